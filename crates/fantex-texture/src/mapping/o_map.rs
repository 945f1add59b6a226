//! O-maps: which point of the intermediate surface belongs to a point of the object.
//!
//! The four of Bier and Sloan, "Two-part texture mappings", 1986, seen from the object: a ray starts there, and where it leaves
//! the intermediate surface, that surface's coordinates are the texture's.
//!
//! ```text
//!   reflection        object normal      centroid           normal of the intermediate surface
//!   ---x------        ------x----        ----x------        ------x-----
//!     /  eye               /                /                     |
//!    /  /                 / n              /                      |
//!   p--'                 p                p                       p
//!                                        /
//!                                       c
//! ```

use glam::{Vec2, Vec3};

use super::{SMap, SurfacePoint};
use crate::{Allowed, InvalidOption, ShadingPoint, UvPoint};

/// How a point of the object is joined to the intermediate surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum OMap {
    /// Along the view ray, reflected. Without an eye, as if it looked along the normal.
    Reflection,
    /// Along the object's normal.
    ObjectNormal,
    /// From the centroid through the point.
    Centroid {
        /// The centroid, object space.
        center: Vec3,
    },
    /// Against the intermediate surface's normal, which runs through the point.
    #[default]
    SurfaceNormal,
}

/// An S-map and an O-map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoPartMapping {
    /// From the intermediate surface to the texture.
    pub s_map: SMap,
    /// From the object to the intermediate surface.
    pub o_map: OMap,
}

/// How far the hit point is followed for its derivative: this share of the surface's size (or of a radian), so that rounding
/// and curvature both cost about 1e-4 of the derivative.
const STEP: f32 = 5e-3;

/// No derivative of a coordinate is longer: beyond, any filter gives the mean of the whole image.
const LONGEST: f32 = 1e4;

impl TwoPartMapping {
    /// Whether all numbers are in range (those of the S-map are).
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        match self.o_map {
            OMap::Centroid { center } => {
                Allowed::Finite.check("a two-part mapping", "the centroid", &center.to_array())
            }
            OMap::Reflection | OMap::ObjectNormal | OMap::SurfaceNormal => Ok(()),
        }
    }

    /// Whether the coordinates depend on the eye.
    pub fn is_view_dependent(&self) -> bool {
        self.o_map == OMap::Reflection
    }

    /// The coordinates of a point, with their change along the footprint's edges.
    pub fn coordinates(&self, at: &ShadingPoint<'_>) -> UvPoint {
        let shape = self.s_map.shape();
        let (point, steps) = match self.o_map {
            // Along its normal, a surface's coordinates stay the same: they are those of the point itself.
            OMap::SurfaceNormal => {
                let position = self.s_map.local_point(at.position);
                let steps = at.position_steps.map(|step| self.s_map.local_direction(step));
                (SurfacePoint { position, normal: shape.foot(position).normal }, steps)
            }
            _ => (self.hit(at.position, at.normal, at.to_eye), [0, 1].map(|edge| self.hit_step(at, edge))),
        };
        let mapping = shape.mapping();
        let uv = mapping.uv(point.position, point.normal);
        let steps = mapping.uv_footprint(point.position, point.normal, steps[0], steps[1]);
        UvPoint { uv, steps: steps.map(bounded) }
    }

    /// Where the ray reaches the intermediate surface, in its own space. If it does not, the nearest point of the surface.
    fn hit(&self, p: Vec3, n: Vec3, to_eye: Option<Vec3>) -> SurfacePoint {
        let shape = self.s_map.shape();
        let local = self.s_map.local_point(p);
        let (origin, direction) = match self.o_map {
            OMap::SurfaceNormal => return shape.foot(local),
            OMap::ObjectNormal => (local, n),
            OMap::Centroid { center } => (self.s_map.local_point(center), p - center),
            OMap::Reflection => (local, reflected(to_eye.unwrap_or(n), n)),
        };
        let ray_end = shape.leave(origin, self.s_map.local_direction(direction));
        ray_end.unwrap_or_else(|| shape.foot(local))
    }

    /// The change of the hit point along an edge of the footprint: a central difference of positions, which (unlike
    /// coordinates) have no seam.
    fn hit_step(&self, at: &ShadingPoint<'_>, edge: usize) -> Vec3 {
        let (dp, dn) = (at.position_steps[edge], at.normal_steps[edge]);
        let moved = self.s_map.local_direction(dp).length() / self.s_map.shape().size();
        let length = moved.max(dn.length());
        if length.is_nan() || length <= 0.0 {
            return Vec3::ZERO;
        }
        let share = STEP / length;
        let beside = |side: f32| {
            let shift = 0.5 * side * share;
            let n = (at.normal + dn * shift).try_normalize().unwrap_or(at.normal);
            self.hit(at.position + dp * shift, n, at.to_eye).position
        };
        (beside(1.0) - beside(-1.0)) / share
    }
}

/// The direction into which a mirror with normal `n` sends the view ray.
pub(crate) fn reflected(to_eye: Vec3, n: Vec3) -> Vec3 {
    2.0 * n.dot(to_eye) * n - to_eye
}

fn bounded(change: Vec2) -> Vec2 {
    if change.is_nan() {
        Vec2::splat(LONGEST)
    } else {
        change.clamp(Vec2::splat(-LONGEST), Vec2::splat(LONGEST))
    }
}
