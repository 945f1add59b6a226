//! A world as one model for other programs.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::Result;
use fantex_export::{
    ExportObject, ExportOptions, ExportSummary, FanFileOptions, export_all_fans, export_models,
};
use fantex_store::Asset;
use fantex_stream::{open_asset, url_of};

use crate::{World, WorldObject};

/// Writes all assets of a world, whole, as one model: see [`export_models`]. `index` is where the world was read, a path or an address. Nodes
/// are named as the assets are in the index, without `.fan`, with `-` for `/`. One asset is open at a time.
///
/// # Errors
/// There is nothing to show; those of [`export_models`] and of opening the assets.
pub fn export_world(
    index: &Path,
    world: &World,
    output: &Path,
    options: &ExportOptions<'_>,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    world.space_to_show(index)?;
    export_models(&objects(world), &mut opener(index, world), output, options, progress)
}

/// As [`export_world`], with the fans themselves: see [`export_all_fans`].
///
/// # Errors
/// There is nothing to show; those of [`export_all_fans`] and of opening the assets.
pub fn export_world_fans(
    index: &Path,
    world: &World,
    output: &Path,
    options: &FanFileOptions,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    world.space_to_show(index)?;
    export_all_fans(&objects(world), &mut opener(index, world), output, options, progress)
}

fn opener(index: &Path, world: &World) -> impl FnMut(usize) -> Result<Arc<Asset>> {
    move |number| open_asset(&World::asset_place(index, &world.objects[number])).map(Arc::new)
}

/// The objects with names that differ, also where the case of letters does not count, as in some file systems.
fn objects(world: &World) -> Vec<ExportObject> {
    let (mut taken, mut counts) = (HashSet::new(), HashMap::new());
    let mut named = |object: &WorldObject| {
        let plain = plain_name(&object.asset);
        let count: &mut u64 = counts.entry(plain.to_lowercase()).or_default();
        loop {
            *count += 1;
            let name = if *count == 1 { plain.clone() } else { format!("{plain}-{count}") };
            if taken.insert(name.to_lowercase()) {
                return ExportObject { name, texels: object.texels };
            }
        }
    };
    world.objects.iter().map(&mut named).collect()
}

/// The name of an asset as a part of a file's name, whatever system made the index: without its extension, of an address only what comes last.
fn plain_name(asset: &str) -> String {
    let name = match url_of(Path::new(asset)) {
        Some(url) => {
            let path = url.split(['?', '#']).next().unwrap_or(url);
            path.rsplit('/').find(|name| !name.is_empty()).unwrap_or(path)
        }
        None => asset.trim_start_matches("./"),
    };
    let name = name.strip_suffix(".fan").filter(|name| !name.is_empty()).unwrap_or(name);
    let is_kept = |c: char| !(c.is_control() || "/\\:*?\"<>|@".contains(c));
    name.chars().map(|c| if is_kept(c) { c } else { '-' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_objects_are_names_of_files_and_differ() {
        let object = |asset: &str| WorldObject {
            asset: asset.into(),
            bytes: 1,
            triangles: 1,
            texels: 1,
            low: [0.0; 3],
            high: [1.0; 3],
            preview: None,
        };
        let assets = [
            "sector-0001.fan",
            "houses/church.fan",
            "./Barn.fan",
            "barn.fan",
            "barn-2.fan",
            "https://a.b/c/barn.fan?x=/y",
            "../barn",
            ".fan",
        ];
        let world = World { objects: assets.map(object).into(), ..World::default() };
        let names: Vec<String> = objects(&world).into_iter().map(|object| object.name).collect();
        let expected =
            ["sector-0001", "houses-church", "Barn", "barn-2", "barn-2-2", "barn-3", "..-barn", ".fan"];
        assert_eq!(names, expected);
    }
}
