//! Several assets as one model, one after the other: only one is open at a time.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use fantex_bake::Progress;
use fantex_base::{Error, Result};
use fantex_store::Asset;

use crate::asset_surface::AssetSurface;
use crate::export::{ExportOptions, ExportSummary, ModelFile, UvChoice, cancelled};
use crate::fan_files::{FanFile, FanFileOptions};
use crate::model_file::stem_of;

/// An asset among several that become one model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportObject {
    /// The name of its node, and of its files after the model's name. No other object may have it.
    pub name: String,
    /// Its share of the work: stored texels at level 0, about.
    pub texels: u64,
}

/// As [`export_model`](crate::export_model), for several assets: each becomes a node with a translation below one that is named after the
/// output, and has pictures of its own, as large as `options` say for one. `open` opens the object of a number; it is closed before the
/// next one is opened. Assets of one mesh space, such as the parts of a larger one, have equal positions where they meet.
///
/// # Errors
/// Those of [`export_model`](crate::export_model) and of `open`; texture coordinates of a model, which are those of a single asset; a
/// `.glb` would exceed 4 GiB.
pub fn export_models(
    objects: &[ExportObject],
    open: &mut dyn FnMut(usize) -> Result<Arc<Asset>>,
    output: &Path,
    options: &ExportOptions<'_>,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    options.check()?;
    if let UvChoice::OfModel(_) = options.uv {
        let message =
            "the texture coordinates of a model are those of one asset; export a single asset with them";
        return Err(Error::unsupported(message));
    }
    let mut file = ModelFile::new(output, Some(&stem_of(output)), options)?;
    let add = |asset: &Arc<Asset>, name: &str, progress: &dyn Progress| {
        file.add(&AssetSurface::new(asset, options), Some(name), progress)
    };
    let steps = if let UvChoice::Atlas = options.uv { 2 } else { 1 };
    let mut summary = add_all(objects, open, (progress, steps), add)?;
    summary.check_damage(options.strict)?;
    summary.files = file.finish()?;
    Ok(summary)
}

/// As [`export_fans`](crate::export_fans), for several assets, as [`export_models`] has them. Of a `.usda` each has a file beside it, to
/// which the output refers.
///
/// # Errors
/// Those of [`export_fans`](crate::export_fans) and of `open`; shaders, which are those of a single asset; a `.glb` would exceed 4 GiB.
pub fn export_all_fans(
    objects: &[ExportObject],
    open: &mut dyn FnMut(usize) -> Result<Arc<Asset>>,
    output: &Path,
    options: &FanFileOptions,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    let mut file = FanFile::new(output, Some(&stem_of(output)), options)?;
    let add = |asset: &Arc<Asset>, name: &str, progress: &dyn Progress| file.add(asset, Some(name), progress);
    let mut summary = add_all(objects, open, (progress, 1), add)?;
    summary.check_damage(options.strict)?;
    summary.files = file.finish()?;
    Ok(summary)
}

/// `steps`: those that `add` reports of each object.
fn add_all(
    objects: &[ExportObject],
    open: &mut dyn FnMut(usize) -> Result<Arc<Asset>>,
    (progress, steps): (&dyn Progress, u64),
    mut add: impl FnMut(&Arc<Asset>, &str, &dyn Progress) -> Result<ExportSummary>,
) -> Result<ExportSummary> {
    let total = objects.iter().fold(0u64, |sum, object| sum.saturating_add(object.texels));
    let mut before = 0u64;
    let mut whole: Option<ExportSummary> = None;
    for (number, ExportObject { name, texels }) in objects.iter().enumerate() {
        if progress.is_cancelled() {
            return Err(cancelled());
        }
        let asset = open(number)?;
        let added = add(
            &asset,
            name,
            &Share { progress, before, own: *texels, total, steps, begun: AtomicU64::new(0) },
        );
        let mut summary = added.map_err(|error| match error.is_cancelled() {
            true => error,
            false => error.in_file(asset.path()),
        })?;
        if let Some((_, first)) = &mut summary.damage {
            *first = format!("{name}: {first}");
        }
        whole = Some(match whole {
            Some(whole) => joined(whole, summary),
            None => summary,
        });
        before = before.saturating_add(*texels);
    }
    Ok(whole.unwrap_or_default())
}

/// The progress of an object as a share of that of all.
struct Share<'a> {
    progress: &'a dyn Progress,
    before: u64,
    own: u64,
    total: u64,
    /// Its steps, all alike, and how many have begun.
    steps: u64,
    begun: AtomicU64,
}

impl Progress for Share<'_> {
    fn report(&self, done: u64, total: u64) {
        if done == 0 {
            self.begun.fetch_add(1, Ordering::Relaxed);
        }
        let earlier = self.begun.load(Ordering::Relaxed).saturating_sub(1).min(self.steps - 1);
        let share = (earlier as f64 + done as f64 / total.max(1) as f64) / self.steps as f64;
        let own = (self.own as f64 * share.min(1.0)) as u64;
        self.progress.report(self.before.saturating_add(own).min(self.total), self.total);
    }

    fn note(&self, sentence: &str) {
        self.progress.note(sentence);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

/// What was exported of several assets: sums, means over texels, the lowest density, and the brightest light.
fn joined(mut a: ExportSummary, b: ExportSummary) -> ExportSummary {
    let covered = |summary: &ExportSummary| summary.used_share * summary.texels as f64;
    let contested = |summary: &ExportSummary| summary.overlapping_share * covered(summary);
    let (all_covered, all_contested) = (covered(&a) + covered(&b), contested(&a) + contested(&b));
    a.texels += b.texels;
    a.used_share = all_covered / a.texels.max(1) as f64;
    a.overlapping_share = all_contested / all_covered.max(1.0);
    a.density_share = a.density_share.min(b.density_share);
    a.sizes.extend(b.sizes);
    a.maps.extend(b.maps.into_iter().filter(|map| !a.maps.contains(map)).collect::<Vec<_>>());
    a.left_out.extend(b.left_out.into_iter().filter(|kind| !a.left_out.contains(kind)).collect::<Vec<_>>());
    a.charts += b.charts;
    a.padding = a.padding.max(b.padding);
    a.points += b.points;
    a.triangles += b.triangles;
    a.vertices += b.vertices;
    for (map, largest) in b.cut_off {
        match a.cut_off.iter_mut().find(|(known, _)| *known == map) {
            Some((_, most)) => *most = most.max(largest),
            None => a.cut_off.push((map, largest)),
        }
    }
    a.damage = match (a.damage, b.damage) {
        (Some((pages, first)), Some((more, _))) => Some((pages + more, first)),
        (one, other) => one.or(other),
    };
    a
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ChannelMap::{Emission, Light};

    #[test]
    fn the_brightest_light_of_all_assets_is_told() {
        let of = |cut_off: &[_]| ExportSummary { cut_off: cut_off.to_vec(), ..ExportSummary::default() };
        let all = [of(&[]), of(&[(Light, 1.5)]), of(&[(Emission, 2.0), (Light, 3.0)]), of(&[(Light, 2.5)])];
        let whole = all.into_iter().reduce(joined).unwrap();
        assert_eq!(whole.cut_off, [(Light, 3.0), (Emission, 2.0)]);
    }
}
