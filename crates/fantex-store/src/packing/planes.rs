//! Between records and the planes of their bytes, sixteen records at a time.

use fearless_simd::{Simd, prelude::*, u8x16};

use super::codes::Code;

/// Records at a time: the lanes of a vector of bytes.
const LANES: usize = 16;

/// A group of fields, `PLANES` bytes from byte `AT` on of a record of `RECORD` bytes, that is packed by code `C`: as many
/// planes, one after the other.
pub(super) struct Packed<C, const PLANES: usize, const AT: usize, const RECORD: usize>(C);

/// Which of all records are unpacked.
#[derive(Clone, Copy)]
pub(super) struct Run {
    /// The first of them, a multiple of 16.
    first: usize,
    /// All records.
    count: usize,
}

/// Records of a run: few enough to stay in the nearest cache until all of their fields are there.
const RUN: usize = 32 * LANES;

/// The records of `natural` in runs, one after the other.
#[inline(always)]
pub(super) fn runs<const RECORD: usize>(natural: &mut [u8]) -> impl Iterator<Item = (Run, &mut [u8])> {
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
    pub(super) fn pack<S: Simd>(simd: S, natural: &[u8], packed: &mut [u8])
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
    pub(super) fn unpacker<S: Simd>(simd: S) -> Self
    where
        C: Code<S, PLANES>,
    {
        Self(C::new(simd))
    }

    /// Inverse of [`pack`](Self::pack), for the [runs](runs) one after the other; `natural` holds this one's records.
    #[inline(always)]
    pub(super) fn unpack<S: Simd>(&mut self, simd: S, packed: &[u8], run: Run, natural: &mut [u8])
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
pub(super) struct Plain<const LENGTH: usize, const AT: usize, const RECORD: usize>;

impl<const LENGTH: usize, const AT: usize, const RECORD: usize> Plain<LENGTH, AT, RECORD> {
    /// Collects the field.
    #[inline(always)]
    pub(super) fn pack(natural: &[u8], packed: &mut [u8]) {
        let records = natural.as_chunks::<RECORD>().0;
        let plain = packed[AT * records.len()..].as_chunks_mut::<LENGTH>().0;
        for (bytes, record) in plain.iter_mut().zip(records) {
            bytes.copy_from_slice(&record[AT..AT + LENGTH]);
        }
    }

    /// Inverse of [`pack`](Self::pack), for one of the [runs](runs).
    #[inline(always)]
    pub(super) fn unpack(packed: &[u8], run: Run, natural: &mut [u8]) {
        let records = natural.as_chunks_mut::<RECORD>().0;
        let plain = packed[AT * run.count + LENGTH * run.first..].as_chunks::<LENGTH>().0;
        for (bytes, record) in plain.iter().zip(records) {
            record[AT..AT + LENGTH].copy_from_slice(bytes);
        }
    }
}
