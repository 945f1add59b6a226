//! The corner points of the region that a group is responsible for.
//!
//! ```text
//!            c                 corner c in the group, j and k not: the region in this triangle is c e_j m e_k with
//!           / \                  e_j = (1-d)/2 c + (1+d)/2 j
//!        e_j   e_k               m   = (1-2d)/3 c + (1+d)/3 (j + k)
//!         / \m/ \              corners j and k in the group, c not: everything below the line through the points
//!        j ----- k               (1-d)/2 j + (1+d)/2 c  and  (1-d)/2 k + (1+d)/2 c
//! ```

use std::ops::{Add, Mul};

/// Calls `emit` with the points on the region's outline in one triangle. `inside` tells which corners are in the group.
///
/// A point on an edge is seen from both of its triangles; with `all` false it is given for one of them only, and centres,
/// which lie inside a closed fan, are left out. Boundaries of the mesh need `all`.
#[inline]
pub(crate) fn outline_points<P>(
    corners: [P; 3],
    inside: [bool; 3],
    delta: f32,
    all: bool,
    mut emit: impl FnMut(P),
) where
    P: Copy + Add<Output = P> + Mul<f32, Output = P>,
{
    let (near, far) = (0.5 - 0.5 * delta, 0.5 + 0.5 * delta);
    for k in (0..3).filter(|&k| inside[k]) {
        let (next, previous) = ((k + 1) % 3, (k + 2) % 3);
        if all {
            emit(corners[k]);
        }
        if !inside[next] {
            emit(corners[k] * near + corners[next] * far);
        }
        if !inside[previous] && all {
            emit(corners[k] * near + corners[previous] * far);
        }
        if !inside[next] && !inside[previous] {
            emit(
                corners[k] * ((1.0 - 2.0 * delta) / 3.0)
                    + (corners[next] + corners[previous]) * ((1.0 + delta) / 3.0),
            );
        }
    }
}
