//! Lays a group flat: direction, rotation, bounding rectangle, and whether that is valid.

use fantex_mesh::FanCorner;
use glam::{Vec2, Vec3};

use crate::Frame;
use crate::cone::{Cone, narrowest_cone};
use crate::fan_shape::Layout;
use crate::injective::{Segment, Spoke, any_crossing, any_overlap_at_vertex};
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

/// What the groups look like while the cover is built.
pub(crate) struct Membership<'a> {
    /// Group of each fan.
    pub(crate) fan_groups: &'a [u32],
    /// The group to lay flat.
    pub(crate) group: u32,
    pub(crate) delta: f32,
    /// The filter margin of both sides in mesh units, which counts when rectangles are compared.
    pub(crate) pad: f32,
    /// A projected group of several fans must keep this cosine between its direction and every triangle's normal.
    pub(crate) facing: f32,
}

/// Reused buffers.
#[derive(Default)]
pub(crate) struct Flattener {
    normals: Vec<Vec3>,
    /// Planar coordinates and, in z, the depth along the direction.
    points: Vec<Vec3>,
    segments: Vec<Segment>,
    spokes: Vec<Spoke>,
    rectangles: RectangleFinder,
}

impl Flattener {
    /// Projects the fans of a group along their common best direction; `None` where a triangle would be too steep or the
    /// region overlap itself.
    pub(crate) fn project(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        membership: &Membership<'_>,
    ) -> Option<Flat> {
        self.normals.clear();
        for &fan in fans {
            for &corner in surface.fans.corners(fan as usize) {
                if is_first_of_group(surface, corner, membership) {
                    self.normals.push(surface.fan_facet(corner).0);
                }
            }
        }
        let cone = narrowest_cone(&self.normals);
        if cone.cos < membership.facing {
            return None;
        }
        let projection = Projection::new(surface.fan_center(fans[fans.len() / 2] as usize), cone.axis);
        self.collect_points(surface, fans, membership, &projection);
        self.collect_boundary(surface, fans, membership, &projection);
        let turn = |fan| turn_in_group(surface, fan, membership, &projection);
        if any_crossing(&mut self.segments) || any_overlap_at_vertex(&self.segments, turn, &mut self.spokes) {
            return None;
        }
        Some(self.enclose(&projection, cone.cos, membership))
    }

    /// Projects a single fan along its own direction.
    pub(crate) fn project_fan(
        &mut self,
        surface: &Surface<'_>,
        fan: usize,
        cone: Cone,
        membership: &Membership<'_>,
    ) -> Flat {
        let projection = Projection::new(surface.fan_center(fan), cone.axis);
        let open = !surface.fans.is_closed(fan);
        self.points.clear();
        for &corner in surface.fans.corners(fan) {
            let triangle = surface.fan_triangle(corner).map(|p| projection.flat(p));
            let points = &mut self.points;
            outline_points(triangle, [true, false, false], membership.delta, open, |p| points.push(p));
        }
        self.enclose(&projection, cone.cos, membership)
    }

    /// The group with the collected points in its best-rotated rectangle.
    fn enclose(&mut self, projection: &Projection, cos: f32, membership: &Membership<'_>) -> Flat {
        let Rectangle { x_axis, min, size } = self.rectangles.smallest(&mut self.points, membership.pad);
        let x_axis = (projection.x * x_axis.x + projection.y * x_axis.y).normalize();
        let frame = Frame { origin: projection.origin, direction: projection.direction, x_axis };
        let outline = self.rectangles.hull().iter().map(|&p| projection.spatial(p)).collect();
        Flat { frame, min, size, cos, outline }
    }

    /// Unfolds a single fan; `None` where that is impossible.
    pub(crate) fn unfold(
        &mut self,
        surface: &Surface<'_>,
        fan: u32,
        cone: Cone,
        membership: &Membership<'_>,
    ) -> Option<Flat> {
        let (rectangle, _) = unfolded_rectangle(
            surface,
            fan as usize,
            membership.delta,
            membership.pad,
            &mut self.rectangles,
        )?;
        let origin = surface.fan_center(fan as usize);
        let frame = Frame { origin, direction: cone.axis, x_axis: cone.axis.any_orthonormal_vector() };
        let Rectangle { min, size, .. } = rectangle;
        Some(Flat { frame, min, size, cos: cone.cos, outline: Box::default() })
    }

    /// The outline points of the group's region. Triangles that lie wholly inside and away from boundaries cannot touch the
    /// hull; they are skipped.
    fn collect_points(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        membership: &Membership<'_>,
        projection: &Projection,
    ) {
        self.points.clear();
        for &fan in fans {
            let open = !surface.fans.is_closed(fan as usize);
            for &corner in surface.fans.corners(fan as usize) {
                let inside = inside_of(surface, corner.triangle(), membership);
                let all = open || corner.reversed();
                if inside == [true; 3] && !all {
                    continue;
                }
                if all || is_first(corner, inside) {
                    let triangle =
                        surface.mesh.triangle_positions(corner.triangle()).map(|p| projection.flat(p));
                    outline_points(triangle, inside, membership.delta, all, |p| self.points.push(p));
                }
            }
        }
        if self.points.is_empty() {
            // A closed surface in one group is steeper than any bound, so this is only ever reached by rounding.
            self.points.extend(fans.iter().map(|&f| projection.flat(surface.fan_center(f as usize))));
        }
    }

    /// The edges that bound the union of the group's triangles, which lies to their left: those opposite a lone corner, and
    /// the mesh's own.
    fn collect_boundary(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        membership: &Membership<'_>,
        projection: &Projection,
    ) {
        self.segments.clear();
        for &fan in fans {
            let corners = surface.fans.corners(fan as usize);
            for &corner in corners {
                let inside = inside_of(surface, corner.triangle(), membership);
                if inside.iter().filter(|&&i| i).count() == 1 {
                    let [_, from, to] = corner.slots();
                    self.segments.push(segment(surface, corner, [from, to], projection));
                }
            }
            if !surface.fans.is_closed(fan as usize)
                && let (Some(&first), Some(&last)) = (corners.first(), corners.last())
            {
                let [center, from, _] = first.slots();
                self.segments.push(segment(surface, first, [center, from], projection));
                // The fan at the other end begins with the same edge; if it is in the group, it gives it.
                let [center, _, to] = last.slots();
                let at_end = surface.fans.of_triangle(last.triangle())[to];
                let given = membership.fan_groups[at_end as usize] == membership.group
                    && surface
                        .fans
                        .corners(at_end as usize)
                        .first()
                        .is_some_and(|c| c.triangle() == last.triangle() && c.slots()[1] == center);
                if !given {
                    self.segments.push(segment(surface, last, [to, center], projection));
                }
            }
        }
    }
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

fn segment(surface: &Surface<'_>, corner: FanCorner, slots: [usize; 2], projection: &Projection) -> Segment {
    let triangle = surface.mesh.triangles[corner.triangle()];
    let vertices = slots.map(|k| triangle[k]);
    let fans = surface.fans.of_triangle(corner.triangle());
    Segment {
        vertices,
        fans: slots.map(|k| fans[k]),
        ends: vertices.map(|v| projection.flat(surface.mesh.positions[v as usize]).truncate()),
    }
}

/// The angle in radians that the group's triangles in a fan span at its centre, projected.
fn turn_in_group(
    surface: &Surface<'_>,
    fan: u32,
    membership: &Membership<'_>,
    projection: &Projection,
) -> f32 {
    let corners = surface.fans.corners(fan as usize).iter();
    corners
        .filter(|c| inside_of(surface, c.triangle(), membership).contains(&true))
        .map(|&c| {
            let [center, from, to] = surface.fan_triangle(c).map(|p| projection.flat(p));
            (from - center).truncate().angle_to((to - center).truncate()).abs()
        })
        .sum()
}

/// Which corners of a triangle are in the group.
fn inside_of(surface: &Surface<'_>, triangle: usize, membership: &Membership<'_>) -> [bool; 3] {
    surface.fans.of_triangle(triangle).map(|f| membership.fan_groups[f as usize] == membership.group)
}

/// True for one of a triangle's corners in the group, so that each triangle is visited once.
fn is_first_of_group(surface: &Surface<'_>, corner: FanCorner, m: &Membership<'_>) -> bool {
    is_first(corner, inside_of(surface, corner.triangle(), m))
}

fn is_first(corner: FanCorner, inside: [bool; 3]) -> bool {
    !inside[..corner.corner() as usize % 3].contains(&true)
}

/// An orthogonal projection with some rotation: planar coordinates and the depth along the direction.
struct Projection {
    origin: Vec3,
    direction: Vec3,
    x: Vec3,
    y: Vec3,
}

impl Projection {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        let (x, y) = direction.any_orthonormal_pair();
        Self { origin, direction, x, y }
    }

    fn flat(&self, p: Vec3) -> Vec3 {
        let q = p - self.origin;
        Vec3::new(q.dot(self.x), q.dot(self.y), q.dot(self.direction))
    }

    fn spatial(&self, p: Vec3) -> Vec3 {
        self.origin + self.x * p.x + self.y * p.y + self.direction * p.z
    }
}
