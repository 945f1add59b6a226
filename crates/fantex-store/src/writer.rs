//! Writing assets.

use std::path::Path;

use fantex_cover::Cover;
use fantex_mesh::Mesh;

use crate::{Channel, CreateError, PageId};

/// How to write an asset.
#[derive(Clone, Debug)]
pub struct CreateOptions {
    /// Overwrite an existing file.
    pub force: bool,
    /// zstd level of the clusters, 1..=19.
    pub zstd_level: i32,
}

impl Default for CreateOptions {
    /// No overwriting, zstd level 1.
    fn default() -> Self {
        Self { force: false, zstd_level: 1 }
    }
}

/// One page of all channels, encoded.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedPage {
    /// Which.
    pub id: PageId,
    /// Bytes of [`encode`](crate::encode) per channel, in the asset's channel order.
    pub channels: Vec<Vec<u8>>,
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteSummary {
    /// Length of the file.
    pub bytes: u64,
    /// Of that, clusters (texels of all levels, packed, without alignment).
    pub cluster_bytes: u64,
    /// Texel bytes before packing (block format, all levels and channels).
    pub unpacked_texel_bytes: u64,
    /// Number of clusters.
    pub clusters: usize,
    /// Number of pages.
    pub pages: u64,
}

/// Writes one asset: a temporary file in the target's folder, renamed by [`finish`](Self::finish). Dropping the writer
/// before that removes the temporary file.
#[derive(Debug)]
pub struct AssetWriter {}

impl AssetWriter {
    /// Checks the contents, creates the temporary file and writes mesh, cover and channels.
    pub fn create(
        path: &Path,
        options: &CreateOptions,
        mesh: &Mesh,
        cover: &Cover,
        channels: &[Channel],
    ) -> Result<Self, CreateError> {
        let _ = (path, options, mesh, cover, channels);
        todo!()
    }

    /// Adds pages: groups ascending, all pages of a group together as [`group_pages`](crate::group_pages) lists them (a
    /// batch may end within a group). Packs the clusters that this fills on the current rayon pool; the file's bytes depend
    /// neither on the threads nor on how pages are split into batches.
    pub fn write_pages(&mut self, batch: Vec<EncodedPage>) -> Result<(), CreateError> {
        let _ = batch;
        todo!()
    }

    /// Writes what is left, makes the file durable and gives it its name. `means`: **linear** RGBA (normals as stored) per
    /// group and channel, `means[group * channels + channel]`.
    pub fn finish(self, means: &[[f32; 4]]) -> Result<WriteSummary, CreateError> {
        let _ = means;
        todo!()
    }
}
