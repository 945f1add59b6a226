//! A fresh copy of an asset: in page order again, in clusters of full length, without gaps, and with other channels where they are
//! wanted.

use std::borrow::Cow;
use std::fs::{OpenOptions, Permissions};
use std::io;
use std::path::Path;
use std::sync::Arc;

use fantex_base::files::{followed, persist};
use fantex_base::{Error, Result};
use fantex_mesh::Mesh;
use tempfile::NamedTempFile;

use super::commit::{FileOutput, pages_of_cluster};
use super::space::padded;
use super::{AssetEditor, EditOptions, used_ranges};
use crate::channel::encode_channels;
use crate::decode::StoredTexels;
use crate::directory::{Attachments, Means};
use crate::header::{HEADER_BYTES, SECTION_NAMES, SectionRecord};
use crate::layout::{ClusterPages, PageSize, TilePlace};
use crate::writer::{CLUSTER_TARGET_BYTES, NewFile, OpenCluster, pack_section};
use crate::{Asset, Channel, PageId, TexelFormat, mesh_section, write_error};

/// A file of whose bytes more than this share is [unused](Asset::gap_share) is worth being written anew.
pub const MAX_GAPS: f64 = 0.5;

/// A copy that is made anyway leaves unused bytes out where they are more than this share.
pub const MAX_GAPS_COPIED: f64 = 0.125;

/// What compaction did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CompactSummary {
    /// Length of the file before.
    pub bytes_before: u64,
    /// Length of the file now.
    pub bytes: u64,
}

impl Asset {
    /// The share of the file that this generation leaves unused: what commits have left behind, and room that a bake has kept.
    pub fn gap_share(&self) -> f64 {
        let used = used_ranges(self.slot(), self.directory(), self.attachments().ok());
        let bytes = HEADER_BYTES + used.map(|range| padded(&range)).map(|r| r.end - r.start).sum::<u64>();
        1.0 - bytes as f64 / self.file_bytes().max(bytes) as f64
    }

    /// Copies this generation into a new file without gaps, which is durable and goes away unless it gets a name: one in the folder of
    /// `place`. Memory does not grow with the asset. Damage is copied, and reported when it is read; where clusters are cut it is an error.
    /// `done` is told the copied bytes and how many there are, and may end it.
    ///
    /// # Errors
    /// The asset cannot be read, the copy not be written; what `done` returns.
    pub fn copy_without_gaps(
        &self,
        place: &Path,
        done: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<NamedTempFile> {
        let channels = NewChannel::all_of(self);
        let zstd_level = EditOptions::default().zstd_level;
        let rewrite = Rewrite { copy: Some(place), ..Rewrite::new(self, &channels, None, zstd_level) };
        let attachment = |_: &str, record: &SectionRecord| {
            let stored = read_stored(self, record).map_err(|source| Error::reading(self.path(), source))?;
            Ok(Some((stored, *record)))
        };
        rewrite.write(place, attachment, None, done)
    }
}

impl AssetEditor {
    /// Commits, then replaces the file by a copy without gaps, atomically. Needs room for the copy; memory does not grow
    /// with the asset. Readers that have the old file open keep it.
    ///
    /// # Errors
    /// As [`commit`](Self::commit), or the copy cannot be written; the file then stays as it is. Where only what comes after that fails (its
    /// folder cannot be made durable, the copy cannot be opened or locked), the file is the copy already; this editor commits no more.
    pub fn compact(&mut self) -> Result<CompactSummary> {
        self.rewrite(&NewChannel::all_of(&self.asset), None, |_| false, |_, contents| Ok(Some(contents)))
    }

    /// The same with these channels, and another mesh that has the same triangles, where one is given. Attachments are copied, but those
    /// that `concerns` names hold what `change` makes of their contents; where that is none, there is no such attachment.
    pub(super) fn rewrite(
        &mut self,
        channels: &[NewChannel],
        mesh: Option<&Mesh>,
        concerns: impl Fn(&str) -> bool,
        mut change: impl FnMut(&str, Vec<u8>) -> Result<Option<Vec<u8>>>,
    ) -> Result<CompactSummary> {
        let bytes_before = self.commit()?.file_bytes;
        self.check_in_place()?;
        let asset = Arc::clone(&self.asset);
        let io = |source| write_error(asset.path(), source);
        // The file that a link leads to is replaced, not the link.
        let path = asset.path();
        let place = followed(path);
        let permissions = self.file.metadata().map_err(io)?.permissions();
        let rewrite = Rewrite::new(&asset, channels, mesh, self.options.zstd_level);
        let attachment = |name: &str, record: &SectionRecord| {
            if !concerns(name) {
                return Ok(Some((read_stored(&asset, record).map_err(io)?, *record)));
            }
            let contents = change(name, asset.read_attachment(name, record)?)?;
            contents.map(|contents| pack_section(&contents).map_err(io)).transpose()
        };
        let copy = rewrite.write(&place, attachment, Some(permissions), &mut |_, _| Ok(()))?;
        // What somebody else has put there meanwhile stays.
        self.check_in_place()?;
        self.move_to(copy, &place, path)?;
        Ok(CompactSummary { bytes_before, bytes: self.asset.file_bytes() })
    }

    /// Puts the finished copy in the place of the asset's file, and goes on there. `path` is the asset's own name.
    fn move_to(&mut self, file: NamedTempFile, place: &Path, path: &Path) -> Result<()> {
        let io = |source| write_error(path, source);
        persist(file.into_temp_path(), place, true)?;
        let file = Arc::new(OpenOptions::new().read(true).write(true).open(path).map_err(io)?);
        let output = Box::new(FileOutput(Arc::clone(&file)));
        let lock = Arc::new(self.lock.moved(path)?);
        let mut there = Self::locked(path, self.options, lock, file, output)?;
        there.limit = self.limit;
        there.replaced = self.replaced.take();
        *self = there;
        Ok(())
    }
}

/// A channel of the copy.
#[derive(Clone, Debug)]
pub(super) struct NewChannel {
    pub(super) channel: Channel,
    /// Its number in the asset; none where it is new.
    pub(super) from: Option<usize>,
}

impl NewChannel {
    /// Those of an asset, as they are.
    pub(super) fn all_of(asset: &Asset) -> Vec<Self> {
        let known = asset.channels().iter().cloned().enumerate();
        known.map(|(index, channel)| Self { channel, from: Some(index) }).collect()
    }
}

/// An asset, and the channels that its copy has.
struct Rewrite<'a> {
    asset: &'a Asset,
    channels: &'a [NewChannel],
    /// In the place of the asset's.
    mesh: Option<&'a Mesh>,
    formats: Vec<TexelFormat>,
    /// The last triangle of each group; empty where no channel is new.
    triangles: Vec<u32>,
    zstd_level: i32,
    /// What is written, for messages, where that is not the asset itself.
    copy: Option<&'a Path>,
}

impl<'a> Rewrite<'a> {
    fn new(asset: &'a Asset, channels: &'a [NewChannel], mesh: Option<&'a Mesh>, zstd_level: i32) -> Self {
        let has_new = channels.iter().any(|new| new.from.is_none());
        let mut triangles = vec![0; if has_new { asset.cover().groups.len() } else { 0 }];
        if has_new {
            for (triangle, groups) in (0u32..).zip(&asset.cover().corner_groups) {
                groups.iter().for_each(|&group| triangles[group as usize] = triangle);
            }
        }
        let formats = channels.iter().map(|new| new.channel.format).collect();
        Self { asset, channels, mesh, formats, triangles, zstd_level, copy: None }
    }

    fn failed(&self, source: io::Error) -> Error {
        match self.copy {
            Some(copy) => Error::writing(copy, source),
            None => write_error(self.asset.path(), source),
        }
    }

    /// Writes the new file. `attachment` gives what becomes of one; none where it is left out.
    fn write(
        &self,
        place: &Path,
        mut attachment: impl FnMut(&str, &SectionRecord) -> Result<Option<(Vec<u8>, SectionRecord)>>,
        permissions: Option<Permissions>,
        done: &mut dyn FnMut(u64, u64) -> Result<()>,
    ) -> Result<NamedTempFile> {
        let io = |source| self.failed(source);
        let total = self.asset.used_bytes();
        let mut copied = 0;
        let mut copy = self.begin(place).map_err(io)?;
        self.copy_clusters(&mut copy, &mut |bytes| {
            copied += bytes;
            done(copied, total)
        })?;
        let mut attachments = Attachments::new();
        for (name, record) in self.asset.attachments()? {
            if let Some((stored, changed)) = attachment(name, record)? {
                let offset = copy.append(&stored).map_err(io)?;
                attachments.insert(name.clone(), SectionRecord { offset, ..changed });
            }
            copied += record.stored_length;
            done(copied, total)?;
        }
        let (copy, _) = copy.finish(self.means()?, &attachments, permissions).map_err(io)?;
        done(total, total)?;
        Ok(copy)
    }

    /// Whether the channels are those of the asset.
    fn is_copy(&self) -> bool {
        let from = self.channels.iter().map(|new| new.from);
        from.eq((0..self.asset.channels().len()).map(Some))
    }

    fn value(&self, channel: &Channel, group: u32) -> [f32; 4] {
        Channel::plain_value(channel.kind, self.asset.mesh(), self.triangles[group as usize] as usize)
    }

    /// Copies the sections that no commit changes into a new file beside `place`, and keeps room for the directory behind them.
    fn begin(&self, place: &Path) -> io::Result<NewFile> {
        let asset = self.asset;
        let mut copy =
            NewFile::create(place, asset.generation().saturating_add(1), asset.directory().levels.len())?;
        copy.slot.hard_edges = asset.slot().hard_edges;
        for (index, record) in asset.slot().sections.iter().enumerate().take(3) {
            let changed = match (SECTION_NAMES[index], self.mesh) {
                ("channel", _) if !self.is_copy() => {
                    let channels: Vec<Channel> =
                        self.channels.iter().map(|new| new.channel.clone()).collect();
                    Some(encode_channels(&channels))
                }
                ("mesh", Some(mesh)) => Some(mesh_section::encode(mesh)),
                _ => None,
            };
            let (stored, record) = match changed {
                Some(changed) => pack_section(&changed)?,
                None => (read_stored(asset, record)?, *record),
            };
            copy.section(index, &stored, record)?;
        }
        let extents: Vec<_> = asset.cover().groups.iter().map(|group| group.extent).collect();
        copy.keep_room_for_directory(&extents, &self.formats);
        Ok(copy)
    }

    /// Joins and copies all clusters, level after level within neighbourhoods of the surface. `done` is told the length of each.
    fn copy_clusters(&self, copy: &mut NewFile, done: &mut dyn FnMut(u64) -> Result<()>) -> Result<()> {
        let (asset, formats) = (self.asset, &self.formats);
        let io = |source| self.failed(source);
        let levels = &asset.directory().levels;
        let is_copy = self.is_copy();
        let mut next = vec![0; levels.len()];
        let mut open: Vec<_> = levels.iter().map(|_| OpenCluster::empty(formats.len())).collect();
        let put = |copy: &mut NewFile, level, cluster: OpenCluster| {
            let packed = cluster.pack(formats, self.zstd_level);
            packed.and_then(|packed| copy.cluster(level, &packed)).map_err(io)
        };
        // Always the level that lags behind most, so that a place's levels come to lie near each other.
        while let Some(level) = (0..levels.len())
            .filter(|&level| next[level] < levels[level].len())
            .min_by_key(|&level| levels[level][next[level]].first.group)
        {
            let (index, entry) = (next[level], &levels[level][next[level]]);
            next[level] += 1;
            if is_copy && self.is_uncut(&open[level], level, index) {
                if let Some(full) = open[level].take() {
                    put(copy, level, full)?;
                }
                let mut stored = vec![0; entry.stored_length as usize];
                let read = asset.source().read_exact_at(&mut stored, entry.offset);
                read.map_err(|source| asset.read_error(&entry.range(), Arc::new(source)))?;
                copy.copied_cluster(level, &stored, *entry).map_err(io)?;
            } else {
                let cluster = asset.read_entry(level as u32, entry)?;
                for place in pages_of_cluster(asset, asset.directory(), level as u32, index) {
                    let id = self.id(level, place);
                    let page = self.page(&cluster, id)?;
                    if let Some(full) = open[level].add(place, &page, CLUSTER_TARGET_BYTES) {
                        put(copy, level, full)?;
                    }
                }
            }
            done(u64::from(entry.stored_length))?;
        }
        for (level, open) in open.iter_mut().enumerate() {
            if let Some(last) = open.take() {
                put(copy, level, last)?;
            }
        }
        Ok(())
    }

    /// Whether neither the pages before a cluster nor those behind it fit into one cluster with its own: joining would make the same one.
    fn is_uncut(&self, before: &OpenCluster, level: usize, index: usize) -> bool {
        let clusters = &self.asset.directory().levels[level];
        let ends = |length: usize, next: usize| {
            let first = clusters.get(next).map(|next| self.id(level, next.first));
            first.is_none_or(|id| {
                let page = |channel| self.asset.page_bytes(channel, id).unwrap_or(usize::MAX);
                let page = (0..self.formats.len()).map(page).fold(0, usize::saturating_add);
                length == 0 || length.saturating_add(page) > CLUSTER_TARGET_BYTES
            })
        };
        ends(before.length(), index) && ends(clusters[index].raw_length as usize, index + 1)
    }

    fn id(&self, level: usize, place: TilePlace) -> PageId {
        let level = level as u32;
        let size = PageSize::new(self.asset.cover().groups[place.group as usize].extent, level);
        PageId { group: place.group, level, page: size.page(place.page) }
    }

    /// A page in all channels.
    fn page<'c>(&self, cluster: &'c ClusterPages, id: PageId) -> Result<Vec<Cow<'c, [u8]>>> {
        let known = self.asset.channels();
        let pages = (0..known.len()).map(|channel| self.asset.page_in(cluster, channel, id));
        let pages = pages.collect::<Result<Vec<_>, _>>()?;
        let beside: Vec<_> = known.iter().zip(pages.iter().copied()).collect();
        let page = |new: &NewChannel| match new.from {
            Some(index) => Ok(Cow::Borrowed(pages[index])),
            None => {
                let (extent, value) = (self.asset.page_extent(0, id)?, self.value(&new.channel, id.group));
                new.channel.plain_page(extent, value, &beside).map(Cow::from)
            }
        };
        self.channels.iter().map(page).collect()
    }

    fn means(&self) -> Result<Means> {
        let known = &self.asset.directory().means;
        if self.is_copy() {
            return Ok(known.clone());
        }
        let mut values = Vec::new();
        for group in 0..self.asset.cover().groups.len() as u32 {
            for NewChannel { channel, from } in self.channels {
                values.push(match from {
                    Some(index) => known.get(*index, group),
                    None => {
                        // What its texels decode to.
                        let block = channel.plain_page([4, 4], self.value(channel, group), &[])?;
                        StoredTexels::decode(channel.format, [4, 4], &block)?.linear(0, channel.srgb)
                    }
                });
            }
        }
        Ok(Means::new(&values, &self.formats))
    }
}

/// The stored bytes of a section or attachment. Damage is copied, and reported when it is read.
fn read_stored(asset: &Asset, record: &SectionRecord) -> io::Result<Vec<u8>> {
    let mut stored = vec![0; record.stored_length as usize];
    asset.source().read_exact_at(&mut stored, record.offset)?;
    Ok(stored)
}
