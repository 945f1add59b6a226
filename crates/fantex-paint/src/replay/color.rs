//! Colours of stroke files.

use std::sync::Arc;

use fantex_texture::color::linear_from_srgb;
use fantex_texture::{Bounds, ShadingPoint, Solid, SolidPoint, Texture, solid_by_name};
use glam::{Vec3, Vec4};

use super::ReplayError;
use super::file::ColorSettings;
use super::prepare::Preparation;
use crate::{PaintColor, Picture, Surface};

/// What the settings of a colour mean.
pub(super) fn color_of(
    preparation: &Preparation<'_>,
    settings: &ColorSettings,
) -> Result<PaintColor, ReplayError> {
    let stroke = preparation.stroke;
    let surface = preparation.painter.surface();
    let color = match settings {
        ColorSettings::Srgb(color) => Vec3::from(color.map(linear_from_srgb)).extend(1.0),
        ColorSettings::Linear(color) => Vec4::from(*color),
        ColorSettings::Solid { name, seed } => {
            let solid = solid_by_name(name, object_bounds(surface), *seed);
            let solid = solid.map_err(|source| ReplayError::Solid { stroke, source })?;
            return Ok(PaintColor::Texture(Arc::new(NamedSolid(solid))));
        }
        ColorSettings::Texture { look, name } => {
            let texture = preparation.graph(look)?.texture(surface, name);
            let texture =
                texture.map_err(|source| ReplayError::Graph { stroke, source: Box::new(source) })?;
            return Ok(PaintColor::Texture(texture));
        }
        ColorSettings::Image(path) => {
            let picture = Arc::new(Picture::new(&preparation.image(path)?));
            let projection = preparation.projection(Arc::clone(&picture))?;
            return Ok(match projection {
                Some(projection) => PaintColor::Projected(Arc::new(projection)),
                None => PaintColor::Image(picture),
            });
        }
    };
    preparation.finite("a colour", &color.to_array())?;
    Ok(PaintColor::Constant(color))
}

/// A solid that was found by its name, as a texture.
struct NamedSolid(Box<dyn Solid>);

impl Texture for NamedSolid {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let point = SolidPoint { p: at.position, n: at.normal, footprint: at.width(), time: at.time };
        Vec4::from_array(self.0.color(&point))
    }
}

/// The model's bounds in object space.
fn object_bounds(surface: &Surface) -> Bounds {
    let mesh = surface.mesh();
    let scale = mesh.world_from_mesh.scale as f32;
    let positions = || mesh.positions.iter().map(|p| *p * scale);
    let min = positions().fold(Vec3::INFINITY, Vec3::min);
    let max = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
    Bounds { min, max }
}
