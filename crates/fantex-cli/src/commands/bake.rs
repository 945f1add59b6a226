//! `fantex bake`: a model and a source of colour in, one seamless asset out, or a model with texture coordinates.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use clap::Args;
use fantex::addresses::{Target, check_is_path};
use fantex::bake::{BakeSummary, LightMapNoise, Progress};
use fantex::export::ExportOptions;
use fantex::photos::PhotoReport;
use fantex::store::{Plan, WriterLock};
use fantex::{BakeFormat, Baked, Baker, Error, FileKind, Fit, Mesh, ModelKind, Quality, Result, model_notes};
use serde::Serialize;

use crate::commands::export::{ModelInfo, has_extension};
use crate::commands::info::CoverArgs;
use crate::commands::plan::{self, Shard};
use crate::context::{Bar, Context, peak_memory_bytes};
use crate::scene::{
    ReadArgs, check_asset_name, check_is_no_model_name, open_shape, report_damage, show_notes,
};
use crate::sources::SourceArg;
use crate::text::{Choices, ShownPath, counted, megabytes, one_of, over_budget};

/// Bake a model and a source of colour into one seamless asset, or into a model with texture coordinates.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bake bottle.gltf -o bottle.fan
  fantex bake statue.ply -o statue.fan --source solid=marble --texels 64M
  fantex bake globe.obj -o globe.fan --source image=earth.jpg,mapping=sphere --density 200
  fantex bake chair.glb -o chair.fan --look oak.toml
  fantex bake coarse.obj -o coarse.fan --source mesh=scan.ply,cage=0.02
  fantex bake scan.ply -o scan.fan --source photos=scan/sparse/0,images=scan/images
  fantex bake scan.ply -o scan.glb --texels 16M

Another model (mesh=PATH) gives its textures or vertex colours and its normals: every point of the model looks for its surface \
along the smooth normal, outwards and inwards, not farther than the cage, which is measured where it is not given.

Photographs (photos=PATH) need their cameras: a sparse model of COLMAP (text or binary) or a transforms.json, in whose coordinates \
the model lies. They are brought to one exposure unless exposure=off; what none of them sees takes the colours of its surroundings, or \
those of unseen=RRGGBB (docs/photographs.md). With --json the result then has photos, photos_used, photos_masked, unseen_share, gains and \
scratch_bytes, too. With --json, looks that bake light tell its noise: light has mean_samples, mean_light, error and, after denoising, \
error_left.

Without --source a model's own textures are baked, or else its vertex colours. Textures are baked at their own \
density unless --texels or --density says otherwise; other sources get 4M texels. A model that repeats its textures, as \
tiled walls and cards of leaves do, gets at most 16M texels, or twice those of its images, by itself; --match lifts this.

An output that ends in .glb or .gltf is a model with ordinary texture coordinates, for programs that know no fans, in the shortest way: without \
an asset, which 'fantex export' would make the same of with more choices. Its pictures have about as many texels as --texels says, and are squares with \
a power of two of columns.")]
pub(crate) struct BakeArgs {
    #[command(flatten)]
    job: JobArgs,
    /// Bake this part of a plan, the I-th of N, instead of a model: any machine may bake any part (see 'fantex plan')
    #[arg(long, value_name = "I/N", conflicts_with_all = ["source", "look", "texels", "density", "match_source", "tile", "longest_edge", "hard_edges", "format", "fit", "quality", "weld"])]
    shard: Option<Shard>,
}

/// A model, what is baked onto it, and how.
#[derive(Args, Debug)]
pub(crate) struct JobArgs {
    /// A model (.glb .gltf .obj .ply .stl), or with --source or --look an asset (.fan), whose mesh is taken
    model: PathBuf,
    /// The file to write, also at an s3://, gs:// or az:// address; .glb or .gltf for a model with texture coordinates
    #[arg(short, long, value_name = "ASSET")]
    pub(crate) output: PathBuf,
    /// uv, vertex, image=PATH,mapping=planar|box|cylinder|sphere|triplanar, solid=NAME, mesh=PATH[,cage=LENGTH],
    /// photos=PATH[,images=FOLDER][,frame=original][,exposure=off][,unseen=RRGGBB] or look=PATH; solids are wood, rings, marble, rock, granite, clouds, checker, brick and landscape
    #[arg(long)]
    source: Option<SourceArg>,
    /// A look (.toml), whose materials are baked: short for --source look=PATH
    #[arg(long, value_name = "LOOK", conflicts_with = "source")]
    look: Option<PathBuf>,
    #[command(flatten)]
    cover: CoverArgs,
    /// Give every triangle the density of the texture, or of the sharpest photograph, that it has
    #[arg(long = "match", conflicts_with_all = ["texels", "density"])]
    match_source: bool,
    #[command(flatten)]
    encoding: EncodingArgs,
    #[command(flatten)]
    read: ReadArgs,
}

const FORMATS: Choices<BakeFormat, 4> = [
    ("bc7", "One byte per texel; normals BC5", BakeFormat::Bc7),
    ("bc1", "Half a byte per texel; normals BC5", BakeFormat::Bc1),
    ("rgba8", "Four bytes per texel, uncompressed", BakeFormat::Rgba8),
    ("float", "Sixteen bytes per texel, nothing rounded", BakeFormat::Float),
];

pub(crate) const FITS: Choices<Fit, 3> = [
    ("sharp", "Fitted to the bilinear look-up, overshoot bounded", Fit::Sharp),
    ("point", "The value at the texel's centre", Fit::Point),
    ("box", "The mean over the texel", Fit::Box),
];

const QUALITIES: Choices<Quality, 4> = [
    ("ultra-fast", "About 25 million texels per second and core", Quality::UltraFast),
    ("very-fast", "A fifth of that, 2 dB better", Quality::VeryFast),
    ("fast", "Slower, slightly better", Quality::Fast),
    ("basic", "About 1 million texels per second and core", Quality::Basic),
];

/// How texels are found and stored.
#[derive(Args, Clone, Debug)]
pub(crate) struct EncodingArgs {
    /// Storage of the texels
    #[arg(long, value_parser = one_of(&FORMATS), default_value = "bc7")]
    format: BakeFormat,
    /// How texels are found from the source
    #[arg(long, value_parser = one_of(&FITS), default_value = "sharp")]
    fit: Fit,
    /// Effort of the BC7 encoder
    #[arg(long, value_parser = one_of(&QUALITIES), default_value = "ultra-fast")]
    quality: Quality,
}

impl EncodingArgs {
    /// The first option that says something else than its default.
    pub(crate) fn changed(&self) -> Option<&'static str> {
        let changed = [
            ("--format", self.format != BakeFormat::default()),
            ("--fit", self.fit != Fit::default()),
            ("--quality", self.quality != Quality::default()),
        ];
        changed.into_iter().find(|(_, is_changed)| *is_changed).map(|(option, _)| option)
    }

    /// Refuses an effort of an encoder that is not used.
    pub(crate) fn check(&self) -> Result<()> {
        if self.quality == Quality::default() || self.format == BakeFormat::Bc7 {
            return Ok(());
        }
        Err(Error::invalid("--quality is the effort of the BC7 encoder; leave it or --format out"))
    }
}

#[derive(Debug, Serialize)]
pub(crate) struct Seconds {
    load: f64,
    cover: f64,
    bake: f64,
    encode: f64,
    write: f64,
    pub(crate) total: f64,
}

#[derive(Debug, Serialize)]
pub(crate) struct BakeInfo {
    pub(crate) output: ShownPath,
    source: String,
    pub(crate) triangles: u64,
    pub(crate) groups: u64,
    pub(crate) texels: u64,
    /// Where a number was asked for. Many small tiles may hold more.
    texels_asked: Option<u64>,
    pub(crate) bytes: u64,
    pub(crate) channels: Vec<String>,
    /// `bake` and `encode` are seconds of all threads together, the others wall clock.
    pub(crate) seconds: Seconds,
    /// The noise of baked light.
    #[serde(skip_serializing_if = "Option::is_none")]
    light: Option<LightInfo>,
    peak_memory_bytes: Option<u64>,
    #[serde(flatten)]
    photos: Option<PhotosInfo>,
}

/// Standard errors in units of the light, means over all texels.
#[derive(Debug, Serialize)]
struct LightInfo {
    mean_samples: f64,
    mean_light: f64,
    error: f64,
    /// After denoising.
    error_left: f64,
}

impl From<LightMapNoise> for LightInfo {
    fn from(noise: LightMapNoise) -> Self {
        let LightMapNoise { mean_samples, mean_value, mean_error, mean_error_left, .. } = noise;
        Self { mean_samples, mean_light: mean_value, error: mean_error, error_left: mean_error_left }
    }
}

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

pub(crate) fn run(args: &BakeArgs, context: &Context) -> Result<()> {
    match args.shard {
        Some(_) if context.is_seed_asked => Err(Error::invalid(
            "--seed is in the plan, which decides what its parts hold; leave it out, or plan anew with it",
        )),
        Some(shard) => plan::bake_shard(&args.job.model, shard, &args.job.output, context),
        None if is_model(&args.job.output) => bake_model(&args.job, context),
        None => context.print(&bake(&args.job, &args.job.output, &Goal::Asset, context.seed, context)?, text),
    }
}

/// What becomes of the arguments of a bake.
pub(crate) enum Goal<'a> {
    Asset,
    /// All but texels, with this note.
    Plan(&'a [u8]),
    Part(&'a Plan, Shard),
}

/// Bakes what the arguments say, into `output` instead of theirs.
pub(crate) fn bake(
    args: &JobArgs,
    output: &Path,
    goal: &Goal<'_>,
    seed: u64,
    context: &Context,
) -> Result<BakeInfo> {
    match goal {
        Goal::Asset => {
            check_asset_name(output, ", or in .glb or .gltf for a model with texture coordinates")?
        }
        Goal::Plan(_) => check_is_no_model_name(output, "a plan", "bottle.plan")?,
        // Its name is checked before the plan is read.
        Goal::Part(..) => {}
    }
    with_job(args, output, goal, seed, context, |job| job.run(context))
}

/// Whether a path names a model that is written instead of an asset.
fn is_model(path: &Path) -> bool {
    ["glb", "gltf"].iter().any(|extension| has_extension(path, extension))
}

/// What can be said of a model that was baked.
#[derive(Debug, Serialize)]
struct BakedModelInfo {
    output: ShownPath,
    source: String,
    #[serde(flatten)]
    model: ModelInfo,
    /// Of all files.
    bytes: u64,
    seconds: ModelSeconds,
    #[serde(skip_serializing_if = "Option::is_none")]
    light: Option<LightInfo>,
    peak_memory_bytes: Option<u64>,
    #[serde(flatten)]
    photos: Option<PhotosInfo>,
}

/// Wall clock.
#[derive(Debug, Serialize)]
struct ModelSeconds {
    load: f64,
    /// Charts, pictures and the files.
    bake: f64,
    total: f64,
}

/// Bakes into a model.
fn bake_model(args: &JobArgs, context: &Context) -> Result<()> {
    let output = &args.output;
    let CoverArgs { tile, hard_edges, .. } = args.cover;
    let of_tiles = tile.map(|_| "--tile").or(hard_edges.map(|_| "--hard-edges"));
    if let Some(option) = of_tiles.or(args.encoding.changed()) {
        return Err(Error::invalid(format!(
            "{option} says how the tiles of an asset are made, and {} is a model; leave it out, or bake an asset (.fan) and export that",
            output.display()
        )));
    }
    check_is_path(output)?;
    let info = with_job(args, output, &Goal::Asset, context.seed, context, |job| job.run_model(context))?;
    context.print(&info, |info| {
        let (model, seconds) = (info.model.text("piece"), info.seconds.total);
        format!("{}: {model}, {seconds:.1} s\n{}", output.display(), info.model.others(output))
    })
}

/// Checks the arguments and hands the job that they make to `run`.
fn with_job<T>(
    args: &JobArgs,
    output: &Path,
    goal: &Goal<'_>,
    seed: u64,
    context: &Context,
    run: impl FnOnce(&BakeJob<'_>) -> Result<T>,
) -> Result<T> {
    let started = Instant::now();
    args.encoding.check()?;
    // What is no asset, a plan or a damaged file, is named first.
    let mesh = open_shape(&args.model, args.read, context)?;
    if args.look.is_none() && args.source.is_none() && FileKind::of(&args.model)? == FileKind::Asset {
        let model = args.model.display();
        return Err(Error::unsupported(format!(
            "{model} is an asset, already baked; give the model that it was baked from, or say what to bake onto its mesh, such as \
             --source solid=marble, or --source mesh={model} for what it holds at another density"
        )));
    }
    context.check_target_of(output, [args.model.as_path()])?;
    if context.force {
        // Who edits it is told of before any work is done.
        drop(WriterLock::of_replaced(output)?);
    }
    show_notes(&mesh, context);
    let source = match (&args.look, &args.source) {
        (Some(look), _) => SourceArg::Look(look.clone()),
        (None, Some(source)) => source.clone(),
        (None, None) => SourceArg::of_model(&mesh)?,
    };
    let job = BakeJob {
        mesh: &mesh,
        source,
        cover: &args.cover,
        match_source: args.match_source,
        encoding: &args.encoding,
        output,
        goal,
        seed,
        started,
    };
    if let (SourceArg::Uv, false) = (&job.source, mesh.has_materials()) {
        return Err(Error::invalid(format!(
            "{} has no textures and no colours of its materials; leave --source uv out, or give --source vertex, image=... or \
             solid=...",
            args.model.display()
        )));
    }
    if let (SourceArg::Vertex, false) = (&job.source, mesh.has_vertex_colors()) {
        return Err(Error::invalid(format!(
            "{} has no vertex colours; leave --source vertex out, or give --source uv, image=... or solid=...",
            args.model.display()
        )));
    }
    if args.match_source && !matches!(job.source, SourceArg::Uv | SourceArg::Photos(_)) {
        let source = &job.source;
        return Err(Error::invalid(format!(
            "--match takes the density of textures, and {source} has none; give --texels or --density"
        )));
    }
    run(&job)
}

/// A mesh, and how it becomes an asset.
pub(crate) struct BakeJob<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) source: SourceArg,
    pub(crate) cover: &'a CoverArgs,
    pub(crate) match_source: bool,
    pub(crate) encoding: &'a EncodingArgs,
    pub(crate) output: &'a Path,
    pub(crate) goal: &'a Goal<'a>,
    /// Of everything random.
    pub(crate) seed: u64,
    /// When the command began.
    pub(crate) started: Instant,
}

impl BakeJob<'_> {
    pub(crate) fn run(&self, context: &Context) -> Result<BakeInfo> {
        let Self { output, goal, .. } = self;
        let load_seconds = self.started.elapsed().as_secs_f64();
        let _deferral = context.defer_interrupt();
        let target = Target::new(output)?;
        let (baked, told) = {
            let progress = Teller::new(context);
            let baker = self.baker(context).progress(&progress);
            let baked = match goal {
                Goal::Asset => baker.write(target.file())?,
                Goal::Plan(about) => baker.write_plan(target.file(), about)?,
                Goal::Part(plan, Shard { number, count }) => {
                    baker.write_part(plan, *number, *count, target.file())?
                }
            };
            (baked, progress.told())
        };
        if let Some(note) = over_budget(baked.texels_asked, &baked.cover) {
            context.note(format!("{}: {note}", output.display()));
        }
        self.tell(&baked, &told, context)?;
        target.finish(&context.replace(), &context.step("uploading", "MB"))?;
        let BakeSummary {
            texels, bytes, channels, bake_seconds, encode_seconds, write_seconds, light, ..
        } = baked.summary;
        Ok(BakeInfo {
            output: (*output).into(),
            source: self.source.to_string(),
            triangles: baked.triangles,
            groups: baked.cover.groups,
            texels,
            texels_asked: baked.texels_asked,
            bytes,
            channels,
            seconds: Seconds {
                load: load_seconds,
                cover: baked.cover_time.as_secs_f64(),
                bake: bake_seconds,
                encode: encode_seconds,
                write: write_seconds,
                total: self.started.elapsed().as_secs_f64(),
            },
            light: light.map(LightInfo::from),
            peak_memory_bytes: peak_memory_bytes(),
            photos: baked.photos.as_ref().map(PhotosInfo::from),
        })
    }

    /// Writes a model with texture coordinates instead.
    fn run_model(&self, context: &Context) -> Result<BakedModelInfo> {
        let load = self.started.elapsed().as_secs_f64();
        let _deferral = context.defer_interrupt();
        let options = ExportOptions {
            force: context.force,
            strict: context.strict,
            memory_bytes: context.memory_bytes,
            ..ExportOptions::default()
        };
        let (baked, told) = {
            let progress = Teller::new(context);
            let baked = self.baker(context).progress(&progress).write_model(self.output, &options)?;
            (baked, progress.told())
        };
        self.tell(&baked, &told, context)?;
        let exported = baked.exported.unwrap_or_default();
        let notes = model_notes(self.output, &exported, ModelKind::Baked { side: None });
        notes.iter().for_each(|note| context.note(note));
        let (model, total) = (ModelInfo::new(&exported), self.started.elapsed().as_secs_f64());
        Ok(BakedModelInfo {
            output: self.output.into(),
            source: self.source.to_string(),
            bytes: model.bytes(),
            model,
            seconds: ModelSeconds { load, bake: total - load, total },
            light: baked.summary.light.map(LightInfo::from),
            peak_memory_bytes: peak_memory_bytes(),
            photos: baked.photos.as_ref().map(PhotosInfo::from),
        })
    }

    /// Says what was not said during the bake.
    fn tell(&self, baked: &Baked, told: &[String], context: &Context) -> Result<()> {
        baked.notes.iter().filter(|note| !told.contains(note)).for_each(|note| context.note(note));
        match &self.source {
            SourceArg::Mesh { path, .. } => report_damage(path, &baked.summary.damage, context),
            _ => Ok(()),
        }
    }

    fn baker<'b>(&'b self, context: &Context) -> Baker<'b> {
        let Self { mesh, cover, encoding, .. } = self;
        let mut baker = Baker::new(mesh)
            .source(self.source.source())
            .format(encoding.format)
            .fit(encoding.fit)
            .quality(encoding.quality)
            .overwrite(context.force)
            .strict(context.strict)
            .memory(context.memory_bytes)
            .seed(self.seed);
        baker = cover.given_to(baker);
        if self.match_source {
            baker = baker.matching();
        }
        baker
    }
}

/// Shows the progress of a bake, and prints what is worth knowing as soon as it is known.
struct Teller<'a> {
    context: &'a Context,
    /// None while a note is printed, which the bar would overwrite.
    bar: Mutex<Option<Bar<'a>>>,
    told: Mutex<Vec<String>>,
}

impl<'a> Teller<'a> {
    fn new(context: &'a Context) -> Self {
        Self { context, bar: Mutex::new(Some(Self::bar(context))), told: Mutex::default() }
    }

    fn bar(context: &'a Context) -> Bar<'a> {
        context.progress("baking")
    }

    /// The notes that were printed.
    fn told(self) -> Vec<String> {
        self.told.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for Teller<'_> {
    fn report(&self, done: u64, total: u64) {
        let bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        bar.iter().for_each(|bar| bar.report(done, total));
    }

    fn prepare(&self, word: &'static str, share: f32) {
        let bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        bar.iter().for_each(|bar| bar.prepare(word, share));
    }

    fn note(&self, sentence: &str) {
        let mut bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        drop(bar.take());
        self.context.note(sentence);
        *bar = Some(Self::bar(self.context));
        self.told.lock().unwrap_or_else(PoisonError::into_inner).push(sentence.to_owned());
    }

    fn is_cancelled(&self) -> bool {
        self.context.is_interrupted()
    }
}

pub(crate) fn text(info: &BakeInfo) -> String {
    let (output, contents) = (info.output.display(), contents(info));
    let light = info.light.as_ref().map_or(String::new(), |light| {
        let LightInfo { mean_light, error, error_left, .. } = light;
        format!("; light of {mean_light:.3} with an error of {error_left:.4} ({error:.4} before denoising)")
    });
    format!("{output}: {contents}, {} in {:.1} s{light}", megabytes(info.bytes), info.seconds.total)
}

/// Texels, tiles and channels.
pub(crate) fn contents(info: &BakeInfo) -> String {
    let (texels, tiles) = (counted(info.texels, "texel"), counted(info.groups, "tile"));
    format!("{texels} in {tiles}, {}", info.channels.join(", "))
}
