//! How each fan is laid flat: projected along its best direction, unfolded, or split.

use glam::{Vec2, Vec3};

use crate::cone::{Cone, narrowest_cone};
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
    /// True where no direction sees the whole fan from the front.
    pub(crate) folds: bool,
}

/// Reused buffers for `FanShape::of`.
#[derive(Default)]
pub(crate) struct ShapeFinder {
    normals: Vec<Vec3>,
}

impl ShapeFinder {
    pub(crate) fn shape(&mut self, surface: &Surface<'_>, fan: usize) -> FanShape {
        let corners = surface.fans.corners(fan);
        self.normals.clear();
        self.normals.extend(corners.iter().map(|&c| surface.fan_normal(c)));
        let cone = narrowest_cone(&self.normals);
        let projectable = cone.cos > FOLDED_BELOW && winds_once(surface, fan, cone.axis);
        let layout = if projectable && cone.cos >= UNFOLD_BELOW {
            Layout::Projected
        } else if unfold(surface, fan).is_some() {
            Layout::Unfolded
        } else if projectable {
            Layout::Projected
        } else {
            Layout::Split
        };
        FanShape { layout, cone, folds: !projectable }
    }
}

/// True where the projected fan surrounds its centre at most once. All its triangles face the direction.
fn winds_once(surface: &Surface<'_>, fan: usize, direction: Vec3) -> bool {
    let (x_axis, y_axis) = direction.any_orthonormal_pair();
    let flat = |v: Vec3| Vec2::new(v.dot(x_axis), v.dot(y_axis));
    let corners = surface.fans.corners(fan);
    if surface.fans.is_closed(fan) {
        // A counter-clockwise ring edge that passes the positive x axis begins below and ends on or above it.
        let passes = corners.iter().filter(|&&c| {
            let [center, from, to] = surface.fan_triangle(c);
            flat(from - center).y < 0.0 && flat(to - center).y >= 0.0
        });
        return passes.count() <= 1;
    }
    let total: f32 = corners
        .iter()
        .map(|&c| {
            let [center, from, to] = surface.fan_triangle(c);
            flat(from - center).angle_to(flat(to - center)).abs()
        })
        .sum();
    total < std::f32::consts::TAU
}
