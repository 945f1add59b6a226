//! Interpolation of whole texels: four channels of a look-up beside each other, by products of 16-bit numbers.
//!
//! ```text
//!  stored       l.r l.g l.b l.a r.r r.g r.b r.a      two neighbouring texels of a row
//!  paired       l.r r.r l.g r.g l.b r.b l.a r.a
//!  weights       L   R   L   R   L   R   L   R       of 15 bits, whose sum is always the same
//!  products      red     green   blue    alpha       of 32 bits: one instruction multiplies and adds pairs
//! ```
//!
//! No channel needs to be moved to a vector of its own and back, and two texels cost one multiplication. Rounding the weights
//! costs at most 1.6e-5 of the difference of the two texels. Numbers are made signed for the product by subtracting a half.
//! Where alpha weighs colours, `decode.rs` does the same with a vector per channel.

use fearless_simd::{Select, Simd, prelude::*, u8x16, u32x4};

use super::place::Quads;
use super::texels::Pairs;
use super::widen::{Meaning, signed_pairs};
use super::{Block, Colors};

/// The sum of the weights of two texels.
const WHOLE: f32 = 32767.0;

/// What products are multiplied by in the end, and what is added then: the half that was subtracted. Black becomes 0 exactly.
const UNIT: f32 = 1.0 / (65535.0 * WHOLE);
const HALF: f32 = 32768.0 * WHOLE * UNIT;

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
        let mut color = (values[part] * UNIT + HALF).max(zero);
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

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::super::{BLOCK, level};
    use super::*;

    /// What a block of look-ups between equal rows gives, whose left and right texels are these.
    fn between<const C: usize>(row: [u16; 8]) -> Colors {
        between_on::<C>(level(), row)
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

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn narrower_vectors_give_the_same() {
        let row = [1_000, 20_000, 65_535, 0, 60_000, 10, 40_000, 3_333];
        let narrower = [level().as_avx2().map(Level::Avx2), level().as_sse4_2().map(Level::Sse4_2)];
        for level in narrower.into_iter().flatten() {
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
}
