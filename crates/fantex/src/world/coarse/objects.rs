//! Coarse assets of separate objects: houses of a town, tiles of a terrain that were baked one by one.
//!
//! They are made like those of sectors, of what objects show from afar, their previews, along a curve through the world. Objects have mesh spaces of their
//! own, so what they have in common is found by its place: vertices at open borders that several objects have, up to rounding, are one. Within a run they
//! are joined and simplified like the rest; those that an object of another run has, too, stay, so that neighbours go on fitting together.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::files::{folder_of, remove_if_there};
use fantex_base::{Error, Result, counted};
use fantex_mesh::{Mesh, WorldFromMesh, morton};
use fantex_store::Asset;
use fantex_stream::{ObjectTarget, Replace, url_of};
use glam::{DVec3, Vec3};

use super::tree::{self, CoarseMaker, CoarseSize, Node};
use super::{FinerSurface, objects_below};
use crate::addresses::staging::Staging;
use crate::addresses::{is_object, watched};
use crate::preview::{CancelOnly, DEFAULT_TEXELS, border_vertices};
use crate::world::split::names::{name_of_generation, numbered_name};
use crate::world::split::output::{assets_of_others, is_foreign, left_behind};
use crate::{PreviewOptions, World};

/// Distance at which two vertices are one, in the space of the world: that of roundings to single precision, twice for either.
const TOLERANCE: f32 = 4.0 / (1 << 23) as f32;

/// Coarse assets that were made and are not in an index yet. They go away with the value.
#[derive(Debug)]
pub(crate) struct MadeCoarse {
    /// How many.
    pub(crate) count: u64,
    /// What is to be known, a sentence each.
    pub(crate) notes: Vec<String>,
    /// Those that were made, and those that they replace.
    files: Files,
}

/// Makes the coarse assets of all objects of a world that no other coarse asset stands for, and puts them into the index that will be written to
/// `index`. Those that were made so before go from it. Each has about so many triangles and texels as the options say, and what its borders need.
///
/// # Errors
/// An asset cannot be read; a file cannot be written; somebody wants to stop.
pub(crate) fn make_coarse(
    world: &mut World,
    index: &Path,
    options: &PreviewOptions,
    progress: &dyn Progress,
) -> Result<MadeCoarse> {
    let progress = &CancelOnly(progress);
    let mut files = Files::new(world, index)?;
    world.coarse.retain(|coarse| !files.is_own(&coarse.asset));
    let mut notes = Vec::new();
    let Some(space) = world.space() else { return Ok(MadeCoarse { count: 0, notes, files }) };
    let (nodes, bare) = nodes(world, &space)?;
    if bare > 0 {
        notes.push(format!(
            "no coarse asset stands for {} without previews: these are shown whole or not at all; --make-previews gives them some",
            counted(bare, "asset")
        ));
    }
    if nodes.len() < 2 {
        notes
            .push("coarse assets stand for two assets with previews or more, which are not there".to_owned());
        return Ok(MadeCoarse { count: 0, notes, files });
    }
    let meetings = Meetings::of(&nodes, index, space, progress)?;
    let before = world.coarse.len();
    let mut maker =
        ObjectMaker { index, meetings, is_kept: Vec::new(), options, files: &mut files, progress };
    let memory = (options.memory_bytes, options.strict);
    let left_out = tree::add_coarse(world, nodes, &mut maker, memory, progress)?;
    if left_out > 0 {
        notes.push(format!(
            "{} left out, as what is there can hardly be simplified: views from afar take more memory",
            match left_out {
                1 => "a coarse asset is".to_owned(),
                count => format!("{count} coarse assets are"),
            }
        ));
    }
    Ok(MadeCoarse { count: (world.coarse.len() - before) as u64, notes, files })
}

impl MadeCoarse {
    /// They stay, whatever becomes of the index.
    pub(crate) fn keep(&mut self) {
        self.files.written.clear();
    }

    /// The index that names them is there: they stay, and those that they replace go. Returns what is to be known.
    pub(crate) fn stay(mut self) -> Vec<String> {
        self.keep();
        let old = &self.files.old;
        for (number, place) in old.iter().enumerate() {
            if let Err(error) = remove(place) {
                let left: Vec<String> =
                    old[number..].iter().map(|place| place.display().to_string()).collect();
                return vec![left_behind(&left, &error)];
            }
        }
        Vec::new()
    }
}

/// Objects and coarse assets for which no coarse asset stands and that show something from afar, along a curve through the world; and the number of
/// objects that show nothing.
fn nodes(world: &World, space: &WorldFromMesh) -> Result<(Vec<Node>, u64)> {
    let parts = world.parts()?;
    let objects = world.objects.len();
    let mut is_part = vec![false; objects + parts.len()];
    parts.iter().flatten().for_each(|&part| is_part[part] = true);
    let middle = |low: [f64; 3], high: [f64; 3]| {
        morton(space.inverse_point(0.5 * (DVec3::from(low) + DVec3::from(high))))
    };
    let mut nodes = Vec::new();
    let mut bare = 0;
    for (number, object) in world.objects.iter().enumerate().filter(|(number, _)| !is_part[*number]) {
        let Some(preview) = object.preview else {
            bare += 1;
            continue;
        };
        let (asset, detail) = (object.asset.clone(), preview.detail);
        nodes.push((
            middle(object.low, object.high),
            Node { objects: vec![number], asset, is_object: true, is_coarse: true, detail },
        ));
    }
    for (number, coarse) in world.coarse.iter().enumerate().filter(|(number, _)| !is_part[objects + *number])
    {
        let (asset, detail) = (coarse.asset.clone(), coarse.detail);
        let below = objects_below(&parts, objects, number);
        nodes.push((
            middle(coarse.low, coarse.high),
            Node { objects: below, asset, is_object: false, is_coarse: true, detail },
        ));
    }
    nodes.sort_by(|(a, node), (b, other)| a.cmp(b).then_with(|| node.asset.cmp(&other.asset)));
    Ok((nodes.into_iter().map(|(_, node)| node).collect(), bare))
}

/// What a node shows from afar.
fn open(index: &Path, node: &Node) -> Result<Asset> {
    let place = World::place_of(index, &node.asset);
    match node.is_object {
        true => World::open_preview(&place),
        false => World::open_coarse(&place),
    }
}

/// Makes coarse assets of objects.
struct ObjectMaker<'a> {
    index: &'a Path,
    meetings: Meetings,
    /// Per meeting whether objects of several runs are there.
    is_kept: Vec<bool>,
    options: &'a PreviewOptions,
    files: &'a mut Files,
    progress: &'a dyn Progress,
}

impl ObjectMaker<'_> {
    /// The vertices at open borders of a mesh that stay.
    fn kept(&self, mesh: &Mesh) -> Vec<u32> {
        let mut vertices = border_vertices(mesh);
        vertices.retain(|&vertex| {
            let p = mesh.world_from_mesh.point(mesh.positions[vertex as usize]);
            self.meetings
                .find(self.meetings.space.inverse_point(p))
                .is_some_and(|number| self.is_kept[number])
        });
        vertices
    }

    /// The space of a run: that of all its assets with vertices that stay, so that these stay to the last bit; the world's, where there are several, or it
    /// would not hold the run; that of the run's box, where nothing has to stay.
    fn space(&self, finer: &[Arc<Asset>]) -> WorldFromMesh {
        let kept = finer.iter().filter(|asset| !self.kept(asset.mesh()).is_empty());
        let mut spaces = kept.map(|asset| asset.mesh().world_from_mesh);
        let corners = finer.iter().flat_map(|asset| {
            let (mesh, bounds) = (asset.mesh(), asset.mesh().bounds());
            [bounds.min, bounds.max].map(|corner| mesh.world_from_mesh.point(corner))
        });
        let corners: Vec<DVec3> = corners.collect();
        let Some(first) = spaces.next() else {
            let low = corners.iter().copied().reduce(DVec3::min);
            let high = corners.iter().copied().reduce(DVec3::max);
            let own = low.zip(high).and_then(|(low, high)| WorldFromMesh::of_box(low, high));
            return own.unwrap_or(self.meetings.space);
        };
        let holds = |corner: &DVec3| first.inverse_point(*corner).abs().max_element() <= 1.0;
        if spaces.all(|space| space == first) && corners.iter().all(holds) {
            first
        } else {
            self.meetings.space
        }
    }
}

impl CoarseMaker for ObjectMaker<'_> {
    fn begin_level(&mut self, runs: &[u32]) {
        let is_kept = |meeting: &Meeting| {
            let mut runs = meeting.objects.iter().map(|&object| runs[object as usize]);
            let first = runs.next();
            runs.any(|run| Some(run) != first)
        };
        self.is_kept = self.meetings.all.iter().map(is_kept).collect();
    }

    fn open(&self, node: &Node) -> Result<Asset> {
        open(self.index, node)
    }

    fn surface(&self, _run: &[Node], finer: &[Arc<Asset>], memory_bytes: u64) -> (FinerSurface, Vec<u32>) {
        let space = self.space(finer);
        // In the space of one asset its places are what they are; others round them.
        let is_common = space == self.meetings.space;
        let moved = |p: Vec3| match is_common.then(|| self.meetings.find(p)).flatten() {
            Some(number) => self.meetings.all[number].place,
            None => p,
        };
        let surface = FinerSurface::of(finer, space, moved, memory_bytes);
        let kept = self.kept(surface.mesh());
        (surface, kept)
    }

    fn size(&self, _world: &World, _objects: &[usize], kept: usize) -> CoarseSize {
        let PreviewOptions { triangles, texels, .. } = *self.options;
        let triangles = triangles.saturating_add(kept + kept / 2);
        let texels = texels.unwrap_or(DEFAULT_TEXELS).max(16 * triangles as u64);
        CoarseSize { triangles, texels, asked: None }
    }

    fn put(&mut self, write: &mut dyn FnMut(&Path) -> Result<()>) -> Result<(String, Asset)> {
        let name = self.files.next();
        let place = World::place_of(self.index, &name);
        if !is_object(&place) {
            write(&place)?;
            self.files.written.push(place.clone());
            return Ok((name, World::open_coarse(&place)?));
        }
        let staging = Staging::new()?;
        let file = staging.path().join(&name);
        write(&file)?;
        let asset = World::open_coarse(&file)?;
        let watch = |done, total| watched(self.progress, done, total);
        ObjectTarget::at(&place)?.put(&file, &Replace::Nothing, &watch)?;
        self.files.written.push(place);
        Ok((name, asset))
    }
}

/// Places at open borders that several objects have.
struct Meetings {
    /// Of the world.
    space: WorldFromMesh,
    all: Vec<Meeting>,
    /// The numbers of those in each cell of a grid.
    cells: HashMap<[i32; 3], Vec<u32>>,
}

struct Meeting {
    /// In the world's space.
    place: Vec3,
    /// Numbers of objects, each once: of a coarse asset that of its first one.
    objects: Vec<u32>,
}

impl Meetings {
    /// Where what nodes show from afar meets. One asset is open at a time.
    fn of(nodes: &[Node], index: &Path, space: WorldFromMesh, progress: &dyn Progress) -> Result<Self> {
        let mut meetings = Self { space, all: Vec::new(), cells: HashMap::new() };
        for node in nodes {
            if progress.is_cancelled() {
                return Err(Error::cancelled("making coarse assets was cancelled"));
            }
            let asset = open(index, node)?;
            let mesh = asset.mesh();
            for vertex in border_vertices(mesh) {
                let p = mesh.world_from_mesh.point(mesh.positions[vertex as usize]);
                meetings.add(space.inverse_point(p), node.objects[0] as u32);
            }
        }
        // Most are of one object alone.
        let shared =
            std::mem::take(&mut meetings.all).into_iter().filter(|meeting| meeting.objects.len() > 1);
        meetings.all = shared.collect();
        meetings.cells.clear();
        for (number, meeting) in (0u32..).zip(&meetings.all) {
            meetings.cells.entry(cell(meeting.place)).or_default().push(number);
        }
        Ok(meetings)
    }

    fn add(&mut self, place: Vec3, object: u32) {
        match self.find(place) {
            Some(number) => {
                let objects = &mut self.all[number].objects;
                // Objects come one after the other.
                if objects.last() != Some(&object) {
                    objects.push(object);
                }
            }
            None => {
                self.cells.entry(cell(place)).or_default().push(self.all.len() as u32);
                self.all.push(Meeting { place, objects: vec![object] });
            }
        }
    }

    /// The first meeting at a place.
    fn find(&self, place: Vec3) -> Option<usize> {
        let around = |c: i32| (c - 1)..=(c + 1);
        let [x, y, z] = cell(place);
        let mut found: Option<usize> = None;
        for [x, y] in around(x).flat_map(|x| around(y).map(move |y| [x, y])) {
            for number in around(z).filter_map(|z| self.cells.get(&[x, y, z])).flatten() {
                let number = *number as usize;
                let is_it = self.all[number].place.distance(place) <= TOLERANCE;
                if is_it && found.is_none_or(|found| number < found) {
                    found = Some(number);
                }
            }
        }
        found
    }
}

/// Cells are as long as the tolerance, so what is near lies in the next one at most.
fn cell(place: Vec3) -> [i32; 3] {
    // What is far outside has neighbours, too.
    place.to_array().map(|x| ((x / TOLERANCE).floor() as i32).clamp(i32::MIN + 1, i32::MAX - 1))
}

/// Names of coarse assets beside an index, and those that are written. These go away with the value.
#[derive(Debug)]
struct Files {
    /// What all names begin with.
    prefix: String,
    generation: u32,
    next: usize,
    written: Vec<PathBuf>,
    /// Places of those of earlier times: neither an object of this world nor named by another index in the folder.
    old: Vec<PathBuf>,
}

impl Files {
    /// Chooses names that nobody has: `NAME-coarse-0001.fan`, or `NAME-coarse-0001-2.fan`, ...
    fn new(world: &World, index: &Path) -> Result<Self> {
        let path = url_of(index).map_or(index, Path::new);
        let stem = path.file_stem().map_or_else(|| "world".into(), |stem| stem.to_string_lossy());
        // As an index may name them.
        let prefix = format!("{}-coarse-", stem.replace(['\\', ':'], "_"));
        let mut files = Self { prefix, generation: 1, next: 0, written: Vec::new(), old: Vec::new() };
        let mut names: Vec<String> = world.coarse.iter().map(|coarse| coarse.asset.clone()).collect();
        let mut kept: HashSet<String> =
            world.objects.iter().filter_map(|object| World::path_below(&object.asset)).collect();
        if !is_object(index) {
            let folder = folder_of(index);
            let entries = folder.read_dir().map_err(|error| Error::writing(folder, error))?;
            let there: Vec<String> = entries
                .filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()))
                .collect();
            let own = folder.join(index.file_name().unwrap_or_default());
            kept.extend(assets_of_others(folder, &there, &own)?);
            names.extend(there);
        }
        names.sort_unstable();
        names.dedup();
        names.retain(|name| files.is_own(name));
        let taken: HashSet<u32> =
            names.iter().filter_map(|name| Some(numbered_name(name, &[files.prefix.as_str()])?.1)).collect();
        files.old = names
            .iter()
            .filter(|name| !kept.contains(*name))
            .map(|name| World::place_of(index, name))
            .filter(|place| is_object(place) || !is_foreign(place))
            .collect();
        for generation in (1u32..).filter(|generation| !taken.contains(generation)) {
            files.generation = generation;
            let first = World::place_of(index, &files.name(0));
            if !is_object(index) || ObjectTarget::at(&first)?.visible_version()?.is_none() {
                break;
            }
        }
        Ok(files)
    }

    /// Whether an asset's name is one of these.
    fn is_own(&self, name: &str) -> bool {
        numbered_name(name, &[self.prefix.as_str()]).is_some()
    }

    fn name(&self, number: usize) -> String {
        name_of_generation(&format!("{}{:04}", self.prefix, number + 1), self.generation)
    }

    fn next(&mut self) -> String {
        self.next += 1;
        self.name(self.next - 1)
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        // The first one last: while it is there, nobody else takes names of this generation.
        self.written.iter().rev().try_for_each(|place| remove(place)).unwrap_or_default();
    }
}

/// Removes a file or an object, if it is there.
fn remove(place: &Path) -> Result<()> {
    if is_object(place) {
        return ObjectTarget::at(place)?.remove();
    }
    remove_if_there(place)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meetings(points: &[(Vec3, u32)]) -> Meetings {
        let space = WorldFromMesh::default();
        let mut meetings = Meetings { space, all: Vec::new(), cells: HashMap::new() };
        points.iter().for_each(|&(place, object)| meetings.add(place, object));
        meetings
    }

    #[test]
    fn places_meet_up_to_rounding() {
        let p = Vec3::new(0.5, -0.25, 0.125);
        let step = Vec3::splat(0.25 * TOLERANCE);
        let found = meetings(&[(p, 0), (p + step, 1), (p - step, 1), (p + Vec3::X * 4.0 * TOLERANCE, 2)]);
        assert_eq!(found.all.len(), 2);
        assert_eq!((found.all[0].place, &found.all[0].objects[..]), (p, &[0, 1][..]));
        assert_eq!(found.all[1].objects, [2]);
        assert_eq!(found.find(p - step), Some(0));
        assert_eq!(found.find(Vec3::ZERO), None);
        // Where a cell ends.
        let edge = Vec3::splat(3.0 * TOLERANCE);
        assert_eq!(meetings(&[(edge, 0), (edge - step, 1)]).all.len(), 1);
    }

    #[test]
    fn names_are_those_that_nobody_has() {
        let folder = tempfile::tempdir().unwrap();
        let index = folder.path().join("town.fanworld");
        let world = World::default();
        let mut files = Files::new(&world, &index).unwrap();
        assert_eq!([files.next(), files.next()], ["town-coarse-0001.fan", "town-coarse-0002.fan"]);
        for name in ["town-coarse-0007.fan", "town-coarse-0001-3.fan", "city-coarse-0001-2.fan"] {
            std::fs::write(folder.path().join(name), b"\x89FAN there").unwrap();
        }
        // Of such a name, but no asset.
        let foreign = folder.path().join("town-coarse-0008.fan");
        std::fs::write(&foreign, "mine").unwrap();
        let mut files = Files::new(&world, &index).unwrap();
        assert_eq!(files.next(), "town-coarse-0001-2.fan");
        let old = ["town-coarse-0001-3.fan", "town-coarse-0007.fan"].map(|name| folder.path().join(name));
        assert_eq!(files.old, old);
        // What is written goes, unless it stays.
        let written = folder.path().join(files.next());
        std::fs::write(&written, "new").unwrap();
        files.written.push(written.clone());
        let made = MadeCoarse { count: 1, notes: Vec::new(), files };
        drop(made);
        assert!(!written.exists() && old.iter().all(|place| place.exists()));
        let files = Files::new(&world, &index).unwrap();
        std::fs::write(&written, "new").unwrap();
        let mut made = MadeCoarse { count: 1, notes: Vec::new(), files };
        made.files.written.push(written.clone());
        assert!(made.stay().is_empty());
        assert!(written.exists() && !old.iter().any(|place| place.exists()));
        assert!(folder.path().join("city-coarse-0001-2.fan").exists() && foreign.exists());
    }
}
