//! From stored texels to interpolated colours, one channel of many look-ups in a vector.

use fearless_simd::{Select, Simd, prelude::*};

use super::place::Quads;
use super::texels::Pairs;
use super::{Block, Colors, LookUp};
use crate::AlphaUse;
use crate::filter::texel::TRANSPARENT_WEIGHT;

/// A texel of every look-up: linear RGBA.
type Rgba<F> = [F; 4];

/// Interpolates between the texels of the quads from `first` on.
#[inline(always)]
pub(super) fn blend<S: Simd, const C: usize>(
    simd: S,
    look_up: &LookUp<'_>,
    quads: &Quads,
    pairs: &Pairs,
    first: usize,
) -> Rgba<S::f32s> {
    let levels = look_up.levels;
    let range = first..first + S::f32s::LEN;
    let level = S::u32s::from_slice(simd, &quads.level.0[range.clone()]);
    let right = S::f32s::from_slice(simd, &quads.right_share.0[range.clone()]);
    let lower = S::f32s::from_slice(simd, &quads.lower_share.0[range]);
    let upper_words = load_four(simd, &pairs.upper, first);
    let is_base = level.simd_eq(S::u32s::splat(simd, 0));
    let is_coverage = look_up.alpha == AlphaUse::Coverage;
    if levels.has_bytes() && is_base.all_true() {
        return bytes_blend::<S, C>(simd, upper_words, [right, lower], levels.is_srgb(), is_coverage);
    }
    let lower_words = load_four(simd, &pairs.lower, first);
    if !is_base.any_true() {
        return words_blend::<S, C>(simd, [upper_words, lower_words], [right, lower], false, is_coverage);
    }
    // Lanes of level 0 and others beside them.
    let base = if levels.has_bytes() {
        bytes_blend::<S, C>(simd, upper_words, [right, lower], levels.is_srgb(), is_coverage)
    } else {
        words_blend::<S, C>(
            simd,
            [upper_words, lower_words],
            [right, lower],
            levels.is_srgb(),
            is_coverage,
        )
    };
    let mut value =
        words_blend::<S, C>(simd, [upper_words, lower_words], [right, lower], false, is_coverage);
    for channel in 0..4 {
        value[channel] = is_base.select(base[channel], value[channel]);
    }
    value
}

/// Interpolates between texels of bytes: eight of the upper row, eight of the lower one.
#[inline(always)]
fn bytes_blend<S: Simd, const C: usize>(
    simd: S,
    [a, b, c, d]: [S::u32s; 4],
    shares: [S::f32s; 2],
    is_srgb: bool,
    is_coverage: bool,
) -> Rgba<S::f32s> {
    let texels = [
        byte_texel::<S, C>(simd, [a, b], 0, is_srgb),
        byte_texel::<S, C>(simd, [a, b], C, is_srgb),
        byte_texel::<S, C>(simd, [c, d], 0, is_srgb),
        byte_texel::<S, C>(simd, [c, d], C, is_srgb),
    ];
    interpolate::<S>(weighed::<S, C>(texels, is_coverage), shares)
}

/// Interpolates between texels of 16 bits: eight samples of either row.
#[inline(always)]
fn words_blend<S: Simd, const C: usize>(
    simd: S,
    [upper, lower]: [[S::u32s; 4]; 2],
    shares: [S::f32s; 2],
    is_srgb: bool,
    is_coverage: bool,
) -> Rgba<S::f32s> {
    let texels = [
        word_texel::<S, C>(simd, upper, 0, is_srgb),
        word_texel::<S, C>(simd, upper, C, is_srgb),
        word_texel::<S, C>(simd, lower, 0, is_srgb),
        word_texel::<S, C>(simd, lower, C, is_srgb),
    ];
    interpolate::<S>(weighed::<S, C>(texels, is_coverage), shares)
}

/// The texel whose samples begin at number `first` of eight bytes.
#[inline(always)]
fn byte_texel<S: Simd, const C: usize>(
    simd: S,
    words: [S::u32s; 2],
    first: usize,
    is_srgb: bool,
) -> Rgba<S::f32s> {
    let mut texel = [S::f32s::splat(simd, 1.0); 4];
    for channel in 0..C {
        let sample = first + channel;
        let code = (words[sample / 4] >> (8 * (sample as u32 % 4))) & 0xff;
        texel[channel] = decoded(simd, code.to_float::<S::f32s>() * (1.0 / 255.0), is_srgb && channel < 3);
    }
    spread::<S, C>(texel)
}

/// The texel whose samples begin at number `first` of eight numbers of 16 bits.
#[inline(always)]
fn word_texel<S: Simd, const C: usize>(
    simd: S,
    words: [S::u32s; 4],
    first: usize,
    is_srgb: bool,
) -> Rgba<S::f32s> {
    let mut texel = [S::f32s::splat(simd, 1.0); 4];
    for channel in 0..C {
        let sample = first + channel;
        let code = (words[sample / 2] >> (16 * (sample as u32 % 2))) & 0xffff;
        texel[channel] =
            decoded(simd, code.to_float::<S::f32s>() * (1.0 / 65535.0), is_srgb && channel < 3);
    }
    spread::<S, C>(texel)
}

/// Grey in all colour channels.
#[inline(always)]
fn spread<S: Simd, const C: usize>(texel: Rgba<S::f32s>) -> Rgba<S::f32s> {
    if C == 1 { [texel[0], texel[0], texel[0], texel[3]] } else { texel }
}

#[inline(always)]
fn decoded<S: Simd>(simd: S, encoded: S::f32s, is_srgb: bool) -> S::f32s {
    if is_srgb { linear_from_srgb(simd, encoded) } else { encoded }
}

/// `((x + 0.055) / 1.055)^2.4` between 0.04045 and 1 to 7e-7: the polynomial of least greatest error.
const SRGB_CURVE: [f32; 9] = [
    0.000_852_608_53,
    0.035_384_666,
    0.484_085_3,
    0.871_667_1,
    -0.899_898_9,
    1.017_006_2,
    -0.812_804_6,
    0.382_023_87,
    -0.078_316_74,
];

/// The sRGB curve between 0 and 1.
#[inline(always)]
fn linear_from_srgb<S: Simd>(simd: S, encoded: S::f32s) -> S::f32s {
    let mut curve = S::f32s::splat(simd, SRGB_CURVE[8]);
    for power in (0..8).rev() {
        curve = curve * encoded + SRGB_CURVE[power];
    }
    encoded.simd_lt(S::f32s::splat(simd, 0.04045)).select(encoded * (1.0 / 12.92), curve)
}

/// Texels weighted by their alpha, if that is coverage.
#[inline(always)]
fn weighed<S: Simd, const C: usize>(
    mut texels: [Rgba<S::f32s>; 4],
    is_coverage: bool,
) -> [Rgba<S::f32s>; 4] {
    if C == 4 && is_coverage {
        for texel in &mut texels {
            let weight = texel[3] + TRANSPARENT_WEIGHT;
            for channel in 0..3 {
                texel[channel] = texel[channel] * weight;
            }
        }
    }
    texels
}

/// Between two by two texels, row by row.
#[inline(always)]
fn interpolate<S: Simd>([a, b, c, d]: [Rgba<S::f32s>; 4], [right, lower]: [S::f32s; 2]) -> Rgba<S::f32s> {
    let mut value = a;
    for channel in 0..4 {
        let upper_row = a[channel] + (b[channel] - a[channel]) * right;
        let lower_row = c[channel] + (d[channel] - c[channel]) * right;
        value[channel] = upper_row + (lower_row - upper_row) * lower;
    }
    value
}

/// Four words of every look-up from `first` on, those of equal place together.
#[inline(always)]
fn load_four<S: Simd>(simd: S, words: &Block<[u32; 4]>, first: usize) -> [S::u32s; 4] {
    let lanes = S::u32s::LEN;
    let words = &words.0.as_flattened()[4 * first..4 * (first + lanes)];
    let a = S::u32s::from_slice(simd, &words[..lanes]);
    let b = S::u32s::from_slice(simd, &words[lanes..2 * lanes]);
    let c = S::u32s::from_slice(simd, &words[2 * lanes..3 * lanes]);
    let d = S::u32s::from_slice(simd, &words[3 * lanes..]);
    let ((even_ab, odd_ab), (even_cd, odd_cd)) = (a.deinterleave(b), c.deinterleave(d));
    let ((w0, w2), (w1, w3)) = (even_ab.deinterleave(even_cd), odd_ab.deinterleave(odd_cd));
    [w0, w1, w2, w3]
}

/// Writes one colour per look-up from `first` on.
#[inline(always)]
pub(super) fn store_rgba<S: Simd>([r, g, b, a]: Rgba<S::f32s>, out: &mut Colors, first: usize) {
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
    use fearless_simd::dispatch;

    use super::*;
    use crate::color::linear_from_srgb8_table;
    use crate::filter::batch::level;

    #[inline(always)]
    fn decode_all<S: Simd>(simd: S, out: &mut [f32; 256]) {
        for first in (0..256).step_by(S::f32s::LEN) {
            let codes = S::f32s::from_fn(simd, |lane| (first + lane) as f32 / 255.0);
            linear_from_srgb(simd, codes).store_slice(&mut out[first..first + S::f32s::LEN]);
        }
    }

    #[test]
    fn the_polynomial_is_the_curve() {
        let mut decoded = [0.0; 256];
        dispatch!(level(), simd => decode_all(simd, &mut decoded));
        for (code, (got, wanted)) in decoded.iter().zip(linear_from_srgb8_table()).enumerate() {
            assert!((got - wanted).abs() < 1e-6, "{code}: {got}, {wanted}");
        }
    }

    #[test]
    fn a_block_is_a_whole_number_of_vectors() {
        assert_eq!(crate::filter::BLOCK % 16, 0);
    }
}
