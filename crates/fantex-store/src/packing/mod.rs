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
//! Packed with zstd level 1, of the blocks' size (photographs of rock and of the Earth, a normal map, in tiles of 64x64):
//!
//! | | plain | rearranged |
//! |---|---|---|
//! | BC7 | 0.93, 0.66, 0.91 | 0.68, 0.52, 0.80 |
//! | BC1 | 0.90, 0.57, 0.90 | 0.75, 0.47, 0.83 |
//! | BC5 | 0.79, 0.65, 1.00 | 0.74, 0.61, 0.98 |
//! | RGBA8 | 0.64, 0.38, 0.74 | 0.49, 0.28, 0.51 |
//!
//! (Higher levels gain at most 0.01 after this.)
//!
//! Records are taken sixteen at a time, as [planes](planes) of their bytes; what the format says record by record stands in
//! `reference`, for the tests. Nanoseconds per byte of noise in 256 KiB, least of 400 calls, on a core of 2.6 GHz with AVX-512
//! (the ignored test `costs`):
//!
//! | | packing by records | by sixteen | unpacking by records | by sixteen |
//! |---|---|---|---|---|
//! | BC1 | 0.61 | 0.07 | 0.49 | 0.15 |
//! | BC5 | 0.45 | 0.08 | 0.37 | 0.09 |
//! | BC7 | 0.64 | 0.08 | 0.79 | 0.11 |
//! | RGBA8 | 0.45 | 0.04 | 0.27 | 0.16 |
//! | RGBA32F | 0.41 | 0.29 | 0.45 | 0.28 |
//!
//! The whole way from stored bytes to pages, checksum and zstd included, on the same core, least of 10 times and of 5 runs by
//! turns (`examples/unpack_cost.rs`; a photograph of rock, 4 million texels; the bottle has three BC7 channels and one BC5).
//! Before, a zstd context was made for every cluster:
//!
//! | | ns per stored byte, by records | by sixteen | stored MB/s |
//! |---|---|---|---|
//! | BC1 | 3.1 | 1.4 | 710 |
//! | BC7 | 3.1 | 1.0 | 1010 |
//! | RGBA8 | 2.1 | 1.6 | 630 |
//! | bottle | 3.3 | 1.7 | 610 |

mod codes;
mod planes;
#[cfg(test)]
mod reference;

use std::sync::LazyLock;

use codes::{Code, Difference8, Difference16, Difference32, EndPoints};
use fearless_simd::{Level, Simd, dispatch};
use planes::{Packed, Plain, runs};

use crate::TexelFormat;

/// What the processor can do.
fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}

/// Rearranges the records `natural` into `packed`, of the same length.
pub(crate) fn pack(format: TexelFormat, natural: &[u8], packed: &mut [u8]) {
    dispatch!(level(), simd => pack_in(simd, format, natural, packed));
}

/// Inverse of [`pack`].
pub(crate) fn unpack(format: TexelFormat, packed: &[u8], natural: &mut [u8]) {
    dispatch!(level(), simd => unpack_in(simd, format, packed, natural));
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

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    fn record_length(format: TexelFormat) -> usize {
        match format {
            TexelFormat::R8 => 1,
            TexelFormat::Rg8 => 2,
            TexelFormat::Rgba8 => 4,
            TexelFormat::Bc1 | TexelFormat::Bc4 => 8,
            TexelFormat::Bc5 | TexelFormat::Bc7 | TexelFormat::Rgba32F => 16,
        }
    }

    /// Bytes that look random, or that hardly change from record to record.
    fn records(format: TexelFormat, count: usize, rough: bool) -> Vec<u8> {
        let record = record_length(format);
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
                    back.fill(0xaa);
                    reference::unpack(format, &packed, &mut back);
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

    /// Least nanoseconds per byte of some calls.
    fn cost(bytes: &[u8], mut call: impl FnMut(&[u8])) -> f64 {
        let mut least = f64::INFINITY;
        for _ in 0..400 {
            let begin = Instant::now();
            call(bytes);
            least = least.min(begin.elapsed().as_nanos() as f64 / bytes.len() as f64);
        }
        least
    }

    #[test]
    #[ignore = "measures"]
    fn costs() {
        for format in TexelFormat::ALL {
            let natural = records(format, (256 << 10) / record_length(format), true);
            let mut packed = vec![0; natural.len()];
            let mut back = vec![0; natural.len()];
            let packing = [
                cost(&natural, |bytes| reference::pack(format, bytes, &mut packed)),
                cost(&natural, |bytes| pack(format, bytes, &mut packed)),
            ];
            let unpacking = [
                cost(&packed, |bytes| reference::unpack(format, bytes, &mut back)),
                cost(&packed, |bytes| unpack(format, bytes, &mut back)),
            ];
            eprintln!(
                "{format:?}: ns per byte, record by record and fast: {packing:.3?}, back {unpacking:.3?}"
            );
        }
    }
}
