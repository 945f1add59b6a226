//! `fantex bake`: a model and a source of colour in, one seamless asset out.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fantex::bake::{self as baking, BakeFormat, BakeOptions, BakeSummary, Fit, Source};
use fantex::cover::{TexelBudget, build_cover};
use fantex::look::LookFile;
use fantex::look_scene::{LookBake, Wardrobe};
use fantex::mesh::Mesh;
use fantex::store::Quality;
use fantex::texture::look::LookImages;
use serde::Serialize;

use crate::commands::info::{CoverArgs, DEFAULT_BUDGET};
use crate::context::Context;
use crate::error::CliError;
use crate::input::CleanModel;
use crate::memory;
use crate::size::{grouped, megabytes};
use crate::sources::{DetailedModel, OpenSource, SourceArg};

/// Bake a model and a source of colour into one seamless asset.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bake bottle.gltf -o bottle.fan
  fantex bake statue.ply -o statue.fan --source solid=marble --texels 64M
  fantex bake globe.obj -o globe.fan --source image=earth.jpg,mapping=sphere --density 200
  fantex bake chair.glb -o chair.fan --look oak.toml
  fantex bake coarse.obj -o coarse.fan --source mesh=scan.ply,cage=0.02

Another model (mesh=PATH) gives its textures or vertex colours and its normals: every point of the model looks for its surface
along the smooth normal, outwards and inwards, not farther than the cage, which is measured where it is not given.

Without --source a model's own textures are baked, or else its vertex colours. Textures are baked at their own
density unless --texels or --density says otherwise; other sources get 4M texels.")]
pub(crate) struct BakeArgs {
    /// A model (.glb .gltf .obj .ply .stl)
    model: PathBuf,
    /// The asset to write
    #[arg(short, long, value_name = "ASSET")]
    output: PathBuf,
    /// uv, vertex, image=PATH,mapping=planar|box|cylinder|sphere|triplanar, solid=NAME, mesh=PATH[,cage=LENGTH]
    /// or look=PATH; solids are wood, marble, rock, granite, clouds, checker, brick and landscape
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
    bytes: u64,
    channels: Vec<String>,
    /// `bake` and `encode` are seconds of all threads together, the others wall clock.
    seconds: Seconds,
    peak_memory_bytes: Option<u64>,
}

/// Runs the command.
pub(crate) fn run(args: &BakeArgs, context: &Context) -> Result<(), CliError> {
    let started = Instant::now();
    let mut model = CleanModel::open(&args.model)?;
    context.check_output(&args.output)?;
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
    let mesh = &model.mesh;
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
}

impl BakeJob<'_> {
    /// Covers the mesh and bakes `source`, with progress.
    pub(crate) fn run(self, source: &dyn Source, context: &Context) -> Result<BakeInfo, CliError> {
        let Self { mesh, output, started, load_seconds, .. } = self;
        let cover_started = Instant::now();
        let (cover, stats) = build_cover(mesh, &self.cover.options(self.budget))?;
        let cover_seconds = cover_started.elapsed().as_secs_f64();
        let options = self.encoding.options(context);
        let _deferral = context.defer_interrupt();
        let progress = context.progress("baking");
        let summary = baking::bake(mesh, &cover, source, output, &options, &progress)?;
        let BakeSummary { texels, bytes, channels, bake_seconds, encode_seconds, write_seconds, .. } =
            summary;
        Ok(BakeInfo {
            output: output.to_owned(),
            source: self.source_name,
            triangles: mesh.triangles.len() as u64,
            groups: stats.groups,
            texels,
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
            peak_memory_bytes: memory::peak_bytes(),
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
        "{}: {} texels in {} tiles, {}, {} in {:.1} s",
        info.output.display(),
        grouped(info.texels),
        grouped(info.groups),
        info.channels.join(", "),
        megabytes(info.bytes),
        info.seconds.total
    )
}
