//! Lays a group flat: direction, rotation, bounding rectangle, and whether that is valid.

use std::ops::{Add, Mul};
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use fantex_mesh::FanCorner;
use glam::{Vec2, Vec3};

use crate::Frame;
use crate::cone::{Cone, narrowest_cone};
use crate::cost::{self, Distortion, Region};
use crate::crossings::{Segment, any_crossing};
use crate::fan_shape::{Layout, opens, unfold};
use crate::injective::{OverlapFinder, Wedge};
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::surface::Surface;
use crate::unroll::{FlatCorners, Lying, Unroller};

/// A finished group, before its tile is sized. `min` and `region` are mesh units along the frame's axes, relative to the
/// frame's origin.
#[derive(Clone, Debug)]
pub(crate) struct Laid {
    pub(crate) frame: Frame,
    pub(crate) min: Vec2,
    pub(crate) region: Region,
    /// Texels per mesh unit along the frame's axes, before a total is met.
    pub(crate) density: Vec2,
    /// The first of its fans.
    pub(crate) fan: u32,
    /// Number of its fans.
    pub(crate) fans: u32,
    pub(crate) layout: Layout,
    /// Those of an unfolded group.
    pub(crate) corners: FlatCorners,
    /// True for a single fan that no direction sees wholly from the front.
    pub(crate) folds: bool,
}

/// A group laid flat. `min` and `region` are mesh units along the frame's axes, relative to the frame's origin.
#[derive(Clone, Debug)]
pub(crate) struct Flat {
    pub(crate) frame: Frame,
    pub(crate) min: Vec2,
    pub(crate) region: Region,
    /// Smallest cosine between the direction and a triangle's normal.
    pub(crate) cos: f32,
    /// How the surface is shrunk, along the frame's axes.
    pub(crate) distortion: Distortion,
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
    unroller: Unroller,
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
        let facets = || std::iter::zip(&self.border.normals, &self.border.areas).map(|(&n, &area)| (n, area));
        let (direction, cos) = best_direction(facets(), cone, limits.facing);
        let projection = Projection::new(surface.fan_center(fans[fans.len() / 2] as usize), direction);
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
        let facets = std::iter::zip(&self.border.normals, &self.border.areas).map(|(&n, &area)| (n, area));
        let outline = self.border.outline;
        Some(enclose(
            &mut self.rectangles,
            &mut self.border.points,
            &projection,
            cos,
            limits.pad,
            outline,
            facets,
        ))
    }

    /// Projects a single fan along the direction of the least error, or along its own where an open fan would overlap itself.
    pub(crate) fn project_fan(
        &mut self,
        surface: &Surface<'_>,
        fan: usize,
        cone: Cone,
        limits: &FlatLimits,
    ) -> Flat {
        let corners = surface.fans.corners(fan);
        let facets = || corners.iter().map(|&corner| surface.fan_facet(corner));
        let (mut direction, mut cos) = best_direction(facets(), cone, 0.5 * cone.cos);
        let open = !surface.fans.is_closed(fan);
        if open {
            let triangles = || corners.iter().map(|&corner| surface.fan_triangle(corner));
            let first = triangles().take(1).map(|[center, next, _]| next - center);
            let others = triangles().map(|[center, _, previous]| previous - center);
            if !opens(first.chain(others), direction) {
                (direction, cos) = (cone.axis, cone.cos);
            }
        }
        let projection = Projection::new(surface.fan_center(fan), direction);
        self.points.clear();
        let mut outline = 0.0;
        for (i, &corner) in corners.iter().enumerate() {
            let triangle = surface.fan_triangle(corner).map(|p| projection.flat(p));
            let points = &mut self.points;
            let inside = [true, false, false];
            outline_points(triangle, inside, limits.delta, open, |p| points.push(p));
            let planar = triangle.map(|p| p.truncate());
            outline += outline_length(planar, inside);
            if open && i == 0 {
                // Half of the first and half of the last edge.
                outline += planar[0].distance(planar[1]);
            }
        }
        enclose(&mut self.rectangles, &mut self.points, &projection, cos, limits.pad, outline, facets())
    }

    /// Unfolds a single fan about its centre; `None` where that is impossible.
    pub(crate) fn unfold(
        &mut self,
        surface: &Surface<'_>,
        fan: u32,
        cone: Cone,
        limits: &FlatLimits,
    ) -> Option<(Flat, FlatCorners)> {
        let (rectangle, corners) =
            unfolded_rectangle(surface, fan as usize, limits.delta, limits.pad, &mut self.rectangles)?;
        let mut distortion = Distortion::default();
        let (mut area, mut outline) = (0.0, 0.0);
        for (i, (corner, (_, by_slot))) in surface.fans.corners(fan as usize).iter().zip(&corners).enumerate()
        {
            let [a, b, c] = surface.fan_triangle(*corner);
            let [u, v, w] = corner.slots().map(|slot| by_slot[slot]);
            if i == 0 && !surface.fans.is_closed(fan as usize) {
                // Half of the first and half of the last edge.
                outline += u.distance(v);
            }
            area += (v - u).perp_dot(w - u).abs() / 6.0;
            outline += outline_length([u, v, w], [true, false, false]);
            distortion.add_edges([b - a, c - a], [v - u, w - u], surface.fan_facet(*corner).1 / 3.0);
        }
        let origin = surface.fan_center(fan as usize);
        let frame = Frame { origin, direction: cone.axis, x_axis: cone.axis.any_orthonormal_vector() };
        let Rectangle { min, size, .. } = rectangle;
        let region = Region { size, area, outline };
        Some((Flat { frame, min, region, cos: cone.cos, distortion, outline: Box::default() }, corners))
    }

    /// Lays connected fans flat freely, from where the parts lie that they come in; `None` where that does not succeed.
    pub(crate) fn unroll(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        lying: &[Lying<'_>],
        limits: &FlatLimits,
        ratio: impl Fn(&Flat, usize) -> f32,
    ) -> Option<(Flat, FlatCorners)> {
        self.unroller.unroll(surface, fans, lying, limits, &mut self.rectangles, ratio)
    }
}

/// The group with the given outline points in its best-rotated rectangle.
fn enclose(
    rectangles: &mut RectangleFinder,
    points: &mut [Vec3],
    projection: &Projection,
    cos: f32,
    pad: f32,
    outline_length: f32,
    facets: impl Iterator<Item = (Vec3, f32)>,
) -> Flat {
    let Rectangle { x_axis, min, size } = rectangles.smallest(points, pad);
    let x_axis = (projection.x * x_axis.x + projection.y * x_axis.y).normalize();
    let frame = Frame { origin: projection.origin, direction: projection.direction, x_axis };
    let outline = rectangles.hull().iter().map(|&p| projection.spatial(p)).collect();
    let mut distortion = Distortion::default();
    let y_axis = frame.y_axis();
    let mut seen = 0.0;
    for (normal, area) in facets {
        let local = Vec3::new(normal.dot(x_axis), normal.dot(y_axis), normal.dot(frame.direction));
        distortion.add_projected(local, area / 3.0);
        seen += local.z.abs() * area / 3.0;
    }
    let region = Region { size, area: seen, outline: outline_length };
    Flat { frame, min, region, cos, distortion, outline }
}

/// The direction in which facets are seen with the least error, if all are seen with the cosine `facing`; else the axis of their
/// cone.
fn best_direction(facets: impl Iterator<Item = (Vec3, f32)> + Clone, cone: Cone, facing: f32) -> (Vec3, f32) {
    let direction = cost::direction(facets.clone(), cone.axis);
    let cos = facets.map(|(normal, _)| normal.dot(direction)).fold(1.0, f32::min);
    if cos >= facing { (direction, cos) } else { (cone.axis, cone.cos) }
}

/// A fan that is unfolded about its centre in its best-rotated rectangle. `None` where it cannot be unfolded.
pub(crate) fn unfolded_rectangle(
    surface: &Surface<'_>,
    fan: usize,
    delta: f32,
    pad: f32,
    rectangles: &mut RectangleFinder,
) -> Option<(Rectangle, FlatCorners)> {
    let planar = unfold(surface, fan)?;
    let mut points = Vec::with_capacity(6 * planar.len());
    for triangle in &planar {
        outline_points(*triangle, [true, false, false], delta, true, |p| points.push(p.extend(0.0)));
    }
    let rectangle = rectangles.smallest(&mut points, pad);
    let turned = surface.fans.corners(fan).iter().zip(planar).map(|(&corner, places)| {
        let mut by_slot = [Vec2::ZERO; 3];
        for (slot, place) in corner.slots().into_iter().zip(places) {
            by_slot[slot] = rectangle.turned(place);
        }
        (corner.corner(), by_slot)
    });
    Some((rectangle, turned.collect()))
}

// The triangles of a group and, among them, those at its border, found in one walk over its fans.
//
// All that decides about a group's tile but its normals lies at the border: the outline of its region, the edges that bound
// it, and the angles that its triangles span around the vertices there.

/// Which fans are in the group in question.
#[derive(Clone, Copy)]
pub(crate) struct Membership<'a> {
    /// Group of each fan.
    pub(crate) fan_groups: &'a [AtomicU32],
    /// The group in question.
    pub(crate) group: u32,
}

impl Membership<'_> {
    #[inline]
    fn holds(&self, fan: u32) -> bool {
        self.fan_groups[fan as usize].load(Relaxed) == self.group
    }
}

/// An orthogonal projection with some rotation: planar coordinates and the depth along the direction.
pub(crate) struct Projection {
    pub(crate) origin: Vec3,
    pub(crate) direction: Vec3,
    pub(crate) x: Vec3,
    pub(crate) y: Vec3,
}

impl Projection {
    pub(crate) fn new(origin: Vec3, direction: Vec3) -> Self {
        let (x, y) = direction.any_orthonormal_pair();
        Self { origin, direction, x, y }
    }

    #[inline]
    pub(crate) fn flat(&self, p: Vec3) -> Vec3 {
        let q = p - self.origin;
        Vec3::new(q.dot(self.x), q.dot(self.y), q.dot(self.direction))
    }

    pub(crate) fn spatial(&self, p: Vec3) -> Vec3 {
        self.origin + self.x * p.x + self.y * p.y + self.direction * p.z
    }
}

/// A triangle at the border of the group, as one of its corners in the group sees it.
#[derive(Clone, Copy)]
struct BorderTriangle {
    corner: FanCorner,
    /// Which of the corners are in the group, in the order of [`FanCorner::slots`]; the first is.
    inside: [bool; 3],
    /// False where an earlier corner has brought the triangle already.
    first: bool,
    /// Where all outline points are wanted: see [`outline_points`].
    all: bool,
}

/// The triangles of a group. Keeps its buffers.
#[derive(Default)]
struct Border {
    /// The normals of all triangles with a corner in the group.
    normals: Vec<Vec3>,
    /// The areas of their triangles, thrice as large where all corners are in the group as where one is.
    areas: Vec<f32>,
    triangles: Vec<BorderTriangle>,
    open_fans: Vec<u32>,
    /// The outline points of the group's region, once laid flat.
    points: Vec<Vec3>,
    /// The edges that bound the group's triangles, which lie to their left, once laid flat.
    segments: Vec<Segment>,
    /// What the group's triangles span around vertices at the border, once laid flat.
    wedges: Vec<Wedge>,
    /// Length of the outline of the group's region, once laid flat.
    outline: f32,
}

impl Border {
    /// Walks over the fans of a group.
    pub(crate) fn gather(&mut self, surface: &Surface<'_>, fans: &[u32], membership: Membership<'_>) {
        self.normals.clear();
        self.areas.clear();
        self.triangles.clear();
        self.open_fans.clear();
        for &fan in fans {
            let open = !surface.fans.is_closed(fan as usize);
            if open {
                self.open_fans.push(fan);
            }
            for &corner in surface.fans.corners(fan as usize) {
                let around = surface.fans.of_triangle(corner.triangle());
                let [center, from, to] = corner.slots();
                let inside = [true, membership.holds(around[from]), membership.holds(around[to])];
                let corners_inside = 1.0 + f32::from(inside[1]) + f32::from(inside[2]);
                let first = !(inside[1] && from < center || inside[2] && to < center);
                if first {
                    let (normal, area) = surface.fan_facet(corner);
                    self.normals.push(normal);
                    self.areas.push(area * corners_inside);
                }
                let all = open || corner.reversed();
                if all || first && inside != [true; 3] {
                    self.triangles.push(BorderTriangle { corner, inside, first, all });
                }
            }
        }
    }

    /// Fills `points`, `segments` and `wedges`.
    fn lay_flat(
        &mut self,
        surface: &Surface<'_>,
        membership: Membership<'_>,
        projection: &Projection,
        delta: f32,
    ) {
        self.points.clear();
        self.segments.clear();
        self.wedges.clear();
        self.outline = 0.0;
        for &BorderTriangle { corner, inside, first, all } in &self.triangles {
            let [a, b, c] = surface.fan_triangle(corner);
            let flat = [projection.flat(a), projection.flat(b), projection.flat(c)];
            if first || all {
                let points = &mut self.points;
                outline_points(flat, inside, delta, all, |p| points.push(p));
            }
            if !first || inside == [true; 3] {
                continue;
            }
            let vertices = surface.fan_vertices(corner);
            let planar = [flat[0].truncate(), flat[1].truncate(), flat[2].truncate()];
            self.outline += outline_length(planar, inside);
            if inside == [true, false, false] {
                self.segments.push(Segment::new([vertices[1], vertices[2]], [planar[1], planar[2]]));
            }
            for k in (0..3).filter(|&k| !inside[k]) {
                self.wedges.push(Wedge::new(
                    vertices[k],
                    planar[k],
                    planar[(k + 1) % 3],
                    planar[(k + 2) % 3],
                ));
            }
        }
        self.lay_open_fans_flat(surface, membership, projection);
    }

    /// The part of the group's boundary that is the mesh's own.
    fn lay_open_fans_flat(
        &mut self,
        surface: &Surface<'_>,
        membership: Membership<'_>,
        projection: &Projection,
    ) {
        let flat = |corner: FanCorner| surface.fan_triangle(corner).map(|p| projection.flat(p).truncate());
        for &fan in &self.open_fans {
            let corners = surface.fans.corners(fan as usize);
            for &corner in corners {
                let [center, from, to] = flat(corner);
                self.wedges.push(Wedge::new(surface.fan_vertices(corner)[0], center, from, to));
            }
            let (Some(&first), Some(&last)) = (corners.first(), corners.last()) else { continue };
            let ([center, from, _], planar) = (surface.fan_vertices(first), flat(first));
            self.segments.push(Segment::new([center, from], [planar[0], planar[1]]));
            self.outline += planar[0].distance(planar[1]);
            // The fan at the other end begins with the same edge; if it is in the group, it gives it.
            let at_end = surface.fans.of_triangle(last.triangle())[last.slots()[2]];
            let begins_here =
                |c: &FanCorner| c.triangle() == last.triangle() && c.slots()[1] == last.slots()[0];
            let given = membership.holds(at_end)
                && surface.fans.corners(at_end as usize).first().is_some_and(begins_here);
            if !given {
                let ([center, _, to], planar) = (surface.fan_vertices(last), flat(last));
                self.segments.push(Segment::new([to, center], [planar[2], planar[0]]));
            }
        }
    }
}

/// The length of a region's outline in one triangle, for a narrow band. `inside` tells which corners are in the group.
pub(crate) fn outline_length(corners: [Vec2; 3], inside: [bool; 3]) -> f32 {
    // From the middle of each edge that leaves the group to the middle of the triangle.
    let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
    let leaves = |&k: &usize| inside[k] != inside[(k + 1) % 3];
    (0..3).filter(leaves).map(|k| middle.distance(0.5 * (corners[k] + corners[(k + 1) % 3]))).sum()
}

// The corner points of the region that a group is responsible for.
//
// ```text
//            c                 corner c in the group, j and k not: the region in this triangle is c e_j m e_k with
//           / \                  e_j = (1-d)/2 c + (1+d)/2 j
//        e_j   e_k               m   = (1-2d)/3 c + (1+d)/3 (j + k)
//         / \m/ \              corners j and k in the group, c not: everything below the line through the points
//        j ----- k               (1-d)/2 j + (1+d)/2 c  and  (1-d)/2 k + (1+d)/2 c
// ```

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
