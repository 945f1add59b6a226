//! Previews: small assets inside assets, which viewers far away show until the rest is there.
//!
//! A preview is a whole asset, of a coarse mesh that has been given the look and the normals of the fine one, so whatever shows assets
//! shows it. It is the attachment [`PREVIEW`](fantex_store::PREVIEW).

use std::path::Path;
use std::sync::Arc;

use fantex_bake::{AssetSource, BakeOptions, NoProgress, TransferOptions, TransferSource, bake};
use fantex_base::{Error, Result};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{CleanOptions, clean, simplified};
use fantex_store::{AssetEditor, EditOptions, PREVIEW, PageCache};

/// How large a preview is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PreviewOptions {
    /// Triangles, about.
    pub triangles: usize,
    /// Stored texels at level 0, per channel.
    pub texels: u64,
}

impl Default for PreviewOptions {
    /// 5000 triangles and 100 000 texels: some 200 to 700 kB.
    fn default() -> Self {
        Self { triangles: 5000, texels: 100_000 }
    }
}

/// Bytes of decoded pages while a preview is made.
const CACHE_BYTES: usize = 256 << 20;

/// A preview.
#[derive(Clone, Debug)]
pub struct Preview {
    /// The `.fan` file that it is.
    pub bytes: Vec<u8>,
    /// Triangles.
    pub triangles: u64,
    /// Stored texels at level 0, per channel.
    pub texels: u64,
}

impl Preview {
    /// Makes the preview of an asset.
    ///
    /// # Errors
    /// Nothing is left of its mesh at so few triangles; too few texels; there is no room for a temporary file of the preview's size.
    pub fn of(asset: &Arc<fantex_store::Asset>, options: &PreviewOptions) -> Result<Self> {
        let (coarse, _) = clean(simplified(asset.mesh(), options.triangles)?, &CleanOptions::default())?;
        let detail = AssetSource::new(&PageCache::new(Arc::clone(asset), CACHE_BYTES));
        let source = TransferSource::new(&coarse, asset.mesh(), Some(&detail), &TransferOptions::default())?;
        let budget = TexelBudget::Total(options.texels);
        let (cover, _) = build_cover(&coarse, &CoverOptions { budget, ..CoverOptions::default() })?;
        let folder = tempfile::tempdir().map_err(|error| Error::writing(std::env::temp_dir(), error))?;
        let path = folder.path().join("preview.fan");
        let baked = bake(&coarse, &cover, &source, &path, &BakeOptions::default(), &NoProgress)?;
        let bytes = std::fs::read(&path).map_err(|error| Error::reading(&path, error))?;
        Ok(Self { bytes, triangles: coarse.triangles.len() as u64, texels: baked.texels })
    }

    /// Puts it into an asset, in the place of one that is there.
    ///
    /// # Errors
    /// The asset cannot be changed: somebody else does, or the disk is full.
    pub fn attach_to(self, path: &Path) -> Result<()> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        editor.attach(PREVIEW, self.bytes)?;
        editor.commit().map(drop)
    }

    /// Takes the preview out of an asset; false where there is none.
    ///
    /// # Errors
    /// As [`attach_to`](Self::attach_to).
    pub fn remove_from(path: &Path) -> Result<bool> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        let is_there = editor.has_attachment(PREVIEW);
        editor.detach(PREVIEW);
        editor.commit()?;
        Ok(is_there)
    }
}
