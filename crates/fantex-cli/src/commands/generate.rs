//! `fantex generate`: procedural models, and photographs of models.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, Subcommand, ValueEnum};
use fantex::base::files::exists;
use fantex::mesh::generate::{Landscape, LandscapeOptions, landscape};
use fantex::mesh::{Model, WriteGeometry, write_model};
use fantex::photos::{
    CameraFromWorld, CaptureOptions, CaptureScene, Distortion, Lens, PhotoCamera, Photograph,
    write_colmap_binary, write_colmap_text, write_transforms,
};
use fantex::render::Camera;
use fantex::texture::{ColorSpace, Depth};
use fantex::{Error, Mesh, Result};
use glam::{DVec3, Vec3};
use serde::Serialize;

use crate::commands::bake;
use crate::commands::bake::{BakeInfo, BakeJob, EncodingArgs, Goal};
use crate::commands::info::CoverArgs;
use crate::context::{Context, check_can_be_folder};
use crate::scene::{check_model_name, open_model, show_notes, size};
use crate::series::Series;
use crate::sources::SourceArg;
use crate::text::{Count, ShownPath, counted, grouped, positive, share, whole};

/// Generate a procedural model, or photographs of a model.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex generate landscape -o cave.ply --triangles 500k --seed 7
  fantex generate photographs bottle.gltf -o shoot --count 24")]
pub(crate) struct GenerateArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Landscape(LandscapeArgs),
    Photographs(PhotographsArgs),
}

/// A closed landscape with mountains, cliffs, overhangs, tunnels and arches; y is up, units are metres.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex generate landscape -o cave.ply --triangles 500k --seed 7
  fantex generate landscape -o world.fan --triangles 1M --texels 16G --format bc1 --memory 512M

An asset (.fan) is baked at once from the solid 'landscape': sand, grass, rock and snow by altitude and slope.")]
struct LandscapeArgs {
    /// The model to write: .ply, .obj or .glb; or an asset: .fan
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Triangles aimed at; from about 5k on the result lies within a tenth of it. The coarsest landscapes have about a
    /// thousand
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "500k")]
    triangles: Count,
    /// Side of the square in metres
    #[arg(long, value_name = "METRES", default_value_t = f64::from(LandscapeOptions::default().size), value_parser = positive, allow_negative_numbers = true)]
    size: f64,
    /// Tunnels wanted
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = LandscapeOptions::default().tunnels, value_parser = whole::<u32>)]
    tunnels: u32,
    /// Natural arches wanted
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = LandscapeOptions::default().arches, value_parser = whole::<u32>)]
    arches: u32,
    /// How far triangles are from regular, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    irregularity: f32,
    #[command(flatten, next_help_heading = "Assets only")]
    cover: CoverArgs,
    #[command(flatten, next_help_heading = "Assets only")]
    encoding: EncodingArgs,
}

impl LandscapeArgs {
    fn writes_asset(&self) -> bool {
        self.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("fan"))
    }
}

#[derive(Debug, Serialize)]
struct LandscapeInfo {
    output: ShownPath,
    triangles: u64,
    #[serde(flatten)]
    shape: LandscapeShape,
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct BakedLandscapeInfo {
    #[serde(flatten)]
    bake: BakeInfo,
    #[serde(flatten)]
    shape: LandscapeShape,
}

#[derive(Debug, Serialize)]
struct LandscapeShape {
    vertices: u64,
    genus: u64,
    components: u64,
    tunnels: u32,
    arches: u32,
    seed: u64,
}

pub(crate) fn run(args: &GenerateArgs, context: &Context) -> Result<()> {
    match &args.what {
        What::Landscape(args) => run_landscape(args, context),
        What::Photographs(args) => run_photographs(args, context),
    }
}

fn run_landscape(args: &LandscapeArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    if !args.writes_asset() {
        check_model_name(&args.output)
            .map_err(|error| Error::invalid(format!("{error}, or .fan for an asset")))?;
        if let Some(option) = args.cover.given().or(args.encoding.changed()) {
            return Err(Error::invalid(format!(
                "{} is a model and has no texels: leave {option} out, or write an asset (.fan)",
                args.output.display()
            )));
        }
    }
    args.encoding.check()?;
    context.check_output(&args.output)?;
    let made = landscape(&LandscapeOptions {
        triangles: args.triangles.0,
        seed: context.seed,
        size: args.size as f32,
        tunnels: args.tunnels,
        arches: args.arches,
        irregularity: args.irregularity,
    })?;
    let (triangles, asked) = (made.triangles.len() as u64, args.triangles.0);
    if triangles.abs_diff(asked) > asked / 10 {
        context.note(format!(
            "{}: {} instead of the {} asked for: coarse landscapes come in large steps, the coarsest with about a thousand",
            args.output.display(),
            counted(triangles, "triangle"),
            grouped(asked)
        ));
    }
    let shape = LandscapeShape {
        vertices: made.positions.len() as u64,
        genus: made.genus,
        components: made.components,
        tunnels: made.tunnels,
        arches: made.arches,
        seed: context.seed,
    };
    if args.writes_asset() {
        let bake = bake_landscape(args, made.into(), started, context)?;
        return context.print(&BakedLandscapeInfo { bake, shape }, |info| bake::text(&info.bake));
    }
    write_landscape(&made, &args.output, context.force, context)?;
    let info = LandscapeInfo {
        output: (&args.output).into(),
        triangles,
        shape,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        format!(
            "{}: {}, genus {} ({}, {}), {:.1} s",
            info.output.display(),
            counted(info.triangles, "triangle"),
            info.shape.genus,
            counted(u64::from(info.shape.tunnels), "tunnel"),
            counted(u64::from(info.shape.arches), "arch"),
            info.seconds
        )
    })
}

/// Writes a landscape as a model.
pub(crate) fn write_landscape(made: &Landscape, path: &Path, force: bool, context: &Context) -> Result<()> {
    let positions: Vec<_> = made.positions.iter().copied().map(Vec3::as_dvec3).collect();
    let _deferral = context.defer_interrupt();
    let geometry = WriteGeometry { positions: &positions, triangles: &made.triangles, colors: None };
    write_model(path, &geometry, force)
}

fn bake_landscape(
    args: &LandscapeArgs,
    model: Model,
    started: Instant,
    context: &Context,
) -> Result<BakeInfo> {
    let mesh = Mesh::from_model(model, &args.output)?;
    let job = BakeJob {
        mesh: &mesh,
        source: SourceArg::Solid("landscape".to_owned()),
        cover: &args.cover,
        match_source: false,
        encoding: &args.encoding,
        output: &args.output,
        goal: &Goal::Asset,
        seed: context.seed,
        started,
    };
    job.run(context)
}

/// Photographs of a model from all sides, with the files that photogrammetry programs write about their cameras: images/,
/// sparse/0/ (COLMAP, binary and text) and transforms.json.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex generate photographs bottle.gltf -o shoot --count 24
  fantex generate photographs bottle.gltf -o shoot --count 24 --lens radial --exposure 0.4 --standing
  fantex bake bottle.gltf -o bottle.fan --source photos=shoot

The model is lit from everywhere, before a grey wall, so photographs show its base colour; what is behind glass and holes is seen through \
them.")]
pub(super) struct PhotographsArgs {
    /// A model (.glb .gltf .obj .ply .stl)
    model: PathBuf,
    /// The folder to write into
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Number of photographs, spread evenly around the model
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    count: u32,
    /// Width and height in pixels, at most 16384 each
    #[arg(long, value_name = "WxH", default_value = "1200x900", value_parser = size)]
    size: [u32; 2],
    /// What the camera sees through
    #[arg(long, value_enum, default_value_t)]
    lens: LensArg,
    /// How far exposure and tint of the photographs differ, 0 to 1: up to half as light again or as dark at 0.5
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    exposure: f32,
    /// The model stands on something: no photograph from below
    #[arg(long)]
    standing: bool,
    /// Rays along each side of a pixel
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: u32,
    /// What the model looks like: uv, vertex, image=PATH,mapping=NAME or solid=NAME; its own look by default
    #[arg(long)]
    source: Option<SourceArg>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum LensArg {
    /// No distortion
    Pinhole,
    /// Radial and tangential distortion, as of a wide lens
    #[default]
    Radial,
    /// A fisheye
    Fisheye,
}

impl LensArg {
    fn lens(self) -> Lens {
        Lens::new(match self {
            Self::Pinhole => Distortion::PINHOLE,
            Self::Radial => Distortion::Perspective {
                radial: [-0.12, 0.03, 0.0, 0.0, 0.0, 0.0],
                tangential: [0.0008, -0.0012],
            },
            Self::Fisheye => Distortion::fisheye([-0.02, 0.003, -0.001, 0.0]),
        })
    }
}

#[derive(Debug, Serialize)]
struct PhotographsInfo {
    output: ShownPath,
    photos: u64,
    width: u32,
    height: u32,
    seconds: f64,
}

fn run_photographs(args: &PhotographsArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let [images, sparse] = [args.output.join("images"), args.output.join("sparse/0")];
    let transforms = args.output.join("transforms.json");
    for path in [&images, &args.output.join("sparse"), &transforms] {
        if !context.force && path.symlink_metadata().is_ok() {
            return Err(exists(path));
        }
    }
    [&args.output, &images, &sparse].into_iter().try_for_each(|folder| check_can_be_folder(folder))?;
    let mesh = &open_model(&args.model, context)?;
    show_notes(mesh, context);
    let look = match &args.source {
        Some(source) => source.clone(),
        None => SourceArg::of_model(mesh)?,
    };
    let look = look.source();
    let look = look.evaluator(mesh, context.seed)?;
    let photographs = set_up(args, mesh, &images);
    let scene = CaptureScene::new(mesh, look.as_ref());
    let mut series = Series::all_or_none(context, &args.output, "photograph", u64::from(args.count));
    [&images, &sparse].into_iter().try_for_each(|folder| context.make_folder(folder))?;
    context.check_output_of(&transforms, &args.model)?;
    for (i, photograph) in photographs.iter().enumerate() {
        context.check_interrupt()?;
        let exposure = exposure(i, args.exposure);
        let options = CaptureOptions { samples: args.samples, exposure, ..CaptureOptions::default() };
        let picture = scene.capture(photograph, &options, &|| context.is_interrupted())?;
        let path = &photograph.path;
        series.write(path, || picture.converted(Depth::U8, ColorSpace::Srgb).save(path))?;
    }
    {
        let _deferral = context.defer_interrupt();
        write_colmap_binary(&sparse, &photographs)?;
        write_colmap_text(&sparse, &photographs)?;
        write_transforms(&transforms, &photographs, "images")?;
        series.finish();
    }
    let [width, height] = args.size;
    let info = PhotographsInfo {
        output: (&args.output).into(),
        photos: photographs.len() as u64,
        width,
        height,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let PhotographsInfo { output, photos, width, height, seconds } = info;
        let photos = counted(*photos, "photograph");
        format!("{}: {photos} of {width} x {height} pixels, {seconds:.1} s", output.display())
    })
}

/// Cameras all around the model that show it whole.
fn set_up(args: &PhotographsArgs, mesh: &Mesh, images: &Path) -> Vec<Photograph> {
    let size = args.size;
    let [width, height] = size.map(f64::from);
    let framed = Camera::orbit(mesh, args.count as usize, width / height);
    let photograph = |(i, camera): (usize, Camera)| {
        let camera = match args.standing {
            true => {
                let direction = camera.eye - camera.target;
                Camera::framing_mesh(
                    mesh,
                    DVec3::new(direction.x, direction.y.abs(), direction.z),
                    width / height,
                )
            }
            false => camera,
        };
        let focal = 0.5 * height / (0.5 * camera.fov_degrees.to_radians()).tan();
        let name = format!("{i:04}.png");
        Photograph {
            path: images.join(&name),
            mask: None,
            name,
            camera: PhotoCamera { lens: args.lens.lens(), ..PhotoCamera::pinhole(size, focal) },
            camera_from_world: CameraFromWorld::looking_at(camera.eye, camera.target, camera.up),
        }
    };
    framed.into_iter().enumerate().map(photograph).collect()
}

/// Factors of red, green and blue of a photograph, all different, around 1.
fn exposure(number: usize, spread: f32) -> Vec3 {
    // Three turns by the golden angle, so that neighbours differ.
    let wave = |turn: f32| (number as f32 * 2.4 + turn).sin();
    let tint = Vec3::new(wave(1.0), 0.0, wave(2.5)) * 0.15;
    (Vec3::splat(wave(0.0)) + tint).map(|x| (1.0 + spread).powf(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures_differ_as_far_as_they_are_told_to() {
        assert!((0..50).all(|i| exposure(i, 0.0) == Vec3::ONE));
        let greens: Vec<f32> = (0..50).map(|i| exposure(i, 0.5).y).collect();
        assert!(greens.iter().all(|g| (1.0 / 1.51..1.51).contains(g)));
        assert!(greens.iter().any(|&g| g > 1.45) && greens.iter().any(|&g| g < 0.69));
    }
}
