//! Cutting triangles at the middles of their edges, round by round, without cracks.
//!
//! Whether an edge is cut is decided once for the edge, from what all its triangles agree on: its length, and the mean over
//! them of the heights along it. Where any side of a triangle is cut, its longest one is, too (M. Rivara, "Algorithms for
//! refining triangular grids suitable for adaptive and multigrid techniques", 1984): so no angle becomes much smaller than
//! the mesh had, and cutting comes to an end. A triangle is then cut by the pattern of its cut edges:
//!
//! ```text
//!      c2               c2                 c2                  c2
//!      /\               /|\                /\                  /\
//!     /  \             / | \              /  \ M1           M2/__\M1
//!    /    \           /  |  \            / ./ \              /\  /\
//!   /______\         /___|___\          /./____\            /__\/__\
//!  c0      c1       c0   M0   c1       c0  M0   c1         c0  M0   c1
//!    none               one          two: the shorter         three
//!                                     diagonal
//! ```

use glam::Vec3;
use rayon::prelude::*;

use super::{DisplaceError, DisplacePoint, Refinement};

/// Triangles per parallel task.
const BLOCK: usize = 1 << 12;
/// No vertex, no edge.
const NONE: u32 = u32::MAX;
/// Where along an edge the displaced surface is compared with the straight line.
const PROBES: [f32; 3] = [0.25, 0.5, 0.75];

/// A corner of a piece of a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) vertex: u32,
    /// Barycentric coordinates on the triangle of the mesh that it is a piece of.
    pub(super) lambda: Vec3,
}

/// A piece of a triangle of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Triangle of the mesh.
    pub(super) triangle: u32,
    pub(super) corners: [Corner; 3],
}

/// A vertex that all pieces around it share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    /// Undisplaced, mesh space.
    pub(super) position: Vec3,
    /// Unit normal along which it is displaced.
    pub(super) normal: Vec3,
    pub(super) height: f32,
}

impl Vertex {
    pub(super) fn displaced(&self) -> Vec3 {
        self.position + self.normal * self.height
    }
}

/// The mesh while it is being cut.
pub(super) struct Tessellation<'h, H> {
    pub(super) vertices: Vec<Vertex>,
    pub(super) pieces: Vec<Piece>,
    pub(super) height: &'h H,
}

/// An edge of a piece: its vertices in ascending order, and the number of its first corner.
type Side = (u64, u32);

impl<H: Fn(&DisplacePoint) -> f32 + Sync> Tessellation<'_, H> {
    /// Cuts once all edges that need it; returns how many.
    pub(super) fn refine(
        &mut self,
        refinement: &Refinement,
        max_triangles: u64,
    ) -> Result<usize, DisplaceError> {
        // Step 1: the sides that may be cut, those of one edge next to each other.
        let mut sides = self.long_sides(refinement.shortest());
        sides.par_sort_unstable();

        // Step 2: decide edge by edge, then for the longest sides of pieces with a cut side.
        let edges: Vec<&[Side]> = sides.chunk_by(|a, b| a.0 == b.0).collect();
        let decide = |edge: &&[Side]| self.is_to_be_cut(edge, refinement);
        let mut is_cut = edges.par_iter().with_min_len(256).map(decide).collect::<Result<Vec<bool>, _>>()?;
        self.cut_longest_sides(&edges, &mut is_cut);

        // Step 3: keep to the limit. Every cut adds one piece per side.
        let cut: Vec<&[Side]> = edges.iter().zip(&is_cut).filter(|e| *e.1).map(|e| *e.0).collect();
        let needed = (self.pieces.len() + cut.iter().map(|edge| edge.len()).sum::<usize>()) as u64;
        if needed > max_triangles {
            let shortest_edge = refinement.shortest();
            return Err(DisplaceError::TooManyTriangles { shortest_edge, needed, limit: max_triangles });
        }

        // Step 4: make the new vertices and tell them to the sides.
        let middle = |edge: &&[Side]| self.on_edge(edge, 0.5);
        let middles = cut.par_iter().with_min_len(256).map(middle).collect::<Result<Vec<Vertex>, _>>()?;
        let mut middle_of_side = vec![NONE; 3 * self.pieces.len()];
        for (vertex, edge) in (self.vertices.len() as u32..).zip(&cut) {
            edge.iter().for_each(|&(_, side)| middle_of_side[side as usize] = vertex);
        }
        self.vertices.extend(middles);

        // Step 5: cut the pieces.
        if !cut.is_empty() {
            let vertices = &self.vertices;
            let cut = |(piece, middles): (&Piece, &[u32])| cut_piece(vertices, piece, middles);
            let pieces = self.pieces.par_iter().zip(middle_of_side.par_chunks_exact(3));
            self.pieces = pieces.with_min_len(BLOCK).flat_map_iter(cut).collect();
        }
        Ok(cut.len())
    }

    /// Flags the longest side of every piece that has a flagged side, and so on. A longest side is among `edges`, because
    /// these are all sides above a certain length.
    fn cut_longest_sides(&self, edges: &[&[Side]], is_cut: &mut [bool]) {
        let mut edge_of_side = vec![NONE; 3 * self.pieces.len()];
        for (number, edge) in (0..).zip(edges) {
            edge.iter().for_each(|&(_, side)| edge_of_side[side as usize] = number);
        }
        let mut waiting: Vec<u32> = (0..).zip(&*is_cut).filter(|e| *e.1).map(|e| e.0).collect();
        while let Some(edge) = waiting.pop() {
            for &(_, side) in edges[edge as usize] {
                let longest = edge_of_side[self.longest_side(side as usize / 3)];
                if let Some(flag) = is_cut.get_mut(longest as usize).filter(|flag| !**flag) {
                    *flag = true;
                    waiting.push(longest);
                }
            }
        }
    }

    /// Number of the longest side of a piece; of equal ones, that between the highest vertices, so that neighbours agree.
    fn longest_side(&self, piece: usize) -> usize {
        let order = |k: usize| {
            let (low, high) = self.ends(piece, k);
            (self.squared_length(low, high).to_bits(), high, low)
        };
        3 * piece + (0..3).max_by_key(|&k| order(k)).unwrap_or(0)
    }

    /// Vertices of a side of a piece, ascending.
    fn ends(&self, piece: usize, k: usize) -> (u32, u32) {
        let corners = &self.pieces[piece].corners;
        let (a, b) = (corners[k].vertex, corners[(k + 1) % 3].vertex);
        (a.min(b), a.max(b))
    }

    fn squared_length(&self, a: u32, b: u32) -> f32 {
        self.vertices[a as usize].position.distance_squared(self.vertices[b as usize].position)
    }

    /// Sides longer than `length`, in any order.
    fn long_sides(&self, length: f32) -> Vec<Side> {
        let of_piece = |piece: usize| {
            (0..3).filter_map(move |k| {
                let (low, high) = self.ends(piece, k);
                let is_long = self.squared_length(low, high) > length * length;
                is_long.then(|| ((u64::from(low) << 32) | u64::from(high), (3 * piece + k) as u32))
            })
        };
        (0..self.pieces.len()).into_par_iter().with_min_len(BLOCK).flat_map_iter(of_piece).collect()
    }

    /// Whether an edge is too long, or the displaced surface along it too far from straight; `sides` are those of all its
    /// pieces, ascending.
    fn is_to_be_cut(&self, sides: &[Side], refinement: &Refinement) -> Result<bool, DisplaceError> {
        let [a, b] = self.end_vertices(sides);
        if a.position.distance(b.position) > refinement.longest() {
            return Ok(true);
        }
        if refinement.tolerance() == f32::INFINITY {
            return Ok(false);
        }
        let (from, to) = (a.displaced(), b.displaced());
        for at in PROBES {
            let vertex = self.on_edge(sides, at)?;
            if vertex.displaced().distance(from.lerp(to, at)) > refinement.tolerance() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The vertices of an edge, the lower number first.
    fn end_vertices(&self, sides: &[Side]) -> [&Vertex; 2] {
        [sides[0].0 >> 32, sides[0].0 & u64::from(u32::MAX)].map(|v| &self.vertices[v as usize])
    }

    /// A vertex on an edge, at a share of the way from its lower to its higher vertex.
    fn on_edge(&self, sides: &[Side], at: f32) -> Result<Vertex, DisplaceError> {
        let [a, b] = self.end_vertices(sides);
        let position = a.position * (1.0 - at) + b.position * at;
        let normal = (a.normal * (1.0 - at) + b.normal * at).try_normalize().unwrap_or(a.normal);
        let mut sum = 0.0;
        for &(_, side) in sides {
            let piece = &self.pieces[side as usize / 3];
            let (first, second) = (side as usize % 3, (side as usize + 1) % 3);
            let [p, q] = [first, second].map(|k| piece.corners[k]);
            let at = if p.vertex < q.vertex { at } else { 1.0 - at };
            let lambda = p.lambda * (1.0 - at) + q.lambda * at;
            sum += height_at(self.height, piece.triangle, lambda, position, normal)?;
        }
        Ok(Vertex { position, normal, height: (sum / sides.len() as f64) as f32 })
    }
}

/// The height that one triangle sees at a point.
pub(super) fn height_at(
    height: &impl Fn(&DisplacePoint) -> f32,
    triangle: u32,
    lambda: Vec3,
    position: Vec3,
    normal: Vec3,
) -> Result<f64, DisplaceError> {
    let triangle = triangle as usize;
    let height = height(&DisplacePoint { triangle, lambda, position, normal });
    if height.is_finite() { Ok(height.into()) } else { Err(DisplaceError::Height { triangle, height }) }
}

/// Up to four pieces of a piece; `middles` holds the new vertex, if any, on the sides from corner 0, 1 and 2.
fn cut_piece(vertices: &[Vertex], piece: &Piece, middles: &[u32]) -> arrayvec::ArrayVec<Piece, 4> {
    let is_cut = |k: usize| middles[k] != NONE;
    // Turned so that sides 0 (and 1) are cut, or 0 alone.
    let turn = match (0..3).filter(|&k| is_cut(k)).count() {
        1 => (0..3).find(|&k| is_cut(k)),
        2 => (0..3).find(|&k| is_cut(k) && is_cut((k + 1) % 3)),
        _ => Some(0),
    };
    let turn = turn.unwrap_or(0);
    let c = [0, 1, 2].map(|k| piece.corners[(k + turn) % 3]);
    let middle = |k: usize| {
        let lambda = 0.5 * (c[k].lambda + c[(k + 1) % 3].lambda);
        Corner { vertex: middles[(k + turn) % 3], lambda }
    };
    let m = [0, 1, 2].map(middle);
    let distance = |a: Corner, b: Corner| {
        vertices[a.vertex as usize].position.distance_squared(vertices[b.vertex as usize].position)
    };
    let cut = [0, 1, 2].map(|k| is_cut((k + turn) % 3));
    let corners: &[[Corner; 3]] = match cut {
        [true, true, true] => &[[c[0], m[0], m[2]], [m[0], c[1], m[1]], [m[2], m[1], c[2]], m],
        [true, true, false] if distance(c[0], m[1]) <= distance(m[0], c[2]) => {
            &[[m[0], c[1], m[1]], [c[0], m[0], m[1]], [c[0], m[1], c[2]]]
        }
        [true, true, false] => &[[m[0], c[1], m[1]], [c[0], m[0], c[2]], [m[0], m[1], c[2]]],
        [true, false, false] => &[[c[0], m[0], c[2]], [m[0], c[1], c[2]]],
        _ => &[c],
    };
    corners.iter().map(|&corners| Piece { triangle: piece.triangle, corners }).collect()
}
