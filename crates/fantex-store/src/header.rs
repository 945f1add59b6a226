//! The header and the way from it to the sections.
//!
//! ```text
//!  0      8192                                      4096-aligned
//!  slots | channels | cover | mesh | directory ... | cluster | cluster | ...
//!  `-1st-' `-------------- 2nd ------------'
//! ```
//!
//! There are two header slots, of which the valid one with the greater generation counts. A new file has the same slot twice. A
//! later change writes clusters and a directory to where neither slot refers to (free space, or the end of the file), makes them
//! durable, and then writes the *older* slot anew with the next generation: a crash in between leaves the other one.
//!
//! Opening takes two reads, because a source far away takes its time for each. Sections that lie far from the others (as
//! those that a change has written do) are read by themselves.

use std::ops::Range;
use std::path::Path;

use fantex_base::{Error, Result, counted, input, zstandard};
use fantex_mesh::check_hard_edges;
use xxhash_rust::xxh3::xxh3_64;

use crate::ByteSource;
use crate::bytes::{ByteReader, ByteWriter};
use crate::error::damaged;
use crate::limits::{MAX_SECTION_RATIO, MAX_WINDOW_LOG, SECTION_RATIO_FREE};

/// Like PNG's, it finds out transfers that change line ends or strip the eighth bit.
pub(crate) const SIGNATURE: [u8; 8] = *b"\x89FAN\r\n\x1a\n";

/// That of parts of a planned bake; the last byte is the version.
pub(crate) const PART_SIGNATURE: &[u8; 8] = b"FANPART2";
pub(crate) const VERSION: u32 = 1;
/// Bytes of a slot, the last eight being its checksum.
pub(crate) const SLOT_BYTES: usize = 256;
/// Where the slots start: each in a disk block of its own.
pub(crate) const SLOT_OFFSETS: [u64; 2] = [0, 4096];
/// End of the header: sections start here.
pub(crate) const HEADER_BYTES: u64 = 8192;

/// Names of the sections, for messages, in their order in the header.
pub(crate) const SECTION_NAMES: [&str; 4] = ["channel", "cover", "mesh", "directory"];

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
    pub(crate) fn range(&self) -> Range<u64> {
        self.offset..self.offset.saturating_add(self.stored_length)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Slot {
    pub(crate) version: u32,
    /// Features that a reader must know: [`FLAG_PLAN`].
    pub(crate) flags: u32,
    pub(crate) generation: u64,
    /// Bytes of the file that this slot refers to.
    pub(crate) file_length: u64,
    pub(crate) sections: [SectionRecord; 4],
    /// The list of attachments; of stored length 0 where there are none. Readers of texels need not know it.
    pub(crate) attachments: SectionRecord,
    /// See [`Cover::hard_edges`](fantex_cover::Cover::hard_edges). Readers of texels need not know it.
    pub(crate) hard_edges: Option<f32>,
}

impl Slot {
    /// Of a generation that names nothing yet.
    pub(crate) fn new(generation: u64) -> Self {
        let (sections, attachments, hard_edges) = Default::default();
        Self { version: VERSION, flags: 0, generation, file_length: 0, sections, attachments, hard_edges }
    }

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
        if let Some(degrees) = self.hard_edges {
            out.u32(1);
            out.f32s(&[degrees]);
        }
        out.bytes.resize(SLOT_BYTES - 8, 0);
        out.u64(xxh3_64(&out.bytes));
        let mut slot = [0; SLOT_BYTES];
        slot.copy_from_slice(&out.bytes);
        slot
    }

    /// Where clusters and attachments may lie.
    pub(crate) fn places(&self) -> Range<u64> {
        HEADER_BYTES..self.file_length
    }

    /// Whether all sections, and the list of attachments where there is one, lie in the file.
    pub(crate) fn names_the_file_only(&self) -> bool {
        let list = Some(&self.attachments).filter(|list| **list != SectionRecord::default());
        let Range { start, end } = self.places();
        self.sections.iter().chain(list).all(|record| start <= record.offset && record.range().end <= end)
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
        let (words, hard) = (u64_at(8), u64_at(192));
        Some(Self {
            version: words as u32,
            flags: (words >> 32) as u32,
            generation: u64_at(16),
            file_length: u64_at(24),
            sections: std::array::from_fn(record),
            attachments: record(4),
            hard_edges: (hard as u32 == 1).then_some(f32::from_bits((hard >> 32) as u32)),
        })
    }
}

/// Bytes between two sections that are read along rather than asked for apart.
const SECTION_GAP: u64 = 1 << 16;

/// The flag of a [plan](crate::Plan): sections without texels.
pub(crate) const FLAG_PLAN: u32 = 2;

/// That of a plan without a recipe, whose parts cannot be told from those of others.
pub(crate) const FLAG_BARE_PLAN: u32 = 1;

/// Flags of all files that have something to say here.
const KNOWN_FLAGS: [u32; 3] = [0, FLAG_PLAN, FLAG_BARE_PLAN];

/// The valid header slot with the greatest generation, and the number of damaged ones.
pub(crate) fn read_slot(source: &dyn ByteSource) -> Result<(Slot, u32)> {
    let (slot, damaged_slots) = read_any_slot(source)?;
    if slot.flags != 0 {
        let path = source.location();
        return Err(Error::unsupported(format!(
            "{} is a plan, which has no texels: bake its shards, then merge them into an asset",
            path.display()
        ))
        .with_path(path));
    }
    Ok((slot, damaged_slots))
}

/// As [`read_slot`], of plans, too.
pub(crate) fn read_any_slot(source: &dyn ByteSource) -> Result<(Slot, u32)> {
    let path = source.location();
    let mut header = [0; HEADER_BYTES as usize];
    let count = source.read_at(&mut header, 0).map_err(|error| Error::reading(source.location(), error))?;
    let mut slots = [[0; SLOT_BYTES]; 2];
    for (slot, offset) in slots.iter_mut().zip(SLOT_OFFSETS) {
        let range = offset as usize..offset as usize + SLOT_BYTES;
        if range.end <= count {
            slot.copy_from_slice(&header[range]);
        }
    }
    let valid = slots.iter().filter_map(Slot::decode);
    let damaged_slots = 2 - valid.clone().count() as u32;
    let Some(slot) = valid.max_by_key(|slot| slot.generation) else {
        let has_signature = slots.iter().any(|slot| slot[..8] == SIGNATURE);
        return Err(if has_signature {
            damaged(path, "neither of its two headers has a valid checksum; bake it anew")
        } else if header.starts_with(PART_SIGNATURE) {
            Error::malformed(format!(
                "{} is a part of a planned bake; a merge takes the plan first, then all parts",
                path.display()
            ))
            .with_path(path)
        } else {
            Error::malformed(format!(
                "{} is not a .fan asset: it does not start with the asset signature",
                path.display()
            ))
            .with_path(path)
        });
    };
    if slot.version != VERSION || !KNOWN_FLAGS.contains(&slot.flags) {
        let (version, flags, supported) = (slot.version, slot.flags, VERSION);
        return Err(Error::unsupported(format!("{} has format version {version}, flags {flags:#x}; this program reads version {supported}, flags 0: use a newer program", path.display())).with_path(path));
    }
    if let Some(Err(wrong)) = slot.hard_edges.map(check_hard_edges) {
        return Err(damaged(path, format!("its header is wrong: {wrong}")));
    }
    let length = source.length().map_err(|error| Error::reading(source.location(), error))?;
    if length < slot.file_length {
        return Err(Error::damaged(format!(
            "{} is truncated: {length} of {}; copy or bake it anew",
            path.display(),
            counted(slot.file_length, "byte")
        ))
        .with_path(path));
    }
    Ok((slot, damaged_slots))
}

/// The slot that does not count, and itself where it is whole.
pub(crate) fn read_other_slot(source: &dyn ByteSource, current: &Slot) -> (usize, Option<Slot>) {
    let mut slots = [[0; SLOT_BYTES]; 2];
    for (bytes, offset) in slots.iter_mut().zip(SLOT_OFFSETS) {
        // A slot that cannot be read is as good as none.
        if source.read_exact_at(bytes, offset).is_err() {
            bytes.fill(0);
        }
    }
    let [first, second] = slots.each_ref().map(Slot::decode);
    if first.as_ref() == Some(current) { (1, second) } else { (0, first) }
}

/// The stored bytes of the sections, each as long as it is not unpacked.
pub(crate) struct Sections<'a> {
    path: &'a Path,
    records: [SectionRecord; 4],
    stored: [Vec<u8>; 4],
}

impl<'a> Sections<'a> {
    /// Checks the records and reads the sections' bytes.
    pub(crate) fn read(source: &'a dyn ByteSource, slot: &Slot) -> Result<Self> {
        let (path, records) = (source.location(), slot.sections);
        let mut ranges = Vec::new();
        for (record, section) in records.iter().zip(SECTION_NAMES) {
            check_record(path, section, record, slot.file_length)?;
            ranges.push(record.range());
        }
        reserve_opening(path, opening_bytes(&records))?;
        let mut stored: [Vec<u8>; 4] = Default::default();
        for span in merged(ranges) {
            let mut bytes = vec![0; (span.end - span.start) as usize];
            source.read_exact_at(&mut bytes, span.start).map_err(|error| Error::reading(path, error))?;
            for (own, range) in stored.iter_mut().zip(records.iter().map(SectionRecord::range)) {
                if span.start <= range.start && range.end <= span.end {
                    *own = bytes[(range.start - span.start) as usize..(range.end - span.start) as usize]
                        .to_vec();
                }
            }
        }
        Ok(Self { path, records, stored })
    }

    /// Counts what all sections take that are unpacked and kept, beside what they say.
    pub(crate) fn reserve_unpacked(&self) -> Result<input::Held> {
        let bytes = self.records.iter().map(|record| record.raw_length).fold(0, u64::saturating_add);
        reserve_opening(self.path, bytes)
    }

    /// A section, unpacked. It is given once.
    pub(crate) fn unpack(&mut self, index: usize) -> Result<Vec<u8>> {
        let stored = std::mem::take(&mut self.stored[index]);
        unpack_section(self.path, SECTION_NAMES[index], &self.records[index], &stored)
    }

    /// Reads a section as it is unpacked. It is given once.
    pub(crate) fn decode<T>(&mut self, index: usize, decode: impl FnOnce(ByteReader<'_>) -> T) -> Result<T> {
        let (stored, record) = (std::mem::take(&mut self.stored[index]), &self.records[index]);
        let section = SECTION_NAMES[index];
        check_stored(self.path, section, record, &stored)?;
        let stream = zstandard::unpacking(&stored, record.raw_length, MAX_WINDOW_LOG);
        let stream = stream.ok_or_else(|| packing_error(self.path, section, record))?;
        Ok(decode(ByteReader::of_stream(stream, record.raw_length as usize)))
    }
}

fn reserve_opening(path: &Path, bytes: u64) -> Result<input::Held> {
    input::reserve(format_args!("opening the sections of {}", path.display()), bytes)
}

pub(crate) fn read_section(
    source: &dyn ByteSource,
    section: &'static str,
    record: &SectionRecord,
    file_length: u64,
) -> Result<Vec<u8>> {
    let path = source.location();
    check_record(path, section, record, file_length)?;
    // As stored, unpacked, and what it says.
    let bytes = record.raw_length.saturating_mul(2).saturating_add(record.stored_length);
    input::reserve(format_args!("the {section} section of {}", path.display()), bytes)?;
    let mut stored = vec![0; record.stored_length as usize];
    source.read_exact_at(&mut stored, record.offset).map_err(|error| Error::reading(path, error))?;
    unpack_section(path, section, record, &stored)
}

/// That a section lies in the file and does not claim to hold more than it can.
fn check_record(path: &Path, section: &'static str, record: &SectionRecord, file_length: u64) -> Result<()> {
    let SectionRecord { offset, stored_length, raw_length, .. } = *record;
    let end = record.range().end;
    if offset < HEADER_BYTES || end > file_length {
        return Err(damaged(path, format!("its {section} section claims bytes {offset} to {end}")));
    }
    if raw_length > SECTION_RATIO_FREE.saturating_add(stored_length.saturating_mul(MAX_SECTION_RATIO)) {
        return Err(packing_error(path, section, record));
    }
    Ok(())
}

/// The order in which sections are opened: channels, mesh, cover, directory.
const OPENING_ORDER: [usize; 4] = [0, MESH_SECTION, 1, 3];

/// The section that is read as it is unpacked: the only large one.
pub(crate) const MESH_SECTION: usize = 2;

/// The most memory that opening takes at once: all sections as read and as stored; then, one after the other, those still stored, what the
/// ones before say, and one of them unpacked.
fn opening_bytes(records: &[SectionRecord; 4]) -> u64 {
    let sum = |lengths: &mut dyn Iterator<Item = u64>| lengths.fold(0, u64::saturating_add);
    let stored_from = |step: usize| sum(&mut OPENING_ORDER[step..].iter().map(|&i| records[i].stored_length));
    let step = |step: usize| {
        let index = OPENING_ORDER[step];
        let is_gradual = index == MESH_SECTION && zstandard::IS_GRADUAL;
        let unpacked = if is_gradual { 0 } else { records[index].raw_length };
        let says = sum(&mut OPENING_ORDER[..=step].iter().map(|&i| records[i].raw_length));
        stored_from(step).saturating_add(unpacked).saturating_add(says)
    };
    (0..OPENING_ORDER.len()).map(step).max().unwrap_or(0).max(stored_from(0).saturating_mul(2))
}

/// That what is stored is as it was written.
fn check_stored(path: &Path, section: &str, record: &SectionRecord, stored: &[u8]) -> Result<()> {
    if xxh3_64(stored) == record.checksum {
        return Ok(());
    }
    Err(damaged(path, format!("its {section} section has a wrong checksum; copy or bake it anew")))
}

fn unpack_section(
    path: &Path,
    section: &'static str,
    record: &SectionRecord,
    stored: &[u8],
) -> Result<Vec<u8>> {
    check_stored(path, section, record, stored)?;
    let unpacked = zstandard::unpack_exactly(stored, record.raw_length, MAX_WINDOW_LOG);
    unpacked.ok_or_else(|| packing_error(path, section, record))
}

/// The fewest ranges that hold all given ones, where those at most [`SECTION_GAP`] apart are joined.
fn merged(mut ranges: Vec<Range<u64>>) -> Vec<Range<u64>> {
    ranges.sort_by_key(|range| range.start);
    let mut joined: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if range.start <= last.end.saturating_add(SECTION_GAP) => {
                last.end = last.end.max(range.end);
            }
            _ => joined.push(range),
        }
    }
    joined
}

fn packing_error(path: &Path, section: &'static str, record: &SectionRecord) -> Error {
    damaged(path, format!("its {section} section does not unpack to {} bytes", record.raw_length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BytesSource;

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
            hard_edges: Some(60.0),
        };
        let bytes = slot.encode();
        assert_eq!(Slot::decode(&bytes), Some(slot));
        for bit in 0..8 * SLOT_BYTES {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Slot::decode(&damaged), None, "bit {bit}");
        }
    }

    #[test]
    fn near_ranges_are_joined_and_far_ones_are_not() {
        let far = SECTION_GAP + 100;
        assert_eq!(merged(vec![20..30, 0..10, 30..40, 25..26]), vec![0..40]);
        assert_eq!(merged(vec![40 + far..50 + far, 0..40, 60..60]), vec![0..60, 40 + far..50 + far]);
    }

    #[test]
    fn sections_count_together() {
        let record = |index: u64| SectionRecord {
            offset: HEADER_BYTES + 100 * index,
            stored_length: 100,
            raw_length: 1000,
            checksum: 0,
        };
        let slot =
            Slot { sections: [0, 1, 2, 3].map(record), file_length: HEADER_BYTES + 400, ..Slot::new(1) };
        let source = BytesSource::new("a.fan", vec![0; slot.file_length as usize]);
        let read = |memory_bytes| {
            let options = input::ReadOptions { memory_bytes, ..input::ReadOptions::default() };
            input::ReadLimits::new(options).run(|| Sections::read(&source, &slot).map(drop))
        };
        // The last one as stored and unpacked, and what all say.
        assert!(read(100 + 1000 + 4000).is_ok());
        let error = read(100 + 1000 + 3999).unwrap_err();
        assert_eq!(error.kind(), fantex_base::ErrorKind::TooLarge, "{error}");
    }

    #[test]
    fn a_large_mesh_counts_once_beside_what_is_stored() {
        let record = |raw_length| SectionRecord { offset: 0, stored_length: 100, raw_length, checksum: 0 };
        let records = [10, 500, 10_000, 10].map(record);
        assert_eq!(opening_bytes(&records), 10_000 + 10 + 2 * 500 + 200);
        let records = [10, 10, 10_000, 10].map(record);
        assert_eq!(opening_bytes(&records), 10_000 + 10 + 300);
    }
}
