//! Which photographs a part of the surface needs.
//!
//! Triangles that lie close together form a cluster. A photograph belongs to a cluster if it sees one of its vertices or
//! of the points spread over it, unless it weighs so little everywhere in it that blending drops it anyway. So a bake looks, per
//! texel, at a dozen photographs instead of hundreds, and touches the pages of few.

use fantex_mesh::Mesh;
use glam::{UVec3, Vec3};

use crate::blend::KEPT_SHARE;
use crate::probes::Probes;

/// Triangles of a cluster in large meshes.
const MOST_TRIANGLES: usize = 64;
/// Clusters that a small mesh is cut into at least.
const FEWEST_CLUSTERS: usize = 512;
/// Weights between the points that were asked may be this much larger.
const MARGIN: f32 = 8.0;

/// Clusters of triangles with their photographs.
#[derive(Debug)]
pub(crate) struct Clusters {
    of_triangle: Vec<u32>,
    /// Per cluster its photographs, ascending, with the largest weight that they have in it.
    views: Vec<Vec<(u32, f32)>>,
}

impl Clusters {
    /// Clusters without photographs: triangles in the order of a space-filling curve (G. M. Morton, 1966), cut into runs.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let count = mesh.triangles.len();
        let size = (count / FEWEST_CLUSTERS).clamp(1, MOST_TRIANGLES);
        let mut order: Vec<(u32, u32)> = (0..count)
            .map(|t| {
                let [a, b, c] = mesh.triangle_positions(t);
                (morton((a + b + c) / 3.0), t as u32)
            })
            .collect();
        order.sort_unstable();
        let mut of_triangle = vec![0; count];
        for (rank, (_, triangle)) in order.into_iter().enumerate() {
            of_triangle[triangle as usize] = (rank / size) as u32;
        }
        Self { of_triangle, views: vec![Vec::new(); count.div_ceil(size)] }
    }

    /// Adds a photograph, in ascending order, with its weights at all probes.
    pub(crate) fn add(&mut self, view: u32, mesh: &Mesh, probes: &Probes, weights: &[f32]) {
        let largest = self.extremes(mesh, probes, weights, 0.0, f32::max);
        for (cluster, largest) in self.views.iter_mut().zip(largest) {
            if largest > 0.0 {
                cluster.push((view, largest));
            }
        }
    }

    /// Drops photographs that weigh next to nothing beside the best one everywhere in a cluster. `best` is the largest weight at every
    /// probe.
    pub(crate) fn prune(&mut self, mesh: &Mesh, probes: &Probes, best: &[f32]) {
        let smallest = self.extremes(mesh, probes, best, f32::INFINITY, f32::min);
        for (views, smallest) in self.views.iter_mut().zip(smallest) {
            views.retain(|&(_, largest)| largest * MARGIN >= smallest * KEPT_SHARE);
        }
    }

    /// The photographs that may see a triangle, ascending.
    pub(crate) fn views_of(&self, triangle: usize) -> impl Iterator<Item = u32> {
        self.views[self.of_triangle[triangle] as usize].iter().map(|&(view, _)| view)
    }

    /// The largest or smallest of the values at the probes of every cluster.
    fn extremes(
        &self,
        mesh: &Mesh,
        probes: &Probes,
        values: &[f32],
        start: f32,
        pick: fn(f32, f32) -> f32,
    ) -> Vec<f32> {
        let mut extremes = vec![start; self.views.len()];
        let (vertices, spread) = values.split_at(probes.vertices());
        for (triangle, &cluster) in mesh.triangles.iter().zip(&self.of_triangle) {
            let extreme = &mut extremes[cluster as usize];
            *extreme = triangle.iter().fold(*extreme, |e, &v| pick(e, vertices[v as usize]));
        }
        for (&triangle, &value) in probes.triangles.iter().zip(spread) {
            let extreme = &mut extremes[self.of_triangle[triangle as usize] as usize];
            *extreme = pick(*extreme, value);
        }
        extremes
    }
}

/// Ten bits of each coordinate, interleaved.
fn morton(p: Vec3) -> u32 {
    let UVec3 { x, y, z } = ((p + 1.0) * 511.5).clamp(Vec3::ZERO, Vec3::splat(1023.0)).as_uvec3();
    let spread = |n: u32| (0..10).fold(0, |bits, k| bits | (n >> k & 1) << (3 * k));
    spread(x) | spread(y) << 1 | spread(z) << 2
}
