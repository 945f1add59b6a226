//! The mantle of an upright cylinder.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::{Bounds, Mapping, SurfacePoint, sphere::azimuth};
use crate::{Allowed, InvalidOption};

/// `(u, v) = (a r (theta - theta_0), d (h - h_0))`, theta about the y axis through `center`, seen from outside: u grows to
/// the right, v downwards (so `d` is negative). The seam is on the far side (-z) of a fitted cylinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CylinderMap {
    /// A point of the axis.
    pub center: Vec3,
    /// Radius `r`: with `a`, it says how many images go round.
    pub radius: f32,
    /// `a`, images per unit of length round the mantle.
    pub around: f32,
    /// `theta_0`, in radians: where `u` is 0.
    pub angle: f32,
    /// `d`, images per unit of height.
    pub along: f32,
    /// `h_0`, the height where `v` is 0.
    pub height: f32,
    /// The lowest and the highest point of the mantle. Where rays leave through the top or the bottom, its disc counts as
    /// folded up: the mantle's coordinates go on from the rim to the centre, and stay within bounds.
    pub ends: [f32; 2],
}

impl CylinderMap {
    /// The image once round and once from the top to the bottom of `bounds`; its middle faces +z.
    pub fn fit(bounds: Bounds) -> Self {
        let extent = bounds.extent();
        let radius = 0.5 * extent.x.max(extent.z);
        Self {
            center: bounds.center(),
            radius,
            around: 1.0 / (TAU * radius),
            angle: -0.5 * TAU,
            along: -1.0 / extent.y,
            height: bounds.max.y,
            ends: [bounds.max.y - extent.y, bounds.max.y],
        }
    }

    /// The point of the mantle with these coordinates.
    pub fn point(&self, uv: Vec2) -> Vec3 {
        let theta = uv.x / (self.around * self.radius) + self.angle;
        let (sin, cos) = theta.sin_cos();
        Vec3::new(
            self.center.x + self.radius * sin,
            uv.y / self.along + self.height,
            self.center.z + self.radius * cos,
        )
    }

    /// Where the line leaves the mantle, or the top or bottom, folded up. For lines that pass by, the point of the mantle that
    /// is nearest to the line's closest point.
    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<SurfacePoint> {
        let local = origin - self.center;
        let a = direction.x * direction.x + direction.z * direction.z;
        let b = local.x * direction.x + local.z * direction.z;
        let c = local.x * local.x + local.z * local.z - self.radius * self.radius;
        let through_mantle = if a > 0.0 { (-b + (b * b - a * c).max(0.0).sqrt()) / a } else { f32::INFINITY };
        let end = if direction.y >= 0.0 { self.ends[1] } else { self.ends[0] };
        let through_end = if direction.y == 0.0 { f32::INFINITY } else { (end - origin.y) / direction.y };
        let along = through_mantle.min(through_end);
        if !along.is_finite() {
            return None;
        }
        let mut leaves = origin + direction * along;
        if through_end < through_mantle {
            let to_rim = self.radius - (leaves.x - self.center.x).hypot(leaves.z - self.center.z);
            leaves.y = end + to_rim.max(0.0).copysign(direction.y);
        }
        Some(self.foot(leaves))
    }

    /// The point of the endless mantle at the same azimuth and height.
    pub(super) fn foot(&self, p: Vec3) -> SurfacePoint {
        let local = p - self.center;
        let normal = Vec3::new(local.x, 0.0, local.z).normalize_or(Vec3::Z);
        let axis = Vec3::new(self.center.x, p.y, self.center.z);
        SurfacePoint { position: axis + normal * self.radius, normal }
    }

    pub(super) fn check(&self) -> Result<(), InvalidOption> {
        const OWNER: &str = "a cylinder mapping";
        Allowed::Finite.check(OWNER, "the centre", &self.center.to_array())?;
        Allowed::Positive.check(OWNER, "the radius", &[self.radius])?;
        Allowed::NotZero.check(OWNER, "'around' (images per unit of length)", &[self.around])?;
        Allowed::Finite.check(OWNER, "the angle", &[self.angle])?;
        Allowed::NotZero.check(OWNER, "'along' (images per unit of height)", &[self.along])?;
        Allowed::Finite.check(OWNER, "the height", &[self.height])?;
        Allowed::Finite.check(OWNER, "the ends", &self.ends)?;
        Allowed::NotNegative.check(OWNER, "the height between the ends", &[self.ends[1] - self.ends[0]])
    }
}

impl Mapping for CylinderMap {
    fn uv(&self, p: Vec3, _n: Vec3) -> Vec2 {
        let local = p - self.center;
        let turn = (azimuth(local) - self.angle).rem_euclid(TAU);
        Vec2::new(self.around * self.radius * turn, self.along * (p.y - self.height))
    }

    fn uv_footprint(&self, p: Vec3, _n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let local = p - self.center;
        // d theta = (z dx - x dz) / (x^2 + z^2); on the axis itself every direction counts as one full image.
        let squared = local.x * local.x + local.z * local.z;
        [dp_dx, dp_dy].map(|direction| {
            let turn = local.z * direction.x - local.x * direction.z;
            let theta = if squared > 0.0 { turn / squared } else { 0.0 };
            let theta = theta.clamp(-TAU, TAU);
            Vec2::new(self.around * self.radius * theta, self.along * direction.y)
        })
    }
}
