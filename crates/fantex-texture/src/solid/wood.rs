//! Wood: annual rings about a trunk, after the classic recipe `grain = round(radius) mod period`.

use std::f32::consts::TAU;

use glam::{IVec3, Quat, Vec3};

use super::{Solid, SolidPoint, opaque};
use crate::noise::{Fractal, Noise, band_limit, smoothstep};

/// A trunk along y, with its irregularities as separate steps; each is off at 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wood {
    /// Width of an annual ring.
    pub period: f32,
    /// How far the rings' centres wander from the axis, per unit of radius: outer rings lie off centre.
    pub eccentricity: f32,
    /// Amplitude of lobes that wind round the trunk.
    pub twist: f32,
    /// Angle between the trunk and the y axis, in radians.
    pub tilt: f32,
    /// Amplitude of the irregular waves of the rings.
    pub wobble: f32,
    /// Strength of the fibres and pores.
    pub grain: f32,
    /// Colour of the wood grown in spring (linear RGB).
    pub early: Vec3,
    /// Colour of the wood grown in late summer.
    pub late: Vec3,
    noise: Noise,
}

/// Mean of [`ring_profile`] over a period.
const RING_MEAN: f32 = 0.275;

/// Share of late wood over one ring: grows slowly, ends sharply.
fn ring_profile(phase: f32) -> f32 {
    smoothstep(0.4, 0.95, phase) * (1.0 - smoothstep(0.9, 1.0, phase)).max(0.0)
}

impl Wood {
    /// A board of a common light wood.
    pub fn new(seed: u32) -> Self {
        Self {
            period: 0.085,
            eccentricity: 0.25,
            twist: 0.012,
            tilt: 0.12,
            wobble: 0.09,
            grain: 1.0,
            early: Vec3::new(0.56, 0.31, 0.13),
            late: Vec3::new(0.20, 0.075, 0.022),
            noise: Noise::new(seed),
        }
    }

    /// The distance from the trunk's (bent) axis, in which the rings are equally wide, and the angle around it.
    fn radius_and_height(&self, p: Vec3) -> (f32, f32) {
        // The trunk's axis passes beside the model, so that boards show arcs and cathedrals, not targets only.
        let trunk = Quat::from_rotation_z(self.tilt) * Quat::from_rotation_x(0.6 * self.tilt);
        let local = trunk * (p + Vec3::new(0.35, 0.0, 0.25));
        let plain = local.x.hypot(local.z);
        let off_center = self.eccentricity * plain;
        let (x, z) = (local.x - 0.5 * off_center, local.z * (1.0 + 0.3 * self.eccentricity));
        let lobes = self.twist * (5.0 * z.atan2(x) + 0.8 * TAU * local.y).sin() * smoothstep(0.0, 0.3, plain);
        let slow = Vec3::new(local.x * 1.6, local.y * 0.5, local.z * 1.6);
        let waves = self.wobble * self.noise.fbm(slow, Fractal::octaves(3), 0.0);
        (x.hypot(z) + lobes + waves, local.y)
    }
}

impl Solid for Wood {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let (radius, height) = self.radius_and_height(at.p);
        let rings = radius / self.period;
        let ring = rings.floor();
        // The sharp end of a ring is a tenth of it.
        let left = band_limit(2.0 / self.period, at.footprint);
        // Years differ.
        let vigor = 0.55 + 0.45 * self.noise.cell_value(IVec3::new(ring as i32, 0, 0));
        let late = RING_MEAN * 0.775 + left * (vigor * ring_profile(rings - ring) - RING_MEAN * 0.775);

        let fibers_at = Vec3::new(at.p.x * 60.0, height * 3.0, at.p.z * 60.0);
        let fibers = self.noise.fbm(fibers_at, Fractal::octaves(3), 60.0 * at.footprint);
        let pores_at = Vec3::new(at.p.x * 110.0, height * 4.0, at.p.z * 110.0);
        let pores =
            smoothstep(0.25, 0.6, self.noise.fbm(pores_at, Fractal::octaves(1), 110.0 * at.footprint));
        let tone = 1.0 + 0.25 * self.noise.fbm(at.p * 1.3, Fractal::octaves(2), 1.3 * at.footprint);

        let share = (1.15 * late + self.grain * 0.16 * fibers).clamp(0.0, 1.0);
        let rgb = self.early.lerp(self.late, share) * tone * (1.0 - self.grain * 0.35 * pores);
        opaque(rgb.max(Vec3::ZERO))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ring_mean_is_that_of_the_profile() {
        let mean = (0..10_000).map(|i| ring_profile((i as f32 + 0.5) / 10_000.0)).sum::<f32>() / 10_000.0;
        assert!((mean - RING_MEAN).abs() < 0.005, "{mean}");
    }
}
