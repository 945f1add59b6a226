//! Models with ordinary texture coordinates instead of assets.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fantex_bake::BakeSummary;
use fantex_base::files::{folder_of, temporary_folder};
use fantex_base::{Error, Result};
use fantex_cover::{CoverStats, TexelBudget};
use fantex_export::{ExportOptions, ExportSummary, export_model, export_source};
use fantex_mesh::AlphaMode;
use fantex_store::Asset;
use fantex_texture::material::LeftOut;

use super::own_materials::OwnDensity;
use super::{Baked, Baker, Goal, budget_texels};

/// The surface has about this share of a picture's texels.
const SURFACE_SHARE: f64 = 0.5;

/// Whether a source gives what only tiles can be made of: light, which is denoised there, and shares of texels that are there, which become
/// numbers to be compared with a threshold.
pub(super) fn needs_tiles(mesh: &fantex_mesh::Mesh, source: &dyn fantex_bake::Source) -> bool {
    let is_cut_out = |m: &fantex_mesh::Material| matches!(m.alpha, AlphaMode::Mask(_));
    source.light_map().is_some() || source.has_shares() && mesh.materials.iter().any(is_cut_out)
}

impl Baker<'_> {
    /// Writes a model with pictures of the source.
    pub(super) fn model(
        &self,
        mesh: &fantex_mesh::Mesh,
        source: &dyn fantex_bake::Source,
        budget: &TexelBudget,
        path: &Path,
        options: &ExportOptions<'_>,
    ) -> Result<Baked> {
        let texels = budget_texels(mesh, budget);
        let share = if let TexelBudget::Total(_) = budget { SURFACE_SHARE } else { 1.0 };
        let texels_per_unit = (share * texels / mesh.area().max(f64::MIN_POSITIVE)).sqrt() as f32;
        let exported = export_source(mesh, source, texels_per_unit, path, options, self.progress.progress)?;
        let summary = BakeSummary { damage: source.damage(), ..summary(&exported) };
        Ok(Baked {
            triangles: mesh.triangles.len() as u64,
            texels_asked: None,
            cover: CoverStats::default(),
            cover_time: Duration::ZERO,
            summary,
            notes: Vec::new(),
            left_out: LeftOut::default(),
            #[cfg(feature = "photos")]
            photos: None,
            exported: Some(exported),
        })
    }

    /// The same by way of an asset, which is removed afterwards.
    pub(super) fn model_of_asset(
        &self,
        mesh: &fantex_mesh::Mesh,
        source: &dyn fantex_bake::Source,
        own_density: Option<OwnDensity>,
        path: &Path,
        options: &ExportOptions<'_>,
    ) -> Result<Baked> {
        let folder = folder_of(path);
        let scratch = temporary_folder(folder).map_err(|error| Error::writing(path, error))?;
        let asset = scratch.path().join("model.fan");
        let baked = self.bake(mesh, source, own_density, &Goal::Asset(&asset))?;
        let asset = Arc::new(Asset::open(&asset)?);
        let exported = export_model(&asset, path, options, self.progress.progress)?;
        let summary = BakeSummary {
            light: baked.summary.light,
            damage: baked.summary.damage.clone(),
            ..summary(&exported)
        };
        Ok(Baked { summary, exported: Some(exported), ..baked })
    }
}

/// What a bake tells, of a model.
fn summary(exported: &ExportSummary) -> BakeSummary {
    BakeSummary {
        texels: exported.texels,
        bytes: exported.files.iter().map(|(_, bytes)| bytes).sum(),
        channels: exported.maps.iter().map(|map| format!("{:?}", map.channel())).collect(),
        ..BakeSummary::default()
    }
}
