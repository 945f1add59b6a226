//! From a mesh and a source of colour to an asset.

pub(crate) mod channels;
pub(crate) mod materials;
#[cfg(feature = "http")]
mod merge;
#[cfg(feature = "export")]
mod model;
mod observer;
mod own_materials;
mod parts;
#[cfg(feature = "photos")]
mod photos;
mod refined;
mod source;
mod transfer;

use std::borrow::Cow;
use std::cell::RefCell;
use std::path::Path;
use std::time::{Duration, Instant};

use fantex_bake::{
    BakeFormat, BakeOptions, BakeSummary, Fit, NoProgress, Progress, Source as BakeSource, bake, bake_part,
    plan_bake,
};
use fantex_base::random::{DEFAULT_SEED, folded_seed};
use fantex_base::{Error, ReadLimits, Result, counted, input, were};
use fantex_cover::{Cover, CoverOptions, CoverStats, TexelBudget, build_cover_while};
use fantex_look::{LookFile, LookImages, ResolveOptions};
use fantex_mesh::check_hard_edges;
use fantex_store::{ChannelKind, Plan, Quality, Recipe};
use fantex_texture::material::LeftOut;
use glam::Vec4;

#[cfg(feature = "export")]
use fantex_export::ExportOptions;
#[cfg(feature = "http")]
pub use merge::{Merge, Merged};
pub use own_materials::OwnLook;
#[cfg(feature = "photos")]
pub use photos::PhotoSet;
pub use refined::LongestEdge;
pub(crate) use refined::budget_texels;
pub use source::Source;

use self::channels::FilledChannels;
use self::materials::without_textures;
use self::observer::Observer;
use self::own_materials::{MANY_TEXELS, OwnDensity};
use self::source::Kind;
use crate::look_scene::{LookBake, MaterialResolver, check_size};
use crate::{Asset, FileKind, Mesh, smallest_tiles_note};

/// How many texels, before the mesh and the source are known.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Budget {
    /// The source's own density, else [`Baker::default_texels`].
    Default,
    Texels(u64),
    /// Per world unit of length.
    Density(f64),
    Matching,
}

/// Bakes a source onto a mesh: covers the mesh, fills the tiles, writes the asset.
///
/// Without a source the model's own materials or vertex colours are baked; without a number of texels textures keep their own
/// density (small ones get up to 16 texels for each of theirs, 262 144 in all), and everything else gets [`Baker::default_texels`]. A model
/// that repeats its textures gets at most 16 million, or twice the texels of its images, and a note.
///
/// ```
/// use fantex::bake::TexelPoint;
/// use fantex::glam::Vec4;
/// use fantex::{Baker, Mesh, Source};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("stripes.fan");
/// let mesh = Mesh::from_triangles(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
/// let stripes = |point: &TexelPoint| Vec4::splat((20.0 * point.position.x).sin().abs());
/// let baked = Baker::new(&mesh).source(Source::function(stripes)).texels(10_000).write(&path)?;
/// println!("{} texels in {} tiles", baked.summary.texels, baked.cover.groups);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
#[must_use = "nothing is baked before `write`"]
pub struct Baker<'a> {
    mesh: &'a Mesh,
    source: Option<Source<'a>>,
    budget: Budget,
    default_texels: u64,
    /// With what they are where nothing says more.
    channels: Vec<(ChannelKind, Vec4)>,
    tile: u32,
    hard_edges: Option<f32>,
    /// As the kind of source suggests where nothing was said.
    longest_edge: Option<LongestEdge>,
    seed: u64,
    options: BakeOptions,
    progress: Observer<'a>,
}

impl<'a> Baker<'a> {
    /// Texels where nothing else says how many, not even [`default_texels`](Self::default_texels).
    pub const DEFAULT_TEXELS: u64 = 4_000_000;

    /// A baker for a mesh.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self {
            mesh,
            source: None,
            budget: Budget::Default,
            default_texels: Self::DEFAULT_TEXELS,
            channels: Vec::new(),
            tile: CoverOptions::default().tile,
            hard_edges: None,
            longest_edge: None,
            seed: DEFAULT_SEED,
            options: BakeOptions::default(),
            progress: Observer::new(&NoProgress),
        }
    }

    /// What is baked.
    pub fn source(self, source: Source<'a>) -> Self {
        Self { source: Some(source), ..self }
    }

    /// Texels in all.
    pub fn texels(self, texels: u64) -> Self {
        Self { budget: Budget::Texels(texels), ..self }
    }

    /// Texels in all where neither a number or density is given nor the source has a density of its own.
    pub fn default_texels(self, texels: u64) -> Self {
        Self { default_texels: texels, ..self }
    }

    /// A channel that the asset has in any case. Where the source lacks it, it holds what the model's materials say: their roughness,
    /// metallic and emission; normals are those of the mesh. What nothing says has this value, linear.
    pub fn channel(mut self, kind: ChannelKind, value: Vec4) -> Self {
        self.channels.push((kind, value));
        self
    }

    /// Texels per world unit of length, everywhere.
    pub fn density(self, texels_per_unit: f64) -> Self {
        Self { budget: Budget::Density(texels_per_unit), ..self }
    }

    /// Every triangle gets the density of the texture or photograph that it has.
    pub fn matching(self) -> Self {
        Self { budget: Budget::Matching, ..self }
    }

    /// Longest side of a tile in texels; 0 gives every fan its own tile.
    pub fn tile(self, texels: u32) -> Self {
        Self { tile: texels, ..self }
    }

    /// Cuts the texture at edges whose two triangles' normals differ by at least so many degrees, 0 to 180: no tile lies across one, and the
    /// texture function may jump there, by about a tile's own error. Textures of boxes, terraces and machines, which are smooth in space, are sharper by that.
    /// By default none are cut, and the function is continuous everywhere; but the mesh of an asset keeps the hard edges of that.
    pub fn hard_edges(self, degrees: f32) -> Self {
        Self { hard_edges: Some(degrees), ..self }
    }

    /// How large triangles are cut first; by default [automatically](LongestEdge::Automatic). They stay whole for [closures](Source::function),
    /// [custom](Source::custom) sources, which are asked for points of the cut triangles then, and looks with baked light unless this is called.
    pub fn longest_edge(self, longest_edge: LongestEdge) -> Self {
        Self { longest_edge: Some(longest_edge), ..self }
    }

    /// Storage of the texels.
    pub fn format(self, format: BakeFormat) -> Self {
        Self { options: BakeOptions { format, ..self.options }, ..self }
    }

    /// How texels are found from the source.
    pub fn fit(self, fit: Fit) -> Self {
        Self { options: BakeOptions { fit, ..self.options }, ..self }
    }

    /// Effort of the block encoder.
    pub fn quality(self, quality: Quality) -> Self {
        Self { options: BakeOptions { quality, ..self.options }, ..self }
    }

    /// Replaces an existing file, unless somebody edits it.
    pub fn overwrite(self, force: bool) -> Self {
        Self { options: BakeOptions { force, ..self.options }, ..self }
    }

    /// Fails, and writes nothing, where an asset that is baked from has damaged texels, for which coarser ones stand in otherwise, or a model
    /// images that are missing or broken, which are left out otherwise.
    pub fn strict(self, strict: bool) -> Self {
        Self { options: BakeOptions { strict, ..self.options }, ..self }
    }

    /// Bytes that texels in flight, images and photographs may take.
    pub fn memory(self, memory_bytes: u64) -> Self {
        Self { options: BakeOptions { memory_bytes, ..self.options }, ..self }
    }

    /// Seed of recipes.
    pub fn seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// Who hears of progress, and may end the bake.
    pub fn progress(self, progress: &'a dyn Progress) -> Self {
        Self { progress: Observer::new(progress), ..self }
    }

    /// Bakes into a file, which is written whole or not at all.
    ///
    /// # Errors
    /// The model has no such materials or colours; what the source names cannot be read; the file exists or cannot be written; the
    /// bake was ended.
    pub fn write(self, path: impl AsRef<Path>) -> Result<Baked> {
        self.reach(&Goal::Asset(path.as_ref()))
    }

    /// Covers the model as [`write`](Self::write) does, and bakes nothing.
    ///
    /// # Errors
    /// The model has no such materials or colours; what the source names cannot be read.
    pub fn cover(self) -> Result<Covered<'static>> {
        let found = RefCell::default();
        let Baked { texels_asked, cover: stats, left_out, .. } = self.reach(&Goal::Cover(&found))?;
        let nothing = || Error::unsupported("such a source covers no model");
        let (mesh, cover) = found.into_inner().ok_or_else(nothing)?;
        Ok(Covered { mesh: Cow::Owned(mesh), cover, stats, texels_asked, left_out })
    }

    /// Covers the model's shape, whatever is baked onto it: with the texels or the density that were asked for, else with
    /// [`default_texels`](Self::default_texels).
    ///
    /// # Errors
    /// The model cannot be covered with such numbers; the work was ended.
    pub fn cover_shape(self) -> Result<Covered<'a>> {
        let budget = self.nominal_budget(self.mesh, None);
        let texels_asked = texels_of(&budget);
        let mesh = self.refined(self.mesh, self.longest_edge.unwrap_or_default(), None)?;
        let (cover, stats) = self.covered(&mesh, (budget, None), false)?;
        self.progress.end_covering();
        Ok(Covered { mesh, cover, stats, texels_asked, left_out: LeftOut::default() })
    }

    /// Makes a model with ordinary texture coordinates instead of an asset: `.glb`, or `.gltf` with files beside it. Its pictures are the smallest in
    /// which the surface has its density, or half of a number of texels in all, unless the options have a side. Triangles stay whole unless
    /// [`longest_edge`](Self::longest_edge) is called; format, fit, quality, tile and hard edges do not count. Light is baked into an asset beside the
    /// model first, which is removed afterwards.
    ///
    /// # Errors
    /// As [`write`](Self::write) and [`export_source`](fantex_export::export_source). [`overwrite`](Self::overwrite) and
    /// [`memory`](Self::memory) are those of the options; [`strict`](Self::strict) is what either of the two says.
    #[cfg(feature = "export")]
    pub fn write_model(self, path: impl AsRef<Path>, options: &ExportOptions<'_>) -> Result<Baked> {
        fantex_export::check_export(path.as_ref(), options)?;
        let strict = options.strict || self.options.strict;
        let baker = self.overwrite(options.force).strict(strict).memory(options.memory_bytes);
        baker.reach(&Goal::Model(path.as_ref(), &ExportOptions { strict, ..options.clone() }))
    }

    fn reach(self, goal: &Goal<'_>) -> Result<Baked> {
        let model = self.mesh;
        let default;
        let Source(kind) = match &self.source {
            Some(source) => source,
            None => {
                default = Source::of_model(model).ok_or_else(|| {
                    let path = model.path().display();
                    Error::invalid(format!(
                        "{path} has neither textures nor colours to bake; choose a source"
                    ))
                })?;
                &default
            }
        };
        let mut baked = match goal.recipe() {
            None => self.bake_kind(kind, goal)?,
            Some(recipe) => {
                self.add_settings(kind, &mut recipe.borrow_mut());
                ReadLimits::current().noting_files().run(|| self.bake_kind(kind, goal))?
            }
        };
        let whole = model.triangles.len() as u64;
        if whole < baked.triangles && !matches!(goal, Goal::Part(..)) {
            baked.notes.push(format!(
                "{} {} cut into {}",
                counted(whole, "triangle"),
                were(whole),
                baked.triangles
            ));
        }
        Ok(baked)
    }

    /// Bakes one kind of source.
    fn bake_kind(&self, kind: &Kind<'_>, goal: &Goal<'_>) -> Result<Baked> {
        let model = self.mesh;
        match kind {
            Kind::OwnMaterials => {
                if !model.has_materials() {
                    return Err(Error::invalid(format!(
                        "{} has no textures and no colours of its materials; choose another source",
                        model.path().display()
                    )));
                }
                self.own_materials(goal)
            }
            Kind::Look(look) => {
                let (file, images) = (LookFile::read(look)?, LookImages::default());
                let options = ResolveOptions {
                    memory_bytes: self.options.memory_bytes,
                    seed: folded_seed(self.seed),
                    ..ResolveOptions::default()
                };
                let mut mesh = (**model).clone();
                let resolver = MaterialResolver { file: &file, images: &images, options };
                let look = LookBake::new(&resolver, &mut mesh, model.path())?;
                // Light starts from the smooth surface that large triangles stand for; pieces of them say less of it.
                let cuts = match look.has_light() {
                    true => self.asked_cuts(),
                    false => self.cuts(goal),
                };
                let mesh = self.refined(&mesh, cuts, None)?;
                self.leave_out(look.left_out(), goal)?;
                let notes = if goal.is_part() { Vec::new() } else { look.notes(&mesh) };
                notes.iter().for_each(|note| self.progress.progress.note(note));
                let baked = look.with_source(&mesh, |source| self.bake(&mesh, source, None, goal))??;
                let left_out = look.left_out().clone();
                Ok(Baked { notes: notes.into_iter().chain(baked.notes).collect(), left_out, ..baked })
            }
            Kind::Mesh { path: detailed, cage } if FileKind::of(detailed)? == FileKind::Asset => {
                self.transfer_asset(&Asset::open(detailed)?, *cage, goal)
            }
            Kind::Mesh { path: detailed, cage } => self.transfer_model(&Mesh::open(detailed)?, *cage, goal),
            Kind::Loaded(detailed, cage) => self.transfer_model(detailed, *cage, goal),
            Kind::Asset(detailed, cage) => self.transfer_asset(detailed, *cage, goal),
            #[cfg(feature = "photos")]
            Kind::Photos(photos) => {
                let mesh = self.refined(model, self.cuts(goal), None)?;
                self.photographs(mesh.into_owned(), photos, goal)
            }
            // Such a source may know the triangles.
            Kind::Custom(source) => {
                let mesh = self.refined(model, self.asked_cuts(), None)?;
                self.bake(&without_textures(&mesh), *source, None, goal)
            }
            Kind::VertexColors | Kind::Image(..) | Kind::Solid(_) | Kind::Function(_) => {
                let cuts = match kind {
                    Kind::Function(_) => self.asked_cuts(),
                    _ => self.cuts(goal),
                };
                let mesh = self.refined(model, cuts, None)?;
                let mesh = without_textures(&mesh);
                self.bake(&mesh, kind.evaluator(&mesh, self.seed)?.as_ref(), None, goal)
            }
        }
    }

    /// Takes a model without some of its images. All who bake a plan have to have the same ones.
    ///
    /// # Errors
    /// There are such images, and the baker is strict.
    fn leave_out(&self, left_out: &LeftOut, goal: &Goal<'_>) -> Result<()> {
        if self.options.strict {
            left_out.check()?;
        }
        if let (Some(recipe), count @ 1..) = (goal.recipe(), left_out.count()) {
            recipe.borrow_mut().add_setting("the number of left-out images", count);
        }
        Ok(())
    }

    /// Covers the mesh and bakes. `own_density`: of the source's own texels, where it has any.
    fn bake(
        &self,
        mesh: &fantex_mesh::Mesh,
        source: &dyn BakeSource,
        own_density: Option<OwnDensity>,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        // What is read is known: it would not be overwritten at the end.
        input::check_output(goal.path())?;
        check_size(mesh)?;
        let with_channels = FilledChannels::of(source, mesh, &self.channels);
        let source = with_channels.as_ref().map_or(source, |with| with as &dyn BakeSource);
        if let (Budget::Matching, None) = (self.budget, &own_density) {
            return Err(Error::invalid(
                "the density of textures was asked for, and the source has none; give a number of texels or a density",
            ));
        }
        let is_own_density = matches!((self.budget, &own_density), (Budget::Default, Some(_)));
        let budget = self.nominal_budget(mesh, own_density.as_ref());
        self.check_cancelled()?;
        #[cfg(feature = "export")]
        if let Goal::Model(path, options) = *goal {
            budget.check(mesh.triangles.len())?;
            let options = &ExportOptions { texels: texels_of(&budget).or(options.texels), ..options.clone() };
            return match model::needs_tiles(mesh, source) {
                true => self.model_of_asset(mesh, source, own_density, path, options),
                false => {
                    self.progress.end_covering();
                    self.model(mesh, source, &budget, path, options)
                }
            };
        }
        // Larger numbers were told of before.
        let is_told = is_own_density && budget_texels(mesh, &budget) > MANY_TEXELS as f64;
        let started = Instant::now();
        let texels_asked = texels_of(&budget);
        let most = own_density.and_then(|density| density.most);
        let (cover, stats) = self.cover_of(mesh, (budget, most), source, goal)?;
        self.progress.end_covering();
        let cover_time = started.elapsed();
        let untold = if is_own_density && !is_told { stats.texels } else { 0 };
        // Of texels beyond those that were asked for others tell.
        let is_within = texels_asked.is_none_or(|asked| stats.texels <= asked);
        let of_smallest = if is_within { smallest_tiles_note(&cover, &stats) } else { None };
        let notes = self.note_of_many(untold).into_iter().chain(of_smallest).collect();
        self.check_cancelled()?;
        let summary = self.fill(mesh, cover, source, goal)?;
        Ok(Baked {
            triangles: mesh.triangles.len() as u64,
            texels_asked,
            cover: stats,
            cover_time,
            summary,
            notes,
            left_out: LeftOut::default(),
            #[cfg(feature = "photos")]
            photos: None,
            #[cfg(feature = "export")]
            exported: None,
        })
    }

    /// Covers the mesh, unless its plan has done so.
    fn cover_of<'g>(
        &self,
        mesh: &fantex_mesh::Mesh,
        budget: (TexelBudget, Option<u64>),
        source: &dyn BakeSource,
        goal: &Goal<'g>,
    ) -> Result<(Cow<'g, Cover>, CoverStats)> {
        if let Goal::Part(plan, ..) = *goal {
            let groups = plan.cover.groups.len() as u64;
            return Ok((Cow::Borrowed(&plan.cover), CoverStats { groups, ..CoverStats::default() }));
        }
        let (cover, stats) = self.covered(mesh, budget, source.jumps_at_creases())?;
        Ok((Cow::Owned(cover), stats))
    }

    /// Covers a mesh whose triangles are cut already, with a budget and texels at most.
    fn covered(
        &self,
        mesh: &fantex_mesh::Mesh,
        (budget, most_texels): (TexelBudget, Option<u64>),
        cut_creases: bool,
    ) -> Result<(Cover, CoverStats)> {
        let options = CoverOptions { most_texels, cut_creases, ..self.cover_options(budget) };
        self.progress.covering(|goes_on| build_cover_while(mesh, &options, goes_on))
    }

    /// Fills the tiles of a cover, as far as the goal needs them.
    fn fill(
        &self,
        mesh: &fantex_mesh::Mesh,
        cover: Cow<'_, Cover>,
        source: &dyn BakeSource,
        goal: &Goal<'_>,
    ) -> Result<BakeSummary> {
        match *goal {
            Goal::Cover(found) => {
                found.replace(Some((mesh.clone(), cover.into_owned())));
                Ok(BakeSummary::default())
            }
            Goal::Plan(path, about, recipe) => {
                let recipe = &mut *recipe.borrow_mut();
                self.add_files(recipe)?;
                plan_bake(mesh, &cover, source, path, &self.options, recipe, about)
            }
            Goal::Part(plan, shard, path, recipe) => {
                let recipe = &mut *recipe.borrow_mut();
                self.add_files(recipe)?;
                plan.check_recipe(recipe)?;
                bake_part(mesh, plan, shard, source, path, &self.options, self.progress.progress)
            }
            _ => bake(mesh, &cover, source, goal.path(), &self.options, self.progress.progress),
        }
    }

    fn check_cancelled(&self) -> Result<()> {
        match self.progress.progress.is_cancelled() {
            true => Err(Error::cancelled("the bake was ended")),
            false => Ok(()),
        }
    }

    /// How large triangles are cut, where the source has no wish of its own.
    fn cuts(&self, goal: &Goal<'_>) -> LongestEdge {
        self.longest_edge.unwrap_or(goal.default_cuts())
    }

    /// How large triangles are cut, where they stay whole by default.
    fn asked_cuts(&self) -> LongestEdge {
        self.longest_edge.unwrap_or(LongestEdge::Texels(0))
    }

    /// A mesh with its triangles cut. `own_density` as in [`bake`](Self::bake).
    fn refined<'m>(
        &self,
        mesh: &'m fantex_mesh::Mesh,
        cuts: LongestEdge,
        own_density: Option<&OwnDensity>,
    ) -> Result<Cow<'m, fantex_mesh::Mesh>> {
        let options = self.cover_options(self.nominal_budget(mesh, own_density));
        options.hard_edges.map_or(Ok(()), check_hard_edges)?;
        self.progress.covering(|goes_on| cuts.refined_while(mesh, &options, goes_on))
    }

    fn cover_options(&self, budget: TexelBudget) -> CoverOptions {
        let (tile, hard_edges) = (self.tile, self.hard_edges.or(self.mesh.hard_edges()));
        CoverOptions { budget, tile, hard_edges, ..CoverOptions::default() }
    }

    /// How many texels a mesh gets, about. `own_density` as in [`bake`](Self::bake).
    fn nominal_budget(&self, mesh: &fantex_mesh::Mesh, own_density: Option<&OwnDensity>) -> TexelBudget {
        match (self.budget, own_density) {
            (Budget::Default | Budget::Matching, Some(density)) => {
                TexelBudget::PerTriangle(density.of_triangles.clone())
            }
            (Budget::Default | Budget::Matching, None) => TexelBudget::Total(self.default_texels),
            (Budget::Texels(texels), _) => TexelBudget::Total(texels),
            (Budget::Density(density), _) => TexelBudget::Density(density * mesh.world_from_mesh.scale),
        }
    }
}

/// What a bake writes.
enum Goal<'g> {
    /// An asset.
    Asset(&'g Path),
    /// Nothing: what is covered, and how, is left there.
    Cover(&'g RefCell<Option<(fantex_mesh::Mesh, Cover)>>),
    /// All but texels, with a note. The recipe is filled on the way.
    Plan(&'g Path, &'g [u8], &'g RefCell<Recipe>),
    /// Shard and count. The recipe is filled on the way, and then compared with that of the plan.
    Part(&'g Plan, [u32; 2], &'g Path, &'g RefCell<Recipe>),
    /// A model with texture coordinates.
    #[cfg(feature = "export")]
    Model(&'g Path, &'g ExportOptions<'g>),
}

impl<'g> Goal<'g> {
    fn path(&self) -> &'g Path {
        match self {
            Self::Asset(path) | Self::Plan(path, ..) | Self::Part(_, _, path, _) => path,
            Self::Cover(_) => Path::new(""),
            #[cfg(feature = "export")]
            Self::Model(path, ..) => path,
        }
    }

    /// Whether it was planned before, and what is to be said was said then.
    fn is_part(&self) -> bool {
        matches!(self, Self::Part(..))
    }

    /// Triangles are cut so that tiles lie better.
    fn default_cuts(&self) -> LongestEdge {
        match self {
            Self::Asset(_) | Self::Cover(_) | Self::Plan(..) | Self::Part(..) => LongestEdge::Automatic,
            #[cfg(feature = "export")]
            Self::Model(..) => LongestEdge::Texels(0),
        }
    }
}

/// What a bake would cover, and how.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Covered<'a> {
    /// The model, with its triangles cut.
    pub mesh: Cow<'a, fantex_mesh::Mesh>,
    /// Its tiles.
    pub cover: Cover,
    /// Groups, texels, stretch.
    pub stats: CoverStats,
    /// The number of texels that was asked for, where it was a number.
    pub texels_asked: Option<u64>,
    /// Images of the model that could not be read.
    pub left_out: LeftOut,
}

/// A finished bake.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Baked {
    /// Triangles of the asset's mesh.
    pub triangles: u64,
    /// The number of texels that was asked for, where it was a number. Many small tiles may hold more.
    pub texels_asked: Option<u64>,
    /// Groups, texels, stretch.
    pub cover: CoverStats,
    /// How long covering took.
    pub cover_time: Duration,
    /// Texels, bytes, channels and times.
    pub summary: BakeSummary,
    /// What the user should know, a sentence each.
    pub notes: Vec<String>,
    /// Images of models that could not be read, of which the notes tell.
    pub left_out: LeftOut,
    /// What was found out about photographs.
    #[cfg(feature = "photos")]
    pub photos: Option<fantex_photos::PhotoReport>,
    /// What was written instead of an asset.
    #[cfg(feature = "export")]
    pub exported: Option<fantex_export::ExportSummary>,
}

/// The number of texels, where it is one.
fn texels_of(budget: &TexelBudget) -> Option<u64> {
    if let TexelBudget::Total(texels) = budget { Some(*texels) } else { None }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

    use fantex_mesh::generate::torus;

    use super::*;

    /// Wants to go on for so many questions.
    struct Patience(AtomicU32);

    impl Progress for Patience {
        fn report(&self, _: u64, _: u64) {
            panic!("the first tile was begun");
        }

        fn prepare(&self, _: &'static str, _: f32) {}

        fn is_cancelled(&self) -> bool {
            self.0.fetch_update(Relaxed, Relaxed, |left| left.checked_sub(1)).is_err()
        }
    }

    /// Covers of large models, and of all lengths that are tried, take longer than anybody waits.
    #[test]
    fn a_bake_ends_while_its_model_is_covered() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = Mesh::from_model(torus(24, 12), "torus").unwrap();
        let (automatic, whole) = (LongestEdge::Automatic, LongestEdge::Texels(0));
        for (longest_edge, questions) in [(automatic, 20), (whole, 20), (automatic, 0)] {
            let patience = Patience(questions.into());
            let baker = Baker::new(&mesh).source(Source::solid("wood")).texels(100_000);
            let baker = baker.longest_edge(longest_edge).progress(&patience);
            assert!(baker.write(folder.path().join("torus.fan")).unwrap_err().is_cancelled());
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
