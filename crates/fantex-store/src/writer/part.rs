//! Parts: the texels of a run of groups, baked by themselves.
//!
//! ```text
//!  header (4096) | cluster | cluster | ... | heads, tails | item | item | ... | means | checksum
//!                `- at multiples of 4096, as in an asset
//! ```
//!
//! Clusters lie where one process would put them: a part knows how full each level's open cluster is when its groups begin. What it adds
//! to that cluster is a *head*, stored as it is; clusters of its own are packed; those that are open at its end are *tails*. Merging
//! joins tails and heads, packs these, and copies all else ([`merge_parts`](crate::merge_parts)).
//!
//! Packed clusters stand together, with the gaps that they have in an asset, so that whoever can copy ranges of files takes long runs of
//! them at once. What says where they lie is at the end, as it is not known before.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use fantex_base::files::temporary_file;
use fantex_base::{Error, Result};
use rayon::prelude::*;
use tempfile::NamedTempFile;
use xxhash_rust::xxh3::xxh3_64;

use super::{CreateOptions, Cuts, EncodedPage, OpenCluster, PackedCluster, PageStream, Plan, WriteSummary};
use crate::Replacement;
use crate::bytes::ByteWriter;
use crate::directory::ALIGNMENT;
use crate::header::PART_SIGNATURE;

/// Of the header: signature, plan, first group, end, shard, count, items, means, where the items stand; zeros; its checksum. The first cluster
/// follows.
pub(super) const HEADER: usize = ALIGNMENT as usize;

/// Of an item: kind, level, first group and page, bytes unpacked and stored, checksum of the bytes stored.
pub(super) const ITEM: usize = 4 * 6 + 8;

/// What stands between clusters.
static PADDING: [u8; ALIGNMENT as usize] = [0; ALIGNMENT as usize];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ItemKind {
    /// Ends a cluster that another part began.
    Head,
    /// A cluster.
    Packed,
    /// Begins, or goes on with, a cluster that another part ends.
    Tail,
}

impl ItemKind {
    pub(super) const ALL: [Self; 3] = [Self::Head, Self::Packed, Self::Tail];
}

/// Writes a part: pages of a run of groups, as [`AssetWriter`](crate::AssetWriter) takes them.
#[derive(Debug)]
pub struct PartWriter {
    path: PathBuf,
    replacement: Replacement,
    zstd_level: i32,
    identity: u128,
    shard: [u32; 2],
    file: NamedTempFile,
    out: BufWriter<File>,
    /// Bytes that are written: header and clusters.
    end: u64,
    /// Heads and tails: at most a cluster of each per level.
    loose: Vec<u8>,
    items: Vec<u8>,
    pages: PageStream,
    summary: WriteSummary,
}

impl PartWriter {
    /// Creates the temporary file of shard `number` of `count`.
    ///
    /// # Errors
    /// The file exists and is not to be overwritten or is being edited, or cannot be written; there is no such shard; the plan was made on a
    /// processor whose block encoders give other bytes.
    pub fn create(
        path: &Path,
        options: &CreateOptions,
        plan: &Plan,
        number: u32,
        count: u32,
    ) -> Result<Self> {
        let groups = plan.shard(number, count)?;
        plan.check_encoders()?;
        let replacement = Replacement::begin(path, options.force)?;
        let io = |source| Error::writing(path, source);
        let mut pages = PageStream::new(path, &plan.cover, &plan.channels, groups.clone());
        for (level, cluster) in pages.open.iter_mut().enumerate() {
            let before = Cuts::new(&pages.extents[..groups.start as usize], &pages.formats, level);
            cluster.before = before.last().map_or(0, |(_, length)| length);
        }
        let file = temporary_file(path, ".tmp").map_err(io)?;
        let mut out = BufWriter::with_capacity(1 << 20, file.as_file().try_clone().map_err(io)?);
        out.write_all(&[0; HEADER]).map_err(io)?;
        Ok(Self {
            path: path.to_owned(),
            replacement,
            zstd_level: options.zstd_level,
            identity: plan.identity,
            shard: [number, count],
            file,
            out,
            end: HEADER as u64,
            loose: Vec::new(),
            items: Vec::new(),
            pages,
            summary: WriteSummary::default(),
        })
    }

    /// The groups whose pages it takes.
    pub fn groups(&self) -> Range<u32> {
        self.pages.groups.clone()
    }

    /// Adds pages, as [`AssetWriter::write_pages`](crate::AssetWriter::write_pages) does.
    ///
    /// # Errors
    /// As there.
    pub fn write_pages(&mut self, batch: Vec<EncodedPage>) -> Result<()> {
        for page in batch {
            self.pages.add(&page)?;
        }
        self.write_full(ItemKind::Packed)
    }

    /// Writes what is left, makes the file durable and gives it its name. `means`: as in [`AssetWriter::finish`](crate::AssetWriter::finish), of
    /// these groups.
    ///
    /// # Errors
    /// As there.
    pub fn finish(mut self, means: &[[f32; 4]]) -> Result<WriteSummary> {
        self.pages.check_finished(means.len())?;
        self.pages.close();
        self.write_full(ItemKind::Tail)?;
        let path = self.path.clone();
        let bytes = self.seal(means).map_err(|source| Error::writing(&path, source))?;
        self.replacement.finish(self.file.into_temp_path())?;
        let (pages, unpacked_texel_bytes) = (self.pages.pages, self.pages.bytes);
        Ok(WriteSummary { bytes, pages, unpacked_texel_bytes, ..self.summary })
    }

    fn write_full(&mut self, kind: ItemKind) -> Result<()> {
        let (formats, zstd_level) = (&self.pages.formats, self.zstd_level);
        let stored: Vec<io::Result<(ItemKind, usize, PackedCluster)>> = std::mem::take(&mut self.pages.full)
            .into_par_iter()
            .map(|(level, cluster)| match (kind, cluster.before) {
                (ItemKind::Packed, 0) => Ok((kind, level, cluster.pack(formats, zstd_level)?)),
                (ItemKind::Packed, _) => Ok((ItemKind::Head, level, cluster.plain())),
                _ => Ok((kind, level, cluster.plain())),
            })
            .collect();
        for item in stored {
            let written = item.and_then(|(kind, level, cluster)| self.write_item(kind, level, &cluster));
            written.map_err(|source| Error::writing(&self.path, source))?;
        }
        Ok(())
    }

    fn write_item(&mut self, kind: ItemKind, level: usize, cluster: &PackedCluster) -> io::Result<()> {
        let PackedCluster { first, raw_length, stored } = cluster;
        let mut item = ByteWriter::default();
        item.u32(ItemKind::ALL.iter().position(|k| *k == kind).unwrap_or(0) as u32);
        [level as u32, first.group, first.page, *raw_length, stored.len() as u32]
            .into_iter()
            .for_each(|n| item.u32(n));
        item.u64(xxh3_64(stored));
        self.items.extend_from_slice(&item.bytes);
        if kind == ItemKind::Packed {
            let taken = stored.len().next_multiple_of(ALIGNMENT as usize);
            self.out.write_all(stored)?;
            self.out.write_all(&PADDING[..taken - stored.len()])?;
            self.end += taken as u64;
        } else {
            self.loose.extend_from_slice(stored);
        }
        self.summary.cluster_bytes += stored.len() as u64;
        self.summary.clusters += usize::from(kind == ItemKind::Packed);
        Ok(())
    }

    /// Heads and tails, items, means and header; returns the length of the file.
    fn seal(&mut self, means: &[[f32; 4]]) -> io::Result<u64> {
        let directory = self.end + self.loose.len() as u64;
        let items = (self.items.len() / ITEM) as u64;
        let mut end = ByteWriter { bytes: std::mem::take(&mut self.items) };
        end.f32s(means.as_flattened());
        end.u64(xxh3_64(&end.bytes));
        self.out.write_all(&self.loose)?;
        self.out.write_all(&end.bytes)?;
        let mut header = ByteWriter::default();
        header.put(PART_SIGNATURE);
        header.put(&self.identity.to_le_bytes());
        let groups = &self.pages.groups;
        [groups.start, groups.end, self.shard[0], self.shard[1]].into_iter().for_each(|n| header.u32(n));
        [items, means.len() as u64, directory].into_iter().for_each(|n| header.u64(n));
        header.bytes.resize(HEADER - 8, 0);
        header.u64(xxh3_64(&header.bytes));
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(&header.bytes)?;
        self.out.flush()?;
        self.out.get_ref().sync_all()?;
        Ok(directory + end.bytes.len() as u64)
    }
}

impl OpenCluster {
    /// The bytes as they are, channel after channel.
    fn plain(&self) -> PackedCluster {
        let stored = self.channels.concat();
        PackedCluster { first: self.first, raw_length: stored.len() as u32, stored }
    }
}
