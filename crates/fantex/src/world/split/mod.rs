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

pub(crate) mod names;
pub(crate) mod output;
mod sectors;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::{Error, Result, counted, grouped};
use fantex_store::Asset;

use self::names::{COARSE_PREFIX, SECTOR_PREFIX, file_name};
use self::output::Output;
use self::sectors::{Plan, shared_vertices};
use super::coarse::FinerSurface;
use super::coarse::tree::{self, CoarseMaker, CoarseSize, Node, RUN};
use crate::{World, WorldObject};

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
    let unfinished = output.unfinished_folder();
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
