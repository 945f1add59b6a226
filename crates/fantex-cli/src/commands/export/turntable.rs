//! Pictures around the model.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use fantex::base::files::{persist, persist_all, temporary_file};
use fantex::mesh::Mesh;
use fantex::render::{Camera, Lights, RenderOptions, render};
use fantex::scene::world_bounds;
use fantex::texture::{Image, Samples};
use fantex::{Error, Result, Surroundings};
use glam::DQuat;
use serde::Serialize;
use tempfile::{NamedTempFile, TempPath};

use super::{ExportArgs, PictureSize, UvArg, has_extension};
use crate::context::Context;
use crate::scene::{Scene, aspect, known_extension};
use crate::series::Series;
use crate::text::{ShownPath, counted, within};

#[derive(Debug, Serialize)]
struct TurntableInfo {
    output: ShownPath,
    pictures: Vec<ShownPath>,
    frames: u32,
    width: u32,
    height: u32,
    seconds: f64,
}

/// Seconds that a picture of an animated PNG can last, as they are written here.
const MAX_SECONDS: f64 = 1000.0;

/// Seconds of a whole turn, for argument parsing.
pub(super) fn whole_turn(text: &str) -> std::result::Result<f64, String> {
    let is_inside = |seconds: f64| seconds > 0.0 && seconds <= MAX_SECONDS;
    within(text, "expected a number of seconds above zero, at most 1000", is_inside)
}

/// Renders `count` pictures: an animation where the output is a PNG, numbered files in a folder else.
pub(super) fn run(args: &ExportArgs, count: u32, context: &Context) -> Result<()> {
    let is_animation = has_extension(&args.output, "png");
    check(args, is_animation)?;
    let started = Instant::now();
    let scene = Scene::open(&args.asset, context)?;
    let [width, height] = match args.size {
        None => [800, 600],
        Some(PictureSize::Side(side)) => [side, side],
        Some(PictureSize::WidthHeight(size)) => size,
    };
    let mut options = RenderOptions { width, height, samples: args.samples, ..RenderOptions::default() };
    let files: Vec<PathBuf> = match is_animation {
        true => vec![args.output.clone()],
        false => (1..=count).map(|i| args.output.join(format!("turn-{i:04}.png"))).collect(),
    };
    if !is_animation {
        context.make_folder(&args.output)?;
    }
    files.iter().try_for_each(|file| context.check_output(file))?;
    let surroundings = args.surroundings.load(None)?;
    options.background = args.surroundings.background()?;
    let surface = scene.surface(args.filter, context)?;
    // An unfinished animation must not stay behind.
    let _deferral = context.defer_interrupt();
    let mut series = Series::of_files(context, &args.output, "picture", Some(u64::from(count)));
    // Pictures that appear only once all of them are known to be sound.
    let mut held = Vec::new();
    let mut animation = None;
    for (i, camera) in (0..).zip(cameras(scene.mesh(), count, aspect(&options))) {
        context.check_interrupt()?;
        let lights = lights(&camera, surroundings.as_ref());
        let picture =
            render(scene.mesh(), surface.as_ref(), &camera, &lights, &options)?.picture.to_srgb_image();
        if is_animation {
            let animation = match &mut animation {
                Some(animation) => animation,
                None => {
                    let rate = f64::from(count) / args.seconds.unwrap_or(DEFAULT_SECONDS);
                    animation.insert(Animation::new(&args.output, &picture, count, rate)?)
                }
            };
            animation.add(&picture)?;
        } else if context.strict {
            held.push((temporary_picture(&files[i], &picture)?, files[i].clone()));
        } else {
            series.write(&files[i], || picture.save(&files[i]))?;
        }
    }
    scene.show_damage(context)?;
    if let Some(animation) = animation {
        animation.finish()?;
    }
    persist_all(held, context.force)?;
    let seconds = started.elapsed().as_secs_f64();
    let (output, pictures) = ((&args.output).into(), files.into_iter().map(ShownPath::from).collect());
    let info = TurntableInfo { output, pictures, frames: count, width, height, seconds };
    context.print(&info, |info| {
        format!(
            "{}: {} of {width} x {height} pixels, {:.1} s",
            info.output.display(),
            counted(info.frames as u64, "picture"),
            info.seconds
        )
    })
}

/// Refuses options that have no meaning here.
fn check(args: &ExportArgs, is_animation: bool) -> Result<()> {
    if args.uv != UvArg::Atlas || args.padding.is_some() {
        return Err(Error::invalid("--uv and --padding have no meaning for a turntable; leave them out"));
    }
    if args.seconds.is_some() && !is_animation {
        return Err(Error::invalid(format!(
            "--seconds is how long an animated .png takes, and {} becomes a folder of pictures; leave it out",
            args.output.display()
        )));
    }
    if known_extension(&args.output).is_some_and(|extension| extension != "png") {
        return Err(Error::invalid(format!(
            "a turntable cannot be written to {}: give the name of a .png, or of a folder for a picture per view",
            args.output.display()
        )));
    }
    Ok(())
}

/// A picture under a temporary name in the folder of its path.
fn temporary_picture(path: &Path, picture: &Image) -> Result<TempPath> {
    let bytes = picture.encoded(path)?;
    let failed = |error| Error::writing(path, error);
    let mut file = temporary_file(path, ".tmp").map_err(failed)?;
    file.write_all(&bytes).map_err(failed)?;
    Ok(file.into_temp_path())
}

/// Cameras on a circle around the middle of the model, all at the distance from which every side is seen whole. The model
/// turns to the right.
fn cameras(mesh: &Mesh, count: u32, aspect: f64) -> Vec<Camera> {
    let target = world_bounds(mesh).center();
    let turned = |i: u32, of: u32| {
        let angle = -std::f64::consts::TAU * f64::from(i) / f64::from(of);
        DQuat::from_rotation_y(angle) * Camera::THREE_QUARTER.normalize()
    };
    let framed = (0..DIRECTIONS).map(|i| Camera::framing_mesh(mesh, turned(i, DIRECTIONS), aspect));
    let farthest = framed.map(|c| (c.eye.distance(target), c.fov_degrees));
    let (distance, fov_degrees) = farthest.fold((0.0, 35.0), |a, b| if b.0 > a.0 { b } else { a });
    let camera =
        |i| Camera { eye: target + turned(i, count) * distance, target, up: glam::DVec3::Y, fov_degrees };
    (0..count).map(camera).collect()
}

/// Seconds of a turn where nothing else is asked for.
const DEFAULT_SECONDS: f64 = 4.0;

/// Directions that the distance is chosen for, whatever the number of pictures.
const DIRECTIONS: u32 = 24;

/// The sun stays behind the camera, so that it is the model that turns; surroundings turn with the model.
fn lights(camera: &Camera, surroundings: Option<&Surroundings>) -> Lights {
    let mut lights = Lights::behind(camera);
    if let Some(surroundings) = surroundings {
        surroundings.shine(&mut lights, false);
    }
    lights
}

/// An animated PNG that is being written, picture by picture, and repeats for ever; programs that know none show its first
/// picture. Whoever holds one holds a deferral of interrupts, too, since dropping it removes the unfinished file.
pub(crate) struct Animation {
    file: NamedTempFile,
    writer: png::Writer<File>,
    target: PathBuf,
}

impl Animation {
    /// Begins a file of `count` pictures of the size of `first`.
    pub(crate) fn new(target: &Path, first: &Image, count: u32, frames_per_second: f64) -> Result<Self> {
        let failed = |error| Error::writing(target, error);
        let file = temporary_file(target, "").map_err(failed)?;
        let copy = file.as_file().try_clone().map_err(failed)?;
        let writer = header(first, count, frames_per_second, copy).map_err(|error| failed(error.into()))?;
        Ok(Self { file, writer, target: target.into() })
    }

    /// Adds a picture: 8 bits, of the first one's size.
    pub(crate) fn add(&mut self, image: &Image) -> Result<()> {
        let Samples::U8(bytes) = &image.samples else { return Ok(()) };
        let failed = |error: png::EncodingError| Error::writing(&self.target, error.into());
        self.writer.write_image_data(bytes).map_err(failed)
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> Result<()> {
        let Self { file, writer, target } = self;
        writer.finish().map_err(|error| Error::writing(&target, error.into()))?;
        persist(file.into_temp_path(), &target, true)
    }
}

fn header(
    first: &Image,
    count: u32,
    frames_per_second: f64,
    file: File,
) -> Result<png::Writer<File>, png::EncodingError> {
    let mut encoder = png::Encoder::new(file, first.width, first.height);
    encoder.set_color(if first.channels == 4 { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_animated(count, 0)?;
    encoder.set_frame_delay(1000, (1000.0 * frames_per_second).round().clamp(1.0, 60_000.0) as u16)?;
    encoder.write_header()
}
