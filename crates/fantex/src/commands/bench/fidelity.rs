//! How much of a known function a baked asset keeps.

use std::sync::Arc;

use fantex::bake::{self as baking, BakeFormat, BakeOptions, SineSource, fidelity};
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::store::{Asset, PageCache};
use serde::Serialize;

use super::FidelityArgs;
use crate::context::Context;
use crate::error::CliError;
use crate::input::CleanModel;
use crate::size::grouped;
use crate::table::Table;

/// Points of the surface that are compared.
const SAMPLES: u64 = 400_000;

#[derive(Debug, Serialize)]
struct FidelityInfo {
    psnr_db: f64,
    density_share: f64,
    lookups_per_sample: f64,
    texels: u64,
    largest_error: f32,
    samples: u64,
    groups: u64,
    tile: u32,
    wavelength: f64,
}

pub(super) fn run(args: &FidelityArgs, context: &Context) -> Result<(), CliError> {
    let model = CleanModel::open(&args.model)?;
    let mesh = &model.mesh;
    let default = CoverOptions::default();
    let tile = args.tile.unwrap_or(default.tile);
    let budget = TexelBudget::Total(args.texels.0);
    let (cover, stats) = build_cover(mesh, &CoverOptions { budget, tile, ..default })?;
    let ideal_texel = (mesh.area() / args.texels.0 as f64).sqrt();
    let k = std::f64::consts::TAU / (args.wavelength * ideal_texel);
    let source = SineSource { k: k as f32 };

    let options = BakeOptions {
        fit: args.fit.into(),
        format: BakeFormat::Float,
        memory_bytes: context.memory_bytes,
        ..BakeOptions::default()
    };
    let _deferral = context.defer_interrupt();
    let folder = tempfile::tempdir().map_err(CliError::TemporaryFolder)?;
    let path = folder.path().join("fidelity.fan");
    baking::bake(mesh, &cover, &source, &path, &options, &context.progress("baking"))?;
    let cache = PageCache::new(Arc::new(Asset::open(&path)?), context.memory_bytes as usize);
    let measured = fidelity(&cache, SAMPLES, context.seed, &|p| source.value(p));
    let info = FidelityInfo {
        psnr_db: measured.psnr_db,
        density_share: stats.density_share,
        lookups_per_sample: measured.lookups_per_sample,
        texels: stats.texels,
        largest_error: measured.largest,
        samples: measured.samples,
        groups: stats.groups,
        tile,
        wavelength: args.wavelength,
    };
    context.print(&info, text)
}

fn text(info: &FidelityInfo) -> String {
    let mut table = Table::default();
    table
        .row("fidelity", format!("{:.2} dB", info.psnr_db))
        .row("largest error", format!("{:.5}", info.largest_error))
        .row("share of ideal density", format!("{:.3}", info.density_share))
        .row("look-ups per sample", format!("{:.3}", info.lookups_per_sample))
        .row("texels", grouped(info.texels))
        .row("groups", grouped(info.groups));
    table.to_text()
}
