//! The triangle fans (umbrellas) of a mesh.
//!
//! A fan is a maximal set of corners around one vertex that are linked through edges, in their order around the vertex:
//! corners are linked where their triangles [continue](crate::continued) each other across the edge. A manifold vertex has
//! one fan; a vertex where several sheets touch has one per sheet. Every corner belongs to exactly one fan, so on an edge
//! both of the triangles that continue each other name the same two fans: the ground that the continuity of the texture
//! function stands on.
//!
//! ```text
//!        w1 ----- w0            corners of the fan around v, counter-clockwise:
//!       /  \  c0  /               c0 = (v, w0, w1), c1 = (v, w1, w2), ...
//!      / c1 \    /              the last one ends at w0 again (closed)
//!    w2 ---- v ---- w5          or at a boundary (open)
//! ```

use arrayvec::ArrayVec;
use glam::Vec3;
use rayon::prelude::*;

use crate::{EdgeSide, MAX_AT_EDGE, Mesh, VertexCorners, continued, continued_by_angle};

/// A fan's corner as the walk around the centre passes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FanCorner(u32);

const REVERSED: u32 = 1 << 31;

/// Triangles of a mesh whose fans are gathered, at most: a [`FanCorner`] keeps a bit of the number of a corner.
pub const MAX_FAN_TRIANGLES: usize = REVERSED as usize / 3;

impl FanCorner {
    fn new(corner: u32, reversed: bool) -> Self {
        Self(corner | if reversed { REVERSED } else { 0 })
    }

    /// Corner index `3 * triangle + k`; corner `k` lies at the fan's centre.
    #[inline]
    pub fn corner(self) -> u32 {
        self.0 & !REVERSED
    }

    /// Triangle index.
    #[inline]
    pub fn triangle(self) -> usize {
        self.corner() as usize / 3
    }

    /// True where the triangle is wound against the fan (on surfaces that cannot be oriented).
    #[inline]
    pub fn reversed(self) -> bool {
        self.0 & REVERSED != 0
    }

    /// Positions within the triangle (0..3) of the centre, the earlier and the later ring vertex of the walk.
    #[inline]
    pub fn slots(self) -> [usize; 3] {
        let k = self.corner() as usize % 3;
        let (next, previous) = ((k + 1) % 3, (k + 2) % 3);
        if self.reversed() { [k, previous, next] } else { [k, next, previous] }
    }
}

/// All fans of a mesh, ascending by centre vertex.
#[derive(Clone, Debug, Default)]
pub struct Fans {
    /// Fan of each corner `3 * t + k`.
    corner_fans: Vec<u32>,
    /// Fan `f` owns `corners[first[f]..first[f + 1]]`.
    first: Vec<u32>,
    corners: Vec<FanCorner>,
    closed: Vec<bool>,
    has_links_by_angle: bool,
}

impl Fans {
    /// Gathers the fans of a mesh with the given vertex-to-corner lists. Linear in the corners for bounded degree,
    /// `O(d log d)` for a vertex of degree `d`.
    ///
    /// # Panics
    /// There are more than [`MAX_FAN_TRIANGLES`].
    pub fn of(triangles: &[[u32; 3]], vertex_corners: &VertexCorners) -> Self {
        Self::linked(triangles, vertex_corners, None)
    }

    /// The fans where triangles continue each other [by angle](crate::continued_by_angle), too.
    ///
    /// # Panics
    /// As [`of`](Self::of).
    pub fn by_angle(mesh: &Mesh, vertex_corners: &VertexCorners) -> Self {
        Self::linked(&mesh.triangles, vertex_corners, Some(&mesh.positions))
    }

    fn linked(triangles: &[[u32; 3]], vertex_corners: &VertexCorners, positions: Option<&[Vec3]>) -> Self {
        assert!(triangles.len() <= MAX_FAN_TRIANGLES, "corners of fans would not fit 31 bits");
        // A fan's corners are some of its vertex' corners: every run of vertices sorts its own.
        let mut corners: Vec<FanCorner> = vec![FanCorner(0); vertex_corners.corner_count()];
        let mut runs = Vec::with_capacity(vertex_corners.len() / RUN + 1);
        let mut rest = corners.as_mut_slice();
        for begin in (0..vertex_corners.len()).step_by(RUN) {
            let vertices = begin..vertex_corners.len().min(begin + RUN);
            let (run, tail) = rest.split_at_mut(vertices.clone().map(|v| vertex_corners.at(v).len()).sum());
            runs.push((vertices, run));
            rest = tail;
        }
        let parts: Vec<Part> = runs
            .into_par_iter()
            .map(|(vertices, run)| {
                let (lengths, closed) = (Vec::with_capacity(RUN), Vec::with_capacity(RUN));
                let mut part = Part { lengths, closed, has_links_by_angle: false };
                let mut walker = Walker { positions, ..Walker::default() };
                let mut rest = run;
                for v in vertices {
                    walker.center = v as u32;
                    let (corners, tail) = rest.split_at_mut(vertex_corners.at(v).len());
                    walker.walk(triangles, vertex_corners.at(v), corners, &mut part);
                    rest = tail;
                }
                part.has_links_by_angle = walker.has_links_by_angle;
                part
            })
            .collect();
        let mut first = Vec::with_capacity(vertex_corners.len() + 1);
        let mut closed = Vec::with_capacity(vertex_corners.len());
        first.push(0);
        let mut end = 0;
        for part in &parts {
            first.extend(part.lengths.iter().map(|length| {
                end += length;
                end
            }));
            closed.extend_from_slice(&part.closed);
        }
        // Where every vertex has one fan, fans are numbered as vertices are.
        let one_each = first.len() == vertex_corners.len() + 1
            && (0..vertex_corners.len())
                .into_par_iter()
                .with_min_len(RUN)
                .all(|v| vertex_corners.at(v).len() as u32 == first[v + 1] - first[v]);
        let corner_fans = match one_each {
            true => triangles.as_flattened().par_iter().with_min_len(RUN).copied().collect(),
            false => invert(&first, &corners, corners.len()),
        };
        let has_links_by_angle = parts.iter().any(|part| part.has_links_by_angle);
        Self { corner_fans, first, corners, closed, has_links_by_angle }
    }

    /// The same fans, cut at the spokes that `is_cut` picks by the corners before and after them. A closed fan is cut at two spokes or
    /// more: across one alone it would still be its own neighbour.
    pub fn cut(&self, is_cut: impl Fn(FanCorner, FanCorner) -> bool) -> Self {
        let mut part = Part::default();
        let mut corners = Vec::with_capacity(self.corners.len());
        for fan in 0..self.len() {
            let (own, is_closed) = (self.corners(fan), self.closed[fan]);
            let is_cut_after = |&i: &usize| is_cut(own[i], own[(i + 1) % own.len()]);
            let mut ends: Vec<usize> =
                (0..own.len() - usize::from(!is_closed)).filter(is_cut_after).map(|i| i + 1).collect();
            let first = match is_closed {
                true if ends.len() < 2 => {
                    ends = vec![own.len()];
                    0
                }
                true => ends[0],
                false => {
                    ends.push(own.len());
                    0
                }
            };
            let is_whole = ends.len() == 1;
            if first > 0 {
                // The piece that begins at the first cut ends at the second, the last one around the end of the list.
                ends.rotate_left(1);
                let last = ends.len() - 1;
                ends[last] = first + own.len();
            }
            corners.extend((first..first + own.len()).map(|i| own[i % own.len()]));
            part.lengths.extend(ends.iter().scan(first, |start, &end| {
                let length = end - *start;
                *start = end;
                Some(length as u32)
            }));
            part.closed.extend(ends.iter().map(|_| is_closed && is_whole));
        }
        let mut first = vec![0];
        first.extend(part.lengths.iter().scan(0, |end, length| {
            *end += length;
            Some(*end)
        }));
        let corner_fans = invert(&first, &corners, corners.len());
        let has_links_by_angle = self.has_links_by_angle;
        Self { corner_fans, first, corners, closed: part.closed, has_links_by_angle }
    }

    /// Number of fans.
    pub fn len(&self) -> usize {
        self.closed.len()
    }

    /// True for a mesh without triangles.
    pub fn is_empty(&self) -> bool {
        self.closed.is_empty()
    }

    /// The corners of a fan, in order around its centre.
    #[inline]
    pub fn corners(&self, fan: usize) -> &[FanCorner] {
        &self.corners[self.first[fan] as usize..self.first[fan + 1] as usize]
    }

    /// True where the fan surrounds its centre.
    #[inline]
    pub fn is_closed(&self, fan: usize) -> bool {
        self.closed[fan]
    }

    /// Whether triangles are linked that continue each other by angle only.
    pub fn has_links_by_angle(&self) -> bool {
        self.has_links_by_angle
    }

    /// Number of triangles of the mesh.
    pub fn triangle_count(&self) -> usize {
        self.corner_fans.len() / 3
    }

    /// The fan that a corner `3 * t + k` belongs to.
    #[inline]
    pub fn of_corner(&self, corner: usize) -> u32 {
        self.corner_fans[corner]
    }

    /// The fans at the three corners of a triangle.
    #[inline]
    pub fn of_triangle(&self, triangle: usize) -> [u32; 3] {
        let c = 3 * triangle;
        [self.corner_fans[c], self.corner_fans[c + 1], self.corner_fans[c + 2]]
    }
}

fn invert(first: &[u32], corners: &[FanCorner], corner_count: usize) -> Vec<u32> {
    let mut corner_fans = vec![0; corner_count];
    for (f, range) in first.windows(2).enumerate() {
        for c in &corners[range[0] as usize..range[1] as usize] {
            corner_fans[c.corner() as usize] = f as u32;
        }
    }
    corner_fans
}

const RUN: usize = 4096;

#[derive(Default)]
struct Part {
    lengths: Vec<u32>,
    closed: Vec<bool>,
    has_links_by_angle: bool,
}

const OPEN: u32 = u32::MAX;

/// Finds the neighbours of each corner around one vertex and walks along them. Keeps its buffers between vertices.
#[derive(Default)]
struct Walker<'p> {
    /// Where links go by angle, too.
    positions: Option<&'p [Vec3]>,
    has_links_by_angle: bool,
    center: u32,
    /// Ring vertices of each local corner: `[next, previous]`.
    ring: Vec<[u32; 2]>,
    /// For each local corner and side, the local corner that shares that edge, or `OPEN`.
    link: Vec<[u32; 2]>,
    visited: Vec<bool>,
    /// The spokes of a vertex of high degree, or those at one edge.
    spokes: Vec<Spoke>,
}

/// An edge at the vertex as one of its triangles has it: `(ring vertex, local corner, side)`.
type Spoke = (u32, u32, u32);

/// Up to this degree a quadratic search for neighbours beats sorting.
const SMALL_DEGREE: usize = 24;

impl Walker<'_> {
    /// Writes the corners of a vertex to `out`, fan by fan.
    fn walk(&mut self, triangles: &[[u32; 3]], corners: &[u32], out: &mut [FanCorner], part: &mut Part) {
        if let Some(disc) = Disc::of(triangles, corners) {
            for (to, &i) in out.iter_mut().zip(&disc.order) {
                *to = FanCorner::new(corners[i as usize], false);
            }
            part.lengths.push(corners.len() as u32);
            part.closed.push(true);
            return;
        }
        self.ring.clear();
        self.ring.extend(corners.iter().map(|&c| {
            let (t, k) = (&triangles[c as usize / 3], c as usize % 3);
            [t[(k + 1) % 3], t[(k + 2) % 3]]
        }));
        self.link.clear();
        self.link.resize(corners.len(), [OPEN; 2]);
        if corners.len() <= SMALL_DEGREE {
            self.link_by_search()
        } else {
            self.link_by_sorting()
        }
        self.visited.clear();
        self.visited.resize(corners.len(), false);
        let mut out = out.iter_mut();
        // Open fans first, each from the end where a counter-clockwise walk begins; then what is left is closed.
        for side in [0, 1] {
            for i in 0..corners.len() {
                if !self.visited[i] && self.link[i][side] == OPEN {
                    self.walk_from(i, side == 1, corners, &mut out, part);
                }
            }
        }
        for i in 0..corners.len() {
            if !self.visited[i] {
                self.walk_from(i, false, corners, &mut out, part);
            }
        }
    }

    fn link_by_search(&mut self) {
        let mut spokes = std::mem::take(&mut self.spokes);
        for i in 0..self.ring.len() {
            for side in 0..2 {
                if self.link[i][side] != OPEN {
                    continue;
                }
                let w = self.ring[i][side];
                spokes.clear();
                spokes.extend((0u32..).zip(&self.ring).filter_map(|(j, ring)| {
                    ring.iter().position(|&v| v == w).map(|side| (w, j, side as u32))
                }));
                self.link_edge(&spokes);
            }
        }
        self.spokes = spokes;
    }

    fn link_by_sorting(&mut self) {
        let mut spokes = std::mem::take(&mut self.spokes);
        spokes.clear();
        for (i, ring) in (0u32..).zip(&self.ring) {
            spokes.extend((0u32..).zip(ring).map(|(side, &w)| (w, i, side)));
        }
        spokes.sort_unstable();
        spokes.chunk_by(|a, b| a.0 == b.0).for_each(|edge| self.link_edge(edge));
        self.spokes = spokes;
    }

    /// Links the triangles that continue each other; `edge` is all of the edge's.
    fn link_edge(&mut self, edge: &[Spoke]) {
        if !(2..=MAX_AT_EDGE).contains(&edge.len()) {
            return;
        }
        let end = edge[0].0;
        // Forward is from the lower vertex to the higher one.
        let side = |&(_, i, side): &Spoke| EdgeSide {
            opposite: self.ring[i as usize][1 - side as usize],
            is_forward: (side == 0) == (self.center < end),
        };
        let sides: ArrayVec<EdgeSide, MAX_AT_EDGE> = edge.iter().map(side).collect();
        let ends = [self.center.min(end), self.center.max(end)];
        let mut pairs = continued(&sides);
        if let Some(positions) = self.positions.filter(|_| pairs.is_empty()) {
            pairs = continued_by_angle(&sides, ends, positions);
            self.has_links_by_angle |= !pairs.is_empty();
        }
        for pair in pairs {
            let [(_, i, side_i), (_, j, side_j)] = pair.map(|k| edge[k]);
            self.link[i as usize][side_i as usize] = j;
            self.link[j as usize][side_j as usize] = i;
        }
    }

    /// Walks from local corner `i`, which is left over its `previous` vertex (or, `reversed`, over its `next`).
    fn walk_from<'a>(
        &mut self,
        mut i: usize,
        mut reversed: bool,
        corners: &[u32],
        out: &mut impl Iterator<Item = &'a mut FanCorner>,
        part: &mut Part,
    ) {
        let mut length = 0;
        let closed = loop {
            self.visited[i] = true;
            length += 1;
            if let Some(to) = out.next() {
                *to = FanCorner::new(corners[i], reversed);
            }
            let exit_side = if reversed { 0 } else { 1 };
            let j = self.link[i][exit_side];
            if j == OPEN {
                break false;
            }
            let shared = self.ring[i][exit_side];
            i = j as usize;
            if self.visited[i] {
                break true;
            }
            reversed = self.ring[i][0] != shared;
        };
        part.lengths.push(length);
        part.closed.push(closed);
    }
}

// The common case of a vertex: a few triangles of one orientation that surround it once.

/// Discs of more triangles are left to the general search.
const MAX_DISC_TRIANGLES: usize = 8;

/// The triangles around a vertex that form a closed, consistently wound disc: two triangles on every edge, running along it
/// in opposite directions.
pub(crate) struct Disc {
    /// Indices into the vertex' corners, counter-clockwise from the first. As many count as the vertex has corners.
    pub(crate) order: [u8; MAX_DISC_TRIANGLES],
    /// For each of the vertex' corners the vertex that follows it in its triangle: the ends of the disc's edges.
    pub(crate) ends: [u32; MAX_DISC_TRIANGLES],
}

impl Disc {
    /// The disc around the vertex with the given corners; `None` where they form none, or a large one.
    #[inline]
    pub(crate) fn of(triangles: &[[u32; 3]], corners: &[u32]) -> Option<Self> {
        if !(3..=MAX_DISC_TRIANGLES).contains(&corners.len()) {
            return None;
        }
        let mut next = [u32::MAX; MAX_DISC_TRIANGLES];
        let mut previous = [u32::MAX; MAX_DISC_TRIANGLES];
        for (i, &corner) in corners.iter().enumerate() {
            let (triangle, k) = (&triangles[corner as usize / 3], corner as usize % 3);
            next[i] = triangle[(k + 1) % 3];
            previous[i] = triangle[(k + 2) % 3];
        }
        // Each triangle is followed by the first one that begins at the edge where it ends. If the first triangle is reached
        // again after all others, every triangle follows exactly one, so no edge has a third.
        let mut order = [0; MAX_DISC_TRIANGLES];
        let mut at = 0;
        for step in order.iter_mut().take(corners.len()).skip(1) {
            let edge = previous[at];
            at = MAX_DISC_TRIANGLES;
            for i in (0..MAX_DISC_TRIANGLES).rev() {
                at = if next[i] == edge { i } else { at };
            }
            if at == 0 || at == MAX_DISC_TRIANGLES {
                return None;
            }
            *step = at as u8;
        }
        (previous[at] == next[0]).then_some(Self { order, ends: next })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(ring: &[[u32; 2]]) -> Option<Vec<u8>> {
        let triangles: Vec<[u32; 3]> = ring.iter().map(|&[a, b]| [0, a, b]).collect();
        let corners: Vec<u32> = (0..ring.len() as u32).map(|t| 3 * t).collect();
        Disc::of(&triangles, &corners).map(|disc| disc.order[..ring.len()].to_vec())
    }

    #[test]
    fn a_disc_is_walked_from_its_first_triangle() {
        assert_eq!(disc(&[[1, 2], [3, 1], [2, 3]]), Some(vec![0, 2, 1]));
        assert_eq!(disc(&[[5, 6], [8, 5], [6, 7], [7, 8]]), Some(vec![0, 2, 3, 1]));
    }

    #[test]
    fn whatever_is_no_disc_is_left() {
        assert_eq!(disc(&[[1, 2], [2, 3]]), None);
        // Open.
        assert_eq!(disc(&[[1, 2], [2, 3], [3, 4]]), None);
        // One triangle turned round.
        assert_eq!(disc(&[[1, 2], [2, 3], [1, 3]]), None);
        // Two sheets.
        assert_eq!(disc(&[[1, 2], [2, 3], [3, 1], [4, 5], [5, 6], [6, 4]]), None);
        // A third triangle at an edge, at its beginning or at its end.
        assert_eq!(disc(&[[1, 2], [2, 3], [3, 1], [2, 4]]), None);
        assert_eq!(disc(&[[1, 2], [2, 3], [3, 1], [4, 2]]), None);
        // A loop that is entered from the side, and a disc that is too large.
        assert_eq!(disc(&[[1, 2], [2, 3], [3, 2], [2, 1]]), None);
        let large: Vec<[u32; 2]> = (0..9).map(|i| [1 + i, 1 + (i + 1) % 9]).collect();
        assert_eq!(disc(&large), None);
        assert_eq!(disc(&large[..8]), None);
    }
}
