//! The levels of an image as they are stored, and pairs of texels out of them.

use std::sync::LazyLock;

use arrayvec::ArrayVec;
use fearless_simd::prelude::*;
use fearless_simd::{Select, Simd, u8x16, u32x4};

use super::batch::{BLOCK, Block, Colors, Quads};
use super::taps::TRANSPARENT_WEIGHT;
use crate::color::{linear_from_srgb8_table, unorm16};
use crate::image::{ColorSpace, Image, Samples};

/// Levels of the largest image.
const MAX_LEVELS: usize = 32;

#[derive(Clone, Copy, Debug)]
pub(crate) enum Stored<'a> {
    U8(&'a [u8]),
    U16(&'a [u16]),
}

/// All levels of an image that can be looked up in vectors.
#[derive(Clone, Debug)]
pub(crate) struct Levels<'a> {
    size: [u32; 2],
    channels: u8,
    /// Whether bytes are encoded; numbers of 16 bits are linear.
    is_srgb: bool,
    stored: ArrayVec<Stored<'a>, MAX_LEVELS>,
}

impl<'a> Levels<'a> {
    /// The levels of an image, level 0 first; `None` for storage that has no fast path.
    pub(crate) fn new(base: &'a Image, coarser: &'a [Image]) -> Option<Self> {
        let is_small = u64::from(base.width) * u64::from(base.height) * 4 < u64::from(u32::MAX);
        if !(is_small && matches!(base.channels, 1 | 3 | 4)) {
            return None;
        }
        if coarser.len() >= MAX_LEVELS {
            return None;
        }
        let stored = |image: &'a Image| match &image.samples {
            Samples::U8(values) => Some(Stored::U8(values)),
            Samples::U16(values) if image.space == ColorSpace::Linear => Some(Stored::U16(values)),
            _ => None,
        };
        let stored = std::iter::once(base).chain(coarser).map(stored).collect::<Option<_>>()?;
        let is_srgb = base.space == ColorSpace::Srgb;
        Some(Self { size: [base.width, base.height], channels: base.channels, is_srgb, stored })
    }

    pub(super) fn size(&self) -> [u32; 2] {
        self.size
    }

    pub(super) fn channels(&self) -> u8 {
        self.channels
    }

    pub(super) fn meaning(&self) -> Meaning {
        Meaning { is_srgb: self.is_srgb, has_alpha: self.channels == 4 }
    }

    pub(super) fn last(&self) -> u32 {
        self.stored.len() as u32 - 1
    }
}

/// Two by two texels per look-up, those of a row as they follow one another in memory: linear numbers of 16 bits, the first in
/// the least significant bits.
pub(super) struct Pairs {
    /// Eight samples from the upper left texel on.
    pub(super) upper: Block<[u64; 2]>,
    /// Eight samples from the lower left texel on.
    pub(super) lower: Block<[u64; 2]>,
    /// The same as bytes, where they are stored so.
    pub(super) upper_bytes: Block<u64>,
    pub(super) lower_bytes: Block<u64>,
    /// Whether they are there as bytes only.
    pub(super) are_bytes: bool,
}

impl Pairs {
    pub(super) fn new() -> Self {
        let (no_words, no_bytes) = (Block::of([0; 2]), Block::of(0));
        Self {
            upper: no_words,
            lower: no_words,
            upper_bytes: no_bytes,
            lower_bytes: no_bytes,
            are_bytes: false,
        }
    }

    /// Copies the texels of every quad; returns the set of those (a bit each) that are at the edges or too near to the end of
    /// the memory. Bytes may be left as such where `weigh` decodes them as fast.
    #[inline(always)]
    pub(super) fn read<S: Simd, const C: usize>(
        &mut self,
        simd: S,
        levels: &Levels<'_>,
        quads: &Quads,
        count: usize,
        may_be_bytes: bool,
    ) -> u64 {
        let count = count.min(BLOCK);
        let level_of = |index: usize| quads.level.0[index] as usize;
        let is_one_level = (1..count).fold(true, |same, index| same & (level_of(index) == level_of(0)));
        let meaning = levels.meaning();
        let words = meaning.words();
        let mut missed = 0;
        self.are_bytes = false;
        // The fewer instructions between them, the more cache lines are under way at once.
        match levels.stored[level_of(0)] {
            Stored::U8(bytes) if is_one_level => {
                for index in 0..count {
                    let Some([upper, lower]) = quads.read_pair::<C, _>(bytes, index) else {
                        missed |= 1 << index;
                        continue;
                    };
                    self.upper_bytes.0[index] = u64::from_le_bytes(*upper);
                    self.lower_bytes.0[index] = u64::from_le_bytes(*lower);
                }
                self.are_bytes = may_be_bytes && widens_in_vectors::<S>(meaning);
                if !self.are_bytes {
                    widen(simd, &self.upper_bytes, meaning, &mut self.upper, count);
                    widen(simd, &self.lower_bytes, meaning, &mut self.lower, count);
                }
            }
            Stored::U16(values) if is_one_level => {
                for index in 0..count {
                    let Some([upper, lower]) = quads.read_pair::<C, _>(values, index) else {
                        missed |= 1 << index;
                        continue;
                    };
                    self.upper.0[index] = joined(upper);
                    self.lower.0[index] = joined(lower);
                }
            }
            _ => {
                for index in 0..count {
                    let pair = match levels.stored[level_of(index)] {
                        Stored::U8(bytes) => quads
                            .read_pair::<C, _>(bytes, index)
                            .map(|pair| pair.map(|row| widened(u64::from_le_bytes(*row), words))),
                        Stored::U16(values) => {
                            quads.read_pair::<C, _>(values, index).map(|pair| pair.map(joined))
                        }
                    };
                    missed |= u64::from(pair.is_none()) << index;
                    [self.upper.0[index], self.lower.0[index]] = pair.unwrap_or_default();
                }
            }
        }
        missed
    }
}

impl Quads {
    /// Eight samples each from the upper left and from the lower left texel on.
    #[inline(always)]
    fn read_pair<'a, const C: usize, T>(&self, samples: &'a [T], index: usize) -> Option<[&'a [T; 8]; 2]> {
        let (upper, lower) = (self.upper.0[index] as usize * C, self.lower.0[index] as usize * C);
        Some([eight(samples, upper)?, eight(samples, lower)?])
    }
}

#[inline(always)]
pub(super) fn eight<T>(samples: &[T], first: usize) -> Option<&[T; 8]> {
    samples.get(first..first + 8)?.first_chunk()
}

#[inline(always)]
fn joined(values: &[u16; 8]) -> [u64; 2] {
    let word =
        |[a, b, c, d]: [u16; 4]| u64::from(a) | u64::from(b) << 16 | u64::from(c) << 32 | u64::from(d) << 48;
    let [a, b, c, d, e, f, g, h] = *values;
    [word([a, b, c, d]), word([e, f, g, h])]
}

// ---- From stored texels to interpolated colours, one channel of many look-ups in a vector.

/// The channels of a texel (or of a mean of texels) of every look-up: those that are stored, in units of [`UNIT`].
type Channels<F> = [F; 4];

/// What stored numbers are multiplied by in the end.
pub(super) const UNIT: f32 = 1.0 / 65535.0;

/// Interpolates between the texels of the quads from `first` on.
#[inline(always)]
pub(super) fn blend<S: Simd, const C: usize>(
    simd: S,
    quads: &Quads,
    pairs: &Pairs,
    is_coverage: bool,
    first: usize,
) -> Channels<S::f32s> {
    let upper = load_four(simd, &pairs.upper.0[first..first + S::f32s::LEN]);
    let lower = load_four(simd, &pairs.lower.0[first..first + S::f32s::LEN]);
    blend_words::<S, C>(simd, quads, [upper, lower], is_coverage, first)
}

/// The same, of texels that are at hand: the upper rows of the quads, and the lower ones.
#[inline(always)]
pub(super) fn blend_words<S: Simd, const C: usize>(
    simd: S,
    quads: &Quads,
    [upper, lower]: [[S::u32s; 4]; 2],
    is_coverage: bool,
    first: usize,
) -> Channels<S::f32s> {
    let range = first..first + S::f32s::LEN;
    let right = S::f32s::from_slice(simd, &quads.right_share.0[range.clone()]);
    let lower_share = S::f32s::from_slice(simd, &quads.lower_share.0[range]);
    let upper_row = row::<S, C>(simd, upper, right, is_coverage);
    let lower_row = row::<S, C>(simd, lower, right, is_coverage);
    mix::<S, C>(upper_row, lower_row, lower_share)
}

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

/// Four words of as many look-ups as a vector has lanes, those of equal place together.
#[inline(always)]
pub(super) fn load_four<S: Simd>(simd: S, words: &[[u64; 2]]) -> [S::u32s; 4] {
    let lanes = S::u64s::LEN;
    let words = &words.as_flattened()[..4 * lanes];
    let a = S::u64s::from_slice(simd, &words[..lanes]);
    let b = S::u64s::from_slice(simd, &words[lanes..2 * lanes]);
    let c = S::u64s::from_slice(simd, &words[2 * lanes..3 * lanes]);
    let d = S::u64s::from_slice(simd, &words[3 * lanes..]);
    apart::<S>([a.bitcast(), b.bitcast(), c.bitcast(), d.bitcast()])
}

/// Words that follow one another by look-ups, those of equal place together.
#[inline(always)]
fn apart<S: Simd>([a, b, c, d]: [S::u32s; 4]) -> [S::u32s; 4] {
    let ((even_ab, odd_ab), (even_cd, odd_cd)) = (a.deinterleave(b), c.deinterleave(d));
    let ((w0, w2), (w1, w3)) = (even_ab.deinterleave(even_cd), odd_ab.deinterleave(odd_cd));
    [w0, w1, w2, w3]
}

/// As [`load_four`], of bytes that are [`widened`].
#[inline(always)]
pub(super) fn widen_four<S: Simd>(
    simd: S,
    bytes: &Block<u64>,
    meaning: Meaning,
    first: usize,
) -> [S::u32s; 4] {
    if widens_in_vectors::<S>(meaning) {
        let lanes = S::u64s::LEN;
        let bytes = &bytes.0[first..first + 2 * lanes];
        let [a, b] = widened_bytes(simd, S::u64s::from_slice(simd, &bytes[..lanes]).bitcast(), meaning);
        let [c, d] = widened_bytes(simd, S::u64s::from_slice(simd, &bytes[lanes..]).bitcast(), meaning);
        return apart::<S>([a.bitcast(), b.bitcast(), c.bitcast(), d.bitcast()]);
    }
    let (table, mut words) = (meaning.words(), [[0; 2]; 16]);
    for (word, bytes) in words.iter_mut().zip(&bytes.0[first..first + S::f32s::LEN]) {
        *word = widened(*bytes, table);
    }
    load_four(simd, &words)
}

/// Writes one colour per look-up from `first` on: grey in all colour channels, 1 for missing alpha.
#[inline(always)]
pub(super) fn store_rgba<S: Simd, const C: usize>(
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

// ---- Interpolation of whole texels: four channels of a look-up beside each other, by products of 16-bit numbers.
//
// ```text
//  stored       l.r l.g l.b l.a r.r r.g r.b r.a      two neighbouring texels of a row
//  paired       l.r r.r l.g r.g l.b r.b l.a r.a
//  weights       L   R   L   R   L   R   L   R       of 15 bits, whose sum is always the same
//  products      red     green   blue    alpha       of 32 bits: one instruction multiplies and adds pairs
// ```
//
// No channel needs to be moved to a vector of its own and back, and two texels cost one multiplication. Rounding the weights
// costs at most 1.6e-5 of the difference of the two texels. Numbers are made signed for the product by subtracting a half.
// Where alpha weighs colours, `blend` does the same with a vector per channel.

/// The sum of the weights of two texels.
const WHOLE: f32 = 32767.0;

/// What products are multiplied by in the end, and what is added then: the half that was subtracted. Black becomes 0 exactly.
const DOT_UNIT: f32 = 1.0 / (65535.0 * WHOLE);
const HALF: f32 = 32768.0 * WHOLE * DOT_UNIT;

/// As many whole colours as four vectors hold, in order.
type Texels<S> = [<S as Simd>::f32s; 4];

/// Interpolates between the texels of the quads from `first` on, as many as a vector has lanes.
#[inline(always)]
pub(super) fn weigh<S: Simd, const C: usize>(
    simd: S,
    quads: &Quads,
    pairs: &Pairs,
    meaning: Meaning,
    first: usize,
) -> Texels<S> {
    let range = first..first + S::f32s::LEN;
    let right = S::f32s::from_slice(simd, &quads.right_share.0[range.clone()]);
    let right = (right * WHOLE + 0.5).to_int::<S::u32s>();
    let weights = spread::<S, S::u32s>((right << 16) + (S::u32s::splat(simd, WHOLE as u32) - right));
    let lower = spread::<S, S::f32s>(S::f32s::from_slice(simd, &quads.lower_share.0[range]));
    let (upper_rows, lower_rows) = if pairs.are_bytes {
        (
            rows_of_bytes::<S, C>(simd, &pairs.upper_bytes, meaning, first),
            rows_of_bytes::<S, C>(simd, &pairs.lower_bytes, meaning, first),
        )
    } else {
        (rows::<S, C>(simd, &pairs.upper, first), rows::<S, C>(simd, &pairs.lower, first))
    };
    let mut values = [S::f32s::splat(simd, 0.0); 4];
    for part in 0..4 {
        let weights = weights[part].bitcast::<S::i16s>();
        let upper_row = upper_rows[part].pairwise_dot_product(weights).to_float::<S::f32s>();
        let lower_row = lower_rows[part].pairwise_dot_product(weights).to_float::<S::f32s>();
        values[part] = upper_row + (lower_row - upper_row) * lower[part];
    }
    values
}

/// From one value to another by a share per look-up.
#[inline(always)]
pub(super) fn mix_texels<S: Simd>(mut from: Texels<S>, to: Texels<S>, share: S::f32s) -> Texels<S> {
    let shares = spread::<S, S::f32s>(share);
    for part in 0..4 {
        from[part] += (to[part] - from[part]) * shares[part];
    }
    from
}

/// Writes the colours of the look-ups from `first` on: 1 for missing alpha.
#[inline(always)]
pub(super) fn store_texels<S: Simd, const C: usize>(
    simd: S,
    values: Texels<S>,
    out: &mut Colors,
    first: usize,
) {
    let (lanes, zero, one) = (S::f32s::LEN, S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    let out = &mut out.0.as_flattened_mut()[4 * first..4 * (first + lanes)];
    let alpha = S::u32s::block_splat(u32x4::from_slice(simd, &[0, 0, 0, 1])).simd_gt(S::u32s::splat(simd, 0));
    for part in 0..4 {
        // Between equal texels the sum may round to just below black.
        let mut color = (values[part] * DOT_UNIT + HALF).max(zero);
        if C != 4 {
            color = alpha.select(one, color);
        }
        color.store_slice(&mut out[part * lanes..(part + 1) * lanes]);
    }
}

/// Every number four times, in order, in four vectors.
#[inline(always)]
fn spread<S: Simd, V: SimdBase<S>>(numbers: V) -> [V; 4] {
    let (low, high) = numbers.interleave(numbers);
    let ((a, b), (c, d)) = (low.interleave(low), high.interleave(high));
    [a, b, c, d]
}

/// Rows that are stored as 16-bit numbers, as signed pairs.
#[inline(always)]
fn rows<S: Simd, const C: usize>(simd: S, words: &Block<[u64; 2]>, first: usize) -> [S::i16s; 4] {
    const { assert!(matches!(C, 1 | 3 | 4)) };
    let order: [u8; 16] = match C {
        1 => [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3],
        3 => [0, 1, 6, 7, 2, 3, 8, 9, 4, 5, 10, 11, 4, 5, 10, 11],
        _ => [0, 1, 8, 9, 2, 3, 10, 11, 4, 5, 12, 13, 6, 7, 14, 15],
    };
    let order = S::u8s::block_splat(u8x16::from_slice(simd, &order));
    let lanes = S::u64s::LEN;
    let words = &words.0.as_flattened()[2 * first..2 * first + 4 * lanes];
    let sign = S::u16s::splat(simd, 0x8000);
    let mut rows = [S::i16s::splat(simd, 0); 4];
    for (part, words) in rows.iter_mut().zip(words.chunks_exact(lanes)) {
        let bytes = S::u64s::from_slice(simd, words).bitcast::<S::u8s>().swizzle_dyn_within_blocks(order);
        *part = (bytes.bitcast::<S::u16s>() ^ sign).bitcast::<S::i16s>();
    }
    rows
}

/// Rows that are stored as bytes, as signed pairs of 16-bit numbers.
#[inline(always)]
fn rows_of_bytes<S: Simd, const C: usize>(
    simd: S,
    bytes: &Block<u64>,
    meaning: Meaning,
    first: usize,
) -> [S::i16s; 4] {
    let order: [u8; 16] = match C {
        1 => [0, 1, 0, 1, 0, 1, 0, 1, 8, 9, 8, 9, 8, 9, 8, 9],
        3 => [0, 3, 1, 4, 2, 5, 2, 5, 8, 11, 9, 12, 10, 13, 10, 13],
        _ => [0, 4, 1, 5, 2, 6, 3, 7, 8, 12, 9, 13, 10, 14, 11, 15],
    };
    let order = S::u8s::block_splat(u8x16::from_slice(simd, &order));
    let lanes = S::u64s::LEN;
    let bytes = &bytes.0[first..first + 2 * lanes];
    let near =
        S::u64s::from_slice(simd, &bytes[..lanes]).bitcast::<S::u8s>().swizzle_dyn_within_blocks(order);
    let far = S::u64s::from_slice(simd, &bytes[lanes..]).bitcast::<S::u8s>().swizzle_dyn_within_blocks(order);
    let ([a, b], [c, d]) = (signed_pairs(simd, near, meaning), signed_pairs(simd, far, meaning));
    [a, b, c, d]
}

// ---- Bytes as linear numbers of 16 bits, as which the coarser levels are stored anyway: then all texels are alike.
//
// Rounding costs at most 8e-6, an eighth of what separates the two darkest bytes in sRGB.

/// The linear 16-bit number of every byte in sRGB: its lower and its upper byte.
struct Curve {
    low: [u8; 256],
    high: [u8; 256],
}

static CURVE: LazyLock<Curve> = LazyLock::new(|| {
    let whole = linear_from_srgb8_table().map(unorm16);
    Curve { low: whole.map(|number| number as u8), high: whole.map(|number| (number >> 8) as u8) }
});

/// The linear 16-bit number of every byte at each of four places, shifted to its place in a word of four.
pub(super) struct Words([[u64; 256]; 4]);

impl Words {
    fn of(meaning: Meaning) -> Self {
        let curve = linear_from_srgb8_table().map(unorm16);
        let number = |place: usize, byte: usize| {
            let is_linear = !meaning.is_srgb || meaning.has_alpha && place == 3;
            if is_linear { byte as u16 * 257 } else { curve[byte] }
        };
        Self(std::array::from_fn(|place| {
            std::array::from_fn(|byte| u64::from(number(place, byte)) << (16 * place))
        }))
    }
}

/// Of linear numbers, of sRGB, and of sRGB with alpha.
static WORDS: LazyLock<[Words; 3]> = LazyLock::new(|| {
    [(false, false), (true, false), (true, true)]
        .map(|(is_srgb, has_alpha)| Words::of(Meaning { is_srgb, has_alpha }))
});

#[derive(Clone, Copy, Debug)]
pub(super) struct Meaning {
    pub(super) is_srgb: bool,
    /// Whether every fourth byte is alpha, which is always linear.
    pub(super) has_alpha: bool,
}

impl Meaning {
    #[inline]
    pub(super) fn words(self) -> &'static Words {
        let [linear, opaque, with_alpha] = &*WORDS;
        match self {
            Self { is_srgb: false, .. } => linear,
            Self { has_alpha: false, .. } => opaque,
            _ => with_alpha,
        }
    }
}

/// Eight bytes as eight numbers of 16 bits, the first in the least significant bits.
#[inline(always)]
pub(super) fn widened(bytes: u64, Words(words): &Words) -> [u64; 2] {
    let [a, b, c, d, e, f, g, h] = bytes.to_le_bytes().map(usize::from);
    let word = |a: usize, b: usize, c: usize, d: usize| words[0][a] | words[1][b] | words[2][c] | words[3][d];
    [word(a, b, c, d), word(e, f, g, h)]
}

/// Whether bytes are widened in vectors: numbers in sRGB only where one instruction looks up 64 bytes in tables of 128; with shorter
/// vectors, one by one is as fast.
#[inline(always)]
fn widens_in_vectors<S: Simd>(meaning: Meaning) -> bool {
    !meaning.is_srgb || S::u8s::LEN == 64
}

/// [`widened`] for a block.
#[inline(always)]
pub(super) fn widen<S: Simd>(
    simd: S,
    bytes: &Block<u64>,
    meaning: Meaning,
    out: &mut Block<[u64; 2]>,
    count: usize,
) {
    if widens_in_vectors::<S>(meaning) {
        let lanes = S::u64s::LEN;
        for first in (0..count).step_by(lanes) {
            let codes = S::u64s::from_slice(simd, &bytes.0[first..first + lanes]).bitcast::<S::u8s>();
            let [near, far] = widened_bytes(simd, codes, meaning);
            let out = out.0[first..first + lanes].as_flattened_mut();
            near.bitcast::<S::u64s>().store_slice(&mut out[..lanes]);
            far.bitcast::<S::u64s>().store_slice(&mut out[lanes..]);
        }
    } else {
        let words = meaning.words();
        for (bytes, out) in bytes.0[..count].iter().zip(&mut out.0) {
            *out = widened(*bytes, words);
        }
    }
}

/// [`widened`] for vectors that [may be](widens_in_vectors).
#[inline(always)]
fn widened_bytes<S: Simd>(simd: S, codes: S::u8s, meaning: Meaning) -> [S::u8s; 2] {
    let alpha = S::u32s::splat(simd, 0xff00_0000).bitcast::<S::u8s>();
    let (low, high) = numbers(simd, codes, meaning, alpha);
    let (near, far) = low.interleave(high);
    [near, far]
}

/// The same less a half, so that numbers have a sign, of bytes of two texels that stand in pairs by channel.
#[inline(always)]
pub(super) fn signed_pairs<S: Simd>(simd: S, codes: S::u8s, meaning: Meaning) -> [S::i16s; 2] {
    let alpha = S::u64s::splat(simd, 0xffff_0000_0000_0000).bitcast::<S::u8s>();
    let (low, high) = numbers(simd, codes, meaning, alpha);
    let (near, far) = low.interleave(high ^ 0x80);
    [near.bitcast::<S::i16s>(), far.bitcast::<S::i16s>()]
}

/// The lower and the upper bytes of the linear numbers. Bits of `alpha` are set where there is alpha.
#[inline(always)]
fn numbers<S: Simd>(simd: S, codes: S::u8s, meaning: Meaning, alpha: S::u8s) -> (S::u8s, S::u8s) {
    if !meaning.is_srgb {
        return (codes, codes);
    }
    let curve = &*CURVE;
    let (low, high) = (look_up(simd, &curve.low, codes), look_up(simd, &curve.high, codes));
    if !meaning.has_alpha {
        return (low, high);
    }
    ((low & !alpha) | (codes & alpha), (high & !alpha) | (codes & alpha))
}

/// The table's entries, for vectors of 64 bytes.
#[inline(always)]
fn look_up<S: Simd>(simd: S, table: &[u8; 256], codes: S::u8s) -> S::u8s {
    let a = S::u8s::from_slice(simd, &table[..64]);
    let b = S::u8s::from_slice(simd, &table[64..128]);
    let c = S::u8s::from_slice(simd, &table[128..192]);
    let d = S::u8s::from_slice(simd, &table[192..]);
    let within = codes & 0x7f;
    let is_upper = codes.simd_ge(S::u8s::splat(simd, 0x80));
    is_upper.select(c.concat_swizzle_dyn(d, within), a.concat_swizzle_dyn(b, within))
}

#[cfg(test)]
mod tests {
    use fantex_base::vector_level;
    use fearless_simd::{Level, dispatch};

    use super::*;
    use crate::color::unit_from_u8_table;

    /// What a block of look-ups between equal rows gives, whose left and right texels are these.
    fn between<const C: usize>(row: [u16; 8]) -> Colors {
        between_on::<C>(vector_level(), row)
    }

    fn between_on<const C: usize>(level: Level, row: [u16; 8]) -> Colors {
        let [a, b] =
            [0, 4].map(|first| (0..4).fold(0, |word, k| word | u64::from(row[first + k]) << (16 * k)));
        let mut pairs = Pairs::new();
        (pairs.upper, pairs.lower) = (Block([[a, b]; BLOCK]), Block([[a, b]; BLOCK]));
        let mut quads = Quads::new();
        quads.right_share = Block(std::array::from_fn(|index| index as f32 / BLOCK as f32));
        quads.lower_share = Block(std::array::from_fn(|index| (index * 37 % BLOCK) as f32 / BLOCK as f32));
        let (meaning, mut out) = (Meaning { is_srgb: false, has_alpha: C == 4 }, Colors::black());
        dispatch!(level, simd => all::<_, C>(simd, &quads, &pairs, meaning, &mut out));
        out
    }

    #[inline(always)]
    fn all<S: Simd, const C: usize>(
        simd: S,
        quads: &Quads,
        pairs: &Pairs,
        meaning: Meaning,
        out: &mut Colors,
    ) {
        for first in (0..BLOCK).step_by(S::f32s::LEN) {
            store_texels::<S, C>(simd, weigh::<S, C>(simd, quads, pairs, meaning, first), out, first);
        }
    }

    #[test]
    fn black_is_zero_and_white_is_one() {
        assert_eq!(between::<4>([0; 8]).0, [[0.0; 4]; BLOCK]);
        assert_eq!(between::<4>([u16::MAX; 8]).0, [[1.0; 4]; BLOCK]);
        assert_eq!(between::<3>([0; 8]).0, [[0.0, 0.0, 0.0, 1.0]; BLOCK]);
        assert_eq!(between::<1>([u16::MAX; 8]).0, [[1.0; 4]; BLOCK]);
    }

    /// The widest vectors of the processor, and narrower ones.
    fn levels() -> Vec<Level> {
        #[cfg(target_arch = "x86_64")]
        let narrower = vector_level().as_avx2().map(Level::Avx2);
        #[cfg(not(target_arch = "x86_64"))]
        let narrower = None;
        [Some(Level::baseline()), narrower, Some(vector_level())].into_iter().flatten().collect()
    }

    #[test]
    fn narrower_vectors_give_the_same() {
        let row = [1_000, 20_000, 65_535, 0, 60_000, 10, 40_000, 3_333];
        for level in levels() {
            assert_eq!(between_on::<4>(level, row).0, between::<4>(row).0);
            assert_eq!(between_on::<3>(level, row).0, between::<3>(row).0);
            assert_eq!(between_on::<1>(level, row).0, between::<1>(row).0);
        }
    }

    #[test]
    fn channels_stay_apart() {
        let row = [1_000, 20_000, 65_535, 0, 60_000, 10, 40_000, 3_333];
        let [four, three, one] = [between::<4>(row), between::<3>(row), between::<1>(row)];
        for index in 0..BLOCK {
            let share = index as f32 / BLOCK as f32;
            let value = |left: usize, right: usize| {
                let [left, right] = [left, right].map(|place| f32::from(row[place]) / 65_535.0);
                left + (right - left) * share
            };
            let expected = [
                ([value(0, 4), value(1, 5), value(2, 6), value(3, 7)], four.0[index]),
                ([value(0, 3), value(1, 4), value(2, 5), 1.0], three.0[index]),
                ([value(0, 1), value(0, 1), value(0, 1), 1.0], one.0[index]),
            ];
            for (expected, got) in expected {
                let is_near = |(a, b): (&f32, f32)| (a - b).abs() < 1.6e-5;
                assert!(expected.iter().zip(got).all(is_near), "{share}: {got:?}, expected {expected:?}");
            }
        }
    }

    #[test]
    fn bytes_are_widened_to_rounded_linear_numbers() {
        let bytes: [[u8; 8]; BLOCK] =
            std::array::from_fn(|i| std::array::from_fn(|k| (9 * i + 31 * k) as u8));
        let words = Block(bytes.map(u64::from_le_bytes));
        for (is_srgb, has_alpha) in [(false, false), (false, true), (true, false), (true, true)] {
            let meaning = Meaning { is_srgb, has_alpha };
            let number = |place: usize, byte: u8| {
                let is_encoded = is_srgb && !(has_alpha && place % 4 == 3);
                let table = if is_encoded { linear_from_srgb8_table() } else { unit_from_u8_table() };
                (table[usize::from(byte)] * 65_535.0).round() as u64
            };
            let word = |bytes: &[u8; 8], first: usize| {
                (0..4).map(|k| number(first + k, bytes[first + k]) << (16 * k)).sum::<u64>()
            };
            let expected = bytes.each_ref().map(|bytes| [word(bytes, 0), word(bytes, 4)]);
            for level in levels() {
                let mut out = Block([[0; 2]; BLOCK]);
                dispatch!(level, simd => widen(simd, &words, meaning, &mut out, BLOCK));
                assert_eq!(out.0, expected, "{meaning:?}, {level:?}");
            }
            assert_eq!(words.0.map(|bytes| widened(bytes, meaning.words())), expected, "{meaning:?}");
        }
    }
}
