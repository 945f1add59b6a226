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
use std::sync::LazyLock;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Select, Simd, dispatch};
use glam::Vec2;

use super::batch_texels::{
    Levels, Meaning, Pairs, UNIT, blend, mix, mix_texels, store_rgba, store_texels, weigh, widen,
};
use crate::{AlphaUse, Wrap};

/// Look-ups of a block: enough that no step waits for the one before, few enough that all arrays stay in the first cache.
pub(crate) const BLOCK: usize = 64;

pub(super) fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}

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
        dispatch!(level(), simd => choose_levels(simd, self, steps, size, last as u32));
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
        dispatch!(level(), simd => sums_of_channels(simd, self, probes, workspace, out))
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

// ---- Bilinear look-ups in many small images at once, each in its own: the tiles of a cover.
//
// The steps are those of look-ups in one image. Positions are held half a texel inside the grid, so that none needs another
// path at its edges, and are worked out once for grids of equal extent that hold different things.

/// Look-ups that are made at once.
pub const GRID_LOOK_UPS: usize = BLOCK;

/// Texels of a rectangle as they are stored, row-major.
#[derive(Clone, Copy, Debug)]
pub enum TexelGrid<'a> {
    /// Red, green, blue and alpha.
    Rgba8 {
        /// One each.
        texels: &'a [[u8; 4]],
        /// Whether the colours, though not alpha, are encoded in sRGB.
        is_srgb: bool,
    },
    /// Red and green; blue is 0, alpha 1.
    Rg16 {
        /// One each: numerators.
        texels: &'a [[u16; 2]],
        /// The denominator.
        one: u16,
    },
}

/// Up to [`GRID_LOOK_UPS`] places, each in a grid of its own.
pub struct GridLookUps {
    x: Block<f32>,
    y: Block<f32>,
    columns: Block<u32>,
    rows: Block<u32>,
    count: usize,
    quads: Quads,
    pairs: Pairs,
    colors: Colors,
}

impl std::fmt::Debug for GridLookUps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GridLookUps").field("count", &self.count).finish_non_exhaustive()
    }
}

impl Default for GridLookUps {
    fn default() -> Self {
        let (no_number, no_index) = (Block::of(0.0), Block::of(0));
        Self {
            x: no_number,
            y: no_number,
            columns: no_index,
            rows: no_index,
            count: 0,
            quads: Quads::new(),
            pairs: Pairs::new(),
            colors: Colors::black(),
        }
    }
}

impl GridLookUps {
    /// Other places: in texels from the grid's corner (texel `i` has its centre at `i + 1/2`), with its columns and rows.
    ///
    /// # Panics
    /// If there are more than [`GRID_LOOK_UPS`].
    pub fn place(&mut self, places: impl ExactSizeIterator<Item = (Vec2, [u32; 2])>) {
        assert!(places.len() <= GRID_LOOK_UPS, "{} places at once", places.len());
        self.count = places.len();
        for (index, (place, [columns, rows])) in places.enumerate() {
            (self.x.0[index], self.y.0[index]) = (place.x, place.y);
            (self.columns.0[index], self.rows.0[index]) = (columns, rows);
        }
        dispatch!(level(), simd => locate_in_grids(simd, self));
    }

    /// Looks up linear RGBA at all places, of which number `i` lies in `grid(i)`. `missing(i)` is asked where there is none, or
    /// one of another kind than the first, or with too few texels.
    pub fn sample<'a>(
        &mut self,
        grid: impl Fn(usize) -> Option<TexelGrid<'a>>,
        missing: impl Fn(usize) -> [f32; 4],
    ) -> &[[f32; 4]] {
        let count = self.count;
        let kind = (0..count).find_map(&grid);
        let mut missed = Vec::new();
        match kind {
            None => missed.extend(0..count),
            Some(TexelGrid::Rgba8 { is_srgb, .. }) => {
                for index in 0..count {
                    let pair = match grid(index) {
                        Some(TexelGrid::Rgba8 { texels, is_srgb: own }) if own == is_srgb => {
                            self.quads.read_two(texels, index)
                        }
                        _ => None,
                    };
                    if pair.is_none() {
                        missed.push(index);
                    }
                    let [upper, lower] = pair.unwrap_or_default().map(word_of_bytes);
                    (self.pairs.upper_bytes.0[index], self.pairs.lower_bytes.0[index]) = (upper, lower);
                }
                dispatch!(level(), simd => colors_of_bytes(simd, self, is_srgb));
            }
            Some(TexelGrid::Rg16 { one, .. }) => {
                for index in 0..count {
                    let pair = match grid(index) {
                        Some(TexelGrid::Rg16 { texels, one: own }) if own == one => {
                            self.quads.read_two(texels, index)
                        }
                        _ => None,
                    };
                    if pair.is_none() {
                        missed.push(index);
                    }
                    let [upper, lower] = pair.unwrap_or_default().map(word_of_numbers);
                    (self.pairs.upper.0[index], self.pairs.lower.0[index]) = ([upper, 0], [lower, 0]);
                }
                dispatch!(level(), simd => colors_of_numbers(simd, self, one));
            }
        }
        for index in missed {
            self.colors.0[index] = missing(index);
        }
        &self.colors.0[..count]
    }
}

impl Quads {
    /// Two neighbouring texels each from the upper left and from the lower left one on.
    #[inline(always)]
    fn read_two<T: Copy>(&self, texels: &[T], index: usize) -> Option<[[T; 2]; 2]> {
        let two = |first: u32| {
            let first = first as usize;
            texels.get(first..first + 2)?.first_chunk::<2>().copied()
        };
        Some([two(self.upper.0[index])?, two(self.lower.0[index])?])
    }
}

#[inline(always)]
fn word_of_bytes([[a, b, c, d], [e, f, g, h]]: [[u8; 4]; 2]) -> u64 {
    u64::from_le_bytes([a, b, c, d, e, f, g, h])
}

#[inline(always)]
fn word_of_numbers(texels: [[u16; 2]; 2]) -> u64 {
    let [[a, b], [c, d]] = texels.map(|texel| texel.map(u64::from));
    a | b << 16 | c << 32 | d << 48
}

#[inline(always)]
fn locate_in_grids<S: Simd>(simd: S, look_ups: &mut GridLookUps) {
    for first in (0..look_ups.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let columns = S::u32s::from_slice(simd, &look_ups.columns.0[range.clone()]);
        let rows = S::u32s::from_slice(simd, &look_ups.rows.0[range.clone()]);
        let x = S::f32s::from_slice(simd, &look_ups.x.0[range.clone()]);
        let y = S::f32s::from_slice(simd, &look_ups.y.0[range.clone()]);
        let (column, right) = split_within(simd, x, columns);
        let (row, lower) = split_within(simd, y, rows);
        let upper = row * columns + column;
        upper.store_slice(&mut look_ups.quads.upper.0[range.clone()]);
        (upper + columns).store_slice(&mut look_ups.quads.lower.0[range.clone()]);
        right.store_slice(&mut look_ups.quads.right_share.0[range.clone()]);
        lower.store_slice(&mut look_ups.quads.lower_share.0[range]);
    }
}

/// The first of two texels around a place, and the share of the second; at the end of the axis the second counts alone.
#[inline(always)]
fn split_within<S: Simd>(simd: S, place: S::f32s, texels: S::u32s) -> (S::u32s, S::f32s) {
    let zero = S::f32s::splat(simd, 0.0);
    let length = texels.to_float::<S::f32s>();
    let position = place - 0.5;
    // NaN reads as 0.
    let position = position.simd_gt(zero).select(position, zero).min(length - 1.0);
    let first = position.to_int::<S::u32s>().min(texels - 2);
    (first, position - first.to_float::<S::f32s>())
}

#[inline(always)]
fn colors_of_bytes<S: Simd>(simd: S, look_ups: &mut GridLookUps, is_srgb: bool) {
    let GridLookUps { quads, pairs, colors, count, .. } = look_ups;
    let meaning = Meaning { is_srgb, has_alpha: true };
    widen(simd, &pairs.upper_bytes, meaning, &mut pairs.upper, *count);
    widen(simd, &pairs.lower_bytes, meaning, &mut pairs.lower, *count);
    for first in (0..*count).step_by(S::f32s::LEN) {
        let value = blend::<S, 4>(simd, quads, pairs, false, first);
        store_rgba::<S, 4>(simd, value, colors, first);
    }
}

#[inline(always)]
fn colors_of_numbers<S: Simd>(simd: S, look_ups: &mut GridLookUps, one: u16) {
    let GridLookUps { quads, pairs, colors, count, .. } = look_ups;
    let factor = 1.0 / (UNIT * f32::from(one));
    for first in (0..*count).step_by(S::f32s::LEN) {
        let [red, green, ..] = blend::<S, 2>(simd, quads, pairs, false, first);
        let [blue, alpha] = [0.0, 1.0 / UNIT].map(|number| S::f32s::splat(simd, number));
        store_rgba::<S, 4>(simd, [red * factor, green * factor, blue, alpha], colors, first);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::color::{linear_from_srgb8_table, unit_from_u8_table};

    /// Texels of a small grid, all different.
    fn bytes(extent: [u32; 2], seed: u32) -> Vec<[u8; 4]> {
        (0..extent[0] * extent[1]).map(|i| (i + seed).wrapping_mul(2_654_435_761).to_le_bytes()).collect()
    }

    fn linear([r, g, b, a]: [u8; 4], is_srgb: bool) -> [f32; 4] {
        let color = if is_srgb { linear_from_srgb8_table() } else { unit_from_u8_table() };
        let [r, g, b] = [r, g, b].map(|c| color[usize::from(c)]);
        [r, g, b, unit_from_u8_table()[usize::from(a)]]
    }

    /// One by one.
    fn expected(extent: [u32; 2], uv: Vec2, texel: impl Fn(usize) -> [f32; 4]) -> [f32; 4] {
        let axis = |coordinate: f32, n: u32| {
            let position = (coordinate * n as f32 - 0.5).max(0.0).min((n - 1) as f32);
            let first = position as u32;
            (first, (first + 1).min(n - 1), position - first as f32)
        };
        let ((x0, x1, x), (y0, y1, y)) = (axis(uv.x, extent[0]), axis(uv.y, extent[1]));
        let at = |x: u32, y: u32| texel((y * extent[0] + x) as usize);
        let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
        std::array::from_fn(|k| {
            let (top, bottom) = (a[k] + x * (b[k] - a[k]), c[k] + x * (d[k] - c[k]));
            top + y * (bottom - top)
        })
    }

    fn differ(a: &[f32; 4], b: &[f32; 4]) -> bool {
        a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-5)
    }

    proptest! {
        #[test]
        fn grids_and_single_texels_agree(
            places in prop::collection::vec(([1u32..9, 1u32..9], -0.2f32..1.2, -0.2f32..1.2), 1..GRID_LOOK_UPS),
            is_srgb in any::<bool>(),
        ) {
            let extents: Vec<[u32; 2]> = places.iter().map(|(extent, ..)| extent.map(|n| 4 * n)).collect();
            let uvs: Vec<Vec2> = places.iter().map(|&(_, u, v)| Vec2::new(u, v)).collect();
            let mut look_ups = GridLookUps::default();
            let texels = |(&uv, &extent): (&Vec2, &[u32; 2])| (uv * Vec2::from(extent.map(|n| n as f32)), extent);
            look_ups.place(uvs.iter().zip(&extents).map(texels));

            let stored: Vec<_> = extents.iter().zip(0..).map(|(&extent, seed)| bytes(extent, seed)).collect();
            let seen = look_ups.sample(
                |i| Some(TexelGrid::Rgba8 { texels: &stored[i], is_srgb }),
                |_| panic!("every place has texels"),
            );
            for (i, seen) in seen.iter().enumerate() {
                let expected = expected(extents[i], uvs[i], |texel| linear(stored[i][texel], is_srgb));
                prop_assert!(!differ(seen, &expected), "{seen:?} {expected:?}");
            }

            let numbers = |texel: &[u8; 4]| [texel[0], texel[1]].map(|byte| u16::from(byte) * 35);
            let stored: Vec<Vec<_>> = stored.iter().map(|s| s.iter().map(numbers).collect()).collect();
            let seen = look_ups.sample(
                |i| Some(TexelGrid::Rg16 { texels: &stored[i], one: 8925 }),
                |_| panic!("every place has texels"),
            );
            for (i, seen) in seen.iter().enumerate() {
                let texel = |texel: usize| {
                    let [r, g] = stored[i][texel].map(|number: u16| f32::from(number) / 8925.0);
                    [r, g, 0.0, 1.0]
                };
                let expected = expected(extents[i], uvs[i], texel);
                prop_assert!(!differ(seen, &expected), "{seen:?} {expected:?}");
            }
        }
    }

    #[test]
    fn what_has_no_texels_is_asked_for() {
        let stored = bytes([4, 4], 0);
        let mut look_ups = GridLookUps::default();
        look_ups.place([(Vec2::splat(2.0), [4, 4]); 3].into_iter());
        let grid =
            |i: usize| (i != 1).then_some(TexelGrid::Rgba8 { texels: &stored[..8 + 4 * i], is_srgb: false });
        let seen = look_ups.sample(grid, |i| [i as f32; 4]).to_vec();
        assert_eq!((seen[0], seen[1]), ([0.0; 4], [1.0; 4]), "too few texels, no texels");
        look_ups.place([(Vec2::NAN, [4, 4])].into_iter());
        let first =
            look_ups.sample(|_| Some(TexelGrid::Rgba8 { texels: &stored, is_srgb: false }), |_| [9.0; 4]);
        assert!(!differ(&first[0], &linear(stored[0], false)), "NaN reads as the first texel");
    }
}
