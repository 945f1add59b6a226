//! BC7 selectors that pack well, at no greater error than the encoder's.
//!
//! A block of mode 6 stores two end points and, per texel, a selector of one of 16 values from one to the other. Selectors are two thirds of what is
//! stored once packed, as the encoder's look random to a compressor. But where end points are near each other several selectors give the same
//! value, and elsewhere the next one is often hardly worse. So a few are preferred:
//!
//! ```text
//!  0    4  8  12    2  6  10  14    odd ones
//! ```
//!
//! A texel takes the selector of least `squared error + weight * bits` (G. J. Sullivan, T. Wiegand, Rate-Distortion Optimization for
//! Video Compression, 1998), with supposed bits, and the greatest weight of a few at which the block's error is not above that of the encoder's
//! selectors. The encoder's are not the best ones, which is what pays for cheap ones. A block depends on its texels only: equal ones stay
//! equal, and repeat. `docs/benchmarks.md` has the figures.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16};

use crate::packing;

/// Texels of a block, row-major.
pub(super) type Texels = [[u8; 4]; 16];

/// Weights of bits are powers of this, times [`FIRST_WEIGHT`] and the block's error.
const WEIGHT_STEP: f32 = 0.35;

const MAX_WEIGHTS: u32 = 4;

const FIRST_WEIGHT: f32 = 0.06;

/// Without an error, selectors of equal values are chosen among.
const MIN_WEIGHT: f32 = 0.02;

/// Supposed bits of a selector.
const SELECTOR_BITS: [f32; 16] =
    [2.0, 6.0, 4.0, 6.0, 3.0, 6.0, 4.0, 6.0, 3.0, 6.0, 4.0, 6.0, 3.0, 6.0, 4.0, 6.0];

/// Selectors of equal bits: every so many from a first one on.
#[derive(Clone, Copy)]
struct Class {
    first: usize,
    step: usize,
    bits: f32,
}

impl Class {
    const fn new(first: usize, step: usize) -> Self {
        Self { first, step, bits: SELECTOR_BITS[first] }
    }
}

const CLASSES: [Class; 4] = [Class::new(0, 16), Class::new(1, 2), Class::new(2, 4), Class::new(4, 4)];

/// The selectors of a class with the least errors, the lowest of equal ones, whatever the weight of bits.
#[derive(Clone, Copy)]
struct Best<S: Simd> {
    error: f32x16<S>,
    selector: f32x16<S>,
}

/// Places of selectors between the end points, in 64ths.
const SELECTOR_PLACES: [i32; 16] = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];

/// Replaces selectors of BC7 blocks of mode 6; others stay as they are. `alpha`: if alpha counts.
pub(super) fn prefer_cheap(alpha: bool, blocks: &mut [u8], texels: impl Iterator<Item = Texels>) {
    dispatch!(packing::level(), simd => prefer_cheap_in(simd, alpha, blocks, texels));
}

#[inline(always)]
fn prefer_cheap_in<S: Simd>(simd: S, alpha: bool, blocks: &mut [u8], texels: impl Iterator<Item = Texels>) {
    let channels = if alpha { 4 } else { 3 };
    for (block, texels) in blocks.as_chunks_mut().0.iter_mut().zip(texels) {
        prefer_cheap_in_block(simd, block, &texels, channels);
    }
}

// Loops, as calls of `map` and `from_fn` are not compiled for the processor's vectors.

#[inline(always)]
fn prefer_cheap_in_block<S: Simd>(simd: S, bytes: &mut [u8; 16], texels: &Texels, channels: usize) {
    if bytes[0] & 127 != 64 {
        return;
    }
    let (ends, bits) = (word(bytes, 0), word(bytes, 8));
    let mut errors = [f32x16::splat(simd, 0.0); 16];
    for c in 0..channels {
        let channel = channel_of(simd, texels, c);
        let a = ((ends >> (7 + 14 * c)) as i32 & 127) << 1 | (ends >> 63) as i32;
        let b = ((ends >> (14 + 14 * c)) as i32 & 127) << 1 | bits as i32 & 1;
        let mut values = [0.0; 16];
        for (value, place) in values.iter_mut().zip(SELECTOR_PLACES) {
            *value = (((64 - place) * a + place * b + 32) >> 6) as f32;
        }
        for (errors, value) in errors.iter_mut().zip(values) {
            let difference = channel - value;
            *errors += difference * difference;
        }
    }
    // The highest bit of the first texel's selector is not stored, but zero.
    let mut never = [0.0; 16];
    never[0] = f32::INFINITY;
    for errors in &mut errors[8..] {
        *errors += f32x16::from_slice(simd, &never);
    }
    let mut selectors = [0; 16];
    for (i, selector) in selectors.iter_mut().enumerate() {
        *selector = (bits >> (4 * i)) as u8 & 15;
    }
    selectors[0] >>= 1;
    if cheapest(simd, &errors, &mut selectors) {
        selectors[0] = selectors[0] << 1 | bits as u8 & 1;
        for (byte, pair) in bytes[8..].iter_mut().zip(selectors.as_chunks::<2>().0) {
            *byte = pair[0] | pair[1] << 4;
        }
    }
}

#[inline(always)]
fn word(bytes: &[u8; 16], at: usize) -> u64 {
    let mut word = [0; 8];
    word.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(word)
}

#[inline(always)]
fn channel_of<S: Simd>(simd: S, texels: &Texels, c: usize) -> f32x16<S> {
    let mut channel = [0.0; 16];
    for (value, texel) in channel.iter_mut().zip(texels) {
        *value = f32::from(texel[c]);
    }
    f32x16::from_slice(simd, &channel)
}

/// Replaces selectors by cheaper ones whose errors, `errors[selector][texel]`, are no greater in all. False if there are none.
#[inline(always)]
fn cheapest<S: Simd>(simd: S, errors: &[f32x16<S>; 16], selectors: &mut [u8; 16]) -> bool {
    let (mut own, mut own_bits) = ([0.0; 16], 0.0);
    for (i, selector) in selectors.iter().enumerate() {
        own[i] = f32::from(*selector);
        own_bits += SELECTOR_BITS[usize::from(*selector)];
    }
    let own = f32x16::from_slice(simd, &own);
    let mut error = f32x16::splat(simd, 0.0);
    for (selector, &errors) in errors.iter().enumerate() {
        error = own.simd_eq(selector as f32).select(errors, error);
    }
    let allowed = sum(error);
    let mut best = [Best { error: errors[0], selector: f32x16::splat(simd, 0.0) }; CLASSES.len()];
    for (best, class) in best.iter_mut().zip(CLASSES) {
        *best = Best { error: errors[class.first], selector: f32x16::splat(simd, class.first as f32) };
        for selector in (class.first + class.step..16).step_by(class.step) {
            let is_less = errors[selector].simd_lt(best.error);
            best.error = is_less.select(errors[selector], best.error);
            best.selector = is_less.select(f32x16::splat(simd, selector as f32), best.selector);
        }
    }
    let mut weight = FIRST_WEIGHT * allowed + MIN_WEIGHT;
    for _ in 0..MAX_WEIGHTS {
        let Best { mut error, selector: mut chosen } = best[0];
        let mut least = error + weight * CLASSES[0].bits;
        for (best, class) in best.iter().zip(CLASSES).skip(1) {
            let cost = best.error + weight * class.bits;
            // Of equal ones that of the lowest number.
            let is_less = cost.simd_lt(least) | (cost.simd_eq(least) & best.selector.simd_lt(chosen));
            least = is_less.select(cost, least);
            error = is_less.select(best.error, error);
            chosen = is_less.select(best.selector, chosen);
        }
        if sum(error) <= allowed {
            let (mut choice, mut choice_bits) = ([0; 16], 0.0);
            for (choice, &selector) in choice.iter_mut().zip(chosen.as_slice()) {
                *choice = selector as u8;
                choice_bits += SELECTOR_BITS[usize::from(*choice)];
            }
            let is_cheaper = choice_bits < own_bits;
            if is_cheaper {
                *selectors = choice;
            }
            return is_cheaper;
        }
        weight *= WEIGHT_STEP;
    }
    false
}

/// In this order on all processors.
#[inline(always)]
fn sum<S: Simd>(values: f32x16<S>) -> f32 {
    let mut sums = [0.0; 16];
    values.store_slice(&mut sums);
    for half in [8, 4, 2, 1] {
        for i in 0..half {
            sums[i] += sums[i + half];
        }
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use fantex_base::random::nth_random;
    use fearless_simd::Level;

    use super::*;
    use crate::encode::{Quality, blocks_of_row, encode_strip};
    use crate::{TexelFormat, decode};

    const WIDTH: usize = 4096;

    /// Four rows: waves of a height, a flat part, and noise of some strength.
    fn strip(height: f32, noise: u64, alpha: bool) -> Vec<[u8; 4]> {
        let texel = |i: usize| {
            let [x, y] = [i % WIDTH, i / WIDTH].map(|n| n as f32);
            let random = nth_random(noise, i as u64);
            let mut texel = [77; 4];
            for (c, value) in texel.iter_mut().enumerate().filter(|_| x > 200.0) {
                let grain = (random >> (16 * c) & 0xffff) * noise / 0xffff;
                let phase = (0.011 + 0.007 * c as f32) * x + 0.05 * y;
                *value = (100.0 + height * phase.sin()) as u8 + grain as u8;
            }
            texel[3] = if alpha { texel[3] } else { 255 };
            texel
        };
        (0..4 * WIDTH).map(texel).collect()
    }

    /// Of each block as the decoder has it, in squares of 1/255.
    fn errors(alpha: bool, texels: &[[u8; 4]], bytes: &[u8]) -> Vec<f32> {
        let channels = if alpha { 4 } else { 3 };
        let error = |(block, texels): (&[u8; 16], Texels)| {
            let decoded = decode(TexelFormat::Bc7, [4, 4], block).unwrap();
            let squares = decoded.iter().zip(texels).flat_map(|(decoded, texel)| {
                (0..channels).map(move |c| (decoded[c] * 255.0 - f32::from(texel[c])).powi(2))
            });
            squares.sum()
        };
        bytes.as_chunks().0.iter().zip(blocks_of_row(texels)).map(error).collect()
    }

    fn packed(bytes: &[u8]) -> f32 {
        let mut rearranged = vec![0; bytes.len()];
        packing::pack(TexelFormat::Bc7, bytes, &mut rearranged);
        let (ends, selectors) = rearranged.split_at(bytes.len() / 2);
        [ends, selectors].map(|bytes| zstd::bulk::compress(bytes, 1).unwrap().len() as f32).iter().sum()
    }

    fn cheap(alpha: bool, texels: &[[u8; 4]], bytes: &[u8]) -> Vec<u8> {
        let mut cheap = bytes.to_vec();
        prefer_cheap(alpha, &mut cheap, blocks_of_row(texels));
        cheap
    }

    #[test]
    fn no_block_is_worse_and_strips_are_smaller() {
        for (height, noise, share) in [(8.0, 0, 0.9), (8.0, 3, 0.98), (90.0, 3, 1.0), (90.0, 60, 1.0)] {
            for alpha in [false, true] {
                let texels = strip(height, noise, alpha);
                for (quality, share) in [(Quality::UltraFast, share), (Quality::VeryFast, 1.0)] {
                    let bytes = encode_strip(TexelFormat::Bc7, quality, alpha, &[&texels]);
                    let cheap = cheap(alpha, &texels, &bytes);
                    let [before, after] = [&bytes, &cheap].map(|bytes| errors(alpha, &texels, bytes));
                    for (block, (before, after)) in before.iter().zip(&after).enumerate() {
                        assert!(*after <= before + 0.01, "block {block}: {before} {after}");
                    }
                    let [before, after] = [&bytes, &cheap].map(|bytes| packed(bytes));
                    assert!(after <= share * before, "{quality:?} {height} {noise}: {before} {after}");
                }
            }
        }
    }

    /// Whatever the block, as encoders may write any.
    #[test]
    fn end_points_and_blocks_of_other_modes_stay() {
        let texels = strip(90.0, 60, true);
        let mut blocks = vec![[0; 16]; WIDTH / 4];
        for (n, block) in blocks.iter_mut().enumerate() {
            for (i, byte) in block.iter_mut().enumerate() {
                *byte = nth_random(7, (16 * n + i) as u64) as u8;
            }
            if n % 2 == 0 {
                block[0] = block[0] & 0x80 | 0x40;
            }
        }
        for alpha in [false, true] {
            let bytes = blocks.as_flattened();
            let cheap = cheap(alpha, &texels, bytes);
            let [before, after] = [bytes, &cheap].map(|bytes| errors(alpha, &texels, bytes));
            assert!(before.iter().zip(after).all(|(before, after)| after <= before + 0.01));
            for (old, new) in blocks.iter().zip(cheap.as_chunks::<16>().0) {
                assert_eq!(old[..8], new[..8]);
                // The lowest bit belongs to the second end point.
                assert_eq!(old[8] & 1, new[8] & 1);
                assert!(old[0] & 127 == 64 || old == new);
            }
            assert_ne!(bytes, cheap);
        }
    }

    #[test]
    fn all_instruction_sets_choose_alike() {
        for (alpha, noise) in [(false, 3), (true, 9)] {
            let texels = strip(30.0, noise, alpha);
            let bytes = encode_strip(TexelFormat::Bc7, Quality::UltraFast, alpha, &[&texels]);
            let best = cheap(alpha, &texels, &bytes);
            let mut plain = bytes.clone();
            let blocks = blocks_of_row(&texels);
            dispatch!(Level::baseline(), simd => prefer_cheap_in(simd, alpha, &mut plain, blocks));
            assert_eq!(best, plain);
            assert_ne!(best, bytes);
        }
    }
}
