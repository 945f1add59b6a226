//! Marble: layers that turbulence has folded, after Perlin, "An image synthesizer", 1985.

use std::f32::consts::PI;

use glam::Vec3;

use super::{Solid, SolidPoint, opaque};
use crate::noise::{Fractal, Noise, band_limit, smoothstep};

/// Pale stone with dark veins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marble {
    /// Veins per unit of length.
    pub frequency: f32,
    /// How far turbulence displaces the layers, in veins.
    pub warp: f32,
    /// Colour of the stone (linear RGB).
    pub stone: Vec3,
    /// Colour of the clouds in the stone.
    pub cloud: Vec3,
    /// Colour of the veins.
    pub vein: Vec3,
    noise: Noise,
}

/// Mean of [`vein`] over a period.
const VEIN_MEAN: f32 = 0.0947;

/// A thin dark line in every period, with soft flanks.
fn vein(phase: f32) -> f32 {
    (1.0 - (PI * phase).sin().abs()).powi(6)
}

impl Marble {
    /// White marble with grey veins.
    pub fn new(seed: u32) -> Self {
        Self {
            frequency: 1.1,
            warp: 1.6,
            stone: Vec3::new(0.82, 0.80, 0.76),
            cloud: Vec3::new(0.52, 0.54, 0.56),
            vein: Vec3::new(0.07, 0.075, 0.085),
            noise: Noise::new(seed),
        }
    }

    /// The veins of one direction; a second set is finer and fainter.
    fn veins(&self, p: Vec3, direction: Vec3, frequency: f32, footprint: f32) -> f32 {
        let folds = self.noise.turbulence(p * frequency, Fractal::octaves(6), frequency * footprint)
            + 0.7 * self.noise.fbm(p * 0.7 * frequency, Fractal::octaves(2), 0.7 * frequency * footprint);
        let phase = direction.dot(p) * frequency + self.warp * folds;
        // A vein is a sixth of its period, and folding makes periods up to about three times narrower.
        let left = band_limit(6.0 * frequency, footprint);
        VEIN_MEAN + left * (vein(phase) - VEIN_MEAN)
    }
}

impl Solid for Marble {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let (p, footprint) = (at.p, at.footprint);
        let clouds = self.noise.fbm(p * 1.7 + 11.0, Fractal::octaves(5), 1.7 * footprint);
        let coarse = self.veins(p, Vec3::new(0.62, 0.55, 0.56), self.frequency, footprint);
        let fine = self.veins(p + 31.0, Vec3::new(-0.48, 0.77, 0.42), 2.7 * self.frequency, footprint);
        // Veins run in some places and fade out in others.
        let presence = smoothstep(-0.35, 0.4, self.noise.value(p * 1.1 - 7.0));
        let crystals = 1.0 + 0.06 * self.noise.fbm(p * 70.0, Fractal::octaves(2), 70.0 * footprint);
        let stone = self.stone.lerp(self.cloud, smoothstep(-0.25, 0.65, clouds));
        let share = (0.9 * coarse * (0.35 + 0.65 * presence) + 0.4 * fine * presence).clamp(0.0, 1.0);
        opaque((stone * crystals).lerp(self.vein, share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vein_mean_is_that_of_the_profile() {
        let mean = (0..10_000).map(|i| vein((i as f32 + 0.5) / 10_000.0)).sum::<f32>() / 10_000.0;
        assert!((mean - VEIN_MEAN).abs() < 0.003, "{mean}");
    }
}
