//! The common case of a vertex: a few triangles of one orientation that surround it once.

/// Discs of more triangles are left to the general search.
pub(crate) const MOST_TRIANGLES: usize = 8;

/// The triangles around a vertex that form a closed, consistently wound disc: two triangles on every edge, running along it
/// in opposite directions.
pub(crate) struct Disc {
    /// Indices into the vertex' corners, counter-clockwise from the first. As many count as the vertex has corners.
    pub(crate) order: [u8; MOST_TRIANGLES],
    /// For each of the vertex' corners the vertex that follows it in its triangle: the ends of the disc's edges.
    pub(crate) ends: [u32; MOST_TRIANGLES],
}

impl Disc {
    /// The disc around the vertex with the given corners; `None` where they form none, or a large one.
    #[inline]
    pub(crate) fn of(triangles: &[[u32; 3]], corners: &[u32]) -> Option<Self> {
        if !(3..=MOST_TRIANGLES).contains(&corners.len()) {
            return None;
        }
        let mut next = [u32::MAX; MOST_TRIANGLES];
        let mut previous = [u32::MAX; MOST_TRIANGLES];
        for (i, &corner) in corners.iter().enumerate() {
            let (triangle, k) = (&triangles[corner as usize / 3], corner as usize % 3);
            next[i] = triangle[(k + 1) % 3];
            previous[i] = triangle[(k + 2) % 3];
        }
        // Each triangle is followed by the first one that begins at the edge where it ends. If the first triangle is reached
        // again after all others, every triangle follows exactly one, so no edge has a third.
        let mut order = [0; MOST_TRIANGLES];
        let mut at = 0;
        for step in order.iter_mut().take(corners.len()).skip(1) {
            let edge = previous[at];
            at = MOST_TRIANGLES;
            for i in (0..MOST_TRIANGLES).rev() {
                at = if next[i] == edge { i } else { at };
            }
            if at == 0 || at == MOST_TRIANGLES {
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
