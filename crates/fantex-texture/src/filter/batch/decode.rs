//! From stored texels to interpolated colours, one channel of many look-ups in a vector.

use fearless_simd::{Simd, prelude::*};

use super::place::Quads;
use super::texels::Pairs;
use super::{Block, Colors};
use crate::filter::texel::TRANSPARENT_WEIGHT;

/// The channels of a texel (or of a mean of texels) of every look-up: those that are stored, in units of [`UNIT`].
type Channels<F> = [F; 4];

/// What stored numbers are multiplied by in the end.
pub(in crate::filter) const UNIT: f32 = 1.0 / 65535.0;

/// Interpolates between the texels of the quads from `first` on.
#[inline(always)]
pub(super) fn blend<S: Simd, const C: usize>(
    simd: S,
    quads: &Quads,
    pairs: &Pairs,
    is_coverage: bool,
    first: usize,
) -> Channels<S::f32s> {
    let range = first..first + S::f32s::LEN;
    let right = S::f32s::from_slice(simd, &quads.right_share.0[range.clone()]);
    let lower = S::f32s::from_slice(simd, &quads.lower_share.0[range]);
    let upper_row = row::<S, C>(simd, load_four(simd, &pairs.upper, first), right, is_coverage);
    let lower_row = row::<S, C>(simd, load_four(simd, &pairs.lower, first), right, is_coverage);
    mix::<S, C>(upper_row, lower_row, lower)
}

/// From one value to another by a share.
#[inline(always)]
pub(super) fn mix<S: Simd, const C: usize>(
    mut from: Channels<S::f32s>,
    to: Channels<S::f32s>,
    share: S::f32s,
) -> Channels<S::f32s> {
    for channel in 0..C {
        from[channel] += (to[channel] - from[channel]) * share;
    }
    from
}

/// Between two neighbouring texels.
#[inline(always)]
fn row<S: Simd, const C: usize>(
    simd: S,
    words: [S::u32s; 4],
    right: S::f32s,
    is_coverage: bool,
) -> Channels<S::f32s> {
    let left_texel = texel::<S, C>(simd, words, 0, is_coverage);
    let right_texel = texel::<S, C>(simd, words, C, is_coverage);
    mix::<S, C>(left_texel, right_texel, right)
}

/// The texel whose samples begin at number `first` of eight; colours weighted by alpha, if that is coverage.
#[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, which keeps arrays in registers")]
#[inline(always)]
fn texel<S: Simd, const C: usize>(
    simd: S,
    words: [S::u32s; 4],
    first: usize,
    is_coverage: bool,
) -> Channels<S::f32s> {
    let mut texel = [S::f32s::splat(simd, 0.0); 4];
    for channel in 0..C {
        let (word, is_high) = (words[(first + channel) / 2], (first + channel) % 2 == 1);
        // Conversion of signed numbers is the cheaper one.
        let number = if is_high { word >> 16 } else { word & 0xffff };
        texel[channel] = number.bitcast::<S::i32s>().to_float::<S::f32s>();
    }
    if C == 4 && is_coverage {
        let weight = texel[3] * UNIT + TRANSPARENT_WEIGHT;
        for channel in 0..3 {
            texel[channel] *= weight;
        }
    }
    texel
}

/// Four words of every look-up from `first` on, those of equal place together.
#[inline(always)]
pub(in crate::filter) fn load_four<S: Simd>(simd: S, words: &Block<[u64; 2]>, first: usize) -> [S::u32s; 4] {
    let lanes = S::u64s::LEN;
    let words = &words.0.as_flattened()[2 * first..2 * first + 4 * lanes];
    let a = S::u64s::from_slice(simd, &words[..lanes]).bitcast::<S::u32s>();
    let b = S::u64s::from_slice(simd, &words[lanes..2 * lanes]).bitcast::<S::u32s>();
    let c = S::u64s::from_slice(simd, &words[2 * lanes..3 * lanes]).bitcast::<S::u32s>();
    let d = S::u64s::from_slice(simd, &words[3 * lanes..]).bitcast::<S::u32s>();
    let ((even_ab, odd_ab), (even_cd, odd_cd)) = (a.deinterleave(b), c.deinterleave(d));
    let ((w0, w2), (w1, w3)) = (even_ab.deinterleave(even_cd), odd_ab.deinterleave(odd_cd));
    [w0, w1, w2, w3]
}

/// Writes one colour per look-up from `first` on: grey in all colour channels, 1 for missing alpha.
#[inline(always)]
pub(in crate::filter) fn store_rgba<S: Simd, const C: usize>(
    simd: S,
    value: Channels<S::f32s>,
    out: &mut Colors,
    first: usize,
) {
    let [red, opaque] = [value[0] * UNIT, S::f32s::splat(simd, 1.0)];
    let [r, g, b, a] = match C {
        1 => [red, red, red, opaque],
        3 => [red, value[1] * UNIT, value[2] * UNIT, opaque],
        _ => [red, value[1] * UNIT, value[2] * UNIT, value[3] * UNIT],
    };
    let lanes = S::f32s::LEN;
    let out = &mut out.0.as_flattened_mut()[4 * first..4 * (first + lanes)];
    let ((rb_low, rb_high), (ga_low, ga_high)) = (r.interleave(b), g.interleave(a));
    let ((first, second), (third, fourth)) = (rb_low.interleave(ga_low), rb_high.interleave(ga_high));
    first.store_slice(&mut out[..lanes]);
    second.store_slice(&mut out[lanes..2 * lanes]);
    third.store_slice(&mut out[2 * lanes..3 * lanes]);
    fourth.store_slice(&mut out[3 * lanes..]);
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_block_is_a_whole_number_of_vectors() {
        assert_eq!(crate::filter::BLOCK % 16, 0);
    }
}
