//! The fastest BC7 encoder of opaque blocks: mode 6 alone, many blocks at once.
//!
//! ```text
//!  1 the line through the texels' mean along which they vary most     4 end points of least squared error for these selectors
//!  2 end points: where the outermost texels project onto it, rounded  5 the same rounded to seven bits and a shared lowest one
//!  3 per texel the better of the two selectors next to its place      6 selectors again; the first ones stay where they are better
//! ```
//!
//! But for the choice at the end, and where the search for the line begins, these are the steps of Intel's ISPC Texture Compressor at its
//! fastest, which takes nearly five times as long, as it looks up weights and end points lane by lane. Each lane is a block. What is summed
//! are integers that single precision holds, and nothing else is fused: blocks are the same on all processors.

#![allow(clippy::needless_range_loop, reason = "counted loops are unrolled, which keeps arrays in registers")]

use fantex_base::vector_level;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch};

use super::{BlockRow, blocks_of_row};

const BLOCK_BYTES: usize = 16;

/// Blocks that are made at once at most.
const MAX_LANES: usize = 16;

/// Colours, a channel for each.
const CHANNELS: usize = 3;

/// Products with the matrix of covariances that turn a vector towards the axis of the most.
const POWER_STEPS: u32 = 8;

/// Encodes rows of blocks, one after the other. Alpha is ignored.
pub(super) fn encode(rows: &[BlockRow<'_>]) -> Vec<u8> {
    let blocks = || rows.iter().flat_map(|row| blocks_of_row(row));
    let count = rows.iter().map(|row| row.len() / 16).sum::<usize>();
    // Lanes beyond the last block are black.
    let mut texels = vec![Default::default(); count.div_ceil(MAX_LANES)];
    for (number, block) in blocks().enumerate() {
        let of_lanes: &mut TexelsOfLanes = &mut texels[number / MAX_LANES];
        for (lanes, texel) in of_lanes.iter_mut().zip(block) {
            lanes[number % MAX_LANES] = u32::from_le_bytes(texel);
        }
    }
    let mut bytes = vec![0; count * BLOCK_BYTES];
    let bytes_of_lanes = bytes.chunks_mut(MAX_LANES * BLOCK_BYTES);
    for (texels, bytes) in texels.iter().zip(bytes_of_lanes) {
        let mut words = WordsOfLanes::default();
        dispatch!(vector_level(), simd => encode_in(simd, texels, &mut words));
        for (lane, block) in bytes.as_chunks_mut::<BLOCK_BYTES>().0.iter_mut().enumerate() {
            for (bytes, words) in block.as_chunks_mut::<4>().0.iter_mut().zip(&words) {
                *bytes = words[lane].to_le_bytes();
            }
        }
    }
    bytes
}

/// The texels of several blocks: of each place in a block, those of all.
type TexelsOfLanes = [[u32; MAX_LANES]; 16];

/// The words of several blocks of 16 bytes.
type WordsOfLanes = [[u32; MAX_LANES]; BLOCK_BYTES / 4];

#[inline(always)]
fn encode_in<S: Simd>(simd: S, blocks: &TexelsOfLanes, words: &mut WordsOfLanes) {
    let lanes = S::u32s::LEN;
    for first in (0..MAX_LANES).step_by(lanes) {
        let mut texels = [[S::f32s::splat(simd, 0.0); 16]; CHANNELS];
        for k in 0..16 {
            let of_lanes = S::u32s::from_slice(simd, &blocks[k][first..first + lanes]);
            for c in 0..CHANNELS {
                let channel = (of_lanes >> (8 * c as u32)) & 255;
                texels[c][k] = channel.bitcast::<S::i32s>().to_float::<S::f32s>();
            }
        }
        for (of_block, words) in blocks_of(simd, &texels).into_iter().zip(words.iter_mut()) {
            of_block.store_slice(&mut words[first..first + lanes]);
        }
    }
}

/// The four words of the lanes' blocks.
#[inline(always)]
fn blocks_of<S: Simd>(simd: S, texels: &[[S::f32s; 16]; CHANNELS]) -> [S::u32s; 4] {
    let mut sums = [S::f32s::splat(simd, 0.0); CHANNELS];
    for c in 0..CHANNELS {
        for k in 0..16 {
            sums[c] += texels[c][k];
        }
    }
    let first_ends = rounded(simd, line(simd, texels, &sums));
    let (first_selectors, first_error) = selectors(simd, texels, &first_ends);
    let mut ends = rounded(simd, fitted(simd, texels, &sums, &first_selectors));
    let (mut selectors, error) = self::selectors(simd, texels, &ends);
    // Rounding may make end points worse than those before.
    let is_worse = first_error.simd_lt(error);
    for k in 0..16 {
        selectors[k] = is_worse.select(first_selectors[k], selectors[k]);
    }
    for (end, first) in ends.iter_mut().zip(first_ends) {
        for c in 0..=CHANNELS {
            end[c] = is_worse.select(first[c], end[c]);
        }
    }
    words(simd, ends, selectors)
}

/// Where the outermost texels project onto the line along which they vary most.
#[inline(always)]
fn line<S: Simd>(
    simd: S,
    texels: &[[S::f32s; 16]; CHANNELS],
    sums: &[S::f32s; CHANNELS],
) -> [[S::f32s; CHANNELS]; 2] {
    let zero = S::f32s::splat(simd, 0.0);
    let mut covariances = [[zero; CHANNELS]; CHANNELS];
    for a in 0..CHANNELS {
        for b in a..CHANNELS {
            let mut products = zero;
            for k in 0..16 {
                products = texels[a][k].mul_add(texels[b][k], products);
            }
            // Sixteen times what the products of the deviations add up to: all integers below 2^24.
            covariances[a][b] = products * 16.0 - sums[a] * sums[b];
            covariances[b][a] = covariances[a][b];
        }
    }
    // As shares of all that varies, lest powers overflow. Equal texels have an axis, too.
    let mut all = S::f32s::splat(simd, 1e-3);
    for a in 0..CHANNELS {
        covariances[a][a] += 1e-3;
        all += covariances[a][a];
    }
    for a in 0..CHANNELS {
        for b in 0..CHANNELS {
            covariances[a][b] /= all;
        }
    }
    // What the channel that varies most has in common with each: no direction that is asked for is across it.
    let mut axis = covariances[0];
    let mut most = covariances[0][0];
    for a in 1..CHANNELS {
        let is_more = covariances[a][a].simd_gt(most);
        most = most.max(covariances[a][a]);
        for b in 0..CHANNELS {
            axis[b] = is_more.select(covariances[a][b], axis[b]);
        }
    }
    for _ in 0..POWER_STEPS {
        let mut turned = [zero; CHANNELS];
        for a in 0..CHANNELS {
            for b in 0..CHANNELS {
                turned[a] += covariances[a][b] * axis[b];
            }
        }
        axis = turned;
    }
    let mut length = zero;
    for along in axis {
        length += along * along;
    }
    let length = length.sqrt();
    let is_axis = length.simd_gt(0.0);
    for along in &mut axis {
        *along = is_axis.select(*along / length, zero);
    }
    let mut mean = [zero; CHANNELS];
    let mut place = zero;
    for c in 0..CHANNELS {
        mean[c] = sums[c] * (1.0 / 16.0);
        place += mean[c] * axis[c];
    }
    let (mut low, mut high) = (S::f32s::splat(simd, f32::MAX), S::f32s::splat(simd, f32::MIN));
    for k in 0..16 {
        let mut along = zero;
        for c in 0..CHANNELS {
            along += texels[c][k] * axis[c];
        }
        low = low.min(along - place);
        high = high.max(along - place);
    }
    // Ends are apart.
    let is_short = (high - low).simd_lt(1.0);
    low = is_short.select(low - 0.5, low);
    high = is_short.select(high + 0.5, high);
    let mut ends = [[zero; CHANNELS]; 2];
    for (end, far) in ends.iter_mut().zip([low, high]) {
        for c in 0..CHANNELS {
            end[c] = far * axis[c] + mean[c];
        }
    }
    ends
}

/// The nearest end points whose channels have the same lowest bit, which comes last.
#[inline(always)]
fn rounded<S: Simd>(simd: S, ends: [[S::f32s; CHANNELS]; 2]) -> [[S::f32s; CHANNELS + 1]; 2] {
    let zero = S::f32s::splat(simd, 0.0);
    let mut rounded = [[zero; CHANNELS + 1]; 2];
    for (rounded, end) in rounded.iter_mut().zip(ends) {
        let mut nearest = [[zero; CHANNELS]; 2];
        let mut errors = [zero; 2];
        for c in 0..CHANNELS {
            let end = end[c].max(0.0).min(255.0);
            nearest[0][c] = ((end * 0.5 + 0.5).floor() * 2.0).min(254.0);
            nearest[1][c] = (end * 0.5).floor() * 2.0 + 1.0;
            for (error, nearest) in errors.iter_mut().zip(nearest) {
                let off = end - nearest[c];
                *error += off * off;
            }
        }
        let is_odd = errors[1].simd_lt(errors[0]);
        for c in 0..CHANNELS {
            rounded[c] = is_odd.select(nearest[1][c], nearest[0][c]);
        }
        rounded[CHANNELS] = is_odd.select(S::f32s::splat(simd, 1.0), zero);
    }
    rounded
}

/// Per texel the better of the two selectors next to where it projects onto the line between end points, and their squared error in all.
#[inline(always)]
fn selectors<S: Simd>(
    simd: S,
    texels: &[[S::f32s; 16]; CHANNELS],
    [first, second]: &[[S::f32s; CHANNELS + 1]; 2],
) -> ([S::f32s; 16], S::f32s) {
    let (zero, half) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 0.5));
    let (mut line, mut parts) = ([zero; CHANNELS], [zero; CHANNELS]);
    let mut length = zero;
    for c in 0..CHANNELS {
        line[c] = second[c] - first[c];
        parts[c] = line[c] * (1.0 / 64.0);
        length = line[c].mul_add(line[c], length);
    }
    let per_place = length.simd_gt(0.0).select(S::f32s::splat(simd, 16.0) / length, zero);
    let (mut selectors, mut error) = ([zero; 16], zero);
    for k in 0..16 {
        let (mut from_first, mut place) = ([zero; CHANNELS], zero);
        for c in 0..CHANNELS {
            from_first[c] = texels[c][k] - first[c];
            place = from_first[c].mul_add(line[c], place);
        }
        let upper = (place * per_place + 0.5).floor().max(1.0).min(15.0);
        let lower = upper - 1.0;
        let mut errors = [zero; 2];
        for (error, selector) in errors.iter_mut().zip([lower, upper]) {
            let share = (selector * (64.0 / 15.0) + 0.5).floor();
            for c in 0..CHANNELS {
                // As decoders round it: an exact product of integers and 64ths.
                let off = from_first[c] - share.mul_add(parts[c], half).floor();
                *error = off.mul_add(off, *error);
            }
        }
        selectors[k] = errors[0].simd_lt(errors[1]).select(lower, upper);
        error += errors[0].min(errors[1]);
    }
    (selectors, error)
}

/// End points of least squared error for these selectors.
#[inline(always)]
fn fitted<S: Simd>(
    simd: S,
    texels: &[[S::f32s; 16]; CHANNELS],
    sums: &[S::f32s; CHANNELS],
    selectors: &[S::f32s; 16],
) -> [[S::f32s; CHANNELS]; 2] {
    let zero = S::f32s::splat(simd, 0.0);
    let (mut sum, mut squares, mut products) = (zero, zero, [zero; CHANNELS]);
    for k in 0..16 {
        sum += selectors[k];
        squares = selectors[k].mul_add(selectors[k], squares);
        for c in 0..CHANNELS {
            products[c] = selectors[k].mul_add(texels[c][k], products[c]);
        }
    }
    // Of the normal equations, with weights of 15 - selector and selector.
    let of_first = squares - sum * 30.0 + 16.0 * 225.0;
    let of_both = sum * 15.0 - squares;
    let determinant = of_first * squares - of_both * of_both;
    let is_regular = determinant.simd_gt(0.0);
    let scale = S::f32s::splat(simd, 15.0) / determinant;
    let mut ends = [[zero; CHANNELS]; 2];
    for c in 0..CHANNELS {
        let towards_first = sums[c] * 15.0 - products[c];
        let mean = sums[c] * (1.0 / 16.0);
        let first = (towards_first * squares - products[c] * of_both) * scale;
        let second = (products[c] * of_first - towards_first * of_both) * scale;
        ends[0][c] = is_regular.select(first, mean);
        ends[1][c] = is_regular.select(second, mean);
    }
    ends
}

/// Blocks of mode 6. The first texel's selector has no highest bit, so ends are swapped where it has one.
#[inline(always)]
fn words<S: Simd>(
    simd: S,
    [first, second]: [[S::f32s; CHANNELS + 1]; 2],
    selectors: [S::f32s; 16],
) -> [S::u32s; 4] {
    let is_swapped = selectors[0].simd_gt(7.0);
    let none = S::u32s::splat(simd, 0);
    let (mut from, mut to) = ([none; CHANNELS + 1], [none; CHANNELS + 1]);
    for c in 0..=CHANNELS {
        from[c] = whole(simd, is_swapped.select(second[c], first[c]));
        to[c] = whole(simd, is_swapped.select(first[c], second[c]));
    }
    let mut halves = [none; 2];
    for k in 0..16 {
        let fifteen = S::f32s::splat(simd, 15.0);
        let selector = whole(simd, is_swapped.select(fifteen - selectors[k], selectors[k]));
        // That of the first texel is a bit farther up, above the second end's lowest bit.
        let shift = if k == 0 { 1 } else { 4 * (k as u32 % 8) };
        halves[k / 8] |= selector << shift;
    }
    let [r, g, b, lowest] = from;
    let [to_r, to_g, to_b, to_lowest] = to;
    // Seven bits for each end of red, green, blue and alpha, which is the greatest.
    let low = ((r >> 1) << 7) | ((to_r >> 1) << 14) | ((g >> 1) << 21) | ((to_g >> 1) << 28) | 64;
    let high = (to_g >> 5) | ((b >> 1) << 3) | ((to_b >> 1) << 10) | (127 << 17 | 127 << 24) | (lowest << 31);
    [low, high, halves[0] | to_lowest, halves[1]]
}

#[inline(always)]
fn whole<S: Simd>(_: S, number: S::f32s) -> S::u32s {
    number.to_int::<S::i32s>().bitcast::<S::u32s>()
}

#[cfg(test)]
mod tests {
    use fantex_base::random::nth_random;
    use fearless_simd::Level;

    use super::*;
    use crate::{TexelFormat, decode};

    /// Four rows of blocks of slopes with some noise.
    fn strip(blocks: usize) -> Vec<[u8; 4]> {
        let width = 4 * blocks;
        let texel = |i: usize| {
            let [x, y] = [i % width, i / width];
            let random = nth_random(3, i as u64);
            let slope = |c: usize| 100.0 + 90.0 * (0.03 * (c + 1) as f32 * x as f32 + 0.2 * y as f32).sin();
            let grain = |c: usize| (random >> (8 * c) & 0xff) as usize * (x / 16 % 8) / 64;
            let [r, g, b] = [0, 1, 2].map(|c| (slope(c) as usize + grain(c)).min(255) as u8);
            [r, g, b, 255]
        };
        (0..4 * width).map(texel).collect()
    }

    fn squared_error(texels: &[[u8; 4]], blocks: &[u8]) -> f32 {
        let rows = blocks_of_row(texels);
        let error = |(block, texels): (&[u8; 16], [[u8; 4]; 16])| {
            let decoded = decode(TexelFormat::Bc7, [4, 4], block).unwrap();
            let off = decoded.iter().zip(texels).flat_map(|(decoded, texel)| {
                assert!(decoded[3] * 255.0 > 253.9);
                [0, 1, 2].map(|c| (decoded[c] * 255.0 - f32::from(texel[c])).powi(2))
            });
            off.sum::<f32>()
        };
        blocks.as_chunks().0.iter().zip(rows).map(error).sum()
    }

    #[test]
    fn blocks_are_as_good_as_those_of_the_other_encoder() {
        let texels = strip(1000);
        let own = encode(&[&texels]);
        let data = texels.as_flattened();
        let surface = intel_tex_2::RgbaSurface { data, width: 4000, height: 4, stride: 16000 };
        let other =
            intel_tex_2::bc7::compress_blocks(&intel_tex_2::bc7::opaque_ultra_fast_settings(), &surface);
        assert_eq!(own.len(), other.len());
        let [own, other] = [own, other].map(|blocks| squared_error(&texels, &blocks));
        assert!(own < 1.005 * other, "{own} {other}");
    }

    #[test]
    fn all_instruction_sets_encode_alike_and_blocks_do_not_depend_on_their_neighbours() {
        let texels = strip(37);
        let best = encode(&[&texels]);
        for (number, block) in blocks_of_row(&texels).enumerate() {
            assert_eq!(best[number * 16..][..16], encode(&[&block]), "{number}");
            let of_lanes = block.map(|texel| [u32::from_le_bytes(texel); MAX_LANES]);
            let mut words = WordsOfLanes::default();
            dispatch!(Level::baseline(), simd => encode_in(simd, &of_lanes, &mut words));
            let plain: Vec<u8> =
                words.iter().flat_map(|words| words[number % MAX_LANES].to_le_bytes()).collect();
            assert_eq!(best[number * 16..][..16], plain, "{number}");
        }
    }

    /// Ends of the range and equal texels, too.
    #[test]
    fn two_colours_are_kept() {
        for [a, b] in [[[0; 3], [255; 3]], [[255, 0, 0], [0, 0, 255]], [[9; 3], [9; 3]], [[0; 3], [0; 3]]] {
            let colours = [a, b].map(|[r, g, b]| [r, g, b, 255]);
            let block: Vec<[u8; 4]> = (0..16).map(|k| colours[usize::from(k % 3 == 0)]).collect();
            assert!(squared_error(&block, &encode(&[&block])) <= 16.0 * 3.0, "{a:?} {b:?}");
        }
    }
}
