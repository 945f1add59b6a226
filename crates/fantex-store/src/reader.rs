//! Reading assets.

use std::path::Path;

use fantex_cover::Cover;
use fantex_mesh::Mesh;

use crate::{Channel, ChannelKind, OpenError, PageError, PageId};

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
pub struct Asset {}

impl Asset {
    /// Opens and checks an asset: header, mesh, cover, channels and directory.
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let _ = path;
        todo!()
    }

    /// The path it was opened from.
    pub fn path(&self) -> &Path {
        todo!()
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        todo!()
    }

    /// The mesh; without images, and its materials without textures (they are baked).
    pub fn mesh(&self) -> &Mesh {
        todo!()
    }

    /// The cover.
    pub fn cover(&self) -> &Cover {
        todo!()
    }

    /// The channels.
    pub fn channels(&self) -> &[Channel] {
        todo!()
    }

    /// Index of the channel of a kind.
    pub fn channel_of_kind(&self, kind: ChannelKind) -> Option<usize> {
        self.channels().iter().position(|c| c.kind == kind)
    }

    /// Number of detail levels of the tile with the most.
    pub fn level_count(&self) -> u32 {
        todo!()
    }

    /// Mean linear RGBA of a group, always resident.
    pub fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        let _ = (channel, group);
        todo!()
    }

    /// Reads, checks and decodes one page. Not cached.
    pub fn read_page(&self, channel: usize, page: PageId) -> Result<Texels, PageError> {
        let _ = (channel, page);
        todo!()
    }

    /// Reads and checks one page and returns its bytes in the channel's format. Not cached.
    pub fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>, PageError> {
        let _ = (channel, page);
        todo!()
    }
}
