//! Many look-ups at once, in the widest vectors that the processor has.
//!
//! ```text
//!  points --place--> levels and positions --read--> pairs of stored texels --decode, interpolate--> linear RGBA
//!            vectors          one by one, no result waits for another             vectors
//! ```
//!
//! A block of look-ups passes each step as a whole. The middle one does nothing but copy bytes, two neighbouring texels by one
//! load, so that the processor has the cache lines of many look-ups under way at once; that is what makes random
//! look-ups four times as fast as one by one. What differs by look-up (level, position, shares) lies in arrays.
//!
//! Steps are those of the scalar look-ups in `taps.rs` and `footprint.rs`, without fused multiplications: the results do not depend on the processor. Bytes
//! are decoded to 16 bits, as which the coarser levels are stored. Where texels count alike (`batch_texels.rs`), neighbours are
//! interpolated in whole numbers. Look-ups at the edges of a level are left to the caller, and so are
//! images that are not stored as one, three or four fixed-point channels.

use std::f32::consts::{LN_2, SQRT_2};
use std::ops::Range;

use fantex_base::vector_level;
use fearless_simd::prelude::*;
use fearless_simd::{Select, Simd, dispatch};
use glam::Vec2;

use super::batch_texels::{Levels, Pairs, blend, mix, mix_texels, store_rgba, store_texels, weigh};
use crate::{AlphaUse, Wrap};

/// Look-ups of a block: enough that no step waits for the one before, few enough that all arrays stay in the first cache.
pub(crate) const BLOCK: usize = 64;

/// Numbers of a block's look-ups.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Block<T>(pub(crate) [T; BLOCK]);

impl<T: Copy> Block<T> {
    pub(super) fn of(value: T) -> Self {
        Self([value; BLOCK])
    }
}

/// Where a block of trilinear look-ups is.
#[derive(Clone, Debug)]
pub(crate) struct Probes {
    /// Texture coordinates.
    places: Block<[f32; 2]>,
    /// The finer one of two neighbouring levels, and the share of the coarser one.
    fine: Block<u32>,
    share: Block<f32>,
    count: usize,
}

impl Probes {
    pub(crate) fn new() -> Self {
        Self { places: Block::of([0.0; 2]), fine: Block::of(0), share: Block::of(0.0), count: 0 }
    }

    /// Up to a block of other points, on the levels of those before: level 0 if there were none.
    pub(crate) fn place(&mut self, points: impl ExactSizeIterator<Item = Vec2>) {
        self.count = points.len();
        for (place, point) in self.places.0.iter_mut().zip(points) {
            *place = point.to_array();
        }
    }

    /// Chooses the levels by footprints: `steps` are the footprints' edges in uv, `size` is that of level 0.
    pub(crate) fn choose_levels(&mut self, steps: &Steps, size: Vec2, last: usize) {
        dispatch!(vector_level(), simd => choose_levels(simd, self, steps, size, last as u32));
    }

    /// Adds points of a row on equal levels, `first + step * number`; the block must have room for them.
    pub(crate) fn push_row(&mut self, [first, step]: [Vec2; 2], numbers: Range<u32>, fine: u32, share: f32) {
        let range = self.count..self.count + numbers.len();
        for (place, number) in self.places.0[range.clone()].iter_mut().zip(numbers) {
            *place = (first + step * number as f32).to_array();
        }
        self.fine.0[range.clone()].fill(fine);
        self.share.0[range.clone()].fill(share);
        self.count = range.end;
    }

    pub(crate) fn len(&self) -> usize {
        self.count
    }

    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    pub(crate) fn at(&self, index: usize) -> (Vec2, u32, f32) {
        (Vec2::from_array(self.places.0[index]), self.fine.0[index], self.share.0[index])
    }
}

/// The edges of a block's footprints, in uv: `x` and `y` of the first, then of the second.
#[derive(Clone, Debug)]
pub(crate) struct Steps(Block<[f32; 4]>);

impl Steps {
    pub(crate) fn new() -> Self {
        Self(Block::of([0.0; 4]))
    }

    /// Up to a block of others.
    pub(crate) fn place(&mut self, footprints: impl Iterator<Item = [Vec2; 2]>) {
        for (numbers, [dx, dy]) in self.0.0.iter_mut().zip(footprints) {
            *numbers = [dx.x, dx.y, dy.x, dy.y];
        }
    }
}

/// Results of a block: linear RGBA, straight alpha.
pub(crate) type Colors = Block<[f32; 4]>;

impl Colors {
    pub(crate) fn black() -> Self {
        Self::of([0.0; 4])
    }
}

/// What the steps hand on, kept from block to block.
pub(crate) struct Workspace {
    /// In the finer and in the coarser level of every probe.
    quads: [Quads; 2],
    pairs: [Pairs; 2],
}

impl Workspace {
    pub(crate) fn new() -> Self {
        Self { quads: [Quads::new(), Quads::new()], pairs: [Pairs::new(), Pairs::new()] }
    }
}

/// What is the same for all look-ups of a call.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LookUp<'a> {
    pub(crate) levels: &'a Levels<'a>,
    pub(crate) wrap: [Wrap; 2],
    pub(crate) alpha: AlphaUse,
}

impl LookUp<'_> {
    /// Interpolates in and between levels at all probes, alpha still a weight. Returns the set of those (a bit each) that must
    /// be looked up otherwise.
    pub(crate) fn sums(&self, probes: &Probes, workspace: &mut Workspace, out: &mut Colors) -> u64 {
        dispatch!(vector_level(), simd => sums_of_channels(simd, self, probes, workspace, out))
    }
}

#[inline(always)]
fn sums_of_channels<S: Simd>(
    simd: S,
    look_up: &LookUp<'_>,
    probes: &Probes,
    workspace: &mut Workspace,
    out: &mut Colors,
) -> u64 {
    match look_up.levels.channels() {
        1 => sums::<S, 1>(simd, look_up, probes, workspace, out),
        3 => sums::<S, 3>(simd, look_up, probes, workspace, out),
        _ => sums::<S, 4>(simd, look_up, probes, workspace, out),
    }
}

#[inline(always)]
fn sums<S: Simd, const C: usize>(
    simd: S,
    look_up: &LookUp<'_>,
    probes: &Probes,
    workspace: &mut Workspace,
    out: &mut Colors,
) -> u64 {
    let (levels, count) = (look_up.levels, probes.count);
    if count == 0 {
        return 0;
    }
    let Workspace { quads: [fine, coarse], pairs: [fine_pairs, coarse_pairs] } = workspace;
    let is_weighted = C == 4 && look_up.alpha == AlphaUse::Coverage;
    locate(simd, probes, look_up.wrap, levels, 0, fine);
    let missed = fine_pairs.read::<S, C>(simd, levels, fine, count, !is_weighted);
    // Magnified, nothing is seen of coarser levels.
    if probes.share.0[..count].iter().all(|&share| share == 0.0) {
        for first in (0..count).step_by(S::f32s::LEN) {
            if is_weighted {
                store_rgba::<S, C>(simd, blend::<S, C>(simd, fine, fine_pairs, true, first), out, first);
            } else {
                let value = weigh::<S, C>(simd, fine, fine_pairs, levels.meaning(), first);
                store_texels::<S, C>(simd, value, out, first);
            }
        }
        return missed;
    }
    locate(simd, probes, look_up.wrap, levels, 1, coarse);
    let missed = missed | coarse_pairs.read::<S, C>(simd, levels, coarse, count, !is_weighted);
    for first in (0..count).step_by(S::f32s::LEN) {
        let share = S::f32s::from_slice(simd, &probes.share.0[first..first + S::f32s::LEN]);
        if is_weighted {
            let from = blend::<S, C>(simd, fine, fine_pairs, true, first);
            let to = blend::<S, C>(simd, coarse, coarse_pairs, true, first);
            store_rgba::<S, C>(simd, mix::<S, C>(from, to, share), out, first);
        } else {
            let from = weigh::<S, C>(simd, fine, fine_pairs, levels.meaning(), first);
            let to = weigh::<S, C>(simd, coarse, coarse_pairs, levels.meaning(), first);
            store_texels::<S, C>(simd, mix_texels::<S>(from, to, share), out, first);
        }
    }
    missed
}

// ---- Which levels, and where in them.

// Closures are not compiled for the vectors' instruction set unless they are inlined, which the compiler declines: so each
// step is a function that must be.

/// As `FootprintAxes::squared_major` and `LevelPair::for_squared_width`.
#[inline(always)]
fn choose_levels<S: Simd>(simd: S, probes: &mut Probes, steps: &Steps, size: Vec2, last: u32) {
    for first in (0..probes.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let [dxx, dxy, dyx, dyy] = load_steps(simd, steps, first);
        let (dxx, dxy) = (dxx * size.x, dxy * size.y);
        let (dyx, dyy) = (dyx * size.x, dyy * size.y);
        let (xx, yy) = (dxx * dxx + dxy * dxy, dyx * dyx + dyy * dyy);
        let (half_difference, xy) = ((xx - yy) * 0.5, dxx * dyx + dxy * dyy);
        let squared = (xx + yy) * 0.5 + (half_difference * half_difference + xy * xy).sqrt();
        // Comparisons with NaN are false.
        let one = S::f32s::splat(simd, 1.0);
        let is_wide = squared.simd_gt(one);
        let squared = is_wide.select(squared, one).min(f32::MAX);
        let lod = (log2_lanes::<S>(squared) * 0.5).min(last as f32);
        let fine = lod.to_int::<S::u32s>();
        fine.store_slice(&mut probes.fine.0[range.clone()]);
        (lod - fine.to_float::<S::f32s>()).store_slice(&mut probes.share.0[range]);
    }
}

/// [`log2`](super::log2) of many numbers, equal bit by bit.
#[inline(always)]
pub fn log2_lanes<S: Simd>(x: S::f32s) -> S::f32s {
    const MANTISSA: u32 = 0x007f_ffff;
    const OFFSET: f32 = SQRT_2 * 0.5;
    let bits = x.bitcast::<S::u32s>() - OFFSET.to_bits();
    let exponent = bits.bitcast::<S::i32s>() >> 23;
    let mantissa = ((bits & MANTISSA) + OFFSET.to_bits()).bitcast::<S::f32s>();
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let series = s2 * (1.0 / 7.0) + 1.0 / 5.0;
    let series = s2 * series + 1.0 / 3.0;
    let series = s2 * series + 1.0;
    exponent.to_float::<S::f32s>() + s * (2.0 / LN_2) * series
}

/// Two numbers of every look-up from `first` on, those of equal place together.
#[inline(always)]
fn load_two<S: Simd>(simd: S, points: &Block<[f32; 2]>, first: usize) -> (S::f32s, S::f32s) {
    let lanes = S::f32s::LEN;
    let numbers = &points.0.as_flattened()[2 * first..2 * (first + lanes)];
    S::f32s::from_slice(simd, &numbers[..lanes]).deinterleave(S::f32s::from_slice(simd, &numbers[lanes..]))
}

/// The four numbers of every footprint from `first` on.
#[inline(always)]
fn load_steps<S: Simd>(simd: S, steps: &Steps, first: usize) -> [S::f32s; 4] {
    let lanes = S::f32s::LEN;
    let numbers = &steps.0.0.as_flattened()[4 * first..4 * (first + lanes)];
    let part = |part: usize| S::f32s::from_slice(simd, &numbers[part * lanes..(part + 1) * lanes]);
    let ((even_low, odd_low), (even_high, odd_high)) =
        (part(0).deinterleave(part(1)), part(2).deinterleave(part(3)));
    let ((dxx, dyx), (dxy, dyy)) = (even_low.deinterleave(even_high), odd_low.deinterleave(odd_high));
    [dxx, dxy, dyx, dyy]
}

/// As the scalar `fold`.
#[inline(always)]
fn fold<S: Simd>(simd: S, coordinate: S::f32s, wrap: Wrap) -> S::f32s {
    match wrap {
        Wrap::Clamp | Wrap::Border => coordinate,
        Wrap::Repeat => {
            const NO_FRACTIONS: f32 = 12_582_912.0;
            let rest = coordinate - ((coordinate + NO_FRACTIONS) - NO_FRACTIONS);
            rest.simd_lt(S::f32s::splat(simd, 0.0)).select(rest + 1.0, rest)
        }
        Wrap::Mirror => {
            let period = coordinate - (coordinate * 0.5).floor() * 2.0;
            S::f32s::splat(simd, 1.0) - (S::f32s::splat(simd, 1.0) - period).abs()
        }
    }
}

/// Two by two texels per look-up, in one level each.
pub(super) struct Quads {
    pub(super) level: Block<u32>,
    /// Row-major offset of the upper left texel, [`NONE`] at the edges of the level; and of the one below it.
    pub(super) upper: Block<u32>,
    pub(super) lower: Block<u32>,
    /// Shares of the right and of the lower texels.
    pub(super) right_share: Block<f32>,
    pub(super) lower_share: Block<f32>,
}

impl Quads {
    pub(super) fn new() -> Self {
        let (no_share, no_index) = (Block::of(0.0), Block::of(0));
        Self {
            level: no_index,
            upper: no_index,
            lower: no_index,
            right_share: no_share,
            lower_share: no_share,
        }
    }
}

pub(super) const NONE: u32 = u32::MAX;

/// Positions in the finer level of every probe, or so many levels above, as `Quad::around`.
#[inline(always)]
fn locate<S: Simd>(
    simd: S,
    probes: &Probes,
    wrap: [Wrap; 2],
    levels: &Levels<'_>,
    above: u32,
    quads: &mut Quads,
) {
    let [width, height] = levels.size();
    let (one, none) = (S::u32s::splat(simd, 1), S::u32s::splat(simd, NONE));
    for first in (0..probes.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let fine = S::u32s::from_slice(simd, &probes.fine.0[range.clone()]);
        let level = (fine + above).min(levels.last());
        let width = (S::u32s::splat(simd, width) >> level).max(one);
        let height = (S::u32s::splat(simd, height) >> level).max(one);
        let (u, v) = load_two(simd, &probes.places, first);
        let (u, v) = (fold(simd, u, wrap[0]), fold(simd, v, wrap[1]));
        let (column, right) = split::<S>(u * width.to_float::<S::f32s>() - 0.5);
        let (row, lower) = split::<S>(v * height.to_float::<S::f32s>() - 0.5);
        let is_inside = column.simd_lt(width - 1) & row.simd_lt(height - 1);
        let upper = is_inside.select(row * width + column, none);
        level.store_slice(&mut quads.level.0[range.clone()]);
        upper.store_slice(&mut quads.upper.0[range.clone()]);
        is_inside.select(upper + width, none).store_slice(&mut quads.lower.0[range.clone()]);
        right.store_slice(&mut quads.right_share.0[range.clone()]);
        lower.store_slice(&mut quads.lower_share.0[range]);
    }
}

/// As the scalar `split`.
#[inline(always)]
fn split<S: Simd>(position: S::f32s) -> (S::u32s, S::f32s) {
    const INTEGERS: f32 = 8_388_608.0;
    let shifted = position - 0.5 + INTEGERS;
    (shifted.bitcast::<S::u32s>() - INTEGERS.to_bits(), position - (shifted - INTEGERS))
}
