//! A large asset as a world of small ones.
//!
//! The groups of a cover are ordered along a space-filling curve. A *sector* is a run of them: an asset of the triangles whose lowest group lies
//! in the run, with all groups that these triangles name. So the texture function on each triangle is that of the whole, and tiles at borders
//! are in several sectors, as far as these read them. Groups of more than half a sector's triangles are cut along a curve through space; each piece has the tile.
//!
//! ```text
//!  groups   0 1 2 3 | 4 5 6 7 8 | 9 ...
//!  sector   1       | 2         | 3       the triangle of groups 3, 4 and 8 lies in sector 1, which has tiles 4 and 8, too
//! ```
//!
//! Where there are many sectors, runs of them get coarse assets, and runs of these, up to a single one. Each has about the size of one
//! sector's preview, beside what its outline needs: vertices that sectors of other runs have, too, stay where they are.
//!
//! Surfaces that can hardly be simplified get neither: what is as large as what it stands for takes bytes and memory, and saves none.
//!
//! A world takes the place of another one by its index alone: its assets have names that those of the other do not have, and lie beside them. So
//! whoever reads sees one or the other, and what ends on the way leaves the old one. The assets that the old index named go last.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::files::{TemporaryFolder, persist_all, remove_leftovers, sync_folder, temporary_folder};
use fantex_base::{Error, ErrorKind, Result, UnionFind, counted, grouped, input};
use fantex_cover::{Cover, GroupTriangles};
use fantex_mesh::{Edges, Mesh, corners_of, morton, shading_normals};
use fantex_store::{Asset, AssetEditor, CreateOptions, EditOptions, GroupCopy, WriterLock};
use fantex_stream::url_of;
use glam::Vec3;
use rayon::prelude::*;
use tempfile::TempPath;

use super::coarse::tree::{self, CoarseMaker, CoarseSize, Node, RUN};
use super::coarse::{FinerSurface, Place, place};
use crate::preview::{coarse_mesh, is_worth_it};
use crate::{Preview, PreviewOptions, WORLD_EXTENSION, World, WorldObject};

/// How to split an asset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplitOptions {
    /// Triangles of a sector, about; at least 1.
    pub triangles: usize,
    /// The sectors' previews, and the coarse assets that are made of them; none: neither is there. Those that would have more than 5000 triangles
    /// and two thirds of those of what they stand for are left out, unless they are to be so large.
    pub previews: Option<SectorPreviews>,
    /// Bytes that decoded tiles and texels in work may take while previews are made.
    pub memory_bytes: u64,
    /// Write into a folder that is not empty, and over a world that is there.
    pub force: bool,
}

impl Default for SplitOptions {
    /// 250 000 triangles, with previews, 512 MiB, only into a new or empty folder.
    fn default() -> Self {
        let previews = Some(SectorPreviews::default());
        Self { triangles: 250_000, previews, memory_bytes: 512 << 20, force: false }
    }
}

/// How large the previews of sectors are, and coarse assets, each of which is made like the preview of a sector of mean size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SectorPreviews {
    /// Triangles, about; by default a 64th of the sector's, and as many as its border needs. Borders may need more than what is given.
    pub triangles: Option<usize>,
    /// Stored texels at level 0, per channel; by default a 64th of the sector's, and at least 16 per triangle.
    pub texels: Option<u64>,
}

impl SectorPreviews {
    /// Triangles for a sector with so many triangles and vertices at its border.
    fn triangles(&self, triangles: usize, border: usize) -> usize {
        self.triangles.unwrap_or(triangles / 64 + border + border / 2).max(1)
    }

    fn texels(&self, texels: u64, triangles: usize) -> u64 {
        self.texels.unwrap_or((texels / 64).max(16 * triangles as u64))
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// The index.
    pub index: PathBuf,
    /// What it says: an object per sector, and of more than 16 sectors the coarse assets.
    pub world: World,
    /// Texels of tiles at level 0 that are in more than one sector, counted beyond the first, per channel. Most of them are left out: what no
    /// triangle of the sector reads takes no room.
    pub repeated_texels: u64,
    /// What is to be known, a sentence each.
    pub notes: Vec<String>,
}

/// Splits an asset into sectors in a folder, which is made where there is none: `sector-0001.fan`, ..., of more than 16 sectors `coarse-0001.fan`,
/// ..., and, when all are there, the index `NAME.fanworld`, NAME being the asset's. The asset stays as it is; attachments (layers, history) stay
/// with it alone. Where a world is in the folder, the files of the new one are `sector-0001-2.fan`, ..., and the new index takes the place of the old
/// one at once, or nothing is written and nothing removed.
///
/// Sectors have the mesh space, materials, names of parts and corner attributes of the whole, and its shading normals. Vertices that sectors share
/// are at the same places in sectors, previews and coarse assets that meet there, to the last bit. Memory beside the asset grows with the
/// triangles, by about 100 bytes each, not with the texels.
///
/// # Errors
/// The folder is not empty (unless forced) or cannot be written; texels of the asset are damaged; the memory that is
/// [allowed](fantex_base::ReadLimits) does not suffice; somebody wants to stop. Then nothing is left of the sectors, and a world that was in the folder is
/// as it was.
pub fn split(
    asset: &Arc<Asset>,
    folder: &Path,
    options: &SplitOptions,
    progress: &dyn Progress,
) -> Result<Split> {
    if options.triangles == 0 {
        return Err(Error::invalid("a sector has at least one triangle"));
    }
    let index = folder.join(Split::index_name(asset.path()));
    let output = Output::begin(folder, &index, options.force)?;
    let unfinished = output.unfinished.as_ref().map(|unfinished| unfinished.path().to_owned());
    write_world(asset, output, index, options, progress).map_err(|error| match unfinished {
        Some(unfinished) => error.renamed(&unfinished, folder),
        None => error,
    })
}

fn write_world(
    asset: &Arc<Asset>,
    mut output: Output,
    index: PathBuf,
    options: &SplitOptions,
    progress: &dyn Progress,
) -> Result<Split> {
    let plan = Plan::of(asset, options.triangles)?;
    let mut world = World::default();
    let (mut done, mut in_sectors) = (0, 0);
    let mut left_out = LeftOut::default();
    let all = asset.mesh().triangles.len() as u128;
    for number in 0..plan.sectors.len() {
        let name = file_name(SECTOR_PREFIX, number);
        let path = output.add(&name);
        let sector = plan.sector(number);
        let (triangles, texels) = (sector.mesh.triangles.len() as u64, sector.cover.texels());
        in_sectors += texels;
        // The whole's texels in proportion to the triangles.
        let mut report = |copied: u64| match progress.is_cancelled() {
            true => Err(Error::cancelled("the split was cancelled")),
            false => {
                let own = u128::from(triangles) * u128::from(copied) / u128::from(texels.max(1));
                let triangles = u128::from(done) + own;
                progress.report((u128::from(plan.texels) * triangles / all) as u64, plan.texels);
                Ok(())
            }
        };
        sector.write(&path, asset, &mut report)?;
        if let Some(previews) = &options.previews {
            let unmade = sector.add_preview(&path, previews, options.memory_bytes, progress)?;
            left_out.add_preview(triangles, unmade);
        }
        done += triangles;
        let written = Asset::open(&path)?;
        world.objects.push(WorldObject::of(name, &written)?);
    }
    if let Some(previews) = &options.previews {
        let output = (&mut world, &mut output);
        left_out.coarse = add_coarse(&plan, output, previews, options.memory_bytes, progress)?;
    }
    if progress.is_cancelled() {
        return Err(Error::cancelled("the split was cancelled"));
    }
    let mut notes = left_out.notes(plan.sectors.len());
    notes.extend(output.finish(&mut world, &index)?);
    let repeated_texels = in_sectors.saturating_sub(plan.texels);
    Ok(Split { index, world, repeated_texels, notes })
}

/// Previews and coarse assets that are not there because they would be hardly smaller than what they stand for.
#[derive(Default)]
struct LeftOut {
    previews: u64,
    /// Of these previews.
    triangles: u64,
    /// Of their sectors.
    sector_triangles: u64,
    coarse: u64,
}

impl LeftOut {
    /// `unmade`: the triangles of a sector's preview that is left out.
    fn add_preview(&mut self, sector_triangles: u64, unmade: Option<u64>) {
        if let Some(triangles) = unmade {
            self.previews += 1;
            self.triangles += triangles;
            self.sector_triangles += sector_triangles;
        }
    }

    fn notes(&self, sectors: usize) -> Vec<String> {
        let mut notes = Vec::new();
        let [triangles, all] = [self.triangles, self.sector_triangles].map(|count| grouped(count, ' '));
        if self.previews > 0 {
            notes.push(format!(
                "previews are left out of {} of {}, which can hardly be simplified ({triangles} of {all} triangles would remain): these are \
                 shown whole or not at all",
                self.previews,
                counted(sectors as u64, "sector"),
            ));
        }
        if self.coarse > 0 {
            notes.push(format!(
                "the surface can hardly be simplified, so {} left out: views from afar take more memory",
                match self.coarse {
                    1 => "a coarse asset is".to_owned(),
                    count => format!("{count} coarse assets are"),
                },
            ));
        }
        notes
    }
}

impl Split {
    /// The file name of the index of the sectors of an asset at a path or an address.
    pub fn index_name(asset: &Path) -> String {
        let asset = url_of(asset).map_or(asset, |url| Path::new(url.split(['?', '#']).next().unwrap_or(url)));
        let name = asset.file_stem().map_or_else(|| "world".into(), |stem| stem.to_string_lossy());
        format!("{name}.{WORLD_EXTENSION}")
    }

    /// Whether a file name is that of a sector or of a coarse asset; such files of a world go when another takes its place.
    pub fn is_asset_name(file: &str) -> bool {
        parts_of_name(file).is_some()
    }

    /// The file name of a sector or a coarse asset in the world of a generation, whatever its own is. Worlds that take each other's places are of
    /// different generations, so that their assets can lie side by side.
    pub(crate) fn name_in_generation(file: &str, generation: u32) -> String {
        parts_of_name(file).map_or_else(|| file.to_owned(), |(stem, _)| name_of_generation(stem, generation))
    }
}

/// The file name of a stem, without an extension, in a generation.
pub(crate) fn name_of_generation(stem: &str, generation: u32) -> String {
    match generation {
        1 => format!("{stem}.fan"),
        _ => format!("{stem}-{generation}.fan"),
    }
}

/// The name of a sector's or a coarse asset's file without its generation, and that: `sector-0001.fan` has the first, `sector-0001-2.fan` the second.
fn parts_of_name(file: &str) -> Option<(&str, u32)> {
    numbered_name(file, &[SECTOR_PREFIX, COARSE_PREFIX])
}

/// The same of a file whose name begins with one of some words, before its number.
pub(crate) fn numbered_name<'f>(file: &'f str, prefixes: &[&str]) -> Option<(&'f str, u32)> {
    let name = file.strip_suffix(".fan")?;
    let prefix = prefixes.iter().find(|prefix| name.starts_with(**prefix))?;
    let (number, generation) = match name[prefix.len()..].split_once('-') {
        Some((_, generation)) if generation.starts_with(['+', '0']) => return None,
        Some((number, generation)) => (number, generation.parse::<u32>().ok().filter(|&number| number > 1)?),
        None => (&name[prefix.len()..], 1),
    };
    let is_number = number.len() >= 4 && number.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| (&name[..prefix.len() + number.len()], generation))
}

/// The generation of a sector's or a coarse asset's file.
pub(crate) fn generation_of(file: &str) -> Option<u32> {
    Some(parts_of_name(file)?.1)
}

/// Says that files or objects of a world which is no more could not be removed.
pub(crate) fn left_behind(left: &[String], error: &Error) -> String {
    const NAMED: usize = 8;
    let names = left.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = match left.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    format!(
        "the world that was replaced has left what could not be removed, and may go: {names}{more} ({error})"
    )
}

/// The file of a sector or a coarse asset, counted from 0.
fn file_name(prefix: &str, number: usize) -> String {
    format!("{prefix}{:04}.fan", number + 1)
}

const SECTOR_PREFIX: &str = "sector-";
const COARSE_PREFIX: &str = "coarse-";

/// A coarse asset is made at least as for sectors of so many triangles: of very small ones it would show next to nothing.
const MIN_SIZE: u64 = 64_000;

/// Makes the coarse assets of more than 16 sectors. Returns how many are left out.
fn add_coarse(
    plan: &Plan<'_>,
    (world, output): (&mut World, &mut Output),
    previews: &SectorPreviews,
    memory_bytes: u64,
    progress: &dyn Progress,
) -> Result<u64> {
    if world.objects.len() <= RUN {
        return Ok(0);
    }
    let node = |(number, object): (usize, &WorldObject)| Node {
        objects: vec![number],
        asset: object.asset.clone(),
        is_object: true,
        is_coarse: object.preview.is_some(),
        detail: object.preview.map_or(0.0, |preview| preview.detail),
    };
    let nodes = world.objects.iter().enumerate().map(node).collect();
    let mut maker = SectorMaker { plan, output, previews, is_shared: Vec::new(), made: 0 };
    tree::add_coarse(world, nodes, &mut maker, (memory_bytes, false), progress)
}

/// Makes coarse assets of sectors.
struct SectorMaker<'a> {
    plan: &'a Plan<'a>,
    output: &'a mut Output,
    previews: &'a SectorPreviews,
    /// Per vertex whether sectors of several runs have it.
    is_shared: Vec<bool>,
    made: usize,
}

impl CoarseMaker for SectorMaker<'_> {
    fn begin_level(&mut self, runs: &[u32]) {
        self.is_shared = shared_vertices(self.plan.mesh, &self.plan.sectors, runs);
    }

    fn open(&self, node: &Node) -> Result<Asset> {
        self.output.open_coarsest(node)
    }

    fn surface(&self, run: &[Node], finer: &[Arc<Asset>], memory_bytes: u64) -> (FinerSurface, Vec<u32>) {
        let surface = FinerSurface::of(finer, self.plan.mesh.world_from_mesh, |p| p, memory_bytes);
        let sectors: Vec<usize> = run.iter().flat_map(|node| node.objects.iter().copied()).collect();
        let kept = surface.vertices_at(&self.plan.places(&self.is_shared, &sectors));
        (surface, kept)
    }

    fn size(&self, world: &World, objects: &[usize], kept: usize) -> CoarseSize {
        let sectors = || objects.iter().map(|&number| &world.objects[number]);
        let mean = |of: fn(&WorldObject) -> u64| sectors().map(of).sum::<u64>() / objects.len() as u64;
        let size = mean(|object| object.triangles).max(MIN_SIZE);
        let triangles = self.previews.triangles(size as usize, kept);
        let texels = self.previews.texels(mean(|object| object.texels), triangles);
        CoarseSize { triangles, texels, asked: self.previews.triangles }
    }

    fn put(&mut self, write: &mut dyn FnMut(&Path) -> Result<()>) -> Result<(String, Asset)> {
        let name = file_name(COARSE_PREFIX, self.made);
        self.made += 1;
        let path = self.output.add(&name);
        write(&path)?;
        Ok((name, Asset::open(&path)?))
    }
}

/// The folder while sectors are written, in a folder within it. What was written goes away unless it is finished.
struct Output {
    folder: PathBuf,
    was_made: bool,
    /// That of an index that may be there.
    lock: Option<WriterLock>,
    unfinished: Option<TemporaryFolder>,
    /// Sectors and coarse assets that are there and belong to the world that is replaced, or to none.
    replaced: Vec<PathBuf>,
    /// Names of sectors and coarse assets.
    written: Vec<String>,
}

impl Output {
    fn begin(folder: &Path, index: &Path, force: bool) -> Result<Self> {
        let writing = |error| Error::writing(folder, error);
        let was_made = !folder.exists();
        if was_made {
            std::fs::create_dir_all(folder).map_err(writing)?;
        }
        let mut output = Self {
            folder: folder.into(),
            was_made,
            lock: None,
            unfinished: None,
            replaced: Vec::new(),
            written: Vec::new(),
        };
        remove_leftovers(folder);
        let names = names_in(folder)?;
        if !force && !names.is_empty() {
            let folder = folder.display();
            return Err(Error::conflict(format!(
                "{folder} is not empty; give another folder, or write over the world in it with --force"
            )));
        }
        // In an empty folder there is nothing that somebody else could change.
        output.lock = if force { lock_index(index)? } else { None };
        let others = assets_of_others(folder, &names, index)?;
        let assets = names.iter().filter(|name| Split::is_asset_name(name) && !others.contains(*name));
        output.replaced.extend(assets.map(|name| folder.join(name)));
        output.replaced.iter().map(PathBuf::as_path).chain([index]).try_for_each(input::check_output)?;
        // What somebody paints on one of them would be lost.
        output.replaced.iter().try_for_each(|path| WriterLock::of_replaced(path).map(drop))?;
        output.unfinished = Some(temporary_folder(folder).map_err(writing)?);
        Ok(output)
    }

    /// Where a file is until all are there.
    fn unfinished(&self, name: impl AsRef<Path>) -> PathBuf {
        self.unfinished.as_ref().map_or(&*self.folder, TemporaryFolder::path).join(name)
    }

    /// The path of a file that is written now.
    fn add(&mut self, name: &str) -> PathBuf {
        self.written.push(name.to_owned());
        self.unfinished(name)
    }

    /// The preview of a sector, or a coarse asset.
    fn open_coarsest(&self, node: &Node) -> Result<Asset> {
        let path = self.unfinished(&node.asset);
        match node.is_object {
            true => World::open_preview(&path),
            false => Asset::open(&path),
        }
    }

    /// Puts all files in their places, then the index, and removes the assets of the world that it replaces. Nothing is changed of that before the
    /// new one is there and durable. Returns what is to be known.
    fn finish(mut self, world: &mut World, index: &Path) -> Result<Vec<String>> {
        let taken: HashSet<u32> =
            names_in(&self.folder)?.iter().filter_map(|name| generation_of(name)).collect();
        let generation = (1..).find(|generation| !taken.contains(generation)).unwrap_or(1);
        let renamed = |name: &str| Split::name_in_generation(name, generation);
        world.rename_assets(renamed);
        let unfinished_index = self.unfinished(index.file_name().unwrap_or_default());
        world.write(&unfinished_index)?;
        let place = |name: &String| self.folder.join(renamed(name));
        let file = |name: &String| -> Result<(TempPath, PathBuf)> {
            let file = self.unfinished(name);
            let temporary = TempPath::try_from_path(&file).map_err(|error| Error::writing(&file, error))?;
            Ok((temporary, place(name)))
        };
        persist_all(self.written.iter().map(file).collect::<Result<_>>()?, false)?;
        if let Err(error) = std::fs::rename(unfinished_index, index) {
            self.written.iter().for_each(|name| std::fs::remove_file(place(name)).unwrap_or_default());
            return Err(Error::writing(index, error));
        }
        self.was_made = false;
        // Until then a crash may leave either index, so both worlds have to be there.
        sync_folder(&self.folder)?;
        let mut failure = None;
        let mut left = Vec::new();
        for path in &self.replaced {
            if let Err(error) = remove_asset(path) {
                left.push(path.display().to_string());
                failure.get_or_insert(error);
            }
        }
        Ok(failure.iter().map(|error| left_behind(&left, error)).collect())
    }
}

/// Removes an asset, if it is there and nobody changes it.
fn remove_asset(path: &Path) -> Result<()> {
    let _lock = WriterLock::of_replaced(path)?;
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Error::writing(path, error)),
        _ => Ok(()),
    }
}

/// Keeps others from changing or replacing an index in a folder meanwhile.
pub(crate) fn lock_index(index: &Path) -> Result<Option<WriterLock>> {
    match WriterLock::acquire(index) {
        Err(error) if error.kind() == ErrorKind::Conflict => Err(error),
        // Where there is no lock, the index cannot be written either, which is told then.
        lock => Ok(lock.ok()),
    }
}

/// Names of what is in a folder.
fn names_in(folder: &Path) -> Result<Vec<String>> {
    let names = folder.read_dir().and_then(|entries| {
        entries.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
    });
    names.map_err(|error| Error::writing(folder, error))
}

/// What other indexes than `index` name in a folder: their assets stay.
pub(crate) fn assets_of_others(folder: &Path, names: &[String], index: &Path) -> Result<HashSet<String>> {
    let others = names.iter().map(|name| folder.join(name));
    let mut assets = HashSet::new();
    for other in others.filter(|other| World::is_named(other) && other != index) {
        let world = World::open_to_change(&other).map_err(|error| {
            let folder = folder.display();
            error.context(format!("cannot tell which files in {folder} belong to another world"))
        })?;
        assets.extend(world.assets().filter_map(World::path_below));
    }
    Ok(assets)
}

impl Drop for Output {
    fn drop(&mut self) {
        drop((self.unfinished.take(), self.lock.take()));
        if self.was_made {
            std::fs::remove_dir(&self.folder).unwrap_or_default();
        }
    }
}

/// Which triangles are in which sector.
struct Plan<'a> {
    mesh: &'a Mesh,
    cover: &'a Cover,
    /// Ascending triangles of each sector.
    sectors: Vec<Vec<u32>>,
    /// Per vertex whether several sectors have it.
    is_shared: Vec<bool>,
    /// Shading normals per corner.
    normals: Vec<Vec3>,
    /// Triangles with a corner in each group.
    in_group: Vec<u32>,
    /// Of all tiles at level 0.
    texels: u64,
}

/// Bytes that a plan takes per triangle: edges while it is made (48), normals (36), numbers of triangles.
const PLAN_BYTES: u64 = 100;

impl<'a> Plan<'a> {
    fn of(asset: &'a Asset, triangles: usize) -> Result<Self> {
        let (mesh, cover) = (asset.mesh(), asset.cover());
        let count = mesh.triangles.len();
        let what = format_args!("splitting {} with {count} triangles", asset.path().display()).to_string();
        let _held = input::reserve(what, PLAN_BYTES * count as u64)?;
        let sectors = sectors(mesh, cover, triangles);
        let alone: Vec<u32> = (0..sectors.len() as u32).collect();
        let is_shared = shared_vertices(mesh, &sectors, &alone);
        let normals = shading_normals(mesh);
        let mut in_group = vec![0; cover.groups.len()];
        for triangle in 0..mesh.triangles.len() as u32 {
            cover.groups_of(triangle).for_each(|group| in_group[group as usize] += 1);
        }
        Ok(Self { mesh, cover, sectors, is_shared, normals, in_group, texels: cover.texels() })
    }

    /// Places in the mesh space of those vertices of some sectors that are marked.
    fn places(&self, is_marked: &[bool], sectors: &[usize]) -> HashSet<Place> {
        let triangles = sectors.iter().flat_map(|&sector| &self.sectors[sector]);
        let vertices = triangles.flat_map(|&triangle| self.mesh.triangles[triangle as usize]);
        let marked = vertices.filter(|&vertex| is_marked[vertex as usize]);
        marked.map(|vertex| place(self.mesh.positions[vertex as usize])).collect()
    }

    fn sector(&self, number: usize) -> Sector {
        let triangles = &self.sectors[number];
        let (mut mesh, vertices) = self.mesh.subset(triangles);
        mesh.corners.normals = corners_of(&self.normals, triangles);
        let border = (0u32..).zip(&vertices).filter(|(_, vertex)| self.is_shared[**vertex as usize]);
        let border = border.map(|(own, _)| own).collect();
        let (cover, groups) = self.cover.subset(triangles);
        let own = GroupTriangles::of(&cover);
        let is_partial = (0u32..).zip(&groups);
        let is_partial = is_partial.map(|(own_group, &group)| {
            own.of_group(own_group).len() < self.in_group[group as usize] as usize
        });
        Sector { mesh, is_partial: is_partial.collect(), cover, groups, border }
    }
}

/// Per vertex whether sectors of several runs have it. `runs`: per sector the number of its run.
fn shared_vertices(mesh: &Mesh, sectors: &[Vec<u32>], runs: &[u32]) -> Vec<bool> {
    let mut is_shared = vec![false; mesh.positions.len()];
    let mut first_run = vec![u32::MAX; mesh.positions.len()];
    for (sector, &number) in sectors.iter().zip(runs) {
        let triangles = sector.iter().map(|&t| mesh.triangles[t as usize]);
        for vertex in triangles.flatten().map(|vertex| vertex as usize) {
            match first_run[vertex] {
                u32::MAX => first_run[vertex] = number,
                first => is_shared[vertex] |= first != number,
            }
        }
    }
    is_shared
}

/// Ascending triangles of each sector, of which there are about so many.
fn sectors(mesh: &Mesh, cover: &Cover, triangles: usize) -> Vec<Vec<u32>> {
    let keys = keys(mesh, cover);
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    order.par_sort_unstable_by_key(|&triangle| (keys[triangle as usize], triangle));
    let (all, wanted) = (order.len(), order.len().div_ceil(triangles));
    let (mut sectors, mut sector) = (Vec::new(), Vec::new());
    let (mut before, mut current) = (0, 0);
    let key = |triangle: &u32| keys[*triangle as usize];
    for group in order.chunk_by(|a, b| key(a).group == key(b).group) {
        let is_large = group.len() > triangles / 2;
        // A small group stays whole.
        let pieces: Vec<&[u32]> = match is_large {
            true => group.chunk_by(|a, b| key(a) == key(b)).collect(),
            false => vec![group],
        };
        for piece in pieces {
            let due = before * wanted / all;
            if due > current {
                sectors.push(std::mem::take(&mut sector));
                current = due;
            }
            sector.extend_from_slice(piece);
            before += piece.len();
        }
    }
    sectors.push(sector);
    sectors.iter_mut().for_each(|sector: &mut Vec<u32>| sector.sort_unstable());
    sectors
}

/// Where a triangle stands in the order in which sectors are cut: by group, and within large groups along a curve through space.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    group: u32,
    curve: u32,
}

/// The keys of all triangles: the lowest group at the corners; triangles that belong together have the lowest key of all of them.
fn keys(mesh: &Mesh, cover: &Cover) -> Vec<Key> {
    let mut sets = joined_triangles(mesh);
    let key = |(t, &[a, b, c]): (usize, &[u32; 3])| {
        let [p, q, r] = mesh.triangle_positions(t);
        Key { group: a.min(b).min(c), curve: morton((p + q + r) / 3.0) }
    };
    let mut keys: Vec<Key> = cover.corner_groups.par_iter().enumerate().map(key).collect();
    for triangle in 0..keys.len() as u32 {
        let set = sets.find(triangle) as usize;
        keys[set] = keys[set].min(keys[triangle as usize]);
    }
    // The smallest member of a set stands for it, so its key is final when the others take it.
    for triangle in 0..keys.len() as u32 {
        keys[triangle as usize] = keys[sets.find(triangle) as usize];
    }
    keys
}

/// Sets of triangles that stay together: the two sides of a leaf, and those around an edge of more than two triangles, which continue each
/// other by what else lies there. (Where two leaves meet, front continues front and back back, whether or not the other leaf is there.)
fn joined_triangles(mesh: &Mesh) -> UnionFind {
    let mut sets = UnionFind::new(mesh.triangles.len());
    for edge in Edges::of(&mesh.triangles).iter().filter(|edge| edge.triangle_count() > 1) {
        let mut at_edge: Vec<(u32, u32)> =
            edge.triangles().map(|(triangle, third)| (third, triangle)).collect();
        at_edge.sort_unstable();
        let mut leaves = 0;
        for pair in at_edge.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            leaves += 1;
            sets.union(pair[0].1, pair[1].1);
        }
        let are_two_leaves = at_edge.len() == 4 && leaves == 2 && at_edge[1].0 != at_edge[2].0;
        if at_edge.len() > 2 && !are_two_leaves {
            at_edge.windows(2).for_each(|pair| {
                sets.union(pair[0].1, pair[1].1);
            });
        }
    }
    sets
}

/// A part of the asset before it is written.
struct Sector {
    mesh: Mesh,
    cover: Cover,
    /// Which group of the whole each group is.
    groups: Vec<u32>,
    /// Whether other sectors have triangles in it, too.
    is_partial: Vec<bool>,
    /// Vertices that other sectors have, too.
    border: Vec<u32>,
}

impl Sector {
    fn write(&self, path: &Path, whole: &Asset, report: &mut dyn FnMut(u64) -> Result<()>) -> Result<()> {
        let options = CreateOptions::default();
        let Self { mesh, cover, groups, is_partial, .. } = self;
        GroupCopy { mesh, cover, from: whole, groups, is_partial }.write(path, &options, report).map(drop)
    }

    /// Adds its preview, unless that would be hardly smaller: then its triangles are returned.
    fn add_preview(
        &self,
        path: &Path,
        previews: &SectorPreviews,
        memory_bytes: u64,
        progress: &dyn Progress,
    ) -> Result<Option<u64>> {
        let mut editor = AssetEditor::open(path, &EditOptions::default())?;
        let triangles = previews.triangles(self.mesh.triangles.len(), self.border.len());
        let texels = previews.texels(self.cover.stored_texels(&self.mesh), triangles);
        let options = PreviewOptions {
            triangles,
            texels: Some(texels),
            keeps_borders: true,
            memory_bytes,
            strict: false,
        };
        let coarse = coarse_mesh(editor.asset().mesh(), triangles, &self.border)?;
        if !is_worth_it(&coarse, editor.asset().mesh(), previews.triangles) {
            return Ok(Some(coarse.triangles.len() as u64));
        }
        Preview::of_coarse(editor.asset(), &coarse, &options, progress)?.attach(&mut editor)?;
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_sectors_tell_their_generation() {
        for (file, parts) in [
            ("sector-0001.fan", Some(("sector-0001", 1))),
            ("coarse-12345-17.fan", Some(("coarse-12345", 17))),
            ("sector-0001-2.fan", Some(("sector-0001", 2))),
            ("sector-0001-1.fan", None),
            ("sector-0001-02.fan", None),
            ("sector-0001-+2.fan", None),
            ("sector-0001-.fan", None),
            ("sector-001.fan", None),
            ("sector-0001-2-3.fan", None),
            ("sector-0001.part", None),
            ("a-sector-0001.fan", None),
        ] {
            assert_eq!(parts_of_name(file), parts, "{file}");
        }
        let name = Split::name_in_generation;
        assert_eq!(name("sector-0001.fan", 1), "sector-0001.fan");
        assert_eq!(name("sector-0001-2.fan", 1), "sector-0001.fan");
        assert_eq!(name("coarse-0001-2.fan", 3), "coarse-0001-3.fan");
        assert_eq!(name("houses/church.fan", 3), "houses/church.fan");
    }
}
