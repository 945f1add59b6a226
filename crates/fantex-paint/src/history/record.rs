//! The records of a step, little-endian:
//!
//! | record | fields |
//! |---|---|
//! | page | u32 0; u32 group, level, column, row, channel, length; bytes before xor bytes after |
//! | attachment | u32 2; u32 lengths of name, contents before, contents after; these (of length 0: none) |
//! | mean | u32 1; u32 group, channel; f32[4] before; f32[4] after |
//! | base | u32 3; u32 group, column, row: of a page of level 0, which is put aside as the base of the layers |

use fantex_store::PageId;

/// One change.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Record {
    Page { id: PageId, channel: usize, change: Vec<u8> },
    Mean { channel: usize, group: u32, values: [[f32; 4]; 2] },
    Attachment { name: String, contents: [Vec<u8>; 2] },
    Base(PageId),
}

const PAGE: u32 = 0;
const MEAN: u32 = 1;
const ATTACHMENT: u32 = 2;
const BASE: u32 = 3;

impl Record {
    pub(super) fn encode(&self, out: &mut Vec<u8>) {
        match self {
            Self::Page { id, channel, change } => {
                let [column, row] = id.page;
                let words = [PAGE, id.group, id.level, column, row, *channel as u32, change.len() as u32];
                out.extend(words.into_iter().flat_map(u32::to_le_bytes));
                out.extend(change);
            }
            Self::Mean { channel, group, values } => {
                out.extend([MEAN, *group, *channel as u32].into_iter().flat_map(u32::to_le_bytes));
                out.extend(values.iter().flatten().flat_map(|x| x.to_le_bytes()));
            }
            Self::Attachment { name, contents: [before, after] } => {
                let lengths = [name.len(), before.len(), after.len()].map(|n| n as u32);
                out.extend([ATTACHMENT].into_iter().chain(lengths).flat_map(u32::to_le_bytes));
                [name.as_bytes(), before, after].into_iter().for_each(|part| out.extend(part));
            }
            Self::Base(PageId { group, page: [column, row], .. }) => {
                out.extend([BASE, *group, *column, *row].into_iter().flat_map(u32::to_le_bytes));
            }
        }
    }

    /// The next record; none where the bytes are none.
    pub(super) fn decode(rest: &mut &[u8]) -> Option<Self> {
        match word(rest)? {
            PAGE => {
                let [group, level, column, row, channel, length] = words(rest)?;
                let change = rest.split_off(..length as usize)?.to_vec();
                let id = PageId { group, level, page: [column, row] };
                Some(Self::Page { id, channel: channel as usize, change })
            }
            MEAN => {
                let [group, channel] = words(rest)?;
                let values = [words::<4>(rest)?, words::<4>(rest)?].map(|v| v.map(f32::from_bits));
                Some(Self::Mean { channel: channel as usize, group, values })
            }
            ATTACHMENT => {
                let [name, before, after] = words(rest)?;
                let name = std::str::from_utf8(rest.split_off(..name as usize)?).ok()?.to_owned();
                let before = rest.split_off(..before as usize)?.to_vec();
                let after = rest.split_off(..after as usize)?.to_vec();
                Some(Self::Attachment { name, contents: [before, after] })
            }
            BASE => {
                let [group, column, row] = words(rest)?;
                Some(Self::Base(PageId { group, level: 0, page: [column, row] }))
            }
            _ => None,
        }
    }
}

fn word(rest: &mut &[u8]) -> Option<u32> {
    let bytes = rest.split_off(..4)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

fn words<const N: usize>(rest: &mut &[u8]) -> Option<[u32; N]> {
    let mut words = [0; N];
    for slot in &mut words {
        *slot = word(rest)?;
    }
    Some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_and_short_ones_are_refused() {
        let id = PageId { group: 7, level: 2, page: [1, 3] };
        let records = [
            Record::Page { id, channel: 1, change: vec![1, 2, 3] },
            Record::Mean { channel: 0, group: 9, values: [[0.5; 4], [1.5; 4]] },
            Record::Attachment { name: "a/b".into(), contents: [vec![], vec![4, 5]] },
            Record::Base(PageId { level: 0, ..id }),
        ];
        let mut bytes = Vec::new();
        records.iter().for_each(|record| record.encode(&mut bytes));
        let mut rest = bytes.as_slice();
        assert_eq!(Record::decode(&mut rest).as_ref(), Some(&records[0]));
        assert_eq!(Record::decode(&mut rest).as_ref(), Some(&records[1]));
        assert_eq!(Record::decode(&mut rest).as_ref(), Some(&records[2]));
        assert_eq!(Record::decode(&mut rest).as_ref(), Some(&records[3]));
        assert!(rest.is_empty());
        for end in 1..30 {
            assert_eq!(Record::decode(&mut &bytes[..end]), None);
        }
    }
}
