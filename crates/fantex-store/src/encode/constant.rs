//! Blocks of one colour, as exact as their format can be.
//!
//! Encoders search end points for what varies, and may come out a step beside what does not. For one colour the best is known:
//!
//! - BC7, mode 6: end points have eight bits, whose lowest one all channels of an end point share. The colour is both end points, or in channels
//!   whose lowest bit is the other one half way between its neighbours. So it is exact unless a channel is 0 and another one 255.
//! - BC7, mode 5: end points have seven bits, and alpha has eight. Every number lies a third of the way between near ones.
//! - BC1: the nearest of what lies a third of the way, or half way, between near end points.
//!
//! Most BC7 blocks are of mode 6, and blocks that resemble their neighbours pack well: so it is taken where it is exact.

use super::{Block, OPAQUE_FROM};
use crate::TexelFormat;

/// Replaces blocks of one colour in what an encoder has made of `blocks`. None becomes zero bytes, which stand for what nothing reads.
pub(super) fn replace(format: TexelFormat, encoded: &mut [u8], blocks: impl Iterator<Item = Block>) {
    match format {
        TexelFormat::Bc1 => replace_blocks(encoded.as_chunks_mut::<8>().0, blocks, bc1),
        TexelFormat::Bc7 => replace_blocks(encoded.as_chunks_mut::<16>().0, blocks, |color| Some(bc7(color))),
        _ => {}
    }
}

fn replace_blocks<const BYTES: usize>(
    encoded: &mut [[u8; BYTES]],
    blocks: impl Iterator<Item = Block>,
    encode: impl Fn([u8; 4]) -> Option<[u8; BYTES]>,
) {
    // Flat parts have many blocks of a colour.
    let mut last: Option<([u8; 4], Option<[u8; BYTES]>)> = None;
    for (bytes, block) in encoded.iter_mut().zip(blocks) {
        let color = block[0];
        if block != [color; 16] {
            continue;
        }
        let best = match last {
            Some((known, best)) if known == color => best,
            _ => encode(color),
        };
        last = Some((color, best));
        if let Some(best) = best {
            *bytes = best;
        }
    }
}

fn bc7(color: [u8; 4]) -> [u8; 16] {
    let block = mode_6(color, 1).or_else(|| mode_6(color, 0)).unwrap_or_else(|| mode_5(color));
    block.to_le_bytes()
}

/// The selector of all texels: 17 of 64 parts from the first end point to the second. It is one of those that `selectors` prefers.
const MODE_6_SELECTORS: u128 = 0x4444_4444_4444_4448 << 64;

/// With end points of this lowest bit. None where that is not exact.
fn mode_6(color: [u8; 4], lowest: u8) -> Option<u128> {
    let ends = |value: u8| match value & 1 == lowest {
        true => Some([value; 2]),
        false => Some([value.checked_sub(1)?, value.checked_add(1)?]),
    };
    let mut block = 1_u128 << 6 | u128::from(lowest) << 63 | u128::from(lowest) << 64 | MODE_6_SELECTORS;
    for (channel, value) in color.into_iter().enumerate() {
        let [first, second] = ends(value)?.map(|end| u128::from(end >> 1));
        block |= first << (7 + 14 * channel) | second << (14 + 14 * channel);
    }
    Some(block)
}

/// The selectors of colours: 21 of 64 parts. Those of alpha are zero.
const MODE_5_SELECTORS: u128 = 0x2aaa_aaab << 66;

fn mode_5(color: [u8; 4]) -> u128 {
    let [r, g, b, alpha] = color;
    let mut block = 1_u128 << 5 | u128::from(alpha) << 50 | u128::from(alpha) << 58 | MODE_5_SELECTORS;
    for (channel, value) in [r, g, b].into_iter().enumerate() {
        let [first, second] = mode_5_ends(value).map(u128::from);
        block |= first << (8 + 14 * channel) | second << (15 + 14 * channel);
    }
    block
}

/// End points of seven bits with a value 21 of 64 parts from the first to the second.
fn mode_5_ends(value: u8) -> [u8; 2] {
    let half = value >> 1;
    let near = half.saturating_sub(1)..=(half + 1).min(127);
    let mut pairs = near.clone().flat_map(|first| near.clone().map(move |second| [first, second]));
    let is_exact = |ends: &[u8; 2]| {
        let [a, b] = ends.map(|end| i32::from(end << 1 | end >> 6));
        (43 * a + 21 * b + 32) >> 6 == i32::from(value)
    };
    pairs.find(is_exact).unwrap_or([half; 2])
}

/// None for what is transparent.
fn bc1(color: [u8; 4]) -> Option<[u8; 8]> {
    if color[3] < OPAQUE_FROM {
        return None;
    }
    let nearest = |weights: [i32; 2]| {
        let ends = [(0, 31), (1, 63), (2, 31)].map(|(c, steps)| bc1_ends(color[c], steps, weights));
        let packed = [0, 1].map(|end| {
            let [r, g, b] = ends.map(|(ends, _)| ends[end] as u16);
            r << 11 | g << 5 | b
        });
        (packed, ends.iter().map(|(_, error)| error).sum::<i32>())
    };
    let ([a, b], error_of_thirds) = nearest([2, 1]);
    let ([c, d], error_of_halves) = nearest([1, 1]);
    // There are thirds between end points of which the first is greater, else halves.
    let (first, second, selector) = match error_of_thirds <= error_of_halves {
        true if a > b => (a, b, 2),
        true if a < b => (b, a, 3),
        true => (a, b, 1),
        false => (c.min(d), c.max(d), 2),
    };
    let selectors: u32 = 0x5555_5555 * selector;
    let mut bytes = [0; 8];
    bytes[..2].copy_from_slice(&first.to_le_bytes());
    bytes[2..4].copy_from_slice(&second.to_le_bytes());
    bytes[4..].copy_from_slice(&selectors.to_le_bytes());
    Some(bytes)
}

/// End points in `0..=steps` whose mean with these weights is nearest to a value once it is decoded, and the square of what is missing. They
/// are beside the value: decoders round what lies between distant ones each in its own way.
fn bc1_ends(value: u8, steps: i32, [first, second]: [i32; 2]) -> ([i32; 2], i32) {
    let value = i32::from(value);
    let low = value * steps / 255;
    let beside = [low, (low + 1).min(steps)];
    let error = |[a, b]: [i32; 2]| {
        let (sum, whole) = (first * a + second * b, (first + second) * steps);
        ((510 * sum + whole) / (2 * whole) - value).pow(2)
    };
    let pairs = beside.into_iter().flat_map(|a| beside.map(|b| [a, b]));
    let ends = pairs.min_by_key(|&ends| error(ends)).unwrap_or([low; 2]);
    (ends, error(ends))
}

#[cfg(test)]
mod tests {
    use fantex_base::random::nth_random;

    use super::*;
    use crate::decode;

    /// Colours at the ends of the range, and others.
    fn colors() -> impl Iterator<Item = [u8; 4]> {
        let edge = |n: usize| [0, 1, 2, 127, 128, 253, 254, 255][n % 8];
        let edges = (0..4096).map(move |n| [edge(n), edge(n / 8), edge(n / 64), edge(n / 512)]);
        let others = (0..4096).map(|n| {
            let [r, g, b, a, ..] = nth_random(5, n).to_le_bytes();
            [r, g, b, if n % 2 == 0 { a } else { 255 }]
        });
        edges.chain(others)
    }

    fn decoded(format: TexelFormat, block: &[u8]) -> [u8; 4] {
        let texels = decode(format, [4, 4], block).unwrap();
        assert!(texels.iter().all(|texel| *texel == texels[0]));
        texels[0].map(|x| (x * 255.0).round() as u8)
    }

    #[test]
    fn every_color_is_exact_in_bc7() {
        for color in colors() {
            let block = bc7(color);
            assert_eq!(decoded(TexelFormat::Bc7, &block), color);
            let expected = if color.contains(&0) && color.contains(&255) { 1 << 5 } else { 1 << 6 };
            // The lowest bit that is set.
            assert_eq!(1 << block[0].trailing_zeros(), expected, "{color:?}");
        }
        for value in 0..=255 {
            assert_eq!(decoded(TexelFormat::Bc7, &mode_5([value; 4]).to_le_bytes()), [value; 4]);
        }
    }

    #[test]
    fn colors_are_as_near_as_bc1_can() {
        for color in colors().filter(|color| color[3] >= OPAQUE_FROM) {
            let block = bc1(color).unwrap();
            let [r, g, b, alpha] = decoded(TexelFormat::Bc1, &block);
            let differences = [r, g, b].into_iter().zip(color).map(|(is, should)| is.abs_diff(should));
            assert!(differences.max() <= Some(1) && alpha == 255, "{color:?}: {r} {g} {b}");
            assert_ne!(block, [0; 8], "what nothing reads");
        }
        assert_eq!(bc1([9, 9, 9, 127]), None);
    }

    /// The nearest of all end points.
    #[test]
    fn no_other_end_points_are_nearer_in_bc1() {
        for (steps, weights) in [(31, [2, 1]), (31, [1, 1]), (63, [2, 1]), (63, [1, 1])] {
            let value = |a: i32, b: i32| {
                let whole = (weights[0] + weights[1]) * steps;
                (510 * (weights[0] * a + weights[1] * b) + whole) / (2 * whole)
            };
            let all: Vec<i32> = (0..=steps).flat_map(|a| (0..=steps).map(move |b| value(a, b))).collect();
            for wanted in 0..=255 {
                let least = all.iter().map(|value| (value - i32::from(wanted)).pow(2)).min();
                assert_eq!(Some(bc1_ends(wanted, steps, weights).1), least, "{wanted} of {steps}");
            }
        }
    }
}
