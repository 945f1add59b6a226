//! Clusters: the pieces in which pages are stored, for those that read them by themselves.
//!
//! A loader asks which cluster holds a page ([`Asset::cluster_of`]) and where it lies ([`Asset::cluster_range`]), reads those
//! bytes in whichever way it likes, and has them checked and unpacked ([`Asset::unpack_cluster`]); then all pages of the
//! cluster are at hand ([`Asset::page_in`]).

use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

use xxhash_rust::xxh3::xxh3_64;
use zstd::zstd_safe::CParameter;

use crate::layout::{ClusterPages, PageSize, TilePlace};
use crate::section::directory::ClusterEntry;
use crate::{Asset, PageError, PageId, TexelFormat, packing};

/// A cluster: a run of pages of one level that are packed and checksummed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ClusterId {
    /// Detail level.
    pub level: u32,
    /// Number within the level, in page order.
    pub index: u32,
}

impl Asset {
    /// All clusters, level by level.
    pub fn clusters(&self) -> impl Iterator<Item = ClusterId> + '_ {
        (0..self.level_count()).flat_map(|level| {
            let count = self.directory.levels[level as usize].len() as u32;
            (0..count).map(move |index| ClusterId { level, index })
        })
    }

    /// The byte ranges of a level's clusters in the file, in page order. Empty beyond the last level.
    pub fn cluster_ranges(&self, level: u32) -> Vec<Range<u64>> {
        let clusters = self.directory.levels.get(level as usize).map_or(&[][..], Vec::as_slice);
        clusters.iter().map(ClusterEntry::range).collect()
    }

    /// The cluster that holds a page.
    pub fn cluster_of(&self, id: PageId) -> Result<ClusterId, PageError> {
        let missing = || self.no_such_page(0, id);
        let clusters = self.directory.levels.get(id.level as usize).ok_or_else(missing)?;
        let group = self.cover().groups.get(id.group as usize).ok_or_else(missing)?;
        let number = PageSize::new(group.extent, id.level).number(id.page).ok_or_else(missing)?;
        let place = TilePlace { group: id.group, page: number };
        let index = clusters.partition_point(|cluster| cluster.first <= place).checked_sub(1);
        Ok(ClusterId { level: id.level, index: index.ok_or_else(missing)? as u32 })
    }

    /// Where a cluster's stored bytes lie in the file; the start is a multiple of 4096. Panics where there is no such
    /// cluster.
    pub fn cluster_range(&self, cluster: ClusterId) -> Range<u64> {
        self.entry(cluster).range()
    }

    /// The first page of a cluster. Panics where there is no such cluster.
    pub fn first_page_of(&self, cluster: ClusterId) -> PageId {
        let TilePlace { group, page } = self.entry(cluster).first;
        let size = PageSize::new(self.cover().groups[group as usize].extent, cluster.level);
        PageId { group, level: cluster.level, page: size.page(page) }
    }

    /// Bytes of a cluster's pages in all channels: how long it is unpacked. Panics where there is no such cluster.
    pub fn cluster_page_bytes(&self, cluster: ClusterId) -> usize {
        self.entry(cluster).raw_length as usize
    }

    /// Checks and unpacks the stored bytes of a cluster: those of [`Asset::cluster_range`], wherever they were read. Panics
    /// where there is no such cluster.
    pub fn unpack_cluster(&self, cluster: ClusterId, stored: &[u8]) -> Result<ClusterPages, PageError> {
        self.unpack_entry(cluster.level, self.entry(cluster), stored)
    }

    fn unpack_entry(
        &self,
        level: u32,
        entry: &ClusterEntry,
        stored: &[u8],
    ) -> Result<ClusterPages, PageError> {
        if stored.len() != entry.stored_length as usize || xxh3_64(stored) != entry.checksum {
            return Err(PageError::Checksum { path: self.path().to_owned(), offset: entry.offset });
        }
        let packing_error = || PageError::Packing {
            path: self.path().to_owned(),
            offset: entry.offset,
            expected: u64::from(entry.raw_length),
        };
        let natural = UNPACKER
            .with_borrow_mut(|unpacker| unpacker.unpack(&self.formats, stored, entry.raw_length as usize))
            .ok_or_else(packing_error)?;
        let extents = |group: usize| self.cover().groups[group].extent;
        Ok(ClusterPages::new(natural, level, entry, &self.formats, extents))
    }

    /// A page's bytes in a channel's format, within the cluster that holds it.
    pub fn page_in<'c>(
        &self,
        cluster: &'c ClusterPages,
        channel: usize,
        id: PageId,
    ) -> Result<&'c [u8], PageError> {
        self.page_extent(channel, id)?;
        let extent = self.cover().groups[id.group as usize].extent;
        cluster.page(&self.formats, channel, id, extent).ok_or_else(|| self.no_such_page(channel, id))
    }

    /// The same, in whichever of several clusters holds the page.
    pub fn page_in_any<'c>(
        &self,
        clusters: &'c [Arc<ClusterPages>],
        channel: usize,
        id: PageId,
    ) -> Result<&'c [u8], PageError> {
        self.page_extent(channel, id)?;
        let extent = self.cover().groups[id.group as usize].extent;
        let found = clusters.iter().find_map(|cluster| cluster.page(&self.formats, channel, id, extent));
        found.ok_or_else(|| self.no_such_page(channel, id))
    }

    /// Reads, checks and unpacks a cluster.
    pub(crate) fn read_cluster(&self, cluster: ClusterId) -> Result<ClusterPages, PageError> {
        self.read_entry(cluster.level, self.entry(cluster))
    }

    /// Reads, checks and unpacks the cluster of an entry, which may be of a later generation.
    pub(crate) fn read_entry(&self, level: u32, entry: &ClusterEntry) -> Result<ClusterPages, PageError> {
        let mut stored = vec![0; entry.stored_length as usize];
        self.source.read_exact_at(&mut stored, entry.offset).map_err(|source| PageError::Io {
            path: self.path().to_owned(),
            offset: entry.offset,
            length: u64::from(entry.stored_length),
            source: Arc::new(source),
        })?;
        self.unpack_entry(level, entry, &stored)
    }

    /// The groups whose tiles may have pages in a cluster.
    pub(crate) fn groups_in_cluster(&self, cluster: ClusterId) -> Range<u32> {
        let clusters = &self.directory.levels[cluster.level as usize];
        let end = match clusters.get(cluster.index as usize + 1) {
            // The next one starts within the last group's tile, or with the tile after it.
            Some(next) => next.first.group + u32::from(next.first.page > 0),
            None => self.cover().groups.len() as u32,
        };
        clusters[cluster.index as usize].first.group..end
    }

    fn entry(&self, cluster: ClusterId) -> &ClusterEntry {
        &self.directory.levels[cluster.level as usize][cluster.index as usize]
    }
}

/// A cluster as it is stored.
pub(crate) struct PackedCluster {
    /// Bytes before packing.
    pub(crate) raw_length: u32,
    pub(crate) stored: Vec<u8>,
}

/// The shortest run that zstd may store as a repetition. Blocks of texels repeat in whole or hardly at all: with short runs a
/// cluster is as large, and takes a tenth longer to unpack.
const SHORTEST_MATCH: u32 = 7;

/// Packs the bytes of all pages of a cluster, given by channel.
pub(crate) fn pack_cluster(
    channels: &[Vec<u8>],
    formats: &[TexelFormat],
    zstd_level: i32,
) -> std::io::Result<PackedCluster> {
    let raw = arrange(channels, formats);
    let mut compressor = zstd::bulk::Compressor::new(zstd_level)?;
    compressor.set_parameter(CParameter::MinMatch(SHORTEST_MATCH))?;
    Ok(PackedCluster { raw_length: raw.len() as u32, stored: compressor.compress(&raw)? })
}

/// The cluster's channels one after the other, each rearranged to pack well.
fn arrange(channels: &[Vec<u8>], formats: &[TexelFormat]) -> Vec<u8> {
    let mut raw = vec![0; channels.iter().map(Vec::len).sum()];
    let mut rest = raw.as_mut_slice();
    for (stream, &format) in channels.iter().zip(formats) {
        let (packed, after) = rest.split_at_mut(stream.len());
        packing::pack(format, stream, packed);
        rest = after;
    }
    raw
}

thread_local! {
    static UNPACKER: RefCell<Unpacker> = RefCell::default();
}

/// A longer buffer is not kept for the next cluster: few clusters are.
const KEPT_BYTES: usize = 1 << 20;

/// What a thread keeps between clusters, so that it needn't be set up for each.
#[derive(Default)]
struct Unpacker {
    zstd: zstd::bulk::Decompressor<'static>,
    raw: Vec<u8>,
}

impl Unpacker {
    /// A cluster's bytes in their natural order, or none if they are not as many.
    fn unpack(&mut self, formats: &[TexelFormat], stored: &[u8], length: usize) -> Option<Vec<u8>> {
        // What is here already is overwritten.
        self.raw.resize(length, 0);
        let unpacked = self.zstd.decompress_to_buffer(stored, self.raw.as_mut_slice()).ok();
        let natural = (unpacked == Some(length)).then(|| unarranged(formats, &self.raw));
        if length > KEPT_BYTES {
            self.raw = Vec::new();
        }
        natural
    }
}

/// Inverse of [`arrange`].
fn unarranged(formats: &[TexelFormat], raw: &[u8]) -> Vec<u8> {
    let block_bytes: usize = formats.iter().map(|f| f.block_bytes()).sum();
    let blocks = raw.len() / block_bytes;
    let mut natural = vec![0; raw.len()];
    let mut from = 0;
    for &format in formats {
        let to = from + blocks * format.block_bytes();
        packing::unpack(format, &raw[from..to], &mut natural[from..to]);
        from = to;
    }
    natural
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unpacker_survives_damaged_clusters_and_long_ones() {
        let formats = [TexelFormat::Bc7, TexelFormat::Rgba8];
        let mut unpacker = Unpacker::default();
        for blocks in [3, 20_000, 7, 100] {
            let channels = formats.map(|format| {
                (0..blocks * format.block_bytes()).map(|i| (i / 16 * 3 + i % 5) as u8).collect::<Vec<u8>>()
            });
            let natural = channels.concat();
            let stored = pack_cluster(&channels, &formats, 1).unwrap().stored;
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len()).as_ref(), Some(&natural));
            assert_eq!(unpacker.unpack(&formats, &stored[..stored.len() - 1], natural.len()), None);
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len() - 80), None);
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len() + 80), None);
            assert_eq!(unpacker.unpack(&formats, b"no zstd frame", natural.len()), None);
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len()), Some(natural));
            assert!(unpacker.raw.capacity() <= KEPT_BYTES);
        }
    }
}
