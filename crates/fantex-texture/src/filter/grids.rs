//! Bilinear look-ups in many small images at once, each in its own: the tiles of a cover.
//!
//! The steps are those of look-ups in one image (`batch.rs`). Positions are held half a texel inside the grid, so that none needs
//! another path at its edges, and are worked out once for grids of equal extent that hold different things. What is looked up is
//! weighted and added to sums, as several look-ups make a value.

use fantex_base::{bits, vector_level};
use fearless_simd::prelude::*;
use fearless_simd::{Select, Simd, dispatch};

use super::batch::{BLOCK, Block, Quads};
use super::batch_texels::{Meaning, Pairs, UNIT, blend_words, widen_four};

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

/// Where look-ups are made, in vectors.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub struct GridPlaces {
    /// Texels from the grid's upper left corner to the right (texel `i` has its centre at `i + 1/2`).
    pub x: [f32; GRID_LOOK_UPS],
    /// The same downwards.
    pub y: [f32; GRID_LOOK_UPS],
    /// Texels of a row of the grid.
    pub columns: [u32; GRID_LOOK_UPS],
    /// Texels of a column.
    pub rows: [u32; GRID_LOOK_UPS],
    /// What the looked-up colour is multiplied by; where this is 0, nothing is looked up.
    pub share: [f32; GRID_LOOK_UPS],
    /// Which grid it is: look-ups in one grid have one number.
    pub grid: [u32; GRID_LOOK_UPS],
    /// How many look-ups there are.
    pub count: usize,
}

impl Default for GridPlaces {
    fn default() -> Self {
        let (numbers, counts) = ([0.0; GRID_LOOK_UPS], [0; GRID_LOOK_UPS]);
        Self { x: numbers, y: numbers, columns: counts, rows: counts, share: numbers, grid: counts, count: 0 }
    }
}

/// Linear red, green, blue and alpha of as many values as look-ups are made at once.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub struct ColorSums([[f32; GRID_LOOK_UPS]; 4]);

impl ColorSums {
    /// All zero.
    pub const ZERO: Self = Self([[0.0; GRID_LOOK_UPS]; 4]);

    /// One of them.
    #[inline]
    pub fn at(&self, index: usize) -> [f32; 4] {
        let [r, g, b, a] = &self.0;
        [r[index], g[index], b[index], a[index]]
    }

    /// Adds to one of them.
    pub fn add(&mut self, index: usize, color: [f32; 4]) {
        for (sums, number) in self.0.iter_mut().zip(color) {
            sums[index] += number;
        }
    }
}

/// Makes up to [`GRID_LOOK_UPS`] look-ups at once.
pub struct GridLookUps {
    quads: Quads,
    pairs: Pairs,
}

impl std::fmt::Debug for GridLookUps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GridLookUps").finish_non_exhaustive()
    }
}

impl Default for GridLookUps {
    fn default() -> Self {
        Self { quads: Quads::new(), pairs: Pairs::new() }
    }
}

impl GridLookUps {
    /// Finds the texels around other places, for all grids that have these extents.
    pub fn locate(&mut self, places: &GridPlaces) {
        dispatch!(vector_level(), simd => locate(simd, places, &mut self.quads));
    }

    /// Looks up linear RGBA at the places that were [located](Self::locate), and adds it, times its share, to the sums. `grid` has the
    /// texels by the grid's number. Returns the set of places (a bit each) that are left out: where there is no grid, or one of another
    /// kind than the first, or with too few texels.
    #[inline]
    pub fn add<'a>(
        &mut self,
        places: &GridPlaces,
        grid: impl Fn(u32) -> Option<TexelGrid<'a>>,
        sums: &mut ColorSums,
    ) -> u64 {
        let is_made = |index: &usize| places.share[*index] != 0.0;
        match (0..places.count).filter(is_made).find_map(|index| grid(places.grid[index])) {
            None => (0..places.count).filter(is_made).fold(0, |missed, index| missed | 1 << index),
            Some(TexelGrid::Rgba8 { is_srgb, .. }) => {
                let texels = |number| match grid(number) {
                    Some(TexelGrid::Rgba8 { texels, is_srgb: own }) if own == is_srgb => texels,
                    _ => &[],
                };
                self.add_texels(places, texels, Meaning { is_srgb, has_alpha: true }, sums)
            }
            Some(TexelGrid::Rg16 { one, .. }) => {
                let texels = |number| match grid(number) {
                    Some(TexelGrid::Rg16 { texels, one: own }) if own == one => texels,
                    _ => &[],
                };
                self.add_texels(places, texels, one, sums)
            }
        }
    }

    /// The same of texels of one kind: `texels` has those of a grid, none for grids of others.
    #[inline]
    fn add_texels<'a, T: Texel + 'a>(
        &mut self,
        places: &GridPlaces,
        texels: impl Fn(u32) -> &'a [T],
        meaning: T::Meaning,
        sums: &mut ColorSums,
    ) -> u64 {
        let missed = self.read(places, texels);
        let left;
        let share = if missed == 0 {
            &places.share
        } else {
            left = places.without(missed);
            &left
        };
        dispatch!(vector_level(), simd => add_colors::<_, T>(simd, self, share, places.count, meaning, sums));
        missed
    }

    /// Copies the texels around all places, and does nothing else: the fewer instructions between them, the more cache lines are under
    /// way at once. Returns the set of places without texels.
    #[inline]
    fn read<'a, T: Texel + 'a>(&mut self, places: &GridPlaces, texels: impl Fn(u32) -> &'a [T]) -> u64 {
        let mut missed = 0;
        let mut known: Option<u32> = None;
        let mut own: &[T] = &[];
        for index in 0..places.count.min(BLOCK) {
            if places.share[index] == 0.0 {
                continue;
            }
            let number = places.grid[index];
            if known != Some(number) {
                (known, own) = (Some(number), texels(number));
            }
            let (upper, lower) = (self.quads.upper.0[index] as usize, self.quads.lower.0[index] as usize);
            match (own.get(upper..upper + 2), own.get(lower..lower + 2)) {
                (Some(upper), Some(lower)) => {
                    self.pairs.upper_bytes.0[index] = T::word(upper);
                    self.pairs.lower_bytes.0[index] = T::word(lower);
                }
                _ => missed |= 1 << index,
            }
        }
        missed
    }
}

/// A texel of which two make a word.
trait Texel: Sized {
    /// What its numbers mean.
    type Meaning: Copy;

    /// Two texels, the first in the least significant bits.
    fn word(two: &[Self]) -> u64;

    /// The colours of the look-ups from `first` on, in units of [`UNIT`].
    fn colors<S: Simd>(simd: S, look_ups: &GridLookUps, meaning: Self::Meaning, first: usize)
    -> [S::f32s; 4];
}

impl Texel for [u8; 4] {
    type Meaning = Meaning;

    #[inline(always)]
    fn word(two: &[Self]) -> u64 {
        two.as_flattened().first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
    }

    #[inline(always)]
    fn colors<S: Simd>(simd: S, look_ups: &GridLookUps, meaning: Meaning, first: usize) -> [S::f32s; 4] {
        let GridLookUps { quads, pairs } = look_ups;
        let upper = widen_four(simd, &pairs.upper_bytes, meaning, first);
        let lower = widen_four(simd, &pairs.lower_bytes, meaning, first);
        blend_words::<S, 4>(simd, quads, [upper, lower], false, first)
    }
}

impl Texel for [u16; 2] {
    /// The denominator.
    type Meaning = u16;

    #[inline(always)]
    fn word(two: &[Self]) -> u64 {
        let four = two.as_flattened().first_chunk();
        let joined = |[a, b, c, d]: &[u16; 4]| {
            u64::from(*a) | u64::from(*b) << 16 | u64::from(*c) << 32 | u64::from(*d) << 48
        };
        four.map_or(0, joined)
    }

    #[inline(always)]
    fn colors<S: Simd>(simd: S, look_ups: &GridLookUps, one: u16, first: usize) -> [S::f32s; 4] {
        let GridLookUps { quads, pairs } = look_ups;
        let factor = 1.0 / (UNIT * f32::from(one));
        let rows = [two_words(simd, &pairs.upper_bytes, first), two_words(simd, &pairs.lower_bytes, first)];
        let [red, green, ..] = blend_words::<S, 2>(simd, quads, rows, false, first);
        let (blue, alpha) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0 / UNIT));
        [red * factor, green * factor, blue, alpha]
    }
}

impl GridPlaces {
    /// The shares, but none of some places (a bit each).
    #[inline]
    fn without(&self, places: u64) -> [f32; GRID_LOOK_UPS] {
        let mut share = self.share;
        bits(places).for_each(|index| share[index] = 0.0);
        share
    }
}

#[inline(always)]
fn locate<S: Simd>(simd: S, places: &GridPlaces, quads: &mut Quads) {
    for first in (0..places.count.min(BLOCK)).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let columns = S::u32s::from_slice(simd, &places.columns[range.clone()]);
        let rows = S::u32s::from_slice(simd, &places.rows[range.clone()]);
        let x = S::f32s::from_slice(simd, &places.x[range.clone()]);
        let y = S::f32s::from_slice(simd, &places.y[range.clone()]);
        let (column, right) = split_within(simd, x, columns);
        let (row, lower) = split_within(simd, y, rows);
        let upper = row * columns + column;
        upper.store_slice(&mut quads.upper.0[range.clone()]);
        (upper + columns).store_slice(&mut quads.lower.0[range.clone()]);
        right.store_slice(&mut quads.right_share.0[range.clone()]);
        lower.store_slice(&mut quads.lower_share.0[range]);
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

/// Adds the colours of all look-ups, by their shares.
#[inline(always)]
fn add_colors<S: Simd, T: Texel>(
    simd: S,
    look_ups: &GridLookUps,
    share: &[f32; BLOCK],
    count: usize,
    meaning: T::Meaning,
    sums: &mut ColorSums,
) {
    for first in (0..count.min(BLOCK)).step_by(S::f32s::LEN) {
        let share = S::f32s::from_slice(simd, &share[first..first + S::f32s::LEN]);
        if !share.simd_eq(S::f32s::splat(simd, 0.0)).all_true() {
            add(simd, T::colors(simd, look_ups, meaning, first), share, sums, first);
        }
    }
}

/// The two words of every look-up from `first` on, those of equal place together; there are no others.
#[inline(always)]
fn two_words<S: Simd>(simd: S, words: &Block<u64>, first: usize) -> [S::u32s; 4] {
    let lanes = S::u64s::LEN;
    let words = &words.0[first..first + 2 * lanes];
    let low = S::u64s::from_slice(simd, &words[..lanes]).bitcast::<S::u32s>();
    let high = S::u64s::from_slice(simd, &words[lanes..]).bitcast::<S::u32s>();
    let (even, odd) = low.deinterleave(high);
    let none = S::u32s::splat(simd, 0);
    [even, odd, none, none]
}

/// Adds colours in units of [`UNIT`], by their shares.
#[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, which keeps arrays in registers")]
#[inline(always)]
fn add<S: Simd>(simd: S, color: [S::f32s; 4], share: S::f32s, sums: &mut ColorSums, first: usize) {
    for channel in 0..4 {
        let sums = &mut sums.0[channel][first..first + S::f32s::LEN];
        (S::f32s::from_slice(simd, sums) + color[channel] * UNIT * share).store_slice(sums);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use glam::Vec2;

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

    /// What is seen at places in grids of these extents, each in its own, and what is left out.
    fn look_up<'a>(
        at: &[(Vec2, [u32; 2])],
        grid: impl Fn(usize) -> Option<TexelGrid<'a>>,
    ) -> (Vec<[f32; 4]>, u64) {
        let mut places = GridPlaces { count: at.len(), ..GridPlaces::default() };
        for (index, &(place, [columns, rows])) in at.iter().enumerate() {
            (places.x[index], places.y[index]) = (place.x, place.y);
            (places.columns[index], places.rows[index]) = (columns, rows);
            (places.share[index], places.grid[index]) = (1.0, index as u32);
        }
        let (mut look_ups, mut sums) = (GridLookUps::default(), ColorSums::ZERO);
        look_ups.locate(&places);
        let missed = look_ups.add(&places, |number| grid(number as usize), &mut sums);
        ((0..at.len()).map(|index| sums.at(index)).collect(), missed)
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
            let places: Vec<_> = uvs.iter().zip(&extents).map(|(&uv, &extent)| (uv * Vec2::from(extent.map(|n| n as f32)), extent)).collect();

            let stored: Vec<_> = extents.iter().zip(0..).map(|(&extent, seed)| bytes(extent, seed)).collect();
            let (seen, missed) = look_up(&places, |i| Some(TexelGrid::Rgba8 { texels: &stored[i], is_srgb }));
            prop_assert_eq!(missed, 0);
            for (i, seen) in seen.iter().enumerate() {
                let expected = expected(extents[i], uvs[i], |texel| linear(stored[i][texel], is_srgb));
                prop_assert!(!differ(seen, &expected), "{seen:?} {expected:?}");
            }

            let numbers = |texel: &[u8; 4]| [texel[0], texel[1]].map(|byte| u16::from(byte) * 35);
            let stored: Vec<Vec<_>> = stored.iter().map(|s| s.iter().map(numbers).collect()).collect();
            let (seen, missed) = look_up(&places, |i| Some(TexelGrid::Rg16 { texels: &stored[i], one: 8925 }));
            prop_assert_eq!(missed, 0);
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
    fn what_has_no_texels_is_left_out() {
        let stored = bytes([4, 4], 0);
        let texels = |i: usize| TexelGrid::Rgba8 { texels: &stored[..8 + 4 * i], is_srgb: false };
        let (seen, missed) = look_up(&[(Vec2::splat(2.0), [4, 4]); 3], |i| (i != 1).then(|| texels(i)));
        assert_eq!(missed, 0b011, "too few texels, no texels");
        assert_eq!(seen[..2], [[0.0; 4]; 2]);
        assert_ne!(seen[2], [0.0; 4]);
        let numbers = [[1, 2]; 16];
        let (seen, missed) = look_up(&[(Vec2::splat(2.0), [4, 4]); 3], |i| {
            Some(if i == 0 { TexelGrid::Rg16 { texels: &numbers, one: 4 } } else { texels(i) })
        });
        assert_eq!(missed, 0b110, "of another kind than the first");
        assert!(!differ(&seen[0], &[0.25, 0.5, 0.0, 1.0]), "{:?}", seen[0]);
        assert_eq!(seen[1..], [[0.0; 4]; 2]);
        let (seen, missed) = look_up(&[(Vec2::NAN, [4, 4])], |_| Some(texels(2)));
        assert_eq!(missed, 0);
        assert!(!differ(&seen[0], &linear(stored[0], false)), "NaN reads as the first texel");
    }

    #[test]
    fn sums_grow_by_shares() {
        let white = [[255; 4]; 16];
        let mut places = GridPlaces { count: 3, ..GridPlaces::default() };
        (places.columns, places.rows) = ([4; GRID_LOOK_UPS], [4; GRID_LOOK_UPS]);
        places.share[..3].copy_from_slice(&[0.25, 0.0, 1.0]);
        let (mut look_ups, mut sums) = (GridLookUps::default(), ColorSums::ZERO);
        look_ups.locate(&places);
        for _ in 0..2 {
            let white = |_| Some(TexelGrid::Rgba8 { texels: &white, is_srgb: true });
            assert_eq!(look_ups.add(&places, white, &mut sums), 0);
        }
        sums.add(1, [1.0, 2.0, 3.0, 4.0]);
        assert_eq!([0, 1, 2].map(|i| sums.at(i)), [[0.5; 4], [1.0, 2.0, 3.0, 4.0], [2.0; 4]]);
    }
}
