//! Gradient noise in space and its fractal sums.
//!
//! Perlin, "Improving noise", 2002: cubic cells, twelve gradients, quintic fade. Deviation: the gradient is chosen by an
//! integer hash of the cell and a seed instead of a permutation table, so that the pattern does not repeat every 256 cells.
//!
//! The fractal sums take a footprint: the width, in the units of the point, over which the caller averages. Octaves whose
//! cells approach it fade to their mean, so a distant surface becomes calm instead of noisy.

use arrayvec::ArrayVec;
use glam::{IVec3, Vec3};

use super::lanes::{Gradients, MAX_OCTAVES, Octaves, Shape, octave_seed, octave_values};
use super::{absorb, band_limit, finish, unit};

/// A seeded pattern of gradient noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    seed: u32,
}

/// The octaves of a fractal sum: octave `i` has frequency `lacunarity^i` and amplitude `gain^i`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fractal {
    /// Number of octaves; those beyond 16 stay at their mean.
    pub octaves: u32,
    /// Ratio of the frequencies of successive octaves.
    pub lacunarity: f32,
    /// Ratio of their amplitudes.
    pub gain: f32,
}

impl Fractal {
    /// So many octaves, each with (about) twice the frequency and half the amplitude. The ratio is not quite 2, lest the
    /// zeros of all octaves coincide on the lattice.
    pub const fn octaves(octaves: u32) -> Self {
        Self { octaves, lacunarity: 2.03, gain: 0.5 }
    }
}

/// Mean of the absolute value of [`Noise::value`] over space (a test measures it).
const MEAN_ABSOLUTE: f32 = 0.2101;
/// Mean of the square of `1 - 2 |value|` over space (a test measures it).
const MEAN_RIDGE: f32 = 0.4294;

/// Fewer points than this are summed one by one, their octaves in the lanes of one vector.
const FEW: usize = 4;

/// The corners of a unit cell, x fastest.
const CORNERS: [Vec3; 8] = [
    Vec3::new(0.0, 0.0, 0.0),
    Vec3::new(1.0, 0.0, 0.0),
    Vec3::new(0.0, 1.0, 0.0),
    Vec3::new(1.0, 1.0, 0.0),
    Vec3::new(0.0, 0.0, 1.0),
    Vec3::new(1.0, 0.0, 1.0),
    Vec3::new(0.0, 1.0, 1.0),
    Vec3::new(1.0, 1.0, 1.0),
];

/// The twelve vectors from the centre of a cube to the middles of its edges.
const EDGES: [Vec3; 12] = [
    Vec3::new(1.0, 1.0, 0.0),
    Vec3::new(-1.0, 1.0, 0.0),
    Vec3::new(1.0, -1.0, 0.0),
    Vec3::new(-1.0, -1.0, 0.0),
    Vec3::new(1.0, 0.0, 1.0),
    Vec3::new(-1.0, 0.0, 1.0),
    Vec3::new(1.0, 0.0, -1.0),
    Vec3::new(-1.0, 0.0, -1.0),
    Vec3::new(0.0, 1.0, 1.0),
    Vec3::new(0.0, -1.0, 1.0),
    Vec3::new(0.0, 1.0, -1.0),
    Vec3::new(0.0, -1.0, -1.0),
];

/// The cell of a point and the point's offset inside, by truncation (a library call without SSE4.1).
fn cell_and_offset(p: Vec3) -> (IVec3, Vec3) {
    let truncated = p.as_ivec3();
    let floor = |truncated: i32, p: f32| truncated.saturating_sub(i32::from(p < truncated as f32));
    let cell = IVec3::new(floor(truncated.x, p.x), floor(truncated.y, p.y), floor(truncated.z, p.z));
    (cell, p - cell.as_vec3())
}

impl Noise {
    /// The pattern of a seed.
    pub const fn new(seed: u32) -> Self {
        Self { seed }
    }

    /// Smooth noise between about -1 and 1 with mean 0; it is 0 at every point with integer coordinates.
    pub fn value(&self, p: Vec3) -> f32 {
        let (cell, t) = cell_and_offset(p);
        let fade = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let slopes = self.corner_gradients(cell);
        let height = |corner: usize| slopes[corner].dot(t - CORNERS[corner]);
        let mix = |low: f32, high: f32, share: f32| low + share * (high - low);
        let edge = |corner: usize| mix(height(corner), height(corner + 1), fade.x);
        mix(mix(edge(0), edge(2), fade.y), mix(edge(4), edge(6), fade.y), fade.z)
    }

    /// [`Noise::value`] at every point, in vectors: the same values, several times as fast. Equal bit by bit for
    /// coordinates below 2^31 (but for the sign of a zero).
    ///
    /// # Panics
    /// If `out` and `points` differ in length.
    pub fn values(&self, points: &[Vec3], out: &mut [f32]) {
        assert_eq!(points.len(), out.len(), "one value for every point");
        self.values_of(|i| points[i], out);
    }

    /// [`Noise::values`] of points that a function gives by their numbers.
    pub(crate) fn values_of(&self, point: impl Fn(usize) -> Vec3, out: &mut [f32]) {
        // The first octave is the noise itself.
        self.sums_of(OctaveShape::PLAIN, Fractal::octaves(1), point, |_| 0.0, out);
    }

    /// The gradients at the corners of a cell, in the order of [`CORNERS`].
    fn corner_gradients(&self, cell: IVec3) -> [Vec3; 8] {
        let next = cell.wrapping_add(IVec3::ONE);
        // The hash takes one coordinate after the other, so corners share its beginning.
        let along_z = [cell.z, next.z].map(|z| absorb(self.seed, z));
        std::array::from_fn(|corner| {
            let y = if corner & 2 == 0 { cell.y } else { next.y };
            let x = if corner & 1 == 0 { cell.x } else { next.x };
            let hash = finish(absorb(absorb(along_z[corner >> 2], y), x));
            // The high half of a product maps the hash to 0..12 evenly.
            EDGES[((u64::from(hash) * 12) >> 32) as usize]
        })
    }

    /// A random number in [0,1) of a cell.
    pub(crate) fn cell_value(&self, cell: IVec3) -> f32 {
        unit(self.hash(cell))
    }

    fn hash(&self, cell: IVec3) -> u32 {
        finish(absorb(absorb(absorb(self.seed, cell.z), cell.y), cell.x))
    }

    /// Fractional Brownian motion: the sum of the octaves, mean 0.
    pub fn fbm(&self, p: Vec3, fractal: Fractal, footprint: f32) -> f32 {
        self.sum(p, fractal, footprint, OctaveShape::PLAIN)
    }

    /// [`Noise::fbm`] at many points, each with its footprint: the same values, several times as fast.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fbm_all(&self, points: &[Vec3], fractal: Fractal, footprints: &[f32], out: &mut [f32]) {
        assert_eq!(points.len(), out.len(), "one value for every point");
        assert_eq!(footprints.len(), out.len(), "one footprint for every point");
        self.sums_of(OctaveShape::PLAIN, fractal, |i| points[i], |i| footprints[i], out);
    }

    /// The sums at points that functions give by their numbers, with their footprints.
    pub(crate) fn sums_of(
        &self,
        octave: OctaveShape,
        fractal: Fractal,
        point: impl Fn(usize) -> Vec3,
        footprint: impl Fn(usize) -> f32,
        out: &mut [f32],
    ) {
        if out.len() < FEW {
            for (i, out) in out.iter_mut().enumerate() {
                *out = self.sum(point(i), fractal, footprint(i), octave);
            }
            return;
        }
        let OctaveShape { mean, shape } = octave;
        let octaves = Octaves { seed: self.seed, fractal, mean, shape, origin: seen_origin };
        Gradients::with(|known| octaves.sums(known, |i| point(i).to_array(), footprint, out));
    }

    fn sum(&self, p: Vec3, fractal: Fractal, footprint: f32, octave: OctaveShape) -> f32 {
        let OctaveShape { mean, shape } = octave;
        let octaves = octaves_at(self.seed, p, fractal, footprint);
        let (mut sum, mut amplitude) = (0.0, 1.0);
        for octave in 0..fractal.octaves {
            let value = octaves.get(octave as usize).map_or(mean, |&(value, left)| {
                if left > 0.0 { mean + left * (shape.of(value) - mean) } else { mean }
            });
            sum += amplitude * value;
            amplitude *= fractal.gain;
        }
        sum
    }
}

/// What an octave is before it is added to others, and its mean over space.
#[derive(Clone, Copy)]
pub(crate) struct OctaveShape {
    shape: Shape,
    mean: f32,
}

impl OctaveShape {
    /// Of [`Noise::fbm`].
    pub(crate) const PLAIN: Self = Self { shape: Shape::Plain, mean: 0.0 };
    /// Of turbulence: absolute values.
    pub(crate) const ABSOLUTE: Self = Self { shape: Shape::Absolute, mean: MEAN_ABSOLUTE };
    /// Of ridges: sharp crests where noise passes through 0, `(1 - 2 |noise|)^2`.
    pub(crate) const CREST: Self = Self { shape: Shape::Crest(2.0), mean: MEAN_RIDGE };
}

/// The origin of an octave that is not left at its mean.
fn seen_origin(octave: u32) -> Option<[f32; 3]> {
    (octave < MAX_OCTAVES as u32).then(|| octave_origin(octave).to_array())
}

/// Each octave has an origin of its own.
fn octave_origin(octave: u32) -> Vec3 {
    Vec3::new(17.3, 5.9, 41.7) * octave as f32
}

/// Value and remaining share ([`band_limit`]) of each octave that the footprint leaves, all in one vector.
fn octaves_at(seed: u32, p: Vec3, fractal: Fractal, footprint: f32) -> ArrayVec<(f32, f32), MAX_OCTAVES> {
    let (mut seeds, mut at) = ([0; MAX_OCTAVES], [[0.0; MAX_OCTAVES]; 3]);
    let mut result = ArrayVec::new();
    let mut frequency = 1.0;
    for octave in 0..fractal.octaves.min(MAX_OCTAVES as u32) {
        let left = band_limit(frequency, footprint);
        if left == 0.0 && fractal.lacunarity >= 1.0 {
            break;
        }
        let index = octave as usize;
        seeds[index] = octave_seed(seed, octave);
        let q = p * frequency + octave_origin(octave);
        (at[0][index], at[1][index], at[2][index]) = (q.x, q.y, q.z);
        result.push((0.0, left));
        frequency *= fractal.lacunarity;
    }
    if !result.is_empty() {
        let values = octave_values(&seeds, &at, result.len());
        result.iter_mut().zip(values).for_each(|(octave, value)| octave.0 = value);
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> impl Iterator<Item = Vec3> {
        (0..200_000).map(|i| {
            let i = i as f32;
            Vec3::new(i * 0.754_877, i * 0.569_84, i * 0.430_159) % 97.0
        })
    }

    #[test]
    fn statistics_match_the_constants() {
        let noise = Noise::new(3);
        let (mut mean, mut absolute, mut ridge, mut largest) = (0.0, 0.0, 0.0, 0.0_f32);
        for p in points() {
            let value = noise.value(p);
            mean += f64::from(value) / 200_000.0;
            absolute += f64::from(value.abs()) / 200_000.0;
            ridge += f64::from((1.0 - 2.0 * value.abs()).powi(2)) / 200_000.0;
            largest = largest.max(value.abs());
        }
        assert!(mean.abs() < 0.004 && largest < 1.1, "mean {mean}, largest {largest}");
        assert!((absolute - f64::from(MEAN_ABSOLUTE)).abs() < 0.004, "{absolute}");
        assert!((ridge - f64::from(MEAN_RIDGE)).abs() < 0.006, "{ridge}");
    }

    #[test]
    fn sums_of_all_shapes_at_many_points_are_those_at_single_ones() {
        let (noise, places) = (Noise::new(5), Vec::from_iter(points().take(400)));
        // From points to footprints that leave nothing.
        let footprint = |i: usize| (i % 7) as f32 * 0.15;
        let mut sums = vec![f32::NAN; places.len()];
        for shape in [OctaveShape::PLAIN, OctaveShape::ABSOLUTE, OctaveShape::CREST] {
            for fractal in [1, 5, 20].map(Fractal::octaves) {
                for count in [0, 1, 3, 4, 63, 64, 65, 400] {
                    noise.sums_of(shape, fractal, |i| places[i], footprint, &mut sums[..count]);
                    let single = |i: usize| noise.sum(places[i], fractal, footprint(i), shape);
                    (0..count).for_each(|i| assert_eq!(sums[i], single(i)));
                }
            }
        }
    }

    #[test]
    fn wide_footprints_leave_the_mean() {
        let (noise, fractal) = (Noise::new(1), Fractal::octaves(3));
        for p in points().take(100) {
            assert_eq!(noise.fbm(p, fractal, 10.0), 0.0);
            assert!((noise.sum(p, fractal, 10.0, OctaveShape::ABSOLUTE) - 1.75 * MEAN_ABSOLUTE).abs() < 1e-5);
        }
    }
}
