//! Shading normals per corner.

use fantex_mesh::{Mesh, shading_normals};
use glam::Vec3;

use crate::{Hit, SmoothPoint};

/// Unit shading normals of a mesh, one per corner.
#[derive(Clone, Debug)]
pub(crate) struct CornerNormals(Vec<Vec3>);

impl CornerNormals {
    /// See [`shading_normals`].
    pub(crate) fn of_mesh(mesh: &Mesh) -> Self {
        Self(shading_normals(mesh))
    }

    /// One per corner of the mesh.
    pub(crate) fn all(&self) -> &[Vec3] {
        &self.0
    }

    /// The interpolated unit normal on the front side.
    pub(crate) fn at(&self, mesh: &Mesh, hit: &Hit) -> Vec3 {
        let corners = [0, 1, 2].map(|k| self.0[3 * hit.triangle + k]);
        hit.blend(corners).try_normalize().unwrap_or_else(|| face_normal(mesh, hit.triangle))
    }

    /// The interpolated unit normal on the front side, and its change along the pixel's edges, on the side that the eye sees.
    pub(crate) fn with_steps(&self, mesh: &Mesh, hit: &Hit) -> (Vec3, [Vec3; 2]) {
        let corners = [0, 1, 2].map(|k| self.0[3 * hit.triangle + k]);
        let along = |l: Vec3| corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
        let unnormalised = along(hit.lambda);
        let scale = unnormalised.length_recip();
        if !(scale.is_finite() && scale > 0.0) {
            return (face_normal(mesh, hit.triangle), [Vec3::ZERO; 2]);
        }
        let normal = unnormalised * scale;
        let scale = if hit.front { scale } else { -scale };
        let steps = [hit.dlambda_dx, hit.dlambda_dy].map(|change| {
            let step = along(change) * scale;
            step - normal * normal.dot(step)
        });
        (normal, steps)
    }
}

impl CornerNormals {
    /// The point lifted to the planes that stand on the normals at the facet's corners (J. Hanika, "Hacking the Shadow
    /// Terminator", 2021), and the normal there, on the side that the eye sees.
    pub(crate) fn smooth_point(&self, mesh: &Mesh, hit: &Hit) -> SmoothPoint {
        let side = if hit.front { 1.0 } else { -1.0 };
        let positions = mesh.triangle_positions(hit.triangle);
        let point = hit.blend(positions);
        let lift = [0, 1, 2].map(|k| {
            let normal = self.0[3 * hit.triangle + k] * side;
            normal * (positions[k] - point).dot(normal).max(0.0)
        });
        SmoothPoint { offset: hit.blend(lift), normal: self.at(mesh, hit) * side }
    }
}

/// Unit normal of a facet, towards its front.
pub(crate) fn face_normal(mesh: &Mesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle).map(|p| p.as_dvec3());
    (b - a).cross(c - a).try_normalize().map_or(Vec3::Z, |n| n.as_vec3())
}
