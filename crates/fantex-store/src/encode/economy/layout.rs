//! The fields of block formats: two end points, and a selector per texel.

/// Texels of a block, channel after channel, row-major, 0..255.
pub(super) type Planes = [[f32; 16]; 4];

/// A block's bytes as a little-endian number. Blocks of eight bytes have zeros behind them.
pub(super) type Block = u128;

/// A block format, some of whose blocks have a *pattern*: two end points, and between them a place for each texel.
pub(super) trait Layout {
    const CHANNELS: usize;
    /// Differences that are stored for the end points.
    const END_BYTES: usize;
    /// From this difference on they are often zero throughout a page.
    const OFTEN_CONSTANT_FROM: usize;
    const SELECTOR_BYTES: usize;
    /// Where the selectors begin.
    const SELECTOR_BIT: u32;
    /// If the first end point must be the greater one.
    const MUST_FALL: bool;

    fn has_pattern(block: Block) -> bool;

    /// The place of each texel between the end points.
    fn places(selectors: u64) -> [f32; 16];

    /// The selectors nearest to places, or to these from the other end.
    fn nearest(places: &[f32; 16]) -> u64;

    /// The block of end points, rounded, and selectors.
    fn block(ends: [[f32; 4]; 2], selectors: u64) -> Block;

    /// Any block.
    fn decode(block: Block) -> Planes;

    /// The end points of a block with the nearest selectors, if it has a pattern.
    fn with_ends_of(block: Block, texels: &Planes, weights: &[f32; 4]) -> Option<Block>;

    /// What is stored for the end points, as differences from the block before (`packing.rs`).
    fn end_codes(block: Block, before: Block) -> [u8; 8];

    #[inline(always)]
    fn selectors(block: Block) -> u64 {
        (block >> Self::SELECTOR_BIT) as u64
    }
}

/// BC7, whose blocks of mode 6 have a pattern. The lowest bit of the second end point counts as a selector, since it is stored with them.
pub(super) struct Bc7;

const BC7_WEIGHTS: [i32; 16] = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];

impl Bc7 {
    #[inline(always)]
    fn ends(block: Block) -> [[i32; 4]; 2] {
        let low = [(block >> 63) as i32 & 1, (block >> 64) as i32 & 1];
        std::array::from_fn(|k| {
            std::array::from_fn(|c| ((block >> (7 + 7 * (2 * c + k))) as i32 & 127) << 1 | low[k])
        })
    }

    /// The first texel's highest bit is not stored, but zero.
    #[inline(always)]
    fn levels(selectors: u64) -> [usize; 16] {
        let mut levels = std::array::from_fn(|i| (selectors >> (4 * i)) as usize & 15);
        levels[0] >>= 1;
        levels
    }

    #[inline(always)]
    fn from_levels(levels: &[usize; 16], low: u64) -> u64 {
        (1..16).fold(low | (levels[0] as u64) << 1, |bits, i| bits | (levels[i] as u64) << (4 * i))
    }
}

impl Layout for Bc7 {
    const CHANNELS: usize = 4;
    const END_BYTES: usize = 8;
    const OFTEN_CONSTANT_FROM: usize = 6;
    const SELECTOR_BYTES: usize = 8;
    const SELECTOR_BIT: u32 = 64;
    const MUST_FALL: bool = false;

    #[inline(always)]
    fn has_pattern(block: Block) -> bool {
        block & 127 == 64
    }

    #[inline(always)]
    fn places(selectors: u64) -> [f32; 16] {
        Self::levels(selectors).map(|level| BC7_WEIGHTS[level] as f32 / 64.0)
    }

    fn nearest(places: &[f32; 16]) -> u64 {
        let is_turned = places[0] > 0.5;
        let levels = places.map(|place| {
            let place = if is_turned { 1.0 - place } else { place };
            (place * 15.0 + 0.5) as usize
        });
        // The middle may have been rounded up.
        let mut levels = levels;
        levels[0] = levels[0].min(7);
        Self::from_levels(&levels, 1)
    }

    #[inline(always)]
    fn block(ends: [[f32; 4]; 2], selectors: u64) -> Block {
        let mut block = Block::from(selectors) << 64 | 64;
        for (k, end) in ends.into_iter().enumerate() {
            let rounded = |low: f32| end.map(|x| ((x - low) * 0.5).clamp(0.0, 127.0).round_ties_even());
            let error = |low: f32| {
                let rounded = rounded(low);
                (0..4).fold(0.0, |sum, c| sum + (2.0 * rounded[c] + low - end[c]).powi(2))
            };
            let low = match k {
                0 => error(1.0) <= error(0.0),
                _ => selectors & 1 == 1,
            };
            for (c, x) in rounded(f32::from(low)).into_iter().enumerate() {
                block |= (x as Block) << (7 + 7 * (2 * c + k));
            }
            block |= Block::from(low && k == 0) << 63;
        }
        block
    }

    #[inline(always)]
    fn decode(block: Block) -> Planes {
        if !Self::has_pattern(block) {
            let mut rgba = [0; 64];
            bcdec_rs::bc7(&block.to_le_bytes(), &mut rgba, 16);
            return std::array::from_fn(|c| std::array::from_fn(|i| f32::from(rgba[4 * i + c])));
        }
        let [a, b] = Self::ends(block);
        let weights = Self::levels(Self::selectors(block)).map(|level| BC7_WEIGHTS[level]);
        std::array::from_fn(|c| weights.map(|w| (((64 - w) * a[c] + w * b[c] + 32) >> 6) as f32))
    }

    #[inline(always)]
    fn with_ends_of(block: Block, texels: &Planes, weights: &[f32; 4]) -> Option<Block> {
        if !Self::has_pattern(block) {
            return None;
        }
        let [a, b] = Self::ends(block);
        let (mut least, mut levels) = ([f32::INFINITY; 16], [0; 16]);
        for (level, w) in BC7_WEIGHTS.into_iter().enumerate() {
            let mut errors = [0.0; 16];
            for c in 0..4 {
                let value = (((64 - w) * a[c] + w * b[c] + 32) >> 6) as f32;
                for i in 0..16 {
                    errors[i] += weights[c] * (texels[c][i] - value) * (texels[c][i] - value);
                }
            }
            if level > 7 {
                errors[0] = f32::INFINITY;
            }
            for i in 0..16 {
                levels[i] = if errors[i] < least[i] { level } else { levels[i] };
                least[i] = least[i].min(errors[i]);
            }
        }
        let selectors = Self::from_levels(&levels, (block >> 64) as u64 & 1);
        Some(block & Block::from(u64::MAX) | Block::from(selectors) << 64)
    }

    #[inline(always)]
    fn end_codes(block: Block, before: Block) -> [u8; 8] {
        let points = |block: Block| -> [u8; 8] {
            let head = block as u64;
            let rest = head & 127 | head >> 63 << 7;
            std::array::from_fn(|k| (head >> (7 + 7 * k)) as u8 & 127 | ((rest >> k) as u8) << 7)
        };
        let (now, before) = (points(block), points(before));
        let d: [u8; 8] = std::array::from_fn(|k| now[k].wrapping_sub(before[k]));
        let less = |k: usize, green: usize| d[k].wrapping_sub(d[green]);
        [less(0, 2), less(1, 3), d[2], d[3], less(4, 2), less(5, 3), d[6], d[7]]
    }
}

/// BC4, and each half of BC5. Blocks with eight steps have a pattern.
pub(super) struct Bc4;

impl Bc4 {
    #[inline(always)]
    fn ends(block: Block) -> [f32; 2] {
        [block as u8, (block >> 8) as u8].map(f32::from)
    }

    /// By selector.
    #[inline(always)]
    fn values([a, b]: [f32; 2]) -> [f32; 8] {
        let mix = |k: f32, n: f32| ((n - k) * a + k * b) / n;
        if a > b {
            [a, b, mix(1.0, 7.0), mix(2.0, 7.0), mix(3.0, 7.0), mix(4.0, 7.0), mix(5.0, 7.0), mix(6.0, 7.0)]
        } else {
            [a, b, mix(1.0, 5.0), mix(2.0, 5.0), mix(3.0, 5.0), mix(4.0, 5.0), 0.0, 255.0]
        }
    }
}

impl Layout for Bc4 {
    const CHANNELS: usize = 1;
    const END_BYTES: usize = 2;
    const OFTEN_CONSTANT_FROM: usize = 2;
    const SELECTOR_BYTES: usize = 6;
    const SELECTOR_BIT: u32 = 16;
    const MUST_FALL: bool = true;

    #[inline(always)]
    fn has_pattern(block: Block) -> bool {
        let [a, b] = Self::ends(block);
        a > b
    }

    #[inline(always)]
    fn places(selectors: u64) -> [f32; 16] {
        let places = Self::values([1.0, 0.0]).map(|value| 1.0 - value);
        std::array::from_fn(|i| places[(selectors >> (3 * i)) as usize & 7])
    }

    fn nearest(places: &[f32; 16]) -> u64 {
        let selector = |place: f32| match (place * 7.0 + 0.5) as u64 {
            0 => 0,
            7 => 1,
            step => step + 1,
        };
        (0..16).fold(0, |bits, i| bits | selector(places[i]) << (3 * i))
    }

    #[inline(always)]
    fn block(ends: [[f32; 4]; 2], selectors: u64) -> Block {
        let [a, b] = ends.map(|end| end[0].clamp(0.0, 255.0).round_ties_even() as Block);
        a | b << 8 | Block::from(selectors) << 16
    }

    #[inline(always)]
    fn decode(block: Block) -> Planes {
        let values = Self::values(Self::ends(block));
        let mut planes = [[0.0; 16]; 4];
        planes[0] = std::array::from_fn(|i| values[(block >> (16 + 3 * i)) as usize & 7]);
        planes
    }

    #[inline(always)]
    fn with_ends_of(block: Block, texels: &Planes, _: &[f32; 4]) -> Option<Block> {
        let (mut least, mut selectors) = ([f32::INFINITY; 16], [0u64; 16]);
        for (selector, value) in (0..).zip(Self::values(Self::ends(block))) {
            for i in 0..16 {
                let error = (texels[0][i] - value).abs();
                selectors[i] = if error < least[i] { selector } else { selectors[i] };
                least[i] = least[i].min(error);
            }
        }
        let selectors = (0..16).fold(0, |bits, i| bits | selectors[i] << (3 * i));
        Some(block & 0xffff | Block::from(selectors) << 16)
    }

    #[inline(always)]
    fn end_codes(block: Block, before: Block) -> [u8; 8] {
        let code = |shift: u32| ((block >> shift) as u8).wrapping_sub((before >> shift) as u8);
        [code(0), code(8), 0, 0, 0, 0, 0, 0]
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::random::nth_random;

    use super::*;
    use crate::{TexelFormat, decode, packing};

    fn random_block(n: u64) -> Block {
        Block::from(nth_random(5, 2 * n)) << 64 | Block::from(nth_random(5, 2 * n + 1))
    }

    fn mode_6(n: u64) -> Block {
        random_block(n) & !127 | 64
    }

    #[test]
    fn decodes_as_the_decoder_does() {
        for n in 0..2000 {
            for block in [mode_6(n), random_block(n)] {
                let bytes = block.to_le_bytes();
                let bc7 = decode(TexelFormat::Bc7, [4, 4], &bytes).unwrap();
                let bc4 = decode(TexelFormat::Bc4, [4, 4], &bytes[..8]).unwrap();
                let own = [Bc7::decode(block), Bc4::decode(block & Block::from(u64::MAX))];
                for i in 0..16 {
                    for c in 0..4 {
                        assert_eq!((bc7[i][c] * 255.0).round(), own[0][c][i]);
                    }
                    assert!((bc4[i][0] * 255.0 - own[1][0][i]).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn end_codes_are_what_is_packed() {
        for n in 0..500 {
            let [before, block] = [random_block(2 * n), random_block(2 * n + 1)];
            let natural = [before.to_le_bytes(), block.to_le_bytes()].concat();
            let mut packed = vec![0; 32];
            packing::pack(TexelFormat::Bc7, &natural, &mut packed);
            let codes = Bc7::end_codes(block, before);
            (0..8).for_each(|k| assert_eq!(packed[2 * k + 1], codes[k]));
            packing::pack(TexelFormat::Bc5, &natural, &mut packed);
            let codes = Bc4::end_codes(block, before);
            (0..2).for_each(|k| assert_eq!(packed[2 * k + 1], codes[k]));
        }
    }

    /// End points that can be stored come back.
    #[test]
    fn blocks_are_put_together_from_their_parts() {
        for n in 0..2000 {
            let block = mode_6(n);
            let ends = Bc7::ends(block).map(|end| end.map(|x| x as f32));
            assert_eq!(Bc7::block(ends, Bc7::selectors(block)), block);
            let block = random_block(n) & Block::from(u64::MAX);
            let ends = Bc4::ends(block).map(|x| [x, 0.0, 0.0, 0.0]);
            assert_eq!(Bc4::block(ends, Bc4::selectors(block)), block);
        }
    }

    #[test]
    fn nearest_selectors_are_nearest_and_may_be_stored() {
        for n in 0..500 {
            let texels: Planes = std::array::from_fn(|c| {
                std::array::from_fn(|i| (nth_random(n, (16 * c + i) as u64) >> 56) as f32)
            });
            let error = |decoded: Planes, i: usize, channels: usize| -> f32 {
                (0..channels).map(|c| (decoded[c][i] - texels[c][i]).powi(2)).sum()
            };
            let before = mode_6(n);
            let block = Bc7::with_ends_of(before, &texels, &[1.0; 4]).unwrap();
            assert_eq!(block as u64, before as u64);
            let levels = Bc7::levels(Bc7::selectors(block));
            for i in 0..16 {
                for level in 0..if i == 0 { 8 } else { 16 } {
                    let mut other = levels;
                    other[i] = level;
                    let low = (block >> 64) as u64 & 1;
                    let other = block as u64 as Block | Block::from(Bc7::from_levels(&other, low)) << 64;
                    assert!(error(Bc7::decode(block), i, 4) <= error(Bc7::decode(other), i, 4));
                }
            }
            let before = random_block(n) & Block::from(u64::MAX);
            let block = Bc4::with_ends_of(before, &texels, &[1.0; 4]).unwrap();
            assert_eq!(block & 0xffff, before & 0xffff);
            for i in 0..16 {
                for selector in 0..8 {
                    let at = 16 + 3 * i as u32;
                    let other = block & !(7 << at) | selector << at;
                    assert!(error(Bc4::decode(block), i, 1) <= error(Bc4::decode(other), i, 1) + 1e-2);
                }
            }
        }
    }
}
