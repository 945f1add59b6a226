//! `fantex bake`: a model and a source of colour in, one seamless asset out.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fantex::bake::{self as baking, BakeFormat, BakeOptions, BakeSummary, Fit, Progress, Source};
use fantex::cover::{TexelBudget, build_cover};
use fantex::look::LookFile;
use fantex::look_scene::{LookBake, Wardrobe};
use fantex::mesh::{Material, Mesh};
use fantex::photos::{PhotoError, PhotoOptions, PhotoReport, PhotoSource, read_cameras_in};
use fantex::store::Quality;
use fantex::texture::color::linear_from_srgb8_table;
use fantex::texture::look::LookImages;
use glam::Vec3;
use serde::Serialize;

use crate::commands::info::{CoverArgs, DEFAULT_BUDGET};
use crate::context::Bar;
use crate::context::{Context, peak_memory_bytes};
use crate::error::CliError;
use crate::scene::CleanModel;
use crate::sources::{DetailedModel, OpenSource, PhotosArg, SourceArg};
use crate::text::{counted, megabytes};
use crate::text::{overdraft, texels_asked};

/// Bake a model and a source of colour into one seamless asset.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bake bottle.gltf -o bottle.fan
  fantex bake statue.ply -o statue.fan --source solid=marble --texels 64M
  fantex bake globe.obj -o globe.fan --source image=earth.jpg,mapping=sphere --density 200
  fantex bake chair.glb -o chair.fan --look oak.toml
  fantex bake coarse.obj -o coarse.fan --source mesh=scan.ply,cage=0.02
  fantex bake scan.ply -o scan.fan --source photos=scan/sparse/0,images=scan/images

Another model (mesh=PATH) gives its textures or vertex colours and its normals: every point of the model looks for its surface
along the smooth normal, outwards and inwards, not farther than the cage, which is measured where it is not given.

Photographs (photos=PATH) need their cameras: a sparse model of COLMAP (text or binary) or a transforms.json, in whose coordinates
the model lies. They are brought to one exposure unless exposure=off; what none of them sees takes the colours of its surroundings, or
those of unseen=RRGGBB (docs/photographs.md). With --json the result then has photos, photos_used, photos_masked, unseen_share, gains and
scratch_bytes, too.

Without --source a model's own textures are baked, or else its vertex colours. Textures are baked at their own
density unless --texels or --density says otherwise; other sources get 4M texels.")]
pub(crate) struct BakeArgs {
    /// A model (.glb .gltf .obj .ply .stl)
    model: PathBuf,
    /// The asset to write
    #[arg(short, long, value_name = "ASSET")]
    output: PathBuf,
    /// uv, vertex, image=PATH,mapping=planar|box|cylinder|sphere|triplanar, solid=NAME, mesh=PATH[,cage=LENGTH],
    /// photos=PATH[,images=FOLDER][,frame=original][,exposure=off][,unseen=RRGGBB] or look=PATH; solids are wood, marble, rock, granite, clouds, checker, brick and landscape
    #[arg(long)]
    source: Option<SourceArg>,
    /// A look (.toml), whose materials are baked: short for --source look=PATH
    #[arg(long, value_name = "LOOK", conflicts_with = "source")]
    look: Option<PathBuf>,
    #[command(flatten)]
    cover: CoverArgs,
    /// Give every triangle the density of the texture that it has
    #[arg(long = "match", conflicts_with_all = ["texels", "density"])]
    match_source: bool,
    #[command(flatten)]
    encoding: EncodingArgs,
}

/// How texels are found and stored.
#[derive(Args, Clone, Debug)]
pub(crate) struct EncodingArgs {
    /// Storage of the texels
    #[arg(long, value_enum, default_value_t)]
    pub(crate) format: FormatArg,
    /// How texels are found from the source
    #[arg(long, value_enum, default_value_t)]
    pub(crate) fit: FitArg,
    /// Effort of the BC7 encoder
    #[arg(long, value_enum, default_value_t)]
    pub(crate) quality: QualityArg,
}

impl EncodingArgs {
    /// The baker's options.
    pub(crate) fn options(&self, context: &Context) -> BakeOptions {
        BakeOptions {
            fit: self.fit.into(),
            format: self.format.into(),
            quality: self.quality.into(),
            force: context.force,
            memory_bytes: context.memory_bytes,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum FormatArg {
    /// One byte per texel; normals BC5
    #[default]
    Bc7,
    /// Half a byte per texel; normals BC5
    Bc1,
    /// Four bytes per texel, uncompressed
    Rgba8,
    /// Sixteen bytes per texel, nothing rounded
    Float,
}

impl From<FormatArg> for BakeFormat {
    fn from(format: FormatArg) -> Self {
        match format {
            FormatArg::Bc7 => Self::Bc7,
            FormatArg::Bc1 => Self::Bc1,
            FormatArg::Rgba8 => Self::Rgba8,
            FormatArg::Float => Self::Float,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum FitArg {
    /// Fitted to the bilinear look-up, overshoot bounded
    #[default]
    Sharp,
    /// The value at the texel's centre
    Point,
    /// The mean over the texel
    Box,
}

impl From<FitArg> for Fit {
    fn from(fit: FitArg) -> Self {
        match fit {
            FitArg::Sharp => Self::Sharp,
            FitArg::Point => Self::Point,
            FitArg::Box => Self::Box,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum QualityArg {
    /// About 60 million texels per second and core
    #[default]
    UltraFast,
    /// A tenth of that, 2 dB better
    VeryFast,
    /// Slower, slightly better
    Fast,
    /// About 1 million texels per second and core
    Basic,
}

impl From<QualityArg> for Quality {
    fn from(quality: QualityArg) -> Self {
        match quality {
            QualityArg::UltraFast => Self::UltraFast,
            QualityArg::VeryFast => Self::VeryFast,
            QualityArg::Fast => Self::Fast,
            QualityArg::Basic => Self::Basic,
        }
    }
}

#[derive(Debug, Serialize)]
struct Seconds {
    load: f64,
    cover: f64,
    bake: f64,
    encode: f64,
    write: f64,
    total: f64,
}

#[derive(Debug, Serialize)]
pub(crate) struct BakeInfo {
    output: PathBuf,
    source: String,
    triangles: u64,
    groups: u64,
    texels: u64,
    /// Where a number was asked for. Many small tiles may hold more.
    texels_asked: Option<u64>,
    bytes: u64,
    channels: Vec<String>,
    /// `bake` and `encode` are seconds of all threads together, the others wall clock.
    seconds: Seconds,
    peak_memory_bytes: Option<u64>,
    #[serde(flatten)]
    photos: Option<PhotosInfo>,
}

/// What was found out about photographs.
#[derive(Debug, Serialize)]
struct PhotosInfo {
    photos: u64,
    /// Those that see some of the model.
    photos_used: u64,
    /// Those that have a mask in a file of its own.
    photos_masked: u64,
    /// Of the area, 0..1.
    unseen_share: f64,
    /// Factors of red, green and blue in linear light, in the order of the photographs' names.
    gains: Vec<[f32; 3]>,
    /// Bytes of photographs that did not fit into memory.
    scratch_bytes: u64,
}

impl From<&PhotoReport> for PhotosInfo {
    fn from(report: &PhotoReport) -> Self {
        Self {
            photos: report.photographs as u64,
            photos_used: report.used as u64,
            photos_masked: report.masked as u64,
            unseen_share: report.unseen_share,
            gains: report.gains.iter().map(|gain| gain.to_array()).collect(),
            scratch_bytes: report.scratch_bytes,
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &BakeArgs, context: &Context) -> Result<(), CliError> {
    let started = Instant::now();
    let mut model = CleanModel::open(&args.model)?;
    context.check_output_of(&args.output, &args.model)?;
    model.show_notes(&args.model, context);
    let source_arg = match (&args.look, &args.source) {
        (Some(look), _) => SourceArg::Look(look.clone()),
        (None, Some(source)) => source.clone(),
        (None, None) => SourceArg::default_of(&model.mesh, &args.model)?,
    };
    let look = match &source_arg {
        SourceArg::Look(path) => Some(wear(path, &mut model.mesh, &args.model, context)?),
        _ => None,
    };
    match &source_arg {
        SourceArg::Photos(_) => plain_materials(&mut model.mesh),
        SourceArg::Uv | SourceArg::Look(_) => {}
        _ => forget_textures(&mut model.mesh),
    }
    let mesh = &model.mesh;
    if let SourceArg::Photos(photos) = &source_arg {
        let info = bake_photos(photos, args, &model, started, context)?;
        return context.print(&info, text);
    }
    let detailed = DetailedModel::of(&source_arg, context)?;
    let own = match (&look, &detailed) {
        (None, None) => Some(OpenSource::open(&source_arg, mesh, &args.model, context.seed)?),
        _ => None,
    };
    let budget = budget(args, &source_arg, own.as_ref(), &model)?;
    let job = BakeJob {
        mesh,
        budget,
        cover: &args.cover,
        encoding: &args.encoding,
        output: &args.output,
        source_name: source_arg.to_string(),
        started,
        load_seconds: model.load_seconds + model.clean_seconds,
        memory_bytes: context.memory_bytes,
    };
    let info = match (&look, &detailed, &own) {
        (Some(look), _, _) => look.with_source(mesh, |source: &dyn Source| job.run(source, context))??,
        (None, Some(detailed), _) => transfer(detailed, job, context)?,
        (None, None, Some(source)) => job.run(source.as_source(), context)?,
        (None, None, None) => return Err(CliError::NothingToBake { path: args.model.clone() }),
    };
    context.print(&info, text)
}

/// Bakes another model's look and shape, and says how well the two fit.
fn transfer(detailed: &DetailedModel, job: BakeJob, context: &Context) -> Result<BakeInfo, CliError> {
    let colors = detailed.colors(context.seed)?;
    let source = detailed.onto(job.mesh, colors.as_ref().map(OpenSource::as_source))?;
    let name = job.source_name.clone();
    let info = job.run(&source, context)?;
    let report = source.report();
    // Single points at rims say nothing.
    if report.missed > report.points / 1000 {
        context.note(format!(
            "{name}: {:.1} % of the points found nothing within the cage of {:.4} world units along their normal and took the \
             nearest point; where that is wrong, give a longer cage",
            100.0 * report.missed as f64 / report.points as f64,
            report.cage
        ));
    }
    Ok(info)
}

/// Bakes photographs, and says what they do not show.
fn bake_photos(
    photos: &PhotosArg,
    args: &BakeArgs,
    model: &CleanModel,
    started: Instant,
    context: &Context,
) -> Result<BakeInfo, CliError> {
    let mesh = &model.mesh;
    let photographs = read_cameras_in(&photos.path, photos.images.as_deref(), photos.frame)?;
    let budget = args.cover.budget(mesh).unwrap_or(DEFAULT_BUDGET);
    let folder =
        args.output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let options = PhotoOptions {
        memory_bytes: context.memory_bytes,
        scratch: folder.to_owned(),
        exposure: photos.exposure,
        unseen: photos
            .unseen
            .map(|bytes| Vec3::from(bytes.map(|b| linear_from_srgb8_table()[usize::from(b)]))),
        texel_size: if args.match_source { None } else { texel_size(&budget, mesh) },
    };
    let source = PhotoSource::new(mesh, &photographs, &options, &context.progress("reading photographs"))?;
    let report = source.report();
    let name = format!("photos={photos}");
    if report.used < report.photographs {
        let unused = report.photographs - report.used;
        context.note(format!(
            "{name}: of {}, {unused} without the model",
            counted(report.photographs as u64, "photograph")
        ));
    }
    if report.unseen_share >= 0.0005 {
        let share = 100.0 * report.unseen_share;
        context.note(format!("{name}: no photograph sees {share:.1} % of the surface"));
    }
    let job = BakeJob {
        mesh,
        budget: if args.match_source { TexelBudget::PerTriangle(source.density()) } else { budget },
        cover: &args.cover,
        encoding: &args.encoding,
        output: &args.output,
        source_name: name,
        started,
        load_seconds: model.load_seconds + model.clean_seconds,
        // The other half holds photographs.
        memory_bytes: context.memory_bytes / 2,
    };
    let info = job.run_until(&source, &|| source.failure().is_some(), context);
    if let Some(error) = source.failure() {
        let source = io::Error::new(error.kind(), error.to_string());
        return Err(PhotoError::Scratch { folder: folder.to_owned(), source }.into());
    }
    Ok(BakeInfo { photos: Some(report.into()), ..info? })
}

/// Photographs show the finished look: what the model's own materials would add to it, such as a glow, goes.
fn plain_materials(mesh: &mut Mesh) {
    for material in &mut mesh.materials {
        let (name, double_sided) = (std::mem::take(&mut material.name), material.double_sided);
        *material = Material { name, double_sided, ..Material::default() };
    }
    mesh.images.clear();
}

/// Another source takes the place of the model's textures: factors that were meant to scale a texture of the model say nothing by
/// themselves. (A white glow, for example, would cover the source's colours.)
fn forget_textures(mesh: &mut Mesh) {
    let plain = Material::default();
    for material in &mut mesh.materials {
        if material.emission_texture.take().is_some() {
            material.emission = plain.emission;
        }
        if material.metallic_roughness_texture.take().is_some() {
            (material.metallic, material.roughness) = (plain.metallic, plain.roughness);
        }
    }
}

/// The side of a texel in mesh units, if the cover gives every triangle the same.
fn texel_size(budget: &TexelBudget, mesh: &Mesh) -> Option<f32> {
    match budget {
        TexelBudget::Total(texels) => Some((mesh.area() / (*texels).max(1) as f64).sqrt() as f32),
        TexelBudget::Density(density) => Some((1.0 / density) as f32),
        _ => None,
    }
}

/// A mesh, and how it becomes an asset.
pub(crate) struct BakeJob<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) budget: TexelBudget,
    pub(crate) cover: &'a CoverArgs,
    pub(crate) encoding: &'a EncodingArgs,
    pub(crate) output: &'a Path,
    pub(crate) source_name: String,
    pub(crate) started: Instant,
    /// What it took to get the mesh.
    pub(crate) load_seconds: f64,
    /// Bytes that texels in flight may take.
    pub(crate) memory_bytes: u64,
}

/// Ends a bake by itself, too.
struct Stoppable<'a> {
    progress: Bar<'a>,
    must_stop: &'a (dyn Fn() -> bool + Sync),
}

impl Progress for Stoppable<'_> {
    fn report(&self, done: u64, total: u64) {
        self.progress.report(done, total);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled() || (self.must_stop)()
    }
}

impl BakeJob<'_> {
    /// Covers the mesh and bakes `source`, with progress.
    pub(crate) fn run(self, source: &dyn Source, context: &Context) -> Result<BakeInfo, CliError> {
        self.run_until(source, &|| false, context)
    }

    /// As [`BakeJob::run`], but given up as soon as `must_stop` says so.
    fn run_until(
        self,
        source: &dyn Source,
        must_stop: &(dyn Fn() -> bool + Sync),
        context: &Context,
    ) -> Result<BakeInfo, CliError> {
        let Self { mesh, output, started, load_seconds, .. } = self;
        let cover_started = Instant::now();
        let texels_asked = texels_asked(&self.budget);
        let (cover, stats) = build_cover(mesh, &self.cover.options(self.budget))?;
        if let Some(note) = overdraft(texels_asked, &stats) {
            context.note(format!("{}: {note}", output.display()));
        }
        let cover_seconds = cover_started.elapsed().as_secs_f64();
        let options = BakeOptions { memory_bytes: self.memory_bytes, ..self.encoding.options(context) };
        let _deferral = context.defer_interrupt();
        let progress = Stoppable { progress: context.progress("baking"), must_stop };
        let summary = baking::bake(mesh, &cover, source, output, &options, &progress)?;
        let BakeSummary { texels, bytes, channels, bake_seconds, encode_seconds, write_seconds, .. } =
            summary;
        Ok(BakeInfo {
            output: output.to_owned(),
            source: self.source_name,
            triangles: mesh.triangles.len() as u64,
            groups: stats.groups,
            texels,
            texels_asked,
            bytes,
            channels,
            seconds: Seconds {
                load: load_seconds,
                cover: cover_seconds,
                bake: bake_seconds,
                encode: encode_seconds,
                write: write_seconds,
                total: started.elapsed().as_secs_f64(),
            },
            peak_memory_bytes: peak_memory_bytes(),
            photos: None,
        })
    }
}

/// Reads a look and dresses the model with it.
fn wear(path: &Path, mesh: &mut Mesh, model: &Path, context: &Context) -> Result<LookBake, CliError> {
    let file = LookFile::read(path)?;
    let images = LookImages::default();
    let wardrobe = Wardrobe { file: &file, images: &images, options: context.resolve_options() };
    Ok(LookBake::new(&wardrobe, mesh, model)?)
}

/// How many texels: what was asked for, else the source's own density, else a fixed number.
fn budget(
    args: &BakeArgs,
    source_arg: &SourceArg,
    source: Option<&OpenSource>,
    model: &CleanModel,
) -> Result<TexelBudget, CliError> {
    if let Some(budget) = args.cover.budget(&model.mesh) {
        return Ok(budget);
    }
    match source.and_then(OpenSource::own_density) {
        Some(density) => Ok(TexelBudget::PerTriangle(density)),
        None if args.match_source => Err(CliError::NothingToMatch { source_name: source_arg.to_string() }),
        None => Ok(DEFAULT_BUDGET),
    }
}

/// One line on a finished bake.
pub(crate) fn text(info: &BakeInfo) -> String {
    format!(
        "{}: {} in {}, {}, {} in {:.1} s",
        info.output.display(),
        counted(info.texels, "texel"),
        counted(info.groups, "tile"),
        info.channels.join(", "),
        megabytes(info.bytes),
        info.seconds.total
    )
}
