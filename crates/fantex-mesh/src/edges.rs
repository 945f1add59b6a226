//! The edges of a mesh with the triangles at each.

use arrayvec::ArrayVec;
use rayon::prelude::*;

use crate::{EdgeSide, MOST_AT_EDGE, continued};

/// All edges of a mesh, in the order of their vertices. Gathering them takes a sort of the half-edges, in parallel.
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
        let of_triangle = |(t, triangle): (usize, &[u32; 3])| {
            let [a, b, c] = *triangle;
            [(a, b), (b, c), (c, a)].into_iter().zip(3 * t as u32..).map(|((from, to), half_edge)| {
                (u64::from(from.min(to)) << 32 | u64::from(from.max(to)), half_edge)
            })
        };
        let mut half_edges: Vec<(u64, u32)> =
            triangles.par_iter().enumerate().flat_map_iter(of_triangle).collect();
        half_edges.par_sort_unstable();
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

    /// How many triangles meet there.
    pub fn triangle_count(&self) -> usize {
        self.half_edges.len()
    }

    /// The half-edges of triangles that [continue](continued) each other.
    pub fn continued(&self) -> ArrayVec<[u32; 2], { MOST_AT_EDGE / 2 }> {
        if self.half_edges.len() > MOST_AT_EDGE {
            return ArrayVec::new();
        }
        let [first, _] = self.vertices();
        let side = |&(_, half_edge): &(u64, u32)| EdgeSide::of_half_edge(self.triangles, half_edge, first);
        let sides: ArrayVec<EdgeSide, MOST_AT_EDGE> = self.half_edges.iter().map(side).collect();
        continued(&sides).into_iter().map(|pair| pair.map(|i| self.half_edges[i].1)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_come_in_order_with_what_continues_across_them() {
        // Two triangles side by side, wound alike, and the back of the second.
        let triangles = [[0, 1, 2], [2, 1, 3], [3, 1, 2]];
        let edges = Edges::of(&triangles);
        let found: Vec<_> =
            edges.iter().map(|e| (e.vertices(), e.triangle_count(), e.continued().to_vec())).collect();
        let expected = [
            ([0, 1], 1, vec![]),
            ([0, 2], 1, vec![]),
            // The first goes on with the second; the back has an end.
            ([1, 2], 3, vec![[1, 3]]),
            ([1, 3], 2, vec![]),
            ([2, 3], 2, vec![]),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn where_too_many_meet_nothing_continues() {
        let fan: Vec<[u32; 3]> = (2..1002).map(|v| if v % 2 == 0 { [0, 1, v] } else { [1, 0, v] }).collect();
        let edges = Edges::of(&fan);
        let middle = edges.iter().next().unwrap();
        assert_eq!((middle.vertices(), middle.triangle_count()), ([0, 1], 1000));
        assert!(middle.continued().is_empty());
    }
}
