//! The rearrangement record by record, as the format describes it: what the fast one is tested against.

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
    /// 8 bytes: the end points of a BC7 block of mode 6, see [`end_points`].
    EndPoints,
    /// So many bytes, copied.
    Plain(usize),
}

impl Field {
    fn length(self) -> usize {
        match self {
            Self::Difference8 => 1,
            Self::Difference16 => 2,
            Self::Difference32 => 4,
            Self::EndPoints => 8,
            Self::Plain(length) => length,
        }
    }
}

fn fields(format: TexelFormat) -> &'static [Field] {
    use Field::{Difference8, Difference16, Difference32, EndPoints, Plain};
    match format {
        TexelFormat::Bc1 => &[Difference16, Difference16, Plain(4)],
        TexelFormat::Bc4 => &[Difference8, Difference8, Plain(6)],
        TexelFormat::Bc5 => &[Difference8, Difference8, Plain(6), Difference8, Difference8, Plain(6)],
        TexelFormat::Bc7 => &[EndPoints, Plain(8)],
        TexelFormat::R8 => &[Difference8],
        TexelFormat::Rg8 => &[Difference8; 2],
        TexelFormat::Rgba8 => &[Difference8; 4],
        TexelFormat::Rgba32F => &[Difference32; 4],
    }
}

/// Rearranges the records `natural` into `packed`, of the same length.
pub(super) fn pack(format: TexelFormat, natural: &[u8], packed: &mut [u8]) {
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
            Field::EndPoints => {
                let mut previous = [0; 8];
                for (i, r) in records.enumerate() {
                    let points = end_points(head(r));
                    let codes = decorrelated(differences(points, previous));
                    for (k, byte) in codes.into_iter().enumerate() {
                        packed[plane + k * count + i] = byte;
                    }
                    previous = points;
                }
            }
        }
        at += field.length();
    }
}

/// The first 64 bits of a block.
fn head(block: &[u8]) -> u64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&block[..8]);
    u64::from_le_bytes(bytes)
}

/// The eight 7-bit fields r0 r1 g0 g1 b0 b1 a0 a1 that follow the 7 mode bits of a block of mode 6. Bit 7 of byte k is bit k
/// of the mode bits (k < 7) or the last bit of the head (k = 7), so nothing is lost, whatever the mode.
fn end_points(head: u64) -> [u8; 8] {
    let rest = (head & 0x7f) | (head >> 63 << 7);
    std::array::from_fn(|k| ((head >> (7 + 7 * k)) & 0x7f) as u8 | ((rest >> k) as u8 & 1) << 7)
}

fn differences(points: [u8; 8], previous: [u8; 8]) -> [u8; 8] {
    std::array::from_fn(|k| points[k].wrapping_sub(previous[k]))
}

/// Red and blue relative to green.
fn decorrelated(d: [u8; 8]) -> [u8; 8] {
    let [r0, r1, g0, g1, b0, b1, a0, a1] = d;
    [r0.wrapping_sub(g0), r1.wrapping_sub(g1), g0, g1, b0.wrapping_sub(g0), b1.wrapping_sub(g1), a0, a1]
}

pub(super) fn record_length(format: TexelFormat) -> usize {
    fields(format).iter().map(|field| field.length()).sum()
}

fn zigzag16(difference: u16) -> u16 {
    (difference << 1) ^ (((difference as i16) >> 15) as u16)
}
