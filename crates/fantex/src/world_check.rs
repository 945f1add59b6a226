//! Whether a world is what its index says, and whether its sectors fit together.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result};
use fantex_mesh::{Edges, SurfacePoint};
use fantex_store::{
    Asset, JUMP_BOUND, PageCache, TileId, TileSource, TileTexels, VerifyOptions, VerifyReport, verify_asset,
};
use fantex_stream::open_asset;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::{World, WorldObject};

/// What verification of a world found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorldReport {
    /// Everything passed: all assets and previews are sound and what the index says, and no seam jumps by more than [`JUMP_BOUND`].
    pub ok: bool,
    /// One for each object of the index, in its order.
    pub objects: Vec<ObjectReport>,
    /// Edges at borders of sectors of one asset that were compared.
    pub seam_edges: u64,
    /// The largest difference of any channel between the two sides of such an edge, at level 0.
    pub largest_jump: f32,
    /// The two objects between which it is; none where there is no jump at all.
    pub worst_seam: Option<[usize; 2]>,
}

/// What verification of one object found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectReport {
    /// Where the asset is: a path or an address.
    pub place: PathBuf,
    /// Nothing is wrong with it.
    pub ok: bool,
    /// What it has found; none where the asset cannot be opened.
    pub asset: Option<VerifyReport>,
    /// What else is wrong, a sentence each.
    pub faults: Vec<String>,
}

/// Verifies every asset of a world as [`verify_asset`] does, and its preview; compares them with the index; and compares the texture function on
/// both sides of edges where sectors of one asset meet: those at open borders with their ends at the same places, of assets with one mesh
/// space, blend band and density. `progress` counts texels.
///
/// # Errors
/// The index cannot be read; somebody wants to stop. What is wrong with assets is reported.
pub fn verify_world(index: &Path, options: &VerifyOptions, progress: &dyn Progress) -> Result<WorldReport> {
    let world = World::open(index)?;
    let mut report = WorldReport::default();
    let mut seams = Seams::default();
    let total = world.objects.iter().map(|object| object.texels).sum();
    let mut done = 0;
    for (number, object) in world.objects.iter().enumerate() {
        if progress.is_cancelled() {
            return Err(Error::cancelled("the verification was cancelled"));
        }
        let place = World::asset_place(index, object);
        report.objects.push(verify_object(number, object, place, options, &mut seams));
        done += object.texels;
        progress.report(done, total);
    }
    (report.seam_edges, report.largest_jump, report.worst_seam) =
        (seams.edges, seams.largest_jump, seams.worst);
    report.ok = report.objects.iter().all(|object| object.ok) && report.largest_jump <= JUMP_BOUND;
    Ok(report)
}

fn verify_object(
    number: usize,
    object: &WorldObject,
    place: PathBuf,
    options: &VerifyOptions,
    seams: &mut Seams,
) -> ObjectReport {
    let mut report = ObjectReport { place, ..ObjectReport::default() };
    let asset = match open_asset(&report.place) {
        Ok(asset) => Arc::new(asset),
        Err(error) => {
            report.faults.push(error.to_string());
            return report;
        }
    };
    let found = verify_asset(&asset, options);
    let is_sound = found.ok;
    report.asset = Some(found);
    match WorldObject::of(object.asset.clone(), &asset) {
        Ok(actual) => report.faults.extend(differences(object, &actual)),
        Err(error) => report.faults.push(error.to_string()),
    }
    if let Ok(Some(preview)) = Asset::open_preview(&**asset.source())
        && !verify_asset(&Arc::new(preview), options).ok
    {
        report.faults.push(format!("the preview of {} is damaged; make it again", report.place.display()));
    }
    // Damaged texels would be reported a second time.
    if is_sound {
        seams.add(number, &PageCache::new(asset, options.memory_bytes));
    }
    report.ok = is_sound && report.faults.is_empty();
    report
}

/// Details are measured in floating point, which differs between processors in the last digits.
const DETAIL_TOLERANCE: f64 = 0.01;

/// What an index says otherwise than its asset, a sentence each.
fn differences(said: &WorldObject, actual: &WorldObject) -> Vec<String> {
    let mut found = Vec::new();
    let mut compare = |what: &str, said: String, actual: String| {
        if said != actual {
            found.push(format!(
                "the index says {what}: {said}, but it is {actual}; update the index with 'fantex world'"
            ));
        }
    };
    compare("bytes", said.bytes.to_string(), actual.bytes.to_string());
    compare("triangles", said.triangles.to_string(), actual.triangles.to_string());
    compare("texels", said.texels.to_string(), actual.texels.to_string());
    compare("low corner", format!("{:?}", said.low), format!("{:?}", actual.low));
    compare("high corner", format!("{:?}", said.high), format!("{:?}", actual.high));
    let size = |object: &WorldObject| match &object.preview {
        Some(preview) => format!("{} triangles, {} texels", preview.triangles, preview.texels),
        None => "none".into(),
    };
    compare("preview", size(said), size(actual));
    if let (Some(a), Some(b)) = (&said.preview, &actual.preview)
        && (a.detail - b.detail).abs() > DETAIL_TOLERANCE * b.detail
    {
        compare("detail", a.detail.to_string(), b.detail.to_string());
    }
    found
}

/// A border edge: what sectors of one asset have in common (mesh space, blend band, density), and the places of its ends in the world, ascending.
/// All as bits.
type SeamKey = ([u64; 6], [[u64; 3]; 2]);

/// The texture function along a border edge: per point and channel.
type SeamValues = Vec<Vec4>;

/// Where points lie along an edge: in the middle of the blend band, and on both sides of it.
const SEAM_POINTS: [f32; 5] = [0.02, 0.3, 0.5, 0.7, 0.98];

/// Border edges that wait for their other side.
#[derive(Default)]
struct Seams {
    open: HashMap<SeamKey, (usize, SeamValues)>,
    edges: u64,
    largest_jump: f32,
    worst: Option<[usize; 2]>,
}

impl Seams {
    fn add(&mut self, object: usize, cache: &PageCache) {
        let mesh = cache.asset().mesh();
        let edges = Edges::of(&mesh.triangles);
        let borders = edges.iter().filter(|edge| edge.triangle_count() == 1);
        let sides: Vec<(u32, [u32; 2])> =
            borders.filter_map(|edge| Some((edge.triangles().next()?.0, edge.vertices()))).collect();
        let values: Vec<(SeamKey, SeamValues)> =
            sides.into_par_iter().map(|(triangle, ends)| seam_values(cache, triangle, ends)).collect();
        for (key, values) in values {
            match self.open.remove(&key) {
                Some((other, seen)) if other != object => self.compare([other, object], &seen, &values),
                Some(twice) => drop(self.open.insert(key, twice)),
                None => drop(self.open.insert(key, (object, values))),
            }
        }
    }

    fn compare(&mut self, objects: [usize; 2], a: &SeamValues, b: &SeamValues) {
        self.edges += 1;
        // Values beyond 1 relative to their size, as within assets.
        let jump =
            |(a, b): (&Vec4, &Vec4)| ((*a - *b).abs() / a.abs().max(b.abs()).max(Vec4::ONE)).max_element();
        let largest = match a.len() == b.len() {
            true => a.iter().zip(b).map(jump).fold(0.0, f32::max),
            // Other channels.
            false => f32::INFINITY,
        };
        if largest > self.largest_jump {
            (self.largest_jump, self.worst) = (largest, Some(objects));
        }
    }
}

fn seam_values(cache: &PageCache, triangle: u32, ends: [u32; 2]) -> (SeamKey, SeamValues) {
    let asset = cache.asset();
    let (mesh, cover) = (asset.mesh(), asset.cover());
    let space = mesh.world_from_mesh;
    let place = |vertex: u32| {
        let p = space.point(mesh.positions[vertex as usize]);
        // Adding zero makes -0 and 0 the same.
        p.to_array().map(|x| (x + 0.0).to_bits())
    };
    let mut ends = ends.map(|vertex| (place(vertex), vertex));
    ends.sort_unstable();
    let corners = mesh.triangles[triangle as usize];
    let slots = ends.map(|(_, vertex)| corners.iter().position(|&corner| corner == vertex).unwrap_or(0));
    let mut values = Vec::new();
    for s in SEAM_POINTS {
        let mut lambda = Vec3::ZERO;
        lambda[slots[0]] = 1.0 - s;
        lambda[slots[1]] = s;
        for channel in 0..asset.channels().len() {
            let value = cover.taps(mesh, SurfacePoint { triangle, lambda }).map(|tap| {
                let tile = cache.tile(channel, TileId { group: tap.group, level: 0 });
                Vec4::from(tile.bilinear(tap.uv)) * tap.weight
            });
            values.push(value.sum());
        }
    }
    let [x, y, z] = space.offset.to_array().map(f64::to_bits);
    let common =
        [x, y, z, space.scale.to_bits(), cover.delta.to_bits().into(), cover.density.to_bits().into()];
    ((common, ends.map(|(place, _)| place)), values)
}
