//! How each fan is laid flat: projected along its best direction, unfolded, or split.

use glam::{Vec2, Vec3};

use crate::cone::{Cone, narrowest_cone};
use crate::ring::Ring;
use crate::surface::Surface;
use crate::unfold::unfold;

/// Below this cosine between direction and worst normal a fan is rather unfolded: the projection would shrink a triangle
/// to less than a sixth of its length in one direction.
const UNFOLD_BELOW: f32 = 0.15;

/// Below this cosine a projection is numerically folded.
pub(crate) const FOLDED_BELOW: f32 = 1e-3;

/// How a fan is laid into the plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    Projected,
    Unfolded,
    /// Neither works: every triangle must go alone.
    Split,
}

/// The decision for one fan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FanShape {
    pub(crate) layout: Layout,
    /// Best direction and its smallest facing cosine.
    pub(crate) cone: Cone,
    /// A third of the area of the fan's triangles.
    pub(crate) area: f32,
    /// True where no direction sees the whole fan from the front.
    pub(crate) folds: bool,
}

impl FanShape {
    /// Decides about a fan whose geometry is in `ring`.
    pub(crate) fn of(ring: &Ring, surface: &Surface<'_>, fan: usize) -> Self {
        let cone = narrowest_cone(&ring.normals);
        let projectable = cone.cos > FOLDED_BELOW && winds_once(ring, cone.axis);
        let layout = if projectable && cone.cos >= UNFOLD_BELOW {
            Layout::Projected
        } else if unfold(surface, fan).is_some() {
            Layout::Unfolded
        } else if projectable {
            Layout::Projected
        } else {
            Layout::Split
        };
        Self { layout, cone, area: ring.area / 3.0, folds: !projectable }
    }
}

/// True where the projected fan surrounds its centre at most once. All its triangles face the direction.
fn winds_once(ring: &Ring, direction: Vec3) -> bool {
    let (x_axis, y_axis) = direction.any_orthonormal_pair();
    if ring.closed {
        // A counter-clockwise ring edge that passes the positive x axis begins below and ends on or above it.
        let below = |spoke: &Vec3| spoke.dot(y_axis) < 0.0;
        let mut was_below = below(&ring.spokes[0]);
        let mut passes = 0;
        for is_below in ring.spokes[1..].iter().map(below) {
            passes += u32::from(was_below & !is_below);
            was_below = is_below;
        }
        return passes <= 1;
    }
    let flat = |v: &Vec3| Vec2::new(v.dot(x_axis), v.dot(y_axis));
    let total: f32 = ring.spokes.windows(2).map(|pair| flat(&pair[0]).angle_to(flat(&pair[1])).abs()).sum();
    total < std::f32::consts::TAU
}
