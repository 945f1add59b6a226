//! Zstandard frames (RFC 8878), unpacked: by the C library, and in WebAssembly, where there is none, by `ruzstd`, which is Rust
//! throughout and takes six to seven times as long.
//!
//! Whatever is unpacked is a sequence of frames whose contents follow each other; skippable frames may lie among them.

use std::io::Read;

#[cfg(not(target_arch = "wasm32"))]
use native as decoder;
#[cfg(target_arch = "wasm32")]
use portable as decoder;

/// Unpacks one piece after the other, and keeps between them what is set up once.
#[derive(Default)]
pub struct Unpacker(decoder::Unpacker);

impl std::fmt::Debug for Unpacker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Unpacker").finish_non_exhaustive()
    }
}

impl Unpacker {
    /// Unpacks frames to the beginning of `room`. Returns how many bytes they hold; none where they are damaged or hold more than
    /// there is room for, and what is in `room` is undefined then.
    pub fn unpack(&mut self, packed: &[u8], room: &mut [u8]) -> Option<usize> {
        self.0.unpack(packed, room)
    }
}

/// Unpacks frames that hold exactly `bytes` bytes and have windows of at most `2^window_log` bytes; none where they are damaged, or
/// ask for other sizes. Memory is set aside for what `bytes` says at most, so callers check that first.
pub fn unpack_exactly(packed: &[u8], bytes: u64, window_log: u32) -> Option<Vec<u8>> {
    decoder::unpack_exactly(packed, bytes, window_log).filter(|raw| raw.len() as u64 == bytes)
}

/// Frames as a stream of what they hold, with windows of at most `2^window_log` bytes; none where these are asked to be larger. `bytes` is how
/// many bytes callers expect, who check the stream's length: where unpacking is not [gradual](IS_GRADUAL), it has so many or there is none.
pub fn unpacking(packed: &[u8], bytes: u64, window_log: u32) -> Option<Box<dyn Read + '_>> {
    decoder::unpacking(packed, bytes, window_log)
}

/// Whether [`unpacking`] takes memory for windows only, not for all that it gives.
pub const IS_GRADUAL: bool = cfg!(not(target_arch = "wasm32"));

/// Unpacks frames that hold at most `max_bytes` bytes; none where they are damaged or hold more.
pub fn unpack(packed: &[u8], max_bytes: usize) -> Option<Vec<u8>> {
    let mut raw = vec![0; max_bytes];
    let length = Unpacker::default().unpack(packed, &mut raw)?;
    raw.truncate(length);
    Some(raw)
}

/// The most bytes that one frame of `bytes` bytes takes, when the encoder does what it can.
pub fn packed_bound(bytes: usize) -> usize {
    // Short input is given some room for headers.
    let margin = (128_usize << 10).saturating_sub(bytes) >> 11;
    bytes.saturating_add(bytes >> 8).saturating_add(margin)
}

#[cfg(not(target_arch = "wasm32"))]
mod native {
    use std::io::Read;

    #[derive(Default)]
    pub(super) struct Unpacker(zstd::bulk::Decompressor<'static>);

    impl Unpacker {
        pub(super) fn unpack(&mut self, packed: &[u8], room: &mut [u8]) -> Option<usize> {
            self.0.decompress_to_buffer(packed, room).ok()
        }
    }

    pub(super) fn unpack_exactly(packed: &[u8], bytes: u64, window_log: u32) -> Option<Vec<u8>> {
        let mut raw = Vec::new();
        unpacking(packed, bytes, window_log)?.take(bytes.saturating_add(1)).read_to_end(&mut raw).ok()?;
        Some(raw)
    }

    pub(super) fn unpacking(packed: &[u8], _: u64, window_log: u32) -> Option<Box<dyn Read + '_>> {
        let mut decoder = zstd::Decoder::with_buffer(packed).ok()?;
        decoder.window_log_max(window_log).ok()?;
        Some(Box::new(decoder))
    }
}

/// Compiled for tests, too: they compare it with the other.
#[cfg(any(test, target_arch = "wasm32"))]
mod portable {
    use std::io::{Cursor, Read};

    use ruzstd::decoding::FrameDecoder;

    #[derive(Default)]
    pub(super) struct Unpacker(FrameDecoder);

    impl Unpacker {
        pub(super) fn unpack(&mut self, packed: &[u8], room: &mut [u8]) -> Option<usize> {
            self.0.decode_all(packed, room).ok()
        }
    }

    pub(super) fn unpack_exactly(packed: &[u8], bytes: u64, window_log: u32) -> Option<Vec<u8>> {
        let mut decoder = FrameDecoder::new();
        decoder.set_max_window_size(1 << window_log);
        let mut raw = vec![0; usize::try_from(bytes).ok()?];
        let length = decoder.decode_all(packed, &mut raw).ok()?;
        raw.truncate(length);
        Some(raw)
    }

    pub(super) fn unpacking(packed: &[u8], bytes: u64, window_log: u32) -> Option<Box<dyn Read + '_>> {
        let raw = unpack_exactly(packed, bytes, window_log).filter(|raw| raw.len() as u64 == bytes)?;
        Some(Box::new(Cursor::new(raw)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Random;

    fn below(random: &mut Random, limit: usize) -> usize {
        random.below(limit as u64) as usize
    }

    /// Bytes that pack well, badly, and not at all, from a seed.
    fn bytes(random: &mut Random, length: usize) -> Vec<u8> {
        let alphabet = [2, 17, 256][below(random, 3)];
        let mut bytes: Vec<u8> = Vec::with_capacity(length);
        while bytes.len() < length {
            if !bytes.is_empty() && below(random, 4) == 0 {
                // What was there before, a little to a lot of it.
                let from = below(random, bytes.len());
                let count = below(random, 300).min(length - bytes.len());
                (0..count).for_each(|i| bytes.push(bytes[from + i]));
            } else {
                bytes.push(below(random, alphabet) as u8);
            }
        }
        bytes
    }

    #[test]
    fn both_decoders_agree_on_good_frames_and_on_damaged_ones() {
        let mut random = Random::new(7);
        let (mut native, mut portable) = (native::Unpacker::default(), portable::Unpacker::default());
        let (mut refused, mut damaged) = (0, 0);
        for round in 0..60 {
            let length = [0, 1, 100, 5000, 200_000][below(&mut random, 5)];
            let content = bytes(&mut random, length);
            let mut packed = zstd::bulk::compress(&content, [1, 3, 9, 19][below(&mut random, 4)]).unwrap();
            let skipped = below(&mut random, 3);
            if skipped > 0 {
                packed.extend(0x184D_2A50_u32.to_le_bytes());
                packed.extend((skipped as u32).to_le_bytes());
                packed.resize(packed.len() + skipped, 7);
            }
            if below(&mut random, 2) == 0 {
                let second = zstd::bulk::compress(&content[..length / 2], 1).unwrap();
                packed.extend(second);
            }
            let bound = 2 * length + 10;
            let (mut one, mut other) = (vec![0; bound], vec![0; bound]);
            let count = native.unpack(&packed, &mut one).unwrap();
            assert_eq!(portable.unpack(&packed, &mut other), Some(count), "round {round}");
            assert!(one[..count] == other[..count] && one.starts_with(&content), "round {round}");
            let exact = native::unpack_exactly(&packed, count as u64, 23);
            assert_eq!(exact.as_deref(), Some(&one[..count]));
            assert_eq!(portable::unpack_exactly(&packed, count as u64, 23), exact);
            for unpacking in [native::unpacking, portable::unpacking] {
                let mut streamed = Vec::new();
                unpacking(&packed, count as u64, 23).unwrap().read_to_end(&mut streamed).unwrap();
                assert_eq!(Some(streamed), exact);
            }
            if count > 0 {
                assert_eq!(portable.unpack(&packed, &mut other[..count - 1]), None);
            }
            // Damage: neither panics, and what both accept is the same.
            for _ in 0..4 {
                let mut wrong = packed.clone();
                match below(&mut random, 2) {
                    0 => wrong.truncate(below(&mut random, packed.len())),
                    _ => wrong[below(&mut random, packed.len())] ^= 1 << below(&mut random, 8),
                }
                let (one_count, other_count) =
                    (native.unpack(&wrong, &mut one), portable.unpack(&wrong, &mut other));
                damaged += 1;
                refused += usize::from(other_count.is_none());
                if let (Some(count), Some(others)) = (one_count, other_count) {
                    assert!(one[..count] == other[..others], "round {round}");
                }
            }
        }
        assert!(refused > damaged / 4, "{refused} of {damaged}");
    }

    #[test]
    fn windows_and_lengths_beyond_the_limit_are_refused() {
        let content = bytes(&mut Random::new(3), 3 << 20);
        let mut packed = Vec::new();
        let mut encoder = zstd::Encoder::new(&mut packed, 1).unwrap();
        encoder.window_log(22).unwrap();
        std::io::Write::write_all(&mut encoder, &content).unwrap();
        encoder.finish().unwrap();
        for unpack in [native::unpack_exactly, portable::unpack_exactly] {
            let length = content.len() as u64;
            assert!(unpack(&packed, length, 22).as_deref() == Some(&content));
            assert!(unpack(&packed, length, 21).is_none());
        }
        assert_eq!(unpack_exactly(&packed, 10, 22), None);
        assert_eq!(unpack_exactly(&packed, content.len() as u64 + 1, 22), None);
        assert_eq!(unpack(&packed, content.len() - 1), None);
        assert!(unpack(&packed, content.len() + 5).as_deref() == Some(&content));
    }

    #[test]
    fn the_bound_is_that_of_the_library() {
        let mut random = Random::new(5);
        let lengths = (0..2000).map(|_| below(&mut random, 300_000)).chain([
            0,
            1,
            128 << 10,
            (128 << 10) - 1,
            64 << 20,
        ]);
        for length in lengths {
            assert_eq!(packed_bound(length), zstd::zstd_safe::compress_bound(length), "{length}");
        }
    }
}
