//! The levels of an image as they are stored, and pairs of texels out of them.

use arrayvec::ArrayVec;

use super::place::Quads;
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
    /// Whether the colours of level 0 are encoded; those of all others are linear.
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
        let is_expected = |image: &Image| match image.samples {
            Samples::U8(_) => false,
            Samples::U16(_) => image.space == ColorSpace::Linear && image.channels == base.channels,
            Samples::F32(_) => false,
        };
        if coarser.len() >= MOST_LEVELS || !coarser.iter().all(is_expected) {
            return None;
        }
        let stored = |image: &'a Image| match &image.samples {
            Samples::U8(values) => Some(Stored::U8(values)),
            Samples::U16(values) => Some(Stored::U16(values)),
            Samples::F32(_) => None,
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

    pub(super) fn is_srgb(&self) -> bool {
        self.is_srgb
    }

    /// Whether level 0 is stored as bytes; all others have 16 bits.
    pub(super) fn has_bytes(&self) -> bool {
        matches!(self.stored[0], Stored::U8(_))
    }

    /// The index of the coarsest level.
    pub(super) fn last(&self) -> u32 {
        self.stored.len() as u32 - 1
    }
}

/// Two by two stored texels per look-up, those of a row as they follow one another in memory.
pub(super) struct Pairs {
    /// Eight samples of 16 bits from the upper left texel on; or eight of 8 bits, and behind them eight from the lower left
    /// texel on.
    pub(super) upper: Block<[u32; 4]>,
    /// Eight samples of 16 bits from the lower left texel on.
    pub(super) lower: Block<[u32; 4]>,
}

impl Pairs {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self { upper: Block([[0; 4]; BLOCK]), lower: Block([[0; 4]; BLOCK]) }
    }

    /// Copies the texels of every quad; returns the set of those (a bit each) that are at the edges or too near to the end of the
    /// memory.
    #[inline(always)]
    pub(super) fn read<const C: usize>(&mut self, levels: &Levels<'_>, quads: &Quads, count: usize) -> u64 {
        let mut missed = 0;
        for index in 0..count {
            let at = [quads.upper.0[index], quads.lower.0[index]].map(|texel| texel as usize * C);
            let is_read = match levels.stored[quads.level.0[index] as usize % MOST_LEVELS] {
                Stored::U8(bytes) => match at.map(|first| eight(bytes, first)) {
                    [Some(upper), Some(lower)] => {
                        let [a, b] = words_of_bytes(upper);
                        let [c, d] = words_of_bytes(lower);
                        self.upper.0[index] = [a, b, c, d];
                        true
                    }
                    _ => false,
                },
                Stored::U16(values) => match at.map(|first| eight(values, first)) {
                    [Some(upper), Some(lower)] => {
                        self.upper.0[index] = words(upper);
                        self.lower.0[index] = words(lower);
                        true
                    }
                    _ => false,
                },
            };
            missed |= u64::from(!is_read) << index;
        }
        missed
    }
}

#[inline(always)]
fn eight<T>(samples: &[T], first: usize) -> Option<&[T; 8]> {
    samples.get(first..)?.first_chunk()
}

#[inline(always)]
fn words_of_bytes(bytes: &[u8; 8]) -> [u32; 2] {
    let [a, b, c, d, e, f, g, h] = *bytes;
    [u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])]
}

#[inline(always)]
fn words(values: &[u16; 8]) -> [u32; 4] {
    let [a, b, c, d, e, f, g, h] = values.map(u32::from);
    [a | b << 16, c | d << 16, e | f << 16, g | h << 16]
}
