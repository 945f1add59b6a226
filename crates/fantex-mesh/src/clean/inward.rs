//! Parts of a mesh that are surely inside out.

use glam::Vec3;

use super::topology::{NONE, flood, neighbours, signed_volume};
use crate::{Mesh, VertexCorners};

/// Pairs of parts that are compared. Of more nothing is known.
const MAX_PAIRS: usize = 10_000_000;

/// Where the volume of a part is a smaller share of the cube over the diagonal of its box, it has no inside.
const MIN_VOLUME: f64 = 1e-9;

/// Closed parts whose fronts lie inside, where nobody can be: the triangles of each. A part may also be a room, which has its fronts inside
/// on purpose, or the hollow of another part. So parts with one of `inside` (mesh space) or another part in their box are left out, and so are
/// those in the box of a closed part whose fronts lie outside.
pub fn inward_parts(mesh: &Mesh, inside: &[Vec3]) -> Vec<Vec<u32>> {
    let triangles = &mesh.triangles;
    let neighbours = neighbours(triangles, &VertexCorners::of(triangles, mesh.positions.len()));
    let mut visited = vec![false; triangles.len()];
    let mut turn = vec![false; triangles.len()];
    let (mut parts, mut inward) = (Vec::new(), Vec::new());
    for seed in 0..triangles.len() {
        if visited[seed] {
            continue;
        }
        let mut patch = Vec::new();
        let is_orientable = flood(seed as u32, triangles, &neighbours, &mut visited, &mut turn, &mut patch);
        let is_consistent = is_orientable && !patch.iter().any(|&t| turn[t as usize]);
        let is_closed = patch.iter().all(|&t| neighbours[t as usize].iter().all(|&h| h != NONE));
        let corners = patch.iter().flat_map(|&t| mesh.triangle_positions(t as usize));
        let empty = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let [low, high] = corners.fold(empty, |[low, high], p| [low.min(p), high.max(p)]);
        let mut volume = 0.0;
        if is_consistent && is_closed {
            volume = signed_volume(&mesh.positions, triangles, &patch, &turn);
        }
        let least = MIN_VOLUME * f64::from(low.distance(high)).powi(3);
        if volume < -least {
            inward.push((parts.len(), patch));
        }
        parts.push(Part { low, high, is_outward: volume > least });
    }
    if inward.len().saturating_mul(parts.len()) > MAX_PAIRS {
        return Vec::new();
    }
    inward.retain(|&(index, _)| {
        let part = &parts[index];
        let is_room_or_hollow = |(other, of): (usize, &Part)| {
            other != index
                && (part.holds(of.low.midpoint(of.high))
                    || (of.is_outward && of.holds(part.low) && of.holds(part.high)))
        };
        !inside.iter().any(|&point| part.holds(point)) && !parts.iter().enumerate().any(is_room_or_hollow)
    });
    inward.into_iter().map(|(_, patch)| patch).collect()
}

/// The box of a part, and whether it is closed with its fronts outside.
struct Part {
    low: Vec3,
    high: Vec3,
    is_outward: bool,
}

impl Part {
    fn holds(&self, point: Vec3) -> bool {
        point.cmpge(self.low).all() && point.cmple(self.high).all()
    }
}
