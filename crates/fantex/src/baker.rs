//! From a mesh and a source of colour to an asset.

#[cfg(feature = "export")]
mod model;
#[cfg(feature = "photos")]
mod photos;

use std::borrow::Cow;
use std::cell::RefCell;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_bake::{
    BakeFormat, BakeOptions, BakeSummary, Fit, LookSource, MappedImageSource, NoProgress, Prefilter,
    Progress, SolidSource, TexelPoint, TransferOptions, TransferSource, VertexColorSource, bake, bake_part,
    plan_bake,
};
use fantex_base::random::{DEFAULT_SEED, folded_seed};
use fantex_base::{Error, ErrorKind, Result, counted, grouped};
use fantex_cover::{Cover, CoverOptions, CoverStats, TexelBudget, build_cover};
use fantex_look::{LookFile, LookImages, ResolveOptions};
use fantex_mesh::ObjectSpace;
use fantex_store::{Plan, Quality};
use fantex_texture::material::MaterialTextures;
use fantex_texture::{Image, ImageTexture, MappingKind, Wrap, solid_by_name};
use glam::Vec4;

#[cfg(feature = "export")]
use fantex_export::ExportOptions;
#[cfg(feature = "photos")]
pub use photos::PhotoSet;

use crate::asset_materials::{AssetChannels, of_transfer, without_textures};
use crate::look_scene::{LookBake, MaterialResolver};
use crate::{Asset, FileKind, LongestEdge, Mesh, budget_texels};

/// What is baked.
pub struct Source<'a>(Kind<'a>);

enum Kind<'a> {
    OwnMaterials,
    VertexColors,
    Image(PathBuf, MappingKind),
    Solid(String),
    Look(PathBuf),
    Mesh {
        path: PathBuf,
        cage: Option<f64>,
    },
    Loaded(&'a Mesh, Option<f64>),
    Asset(&'a Asset, Option<f64>),
    #[cfg(feature = "photos")]
    Photos(PhotoSet),
    Function(Box<dyn Fn(&TexelPoint) -> Vec4 + Sync + 'a>),
    Custom(&'a dyn fantex_bake::Source),
}

impl<'a> Source<'a> {
    /// The model's own materials: colours, textures and all other channels.
    pub fn own_materials() -> Self {
        Self(Kind::OwnMaterials)
    }

    /// The model's vertex colours.
    pub fn vertex_colors() -> Self {
        Self(Kind::VertexColors)
    }

    /// What a model offers by itself: its materials (which take its vertex colours in), else its vertex colours.
    pub fn of_model(mesh: &Mesh) -> Option<Self> {
        match (mesh.has_materials(), mesh.has_vertex_colors()) {
            (true, _) => Some(Self::own_materials()),
            (false, true) => Some(Self::vertex_colors()),
            (false, false) => None,
        }
    }

    /// An image, laid over the model.
    pub fn image(path: impl Into<PathBuf>, mapping: MappingKind) -> Self {
        Self(Kind::Image(path.into(), mapping))
    }

    /// A solid recipe, one of [`SOLID_NAMES`](fantex_texture::SOLID_NAMES): `"marble"`, `"wood"` ...
    pub fn solid(name: impl Into<String>) -> Self {
        Self(Kind::Solid(name.into()))
    }

    /// The materials, displacements and, if it says so, the light of a look (`.toml`).
    pub fn look(path: impl Into<PathBuf>) -> Self {
        Self(Kind::Look(path.into()))
    }

    /// Another, more detailed model: its materials or vertex colours, and its normals. Or an asset: all that it holds.
    pub fn mesh(path: impl Into<PathBuf>) -> Self {
        Self(Kind::Mesh { path: path.into(), cage: None })
    }

    /// As [`mesh`](Self::mesh), looking for its surface no farther than `cage` world units.
    pub fn mesh_within(path: impl Into<PathBuf>, cage: f64) -> Self {
        Self(Kind::Mesh { path: path.into(), cage: Some(cage) })
    }

    /// As [`mesh`](Self::mesh), of a model in memory; `cage` as in [`mesh_within`](Self::mesh_within).
    pub fn loaded_mesh(mesh: &'a Mesh, cage: Option<f64>) -> Self {
        Self(Kind::Loaded(mesh, cage))
    }

    /// As [`mesh`](Self::mesh), of an asset that is open; `cage` as in [`mesh_within`](Self::mesh_within).
    pub fn asset(asset: &'a Asset, cage: Option<f64>) -> Self {
        Self(Kind::Asset(asset, cage))
    }

    /// Photographs with cameras.
    #[cfg(feature = "photos")]
    pub fn photos(photos: PhotoSet) -> Self {
        Self(Kind::Photos(photos))
    }

    /// A closure that gives the linear base colour and opacity at a point of the surface.
    pub fn function(color: impl Fn(&TexelPoint) -> Vec4 + Sync + 'a) -> Self {
        Self(Kind::Function(Box::new(color)))
    }

    /// The source as a function on a mesh's surface: what pictures of an asset are compared with.
    ///
    /// # Errors
    /// The mesh has no such colours, a file cannot be read; or it is a look, a mesh or photographs, which can only be baked.
    pub fn evaluator<'m>(
        &'m self,
        mesh: &'m fantex_mesh::Mesh,
        seed: u64,
    ) -> Result<Box<dyn fantex_bake::Source + 'm>> {
        self.0.evaluator(mesh, seed)
    }

    /// Any source with any channels.
    pub fn custom(source: &'a dyn fantex_bake::Source) -> Self {
        Self(Kind::Custom(source))
    }
}

/// Refuses sizes whose squares single precision, in which textures are evaluated, does not hold.
fn check_size(mesh: &fantex_mesh::Mesh) -> Result<()> {
    let scale = mesh.world_from_mesh.scale;
    if (1e-18..=1e18).contains(&scale) {
        return Ok(());
    }
    Err(Error::unsupported(format!(
        "the model is about {scale:.0e} units large, and textures are evaluated on 1e-18 to 1e18; scale it, or remove stray vertices"
    )))
}

impl Kind<'_> {
    fn evaluator<'m>(
        &'m self,
        mesh: &'m fantex_mesh::Mesh,
        seed: u64,
    ) -> Result<Box<dyn fantex_bake::Source + 'm>> {
        Ok(match self {
            Self::OwnMaterials => Box::new(LookSource::of_model(mesh)?),
            Self::VertexColors => Box::new(VertexColorSource::new(mesh)?),
            Self::Image(path, mapping) => {
                let texture = ImageTexture::new(Arc::new(Image::load(path)?));
                let mapping = mapping.fit(ObjectSpace::of(mesh).bounds());
                Box::new(MappedImageSource::new(mesh, texture, mapping, [Wrap::Repeat; 2]))
            }
            Self::Solid(name) => {
                let solid = solid_by_name(name, ObjectSpace::of(mesh).bounds(), folded_seed(seed))?;
                Box::new(SolidSource::new(mesh, solid))
            }
            Self::Function(color) => Box::new(FunctionSource(color.as_ref())),
            Self::Custom(_) | Self::Look(_) | Self::Mesh { .. } | Self::Loaded(..) | Self::Asset(..) => {
                return Err(only_baked());
            }
            #[cfg(feature = "photos")]
            Self::Photos(_) => return Err(only_baked()),
        })
    }
}

fn only_baked() -> Error {
    Error::invalid("looks, other models and photographs can only be baked; give another source here")
}

impl fmt::Debug for Source<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Kind::OwnMaterials => f.write_str("own materials"),
            Kind::VertexColors => f.write_str("vertex colours"),
            Kind::Image(path, mapping) => write!(f, "image {}, {}", path.display(), mapping.name()),
            Kind::Solid(name) => write!(f, "solid {name}"),
            Kind::Look(path) => write!(f, "look {}", path.display()),
            Kind::Mesh { path, .. } => write!(f, "mesh {}", path.display()),
            Kind::Loaded(mesh, _) => write!(f, "mesh {}", mesh.path().display()),
            Kind::Asset(asset, _) => write!(f, "mesh {}", asset.path().display()),
            #[cfg(feature = "photos")]
            Kind::Photos(photos) => write!(f, "photographs {}", photos.path.display()),
            Kind::Function(_) => f.write_str("function"),
            Kind::Custom(_) => f.write_str("custom source"),
        }
    }
}

/// How many texels, before the mesh and the source are known.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Budget {
    /// The source's own density, else [`Baker::DEFAULT_TEXELS`].
    Default,
    Texels(u64),
    /// Per world unit of length.
    Density(f64),
    Matching,
}

/// Bakes a source onto a mesh: covers the mesh, fills the tiles, writes the asset.
///
/// Without a source the model's own materials or vertex colours are baked; without a number of texels textures keep their own
/// density, and everything else gets [`Baker::DEFAULT_TEXELS`]. A model that repeats its textures gets at most 16 million, or twice the
/// texels of its images, and a note.
#[derive(Debug)]
#[must_use = "nothing is baked before `write`"]
pub struct Baker<'a> {
    mesh: &'a Mesh,
    source: Option<Source<'a>>,
    budget: Budget,
    tile: u32,
    /// As the kind of source suggests where nothing was said.
    longest_edge: Option<LongestEdge>,
    seed: u64,
    options: BakeOptions,
    progress: Observer<'a>,
}

struct Observer<'a>(&'a dyn Progress);

impl fmt::Debug for Observer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("progress")
    }
}

impl<'a> Baker<'a> {
    /// Texels where nothing else says how many.
    pub const DEFAULT_TEXELS: u64 = 4_000_000;

    /// More texels than this, which nobody asked for, are worth a note.
    const MANY_TEXELS: u64 = 64_000_000;

    /// A model that shows parts of its images again and again gets no more than so many texels by itself, or twice those of its images.
    const REPEATED_TEXELS: u64 = 16_000_000;

    /// Texels for each of an image's whose texels are to appear as squares: edges a quarter as wide as a square look crisp.
    const CRISP_TEXELS: f64 = 16.0;

    /// A baker for a mesh.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self {
            mesh,
            source: None,
            budget: Budget::Default,
            tile: CoverOptions::default().tile,
            longest_edge: None,
            seed: DEFAULT_SEED,
            options: BakeOptions::default(),
            progress: Observer(&NoProgress),
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

    /// Replaces an existing file.
    pub fn overwrite(self, force: bool) -> Self {
        Self { options: BakeOptions { force, ..self.options }, ..self }
    }

    /// Fails, and writes nothing, where an asset that is baked from has damaged texels, for which coarser ones stand in otherwise.
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
        Self { progress: Observer(progress), ..self }
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
    pub fn cover(self) -> Result<Covered> {
        let found = RefCell::default();
        let Baked { texels_asked, cover: stats, .. } = self.reach(&Goal::Cover(&found))?;
        let nothing = || Error::unsupported("such a source covers no model");
        let (mesh, cover) = found.into_inner().ok_or_else(nothing)?;
        Ok(Covered { mesh, cover, stats, texels_asked })
    }

    /// Writes all but the texels of what [`write`](Self::write) would write, with a note for whoever bakes its parts: [`write_part`](Self::write_part)
    /// in any number of processes, then [`merge_parts`](fantex_store::merge_parts).
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_plan(self, path: impl AsRef<Path>, about: &[u8]) -> Result<Baked> {
        self.reach(&Goal::Plan(path.as_ref(), about))
    }

    /// Bakes shard `number` of `count` of a plan, which this baker wrote, or one with the same mesh, source and settings.
    ///
    /// # Errors
    /// As [`write`](Self::write); the plan is of something else; there is no such shard.
    pub fn write_part(self, plan: &Plan, number: u32, count: u32, path: impl AsRef<Path>) -> Result<Baked> {
        self.reach(&Goal::Part(plan, [number, count], path.as_ref()))
    }

    /// Makes a model with ordinary texture coordinates instead of an asset: `.glb`, or `.gltf` with files beside it. Its pictures are the smallest in
    /// which the surface has its density, or half of a number of texels in all, unless the options have a side. Triangles stay whole unless
    /// [`longest_edge`](Self::longest_edge) is called; format, fit, quality and tile do not count. Light is baked into an asset beside the
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
        let mut baked = self.bake_kind(kind, goal)?;
        let whole = model.triangles.len() as u64;
        if whole < baked.triangles && !matches!(goal, Goal::Part(..)) {
            baked.notes.push(format!("{whole} triangles were cut into {}", baked.triangles));
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
                let mesh = self.refined(&mesh, cuts, None);
                let notes = if goal.is_part() { Vec::new() } else { look.notes(&mesh) };
                notes.iter().for_each(|note| self.progress.0.note(note));
                let baked = look.with_source(&mesh, |source| self.bake(&mesh, source, None, goal))??;
                Ok(Baked { notes: notes.into_iter().chain(baked.notes).collect(), ..baked })
            }
            Kind::Mesh { path: detailed, cage } if FileKind::of(detailed)? == FileKind::Asset => {
                self.transfer_asset(&Asset::open(detailed)?, *cage, goal)
            }
            Kind::Mesh { path: detailed, cage } => self.transfer_model(&Mesh::open(detailed)?, *cage, goal),
            Kind::Loaded(detailed, cage) => self.transfer_model(detailed, *cage, goal),
            Kind::Asset(detailed, cage) => self.transfer_asset(detailed, *cage, goal),
            #[cfg(feature = "photos")]
            Kind::Photos(photos) => {
                let mesh = self.refined(model, self.cuts(goal), None);
                self.photographs(mesh.into_owned(), photos, goal)
            }
            // Such a source may know the triangles.
            Kind::Custom(source) => {
                let mesh = self.refined(model, self.asked_cuts(), None);
                self.bake(&without_textures(&mesh), *source, None, goal)
            }
            Kind::VertexColors | Kind::Image(..) | Kind::Solid(_) | Kind::Function(_) => {
                let cuts = match kind {
                    Kind::Function(_) => self.asked_cuts(),
                    _ => self.cuts(goal),
                };
                let mesh = self.refined(model, cuts, None);
                let mesh = without_textures(&mesh);
                self.bake(&mesh, kind.evaluator(&mesh, self.seed)?.as_ref(), None, goal)
            }
        }
    }

    /// Bakes the model's materials.
    fn own_materials(&self, goal: &Goal<'_>) -> Result<Baked> {
        let model: &fantex_mesh::Mesh = self.mesh;
        let textures = LookSource::decoded(model)?;
        let source = LookSource::of_decoded(model, textures.clone());
        let own = source.has_textures().then(|| source.density());
        let own_texels = own.as_deref().map_or(0.0, |own| density_texels(model, own));
        let most = Self::REPEATED_TEXELS.max(2 * source.image_texels()) as f64;
        let is_limited = self.budget == Budget::Default && own_texels > most;
        let share = if is_limited { (most / own_texels).sqrt() as f32 } else { 1.0 };
        let density = own.as_deref().map(|own| scaled(own, share));
        let mut notes = Vec::new();
        // Before the mesh is cut and covered, which takes its time.
        if let (Some(own), Some(density), false) = (&own, &density, goal.is_part()) {
            notes.extend(self.note_of_squares(&source, own, density));
            if self.budget == Budget::Default {
                notes.extend(self.note_of_repeats(own_texels, most));
                notes.extend(self.note_of_many(density_texels(model, density) as u64));
            }
        }
        let mut baked = self.textured(model, source, share, textures, goal)?;
        baked.notes.splice(0..0, notes);
        Ok(baked)
    }

    /// Says that a model gets fewer texels than its images have wherever they are shown, if it does.
    fn note_of_repeats(&self, own_texels: f64, most: f64) -> Option<String> {
        let millions = |texels: f64| (texels / 1e6) as u64;
        let note = format!(
            "the model shows parts of its textures again and again: at their own density these were about {} million texels; it is given \
             about {} million, unless a number of texels or the density of its textures is asked for",
            millions(own_texels),
            millions(most)
        );
        let note = Some(note).filter(|_| own_texels > most);
        note.iter().for_each(|note| self.progress.0.note(note));
        note
    }

    /// Says that texels which are to appear as squares are blended, unless there are enough to hide it. `own`: the density of the textures,
    /// `density` the one that they get where nothing else is asked for.
    fn note_of_squares(&self, source: &LookSource<'_>, own: &[f32], density: &[f32]) -> Option<String> {
        let own = density_texels(self.mesh, own);
        let asked = budget_texels(self.mesh, &self.nominal_budget(self.mesh, Some(density)));
        // Whoever gives a rounded number has heard the note.
        let materials =
            if asked < 0.5 * Self::CRISP_TEXELS * own { source.square_texel_materials() } else { 0 };
        let note = format!(
            "the textures of {} are to appear as squares (nearest filtering), but what is baked is blended between texels: edges of squares \
             are as soft as a texel is wide; about {} texels, {} per texel of the textures, make them crisp",
            counted(materials, "material"),
            grouped(rounded(Self::CRISP_TEXELS * own), ' '),
            Self::CRISP_TEXELS
        );
        let note = Some(note).filter(|_| materials > 0);
        note.iter().for_each(|note| self.progress.0.note(note));
        note
    }

    /// Says that a number of texels, which nobody asked for, is large, if it is.
    fn note_of_many(&self, texels: u64) -> Option<String> {
        let millions = texels / 1_000_000;
        let note = format!(
            "at the density of the model's own textures these are about {millions} million texels; a number of texels may be given instead"
        );
        let note = Some(note).filter(|_| texels > Self::MANY_TEXELS);
        note.iter().for_each(|note| self.progress.0.note(note));
        note
    }

    /// Cuts a model and bakes its materials. `share`: of the density of the textures, which are those of the source.
    fn textured(
        &self,
        model: &fantex_mesh::Mesh,
        source: LookSource<'_>,
        share: f32,
        textures: Vec<MaterialTextures>,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        let cuts = self.cuts(goal);
        let tangents = source.normal_map_tangents();
        let density =
            |source: &LookSource<'_>| source.has_textures().then(|| scaled(&source.density(), share));
        if cuts.leaves_whole(model, self.tile) {
            return self.bake(model, &source, density(&source), goal);
        }
        // Normal maps were made for the axes of the whole triangles.
        let mut framed = Cow::Borrowed(model);
        if model.corners.tangents.is_empty() && !tangents.is_empty() {
            framed.to_mut().corners.tangents = tangents.to_vec();
        }
        let Cow::Owned(framed) = self.refined(&framed, cuts, density(&source).as_deref()) else {
            return self.bake(model, &source, density(&source), goal);
        };
        let mut cut = framed.clone();
        if model.corners.tangents.is_empty() {
            cut.corners.tangents.clear();
        }
        let source = LookSource::of_decoded(&framed, textures);
        self.bake(&cut, &source, density(&source), goal)
    }

    /// Covers the mesh and bakes. `own_density`: texels per mesh unit of the source's own texels, per triangle, where it has any.
    fn bake(
        &self,
        mesh: &fantex_mesh::Mesh,
        source: &dyn fantex_bake::Source,
        own_density: Option<Vec<f32>>,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        check_size(mesh)?;
        if let (Budget::Matching, None) = (self.budget, &own_density) {
            return Err(Error::invalid(
                "the density of textures was asked for, and the source has none; give a number of texels or a density",
            ));
        }
        let is_own_density = matches!((self.budget, &own_density), (Budget::Default, Some(_)));
        let budget = self.nominal_budget(mesh, own_density.as_deref());
        self.check_cancelled()?;
        #[cfg(feature = "export")]
        if let Goal::Model(path, options) = *goal {
            budget.check(mesh.triangles.len())?;
            let texels = if let TexelBudget::Total(texels) = budget { Some(texels) } else { None };
            let options = &ExportOptions { texels: texels.or(options.texels), ..options.clone() };
            return match model::needs_tiles(mesh, source) {
                true => self.model_of_asset(mesh, source, own_density, path, options),
                false => self.model(mesh, source, &budget, path, options),
            };
        }
        // Larger numbers were told of before.
        let is_told = is_own_density && budget_texels(mesh, &budget) > Self::MANY_TEXELS as f64;
        let started = Instant::now();
        let texels_asked = if let TexelBudget::Total(texels) = budget { Some(texels) } else { None };
        let cut_creases = source.jumps_at_creases();
        let options = CoverOptions { budget, tile: self.tile, cut_creases, ..CoverOptions::default() };
        let (cover, stats) = match goal {
            Goal::Part(plan, ..) => {
                let groups = plan.cover.groups.len() as u64;
                (Cow::Borrowed(&plan.cover), CoverStats { groups, ..CoverStats::default() })
            }
            _ => {
                let (cover, stats) = build_cover(mesh, &options)?;
                (Cow::Owned(cover), stats)
            }
        };
        let cover_time = started.elapsed();
        let untold = if is_own_density && !is_told { stats.texels } else { 0 };
        let notes = Vec::from_iter(self.note_of_many(untold));
        self.check_cancelled()?;
        let summary = match *goal {
            Goal::Cover(found) => {
                found.replace(Some((mesh.clone(), cover.into_owned())));
                BakeSummary::default()
            }
            Goal::Plan(path, about) => plan_bake(mesh, &cover, source, path, &self.options, about)?,
            Goal::Part(plan, shard, path) => {
                bake_part(mesh, plan, shard, source, path, &self.options, self.progress.0)?
            }
            _ => bake(mesh, &cover, source, goal.path(), &self.options, self.progress.0)?,
        };
        Ok(Baked {
            triangles: mesh.triangles.len() as u64,
            texels_asked,
            cover: stats,
            cover_time,
            summary,
            notes,
            #[cfg(feature = "photos")]
            photos: None,
            #[cfg(feature = "export")]
            exported: None,
        })
    }

    fn check_cancelled(&self) -> Result<()> {
        match self.progress.0.is_cancelled() {
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
        own_density: Option<&[f32]>,
    ) -> Cow<'m, fantex_mesh::Mesh> {
        cuts.refined(mesh, &self.nominal_budget(mesh, own_density), self.tile)
    }

    /// How many texels a mesh gets, about. `own_density` as in [`bake`](Self::bake).
    fn nominal_budget(&self, mesh: &fantex_mesh::Mesh, own_density: Option<&[f32]>) -> TexelBudget {
        match (self.budget, own_density) {
            (Budget::Default | Budget::Matching, Some(density)) => TexelBudget::PerTriangle(density.to_vec()),
            (Budget::Default | Budget::Matching, None) => TexelBudget::Total(Self::DEFAULT_TEXELS),
            (Budget::Texels(texels), _) => TexelBudget::Total(texels),
            (Budget::Density(density), _) => TexelBudget::Density(density * mesh.world_from_mesh.scale),
        }
    }

    /// Bakes another model's look and shape.
    fn transfer_model(&self, detailed: &Mesh, cage: Option<f64>, goal: &Goal<'_>) -> Result<Baked> {
        let (materials, vertices);
        let colors: Option<&dyn fantex_bake::Source> = if detailed.has_materials() {
            materials = LookSource::of_model(detailed)?;
            Some(&materials)
        } else if detailed.has_vertex_colors() {
            vertices = VertexColorSource::new(detailed)?;
            Some(&vertices)
        } else {
            None
        };
        let named = |note: &String| format!("{}: {note}", detailed.path().display());
        let detail = (colors, detailed.has_materials());
        let baked = self.transfer(detailed, detail, detailed.path(), cage, goal)?;
        Ok(Baked { notes: detailed.notes().iter().map(named).chain(baked.notes).collect(), ..baked })
    }

    /// Bakes what another asset holds, and its shape.
    fn transfer_asset(&self, asset: &Asset, cage: Option<f64>, goal: &Goal<'_>) -> Result<Baked> {
        let source = AssetChannels::all_of(asset.shared(), self.options.memory_bytes / 4);
        self.transfer(asset.mesh(), (Some(&source), true), asset.path(), cage, goal)
    }

    /// Bakes the shape of a mesh and a source on it, and says how well the two meshes fit. With the source: whether it is what the mesh's materials show.
    fn transfer(
        &self,
        detailed: &fantex_mesh::Mesh,
        (detail, of_materials): (Option<&dyn fantex_bake::Source>, bool),
        path: &Path,
        cage: Option<f64>,
        goal: &Goal<'_>,
    ) -> Result<Baked> {
        let mesh = self.refined(self.mesh, self.cuts(goal), None);
        let mesh = if of_materials { of_transfer(&mesh, detailed) } else { without_textures(&mesh) };
        let options = TransferOptions { cage, ..TransferOptions::default() };
        let source = TransferSource::new(&mesh, detailed, detail, &options)?;
        let baked = self.bake(&mesh, &source, None, goal);
        let mut baked = baked.map_err(|error| match error.kind() {
            ErrorKind::Damaged => error.in_file(path),
            _ => error,
        })?;
        let report = source.report();
        // Single points at rims say nothing.
        if report.missed > report.points / 1000 {
            baked.notes.push(format!(
                "{}: {:.1} % of the points found nothing within the cage of {} world units along their normal and took the \
                 nearest point; where that is wrong, give a longer cage",
                path.display(),
                100.0 * report.missed as f64 / report.points as f64,
                in_three_digits(report.cage)
            ));
        }
        Ok(baked)
    }
}

/// What a bake writes.
enum Goal<'g> {
    /// An asset.
    Asset(&'g Path),
    /// Nothing: what is covered, and how, is left there.
    Cover(&'g RefCell<Option<(fantex_mesh::Mesh, Cover)>>),
    /// All but texels, with a note.
    Plan(&'g Path, &'g [u8]),
    /// Shard and count.
    Part(&'g Plan, [u32; 2], &'g Path),
    /// A model with texture coordinates.
    #[cfg(feature = "export")]
    Model(&'g Path, &'g ExportOptions<'g>),
}

impl<'g> Goal<'g> {
    fn path(&self) -> &'g Path {
        match self {
            Self::Asset(path) | Self::Plan(path, _) | Self::Part(.., path) => path,
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
pub struct Covered {
    /// The model, with its triangles cut.
    pub mesh: fantex_mesh::Mesh,
    /// Its tiles.
    pub cover: Cover,
    /// Groups, texels, stretch.
    pub stats: CoverStats,
    /// The number of texels that was asked for, where it was a number.
    pub texels_asked: Option<u64>,
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
    /// What was found out about photographs.
    #[cfg(feature = "photos")]
    pub photos: Option<fantex_photos::PhotoReport>,
    /// What was written instead of an asset.
    #[cfg(feature = "export")]
    pub exported: Option<fantex_export::ExportSummary>,
}

/// A closure as a source of base colour.
struct FunctionSource<'f>(&'f (dyn Fn(&TexelPoint) -> Vec4 + Sync));

impl fantex_bake::Source for FunctionSource<'_> {
    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = (self.0)(point);
    }
}

/// Texels of a mesh at densities of its triangles.
fn density_texels(mesh: &fantex_mesh::Mesh, density: &[f32]) -> f64 {
    budget_texels(mesh, &TexelBudget::PerTriangle(density.to_vec()))
}

/// All densities times a factor.
fn scaled(density: &[f32], factor: f32) -> Vec<f32> {
    density.iter().map(|density| density * factor).collect()
}

/// A length to three digits, whatever its unit.
fn in_three_digits(length: f64) -> String {
    let power = if length > 0.0 { length.log10().floor() as i32 } else { 0 };
    let decimals = (2 - power).max(0) as usize;
    match power {
        -4..=5 => format!("{length:.decimals$}"),
        _ => format!("{length:.2e}"),
    }
}

/// A count to two digits, not less than it.
fn rounded(count: f64) -> u64 {
    let unit = 10_f64.powi(count.max(10.0).log10() as i32 - 1);
    (unit * (count / unit).ceil()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_three_digits_in_every_unit() {
        let said = [0.021, 1.0, 87.83, 4321.4, 8.783e7, 2.5e-9, 0.0].map(in_three_digits);
        assert_eq!(said, ["0.0210", "1.00", "87.8", "4321", "8.78e7", "2.50e-9", "0.00"]);
    }
}
