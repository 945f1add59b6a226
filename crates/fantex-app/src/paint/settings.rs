//! What the painter remembers from one start to the next.

use std::path::PathBuf;

use eframe::egui::{Key, Modifiers};
use fantex::glam::Vec4;
use fantex::paint::{ChannelPaint, ColorFill, FillSettings, PaintColor};
use fantex::store::{Channel, ChannelKind};
use serde::{Deserialize, Serialize};

use crate::command::{Command, Section, Shortcut};
use crate::paint::colors::linear_of;
use crate::paint::{BrushSettings, Colors, StencilSettings, SymmetrySettings, TextureChoice};

/// Tool, brush, colours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PaintSettings {
    /// The tool.
    pub tool: PaintTool,
    /// The brush of all tools.
    pub brush: BrushSettings,
    /// Colours.
    pub colors: Colors,
    /// A texture that is painted instead of the foreground.
    pub texture: TextureChoice,
    /// A picture over the view.
    pub stencil: StencilSettings,
    /// Which channels are painted.
    pub channels: ChannelSwitches,
    /// With what besides the colour.
    pub material: Material,
    /// Copies of strokes.
    pub symmetry: SymmetrySettings,
    /// How far fills go.
    pub fill: FillReach,
    /// Degrees by which an edge bends that ends a fill.
    pub fill_degrees: f32,
    /// Largest distance of colours that a fill takes for the same, 0..2.
    pub fill_tolerance: f32,
    /// Share of a colour that smudging carries over a radius of the brush, 0..1.
    pub smudge: f32,
    /// What is laid onto the surface.
    pub sticker: StickerKind,
    /// The text of it.
    pub text: String,
    /// The picture of it.
    pub picture: Option<PathBuf>,
    /// How it is turned, degrees.
    pub sticker_degrees: f32,
    /// How far around blurring looks, diameters of the brush.
    pub blur_radius: f32,
    /// Whether the brush panel is shown.
    pub has_brush_panel: bool,
    /// Whether the panel of colours and layers is shown.
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
            smudge: 0.8,
            sticker: StickerKind::Text,
            text: "fantex".into(),
            picture: None,
            sticker_degrees: 0.0,
            blur_radius: 0.15,
            has_brush_panel: true,
            has_layer_panel: true,
        }
    }
}

// What the pen does.

/// A tool of the strip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PaintTool {
    /// Lays colour on.
    #[default]
    Paint,
    /// Takes away what was painted.
    Erase,
    /// Covers a part of the surface at once.
    Fill,
    /// Averages what is there.
    Blur,
    /// Drags what is there along.
    Smudge,
    /// Copies from elsewhere.
    Clone,
    /// Lays a text or a picture onto the surface.
    Sticker,
    /// Takes the colour from the surface.
    Pick,
}

impl PaintTool {
    /// All tools from the top of the strip to its bottom.
    pub const ALL: [Self; 8] = [
        Self::Paint,
        Self::Erase,
        Self::Fill,
        Self::Blur,
        Self::Smudge,
        Self::Clone,
        Self::Sticker,
        Self::Pick,
    ];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Paint => "Paint",
            Self::Erase => "Erase",
            Self::Fill => "Fill",
            Self::Blur => "Blur",
            Self::Smudge => "Smudge",
            Self::Sticker => "Text and pictures",
            Self::Clone => "Clone",
            Self::Pick => "Pick colour",
        }
    }

    /// What to do with it, for the line below the window.
    pub fn hint(self) -> &'static str {
        match self {
            Self::Paint => "Drag paints, Shift + click draws a straight line, Alt + click picks a colour",
            Self::Erase => "Drag takes away what was painted on the layer, Shift + click in a straight line",
            Self::Fill => "Click fills the part of the surface under the cursor",
            Self::Blur => "Drag averages what is there",
            Self::Smudge => "Drag takes the colours along",
            Self::Sticker => "Click lays the text or the picture onto the surface",
            Self::Clone => "Alt + click says from where, then drag copies",
            Self::Pick => "Click takes the colour from the surface",
        }
    }

    /// Whether it has a brush.
    pub fn has_brush(self) -> bool {
        !matches!(self, Self::Fill | Self::Sticker | Self::Pick)
    }

    /// Whether it lays the chosen colour on.
    pub fn has_color(self) -> bool {
        matches!(self, Self::Paint | Self::Fill | Self::Sticker)
    }
}

/// How far a fill goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FillReach {
    /// All that hangs together.
    #[default]
    Connected,
    /// Up to edges that bend.
    Angle,
    /// What looks alike and hangs together.
    Color,
    /// What looks alike anywhere.
    AllOfColor,
    /// Everything.
    Whole,
}

/// What a sticker is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StickerKind {
    /// A text in the foreground's colour.
    #[default]
    Text,
    /// A picture from a file.
    Picture,
}

impl StickerKind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Text, Self::Picture];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Text => "Text",
            Self::Picture => "Picture",
        }
    }
}

impl FillReach {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Connected, Self::Angle, Self::Color, Self::AllOfColor, Self::Whole];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Connected => "Connected part",
            Self::Angle => "Up to edges",
            Self::Color => "Same colour",
            Self::AllOfColor => "Same colour anywhere",
            Self::Whole => "Everything",
        }
    }

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
    /// Base colour.
    pub color: bool,
    /// Occlusion, roughness and metallic, together.
    pub material: bool,
    /// Emission.
    pub emission: bool,
    /// Normal: towards the mesh's own.
    pub normal: bool,
    /// Displacement.
    pub height: bool,
}

impl Default for ChannelSwitches {
    fn default() -> Self {
        Self { color: true, material: false, emission: false, normal: false, height: false }
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
    /// Whether a kind of channel is painted.
    pub fn paints(&self, kind: ChannelKind) -> bool {
        match kind {
            ChannelKind::BaseColor => self.color,
            ChannelKind::OcclusionRoughnessMetallic => self.material,
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
                ChannelPaint { channel: index, color: PaintColor::Constant(value) }
            })
            .collect()
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

/// Something that a key or a button does.
#[derive(Clone, Debug, PartialEq)]
pub enum PaintCommand {
    /// Another tool.
    Tool(PaintTool),
    /// Larger or smaller, in steps.
    Size(i32),
    /// Harder or softer, in tenths.
    Hardness(i32),
    /// Opacity in per cent.
    Opacity(u32),
    /// Flow in per cent.
    Flow(u32),
    /// Foreground and background change places.
    SwapColors,
    /// Black and white.
    ResetColors,
    /// One step back.
    Undo,
    /// One step forth.
    Redo,
    /// Mirror on or off.
    ToggleSymmetry,
    /// The picture over the view on or off.
    ToggleStencil,
    /// The pointer moves the picture over the view, or paints.
    AdjustStencil,
    /// The picture over the view goes onto all that is seen.
    Project,
    /// A layer above the chosen one.
    AddLayer,
    /// Save now.
    Save,
    /// Brush and layer panels on or off.
    TogglePanels,
}

impl PaintCommand {
    /// Whether it is done again while its key is held.
    pub fn repeats(&self) -> bool {
        matches!(self, Self::Size(_) | Self::Hardness(_) | Self::Undo | Self::Redo)
    }
}

/// All keys of the painter.
pub fn paint_shortcuts() -> Vec<Shortcut> {
    use PaintCommand::{
        AddLayer, AdjustStencil, Flow, Hardness, Opacity, Project, Redo, ResetColors, Save, Size, SwapColors,
        TogglePanels, ToggleStencil, ToggleSymmetry, Tool, Undo,
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
        row(NONE, Key::G, Tool(PaintTool::Fill), "Fill"),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::{command_while, parse_keys};

    #[test]
    fn no_key_of_the_painter_has_two_meanings() {
        let all = paint_shortcuts();
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| !(a.key == b.key && a.modifiers == b.modifiers)), "{}", a.text);
            let (modifiers, key) = parse_keys(&a.keys().replace(' ', "")).unwrap();
            assert_eq!(command_while(true, modifiers, key).as_ref(), Some(&a.command));
        }
    }

    #[test]
    fn the_viewer_s_keys_stay_where_painting_needs_none() {
        let help = command_while(true, Modifiers::NONE, Key::F1);
        assert_eq!(help, Some(Command::ToggleHelp));
        assert_eq!(command_while(false, Modifiers::NONE, Key::X), Some(Command::ToggleShadows));
    }
}
