//! The space in which recipes and mappings are evaluated.

use fantex_mesh::Mesh;
use fantex_texture::Bounds;
use glam::Vec3;

/// World units and axes, with the origin at the mesh's centre: recipes keep their real size, and models far from the
/// world's origin keep their precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldSpace {
    /// World units per mesh unit.
    scale: f32,
}

impl WorldSpace {
    /// That of a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        Self { scale: mesh.world_from_mesh.scale as f32 }
    }

    /// The mesh's bounding box in this space.
    pub fn bounds(mesh: &Mesh) -> Bounds {
        let (low, high) = mesh
            .positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
        let scale = mesh.world_from_mesh.scale as f32;
        Bounds { min: low * scale, max: high * scale }
    }

    pub(crate) fn point(&self, p_mesh: Vec3) -> Vec3 {
        p_mesh * self.scale
    }

    pub(crate) fn steps(&self, steps_mesh: [Vec3; 2]) -> [Vec3; 2] {
        steps_mesh.map(|s| s * self.scale)
    }
}
