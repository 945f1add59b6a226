//! `fantex render`: a picture of a model or an asset.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use fantex::base::are;
use fantex::base::files::folder_of;
use fantex::gpu::{
    DrawOptions, Frame, Gpu, GpuOptions, Model, StreamedModel, UvModel, render_to_picture, stream_view,
};
use fantex::look::LookFile;
use fantex::look::{LookImages, ResolveOptions};
use fantex::look_scene::{GivenModel, LookScene, MaterialResolver, PictureChanges};
use fantex::render::{Background, Camera, Lights, Picture, RenderOptions, Rendering, render};
use fantex::scene::FilterOptions;
use fantex::texture::Filter;
use fantex::{Error, FileKind, Result, StreamedWorld, World, WorldOptions, WorldScene, frame_world};
use glam::DVec3;
use serde::Serialize;

use crate::context::Context;
use crate::scene::{
    FILTERS, ReadArgs, Scene, SurroundingsArgs, aspect, check_picture_name, direction, is_look, open_shape,
    report_damage, show_notes, size, vector,
};
use crate::series::Series;
use crate::text::{ShownPath, bytes, counted, one_of, whole};

/// Render a model, an asset, a world or a look.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex render bottle.fan -o bottle.png
  fantex render scene.toml -o scene.png
  fantex render chair.glb --look oak.toml -o chair.png
  fantex render cave.glb -o cave.exr --size 1920x1080 --eye 3,2,5 --target 0,1,0 --fov 60 --samples 16
  fantex render car.glb -o car.png --environment forest.exr --environment-rotation 90
  fantex render world.fan -o world.png --gpu --pool 128M
  fantex render land.fanworld -o land.png --eye 0,400,1800 --target 0,0,0

Without --eye and --target the camera shows the whole model from the front, the right and above.")]
pub(crate) struct RenderArgs {
    /// A model (.glb .gltf .obj .ply .stl), an asset (.fan) or a world (.fanworld), both also at an https://, s3://, gs:// or az:// address, or
    /// a look (.toml)
    file: PathBuf,
    /// A look (.toml) for the model: materials, lamps, surroundings, camera
    #[arg(long, value_name = "LOOK")]
    look: Option<PathBuf>,
    /// The picture to write: .png, .jpg, .webp or .tif in sRGB, .exr or .hdr in linear light
    #[arg(short, long, value_name = "PICTURE")]
    pub(crate) output: PathBuf,
    /// Width and height in pixels [default: the look's, or 1280x720]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Where the camera is, world units
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub(crate) eye: Option<DVec3>,
    /// What the camera looks at, world units; the model's centre by default
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub(crate) target: Option<DVec3>,
    /// Vertical opening angle of the camera in degrees [default: 35]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub(crate) fov: Option<f64>,
    /// Samples per pixel, 1 to 64 [default: the look's, or 8]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u32>)]
    pub(crate) samples: Option<u32>,
    /// How textures are filtered [default: the look's, or anisotropic]
    #[arg(long, value_parser = one_of(&FILTERS))]
    pub(crate) filter: Option<Filter>,
    /// Direction to the sun, world axes; over the camera's left shoulder by default, none beside an environment
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction)]
    light: Option<DVec3>,
    #[command(flatten)]
    surroundings: SurroundingsArgs,
    /// Draw on the graphics card (any Vulkan, Metal or DirectX 12 adapter; software too) with 1 or 4 samples
    #[arg(long)]
    gpu: bool,
    /// Graphics memory for an asset's texels [default: 64M]
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true, requires = "gpu", value_parser = bytes)]
    pool: Option<u64>,
}

impl RenderArgs {
    fn pool_bytes(&self) -> u64 {
        self.pool.unwrap_or(64 << 20)
    }
}

#[derive(Debug, Default, Serialize)]
struct RenderInfo {
    output: ShownPath,
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

pub(crate) fn run(args: &RenderArgs, context: &Context) -> Result<()> {
    if let Some(path) = args.look.as_ref().or(is_look(&args.file).then_some(&args.file)) {
        if args.light.is_some() || args.surroundings.is_given() {
            return Err(not_for_looks("--light and --environment", path));
        }
        if args.surroundings.has_background() {
            return Err(not_for_looks("--background", path));
        }
        if args.gpu {
            return Err(not_for_looks("--gpu", path));
        }
        return render_look(args, &LookFile::read(path)?, context);
    }
    let options = options(args)?;
    // Folders and devices are told as such.
    context.check_output(&args.output)?;
    check_picture_name(&args.output, options.background == Background::Transparent)?;
    if FileKind::of(&args.file)? == FileKind::World {
        return render_world(args, &options, context);
    }
    let scene = Scene::open(&args.file, context)?;
    context.check_output(&args.output)?;
    if args.pool.is_some() && scene.asset().is_none() {
        return Err(Error::invalid(format!(
            "--pool is for the texels of an asset, and {} is a model; leave it out",
            args.file.display()
        )));
    }
    let mesh = scene.mesh();
    let camera = camera(args, mesh.world_from_mesh.offset, |fov| {
        Ok(Camera::framing_mesh_with(mesh, Camera::THREE_QUARTER, aspect(&options), DVec3::Y, fov))
    })?;
    let lights = lights(args, &camera)?;
    let filter = args.filter.unwrap_or(Filter::Anisotropic);
    let (picture, info) = if args.gpu {
        let filter = FilterOptions { filter, ..FilterOptions::default() };
        let shot = Shot { camera: &camera, lights: &lights, options: &options, filter };
        let drawn = render_on_gpu(&scene, shot, args.pool_bytes(), context)?;
        drawn.into_parts(scene.mesh().triangles.len() as u64)
    } else {
        let surface = scene.surface(filter, context)?;
        let rendering = render(scene.mesh(), surface.as_ref(), &camera, &lights, &options)?;
        scene.show_damage(context)?;
        of_rendering(rendering)
    };
    finish(args, &picture, info, context)
}

/// Writes the picture and says so.
fn finish(args: &RenderArgs, picture: &Picture, info: RenderInfo, context: &Context) -> Result<()> {
    save(picture, &args.output, context)?;
    let Picture { width, height, .. } = *picture;
    context.print(&RenderInfo { output: (&args.output).into(), width, height, ..info }, text)
}

/// What the options say of the picture.
fn options(args: &RenderArgs) -> Result<RenderOptions> {
    let mut options = RenderOptions::default();
    [options.width, options.height] = args.size.unwrap_or([options.width, options.height]);
    options.samples = args.samples.unwrap_or(if args.gpu { 4 } else { options.samples });
    options.background = args.surroundings.background()?;
    if args.gpu && !matches!(options.samples, 1 | 4) {
        let samples = options.samples;
        return Err(Error::invalid(format!("--samples {samples} is not possible with --gpu: give 1 or 4")));
    }
    Ok(options)
}

/// The sun and the surroundings.
fn lights(args: &RenderArgs, camera: &Camera) -> Result<Lights> {
    let sun = args.light.map(|to_light| to_light.as_vec3());
    let mut lights = sun.map_or_else(|| Lights::behind(camera), Lights::sun);
    if let Some(surroundings) = args.surroundings.load(sun)? {
        surroundings.shine(&mut lights, sun.is_some());
    }
    Ok(lights)
}

fn of_rendering(Rendering { picture, stats }: Rendering) -> (Picture, RenderInfo) {
    let info = RenderInfo {
        seconds: stats.elapsed.as_secs_f64(),
        triangles: stats.triangles,
        shaded: Some(stats.shaded),
        lookups: Some(stats.lookups),
        lookups_per_shading: Some(stats.lookups as f64 / stats.shaded.max(1) as f64),
        ..RenderInfo::default()
    };
    (picture, info)
}

/// Renders a world: what is near whole, what is far by its previews, as memory allows.
fn render_world(args: &RenderArgs, options: &RenderOptions, context: &Context) -> Result<()> {
    let world = World::open(&args.file)?;
    let space = world.space_to_show(&args.file)?;
    context.check_output(&args.output)?;
    let size = [options.width, options.height];
    let camera = camera(args, space.offset, |fov| {
        frame_world(&args.file, &world, Camera::THREE_QUARTER, aspect(options), fov)
    })?;
    if let Some(defect) = camera.defect() {
        return Err(Error::invalid(format!("the camera cannot take a picture: {defect}")));
    }
    let lights = lights(args, &camera)?;
    let filter =
        FilterOptions { filter: args.filter.unwrap_or(Filter::Anisotropic), ..FilterOptions::default() };
    let (picture, info) = if args.gpu {
        draw_world(args, world, Shot { camera: &camera, lights: &lights, options, filter }, context)?
    } else {
        let scene = WorldScene::open(&args.file, &world, &camera, size, context.memory_bytes)?;
        let rendering = render(scene.mesh(), &scene.surface(filter), &camera, &lights, options)?;
        scene.damage().try_for_each(|damage| report_damage(&args.file, &damage, context))?;
        note_coarse(scene.coarse(), context);
        of_rendering(rendering)
    };
    finish(args, &picture, info, context)
}

fn note_coarse(objects: usize, context: &Context) {
    if objects > 0 {
        context.note(format!(
            "{} {} coarser than the picture could show; give it more memory by --memory",
            counted(objects as u64, "object"),
            are(objects)
        ));
    }
}

/// Draws a world on the graphics card, once all is there that the view needs.
fn draw_world(
    args: &RenderArgs,
    world: World,
    shot: Shot<'_>,
    context: &Context,
) -> Result<(Picture, RenderInfo)> {
    let gpu = Arc::new(Gpu::headless(&GpuOptions::default())?);
    let settings = WorldOptions {
        pool_bytes: args.pool_bytes(),
        geometry_bytes: context.memory_bytes / 2,
        filter: shot.filter,
    };
    let mut streamed = StreamedWorld::new(&args.file, Arc::new(world), settings)?;
    if !streamed.wait_until_settled(&gpu, shot.camera, shot.size(), MAX_WAIT)? {
        note_missing(context);
    }
    // The sentence names the file.
    if let Some((_, error)) = streamed.statistics().failed.first() {
        return Err(Error::not_found(error.clone()));
    }
    let triangles = streamed.statistics().triangles;
    let drawn = draw(&gpu, &mut streamed, shot)?;
    Ok(drawn.into_parts(triangles))
}

fn not_for_looks(option: &str, path: &Path) -> Error {
    let path = path.display();
    Error::invalid(format!(
        "{path} is a look, which has its lamps and surroundings itself; leave {option} out"
    ))
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

/// The camera that was asked for; what was not is taken from the view that shows the whole model, by its opening angle.
fn camera(args: &RenderArgs, center: DVec3, framed: impl FnOnce(f64) -> Result<Camera>) -> Result<Camera> {
    let fov_degrees = args.fov.unwrap_or(Camera::FRAMING_FOV_DEGREES);
    let (target, up) = (args.target.unwrap_or(center), DVec3::Y);
    Ok(match (args.eye, args.target) {
        (Some(eye), _) => Camera { eye, target, up, fov_degrees },
        (None, Some(_)) => Camera { target, up, ..framed(fov_degrees)? },
        (None, None) => framed(fov_degrees)?,
    })
}

/// Writes a picture: in linear light where the format holds it, else in sRGB.
pub(crate) fn save(picture: &Picture, path: &Path, context: &Context) -> Result<()> {
    let _deferral = context.defer_interrupt();
    let holds_light =
        path.extension().is_some_and(|e| ["exr", "hdr"].iter().any(|name| e.eq_ignore_ascii_case(name)));
    let image = if holds_light { picture.to_linear_image() } else { picture.to_srgb_image() };
    image.save(path)?;
    Ok(())
}

/// How long tiles are waited for.
const MAX_WAIT: Duration = Duration::from_secs(600);

fn note_missing(context: &Context) {
    context.note(format!("tiles were still missing after {} s", MAX_WAIT.as_secs()));
}

/// A picture that is drawn on the graphics card.
#[derive(Clone, Copy)]
struct Shot<'a> {
    camera: &'a Camera,
    lights: &'a Lights,
    options: &'a RenderOptions,
    filter: FilterOptions,
}

impl Shot<'_> {
    fn size(&self) -> [u32; 2] {
        [self.options.width, self.options.height]
    }
}

/// What was drawn, and on what.
struct GpuRendering {
    picture: Picture,
    adapter: String,
    /// Drawing and reading back, without loading.
    elapsed: Duration,
}

impl GpuRendering {
    fn into_parts(self, triangles: u64) -> (Picture, RenderInfo) {
        let (seconds, adapter) = (self.elapsed.as_secs_f64(), Some(self.adapter));
        (self.picture, RenderInfo { seconds, triangles, adapter, ..RenderInfo::default() })
    }
}

/// Draws a model that has all that it needs.
fn draw(gpu: &Gpu, model: &mut dyn Model, shot: Shot<'_>) -> Result<GpuRendering> {
    let Shot { camera, lights, options, filter } = shot;
    let settings = DrawOptions {
        shading: options.shading,
        filter,
        background: options.background,
        exposure: options.exposure,
        // Whoever saves the picture brings it into its range.
        tone_map: None,
        samples: options.samples,
        ..DrawOptions::default()
    };
    let started = Instant::now();
    let size = shot.size();
    let picture = render_to_picture(gpu, &mut Frame { size, camera, lights, model, options: &settings })?;
    Ok(GpuRendering { picture, adapter: gpu.info().name.clone(), elapsed: started.elapsed() })
}

/// Draws a model with its own textures, or an asset through an atlas of at most `pool_bytes`.
fn render_on_gpu(scene: &Scene, shot: Shot<'_>, pool_bytes: u64, context: &Context) -> Result<GpuRendering> {
    let gpu = Gpu::headless(&GpuOptions::default())?;
    let Some(asset) = scene.asset() else {
        let mut model = UvModel::load(&gpu, scene.mesh())?;
        context.report_left_out(scene.path(), model.left_out())?;
        return draw(&gpu, &mut model, shot);
    };
    let mut streamed = StreamedModel::open(&gpu, asset.clone(), pool_bytes)?;
    let view = stream_view(shot.camera, shot.size(), streamed.model.space());
    let is_sharp = streamed.wait_until_sharp(&gpu, &view, &shot.filter, MAX_WAIT)?;
    let figures = streamed.streamer.statistics();
    if figures.bias_levels > 0.0 {
        context.note(format!(
            "the view does not fit into the pool: tiles are up to {:.1} levels coarser than they should be; give it more \
             memory by --pool",
            figures.bias_levels
        ));
    } else if !is_sharp {
        note_missing(context);
    }
    for (parcel, error) in streamed.streamer.damaged().take(4) {
        context
            .report_damage(format!("{parcel} cannot be read, a coarser level takes its place: {error}"))?;
    }
    draw(&gpu, &mut streamed.model, shot)
}

#[derive(Debug, Default, Serialize)]
struct LookRenderInfo {
    output: ShownPath,
    /// All pictures that were written.
    pictures: Vec<ShownPath>,
    width: u32,
    height: u32,
    seconds: f64,
    triangles: u64,
    shaded: u64,
    lookups: u64,
}

/// Renders a look, on a model where one is given.
fn render_look(args: &RenderArgs, file: &LookFile, context: &Context) -> Result<()> {
    // With --look the file is the model.
    let given = args.look.as_ref().map(|_| given_model(&args.file, context)).transpose()?;
    let images = LookImages::default();
    let options = ResolveOptions { filter: args.filter, ..context.resolve_options() };
    let resolver = MaterialResolver { file, images: &images, options };
    let changes = PictureChanges {
        size: args.size,
        samples: args.samples,
        filter: args.filter,
        eye: args.eye,
        target: args.target,
        fov_degrees: args.fov,
        background: None,
    };
    let scene = LookScene::new(resolver, given.as_ref(), changes)?;
    if context.strict {
        scene.left_out().check()?;
    }
    scene.notes().into_iter().for_each(|note| context.note(note));
    let times = scene.times();
    let pictures = names(&args.output, times.len());
    pictures.iter().try_for_each(|path| context.check_output(path))?;
    let is_transparent = file.look().picture.background.is_some_and(|color| color.0.w == 0.0);
    check_picture_name(&args.output, is_transparent)?;
    let count = Some(pictures.len() as u64);
    let mut series = Series::of_files(context, folder_of(&args.output), "picture", count);
    let mut info = LookRenderInfo { output: (&args.output).into(), ..LookRenderInfo::default() };
    for (time, path) in times.into_iter().zip(pictures) {
        let Rendering { picture, stats } = scene.render(time)?;
        if context.strict {
            show_damaged_tiles(&scene, context)?;
        }
        series.write(&path, || save(&picture, &path, context))?;
        (info.width, info.height) = (picture.width, picture.height);
        info.seconds += stats.elapsed.as_secs_f64();
        info.triangles = stats.triangles;
        info.shaded += stats.shaded;
        info.lookups += stats.lookups;
        info.pictures.push(path.into());
        context.check_interrupt()?;
    }
    show_damaged_tiles(&scene, context)?;
    context.print(&info, look_text)
}

/// Notes damaged tiles that rendering has met.
pub(crate) fn show_damaged_tiles(scene: &LookScene, context: &Context) -> Result<()> {
    match scene.damaged_tiles() {
        0 => Ok(()),
        count => {
            context.report_damage(format!("coarser texels stand in for {}", counted(count, "damaged tile")))
        }
    }
}

fn given_model(path: &Path, context: &Context) -> Result<GivenModel> {
    let model = open_shape(path, ReadArgs::default(), context)?;
    show_notes(&model, context);
    Ok(GivenModel { path: path.into(), mesh: model.into_inner() })
}

/// `picture.png` for one picture, `picture-0001.png` and so on for several.
fn names(output: &Path, count: usize) -> Vec<PathBuf> {
    if count == 1 {
        return vec![output.into()];
    }
    let name = |number: usize| {
        let mut name = output.file_stem().unwrap_or_default().to_owned();
        name.push(format!("-{number:04}"));
        if let Some(extension) = output.extension() {
            name.push(".");
            name.push(extension);
        }
        output.with_file_name(name)
    };
    (1..=count).map(name).collect()
}

fn look_text(info: &LookRenderInfo) -> String {
    let what = match info.pictures.as_slice() {
        [only] => only.display().to_string(),
        [first, .., last] => format!("{} to {}", first.display(), last.display()),
        [] => String::new(),
    };
    format!(
        "{what}: {} x {} pixels, {}, {}, {:.2} s",
        info.width,
        info.height,
        counted(info.triangles, "triangle"),
        counted(info.lookups, "look-up"),
        info.seconds
    )
}
