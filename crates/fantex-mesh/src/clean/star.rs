//! The triangles around one vertex, seen through the edges that leave it.
//!
//! All questions about edges are answered locally: the star of a vertex lists its edges sorted by their other end. No
//! table of all edges of the mesh is needed, and vertices are independent of each other.

/// The edges of one vertex. Refilled for every vertex to reuse its memory.
#[derive(Default)]
pub(crate) struct Star {
    vertex: u32,
    corner_count: usize,
    /// One entry per triangle and edge, sorted.
    entries: Vec<Entry>,
    /// Union-find over the corners of the star.
    fans: Vec<u32>,
}

/// An edge of the star as one of its triangles sees it.
#[derive(Clone, Copy)]
struct Entry {
    other: u32,
    /// Index of the corner within the star.
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
            let incoming_half_edge = corner - k + previous;
            self.entries.push(Entry {
                other: triangle[next as usize],
                slot,
                half_edge: corner,
                incoming: false,
            });
            self.entries.push(Entry {
                other: triangle[previous as usize],
                slot,
                half_edge: incoming_half_edge,
                incoming: true,
            });
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
    pub(crate) fn edges(&self) -> impl Iterator<Item = Edge<'_>> {
        self.entries.chunk_by(|a, b| a.other == b.other).map(Edge)
    }

    /// True where all triangles hang together through the edges of this vertex.
    pub(crate) fn is_single_fan(&mut self) -> bool {
        self.fans.clear();
        self.fans.extend(0..self.corner_count as u32);
        let mut fan_count = self.corner_count;
        for pair in self.entries.windows(2).filter(|pair| pair[0].other == pair[1].other) {
            let (a, b) = (root(&mut self.fans, pair[0].slot), root(&mut self.fans, pair[1].slot));
            if a != b {
                self.fans[a.max(b) as usize] = a.min(b);
                fan_count -= 1;
            }
        }
        fan_count <= 1
    }
}

/// The root of an element's set, halving the path on the way.
pub(crate) fn root(parents: &mut [u32], mut element: u32) -> u32 {
    while parents[element as usize] != element {
        parents[element as usize] = parents[parents[element as usize] as usize];
        element = parents[element as usize];
    }
    element
}

/// One edge with all its triangles.
#[derive(Clone, Copy)]
pub(crate) struct Edge<'a>(&'a [Entry]);

impl Edge<'_> {
    /// The end that is not the star's vertex.
    pub(crate) fn other(&self) -> u32 {
        self.0[0].other
    }

    /// Number of triangles, at least one.
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
