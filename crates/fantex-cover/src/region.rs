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

/// Calls `emit` with the points on the region's outline in one triangle. `inside` tells which corners are in the group;
/// points of a triangle that is wholly inside are its corners.
pub(crate) fn outline_points<P>(corners: [P; 3], inside: [bool; 3], delta: f32, mut emit: impl FnMut(P))
where
    P: Copy + Add<Output = P> + Mul<f32, Output = P>,
{
    let (near, far) = (0.5 - 0.5 * delta, 0.5 + 0.5 * delta);
    let inside_count = inside.iter().filter(|&&i| i).count();
    for k in 0..3 {
        let (this, next, previous) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
        match (inside_count, inside[k]) {
            (1, true) => {
                emit(this);
                emit(this * near + next * far);
                emit(this * near + previous * far);
                emit(this * ((1.0 - 2.0 * delta) / 3.0) + (next + previous) * ((1.0 + delta) / 3.0));
            }
            (2, false) => {
                emit(next * near + this * far);
                emit(previous * near + this * far);
            }
            (2 | 3, true) => emit(this),
            _ => {}
        }
    }
}
