//! Rays against a mesh, and the point of a mesh nearest to a given one.
//!
//! The hierarchy of boxes, eight to a node (H. Ylitie, T. Karras and S. Laine, "Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs", 2017), comes from the crate `obvhs`. On 1.3 M triangles and random rays it is 1.4 times as
//! fast as the same crate's binary tree, and half its size. It is built on one thread, so that the same mesh
//! always gives the same tree. Triangles are tested by the watertight method of [`intersect`]. Everything is in mesh space.
//!
//! # Rays that start on the surface
//!
//! A point that was interpolated on a triangle lies beside its plane by a few units in the last place. A ray that starts
//! there must not see the triangle it comes from, so its origin is moved by [`SURFACE_OFFSET`] along the geometric normal
//! to the side it shall be on ([`origin_beside`]). Coordinates lie within -1..1, where single precision is exact to 2^-24:
//! the offset is 32 times that, large enough for every point and direction, and far below any detail of a mesh. Triangles
//! are not told apart by their indices, so that a ray from a point on an edge does not see the neighbour, either.

mod intersect;
mod nearest;
mod tree;

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit as TreeHit};
use rayon::prelude::*;

pub use self::nearest::NearestPoint;

use self::intersect::Shear;
use crate::Mesh;

/// How far the origin of a ray that starts on the surface is moved off it, mesh units.
pub const SURFACE_OFFSET: f32 = 1.0 / (1 << 19) as f32;

/// Boxes are this much larger than their triangles on every side, so that rounding in the test of a box never loses a
/// triangle for origins up to four units away.
const BOX_MARGIN: f32 = 1.0 / (1 << 19) as f32;

/// The tree sees directions this long. It passes over boxes that end before 1e-4 of the direction's length, which must be
/// less than the rounding of a coordinate.
const TREE_DIRECTION: f32 = 1.0 / (1 << 12) as f32;

/// Where a ray meets a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Triangle index.
    pub triangle: usize,
    /// Barycentric coordinates, not negative, of sum one.
    pub lambda: Vec3,
    /// From the origin, in units of the direction's length.
    pub distance: f32,
    /// True where the ray meets the front of the triangle, whose corners run counter-clockwise there.
    pub front: bool,
}

/// A tree of boxes around the triangles of a mesh, for rays and nearest points. It keeps its own copy of the positions:
/// about 70 bytes per triangle.
pub struct TriangleBvh {
    tree: CwBvh,
    /// Corners of the triangles, in the tree's order.
    corners: Vec<[Vec3; 3]>,
    /// Index of each of them in the mesh.
    triangles: Vec<u32>,
}

impl std::fmt::Debug for TriangleBvh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TriangleBvh").field("triangles", &self.triangles.len()).finish_non_exhaustive()
    }
}

impl TriangleBvh {
    /// Builds the tree of a mesh, on one thread (about two seconds for a million triangles).
    pub fn new(mesh: &Mesh) -> Self {
        let margin = Vec3A::splat(BOX_MARGIN);
        let padded = |t: usize| {
            let [a, b, c] = mesh.triangle_positions(t).map(Vec3A::from);
            Aabb::new(a.min(b).min(c) - margin, a.max(b).max(c) + margin)
        };
        let boxes: Vec<Aabb> =
            (0..mesh.triangles.len()).into_par_iter().with_min_len(1 << 12).map(padded).collect();
        if boxes.is_empty() {
            return Self { tree: CwBvh::default(), corners: Vec::new(), triangles: Vec::new() };
        }
        let mut tree = tree::build(&boxes);
        let triangles = std::mem::take(&mut tree.primitive_indices);
        let corners = triangles.iter().map(|&t| mesh.triangle_positions(t as usize)).collect();
        Self { tree, corners, triangles }
    }

    /// The first triangle on a ray, from either side, nearer than `max_distance` (which may be infinite).
    ///
    /// Distances count in units of the direction's length. There is no hit behind the origin, and none along a direction
    /// that is zero or not finite.
    pub fn first_hit(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<RayHit> {
        self.first_hit_where(origin, direction, max_distance, |_| true)
    }

    /// As [`first_hit`](Self::first_hit), passing through where `accept` refuses the hit (through cut-outs, say). It is
    /// asked for hits in no particular order.
    pub fn first_hit_where(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        mut accept: impl FnMut(&RayHit) -> bool,
    ) -> Option<RayHit> {
        let ray = PreparedRay::new(origin, direction, max_distance)?;
        let mut nearest = None;
        let mut tree_hit = TreeHit::none();
        self.tree.ray_traverse(ray.in_tree, &mut tree_hit, |in_tree, slot| {
            match self.hit_at(&ray, slot, in_tree.tmax) {
                Some((t, hit)) if accept(&hit) => {
                    nearest = Some(hit);
                    t
                }
                _ => f32::INFINITY,
            }
        });
        nearest
    }

    /// True where a triangle lies on the ray, nearer than `max_distance`.
    pub fn is_occluded(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> bool {
        self.is_occluded_where(origin, direction, max_distance, |_| true)
    }

    /// As [`is_occluded`](Self::is_occluded), passing through where `accept` refuses the hit.
    pub fn is_occluded_where(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        mut accept: impl FnMut(&RayHit) -> bool,
    ) -> bool {
        let Some(ray) = PreparedRay::new(origin, direction, max_distance) else { return false };
        !self.tree.ray_traverse_miss(ray.in_tree, |in_tree, slot| {
            match self.hit_at(&ray, slot, in_tree.tmax) {
                Some((t, hit)) if accept(&hit) => t,
                _ => f32::INFINITY,
            }
        })
    }

    /// The point of the mesh nearest to `p`, within `max_distance` (which may be infinite).
    pub fn nearest_point(&self, p: Vec3, max_distance: f32) -> Option<NearestPoint> {
        nearest::nearest_point(&self.tree, &self.corners, &self.triangles, p, max_distance)
    }

    /// The hit on the triangle in a slot of the tree's order, nearer than `nearest`, and its distance as the tree counts.
    #[inline]
    fn hit_at(&self, ray: &PreparedRay, slot: usize, nearest: f32) -> Option<(f32, RayHit)> {
        let crossing = ray.shear.intersect(&self.corners[slot])?;
        let t = crossing.distance * ray.t_per_distance;
        (t < nearest).then(|| {
            let (triangle, lambda) = (self.triangles[slot] as usize, crossing.lambda);
            (t, RayHit { triangle, lambda, distance: crossing.distance, front: crossing.front })
        })
    }
}

/// A ray, ready for the tree and for triangles.
struct PreparedRay {
    in_tree: Ray,
    shear: Shear,
    /// The tree's direction is shorter by this power of two.
    t_per_distance: f32,
}

impl PreparedRay {
    /// `None` where there is no direction.
    fn new(origin: Vec3, direction: Vec3, max_distance: f32) -> Option<Self> {
        let longest = direction.abs().max_element();
        let usable = origin.is_finite() && direction.is_finite() && (1e-30..1e30).contains(&longest);
        if !(usable && max_distance > 0.0) {
            return None;
        }
        let t_per_distance = power_of_two_below(longest) / TREE_DIRECTION;
        // The tree takes a zero of either sign as positive, and its inverse must have the same sign.
        let shortened = direction / t_per_distance + Vec3::ZERO;
        let least = f32::EPSILON * TREE_DIRECTION;
        let inverse = shortened.map(|d| 1.0 / d.abs().max(least).copysign(d));
        let in_tree = Ray {
            origin: origin.into(),
            direction: shortened.into(),
            inv_direction: inverse.into(),
            tmin: 0.0,
            tmax: max_distance * t_per_distance,
        };
        Some(Self { in_tree, shear: Shear::new(origin, direction), t_per_distance })
    }
}

/// The largest power of two that is not above `x` (positive, normal).
fn power_of_two_below(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7f80_0000)
}

/// The origin for rays that start at a point of the surface, on the side that `side` points to: `geometric_normal` is the
/// unit normal of the triangle, either way round.
pub fn origin_beside(position: Vec3, geometric_normal: Vec3, side: Vec3) -> Vec3 {
    position + geometric_normal * SURFACE_OFFSET.copysign(geometric_normal.dot(side))
}
