//! Choosing among encodings of a block by error and by the bytes that they take once packed.
//!
//! A packed block costs what its stored fields cost (`packing.rs`): end points are differences from the block before, so they
//! are short where little changes; selectors are eight or six literal bytes, or a repetition of those of an earlier block.
//! Selectors are most of what is stored, and random to a compressor, so repeating them is what saves. For each block
//!
//! ```text
//!  the encoder's blocks           as they are
//!  the block before               again
//!  the end points before          with the nearest selectors
//!  selectors seen before, ramps   with end points by least squares: those two that fit best
//!  the selectors that follow      those which the block before repeats: they make its repetition longer
//! ```
//!
//! are compared by `squared error + lambda * bits` (G. J. Sullivan, T. Wiegand, Rate-Distortion Optimization for Video
//! Compression, 1998), and the least is taken. `lambda` follows the encoder's own mean error in the page: what is exact stays nearly so,
//! and a page loses about as much as it gains by a better encoder. `docs/benchmarks.md` has the figures.
//!
//! A page is chosen by itself, one block after the other, so its bytes depend on its texels only. All pages begin with the same
//! ramps, so a cluster's pages repeat each other's.

use std::marker::PhantomData;

use fearless_simd::{Simd, dispatch};

use self::layout::{Bc4, Bc7, Block, Layout, Planes};
use self::patterns::Patterns;
use crate::{TexelFormat, packing};

mod layout;
mod patterns;

/// `lambda`, by the mean squared error of the encoder's blocks. Of 0.02, 0.03, 0.04 and 0.06 the one that keeps the error of the fastest preset over
/// photographs, masks and flat colours; a block's error cannot exceed the encoder's by more than 200 bits of it.
const ERROR_PER_BIT: f32 = 0.03;

/// Squared error of a texel's channel that was rounded to 8 bits.
const ROUNDING_ERROR: f32 = 1.0 / 12.0;

/// Selectors that a page remembers, besides the ramps.
const REMEMBERED: usize = 63;

/// Longest code of a literal in zstd.
const MAX_LITERAL_BITS: f32 = 11.0;

/// A repetition: how far back, how long, and how many literals before it.
const REPETITION_BITS: f32 = 22.0;

/// A repetition of what stands just before, whose distance is the usual one.
const NEAR_REPETITION_BITS: f32 = 16.0;

/// A repetition that becomes a block longer.
const LONGER_BITS: f32 = 1.0;

/// A zero among zeros, as the alpha of opaque texels is.
const ZERO_RUN_BITS: f32 = 0.1;

/// How much more the end points behind a block of another mode take.
const RETURN_BITS: f32 = 24.0;

/// Literals between two measurements of their bits.
const MEASURED_EVERY: u32 = 4096;

/// True for formats whose blocks can be chosen.
pub(super) fn is_chosen(format: TexelFormat) -> bool {
    matches!(format, TexelFormat::Bc4 | TexelFormat::Bc5 | TexelFormat::Bc7)
}

/// A page's blocks that are read.
pub(super) struct PageBlocks<'a> {
    /// Their texels, row-major.
    pub(super) texels: Vec<[[u8; 4]; 16]>,
    /// If alpha counts.
    pub(super) has_alpha: bool,
    /// Which blocks these are, if not all.
    pub(super) numbers: Option<&'a [u32]>,
}

impl PageBlocks<'_> {
    /// If blocks that nothing reads, zeros, stand before a block.
    fn follows_gap(&self, index: usize) -> bool {
        index > 0 && self.numbers.is_some_and(|numbers| numbers[index - 1] + 1 != numbers[index])
    }

    fn planes(&self, channels: impl Fn([u8; 4]) -> [f32; 4]) -> Vec<Planes> {
        let planes = |texels: &[[u8; 4]; 16]| {
            let texels = texels.map(&channels);
            std::array::from_fn(|c| texels.map(|texel| texel[c]))
        };
        self.texels.iter().map(planes).collect()
    }
}

/// Chooses the blocks of a page. `encoded`: what encoders made of it, one after the other; the first one's error says how much may be lost.
pub(super) fn choose(format: TexelFormat, page: &PageBlocks<'_>, encoded: &[&[u8]]) -> Vec<u8> {
    let mut bytes = vec![0; encoded[0].len()];
    let halves = |record: usize, at: usize| -> Vec<Vec<Block>> {
        let read = |stream: &&[u8]| stream.chunks_exact(record).map(|bytes| half(&bytes[at..])).collect();
        encoded.iter().map(read).collect()
    };
    match format {
        TexelFormat::Bc7 => {
            let weights = [1.0, 1.0, 1.0, if page.has_alpha { 1.0 } else { 0.0 }];
            let candidates: Vec<Vec<Block>> = encoded
                .iter()
                .map(|stream| stream.as_chunks().0.iter().map(|&bytes| Block::from_le_bytes(bytes)).collect())
                .collect();
            let texels = page.planes(|texel| texel.map(f32::from));
            let chosen = chosen::<Bc7>(page, &texels, weights, &candidates);
            for (bytes, block) in bytes.as_chunks_mut().0.iter_mut().zip(chosen) {
                *bytes = block.to_le_bytes();
            }
        }
        // Red, and green behind it, each by itself.
        _ => {
            let record = format.block_bytes();
            for at in (0..record).step_by(8) {
                let texels = page.planes(|texel| [f32::from(texel[at / 8]), 0.0, 0.0, 0.0]);
                let weights = [1.0, 0.0, 0.0, 0.0];
                let chosen = chosen::<Bc4>(page, &texels, weights, &halves(record, at));
                for (bytes, block) in bytes.chunks_exact_mut(record).zip(chosen) {
                    bytes[at..at + 8].copy_from_slice(&block.to_le_bytes()[..8]);
                }
            }
        }
    }
    bytes
}

/// A block of eight bytes.
fn half(bytes: &[u8]) -> Block {
    bytes[..8].iter().rev().fold(0, |block, &byte| block << 8 | Block::from(byte))
}

fn chosen<L: Layout>(
    page: &PageBlocks<'_>,
    texels: &[Planes],
    weights: [f32; 4],
    candidates: &[Vec<Block>],
) -> Vec<Block> {
    let mut chooser = Chooser::<L>::new(weights);
    dispatch!(packing::level(), simd => chooser.page(simd, page, texels, candidates))
}

/// Bits that a literal takes, by how often it came so far.
struct Literals {
    counts: [f32; 256],
    bits: [f32; 256],
    unmeasured: u32,
}

impl Literals {
    fn new(counts: [f32; 256]) -> Self {
        let mut literals = Self { counts, bits: [0.0; 256], unmeasured: 0 };
        literals.measure();
        literals
    }

    fn measure(&mut self) {
        let sum: f32 = self.counts.iter().sum();
        for (bits, count) in self.bits.iter_mut().zip(&self.counts) {
            *bits = (sum / count).log2().clamp(1.0, MAX_LITERAL_BITS);
        }
        self.unmeasured = 0;
    }

    fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.counts[usize::from(byte)] += 1.0;
        }
        self.unmeasured += bytes.len() as u32;
        if self.unmeasured >= MEASURED_EVERY {
            self.measure();
        }
    }
}

/// What a block's selectors are to a compressor.
#[derive(Clone, Copy)]
enum Selectors {
    Literal,
    /// Those of an earlier block, if the page has one.
    Repeated(Option<u32>),
}

struct Choice {
    cost: f32,
    block: Block,
    selectors: Selectors,
}

/// Chooses a page's blocks, one after the other.
struct Chooser<L> {
    lambda: f32,
    /// Of the channels' errors.
    weights: [f32; 4],
    ends: Literals,
    selectors: Literals,
    patterns: Patterns,
    /// Selectors of the blocks so far.
    history: Vec<u64>,
    before: Option<Block>,
    /// The last block with a pattern: what the next one's end points would be a difference from.
    pattern_before: Block,
    /// The block whose selectors the one before repeats.
    source: Option<u32>,
    layout: PhantomData<L>,
}

impl<L: Layout> Chooser<L> {
    fn new(weights: [f32; 4]) -> Self {
        let near_zero = |byte: usize| 60.0 * (-f32::from(byte as u8 as i8).abs() / 6.0).exp() + 0.3;
        Self {
            lambda: 0.0,
            weights,
            ends: Literals::new(std::array::from_fn(near_zero)),
            selectors: Literals::new([4.0; 256]),
            patterns: Patterns::new::<L>(REMEMBERED),
            history: Vec::new(),
            before: None,
            pattern_before: 0,
            source: None,
            layout: PhantomData,
        }
    }

    #[inline(always)]
    fn page<S: Simd>(
        &mut self,
        _: S,
        page: &PageBlocks<'_>,
        texels: &[Planes],
        candidates: &[Vec<Block>],
    ) -> Vec<Block> {
        let errors: f32 =
            candidates[0].iter().zip(texels).map(|(&block, texels)| self.error(block, texels)).sum();
        let rounding = 16.0 * self.weights.iter().sum::<f32>() * ROUNDING_ERROR;
        self.lambda = ERROR_PER_BIT * (errors / texels.len().max(1) as f32 + rounding);
        let mut blocks = Vec::with_capacity(texels.len());
        for (index, texels) in texels.iter().enumerate() {
            if page.follows_gap(index) {
                self.skip();
            }
            blocks.push(self.block(texels, candidates.iter().map(|blocks| blocks[index])));
        }
        blocks
    }

    /// Blocks of zeros are in between.
    fn skip(&mut self) {
        self.history.push(0);
        (self.before, self.pattern_before, self.source) = (None, 0, None);
    }

    #[inline(always)]
    fn block(&mut self, texels: &Planes, candidates: impl Iterator<Item = Block>) -> Block {
        let mut best = Choice { cost: f32::INFINITY, block: 0, selectors: Selectors::Literal };
        for block in candidates {
            // An encoder may happen to repeat itself.
            let known = self.patterns.find(L::selectors(block)).map(|pattern| self.patterns.source(pattern));
            self.consider(&mut best, texels, block, known.map_or(Selectors::Literal, Selectors::Repeated));
        }
        if let Some(before) = self.before {
            let last = self.history.len() as u32 - 1;
            self.consider(&mut best, texels, before, Selectors::Repeated(Some(last)));
            if let Some(block) = L::with_ends_of(before, texels, &self.weights) {
                self.consider(&mut best, texels, block, Selectors::Literal);
            }
        }
        let means = texels.map(|channel| sum(channel) / 16.0);
        let fitting = self.patterns.best::<L>(texels, &self.weights);
        let following = self.following().and_then(|selectors| self.patterns.find(selectors));
        let following = following.map(|pattern| (pattern, self.patterns.dots(pattern, texels)));
        // The first one is flat.
        for (pattern, dots) in fitting.into_iter().chain([(0, [0.0; 4])]).chain(following) {
            let block = L::block(self.patterns.ends(pattern, means, dots), self.patterns.selectors(pattern));
            self.consider(&mut best, texels, block, Selectors::Repeated(self.patterns.source(pattern)));
        }
        self.push(&best);
        best.block
    }

    #[inline(always)]
    fn consider(&self, best: &mut Choice, texels: &Planes, block: Block, selectors: Selectors) {
        let bits = self.end_bits(block) + self.selector_bits(block, selectors);
        let cost = self.error(block, texels) + self.lambda * bits;
        if cost < best.cost {
            *best = Choice { cost, block, selectors };
        }
    }

    #[inline(always)]
    fn error(&self, block: Block, texels: &Planes) -> f32 {
        let decoded = L::decode(block);
        let mut errors = [0.0; 16];
        for c in 0..L::CHANNELS {
            for i in 0..16 {
                let difference = decoded[c][i] - texels[c][i];
                errors[i] += self.weights[c] * difference * difference;
            }
        }
        sum(errors)
    }

    #[inline(always)]
    fn end_bits(&self, block: Block) -> f32 {
        let before = self.before.unwrap_or(0);
        let (before, mut bits) = match (L::has_pattern(block), L::has_pattern(before)) {
            (true, _) => (self.pattern_before, 0.0),
            (false, true) => (before, RETURN_BITS),
            (false, false) => (before, 0.0),
        };
        for (k, code) in L::end_codes(block, before).into_iter().take(L::END_BYTES).enumerate() {
            let is_in_run = k >= L::OFTEN_CONSTANT_FROM && code == 0;
            bits += if is_in_run { ZERO_RUN_BITS } else { self.ends.bits[usize::from(code)] };
        }
        bits
    }

    #[inline(always)]
    fn selector_bits(&self, block: Block, selectors: Selectors) -> f32 {
        let own = L::selectors(block);
        match selectors {
            _ if self.following() == Some(own) => LONGER_BITS,
            Selectors::Repeated(Some(at)) if at as usize + 1 == self.history.len() => NEAR_REPETITION_BITS,
            Selectors::Repeated(_) => REPETITION_BITS,
            Selectors::Literal => {
                let bytes = own.to_le_bytes();
                bytes[..L::SELECTOR_BYTES].iter().map(|&byte| self.selectors.bits[usize::from(byte)]).sum()
            }
        }
    }

    /// The selectors that would make the repetition longer.
    #[inline(always)]
    fn following(&self) -> Option<u64> {
        self.history.get(self.source? as usize + 1).copied()
    }

    fn push(&mut self, choice: &Choice) {
        let &Choice { block, selectors, .. } = choice;
        let own = L::selectors(block);
        let codes = L::end_codes(block, self.before.unwrap_or(0));
        self.ends.add(&codes[..L::END_BYTES.min(L::OFTEN_CONSTANT_FROM)]);
        self.source = match selectors {
            _ if self.following() == Some(own) => self.source.map(|source| source + 1),
            Selectors::Repeated(source) => source,
            Selectors::Literal => None,
        };
        if matches!(selectors, Selectors::Literal) {
            self.selectors.add(&own.to_le_bytes()[..L::SELECTOR_BYTES]);
        }
        if L::has_pattern(block) {
            self.patterns.remember::<L>(own, self.history.len() as u32);
            self.pattern_before = block;
        }
        self.history.push(own);
        self.before = Some(block);
    }
}

/// In order, so that it is the same on all processors.
#[inline(always)]
fn sum(values: [f32; 16]) -> f32 {
    values.into_iter().fold(0.0, |sum, value| sum + value)
}

#[cfg(test)]
mod tests {
    use fantex_base::random::nth_random;
    use fearless_simd::Level;

    use super::*;
    use crate::decode;
    use crate::encode::{PageTexels, Quality, TexelSlice, encode, encode_many};

    const EXTENT: [u32; 2] = [128, 96];

    /// Waves, a flat quarter, and noise of some strength.
    fn picture(seed: u64, noise: u64, alpha: bool) -> Vec<[u8; 4]> {
        (0..EXTENT[0] * EXTENT[1])
            .map(|i| {
                let [x, y] = [i % EXTENT[0], i / EXTENT[0]].map(|n| n as f32);
                let wave = |kx: f32, ky: f32| 120.0 + 90.0 * (kx * x + ky * y + seed as f32).sin();
                let flat = x < 40.0 && y < 50.0;
                let channels = [wave(0.07, 0.02), wave(0.03, 0.05), wave(-0.02, 0.09), wave(0.04, 0.04)];
                let random = nth_random(seed, u64::from(i));
                let mut texel = [0; 4];
                for c in 0..4 {
                    let grain = (random >> (16 * c) & 0xffff) * noise / 0xffff;
                    texel[c] = if flat { 77 } else { channels[c] as u8 + grain as u8 };
                }
                texel[3] = if alpha { texel[3] } else { 255 };
                texel
            })
            .collect()
    }

    /// Of each block, after decoding, in squares of 1/255.
    fn errors(format: TexelFormat, texels: &[[u8; 4]], bytes: &[u8], channels: usize) -> Vec<f32> {
        let decoded = decode(format, EXTENT, bytes).unwrap();
        let columns = EXTENT[0] / 4;
        let mut errors = vec![0.0; texels.len() / 16];
        for (i, (texel, decoded)) in (0..).zip(texels.iter().zip(decoded)) {
            let block = i / EXTENT[0] / 4 * columns + i % EXTENT[0] / 4;
            for c in 0..channels {
                errors[block as usize] += (f32::from(texel[c]) - decoded[c] * 255.0).powi(2);
            }
        }
        errors
    }

    fn packed(format: TexelFormat, bytes: &[u8]) -> usize {
        let mut rearranged = vec![0; bytes.len()];
        packing::pack(format, bytes, &mut rearranged);
        zstd::bulk::compress(&rearranged, 1).unwrap().len()
    }

    #[test]
    fn no_block_loses_more_than_its_bits_are_worth_and_pages_are_smaller() {
        for (seed, noise) in [(1, 0), (2, 3), (3, 12), (4, 40)] {
            for (format, channels, alpha, parts) in [
                (TexelFormat::Bc7, 3, false, 1),
                (TexelFormat::Bc7, 4, true, 1),
                (TexelFormat::Bc5, 2, false, 2),
                (TexelFormat::Bc4, 1, false, 1),
            ] {
                let texels = picture(seed, noise, alpha);
                let encoded = |quality| encode(format, quality, EXTENT, TexelSlice::U8(&texels)).unwrap();
                let (fast, small) = (encoded(Quality::UltraFast), encoded(Quality::Small));
                let [before, after] = [&fast, &small].map(|bytes| errors(format, &texels, bytes, channels));
                let mean = before.iter().sum::<f32>() / before.len() as f32;
                let lambda = ERROR_PER_BIT * (mean + 16.0 * channels as f32 * ROUNDING_ERROR);
                let bits = MAX_LITERAL_BITS * (format.block_bytes() / parts) as f32 + RETURN_BITS;
                for (block, (before, after)) in before.iter().zip(&after).enumerate() {
                    assert!(
                        *after <= before + lambda * bits + 0.01,
                        "{format:?} {noise} {block}: {before} {after}"
                    );
                }
                let after_mean = after.iter().sum::<f32>() / after.len() as f32;
                assert!(after_mean < 2.5 * mean + 4.0, "{format:?} {noise}: {mean} {after_mean}");
                let [fast, small] = [fast, small].map(|bytes| packed(format, &bytes));
                assert!(small < fast, "{format:?} {noise}: {fast} {small}");
            }
        }
    }

    #[test]
    fn smooth_pages_shrink_most() {
        let texels = picture(5, 0, false);
        for (format, share) in [(TexelFormat::Bc7, 0.5), (TexelFormat::Bc5, 0.65)] {
            let encoded = |quality| encode(format, quality, EXTENT, TexelSlice::U8(&texels)).unwrap();
            let [fast, small] =
                [Quality::UltraFast, Quality::Small].map(|quality| packed(format, &encoded(quality)) as f32);
            assert!(small < share * fast, "{format:?}: {fast} {small}");
        }
    }

    #[test]
    fn opaque_pages_stay_opaque_beside_black_and_beside_what_nothing_reads() {
        let mut texels = picture(6, 5, false);
        for texel in texels.iter_mut().skip(EXTENT[0] as usize * 40) {
            *texel = [0, 0, 0, 255];
        }
        let read: Vec<bool> = (0..EXTENT[0] * EXTENT[1] / 16).map(|block| block % 5 != 2).collect();
        let page = PageTexels { extent: EXTENT, texels: TexelSlice::U8(&texels), read: Some(&read) };
        let bytes = encode_many(TexelFormat::Bc7, Quality::Small, &[page]).unwrap().remove(0);
        for (block, is_read) in bytes.as_chunks::<16>().0.iter().zip(read) {
            let alpha =
                decode(TexelFormat::Bc7, [4, 4], block).unwrap().iter().map(|t| t[3]).fold(1.0, f32::min);
            assert_eq!(alpha > 0.99, is_read);
            assert_eq!(*block != [0; 16], is_read);
        }
    }

    #[test]
    fn all_instruction_sets_choose_alike() {
        let texels = picture(7, 9, true);
        let blocks: Vec<[[u8; 4]; 16]> = texels.as_chunks::<16>().0.to_vec();
        let candidates = vec![vec![1 << 6; blocks.len()]];
        let page = PageBlocks { texels: blocks, has_alpha: true, numbers: None };
        let planes = page.planes(|texel| texel.map(f32::from));
        let best = chosen::<Bc7>(&page, &planes, [1.0; 4], &candidates);
        let mut chooser = Chooser::<Bc7>::new([1.0; 4]);
        let plain = dispatch!(Level::baseline(), simd => chooser.page(simd, &page, &planes, &candidates));
        assert_eq!(best, plain);
    }
}
