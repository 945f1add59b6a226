//! Longitude and latitude.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::{Bounds, Mapping, SurfacePoint};
use crate::{Allowed, InvalidOption};

/// Angle about the y axis, 0 at +z, growing towards +x (to the right, seen from outside), in (-pi, pi].
pub(super) fn azimuth(local: Vec3) -> f32 {
    local.x.atan2(local.z)
}

/// The point's direction from `center`: `u` = longitude / 2 pi from the far side (-z) round to the right, `v` = angle from
/// the top (+y) / pi, each times `repeat`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereMap {
    /// Centre of the sphere.
    pub center: Vec3,
    /// Radius of the sphere: of importance where rays meet it.
    pub radius: f32,
    /// Images round the equator and from pole to pole.
    pub repeat: Vec2,
}

impl SphereMap {
    /// The image once over the sphere around the centre of `bounds`; its middle faces +z.
    pub fn fit(bounds: Bounds) -> Self {
        Self { center: bounds.center(), radius: 0.5 * bounds.extent().length(), repeat: Vec2::ONE }
    }

    /// The unit vector from the centre to the points with these coordinates.
    pub fn direction(&self, uv: Vec2) -> Vec3 {
        let (sin, cos) = (TAU * uv.x / self.repeat.x - PI).sin_cos();
        let (sin_polar, cos_polar) = (PI * uv.y / self.repeat.y).sin_cos();
        Vec3::new(sin_polar * sin, cos_polar, sin_polar * cos)
    }

    /// The point of the sphere with these coordinates.
    pub fn point(&self, uv: Vec2) -> Vec3 {
        self.center + self.direction(uv) * self.radius
    }

    pub(super) fn check(&self) -> Result<(), InvalidOption> {
        const OWNER: &str = "a sphere mapping";
        Allowed::Finite.check(OWNER, "the centre", &self.center.to_array())?;
        Allowed::Positive.check(OWNER, "the radius", &[self.radius])?;
        Allowed::NotZero.check(OWNER, "the repeat", &self.repeat.to_array())
    }
}

/// Where the line leaves a sphere. For lines that pass by, the point that is nearest to the line.
pub(super) fn leave_sphere(center: Vec3, radius: f32, origin: Vec3, direction: Vec3) -> Option<SurfacePoint> {
    let direction = direction.try_normalize()?;
    let local = origin - center;
    let b = local.dot(direction);
    let c = local.length_squared() - radius * radius;
    let along = -b + (b * b - c).max(0.0).sqrt();
    Some(foot_on_sphere(center, radius, origin + direction * along))
}

/// The nearest point of a sphere; the top for the centre.
pub(super) fn foot_on_sphere(center: Vec3, radius: f32, p: Vec3) -> SurfacePoint {
    let normal = (p - center).normalize_or(Vec3::Y);
    SurfacePoint { position: center + normal * radius, normal }
}

impl Mapping for SphereMap {
    fn uv(&self, p: Vec3, _n: Vec3) -> Vec2 {
        let local = p - self.center;
        let longitude = (azimuth(local) + PI).rem_euclid(TAU) / TAU;
        // atan2 is precise near the poles, where acos is not.
        let polar = local.x.hypot(local.z).atan2(local.y) / PI;
        Vec2::new(longitude, polar) * self.repeat
    }

    fn uv_footprint(&self, p: Vec3, _n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let local = p - self.center;
        let around2 = local.x * local.x + local.z * local.z;
        let around = around2.sqrt();
        let squared = around2 + local.y * local.y;
        [dp_dx, dp_dy].map(|direction| {
            let turn = local.z * direction.x - local.x * direction.z;
            let outward = local.x * direction.x + local.z * direction.z;
            // At a pole the longitude is undefined and next to it the footprint goes all round: at most one turn.
            let longitude = if around2 > 0.0 { (turn / around2).clamp(-TAU, TAU) } else { TAU };
            let polar = match (squared > 0.0, around > 0.0) {
                (true, true) => (outward / around * local.y - direction.y * around) / squared,
                (true, false) => direction.x.hypot(direction.z) / local.y.abs(),
                _ => 0.0,
            };
            Vec2::new(longitude / TAU, polar / PI) * self.repeat
        })
    }
}
