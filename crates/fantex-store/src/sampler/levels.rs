//! The levels of many look-ups at once, in vectors: the steps of [`TileLookup`](super::TileLookup) in the same order, so the results are equal.

use fantex_cover::Group;
use fantex_texture::filter::{MAX_ANISOTROPY, log2_lanes};
use fantex_texture::{Filter, FilterOptions};
use fearless_simd::prelude::*;
use fearless_simd::{Select, Simd, dispatch};
use glam::Vec2;

use super::lookup::MAX_FOOTPRINT;
use crate::packing::level;

/// Look-ups of a block; a whole number of vectors.
pub(super) const BLOCK: usize = 64;

type Numbers = [f32; BLOCK];
type Counts = [u32; BLOCK];

/// Up to a block of look-ups in tiles, with what they are made of.
#[repr(align(64))]
pub(super) struct LevelBlock {
    count: usize,
    /// Of level 0.
    extent: [Counts; 2],
    last: Counts,
    /// Derivatives of tile coordinates: x and y of the first, then of the second.
    steps: [Numbers; 4],
    fine: Counts,
    fine_extent: [Counts; 2],
    coarse_extent: [Counts; 2],
    coarse_share: Numbers,
    probes: Counts,
    span: [Numbers; 2],
}

/// A look-up: two levels with bilinear probes in them.
pub(super) struct ChosenLevels {
    /// The finer level, and its columns and rows.
    pub(super) fine: u32,
    pub(super) fine_extent: [u32; 2],
    /// The columns and rows of the coarser one; none after the last. They are not chosen where its share is 0.
    pub(super) coarse_extent: Option<[u32; 2]>,
    pub(super) coarse_share: f32,
    /// Probes in each, and the way, in tile coordinates, that they are spread over.
    pub(super) probes: u32,
    pub(super) span: Vec2,
}

impl LevelBlock {
    pub(super) fn new() -> Self {
        let (no_counts, no_numbers) = ([0; BLOCK], [0.0; BLOCK]);
        Self {
            count: 0,
            extent: [no_counts; 2],
            last: no_counts,
            steps: [no_numbers; 4],
            fine: no_counts,
            fine_extent: [no_counts; 2],
            coarse_extent: [no_counts; 2],
            coarse_share: no_numbers,
            probes: [1; BLOCK],
            span: [no_numbers; 2],
        }
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    pub(super) fn is_full(&self) -> bool {
        self.count == BLOCK
    }

    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds a look-up in a group's tile with derivatives of tile coordinates per pixel; the block must have room for it.
    #[inline]
    pub(super) fn push(&mut self, group: &Group, steps: [Vec2; 2]) {
        let index = self.count;
        self.count += 1;
        [self.extent[0][index], self.extent[1][index]] = group.extent;
        self.last[index] = group.level_count() - 1;
        let [dx, dy] = steps;
        for (numbers, number) in self.steps.iter_mut().zip([dx.x, dx.y, dy.x, dy.y]) {
            numbers[index] = number;
        }
    }

    /// Chooses the levels of all look-ups, by a filter of bilinear probes.
    pub(super) fn choose(&mut self, options: &FilterOptions) {
        let max_anisotropy = options.max_anisotropy.clamp(1.0, MAX_ANISOTROPY);
        match options.filter {
            Filter::Trilinear => dispatch!(level(), simd => choose_levels::<_, false>(simd, self, 1.0)),
            Filter::Anisotropic => {
                dispatch!(level(), simd => choose_levels::<_, true>(simd, self, max_anisotropy));
                dispatch!(level(), simd => choose_probes(simd, self, max_anisotropy));
            }
            // Level 0 and one probe, as in a block without look-ups.
            _ => self.fine_extent = self.extent,
        }
    }

    #[inline]
    pub(super) fn chosen(&self, index: usize) -> ChosenLevels {
        let extent = |[columns, rows]: &[Counts; 2]| [columns[index], rows[index]];
        let fine = self.fine[index];
        ChosenLevels {
            fine,
            fine_extent: extent(&self.fine_extent),
            coarse_extent: (fine < self.last[index]).then(|| extent(&self.coarse_extent)),
            coarse_share: self.coarse_share[index],
            probes: self.probes[index],
            span: Vec2::new(self.span[0][index], self.span[1][index]),
        }
    }
}

// Closures are not compiled for the vectors' instruction set unless they are inlined, which the compiler declines: so each
// step is a function that must be.

#[inline(always)]
fn choose_levels<S: Simd, const IS_ANISOTROPIC: bool>(simd: S, block: &mut LevelBlock, max_anisotropy: f32) {
    let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    for first in (0..block.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let steps = load_steps(simd, block, first);
        let extent = load_extent(simd, block, first);
        let last = S::u32s::from_slice(simd, &block.last[range.clone()]);

        // Comparisons with NaN are false.
        let finest = squared_width::<S, IS_ANISOTROPIC>(simd, steps, extent, max_anisotropy);
        let is_wide = finest.simd_gt(one);
        let mut here = is_wide.select(finest, one);
        let exponent = (here.bitcast::<S::u32s>() >> 23) - 127;
        let guess = ((exponent >> 1).max(S::u32s::splat(simd, 1)) - 1).min(last);
        let there_extent = level_extent::<S>(simd, extent, guess);
        let there = squared_width::<S, IS_ANISOTROPIC>(simd, steps, there_extent, max_anisotropy);
        let is_beyond = there.simd_gt(one);
        let mut fine = is_beyond.select(guess, S::u32s::splat(simd, 0));
        here = is_beyond.select(there, here);
        let mut coarse_extent;
        let mut next;
        loop {
            coarse_extent = level_extent::<S>(simd, extent, fine + 1);
            let is_last = fine.simd_ge(last);
            let coarse = squared_width::<S, IS_ANISOTROPIC>(simd, steps, coarse_extent, max_anisotropy);
            next = is_last.select(here * (1.0 / 16.0), coarse);
            let goes_on = is_wide & !(is_last | next.simd_le(one));
            if !goes_on.any_true() {
                break;
            }
            fine = goes_on.select(fine + 1, fine);
            here = goes_on.select(next, here);
        }
        let share = (log2_lanes::<S>(here) / log2_lanes::<S>(here / next)).max(zero).min(one);
        let share = is_wide.select(share, zero);
        let fine_extent = level_extent::<S>(simd, extent, fine);

        fine.store_slice(&mut block.fine[range.clone()]);
        share.store_slice(&mut block.coarse_share[range.clone()]);
        let ([columns, rows], [coarse_columns, coarse_rows]) = (fine_extent, coarse_extent);
        columns.store_slice(&mut block.fine_extent[0][range.clone()]);
        rows.store_slice(&mut block.fine_extent[1][range.clone()]);
        coarse_columns.store_slice(&mut block.coarse_extent[0][range.clone()]);
        coarse_rows.store_slice(&mut block.coarse_extent[1][range]);
    }
}

/// How many probes, and the way that they are spread over: along the longer axis of the footprint in level 0.
#[inline(always)]
fn choose_probes<S: Simd>(simd: S, block: &mut LevelBlock, max_anisotropy: f32) {
    let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    for first in (0..block.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let [columns, rows] = load_extent(simd, block, first);
        let (columns, rows) = (columns.to_float::<S::f32s>(), rows.to_float::<S::f32s>());
        let [dxx, dxy, dyx, dyy] = load_steps(simd, block, first);
        let (dxx, dxy, dyx, dyy) = (dxx * columns, dxy * rows, dyx * columns, dyy * rows);

        // As `FootprintAxes::new`.
        let (xx, xy, yy) = (dxx * dxx + dyx * dyx, dxx * dxy + dyx * dyy, dxy * dxy + dyy * dyy);
        let half_difference = (xx - yy) * 0.5;
        let root = (half_difference * half_difference + xy * xy).sqrt();
        let is_across = half_difference.simd_ge(zero);
        let x = is_across.select(half_difference + root, xy);
        let y = is_across.select(xy, root - half_difference);
        let major = ((xx + yy) * 0.5 + root).sqrt();
        let minor = major.simd_gt(zero).select((dxx * dyy - dxy * dyx).abs() / major, zero);
        let reciprocal = one / (x * x + y * y).sqrt();
        let is_usable = reciprocal.simd_gt(zero) & reciprocal.simd_lt(S::f32s::splat(simd, f32::INFINITY));
        let (x, y) = (is_usable.select(x * reciprocal, one), is_usable.select(y * reciprocal, zero));

        let width = minor.max(major / max_anisotropy).max(one);
        let probes = (major / width).ceil().max(one).min(MAX_ANISOTROPY);
        probes.to_int::<S::u32s>().store_slice(&mut block.probes[range.clone()]);
        (x * major / columns).store_slice(&mut block.span[0][range.clone()]);
        (y * major / rows).store_slice(&mut block.span[1][range]);
    }
}

/// The square of the pixel's width in texels, as `squared_major` and `squared_minor`.
#[inline(always)]
fn squared_width<S: Simd, const IS_ANISOTROPIC: bool>(
    simd: S,
    [dxx, dxy, dyx, dyy]: [S::f32s; 4],
    [columns, rows]: [S::u32s; 2],
    max_anisotropy: f32,
) -> S::f32s {
    let (columns, rows) = (columns.to_float::<S::f32s>(), rows.to_float::<S::f32s>());
    let (dxx, dxy, dyx, dyy) = (dxx * columns, dxy * rows, dyx * columns, dyy * rows);
    let (xx, yy) = (dxx * dxx + dxy * dxy, dyx * dyx + dyy * dyy);
    let (half_difference, xy) = ((xx - yy) * 0.5, dxx * dyx + dxy * dyy);
    let major = (xx + yy) * 0.5 + (half_difference * half_difference + xy * xy).sqrt();
    if !IS_ANISOTROPIC {
        return major;
    }
    let zero = S::f32s::splat(simd, 0.0);
    let determinant = dxx * dyy - dxy * dyx;
    let minor = major.simd_gt(zero).select(determinant * determinant / major, zero);
    minor.max(major / (max_anisotropy * max_anisotropy))
}

/// As [`fantex_cover::level_extent`]; sides have at most 65536 texels.
#[inline(always)]
fn level_extent<S: Simd>(simd: S, extent: [S::u32s; 2], level: S::u32s) -> [S::u32s; 2] {
    [level_length::<S>(simd, extent[0], level), level_length::<S>(simd, extent[1], level)]
}

#[inline(always)]
fn level_length<S: Simd>(simd: S, length: S::u32s, level: S::u32s) -> S::u32s {
    let quarters = (length + (S::u32s::splat(simd, 2) << level)) >> (level + 2);
    quarters.max(S::u32s::splat(simd, 1)) << 2
}

#[inline(always)]
fn load_extent<S: Simd>(simd: S, block: &LevelBlock, first: usize) -> [S::u32s; 2] {
    let range = first..first + S::f32s::LEN;
    [
        S::u32s::from_slice(simd, &block.extent[0][range.clone()]),
        S::u32s::from_slice(simd, &block.extent[1][range]),
    ]
}

/// The derivatives, as `bounded`.
#[inline(always)]
fn load_steps<S: Simd>(simd: S, block: &LevelBlock, first: usize) -> [S::f32s; 4] {
    let mut steps = [S::f32s::splat(simd, 0.0); 4];
    for (step, numbers) in steps.iter_mut().zip(&block.steps) {
        let number = S::f32s::from_slice(simd, &numbers[first..first + S::f32s::LEN]);
        // NaN is not equal to itself.
        let number = number.simd_eq(number).select(number, *step);
        *step = number.max(-MAX_FOOTPRINT).min(MAX_FOOTPRINT);
    }
    steps
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;
    use fantex_cover::{Frame, GroupKind};
    use glam::Vec3;

    use super::super::TileLookup;
    use super::*;

    fn group(extent: [u32; 2]) -> Group {
        let frame = Frame { origin: Vec3::ZERO, direction: Vec3::Z, x_axis: Vec3::X };
        let kind = GroupKind::Projected;
        Group { kind, frame, uv_scale: Vec2::ONE, uv_offset: Vec2::ZERO, extent }
    }

    #[test]
    fn vectors_and_single_look_ups_choose_equal_levels() {
        let mut random = Random::new(3);
        let mut unit = || random.unit() as f32;
        for _ in 0..200 {
            let look_ups: Vec<_> = (0..BLOCK)
                .map(|index| {
                    let mut side = || 4 * ((unit() * 14.0).exp2() as u32).max(1);
                    let extent = [side(), side()];
                    let mut step = || {
                        let size = (unit() * 40.0 - 24.0).exp2();
                        Vec2::new(unit() * 2.0 - 1.0, unit() * 2.0 - 1.0) * size
                    };
                    let steps = match index {
                        0 => [Vec2::ZERO; 2],
                        1 => [Vec2::NAN, step()],
                        2 => [Vec2::splat(f32::INFINITY), step()],
                        3 => [Vec2::X, Vec2::X],
                        _ => [step(), step()],
                    };
                    (group(extent), steps)
                })
                .collect();
            for filter in [Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic] {
                let options = FilterOptions { filter, ..FilterOptions::default() };
                let mut block = LevelBlock::new();
                look_ups.iter().for_each(|(group, steps)| block.push(group, *steps));
                block.choose(&options);
                for (index, (group, steps)) in look_ups.iter().enumerate() {
                    let expected = TileLookup::new(0, group, Vec2::ZERO, *steps, &options);
                    let chosen = block.chosen(index);
                    let seen = (chosen.fine, chosen.coarse_share);
                    assert_eq!(seen, expected.levels(), "{filter:?}: {group:?}, {steps:?}");
                    let seen = (chosen.probes, chosen.span);
                    assert_eq!(seen, (expected.probes, expected.span), "{filter:?}: {group:?}, {steps:?}");
                    assert_eq!(chosen.fine_extent, group.level_extent(chosen.fine));
                    if chosen.coarse_share > 0.0 {
                        let has_coarse = chosen.fine + 1 < group.level_count();
                        let coarse_extent = has_coarse.then(|| group.level_extent(chosen.fine + 1));
                        assert_eq!(chosen.coarse_extent, coarse_extent);
                    }
                }
            }
        }
    }
}
