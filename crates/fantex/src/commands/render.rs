//! `fantex render`: a picture of a model or an asset.

use std::path::PathBuf;

use clap::Args;
use fantex::look::LookFile;
use fantex::render::{AmbientLight, Camera, Lights, Picture, RenderOptions, Rendering, render};
use glam::DVec3;
use serde::Serialize;

use crate::commands::{render_gpu, render_look};
use crate::context::Context;
use crate::error::CliError;
use crate::input::is_look;
use crate::scene::{FilterArg, Scene, SizeArg, VectorArg, portrait};
use crate::size::{Bytes, counted};
use crate::surroundings::SurroundingsArgs;

/// Render a model, an asset or a look.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex render bottle.fan -o bottle.png
  fantex render scene.toml -o scene.png
  fantex render chair.glb --look oak.toml -o chair.png
  fantex render cave.glb -o cave.exr --size 1920x1080 --eye 3,2,5 --target 0,1,0 --fov 60 --samples 16
  fantex render car.glb -o car.png --environment forest.exr --environment-rotation 90
  fantex render world.fan -o world.png --gpu --pool 128M

Without --eye and --target the camera shows the whole model from the front, the right and above.")]
pub(crate) struct RenderArgs {
    /// A model (.glb .gltf .obj .ply .stl), an asset (.fan) or a look (.toml)
    file: PathBuf,
    /// A look (.toml) for the model: materials, lamps, surroundings, camera
    #[arg(long, value_name = "LOOK")]
    look: Option<PathBuf>,
    /// The picture to write: .png, .jpg, .webp or .tif in sRGB, .exr or .hdr in linear light
    #[arg(short, long, value_name = "PICTURE")]
    pub(crate) output: PathBuf,
    /// Width and height in pixels [default: the look's, or 1280x720]
    #[arg(long, value_name = "WxH")]
    pub(crate) size: Option<SizeArg>,
    /// Where the camera is, world units
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub(crate) eye: Option<VectorArg>,
    /// What the camera looks at, world units; the model's centre by default
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub(crate) target: Option<VectorArg>,
    /// Vertical opening angle of the camera in degrees [default: 35]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub(crate) fov: Option<f64>,
    /// Samples per pixel, 1 to 64 [default: the look's, or 8]
    #[arg(long, value_name = "N")]
    pub(crate) samples: Option<u32>,
    /// How textures are filtered [default: the look's, or anisotropic]
    #[arg(long, value_enum)]
    pub(crate) filter: Option<FilterArg>,
    /// Direction to the sun, world axes; over the camera's left shoulder by default, none beside an environment
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    light: Option<VectorArg>,
    #[command(flatten)]
    surroundings: SurroundingsArgs,
    /// Draw on the graphics card (any Vulkan, Metal or DirectX 12 adapter; software too) with 1 or 4 samples
    #[arg(long)]
    gpu: bool,
    /// Graphics memory for an asset's texels
    #[arg(long, value_name = "SIZE", default_value = "64M", requires = "gpu")]
    pool: Bytes,
}

#[derive(Debug, Serialize)]
struct RenderInfo {
    output: PathBuf,
    width: u32,
    height: u32,
    seconds: f64,
    triangles: u64,
    /// Points at which materials were evaluated; unknown on the graphics card.
    shaded: Option<u64>,
    /// Filtered look-ups of all channels; unknown on the graphics card.
    lookups: Option<u64>,
    lookups_per_shading: Option<f64>,
    /// The graphics card, if one was used.
    adapter: Option<String>,
}

/// Runs the command.
pub(crate) fn run(args: &RenderArgs, context: &Context) -> Result<(), CliError> {
    if (args.look.is_some() || is_look(&args.file)) && (args.light.is_some() || args.surroundings.is_given())
    {
        let path = args.look.clone().unwrap_or_else(|| args.file.clone());
        return Err(CliError::NotForLooks { option: "--light and --environment", path });
    }
    if (args.look.is_some() || is_look(&args.file)) && args.gpu {
        let path = args.look.clone().unwrap_or_else(|| args.file.clone());
        return Err(CliError::NotForLooks { option: "--gpu", path });
    }
    if let Some(path) = &args.look {
        return render_look::run(args, &LookFile::read(path)?, Some(&args.file), context);
    }
    if is_look(&args.file) {
        return render_look::run(args, &LookFile::read(&args.file)?, None, context);
    }
    let scene = Scene::open(&args.file, context)?;
    context.check_output(&args.output)?;
    let mut options = RenderOptions::default();
    [options.width, options.height] = args.size.map_or([options.width, options.height], |size| size.0);
    options.samples = args.samples.unwrap_or(options.samples);
    let [width, height] = [options.width, options.height];
    let camera = camera(args, &scene, &options);
    let sun = args.light.map(|VectorArg(to_light)| to_light.as_vec3());
    let mut lights = sun.map_or_else(|| Lights::behind(&camera), Lights::sun);
    if let Some(surroundings) = args.surroundings.load(sun)? {
        options.background = surroundings.background();
        lights.ambient = AmbientLight::environment(surroundings.light);
        lights.lamps.retain_mut(|lamp| match surroundings.sun {
            Some(color) => {
                lamp.color = color;
                true
            }
            None => sun.is_some(),
        });
    }
    let filter = args.filter.unwrap_or_default().options();
    let mut info = RenderInfo {
        output: args.output.clone(),
        width,
        height,
        seconds: 0.0,
        triangles: scene.mesh().triangles.len() as u64,
        shaded: None,
        lookups: None,
        lookups_per_shading: None,
        adapter: None,
    };
    let picture = if args.gpu {
        options.samples = args.samples.unwrap_or(4);
        let drawn = render_gpu::render(&scene, &camera, &lights, &options, filter, args.pool.0, context)?;
        info.seconds = drawn.elapsed.as_secs_f64();
        info.adapter = Some(drawn.adapter);
        drawn.picture
    } else {
        let surface = scene.surface(filter)?;
        let Rendering { picture, stats } =
            render(scene.mesh(), surface.as_ref(), &camera, &lights, &options)?;
        scene.show_damage(context);
        info.seconds = stats.elapsed.as_secs_f64();
        info.triangles = stats.triangles;
        info.shaded = Some(stats.shaded);
        info.lookups = Some(stats.lookups);
        info.lookups_per_shading = Some(stats.lookups as f64 / stats.shaded.max(1) as f64);
        picture
    };
    save(&picture, &args.output, context)?;
    context.print(&info, text)
}

fn text(info: &RenderInfo) -> String {
    let RenderInfo { output, width, height, seconds, .. } = info;
    let triangles = counted(info.triangles, "triangle");
    let how = match (&info.lookups, &info.adapter) {
        (Some(lookups), _) => counted(*lookups, "look-up"),
        (None, Some(adapter)) => format!("on {adapter}"),
        (None, None) => String::new(),
    };
    format!("{}: {width} x {height} pixels, {triangles}, {how}, {seconds:.2} s", output.display())
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
