//! The topology of an indexed mesh: edges, manifoldness, components, Euler characteristic.

use std::cmp::Ordering;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::VertexCorners;
use crate::adjacency::Star;
use crate::fans::Disc;

const BLOCK: usize = 1 << 12;

/// Counts that describe how a mesh's triangles are connected.
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
        Self::and_discs(triangles, corners).0
    }

    /// The same, and which vertices lie in the middle of a small [disc](Disc).
    pub(super) fn and_discs(triangles: &[[u32; 3]], corners: &VertexCorners) -> (Self, Vec<bool>) {
        let components = Components::new(triangles.len());
        let mut is_disc = vec![false; corners.len()];
        let mut topology = is_disc
            .par_chunks_mut(BLOCK)
            .enumerate()
            .map_init(Star::default, |star, (block, is_disc)| {
                let mut counts = Self::default();
                for (v, is_disc) in (block * BLOCK..).zip(is_disc) {
                    if let Some(disc) = Disc::of(triangles, corners.at(v)) {
                        counts.add_disc(v as u32, corners.at(v), &disc, &components);
                        *is_disc = true;
                        continue;
                    }
                    counts.add_vertex(star.gather(v as u32, corners.at(v), triangles), &components);
                }
                counts
            })
            .reduce(Self::default, Self::plus);
        topology.triangles = triangles.len() as u64;
        topology.components = components.count();
        (topology, is_disc)
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

    pub(crate) fn count(&self) -> u64 {
        let is_root = |(i, parent): (usize, &AtomicU32)| parent.load(Relaxed) == i as u32;
        self.parents.par_iter().enumerate().with_min_len(1 << 14).filter(|&p| is_root(p)).count() as u64
    }
}

// Making the orientation of neighbouring triangles agree.

/// Marks an edge that has no single neighbour.
pub(super) const NONE: u32 = u32::MAX;

/// Which triangles to turn, and what could not be decided.
pub(super) struct Turning {
    pub(super) turn: Vec<bool>,
    /// Patches that have no consistent orientation (they contain a Moebius strip); their seam stays, as the model has it unless turning
    /// makes it shorter.
    pub(super) non_orientable: u64,
}

/// Decides which triangles to turn so that neighbours across edges with exactly two triangles agree. A patch is a component connected
/// through such edges. The front of one where some disagree is the side
///
/// 1. that most of its corner normals point to, by area: `area_in_front` gives that of a triangle less what they say is behind;
/// 2. at a tie, the front of most of its triangles;
/// 3. at a tie, the outside, where it is closed;
/// 4. else the front of its first triangle.
///
/// With `outward`, the front of every closed patch is the outside.
pub(super) fn decide(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    corners: &VertexCorners,
    area_in_front: impl Fn(u32) -> f64,
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
        if !is_orientable {
            let seam = |turn: Option<&[bool]>| inconsistent_sides(triangles, &neighbours, &patch, turn);
            if seam(None) <= seam(Some(&turning.turn)) {
                patch.iter().for_each(|&t| turning.turn[t as usize] = false);
                continue;
            }
        }
        let turn = &turning.turn;
        let turned = patch.iter().filter(|&&t| turn[t as usize]).count();
        let has_outside =
            || is_orientable && patch.iter().all(|&t| neighbours[t as usize].iter().all(|&h| h != NONE));
        let is_inside_out = || has_outside() && signed_volume(positions, triangles, &patch, turn) < 0.0;
        let is_inverted = || match (by_normals(&patch, turn, &area_in_front), (2 * turned).cmp(&patch.len()))
        {
            (Ordering::Equal, Ordering::Equal) => is_inside_out(),
            (Ordering::Equal, most_turned) => most_turned.is_gt(),
            (in_front, _) => in_front.is_lt(),
        };
        let invert = if outward && has_outside() { is_inside_out() } else { turned > 0 && is_inverted() };
        if invert {
            patch.iter().for_each(|&t| turning.turn[t as usize] ^= true);
        }
    }
    turning
}

/// Where the areas in front and behind differ by less than this part of both, normals say nothing.
const CLEAR_SHARE: f64 = 0.01;

/// Whether more of a patch's area is in front of its triangles, by their normals, or behind them, after those flagged have turned.
fn by_normals(patch: &[u32], turn: &[bool], area_in_front: impl Fn(u32) -> f64) -> Ordering {
    let (mut in_front, mut all) = (0.0, 0.0);
    for &t in patch {
        let area = area_in_front(t);
        in_front += if turn[t as usize] { -area } else { area };
        all += area.abs();
    }
    if in_front.abs() <= CLEAR_SHARE * all { Ordering::Equal } else { in_front.total_cmp(&0.0) }
}

/// For every half-edge the opposite one, where exactly two triangles meet.
pub(super) fn neighbours(triangles: &[[u32; 3]], corners: &VertexCorners) -> Vec<[u32; 3]> {
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
pub(super) fn flood(
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

/// Of how many sides of a patch's triangles the other triangle runs along them in the same direction, after those flagged, if any, have turned.
fn inconsistent_sides(
    triangles: &[[u32; 3]],
    neighbours: &[[u32; 3]],
    patch: &[u32],
    turn: Option<&[bool]>,
) -> usize {
    let origin = |half_edge: u32| triangles[half_edge as usize / 3][half_edge as usize % 3];
    let is_turned = |t: u32| turn.is_some_and(|turn| turn[t as usize]);
    let is_inconsistent = |t: u32, k: usize| match neighbours[t as usize][k] {
        NONE => false,
        h => (origin(h) == triangles[t as usize][k]) ^ is_turned(t) ^ is_turned(h / 3),
    };
    patch.iter().map(|&t| (0..3).filter(|&k| is_inconsistent(t, k)).count()).sum()
}

/// Six times the volume enclosed by a closed patch, relative to a point on it.
pub(super) fn signed_volume(positions: &[Vec3], triangles: &[[u32; 3]], patch: &[u32], turn: &[bool]) -> f64 {
    let at = |v: u32| positions[v as usize].as_dvec3();
    let origin = patch.first().map_or(DVec3::ZERO, |&t| at(triangles[t as usize][0]));
    let volumes = patch.iter().map(|&t| {
        let [a, b, c] = triangles[t as usize].map(|v| at(v) - origin);
        let volume = a.dot(b.cross(c));
        if turn[t as usize] { -volume } else { volume }
    });
    volumes.sum()
}
