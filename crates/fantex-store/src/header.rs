//! The header: two slots, of which the valid one with the greater generation counts.
//!
//! A new file has the same slot twice. A later change appends clusters and a directory, makes them durable, and then writes
//! the *older* slot anew with the next generation: a crash in between leaves the other one.

use xxhash_rust::xxh3::xxh3_64;

use crate::bytes::ByteWriter;

/// Like PNG's, it finds out transfers that change line ends or strip the eighth bit.
pub(crate) const SIGNATURE: [u8; 8] = *b"\x89FAN\r\n\x1a\n";
/// Version of the format.
pub(crate) const VERSION: u32 = 1;
/// Bytes of a slot, the last eight being its checksum.
pub(crate) const SLOT_BYTES: usize = 256;
/// Where the slots start: each in a disk block of its own.
pub(crate) const SLOT_OFFSETS: [u64; 2] = [0, 4096];
/// End of the header: sections start here.
pub(crate) const HEADER_BYTES: u64 = 8192;

/// Names of the sections, for messages, in their order in the header.
pub(crate) const SECTION_NAMES: [&str; 4] = ["channel", "cover", "mesh", "directory"];

/// A packed section.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SectionRecord {
    pub(crate) offset: u64,
    pub(crate) stored_length: u64,
    pub(crate) raw_length: u64,
    /// xxh3-64 of the stored bytes.
    pub(crate) checksum: u64,
}

impl SectionRecord {
    /// Bytes of the file; empty for one that overflows.
    pub(crate) fn range(&self) -> std::ops::Range<u64> {
        self.offset..self.offset.saturating_add(self.stored_length)
    }
}

/// One slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Slot {
    pub(crate) version: u32,
    /// Features that a reader must know; none yet.
    pub(crate) flags: u32,
    pub(crate) generation: u64,
    /// Bytes of the file that this slot refers to.
    pub(crate) file_length: u64,
    pub(crate) sections: [SectionRecord; 4],
    /// The list of attachments; of stored length 0 where there are none. Readers of texels need not know it.
    pub(crate) attachments: SectionRecord,
}

impl Slot {
    pub(crate) fn encode(&self) -> [u8; SLOT_BYTES] {
        let mut out = ByteWriter::default();
        out.put(&SIGNATURE);
        out.u32(self.version);
        out.u32(self.flags);
        out.u64(self.generation);
        out.u64(self.file_length);
        for section in self.sections.iter().chain([&self.attachments]) {
            let SectionRecord { offset, stored_length, raw_length, checksum } = *section;
            [offset, stored_length, raw_length, checksum].into_iter().for_each(|x| out.u64(x));
        }
        out.bytes.resize(SLOT_BYTES - 8, 0);
        out.u64(xxh3_64(&out.bytes));
        let mut slot = [0; SLOT_BYTES];
        slot.copy_from_slice(&out.bytes);
        slot
    }

    /// None where signature or checksum are wrong.
    pub(crate) fn decode(bytes: &[u8; SLOT_BYTES]) -> Option<Self> {
        let u64_at = |at: usize| {
            let mut word = [0; 8];
            word.copy_from_slice(&bytes[at..at + 8]);
            u64::from_le_bytes(word)
        };
        if bytes[..8] != SIGNATURE || u64_at(SLOT_BYTES - 8) != xxh3_64(&bytes[..SLOT_BYTES - 8]) {
            return None;
        }
        let record = |i: usize| SectionRecord {
            offset: u64_at(32 + 32 * i),
            stored_length: u64_at(40 + 32 * i),
            raw_length: u64_at(48 + 32 * i),
            checksum: u64_at(56 + 32 * i),
        };
        let words = u64_at(8);
        Some(Self {
            version: words as u32,
            flags: (words >> 32) as u32,
            generation: u64_at(16),
            file_length: u64_at(24),
            sections: std::array::from_fn(record),
            attachments: record(4),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_comes_back_and_any_flipped_bit_is_noticed() {
        let record = SectionRecord { offset: 1, stored_length: 2, raw_length: 3, checksum: 4 };
        let slot = Slot {
            version: 1,
            flags: 0,
            generation: 5,
            file_length: 6,
            sections: [record; 4],
            attachments: record,
        };
        let bytes = slot.encode();
        assert_eq!(Slot::decode(&bytes), Some(slot));
        for bit in 0..8 * SLOT_BYTES {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Slot::decode(&damaged), None, "bit {bit}");
        }
    }
}
