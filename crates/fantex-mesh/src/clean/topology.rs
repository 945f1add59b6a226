//! The topology of an indexed mesh: edges, manifoldness, components, Euler characteristic.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use super::star::Star;
use crate::VertexCorners;
use crate::disc::Disc;

/// Vertices per parallel task.
const BLOCK: usize = 1 << 12;

/// Counts that describe how a mesh's triangles hang together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Topology {
    /// Vertices that a triangle uses.
    pub vertices: u64,
    /// Distinct edges.
    pub edges: u64,
    /// Triangles.
    pub triangles: u64,
    /// Edges with a single triangle.
    pub edges_boundary: u64,
    /// Edges with more than two triangles.
    pub edges_non_manifold: u64,
    /// Edges with two triangles that run along it in the same direction.
    pub edges_inconsistent: u64,
    /// Vertices whose triangles do not form one single fan (or that lie on a non-manifold edge).
    pub vertices_non_manifold: u64,
    /// Pieces connected through shared edges.
    pub components: u64,
}

impl Topology {
    /// Counts everything, in parallel. `corners` belongs to `triangles`; every triangle has three distinct vertices.
    pub fn of(triangles: &[[u32; 3]], corners: &VertexCorners) -> Self {
        let components = Components::new(triangles.len());
        let mut topology = (0..corners.len().div_ceil(BLOCK))
            .into_par_iter()
            .map_init(Star::default, |star, block| {
                let mut counts = Self::default();
                for v in block * BLOCK..corners.len().min((block + 1) * BLOCK) {
                    if let Some(disc) = Disc::of(triangles, corners.at(v)) {
                        counts.add_disc(v as u32, corners.at(v), &disc, &components);
                        continue;
                    }
                    counts.add_vertex(star.gather(v as u32, corners.at(v), triangles), &components);
                }
                counts
            })
            .reduce(Self::default, Self::plus);
        topology.triangles = triangles.len() as u64;
        topology.components = components.count();
        topology
    }

    /// `V - E + F`.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.triangles as i64
    }

    /// Number of handles of all components together; `None` unless the surface is closed, manifold and oriented.
    pub fn genus(&self) -> Option<u64> {
        let is_closed = self.edges_boundary == 0 && self.edges_inconsistent == 0;
        let is_manifold = self.edges_non_manifold == 0 && self.vertices_non_manifold == 0;
        let doubled = 2 * self.components as i64 - self.euler_characteristic();
        (is_closed && is_manifold).then_some((doubled / 2) as u64)
    }

    /// As `add_vertex`, for a vertex in the middle of a disc.
    fn add_disc(&mut self, vertex: u32, corners: &[u32], disc: &Disc, components: &Components) {
        self.vertices += 1;
        let triangle = |i: u8| corners[i as usize] / 3;
        let order = &disc.order[..corners.len()];
        let mut before = order[corners.len() - 1];
        for &i in order {
            if disc.ends[i as usize] > vertex {
                self.edges += 1;
                components.join(triangle(before), triangle(i));
            }
            before = i;
        }
    }

    /// Counts a vertex and those of its edges that lead to a higher index; joins the triangles at these edges.
    fn add_vertex(&mut self, star: &mut Star, components: &Components) {
        if star.is_empty() {
            return;
        }
        self.vertices += 1;
        let mut is_manifold = star.is_single_fan();
        for edge in star.edges() {
            is_manifold &= edge.len() <= 2;
            if edge.other() < star.vertex() {
                continue;
            }
            self.edges += 1;
            match edge.len() {
                1 => self.edges_boundary += 1,
                2 if !edge.is_consistent() => self.edges_inconsistent += 1,
                2 => {}
                _ => self.edges_non_manifold += 1,
            }
            let mut around = edge.half_edges().map(|h| h / 3);
            if let Some(first) = around.next() {
                around.for_each(|t| components.join(first, t));
            }
        }
        self.vertices_non_manifold += u64::from(!is_manifold);
    }

    fn plus(mut self, other: Self) -> Self {
        self.vertices += other.vertices;
        self.edges += other.edges;
        self.edges_boundary += other.edges_boundary;
        self.edges_non_manifold += other.edges_non_manifold;
        self.edges_inconsistent += other.edges_inconsistent;
        self.vertices_non_manifold += other.vertices_non_manifold;
        self
    }
}

/// Concurrent union-find over triangles. Every set's root is its smallest member, whatever the order of joining.
pub(crate) struct Components {
    parents: Vec<AtomicU32>,
}

impl Components {
    pub(crate) fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).map(AtomicU32::new).collect() }
    }

    /// The smallest member of the set, once all joins are done.
    pub(crate) fn root(&self, mut element: u32) -> u32 {
        loop {
            let parent = self.parents[element as usize].load(Relaxed);
            if parent == element {
                return element;
            }
            let grandparent = self.parents[parent as usize].load(Relaxed);
            // Path halving; a stale value is still an ancestor, so losing the race does no harm.
            self.parents[element as usize].store(grandparent, Relaxed);
            element = grandparent;
        }
    }

    /// Makes the sets of `a` and `b` one.
    pub(crate) fn join(&self, mut a: u32, mut b: u32) {
        loop {
            (a, b) = (self.root(a), self.root(b));
            if a == b {
                return;
            }
            let (low, high) = (a.min(b), a.max(b));
            if self.parents[high as usize].compare_exchange(high, low, Relaxed, Relaxed).is_ok() {
                return;
            }
        }
    }

    /// Number of sets.
    pub(crate) fn count(&self) -> u64 {
        let is_root = |(i, parent): (usize, &AtomicU32)| parent.load(Relaxed) == i as u32;
        self.parents.par_iter().enumerate().with_min_len(1 << 14).filter(|&p| is_root(p)).count() as u64
    }
}
