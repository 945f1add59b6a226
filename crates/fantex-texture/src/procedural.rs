//! Noise and waves as textures of object space.

use glam::{Vec3, Vec4};

use crate::noise::{Fractal, FractalNoise, Noise, Waves};
use crate::{Allowed, InvalidOption, ShadingPoint, Texture};

/// A fractal noise as a texture: a number, as grey.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseTexture {
    /// The noise, in cells.
    pub noise: FractalNoise,
    /// Width of a cell of the first octave, in units of the point, above 0.
    pub cell: f32,
    /// How far the point is moved by another noise before, in cells: bands and flows (I. Quilez, "Domain warping", 2002).
    pub warp: f32,
    /// The noise that moves the point.
    pub warp_noise: Noise,
    /// Factor of the noise.
    pub amplitude: f32,
    /// Added after that.
    pub offset: f32,
    /// Cells per second along a fourth axis of the noise; 0 for noise of space alone.
    pub speed: f32,
}

impl NoiseTexture {
    /// A noise between about 0 and 1 with cells of this width.
    pub fn new(noise: FractalNoise, cell: f32) -> Self {
        let (warp, warp_noise) = (0.0, Noise::new(0x1b87_3593));
        Self { noise, cell, warp, warp_noise, amplitude: 0.5, offset: 0.5, speed: 0.0 }
    }

    /// Checks the options.
    ///
    /// # Errors
    ///
    /// A number is out of its range.
    pub fn validate(&self) -> Result<(), InvalidOption> {
        Allowed::Positive.check("a noise", "cell", &[self.cell])?;
        Allowed::Finite.check("a noise", "warp", &[self.warp])?;
        Allowed::Finite.check("a noise", "amplitude", &[self.amplitude])?;
        Allowed::Finite.check("a noise", "offset", &[self.offset])?;
        Allowed::Finite.check("a noise", "speed", &[self.speed])
    }

    /// The value at a point, averaged over a width, at a time in seconds.
    pub fn value(&self, p: Vec3, width: f32, time: f32) -> f32 {
        let (mut at, mut width) = (p / self.cell, width / self.cell);
        if self.warp != 0.0 {
            let pull = |shift: f32| self.warp_noise.fbm(at + shift, Fractal::octaves(2), width);
            at += self.warp * Vec3::new(pull(0.0), pull(31.4), pull(-27.2));
            // Where the warp stretches space, details become narrower.
            width *= 1.0 + self.warp.abs();
        }
        let value = match self.speed {
            0.0 => self.noise.value(at.to_array(), width),
            speed => self.noise.value(at.extend(speed * time).to_array(), width),
        };
        self.offset + self.amplitude * value
    }
}

impl Texture for NoiseTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        Vec3::splat(self.value(at.position, at.width(), at.time)).extend(1.0)
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        if self.warp != 0.0 || self.speed != 0.0 {
            at.iter().zip(values).for_each(|(at, value)| *value = self.evaluate(at));
            return;
        }
        let points: Vec<Vec3> = at.iter().map(|at| at.position / self.cell).collect();
        let widths: Vec<f32> = at.iter().map(|at| at.width() / self.cell).collect();
        let mut sums = vec![0.0; at.len()];
        self.noise.values(&points, &widths, &mut sums);
        for (value, sum) in values.iter_mut().zip(sums) {
            *value = Vec3::splat(self.offset + self.amplitude * sum).extend(1.0);
        }
    }

    fn is_animated(&self) -> bool {
        self.speed != 0.0
    }
}

/// A sum of sine waves as a texture: a number, as grey.
#[derive(Clone, Debug, PartialEq)]
pub struct WavesTexture {
    /// The waves.
    pub waves: Waves,
    /// Added to their sum.
    pub offset: f32,
}

impl Texture for WavesTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let sum = self.waves.mean(at.position, at.position_steps, at.time);
        Vec3::splat(self.offset + sum).extend(1.0)
    }

    fn is_animated(&self) -> bool {
        self.waves.0.iter().any(|wave| wave.angular_speed != 0.0)
    }
}
