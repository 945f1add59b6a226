//! `fantex render`: a picture of a model or an asset.

use std::path::PathBuf;

use clap::Args;
use fantex::render::{AmbientLight, Camera, Lights, Picture, RenderOptions, render};
use glam::DVec3;
use serde::Serialize;

use crate::context::Context;
use crate::error::CliError;
use crate::surroundings::SurroundingsArgs;
use crate::scene::{FilterArg, Scene, SizeArg, VectorArg, portrait};
use crate::size::grouped;

/// Render a model or an asset.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex render bottle.fan -o bottle.png
  fantex render cave.glb -o cave.exr --size 1920x1080 --eye 3,2,5 --target 0,1,0 --fov 60 --samples 16
  fantex render car.glb -o car.png --environment forest.exr --environment-rotation 90

Without --eye and --target the camera shows the whole model from the front, the right and above.")]
pub(crate) struct RenderArgs {
    /// A model (.glb .gltf .obj .ply .stl) or an asset (.fan)
    file: PathBuf,
    /// The picture to write: .png, .jpg, .webp or .tif in sRGB, .exr or .hdr in linear light
    #[arg(short, long, value_name = "PICTURE")]
    output: PathBuf,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: SizeArg,
    /// Where the camera is, world units
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    eye: Option<VectorArg>,
    /// What the camera looks at, world units; the model's centre by default
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    target: Option<VectorArg>,
    /// Vertical opening angle of the camera in degrees [default: 35]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    fov: Option<f64>,
    /// Samples per pixel, 1 to 64
    #[arg(long, value_name = "N", default_value_t = 8)]
    samples: u32,
    /// How textures are filtered
    #[arg(long, value_enum, default_value_t)]
    filter: FilterArg,
    /// Direction to the sun, world axes; over the camera's left shoulder by default, none beside an environment
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    light: Option<VectorArg>,
    #[command(flatten)]
    surroundings: SurroundingsArgs,
}

#[derive(Debug, Serialize)]
struct RenderInfo {
    output: PathBuf,
    width: u32,
    height: u32,
    seconds: f64,
    triangles: u64,
    shaded: u64,
    lookups: u64,
    /// Filtered look-ups, of all channels, per shaded point.
    lookups_per_shading: f64,
}

/// Runs the command.
pub(crate) fn run(args: &RenderArgs, context: &Context) -> Result<(), CliError> {
    let scene = Scene::open(&args.file, context)?;
    context.check_output(&args.output)?;
    let [width, height] = args.size.0;
    let mut options = RenderOptions { width, height, samples: args.samples, ..RenderOptions::default() };
    let camera = camera(args, &scene, &options);
    let sun = args.light.map(|VectorArg(to_light)| to_light.as_vec3());
    let mut lights = sun.map_or_else(|| Lights::behind(&camera), Lights::sun);
    if let Some(surroundings) = args.surroundings.load(sun)? {
        options.background = surroundings.background();
        lights.ambient = AmbientLight::environment(surroundings.light);
        lights.directional.retain_mut(|lamp| match surroundings.sun {
            Some(color) => {
                lamp.color = color;
                true
            }
            None => sun.is_some(),
        });
    }
    let surface = scene.surface(args.filter.options())?;
    let rendering = render(scene.mesh(), surface.as_ref(), &camera, &lights, &options)?;
    scene.show_damage(context);
    save(&rendering.picture, &args.output, context)?;
    let stats = rendering.stats;
    let info = RenderInfo {
        output: args.output.clone(),
        width,
        height,
        seconds: stats.elapsed.as_secs_f64(),
        triangles: stats.triangles,
        shaded: stats.shaded,
        lookups: stats.lookups,
        lookups_per_shading: stats.lookups as f64 / stats.shaded.max(1) as f64,
    };
    context.print(&info, |info| {
        format!(
            "{}: {width} x {height} pixels, {} triangles, {} look-ups, {:.2} s",
            info.output.display(),
            grouped(info.triangles),
            grouped(info.lookups),
            info.seconds
        )
    })
}

/// The camera that was asked for; what was not is taken from the view that shows the whole model.
fn camera(args: &RenderArgs, scene: &Scene, options: &RenderOptions) -> Camera {
    let framed = portrait(scene.mesh(), options);
    let center = scene.mesh().world_from_mesh.offset;
    let target = args.target.map_or(center, |v| v.0);
    let fov_degrees = args.fov.unwrap_or(framed.fov_degrees);
    match (args.eye, args.target) {
        (Some(VectorArg(eye)), _) => Camera { eye, target, up: DVec3::Y, fov_degrees },
        (None, Some(_)) => Camera { target, up: DVec3::Y, fov_degrees, ..framed },
        (None, None) => Camera { fov_degrees, ..framed },
    }
}

/// Writes a picture: in linear light where the format holds it, else in sRGB.
pub(crate) fn save(picture: &Picture, path: &std::path::Path, context: &Context) -> Result<(), CliError> {
    let _deferral = context.defer_interrupt();
    let holds_light =
        path.extension().is_some_and(|e| ["exr", "hdr"].iter().any(|name| e.eq_ignore_ascii_case(name)));
    let image = if holds_light { picture.to_linear_image() } else { picture.to_srgb_image() };
    image.save(path)?;
    Ok(())
}
