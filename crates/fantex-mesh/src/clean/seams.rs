//! Seams whose two sides lie apart by a rounding, as in triangle soups with positions that were computed once per triangle.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::repeats::{Repeat, repeats, scramble};
use crate::VertexCorners;
use crate::fans::Disc;

/// Vertices (ascending) that welding with a tolerance of `distance` mesh units would join to an earlier one so that triangles on both sides go on
/// from each other. Not those of layers, which lie over each other, nor of triangles that are smaller than that. Takes time linear in the
/// boundary; where the two sides are nearly as far apart as that, a few are missed.
pub(super) fn open(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    corners: &VertexCorners,
    distance: f32,
) -> Vec<u32> {
    let boundary = boundary(triangles, corners);
    let mut ends: Vec<u32> = boundary.iter().flat_map(|&half_edge| vertices(triangles, half_edge)).collect();
    ends.par_sort_unstable();
    ends.dedup();
    let mut first: Vec<u32> = (0..positions.len() as u32).collect();
    let mut is_near = vec![false; positions.len()];
    // A border of cells may part a pair once.
    for offset in [0.37, 0.81] {
        let of = |i: usize| ends[i] as usize;
        let found = near(&ends, positions, |i| first[of(i)] == ends[i], distance, offset);
        for Repeat { element, first: other } in found {
            let [vertex, other] = [element, other].map(|i| ends[i as usize]);
            first[vertex as usize] = other;
            [vertex, other].into_iter().for_each(|v| is_near[v as usize] = true);
        }
    }
    let is_far = |a: u32, b: u32| positions[a as usize].distance(positions[b as usize]) > distance;
    let is_at_seam = |&&half_edge: &&u32| {
        let ([from, to], opposite) = half_edge_of(triangles, half_edge);
        // Needles that would have no area left are no sides of a seam.
        (is_near[from as usize] || is_near[to as usize])
            && first[from as usize] != first[to as usize]
            && is_far(opposite, from)
            && is_far(opposite, to)
    };
    let key = |[from, to]: [u32; 2]| u64::from(first[from as usize]) << 32 | u64::from(first[to as usize]);
    let mut sides: Vec<(u64, u32)> = boundary
        .iter()
        .filter(is_at_seam)
        .map(|&half_edge| (key(half_edge_of(triangles, half_edge).0), half_edge))
        .collect();
    sides.par_sort_unstable();
    let goes_on = |&&(_, half_edge): &&(u64, u32)| {
        let ([from, to], opposite) = half_edge_of(triangles, half_edge);
        let reversed = key([to, from]);
        let start = sides.partition_point(|side| side.0 < reversed);
        let mut others = sides[start..].iter().take_while(|side| side.0 == reversed);
        others.any(|&(_, other)| is_far(opposite, half_edge_of(triangles, other).1))
    };
    let closed = sides.iter().filter(goes_on).flat_map(|&(_, half_edge)| vertices(triangles, half_edge));
    let mut joined: Vec<u32> = closed.filter(|&v| first[v as usize] != v).collect();
    joined.sort_unstable();
    joined.dedup();
    joined
}

/// Half-edges without another triangle, in the order of where they begin.
fn boundary(triangles: &[[u32; 3]], corners: &VertexCorners) -> Vec<u32> {
    let of_vertex = |vertex: usize| {
        let around = corners.at(vertex);
        let is_inside = Disc::of(triangles, around).is_some();
        let own: &[u32] = if is_inside { &[] } else { around };
        // Other vertices, once for each triangle that has them: a hub may have any number of triangles.
        let mut others: Vec<u32> = own
            .iter()
            .flat_map(|&corner| {
                let ([_, end], opposite) = half_edge_of(triangles, corner);
                [end, opposite]
            })
            .collect();
        others.sort_unstable();
        own.iter().copied().filter(move |&corner| {
            let end = half_edge_of(triangles, corner).0[1];
            let first = others.partition_point(|&other| other < end);
            others.get(first + 1) != Some(&end)
        })
    };
    (0..corners.len()).into_par_iter().with_min_len(1 << 12).flat_map_iter(of_vertex).collect()
}

/// The ends of a half-edge, and the third vertex of its triangle.
fn half_edge_of(triangles: &[[u32; 3]], half_edge: u32) -> ([u32; 2], u32) {
    let (triangle, k) = (triangles[half_edge as usize / 3], half_edge as usize % 3);
    ([triangle[k], triangle[(k + 1) % 3]], triangle[(k + 2) % 3])
}

fn vertices(triangles: &[[u32; 3]], half_edge: u32) -> impl Iterator<Item = u32> + use<> {
    half_edge_of(triangles, half_edge).0.into_iter()
}

/// Cells are as wide as so many times the distance.
const CELL_PER_DISTANCE: f32 = 16.0;

/// Which of the vertices that are asked for lie no further than `distance` from an earlier one in the same cell.
fn near(
    vertices: &[u32],
    positions: &[Vec3],
    is_asked: impl Fn(usize) -> bool + Sync,
    distance: f32,
    offset: f32,
) -> Vec<Repeat> {
    let position = |i: usize| positions[vertices[i] as usize];
    let cell = |i: usize| -> IVec3 {
        (position(i).as_dvec3() / f64::from(CELL_PER_DISTANCE * distance) + f64::from(offset))
            .floor()
            .as_ivec3()
    };
    repeats(
        vertices.len(),
        |i| is_asked(i).then(|| scramble(cell(i).to_array().map(|c| c as u32))),
        |a, b| position(a as usize).distance(position(b as usize)) <= distance,
    )
}
