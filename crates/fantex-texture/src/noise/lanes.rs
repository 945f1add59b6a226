//! Noise at many points at once, in the widest vectors that the processor has.
//!
//! Every step is that of the scalar functions in the same order, without fused multiplications that round otherwise: values are equal
//! bit by bit for coordinates below 2^31 (a zero may differ in its sign).

use std::sync::LazyLock;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Select, dispatch};
use glam::{IVec3, Vec3};

use super::{Cellular, CellularMetric, Fractal, Noise, RADIUS2, SCALES, band_limit};

/// Most octaves that [`octave_values`] evaluates.
pub(super) const MAX_OCTAVES: usize = 16;

/// Points that are brought from `x y z x y z` to `x x y y z z` at a time.
const BLOCK: usize = 64;

fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}

/// The same, but not wider than eight lanes: few octaves would leave more of them empty.
fn level_of_eight_lanes() -> Level {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = level().as_avx2() {
        return Level::Avx2(avx2);
    }
    level()
}

// Closures are not compiled for the vectors' instruction set unless they are inlined, which the compiler declines here: so
// each step is a function that must be.

/// Noise of one seed in the lanes of vectors. A kernel may remember what lanes share from one vector to the next.
pub(super) trait Kernel<const D: usize> {
    fn value<S: Simd>(&mut self, simd: S, seed: u32, at: [S::f32s; D]) -> S::f32s;
}

/// What is done to the noise of an octave before octaves are added.
#[derive(Clone, Copy)]
pub(super) enum Shape {
    Plain,
    Absolute,
    /// `(1 - steepness |noise|)^2`: a sharp crest where noise passes through 0.
    Crest(f32),
}

impl Shape {
    pub(super) fn of(self, noise: f32) -> f32 {
        match self {
            Self::Plain => noise,
            Self::Absolute => noise.abs(),
            Self::Crest(steepness) => (1.0 - steepness * noise.abs()).powi(2),
        }
    }

    #[inline(always)]
    fn of_lanes<S: Simd>(self, simd: S, noise: S::f32s) -> S::f32s {
        let absolute = (noise.bitcast::<S::u32s>() & !SIGN).bitcast::<S::f32s>();
        match self {
            Self::Plain => noise,
            Self::Absolute => absolute,
            Self::Crest(steepness) => {
                let below = S::f32s::splat(simd, 1.0) - absolute * steepness;
                below * below
            }
        }
    }
}

/// Octaves of shaped noise, of which the mean is known.
pub(super) struct Octaves<Origin> {
    pub(super) seed: u32,
    pub(super) fractal: Fractal,
    pub(super) mean: f32,
    pub(super) shape: Shape,
    /// Where an octave's origin lies; octaves without one stay at their mean.
    pub(super) origin: Origin,
}

impl<Origin> Octaves<Origin> {
    /// The sums at many points, each averaged over its footprint; `point` gives the coordinates of one, `footprint` the width.
    pub(super) fn sums<const D: usize>(
        &self,
        kernel: &mut impl Kernel<D>,
        point: impl Fn(usize) -> [f32; D],
        footprint: impl Fn(usize) -> f32,
        out: &mut [f32],
    ) where
        Origin: Fn(u32) -> Option<[f32; D]>,
    {
        let mut at = [[0.0; BLOCK]; D];
        let mut widths = [[0.0; BLOCK]];
        for (first, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
            // Lanes beyond the last point repeat it, so that they share its cells.
            transpose(&mut at, out.len(), |i| point(first + i));
            transpose(&mut widths, out.len(), |i| [footprint(first + i)]);
            self.dispatch_block(kernel, &at, &widths[0], out);
        }
    }

    // A function of its own, so that there is one for all closures that give points.
    #[inline(never)]
    fn dispatch_block<const D: usize>(
        &self,
        kernel: &mut impl Kernel<D>,
        at: &[[f32; BLOCK]; D],
        footprints: &[f32; BLOCK],
        out: &mut [f32],
    ) where
        Origin: Fn(u32) -> Option<[f32; D]>,
    {
        dispatch!(level(), simd => self.block(simd, kernel, at, footprints, out));
    }

    #[inline(always)]
    fn block<S: Simd, const D: usize>(
        &self,
        simd: S,
        kernel: &mut impl Kernel<D>,
        at: &[[f32; BLOCK]; D],
        footprints: &[f32; BLOCK],
        out: &mut [f32],
    ) where
        Origin: Fn(u32) -> Option<[f32; D]>,
    {
        let lanes = S::f32s::LEN;
        let narrowest = footprints.iter().copied().fold(f32::INFINITY, f32::min);
        let mean = S::f32s::splat(simd, self.mean);
        let mut sums = [0.0_f32; BLOCK];
        let (mut frequency, mut amplitude) = (1.0, 1.0);
        for octave in 0..self.fractal.octaves {
            let seen_from = (self.origin)(octave).filter(|_| band_limit(frequency, narrowest) > 0.0);
            if let Some(origin) = seen_from {
                for first in (0..out.len()).step_by(lanes) {
                    let left = band_limits(simd, load(simd, footprints, first) * frequency);
                    let is_left = left.simd_gt(0.0);
                    let mut value = mean;
                    if is_left.any_true() {
                        let mut place = [mean; D];
                        for d in 0..D {
                            place[d] = load(simd, &at[d], first) * frequency + origin[d];
                        }
                        let noise = kernel.value(simd, octave_seed(self.seed, octave), place);
                        let shaped = mean + left * (self.shape.of_lanes(simd, noise) - mean);
                        value = is_left.select(shaped, mean);
                    }
                    let sum = load(simd, &sums, first) + value * amplitude;
                    sum.store_slice(&mut sums[first..first + lanes]);
                }
            } else {
                sums.iter_mut().for_each(|sum| *sum += amplitude * self.mean);
            }
            frequency *= self.fractal.lacunarity;
            amplitude *= self.fractal.gain;
        }
        out.copy_from_slice(&sums[..out.len()]);
    }
}

/// Each octave has a pattern of its own.
pub(super) fn octave_seed(seed: u32, octave: u32) -> u32 {
    seed.wrapping_add(octave.wrapping_mul(0x632b_e5ab))
}

/// Noise of one seed at all points; `point` gives the coordinates of one.
pub(super) fn values_at<const D: usize>(
    kernel: &mut impl Kernel<D>,
    seed: u32,
    point: impl Fn(usize) -> [f32; D],
    out: &mut [f32],
) {
    let mut at = [[0.0; BLOCK]; D];
    for (first, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
        transpose(&mut at, out.len(), |i| point(first + i));
        dispatch_values(kernel, seed, &at, out);
    }
}

#[inline(never)]
fn dispatch_values<const D: usize>(
    kernel: &mut impl Kernel<D>,
    seed: u32,
    at: &[[f32; BLOCK]; D],
    out: &mut [f32],
) {
    dispatch!(level(), simd => values_in(simd, kernel, seed, at, out));
}

/// Columns of the coordinates of `count` points; what is left repeats the last one.
fn transpose<const D: usize>(at: &mut [[f32; BLOCK]; D], count: usize, point: impl Fn(usize) -> [f32; D]) {
    for (i, p) in (0..count).map(point).enumerate() {
        at.iter_mut().zip(p).for_each(|(at, x)| at[i] = x);
    }
    for at in at {
        let last = at[count - 1];
        at[count..].fill(last);
    }
}

#[inline(always)]
fn values_in<S: Simd, const D: usize>(
    simd: S,
    kernel: &mut impl Kernel<D>,
    seed: u32,
    at: &[[f32; BLOCK]; D],
    out: &mut [f32],
) {
    let lanes = S::f32s::LEN;
    for (first, out) in (0..).step_by(lanes).zip(out.chunks_mut(lanes)) {
        let mut place = [S::f32s::splat(simd, 0.0); D];
        for d in 0..D {
            place[d] = load(simd, &at[d], first);
        }
        let value = kernel.value(simd, seed, place);
        out.copy_from_slice(&value.as_slice()[..out.len()]);
    }
}

/// Gradient noise of up to [`MAX_OCTAVES`] seeds, each at its own point: the octaves of a fractal sum.
pub(super) fn octave_values(
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
        let place = [load(simd, &at[0], first), load(simd, &at[1], first), load(simd, &at[2], first)];
        gradient_noise(simd, seeds, CellsAndOffsets::new(place)).store_slice(&mut out[range]);
    }
}

#[inline(always)]
fn load<S: Simd, const COUNT: usize>(simd: S, from: &[f32; COUNT], first: usize) -> S::f32s {
    S::f32s::from_slice(simd, &from[first..first + S::f32s::LEN])
}

/// [`band_limit`] of lengths in cells.
#[inline(always)]
fn band_limits<S: Simd>(simd: S, cells: S::f32s) -> S::f32s {
    let one = S::f32s::splat(simd, 1.0);
    // The quotient by a half is exact either way.
    let t = ((cells - 0.5) * 2.0).max(0.0).min(one);
    one - t * t * (S::f32s::splat(simd, 3.0) - t * 2.0)
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

#[inline(always)]
fn finish_all<S: Simd>(hash: S::u32s) -> S::u32s {
    let mixed = hash * 0xc2b2_ae35;
    (mixed ^ (mixed >> 16)) * 0x27d4_eb2f
}

/// [`unit`](super::unit) of many hashes.
#[inline(always)]
fn units<S: Simd>(hash: S::u32s) -> S::f32s {
    (hash >> 8).bitcast::<S::i32s>().to_float::<S::f32s>() * (1.0 / (1 << 24) as f32)
}

/// The bit of a float that is its sign.
const SIGN: u32 = 1 << 31;

/// The unit cells of points and the points' offsets inside.
#[derive(Clone, Copy)]
struct CellsAndOffsets<S: Simd, const D: usize> {
    cells: [S::u32s; D],
    offsets: [S::f32s; D],
}

impl<S: Simd, const D: usize> CellsAndOffsets<S, D> {
    #[inline(always)]
    fn new(mut offsets: [S::f32s; D]) -> Self {
        let mut cells = [offsets[0].bitcast::<S::u32s>(); D];
        for d in 0..D {
            let floor = offsets[d].floor();
            cells[d] = floor.to_int::<S::i32s>().bitcast::<S::u32s>();
            offsets[d] -= floor;
        }
        Self { cells, offsets }
    }

    /// The cell that all lanes are in, if they are in one.
    #[inline(always)]
    fn shared(&self, simd: S) -> Option<[u32; D]> {
        let mut first = [0; D];
        let mut differs = S::u32s::splat(simd, 0);
        for (first, cells) in first.iter_mut().zip(self.cells) {
            *first = cells.as_slice()[0];
            differs |= cells ^ S::u32s::splat(simd, *first);
        }
        differs.simd_eq(0).all_true().then_some(first)
    }
}

// ---- Gradients on a cubic lattice.

/// [`Noise::value`]. Texels that follow one another mostly lie in one cell of all but the finest octaves, and share its gradients.
#[derive(Default)]
pub(super) struct Gradients {
    /// Seed and cell that `slopes` belong to.
    known: Option<(u32, [u32; 3])>,
    slopes: [Vec3; 8],
}

impl Kernel<3> for Gradients {
    #[inline(always)]
    fn value<S: Simd>(&mut self, simd: S, seed: u32, at: [S::f32s; 3]) -> S::f32s {
        let place = CellsAndOffsets::<S, 3>::new(at);
        let Some(cell) = place.shared(simd) else {
            return gradient_noise(simd, S::u32s::splat(simd, seed), place);
        };
        if self.known != Some((seed, cell)) {
            self.known = Some((seed, cell));
            self.slopes = Noise::new(seed).corner_gradients(IVec3::from_array(cell.map(|c| c as i32)));
        }
        let [x, y, z] = place.offsets;
        let (beyond_x, beyond_y, beyond_z) = (x - 1.0, y - 1.0, z - 1.0);
        let [share_x, share_y, share_z] = [fade::<S>(x), fade::<S>(y), fade::<S>(z)];
        let [a, b, c, d, e, f, g, h] = &self.slopes;
        let near = mix::<S>(
            mix::<S>(dot(simd, a, [x, y, z]), dot(simd, b, [beyond_x, y, z]), share_x),
            mix::<S>(dot(simd, c, [x, beyond_y, z]), dot(simd, d, [beyond_x, beyond_y, z]), share_x),
            share_y,
        );
        let far = mix::<S>(
            mix::<S>(dot(simd, e, [x, y, beyond_z]), dot(simd, f, [beyond_x, y, beyond_z]), share_x),
            mix::<S>(
                dot(simd, g, [x, beyond_y, beyond_z]),
                dot(simd, h, [beyond_x, beyond_y, beyond_z]),
                share_x,
            ),
            share_y,
        );
        mix::<S>(near, far, share_z)
    }
}

/// The product with a gradient whose coordinates are 0 or of length 1: one sum of two offsets, so fusing does not matter.
#[inline(always)]
fn dot<S: Simd>(simd: S, slope: &Vec3, [x, y, z]: [S::f32s; 3]) -> S::f32s {
    let of_z = z * slope.z;
    let of_y = y.mul_add(S::f32s::splat(simd, slope.y), of_z);
    x.mul_add(S::f32s::splat(simd, slope.x), of_y)
}

/// See the scalar version for the meaning of each step.
#[inline(always)]
fn gradient_noise<S: Simd>(simd: S, seed: S::u32s, place: CellsAndOffsets<S, 3>) -> S::f32s {
    let ([cell_x, cell_y, cell_z], [x, y, z]) = (place.cells, place.offsets);
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
fn fade<S: Simd>(t: S::f32s) -> S::f32s {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// The product of a corner's gradient, chosen by its hash, and the offset `d` from the corner.
#[inline(always)]
fn height<S: Simd>(simd: S, hash: S::u32s, d: [S::f32s; 3]) -> S::f32s {
    let hash = finish_all::<S>(hash);
    // The upper four bits of floor(3/4 hash) are floor(12 hash / 2^32), the gradient's number. Halves and quarters are rounded
    // down; together they miss 1 where the lowest two bits are set.
    let half = hash >> 1;
    let number = half + (hash >> 2) + (hash & half & 1);
    // Gradients 0..4 lie in the plane of x and y, 4..8 of x and z, the others of y and z; two bits are the signs.
    let first = number.simd_lt(S::u32s::splat(simd, 8 << 28)).select(d[0], d[1]);
    let second = number.simd_lt(S::u32s::splat(simd, 4 << 28)).select(d[1], d[2]);
    signed::<S>(first, number << 3) + signed::<S>(second, number << 2)
}

/// The value with its sign turned where the uppermost bit is set.
#[inline(always)]
fn signed<S: Simd>(value: S::f32s, bits: S::u32s) -> S::f32s {
    (value.bitcast::<S::u32s>() ^ (bits & SIGN)).bitcast::<S::f32s>()
}

// ---- Gradients on simplices.

/// [`simplex_noise`](super::simplex_noise) in 3 or 4 dimensions.
pub(super) struct Simplices;

impl<const D: usize> Kernel<D> for Simplices {
    #[inline(always)]
    fn value<S: Simd>(&mut self, simd: S, seed: u32, at: [S::f32s; D]) -> S::f32s {
        const { assert!(D == 3 || D == 4) };
        let root = (D as f32 + 1.0).sqrt();
        let (skew, unskew) = ((root - 1.0) / D as f32, (1.0 - 1.0 / root) / D as f32);
        let zero = S::f32s::splat(simd, 0.0);
        let mut sum = zero;
        for x in at {
            sum += x;
        }
        let shift = sum * skew;
        let mut skewed = at;
        for d in 0..D {
            skewed[d] = at[d] + shift;
        }
        let cells = CellsAndOffsets::<S, D>::new(skewed).cells;
        let mut sum = zero;
        for cell in cells {
            sum += cell.bitcast::<S::i32s>().to_float::<S::f32s>();
        }
        let back = sum * unskew;
        let mut local = at;
        for d in 0..D {
            local[d] = at[d] - (cells[d].bitcast::<S::i32s>().to_float::<S::f32s>() - back);
        }
        // How many coordinates come before each, larger ones first.
        let (none, one) = (S::u32s::splat(simd, 0), S::u32s::splat(simd, 1));
        let mut rank = [none; D];
        for d in 0..D {
            for e in 0..d {
                let is_before = local[e].simd_ge(local[d]);
                rank[d] += is_before.select(one, none);
                rank[e] += is_before.select(none, one);
            }
        }
        let mut value = zero;
        for corner in 0..=D {
            let mut offset = local;
            let mut cell = cells;
            let mut distance = zero;
            for d in 0..D {
                let is_passed = rank[d].simd_lt(corner as u32);
                cell[d] = cells[d] + is_passed.select(one, none);
                let step = is_passed.select(S::f32s::splat(simd, 1.0), zero);
                offset[d] = local[d] - step + corner as f32 * unskew;
                distance += offset[d] * offset[d];
            }
            let reach = S::f32s::splat(simd, RADIUS2) - distance;
            let mut hash = S::u32s::splat(simd, seed);
            for d in (0..D).rev() {
                hash = absorb_all::<S>(hash, cell[d]);
            }
            let height = if D == 3 {
                height(simd, hash, [offset[0], offset[1], offset[2]])
            } else {
                height_of_four(simd, hash, [offset[0], offset[1], offset[2], offset[D - 1]])
            };
            let squared = reach * reach;
            let part = squared * squared * height;
            value += reach.simd_gt(0.0).select(part, zero);
        }
        value * SCALES[D]
    }
}

/// [`height`] in four dimensions: three of the coordinates with any sign.
#[inline(always)]
fn height_of_four<S: Simd>(simd: S, hash: S::u32s, d: [S::f32s; 4]) -> S::f32s {
    let hash = finish_all::<S>(hash);
    let first = hash.simd_lt(S::u32s::splat(simd, 3 << 30)).select(d[0], d[1]);
    let second = hash.simd_lt(S::u32s::splat(simd, 2 << 30)).select(d[1], d[2]);
    let third = hash.simd_lt(S::u32s::splat(simd, 1 << 30)).select(d[2], d[3]);
    signed::<S>(first, hash << 4) + signed::<S>(second, hash << 3) + signed::<S>(third, hash << 2)
}

// ---- Scattered points.

/// What cellular noise is made of.
#[derive(Clone, Copy)]
pub(super) enum CellularValue {
    Nearest,
    Border,
    Id,
}

/// [`cellular`](super::cellular) in space.
pub(super) struct Scattered {
    pub(super) metric: CellularMetric,
    pub(super) value: CellularValue,
}

impl Kernel<3> for Scattered {
    #[inline(always)]
    fn value<S: Simd>(&mut self, simd: S, seed: u32, at: [S::f32s; 3]) -> S::f32s {
        let found = scattered(simd, seed, at, self.metric);
        match self.value {
            CellularValue::Nearest => found.nearest,
            CellularValue::Border => found.second - found.nearest,
            CellularValue::Id => found.id * 2.0 - 1.0,
        }
    }
}

/// [`Cellular`](super::Cellular) of the lanes.
#[derive(Clone, Copy)]
struct Found<S: Simd> {
    nearest: S::f32s,
    second: S::f32s,
    id: S::f32s,
}

impl<S: Simd> Found<S> {
    #[inline(always)]
    fn add(&mut self, distance: S::f32s, id: S::f32s) {
        let is_nearer = distance.simd_lt(self.nearest);
        self.second = is_nearer.select(self.nearest, self.second.min(distance));
        self.nearest = self.nearest.min(distance);
        self.id = is_nearer.select(id, self.id);
    }
}

/// [`cellular`](super::cellular) at many points.
pub(super) fn cellular_at(
    seed: u32,
    metric: CellularMetric,
    point: impl Fn(usize) -> [f32; 3],
    out: &mut [Cellular],
) {
    let mut at = [[0.0; BLOCK]; 3];
    for (first, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
        transpose(&mut at, out.len(), |i| point(first + i));
        dispatch!(level(), simd => cellular_in(simd, seed, metric, &at, out));
    }
}

#[inline(always)]
fn cellular_in<S: Simd>(
    simd: S,
    seed: u32,
    metric: CellularMetric,
    at: &[[f32; BLOCK]; 3],
    out: &mut [Cellular],
) {
    let lanes = S::f32s::LEN;
    for (first, out) in (0..).step_by(lanes).zip(out.chunks_mut(lanes)) {
        let place = [load(simd, &at[0], first), load(simd, &at[1], first), load(simd, &at[2], first)];
        let Found { nearest, second, id } = scattered(simd, seed, place, metric);
        let lanes = nearest.as_slice().iter().zip(second.as_slice()).zip(id.as_slice());
        for (out, ((&nearest, &second), &id)) in out.iter_mut().zip(lanes) {
            *out = Cellular { nearest, second, id };
        }
    }
}

/// The scattered points nearest to the lanes' places, ring by ring as in the scalar search.
#[inline(always)]
fn scattered<S: Simd>(simd: S, seed: u32, at: [S::f32s; 3], metric: CellularMetric) -> Found<S> {
    let place = CellsAndOffsets::<S, 3>::new(at);
    let one = S::f32s::splat(simd, 1.0);
    let mut margin = S::f32s::splat(simd, 0.5);
    for t in place.offsets {
        margin = margin.min(t).min(one - t);
    }
    let far = S::f32s::splat(simd, f32::INFINITY);
    let mut found = Found { nearest: far, second: far, id: S::f32s::splat(simd, 0.0) };
    for ring in 0..=super::CELLULAR_RINGS {
        let reach = margin + (ring as f32 - 1.0);
        let is_open = lengths::<S>(metric, found.second).simd_gt(reach);
        if !is_open.any_true() {
            break;
        }
        visit_ring(simd, seed, &place, metric, (ring, is_open), &mut found);
    }
    Found {
        nearest: lengths::<S>(metric, found.nearest),
        second: lengths::<S>(metric, found.second),
        id: found.id,
    }
}

#[inline(always)]
fn visit_ring<S: Simd>(
    simd: S,
    seed: u32,
    place: &CellsAndOffsets<S, 3>,
    metric: CellularMetric,
    (ring, is_open): (i32, <S::f32s as SimdBase<S>>::Mask),
    found: &mut Found<S>,
) {
    let (zero, far) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, f32::INFINITY));
    let [x, y, z] = place.offsets;
    for number_z in 0..=2 * ring {
        let step_z = outwards(number_z);
        let gap_z = joined::<S>(metric, zero, gap(simd, z, step_z));
        if !is_near::<S>(gap_z, found) {
            continue;
        }
        let of_z = absorb_all::<S>(S::u32s::splat(simd, seed), place.cells[2] + step_z as u32);
        for number_y in 0..=2 * ring {
            let step_y = outwards(number_y);
            let gap_yz = joined::<S>(metric, gap_z, gap(simd, y, step_y));
            if !is_near::<S>(gap_yz, found) {
                continue;
            }
            let of_yz = absorb_all::<S>(of_z, place.cells[1] + step_y as u32);
            let is_on_ring = step_z.abs().max(step_y.abs()) == ring;
            // Within the ring's square only the ends of a row.
            let first = if is_on_ring || ring == 0 { 0 } else { 2 * ring - 1 };
            for number_x in first..=2 * ring {
                let step_x = outwards(number_x);
                // In the nearest ring a look is nearly as dear as a cell.
                if ring > 1 && !is_near::<S>(joined::<S>(metric, gap_yz, gap(simd, x, step_x)), found) {
                    continue;
                }
                let hash = finish_all::<S>(absorb_all::<S>(of_yz, place.cells[0] + step_x as u32));
                let mut distance = joined::<S>(metric, zero, to_point(simd, hash, 0, step_x, x));
                distance = joined::<S>(metric, distance, to_point(simd, hash, 1, step_y, y));
                distance = joined::<S>(metric, distance, to_point(simd, hash, 2, step_z, z));
                found.add(is_open.select(distance, far), units::<S>(hash));
            }
        }
    }
}

/// From the lanes' places to the points of cells with these hashes, so many steps away, along an axis.
#[inline(always)]
fn to_point<S: Simd>(simd: S, hash: S::u32s, axis: u32, step: i32, offset: S::f32s) -> S::f32s {
    units::<S>(finish_all::<S>(absorb_all::<S>(hash, S::u32s::splat(simd, axis)))) + step as f32 - offset
}

/// 0, -1, 1, -2, 2, ...: points that are found first spare the search of cells farther away.
#[inline(always)]
fn outwards(number: i32) -> i32 {
    if number % 2 == 0 { number / 2 } else { -(number + 1) / 2 }
}

/// From the lanes' places to the cell so many steps away along an axis.
#[inline(always)]
fn gap<S: Simd>(simd: S, offset: S::f32s, step: i32) -> S::f32s {
    match step {
        0 => S::f32s::splat(simd, 0.0),
        1.. => S::f32s::splat(simd, step as f32) - offset,
        _ => offset - (step + 1) as f32,
    }
}

/// Whether a cell this far away may hold a point that is nearer than the second nearest of a lane.
#[inline(always)]
fn is_near<S: Simd>(gap: S::f32s, found: &Found<S>) -> bool {
    gap.simd_lt(found.second * super::CELLULAR_SLACK).any_true()
}

/// [`CellularMetric::joined`] in lanes.
#[inline(always)]
fn joined<S: Simd>(metric: CellularMetric, distance: S::f32s, along: S::f32s) -> S::f32s {
    let absolute = (along.bitcast::<S::u32s>() & !SIGN).bitcast::<S::f32s>();
    match metric {
        CellularMetric::Euclidean => distance + along * along,
        CellularMetric::Manhattan => distance + absolute,
        CellularMetric::Chebyshev => distance.max(absolute),
    }
}

#[inline(always)]
fn lengths<S: Simd>(metric: CellularMetric, distance: S::f32s) -> S::f32s {
    match metric {
        CellularMetric::Euclidean => distance.sqrt(),
        _ => distance,
    }
}
