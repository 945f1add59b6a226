//! Whether a world is what its index says, and whether its sectors fit together.

mod seams;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result, counted};
use fantex_store::{Asset, JUMP_BOUND, PageCache, VerifyOptions, VerifyReport, verify_asset};
use fantex_stream::open_asset;

use self::seams::Seams;
use super::coarse::{measured, objects_below};
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

impl ObjectReport {
    /// Of an asset, which is opened and verified; none where it cannot be opened.
    fn begin(place: PathBuf, options: &VerifyOptions) -> (Self, Option<Arc<Asset>>) {
        let report = Self { place, ..Self::default() };
        match open_asset(&report.place).map(Arc::new) {
            Ok(asset) => (Self { asset: Some(verify_asset(&asset, options)), ..report }, Some(asset)),
            Err(error) => (Self { faults: vec![error.to_string()], ..report }, None),
        }
    }

    fn is_sound(&self) -> bool {
        self.asset.as_ref().is_some_and(|found| found.ok)
    }

    fn end(self) -> Self {
        Self { ok: self.is_sound() && self.faults.is_empty(), ..self }
    }
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
    let mut seams = Seams::new(!world.coarse.is_empty());
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
        let mut stands_for = vec![false; world.objects.len()];
        for object in objects_below(&parts, world.objects.len(), number) {
            stands_for[object] = true;
        }
        report.coarse.push(verify_coarse(
            (index, &world),
            (coarse, &parts[number]),
            &stands_for,
            options,
            &seams,
        ));
        done = coarse.texels.saturating_add(done);
        progress.report(done, total);
    }
    (report.seam_edges, report.largest_jump, report.worst_seam) =
        (seams.edges, seams.largest_jump, seams.worst);
    let all_ok = report.objects.iter().chain(&report.coarse).all(|object| object.ok);
    report.ok = all_ok && report.largest_jump <= JUMP_BOUND;
    Ok(report)
}

fn verify_object(
    number: usize,
    object: &WorldObject,
    place: PathBuf,
    options: &VerifyOptions,
    seams: &mut Seams,
) -> ObjectReport {
    let (mut report, asset) = ObjectReport::begin(place, options);
    let Some(asset) = asset else { return report };
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
    if report.is_sound() {
        seams.add(number, &PageCache::new(asset, options.memory_bytes));
    }
    report.end()
}

fn verify_coarse(
    (index, world): (&Path, &World),
    (coarse, parts): (&WorldCoarse, &[usize]),
    stands_for: &[bool],
    options: &VerifyOptions,
    seams: &Seams,
) -> ObjectReport {
    let (mut report, asset) = ObjectReport::begin(World::place_of(index, &coarse.asset), options);
    let Some(asset) = asset else { return report };
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
            "its border lacks {} at which the assets that it stands for meet others, so gaps may show there; make it anew with 'fantex split', or with \
             'fantex world --make-coarse'",
            counted(missing, "edge")
        ));
    }
    report.end()
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
    Ok(measured(&said.asset, asset, said.parts.clone(), &finer, detail))
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
        Some(preview) => {
            format!("{}, {}", counted(preview.triangles, "triangle"), counted(preview.texels, "texel"))
        }
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
