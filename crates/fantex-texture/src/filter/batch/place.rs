//! Which levels, and where in them.

use std::f32::consts::{LN_2, SQRT_2};

use fearless_simd::{Select, Simd, prelude::*};
use glam::Vec2;

use super::texels::Levels;
use super::{Block, Probes, Steps};
use crate::Wrap;

// Closures are not compiled for the vectors' instruction set unless they are inlined, which the compiler declines: so each
// step is a function that must be.

/// As `FootprintAxes::squared_major` and `LevelPair::for_squared_width`.
#[inline(always)]
pub(super) fn choose_levels<S: Simd>(simd: S, probes: &mut Probes, steps: &Steps, size: Vec2, last: u32) {
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
        let lod = (log2::<S>(squared) * 0.5).min(last as f32);
        let fine = lod.to_int::<S::u32s>();
        fine.store_slice(&mut probes.fine.0[range.clone()]);
        (lod - fine.to_float::<S::f32s>()).store_slice(&mut probes.share.0[range]);
    }
}

/// As the scalar `log2`.
#[inline(always)]
fn log2<S: Simd>(x: S::f32s) -> S::f32s {
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
    /// The level.
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

/// No offset.
pub(super) const NONE: u32 = u32::MAX;

/// Positions in the finer level of every probe, or so many levels above, as `Quad::around`.
#[inline(always)]
pub(super) fn locate<S: Simd>(
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
