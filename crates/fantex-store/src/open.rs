//! Opening assets: header, then sections.
//!
//! ```text
//!  0      8192                                      4096-aligned
//!  slots | channels | cover | mesh | directory ... | cluster | cluster | ...
//!  `-1st-' `-------------- 2nd ------------'
//! ```
//!
//! Two reads, because a source far away takes its time for each. Sections that lie far from the others (as appended ones
//! do) are read by themselves.

use std::io::Read;
use std::ops::Range;
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;

use crate::header::{
    HEADER_BYTES, SECTION_NAMES, SIGNATURE, SLOT_BYTES, SLOT_OFFSETS, SectionRecord, Slot, VERSION,
};
use crate::limits::{MAX_SECTION_RATIO, MAX_WINDOW_LOG, SECTION_RATIO_FREE};
use crate::{ByteSource, OpenError};

/// Bytes between two sections that are read along rather than asked for apart.
const SECTION_GAP: u64 = 1 << 16;

/// The valid header slot with the greatest generation, and the number of damaged ones.
pub(crate) fn read_slot(source: &dyn ByteSource) -> Result<(Slot, u32), OpenError> {
    let path = source.location().to_owned();
    let mut header = [0; HEADER_BYTES as usize];
    let count = source.read_at(&mut header, 0).map_err(|error| io_error(source.location(), error))?;
    let mut slots = [[0; SLOT_BYTES]; 2];
    for (slot, offset) in slots.iter_mut().zip(SLOT_OFFSETS) {
        let range = offset as usize..offset as usize + SLOT_BYTES;
        if range.end <= count {
            slot.copy_from_slice(&header[range]);
        }
    }
    let valid = slots.iter().filter_map(Slot::decode);
    let damaged = 2 - valid.clone().count() as u32;
    let Some(slot) = valid.max_by_key(|slot| slot.generation) else {
        let has_signature = slots.iter().any(|slot| slot[..8] == SIGNATURE);
        return Err(if has_signature { OpenError::Header { path } } else { OpenError::NotAnAsset { path } });
    };
    if slot.version != VERSION || slot.flags != 0 {
        let (version, flags, supported) = (slot.version, slot.flags, VERSION);
        return Err(OpenError::Version { path, version, flags, supported });
    }
    let length = source.length().map_err(|error| io_error(source.location(), error))?;
    if length < slot.file_length {
        return Err(OpenError::Truncated { path, length, expected: slot.file_length });
    }
    Ok((slot, damaged))
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

/// The stored bytes of the sections.
pub(crate) struct Sections<'a> {
    path: &'a Path,
    records: [SectionRecord; 4],
    /// What was read, by place in the file.
    spans: Vec<(Range<u64>, Vec<u8>)>,
}

impl<'a> Sections<'a> {
    /// Checks the records and reads the sections' bytes. Memory grows with what is really there, not with what is claimed.
    pub(crate) fn read(source: &'a dyn ByteSource, slot: &Slot) -> Result<Self, OpenError> {
        let path = source.location();
        let mut ranges = Vec::new();
        for (record, section) in slot.sections.iter().zip(SECTION_NAMES) {
            check_record(path, section, record, slot.file_length)?;
            ranges.push(record.range());
        }
        let mut spans = Vec::new();
        for range in merged(ranges) {
            let mut bytes = vec![0; (range.end - range.start) as usize];
            source.read_exact_at(&mut bytes, range.start).map_err(|error| io_error(path, error))?;
            spans.push((range, bytes));
        }
        Ok(Self { path, records: slot.sections, spans })
    }

    /// Checks and unpacks a section.
    pub(crate) fn unpack(&self, index: usize) -> Result<Vec<u8>, OpenError> {
        let record = &self.records[index];
        unpack_section(self.path, SECTION_NAMES[index], record, self.stored(record))
    }

    fn stored(&self, record: &SectionRecord) -> &[u8] {
        let end = record.offset + record.stored_length;
        let holds = |range: &Range<u64>| range.start <= record.offset && end <= range.end;
        self.spans.iter().find(|(range, _)| holds(range)).map_or(&[], |(range, bytes)| {
            &bytes[(record.offset - range.start) as usize..(end - range.start) as usize]
        })
    }
}

/// Reads, checks and unpacks one section by itself.
pub(crate) fn read_section(
    source: &dyn ByteSource,
    section: &'static str,
    record: &SectionRecord,
    file_length: u64,
) -> Result<Vec<u8>, OpenError> {
    let path = source.location();
    check_record(path, section, record, file_length)?;
    let mut stored = vec![0; record.stored_length as usize];
    source.read_exact_at(&mut stored, record.offset).map_err(|error| io_error(path, error))?;
    unpack_section(path, section, record, &stored)
}

/// That a section lies in the file and does not claim too much memory.
fn check_record(
    path: &Path,
    section: &'static str,
    record: &SectionRecord,
    file_length: u64,
) -> Result<(), OpenError> {
    let SectionRecord { offset, stored_length, raw_length, .. } = *record;
    let end = record.range().end;
    if offset < HEADER_BYTES || end > file_length {
        return Err(OpenError::SectionPlace { path: path.to_owned(), section, offset, end });
    }
    if raw_length > SECTION_RATIO_FREE.saturating_add(stored_length.saturating_mul(MAX_SECTION_RATIO)) {
        return Err(packing_error(path, section, record));
    }
    Ok(())
}

fn unpack_section(
    path: &Path,
    section: &'static str,
    record: &SectionRecord,
    stored: &[u8],
) -> Result<Vec<u8>, OpenError> {
    if xxh3_64(stored) != record.checksum {
        return Err(OpenError::SectionChecksum { path: path.to_owned(), section });
    }
    let unpacked = zstd::Decoder::new(stored).and_then(|mut decoder| {
        decoder.window_log_max(MAX_WINDOW_LOG)?;
        let mut raw = Vec::new();
        decoder.take(record.raw_length + 1).read_to_end(&mut raw)?;
        Ok(raw)
    });
    match unpacked {
        Ok(raw) if raw.len() as u64 == record.raw_length => Ok(raw),
        _ => Err(packing_error(path, section, record)),
    }
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

fn packing_error(path: &Path, section: &'static str, record: &SectionRecord) -> OpenError {
    OpenError::SectionPacking { path: path.to_owned(), section, expected: record.raw_length }
}

pub(crate) fn io_error(path: &Path, source: std::io::Error) -> OpenError {
    OpenError::Io { path: path.to_owned(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_ranges_are_joined_and_far_ones_are_not() {
        let far = SECTION_GAP + 100;
        assert_eq!(merged(vec![20..30, 0..10, 30..40, 25..26]), vec![0..40]);
        assert_eq!(merged(vec![40 + far..50 + far, 0..40, 60..60]), vec![0..60, 40 + far..50 + far]);
    }
}
