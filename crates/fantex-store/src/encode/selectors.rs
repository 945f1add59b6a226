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

use fantex_base::vector_level;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16, i32x16, u32x8, u32x16};

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
const SELECTOR_PLACES: [f32; 16] =
    [0.0, 4.0, 9.0, 13.0, 17.0, 21.0, 26.0, 30.0, 34.0, 38.0, 43.0, 47.0, 51.0, 55.0, 60.0, 64.0];

/// Replaces selectors of BC7 blocks of mode 6; others stay as they are. `alpha`: if alpha counts.
pub(super) fn prefer_cheap(alpha: bool, blocks: &mut [u8], texels: impl Iterator<Item = Texels>) {
    dispatch!(vector_level(), simd => prefer_cheap_in(simd, alpha, blocks, texels));
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
    let own = selectors_of(simd, bits);
    let own_places = (own * (64.0 / 15.0) + 0.5).floor();
    // Sixteen times a selector's error, and the selector: all numbers here are integers that single precision holds, so that the least one
    // tells both, and fused products are not rounded.
    let mut numbered = [f32x16::splat(simd, 0.0); 16];
    for (number, numbered) in numbered.iter_mut().enumerate() {
        *numbered = f32x16::splat(simd, number as f32);
    }
    let mut error = f32x16::splat(simd, 0.0);
    let texels = texels_of(simd, texels);
    let places = f32x16::from_slice(simd, &SELECTOR_PLACES);
    let half = f32x16::splat(simd, 0.5);
    for c in 0..channels {
        let channel = ((texels >> (8 * c as u32)) & 255).bitcast::<i32x16<S>>().to_float::<f32x16<S>>();
        let a = ((ends >> (7 + 14 * c)) as i32 & 127) << 1 | (ends >> 63) as i32;
        let b = ((ends >> (14 + 14 * c)) as i32 & 127) << 1 | bits as i32 & 1;
        let from_a = channel - a as f32;
        // What decoders add to the first end point, at the selectors' places.
        let step = f32x16::splat(simd, (b - a) as f32 / 64.0);
        let difference = from_a - own_places.mul_add(step, half).floor();
        error = difference.mul_add(difference, error);
        let mut added = [0.0; 16];
        (places.mul_add(step, half).floor() * 4.0).store_slice(&mut added);
        let from_a = from_a * 4.0;
        for (numbered, added) in numbered.iter_mut().zip(added) {
            let difference = from_a - added;
            *numbered = difference.mul_add(difference, *numbered);
        }
    }
    // The highest bit of the first texel's selector is not stored, but zero.
    let mut never = [0.0; 16];
    never[0] = f32::INFINITY;
    for numbered in &mut numbered[8..] {
        *numbered += f32x16::from_slice(simd, &never);
    }
    if let Some(chosen) = cheapest(simd, &numbered, error.reduce_sum()) {
        let shifted =
            chosen.to_int::<i32x16<S>>().bitcast::<u32x16<S>>() << u32x16::from_slice(simd, &SHIFTS);
        let mut parts = [0; 16];
        shifted.store_slice(&mut parts);
        let mut halves = [0; 2];
        for (half, parts) in halves.iter_mut().zip(parts.as_chunks::<8>().0) {
            *half = parts.iter().fold(0, |all, part| all | part);
        }
        let word = u64::from(halves[0]) | u64::from(halves[1]) << 32 | bits & 1;
        if bits_of(word) < bits_of(bits) {
            bytes[8..].copy_from_slice(&word.to_le_bytes());
        }
    }
}

/// Where selectors lie in their half of a block's second word. That of the first texel has three bits, above one of an end point.
const SHIFTS: [u32; 16] = [1, 4, 8, 12, 16, 20, 24, 28, 0, 4, 8, 12, 16, 20, 24, 28];

/// The selectors of a block's second word.
#[inline(always)]
fn selectors_of<S: Simd>(simd: S, bits: u64) -> f32x16<S> {
    let halves = [bits as u32, (bits >> 32) as u32].map(|half| u32x8::splat(simd, half));
    let mut masks = [15; 16];
    masks[0] = 7;
    let bits: u32x16<S> = halves[0].combine(halves[1]);
    let selectors = (bits >> u32x16::from_slice(simd, &SHIFTS)) & u32x16::from_slice(simd, &masks);
    selectors.bitcast::<i32x16<S>>().to_float::<f32x16<S>>()
}

/// The supposed bits of its selectors, counted four bits at a time.
fn bits_of(word: u64) -> f32 {
    const LOWEST: u64 = 0x1111_1111_1111_1111;
    let word = word & !15 | word >> 1 & 7;
    let odd = word & LOWEST;
    let of_two = word >> 1 & LOWEST & !odd;
    let of_four = (word >> 2 | word >> 3) & LOWEST & !odd & !of_two;
    let [odd, of_two, of_four] = [odd, of_two, of_four].map(u64::count_ones);
    let [of_none, of_odd, of_twos, of_fours] = [0, 1, 2, 4].map(|selector| SELECTOR_BITS[selector]);
    let none = 16 - odd - of_two - of_four;
    [(none, of_none), (odd, of_odd), (of_two, of_twos), (of_four, of_fours)]
        .iter()
        .map(|&(count, bits)| count as f32 * bits)
        .sum()
}

#[inline(always)]
fn word(bytes: &[u8; 16], at: usize) -> u64 {
    let mut word = [0; 8];
    word.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(word)
}

#[inline(always)]
fn texels_of<S: Simd>(simd: S, texels: &Texels) -> u32x16<S> {
    let mut words = [0; 16];
    for (word, texel) in words.iter_mut().zip(texels) {
        *word = u32::from_le_bytes(*texel);
    }
    u32x16::from_slice(simd, &words)
}

/// Cheap selectors whose errors are not above what is allowed in all. `numbered[selector][texel]`: sixteen times the error, and the selector.
#[inline(always)]
fn cheapest<S: Simd>(simd: S, numbered: &[f32x16<S>; 16], allowed: f32) -> Option<f32x16<S>> {
    let none = f32x16::splat(simd, 0.0);
    let mut best = [Best { error: none, selector: none }; CLASSES.len()];
    for (best, class) in best.iter_mut().zip(CLASSES) {
        let mut least = numbered[class.first];
        for selector in (class.first + class.step..16).step_by(class.step) {
            least = least.min(numbered[selector]);
        }
        best.error = (least * (1.0 / 16.0)).floor();
        best.selector = least - best.error * 16.0;
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
        if error.reduce_sum() <= allowed {
            return Some(chosen);
        }
        weight *= WEIGHT_STEP;
    }
    None
}

#[cfg(test)]
mod tests {
    use fantex_base::random::nth_random;
    use fearless_simd::Level;

    use super::*;
    use crate::encode::{Quality, blocks_of_row, encode_strip};
    use crate::{TexelFormat, decode, packing};

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
