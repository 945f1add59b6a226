//! Whether a world is what its index says, and whether its sectors fit together.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result};
use fantex_mesh::{Edge, Edges, Mesh, SurfacePoint, WorldFromMesh};
use fantex_store::{
    Asset, JUMP_BOUND, PageCache, TileId, TileSource, TileTexels, VerifyOptions, VerifyReport, jump,
    verify_asset,
};
use fantex_stream::open_asset;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::coarse::joined;
use crate::{World, WorldCoarse, WorldObject, WorldPreview, not_verified};

/// What verification of a world found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorldReport {
    /// Everything passed: all assets and previews are sound and what the index says, and no seam jumps by more than [`JUMP_BOUND`].
    pub ok: bool,
    /// One for each object of the index, in its order.
    pub objects: Vec<ObjectReport>,
    /// One for each coarse asset of the index, in its order.
    pub coarse: Vec<ObjectReport>,
    /// Edges at borders of sectors of one asset that were compared.
    pub seam_edges: u64,
    /// The largest difference of any channel between the two sides of such an edge, at level 0.
    pub largest_jump: f32,
    /// The two objects between which it is; none where there is no jump at all.
    pub worst_seam: Option<[usize; 2]>,
}

impl WorldReport {
    /// All faults, a sentence each.
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        for object in self.objects.iter().chain(&self.coarse) {
            if let Some(found) = object.asset.as_ref().filter(|found| !found.ok) {
                faults.push(not_verified(&object.place, found).to_string());
            }
            faults.extend(object.faults.iter().map(|fault| format!("{}: {fault}", object.place.display())));
        }
        if self.largest_jump > JUMP_BOUND
            && let Some(seam) = self.worst_seam
        {
            let [a, b] = seam.map(|number| self.objects[number].place.display());
            let jump = self.largest_jump;
            faults.push(format!(
                "the texture jumps by {jump:.1e} between {a} and {b}, more than the bound of {JUMP_BOUND:.0e}"
            ));
        }
        faults
    }
}

/// What verification of one object, or of one coarse asset, found.
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
/// space, blend band and density. Those edges at which a coarse asset ends must be edges of it, too, unless they are at the outline of all
/// sectors. `progress` counts texels.
///
/// # Errors
/// The index cannot be read; somebody wants to stop. What is wrong with assets is reported.
pub fn verify_world(index: &Path, options: &VerifyOptions, progress: &dyn Progress) -> Result<WorldReport> {
    let world = World::open(index)?;
    let mut report = WorldReport::default();
    let mut seams = Seams { keeps_meetings: !world.coarse.is_empty(), ..Seams::default() };
    let of_coarse = world.coarse.iter().map(|coarse| coarse.texels);
    let total =
        world.objects.iter().map(|object| object.texels).chain(of_coarse).fold(0, u64::saturating_add);
    let mut done = 0;
    for (number, object) in world.objects.iter().enumerate() {
        if progress.is_cancelled() {
            return Err(Error::cancelled("the verification was cancelled"));
        }
        let place = World::asset_place(index, object);
        report.objects.push(verify_object(number, object, place, options, &mut seams));
        done = object.texels.saturating_add(done);
        progress.report(done, total);
    }
    let parts = world.parts()?;
    for (number, coarse) in world.coarse.iter().enumerate() {
        if progress.is_cancelled() {
            return Err(Error::cancelled("the verification was cancelled"));
        }
        let stands_for = objects_below(&parts, world.objects.len(), number);
        report.coarse.push(verify_coarse(
            (index, &world),
            (coarse, &parts[number]),
            &stands_for,
            options,
            &seams,
        ));
        done += coarse.texels;
        progress.report(done, total);
    }
    (report.seam_edges, report.largest_jump, report.worst_seam) =
        (seams.edges, seams.largest_jump, seams.worst);
    let all_ok = report.objects.iter().chain(&report.coarse).all(|object| object.ok);
    report.ok = all_ok && report.largest_jump <= JUMP_BOUND;
    Ok(report)
}

/// Per object whether a coarse asset stands for it.
fn objects_below(parts: &[Vec<usize>], objects: usize, coarse: usize) -> Vec<bool> {
    let mut is_below = vec![false; objects];
    let mut open = vec![coarse];
    while let Some(coarse) = open.pop() {
        for &part in &parts[coarse] {
            match is_below.get_mut(part) {
                Some(is_below) => *is_below = true,
                None => open.push(part - objects),
            }
        }
    }
    is_below
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
        Ok(actual) => {
            report.faults.extend(differences(object, &actual, "update the index with 'fantex world'"))
        }
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

fn verify_coarse(
    (index, world): (&Path, &World),
    (coarse, parts): (&WorldCoarse, &[usize]),
    stands_for: &[bool],
    options: &VerifyOptions,
    seams: &Seams,
) -> ObjectReport {
    let mut report = ObjectReport { place: World::place_of(index, &coarse.asset), ..ObjectReport::default() };
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
    match coarse_of((index, world), (coarse, parts), &asset) {
        Ok(actual) => report.faults.extend(differences(
            &as_object(coarse),
            &as_object(&actual),
            "make it anew with 'fantex split', or with 'fantex world --make-coarse'",
        )),
        Err(error) => report.faults.push(format!("it cannot be compared with what it stands for: {error}")),
    }
    let missing = seams.missing(asset.mesh(), stands_for);
    if missing > 0 {
        report.faults.push(format!(
            "its border lacks {missing} edges at which the assets that it stands for meet others, so gaps may show there; make it anew with 'fantex split', or with \
             'fantex world --make-coarse'"
        ));
    }
    report.ok = is_sound && report.faults.is_empty();
    report
}

/// What the index is to say of a coarse asset.
fn coarse_of(
    (index, world): (&Path, &World),
    (said, parts): (&WorldCoarse, &[usize]),
    asset: &Asset,
) -> Result<WorldCoarse> {
    let (mut finer, mut detail) = (Vec::with_capacity(parts.len()), 0.0f64);
    for (&part, name) in parts.iter().zip(&said.parts) {
        let place = World::place_of(index, name);
        let (open, known): (fn(&Path) -> Result<Asset>, f64) = match world.objects.get(part) {
            Some(WorldObject { preview: Some(preview), .. }) => (World::open_preview, preview.detail),
            Some(_) => (open_asset, 0.0),
            None => (World::open_coarse, world.coarse[part - world.objects.len()].detail),
        };
        finer.push(open(&place)?.shared_mesh());
        detail = detail.max(known);
    }
    let space = finer.first().map_or(asset.mesh().world_from_mesh, |mesh| mesh.world_from_mesh);
    let finer = joined(finer.iter().map(|mesh| &**mesh), space, |p| p).mesh;
    Ok(WorldCoarse::of(said.asset.clone(), asset, said.parts.clone(), &finer, detail))
}

/// A coarse asset as an object with a preview of its detail.
fn as_object(coarse: &WorldCoarse) -> WorldObject {
    let WorldCoarse { asset, bytes, triangles, texels, low, high, detail, .. } = coarse.clone();
    let preview = Some(WorldPreview { triangles: 0, texels: 0, detail });
    WorldObject { asset, bytes, triangles, texels, low, high, preview }
}

/// Details are measured in floating point, which differs between processors in the last digits.
const DETAIL_TOLERANCE: f64 = 0.01;

/// What an index says otherwise than its asset, a sentence each, which ends with what to do.
fn differences(said: &WorldObject, actual: &WorldObject, remedy: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut compare = |what: &str, said: String, actual: String| {
        if said != actual {
            found.push(format!("the index says {what}: {said}, but it is {actual}; {remedy}"));
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

/// The places of the ends of an edge in the world, ascending, as bits.
type Ends = [[u64; 3]; 2];

/// A border edge: what sectors of one asset have in common (mesh space, blend band, density), as bits, and its ends.
type SeamKey = ([u64; 6], Ends);

/// The texture function along a border edge: per point and channel.
type SeamValues = Vec<Vec4>;

/// Where points lie along an edge: in the middle of the blend band, and on both sides of it.
const SEAM_POINTS: [f32; 5] = [0.02, 0.3, 0.5, 0.7, 0.98];

/// Border edges that wait for their other side.
#[derive(Default)]
struct Seams {
    open: HashMap<SeamKey, (usize, SeamValues)>,
    /// Whether edges that had two sides are remembered.
    keeps_meetings: bool,
    /// Those edges, and the objects on both sides.
    meetings: Vec<(Ends, [usize; 2])>,
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
                Some((other, seen)) if other != object => {
                    if self.keeps_meetings {
                        self.meetings.push((key.1, [other, object]));
                    }
                    self.compare([other, object], &seen, &values);
                }
                Some(twice) => drop(self.open.insert(key, twice)),
                None => drop(self.open.insert(key, (object, values))),
            }
        }
    }

    fn compare(&mut self, objects: [usize; 2], a: &SeamValues, b: &SeamValues) {
        self.edges += 1;
        let largest = match a.len() == b.len() {
            true => a.iter().zip(b).map(|(a, b)| jump(a.to_array(), b.to_array())).fold(0.0, f32::max),
            // Other channels.
            false => f32::INFINITY,
        };
        if largest > self.largest_jump {
            (self.largest_jump, self.worst) = (largest, Some(objects));
        }
    }
}

impl Seams {
    /// How many edges a mesh lacks that stands for some of the objects: those at which one of them meets another one, which do not end
    /// at the outline of all objects.
    fn missing(&self, mesh: &Mesh, stands_for: &[bool]) -> usize {
        let at_outline: HashSet<[u64; 3]> = self.open.keys().flat_map(|(_, ends)| *ends).collect();
        let space = mesh.world_from_mesh;
        let places: Vec<[u64; 3]> = mesh.positions.iter().map(|&p| place(&space, p)).collect();
        let ends = |edge: Edge<'_>| sorted(edge.vertices().map(|vertex| places[vertex as usize]));
        let own: HashSet<Ends> = Edges::of(&mesh.triangles).iter().map(ends).collect();
        let is_border = |[a, b]: [usize; 2]| stands_for[a] != stands_for[b];
        let borders = self.meetings.iter().filter(|(_, objects)| is_border(*objects));
        let inner = borders.filter(|(ends, _)| !ends.iter().any(|end| at_outline.contains(end)));
        inner.filter(|(ends, _)| !own.contains(ends)).count()
    }
}

/// A place in the world, to the last bit.
fn place(space: &WorldFromMesh, p: Vec3) -> [u64; 3] {
    // Adding zero makes -0 and 0 the same.
    space.point(p).to_array().map(|x| (x + 0.0).to_bits())
}

fn sorted(mut ends: Ends) -> Ends {
    ends.sort_unstable();
    ends
}

fn seam_values(cache: &PageCache, triangle: u32, ends: [u32; 2]) -> (SeamKey, SeamValues) {
    let asset = cache.asset();
    let (mesh, cover) = (asset.mesh(), asset.cover());
    let space = mesh.world_from_mesh;
    let mut ends = ends.map(|vertex| (place(&space, mesh.positions[vertex as usize]), vertex));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_on_one_side_of_a_seam_only_is_a_jump() {
        let jump_between = |a: f32, b: f32| {
            let mut seams = Seams::default();
            seams.compare([0, 1], &vec![Vec4::splat(a)], &vec![Vec4::new(a, a, a, b)]);
            (seams.largest_jump, seams.worst)
        };
        assert_eq!(jump_between(0.25, 0.25), (0.0, None));
        assert_eq!(jump_between(0.25, 0.75), (0.5, Some([0, 1])));
        assert_eq!(jump_between(0.25, f32::NAN), (1.0, Some([0, 1])));
        assert_eq!(jump_between(f32::NAN, f32::NAN), (0.0, None));
    }
}
