//! The triangles of a group and, among them, those at its border, found in one walk over its fans.
//!
//! All that decides about a group's tile but its normals lies at the border: the outline of its region, the edges that bound
//! it, and the angles that its triangles span around the vertices there.

use fantex_mesh::FanCorner;
use glam::Vec3;

use crate::injective::{Segment, Wedge};
use crate::region::outline_points;
use crate::surface::Surface;

/// Which fans are in the group in question.
#[derive(Clone, Copy)]
pub(crate) struct Membership<'a> {
    /// Group of each fan.
    pub(crate) fan_groups: &'a [u32],
    /// The group in question.
    pub(crate) group: u32,
}

impl Membership<'_> {
    #[inline]
    fn holds(&self, fan: u32) -> bool {
        self.fan_groups[fan as usize] == self.group
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
pub(crate) struct Border {
    /// The normals of all triangles with a corner in the group.
    pub(crate) normals: Vec<Vec3>,
    triangles: Vec<BorderTriangle>,
    open_fans: Vec<u32>,
    /// The outline points of the group's region, once laid flat.
    pub(crate) points: Vec<Vec3>,
    /// The edges that bound the group's triangles, which lie to their left, once laid flat.
    pub(crate) segments: Vec<Segment>,
    /// What the group's triangles span around vertices at the border, once laid flat.
    pub(crate) wedges: Vec<Wedge>,
}

impl Border {
    /// Walks over the fans of a group.
    pub(crate) fn gather(&mut self, surface: &Surface<'_>, fans: &[u32], membership: Membership<'_>) {
        self.normals.clear();
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
                let first = !(inside[1] && from < center || inside[2] && to < center);
                if first {
                    self.normals.push(surface.fan_facet(corner).0);
                }
                let all = open || corner.reversed();
                if all || first && inside != [true; 3] {
                    self.triangles.push(BorderTriangle { corner, inside, first, all });
                }
            }
        }
    }

    /// Fills `points`, `segments` and `wedges`.
    pub(crate) fn lay_flat(
        &mut self,
        surface: &Surface<'_>,
        membership: Membership<'_>,
        projection: &Projection,
        delta: f32,
    ) {
        self.points.clear();
        self.segments.clear();
        self.wedges.clear();
        for &BorderTriangle { corner, inside, first, all } in &self.triangles {
            let flat = surface.fan_triangle(corner).map(|p| projection.flat(p));
            if first || all {
                let points = &mut self.points;
                outline_points(flat, inside, delta, all, |p| points.push(p));
            }
            if !first || inside == [true; 3] {
                continue;
            }
            let vertices = surface.fan_vertices(corner);
            let planar = flat.map(|p| p.truncate());
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
