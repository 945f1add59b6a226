//! Making the orientation of neighbouring triangles agree.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::star::Star;
use crate::VertexCorners;

/// Marks an edge that has no single neighbour.
const NONE: u32 = u32::MAX;

/// Which triangles to turn, and what could not be decided.
pub(super) struct Turning {
    /// One flag per triangle.
    pub(super) turn: Vec<bool>,
    /// Patches that have no consistent orientation (they contain a Moebius strip); their seam stays.
    pub(super) non_orientable: u64,
}

/// Decides which triangles to turn so that neighbours across edges with exactly two triangles agree: in each patch the
/// minority (for a tie, those that disagree with its first triangle).
///
/// A patch is what hangs together through such edges. With `outward`, closed patches of negative volume are turned as a
/// whole as well.
pub(super) fn decide(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    corners: &VertexCorners,
    outward: bool,
) -> Turning {
    let neighbours = neighbours(triangles, corners);
    let mut turning = Turning { turn: vec![false; triangles.len()], non_orientable: 0 };
    let mut visited = vec![false; triangles.len()];
    let mut patch = Vec::new();
    for seed in 0..triangles.len() {
        if visited[seed] {
            continue;
        }
        patch.clear();
        let is_orientable =
            flood(seed as u32, triangles, &neighbours, &mut visited, &mut turning.turn, &mut patch);
        turning.non_orientable += u64::from(!is_orientable);
        let turned = patch.iter().filter(|&&t| turning.turn[t as usize]).count();
        let is_closed = || patch.iter().all(|&t| neighbours[t as usize].iter().all(|&h| h != NONE));
        let mut invert = 2 * turned > patch.len();
        if outward && is_orientable && is_closed() {
            invert = signed_volume(positions, triangles, &patch, &turning.turn) < 0.0;
        }
        if invert {
            patch.iter().for_each(|&t| turning.turn[t as usize] ^= true);
        }
    }
    turning
}

/// For every half-edge the opposite one, where exactly two triangles meet.
fn neighbours(triangles: &[[u32; 3]], corners: &VertexCorners) -> Vec<[u32; 3]> {
    let opposite: Vec<[AtomicU32; 3]> = triangles.iter().map(|_| [NONE; 3].map(AtomicU32::new)).collect();
    let set = |from: u32, to: u32| opposite[from as usize / 3][from as usize % 3].store(to, Relaxed);
    (0..corners.len()).into_par_iter().with_min_len(1 << 12).for_each_init(Star::default, |star, v| {
        star.gather(v as u32, corners.at(v), triangles);
        for edge in star.edges().filter(|edge| edge.other() > v as u32 && edge.len() == 2) {
            let mut both = edge.half_edges();
            if let (Some(a), Some(b)) = (both.next(), both.next()) {
                set(a, b);
                set(b, a);
            }
        }
    });
    opposite.into_iter().map(|row| row.map(AtomicU32::into_inner)).collect()
}

/// Walks breadth first over the patch of `seed`, setting flags relative to it; false if two ways round disagree.
///
/// Neighbours are taken by ascending index, so the way does not depend on how triangles are turned.
fn flood(
    seed: u32,
    triangles: &[[u32; 3]],
    neighbours: &[[u32; 3]],
    visited: &mut [bool],
    turn: &mut [bool],
    patch: &mut Vec<u32>,
) -> bool {
    let origin = |half_edge: u32| triangles[half_edge as usize / 3][half_edge as usize % 3];
    let mut is_orientable = true;
    visited[seed as usize] = true;
    patch.push(seed);
    let mut head = 0;
    while let Some(&t) = patch.get(head) {
        head += 1;
        let mut across: [(u32, bool); 3] = std::array::from_fn(|k| match neighbours[t as usize][k] {
            NONE => (NONE, false),
            h => (h / 3, turn[t as usize] ^ (origin(h) == triangles[t as usize][k])),
        });
        across.sort_unstable();
        for (n, should_turn) in across.into_iter().filter(|&(n, _)| n != NONE) {
            if !visited[n as usize] {
                visited[n as usize] = true;
                turn[n as usize] = should_turn;
                patch.push(n);
            } else if turn[n as usize] != should_turn {
                is_orientable = false;
            }
        }
    }
    is_orientable
}

/// Six times the volume enclosed by a closed patch, relative to a point on it.
fn signed_volume(positions: &[Vec3], triangles: &[[u32; 3]], patch: &[u32], turn: &[bool]) -> f64 {
    let at = |v: u32| positions[v as usize].as_dvec3();
    let origin = patch.first().map_or(DVec3::ZERO, |&t| at(triangles[t as usize][0]));
    let volumes = patch.iter().map(|&t| {
        let [a, b, c] = triangles[t as usize].map(|v| at(v) - origin);
        let volume = a.dot(b.cross(c));
        if turn[t as usize] { -volume } else { volume }
    });
    volumes.sum()
}
