//! Writing changes: flushing them into free space, and the switch that commits them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::Arc;

use fantex_base::{Error, Result};
use rayon::prelude::*;

use super::lock::{is_same_file, is_unread};
use super::{AssetEditor, EditOptions, Flushed, used_ranges};
use crate::directory::{self, ClusterEntry, Directory};
use crate::file_source::write_all_at;
use crate::header::{SLOT_OFFSETS, SectionRecord, Slot};
use crate::layout::{PageSize, TilePlace};
use crate::writer::{OpenCluster, PackedCluster, pack_section};
use crate::{Asset, PageId, write_error};

/// Clusters that are packed at a time: bounds the memory of a flush.
const BATCH: usize = 32;

/// Attachments are packed at a time until they have so many bytes, unpacked.
const ATTACHMENT_BATCH_BYTES: usize = 32 << 20;

/// What a commit did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CommitSummary {
    /// The generation that counts now.
    pub generation: u64,
    /// Length of the file.
    pub file_bytes: u64,
    /// Bytes of the file that can be overwritten, or that wait for older readers to close it.
    pub free_bytes: u64,
}

impl AssetEditor {
    /// Makes all changes durable, at once: after a crash either all of them are there or none. Returns the same generation
    /// where there are none.
    ///
    /// # Errors
    /// The file cannot be written, the disk is full ([`is_disk_full`](crate::is_disk_full)), or it was replaced. The file keeps its last
    /// committed state, and the changes stay pending.
    pub fn commit(&mut self) -> Result<CommitSummary> {
        if self.has_changes() {
            self.check_in_place()?;
            self.flush()?;
            let (slot, written) = self.write_directory()?;
            self.switch_to(slot, written)?;
        }
        Ok(CommitSummary {
            generation: self.asset.generation(),
            file_bytes: self.asset.file_bytes(),
            free_bytes: self.space.free_bytes(),
        })
    }

    /// Writes pending pages and attachments to the file, uncommitted, and so frees their memory. What could not be written
    /// stays pending.
    ///
    /// # Errors
    /// As [`commit`](Self::commit).
    pub fn flush(&mut self) -> Result<()> {
        if !self.has_pending() {
            return Ok(());
        }
        self.check_in_place()?;
        self.reclaim();
        for level in 0..self.pending.pages.len() as u32 {
            while !self.pending.pages[level as usize].is_empty() {
                self.flush_batch(level)?;
            }
        }
        while !self.pending.attachments.is_empty() {
            self.flush_attachments()?;
        }
        Ok(())
    }

    /// Whether the asset's path still names the file that is open.
    pub fn is_in_place(&self) -> bool {
        is_same_file(&self.file, self.asset.path())
    }

    /// Whether commits go to the open file even where its path names another one, or none: who has the [`asset`](Self::asset) can read them
    /// there.
    pub fn set_detached(&mut self, is_detached: bool) {
        self.is_detached = is_detached;
    }

    /// Refuses to write to a file that is gone: nobody would see it.
    pub(super) fn check_in_place(&self) -> Result<()> {
        if self.is_detached || self.is_in_place() {
            return Ok(());
        }
        let path = self.asset.path();
        let sentence = format!(
            "{} was replaced or removed while it was edited; the changes cannot be saved there",
            path.display()
        );
        Err(Error::conflict(sentence).with_path(path))
    }

    /// Rewrites the first few clusters of a level that have changes.
    fn flush_batch(&mut self, level: u32) -> Result<()> {
        let (changes, indices) = self.take_batch(level);
        let (asset, directory) = (&self.asset, &self.flushed.directory);
        let options = &self.options;
        let packed: Result<Vec<_>> = indices
            .par_iter()
            .map(|&index| Ok((index, rewrite(asset, directory, level, index, &changes, options)?)))
            .collect();
        let written = packed.and_then(|packed| self.write_clusters(packed));
        match written {
            Ok(entries) => {
                let written = changes.values().flatten().flatten().map(|bytes| bytes.len());
                self.pending.page_bytes -= written.sum::<usize>();
                self.replace_entries(level, entries);
                Ok(())
            }
            Err(error) => {
                self.pending.pages[level as usize].extend(changes);
                Err(error)
            }
        }
    }

    /// The changes of the first few clusters of a level that have any, and the indices of these.
    fn take_batch(&mut self, level: u32) -> (LevelChanges, Vec<usize>) {
        let mut indices: Vec<usize> = Vec::new();
        let mut rest = None;
        for &place in self.pending.pages[level as usize].keys() {
            let index = self.flushed.directory.cluster_of(level, place);
            if indices.last() == Some(&index) {
                continue;
            }
            if indices.len() == BATCH {
                rest = Some(place);
                break;
            }
            indices.push(index);
        }
        let pending = &mut self.pending.pages[level as usize];
        let rest = rest.map(|place| pending.split_off(&place)).unwrap_or_default();
        (std::mem::replace(pending, rest), indices)
    }

    /// Writes rewritten clusters: all of them or, on an error, none.
    fn write_clusters(
        &mut self,
        packed: Vec<(usize, Vec<PackedCluster>)>,
    ) -> Result<Vec<(usize, Vec<ClusterEntry>)>> {
        let mut done: Vec<(usize, Vec<ClusterEntry>)> = Vec::new();
        for (index, runs) in packed {
            let mut entries = Vec::new();
            for run in &runs {
                match self.write_anywhere(&run.stored) {
                    Ok(offset) => entries.push(run.entry(offset)),
                    Err(error) => {
                        for entry in done.iter().flat_map(|(_, entries)| entries).chain(&entries) {
                            self.space.release(&entry.range());
                        }
                        return Err(error);
                    }
                }
            }
            done.push((index, entries));
        }
        Ok(done)
    }

    /// Puts new entries in the place of old ones, given by their index, ascending.
    fn replace_entries(&mut self, level: u32, replacements: Vec<(usize, Vec<ClusterEntry>)>) {
        if replacements.is_empty() {
            return;
        }
        let clusters = &mut Arc::make_mut(&mut self.flushed.directory).levels[level as usize];
        let old = std::mem::take(clusters);
        let mut replacements = replacements.into_iter().peekable();
        let mut dropped = Vec::new();
        let mut fresh = Vec::new();
        for (index, entry) in old.into_iter().enumerate() {
            if let Some((_, entries)) = replacements.next_if(|(replaced, _)| *replaced == index) {
                dropped.push(entry.range());
                fresh.extend(entries.iter().map(|entry| entry.offset));
                clusters.extend(entries);
            } else {
                clusters.push(entry);
            }
        }
        dropped.into_iter().for_each(|range| self.drop_range(range));
        self.flushed.uncommitted.extend(fresh);
        self.flushed.changed = true;
    }

    /// Writes the first few attachments that have changes. After an error that one and those after it are still pending.
    fn flush_attachments(&mut self) -> Result<()> {
        let (mut batch, mut bytes) = (Vec::new(), 0);
        while bytes < ATTACHMENT_BATCH_BYTES
            && let Some((name, contents)) = self.pending.pop_first_attachment()
        {
            bytes += contents.as_ref().map_or(0, Vec::len);
            batch.push((name, contents));
        }
        let packed: Vec<_> =
            batch.par_iter().map(|(_, contents)| contents.as_deref().map(pack_section).transpose()).collect();
        let mut attachments = batch.into_iter().zip(packed);
        for ((name, contents), packed) in &mut attachments {
            let written = packed.map_err(|source| self.failed(source)).and_then(|packed| {
                let section = packed.map(|(stored, record)| self.write_packed(&stored, record));
                section.transpose()
            });
            match written {
                Ok(record) => self.replace_attachment(name, record),
                Err(error) => {
                    self.pending.insert_attachment(name, contents);
                    attachments
                        .for_each(|((name, contents), _)| self.pending.insert_attachment(name, contents));
                    return Err(error);
                }
            }
        }
        Ok(())
    }

    /// Names where an attachment lies, if it is to be there.
    fn replace_attachment(&mut self, name: String, record: Option<SectionRecord>) {
        let old = match record {
            Some(record) => {
                self.flushed.uncommitted.insert(record.offset);
                self.flushed.attachments.insert(name, record)
            }
            None => self.flushed.attachments.remove(&name),
        };
        if let Some(old) = old {
            self.drop_range(old.range());
        }
        self.flushed.changed = true;
    }

    /// The working state no longer names a range.
    fn drop_range(&mut self, range: Range<u64>) {
        if self.flushed.uncommitted.remove(&range.start) {
            self.space.release(&range);
        } else {
            self.flushed.superseded.push(range);
        }
    }

    /// Steps 1 and 2: the directory and the list of attachments, and everything made durable. Returns also where these went.
    fn write_directory(&mut self) -> Result<(Slot, Vec<Range<u64>>)> {
        let mut written = Vec::new();
        let slot = self.write_sections(&mut written);
        let durable = slot.and_then(|slot| {
            // The last part's padding is part of the file.
            self.output
                .set_len(slot.file_length)
                .and_then(|()| self.output.sync())
                .map_err(|e| self.failed(e))?;
            Ok(slot)
        });
        match durable {
            Ok(slot) => Ok((slot, written)),
            Err(error) => {
                written.iter().for_each(|range| self.space.release(range));
                Err(error)
            }
        }
    }

    fn write_sections(&mut self, written: &mut Vec<Range<u64>>) -> Result<Slot> {
        let mut sections = self.asset.slot().sections;
        sections[3] = self.write_section(&directory::encode(&self.flushed.directory))?;
        written.push(sections[3].range());
        let mut attachments = SectionRecord::default();
        if !self.flushed.attachments.is_empty() {
            attachments = self.write_section(&directory::encode_attachments(&self.flushed.attachments))?;
            written.push(attachments.range());
        }
        let (file_length, hard_edges) = (self.space.end(), self.asset.slot().hard_edges);
        Ok(Slot { file_length, sections, attachments, hard_edges, ..Slot::new(self.header.newest + 1) })
    }

    /// Steps 3 and 4.
    fn switch_to(&mut self, slot: Slot, written: Vec<Range<u64>>) -> Result<()> {
        let target = SLOT_OFFSETS[self.header.target];
        self.header.newest = slot.generation;
        self.space.keep_length();
        let done = self.output.write_slot(target, &slot.encode()).and_then(|()| self.output.sync());
        if let Err(source) = done {
            // The slot may be on the disk or not, so what it names must stay until it is overwritten for sure.
            self.flushed.uncommitted.clear();
            self.flushed.superseded.extend(written);
            return Err(self.failed(source));
        }
        let before = *self.asset.slot();
        let attachments = self.flushed.attachments.clone();
        let directory = Arc::clone(&self.flushed.directory);
        self.asset = Arc::new(self.asset.committed(slot, directory, attachments));
        self.snapshots.push((slot.generation, Arc::downgrade(&self.asset)));
        self.header.target = 1 - self.header.target;
        self.header.oldest = before.generation;
        let superseded = std::mem::replace(&mut self.flushed, Flushed::none(&self.asset)?).superseded;
        let sections = [before.sections[3].range(), before.attachments.range()];
        for range in superseded.into_iter().chain(sections).filter(|range| !range.is_empty()) {
            self.space.retire(range, slot.generation);
        }
        Ok(())
    }

    /// Makes superseded space free where nobody can read it any more.
    fn reclaim(&mut self) {
        self.snapshots.retain(|(_, asset)| asset.strong_count() > 0);
        let oldest_read = self.snapshots.iter().map(|(generation, _)| *generation).min();
        let oldest = oldest_read.unwrap_or(self.header.oldest).min(self.header.oldest);
        if self.header.may_reuse && self.space.has_retired(oldest) && is_unread(&self.file) {
            self.space.reclaim(oldest);
        }
    }

    fn write_section(&mut self, raw: &[u8]) -> Result<SectionRecord> {
        let (stored, record) = pack_section(raw).map_err(|source| self.failed(source))?;
        self.write_packed(&stored, record)
    }

    fn write_packed(&mut self, stored: &[u8], record: SectionRecord) -> Result<SectionRecord> {
        Ok(SectionRecord { offset: self.write_anywhere(stored)?, ..record })
    }

    /// Writes bytes where there is room and returns where.
    fn write_anywhere(&mut self, bytes: &[u8]) -> Result<u64> {
        let offset = self.space.allocate(bytes.len() as u64);
        let is_beyond = self.limit.is_some_and(|limit| offset + bytes.len() as u64 > limit);
        let written = if is_beyond {
            Err(io::ErrorKind::QuotaExceeded.into())
        } else {
            self.output.write_at(offset, bytes)
        };
        match written {
            Ok(()) => Ok(offset),
            Err(source) => {
                self.space.release(&(offset..offset + bytes.len() as u64));
                Err(self.failed(source))
            }
        }
    }

    /// The error of a failed write. Gives back what the file grew by, so that a full disk has room for others again.
    fn failed(&mut self, source: io::Error) -> Error {
        let length = self.space.end().max(self.asset.file_bytes());
        self.output.set_len(length).unwrap_or_default();
        write_error(self.asset.path(), source)
    }
}

impl Asset {
    /// Bytes of the file that texels, sections and attachments of this generation take.
    pub fn used_bytes(&self) -> u64 {
        let used = used_ranges(self.slot(), self.directory(), self.attachments().ok());
        used.map(|range| range.end - range.start).sum()
    }
}

/// Replaced bytes of a page per channel; none where the channel stays.
pub(super) type PageChange = Vec<Option<Arc<Vec<u8>>>>;

pub(super) type LevelChanges = BTreeMap<TilePlace, PageChange>;

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
fn rewrite(
    asset: &Asset,
    directory: &Directory,
    level: u32,
    index: usize,
    changes: &LevelChanges,
    options: &EditOptions,
) -> Result<Vec<PackedCluster>> {
    let entry = &directory.levels[level as usize][index];
    let cluster = asset.read_entry(level, entry)?;
    let formats = asset.formats();
    let mut open = OpenCluster::empty(formats.len());
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
        runs.extend(open.add(place, &page, options.run_bytes));
    }
    runs.extend(open.take());
    let packed = runs.iter().map(|run| run.pack(formats, options.zstd_level)).collect::<io::Result<_>>();
    packed.map_err(|source| write_error(asset.path(), source))
}

/// Positional writes, made durable on demand. Writes between two calls of `sync` may reach the disk in any order, in part
/// or not at all.
pub trait EditOutput: Send + Sync + std::fmt::Debug {
    /// Writes all bytes at an offset; the file grows as needed.
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()>;
    /// Cuts or extends the file.
    fn set_len(&mut self, length: u64) -> io::Result<()>;
    /// Makes everything written so far durable.
    fn sync(&mut self) -> io::Result<()>;
}

/// Bytes of writes that are not durable yet and are kept in memory; beyond, they are made durable at once.
const MAX_UNSYNCED_BYTES: usize = 32 << 20;

/// An output that remembers what is not durable yet. A system that fails to sync may forget what was written and call the next
/// sync a success, so after a failure all of it is written again.
#[derive(Debug)]
pub(super) struct DurableOutput {
    output: Box<dyn EditOutput>,
    /// By offset.
    unsynced: BTreeMap<u64, Vec<u8>>,
    bytes: usize,
    /// Whether the system may have forgotten them.
    is_dropped: bool,
}

impl DurableOutput {
    pub(super) fn new(output: Box<dyn EditOutput>) -> Self {
        Self { output, unsynced: BTreeMap::new(), bytes: 0, is_dropped: false }
    }

    /// Writes a range that a commit will name. What it overlaps was given up.
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.forget(offset..offset + bytes.len() as u64);
        self.output.write_at(offset, bytes)?;
        self.unsynced.insert(offset, bytes.to_vec());
        self.bytes += bytes.len();
        if self.bytes > MAX_UNSYNCED_BYTES { self.sync() } else { Ok(()) }
    }

    /// Writes a header slot, which the next attempt writes anew in any case.
    fn write_slot(&mut self, offset: u64, slot: &[u8]) -> io::Result<()> {
        self.output.write_at(offset, slot)
    }

    pub(super) fn set_len(&mut self, length: u64) -> io::Result<()> {
        self.forget(length..u64::MAX);
        self.output.set_len(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        if self.is_dropped {
            self.write_again()?;
        }
        self.output.sync().inspect_err(|_| {
            self.is_dropped = true;
            self.write_again().unwrap_or_default();
        })?;
        self.unsynced.clear();
        self.bytes = 0;
        Ok(())
    }

    fn write_again(&mut self) -> io::Result<()> {
        self.unsynced.iter().try_for_each(|(&offset, bytes)| self.output.write_at(offset, bytes))?;
        self.is_dropped = false;
        Ok(())
    }

    /// Drops copies that reach into a range. They do not overlap each other, so only the last ones that start before its end may do so: there may be
    /// thousands, and each write asks for this.
    fn forget(&mut self, range: Range<u64>) {
        while let Some((&start, copy)) = self.unsynced.range(..range.end).next_back()
            && start + copy.len() as u64 > range.start
        {
            self.bytes -= copy.len();
            self.unsynced.remove(&start);
        }
    }
}

#[derive(Debug)]
pub(super) struct FileOutput(pub(super) Arc<File>);

impl EditOutput for FileOutput {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        write_all_at(&self.0, bytes, offset)
    }

    fn set_len(&mut self, length: u64) -> io::Result<()> {
        self.0.set_len(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.0.sync_all()
    }
}
