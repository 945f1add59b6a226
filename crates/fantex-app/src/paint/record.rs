//! What the hand does in the terms of stroke files, for the asset's log.

use std::path::PathBuf;

use fantex_paint::{
    self as engine, ChannelKindName, ChannelSettings, ColorSettings, Paint, PaintColor, SampleSettings, Size,
    StrokeSettings, Surface, SurfacePoint, ToolSettings, Where,
};
use fantex_store::{Channel, ChannelKind};

use super::pen::world_position;
use super::texture::ChosenTexture;

/// What a paint is made of, besides constants.
#[derive(Clone, Debug, Default)]
pub(super) struct Ingredients {
    /// The texture of the base colour.
    pub(super) texture: Option<ChosenTexture>,
    /// The picture of the base colour.
    pub(super) picture: Option<PathBuf>,
}

/// A stroke that paints so; where it paints comes on top.
pub(super) fn recorded(
    label: &str,
    paint: &Paint,
    channels: &[Channel],
    ingredients: &Ingredients,
    surface: &Surface,
) -> StrokeSettings {
    let world_from_mesh = surface.mesh().world_from_mesh;
    let tool = match paint.tool {
        engine::Tool::Paint(mode) => ToolSettings::Paint(mode),
        engine::Tool::Erase => ToolSettings::Erase,
        engine::Tool::Smudge { strength } => ToolSettings::Smudge { strength },
        engine::Tool::Blur { radius } => {
            ToolSettings::Blur { radius: Size::World((f64::from(radius) * world_from_mesh.scale) as f32) }
        }
        // Where from is added where it is known where to.
        engine::Tool::Clone { .. } => ToolSettings::Clone { from: [0.0; 3] },
    };
    let color = |color: &PaintColor| match (color, &ingredients.texture, &ingredients.picture) {
        (PaintColor::Constant(color), _, _) => ColorSettings::Linear(color.to_array()),
        (PaintColor::Texture(_), Some(chosen), _) => {
            ColorSettings::Texture { look: chosen.look(), name: chosen.name.clone() }
        }
        (PaintColor::Image(_) | PaintColor::Projected(_), _, Some(path)) => {
            ColorSettings::Image(path.clone())
        }
        _ => ColorSettings::default(),
    };
    let settings = paint.channels.iter().map(|painted| ChannelSettings {
        kind: kind_name(channels[painted.channel].kind),
        color: color(&painted.color),
    });
    StrokeSettings {
        label: label.to_owned(),
        brush: engine::BrushSettings { opacity: paint.opacity, ..engine::BrushSettings::default() },
        tool,
        channels: settings.collect(),
        ..StrokeSettings::default()
    }
}

/// A point as a sample.
pub(super) fn sample_at(surface: &Surface, point: SurfacePoint) -> SampleSettings {
    // Made fit for other meshes when it is recorded.
    let at = Where::Position(world_position(surface, point).to_array());
    let is_exact = point.lambda.min_element() >= 0.0;
    let exact = Where::Point { triangle: point.triangle, lambda: point.lambda.to_array() };
    SampleSettings { at: if is_exact { exact } else { at }, pressure: 1.0, tilt: [0.0; 2], time: 0.0 }
}

fn kind_name(kind: ChannelKind) -> ChannelKindName {
    match kind {
        ChannelKind::BaseColor => ChannelKindName::BaseColor,
        ChannelKind::Normal => ChannelKindName::Normal,
        ChannelKind::OcclusionRoughnessMetallic => ChannelKindName::OcclusionRoughnessMetallic,
        ChannelKind::Emission => ChannelKindName::Emission,
        ChannelKind::Displacement => ChannelKindName::Displacement,
        ChannelKind::Light => ChannelKindName::Light,
        ChannelKind::Anisotropy => ChannelKindName::Anisotropy,
    }
}
