//! Which corners lie at which vertex: the adjacency that fans, normals and the cleaning report are built from.

use std::f64::consts::{PI, TAU};
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use arrayvec::ArrayVec;
use fantex_base::UnionFind;
use glam::Vec3;
use rayon::prelude::*;

const BLOCK: usize = 1 << 14;

/// For every vertex its corners in ascending order, in one flat array (compressed rows).
///
/// Corner `3 * t + k` is corner `k` of triangle `t`. A triangle that names a vertex twice appears twice in its row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VertexCorners {
    /// Row `v` is `corners[starts[v]..starts[v + 1]]`; one entry more than there are vertices.
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl VertexCorners {
    /// Gathers the corners of every vertex, in parallel; the result does not depend on the number of threads.
    ///
    /// Indices must be below `vertex_count`, and there must be fewer than `u32::MAX / 3` triangles ([`Mesh`]
    /// guarantees both); otherwise it panics.
    ///
    /// [`Mesh`]: crate::Mesh
    pub fn of(triangles: &[[u32; 3]], vertex_count: usize) -> Self {
        assert!(triangles.len() < u32::MAX as usize / 3, "corner indices would not fit 32 bits");
        let starts = row_starts(triangles, vertex_count);
        let corners = filled_rows(triangles, &starts);
        let mut adjacency = Self { starts, corners };
        adjacency.sort_rows();
        adjacency
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of corners of all vertices.
    pub fn corner_count(&self) -> usize {
        self.corners.len()
    }

    /// True where there is no vertex at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners at a vertex, ascending; empty for an isolated vertex.
    #[inline]
    pub fn at(&self, vertex: usize) -> &[u32] {
        &self.corners[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }

    /// Sorts every row, which the racing writers left in any order.
    fn sort_rows(&mut self) {
        let mut blocks = Vec::with_capacity(self.len() / BLOCK + 1);
        let mut rest = self.corners.as_mut_slice();
        for first in (0..self.starts.len() - 1).step_by(BLOCK) {
            let last = (first + BLOCK).min(self.starts.len() - 1);
            let starts = &self.starts[first..=last];
            let (block, tail) = rest.split_at_mut((starts[starts.len() - 1] - starts[0]) as usize);
            rest = tail;
            blocks.push((starts, block));
        }
        blocks.into_par_iter().for_each(|(starts, block)| {
            for row in starts.windows(2) {
                block[(row[0] - starts[0]) as usize..(row[1] - starts[0]) as usize].sort_unstable();
            }
        });
    }
}

/// Counts the corners of every vertex and sums the counts up.
fn row_starts(triangles: &[[u32; 3]], vertex_count: usize) -> Vec<u32> {
    let counts = atomic_zeros(vertex_count + 1);
    triangles.par_iter().with_min_len(BLOCK).flatten_iter().for_each(|&v| {
        counts[v as usize].fetch_add(1, Relaxed);
    });
    let mut sum = 0;
    counts
        .into_iter()
        .map(|count| {
            let start = sum;
            sum += count.into_inner();
            start
        })
        .collect()
}

/// Writes every corner into its vertex' row, in any order.
fn filled_rows(triangles: &[[u32; 3]], starts: &[u32]) -> Vec<u32> {
    let cursors: Vec<AtomicU32> = starts.par_iter().with_min_len(BLOCK).map(|&s| AtomicU32::new(s)).collect();
    let corners = atomic_zeros(3 * triangles.len());
    triangles.par_iter().with_min_len(BLOCK).enumerate().for_each(|(t, triangle)| {
        for (k, &v) in triangle.iter().enumerate() {
            let slot = cursors[v as usize].fetch_add(1, Relaxed);
            corners[slot as usize].store((3 * t + k) as u32, Relaxed);
        }
    });
    corners.into_iter().map(AtomicU32::into_inner).collect()
}

fn atomic_zeros(count: usize) -> Vec<AtomicU32> {
    (0..count).into_par_iter().with_min_len(BLOCK).map(|_| AtomicU32::new(0)).collect()
}

// The edges of a mesh with the triangles at each.

/// All edges of a mesh, in the order of their vertices.
///
/// A half-edge `3 * triangle + k` runs from the triangle's corner `k` to the next one.
#[derive(Debug)]
pub struct Edges<'m> {
    triangles: &'m [[u32; 3]],
    /// Lower and higher vertex in one number, half-edge; ascending.
    half_edges: Vec<(u64, u32)>,
}

/// An edge.
#[derive(Clone, Copy, Debug)]
pub struct Edge<'a> {
    triangles: &'a [[u32; 3]],
    half_edges: &'a [(u64, u32)],
}

impl<'m> Edges<'m> {
    /// Of a mesh's triangles, of which there are less than 2^32 / 3.
    pub fn of(triangles: &'m [[u32; 3]]) -> Self {
        let of_triangle = |&[a, b, c]: &[u32; 3]| [(a, b), (b, c), (c, a)];
        let all = || (0u32..).zip(triangles.iter().flat_map(of_triangle));
        // By lower vertex: counted, then put where those of the vertex begin, each beginning moving on to its end.
        let mut ends = vec![0u32; triangles.as_flattened().iter().max().map_or(0, |&last| last as usize + 1)];
        all().for_each(|(_, (from, to))| ends[from.min(to) as usize] += 1);
        let mut count = 0;
        for end in &mut ends {
            count += std::mem::replace(end, count);
        }
        let mut half_edges = vec![(0u64, 0u32); 3 * triangles.len()];
        for (half_edge, (from, to)) in all() {
            let (lower, higher) = (from.min(to), from.max(to));
            let place = &mut ends[lower as usize];
            half_edges[*place as usize] = (u64::from(lower) << 32 | u64::from(higher), half_edge);
            *place += 1;
        }
        let mut rest = &mut half_edges[..];
        let mut first = 0;
        for end in ends {
            let (at_vertex, others) = rest.split_at_mut((end - first) as usize);
            at_vertex.sort_unstable();
            (rest, first) = (others, end);
        }
        Self { triangles, half_edges }
    }

    /// Each of them once.
    pub fn iter(&self) -> impl Iterator<Item = Edge<'_>> {
        let edges = self.half_edges.chunk_by(|a, b| a.0 == b.0);
        edges.map(|half_edges| Edge { triangles: self.triangles, half_edges })
    }
}

impl Edge<'_> {
    /// Its ends, ascending.
    pub fn vertices(&self) -> [u32; 2] {
        let ends = self.half_edges[0].0;
        [(ends >> 32) as u32, ends as u32]
    }

    /// The triangles that meet there, with their third vertices; ascending.
    pub fn triangles(&self) -> impl Iterator<Item = (u32, u32)> + use<'_> {
        let third = |half_edge: u32| EdgeSide::of_half_edge(self.triangles, half_edge, 0).opposite;
        self.half_edges.iter().map(move |&(_, half_edge)| (half_edge / 3, third(half_edge)))
    }

    /// How many triangles meet there.
    pub fn triangle_count(&self) -> usize {
        self.half_edges.len()
    }

    /// The half-edges of triangles that [continue](continued) each other.
    pub fn continued(&self) -> ArrayVec<[u32; 2], { MAX_AT_EDGE / 2 }> {
        self.pairs(continued)
    }

    /// The half-edges of triangles that continue each other, [by angle](continued_by_angle) where vertices do not tell.
    pub fn continued_by_angle(&self, positions: &[Vec3]) -> ArrayVec<[u32; 2], { MAX_AT_EDGE / 2 }> {
        self.pairs(|sides| continued_by_angle(sides, self.vertices(), positions))
    }

    fn pairs(&self, pair: impl Fn(&[EdgeSide]) -> Pairs) -> ArrayVec<[u32; 2], { MAX_AT_EDGE / 2 }> {
        if self.half_edges.len() > MAX_AT_EDGE {
            return ArrayVec::new();
        }
        let [first, _] = self.vertices();
        let side = |&(_, half_edge): &(u64, u32)| EdgeSide::of_half_edge(self.triangles, half_edge, first);
        let sides: ArrayVec<EdgeSide, MAX_AT_EDGE> = self.half_edges.iter().map(side).collect();
        pair(&sides).into_iter().map(|pair| pair.map(|i| self.half_edges[i].1)).collect()
    }
}

// Which triangles continue each other across an edge.
//
// At most edges there is nothing to decide: two triangles meet. Where more meet, the surface goes on where it is clear how:
//
// ```text
//        p             q           a leaf or a wall modelled with both of its sides: four triangles at the edge (seen
//         \           /            from its end), two and two with the same vertices in opposite order. The front goes on
//     back \\       // back        with the front, the back with the back.
//     front \\_____// front
//            ^ edge
// ```
//
// A triangle is never continued by one that has the same three vertices: where only the two sides of a leaf meet, at its
// rim, each of them ends.

/// One triangle at an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgeSide {
    /// Its third vertex.
    pub opposite: u32,
    /// Whether it runs along the edge in the one direction or in the other; which is called so does not matter.
    pub is_forward: bool,
}

impl EdgeSide {
    /// The triangle of a half-edge (its number is three times the triangle's plus that of the corner where it begins).
    /// `first` is the end of the edge from which on a triangle runs forward.
    #[inline]
    fn of_half_edge(triangles: &[[u32; 3]], half_edge: u32, first: u32) -> Self {
        let (triangle, k) = (triangles[half_edge as usize / 3], half_edge as usize % 3);
        Self { opposite: triangle[(k + 2) % 3], is_forward: triangle[k] == first }
    }
}

/// Edges of more triangles end all of them.
pub const MAX_AT_EDGE: usize = 8;

/// Indices of triangles at an edge that continue each other.
pub type Pairs = ArrayVec<[usize; 2], { MAX_AT_EDGE / 2 }>;

/// The pairs of triangles that continue each other at an edge, as ascending indices into `sides`, which are all triangles
/// there. Each is in one pair at most.
///
/// Two triangles continue each other unless they have the same vertices. Of more, those that run along the edge in opposite
/// directions are candidates of each other with that exception, and those continue each other that have no other candidate.
pub fn continued(sides: &[EdgeSide]) -> Pairs {
    let are_same = |i: usize, j: usize| sides[i].opposite == sides[j].opposite;
    let mut pairs = ArrayVec::new();
    match sides.len() {
        2 if !are_same(0, 1) => pairs.push([0, 1]),
        3..=MAX_AT_EDGE => {
            let only_candidate = |i: usize| {
                let is_candidate = |&j: &usize| sides[j].is_forward != sides[i].is_forward && !are_same(i, j);
                let mut candidates = (0..sides.len()).filter(is_candidate);
                candidates.next().filter(|_| candidates.next().is_none())
            };
            let partners = (0..sides.len()).filter_map(|i| only_candidate(i).map(|j| [i, j]));
            pairs.extend(partners.filter(|&[i, j]| i < j && only_candidate(j) == Some(i)));
        }
        _ => {}
    }
    pairs
}

/// The same, where vertices do not tell by the angles of the triangles around an edge between the vertices `ends`, the lower one first, from
/// which on triangles run forward.
///
/// ```text
///      b   f           Around the edge (seen against its direction) triangles with their fronts to the left of the edge (f) and to
///       \ /  front      its right (b) take turns, as where two boxes touch: those continue each other whose fronts face each
///  front x   ...       other, which are seen together.
///       / \
///      f   b           Where two sheets cross, forward and backward do not take turns: the straight ones continue each other.
/// ```
pub fn continued_by_angle(sides: &[EdgeSide], ends: [u32; 2], positions: &[Vec3]) -> Pairs {
    let pairs = continued(sides);
    let n = sides.len();
    if !pairs.is_empty() || !(4..=MAX_AT_EDGE).contains(&n) || !n.is_multiple_of(2) {
        return pairs;
    }
    let at = |v: u32| positions[v as usize].as_dvec3();
    let origin = at(ends[0]);
    let Some(axis) = (at(ends[1]) - origin).try_normalize() else { return pairs };
    let (x, y) = axis.any_orthonormal_pair();
    let mut around: ArrayVec<(f64, usize), MAX_AT_EDGE> = ArrayVec::new();
    for (i, side) in sides.iter().enumerate() {
        let arm = at(side.opposite) - origin;
        around.push((libm::atan2(arm.dot(y), arm.dot(x)), i));
    }
    around.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let turn = |k: usize| {
        let whole = if k + 1 < n { 0.0 } else { TAU };
        around[(k + 1) % n].0 + whole - around[k].0
    };
    // Triangles that lie on each other have no order.
    if !(0..n).all(|k| turn(k) > MIN_TURN) {
        return pairs;
    }
    let is_forward = |k: usize| sides[around[k % n].1].is_forward;
    let pair = |k: usize, l: usize| {
        let [i, j] = [k, l].map(|k| around[k % n].1);
        [i.min(j), i.max(j)]
    };
    let mut found: Pairs = if (0..n).all(|k| is_forward(k) != is_forward(k + 1)) {
        (0..n).filter(|&k| is_forward(k)).map(|k| pair(k, k + 1)).collect()
    } else {
        let is_straight =
            |k: usize| is_forward(k) != is_forward(k + 2) && (turn(k) + turn(k + 1) - PI).abs() < MAX_BEND;
        match n == 4 && is_straight(0) && is_straight(1) {
            true => [pair(0, 2), pair(1, 3)].into_iter().collect(),
            false => Pairs::new(),
        }
    };
    found.sort_unstable();
    found
}

/// Triangles closer to each other around an edge have no order, radians.
const MIN_TURN: f64 = 1e-5;

/// Sheets that cross bend less than this, radians.
const MAX_BEND: f64 = PI / 3.0;

// Triangles that are each other's back.
//
// A leaf or a wall modelled with both of its sides has each triangle twice, with its vertices in opposite order. Both lie at the same
// depth, so that a renderer or a ray meets either one by chance. Seen from behind such a triangle does not
// count, whatever its material says: what is seen there is the other one.

/// The triangles that are opposed by another one: with the same three vertices in opposite order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpposedTriangles {
    /// Per triangle; empty where there are none.
    is_opposed: Vec<bool>,
}

impl OpposedTriangles {
    /// Finds them. Of more than two with the same vertices, as cleaned meshes have none, all are opposed where any two are in opposite
    /// order.
    pub fn of(triangles: &[[u32; 3]]) -> Self {
        let mut keys: Vec<([u32; 3], u32)> =
            triangles.par_iter().enumerate().map(|(t, &triangle)| (sorted(triangle), t as u32)).collect();
        keys.par_sort_unstable();
        let mut opposed = Self::default();
        for alike in keys.chunk_by(|a, b| a.0 == b.0).filter(|alike| alike.len() > 1) {
            let is_even = |&(key, t): &([u32; 3], u32)| is_turned(triangles[t as usize], key);
            let even = alike.iter().filter(|one| is_even(one)).count();
            if even > 0 && even < alike.len() {
                opposed.is_opposed.resize(triangles.len(), false);
                alike.iter().for_each(|&(_, t)| opposed.is_opposed[t as usize] = true);
            }
        }
        opposed
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.is_opposed.is_empty()
    }

    /// Whether a triangle is opposed, so that it counts from its front only.
    #[inline]
    pub fn contains(&self, triangle: usize) -> bool {
        self.is_opposed.get(triangle).copied().unwrap_or(false)
    }
}

fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// Whether one has the vertices of the other in the same cyclic order.
fn is_turned(triangle: [u32; 3], [a, b, _]: [u32; 3]) -> bool {
    (0..3).any(|k| triangle[k] == a && triangle[(k + 1) % 3] == b)
}

// The triangles around one vertex, seen through the edges that leave it.
//
// All questions about edges are answered locally: the star of a vertex lists its edges sorted by their other end. No
// table of all edges of the mesh is needed, and vertices are independent of each other.

/// The edges of one vertex. Refilled for every vertex to reuse its memory.
#[derive(Default)]
pub(crate) struct Star {
    vertex: u32,
    corner_count: usize,
    /// One entry per triangle and edge, sorted.
    entries: Vec<Entry>,
    /// The corners of the star that are linked through edges.
    fans: UnionFind,
}

/// An edge of the star as one of its triangles sees it.
#[derive(Clone, Copy)]
struct Entry {
    other: u32,
    slot: u32,
    /// `3 * t + k` for the edge from corner `k` to the next one of triangle `t`.
    half_edge: u32,
    /// The half-edge ends in the star's vertex.
    incoming: bool,
}

impl Star {
    /// Fills the star with the edges of `vertex`, whose corners are given.
    pub(crate) fn gather(&mut self, vertex: u32, corners: &[u32], triangles: &[[u32; 3]]) -> &mut Self {
        self.vertex = vertex;
        self.corner_count = corners.len();
        self.entries.clear();
        for (slot, &corner) in corners.iter().enumerate() {
            let (slot, triangle, k) = (slot as u32, triangles[corner as usize / 3], corner % 3);
            let (next, previous) = ((k + 1) % 3, (k + 2) % 3);
            for (at, half_edge, incoming) in [(next, corner, false), (previous, corner - k + previous, true)]
            {
                self.entries.push(Entry { other: triangle[at as usize], slot, half_edge, incoming });
            }
        }
        self.entries.sort_unstable_by_key(|e| (u64::from(e.other) << 32) | u64::from(e.half_edge));
        self
    }

    pub(crate) fn vertex(&self) -> u32 {
        self.vertex
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.corner_count == 0
    }

    /// The edges by ascending other end.
    pub(crate) fn edges(&self) -> impl Iterator<Item = StarEdge<'_>> {
        self.entries.chunk_by(|a, b| a.other == b.other).map(StarEdge)
    }

    /// True where all triangles are connected through the edges of this vertex.
    pub(crate) fn is_single_fan(&mut self) -> bool {
        self.fans.reset(self.corner_count);
        let mut fan_count = self.corner_count;
        for pair in self.entries.windows(2).filter(|pair| pair[0].other == pair[1].other) {
            fan_count -= usize::from(self.fans.union(pair[0].slot, pair[1].slot));
        }
        fan_count <= 1
    }
}

#[derive(Clone, Copy)]
pub(crate) struct StarEdge<'a>(&'a [Entry]);

impl StarEdge<'_> {
    /// The end that is not the star's vertex.
    pub(crate) fn other(&self) -> u32 {
        self.0[0].other
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Half-edges `3 * t + k` (from corner `k` to the next), ascending.
    pub(crate) fn half_edges(&self) -> impl Iterator<Item = u32> + '_ {
        self.0.iter().map(|e| e.half_edge)
    }

    /// The corners (as indices into the star's) whose triangles have this edge, by ascending half-edge.
    pub(crate) fn slots(&self) -> impl Iterator<Item = u32> + '_ {
        self.0.iter().map(|e| e.slot)
    }

    /// True for exactly two triangles that run along the edge in opposite directions.
    pub(crate) fn is_consistent(&self) -> bool {
        self.len() == 2 && self.0[0].incoming != self.0[1].incoming
    }
}
