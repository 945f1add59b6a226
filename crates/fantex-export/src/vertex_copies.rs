//! Vertices that are split where what is stored with them differs.

use std::hash::Hash;

use rustc_hash::FxHashMap;

use crate::charts::NONE;

/// Copies of vertices, numbered from 0 in the order in which they are asked for: one for each of a vertex' different keys.
pub(crate) struct VertexCopies<K> {
    /// Of each vertex its latest copy, or [`NONE`].
    latest: Vec<u32>,
    /// Of each copy its key, and its vertex' copy before it, or [`NONE`].
    copies: Vec<(K, u32)>,
    /// The copies of a vertex but for its latest [`FEW`].
    of_many: FxHashMap<(u32, K), u32>,
    /// The first copy that counts.
    first: u32,
}

/// Of so many copies a vertex' own is found faster by looking at all of them than by hashing.
const FEW: usize = 16;

impl<K: Copy + Eq + Hash> VertexCopies<K> {
    /// No copies yet of so many vertices.
    pub(crate) fn new(vertices: usize) -> Self {
        Self { latest: vec![NONE; vertices], copies: Vec::new(), of_many: FxHashMap::default(), first: 0 }
    }

    /// Begins anew, with copy 0.
    pub(crate) fn restart(&mut self) {
        self.first = self.copies.len() as u32;
    }

    /// The copy of a vertex with a key, and whether it is a new one.
    pub(crate) fn find_or_add(&mut self, vertex: u32, key: K) -> (u32, bool) {
        let counts = |copy: u32| copy != NONE && copy >= self.first;
        let mut copy = self.latest[vertex as usize];
        let (mut seen, mut oldest) = (0, NONE);
        while counts(copy) && seen < FEW {
            let (own, before) = self.copies[copy as usize];
            if own == key {
                return (copy - self.first, false);
            }
            (seen, oldest, copy) = (seen + 1, copy, before);
        }
        if seen == FEW {
            if let Some(&copy) = self.of_many.get(&(vertex, key)).filter(|&&copy| counts(copy)) {
                return (copy - self.first, false);
            }
            // From now on it is too far back.
            self.of_many.insert((vertex, self.copies[oldest as usize].0), oldest);
        }
        let new = self.copies.len() as u32;
        self.copies.push((key, std::mem::replace(&mut self.latest[vertex as usize], new)));
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

    /// As a hub of very many spokes has, each with a normal of its own.
    #[test]
    fn many_copies_are_found_again() {
        let mut copies = VertexCopies::new(2);
        for first in [0, 3] {
            copies.restart();
            for key in first..200 {
                assert_eq!(copies.find_or_add(1, key), (key - first, true));
            }
            assert_eq!(copies.find_or_add(0, 7), (200 - first, true));
            for key in first..200 {
                assert_eq!(copies.find_or_add(1, key), (key - first, false));
            }
        }
    }
}
