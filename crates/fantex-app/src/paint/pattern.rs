//! Patterns in space as paint: solids by their names.

use std::sync::Arc;

use fantex_paint::{PaintColor, Surface};
use fantex_texture::{Bounds, SOLID_NAMES, ShadingPoint, Solid, SolidPoint, Texture, solid_by_name};
use glam::{Vec3, Vec4};

/// A solid as a texture of object space.
struct Pattern(Box<dyn Solid>);

impl Texture for Pattern {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let point = SolidPoint { p: at.position, n: at.normal, footprint: at.width(), time: at.time };
        Vec4::from_array(self.0.color(&point))
    }
}

/// The names of patterns.
pub const PATTERNS: [&str; 8] = SOLID_NAMES;

/// A pattern scaled to a model; nothing where there is none of that name.
pub(super) fn pattern(name: &str, surface: &Surface) -> Option<PaintColor> {
    let mesh = surface.mesh();
    let scale = mesh.world_from_mesh.scale as f32;
    let positions = || mesh.positions.iter().map(|p| *p * scale);
    let min = positions().fold(Vec3::INFINITY, Vec3::min);
    let max = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
    let solid = solid_by_name(name, Bounds { min, max }, 1).ok()?;
    Some(PaintColor::Texture(Arc::new(Pattern(solid))))
}
