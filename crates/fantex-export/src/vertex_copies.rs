//! Vertices that are split where what is stored with them differs.

use crate::charts::NONE;

/// Copies of vertices, numbered from 0 in the order in which they are asked for: one for each of a vertex' different keys.
pub(crate) struct VertexCopies<K> {
    /// Of each vertex its latest copy, or [`NONE`].
    latest: Vec<u32>,
    /// Of each copy its key, and its vertex' copy before it, or [`NONE`].
    copies: Vec<(K, u32)>,
    /// The first copy that counts.
    first: u32,
}

impl<K: PartialEq> VertexCopies<K> {
    /// No copies yet of so many vertices.
    pub(crate) fn new(vertices: usize) -> Self {
        Self { latest: vec![NONE; vertices], copies: Vec::new(), first: 0 }
    }

    /// Begins anew, with copy 0.
    pub(crate) fn restart(&mut self) {
        self.first = self.copies.len() as u32;
    }

    /// The copy of a vertex with a key, and whether it is a new one.
    pub(crate) fn find_or_add(&mut self, vertex: u32, key: K) -> (u32, bool) {
        let latest = &mut self.latest[vertex as usize];
        let mut copy = *latest;
        while copy != NONE && copy >= self.first {
            let (own, before) = &self.copies[copy as usize];
            if *own == key {
                return (copy - self.first, false);
            }
            copy = *before;
        }
        let new = self.copies.len() as u32;
        self.copies.push((key, std::mem::replace(latest, new)));
        (new - self.first, true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vertex_has_a_copy_for_each_key() {
        let mut copies = VertexCopies::new(3);
        let asked = [(2, 'a'), (0, 'a'), (2, 'b'), (2, 'a'), (2, 'b'), (1, 'a')];
        let found: Vec<_> = asked.iter().map(|&(vertex, key)| copies.find_or_add(vertex, key)).collect();
        assert_eq!(found, [(0, true), (1, true), (2, true), (0, false), (2, false), (3, true)]);
        copies.restart();
        assert_eq!(copies.find_or_add(2, 'b'), (0, true));
        assert_eq!(copies.find_or_add(2, 'a'), (1, true));
        assert_eq!(copies.find_or_add(2, 'b'), (0, false));
    }
}
