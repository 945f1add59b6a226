//! A fresh copy of an asset: in page order again, in clusters of full length, without gaps, and with further channels where they are
//! wanted.

use std::borrow::Cow;
use std::fs::OpenOptions;
use std::io;
use std::path::Path;
use std::sync::Arc;

use fantex_base::Result;
use fantex_base::files::persist;
use tempfile::NamedTempFile;

use super::AssetEditor;
use super::commit::{FileOutput, pages_of_cluster};
use crate::channel::encode_channels;
use crate::decode::StoredTexels;
use crate::directory::{Attachments, Means};
use crate::header::SectionRecord;
use crate::layout::{ClusterPages, PageSize};
use crate::writer::{CLUSTER_TARGET_BYTES, NewFile, OpenCluster, pack_section};
use crate::{Asset, Channel, PageId, TexelFormat, write_error};

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
        let channels = self.asset.channels().to_vec();
        self.rewrite(&channels)
    }

    /// The same with these channels: those of the asset, and others behind them.
    pub(super) fn rewrite(&mut self, channels: &[Channel]) -> Result<CompactSummary> {
        let bytes_before = self.commit()?.file_bytes;
        let asset = Arc::clone(&self.asset);
        let io = |source| write_error(asset.path(), source);
        let added = AddedChannels::new(&asset, channels);
        let mut copy = added.begin().map_err(io)?;
        added.copy_clusters(&mut copy, self.options.zstd_level)?;
        let attachments = copy_attachments(&asset, &mut copy).map_err(io)?;
        let permissions = self.file.metadata().map_err(io)?.permissions();
        let finished = copy.finish(added.means()?, &attachments, Some(permissions));
        self.move_to(finished.map_err(io)?.0, asset.path())?;
        Ok(CompactSummary { bytes_before, bytes: self.asset.file_bytes() })
    }

    /// Gives the finished copy the asset's name and goes on there.
    fn move_to(&mut self, file: NamedTempFile, path: &Path) -> Result<()> {
        let io = |source| write_error(path, source);
        persist(file.into_temp_path(), path, true)?;
        let file = Arc::new(OpenOptions::new().read(true).write(true).open(path).map_err(io)?);
        let output = Box::new(FileOutput(Arc::clone(&file)));
        let lock = Arc::new(self.lock.moved(path)?);
        *self = Self::locked(path, self.options, lock, file, output)?;
        Ok(())
    }
}

/// An asset, and the channels that its copy has.
struct AddedChannels<'a> {
    asset: &'a Asset,
    channels: &'a [Channel],
    formats: Vec<TexelFormat>,
    /// The last triangle of each group; empty without further channels.
    triangles: Vec<u32>,
}

impl<'a> AddedChannels<'a> {
    fn new(asset: &'a Asset, channels: &'a [Channel]) -> Self {
        let is_longer = channels.len() > asset.channels().len();
        let mut triangles = vec![0; if is_longer { asset.cover().groups.len() } else { 0 }];
        if is_longer {
            for (triangle, groups) in (0u32..).zip(&asset.cover().corner_groups) {
                groups.iter().for_each(|&group| triangles[group as usize] = triangle);
            }
        }
        let formats = channels.iter().map(|channel| channel.format).collect();
        Self { asset, channels, formats, triangles }
    }

    /// The channels that the asset does not have.
    fn added(&self) -> &[Channel] {
        &self.channels[self.asset.channels().len()..]
    }

    fn value(&self, channel: &Channel, group: u32) -> [f32; 4] {
        Channel::plain_value(channel.kind, self.asset.mesh(), self.triangles[group as usize] as usize)
    }

    /// Copies the sections that no commit changes, and keeps room for the directory behind them.
    fn begin(&self) -> io::Result<NewFile> {
        let asset = self.asset;
        let mut copy = NewFile::create(asset.path(), asset.generation() + 1, asset.directory().levels.len())?;
        for (index, record) in asset.slot().sections.iter().enumerate().take(3) {
            if index == 0 && !self.added().is_empty() {
                let (stored, record) = pack_section(&encode_channels(self.channels))?;
                copy.section(index, &stored, record)?;
            } else {
                copy.section(index, &read_stored(asset, record)?, *record)?;
            }
        }
        let extents: Vec<_> = asset.cover().groups.iter().map(|group| group.extent).collect();
        copy.keep_room_for_directory(&extents, &self.formats);
        Ok(copy)
    }

    /// Joins and copies all clusters, level after level within neighbourhoods of the surface.
    fn copy_clusters(&self, copy: &mut NewFile, zstd_level: i32) -> Result<()> {
        let (asset, formats) = (self.asset, &self.formats);
        let levels = &asset.directory().levels;
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
                if let Some(full) = open[level].add(place, &self.page(&cluster, id)?, CLUSTER_TARGET_BYTES) {
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

    /// A page in all channels.
    fn page<'c>(&self, cluster: &'c ClusterPages, id: PageId) -> Result<Vec<Cow<'c, [u8]>>> {
        let known = self.asset.channels();
        let pages = (0..known.len()).map(|channel| self.asset.page_in(cluster, channel, id));
        let pages = pages.collect::<Result<Vec<_>, _>>()?;
        let beside: Vec<_> = known.iter().zip(pages.iter().copied()).collect();
        let mut all: Vec<Cow<'c, [u8]>> = pages.iter().map(|bytes| Cow::Borrowed(*bytes)).collect();
        for channel in self.added() {
            let extent = self.asset.page_extent(0, id)?;
            all.push(channel.plain_page(extent, self.value(channel, id.group), &beside)?.into());
        }
        Ok(all)
    }

    fn means(&self) -> Result<Means> {
        let known = &self.asset.directory().means;
        if self.added().is_empty() {
            return Ok(known.clone());
        }
        let mut values = Vec::new();
        for group in 0..self.asset.cover().groups.len() as u32 {
            values.extend((0..self.asset.channels().len()).map(|channel| known.get(channel, group)));
            for channel in self.added() {
                // What its texels decode to.
                let block = channel.plain_page([4, 4], self.value(channel, group), &[])?;
                values.push(StoredTexels::decode(channel.format, [4, 4], &block)?.linear(0, channel.srgb));
            }
        }
        Ok(Means::new(&values, &self.formats))
    }
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
