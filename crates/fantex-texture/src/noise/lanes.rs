//! Noise at many points at once, in the widest vectors that the processor has.
//!
//! Every step is that of the scalar functions in the same order, without fused multiplications that round otherwise: values are equal
//! bit by bit for coordinates below 2^31 (a zero may differ in its sign).

use std::cell::Cell;

use fantex_base::vector_level;
use fearless_simd::prelude::*;
use fearless_simd::{Level, Select, dispatch};

use super::{Fractal, RADIUS2, SCALES, band_limit};

/// Most octaves that [`octave_values`] evaluates.
pub(super) const MAX_OCTAVES: usize = 16;

/// Points that are brought from `x y z x y z` to `x x y y z z` at a time.
pub(super) const BLOCK: usize = 64;

/// The processor's vectors, but not wider than eight lanes: few octaves would leave more of them empty.
fn level_of_eight_lanes() -> Level {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = vector_level().as_avx2() {
        return Level::Avx2(avx2);
    }
    vector_level()
}

// Closures are not compiled for the vectors' instruction set unless they are inlined, which the compiler declines here: so
// each step is a function that must be.

/// Noise of one seed in the lanes of vectors. A kernel may remember what lanes share from one vector to the next.
pub(super) trait Kernel<const D: usize> {
    fn value<S: Simd>(&mut self, simd: S, seed: u32, at: [S::f32s; D]) -> S::f32s;

    /// The same at the first `count` places of a block, up to a whole vector.
    #[inline(always)]
    fn values<S: Simd>(
        &mut self,
        simd: S,
        seed: u32,
        at: &[[f32; BLOCK]; D],
        count: usize,
        out: &mut [f32; BLOCK],
    ) {
        for first in (0..count).step_by(S::f32s::LEN) {
            let value = self.value(simd, seed, load_place(simd, at, first));
            value.store_slice(&mut out[first..first + S::f32s::LEN]);
        }
    }
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
        if out.is_empty() {
            return;
        }
        // Numbers that are known to lie within a block are looked up in columns without a check, many at once.
        if out.len() <= BLOCK {
            return self.sums_of_block(kernel, point, footprint, out);
        }
        for (first, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
            self.sums_of_block(kernel, |i| point(first + i), |i| footprint(first + i), out);
        }
    }

    #[inline]
    fn sums_of_block<const D: usize>(
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
        // Lanes beyond the last point repeat it, so that they share its cells.
        transpose(&mut at, out.len(), point);
        transpose(&mut widths, out.len(), |i| [footprint(i)]);
        self.dispatch(kernel, &at, &widths[0], out);
    }

    // A function of its own, so that there is one for all closures that give points.
    #[inline(never)]
    fn dispatch<const D: usize>(
        &self,
        kernel: &mut impl Kernel<D>,
        at: &[[f32; BLOCK]; D],
        footprints: &[f32; BLOCK],
        out: &mut [f32],
    ) where
        Origin: Fn(u32) -> Option<[f32; D]>,
    {
        dispatch!(vector_level(), simd => self.block(simd, kernel, at, footprints, out));
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
        let [narrowest, widest] = least_and_greatest(footprints);
        let [zero, mean] = [S::f32s::splat(simd, 0.0), S::f32s::splat(simd, self.mean)];
        let mut sums = [0.0_f32; BLOCK];
        let (mut places, mut noise) = ([[0.0; BLOCK]; D], [0.0; BLOCK]);
        let (mut frequency, mut amplitude) = (1.0, 1.0);
        for octave in 0..self.fractal.octaves {
            let seen_from = (self.origin)(octave).filter(|_| band_limit(frequency, narrowest) > 0.0);
            let seed = octave_seed(self.seed, octave);
            if let Some(origin) = seen_from
                && band_limit(frequency, widest) == 1.0
            {
                for first in (0..out.len()).step_by(lanes) {
                    for d in 0..D {
                        let place = load(simd, &at[d], first) * frequency + origin[d];
                        place.store_slice(&mut places[d][first..first + lanes]);
                    }
                }
                kernel.values(simd, seed, &places, out.len(), &mut noise);
                for first in (0..out.len()).step_by(lanes) {
                    let beyond_mean = self.shape.of_lanes(simd, load(simd, &noise, first)) - mean;
                    let sum = load(simd, &sums, first) + (mean + beyond_mean) * amplitude;
                    sum.store_slice(&mut sums[first..first + lanes]);
                }
            } else if let Some(origin) = seen_from {
                for first in (0..out.len()).step_by(lanes) {
                    let left = band_limits(simd, load(simd, footprints, first) * frequency);
                    let is_left = left.simd_gt(0.0);
                    let mut value = mean;
                    if is_left.any_true() {
                        let mut place = [mean; D];
                        for d in 0..D {
                            place[d] = load(simd, &at[d], first) * frequency + origin[d];
                        }
                        let noise = kernel.value(simd, seed, place);
                        let beyond_mean = self.shape.of_lanes(simd, noise) - mean;
                        value = mean + is_left.select(left * beyond_mean, zero);
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

/// Columns of the coordinates of `count` points, at least one; what is left repeats the last one.
pub(super) fn transpose<const D: usize>(
    at: &mut [[f32; BLOCK]; D],
    count: usize,
    point: impl Fn(usize) -> [f32; D],
) {
    let count = count.min(BLOCK);
    for i in 0..count {
        for (column, x) in at.iter_mut().zip(point(i)) {
            column[i] = x;
        }
    }
    for at in at {
        let last = at[count - 1];
        at[count..].fill(last);
    }
}

/// Gradient noise of up to [`MAX_OCTAVES`] seeds, each at its own point: the octaves of a fractal sum.
pub(super) fn octave_values(
    seeds: &[u32; MAX_OCTAVES],
    at: &[[f32; MAX_OCTAVES]; 3],
    count: usize,
) -> [f32; MAX_OCTAVES] {
    let mut out = [0.0; MAX_OCTAVES];
    let level = if count <= 8 { level_of_eight_lanes() } else { vector_level() };
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

/// Of numbers that are not negative, by their bits, which vectors compare without a thought of what is no number.
#[inline(always)]
fn least_and_greatest(numbers: &[f32; BLOCK]) -> [f32; 2] {
    let (mut least, mut greatest) = (i32::MAX, i32::MIN);
    for number in numbers {
        let bits = number.to_bits() as i32;
        (least, greatest) = (least.min(bits), greatest.max(bits));
    }
    [least, greatest].map(|bits| f32::from_bits(bits as u32))
}

#[inline(always)]
pub(super) fn load<S: Simd, const COUNT: usize>(simd: S, from: &[f32; COUNT], first: usize) -> S::f32s {
    S::f32s::from_slice(simd, &from[first..first + S::f32s::LEN])
}

#[inline(always)]
fn load_place<S: Simd, const D: usize>(simd: S, at: &[[f32; BLOCK]; D], first: usize) -> [S::f32s; D] {
    let mut place = [S::f32s::splat(simd, 0.0); D];
    for d in 0..D {
        place[d] = load(simd, &at[d], first);
    }
    place
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
pub(super) fn absorb_all<S: Simd>(hash: S::u32s, coordinate: S::u32s) -> S::u32s {
    let mixed = ((hash ^ coordinate) + 0x9e37_79b9) * 0x85eb_ca6b;
    mixed ^ (mixed >> 15)
}

#[inline(always)]
pub(super) fn finish_all<S: Simd>(hash: S::u32s) -> S::u32s {
    let mixed = hash * 0xc2b2_ae35;
    (mixed ^ (mixed >> 16)) * 0x27d4_eb2f
}

/// [`unit`](super::unit) of many hashes.
#[inline(always)]
pub(super) fn units<S: Simd>(hash: S::u32s) -> S::f32s {
    (hash >> 8).bitcast::<S::i32s>().to_float::<S::f32s>() * (1.0 / (1 << 24) as f32)
}

/// The bit of a float that is its sign.
pub(super) const SIGN: u32 = 1 << 31;

/// The unit cells of points and the points' offsets inside.
#[derive(Clone, Copy)]
pub(super) struct CellsAndOffsets<S: Simd, const D: usize> {
    pub(super) cells: [S::u32s; D],
    pub(super) offsets: [S::f32s; D],
}

impl<S: Simd, const D: usize> CellsAndOffsets<S, D> {
    #[inline(always)]
    pub(super) fn new(mut offsets: [S::f32s; D]) -> Self {
        let mut cells = [offsets[0].bitcast::<S::u32s>(); D];
        for d in 0..D {
            let floor = offsets[d].floor();
            cells[d] = floor.to_int::<S::i32s>().bitcast::<S::u32s>();
            offsets[d] -= floor;
        }
        Self { cells, offsets }
    }

    /// The cell of a lane, and the lanes that are in it.
    #[inline(always)]
    pub(super) fn shared(&self, simd: S, lane: usize) -> ([u32; D], <S::u32s as SimdBase<S>>::Mask) {
        let mut cell = [0; D];
        for (cell, cells) in cell.iter_mut().zip(self.cells) {
            *cell = cells.as_slice()[lane];
        }
        (cell, self.in_cell(simd, cell))
    }

    /// The lanes that are in a cell.
    #[inline(always)]
    fn in_cell(&self, simd: S, cell: [u32; D]) -> <S::u32s as SimdBase<S>>::Mask {
        let mut differs = S::u32s::splat(simd, 0);
        for (cell, cells) in cell.into_iter().zip(self.cells) {
            differs |= cells ^ S::u32s::splat(simd, cell);
        }
        differs.simd_eq(0)
    }
}

// ---- Gradients on a cubic lattice.

/// [`Noise::value`](super::Noise::value). Texels that follow one another mostly lie in one cell or two of all but the finest octaves, and share their
/// gradients.
pub(super) struct Gradients {
    /// Of seeds and cells that were met last, each in a place that follows from them.
    known: [KnownSlopes; KNOWN_SLOPES],
}

/// Enough for all octaves of a recipe, few enough for the nearest cache.
const KNOWN_SLOPES: usize = 64;

impl Gradients {
    /// Calls `then` with those that the thread has met last.
    pub(super) fn with<R>(then: impl FnOnce(&mut Self) -> R) -> R {
        thread_local! {
            static KNOWN: Cell<Option<Box<Gradients>>> = const { Cell::new(None) };
        }
        let mut known =
            KNOWN.take().unwrap_or_else(|| Box::new(Self { known: [KnownSlopes::default(); KNOWN_SLOPES] }));
        let result = then(&mut known);
        KNOWN.set(Some(known));
        result
    }

    /// The gradients at a cell's corners.
    #[inline(always)]
    fn slopes<S: Simd>(&mut self, simd: S, seed: u32, cell: [u32; 3]) -> &CornerSlopes {
        let [x, y, z] = cell;
        let asked = Some([u64::from(seed) | u64::from(x) << 32, u64::from(y) | u64::from(z) << 32]);
        // Neighbouring cells and successive octaves lie apart.
        let mixed = x.wrapping_add(y.wrapping_mul(5)).wrapping_add(z.wrapping_mul(19)) ^ (seed >> 7);
        let known = &mut self.known[mixed as usize % KNOWN_SLOPES];
        if known.0 != asked {
            *known = (asked, corner_slopes(simd, seed, cell));
        }
        &known.1
    }
}

/// A seed and a cell, and the gradients at its corners.
type KnownSlopes = (Option<[u64; 2]>, CornerSlopes);

/// Gradients at the corners of a cell by axis, x fastest; as many as whole vectors hold.
type CornerSlopes = [[f32; CORNER_LANES]; 3];

/// The widest vectors have more lanes than a cell has corners.
const CORNER_LANES: usize = 16;

/// Steps from the lowest corner of a cell to each, by axis; x fastest.
const CORNER_STEPS: [[u32; CORNER_LANES]; 3] = {
    let mut steps = [[0; CORNER_LANES]; 3];
    let mut corner = 0;
    while corner < CORNER_LANES {
        steps[0][corner] = corner as u32 & 1;
        steps[1][corner] = corner as u32 >> 1 & 1;
        steps[2][corner] = corner as u32 >> 2 & 1;
        corner += 1;
    }
    steps
};

/// The scalar gradients at the corners of a cell in the lanes of vectors.
#[inline(always)]
fn corner_slopes<S: Simd>(simd: S, seed: u32, cell: [u32; 3]) -> CornerSlopes {
    let mut slopes = [[0.0; CORNER_LANES]; 3];
    let [zero, one] = [S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0)];
    let lanes = S::f32s::LEN;
    for first in (0..8).step_by(lanes) {
        let range = first..first + lanes;
        let mut hash = S::u32s::splat(simd, seed);
        for axis in (0..3).rev() {
            let step = S::u32s::from_slice(simd, &CORNER_STEPS[axis][range.clone()]);
            hash = absorb_all::<S>(hash, step + cell[axis]);
        }
        let gradient = GradientNumbers::of(simd, hash);
        let [first_sign, second_sign] = gradient.signed([one; 2]);
        gradient.has_x.select(first_sign, zero).store_slice(&mut slopes[0][range.clone()]);
        let y = gradient.has_no_z.select(second_sign, gradient.has_x.select(zero, first_sign));
        y.store_slice(&mut slopes[1][range.clone()]);
        gradient.has_no_z.select(zero, second_sign).store_slice(&mut slopes[2][range]);
    }
    slopes
}

impl Kernel<3> for Gradients {
    /// Where all places lie in one cell, its gradients are found once, and nothing else is asked of a vector.
    #[inline(always)]
    fn values<S: Simd>(
        &mut self,
        simd: S,
        seed: u32,
        at: &[[f32; BLOCK]; 3],
        count: usize,
        out: &mut [f32; BLOCK],
    ) {
        let lanes = S::f32s::LEN;
        let first_place = CellsAndOffsets::<S, 3>::new(load_place(simd, at, 0));
        let (cell, inside) = first_place.shared(simd, 0);
        let mut is_one = inside.all_true();
        for first in (lanes..count).step_by(lanes) {
            let place = CellsAndOffsets::<S, 3>::new(load_place(simd, at, first));
            is_one &= place.in_cell(simd, cell).all_true();
        }
        if !is_one {
            for first in (0..count).step_by(lanes) {
                let value = self.value(simd, seed, load_place(simd, at, first));
                value.store_slice(&mut out[first..first + lanes]);
            }
            return;
        }
        let slopes = self.slopes(simd, seed, cell);
        for first in (0..count).step_by(lanes) {
            let place = CellsAndOffsets::<S, 3>::new(load_place(simd, at, first));
            noise_in_cell(simd, slopes, place.offsets).store_slice(&mut out[first..first + lanes]);
        }
    }

    #[inline(always)]
    fn value<S: Simd>(&mut self, simd: S, seed: u32, at: [S::f32s; 3]) -> S::f32s {
        let place = CellsAndOffsets::<S, 3>::new(at);
        let (cell, inside) = place.shared(simd, 0);
        if inside.all_true() {
            return noise_in_cell(simd, self.slopes(simd, seed, cell), place.offsets);
        }
        let (other, others) = place.shared(simd, inside.to_bitmask().trailing_ones() as usize);
        if (inside | others).any_false() {
            return gradient_noise(simd, S::u32s::splat(simd, seed), place);
        }
        let noise = noise_in_cell(simd, self.slopes(simd, seed, cell), place.offsets);
        inside.select(noise, noise_in_cell(simd, self.slopes(simd, seed, other), place.offsets))
    }
}

/// The noise of lanes in a cell with these gradients at its corners.
#[inline(always)]
fn noise_in_cell<S: Simd>(simd: S, slopes: &CornerSlopes, [x, y, z]: [S::f32s; 3]) -> S::f32s {
    let (beyond_x, beyond_y, beyond_z) = (x - 1.0, y - 1.0, z - 1.0);
    let [share_x, share_y, share_z] = [fade::<S>(x), fade::<S>(y), fade::<S>(z)];
    let near = mix::<S>(
        mix::<S>(dot(simd, slopes, 0, [x, y, z]), dot(simd, slopes, 1, [beyond_x, y, z]), share_x),
        mix::<S>(
            dot(simd, slopes, 2, [x, beyond_y, z]),
            dot(simd, slopes, 3, [beyond_x, beyond_y, z]),
            share_x,
        ),
        share_y,
    );
    let far = mix::<S>(
        mix::<S>(
            dot(simd, slopes, 4, [x, y, beyond_z]),
            dot(simd, slopes, 5, [beyond_x, y, beyond_z]),
            share_x,
        ),
        mix::<S>(
            dot(simd, slopes, 6, [x, beyond_y, beyond_z]),
            dot(simd, slopes, 7, [beyond_x, beyond_y, beyond_z]),
            share_x,
        ),
        share_y,
    );
    mix::<S>(near, far, share_z)
}

/// The product with a corner's gradient, whose coordinates are 0 or of length 1: one sum of two offsets, so fusing does not matter.
#[inline(always)]
fn dot<S: Simd>(simd: S, slopes: &CornerSlopes, corner: usize, [x, y, z]: [S::f32s; 3]) -> S::f32s {
    let of_z = z * slopes[2][corner];
    let of_y = y.mul_add(S::f32s::splat(simd, slopes[1][corner]), of_z);
    x.mul_add(S::f32s::splat(simd, slopes[0][corner]), of_y)
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
    let gradient = GradientNumbers::of(simd, hash);
    let [first, second] =
        gradient.signed([gradient.has_x.select(d[0], d[1]), gradient.has_no_z.select(d[1], d[2])]);
    first + second
}

/// Which of the twelve gradients corners have.
struct GradientNumbers<S: Simd> {
    /// In the upper four bits.
    numbers: S::u32s,
    has_x: S::mask32s,
    has_no_z: S::mask32s,
}

impl<S: Simd> GradientNumbers<S> {
    /// Those of corners with these hashes.
    #[inline(always)]
    fn of(simd: S, hash: S::u32s) -> Self {
        let hash = finish_all::<S>(hash);
        // The upper four bits of floor(3/4 hash) are floor(12 hash / 2^32), the gradient's number. Halves and quarters are rounded
        // down; together they miss 1 where the lowest two bits are set.
        let half = hash >> 1;
        let numbers = half + (hash >> 2) + (hash & half & 1);
        // Gradients 0..4 lie in the plane of x and y, 4..8 of x and z, the others of y and z; two bits are the signs.
        let has_x = numbers.simd_lt(S::u32s::splat(simd, 8 << 28));
        let has_no_z = numbers.simd_lt(S::u32s::splat(simd, 4 << 28));
        Self { numbers, has_x, has_no_z }
    }

    /// What belongs to the first and to the second coordinate that is not 0, with the signs of these.
    #[inline(always)]
    fn signed(&self, [first, second]: [S::f32s; 2]) -> [S::f32s; 2] {
        [signed::<S>(first, self.numbers << 3), signed::<S>(second, self.numbers << 2)]
    }
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
