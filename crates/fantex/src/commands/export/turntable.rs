//! Pictures around the model.

use std::path::PathBuf;
use std::time::Instant;

use fantex::mesh::Mesh;
use fantex::render::{AmbientLight, Camera, Lights, RenderOptions, render};
use fantex::scene::Bounds;
use glam::DQuat;
use serde::Serialize;

use super::{ExportArgs, PictureSizeArg, UvArg, has_extension};
use crate::animation::Animation;
use crate::context::Context;
use crate::error::CliError;
use crate::scene::{Scene, aspect};
use crate::size::counted;
use crate::surroundings::Surroundings;

#[derive(Debug, Serialize)]
struct TurntableInfo {
    output: PathBuf,
    pictures: Vec<PathBuf>,
    frames: u32,
    width: u32,
    height: u32,
    seconds: f64,
}

/// Renders `count` pictures: an animation where the output is a PNG, numbered files in a folder else.
pub(super) fn run(args: &ExportArgs, count: u32, context: &Context) -> Result<(), CliError> {
    if args.uv != UvArg::Atlas || args.padding.is_some() {
        return Err(CliError::NoTurntableOption { option: "--uv and --padding" });
    }
    let started = Instant::now();
    let scene = Scene::open(&args.asset, context)?;
    let [width, height] = match args.size {
        None => [800, 600],
        Some(PictureSizeArg::Side(side)) => [side, side],
        Some(PictureSizeArg::WidthHeight(size)) => size.0,
    };
    let mut options = RenderOptions { width, height, samples: args.samples, ..RenderOptions::default() };
    let is_animation = has_extension(&args.output, "png");
    let files: Vec<PathBuf> = match is_animation {
        true => vec![args.output.clone()],
        false => (1..=count).map(|i| args.output.join(format!("turn-{i:04}.png"))).collect(),
    };
    if !is_animation {
        context.make_folder(&args.output)?;
    }
    files.iter().try_for_each(|file| context.check_output(file))?;
    let surroundings = args.surroundings.load(None)?;
    if let Some(surroundings) = &surroundings {
        options.background = surroundings.background();
    }
    let surface = scene.surface(args.filter.options())?;
    // An unfinished animation must not stay behind.
    let _deferral = context.defer_interrupt();
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
                    let rate = f64::from(count) / args.seconds;
                    animation.insert(Animation::new(&args.output, &picture, count, rate)?)
                }
            };
            animation.add(&picture)?;
        } else {
            picture.save(&files[i])?;
        }
    }
    if let Some(animation) = animation {
        animation.finish()?;
    }
    scene.show_damage(context);
    let seconds = started.elapsed().as_secs_f64();
    let output = args.output.clone();
    let info = TurntableInfo { output, pictures: files, frames: count, width, height, seconds };
    context.print(&info, |info| {
        format!(
            "{}: {} of {width} x {height} pixels, {:.1} s",
            info.output.display(),
            counted(info.frames as u64, "picture"),
            info.seconds
        )
    })
}

/// Cameras on a circle around the middle of the model, all at the distance from which every side is seen whole. The model
/// turns to the right.
fn cameras(mesh: &Mesh, count: u32, aspect: f64) -> Vec<Camera> {
    let target = Bounds::of_mesh(mesh).center();
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

/// Directions that the distance is chosen for, whatever the number of pictures.
const DIRECTIONS: u32 = 24;

/// The sun stays behind the camera, so that it is the model that turns; surroundings turn with the model.
fn lights(camera: &Camera, surroundings: Option<&Surroundings>) -> Lights {
    let mut lights = Lights::behind(camera);
    if let Some(surroundings) = surroundings {
        lights.ambient = AmbientLight::environment(surroundings.light.clone());
        lights.lamps.retain_mut(|lamp| {
            surroundings.sun.is_some_and(|color| {
                lamp.color = color;
                true
            })
        });
    }
    lights
}
