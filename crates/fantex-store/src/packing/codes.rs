//! How the values of a field become differences and back, sixteen records at a time.
//!
//! Sixteen records are at hand in *planes*: byte `k` of all of them in vector `k`. A code keeps what it needs of the records
//! before, so that blocks must come in order.

use fearless_simd::{Simd, prelude::*, u8x16, u16x8, u32x4};

/// A reversible code of `PLANES` bytes of a record.
pub(super) trait Code<S: Simd, const PLANES: usize> {
    /// Before the first record.
    fn new(simd: S) -> Self;

    /// Values to stored differences.
    fn encode(&mut self, simd: S, planes: &mut [u8x16<S>; PLANES]);

    /// Stored differences to values.
    fn decode(&mut self, simd: S, planes: &mut [u8x16<S>; PLANES]);
}

/// `PLANES` bytes: of each the difference from the record before, modulo 256.
pub(super) struct Difference8<S: Simd, const PLANES: usize> {
    /// When encoding the 16 values before, when decoding the last of them, in all lanes.
    before: [u8x16<S>; PLANES],
}

impl<S: Simd, const PLANES: usize> Code<S, PLANES> for Difference8<S, PLANES> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        Self { before: [u8x16::splat(simd, 0); PLANES] }
    }

    #[inline(always)]
    fn encode(&mut self, simd: S, planes: &mut [u8x16<S>; PLANES]) {
        for (plane, before) in planes.iter_mut().zip(&mut self.before) {
            let values = *plane;
            *plane = values - simd.slide_u8x16::<15>(*before, values);
            *before = values;
        }
    }

    #[inline(always)]
    fn decode(&mut self, simd: S, planes: &mut [u8x16<S>; PLANES]) {
        let (zero, last) = (u8x16::splat(simd, 0), u8x16::splat(simd, 15));
        for (plane, before) in planes.iter_mut().zip(&mut self.before) {
            let mut sums = *plane;
            sums += simd.slide_u8x16::<15>(zero, sums);
            sums += simd.slide_u8x16::<14>(zero, sums);
            sums += simd.slide_u8x16::<12>(zero, sums);
            sums += simd.slide_u8x16::<8>(zero, sums);
            sums += *before;
            *before = simd.swizzle_dyn_within_blocks_u8x16(sums, last);
            *plane = sums;
        }
    }
}

/// Two little-endian integers of 2 bytes: of each the zigzag-coded difference modulo 2^16.
pub(super) struct Difference16<S: Simd> {
    before: [u16x8<S>; 2],
}

impl<S: Simd> Code<S, 4> for Difference16<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        Self { before: [u16x8::splat(simd, 0); 2] }
    }

    #[inline(always)]
    fn encode(&mut self, simd: S, planes: &mut [u8x16<S>; 4]) {
        for (planes, before) in planes.as_chunks_mut::<2>().0.iter_mut().zip(&mut self.before) {
            let (first, second) = joined(simd, *planes);
            let codes = [
                zigzag16::<S>(first - simd.slide_u16x8::<7>(*before, first)),
                zigzag16::<S>(second - simd.slide_u16x8::<7>(first, second)),
            ];
            *before = second;
            *planes = split(simd, codes);
        }
    }

    #[inline(always)]
    fn decode(&mut self, simd: S, planes: &mut [u8x16<S>; 4]) {
        let zero = u16x8::splat(simd, 0);
        let last = u8x16::from_slice(simd, &[14, 15, 14, 15, 14, 15, 14, 15, 14, 15, 14, 15, 14, 15, 14, 15]);
        for (planes, before) in planes.as_chunks_mut::<2>().0.iter_mut().zip(&mut self.before) {
            let (first, second) = joined(simd, *planes);
            let mut values = [first, second];
            for values in &mut values {
                let mut sums = unzigzag16::<S>(*values);
                sums += simd.slide_u16x8::<7>(zero, sums);
                sums += simd.slide_u16x8::<6>(zero, sums);
                sums += simd.slide_u16x8::<4>(zero, sums);
                sums += *before;
                *before = simd.swizzle_dyn_within_blocks_u16x8(sums, last);
                *values = sums;
            }
            *planes = split(simd, values);
        }
    }
}

/// Sixteen integers from their low and high bytes.
#[inline(always)]
fn joined<S: Simd>(simd: S, [low, high]: [u8x16<S>; 2]) -> (u16x8<S>, u16x8<S>) {
    let (low, high) = (simd.widen_u8x16(low), simd.widen_u8x16(high));
    (low.0 | (high.0 << 8), low.1 | (high.1 << 8))
}

/// Inverse of [`joined`].
#[inline(always)]
fn split<S: Simd>(simd: S, [first, second]: [u16x8<S>; 2]) -> [u8x16<S>; 2] {
    [simd.narrow_u16x8(first & 0xff, second & 0xff), simd.narrow_u16x8(first >> 8, second >> 8)]
}

/// 0, -1, 1, -2, ... becomes 0, 1, 2, 3, ...
#[inline(always)]
fn zigzag16<S: Simd>(difference: u16x8<S>) -> u16x8<S> {
    (difference << 1) ^ ((difference >> 15) * 0xffff)
}

/// Inverse of [`zigzag16`].
#[inline(always)]
fn unzigzag16<S: Simd>(code: u16x8<S>) -> u16x8<S> {
    (code >> 1) ^ ((code & 1) * 0xffff)
}

/// Four little-endian integers of 4 bytes: of each the zigzag-coded difference modulo 2^32.
pub(super) struct Difference32 {
    before: [u32; 4],
}

impl<S: Simd> Code<S, 16> for Difference32 {
    #[inline(always)]
    fn new(_: S) -> Self {
        Self { before: [0; 4] }
    }

    #[inline(always)]
    fn encode(&mut self, simd: S, planes: &mut [u8x16<S>; 16]) {
        for (planes, before) in planes.as_chunks_mut::<4>().0.iter_mut().zip(&mut self.before) {
            let mut words = words(simd, *planes);
            for word in &mut words {
                let value = *word;
                *word = crate::bytes::zigzag(value.wrapping_sub(*before));
                *before = value;
            }
            *planes = word_planes(simd, &words);
        }
    }

    #[inline(always)]
    fn decode(&mut self, simd: S, planes: &mut [u8x16<S>; 16]) {
        let zero = u32x4::splat(simd, 0);
        for (planes, before) in planes.as_chunks_mut::<4>().0.iter_mut().zip(&mut self.before) {
            let mut words = words(simd, *planes);
            for four in words.as_chunks_mut::<4>().0 {
                let codes = u32x4::from_slice(simd, four);
                let mut sums = (codes >> 1) ^ (zero - (codes & 1));
                sums += simd.slide_u32x4::<3>(zero, sums);
                sums += simd.slide_u32x4::<2>(zero, sums);
                sums += *before;
                *before = sums[3];
                sums.store_slice(four);
            }
            *planes = word_planes(simd, &words);
        }
    }
}

/// Sixteen integers from the planes of their bytes, lowest first.
#[inline(always)]
fn words<S: Simd>(simd: S, planes: [u8x16<S>; 4]) -> [u32; 16] {
    let mut bytes = [0; 64];
    simd.store_four_interleaved_u8x16(planes, &mut bytes);
    let mut words = [0; 16];
    for (word, bytes) in words.iter_mut().zip(bytes.as_chunks().0) {
        *word = u32::from_le_bytes(*bytes);
    }
    words
}

/// Inverse of [`words`].
#[inline(always)]
fn word_planes<S: Simd>(simd: S, words: &[u32; 16]) -> [u8x16<S>; 4] {
    let mut bytes = [0; 64];
    for (word, bytes) in words.iter().zip(bytes.as_chunks_mut().0) {
        *bytes = word.to_le_bytes();
    }
    simd.load_four_interleaved_u8x16(&bytes)
}

/// The first 8 bytes of a BC7 block, as end points of mode 6: eight 7-bit fields r0 r1 g0 g1 b0 b1 a0 a1 that follow the 7
/// mode bits. They become a byte each, of which bit 7 is, in the first seven, a mode bit (bit k in byte k) and in the last
/// one the last bit, so that nothing is lost, whatever the mode. Stored are differences, red and blue relative to green.
pub(super) struct EndPoints<S: Simd>(Difference8<S, 8>);

impl<S: Simd> Code<S, 8> for EndPoints<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        Self(Difference8::new(simd))
    }

    #[inline(always)]
    fn encode(&mut self, simd: S, planes: &mut [u8x16<S>; 8]) {
        let head = *planes;
        // Field k begins at bit 7 - k of byte k; byte 7 is as it shall be.
        for k in 0..7 {
            let shift = k as u32;
            let field = ((head[k] >> (7 - shift)) | (head[k + 1] << (shift + 1))) & 0x7f;
            planes[k] = field | ((head[0] >> shift) << 7);
        }
        // Differences of differences: all of it is linear, in whichever order.
        for (k, green) in [(0, 2), (1, 3), (4, 2), (5, 3)] {
            planes[k] -= planes[green];
        }
        self.0.encode(simd, planes);
    }

    #[inline(always)]
    fn decode(&mut self, simd: S, planes: &mut [u8x16<S>; 8]) {
        self.0.decode(simd, planes);
        for (k, green) in [(0, 2), (1, 3), (4, 2), (5, 3)] {
            planes[k] += planes[green];
        }
        let points = *planes;
        let mut mode = points[0] >> 7;
        for k in 1..7 {
            let shift = k as u32;
            mode |= (points[k] >> 7) << shift;
            planes[k] = ((points[k - 1] & 0x7f) >> shift) | (points[k] << (7 - shift));
        }
        planes[0] = mode | (points[0] << 7);
    }
}
