//! Bilinear look-ups in many small images at once, each in its own: the tiles of a cover.
//!
//! The steps are those of look-ups in one image. Positions are held half a texel inside the grid, so that none needs another
//! path at its edges, and are worked out once for grids of equal extent that hold different things.

use fearless_simd::{Select, Simd, dispatch, prelude::*};
use glam::Vec2;

use super::decode::{UNIT, blend, store_rgba};
use super::place::Quads;
use super::texels::Pairs;
use super::widen::{Meaning, widen};
use super::{BLOCK, Block, Colors, level};

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
    u: Block<f32>,
    v: Block<f32>,
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
            u: no_number,
            v: no_number,
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
    /// Other places: coordinates in `[0,1]²` of grids with so many columns and rows.
    ///
    /// # Panics
    /// If there are more than [`GRID_LOOK_UPS`].
    pub fn place(&mut self, places: impl ExactSizeIterator<Item = (Vec2, [u32; 2])>) {
        assert!(places.len() <= GRID_LOOK_UPS, "{} places at once", places.len());
        self.count = places.len();
        for (index, (uv, [columns, rows])) in places.enumerate() {
            (self.u.0[index], self.v.0[index]) = (uv.x, uv.y);
            (self.columns.0[index], self.rows.0[index]) = (columns, rows);
        }
        dispatch!(level(), simd => locate(simd, self));
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
fn locate<S: Simd>(simd: S, look_ups: &mut GridLookUps) {
    for first in (0..look_ups.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let columns = S::u32s::from_slice(simd, &look_ups.columns.0[range.clone()]);
        let rows = S::u32s::from_slice(simd, &look_ups.rows.0[range.clone()]);
        let u = S::f32s::from_slice(simd, &look_ups.u.0[range.clone()]);
        let v = S::f32s::from_slice(simd, &look_ups.v.0[range.clone()]);
        let (column, right) = split(simd, u, columns);
        let (row, lower) = split(simd, v, rows);
        let upper = row * columns + column;
        upper.store_slice(&mut look_ups.quads.upper.0[range.clone()]);
        (upper + columns).store_slice(&mut look_ups.quads.lower.0[range.clone()]);
        right.store_slice(&mut look_ups.quads.right_share.0[range.clone()]);
        lower.store_slice(&mut look_ups.quads.lower_share.0[range]);
    }
}

/// The first of two texels around a coordinate, and the share of the second; at the end of the axis the second counts alone.
#[inline(always)]
fn split<S: Simd>(simd: S, coordinate: S::f32s, texels: S::u32s) -> (S::u32s, S::f32s) {
    let zero = S::f32s::splat(simd, 0.0);
    let length = texels.to_float::<S::f32s>();
    let position = coordinate * length - 0.5;
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
            look_ups.place(uvs.iter().copied().zip(extents.iter().copied()).collect::<Vec<_>>().into_iter());

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
        look_ups.place([(Vec2::splat(0.5), [4, 4]); 3].into_iter());
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
