//! The levels of an image as they are stored, and pairs of texels out of them.

use arrayvec::ArrayVec;

use fearless_simd::Simd;

use super::place::Quads;
use super::widen::{Meaning, has_byte_tables, widen, widened};
use super::{BLOCK, Block};
use crate::image::{ColorSpace, Image, Samples};

/// Levels of the largest image.
const MOST_LEVELS: usize = 32;

/// The samples of a level.
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
    stored: ArrayVec<Stored<'a>, MOST_LEVELS>,
}

impl<'a> Levels<'a> {
    /// The levels of an image, level 0 first; `None` for storage that has no fast path.
    pub(crate) fn new(base: &'a Image, coarser: &'a [Image]) -> Option<Self> {
        let is_small = u64::from(base.width) * u64::from(base.height) * 4 < u64::from(u32::MAX);
        if !(is_small && matches!(base.channels, 1 | 3 | 4)) {
            return None;
        }
        if coarser.len() >= MOST_LEVELS {
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

    /// Width and height of level 0.
    pub(super) fn size(&self) -> [u32; 2] {
        self.size
    }

    pub(super) fn channels(&self) -> u8 {
        self.channels
    }

    /// How stored bytes are to be understood.
    pub(super) fn meaning(&self) -> Meaning {
        Meaning { is_srgb: self.is_srgb, has_alpha: self.channels == 4 }
    }

    /// The index of the coarsest level.
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
                self.are_bytes = may_be_bytes && has_byte_tables::<S>();
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
                            .map(|pair| pair.map(|row| widened(u64::from_le_bytes(*row), meaning))),
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
pub(in crate::filter) fn eight<T>(samples: &[T], first: usize) -> Option<&[T; 8]> {
    samples.get(first..first + 8)?.first_chunk()
}

#[inline(always)]
fn joined(values: &[u16; 8]) -> [u64; 2] {
    let word =
        |[a, b, c, d]: [u16; 4]| u64::from(a) | u64::from(b) << 16 | u64::from(c) << 32 | u64::from(d) << 48;
    let [a, b, c, d, e, f, g, h] = *values;
    [word([a, b, c, d]), word([e, f, g, h])]
}
