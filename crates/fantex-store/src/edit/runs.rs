//! Rewriting a cluster: its pages with some of them replaced, cut into shorter runs, packed.
//!
//! A cluster is packed as a whole, so that one changed page costs all of its pages. A baked cluster holds 256 KiB before
//! packing; where an edit touches one, it is cut into runs of at most [`RUN_BYTES`], so that the next edit nearby
//! rewrites less. Bytes written (directory and alignment included) per byte of changed pages, packed; BC7, tiles of 64x64
//! texels, one page changed per commit (the test `write_amplification` prints these):
//!
//! | runs of | 16 KiB | 64 KiB | 256 KiB (never cut) |
//! |---|---|---|---|
//! | first edit of a cluster | 60 | 55 | 50 |
//! | later edits | 6 | 16 | 50 |
//! | bytes of the texels, padded to 4 KiB | 1.19 | 1.10 | 1 |
//!
//! 64 KiB is also one page of 256x256 texels in BC7.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::layout::{PageSize, TilePlace};
use crate::section::directory::{ClusterEntry, Directory};
use crate::writer::arrange;
use crate::{Asset, EditError, PageId, TexelFormat};
use xxhash_rust::xxh3::xxh3_64;

/// Bytes before packing of a run that an edit makes.
pub(super) const RUN_BYTES: usize = 64 << 10;

/// Replaced bytes of a page per channel; none where the channel stays.
pub(super) type PageChange = Vec<Option<Arc<Vec<u8>>>>;

/// Changed pages of one level.
pub(super) type LevelChanges = BTreeMap<TilePlace, PageChange>;

/// A run that is ready to be written.
pub(super) struct PackedRun {
    pub(super) first: TilePlace,
    pub(super) raw_length: u32,
    pub(super) stored: Vec<u8>,
}

impl PackedRun {
    /// Its entry once it lies at `offset`.
    pub(super) fn entry(&self, offset: u64) -> ClusterEntry {
        ClusterEntry {
            first: self.first,
            offset,
            stored_length: self.stored.len() as u32,
            raw_length: self.raw_length,
            checksum: xxh3_64(&self.stored),
        }
    }
}

/// How runs are made.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunPacking {
    /// A run has at most so many bytes before packing, or one page.
    pub(super) run_bytes: usize,
    pub(super) zstd_level: i32,
}

/// Pages that are gathered until they are a run.
pub(super) struct RunCutter<'a> {
    formats: &'a [TexelFormat],
    packing: RunPacking,
    first: Option<TilePlace>,
    channels: Vec<Vec<u8>>,
}

impl<'a> RunCutter<'a> {
    /// Without pages.
    pub(super) fn new(formats: &'a [TexelFormat], packing: RunPacking) -> Self {
        Self { formats, packing, first: None, channels: vec![Vec::new(); formats.len()] }
    }

    /// Adds the next page; returns the run before it where that is full.
    pub(super) fn add(
        &mut self,
        place: TilePlace,
        page: &[impl AsRef<[u8]>],
    ) -> std::io::Result<Option<PackedRun>> {
        let length = |channels: &[Vec<u8>]| channels.iter().map(Vec::len).sum::<usize>();
        let page_length: usize = page.iter().map(|bytes| bytes.as_ref().len()).sum();
        let full = self.first.is_some() && length(&self.channels) + page_length > self.packing.run_bytes;
        let done = if full { self.finish()? } else { None };
        self.first.get_or_insert(place);
        for (stream, bytes) in self.channels.iter_mut().zip(page) {
            stream.extend_from_slice(bytes.as_ref());
        }
        Ok(done)
    }

    /// The last run.
    pub(super) fn finish(&mut self) -> std::io::Result<Option<PackedRun>> {
        let Some(first) = self.first.take() else { return Ok(None) };
        let raw = arrange(&self.channels, self.formats);
        self.channels.iter_mut().for_each(Vec::clear);
        let stored = zstd::bulk::compress(&raw, self.packing.zstd_level)?;
        Ok(Some(PackedRun { first, raw_length: raw.len() as u32, stored }))
    }
}

/// The pages of a cluster, in order.
pub(super) fn pages_of_cluster(
    asset: &Asset,
    directory: &Directory,
    level: u32,
    index: usize,
) -> Vec<TilePlace> {
    let clusters = &directory.levels[level as usize];
    let groups = &asset.cover().groups;
    let end = clusters.get(index + 1).map_or(TilePlace { group: groups.len() as u32, page: 0 }, |c| c.first);
    let mut at = clusters[index].first;
    let mut pages = Vec::new();
    while at < end {
        if at.page < PageSize::new(groups[at.group as usize].extent, level).page_count() {
            pages.push(at);
            at.page += 1;
        } else {
            at = TilePlace { group: at.group + 1, page: 0 };
        }
    }
    pages
}

/// Reads a cluster, replaces what has changed, and packs it as one or more runs.
pub(super) fn rewrite(
    asset: &Asset,
    directory: &Directory,
    level: u32,
    index: usize,
    changes: &LevelChanges,
    packing: RunPacking,
) -> Result<Vec<PackedRun>, EditError> {
    let entry = &directory.levels[level as usize][index];
    let cluster = asset.read_entry(level, entry)?;
    let formats = asset.formats();
    let io = |source| EditError::write(asset.path().to_owned(), source);
    let mut cutter = RunCutter::new(formats, packing);
    let mut runs = Vec::new();
    for place in pages_of_cluster(asset, directory, level, index) {
        let size = PageSize::new(asset.cover().groups[place.group as usize].extent, level);
        let id = PageId { group: place.group, level, page: size.page(place.page) };
        let mut page = Vec::with_capacity(formats.len());
        for channel in 0..formats.len() {
            let changed = changes.get(&place).and_then(|change| change[channel].as_ref());
            page.push(match changed {
                Some(bytes) => bytes.as_slice(),
                None => asset.page_in(&cluster, channel, id)?,
            });
        }
        runs.extend(cutter.add(place, &page).map_err(io)?);
    }
    runs.extend(cutter.finish().map_err(io)?);
    Ok(runs)
}
