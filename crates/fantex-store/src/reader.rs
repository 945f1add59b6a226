//! Reading assets.

use std::path::Path;
use std::sync::Arc;

use fantex_cover::Cover;
use fantex_mesh::Mesh;

use crate::codec::StoredTexels;
use crate::header::{HEADER_BYTES, SECTION_NAMES, SectionRecord, Slot};
use crate::layout::PageSize;
use crate::open::{Sections, io_error, read_section, read_slot};
use crate::section::attachments::{self, Attachments};
use crate::section::directory::{self, Directory};
use crate::section::{channels, cover as cover_section, mesh as mesh_section};
use crate::{
    AttachmentError, ByteSource, Channel, ChannelKind, ContentError, FileSource, OpenError, PageError,
    PageId, TexelFormat, cover_level_count,
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
    pub(crate) source: Arc<dyn ByteSource>,
    slot: Slot,
    mesh: Arc<Mesh>,
    cover: Arc<Cover>,
    channels: Vec<Channel>,
    pub(crate) formats: Vec<TexelFormat>,
    pub(crate) directory: Arc<Directory>,
    /// An error where their list is damaged; that does not keep anybody from reading texels.
    attachments: Result<Attachments, AttachmentError>,
    damaged_headers: u32,
}

impl Asset {
    /// Opens and checks an asset in a file: header, mesh, cover, channels and directory. It stays as it is now, whatever is
    /// committed later: see [`AssetEditor`](crate::AssetEditor).
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let file = FileSource::open(path).map_err(|source| io_error(path, source))?;
        Self::open_source(Arc::new(file))
    }

    /// Opens and checks an asset, wherever its bytes are. Two reads, unless sections were appended to it.
    pub fn open_source(source: Arc<dyn ByteSource>) -> Result<Self, OpenError> {
        let (slot, damaged_headers) = read_slot(&*source)?;
        let sections = Sections::read(&*source, &slot)?;
        let content = |section: usize| {
            let path = source.location().to_owned();
            move |source: ContentError| OpenError::Content { path, section: SECTION_NAMES[section], source }
        };
        let channels = channels::decode(&sections.unpack(0)?).map_err(content(0))?;
        let mesh = mesh_section::decode(&sections.unpack(2)?).map_err(content(2))?;
        let cover = cover_section::decode(&sections.unpack(1)?, mesh.triangles.len()).map_err(content(1))?;
        let formats: Vec<_> = channels.iter().map(|channel| channel.format).collect();
        let expected = directory::Expected {
            extents: &|group| cover.groups[group].extent,
            groups: cover.groups.len(),
            levels: cover_level_count(&cover),
            formats: &formats,
            clusters: HEADER_BYTES..slot.file_length,
        };
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
        read_section(&*self.source, "attachment", record, record.range().end).map_err(|source| {
            AttachmentError::Damaged {
                path: self.path().to_owned(),
                name: name.to_owned(),
                source: Arc::new(source),
            }
        })
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
        let cluster = self.read_cluster(self.cluster_of(page)?)?;
        self.page_in(&cluster, channel, page).map(<[u8]>::to_vec)
    }

    pub(crate) fn damaged_headers(&self) -> u32 {
        self.damaged_headers
    }

    /// Columns and rows of a page in texels; an error where there is no such page or channel.
    pub fn page_extent(&self, channel: usize, id: PageId) -> Result<[u32; 2], PageError> {
        let group = self.cover.groups.get(id.group as usize).filter(|_| channel < self.channels.len());
        let size = group.map(|group| PageSize::new(group.extent, id.level));
        let extent = size.and_then(|size| Some(size.page_extent(size.number(id.page)?)));
        extent.ok_or_else(|| self.no_such_page(channel, id))
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

    pub(crate) fn no_such_page(&self, channel: usize, page: PageId) -> PageError {
        PageError::NoSuchPage { path: self.path().to_owned(), channel, page }
    }
}

fn read_attachments(source: &dyn ByteSource, slot: &Slot) -> Result<Attachments, AttachmentError> {
    if slot.attachments == SectionRecord::default() {
        return Ok(Attachments::new());
    }
    let section = "attachment";
    let list = read_section(source, section, &slot.attachments, slot.file_length).and_then(|raw| {
        attachments::decode(&raw, &(HEADER_BYTES..slot.file_length)).map_err(|error| OpenError::Content {
            path: source.location().to_owned(),
            section,
            source: error,
        })
    });
    list.map_err(|error| AttachmentError::List {
        path: source.location().to_owned(),
        source: Arc::new(error),
    })
}
