//! Vertex normals as the baker and the renderer interpolate them.

use fantex_mesh::Mesh;
use glam::Vec3;

/// Unit normals per corner: the mesh's own, or smooth ones.
pub fn shading_normals(mesh: &Mesh) -> Vec<Vec3> {
    let face = |t: usize| {
        let [a, b, c] = mesh.triangle_positions(t);
        (b - a).cross(c - a).normalize_or(Vec3::Z)
    };
    (0..3 * mesh.triangles.len())
        .map(|corner| mesh.corners.normals.get(corner).copied().unwrap_or_else(|| face(corner / 3)))
        .collect()
}
