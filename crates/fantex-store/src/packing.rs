//! The reversible rearrangement of a channel's blocks that a general compressor packs better.
//!
//! Every block (or texel of an uncompressed format) is a record of *fields*. All values of one field are stored together.
//! End points of block formats, and texels, resemble those of the neighbour, so they are stored as differences from the
//! record before; indices are left as they are.
//!
//! ```text
//!  blocks:  e0 e1 iiii | e0 e1 iiii | e0 e1 iiii
//!  packed:  d0 d0 d0 | d1 d1 d1 | iiii iiii iiii
//! ```
//!
//! Most BC7 blocks of opaque pictures are of mode 6, whose first 64 bits are its end points, seven bits each. They are
//! aligned to bytes and decorrelated; blocks of other modes take the same (reversible) way.
//!
//! Records are taken sixteen at a time, as *planes*: byte `k` of all of them in vector `k`. A code keeps what it needs of the records
//! before, so blocks must come in order. `reference` says the same record by record, for the tests. `docs/benchmarks.md` has the
//! sizes and times.

use fantex_base::vector_level;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, u8x16, u16x8, u32x4};

use crate::TexelFormat;

#[cfg(test)]
mod reference;

/// Rearranges the records `natural` into `packed`, of the same length.
pub(crate) fn pack(format: TexelFormat, natural: &[u8], packed: &mut [u8]) {
    dispatch!(vector_level(), simd => pack_in(simd, format, natural, packed));
}

/// Inverse of [`pack`].
pub(crate) fn unpack(format: TexelFormat, packed: &[u8], natural: &mut [u8]) {
    dispatch!(vector_level(), simd => unpack_in(simd, format, packed, natural));
}

/// Bytes per record of runs of fields whose values are alike, in the order in which they are packed.
pub(crate) fn alike(format: TexelFormat) -> &'static [usize] {
    match format {
        TexelFormat::Bc1 => &[4, 4],
        TexelFormat::Bc4 => &[2, 6],
        TexelFormat::Bc5 => &[2, 6, 2, 6],
        // Red, green, blue, alpha, and what stands between them.
        TexelFormat::Bc7 => &[2, 2, 2, 2, 8],
        TexelFormat::R8 => &[1],
        TexelFormat::Rg8 => &[1, 1],
        TexelFormat::Rgba8 => &[1, 1, 1, 1],
        TexelFormat::Rgba32F => &[1; 16],
    }
}

// The numbers after a code: its bytes, where they begin in the record, and the record's bytes.

#[inline(always)]
fn pack_in<S: Simd>(simd: S, format: TexelFormat, natural: &[u8], packed: &mut [u8]) {
    match format {
        TexelFormat::Bc1 => {
            Packed::<Difference16<S>, 4, 0, 8>::pack(simd, natural, packed);
            Plain::<4, 4, 8>::pack(natural, packed);
        }
        TexelFormat::Bc4 => {
            Packed::<Difference8<S, 2>, 2, 0, 8>::pack(simd, natural, packed);
            Plain::<6, 2, 8>::pack(natural, packed);
        }
        TexelFormat::Bc5 => {
            Packed::<Difference8<S, 2>, 2, 0, 16>::pack(simd, natural, packed);
            Plain::<6, 2, 16>::pack(natural, packed);
            Packed::<Difference8<S, 2>, 2, 8, 16>::pack(simd, natural, packed);
            Plain::<6, 10, 16>::pack(natural, packed);
        }
        TexelFormat::Bc7 => {
            Packed::<EndPoints<S>, 8, 0, 16>::pack(simd, natural, packed);
            Plain::<8, 8, 16>::pack(natural, packed);
        }
        TexelFormat::R8 => Packed::<Difference8<S, 1>, 1, 0, 1>::pack(simd, natural, packed),
        TexelFormat::Rg8 => Packed::<Difference8<S, 2>, 2, 0, 2>::pack(simd, natural, packed),
        TexelFormat::Rgba8 => Packed::<Difference8<S, 4>, 4, 0, 4>::pack(simd, natural, packed),
        TexelFormat::Rgba32F => Packed::<Difference32, 16, 0, 16>::pack(simd, natural, packed),
    }
}

#[inline(always)]
fn unpack_in<S: Simd>(simd: S, format: TexelFormat, packed: &[u8], natural: &mut [u8]) {
    match format {
        TexelFormat::Bc1 => {
            let mut colors = Packed::<Difference16<S>, 4, 0, 8>::unpacker(simd);
            for (run, natural) in runs::<8>(natural) {
                colors.unpack(simd, packed, run, natural);
                Plain::<4, 4, 8>::unpack(packed, run, natural);
            }
        }
        TexelFormat::Bc4 => {
            let mut ends = Packed::<Difference8<S, 2>, 2, 0, 8>::unpacker(simd);
            for (run, natural) in runs::<8>(natural) {
                ends.unpack(simd, packed, run, natural);
                Plain::<6, 2, 8>::unpack(packed, run, natural);
            }
        }
        TexelFormat::Bc5 => {
            let mut first = Packed::<Difference8<S, 2>, 2, 0, 16>::unpacker(simd);
            let mut second = Packed::<Difference8<S, 2>, 2, 8, 16>::unpacker(simd);
            for (run, natural) in runs::<16>(natural) {
                first.unpack(simd, packed, run, natural);
                Plain::<6, 2, 16>::unpack(packed, run, natural);
                second.unpack(simd, packed, run, natural);
                Plain::<6, 10, 16>::unpack(packed, run, natural);
            }
        }
        TexelFormat::Bc7 => {
            let mut ends = Packed::<EndPoints<S>, 8, 0, 16>::unpacker(simd);
            for (run, natural) in runs::<16>(natural) {
                ends.unpack(simd, packed, run, natural);
                Plain::<8, 8, 16>::unpack(packed, run, natural);
            }
        }
        TexelFormat::R8 => unpack_all::<S, Difference8<S, 1>, 1, 1>(simd, packed, natural),
        TexelFormat::Rg8 => unpack_all::<S, Difference8<S, 2>, 2, 2>(simd, packed, natural),
        TexelFormat::Rgba8 => unpack_all::<S, Difference8<S, 4>, 4, 4>(simd, packed, natural),
        TexelFormat::Rgba32F => unpack_all::<S, Difference32, 16, 16>(simd, packed, natural),
    }
}

/// Unpacks records of one group of fields.
#[inline(always)]
fn unpack_all<S: Simd, C: Code<S, PLANES>, const PLANES: usize, const RECORD: usize>(
    simd: S,
    packed: &[u8],
    natural: &mut [u8],
) {
    let mut records = Packed::<C, PLANES, 0, RECORD>::unpacker(simd);
    for (run, natural) in runs::<RECORD>(natural) {
        records.unpack(simd, packed, run, natural);
    }
}

/// Records at a time: the lanes of a vector of bytes.
const LANES: usize = 16;

/// A group of fields, `PLANES` bytes from byte `AT` on of a record of `RECORD` bytes, that is packed by code `C`: as many
/// planes, one after the other.
struct Packed<C, const PLANES: usize, const AT: usize, const RECORD: usize>(C);

/// Which of all records are unpacked.
#[derive(Clone, Copy)]
struct Run {
    /// The first of them, a multiple of 16.
    first: usize,
    count: usize,
}

/// Records of a run: few enough to stay in the nearest cache until all of their fields are there.
const RUN: usize = 32 * LANES;

/// The records of `natural` in runs, one after the other.
#[inline(always)]
fn runs<const RECORD: usize>(natural: &mut [u8]) -> impl Iterator<Item = (Run, &mut [u8])> {
    let count = natural.len() / RECORD;
    let runs = natural[..count * RECORD].chunks_mut(RUN * RECORD).enumerate();
    runs.map(move |(index, records)| (Run { first: index * RUN, count }, records))
}

impl<C, const PLANES: usize, const AT: usize, const RECORD: usize> Packed<C, PLANES, AT, RECORD> {
    /// Bytes of a record's piece that is moved at a time.
    const PIECE: usize = match PLANES {
        1 => {
            assert!(RECORD == 1, "single bytes are only moved where they are all of a record");
            1
        }
        2 => 2,
        _ => 4,
    };

    /// From records to the planes of this group.
    #[inline(always)]
    fn pack<S: Simd>(simd: S, natural: &[u8], packed: &mut [u8])
    where
        C: Code<S, PLANES>,
    {
        let records = natural.as_chunks::<RECORD>().0;
        let count = records.len();
        if count == 0 {
            return;
        }
        let packed = &mut packed[AT * count..][..PLANES * count];
        let (blocks, rest) = records.as_chunks::<LANES>();
        let mut last = [[0; RECORD]; LANES];
        last[..rest.len()].copy_from_slice(rest);
        let last = (!rest.is_empty()).then_some(&last);
        let mut code = C::new(simd);
        let mut planes = [u8x16::splat(simd, 0); PLANES];
        for (index, block) in blocks.iter().chain(last).enumerate() {
            Self::gather(simd, block, &mut planes);
            code.encode(simd, &mut planes);
            for (plane, values) in packed.chunks_exact_mut(count).zip(&planes) {
                store(&mut plane[LANES * index..], *values);
            }
        }
    }

    /// Before the first run is unpacked.
    #[inline(always)]
    fn unpacker<S: Simd>(simd: S) -> Self
    where
        C: Code<S, PLANES>,
    {
        Self(C::new(simd))
    }

    /// Inverse of [`pack`](Self::pack), for the [runs](runs) one after the other; `natural` holds this one's records.
    #[inline(always)]
    fn unpack<S: Simd>(&mut self, simd: S, packed: &[u8], run: Run, natural: &mut [u8])
    where
        C: Code<S, PLANES>,
    {
        let records = natural.as_chunks_mut::<RECORD>().0;
        let packed = &packed[AT * run.count..][..PLANES * run.count];
        let (blocks, rest) = records.as_chunks_mut::<LANES>();
        // What other fields have written there comes back with it.
        let mut last = [[0; RECORD]; LANES];
        last[..rest.len()].copy_from_slice(rest);
        let last_block = (!rest.is_empty()).then_some(&mut last);
        let mut planes = [u8x16::splat(simd, 0); PLANES];
        for (index, block) in blocks.iter_mut().chain(last_block).enumerate() {
            for (values, plane) in planes.iter_mut().zip(packed.chunks_exact(run.count)) {
                *values = load(simd, &plane[run.first + LANES * index..]);
            }
            self.0.decode(simd, &mut planes);
            Self::scatter(simd, &planes, block);
        }
        rest.copy_from_slice(&last[..rest.len()]);
    }

    /// Planes from 16 records.
    #[inline(always)]
    fn gather<S: Simd>(simd: S, records: &[[u8; RECORD]; LANES], planes: &mut [u8x16<S>; PLANES]) {
        for (index, planes) in planes.chunks_exact_mut(Self::PIECE).enumerate() {
            let at = AT + index * Self::PIECE;
            match planes {
                [a, b, c, d] => {
                    let mut pieces = [[0; 4]; LANES];
                    for (piece, record) in pieces.iter_mut().zip(records) {
                        piece.copy_from_slice(&record[at..at + 4]);
                    }
                    let mut bytes = [0; 4 * LANES];
                    bytes.copy_from_slice(pieces.as_flattened());
                    [*a, *b, *c, *d] = simd.load_four_interleaved_u8x16(&bytes);
                }
                [a, b] => {
                    let mut pieces = [[0; 2]; LANES];
                    for (piece, record) in pieces.iter_mut().zip(records) {
                        piece.copy_from_slice(&record[at..at + 2]);
                    }
                    let (first, second) = pieces.as_flattened().split_at(LANES);
                    let (first, second) = (u8x16::from_slice(simd, first), u8x16::from_slice(simd, second));
                    (*a, *b) = simd.deinterleave_u8x16(first, second);
                }
                // A record of one byte.
                _ => planes.fill(load(simd, records.as_flattened())),
            }
        }
    }

    /// Inverse of [`gather`](Self::gather).
    #[inline(always)]
    fn scatter<S: Simd>(simd: S, planes: &[u8x16<S>; PLANES], records: &mut [[u8; RECORD]; LANES]) {
        for (index, planes) in planes.chunks_exact(Self::PIECE).enumerate() {
            let at = AT + index * Self::PIECE;
            match *planes {
                [a, b, c, d] => {
                    let mut bytes = [0; 4 * LANES];
                    simd.store_four_interleaved_u8x16([a, b, c, d], &mut bytes);
                    for (piece, record) in bytes.as_chunks::<4>().0.iter().zip(&mut *records) {
                        record[at..at + 4].copy_from_slice(piece);
                    }
                }
                [a, b] => {
                    let mut bytes = [0; 2 * LANES];
                    let (first, second) = simd.interleave_u8x16(a, b);
                    first.store_slice(&mut bytes[..LANES]);
                    second.store_slice(&mut bytes[LANES..]);
                    for (piece, record) in bytes.as_chunks::<2>().0.iter().zip(&mut *records) {
                        record[at..at + 2].copy_from_slice(piece);
                    }
                }
                // A record of one byte.
                _ => store(records.as_flattened_mut(), planes[0]),
            }
        }
    }
}

/// The first 16 bytes of a plane's rest, or all and zeros.
#[inline(always)]
fn load<S: Simd>(simd: S, rest: &[u8]) -> u8x16<S> {
    match rest.first_chunk::<LANES>() {
        Some(bytes) => u8x16::from_slice(simd, bytes),
        None => {
            let mut bytes = [0; LANES];
            bytes[..rest.len()].copy_from_slice(rest);
            u8x16::from_slice(simd, &bytes)
        }
    }
}

/// Inverse of [`load`].
#[inline(always)]
fn store<S: Simd>(rest: &mut [u8], values: u8x16<S>) {
    match rest.first_chunk_mut::<LANES>() {
        Some(bytes) => values.store_slice(bytes),
        None => rest.copy_from_slice(&values.as_slice()[..rest.len()]),
    }
}

/// A field of `LENGTH` bytes from byte `AT` on of a record of `RECORD` bytes, that is packed as it is, record after record.
struct Plain<const LENGTH: usize, const AT: usize, const RECORD: usize>;

impl<const LENGTH: usize, const AT: usize, const RECORD: usize> Plain<LENGTH, AT, RECORD> {
    /// Collects the field.
    #[inline(always)]
    fn pack(natural: &[u8], packed: &mut [u8]) {
        let records = natural.as_chunks::<RECORD>().0;
        let plain = packed[AT * records.len()..].as_chunks_mut::<LENGTH>().0;
        for (bytes, record) in plain.iter_mut().zip(records) {
            bytes.copy_from_slice(&record[AT..AT + LENGTH]);
        }
    }

    /// Inverse of [`pack`](Self::pack), for one of the [runs](runs).
    #[inline(always)]
    fn unpack(packed: &[u8], run: Run, natural: &mut [u8]) {
        let records = natural.as_chunks_mut::<RECORD>().0;
        let plain = packed[AT * run.count + LENGTH * run.first..].as_chunks::<LENGTH>().0;
        for (bytes, record) in plain.iter().zip(records) {
            record[AT..AT + LENGTH].copy_from_slice(bytes);
        }
    }
}

/// A reversible code of `PLANES` bytes of a record.
trait Code<S: Simd, const PLANES: usize> {
    /// Before the first record.
    fn new(simd: S) -> Self;

    /// Values to stored differences.
    fn encode(&mut self, simd: S, planes: &mut [u8x16<S>; PLANES]);

    /// Stored differences to values.
    fn decode(&mut self, simd: S, planes: &mut [u8x16<S>; PLANES]);
}

/// `PLANES` bytes: of each the difference from the record before, modulo 256.
struct Difference8<S: Simd, const PLANES: usize> {
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
struct Difference16<S: Simd> {
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
struct Difference32 {
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
struct EndPoints<S: Simd>(Difference8<S, 8>);

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

#[cfg(test)]
mod tests {
    use fearless_simd::Level;

    use super::*;

    /// Bytes that look random, or that hardly change from record to record.
    fn records(format: TexelFormat, count: usize, rough: bool) -> Vec<u8> {
        let record = reference::record_length(format);
        let mut state = count as u32 + 1;
        (0..count * record)
            .map(|i| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise = (state >> 24) as u8;
                if rough { noise } else { (i % record * 37 + i / record) as u8 ^ (noise & 1) }
            })
            .collect()
    }

    #[test]
    fn packs_as_the_reference_and_back_whatever_the_length() {
        for format in TexelFormat::ALL {
            for count in (0..70).chain([97, 255, 256, 1000]) {
                for rough in [false, true] {
                    let natural = records(format, count, rough);
                    let mut expected = vec![0; natural.len()];
                    reference::pack(format, &natural, &mut expected);
                    let mut packed = vec![0xaa; natural.len()];
                    pack(format, &natural, &mut packed);
                    assert_eq!(packed, expected, "{count} records of {format:?}");
                    let mut back = vec![0xaa; natural.len()];
                    unpack(format, &packed, &mut back);
                    assert_eq!(back, natural, "{count} records of {format:?}");
                }
            }
        }
    }

    #[test]
    fn all_instruction_sets_agree() {
        for format in TexelFormat::ALL {
            let natural = records(format, 333, true);
            let mut packed = vec![0; natural.len()];
            let mut back = vec![0; natural.len()];
            dispatch!(Level::baseline(), simd => pack_in(simd, format, &natural, &mut packed));
            dispatch!(Level::baseline(), simd => unpack_in(simd, format, &packed, &mut back));
            assert_eq!(back, natural, "{format:?}");
            let mut expected = vec![0; natural.len()];
            pack(format, &natural, &mut expected);
            assert_eq!(packed, expected, "{format:?}");
        }
    }

    #[test]
    fn equal_blocks_become_zero_differences() {
        let natural = [10, 200, 1, 2, 3, 4, 5, 6].repeat(3);
        let mut packed = vec![0; 24];
        pack(TexelFormat::Bc4, &natural, &mut packed);
        assert_eq!(packed[..6], [10, 0, 0, 200, 0, 0]);
        assert_eq!(packed[6..], [1, 2, 3, 4, 5, 6].repeat(3));
    }
}
