//! Triangles that are each other's back.
//!
//! A leaf or a wall modelled with both of its sides has each triangle twice, with its vertices in opposite order. Both lie at the same
//! depth, so whoever draws or meets both sees sometimes the one and sometimes the other. Seen from behind such a triangle does not
//! count, whatever its material says: what is seen there is its twin.

use rayon::prelude::*;

/// The triangles that have a twin: the same three vertices in opposite order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Twins {
    /// Per triangle; empty where there are none.
    has_twin: Vec<bool>,
}

impl Twins {
    /// Finds them. Of more than two with the same vertices, as cleaned meshes have none, all have twins where any two are in opposite
    /// order.
    pub fn of(triangles: &[[u32; 3]]) -> Self {
        let mut keys: Vec<([u32; 3], u32)> =
            triangles.par_iter().enumerate().map(|(t, &triangle)| (sorted(triangle), t as u32)).collect();
        keys.par_sort_unstable();
        let mut twins = Self::default();
        for alike in keys.chunk_by(|a, b| a.0 == b.0).filter(|alike| alike.len() > 1) {
            let is_even = |&(key, t): &([u32; 3], u32)| is_turned(triangles[t as usize], key);
            let even = alike.iter().filter(|one| is_even(one)).count();
            if even > 0 && even < alike.len() {
                twins.has_twin.resize(triangles.len(), false);
                alike.iter().for_each(|&(_, t)| twins.has_twin[t as usize] = true);
            }
        }
        twins
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.has_twin.is_empty()
    }

    /// Whether a triangle has a twin, so that it counts from its front only.
    #[inline]
    pub fn contains(&self, triangle: usize) -> bool {
        self.has_twin.get(triangle).copied().unwrap_or(false)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_of_a_pair_are_twins_and_nothing_else() {
        let triangles = [[5, 3, 9], [0, 1, 2], [9, 3, 5], [1, 2, 3], [3, 9, 5], [2, 1, 7]];
        // The fifth is the first once more.
        let found = Twins::of(&triangles);
        let all: Vec<bool> = (0..triangles.len()).map(|t| found.contains(t)).collect();
        assert_eq!(all, [true, false, true, false, true, false]);
        assert!(!found.contains(99));
        // Copies in the same order are no twins.
        assert!(Twins::of(&[[0, 1, 2], [1, 2, 0], [2, 3, 4]]).is_empty());
        assert_eq!(Twins::of(&[]), Twins::default());
    }

    #[test]
    fn every_pair_of_orders_is_told_apart() {
        let orders = [[4, 6, 8], [6, 8, 4], [8, 4, 6], [4, 8, 6], [8, 6, 4], [6, 4, 8]];
        for (i, a) in orders.into_iter().enumerate() {
            for (j, b) in orders.into_iter().enumerate() {
                assert_eq!(Twins::of(&[a, b]).contains(1), (i < 3) != (j < 3), "{a:?} {b:?}");
            }
        }
    }
}
