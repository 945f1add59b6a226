//! Noise and waves as textures of object space.

use std::f32::consts::TAU;

use fantex_base::parameters;
use glam::{Vec3, Vec4};

use crate::invalid_option::check_within;
use crate::noise::{CellularMetric, Fractal, FractalKind, FractalNoise, Noise, NoiseFamily};
use crate::{Allowed, Dependence, List3, ShadingPoint, Texture};

parameters! {
    /// Noise: a number, as grey.
    #[derive(Copy)]
    pub struct NoiseOptions {
        /// The kind of noise.
        pub family: NoiseFamily = NoiseFamily::Perlin,
        /// How distances of cellular noise are measured.
        pub metric: CellularMetric = CellularMetric::Euclidean,
        /// How octaves are summed.
        pub fractal: FractalKind = FractalKind::Fbm,
        /// Number of octaves.
        #[schemars(range(min = 1, max = 24))]
        pub octaves: u32 = 5,
        /// Ratio of the frequencies of two octaves.
        #[schemars(range(min = 1.01, max = 16))]
        pub lacunarity: f32 = 2.03,
        /// Ratio of the amplitudes of two octaves.
        #[schemars(range(min = 0, max = 1))]
        pub gain: f32 = 0.5,
        /// Width of a cell of the first octave, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub cell: f32 = 0.25,
        /// How far the point is moved by another noise first, in cells: bands and flows.
        #[schemars(range(min = 0, max = 100))]
        pub warp: f32 = 0.0,
        /// Factor of the noise.
        pub amplitude: f32 = 0.5,
        /// Added after that.
        pub offset: f32 = 0.5,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// How far a fourth coordinate of the noise grows each second, in cells: noise that boils.
        pub evolve: f32 = 0.0,
    }
}

/// A fractal noise as a texture: a number, as grey. Warps follow I. Quilez, "Domain warping", 2002.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseTexture {
    options: NoiseOptions,
    /// In cells.
    noise: FractalNoise,
    /// Moves the point.
    warp_noise: Noise,
}

impl NoiseOptions {
    /// Checks the options.
    ///
    /// # Errors
    /// A number is out of its range.
    pub fn check(&self) -> fantex_base::Result<()> {
        check_within("a noise", "octaves", self.octaves as f32, 1.0..=24.0)?;
        check_within("a noise", "lacunarity", self.lacunarity, 1.01..=16.0)?;
        check_within("a noise", "gain", self.gain, 0.0..=1.0)?;
        Allowed::Positive.check("a noise", "cell", &[self.cell])?;
        Allowed::Finite.check("a noise", "warp", &[self.warp])?;
        Allowed::Finite.check("a noise", "amplitude", &[self.amplitude])?;
        Allowed::Finite.check("a noise", "offset", &[self.offset])?;
        Allowed::Finite.check("a noise", "evolve", &[self.evolve])
    }
}

impl NoiseTexture {
    /// The texture that the options describe.
    pub fn new(options: NoiseOptions) -> Self {
        let NoiseOptions { family, metric, fractal, octaves, lacunarity, gain, seed, .. } = options;
        let octaves = Fractal { octaves, lacunarity, gain };
        let noise = FractalNoise::with_metric(family, metric, fractal, octaves, seed);
        Self { options, noise, warp_noise: Noise::new(seed ^ 0x1b87_3593) }
    }

    fn values(&self, at: &[ShadingPoint<'_>]) -> Vec<f32> {
        let NoiseOptions { cell, warp, amplitude, offset, evolve, .. } = self.options;
        let mut points: Vec<Vec3> = at.iter().map(|at| at.position / cell).collect();
        let mut widths: Vec<f32> = at.iter().map(|at| at.width() / cell).collect();
        let mut values = vec![0.0; at.len()];
        if warp != 0.0 {
            let pulls = [0.0, 31.4, -27.2].map(|shift| {
                let shifted: Vec<Vec3> = points.iter().map(|&p| p + shift).collect();
                self.warp_noise.fbm_all(&shifted, Fractal::octaves(2), &widths, &mut values);
                values.clone()
            });
            for (i, (p, width)) in points.iter_mut().zip(&mut widths).enumerate() {
                *p += warp * Vec3::new(pulls[0][i], pulls[1][i], pulls[2][i]);
                // Where the warp stretches space, details become narrower.
                *width *= 1.0 + warp.abs();
            }
        }
        if evolve == 0.0 {
            self.noise.values(&points, &widths, &mut values);
        } else {
            let in_time = |(p, at): (&Vec3, &ShadingPoint<'_>)| p.extend(evolve * at.time);
            let points: Vec<Vec4> = points.iter().zip(at).map(in_time).collect();
            self.noise.values_4d(&points, &widths, &mut values);
        }
        values.iter_mut().for_each(|value| *value = offset + amplitude * *value);
        values
    }
}

impl Texture for NoiseTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        Vec3::splat(self.values(std::slice::from_ref(at))[0]).extend(1.0)
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        for (value, number) in values.iter_mut().zip(self.values(at)) {
            *value = Vec3::splat(number).extend(1.0);
        }
    }

    fn depends_on(&self, what: Dependence) -> bool {
        what == Dependence::Time && self.options.evolve != 0.0
    }
}

parameters! {
    /// Sine waves: a number, as grey.
    #[schemars(extend("required" = ["waves"]))]
    pub struct Sines {
        /// The waves.
        #[schemars(length(min = 1, max = 1024))]
        pub waves: Vec<Wave> = Vec::new(),
        /// Added to their sum.
        pub offset: f32 = 0.5,
    }

    /// A sine wave.
    #[derive(Copy)]
    pub struct Wave {
        /// Along which it changes, of any length but zero.
        #[serde(with = "List3")]
        pub direction: Vec3 = Vec3::X,
        /// Its length, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub length: f32 = 0.5,
        /// Its amplitude.
        pub amplitude: f32 = 0.5,
        /// Its phase at the origin, in degrees.
        pub phase: f64 = 0.0,
        /// Waves that pass each second.
        pub speed: f32 = 0.0,
    }
}

impl Wave {
    /// The mean over the parallelogram around `p` with the edges `steps` (zero for the value at the point). Exact: the mean of a
    /// sine over an edge is its value in the middle times `sin(x)/x` of half the phase along the edge. The wave moves along its
    /// direction, so its phase falls with time.
    fn mean(&self, p: Vec3, steps: [Vec3; 2], time: f32) -> f32 {
        let wave_vector = self.direction.normalize() * (TAU / self.length);
        let left: f32 = steps.iter().map(|step| sinc(0.5 * wave_vector.dot(*step))).product();
        let phase = wave_vector.dot(p) + self.phase.to_radians() as f32 - TAU * self.speed * time;
        left * self.amplitude * phase.sin()
    }
}

impl Texture for Sines {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let sum: f32 = self.waves.iter().map(|wave| wave.mean(at.position, at.position_steps, at.time)).sum();
        Vec3::splat(self.offset + sum).extend(1.0)
    }

    fn depends_on(&self, what: Dependence) -> bool {
        what == Dependence::Time && self.waves.iter().any(|wave| wave.speed != 0.0)
    }
}

/// `sin(x) / x`.
fn sinc(x: f32) -> f32 {
    if x.abs() < 1e-3 { 1.0 - x * x / 6.0 } else { x.sin() / x }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers next to the ends of a range, the first and the last of which lie outside.
    fn around(schema: &schemars::Schema, name: &str) -> [f32; 4] {
        let limit = |end: &str| schema.pointer(&format!("/properties/{name}/{end}"))?.as_f64();
        let [low, high] = ["minimum", "maximum"].map(|end| limit(end).unwrap() as f32);
        match name {
            "octaves" => [low - 1.0, low, high, high + 1.0],
            _ => [low.next_down(), low, high, high.next_up()],
        }
    }

    #[test]
    fn options_are_checked_as_the_schema_has_them() {
        let schema = schemars::schema_for!(NoiseOptions);
        let default = NoiseOptions::default();
        let with = |name: &str, value: f32| match name {
            "octaves" => NoiseOptions { octaves: value as u32, ..default },
            "lacunarity" => NoiseOptions { lacunarity: value, ..default },
            _ => NoiseOptions { gain: value, ..default },
        };
        for name in ["octaves", "lacunarity", "gain"] {
            let [below, low, high, above] = around(&schema, name);
            for value in [low, high] {
                with(name, value).check().unwrap();
            }
            for value in [below, above] {
                let error = with(name, value).check().unwrap_err().to_string();
                let expected = format!("{name} of a noise is {value}; it must be between {low} and {high}");
                assert_eq!(error, expected);
            }
        }
        assert!(with("gain", f32::NAN).check().is_err());
        let error = NoiseOptions { evolve: f32::INFINITY, ..default }.check().unwrap_err().to_string();
        assert!(error.starts_with("evolve of a noise is inf"), "{error}");
    }
}
