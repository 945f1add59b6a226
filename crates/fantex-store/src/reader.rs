//! Reading assets.
//!
//! Pages are stored in *clusters*. A loader asks which cluster holds a page ([`Asset::cluster_of`]) and where it lies
//! ([`Asset::cluster_range`]), reads those bytes in whichever way it likes, and has them checked and unpacked
//! ([`Asset::unpack_cluster`]); then all pages of the cluster are at hand ([`Asset::page_in`]). [`Asset::read_page`] does all of it.

use std::cell::RefCell;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use fantex_base::{Error, ErrorKind, Place, Result, zstandard};
use fantex_cover::Cover;
use fantex_mesh::Mesh;
use xxhash_rust::xxh3::xxh3_64;

use crate::decode::StoredTexels;
use crate::directory::{self, Attachments, ClusterEntry, Directory};
use crate::error::{damaged, no_such_page};
use crate::header::{MESH_SECTION, SECTION_NAMES, SectionRecord, Sections, Slot, read_section, read_slot};
use crate::layout::{ClusterPages, PageSize, TilePlace};
use crate::{
    ByteSource, BytesSource, Channel, ChannelKind, PageId, TexelFormat, channel, cover_section, mesh_section,
    packing,
};

/// The attachment that is a coarse asset of the same model, to be shown until the asset itself is there.
pub const PREVIEW: &str = "preview";

/// What the first bytes of an asset tell.
#[derive(Clone, Debug, PartialEq)]
pub struct AssetHead {
    /// The channels.
    pub channels: Vec<Channel>,
    /// Whether there are attachments, among which a [preview](PREVIEW) may be.
    pub has_attachments: bool,
}

impl AssetHead {
    /// Reads and checks the header and the first section.
    ///
    /// # Errors
    /// They cannot be read or are damaged; the file is no asset.
    pub fn read(source: &dyn ByteSource) -> Result<Self> {
        let (slot, _) = read_slot(source)?;
        let channels = read_section(source, SECTION_NAMES[0], &slot.sections[0], slot.file_length)?;
        let content = |error: Error| content_error(source, SECTION_NAMES[0], &error);
        Ok(Self {
            channels: channel::decode_channels(&channels).map_err(content)?,
            has_attachments: slot.attachments != SectionRecord::default(),
        })
    }
}

/// Decoded texels of one page and channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Texels {
    /// Columns, rows.
    pub extent: [u32; 2],
    /// Row-major from v = 0, **linear** RGBA (sRGB decoded); normals as stored (0..1).
    pub rgba: Vec<[f32; 4]>,
}

/// An open asset. Shared by threads: all reads are positional.
#[derive(Debug)]
pub struct Asset {
    pub(crate) source: Arc<dyn ByteSource>,
    slot: Slot,
    mesh: Arc<Mesh>,
    cover: Arc<Cover>,
    channels: Vec<Channel>,
    pub(crate) formats: Vec<TexelFormat>,
    pub(crate) directory: Arc<Directory>,
    /// An error where their list is damaged; that does not keep anybody from reading texels.
    attachments: Result<Attachments>,
    damaged_headers: u32,
}

impl Asset {
    /// Opens and checks an asset in a file: header, mesh, cover, channels and directory. It stays as it is now, whatever is
    /// committed later: see [`AssetEditor`](crate::AssetEditor).
    ///
    /// # Errors
    /// The file cannot be read, is no asset, or is damaged.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open(path: &Path) -> Result<Self> {
        let file = crate::FileSource::open(path).map_err(|source| Error::reading(path, source))?;
        Self::open_source(Arc::new(file))
    }

    /// Opens and checks an asset, wherever its bytes are. Two reads, unless changes have put sections elsewhere.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_source(source: Arc<dyn ByteSource>) -> Result<Self> {
        let (slot, damaged_headers) = read_slot(&*source)?;
        let mut sections = Sections::read(&*source, &slot)?;
        let content = |section: usize| {
            let source = &*source;
            move |error: Error| content_error(source, SECTION_NAMES[section], &error)
        };
        let channels = channel::decode_channels(&sections.unpack(0)?).map_err(content(0))?;
        let mesh = sections.decode(MESH_SECTION, mesh_section::decode)?.map_err(content(MESH_SECTION))?;
        let cover = cover_section::decode(&sections.unpack(1)?, &mesh.triangles).map_err(content(1))?;
        let cover = Cover { hard_edges: slot.hard_edges, ..cover };
        let formats: Vec<_> = channels.iter().map(|channel| channel.format).collect();
        let expected = directory::Expected { cover: &cover, formats: &formats, places: slot.places() };
        let directory = directory::decode(&sections.unpack(3)?, &expected).map_err(content(3))?;
        drop(sections);
        let attachments = read_attachments(&*source, &slot);
        Ok(Self {
            source,
            slot,
            mesh: Arc::new(mesh),
            cover: Arc::new(cover),
            channels,
            formats,
            directory: Arc::new(directory),
            attachments,
            damaged_headers,
        })
    }

    /// Opens the [preview](PREVIEW) of an asset, which is an asset in memory; none where there is none. Of the asset itself only header, list of
    /// attachments and preview are read.
    ///
    /// # Errors
    /// One of these cannot be read or is damaged.
    pub fn open_preview(source: &dyn ByteSource) -> Result<Option<Self>> {
        let (slot, _) = read_slot(source)?;
        let attachments = read_attachments(source, &slot)?;
        let Some(record) = attachments.get(PREVIEW) else { return Ok(None) };
        let bytes = read_attachment(source, PREVIEW, record)?;
        let location = format!("the preview of {}", source.location().display());
        Self::open_source(Arc::new(BytesSource::new(location, bytes))).map(Some)
    }

    /// The asset as a commit leaves it.
    pub(crate) fn committed(&self, slot: Slot, directory: Arc<Directory>, attachments: Attachments) -> Self {
        Self {
            source: Arc::clone(&self.source),
            slot,
            mesh: Arc::clone(&self.mesh),
            cover: Arc::clone(&self.cover),
            channels: self.channels.clone(),
            formats: self.formats.clone(),
            directory,
            attachments: Ok(attachments),
            damaged_headers: 0,
        }
    }

    /// Number of the committed state, from 1 on; grows with every commit.
    pub fn generation(&self) -> u64 {
        self.slot.generation
    }

    /// Names of all attachments, ascending: data of other programs' parts (a painter's layers and history) that the
    /// texture function does not need.
    ///
    /// # Errors
    /// The list of attachments is damaged.
    pub fn attachment_names(&self) -> Result<Vec<&str>> {
        Ok(self.attachments()?.keys().map(String::as_str).collect())
    }

    /// Reads and checks an attachment; none where there is none of that name.
    ///
    /// # Errors
    /// It, or the list of attachments, cannot be read or is damaged.
    pub fn attachment(&self, name: &str) -> Result<Option<Vec<u8>>> {
        let record = self.attachments()?.get(name);
        record.map(|record| self.read_attachment(name, record)).transpose()
    }

    /// Bytes of an attachment, which is not read; none where there is none of that name.
    ///
    /// # Errors
    /// The list of attachments is damaged.
    pub fn attachment_bytes(&self, name: &str) -> Result<Option<u64>> {
        Ok(self.attachments()?.get(name).map(|record| record.raw_length))
    }

    pub(crate) fn attachments(&self) -> Result<&Attachments> {
        self.attachments.as_ref().map_err(Clone::clone)
    }

    pub(crate) fn read_attachment(&self, name: &str, record: &SectionRecord) -> Result<Vec<u8>> {
        read_attachment(&*self.source, name, record)
    }

    pub(crate) fn slot(&self) -> &Slot {
        &self.slot
    }

    pub(crate) fn directory(&self) -> &Arc<Directory> {
        &self.directory
    }

    pub(crate) fn formats(&self) -> &[TexelFormat] {
        &self.formats
    }

    /// The path or URL it was opened from.
    pub fn path(&self) -> &Path {
        self.source.location()
    }

    /// Where its bytes come from.
    pub fn source(&self) -> &Arc<dyn ByteSource> {
        &self.source
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.slot.file_length
    }

    /// Stored bytes of channels, mesh, cover and directory: what is read before any texel.
    pub fn head_bytes(&self) -> u64 {
        self.slot.sections.iter().map(|section| section.stored_length).sum()
    }

    /// The mesh; without images, and its materials without textures (they are baked).
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The cover.
    pub fn cover(&self) -> &Cover {
        &self.cover
    }

    /// The mesh, to be kept without keeping this generation of the texels.
    pub fn shared_mesh(&self) -> Arc<Mesh> {
        Arc::clone(&self.mesh)
    }

    /// The cover, to be kept without keeping this generation of the texels.
    pub fn shared_cover(&self) -> Arc<Cover> {
        Arc::clone(&self.cover)
    }

    /// The channels.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Index of the channel of a kind.
    pub fn channel_of_kind(&self, kind: ChannelKind) -> Option<usize> {
        self.channels().iter().position(|c| c.kind == kind)
    }

    /// Number of detail levels of the tile with the most.
    pub fn level_count(&self) -> u32 {
        self.directory.levels.len() as u32
    }

    /// Mean linear RGBA of a group, always resident. Panics where `channel` or `group` is out of range.
    pub fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.directory.means.get(channel, group)
    }

    /// Reads, checks and decodes one page. Not cached.
    ///
    /// # Errors
    /// There is no such page or channel, or its cluster cannot be read or is damaged.
    pub fn read_page(&self, channel: usize, page: PageId) -> Result<Texels> {
        self.decode_page_raw(channel, page, &self.read_page_raw(channel, page)?)
    }

    /// Decodes bytes that [`read_page_raw`](Self::read_page_raw) gave for a page.
    ///
    /// # Errors
    /// There is no such page or channel, or the bytes are not as many as it takes.
    pub fn decode_page_raw(&self, channel: usize, page: PageId, bytes: &[u8]) -> Result<Texels> {
        let extent = self.page_extent(channel, page)?;
        let texels = self.decode_page(channel, page, extent, bytes)?;
        let srgb = self.channels[channel].srgb;
        let count = extent[0] as usize * extent[1] as usize;
        Ok(Texels { extent, rgba: (0..count).map(|i| texels.linear(i, srgb)).collect() })
    }

    /// Reads and checks one page and returns its bytes in the channel's format. Not cached.
    ///
    /// # Errors
    /// As [`read_page`](Self::read_page).
    pub fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>> {
        self.page_extent(channel, page)?;
        let cluster = self.read_cluster(self.cluster_of(page)?)?;
        self.page_in(&cluster, channel, page).map(<[u8]>::to_vec)
    }

    pub(crate) fn damaged_headers(&self) -> u32 {
        self.damaged_headers
    }

    /// Columns and rows of a page in texels; an error where there is no such page or channel.
    ///
    /// # Errors
    /// There is no such page or channel.
    pub fn page_extent(&self, channel: usize, id: PageId) -> Result<[u32; 2]> {
        let group = self.cover.groups.get(id.group as usize).filter(|_| channel < self.channels.len());
        let size = group.map(|group| PageSize::new(group.extent, id.level));
        let extent = size.and_then(|size| Some(size.page_extent(size.number(id.page)?)));
        extent.ok_or_else(|| self.no_such_page(channel, id))
    }

    /// Bytes of a page in a channel's format.
    ///
    /// # Errors
    /// There is no such page or channel.
    pub fn page_bytes(&self, channel: usize, id: PageId) -> Result<usize> {
        let extent = self.page_extent(channel, id)?;
        Ok(self.formats[channel].bytes(extent))
    }

    pub(crate) fn decode_page(
        &self,
        channel: usize,
        id: PageId,
        extent: [u32; 2],
        bytes: &[u8],
    ) -> Result<StoredTexels> {
        StoredTexels::decode(self.formats[channel], extent, bytes).map_err(|_| self.no_such_page(channel, id))
    }

    /// The error of a page that it does not have.
    pub fn no_such_page(&self, channel: usize, page: PageId) -> Error {
        no_such_page(self.path(), channel, page)
    }
}

fn read_attachment(source: &dyn ByteSource, name: &str, record: &SectionRecord) -> Result<Vec<u8>> {
    read_section(source, "attachment", record, record.range().end).map_err(|error| {
        let path = source.location();
        let sentence = format!("attachment {name:?} of {} cannot be read: {error}", path.display());
        Error::new(error.kind(), sentence).with_path(path).with_source(error)
    })
}

pub(crate) fn read_attachments(source: &dyn ByteSource, slot: &Slot) -> Result<Attachments> {
    if slot.attachments == SectionRecord::default() {
        return Ok(Attachments::new());
    }
    let section = "attachment";
    let list = read_section(source, section, &slot.attachments, slot.file_length).and_then(|raw| {
        directory::decode_attachments(&raw, &slot.places())
            .map_err(|error| content_error(source, section, &error))
    });
    list.map_err(|error| {
        let path = source.location();
        let sentence =
            format!("the attachments of {} cannot be read; its texels can: {error}", path.display());
        Error::new(error.kind(), sentence).with_path(path).with_source(error)
    })
}

fn content_error(source: &dyn ByteSource, section: &str, rule: &Error) -> Error {
    let path = source.location();
    let sentence = format!("{} cannot be used: in its {section} section {rule}", path.display());
    Error::new(rule.kind(), sentence).with_path(path)
}

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
    ///
    /// # Errors
    /// There is no such page.
    pub fn cluster_of(&self, id: PageId) -> Result<ClusterId> {
        let index = self.directory.cluster_of(id.level, self.place_of(id)?);
        Ok(ClusterId { level: id.level, index: index as u32 })
    }

    pub(crate) fn place_of(&self, id: PageId) -> Result<TilePlace> {
        let group = self.cover.groups.get(id.group as usize).filter(|group| id.level < group.level_count());
        let number = group.and_then(|group| PageSize::new(group.extent, id.level).number(id.page));
        Ok(TilePlace { group: id.group, page: number.ok_or_else(|| self.no_such_page(0, id))? })
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
    ///
    /// # Errors
    /// The bytes do not match their checksum, or do not unpack to the pages.
    pub fn unpack_cluster(&self, cluster: ClusterId, stored: &[u8]) -> Result<ClusterPages> {
        self.unpack_entry(cluster.level, self.entry(cluster), stored)
    }

    fn unpack_entry(&self, level: u32, entry: &ClusterEntry, stored: &[u8]) -> Result<ClusterPages> {
        let error = |what: String| {
            let sentence = format!("the cluster at byte {} {what}", entry.offset);
            damaged(self.path(), sentence).with_place(Place::Byte(entry.offset))
        };
        if stored.len() != entry.stored_length as usize || xxh3_64(stored) != entry.checksum {
            return Err(error("has a wrong checksum".into()));
        }
        let natural = UNPACKER
            .with_borrow_mut(|unpacker| unpacker.unpack(&self.formats, stored, entry.raw_length as usize))
            .ok_or_else(|| error(format!("does not unpack to {} bytes", entry.raw_length)))?;
        let extents = |group: usize| self.cover().groups[group].extent;
        Ok(ClusterPages::new(natural, level, entry, &self.formats, extents))
    }

    /// A page's bytes in a channel's format, within the cluster that holds it.
    ///
    /// # Errors
    /// There is no such page or channel, or it lies in another cluster.
    pub fn page_in<'c>(&self, cluster: &'c ClusterPages, channel: usize, id: PageId) -> Result<&'c [u8]> {
        self.page_in_any([cluster], channel, id)
    }

    /// The same, in whichever of several clusters holds the page.
    ///
    /// # Errors
    /// There is no such page or channel, or it lies in none of them.
    pub fn page_in_any<'c>(
        &self,
        clusters: impl IntoIterator<Item = &'c ClusterPages>,
        channel: usize,
        id: PageId,
    ) -> Result<&'c [u8]> {
        self.page_extent(channel, id)?;
        let extent = self.cover().groups[id.group as usize].extent;
        let mut clusters = clusters.into_iter();
        let found = clusters.find_map(|cluster| cluster.page(&self.formats, channel, id, extent));
        found.ok_or_else(|| self.no_such_page(channel, id))
    }

    /// The error of bytes of a cluster that could not be read: [`io_cause`](crate::io_cause) of it is `source`.
    pub fn read_error(&self, bytes: &Range<u64>, source: Arc<std::io::Error>) -> Error {
        let (offset, length) = (bytes.start, bytes.end - bytes.start);
        let path = self.path();
        let sentence = format!("cannot read {length} bytes at byte {offset} of {}: {source}", path.display());
        let error = Error::new(ErrorKind::Io, sentence).with_path(path).with_place(Place::Byte(offset));
        error.with_source(source)
    }

    /// Reads, checks and unpacks a cluster.
    pub(crate) fn read_cluster(&self, cluster: ClusterId) -> Result<ClusterPages> {
        self.read_entry(cluster.level, self.entry(cluster))
    }

    /// Reads, checks and unpacks the cluster of an entry, which may be of a later generation.
    pub(crate) fn read_entry(&self, level: u32, entry: &ClusterEntry) -> Result<ClusterPages> {
        let mut stored = vec![0; entry.stored_length as usize];
        self.source
            .read_exact_at(&mut stored, entry.offset)
            .map_err(|source| self.read_error(&entry.range(), Arc::new(source)))?;
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

thread_local! {
    static UNPACKER: RefCell<Unpacker> = RefCell::default();
}

/// A longer buffer is not kept for the next cluster: few clusters are.
const MAX_KEPT_BYTES: usize = 1 << 20;

/// What a thread keeps between clusters, so that it needn't be set up for each.
#[derive(Default)]
struct Unpacker {
    zstd: zstandard::Unpacker,
    raw: Vec<u8>,
}

impl Unpacker {
    /// A cluster's bytes in their natural order, or none if they are not as many.
    fn unpack(&mut self, formats: &[TexelFormat], stored: &[u8], length: usize) -> Option<Vec<u8>> {
        // What is here already is overwritten.
        self.raw.resize(length, 0);
        let unpacked = self.zstd.unpack(stored, &mut self.raw);
        let natural = (unpacked == Some(length)).then(|| unarranged(formats, &self.raw));
        if length > MAX_KEPT_BYTES {
            self.raw = Vec::new();
        }
        natural
    }
}

/// The inverse of what `OpenCluster::pack` does to channels.
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
    use crate::writer::OpenCluster;

    #[test]
    fn an_unpacker_survives_damaged_clusters_and_long_ones() {
        let formats = [TexelFormat::Bc7, TexelFormat::Rgba8];
        let mut unpacker = Unpacker::default();
        for blocks in [3, 20_000, 7, 100] {
            let channels = formats.map(|format| {
                (0..blocks * format.block_bytes()).map(|i| (i / 16 * 3 + i % 5) as u8).collect::<Vec<u8>>()
            });
            let natural = channels.concat();
            let mut cluster = OpenCluster::empty(2);
            cluster.add(TilePlace { group: 0, page: 0 }, &channels, usize::MAX);
            let stored = cluster.pack(&formats, 1).unwrap().stored;
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len()).as_ref(), Some(&natural));
            assert_eq!(unpacker.unpack(&formats, &stored[..stored.len() - 1], natural.len()), None);
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len() - 80), None);
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len() + 80), None);
            assert_eq!(unpacker.unpack(&formats, b"no zstd frame", natural.len()), None);
            assert_eq!(unpacker.unpack(&formats, &stored, natural.len()), Some(natural));
            assert!(unpacker.raw.capacity() <= MAX_KEPT_BYTES);
        }
    }
}
