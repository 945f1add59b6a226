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
    /// Bytes that decoded tiles and texels in work may take while it is made.
    pub memory_bytes: u64,
}

impl Default for PreviewOptions {
    /// 5000 triangles and 100 000 texels: some 200 to 700 kB. 512 MiB.
    fn default() -> Self {
        Self { triangles: 5000, texels: 100_000, memory_bytes: 512 << 20 }
    }
}

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
        let half = options.memory_bytes / 2;
        let cache_bytes = usize::try_from(half).unwrap_or(usize::MAX);
        let detail = AssetSource::new(&PageCache::new(Arc::clone(asset), cache_bytes));
        let source = TransferSource::new(&coarse, asset.mesh(), Some(&detail), &TransferOptions::default())?;
        let budget = TexelBudget::Total(options.texels);
        let (cover, _) = build_cover(&coarse, &CoverOptions { budget, ..CoverOptions::default() })?;
        let folder = tempfile::tempdir().map_err(|error| Error::writing(std::env::temp_dir(), error))?;
        let path = folder.path().join("preview.fan");
        let bake_options = BakeOptions { memory_bytes: half, ..BakeOptions::default() };
        let baked = bake(&coarse, &cover, &source, &path, &bake_options, &NoProgress)?;
        let bytes = std::fs::read(&path).map_err(|error| Error::reading(&path, error))?;
        Ok(Self { bytes, triangles: coarse.triangles.len() as u64, texels: baked.texels })
    }

    /// Makes the preview of an asset and puts it there, in the place of one that it has. Nobody else can change the asset meanwhile.
    ///
    /// # Errors
    /// As [`of`](Self::of); the asset cannot be changed: somebody else does, or the disk is full.
    pub fn add_to(path: &Path, options: &PreviewOptions) -> Result<Self> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        let preview = Self::of(editor.asset(), options)?;
        editor.attach(PREVIEW, preview.bytes.clone())?;
        editor.commit()?;
        Ok(preview)
    }

    /// Takes the preview out of an asset; false where there is none.
    ///
    /// # Errors
    /// The asset cannot be changed: somebody else does, or the disk is full.
    pub fn remove_from(path: &Path) -> Result<bool> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        let is_there = editor.has_attachment(PREVIEW);
        editor.detach(PREVIEW);
        editor.commit()?;
        Ok(is_there)
    }
}
