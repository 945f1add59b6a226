//! Reading assets.

use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_cover::Cover;
use fantex_mesh::Mesh;
use xxhash_rust::xxh3::xxh3_64;

use crate::codec::StoredTexels;
use crate::edit::lock;
use crate::header::{
    HEADER_BYTES, SECTION_NAMES, SIGNATURE, SLOT_BYTES, SLOT_OFFSETS, SectionRecord, Slot, VERSION,
};
use crate::layout::{ClusterPages, PageSize, TilePlace};
use crate::limits::{MAX_SECTION_RATIO, MAX_WINDOW_LOG, SECTION_RATIO_FREE};
use crate::section::attachments::{self, Attachments};
use crate::section::directory::{self, ClusterEntry, Directory};
use crate::section::{channels, cover as cover_section, mesh as mesh_section};
use crate::{
    AttachmentError, Channel, ChannelKind, ContentError, OpenError, PageError, PageId, TexelFormat,
    cover_level_count, packing,
};

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
    path: PathBuf,
    /// Shared with the later generations that an editor makes, which see the same file.
    file: Arc<File>,
    slot: Slot,
    mesh: Arc<Mesh>,
    cover: Arc<Cover>,
    channels: Vec<Channel>,
    formats: Vec<TexelFormat>,
    directory: Arc<Directory>,
    /// An error where their list is damaged; that does not keep anybody from reading texels.
    attachments: Result<Attachments, AttachmentError>,
    damaged_headers: u32,
}

impl Asset {
    /// Opens and checks an asset: header, mesh, cover, channels and directory. It stays as it is now, whatever is committed
    /// later: see [`AssetEditor`](crate::AssetEditor).
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let file = File::open(path).map_err(|source| io_error(path, source))?;
        Self::from_file(path, Arc::new(file))
    }

    /// The asset that an open file holds.
    pub(crate) fn from_file(path: &Path, file: Arc<File>) -> Result<Self, OpenError> {
        // Before the header is read: what it names must not be overwritten from here on.
        lock::keep_generation(&file);
        let (slot, damaged_headers) = read_slot(path, &file)?;
        let [channel_record, cover_record, mesh_record, directory_record] = slot.sections;
        let read = |index: usize, record: SectionRecord| {
            read_section(path, &file, SECTION_NAMES[index], record, slot.file_length)
        };
        let content = |section: usize| {
            move |source: ContentError| OpenError::Content {
                path: path.to_owned(),
                section: SECTION_NAMES[section],
                source,
            }
        };
        let channels = channels::decode(&read(0, channel_record)?).map_err(content(0))?;
        let mesh = mesh_section::decode(&read(2, mesh_record)?).map_err(content(2))?;
        let cover =
            cover_section::decode(&read(1, cover_record)?, mesh.triangles.len()).map_err(content(1))?;
        let formats: Vec<_> = channels.iter().map(|channel| channel.format).collect();
        let expected = directory::Expected {
            extents: &|group| cover.groups[group].extent,
            groups: cover.groups.len(),
            levels: cover_level_count(&cover),
            formats: &formats,
            clusters: HEADER_BYTES..slot.file_length,
        };
        let directory = directory::decode(&read(3, directory_record)?, &expected).map_err(content(3))?;
        let attachments = read_attachments(path, &file, &slot);
        Ok(Self {
            path: path.to_owned(),
            file,
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

    /// The asset as a commit leaves it.
    pub(crate) fn committed(&self, slot: Slot, directory: Arc<Directory>, attachments: Attachments) -> Self {
        Self {
            path: self.path.clone(),
            file: Arc::clone(&self.file),
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
    pub fn attachment_names(&self) -> Result<Vec<&str>, AttachmentError> {
        Ok(self.attachments()?.keys().map(String::as_str).collect())
    }

    /// Reads and checks an attachment; none where there is none of that name.
    pub fn attachment(&self, name: &str) -> Result<Option<Vec<u8>>, AttachmentError> {
        let record = self.attachments()?.get(name);
        record.map(|record| self.read_attachment(name, record)).transpose()
    }

    pub(crate) fn attachments(&self) -> Result<&Attachments, AttachmentError> {
        self.attachments.as_ref().map_err(Clone::clone)
    }

    pub(crate) fn read_attachment(
        &self,
        name: &str,
        record: &SectionRecord,
    ) -> Result<Vec<u8>, AttachmentError> {
        read_section(&self.path, &self.file, "attachment", *record, record.range().end).map_err(|source| {
            AttachmentError::Damaged {
                path: self.path.clone(),
                name: name.to_owned(),
                source: Arc::new(source),
            }
        })
    }

    pub(crate) fn slot(&self) -> &Slot {
        &self.slot
    }

    pub(crate) fn file(&self) -> &Arc<File> {
        &self.file
    }

    pub(crate) fn directory(&self) -> &Arc<Directory> {
        &self.directory
    }

    pub(crate) fn formats(&self) -> &[TexelFormat] {
        &self.formats
    }

    /// The path it was opened from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.slot.file_length
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
    pub fn read_page(&self, channel: usize, page: PageId) -> Result<Texels, PageError> {
        self.decode_page_raw(channel, page, &self.read_page_raw(channel, page)?)
    }

    /// Decodes bytes that [`read_page_raw`](Self::read_page_raw) gave for a page.
    pub fn decode_page_raw(&self, channel: usize, page: PageId, bytes: &[u8]) -> Result<Texels, PageError> {
        let extent = self.page_extent(channel, page)?;
        let texels = self.decode_page(channel, page, extent, bytes)?;
        let srgb = self.channels[channel].srgb;
        let count = extent[0] as usize * extent[1] as usize;
        Ok(Texels { extent, rgba: (0..count).map(|i| texels.linear(i, srgb)).collect() })
    }

    /// Reads and checks one page and returns its bytes in the channel's format. Not cached.
    pub fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>, PageError> {
        self.page_extent(channel, page)?;
        let cluster = self.read_cluster(page.level, self.cluster_of(page)?)?;
        self.page_in(&cluster, channel, page).map(<[u8]>::to_vec)
    }

    /// The byte ranges of a level's clusters in the file, in page order. Empty beyond the last level.
    pub fn cluster_ranges(&self, level: u32) -> Vec<Range<u64>> {
        let clusters = self.directory.levels.get(level as usize).map_or(&[][..], Vec::as_slice);
        clusters.iter().map(ClusterEntry::range).collect()
    }

    pub(crate) fn damaged_headers(&self) -> u32 {
        self.damaged_headers
    }

    /// Number of clusters of a level.
    pub(crate) fn cluster_count(&self, level: u32) -> usize {
        self.directory.levels[level as usize].len()
    }

    /// The groups whose tiles may have pages in a cluster, given by its index within its level.
    pub(crate) fn groups_in_cluster(&self, level: u32, index: usize) -> Range<u32> {
        let clusters = &self.directory.levels[level as usize];
        let end = match clusters.get(index + 1) {
            // The next one starts within the last group's tile, or with the tile after it.
            Some(next) => next.first.group + u32::from(next.first.page > 0),
            None => self.cover.groups.len() as u32,
        };
        clusters[index].first.group..end
    }

    /// Extent of a page in texels; an error where there is no such page or channel.
    pub(crate) fn page_extent(&self, channel: usize, id: PageId) -> Result<[u32; 2], PageError> {
        let group = self.cover.groups.get(id.group as usize).filter(|_| channel < self.channels.len());
        let size = group.map(|group| PageSize::new(group.extent, id.level));
        let extent = size.and_then(|size| Some(size.page_extent(size.number(id.page)?)));
        extent.ok_or_else(|| self.no_such_page(channel, id))
    }

    /// Index, within its level, of the cluster that holds a page.
    pub(crate) fn cluster_of(&self, id: PageId) -> Result<usize, PageError> {
        let missing = || self.no_such_page(0, id);
        let clusters = self.directory.levels.get(id.level as usize).ok_or_else(missing)?;
        let group = self.cover.groups.get(id.group as usize).ok_or_else(missing)?;
        let number = PageSize::new(group.extent, id.level).number(id.page).ok_or_else(missing)?;
        let place = TilePlace { group: id.group, page: number };
        clusters.partition_point(|cluster| cluster.first <= place).checked_sub(1).ok_or_else(missing)
    }

    /// Reads, checks and unpacks a cluster, given by its index within its level.
    pub(crate) fn read_cluster(&self, level: u32, index: usize) -> Result<ClusterPages, PageError> {
        self.read_entry(level, &self.directory.levels[level as usize][index])
    }

    /// Reads, checks and unpacks the cluster of an entry, which may be of a later generation.
    pub(crate) fn read_entry(&self, level: u32, entry: &ClusterEntry) -> Result<ClusterPages, PageError> {
        let stored = self.read_stored(entry)?;
        let packing_error = || PageError::Packing {
            path: self.path.clone(),
            offset: entry.offset,
            expected: u64::from(entry.raw_length),
        };
        let raw = zstd::bulk::decompress(&stored, entry.raw_length as usize).map_err(|_| packing_error())?;
        if raw.len() != entry.raw_length as usize {
            return Err(packing_error());
        }
        let extents = |group: usize| self.cover.groups[group].extent;
        Ok(ClusterPages::new(self.unarranged(&raw), level, entry, &self.formats, extents))
    }

    /// Inverse of the writer's arrangement.
    fn unarranged(&self, raw: &[u8]) -> Vec<u8> {
        let block_bytes: usize = self.formats.iter().map(|f| f.block_bytes()).sum();
        let blocks = raw.len() / block_bytes;
        let mut natural = vec![0; raw.len()];
        let mut from = 0;
        for &format in &self.formats {
            let to = from + blocks * format.block_bytes();
            packing::unpack(format, &raw[from..to], &mut natural[from..to]);
            from = to;
        }
        natural
    }

    fn read_stored(&self, entry: &ClusterEntry) -> Result<Vec<u8>, PageError> {
        let mut stored = vec![0; entry.stored_length as usize];
        read_exact_at(&self.file, &mut stored, entry.offset).map_err(|source| PageError::Io {
            path: self.path.clone(),
            offset: entry.offset,
            length: u64::from(entry.stored_length),
            source: Arc::new(source),
        })?;
        if xxh3_64(&stored) != entry.checksum {
            return Err(PageError::Checksum { path: self.path.clone(), offset: entry.offset });
        }
        Ok(stored)
    }

    /// A page's bytes within its cluster.
    pub(crate) fn page_in<'c>(
        &self,
        cluster: &'c ClusterPages,
        channel: usize,
        id: PageId,
    ) -> Result<&'c [u8], PageError> {
        let extent = self.cover.groups[id.group as usize].extent;
        cluster.page(&self.formats, channel, id, extent).ok_or_else(|| self.no_such_page(channel, id))
    }

    /// Decodes a page's bytes.
    pub(crate) fn decode_page(
        &self,
        channel: usize,
        id: PageId,
        extent: [u32; 2],
        bytes: &[u8],
    ) -> Result<StoredTexels, PageError> {
        StoredTexels::decode(self.formats[channel], extent, bytes).map_err(|_| self.no_such_page(channel, id))
    }

    fn no_such_page(&self, channel: usize, page: PageId) -> PageError {
        PageError::NoSuchPage { path: self.path.clone(), channel, page }
    }
}

/// The valid header slot with the greatest generation, and the number of damaged ones.
fn read_slot(path: &Path, file: &File) -> Result<(Slot, u32), OpenError> {
    let length = file.metadata().map_err(|source| io_error(path, source))?.len();
    let mut slots = [[0; SLOT_BYTES]; 2];
    for (bytes, offset) in slots.iter_mut().zip(SLOT_OFFSETS) {
        if offset + SLOT_BYTES as u64 <= length {
            read_exact_at(file, bytes, offset).map_err(|source| io_error(path, source))?;
        }
    }
    let valid = slots.iter().filter_map(Slot::decode);
    let damaged = 2 - valid.clone().count() as u32;
    let Some(slot) = valid.max_by_key(|slot| slot.generation) else {
        let path = path.to_owned();
        let has_signature = slots.iter().any(|slot| slot[..8] == SIGNATURE);
        return Err(if has_signature { OpenError::Header { path } } else { OpenError::NotAnAsset { path } });
    };
    let path = path.to_owned();
    if slot.version != VERSION || slot.flags != 0 {
        let (version, flags, supported) = (slot.version, slot.flags, VERSION);
        return Err(OpenError::Version { path, version, flags, supported });
    }
    if length < slot.file_length {
        return Err(OpenError::Truncated { path, length, expected: slot.file_length });
    }
    Ok((slot, damaged))
}

/// The slot that does not count, where it is whole.
pub(crate) fn read_other_slot(file: &File, current: &Slot) -> (usize, Option<Slot>) {
    let mut slots = [[0; SLOT_BYTES]; 2];
    for (bytes, offset) in slots.iter_mut().zip(SLOT_OFFSETS) {
        // A slot that cannot be read is as good as none.
        if read_exact_at(file, bytes, offset).is_err() {
            bytes.fill(0);
        }
    }
    let [first, second] = slots.each_ref().map(Slot::decode);
    if first.as_ref() == Some(current) { (1, second) } else { (0, first) }
}

fn read_attachments(path: &Path, file: &File, slot: &Slot) -> Result<Attachments, AttachmentError> {
    if slot.attachments == SectionRecord::default() {
        return Ok(Attachments::new());
    }
    let section = "attachment";
    let list =
        read_section(path, file, section, slot.attachments, slot.file_length).and_then(|raw| {
            attachments::decode(&raw, &(HEADER_BYTES..slot.file_length))
                .map_err(|source| OpenError::Content { path: path.to_owned(), section, source })
        });
    list.map_err(|source| AttachmentError::List { path: path.to_owned(), source: Arc::new(source) })
}

/// Reads, checks and unpacks a section. Memory grows with what is really there, not with what is claimed.
pub(crate) fn read_section(
    path: &Path,
    file: &File,
    section: &'static str,
    record: SectionRecord,
    file_length: u64,
) -> Result<Vec<u8>, OpenError> {
    let SectionRecord { offset, stored_length, raw_length, checksum } = record;
    let end = record.range().end;
    if offset < HEADER_BYTES || end > file_length {
        return Err(OpenError::SectionPlace { path: path.to_owned(), section, offset, end });
    }
    let packing_error = || OpenError::SectionPacking { path: path.to_owned(), section, expected: raw_length };
    if raw_length > SECTION_RATIO_FREE.saturating_add(stored_length.saturating_mul(MAX_SECTION_RATIO)) {
        return Err(packing_error());
    }
    let mut stored = vec![0; stored_length as usize];
    read_exact_at(file, &mut stored, offset).map_err(|source| io_error(path, source))?;
    if xxh3_64(&stored) != checksum {
        return Err(OpenError::SectionChecksum { path: path.to_owned(), section });
    }
    let unpacked = zstd::Decoder::new(stored.as_slice()).and_then(|mut decoder| {
        decoder.window_log_max(MAX_WINDOW_LOG)?;
        let mut raw = Vec::new();
        decoder.take(raw_length + 1).read_to_end(&mut raw)?;
        Ok(raw)
    });
    match unpacked {
        Ok(raw) if raw.len() as u64 == raw_length => Ok(raw),
        _ => Err(packing_error()),
    }
}

fn io_error(path: &Path, source: std::io::Error) -> OpenError {
    OpenError::Io { path: path.to_owned(), source }
}

#[cfg(unix)]
pub(crate) fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
pub(crate) fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            count => {
                bytes = &mut bytes[count..];
                offset += count as u64;
            }
        }
    }
    Ok(())
}
