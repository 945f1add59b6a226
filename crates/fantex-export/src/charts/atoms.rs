//! The smallest pieces: connected triangles that belong to one group of the cover.

use fantex_cover::{Cover, GroupKind};
use fantex_mesh::{Edges, Mesh};
use rayon::prelude::*;

use super::{facet_normal, root};

/// An edge that two triangles continue each other across.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    /// The triangles.
    pub(crate) triangles: [u32; 2],
    /// Mesh units.
    pub(crate) length: f32,
}

/// A group that sees a triangle worse than this does not get it.
const LEAST_FACING: f32 = 0.3;

/// All edges that triangles [continue](fantex_mesh::continued) each other across, ordered by their vertices.
pub(crate) fn edges(mesh: &Mesh) -> Vec<Edge> {
    let shared = Edges::of(&mesh.triangles);
    let of_pairs = |edge: fantex_mesh::Edge<'_>| {
        let [a, b] = edge.vertices().map(|v| mesh.positions[v as usize]);
        let length = a.distance(b);
        edge.continued()
            .into_iter()
            .map(move |pair| Edge { triangles: pair.map(|half_edge| half_edge / 3), length })
    };
    shared.iter().flat_map(of_pairs).collect()
}

/// The atom of every triangle, numbered from 0 in the order of their first triangles.
pub(super) fn atoms(mesh: &Mesh, cover: &Cover, edges: &[Edge]) -> Vec<u32> {
    let groups: Vec<Option<u32>> = (0..mesh.triangles.len())
        .into_par_iter()
        .with_min_len(1 << 12)
        .map(|t| group_of(mesh, cover, t))
        .collect();
    let mut parents: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    for [a, b] in edges.iter().map(|e| e.triangles) {
        if groups[a as usize].is_some() && groups[a as usize] == groups[b as usize] {
            let (a, b) = (root(&mut parents, a), root(&mut parents, b));
            parents[a.max(b) as usize] = a.min(b);
        }
    }
    let mut numbers = vec![u32::MAX; parents.len()];
    let mut count = 0;
    (0..parents.len() as u32)
        .map(|t| {
            let number = &mut numbers[root(&mut parents, t) as usize];
            if *number == u32::MAX {
                *number = count;
                count += 1;
            }
            *number
        })
        .collect()
}

/// The projected group that has most of a triangle's corners and, among those, sees it best. None where no group sees it well.
fn group_of(mesh: &Mesh, cover: &Cover, triangle: usize) -> Option<u32> {
    let corner_groups = cover.corner_groups[triangle];
    let normal = facet_normal(mesh, triangle);
    let facing = |g: u32| {
        let group = &cover.groups[g as usize];
        if group.kind == GroupKind::Projected { group.frame.direction.dot(normal) } else { -1.0 }
    };
    let corners = |g: u32| corner_groups.iter().filter(|&&other| other == g).count();
    let seen = corner_groups.into_iter().filter(|&g| facing(g) >= LEAST_FACING);
    seen.max_by(|&a, &b| corners(a).cmp(&corners(b)).then(facing(a).total_cmp(&facing(b))).then(b.cmp(&a)))
}
