//! Reading assets.

use std::path::Path;

use fantex_cover::Cover;
use fantex_mesh::Mesh;

use crate::Channel;

/// A failed operation on an asset. (To be split by who can act.)
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {}

/// The name of one stored rectangle of texels: a tile at a level, or, where that is larger than [`PAGE`] texels, one of
/// the pages it is cut into (row-major).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PageId {
    /// Group index.
    pub group: u32,
    /// Detail level, 0 = finest.
    pub level: u32,
    /// Page column and row; `[0, 0]` for most tiles.
    pub page: [u32; 2],
}

/// Longest side of a page in texels.
pub const PAGE: u32 = 256;

/// Decoded texels of one page and channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Texels {
    /// Columns, rows.
    pub extent: [u32; 2],
    /// Row-major from v = 0, **linear** RGBA (sRGB decoded); normals as stored (0..1).
    pub rgba: Vec<[f32; 4]>,
}

/// An open asset. Shared by threads.
#[derive(Debug)]
pub struct Asset {}

impl Asset {
    /// Opens and checks an asset: header, mesh, cover, channels and directory.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let _ = path;
        todo!()
    }

    /// The mesh.
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

    /// Mean linear RGBA of a group, always resident.
    pub fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        let _ = (channel, group);
        todo!()
    }

    /// Reads, checks and decodes one page. Not cached.
    pub fn read_page(&self, channel: usize, page: PageId) -> Result<Texels, StoreError> {
        let _ = (channel, page);
        todo!()
    }
}
