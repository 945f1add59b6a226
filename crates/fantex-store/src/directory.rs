//! The directory: where the clusters lie, and the mean of every group and channel.
//!
//! It lists clusters, not pages. The clusters of a level hold its pages in order (groups ascending, pages of a tile row by
//! row), and how many bytes a page takes follows from cover and channels. So a million tiles of five levels need some ten
//! thousand entries, and finding a page is a binary search.
//!
//! Below it the list of attachments: named blobs that travel with the asset (layers, history) and that readers of texels skip.

use std::collections::BTreeMap;
use std::ops::Range;

use fantex_base::{Error, Result, zstandard};
use fantex_cover::Cover;
use half::f16;

use crate::bytes::{ByteReader, ByteWriter};
use crate::error::{ends, misplaced, out_of_order, too_many, wrong_cluster_length, wrong_count};
use crate::header::SectionRecord;
use crate::layout::{PageSize, TilePlace};
use crate::limits::{MAX_ATTACHMENT_BYTES, MAX_ATTACHMENT_NAME_BYTES, MAX_ATTACHMENTS, MAX_CLUSTER_BYTES};
use crate::{TexelFormat, cover_level_count};

/// Clusters start at multiples of this, so that direct I/O can read them.
pub(crate) const ALIGNMENT: u64 = 4096;

const ENTRY_BYTES: usize = 32;

/// Where a cluster lies and which page it starts with. It ends before the next one's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ClusterEntry {
    pub(crate) first: TilePlace,
    pub(crate) offset: u64,
    pub(crate) stored_length: u32,
    pub(crate) raw_length: u32,
    /// xxh3-64 of the stored bytes.
    pub(crate) checksum: u64,
}

impl ClusterEntry {
    pub(crate) fn range(&self) -> Range<u64> {
        self.offset..self.offset + u64::from(self.stored_length)
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Directory {
    /// Per level, in page order.
    pub(crate) levels: Vec<Vec<ClusterEntry>>,
    /// Linear RGBA, `means[group * channels + channel]`.
    pub(crate) means: Means,
}

impl Directory {
    /// Index of the cluster that holds an existing page of a level.
    pub(crate) fn cluster_of(&self, level: u32, place: TilePlace) -> usize {
        let clusters = &self.levels[level as usize];
        clusters.partition_point(|cluster| cluster.first <= place).saturating_sub(1)
    }
}

/// Means of all groups and channels, group after group: half floats, or floats for float channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Means {
    bytes: Vec<u8>,
    /// Offset of each channel's mean within a group's, and whether it is of half floats.
    channels: Vec<(usize, bool)>,
    group_bytes: usize,
}

impl Means {
    fn layout(formats: &[TexelFormat]) -> Self {
        let mut means = Self::default();
        for &format in formats {
            let is_half = format != TexelFormat::Rgba32F;
            means.channels.push((means.group_bytes, is_half));
            means.group_bytes += if is_half { 8 } else { 16 };
        }
        means
    }

    /// From `values[group * channels + channel]`. Values beyond the half floats' range are clamped to it, NaN becomes 0.
    pub(crate) fn new(values: &[[f32; 4]], formats: &[TexelFormat]) -> Self {
        let mut means = Self::layout(formats);
        for (i, &value) in values.iter().enumerate() {
            let (_, is_half) = means.channels[i % formats.len()];
            means.bytes.extend(encoded_mean(value, is_half));
        }
        means
    }

    /// Replaces one mean, with the same rounding as [`new`](Self::new).
    pub(crate) fn set(&mut self, channel: usize, group: u32, value: [f32; 4]) {
        let (offset, is_half) = self.channels[channel];
        let at = group as usize * self.group_bytes + offset;
        for (byte, new) in self.bytes[at..].iter_mut().zip(encoded_mean(value, is_half)) {
            *byte = new;
        }
    }

    pub(crate) fn get(&self, channel: usize, group: u32) -> [f32; 4] {
        let (offset, is_half) = self.channels[channel];
        let bytes = &self.bytes[group as usize * self.group_bytes + offset..];
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        std::array::from_fn(|k| {
            finite(if is_half {
                f16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]).to_f32()
            } else {
                f32::from_le_bytes([bytes[4 * k], bytes[4 * k + 1], bytes[4 * k + 2], bytes[4 * k + 3]])
            })
        })
    }
}

/// A mean as it is stored: values beyond the half floats' range are clamped to it, NaN becomes 0.
fn encoded_mean(value: [f32; 4], is_half: bool) -> impl Iterator<Item = u8> {
    let limit = if is_half { f32::from(f16::MAX) } else { f32::MAX };
    let bounded = value.map(|x| if x.is_nan() { 0.0 } else { x.clamp(-limit, limit) });
    let length = if is_half { 2 } else { 4 };
    bounded.into_iter().flat_map(move |x| {
        let [a, b] = f16::from_f32(x).to_le_bytes();
        let bytes = if is_half { [a, b, 0, 0] } else { x.to_le_bytes() };
        bytes.into_iter().take(length)
    })
}

pub(crate) fn encoded_length(clusters_per_level: &[usize], groups: usize, formats: &[TexelFormat]) -> usize {
    let clusters: usize = clusters_per_level.iter().sum();
    8 + 4 * clusters_per_level.len() + ENTRY_BYTES * clusters + groups * Means::layout(formats).group_bytes
}

pub(crate) fn encode(directory: &Directory) -> Vec<u8> {
    let mut out = ByteWriter::default();
    out.u32(directory.levels.len() as u32);
    out.u32(0);
    directory.levels.iter().for_each(|clusters| out.u32(clusters.len() as u32));
    for cluster in directory.levels.iter().flatten() {
        out.u32(cluster.first.group);
        out.u32(cluster.first.page);
        out.u64(cluster.offset);
        out.u32(cluster.stored_length);
        out.u32(cluster.raw_length);
        out.u64(cluster.checksum);
    }
    out.put(&directory.means.bytes);
    out.bytes
}

pub(crate) struct Expected<'a> {
    pub(crate) cover: &'a Cover,
    pub(crate) formats: &'a [TexelFormat],
    /// Where clusters may lie.
    pub(crate) places: Range<u64>,
}

pub(crate) fn decode(bytes: &[u8], expected: &Expected<'_>) -> Result<Directory> {
    let mut input = ByteReader::new(bytes);
    let levels = input.u32("the directory's levels")?;
    input.u32("the directory's levels")?;
    let expected_levels = cover_level_count(expected.cover);
    if levels != expected_levels {
        return Err(wrong_count("levels in the directory", u64::from(expected_levels), u64::from(levels)));
    }
    let counts = (0..levels)
        .map(|_| input.count(bytes.len() / ENTRY_BYTES, "clusters"))
        .collect::<Result<Vec<_>, _>>()?;
    let mut directory = Directory { levels: Vec::new(), means: Means::layout(expected.formats) };
    for &count in &counts {
        let what = "the directory's clusters";
        let bytes = input.take(count * ENTRY_BYTES, what)?;
        let mut entries = ByteReader::new(&bytes);
        let mut clusters = Vec::with_capacity(count);
        for _ in 0..count {
            clusters.push(ClusterEntry {
                first: TilePlace { group: entries.u32(what)?, page: entries.u32(what)? },
                offset: entries.u64(what)?,
                stored_length: entries.u32(what)?,
                raw_length: entries.u32(what)?,
                checksum: entries.u64(what)?,
            });
        }
        directory.levels.push(clusters);
    }
    let mean_bytes = expected.cover.groups.len().checked_mul(directory.means.group_bytes);
    let mean_bytes = mean_bytes.ok_or(ends("the means", bytes.len()))?;
    directory.means.bytes = input.take(mean_bytes, "the means")?.into_owned();
    input.end()?;
    check_places(&directory, expected)?;
    for (level, clusters) in directory.levels.iter().enumerate() {
        check_lengths(level as u32, clusters, expected)?;
    }
    Ok(directory)
}

/// Clusters lie aligned within the file's cluster area. (They may overlap: whatever they hold is checksummed.)
fn check_places(directory: &Directory, expected: &Expected<'_>) -> Result<()> {
    let Range { start: first, end: last } = expected.places;
    for (cluster, entry) in directory.levels.iter().flatten().enumerate() {
        let offset = entry.offset;
        let end = offset.saturating_add(u64::from(entry.stored_length));
        if offset < first || end > last || !offset.is_multiple_of(ALIGNMENT) {
            return Err(misplaced("cluster", cluster, offset..end, &expected.places));
        }
        // More would not be one frame of so many bytes.
        let limit = zstandard::packed_bound(entry.raw_length as usize) as u64;
        if u64::from(entry.stored_length) > limit {
            let got = u64::from(entry.stored_length);
            let expected = u64::from(entry.raw_length);
            return Err(wrong_cluster_length(cluster, expected, got, limit));
        }
    }
    Ok(())
}

/// The clusters of a level hold all its pages, each once, in order, and record their lengths rightly.
fn check_lengths(level: u32, clusters: &[ClusterEntry], expected: &Expected<'_>) -> Result<()> {
    let block_bytes: u64 = expected.formats.iter().map(|f| f.block_bytes() as u64).sum();
    let mut open: Option<(usize, u64)> = None;
    let mut next = clusters.iter().enumerate().peekable();
    let close = |open: Option<(usize, u64)>| match open {
        Some((cluster, got)) if u64::from(clusters[cluster].raw_length) != got => {
            let recorded = u64::from(clusters[cluster].raw_length);
            Err(wrong_cluster_length(cluster, got, recorded, MAX_CLUSTER_BYTES))
        }
        _ => Ok(()),
    };
    for (group, tile) in expected.cover.groups.iter().enumerate() {
        let size = PageSize::new(tile.extent, level);
        let mut from = 0;
        while let Some((cluster, entry)) = next.next_if(|(_, c)| c.first.group as usize == group) {
            let page = entry.first.page;
            if page >= size.page_count() || (from > 0 && page == 0) {
                return Err(out_of_order("cluster", cluster));
            }
            let at = size.blocks_before(page);
            if at < from {
                return Err(out_of_order("cluster", cluster));
            }
            add(&mut open, (at - from) * block_bytes, clusters)?;
            close(open)?;
            open = Some((cluster, 0));
            from = at;
        }
        add(&mut open, (size.blocks() - from) * block_bytes, clusters)?;
    }
    match next.next() {
        Some((index, _)) => Err(out_of_order("cluster", index)),
        None => close(open),
    }
}

/// Counts bytes of pages to the open cluster. There is one, unless there are no bytes.
fn add(open: &mut Option<(usize, u64)>, bytes: u64, clusters: &[ClusterEntry]) -> Result<()> {
    match open {
        _ if bytes == 0 => Ok(()),
        None => Err(out_of_order("cluster", 0)),
        Some((cluster, sum)) => {
            *sum += bytes;
            if *sum > MAX_CLUSTER_BYTES {
                let got = u64::from(clusters[*cluster].raw_length);
                return Err(wrong_cluster_length(*cluster, *sum, got, MAX_CLUSTER_BYTES));
            }
            Ok(())
        }
    }
}

/// Bytes of an entry with an empty name.
const MIN_ENTRY_BYTES: usize = 36;

/// Where every attachment lies, by name.
pub(crate) type Attachments = BTreeMap<String, SectionRecord>;

pub(crate) fn encode_attachments(attachments: &Attachments) -> Vec<u8> {
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
pub(crate) fn decode_attachments(bytes: &[u8], places: &Range<u64>) -> Result<Attachments> {
    let mut input = ByteReader::new(bytes);
    let count = input.count((bytes.len() / MIN_ENTRY_BYTES).min(MAX_ATTACHMENTS), "attachments")?;
    let mut attachments = Attachments::new();
    for index in 0..count {
        let what = "the name of an attachment";
        let length = input.count(MAX_ATTACHMENT_NAME_BYTES, what)?;
        let name = input.take(length, what)?;
        let name = std::str::from_utf8(&name)
            .map_err(|_| Error::malformed(format!("the name of attachment {index} is not UTF-8")))?
            .to_owned();
        let what = "an attachment's place";
        let record = SectionRecord {
            offset: input.u64(what)?,
            stored_length: input.u64(what)?,
            raw_length: input.u64(what)?,
            checksum: input.u64(what)?,
        };
        check_place(index, &record, places)?;
        if attachments.last_key_value().is_some_and(|(last, _)| *last >= name) {
            return Err(out_of_order("attachment", index));
        }
        attachments.insert(name, record);
    }
    input.end()?;
    Ok(attachments)
}

fn check_place(index: usize, record: &SectionRecord, places: &Range<u64>) -> Result<()> {
    let (offset, end) = (record.offset, record.range().end);
    if offset < places.start || end > places.end || !offset.is_multiple_of(ALIGNMENT) {
        return Err(misplaced("attachment", index, offset..end, places));
    }
    if record.raw_length > MAX_ATTACHMENT_BYTES {
        let (count, limit) = (record.raw_length, MAX_ATTACHMENT_BYTES);
        return Err(too_many("bytes of an attachment", count, limit));
    }
    // More would not be one frame of so many bytes, and a copy of the asset reads them at once.
    let limit = zstandard::packed_bound(record.raw_length as usize) as u64;
    if record.stored_length > limit {
        return Err(too_many("packed bytes of an attachment", record.stored_length, limit));
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
        let bytes = encode_attachments(&list);
        let places = 8192..20000;
        assert_eq!(decode_attachments(&bytes, &places).unwrap(), list);
        for end in 0..bytes.len() {
            assert!(decode_attachments(&bytes[..end], &places).is_err());
        }
        assert!(decode_attachments(&bytes, &(8192..12290)).is_err(), "beyond the file");
        assert!(
            decode_attachments(&encode_attachments(&[("a".into(), record(8200))].into()), &places).is_err(),
            "not aligned"
        );
        let mut twice = bytes.clone();
        twice[0] = 1;
        assert!(decode_attachments(&twice, &places).is_err(), "trailing bytes");
        assert!(decode_attachments(&[0xff; 64], &places).is_err(), "a huge count");
        let long = SectionRecord { stored_length: 1 << 40, ..record(8192) };
        let long = decode_attachments(&encode_attachments(&[("a".into(), long)].into()), &(8192..u64::MAX));
        let error = long.unwrap_err().to_string();
        assert!(error.contains("packed bytes of an attachment"), "{error}");
    }
}
