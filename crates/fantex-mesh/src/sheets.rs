//! Which triangles continue each other across an edge.
//!
//! At most edges there is nothing to decide: two triangles meet. Where more meet, the surface goes on where it is clear how:
//!
//! ```text
//!        p             q           a leaf or a wall modelled with both of its sides: four triangles at the edge (seen
//!         \           /            from its end), two and two with the same vertices in opposite order. The front goes on
//!     back \\       // back        with the front, the back with the back.
//!     front \\_____// front
//!            ^ edge
//! ```
//!
//! A triangle is never continued by its *twin*, which has the same three vertices: where only the two sides of a leaf meet, at its
//! rim, each of them ends.

use arrayvec::ArrayVec;

/// One triangle at an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgeSide {
    /// Its third vertex.
    pub opposite: u32,
    /// Whether it runs along the edge in the one direction or in the other; which is called so does not matter.
    pub is_forward: bool,
}

impl EdgeSide {
    /// The triangle of a half-edge (its number is three times the triangle's plus that of the corner where it begins).
    /// `first` is the end of the edge from which on a triangle runs forward.
    #[inline]
    pub fn of_half_edge(triangles: &[[u32; 3]], half_edge: u32, first: u32) -> Self {
        let (triangle, k) = (triangles[half_edge as usize / 3], half_edge as usize % 3);
        Self { opposite: triangle[(k + 2) % 3], is_forward: triangle[k] == first }
    }
}

/// Edges of more triangles end all of them.
pub const MOST_AT_EDGE: usize = 8;

/// The pairs of triangles that continue each other at an edge, as ascending indices into `sides`, which are all triangles
/// there. Each is in one pair at most.
///
/// Two triangles continue each other unless they are twins. Of more, those that run along the edge in opposite directions
/// are candidates of each other unless they are twins, and those continue each other that have no other candidate.
pub fn continued(sides: &[EdgeSide]) -> ArrayVec<[usize; 2], { MOST_AT_EDGE / 2 }> {
    let are_twins = |i: usize, j: usize| sides[i].opposite == sides[j].opposite;
    let mut pairs = ArrayVec::new();
    match sides.len() {
        2 if !are_twins(0, 1) => pairs.push([0, 1]),
        3..=MOST_AT_EDGE => {
            let only_candidate = |i: usize| {
                let is_candidate =
                    |&j: &usize| sides[j].is_forward != sides[i].is_forward && !are_twins(i, j);
                let mut candidates = (0..sides.len()).filter(is_candidate);
                candidates.next().filter(|_| candidates.next().is_none())
            };
            let partners = (0..sides.len()).filter_map(|i| only_candidate(i).map(|j| [i, j]));
            pairs.extend(partners.filter(|&[i, j]| i < j && only_candidate(j) == Some(i)));
        }
        _ => {}
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(sides: &[(u32, bool)]) -> Vec<[usize; 2]> {
        let sides: Vec<EdgeSide> =
            sides.iter().map(|&(opposite, is_forward)| EdgeSide { opposite, is_forward }).collect();
        continued(&sides).to_vec()
    }

    #[test]
    fn two_triangles_continue_each_other_however_they_are_wound() {
        assert_eq!(pairs(&[(2, true), (3, false)]), [[0, 1]]);
        assert_eq!(pairs(&[(2, true), (3, true)]), [[0, 1]]);
        assert_eq!(pairs(&[(2, true)]), [[0; 2]; 0]);
    }

    #[test]
    fn twins_do_not_continue_each_other() {
        assert_eq!(pairs(&[(2, true), (2, false)]), [[0; 2]; 0]);
    }

    #[test]
    fn both_sides_of_a_leaf_go_on() {
        assert_eq!(pairs(&[(2, true), (2, false), (3, true), (3, false)]), [[0, 3], [1, 2]]);
        // One side has an end here.
        assert_eq!(pairs(&[(2, true), (2, false), (3, true)]), [[1, 2]]);
    }

    #[test]
    fn where_it_is_not_clear_nothing_goes_on() {
        assert_eq!(pairs(&[(2, true), (3, false), (4, true)]), [[0; 2]; 0]);
        // Two blocks that touch along an edge.
        assert_eq!(pairs(&[(2, true), (3, false), (4, true), (5, false)]), [[0; 2]; 0]);
        // Three leaves in one stem.
        let leaves: Vec<(u32, bool)> = (2..5).flat_map(|v| [(v, true), (v, false)]).collect();
        assert_eq!(pairs(&leaves), [[0; 2]; 0]);
        let many: Vec<(u32, bool)> = (2..90_000).map(|v| (v, v % 2 == 0)).collect();
        assert_eq!(pairs(&many), [[0; 2]; 0]);
    }
}
