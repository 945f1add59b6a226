//! Lays a group flat: direction, rotation, bounding rectangle, and whether that is valid.

use glam::{Vec2, Vec3};

use crate::Frame;
use crate::border::{Border, Membership, Projection};
use crate::cone::{Cone, narrowest_cone};
use crate::fan_shape::Layout;
use crate::injective::{OverlapFinder, any_crossing};
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::region::outline_points;
use crate::surface::Surface;
use crate::unfold::unfold;

/// A finished group, before its tile is sized. `min` and `size` are mesh units along the frame's axes, relative to the
/// frame's origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Laid {
    pub(crate) frame: Frame,
    pub(crate) min: Vec2,
    pub(crate) size: Vec2,
    /// Nominal texels per mesh unit.
    pub(crate) density: f32,
    /// The first of its fans; the only one unless it is projected.
    pub(crate) fan: u32,
    pub(crate) layout: Layout,
    /// True for a single fan that no direction sees wholly from the front.
    pub(crate) folds: bool,
}

/// A group laid flat. `min` and `size` are mesh units along the frame's axes, relative to the frame's origin.
#[derive(Clone, Debug)]
pub(crate) struct Flat {
    pub(crate) frame: Frame,
    pub(crate) min: Vec2,
    pub(crate) size: Vec2,
    /// Smallest cosine between the direction and a triangle's normal.
    pub(crate) cos: f32,
    /// Points on the convex outline of a projected group, mesh space.
    pub(crate) outline: Box<[Vec3]>,
}

/// What a group's tile is measured by.
#[derive(Clone, Copy)]
pub(crate) struct FlatLimits {
    /// Width of the blend band.
    pub(crate) delta: f32,
    /// The filter margin of both sides in mesh units, which counts when rectangles are compared.
    pub(crate) pad: f32,
    /// A projected group of several fans must keep this cosine between its direction and every triangle's normal.
    pub(crate) facing: f32,
}

/// Reused buffers.
#[derive(Default)]
pub(crate) struct Flattener {
    border: Border,
    overlaps: OverlapFinder,
    rectangles: RectangleFinder,
    points: Vec<Vec3>,
}

impl Flattener {
    /// Projects the fans of a group along their common best direction; `None` where a triangle would be too steep or the
    /// region overlap itself.
    pub(crate) fn project(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        membership: Membership<'_>,
        limits: &FlatLimits,
    ) -> Option<Flat> {
        self.border.gather(surface, fans, membership);
        let cone = narrowest_cone(&self.border.normals);
        if cone.cos < limits.facing {
            return None;
        }
        let projection = Projection::new(surface.fan_center(fans[fans.len() / 2] as usize), cone.axis);
        self.border.lay_flat(surface, membership, &projection, limits.delta);
        if self.border.points.is_empty() {
            // A closed surface in one group is steeper than any bound, so this is only ever reached by rounding.
            let centers = fans.iter().map(|&f| projection.flat(surface.fan_center(f as usize)));
            self.border.points.extend(centers);
        }
        if any_crossing(&mut self.border.segments)
            || self.overlaps.any_at_vertex(&self.border.segments, &self.border.wedges)
        {
            return None;
        }
        Some(enclose(&mut self.rectangles, &mut self.border.points, &projection, cone.cos, limits.pad))
    }

    /// Projects a single fan along its own direction.
    pub(crate) fn project_fan(
        &mut self,
        surface: &Surface<'_>,
        fan: usize,
        cone: Cone,
        limits: &FlatLimits,
    ) -> Flat {
        let projection = Projection::new(surface.fan_center(fan), cone.axis);
        let open = !surface.fans.is_closed(fan);
        self.points.clear();
        for &corner in surface.fans.corners(fan) {
            let triangle = surface.fan_triangle(corner).map(|p| projection.flat(p));
            let points = &mut self.points;
            outline_points(triangle, [true, false, false], limits.delta, open, |p| points.push(p));
        }
        enclose(&mut self.rectangles, &mut self.points, &projection, cone.cos, limits.pad)
    }

    /// Unfolds a single fan; `None` where that is impossible.
    pub(crate) fn unfold(
        &mut self,
        surface: &Surface<'_>,
        fan: u32,
        cone: Cone,
        limits: &FlatLimits,
    ) -> Option<Flat> {
        let (rectangle, _) =
            unfolded_rectangle(surface, fan as usize, limits.delta, limits.pad, &mut self.rectangles)?;
        let origin = surface.fan_center(fan as usize);
        let frame = Frame { origin, direction: cone.axis, x_axis: cone.axis.any_orthonormal_vector() };
        let Rectangle { min, size, .. } = rectangle;
        Some(Flat { frame, min, size, cos: cone.cos, outline: Box::default() })
    }
}

/// The group with the given outline points in its best-rotated rectangle.
fn enclose(
    rectangles: &mut RectangleFinder,
    points: &mut [Vec3],
    projection: &Projection,
    cos: f32,
    pad: f32,
) -> Flat {
    let Rectangle { x_axis, min, size } = rectangles.smallest(points, pad);
    let x_axis = (projection.x * x_axis.x + projection.y * x_axis.y).normalize();
    let frame = Frame { origin: projection.origin, direction: projection.direction, x_axis };
    let outline = rectangles.hull().iter().map(|&p| projection.spatial(p)).collect();
    Flat { frame, min, size, cos, outline }
}

/// Planar coordinates of an unfolded fan's triangles, see [`unfold`].
type Unfolded = Vec<[Vec2; 3]>;

/// An unfolded fan in its best-rotated rectangle; the coordinates are not rotated. `None` where it cannot be unfolded.
pub(crate) fn unfolded_rectangle(
    surface: &Surface<'_>,
    fan: usize,
    delta: f32,
    pad: f32,
    rectangles: &mut RectangleFinder,
) -> Option<(Rectangle, Unfolded)> {
    let planar = unfold(surface, fan)?;
    let mut points = Vec::with_capacity(6 * planar.len());
    for triangle in &planar {
        outline_points(*triangle, [true, false, false], delta, true, |p| points.push(p.extend(0.0)));
    }
    Some((rectangles.smallest(&mut points, pad), planar))
}

/// The rotated coordinates of an unfolded fan: for every corner at its centre the corner's index and the planar coordinates
/// of the triangle's corners.
pub(crate) fn unfolded_corners(surface: &Surface<'_>, laid: &Laid, delta: f32) -> Vec<(u32, [Vec2; 3])> {
    let (fan, pad) = (laid.fan as usize, 1.0 / laid.density.max(f32::MIN_POSITIVE));
    let Some((Rectangle { x_axis, .. }, planar)) =
        unfolded_rectangle(surface, fan, delta, pad, &mut RectangleFinder::default())
    else {
        return Vec::new();
    };
    let turned = |p: Vec2| Vec2::new(p.dot(x_axis), x_axis.perp_dot(p));
    let corners = surface.fans.corners(fan).iter().zip(planar);
    corners
        .map(|(&corner, p)| {
            let mut by_slot = [Vec2::ZERO; 3];
            for (slot, p) in corner.slots().into_iter().zip(p) {
                by_slot[slot] = turned(p);
            }
            (corner.corner(), by_slot)
        })
        .collect()
}
