//! Triangles that occur more than once.

use std::collections::HashSet;

use super::first::{repeats, scramble};

/// What [`find`] found.
pub(super) struct Duplicates {
    /// Triangles with the same vertices in the same cyclic order as an earlier one, ascending.
    pub(super) repeated: Vec<u32>,
    /// Pairs of triangles with the same vertices in opposite order: a double-sided sheet. Both stay.
    pub(super) double_sided_pairs: u64,
}

/// Finds repeated and double-sided triangles.
pub(super) fn find(triangles: &[[u32; 3]]) -> Duplicates {
    let mut found = Duplicates { repeated: Vec::new(), double_sided_pairs: 0 };
    let mut paired = HashSet::new();
    let key = |t: usize| sorted(triangles[t]);
    let same_vertices = |a: u32, b: u32| key(a as usize) == key(b as usize);
    for repeat in repeats(triangles.len(), |t| Some(scramble(key(t))), same_vertices) {
        let (triangle, first) = (triangles[repeat.element as usize], triangles[repeat.first as usize]);
        if smallest_first(triangle) == smallest_first(first) || !paired.insert(repeat.first) {
            found.repeated.push(repeat.element);
        } else {
            found.double_sided_pairs += 1;
        }
    }
    found
}

fn sorted([a, b, c]: [u32; 3]) -> [u32; 3] {
    let (low, high) = (a.min(b), a.max(b));
    [low.min(c), low.max(high.min(c)), high.max(c)]
}

/// Turned so that the smallest index comes first; the cyclic order stays.
fn smallest_first(triangle: [u32; 3]) -> [u32; 3] {
    let mut turned = triangle;
    while turned[0] > turned[1] || turned[0] > turned[2] {
        turned.rotate_left(1);
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turned_copies_are_repeats_and_reversed_ones_are_twins() {
        let found = find(&[[5, 3, 9], [3, 9, 5], [9, 3, 5], [5, 9, 3], [1, 2, 3], [9, 5, 3]]);
        assert_eq!(found.repeated, [1, 3, 5]);
        assert_eq!(found.double_sided_pairs, 1);
    }

    #[test]
    fn sorting_covers_every_order() {
        for t in [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]] {
            assert_eq!(sorted(t), [1, 2, 3]);
        }
    }
}
