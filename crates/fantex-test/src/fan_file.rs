//! `.fan` files whose checksums are right although they were changed (docs/format.md).

use xxhash_rust::xxh3::xxh3_64;

/// A number at a place.
pub fn word(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Changes a number at a place.
pub fn set_word(bytes: &mut [u8], at: usize, value: u64) {
    bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
}

/// Makes the checksums of both header slots right.
pub fn seal(bytes: &mut [u8]) {
    for slot in [0, 4096] {
        let checksum = xxh3_64(&bytes[slot..slot + 248]);
        set_word(bytes, slot + 248, checksum);
    }
}

/// Where the header slot starts that counts: the one with the greater generation.
fn slot_of(bytes: &[u8]) -> usize {
    if word(bytes, 4096 + 16) > word(bytes, 16) { 4096 } else { 0 }
}

/// A section's bytes, unpacked. Sections: 0 channels, 1 cover, 2 mesh, 3 directory, 4 the list of attachments.
pub fn section(bytes: &[u8], index: usize) -> Vec<u8> {
    let record = slot_of(bytes) + 32 + 32 * index;
    unpacked(bytes, word(bytes, record) as usize, word(bytes, record + 8) as usize)
}

/// The file with another section, appended at its end, and all checksums right.
pub fn with_section(bytes: &[u8], index: usize, raw: &[u8]) -> Vec<u8> {
    let mut changed = bytes.to_vec();
    let slot = slot_of(bytes);
    changed.copy_within(slot..slot + 256, 4096 - slot);
    let stored = zstd::encode_all(raw, 1).unwrap();
    let offset = changed.len() as u64;
    changed.extend_from_slice(&stored);
    let file_length = changed.len() as u64;
    for slot in [0, 4096] {
        set_word(&mut changed, slot + 24, file_length);
        let record = [offset, stored.len() as u64, raw.len() as u64, xxh3_64(&stored)];
        for (k, value) in record.into_iter().enumerate() {
            set_word(&mut changed, slot + 32 + 32 * index + 8 * k, value);
        }
    }
    seal(&mut changed);
    changed
}

/// A part of a bake with right checksums, and the place of its items by its length, whatever was changed in it; as far as its items can be followed.
pub fn sealed_part(bytes: &[u8]) -> Vec<u8> {
    const HEADER: usize = 4096;
    const ITEM: usize = 32;
    const PACKED: u32 = 1;
    let mut sealed = bytes.to_vec();
    let Some(end) = sealed.len().checked_sub(8).filter(|end| *end >= HEADER) else { return sealed };
    let [items, means] = [40, 48].map(|at| usize::try_from(word(bytes, at)).unwrap_or(usize::MAX));
    let listed = items.saturating_mul(ITEM).saturating_add(means.saturating_mul(16));
    let directory = end.checked_sub(listed).filter(|directory| *directory >= HEADER);
    if let Some(directory) = directory {
        set_word(&mut sealed, 56, directory as u64);
        let number = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let mut at = HEADER;
        // Clusters, then heads and tails.
        for are_packed in [true, false] {
            for item in (0..items).map(|item| directory + item * ITEM) {
                if (number(bytes, item) == PACKED) != are_packed {
                    continue;
                }
                let stored = number(bytes, item + 20) as usize;
                if let Some(content) = bytes.get(at..at + stored) {
                    set_word(&mut sealed, item + 24, xxh3_64(content));
                }
                at += if are_packed { stored.next_multiple_of(4096) } else { stored };
            }
        }
        let checksum = xxh3_64(&sealed[directory..end]);
        set_word(&mut sealed, end, checksum);
    }
    let checksum = xxh3_64(&sealed[..HEADER - 8]);
    set_word(&mut sealed, HEADER - 8, checksum);
    sealed
}

fn unpacked(bytes: &[u8], offset: usize, length: usize) -> Vec<u8> {
    zstd::decode_all(&bytes[offset..offset + length]).unwrap()
}

/// The file with a change in one of the places that have checksums, all of which are right again: what an attacker would make.
/// `choose` gives a number below another one; `change` makes others of some bytes.
pub fn crafted(
    bytes: &[u8],
    choose: &mut dyn FnMut(u64) -> u64,
    change: impl Fn(&[u8]) -> Vec<u8>,
) -> Vec<u8> {
    let part = choose(7) as usize;
    if part < 5 {
        return with_section(bytes, part, &change(&section(bytes, part)));
    }
    let number = |bytes: &[u8], at: usize| word(bytes, at) as u32 as usize;
    let mut changed = bytes.to_vec();
    changed.resize(bytes.len().next_multiple_of(4096), 0);
    let place = changed.len() as u64;
    if part == 5 {
        let mut directory = section(bytes, 3);
        let levels = number(&directory, 0);
        let clusters: usize = (0..levels).map(|level| number(&directory, 8 + 4 * level)).sum();
        let entry = 8 + 4 * levels + 32 * choose(clusters as u64) as usize;
        let (at, length) = (word(&directory, entry + 8) as usize, number(&directory, entry + 16));
        let raw = change(&unpacked(bytes, at, length));
        let stored = zstd::encode_all(&raw[..], 1).unwrap();
        set_word(&mut directory, entry + 8, place);
        set_word(&mut directory, entry + 16, stored.len() as u64 | (raw.len() as u64) << 32);
        set_word(&mut directory, entry + 24, xxh3_64(&stored));
        changed.extend(stored);
        return with_section(&changed, 3, &directory);
    }
    let mut list = section(bytes, 4);
    let mut records = Vec::new();
    let mut at = 4;
    for _ in 0..number(&list, 0) {
        at += 4 + u32::from_le_bytes(list[at..at + 4].try_into().unwrap()) as usize;
        records.push(at);
        at += 32;
    }
    let record = records[choose(records.len() as u64) as usize];
    let (at, length) = (word(&list, record) as usize, word(&list, record + 8) as usize);
    let raw = change(&unpacked(bytes, at, length));
    let stored = zstd::encode_all(&raw[..], 1).unwrap();
    for (k, value) in [place, stored.len() as u64, raw.len() as u64, xxh3_64(&stored)].into_iter().enumerate()
    {
        set_word(&mut list, record + 8 * k, value);
    }
    changed.extend(stored);
    with_section(&changed, 4, &list)
}
