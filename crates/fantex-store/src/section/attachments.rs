//! The list of attachments: named blobs that travel with the asset (layers, history) and that readers of texels skip.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::ContentError;
use crate::bytes::{ByteReader, ByteWriter};
use crate::header::SectionRecord;
use crate::limits::{MAX_ATTACHMENT_BYTES, MAX_ATTACHMENT_NAME_BYTES, MAX_ATTACHMENTS};
use crate::section::directory::ALIGNMENT;

/// Bytes of an entry with an empty name.
const LEAST_ENTRY_BYTES: usize = 36;

/// Where every attachment lies, by name.
pub(crate) type Attachments = BTreeMap<String, SectionRecord>;

/// Bytes of the encoded list.
pub(crate) fn encode(attachments: &Attachments) -> Vec<u8> {
    let mut out = ByteWriter::default();
    out.u32(attachments.len() as u32);
    for (name, record) in attachments {
        let SectionRecord { offset, stored_length, raw_length, checksum } = *record;
        out.u32(name.len() as u32);
        out.put(name.as_bytes());
        [offset, stored_length, raw_length, checksum].into_iter().for_each(|x| out.u64(x));
    }
    out.bytes
}

/// `places`: where attachments may lie.
pub(crate) fn decode(bytes: &[u8], places: &Range<u64>) -> Result<Attachments, ContentError> {
    let mut input = ByteReader::new(bytes);
    let count = input.count((bytes.len() / LEAST_ENTRY_BYTES).min(MAX_ATTACHMENTS), "attachments")?;
    let mut attachments = Attachments::new();
    for index in 0..count {
        let what = "the name of an attachment";
        let length = input.count(MAX_ATTACHMENT_NAME_BYTES, what)?;
        let name = std::str::from_utf8(input.take(length, what)?);
        let name = name.map_err(|_| ContentError::Order { what: "name of attachment", index })?.to_owned();
        let what = "an attachment's place";
        let record = SectionRecord {
            offset: input.u64(what)?,
            stored_length: input.u64(what)?,
            raw_length: input.u64(what)?,
            checksum: input.u64(what)?,
        };
        check_place(index, &record, places)?;
        if attachments.last_key_value().is_some_and(|(last, _)| *last >= name) {
            return Err(ContentError::Order { what: "attachment", index });
        }
        attachments.insert(name, record);
    }
    input.end()?;
    Ok(attachments)
}

fn check_place(index: usize, record: &SectionRecord, places: &Range<u64>) -> Result<(), ContentError> {
    let (offset, end) = (record.offset, record.range().end);
    if offset < places.start || end > places.end || !offset.is_multiple_of(ALIGNMENT) {
        let (first, last) = (places.start, places.end);
        return Err(ContentError::ClusterPlace { cluster: index, offset, end, first, last });
    }
    if record.raw_length > MAX_ATTACHMENT_BYTES {
        let (count, limit) = (record.raw_length, MAX_ATTACHMENT_BYTES);
        return Err(ContentError::TooMany { what: "bytes of an attachment", count, limit });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(offset: u64) -> SectionRecord {
        SectionRecord { offset, stored_length: 10, raw_length: 20, checksum: 7 }
    }

    #[test]
    fn a_list_comes_back_and_wrong_ones_are_refused() {
        let list = Attachments::from([("a".into(), record(8192)), ("b/ü".into(), record(12288))]);
        let bytes = encode(&list);
        let places = 8192..20000;
        assert_eq!(decode(&bytes, &places).unwrap(), list);
        for end in 0..bytes.len() {
            assert!(decode(&bytes[..end], &places).is_err());
        }
        assert!(decode(&bytes, &(8192..12290)).is_err(), "beyond the file");
        assert!(decode(&encode(&[("a".into(), record(8200))].into()), &places).is_err(), "not aligned");
        let mut twice = bytes.clone();
        twice[0] = 1;
        assert!(decode(&twice, &places).is_err(), "trailing bytes");
        assert!(decode(&[0xff; 64], &places).is_err(), "a huge count");
    }
}
