//! Every family of noise by name, and its fractal sums.

use glam::Vec3;

use super::hash::scattered_point;
use super::{
    CellularMetric, Fractal, Noise, band_limit, cellular, gradient_noise, simplex_noise, white_noise,
};

/// A family of noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NoiseFamily {
    /// Gradients on a cubic lattice, -1 to 1.
    #[default]
    Perlin,
    /// Gradients on simplices, -1 to 1.
    Simplex,
    /// Distance to the nearest scattered point, from 0 to about 1.
    Cellular(CellularMetric),
    /// How much farther the second nearest point is than the nearest: 0 along the borders of the Voronoi cells.
    CellularBorders(CellularMetric),
    /// A random number for every Voronoi cell, -1 to 1.
    CellularIds(CellularMetric),
    /// A random number for every cubic cell, -1 to 1.
    White,
}

impl NoiseFamily {
    /// The value of one octave in 2, 3 or 4 dimensions; cells are one unit wide.
    pub fn value<const D: usize>(self, seed: u32, p: [f32; D]) -> f32 {
        match self {
            Self::Perlin => match *p.as_slice() {
                // The same pattern, by faster code.
                [x, y, z] => Noise::new(seed).value(glam::Vec3::new(x, y, z)),
                _ => gradient_noise(seed, p).0,
            },
            Self::Simplex => simplex_noise(seed, p).0,
            Self::Cellular(metric) => cellular(seed, p, metric).nearest,
            Self::CellularBorders(metric) => {
                let found = cellular(seed, p, metric);
                found.second - found.nearest
            }
            Self::CellularIds(metric) => 2.0 * cellular(seed, p, metric).id - 1.0,
            Self::White => white_noise(seed, p),
        }
    }
}

/// How octaves are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FractalKind {
    /// The first octave alone.
    Single,
    /// The sum of the octaves: fractional Brownian motion (B. Mandelbrot and J. van Ness, 1968).
    #[default]
    Fbm,
    /// The sum of their absolute values (K. Perlin, "An image synthesizer", 1985).
    Turbulence,
    /// The sum of crests `(1 - |n|)^2` where octaves pass through 0 (after F. K. Musgrave, "Texturing and modeling", 1994).
    Ridged,
}

impl FractalKind {
    fn shape(self, value: f32) -> f32 {
        match self {
            Self::Single | Self::Fbm => value,
            Self::Turbulence => value.abs(),
            Self::Ridged => (1.0 - value.abs()).powi(2),
        }
    }
}

/// A fractal sum of noise that knows its mean, and so can be averaged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FractalNoise {
    family: NoiseFamily,
    kind: FractalKind,
    octaves: Fractal,
    seed: u32,
    /// Mean of one shaped octave, measured.
    octave_mean: f32,
}

impl FractalNoise {
    /// Octaves of a family. The mean of an octave is measured at 16 384 points of space.
    pub fn new(family: NoiseFamily, kind: FractalKind, octaves: Fractal, seed: u32) -> Self {
        let octaves = if kind == FractalKind::Single { Fractal { octaves: 1, ..octaves } } else { octaves };
        const COUNT: u32 = 1 << 14;
        let sum: f64 =
            (0..COUNT).map(|i| f64::from(kind.shape(family.value(seed, scattered_point(i))))).sum();
        Self { family, kind, octaves, seed, octave_mean: (sum / f64::from(COUNT)) as f32 }
    }

    /// The mean over all of space.
    pub fn mean(&self) -> f32 {
        let Fractal { octaves, gain, .. } = self.octaves;
        self.octave_mean * (0..octaves).map(|i| gain.powi(i as i32)).sum::<f32>()
    }

    /// The sum at a point of 2, 3 or 4 dimensions, averaged over a footprint of this width (in the units of the point): octaves
    /// whose cells approach it fade to their mean.
    pub fn value<const D: usize>(&self, p: [f32; D], footprint: f32) -> f32 {
        let (mut sum, mut frequency, mut amplitude) = (0.0, 1.0, 1.0);
        for octave in 0..self.octaves.octaves {
            let left = band_limit(frequency, footprint);
            let mut value = self.octave_mean;
            if left > 0.0 {
                // Each octave has a pattern and an origin of its own.
                let seed = self.seed.wrapping_add(octave.wrapping_mul(0x632b_e5ab));
                let at = p.map(|x| x * frequency + 17.31 * octave as f32);
                value += left * (self.kind.shape(self.family.value(seed, at)) - self.octave_mean);
            }
            sum += amplitude * value;
            frequency *= self.octaves.lacunarity;
            amplitude *= self.octaves.gain;
        }
        sum
    }

    /// [`FractalNoise::value`] at many points of space, each with its footprint: the same values, for gradient noise several
    /// times as fast.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn values(&self, points: &[Vec3], footprints: &[f32], out: &mut [f32]) {
        assert!(
            points.len() == footprints.len() && points.len() == out.len(),
            "one footprint and value per point"
        );
        for ((points, footprints), out) in
            points.chunks(BLOCK).zip(footprints.chunks(BLOCK)).zip(out.chunks_mut(BLOCK))
        {
            if self.family == NoiseFamily::Perlin {
                self.gradient_sums(points, footprints, out);
            } else {
                for ((p, &footprint), out) in points.iter().zip(footprints).zip(out) {
                    *out = self.value(p.to_array(), footprint);
                }
            }
        }
    }

    /// Sums of gradient noise at a block of points, octave by octave, each step in the order of the single sum.
    fn gradient_sums(&self, points: &[Vec3], footprints: &[f32], out: &mut [f32]) {
        let (mut at, mut values) = ([Vec3::ZERO; BLOCK], [0.0; BLOCK]);
        let (at, values) = (&mut at[..points.len()], &mut values[..points.len()]);
        let narrowest = footprints.iter().copied().fold(f32::INFINITY, f32::min);
        let (mut frequency, mut amplitude) = (1.0, 1.0);
        out.fill(0.0);
        for octave in 0..self.octaves.octaves {
            if band_limit(frequency, narrowest) > 0.0 {
                let seed = self.seed.wrapping_add(octave.wrapping_mul(0x632b_e5ab));
                let origin = 17.31 * octave as f32;
                at.iter_mut().zip(points).for_each(|(at, &p)| *at = p * frequency + origin);
                Noise::new(seed).values(at, values);
            }
            for ((sum, &value), &footprint) in out.iter_mut().zip(&*values).zip(footprints) {
                let left = band_limit(frequency, footprint);
                let mut share = self.octave_mean;
                if left > 0.0 {
                    share += left * (self.kind.shape(value) - self.octave_mean);
                }
                *sum += amplitude * share;
            }
            frequency *= self.octaves.lacunarity;
            amplitude *= self.octaves.gain;
        }
    }
}

/// Points that are summed at a time.
const BLOCK: usize = 64;

#[cfg(test)]
mod tests {
    use super::super::tests_common::points;
    use super::*;

    const FAMILIES: [NoiseFamily; 6] = [
        NoiseFamily::Perlin,
        NoiseFamily::Simplex,
        NoiseFamily::Cellular(CellularMetric::Euclidean),
        NoiseFamily::CellularBorders(CellularMetric::Manhattan),
        NoiseFamily::CellularIds(CellularMetric::Chebyshev),
        NoiseFamily::White,
    ];
    const KINDS: [FractalKind; 4] =
        [FractalKind::Single, FractalKind::Fbm, FractalKind::Turbulence, FractalKind::Ridged];

    #[test]
    fn fast_and_general_gradient_noise_are_one_pattern() {
        for p in points::<3>(5000) {
            let difference = NoiseFamily::Perlin.value(7, p) - gradient_noise(7, p).0;
            assert!(difference.abs() < 1e-5, "{difference} at {p:?}");
        }
    }

    #[test]
    fn sums_have_the_mean_they_state_and_wide_footprints_leave_it() {
        for family in FAMILIES {
            for kind in KINDS {
                let noise = FractalNoise::new(family, kind, Fractal::octaves(4), 11);
                let count = 20_000;
                let mean = points::<3>(count).map(|p| f64::from(noise.value(p, 0.0))).sum::<f64>()
                    / f64::from(count);
                assert!(
                    (mean as f32 - noise.mean()).abs() < 0.02,
                    "{family:?} {kind:?}: {mean} {}",
                    noise.mean()
                );
                let calm = noise.value([0.3, 0.4, 0.5], 100.0);
                assert!((calm - noise.mean()).abs() < 1e-5, "{family:?} {kind:?}");
            }
        }
    }

    #[test]
    fn sums_at_many_points_are_those_at_single_ones() {
        let places: Vec<Vec3> = points::<3>(150).map(Vec3::from_array).collect();
        let widths: Vec<f32> = (0..places.len()).map(|i| 0.004 * i as f32).collect();
        for family in FAMILIES {
            for kind in KINDS {
                let noise = FractalNoise::new(family, kind, Fractal::octaves(5), 3);
                let mut sums = vec![f32::NAN; places.len()];
                noise.values(&places, &widths, &mut sums);
                for ((p, &width), sum) in places.iter().zip(&widths).zip(sums) {
                    assert_eq!(sum, noise.value(p.to_array(), width), "{family:?} {kind:?} at {p}");
                }
            }
        }
    }

    #[test]
    fn footprints_take_away_detail_steadily() {
        let noise = FractalNoise::new(NoiseFamily::Simplex, FractalKind::Fbm, Fractal::octaves(5), 2);
        let variance = |footprint: f32| {
            points::<4>(4000).map(|p| noise.value(p, footprint).powi(2)).sum::<f32>() / 4000.0
        };
        let steps = [0.0, 0.03, 0.1, 0.3, 0.6].map(variance);
        assert!(steps.windows(2).all(|w| w[1] <= w[0] * 1.001), "{steps:?}");
    }
}
