//! Clouds and smoke: fractal noise that boils, cut off below a density.

use glam::Vec3;

use super::{Solid, SolidPoint};
use crate::noise::{Fractal, FractalKind, FractalNoise, Noise, NoiseFamily, smoothstep};
use crate::{Allowed, InvalidOption};

/// White clouds before a blue sky, or smoke: the colour goes from `sky` to `cloud` with the density, which is the alpha, too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clouds {
    /// Width of the largest clouds, above 0.
    pub size: f32,
    /// Share of the sky that is covered, 0 to 1.
    pub cover: f32,
    /// How soft the borders are, above 0.
    pub softness: f32,
    /// Cells of change per second: clouds form and dissolve.
    pub speed: f32,
    /// Colour where there is no cloud (linear RGB).
    pub sky: Vec3,
    /// Colour of thick cloud.
    pub cloud: Vec3,
    /// Opacity where there is no cloud, 0 to 1.
    pub sky_alpha: f32,
    noise: FractalNoise,
    swirl: Noise,
}

impl Clouds {
    /// Fair weather.
    pub fn new(seed: u32) -> Self {
        let octaves = Fractal { octaves: 7, lacunarity: 2.03, gain: 0.52 };
        Self {
            size: 0.7,
            cover: 0.5,
            softness: 0.6,
            speed: 0.2,
            sky: Vec3::new(0.10, 0.28, 0.62),
            cloud: Vec3::new(0.92, 0.93, 0.95),
            sky_alpha: 1.0,
            noise: FractalNoise::new(NoiseFamily::Simplex, FractalKind::Fbm, octaves, seed),
            swirl: Noise::new(seed ^ 0x68bc_21eb),
        }
    }

    /// Checks the options.
    ///
    /// # Errors
    ///
    /// A number is out of its range.
    pub fn validate(&self) -> Result<(), InvalidOption> {
        Allowed::Positive.check("clouds", "size", &[self.size])?;
        Allowed::Share.check("clouds", "cover", &[self.cover])?;
        Allowed::Positive.check("clouds", "softness", &[self.softness])?;
        Allowed::Finite.check("clouds", "speed", &[self.speed])?;
        Allowed::Share.check("clouds", "opacity of the sky", &[self.sky_alpha])?;
        let colors = [self.sky.to_array(), self.cloud.to_array()];
        Allowed::NotNegative.check("clouds", "colour", colors.as_flattened())
    }

    /// Thickness of the cloud at a point, 0 to 1.
    pub fn density(&self, at: &SolidPoint) -> f32 {
        let (p, width) = (at.p / self.size, at.footprint / self.size);
        let swirl = self.swirl.fbm(p * 1.3, Fractal::octaves(2), 1.3 * width);
        let at_time = (p + 0.35 * swirl).extend(self.speed * at.time).to_array();
        // About 0.3 is the standard deviation of the sum.
        let threshold = 0.75 * (0.5 - self.cover);
        // What the footprint takes from the noise's contrast comes back as softer borders.
        let half = 0.5 * self.softness + 0.5 * width.min(1.0);
        smoothstep(threshold - half, threshold + half, self.noise.value(at_time, width))
    }
}

impl Solid for Clouds {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let density = self.density(at);
        let rgb = self.sky.lerp(self.cloud, density);
        rgb.extend(self.sky_alpha + (1.0 - self.sky_alpha) * density).to_array()
    }
}
