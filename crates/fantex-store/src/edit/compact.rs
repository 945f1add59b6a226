//! A fresh copy of an asset: in page order again, in clusters of full length, without gaps.

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;

use fantex_base::Result;
use tempfile::NamedTempFile;
use xxhash_rust::xxh3::xxh3_64;

use super::AssetEditor;
use super::commit::{FileOutput, PackedRun, RunCutter, RunPacking, pages_of_cluster};
use crate::directory::{self, ALIGNMENT, Attachments, ClusterEntry, Directory};
use crate::header::{HEADER_BYTES, SLOT_OFFSETS, SectionRecord, Slot, VERSION};
use crate::layout::PageSize;
use crate::writer::{
    CLUSTER_TARGET_BYTES, SECTION_ZSTD_LEVEL, clusters_per_level, folder_of, lengthen, temporary_file,
};
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
        let path = self.asset.path().to_owned();
        let io = |source| write_error(&path, source);
        let mut copy = Copy::begin(&self.asset).map_err(io)?;
        let run_bytes = CLUSTER_TARGET_BYTES as usize;
        copy.clusters(&self.asset, RunPacking { run_bytes, ..self.packing })?;
        copy.attachments(&self.asset).map_err(io)?;
        let file = copy.finish(&self.file).map_err(io)?;
        self.move_to(file, &path)?;
        Ok(CompactSummary { bytes_before, bytes: self.asset.file_bytes() })
    }

    /// Gives the finished copy the asset's name and goes on there.
    fn move_to(&mut self, file: NamedTempFile, path: &Path) -> Result<()> {
        let io = |source| write_error(path, source);
        file.persist(path).map_err(|error| io(error.error))?;
        #[cfg(unix)]
        File::open(folder_of(path)).and_then(|folder| folder.sync_all()).map_err(io)?;
        let file = Arc::new(OpenOptions::new().read(true).write(true).open(path).map_err(io)?);
        let output = Box::new(FileOutput(Arc::clone(&file)));
        // The lock is on another file and stays ours.
        *self = Self::with_output(path, self.packing, Arc::clone(&self.lock), file, output)?;
        Ok(())
    }
}

/// The copy while it is being written.
struct Copy {
    file: NamedTempFile,
    end: u64,
    slot: Slot,
    directory: Directory,
    list: Attachments,
}

impl Copy {
    /// Copies the sections that no commit changes, and keeps room for the directory behind them.
    fn begin(asset: &Asset) -> std::io::Result<Self> {
        let file = temporary_file(asset.path())?;
        let directory = Directory {
            levels: vec![Vec::new(); asset.directory().levels.len()],
            means: asset.directory().means.clone(),
        };
        let slot = Slot {
            version: VERSION,
            flags: 0,
            generation: asset.generation() + 1,
            file_length: 0,
            sections: [SectionRecord::default(); 4],
            attachments: SectionRecord::default(),
        };
        let mut copy = Self { file, end: HEADER_BYTES, slot, directory, list: Attachments::new() };
        for (index, record) in asset.slot().sections.iter().enumerate().take(3) {
            let stored = read_stored(asset, record)?;
            copy.write_at(copy.end, &stored)?;
            copy.slot.sections[index] = SectionRecord { offset: copy.end, ..*record };
            copy.end = (copy.end + record.stored_length).next_multiple_of(8);
        }
        copy.slot.sections[3].offset = copy.end;
        let extents: Vec<_> = asset.cover().groups.iter().map(|group| group.extent).collect();
        let clusters = clusters_per_level(&extents, asset.formats(), asset.level_count() as usize);
        let length = directory::encoded_length(&clusters, asset.cover().groups.len(), asset.formats());
        copy.end = (copy.end + zstd::zstd_safe::compress_bound(length) as u64).next_multiple_of(ALIGNMENT);
        Ok(copy)
    }

    /// Joins and copies all clusters, level after level within neighbourhoods of the surface.
    fn clusters(&mut self, asset: &Asset, packing: RunPacking) -> Result<()> {
        let levels = asset.directory().levels.len();
        let mut next = vec![0; levels];
        let mut cutters: Vec<_> = (0..levels).map(|_| RunCutter::new(asset.formats(), packing)).collect();
        // Always the level that lags behind most, so that a place's levels come to lie near each other.
        while let Some(level) = (0..levels)
            .filter(|&level| next[level] < asset.directory().levels[level].len())
            .min_by_key(|&level| asset.directory().levels[level][next[level]].first.group)
        {
            self.cluster(asset, level, next[level], &mut cutters[level])?;
            next[level] += 1;
        }
        for (level, cutter) in cutters.iter_mut().enumerate() {
            let run = cutter.finish().map_err(|e| write_error(asset.path(), e))?;
            self.run(asset, level, run)?;
        }
        Ok(())
    }

    fn cluster(
        &mut self,
        asset: &Asset,
        level: usize,
        index: usize,
        cutter: &mut RunCutter<'_>,
    ) -> Result<()> {
        let cluster = asset.read_entry(level as u32, &asset.directory().levels[level][index])?;
        for place in pages_of_cluster(asset, asset.directory(), level as u32, index) {
            let size = PageSize::new(asset.cover().groups[place.group as usize].extent, level as u32);
            let id = PageId { group: place.group, level: level as u32, page: size.page(place.page) };
            let channels = (0..asset.formats().len()).map(|channel| asset.page_in(&cluster, channel, id));
            let page = channels.collect::<Result<Vec<_>, _>>()?;
            let run = cutter.add(place, &page).map_err(|e| write_error(asset.path(), e))?;
            self.run(asset, level, run)?;
        }
        Ok(())
    }

    fn run(&mut self, asset: &Asset, level: usize, run: Option<PackedRun>) -> Result<()> {
        let Some(run) = run else { return Ok(()) };
        let entry: ClusterEntry = run.entry(self.end);
        self.write_at(self.end, &run.stored).map_err(|e| write_error(asset.path(), e))?;
        self.directory.levels[level].push(entry);
        self.end = entry.range().end.next_multiple_of(ALIGNMENT);
        Ok(())
    }

    fn attachments(&mut self, asset: &Asset) -> std::io::Result<()> {
        for (name, record) in asset.attachments().map_err(std::io::Error::other)? {
            let stored = read_stored(asset, record)?;
            self.write_at(self.end, &stored)?;
            self.list.insert(name.clone(), SectionRecord { offset: self.end, ..*record });
            self.end = (self.end + record.stored_length).next_multiple_of(ALIGNMENT);
        }
        Ok(())
    }

    /// Writes directory, list and header, and makes the file durable.
    fn finish(mut self, old: &File) -> std::io::Result<NamedTempFile> {
        let offset = self.slot.sections[3].offset;
        self.slot.sections[3] = self.section(offset, &directory::encode(&self.directory))?;
        if !self.list.is_empty() {
            self.slot.attachments = self.section(self.end, &directory::encode_attachments(&self.list))?;
            self.end = self.slot.attachments.range().end.next_multiple_of(ALIGNMENT);
        }
        self.slot.file_length = self.end;
        for offset in SLOT_OFFSETS {
            self.write_at(offset, &self.slot.encode())?;
        }
        let file = self.file.as_file();
        file.set_len(self.end)?;
        file.set_permissions(old.metadata()?.permissions())?;
        file.sync_all()?;
        Ok(self.file)
    }

    fn section(&self, offset: u64, raw: &[u8]) -> std::io::Result<SectionRecord> {
        let mut stored = zstd::bulk::compress(raw, SECTION_ZSTD_LEVEL)?;
        lengthen(&mut stored, raw.len() as u64);
        self.write_at(offset, &stored)?;
        let (stored_length, raw_length) = (stored.len() as u64, raw.len() as u64);
        Ok(SectionRecord { offset, stored_length, raw_length, checksum: xxh3_64(&stored) })
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> std::io::Result<()> {
        let mut file: &File = self.file.as_file();
        file.seek(SeekFrom::Start(offset)).and_then(|_| file.write_all(bytes))
    }
}

/// The stored bytes of a section or attachment. Damage is copied, and reported when it is read.
fn read_stored(asset: &Asset, record: &SectionRecord) -> std::io::Result<Vec<u8>> {
    let mut stored = vec![0; record.stored_length as usize];
    asset.source().read_exact_at(&mut stored, record.offset)?;
    Ok(stored)
}
