//! A fresh copy of an asset: in page order again, in clusters of full length, without gaps.

use std::fs::OpenOptions;
use std::io;
use std::path::Path;
use std::sync::Arc;

use fantex_base::Result;
use fantex_base::files::persist;
use tempfile::NamedTempFile;

use super::AssetEditor;
use super::commit::{FileOutput, pages_of_cluster};
use crate::directory::Attachments;
use crate::header::SectionRecord;
use crate::layout::PageSize;
use crate::writer::{CLUSTER_TARGET_BYTES, NewFile, OpenCluster};
use crate::{Asset, PageId, write_error};

/// What compaction did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CompactSummary {
    /// Length of the file before.
    pub bytes_before: u64,
    /// Length of the file now.
    pub bytes: u64,
}

impl AssetEditor {
    /// Commits, then replaces the file by a copy without gaps, atomically. Needs room for the copy; memory does not grow
    /// with the asset. Readers that have the old file open keep it.
    ///
    /// # Errors
    /// As [`commit`](Self::commit), or the copy cannot be written; the file then stays as it is.
    pub fn compact(&mut self) -> Result<CompactSummary> {
        let bytes_before = self.commit()?.file_bytes;
        let asset = Arc::clone(&self.asset);
        let io = |source| write_error(asset.path(), source);
        let mut copy = begin(&asset).map_err(io)?;
        copy_clusters(&asset, &mut copy, self.options.zstd_level)?;
        let attachments = copy_attachments(&asset, &mut copy).map_err(io)?;
        let permissions = self.file.metadata().map_err(io)?.permissions();
        let finished = copy.finish(asset.directory().means.clone(), &attachments, Some(permissions));
        self.move_to(finished.map_err(io)?.0, asset.path())?;
        Ok(CompactSummary { bytes_before, bytes: self.asset.file_bytes() })
    }

    /// Gives the finished copy the asset's name and goes on there.
    fn move_to(&mut self, file: NamedTempFile, path: &Path) -> Result<()> {
        let io = |source| write_error(path, source);
        persist(file.into_temp_path(), path, true)?;
        let file = Arc::new(OpenOptions::new().read(true).write(true).open(path).map_err(io)?);
        let output = Box::new(FileOutput(Arc::clone(&file)));
        // The lock is on another file and stays ours.
        *self = Self::locked(path, self.options, Arc::clone(&self.lock), file, output)?;
        Ok(())
    }
}

/// Copies the sections that no commit changes, and keeps room for the directory behind them.
fn begin(asset: &Asset) -> io::Result<NewFile> {
    let mut copy = NewFile::create(asset.path(), asset.generation() + 1, asset.directory().levels.len())?;
    for (index, record) in asset.slot().sections.iter().enumerate().take(3) {
        copy.section(index, &read_stored(asset, record)?, *record)?;
    }
    let extents: Vec<_> = asset.cover().groups.iter().map(|group| group.extent).collect();
    copy.keep_room_for_directory(&extents, asset.formats());
    Ok(copy)
}

/// Joins and copies all clusters, level after level within neighbourhoods of the surface.
fn copy_clusters(asset: &Asset, copy: &mut NewFile, zstd_level: i32) -> Result<()> {
    let (levels, formats) = (&asset.directory().levels, asset.formats());
    let mut next = vec![0; levels.len()];
    let mut open: Vec<_> = levels.iter().map(|_| OpenCluster::empty(formats.len())).collect();
    let mut put = |level, cluster: OpenCluster| {
        let written = cluster.pack(formats, zstd_level).and_then(|packed| copy.cluster(level, &packed));
        written.map_err(|source| write_error(asset.path(), source))
    };
    // Always the level that lags behind most, so that a place's levels come to lie near each other.
    while let Some(level) = (0..levels.len())
        .filter(|&level| next[level] < levels[level].len())
        .min_by_key(|&level| levels[level][next[level]].first.group)
    {
        let cluster = asset.read_entry(level as u32, &levels[level][next[level]])?;
        for place in pages_of_cluster(asset, asset.directory(), level as u32, next[level]) {
            let size = PageSize::new(asset.cover().groups[place.group as usize].extent, level as u32);
            let id = PageId { group: place.group, level: level as u32, page: size.page(place.page) };
            let channels = (0..formats.len()).map(|channel| asset.page_in(&cluster, channel, id));
            let page = channels.collect::<Result<Vec<_>, _>>()?;
            if let Some(full) = open[level].add(place, &page, CLUSTER_TARGET_BYTES) {
                put(level, full)?;
            }
        }
        next[level] += 1;
    }
    for (level, open) in open.iter_mut().enumerate() {
        if let Some(last) = open.take() {
            put(level, last)?;
        }
    }
    Ok(())
}

fn copy_attachments(asset: &Asset, copy: &mut NewFile) -> io::Result<Attachments> {
    let mut list = Attachments::new();
    for (name, record) in asset.attachments().map_err(io::Error::other)? {
        let offset = copy.append(&read_stored(asset, record)?)?;
        list.insert(name.clone(), SectionRecord { offset, ..*record });
    }
    Ok(list)
}

/// The stored bytes of a section or attachment. Damage is copied, and reported when it is read.
fn read_stored(asset: &Asset, record: &SectionRecord) -> io::Result<Vec<u8>> {
    let mut stored = vec![0; record.stored_length as usize];
    asset.source().read_exact_at(&mut stored, record.offset)?;
    Ok(stored)
}
