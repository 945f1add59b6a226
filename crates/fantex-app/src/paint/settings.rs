//! What the painter remembers from one start to the next.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{
    BrushSettings, ChannelSwitches, Colors, FillReach, Material, PaintTool, StencilSettings, StickerKind,
    SymmetrySettings, TextureChoice,
};

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
