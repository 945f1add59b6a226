//! The tables of a stroke file.

use std::path::PathBuf;

use fantex_store::ChannelKind;
use serde::{Deserialize, Serialize};

use crate::{BlendMode, FillScope, Jitter, PressureResponse, Size, Symmetry};

/// A stroke file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrokeFile {
    /// 1.
    pub version: u32,
    /// In order.
    pub strokes: Vec<StrokeSettings>,
}

/// One stroke or fill.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrokeSettings {
    /// Its name in the history.
    #[serde(default = "default_label")]
    pub label: String,
    /// With what.
    #[serde(default)]
    pub brush: BrushSettings,
    /// How.
    #[serde(default)]
    pub tool: ToolSettings,
    /// Into which channels, together.
    pub channels: Vec<ChannelSettings>,
    /// The way of the pen; for a fill its start.
    pub samples: Vec<SampleSettings>,
    /// Fills instead of painting along the samples.
    #[serde(default)]
    pub fill: Option<FillScope>,
    /// Only the first and the last sample count.
    #[serde(default)]
    pub line: bool,
    /// Copies.
    #[serde(default)]
    pub symmetry: Symmetry,
    /// The layer to paint on, by its name; made on top of the others where there is none. Without it: under all layers.
    #[serde(default)]
    pub layer: Option<LayerSettings>,
}

/// A layer to paint on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerSettings {
    /// Its name.
    pub name: String,
    /// How it lies over what is below; where the layer is made.
    #[serde(default)]
    pub blend: BlendMode,
    /// 0..1; where the layer is made.
    #[serde(default = "full")]
    pub opacity: f32,
}

fn default_label() -> String {
    "stroke".to_owned()
}

/// A [`Brush`](crate::Brush); what is left out is as in its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BrushSettings {
    /// Diameter: `{"texels": 64}` or `{"world": 0.1}`.
    pub size: Size,
    /// 0..1.
    pub hardness: f32,
    /// 0..1.
    pub opacity: f32,
    /// 0..1.
    pub flow: f32,
    /// Diameters.
    pub spacing: f32,
    /// 0..1.
    pub smoothing: f32,
    /// Degrees.
    pub angle: f32,
    /// The stamp turns with the pen's tilt.
    pub follow_tilt: bool,
    /// Random changes.
    pub jitter: Jitter,
    /// What pressure does.
    pub pressure: PressureResponse,
    /// A picture, relative to the stroke file.
    pub stamp: Option<PathBuf>,
    /// Of the jitter.
    pub seed: u64,
}

impl Default for BrushSettings {
    fn default() -> Self {
        let brush = crate::Brush::default();
        Self {
            size: brush.size,
            hardness: brush.hardness,
            opacity: brush.opacity,
            flow: brush.flow,
            spacing: brush.spacing,
            smoothing: brush.smoothing,
            angle: brush.angle.to_degrees(),
            follow_tilt: brush.follow_tilt,
            jitter: brush.jitter,
            pressure: brush.pressure,
            stamp: None,
            seed: brush.seed,
        }
    }
}

/// What the stroke does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ToolSettings {
    /// Lays colour over what is there.
    Paint(BlendMode),
    /// Takes alpha away.
    Erase,
    /// Averages what is seen within a radius.
    Blur {
        /// Radius.
        radius: Size,
    },
    /// Copies from elsewhere.
    Clone {
        /// What comes to lie under the first sample: a position in world space.
        from: [f64; 3],
    },
}

impl Default for ToolSettings {
    fn default() -> Self {
        Self::Paint(BlendMode::Normal)
    }
}

/// What goes into a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelSettings {
    /// Which.
    pub kind: ChannelKindName,
    /// What (an eraser needs none).
    #[serde(default)]
    pub color: ColorSettings,
}

/// A colour on the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ColorSettings {
    /// sRGB-encoded, opaque.
    Srgb([f32; 3]),
    /// Linear RGBA with straight alpha; for channels that hold no colour, their values.
    Linear([f32; 4]),
    /// A solid by its name, scaled to the model.
    Solid {
        /// wood, marble, rock, granite, clouds, checker, brick or landscape.
        name: String,
        /// Of its noise.
        #[serde(default)]
        seed: u32,
    },
}

impl Default for ColorSettings {
    /// Black.
    fn default() -> Self {
        Self::Srgb([0.0; 3])
    }
}

/// A channel by its meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "they are the kinds of `fantex_store::ChannelKind`")]
pub enum ChannelKindName {
    BaseColor,
    Normal,
    OcclusionRoughnessMetallic,
    Emission,
    Displacement,
    Light,
}

impl From<ChannelKindName> for ChannelKind {
    fn from(name: ChannelKindName) -> Self {
        match name {
            ChannelKindName::BaseColor => Self::BaseColor,
            ChannelKindName::Normal => Self::Normal,
            ChannelKindName::OcclusionRoughnessMetallic => Self::OcclusionRoughnessMetallic,
            ChannelKindName::Emission => Self::Emission,
            ChannelKindName::Displacement => Self::Displacement,
            ChannelKindName::Light => Self::Light,
        }
    }
}

/// Where the pen was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleSettings {
    /// Where.
    pub at: Where,
    /// 0..1.
    #[serde(default = "full")]
    pub pressure: f32,
    /// Radians along the stamp's x and y axis.
    #[serde(default)]
    pub tilt: [f32; 2],
    /// Seconds.
    #[serde(default)]
    pub time: f32,
}

fn full() -> f32 {
    1.0
}

/// A place on the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Where {
    /// The surface's point nearest to one in world space.
    Position([f64; 3]),
    /// The first one that a ray in world space meets.
    Ray {
        /// Start.
        origin: [f64; 3],
        /// Of any length.
        direction: [f64; 3],
    },
    /// A point of a triangle of this very mesh.
    Point {
        /// Index.
        triangle: u32,
        /// Barycentric coordinates.
        lambda: [f32; 3],
    },
}
