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

use crate::TexelFormat;

/// A little-endian integer (`Difference`) or plain bytes (`Plain`) of a record.
#[derive(Clone, Copy)]
enum Field {
    /// 1 byte: difference from the record before, modulo 256.
    Difference8,
    /// 2 bytes: zigzag-coded difference modulo 2^16; low bytes first, then high bytes.
    Difference16,
    /// 4 bytes: zigzag-coded difference modulo 2^32; four byte planes, lowest first.
    Difference32,
    /// So many bytes, copied.
    Plain(usize),
}

impl Field {
    fn length(self) -> usize {
        match self {
            Self::Difference8 => 1,
            Self::Difference16 => 2,
            Self::Difference32 => 4,
            Self::Plain(length) => length,
        }
    }
}

fn fields(format: TexelFormat) -> &'static [Field] {
    use Field::{Difference8, Difference16, Difference32, Plain};
    match format {
        TexelFormat::Bc1 => &[Difference16, Difference16, Plain(4)],
        TexelFormat::Bc4 => &[Difference8, Difference8, Plain(6)],
        TexelFormat::Bc5 => &[Difference8, Difference8, Plain(6), Difference8, Difference8, Plain(6)],
        TexelFormat::Bc7 => &[Plain(16)],
        TexelFormat::R8 => &[Difference8],
        TexelFormat::Rg8 => &[Difference8; 2],
        TexelFormat::Rgba8 => &[Difference8; 4],
        TexelFormat::Rgba32F => &[Difference32; 4],
    }
}

/// Rearranges the records `natural` into `packed`, of the same length.
pub(crate) fn pack(format: TexelFormat, natural: &[u8], packed: &mut [u8]) {
    let record = record_length(format);
    let count = natural.len() / record;
    let mut at = 0;
    for &field in fields(format) {
        let plane = at * count;
        let records = natural.chunks_exact(record).map(|r| &r[at..]);
        match field {
            Field::Plain(length) => {
                for (i, r) in records.enumerate() {
                    packed[plane + i * length..][..length].copy_from_slice(&r[..length]);
                }
            }
            Field::Difference8 => {
                let mut previous = 0;
                for (out, r) in packed[plane..][..count].iter_mut().zip(records) {
                    *out = r[0].wrapping_sub(previous);
                    previous = r[0];
                }
            }
            Field::Difference16 => {
                let mut previous = 0;
                for (i, r) in records.enumerate() {
                    let value = u16::from_le_bytes([r[0], r[1]]);
                    let code = zigzag16(value.wrapping_sub(previous)).to_le_bytes();
                    packed[plane + i] = code[0];
                    packed[plane + count + i] = code[1];
                    previous = value;
                }
            }
            Field::Difference32 => {
                let mut previous = 0;
                for (i, r) in records.enumerate() {
                    let value = u32::from_le_bytes([r[0], r[1], r[2], r[3]]);
                    let code = crate::bytes::zigzag(value.wrapping_sub(previous)).to_le_bytes();
                    for (k, byte) in code.into_iter().enumerate() {
                        packed[plane + k * count + i] = byte;
                    }
                    previous = value;
                }
            }
        }
        at += field.length();
    }
}

/// Inverse of [`pack`].
pub(crate) fn unpack(format: TexelFormat, packed: &[u8], natural: &mut [u8]) {
    let record = record_length(format);
    let count = natural.len() / record;
    let mut at = 0;
    for &field in fields(format) {
        let plane = at * count;
        let records = natural.chunks_exact_mut(record).map(|r| &mut r[at..]);
        match field {
            Field::Plain(length) => {
                for (r, bytes) in records.zip(packed[plane..].chunks_exact(length)) {
                    r[..length].copy_from_slice(bytes);
                }
            }
            Field::Difference8 => {
                let mut value = 0u8;
                for (r, code) in records.zip(&packed[plane..]) {
                    value = value.wrapping_add(*code);
                    r[0] = value;
                }
            }
            Field::Difference16 => {
                let (low, high) = packed[plane..][..2 * count].split_at(count);
                let mut value = 0u16;
                for ((r, &l), &h) in records.zip(low).zip(high) {
                    value = value.wrapping_add(unzigzag16(u16::from_le_bytes([l, h])));
                    r[..2].copy_from_slice(&value.to_le_bytes());
                }
            }
            Field::Difference32 => {
                let planes = &packed[plane..][..4 * count];
                let mut value = 0u32;
                for (i, r) in records.enumerate() {
                    let code = [0, 1, 2, 3].map(|k| planes[k * count + i]);
                    value = value.wrapping_add(crate::bytes::unzigzag(u32::from_le_bytes(code)));
                    r[..4].copy_from_slice(&value.to_le_bytes());
                }
            }
        }
        at += field.length();
    }
}

fn record_length(format: TexelFormat) -> usize {
    fields(format).iter().map(|field| field.length()).sum()
}

fn zigzag16(difference: u16) -> u16 {
    (difference << 1) ^ (((difference as i16) >> 15) as u16)
}

fn unzigzag16(code: u16) -> u16 {
    (code >> 1) ^ (code & 1).wrapping_neg()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packing_is_reversible_and_separates_the_fields() {
        for format in TexelFormat::ALL {
            let count = 7;
            let natural: Vec<u8> =
                (0..count * record_length(format)).map(|i| (i * i * 31 + 7 * i) as u8).collect();
            let mut packed = vec![0; natural.len()];
            pack(format, &natural, &mut packed);
            let mut back = vec![0; natural.len()];
            unpack(format, &packed, &mut back);
            assert_eq!(back, natural, "{format:?}");
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
