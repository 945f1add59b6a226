//! Evening out a surface's triangles without moving the surface: vertices slide along it.

use glam::Vec3;
use rayon::prelude::*;

use crate::VertexCorners;

/// Moves every vertex by `share` of the way towards the mean of its neighbours, within its tangent plane, `rounds` times
/// (tangential Laplacian smoothing).
pub(super) fn relax(positions: &mut Vec<Vec3>, triangles: &[[u32; 3]], share: f32, rounds: u32) {
    let corners = VertexCorners::of(triangles, positions.len());
    for _ in 0..rounds {
        *positions = (0..positions.len())
            .into_par_iter()
            .with_min_len(1 << 12)
            .map(|v| relaxed(v, positions, triangles, corners.at(v), share))
            .collect();
    }
}

fn relaxed(v: usize, positions: &[Vec3], triangles: &[[u32; 3]], corners: &[u32], share: f32) -> Vec3 {
    let p = positions[v];
    let (mut normal, mut pull) = (Vec3::ZERO, Vec3::ZERO);
    for &corner in corners {
        let (triangle, k) = (triangles[corner as usize / 3], corner as usize % 3);
        let [next, previous] = [1, 2].map(|i| positions[triangle[(k + i) % 3] as usize] - p);
        normal += next.cross(previous);
        pull += next;
    }
    let pull = pull / corners.len().max(1) as f32;
    let normal = normal.normalize_or_zero();
    p + share * (pull - normal * pull.dot(normal))
}
