//! Moving vertices along a surface: to even its triangles out, or to make them uneven.

use glam::Vec3;
use rayon::prelude::*;

use crate::generate::noise::Noise;
use crate::{VertexCorners, unit_vector};

/// Share of the way to the mean of the neighbours that one round moves a vertex.
const SHARE: f32 = 0.5;
/// Rounds of evening out.
const ROUNDS: u32 = 3;

/// Moves every vertex towards the mean of its neighbours within its tangent plane (tangential Laplacian smoothing), which
/// evens out the slivers of marching tetrahedra.
pub(super) fn relax(positions: &mut Vec<Vec3>, triangles: &[[u32; 3]], corners: &VertexCorners) {
    for _ in 0..ROUNDS {
        *positions = moved(positions, triangles, corners, |_, star| {
            star.p + SHARE * (star.pull - star.normal * star.pull.dot(star.normal))
        });
    }
}

/// Moves every vertex in a random direction within its tangent plane, at most `amount` (0..1) of a third of its shortest
/// edge: neighbours do not meet.
pub(super) fn scatter(
    positions: &mut Vec<Vec3>,
    triangles: &[[u32; 3]],
    corners: &VertexCorners,
    amount: f32,
) {
    let random = Noise::new(0, 40);
    *positions = moved(positions, triangles, corners, |v, star| {
        let (x, y) = star.normal.any_orthonormal_pair();
        let direction = unit_vector(std::f32::consts::TAU * random.uniform(2 * v as u32));
        let way = amount * star.shortest / 3.0 * random.uniform(2 * v as u32 + 1).sqrt();
        star.p + way * (x * direction.x + y * direction.y)
    });
}

/// What a vertex' triangles say about it.
struct Star {
    p: Vec3,
    /// Unit normal.
    normal: Vec3,
    /// To the mean of the neighbours.
    pull: Vec3,
    /// Length of the shortest edge.
    shortest: f32,
}

/// All vertices after `step`, which sees the positions before.
fn moved(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    corners: &VertexCorners,
    step: impl Fn(usize, Star) -> Vec3 + Sync,
) -> Vec<Vec3> {
    (0..positions.len())
        .into_par_iter()
        .with_min_len(1 << 12)
        .map(|v| step(v, star(positions[v], positions, triangles, corners.at(v))))
        .collect()
}

fn star(p: Vec3, positions: &[Vec3], triangles: &[[u32; 3]], corners: &[u32]) -> Star {
    let (mut normal, mut pull, mut shortest) = (Vec3::ZERO, Vec3::ZERO, f32::MAX);
    for &corner in corners {
        let (triangle, k) = (triangles[corner as usize / 3], corner as usize % 3);
        let [next, previous] = [1, 2].map(|i| positions[triangle[(k + i) % 3] as usize] - p);
        normal += next.cross(previous);
        pull += next;
        shortest = shortest.min(next.length());
    }
    Star {
        p,
        normal: normal.try_normalize().unwrap_or(Vec3::Y),
        pull: pull / corners.len().max(1) as f32,
        shortest,
    }
}
