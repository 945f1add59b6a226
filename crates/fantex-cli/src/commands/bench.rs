//! `fantex bench`: figures of fidelity and speed.

mod paint;
mod stream;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use clap::{Args, Subcommand};
use fantex::bake::{self as baking, BakeFormat, BakeOptions, Fit, SineSource, fidelity};
use fantex::base::files::{TemporaryFolder, scratch_folder};
use fantex::base::input;
use fantex::base::random::nth_random;
use fantex::cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex::mesh::generate::{LandscapeOptions, landscape};
use fantex::mesh::{CleanOptions, LoadOptions, Model, SurfacePoint, clean, load};
use fantex::render::{FanSurface, FilterOptions, LookSurface, RenderOptions, Surface};
use fantex::store::{Asset, Footprint, PageCache, Sampler};
use fantex::texture::{ColorSpace, Filter, Image, ImageTexture, SampleOptions, Samples};
use fantex::{Baker, Covered, LongestEdge, Mesh, Result};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use serde::Serialize;

use crate::commands::bake::FITS;
use crate::commands::info::LongestEdgeArg;
use crate::context::Context;
use crate::scene::{photograph, portrait};
use crate::sources::SourceArg;
use crate::text::{Count, Table, bend, columns, counted, grouped, one_of, positive, whole};

/// Measure fidelity and speed.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bench fidelity bunny.ply --texels 5.59M --wavelength 16
  fantex bench cover --triangles 2M --json")]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Fidelity(FidelityArgs),
    /// Speed of covering, from welding to tile extents: grouped, and with one fan per tile
    Cover(ModelArgs),
    /// Speed of baking: uncompressed and BC7
    Bake(ModelArgs),
    /// Speed of single look-ups through the texture function, beside plain image look-ups
    Sample(ModelArgs),
    /// Speed of rendering an asset, beside the model itself
    Render(ModelArgs),
    Stream(stream::StreamArgs),
    Paint(paint::PaintBenchArgs),
}

/// Bake a sum of sine waves into float tiles and compare it with the function at 400 000 points of the surface.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bench fidelity bunny.ply --texels 5.59M --wavelength 16")]
struct FidelityArgs {
    /// A model (.glb .gltf .obj .ply .stl)
    model: PathBuf,
    /// Texels in all
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "4M")]
    texels: Count,
    /// Wavelength in texels of the ideal density
    #[arg(long, value_name = "W", allow_negative_numbers = true, default_value_t = 16.0, value_parser = positive)]
    wavelength: f64,
    /// Target extent of a tile in texels; 0 gives every fan its own tile
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u32>)]
    tile: Option<u32>,
    /// Cut triangles at bends until their edges are at most so many texels long, as 'fantex bake' does; 0 leaves them whole
    #[arg(long, value_name = "N|auto", default_value = "auto")]
    longest_edge: LongestEdgeArg,
    /// Cut the texture at edges whose two triangles' normals differ by at least so many degrees
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = bend)]
    hard_edges: Option<f32>,
    /// How texels are found from the function
    #[arg(long, value_parser = one_of(&FITS), default_value = "sharp")]
    fit: Fit,
}

/// The model of a benchmark.
#[derive(Args, Debug)]
struct ModelArgs {
    /// A model; a generated landscape by default
    model: Option<PathBuf>,
    /// Triangles of the generated landscape
    #[arg(
        long,
        value_name = "N",
        allow_negative_numbers = true,
        default_value = "200k",
        conflicts_with = "model"
    )]
    triangles: Count,
    /// Texels in all
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "16M")]
    texels: Count,
}

#[derive(Clone, Debug, Serialize)]
struct Row {
    name: String,
    value: f64,
    unit: &'static str,
    /// The same measured for the usual way of doing it, where there is one.
    peer: Option<f64>,
    /// `value / peer`.
    ratio: Option<f64>,
}

impl Row {
    fn new(name: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, unit, peer: None, ratio: None }
    }

    fn beside(self, peer: f64) -> Self {
        Self { peer: Some(peer), ratio: Some(self.value / peer), ..self }
    }
}

#[derive(Debug, Serialize)]
struct Rows {
    rows: Vec<Row>,
}

pub(crate) fn run(args: &BenchArgs, context: &Context) -> Result<()> {
    let rows = match &args.what {
        What::Fidelity(args) => return measure_fidelity(args, context),
        What::Cover(args) => cover(args, context)?,
        What::Bake(args) => bake(args, context)?,
        What::Sample(args) => sample(args, context)?,
        What::Render(args) => render(args, context)?,
        What::Stream(args) => stream::stream(args, context)?,
        What::Paint(args) => paint::paint(args, context)?,
    };
    context.print(&Rows { rows }, |result| text(&result.rows))
}

fn text(rows: &[Row]) -> String {
    let number = |value: f64| match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.2}"),
        v => format!("{v:.4}"),
    };
    let optional = |value: Option<f64>| value.map_or(String::new(), number);
    let mut cells = vec![["", "value", "unit", "peer", "ratio"].map(str::to_owned).to_vec()];
    cells.extend(rows.iter().map(|row| {
        let unit = row.unit.to_owned();
        vec![row.name.clone(), number(row.value), unit, optional(row.peer), optional(row.ratio)]
    }));
    columns(&cells)
}

/// Points of the surface that are compared.
const SAMPLES: u64 = 400_000;

#[derive(Debug, Serialize)]
struct FidelityInfo {
    psnr_db: f64,
    density_share: f64,
    lookups_per_sample: f64,
    texels: u64,
    largest_error: f32,
    samples: u64,
    groups: u64,
    tile: u32,
    wavelength: f64,
}

fn measure_fidelity(args: &FidelityArgs, context: &Context) -> Result<()> {
    let model = crate::scene::open_model(&args.model, context)?;
    let tile = args.tile.unwrap_or(CoverOptions::default().tile);
    let progress = context.step("covering", "M texels");
    let LongestEdgeArg(longest_edge) = args.longest_edge;
    let mut baker = Baker::new(&model).texels(args.texels.0).longest_edge(longest_edge).tile(tile);
    if let Some(degrees) = args.hard_edges {
        baker = baker.hard_edges(degrees);
    }
    let Covered { mesh, cover, stats, .. } = baker.progress(&progress).cover_shape()?;
    let mesh = &*mesh;
    let ideal_texel = (mesh.area() / args.texels.0 as f64).sqrt();
    let k = std::f64::consts::TAU / (args.wavelength * ideal_texel);
    let source = SineSource { k: k as f32 };

    let options = BakeOptions {
        fit: args.fit,
        format: BakeFormat::Float,
        memory_bytes: context.memory_bytes,
        ..BakeOptions::default()
    };
    let _deferral = context.defer_interrupt();
    let folder = scratch_folder()?;
    let path = folder.path().join("fidelity.fan");
    baking::bake(mesh, &cover, &source, &path, &options, &context.progress("baking"))?;
    let cache = PageCache::new(Arc::new(Asset::open(&path)?), context.memory_bytes as usize);
    let measured = fidelity(&cache, SAMPLES, context.seed, &|p| source.value(p));
    let info = FidelityInfo {
        psnr_db: measured.psnr_db,
        density_share: stats.density_share,
        lookups_per_sample: measured.lookups_per_sample,
        texels: stats.texels,
        largest_error: measured.largest,
        samples: measured.samples,
        groups: stats.groups,
        tile,
        wavelength: args.wavelength,
    };
    context.print(&info, fidelity_text)
}

fn fidelity_text(info: &FidelityInfo) -> String {
    let mut table = Table::default();
    table
        .row("fidelity", format!("{:.2} dB", info.psnr_db))
        .row("largest error", format!("{:.5}", info.largest_error))
        .row("share of ideal density", format!("{:.3}", info.density_share))
        .row("look-ups per sample", format!("{:.3}", info.lookups_per_sample))
        .row("texels", grouped(info.texels))
        .row("groups", grouped(info.groups));
    table.to_text()
}

/// Repetitions of quick measurements; the fastest counts.
const REPETITIONS: usize = 3;

/// Covering: all steps from welding to tile extents, cleaning and its report included.
fn cover(args: &ModelArgs, context: &Context) -> Result<Vec<Row>> {
    let model = open_model(args, context)?;
    let mut rows = Vec::new();
    for (name, tile) in [("cover, grouped", CoverOptions::default().tile), ("cover, one fan per tile", 0)] {
        let budget = TexelBudget::Total(args.texels.0);
        let options = CoverOptions { budget, tile, ..CoverOptions::default() };
        let mut best_seconds = f64::INFINITY;
        for _ in 0..REPETITIONS {
            let model = model.clone();
            let started = Instant::now();
            let (mesh, _) = clean(model, &CleanOptions::default())?;
            build_cover(&mesh, &options)?;
            best_seconds = best_seconds.min(started.elapsed().as_secs_f64());
        }
        rows.push(Row::new(name, model.triangles.len() as f64 / best_seconds / 1e6, "M triangles/s"));
    }
    Ok(rows)
}

/// Baking from the model's textures, or from marble.
fn bake(args: &ModelArgs, context: &Context) -> Result<Vec<Row>> {
    let bench = Bench::open(args, context)?;
    let mut rows = Vec::new();
    for (format_name, format) in [("rgba8", BakeFormat::Rgba8), ("bc7", BakeFormat::Bc7)] {
        let name = format!("bake {}, {format_name}", bench.source);
        let baked = bench.bake(format, context)?;
        let texels = baked.texels as f64 * baked.channels as f64;
        rows.push(Row::new(&name, texels / baked.seconds / 1e6, "M texels/s"));
        rows.push(Row::new(format!("{name}, size"), baked.bytes as f64 / texels, "bytes/texel"));
    }
    Ok(rows)
}

/// Bilinear look-ups at random points, beside bilinear look-ups at random places of one image of as many texels.
fn sample(args: &ModelArgs, context: &Context) -> Result<Vec<Row>> {
    const SAMPLES: u64 = 4_000_000;
    let bench = Bench::open(args, context)?;
    let baked = bench.bake(BakeFormat::Rgba8, context)?;
    let side = (baked.texels as f64).sqrt() as u32;
    let image_bytes = u64::from(side) * u64::from(side) * 4;
    // With its levels, which are made one from the other.
    let held = input::reserve("an image of as many texels", 2 * image_bytes)?;
    let texels = [64, 128, 192, 255].repeat(image_bytes as usize / 4);
    let samples = Samples::U8(texels);
    let image = Image { width: side, height: side, channels: 4, space: ColorSpace::Linear, samples };
    let texture = ImageTexture::new(Arc::new(image));
    drop(held);
    let cache_bytes = input::share_of_cache(context.memory_bytes) as usize;
    let cache = PageCache::new(Arc::new(Asset::open(&baked.path)?), cache_bytes);
    let bilinear = FilterOptions { filter: Filter::Bilinear, ..FilterOptions::default() };
    let sampler = Sampler::of_cache(&cache, bilinear);
    let triangles = bench.mesh.triangles.len() as u64;
    let points = |i: u64| {
        let [r, s] = [3 * i, 3 * i + 1].map(|n| unit(context.seed, n));
        let lambda =
            if r + s < 1.0 { Vec3::new(r, s, 1.0 - r - s) } else { Vec3::new(1.0 - r, 1.0 - s, r + s - 1.0) };
        ((nth_random(context.seed, 3 * i + 2) % triangles) as usize, lambda)
    };
    let fans = || {
        (0..SAMPLES as usize)
            .into_par_iter()
            .with_min_len(1 << 14)
            .map(|i| {
                let (triangle, lambda) = points(i as u64);
                let point = SurfacePoint { triangle: triangle as u32, lambda };
                sampler.sample_channel(0, point, Footprint::NONE).x
            })
            .sum::<f32>()
    };
    std::hint::black_box(fans());
    let fan_seconds = fastest(|| {
        std::hint::black_box(fans());
        Ok(())
    })?;

    let options = SampleOptions { filter: Filter::Bilinear, ..SampleOptions::default() };
    let plain = || {
        (0..SAMPLES as usize)
            .into_par_iter()
            .with_min_len(1 << 14)
            .map(|i| {
                let [u, v] = [2 * i, 2 * i + 1].map(|n| unit(context.seed, n as u64));
                texture.sample(Vec2::new(u, v), [Vec2::ZERO; 2], &options)[0]
            })
            .sum::<f32>()
    };
    let plain_seconds = fastest(|| {
        std::hint::black_box(plain());
        Ok(())
    })?;
    let rate = |seconds: f64| SAMPLES as f64 / seconds / 1e6;
    let name =
        format!("sample, bilinear, random, {}", counted(rayon::current_num_threads() as u64, "thread"));
    Ok(vec![Row::new(name, rate(fan_seconds), "M samples/s").beside(rate(plain_seconds))])
}

/// Rendering an asset, beside rendering the model with its own textures.
fn render(args: &ModelArgs, context: &Context) -> Result<Vec<Row>> {
    let bench = Bench::open(args, context)?;
    let baked = bench.bake(BakeFormat::Bc7, context)?;
    let cache = PageCache::new(Arc::new(Asset::open(&baked.path)?), context.memory_bytes as usize);
    let options = RenderOptions { samples: 4, ..RenderOptions::default() };
    let camera = portrait(&bench.mesh, &options);
    let mut rows = Vec::new();
    for (name, filter) in [("trilinear", Filter::Trilinear), ("anisotropic", Filter::Anisotropic)] {
        let filter = FilterOptions { filter, ..FilterOptions::default() };
        let seconds = |surface: &dyn Surface| {
            fastest(|| photograph(&bench.mesh, surface, &camera, &options).map(|_| ()))
        };
        let fans = seconds(&*FanSurface::boxed(&cache, filter))?;
        let model = seconds(&LookSurface::of_model(&bench.mesh, filter)?)?;
        rows.push(Row::new(format!("render 1280x720, {name}"), 1e3 * fans, "ms").beside(1e3 * model));
    }
    Ok(rows)
}

/// A model with its cover, and a folder for assets.
struct Bench {
    mesh: Mesh,
    cover: Cover,
    source: SourceArg,
    folder: TemporaryFolder,
}

struct Baked {
    path: PathBuf,
    texels: u64,
    channels: usize,
    bytes: u64,
    seconds: f64,
}

impl Bench {
    fn open(args: &ModelArgs, context: &Context) -> Result<Self> {
        let mesh = open(args, context)?;
        let progress = context.step("covering", "M texels");
        let baker = Baker::new(&mesh).texels(args.texels.0).longest_edge(LongestEdge::Texels(0));
        let cover = baker.progress(&progress).cover_shape()?.cover;
        let source = SourceArg::of_model(&mesh).unwrap_or(SourceArg::Solid("marble".to_owned()));
        let folder = scratch_folder()?;
        Ok(Self { mesh, cover, source, folder })
    }

    fn bake(&self, format: BakeFormat, context: &Context) -> Result<Baked> {
        let path = self.folder.path().join(format!("{format:?}.fan"));
        let source = self.source.source();
        let source = source.evaluator(&self.mesh, context.seed)?;
        let options = BakeOptions { format, memory_bytes: context.memory_bytes, ..BakeOptions::default() };
        let _deferral = context.defer_interrupt();
        let started = Instant::now();
        let progress = context.progress("baking");
        let summary = baking::bake(&self.mesh, &self.cover, source.as_ref(), &path, &options, &progress)?;
        Ok(Baked {
            path,
            texels: summary.texels,
            channels: summary.channels.len(),
            bytes: summary.bytes,
            seconds: started.elapsed().as_secs_f64(),
        })
    }
}

fn open(args: &ModelArgs, context: &Context) -> Result<Mesh> {
    if let Some(path) = &args.model {
        return crate::scene::open_model(path, context);
    }
    Mesh::from_model(open_model(args, context)?, "landscape")
}

/// The model as its file says, or a landscape.
fn open_model(args: &ModelArgs, context: &Context) -> Result<Model> {
    if let Some(path) = &args.model {
        return load(path, &LoadOptions::default());
    }
    let options =
        LandscapeOptions { triangles: args.triangles.0, seed: context.seed, ..LandscapeOptions::default() };
    Ok(landscape(&options)?.into())
}

/// Seconds of the fastest repetition.
fn fastest(mut work: impl FnMut() -> Result<()>) -> Result<f64> {
    let mut best = f64::INFINITY;
    for _ in 0..REPETITIONS {
        let started = Instant::now();
        work()?;
        best = best.min(started.elapsed().as_secs_f64());
    }
    Ok(best)
}

/// A number in [0, 1) that depends on seed and index.
fn unit(seed: u64, index: u64) -> f32 {
    (nth_random(seed, index) >> 40) as f32 / (1 << 24) as f32
}
