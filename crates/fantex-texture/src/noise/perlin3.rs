//! Gradient noise in space and its fractal sums.
//!
//! Perlin, "Improving noise", 2002: cubic cells, twelve gradients, quintic fade. Deviation: the gradient is chosen by an
//! integer hash of the cell and a seed instead of a permutation table, so that the pattern does not repeat every 256 cells.
//!
//! The fractal sums take a footprint: the width, in the units of the point, over which the caller averages. Octaves whose
//! cells approach it fade to their mean, so a distant surface becomes calm instead of noisy.

use std::sync::LazyLock;

use arrayvec::ArrayVec;
use fearless_simd::prelude::*;
use fearless_simd::{Level, Select, dispatch};
use glam::{IVec3, Vec3};

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
        values_at(self.seed, points, out);
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
    pub fn cell_value(&self, cell: IVec3) -> f32 {
        unit(self.hash(cell))
    }

    fn hash(&self, cell: IVec3) -> u32 {
        finish(absorb(absorb(absorb(self.seed, cell.z), cell.y), cell.x))
    }

    /// Fractional Brownian motion: the sum of the octaves, mean 0.
    pub fn fbm(&self, p: Vec3, fractal: Fractal, footprint: f32) -> f32 {
        self.sum(p, fractal, footprint, 0.0, |noise| noise)
    }

    /// The sum of the octaves' absolute values, 0 or more.
    pub fn turbulence(&self, p: Vec3, fractal: Fractal, footprint: f32) -> f32 {
        self.sum(p, fractal, footprint, MEAN_ABSOLUTE, f32::abs)
    }

    /// The sum of sharp crests, where the octaves pass through 0: `(1 - 2 |noise|)^2` each.
    pub fn ridged(&self, p: Vec3, fractal: Fractal, footprint: f32) -> f32 {
        self.sum(p, fractal, footprint, MEAN_RIDGE, ridge)
    }

    /// [`Noise::fbm`] at many points, each with its footprint: the same values, several times as fast.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fbm_all(&self, points: &[Vec3], fractal: Fractal, footprints: &[f32], out: &mut [f32]) {
        self.sums(points, fractal, footprints, out, 0.0, |noise| noise);
    }

    /// [`Noise::ridged`] at many points, each with its footprint: the same values, several times as fast.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn ridged_all(&self, points: &[Vec3], fractal: Fractal, footprints: &[f32], out: &mut [f32]) {
        self.sums(points, fractal, footprints, out, MEAN_RIDGE, ridge);
    }

    fn sums(
        &self,
        points: &[Vec3],
        fractal: Fractal,
        footprints: &[f32],
        out: &mut [f32],
        mean: f32,
        shape: impl Fn(f32) -> f32,
    ) {
        if points.len() < FEW {
            for ((&p, &footprint), out) in points.iter().zip(footprints).zip(out) {
                *out = self.sum(p, fractal, footprint, mean, &shape);
            }
            return;
        }
        let origin = |octave| (octave < MAX_OCTAVES as u32).then(|| octave_origin(octave));
        sum_octaves(self.seed, points, fractal, footprints, out, (mean, shape), origin);
    }

    fn sum(&self, p: Vec3, fractal: Fractal, footprint: f32, mean: f32, shape: impl Fn(f32) -> f32) -> f32 {
        let octaves = octaves_at(self.seed, p, fractal, footprint);
        let (mut sum, mut amplitude) = (0.0, 1.0);
        for octave in 0..fractal.octaves {
            let value = octaves.get(octave as usize).map_or(mean, |&(value, left)| {
                if left > 0.0 { mean + left * (shape(value) - mean) } else { mean }
            });
            sum += amplitude * value;
            amplitude *= fractal.gain;
        }
        sum
    }
}

/// Octaves of shaped gradient noise, of which the mean is known, one after the other over blocks of points: each step in the order of
/// the sum at a single point. Octaves without origin stay at their mean.
pub(super) fn sum_octaves(
    seed: u32,
    points: &[Vec3],
    fractal: Fractal,
    footprints: &[f32],
    out: &mut [f32],
    (mean, shape): (f32, impl Fn(f32) -> f32),
    origin: impl Fn(u32) -> Option<Vec3>,
) {
    assert!(
        points.len() == footprints.len() && points.len() == out.len(),
        "one footprint and value per point"
    );
    const BLOCK: usize = 64;
    let (mut at, mut values) = ([Vec3::ZERO; BLOCK], [0.0; BLOCK]);
    let blocks = points.chunks(BLOCK).zip(footprints.chunks(BLOCK)).zip(out.chunks_mut(BLOCK));
    for ((points, footprints), out) in blocks {
        let narrowest = footprints.iter().copied().fold(f32::INFINITY, f32::min);
        out.fill(0.0);
        let (mut frequency, mut amplitude) = (1.0, 1.0);
        for octave in 0..fractal.octaves {
            let seen_from = origin(octave).filter(|_| band_limit(frequency, narrowest) > 0.0);
            if let Some(origin) = seen_from {
                at.iter_mut().zip(points).for_each(|(at, &p)| *at = p * frequency + origin);
                let count = points.len();
                values_at(octave_seed(seed, octave), &at[..count], &mut values[..count]);
            }
            for ((sum, &value), &footprint) in out.iter_mut().zip(&values).zip(footprints) {
                let left = if seen_from.is_some() { band_limit(frequency, footprint) } else { 0.0 };
                *sum += amplitude * if left > 0.0 { mean + left * (shape(value) - mean) } else { mean };
            }
            frequency *= fractal.lacunarity;
            amplitude *= fractal.gain;
        }
    }
}

/// A sharp crest where noise passes through 0.
fn ridge(noise: f32) -> f32 {
    (1.0 - 2.0 * noise.abs()).powi(2)
}

/// Each octave has a pattern of its own,
fn octave_seed(seed: u32, octave: u32) -> u32 {
    seed.wrapping_add(octave.wrapping_mul(0x632b_e5ab))
}

/// and an origin of its own.
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

// ---- Gradient noise in 3D at many points at once, in the widest vectors that the processor has.
//
// Every step is that of the scalar [`Noise::value`](super::Noise::value) in the same order, without fused
// multiplications: the values are equal bit by bit for coordinates below 2^31 (a zero may differ in its sign).

/// Most octave_values that [`octave_values`] evaluates.
pub(super) const MAX_OCTAVES: usize = 16;

fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}

/// The same, but not wider than eight lanes: few octave_values would leave more of them empty.
fn level_of_eight_lanes() -> Level {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = level().as_avx2() {
        return Level::Avx2(avx2);
    }
    level()
}

/// Noise of one seed at all points.
fn values_at(seed: u32, points: &[Vec3], out: &mut [f32]) {
    assert_eq!(points.len(), out.len(), "one value for every point");
    dispatch!(level(), simd => values_in(simd, seed, points, out));
}

/// Points that are brought from `x y z x y z` to `x x y y z z` at a time: enough that the vectors' loads do not wait for
/// the stores.
const BLOCK: usize = 128;

#[inline(always)]
fn values_in<S: Simd>(simd: S, seed: u32, points: &[Vec3], out: &mut [f32]) {
    let lanes = S::f32s::LEN;
    let seeds = S::u32s::splat(simd, seed);
    let mut at = [[0.0_f32; BLOCK]; 3];
    for (points, out) in points.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
        for (index, p) in points.iter().enumerate() {
            (at[0][index], at[1][index], at[2][index]) = (p.x, p.y, p.z);
        }
        let mut first = 0;
        for out in out.chunks_mut(lanes) {
            let value = noise(simd, seeds, load(simd, &at, first));
            if out.len() == lanes {
                value.store_slice(out);
            } else {
                out.copy_from_slice(&value.as_slice()[..out.len()]);
            }
            first += lanes;
        }
    }
}

/// Noise of up to [`MAX_OCTAVES`] seeds, each at its own point: the octave_values of a fractal sum.
fn octave_values(
    seeds: &[u32; MAX_OCTAVES],
    at: &[[f32; MAX_OCTAVES]; 3],
    count: usize,
) -> [f32; MAX_OCTAVES] {
    let mut out = [0.0; MAX_OCTAVES];
    let level = if count <= 8 { level_of_eight_lanes() } else { level() };
    dispatch!(level, simd => octaves_in(simd, seeds, at, count, &mut out));
    out
}

#[inline(always)]
fn octaves_in<S: Simd>(
    simd: S,
    seeds: &[u32; MAX_OCTAVES],
    at: &[[f32; MAX_OCTAVES]; 3],
    count: usize,
    out: &mut [f32; MAX_OCTAVES],
) {
    let lanes = S::f32s::LEN;
    for first in (0..count).step_by(lanes) {
        let range = first..first + lanes;
        let seeds = S::u32s::from_slice(simd, &seeds[range.clone()]);
        noise(simd, seeds, load(simd, at, first)).store_slice(&mut out[range]);
    }
}

#[inline(always)]
fn load<S: Simd, const COUNT: usize>(simd: S, at: &[[f32; COUNT]; 3], first: usize) -> [S::f32s; 3] {
    let end = first + S::f32s::LEN;
    [
        S::f32s::from_slice(simd, &at[0][first..end]),
        S::f32s::from_slice(simd, &at[1][first..end]),
        S::f32s::from_slice(simd, &at[2][first..end]),
    ]
}

// Closures are not compiled for the vectors' instruction set unless they are inlined, which the compiler declines here: so
// each step is a function that must be.

/// The kernel: see the scalar version for the meaning of each step.
#[inline(always)]
fn noise<S: Simd>(simd: S, seed: S::u32s, [x, y, z]: [S::f32s; 3]) -> S::f32s {
    let (cell_x, x) = cells_and_offsets::<S>(x);
    let (cell_y, y) = cells_and_offsets::<S>(y);
    let (cell_z, z) = cells_and_offsets::<S>(z);
    let share = [fade::<S>(x), fade::<S>(y)];
    let low = plane(simd, absorb_all::<S>(seed, cell_z), [cell_x, cell_y], [x, y, z], share);
    let high = plane(simd, absorb_all::<S>(seed, cell_z + 1), [cell_x, cell_y], [x, y, z - 1.0], share);
    mix::<S>(low, high, fade::<S>(z))
}

/// The four corners of equal z.
#[inline(always)]
fn plane<S: Simd>(
    simd: S,
    hash: S::u32s,
    [cell_x, cell_y]: [S::u32s; 2],
    [x, y, z]: [S::f32s; 3],
    share: [S::f32s; 2],
) -> S::f32s {
    let low = edge(simd, absorb_all::<S>(hash, cell_y), cell_x, [x, y, z], share[0]);
    let high = edge(simd, absorb_all::<S>(hash, cell_y + 1), cell_x, [x, y - 1.0, z], share[0]);
    mix::<S>(low, high, share[1])
}

/// The two corners of equal y and z.
#[inline(always)]
fn edge<S: Simd>(
    simd: S,
    hash: S::u32s,
    cell_x: S::u32s,
    [x, y, z]: [S::f32s; 3],
    share: S::f32s,
) -> S::f32s {
    let low = height(simd, absorb_all::<S>(hash, cell_x), [x, y, z]);
    let high = height(simd, absorb_all::<S>(hash, cell_x + 1), [x - 1.0, y, z]);
    mix::<S>(low, high, share)
}

#[inline(always)]
fn cells_and_offsets<S: Simd>(x: S::f32s) -> (S::u32s, S::f32s) {
    let floor = x.floor();
    (floor.to_int::<S::i32s>().bitcast::<S::u32s>(), x - floor)
}

#[inline(always)]
fn fade<S: Simd>(t: S::f32s) -> S::f32s {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[inline(always)]
fn mix<S: Simd>(low: S::f32s, high: S::f32s, share: S::f32s) -> S::f32s {
    low + share * (high - low)
}

#[inline(always)]
fn absorb_all<S: Simd>(hash: S::u32s, coordinate: S::u32s) -> S::u32s {
    let mixed = ((hash ^ coordinate) + 0x9e37_79b9) * 0x85eb_ca6b;
    mixed ^ (mixed >> 15)
}

/// The product of a corner's gradient, chosen by its hash, and the offset `d` from the corner.
#[inline(always)]
fn height<S: Simd>(simd: S, hash: S::u32s, d: [S::f32s; 3]) -> S::f32s {
    let mixed = hash * 0xc2b2_ae35;
    let hash = (mixed ^ (mixed >> 16)) * 0x27d4_eb2f;
    // The upper four bits of floor(3/4 hash) are floor(12 hash / 2^32), the gradient's number. Halves and quarters are rounded
    // down; together they miss 1 where the lowest two bits are set.
    let half = hash >> 1;
    let number = half + (hash >> 2) + (hash & half & 1);
    // Gradients 0..4 lie in the plane of x and y, 4..8 of x and z, the others of y and z; two bits are the signs.
    let first = number.simd_lt(S::u32s::splat(simd, 8 << 28)).select(d[0], d[1]);
    let second = number.simd_lt(S::u32s::splat(simd, 4 << 28)).select(d[1], d[2]);
    let first = (first.bitcast::<S::u32s>() ^ ((number << 3) & SIGN)).bitcast::<S::f32s>();
    let second = (second.bitcast::<S::u32s>() ^ ((number << 2) & SIGN)).bitcast::<S::f32s>();
    first + second
}

/// The bit of a float that is its sign.
const SIGN: u32 = 1 << 31;

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
    fn sums_at_many_points_equal_single_sums() {
        let noise = Noise::new(5);
        for count in [1, 3, 4, 63, 64, 65, 200] {
            let at: Vec<Vec3> = points().take(count).map(|p| p * 0.1).collect();
            // From points to footprints that leave nothing.
            let footprints: Vec<f32> = (0..count).map(|i| (i % 7) as f32 * 0.15).collect();
            let mut out = vec![f32::NAN; count];
            for fractal in [Fractal::octaves(1), Fractal::octaves(5), Fractal::octaves(20)] {
                noise.fbm_all(&at, fractal, &footprints, &mut out);
                for i in 0..count {
                    assert_eq!(out[i], noise.fbm(at[i], fractal, footprints[i]), "{i} of {count}");
                }
                noise.ridged_all(&at, fractal, &footprints, &mut out);
                for i in 0..count {
                    assert_eq!(out[i], noise.ridged(at[i], fractal, footprints[i]), "{i} of {count}");
                }
            }
        }
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
    fn wide_footprints_leave_the_mean() {
        let (noise, fractal) = (Noise::new(1), Fractal::octaves(3));
        for p in points().take(100) {
            assert_eq!(noise.fbm(p, fractal, 10.0), 0.0);
            assert!((noise.turbulence(p, fractal, 10.0) - 1.75 * MEAN_ABSOLUTE).abs() < 1e-5);
        }
    }
}
