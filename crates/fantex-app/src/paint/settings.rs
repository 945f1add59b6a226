//! What the painter remembers from one start to the next.

use std::path::PathBuf;

use eframe::egui::{Key, Modifiers};
use fantex::glam::Vec4;
use fantex::mesh::AlphaMode;
use fantex::paint::{ChannelPaint, ColorFill, FillSettings, PaintColor};
use fantex::store::{Channel, ChannelKind};
use serde::{Deserialize, Serialize};

use crate::command::{Command, Section, Shortcut};
use crate::paint::colors::linear_of;
use crate::paint::{
    BrushSettings, Colors, GradientSettings, StencilSettings, SymmetrySettings, TextureChoice,
};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PaintSettings {
    pub tool: PaintTool,
    pub brush: BrushSettings,
    pub colors: Colors,
    /// A texture that is painted instead of the foreground.
    pub texture: TextureChoice,
    pub stencil: StencilSettings,
    pub channels: ChannelSwitches,
    /// With what besides the colour.
    pub material: Material,
    pub symmetry: SymmetrySettings,
    pub fill: FillReach,
    /// Degrees by which an edge bends that ends a fill.
    pub fill_degrees: f32,
    /// Largest distance of colours that a fill takes for the same, 0..2.
    pub fill_tolerance: f32,
    pub gradient: GradientSettings,
    /// Where the tool *Opacity* brings the opacity, 0..1.
    pub opacity_to: f32,
    /// Share of a colour that smudging carries over a radius of the brush, 0..1.
    pub smudge: f32,
    pub sticker: StickerKind,
    pub text: String,
    pub picture: Option<PathBuf>,
    pub picture_use: PictureUse,
    /// How it is turned, degrees.
    pub sticker_degrees: f32,
    /// How far around blurring looks, diameters of the brush.
    pub blur_radius: f32,
    /// -1 for a pen that needs much force, 1 for one that needs little.
    pub pen_softness: f32,
    /// Whether `Alt` + drag turns the view; then strokes may begin beside the model.
    pub alt_turns: bool,
    pub has_brush_panel: bool,
    pub has_layer_panel: bool,
}

impl Default for PaintSettings {
    fn default() -> Self {
        Self {
            tool: PaintTool::Paint,
            brush: BrushSettings::default(),
            colors: Colors::default(),
            texture: TextureChoice::default(),
            stencil: StencilSettings::default(),
            channels: ChannelSwitches::default(),
            material: Material::default(),
            symmetry: SymmetrySettings::default(),
            fill: FillReach::default(),
            fill_degrees: 30.0,
            fill_tolerance: 0.1,
            gradient: GradientSettings::default(),
            opacity_to: 0.0,
            smudge: 0.8,
            sticker: StickerKind::Text,
            text: "fantex".into(),
            picture: None,
            picture_use: PictureUse::default(),
            sticker_degrees: 0.0,
            blur_radius: 0.15,
            pen_softness: 0.0,
            alt_turns: false,
            has_brush_panel: true,
            has_layer_panel: true,
        }
    }
}

// What the pen does.

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PaintTool {
    #[default]
    Paint,
    Erase,
    Opacity,
    Fill,
    Gradient,
    Blur,
    Smudge,
    Clone,
    Sticker,
    Pick,
}

impl PaintTool {
    pub const ALL: [(Self, &'static str); 10] = [
        (Self::Paint, "Paint"),
        (Self::Erase, "Erase"),
        (Self::Opacity, "Opacity"),
        (Self::Fill, "Fill"),
        (Self::Gradient, "Gradient"),
        (Self::Blur, "Blur"),
        (Self::Smudge, "Smudge"),
        (Self::Clone, "Clone"),
        (Self::Sticker, "Text and pictures"),
        (Self::Pick, "Pick colour"),
    ];

    /// What to do with it, for the line below the window.
    pub fn hint(self) -> &'static str {
        match self {
            Self::Paint => "Drag paints, Shift + click draws a straight line, Alt + click picks a colour",
            Self::Erase => "Drag takes away what was painted on the layer, Shift + click in a straight line",
            Self::Opacity => "Drag lowers or raises the opacity and leaves the colour",
            Self::Fill => "Click fills the part of the surface under the cursor",
            Self::Gradient => "Drag from where the foreground is to where it ends; Esc gives it up",
            Self::Blur => "Drag averages what is there",
            Self::Smudge => "Drag takes the colours along",
            Self::Sticker => {
                "Click puts the text or the picture there; drag it and its handles, Enter applies, Esc takes it away"
            }
            Self::Clone => "Alt + click says from where, then drag copies",
            Self::Pick => "Click takes the colour from the surface",
        }
    }

    pub fn has_brush(self) -> bool {
        !matches!(self, Self::Fill | Self::Gradient | Self::Sticker | Self::Pick)
    }

    /// Whether it lays the chosen colour on.
    pub fn has_color(self) -> bool {
        matches!(self, Self::Paint | Self::Fill | Self::Sticker)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FillReach {
    #[default]
    Connected,
    Angle,
    Color,
    AllOfColor,
    Whole,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StickerKind {
    #[default]
    Text,
    Picture,
}

impl StickerKind {
    pub const ALL: [(Self, &'static str); 2] = [(Self::Text, "Text"), (Self::Picture, "Picture")];
}

/// What a picture that is laid onto the surface shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PictureUse {
    #[default]
    Color,
    /// A normal map: red to the right, green upwards.
    Normal,
    /// Brightness: 0.5 is level.
    Height,
}

impl PictureUse {
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Color, "Colour"), (Self::Normal, "Normal"), (Self::Height, "Height")];

    pub fn kind(self) -> ChannelKind {
        match self {
            Self::Color => ChannelKind::BaseColor,
            Self::Normal => ChannelKind::Normal,
            Self::Height => ChannelKind::Displacement,
        }
    }
}

impl FillReach {
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Connected, "Connected part"),
        (Self::Angle, "Up to edges"),
        (Self::Color, "Same colour"),
        (Self::AllOfColor, "Same colour anywhere"),
        (Self::Whole, "Everything"),
    ];

    /// As the engine knows it; an edge bends by more than `degrees`. Colours differ by at most
    /// `tolerance`, 0..2.
    pub fn fill(self, degrees: f32, tolerance: f32) -> FillSettings {
        let by_color =
            |connected| FillSettings::Color(ColorFill { tolerance, softness: 0.5 * tolerance, connected });
        match self {
            Self::Connected => FillSettings::Connected,
            Self::Angle => FillSettings::Angle(degrees),
            Self::Whole => FillSettings::Whole,
            Self::Color => by_color(true),
            Self::AllOfColor => by_color(false),
        }
    }
}

// Which of the asset's channels a brush paints, and with what.

/// Channels that a brush paints, where the asset has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ChannelSwitches {
    pub color: bool,
    /// Some of occlusion, roughness and metallic.
    pub material: bool,
    /// Which of them, in that order.
    pub components: [bool; 3],
    pub emission: bool,
    /// Normal: towards the mesh's own.
    pub normal: bool,
    /// Displacement.
    pub height: bool,
}

impl Default for ChannelSwitches {
    fn default() -> Self {
        Self {
            color: true,
            material: false,
            components: [true; 3],
            emission: false,
            normal: false,
            height: false,
        }
    }
}

/// What is painted besides the base colour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Material {
    /// 0 a mirror, 1 dull.
    pub roughness: f32,
    /// 0 or 1, mostly.
    pub metallic: f32,
    /// 1 lets all light in.
    pub occlusion: f32,
    /// sRGB.
    pub emission: [u8; 3],
    /// 0..1.
    pub height: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self { roughness: 0.5, metallic: 0.0, occlusion: 1.0, emission: [0xff, 0xd4, 0x8a], height: 0.5 }
    }
}

impl ChannelSwitches {
    /// One kind of channel alone.
    pub fn only(kind: ChannelKind) -> Self {
        let mut switches = Self { color: false, ..Self::default() };
        if let Some(switch) = switches.of(kind) {
            *switch = true;
        }
        switches
    }

    pub fn paints(&self, kind: ChannelKind) -> bool {
        match kind {
            ChannelKind::BaseColor => self.color,
            ChannelKind::OcclusionRoughnessMetallic => self.material && self.components != [false; 3],
            ChannelKind::Emission => self.emission,
            ChannelKind::Normal => self.normal,
            ChannelKind::Displacement => self.height,
            ChannelKind::Light | ChannelKind::Anisotropy => false,
        }
    }

    /// The switch of a kind of channel; light and anisotropy are not painted.
    pub fn of(&mut self, kind: ChannelKind) -> Option<&mut bool> {
        match kind {
            ChannelKind::BaseColor => Some(&mut self.color),
            ChannelKind::OcclusionRoughnessMetallic => Some(&mut self.material),
            ChannelKind::Emission => Some(&mut self.emission),
            ChannelKind::Normal => Some(&mut self.normal),
            ChannelKind::Displacement => Some(&mut self.height),
            ChannelKind::Light | ChannelKind::Anisotropy => None,
        }
    }

    /// What a stroke paints into an asset's channels. `color` is the base colour, linear RGBA.
    pub fn paint(&self, channels: &[Channel], color: Vec4, material: &Material) -> Vec<ChannelPaint> {
        let chosen = channels.iter().enumerate().filter(|(_, channel)| self.paints(channel.kind));
        chosen
            .map(|(index, channel)| {
                let value = material.value(channel.kind, color);
                let is_material = channel.kind == ChannelKind::OcclusionRoughnessMetallic;
                let components = if is_material { self.components } else { [true; 3] };
                ChannelPaint { channel: index, color: PaintColor::Constant(value), components }
            })
            .collect()
    }
}

/// What the model's materials make of the opacity of the base colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlphaShown {
    #[default]
    Opaque,
    CutOut,
    Blended,
}

impl AlphaShown {
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Opaque, "Not at all"), (Self::CutOut, "Cut out below 50 %"), (Self::Blended, "Blended")];

    /// Of a material.
    pub fn of(mode: AlphaMode) -> Self {
        match mode {
            AlphaMode::Opaque => Self::Opaque,
            AlphaMode::Mask(_) => Self::CutOut,
            AlphaMode::Blend => Self::Blended,
        }
    }

    pub fn mode(self) -> AlphaMode {
        match self {
            Self::Opaque => AlphaMode::Opaque,
            Self::CutOut => AlphaMode::Mask(0.5),
            Self::Blended => AlphaMode::Blend,
        }
    }
}

/// What a kind of channel is called.
pub fn channel_name(kind: ChannelKind) -> &'static str {
    match kind {
        ChannelKind::BaseColor => "Base colour, opacity",
        ChannelKind::OcclusionRoughnessMetallic => "Occlusion, roughness, metallic",
        ChannelKind::Emission => "Emission",
        ChannelKind::Normal => "Normal",
        ChannelKind::Displacement => "Height",
        ChannelKind::Light => "Light",
        ChannelKind::Anisotropy => "Anisotropy",
    }
}

impl Material {
    /// Linear RGBA of a kind of channel.
    pub(crate) fn value(&self, kind: ChannelKind, color: Vec4) -> Vec4 {
        match kind {
            ChannelKind::BaseColor | ChannelKind::Light => color,
            ChannelKind::OcclusionRoughnessMetallic => {
                Vec4::new(self.occlusion, self.roughness, self.metallic, 1.0)
            }
            ChannelKind::Emission => linear_of(self.emission),
            ChannelKind::Normal | ChannelKind::Anisotropy => Vec4::new(0.5, 0.5, 1.0, 1.0),
            ChannelKind::Displacement => Vec4::new(self.height, self.height, self.height, 1.0),
        }
    }
}

// Keys of the painter, as painters know them. While something is painted they come before those of the viewer.

#[derive(Clone, Debug, PartialEq)]
pub enum PaintCommand {
    Tool(PaintTool),
    /// Larger or smaller, in steps.
    Size(i32),
    /// Harder or softer, in tenths.
    Hardness(i32),
    /// Opacity in per cent.
    Opacity(u32),
    /// Flow in per cent.
    Flow(u32),
    SwapColors,
    ResetColors,
    Undo,
    Redo,
    ToggleSymmetry,
    ToggleStencil,
    /// The pointer moves the picture over the view, or paints.
    AdjustStencil,
    Project,
    AddLayer,
    GroupLayer,
    UngroupLayer,
    /// What lies there and is not applied yet is.
    Apply,
    Save,
    TogglePanels,
}

impl PaintCommand {
    /// Whether it is done again while its key is held.
    pub fn repeats(&self) -> bool {
        matches!(self, Self::Size(_) | Self::Hardness(_) | Self::Undo | Self::Redo)
    }
}

pub fn paint_shortcuts() -> Vec<Shortcut> {
    use PaintCommand::{
        AddLayer, AdjustStencil, Apply, Flow, GroupLayer, Hardness, Opacity, Project, Redo, ResetColors,
        Save, Size, SwapColors, TogglePanels, ToggleStencil, ToggleSymmetry, Tool, Undo, UngroupLayer,
    };
    const NONE: Modifiers = Modifiers::NONE;
    const SHIFT: Modifiers = Modifiers::SHIFT;
    const CONTROL: Modifiers = Modifiers::COMMAND;
    let row = |modifiers, key, command, text| Shortcut {
        command: Command::Paint(command),
        modifiers,
        key,
        text,
        section: Section::Painting,
    };
    let mut rows = vec![
        row(NONE, Key::B, Tool(PaintTool::Paint), "Paint"),
        row(NONE, Key::E, Tool(PaintTool::Erase), "Erase"),
        row(SHIFT, Key::E, Tool(PaintTool::Opacity), "Opacity"),
        row(NONE, Key::G, Tool(PaintTool::Fill), "Fill"),
        row(SHIFT, Key::G, Tool(PaintTool::Gradient), "Gradient"),
        row(NONE, Key::U, Tool(PaintTool::Blur), "Blur"),
        row(NONE, Key::K, Tool(PaintTool::Smudge), "Smudge"),
        row(NONE, Key::C, Tool(PaintTool::Clone), "Clone"),
        row(NONE, Key::T, Tool(PaintTool::Sticker), "Text and pictures"),
        row(NONE, Key::I, Tool(PaintTool::Pick), "Pick a colour (also Alt + click)"),
        row(NONE, Key::OpenBracket, Size(-1), "Smaller brush"),
        row(NONE, Key::CloseBracket, Size(1), "Larger brush"),
        row(SHIFT, Key::OpenBracket, Hardness(-1), "Softer brush"),
        row(SHIFT, Key::CloseBracket, Hardness(1), "Harder brush"),
        row(NONE, Key::X, SwapColors, "Swap colours"),
        row(NONE, Key::D, ResetColors, "Black and white"),
        row(NONE, Key::S, ToggleSymmetry, "Symmetry"),
        row(NONE, Key::N, ToggleStencil, "Picture over the view"),
        row(SHIFT, Key::N, AdjustStencil, "Move that picture"),
        row(CONTROL, Key::J, Project, "Project it onto what is seen"),
        row(CONTROL, Key::Z, Undo, "Undo"),
        row(CONTROL | SHIFT, Key::Z, Redo, "Redo"),
        row(CONTROL | SHIFT, Key::N, AddLayer, "New layer"),
        row(NONE, Key::Enter, Apply, "Apply the text or picture (Esc takes it away)"),
        row(CONTROL, Key::G, GroupLayer, "Group the layer"),
        row(CONTROL | SHIFT, Key::G, UngroupLayer, "Ungroup"),
        row(CONTROL, Key::S, Save, "Save now (it saves by itself, too)"),
        row(NONE, Key::Tab, TogglePanels, "Hide or show the panels"),
    ];
    let digits = [
        Key::Num1,
        Key::Num2,
        Key::Num3,
        Key::Num4,
        Key::Num5,
        Key::Num6,
        Key::Num7,
        Key::Num8,
        Key::Num9,
        Key::Num0,
    ];
    for (key, tenths) in digits.into_iter().zip(1..) {
        rows.push(row(NONE, key, Opacity(10 * tenths), "Opacity"));
        rows.push(row(SHIFT, key, Flow(10 * tenths), "Flow"));
    }
    rows
}
