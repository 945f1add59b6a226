//! Colours for what no photograph sees: those of the surroundings, spread along the surface.
//!
//! Vertices that are seen keep their colours; those in between become the mean of their neighbours, weighted by one over the length of
//! the edge: the solution of Laplace's equation on the graph of edges. It has no extremes of its own, is smooth,
//! and meets what is seen. Parts of the mesh where nothing is seen at all get the mean of everything that is.

use std::collections::VecDeque;

use fantex_mesh::Mesh;
use glam::{DVec3, Vec3};

use crate::gains::conjugate_gradients;

/// Steps of the solver per channel.
const MOST_STEPS: usize = 400;
/// The residual that is small enough, relative to the start.
const TOLERANCE: f64 = 1e-4;
/// What a model looks like that no photograph sees.
const GREY: Vec3 = Vec3::splat(0.18);

/// The mean of what is seen.
pub(crate) fn mean(seen: impl Iterator<Item = Vec3>) -> Vec3 {
    let (sum, count) =
        seen.fold((DVec3::ZERO, 0.0), |(sum, count), color| (sum + color.as_dvec3(), count + 1.0));
    if count > 0.0 { (sum / count).as_vec3() } else { GREY }
}

/// One colour per vertex. `seen` says which are known; the others are found. `mean` is that of the whole surface that is seen: of a
/// coarse mesh that may be much, without a single vertex.
pub(crate) fn spread(mesh: &Mesh, seen: &[Option<Vec3>], mean: Vec3) -> Vec<Vec3> {
    let known: Vec<Vec3> = seen.iter().copied().flatten().collect();
    if known.len() == seen.len() {
        return known;
    }
    let edges = Edges::of(mesh);
    let mut colors = nearest_known(&edges, seen, mean);
    // Unknown vertices that are connected with known ones, in the order of their numbers.
    let unknowns: Vec<u32> =
        (0..seen.len() as u32).filter(|&v| seen[v as usize].is_none() && colors[v as usize].1).collect();
    let mut place = vec![u32::MAX; seen.len()];
    for (i, &v) in (0..).zip(&unknowns) {
        place[v as usize] = i;
    }
    for channel in 0..3 {
        let start: Vec<f64> = unknowns.iter().map(|&v| f64::from(colors[v as usize].0[channel])).collect();
        let apply = |x: &[f64]| {
            let row = |(&v, &own): (&u32, &f64)| {
                edges
                    .of_vertex(v)
                    .map(|(n, w)| w * (own - x.get(place[n as usize] as usize).unwrap_or(&0.0)))
                    .sum()
            };
            unknowns.iter().zip(x).map(row).collect::<Vec<f64>>()
        };
        let right: Vec<f64> = unknowns
            .iter()
            .map(|&v| {
                let known =
                    edges.of_vertex(v).filter_map(|(n, w)| Some(w * f64::from(seen[n as usize]?[channel])));
                known.sum()
            })
            .collect();
        let solved = conjugate_gradients(apply, &right, start, MOST_STEPS, TOLERANCE);
        for (&v, value) in unknowns.iter().zip(solved) {
            colors[v as usize].0[channel] = value as f32;
        }
    }
    let (low, high) =
        known.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &c| (low.min(c), high.max(c)));
    let bounded = |color: Vec3| if known.is_empty() { color } else { color.clamp(low, high) };
    colors.into_iter().map(|(color, _)| bounded(color)).collect()
}

/// The colour of a known vertex that is the fewest edges away, and whether there is one: where the solver starts.
fn nearest_known(edges: &Edges, seen: &[Option<Vec3>], mean: Vec3) -> Vec<(Vec3, bool)> {
    let mut colors: Vec<(Vec3, bool)> = seen.iter().map(|c| (c.unwrap_or(mean), c.is_some())).collect();
    let mut front: VecDeque<u32> = (0..seen.len() as u32).filter(|&v| seen[v as usize].is_some()).collect();
    while let Some(v) = front.pop_front() {
        let color = colors[v as usize].0;
        for (neighbour, _) in edges.of_vertex(v) {
            let slot = &mut colors[neighbour as usize];
            if !slot.1 {
                *slot = (color, true);
                front.push_back(neighbour);
            }
        }
    }
    colors
}

/// The edges at every vertex, with one over their length.
struct Edges {
    first: Vec<u32>,
    neighbours: Vec<(u32, f32)>,
}

impl Edges {
    fn of(mesh: &Mesh) -> Self {
        let mut pairs: Vec<[u32; 2]> = mesh
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, a], [b, c], [c, b], [c, a], [a, c]])
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut first = vec![0_u32; mesh.positions.len() + 1];
        pairs.iter().for_each(|&[v, _]| first[v as usize + 1] += 1);
        (1..first.len()).for_each(|v| first[v] += first[v - 1]);
        let length = |[a, b]: [u32; 2]| mesh.positions[a as usize].distance(mesh.positions[b as usize]);
        let neighbours = pairs.into_iter().map(|pair| (pair[1], 1.0 / length(pair).max(1e-6))).collect();
        Self { first, neighbours }
    }

    fn of_vertex(&self, v: u32) -> impl Iterator<Item = (u32, f64)> {
        let range = self.first[v as usize] as usize..self.first[v as usize + 1] as usize;
        self.neighbours[range].iter().map(|&(n, w)| (n, f64::from(w)))
    }
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{CleanOptions, clean, generate};

    use super::*;

    fn sphere() -> Mesh {
        clean(generate::icosphere(4), &CleanOptions::default()).unwrap().0
    }

    #[test]
    fn the_fill_is_smooth_and_within_what_is_known() {
        let mesh = sphere();
        // Red above, blue below, nothing in the middle.
        let seen: Vec<Option<Vec3>> = mesh
            .positions
            .iter()
            .map(|p| (p.y.abs() > 0.4).then_some(if p.y > 0.0 { Vec3::X } else { Vec3::Z }))
            .collect();
        let colors = spread(&mesh, &seen, mean(seen.iter().copied().flatten()));
        for (color, seen) in colors.iter().zip(&seen) {
            assert!(seen.is_none_or(|seen| seen == *color));
            assert!(color.min_element() >= 0.0 && color.max_element() <= 1.0);
        }
        // Half of each on the equator, more red above it.
        for (p, color) in mesh.positions.iter().zip(&colors) {
            if p.y.abs() < 0.02 {
                assert!((color.x - 0.5).abs() < 0.05 && (color.z - 0.5).abs() < 0.05, "{p} {color}");
            }
            if p.y > 0.2 && p.y < 0.35 {
                assert!(color.x > 0.6, "{p} {color}");
            }
        }
        let steps = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let largest = steps
            .map(|[a, b]| (colors[a as usize] - colors[b as usize]).abs().max_element())
            .fold(0.0, f32::max);
        assert!(largest < 0.25, "{largest}");
    }

    #[test]
    fn nothing_seen_is_grey_and_everything_seen_stays() {
        let mesh = sphere();
        let count = mesh.positions.len();
        assert_eq!(mean(std::iter::empty()), GREY);
        // Seen, though no vertex is.
        let red = mean([Vec3::X, 0.5 * Vec3::X].into_iter());
        assert_eq!(spread(&mesh, &vec![None; count], red), vec![0.75 * Vec3::X; count]);
        let all: Vec<Option<Vec3>> = mesh.positions.iter().map(|&p| Some(p.abs())).collect();
        assert_eq!(spread(&mesh, &all, GREY), mesh.positions.iter().map(|p| p.abs()).collect::<Vec<_>>());
    }
}
