//! Bytes as linear numbers of 16 bits, as which the coarser levels are stored anyway: then all texels are alike.
//!
//! Rounding costs at most 8e-6, an eighth of what separates the two darkest bytes in sRGB.

use std::sync::LazyLock;

use fearless_simd::{Simd, prelude::*};

use super::Block;
use crate::color::{linear_from_srgb8_table, unorm16};

/// The linear 16-bit number of every byte in sRGB: whole, and as the lower and the upper byte.
struct Curve {
    whole: [u16; 256],
    low: [u8; 256],
    high: [u8; 256],
}

static CURVE: LazyLock<Curve> = LazyLock::new(|| {
    let whole = linear_from_srgb8_table().map(unorm16);
    Curve { whole, low: whole.map(|number| number as u8), high: whole.map(|number| (number >> 8) as u8) }
});

/// How bytes are to be understood.
#[derive(Clone, Copy, Debug)]
pub(in crate::filter) struct Meaning {
    pub(in crate::filter) is_srgb: bool,
    /// Whether every fourth byte is alpha, which is always linear.
    pub(in crate::filter) has_alpha: bool,
}

/// Eight bytes as eight numbers of 16 bits, the first in the least significant bits.
#[inline(always)]
pub(super) fn widened(bytes: u64, meaning: Meaning) -> [u64; 2] {
    let bytes = bytes.to_le_bytes();
    let word = |first: usize| {
        (0..4).fold(0, |word, place| {
            let byte = bytes[first + place];
            let is_color = !(meaning.has_alpha && place == 3);
            let number = if meaning.is_srgb && is_color {
                CURVE.whole[usize::from(byte)]
            } else {
                u16::from(byte) * 257
            };
            word | u64::from(number) << (16 * place)
        })
    };
    [word(0), word(4)]
}

/// Whether one instruction looks up 64 bytes in tables of 128; with shorter vectors, one by one is as fast.
#[inline(always)]
pub(super) fn has_byte_tables<S: Simd>() -> bool {
    S::u8s::LEN == 64
}

/// [`widened`] for a block.
#[inline(always)]
pub(in crate::filter) fn widen<S: Simd>(
    simd: S,
    bytes: &Block<u64>,
    meaning: Meaning,
    out: &mut Block<[u64; 2]>,
    count: usize,
) {
    if has_byte_tables::<S>() {
        for first in (0..count).step_by(8) {
            let codes = S::u64s::from_slice(simd, &bytes.0[first..first + 8]).bitcast::<S::u8s>();
            let alpha = S::u32s::splat(simd, 0xff00_0000).bitcast::<S::u8s>();
            let (low, high) = numbers(simd, codes, meaning, alpha);
            let (near, far) = low.interleave(high);
            let out = out.0[first..first + 8].as_flattened_mut();
            near.bitcast::<S::u64s>().store_slice(&mut out[..8]);
            far.bitcast::<S::u64s>().store_slice(&mut out[8..]);
        }
    } else {
        for (bytes, out) in bytes.0[..count].iter().zip(&mut out.0) {
            *out = widened(*bytes, meaning);
        }
    }
}

/// [`widened`] less a half, so that numbers have a sign, for vectors of 64 bytes in which the bytes of two texels stand in pairs
/// by channel.
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
    use fearless_simd::dispatch;

    use super::*;
    use crate::filter::BLOCK;
    use crate::filter::batch::level;

    #[test]
    fn vectors_and_single_bytes_widen_alike() {
        for is_srgb in [false, true] {
            for has_alpha in [false, true] {
                let meaning = Meaning { is_srgb, has_alpha };
                let bytes: [u64; BLOCK] =
                    std::array::from_fn(|i| u64::from_le_bytes(std::array::from_fn(|k| (8 * i + k) as u8)));
                let mut out = Block([[0; 2]; BLOCK]);
                dispatch!(level(), simd => widen(simd, &Block(bytes), meaning, &mut out, BLOCK));
                for (bytes, out) in bytes.into_iter().zip(out.0) {
                    assert_eq!(out, widened(bytes, meaning), "{meaning:?}, {bytes:x}");
                }
            }
        }
        let white = widened(u64::MAX, Meaning { is_srgb: true, has_alpha: false });
        assert_eq!(white, [u64::MAX; 2]);
    }
}
