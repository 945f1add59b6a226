//! Shading normals per corner.

use fantex_mesh::{Mesh, corner_normals};
use glam::Vec3;

use crate::Hit;

/// Where a mesh has no normals of its own, edges that bend less than this are shown smooth.
pub const CREASE_DEGREES: f32 = 60.0;

/// Unit shading normals of a mesh, one per corner.
#[derive(Clone, Debug)]
pub(crate) struct CornerNormals {
    normals: Vec<Vec3>,
}

impl CornerNormals {
    /// The mesh's own normals, or smooth ones with creases where it has none.
    pub(crate) fn of_mesh(mesh: &Mesh) -> Self {
        let own = &mesh.corners.normals;
        Self {
            normals: if own.len() == 3 * mesh.triangles.len() {
                own.clone()
            } else {
                corner_normals(mesh, CREASE_DEGREES)
            },
        }
    }

    /// The normals at a triangle's corners; the facet's own where a corner has none.
    pub(crate) fn corners(&self, mesh: &Mesh, triangle: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|k| {
            let n = self.normals[3 * triangle + k];
            if n.is_finite() && n.length_squared() > 0.25 { n } else { face_normal(mesh, triangle) }
        })
    }

    /// The interpolated unit normal on the front side.
    pub(crate) fn at(&self, mesh: &Mesh, hit: &Hit) -> Vec3 {
        let corners = self.corners(mesh, hit.triangle);
        hit.blend(corners).try_normalize().unwrap_or_else(|| face_normal(mesh, hit.triangle))
    }
}

/// Unit normal of a facet, towards its front.
pub(crate) fn face_normal(mesh: &Mesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle).map(|p| p.as_dvec3());
    (b - a).cross(c - a).try_normalize().map_or(Vec3::Z, |n| n.as_vec3())
}

/// Angles at the corners in radians.
pub(crate) fn corner_angles(p: [Vec3; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| {
        let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
        a.cross(b).length().atan2(a.dot(b))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles that meet at an edge along x, the second one bent down by `degrees`.
    fn roof(degrees: f32) -> Mesh {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.5, -cos, -sin)];
        Mesh { positions, triangles: vec![[0, 1, 2], [1, 0, 3]], ..Mesh::default() }
    }

    #[test]
    fn soft_edges_are_smooth_and_sharp_ones_are_not() {
        let at_edge = |mesh: &Mesh| CornerNormals::of_mesh(mesh).corners(mesh, 0)[0];
        assert!((at_edge(&roof(90.0)) - Vec3::Z).length() < 1e-6);
        let bent = at_edge(&roof(30.0));
        assert!(bent.y < -0.1 && bent.z > 0.9, "{bent}");
    }

    #[test]
    fn unusable_normals_are_replaced_by_the_facets() {
        let mut mesh = roof(30.0);
        mesh.corners.normals = vec![Vec3::ZERO, Vec3::NAN, Vec3::X, Vec3::Z, Vec3::Z, Vec3::Z];
        assert_eq!(CornerNormals::of_mesh(&mesh).corners(&mesh, 0), [Vec3::Z, Vec3::Z, Vec3::X]);
    }
}
