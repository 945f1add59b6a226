//! Corner normals and the fronts of triangles.

use glam::{DVec3, Vec3};

use crate::Mesh;

/// Twice a triangle's area as its corner normals see it, a third for each: positive for those on its front, negative for those behind.
pub(super) fn area_in_front([a, b, c]: [Vec3; 3], normals: &[Vec3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
    let front = (b - a).cross(c - a);
    let sides = normals.iter().map(|normal| side(front, *normal));
    front.length() * sides.sum::<f64>() / 3.0
}

/// 1 in front, -1 behind, 0 where neither can be said.
fn side(front: DVec3, normal: Vec3) -> f64 {
    let cosine = front.dot(normal.as_dvec3());
    f64::from(i8::from(cosine > 0.0) - i8::from(cosine < 0.0))
}

/// Turns normals of turned triangles round that point away from the new front, as whoever shows the back of a triangle does. Bitangents, which
/// are products of normals and tangents, stay.
pub(super) fn reverse_opposed(mesh: &mut Mesh, turned: &[bool]) {
    for (t, _) in turned.iter().enumerate().filter(|(_, turned)| **turned) {
        let front = mesh.facet_normal(t);
        for corner in 3 * t..3 * t + 3 {
            let normal = mesh.corners.normals.get_mut(corner);
            if normal.as_ref().is_some_and(|normal| side(front, **normal) >= 0.0) {
                continue;
            }
            if let Some(normal) = normal {
                // A difference, so that no zero is negative.
                *normal = Vec3::ZERO - *normal;
            }
            if let Some(tangent) = mesh.corners.tangents.get_mut(corner) {
                tangent.w = -tangent.w;
            }
        }
    }
}
