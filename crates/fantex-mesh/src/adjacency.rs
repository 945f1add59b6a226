//! Which corners lie at which vertex: the adjacency that fans, normals and the cleaning report are built from.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

/// Vertices handled per parallel task.
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
    let cursors: Vec<AtomicU32> = starts.iter().map(|&s| AtomicU32::new(s)).collect();
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
    (0..count).map(|_| AtomicU32::new(0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_hold_every_corner_once_in_ascending_order() {
        let triangles = [[0, 1, 2], [2, 1, 3], [5, 3, 1]];
        let adjacency = VertexCorners::of(&triangles, 7);
        let rows: Vec<&[u32]> = (0..adjacency.len()).map(|v| adjacency.at(v)).collect();
        let expected: [&[u32]; 7] = [&[0], &[1, 4, 8], &[2, 3], &[5, 7], &[], &[6], &[]];
        assert_eq!(rows, expected);
    }

    #[test]
    fn a_hub_of_a_hundred_thousand_triangles_stays_sorted() {
        let triangles: Vec<[u32; 3]> = (0..100_000).map(|i| [0, i + 1, i + 2]).collect();
        let adjacency = VertexCorners::of(&triangles, 100_002);
        assert!(adjacency.at(0).iter().enumerate().all(|(i, &c)| c == 3 * i as u32));
    }

    #[test]
    fn no_triangles_give_empty_rows() {
        assert!(VertexCorners::of(&[], 0).is_empty());
        assert_eq!(VertexCorners::of(&[], 2).at(1), &[] as &[u32]);
    }
}
