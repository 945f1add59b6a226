//! The levels of many look-ups at once, in vectors: the steps of [`TileLookup`](super::TileLookup) in the same order, so the results are equal.

use fantex_base::vector_level;
use fantex_cover::Group;
use fantex_texture::filter::{GRID_LOOK_UPS, GridPlaces, MAX_ANISOTROPY, log2_lanes};
use fantex_texture::{Filter, FilterOptions};
use fearless_simd::prelude::*;
use fearless_simd::{Select, Simd, dispatch};
use glam::Vec2;

use super::lookup::MAX_FOOTPRINT;
use crate::{PAGE, TileId};

/// Look-ups of a block; a whole number of vectors.
pub(super) const BLOCK: usize = GRID_LOOK_UPS;

type Numbers = [f32; BLOCK];
type Counts = [u32; BLOCK];

/// Up to a block of look-ups in tiles, with what they are made of.
#[repr(align(64))]
pub(super) struct LevelBlock {
    count: usize,
    /// Index of the tile's group.
    group: Counts,
    /// Of level 0.
    extent: [Counts; 2],
    last: Counts,
    /// Tile coordinates.
    uv: [Numbers; 2],
    /// Their derivatives: x and y of the first, then of the second.
    steps: [Numbers; 4],
    /// The finer level, its columns and rows, those of the coarser one, and that one's share.
    fine: Counts,
    fine_extent: [Counts; 2],
    coarse_extent: [Counts; 2],
    coarse_share: Numbers,
    /// Probes in each, and the way, in tile coordinates, that they are spread over.
    probes: Counts,
    span: [Numbers; 2],
    /// Tile coordinates of the probes that were placed last, and the page that their texels lie in: row and column of it in 16 bits each.
    probe_uv: [Numbers; 2],
    page: Counts,
}

/// No page: texels on both sides of a border of pages.
const ACROSS: u32 = u32::MAX;

/// One of the two levels of a look-up.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Depth {
    Fine,
    Coarse,
}

impl Default for LevelBlock {
    fn default() -> Self {
        let (no_counts, no_numbers) = ([0; BLOCK], [0.0; BLOCK]);
        Self {
            count: 0,
            group: no_counts,
            extent: [no_counts; 2],
            last: no_counts,
            uv: [no_numbers; 2],
            steps: [no_numbers; 4],
            fine: no_counts,
            fine_extent: [no_counts; 2],
            coarse_extent: [no_counts; 2],
            coarse_share: no_numbers,
            probes: [1; BLOCK],
            span: [no_numbers; 2],
            probe_uv: [no_numbers; 2],
            page: no_counts,
        }
    }
}

impl LevelBlock {
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
    pub(super) fn push(&mut self, index: u32, group: &Group, uv: Vec2, [dx, dy]: [Vec2; 2]) {
        let place = self.count;
        self.count += 1;
        self.group[place] = index;
        [self.extent[0][place], self.extent[1][place]] = group.extent;
        self.last[place] = group.level_count() - 1;
        (self.uv[0][place], self.uv[1][place]) = (uv.x, uv.y);
        (self.steps[0][place], self.steps[1][place]) = (dx.x, dx.y);
        (self.steps[2][place], self.steps[3][place]) = (dy.x, dy.y);
    }

    /// Chooses the levels of all look-ups, by a filter of bilinear probes.
    pub(super) fn choose(&mut self, options: &FilterOptions) {
        let max_anisotropy = options.max_anisotropy.clamp(1.0, MAX_ANISOTROPY);
        match options.filter {
            Filter::Trilinear => {
                dispatch!(vector_level(), simd => choose_levels::<_, false>(simd, self, 1.0))
            }
            Filter::Anisotropic => {
                dispatch!(vector_level(), simd => choose_levels::<_, true>(simd, self, max_anisotropy));
                dispatch!(vector_level(), simd => choose_probes(simd, self, max_anisotropy));
                return;
            }
            _ => {
                self.fine_extent = self.extent;
                (self.fine, self.coarse_share) = ([0; BLOCK], [0.0; BLOCK]);
            }
        }
        self.probes = [1; BLOCK];
    }

    /// The most probes that a look-up has.
    pub(super) fn max_probes(&self) -> u32 {
        self.probes[..self.count].iter().fold(0, |most, &probes| most.max(probes))
    }

    /// Where the probes of this number lie in pages, or across their borders in levels, with their shares of the values: none where look-ups
    /// have fewer probes, or nothing of the level.
    pub(super) fn place(&mut self, depth: Depth, number: u32, places: &mut GridPlaces) {
        places.count = self.count;
        match depth {
            Depth::Fine => dispatch!(vector_level(), simd => place::<_, false>(simd, self, number, places)),
            Depth::Coarse => dispatch!(vector_level(), simd => place::<_, true>(simd, self, number, places)),
        }
    }

    /// A look-up's tile at a level, and the level's columns and rows.
    #[inline]
    pub(super) fn tile(&self, depth: Depth, index: usize) -> (TileId, [u32; 2]) {
        let (level, [columns, rows]) = match depth {
            Depth::Fine => (self.fine[index], &self.fine_extent),
            Depth::Coarse => (self.fine[index] + 1, &self.coarse_extent),
        };
        (TileId { group: self.group[index], level }, [columns[index], rows[index]])
    }

    /// A look-up's group.
    #[inline]
    pub(super) fn group(&self, index: usize) -> u32 {
        self.group[index]
    }

    /// The share of its group's mean, which comes after the last level, in a look-up.
    #[inline]
    pub(super) fn mean_share(&self, index: usize) -> f32 {
        if self.fine[index] < self.last[index] { 0.0 } else { self.coarse_share[index] }
    }

    /// Column and row of the page that a probe lies in that was placed last; none across the border of pages.
    #[inline]
    pub(super) fn page(&self, index: usize) -> Option<[u32; 2]> {
        let page = self.page[index];
        (page != ACROSS).then_some([page & 0xffff, page >> 16])
    }

    /// Tile coordinates of a probe that was placed last.
    #[inline]
    pub(super) fn probe_uv(&self, index: usize) -> Vec2 {
        Vec2::new(self.probe_uv[0][index], self.probe_uv[1][index])
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

/// As `TileLookup::probe`, in texels, with each probe's share.
#[inline(always)]
fn place<S: Simd, const IS_COARSE: bool>(
    simd: S,
    block: &mut LevelBlock,
    number: u32,
    places: &mut GridPlaces,
) {
    let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    for first in (0..block.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let [columns, rows] = if IS_COARSE { &block.coarse_extent } else { &block.fine_extent };
        let columns = S::u32s::from_slice(simd, &columns[range.clone()]);
        let rows = S::u32s::from_slice(simd, &rows[range.clone()]);
        let probes = S::u32s::from_slice(simd, &block.probes[range.clone()]);
        let (count, is_one) = (probes.to_float::<S::f32s>(), probes.simd_le(S::u32s::splat(simd, 1)));

        let share = S::f32s::from_slice(simd, &block.coarse_share[range.clone()]);
        let fine = S::u32s::from_slice(simd, &block.fine[range.clone()]);
        let is_last = fine.simd_ge(S::u32s::from_slice(simd, &block.last[range.clone()]));
        let share = if IS_COARSE { is_last.select(zero, share) } else { one - share };
        let is_there = probes.simd_gt(S::u32s::splat(simd, number));
        is_there.select(share / count, zero).store_slice(&mut places.share[range.clone()]);

        let along = S::f32s::splat(simd, number as f32 + 0.5) / count - 0.5;
        let mut texels = [columns.to_float::<S::f32s>(), rows.to_float::<S::f32s>()];
        for (axis, texels) in texels.iter_mut().enumerate() {
            let middle = S::f32s::from_slice(simd, &block.uv[axis][range.clone()]);
            let span = S::f32s::from_slice(simd, &block.span[axis][range.clone()]);
            let uv = is_one.select(middle, middle + span * along);
            uv.store_slice(&mut block.probe_uv[axis][range.clone()]);
            *texels = uv * *texels;
        }
        let (column, is_across_columns) = page_along(simd, texels[0], columns);
        let (row, is_across_rows) = page_along(simd, texels[1], rows);
        let is_across = is_across_columns | is_across_rows;
        let none = S::u32s::splat(simd, 0);
        let (left, top) = (is_across.select(none, column * PAGE), is_across.select(none, row * PAGE));
        let page = is_across.select(S::u32s::splat(simd, ACROSS), (row << 16) | column);
        page.store_slice(&mut block.page[range.clone()]);
        (texels[0] - left.to_float::<S::f32s>()).store_slice(&mut places.x[range.clone()]);
        (texels[1] - top.to_float::<S::f32s>()).store_slice(&mut places.y[range.clone()]);
        let most = is_across.select(S::u32s::splat(simd, u32::MAX), S::u32s::splat(simd, PAGE));
        (columns - left).min(most).store_slice(&mut places.columns[range.clone()]);
        (rows - top).min(most).store_slice(&mut places.rows[range]);
    }
}

/// The page along an axis that the two texels around a place lie in, and whether they lie in two.
#[inline(always)]
fn page_along<S: Simd>(simd: S, place: S::f32s, texels: S::u32s) -> (S::u32s, S::mask32s) {
    let zero = S::f32s::splat(simd, 0.0);
    let last = texels - 1;
    let position = place - 0.5;
    // NaN reads as 0.
    let position = position.simd_gt(zero).select(position, zero).min(last.to_float::<S::f32s>());
    let first = position.to_int::<S::u32s>();
    let page = first >> PAGE.ilog2();
    (page, !((first + 1).min(last) >> PAGE.ilog2()).simd_eq(page))
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
    use crate::cache::TexelQuad;
    use crate::{page_extent, page_origin};

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
                let mut block = LevelBlock::default();
                look_ups.iter().for_each(|(group, steps)| block.push(0, group, Vec2::ZERO, *steps));
                block.choose(&options);
                for (index, (group, steps)) in look_ups.iter().enumerate() {
                    let expected = TileLookup::new(0, group, Vec2::ZERO, *steps, &options);
                    let seen = (block.fine[index], block.coarse_share[index]);
                    assert_eq!(seen, expected.levels(), "{filter:?}: {group:?}, {steps:?}");
                    let seen = (block.probes[index], Vec2::from(block.span.map(|axis| axis[index])));
                    assert_eq!(seen, (expected.probes, expected.span), "{filter:?}: {group:?}, {steps:?}");
                    let tile = |depth| {
                        let (TileId { level, .. }, extent) = block.tile(depth, index);
                        (level, extent)
                    };
                    let fine = block.fine[index];
                    assert_eq!(tile(Depth::Fine), (fine, group.level_extent(fine)));
                    let is_last = fine + 1 == group.level_count();
                    if block.coarse_share[index] > 0.0 && !is_last {
                        assert_eq!(tile(Depth::Coarse), (fine + 1, group.level_extent(fine + 1)));
                    }
                    let expected = if is_last { block.coarse_share[index] } else { 0.0 };
                    assert_eq!(block.mean_share(index), expected);
                }
            }
        }
    }
    #[test]
    fn vectors_and_single_look_ups_place_probes_alike() {
        let mut random = Random::new(4);
        let mut block = LevelBlock::default();
        for filter in [Filter::Anisotropic, Filter::Trilinear, Filter::Bilinear] {
            let options = FilterOptions { filter, ..FilterOptions::default() };
            let mut unit = || random.unit() as f32;
            let look_ups: Vec<_> = (0..BLOCK)
                .map(|index| {
                    let size = (unit() * 8.0 - 12.0).exp2();
                    let steps = [Vec2::new(unit(), unit()) * size, Vec2::new(unit(), -unit()) * size];
                    (group([4 + 20 * index as u32, 128]), Vec2::new(unit(), unit()), steps)
                })
                .collect();
            block.clear();
            for (index, (group, uv, steps)) in look_ups.iter().enumerate() {
                block.push(index as u32, group, *uv, *steps);
            }
            block.choose(&options);
            let mut places = GridPlaces::default();
            for (depth, number) in
                [Depth::Fine, Depth::Coarse].into_iter().flat_map(|d| [0, 1, 2, 9].map(|n| (d, n)))
            {
                block.place(depth, number, &mut places);
                for (index, (group, uv, steps)) in look_ups.iter().enumerate() {
                    let look_up = TileLookup::new(0, group, *uv, *steps, &options);
                    let (fine, coarse) = look_up.levels();
                    let share = match depth {
                        _ if number >= look_up.probes => 0.0,
                        Depth::Fine => 1.0 - coarse,
                        Depth::Coarse if fine + 1 == group.level_count() => 0.0,
                        Depth::Coarse => coarse,
                    };
                    assert_eq!(places.share[index], share / look_up.probes as f32);
                    if share > 0.0 {
                        let (tile, extent) = block.tile(depth, index);
                        let uv = look_up.probe(number);
                        assert_eq!(
                            tile,
                            TileId { group: index as u32, level: fine + (depth == Depth::Coarse) as u32 }
                        );
                        assert_eq!(block.probe_uv(index), uv);
                        let page = TexelQuad::new(uv, extent).in_one_page().0;
                        assert_eq!(block.page(index), page);
                        let corner = page_origin(page.unwrap_or_default()).map(|n| n as f32);
                        let place = uv * Vec2::from(extent.map(|n| n as f32)) - Vec2::from(corner);
                        assert_eq!([places.x[index], places.y[index]], place.to_array());
                        let extent = page.map_or(extent, |page| page_extent(extent, page));
                        assert_eq!([places.columns[index], places.rows[index]], extent);
                    }
                }
            }
        }
    }
}
