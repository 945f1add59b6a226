//! The mantle of an upright cylinder.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::{Bounds, Mapping, sphere::azimuth};

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
