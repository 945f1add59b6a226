//! Shading normals per corner.

use fantex_mesh::Mesh;
use glam::Vec3;

use crate::Hit;

/// Unit shading normals of a mesh, one per corner.
#[derive(Clone, Debug)]
pub(crate) struct CornerNormals {
    normals: Vec<Vec3>,
}

impl CornerNormals {
    /// The mesh's own normals, or smooth ones where it has none.
    pub(crate) fn of_mesh(mesh: &Mesh) -> Self {
        let own = &mesh.corners.normals;
        Self { normals: if own.len() == 3 * mesh.triangles.len() { own.clone() } else { smooth(mesh) } }
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

/// Normals of the welded vertices: facet normals weighted by the angle at the vertex (G. Thürmer and C. Wüthrich,
/// "Computing Vertex Normals from Polygonal Facets", 1998).
fn smooth(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; mesh.positions.len()];
    for (t, vertices) in mesh.triangles.iter().enumerate() {
        let normal = face_normal(mesh, t);
        let angles = corner_angles(mesh.triangle_positions(t));
        for (&v, angle) in vertices.iter().zip(angles) {
            sums[v as usize] += normal * angle;
        }
    }
    let of_vertex = |&v: &u32| sums[v as usize].normalize_or_zero();
    mesh.triangles.iter().flatten().map(of_vertex).collect()
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

    #[test]
    fn a_cubes_corner_points_outwards_whatever_its_diagonals() {
        // Three faces around a corner, one of them cut so that it has two triangles there.
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(1.0, 1.0, 0.0)];
        let triangles = vec![[0, 4, 1], [0, 2, 4], [0, 1, 3], [0, 3, 2]];
        let mesh = Mesh { positions, triangles, ..Mesh::default() };
        let normals = CornerNormals::of_mesh(&mesh);
        let expected = Vec3::splat(-1.0).normalize();
        assert!((normals.corners(&mesh, 0)[0] - expected).length() < 1e-6);
    }
}
