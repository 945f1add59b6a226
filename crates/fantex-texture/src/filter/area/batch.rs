//! Means over many equal footprints at once: those about a texel wide, in images of bytes.
//!
//! A lane of a vector is a footprint. Its nine weights are the same for all images of equal size; per image three rows of three
//! texels are copied, decoded and weighted. See `filter/batch`, whose steps these are.

use fearless_simd::{Simd, dispatch, prelude::*};
use glam::Vec2;

use super::{AreaPlan, MARGIN_TEXELS, Subsamples, WindowPlan};
use crate::Wrap;
use crate::filter::TexelUse;
use crate::filter::batch::{Block, Colors, Meaning, UNIT, eight, level, load_four, store_rgba, widen};
use crate::filter::texel::TRANSPARENT_WEIGHT;
use crate::image::{ColorSpace, Image, Samples};
use crate::{AlphaUse, filter::BLOCK};

/// Texels along a side of a footprint's window.
const SIDE: usize = 3;

/// No offset: the window reaches over the image's border.
const NONE: u32 = u32::MAX;

/// Weights of the texels under a block of equal footprints.
#[derive(Clone, Debug)]
pub(crate) struct AreaBlock {
    points: Block<Vec2>,
    count: usize,
    /// Row-major offset of the window's first texel, or [`NONE`]; without, the footprint is no narrow one.
    first: Option<Block<u32>>,
    /// By row, then column.
    weights: [[Block<f32>; SIDE]; SIDE],
}

impl AreaBlock {
    /// Around up to a block of points.
    pub(crate) fn new(plan: &AreaPlan, image: &Image, points: &[Vec2]) -> Self {
        let mut block = Self {
            points: Block([Vec2::ZERO; BLOCK]),
            count: points.len(),
            first: None,
            weights: [[Block([0.0; BLOCK]); SIDE]; SIDE],
        };
        block.points.0[..points.len()].copy_from_slice(points);
        let is_small = u64::from(image.width) * u64::from(image.height) < u64::from(u32::MAX);
        if let Some(window) = plan.window.filter(|window| window.is_narrow && is_small) {
            dispatch!(level(), simd => place(simd, plan, &window, [image.width, image.height], &mut block));
        }
        block
    }

    /// Where the footprints are.
    pub(crate) fn points(&self) -> &[Vec2] {
        &self.points.0[..self.count]
    }

    /// The means of `image`, which has the size that was given; alpha still a weight. Returns the set of those (a bit each) that
    /// must be looked up otherwise.
    pub(crate) fn sums(&self, image: &Image, texels: TexelUse, out: &mut Colors) -> u64 {
        let all = u64::MAX >> (BLOCK - self.count.max(1));
        let (Samples::U8(bytes), Some(first)) = (&image.samples, &self.first) else { return all };
        let source = Source {
            bytes,
            width: image.width as usize,
            first,
            is_srgb: image.space == ColorSpace::Srgb,
            is_coverage: texels.alpha == AlphaUse::Coverage,
        };
        dispatch!(level(), simd => match image.channels {
            1 => sums::<_, 1>(simd, self, &source, out),
            3 => sums::<_, 3>(simd, self, &source, out),
            4 => sums::<_, 4>(simd, self, &source, out),
            _ => all,
        })
    }
}

/// An image of bytes, and where it is read.
struct Source<'a> {
    bytes: &'a [u8],
    width: usize,
    first: &'a Block<u32>,
    is_srgb: bool,
    is_coverage: bool,
}

/// As [`Window::new`] and [`Window::gather`].
#[inline(always)]
fn place<S: Simd>(simd: S, plan: &AreaPlan, window: &WindowPlan, size: [u32; 2], block: &mut AreaBlock) {
    let mut offsets = Block([NONE; BLOCK]);
    let mut at = [Block([0.0; BLOCK]); 2];
    for (index, point) in block.points.0.iter().enumerate() {
        (at[0].0[index], at[1].0[index]) = (point.x, point.y);
    }
    let last = size.map(|n| S::f32s::splat(simd, n as f32 - SIDE as f32));
    let zero = S::f32s::splat(simd, 0.0);
    for first in (0..block.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let u = S::f32s::from_slice(simd, &at[0].0[range.clone()]);
        let v = S::f32s::from_slice(simd, &at[1].0[range.clone()]);
        let x = recentred(simd, u, size[0] as f32, plan.wrap[0]) - 0.5;
        let y = recentred(simd, v, size[1] as f32, plan.wrap[1]) - 0.5;
        let (column, row) = ((x - window.reach.x).floor(), (y - window.reach.y).floor());
        let is_inside =
            column.simd_ge(zero) & row.simd_ge(zero) & column.simd_le(last[0]) & row.simd_le(last[1]);
        let offset = row.to_int::<S::u32s>() * size[0] + column.to_int::<S::u32s>();
        is_inside.select(offset, S::u32s::splat(simd, NONE)).store_slice(&mut offsets.0[range]);
        let from = [x - column + window.first.x, y - row + window.first.y];
        gather(simd, from, window, plan.subsamples, &mut block.weights, first);
    }
    block.first = Some(offsets);
}

/// As the scalar `recenter`.
#[inline(always)]
fn recentred<S: Simd>(simd: S, coordinate: S::f32s, texels: f32, wrap: Wrap) -> S::f32s {
    let position = match wrap {
        Wrap::Repeat => (coordinate - coordinate.floor()) * texels,
        Wrap::Mirror => (coordinate - (coordinate * 0.5).floor() * 2.0) * texels,
        Wrap::Clamp | Wrap::Border => coordinate * texels,
    };
    position.max(S::f32s::splat(simd, -MARGIN_TEXELS)).min(S::f32s::splat(simd, 2.0 * texels + MARGIN_TEXELS))
}

#[inline(always)]
fn gather<S: Simd>(
    simd: S,
    from: [S::f32s; 2],
    window: &WindowPlan,
    subsamples: Subsamples,
    weights: &mut [[Block<f32>; SIDE]; SIDE],
    first: usize,
) {
    let mut sums = [[S::f32s::splat(simd, 0.0); SIDE]; SIDE];
    for row in 0..subsamples.rows {
        for column in 0..subsamples.columns {
            let offset = window.step[0] * column as f32 + window.step[1] * row as f32;
            let (across, down) = (hats(simd, from[0] + offset.x), hats(simd, from[1] + offset.y));
            for y in 0..SIDE {
                for x in 0..SIDE {
                    sums[y][x] += across[x] * down[y];
                }
            }
        }
    }
    for y in 0..SIDE {
        for x in 0..SIDE {
            (sums[y][x] * window.share).store_slice(&mut weights[y][x].0[first..first + S::f32s::LEN]);
        }
    }
}

/// The hat functions of a window's texels.
#[inline(always)]
fn hats<S: Simd>(simd: S, position: S::f32s) -> [S::f32s; SIDE] {
    let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    let mut hats = [zero; SIDE];
    for (texel, hat) in hats.iter_mut().enumerate() {
        *hat = (one - (position - texel as f32).abs()).max(zero);
    }
    hats
}

#[inline(always)]
fn sums<S: Simd, const C: usize>(simd: S, block: &AreaBlock, source: &Source<'_>, out: &mut Colors) -> u64 {
    let count = block.count;
    let meaning = Meaning { is_srgb: source.is_srgb, has_alpha: C == 4 };
    let no_bytes = Block([0_u64; BLOCK]);
    let mut bytes = [[no_bytes; 2]; SIDE];
    let mut missed = 0;
    for index in 0..count {
        let first = source.first.0[index] as usize;
        let mut is_read = true;
        for (row, bytes) in bytes.iter_mut().enumerate() {
            let at = (first + row * source.width) * C;
            match (eight(source.bytes, at), eight(source.bytes, at + 8)) {
                (Some(near), Some(far)) => {
                    bytes[0].0[index] = u64::from_le_bytes(*near);
                    bytes[1].0[index] = u64::from_le_bytes(*far);
                }
                _ => is_read = false,
            }
        }
        missed |= u64::from(!is_read) << index;
    }
    let no_words = Block([[0_u64; 2]; BLOCK]);
    let mut words = [[no_words; 2]; SIDE];
    for (bytes, words) in bytes.iter().zip(&mut words) {
        widen(simd, &bytes[0], meaning, &mut words[0], count);
        // One channel has no texel there.
        if C > 1 {
            widen(simd, &bytes[1], meaning, &mut words[1], count);
        }
    }
    for first in (0..count).step_by(S::f32s::LEN) {
        let mut sum = [S::f32s::splat(simd, 0.0); 4];
        for (words, weights) in words.iter().zip(&block.weights) {
            let [a, b, c, d] = load_four(simd, &words[0], first);
            let [e, f, g, h] = load_four(simd, &words[1], first);
            let words = [a, b, c, d, e, f, g, h];
            for (texel, weight) in weights.iter().enumerate() {
                let weight = S::f32s::from_slice(simd, &weight.0[first..first + S::f32s::LEN]);
                sum = weighted::<S, C>(sum, words, texel * C, weight, source.is_coverage);
            }
        }
        store_rgba::<S, C>(simd, sum, out, first);
    }
    missed
}

/// Adds the texel whose samples begin at number `first` of sixteen.
#[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, which keeps arrays in registers")]
#[inline(always)]
fn weighted<S: Simd, const C: usize>(
    mut sum: [S::f32s; 4],
    words: [S::u32s; 8],
    first: usize,
    weight: S::f32s,
    is_coverage: bool,
) -> [S::f32s; 4] {
    let mut color_weight = weight;
    if C == 4 && is_coverage {
        color_weight = weight * (number::<S>(words, first + 3) * UNIT + TRANSPARENT_WEIGHT);
    }
    for channel in 0..C {
        let weight = if channel < 3 { color_weight } else { weight };
        sum[channel] += number::<S>(words, first + channel) * weight;
    }
    sum
}

/// A number of 16 bits.
#[inline(always)]
fn number<S: Simd>(words: [S::u32s; 8], sample: usize) -> S::f32s {
    let word = words[sample / 2];
    let number = if sample % 2 == 1 { word >> 16 } else { word & 0xffff };
    number.bitcast::<S::i32s>().to_float::<S::f32s>()
}
