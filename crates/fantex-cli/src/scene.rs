//! Opening models, assets and looks, and rendering them.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use fantex::addresses::check_can_change;
use fantex::bake::{Source, TexelPoint};
use fantex::look::LookFile;
use fantex::mesh::{CleanOptions, Mesh, shading_normals, written_format};
use fantex::render::{
    Background, Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Lights, LookSurface,
    RenderOptions, Rendering, Surface, render,
};
use fantex::store::{Asset, Damage, PageCache};
use fantex::texture::{Filter, Image};
use fantex::{Error, FileKind, Result, Surroundings, World, damage_note};
use glam::{DVec3, Vec3, Vec4};

use crate::context::Context;
use crate::text::{Choices, positive, share, within};

#[derive(Debug)]
pub(crate) struct Scene {
    path: PathBuf,
    content: Content,
}

#[derive(Debug)]
enum Content {
    Model(Box<fantex::Mesh>),
    Asset(PageCache),
}

impl Scene {
    /// Opens a file. An asset's decoded tiles stay within the common memory budget.
    pub(crate) fn open(path: &Path, context: &Context) -> Result<Self> {
        let content = match Input::open(path, ReadArgs::default(), context)? {
            Input::Model(model) => {
                show_notes(&model, context);
                Content::Model(model)
            }
            Input::Look(_) => return Err(FileKind::look_instead(path)),
            Input::World(_) => return Err(FileKind::world_instead(path)),
            Input::Asset(asset) => Content::Asset(PageCache::new(asset, context.memory_bytes as usize)),
        };
        Ok(Self { path: path.into(), content })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn mesh(&self) -> &Mesh {
        match &self.content {
            Content::Model(model) => model,
            Content::Asset(cache) => cache.asset().mesh(),
        }
    }

    /// Whether it is a model without textures and colours, which is drawn grey.
    pub(crate) fn is_grey(&self) -> bool {
        matches!(&self.content, Content::Model(model) if !model.has_materials() && !model.has_vertex_colors())
    }

    pub(crate) fn asset(&self) -> Option<&Arc<Asset>> {
        match &self.content {
            Content::Model(_) => None,
            Content::Asset(cache) => Some(cache.asset()),
        }
    }

    /// What it looks like. Images of a model that cannot be read are noted.
    pub(crate) fn surface(&self, filter: Filter, context: &Context) -> Result<Box<dyn Surface + '_>> {
        let filter = FilterOptions { filter, ..FilterOptions::default() };
        Ok(match &self.content {
            Content::Model(model) => {
                let surface = LookSurface::of_model(model, filter)?;
                context.report_left_out(&self.path, &surface.left_out())?;
                Box::new(surface)
            }
            Content::Asset(cache) => FanSurface::boxed(cache, filter),
        })
    }

    /// Notes damaged tiles that rendering has met.
    pub(crate) fn show_damage(&self, context: &Context) -> Result<()> {
        let Content::Asset(cache) = &self.content else { return Ok(()) };
        report_damage(&self.path, &cache.damage(), context)
    }
}

/// Notes damaged tiles, if there are any.
pub(crate) fn report_damage(path: &Path, damage: &Damage, context: &Context) -> Result<()> {
    damage_note(path, damage).map_or(Ok(()), |note| context.report_damage(note))
}

/// The filters of `--filter`.
pub(crate) const FILTERS: Choices<Filter, 7> = [
    ("nearest", "The nearest texel", Filter::Nearest),
    ("bilinear", "Four texels, no anti-aliasing", Filter::Bilinear),
    ("bicubic", "Sixteen texels, no anti-aliasing", Filter::Bicubic),
    ("bicubic-mipmaps", "Sixteen texels of each of two detail levels", Filter::BicubicMipmaps),
    ("trilinear", "Two detail levels", Filter::Trilinear),
    ("anisotropic", "Several trilinear probes along the footprint", Filter::Anisotropic),
    ("ewa", "Elliptical weighted average, the reference", Filter::Ewa),
];

/// A surface that asks a bake source itself: the truth that a baked asset is compared with. Base colour only.
pub(crate) fn source_surface<'a>(
    mesh: &'a Mesh,
    source: &'a dyn Source,
) -> FlatSurface<'a, impl Fn(&fantex::render::Hit) -> Vec3 + Sync + 'a> {
    let normals = shading_normals(mesh);
    let channels = source.channels().len();
    FlatSurface::new(mesh, FlatShading::Smooth, move |hit| {
        let (position, position_steps) = hit.interpolate(mesh.triangle_positions(hit.triangle()));
        let corner_normals = [0, 1, 2].map(|k| normals[3 * hit.triangle() + k]);
        let point = TexelPoint {
            at: hit.at,
            lambda_steps: hit.lambda_steps,
            position,
            position_steps,
            normal: hit.at.interpolate(corner_normals).normalize_or(Vec3::Z),
        };
        let mut values = vec![Vec4::ZERO; channels];
        source.evaluate(&point, &mut values);
        values[0].truncate()
    })
}

/// Renders with the sun behind the camera.
pub(crate) fn photograph(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    options: &RenderOptions,
) -> Result<Rendering> {
    render(mesh, surface, camera, &Lights::behind(camera), options)
}

/// The three-quarter view that shows a whole mesh.
pub(crate) fn portrait(mesh: &Mesh, options: &RenderOptions) -> Camera {
    Camera::framing_mesh(mesh, Camera::THREE_QUARTER, aspect(options))
}

/// Width by height.
pub(crate) fn aspect(options: &RenderOptions) -> f64 {
    f64::from(options.width) / f64::from(options.height)
}

/// Parses a point or direction: `X,Y,Z`.
pub(crate) fn vector(text: &str) -> Result<DVec3> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|n| n.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => Err(Error::invalid("expected three numbers with commas between them, such as 1,0.5,-2")),
    }
}

/// Parses a direction: `X,Y,Z`, not all zero in single precision.
pub(crate) fn direction(text: &str) -> Result<DVec3> {
    let direction = vector(text)?;
    match direction.as_vec3() {
        single if single.is_finite() && single != Vec3::ZERO => Ok(direction),
        _ => Err(Error::invalid(
            "expected a direction, such as 1,2,0.5; numbers this small or large give none",
        )),
    }
}

/// Parses a picture's size: `1280x720`.
pub(crate) fn size(text: &str) -> Result<[u32; 2]> {
    let side = |s: &str| s.parse().ok().filter(|&n: &u32| n > 0);
    let sides = text.split_once(['x', 'X']).and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| Error::invalid("expected width x height in pixels, such as 1280x720"))
}

/// How models are read.
#[derive(Args, Clone, Copy, Debug, Default)]
pub(crate) struct ReadArgs {
    /// Join vertices of models that lie up to this far apart, world units [default: those at the same place]
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true, value_parser = positive)]
    pub(crate) weld: Option<f64>,
}

#[derive(Debug)]
pub(crate) enum Input {
    Model(Box<fantex::Mesh>),
    Asset(Arc<Asset>),
    Look(Box<LookFile>),
    World(World),
}

impl Input {
    pub(crate) fn open(path: &Path, read: ReadArgs, context: &Context) -> Result<Self> {
        Ok(match FileKind::of(path)? {
            FileKind::Look => Self::Look(Box::new(LookFile::read(path)?)),
            FileKind::World => Self::World(World::open(path)?),
            FileKind::Asset => Self::Asset(Arc::clone(fantex::Asset::open(path)?.shared())),
            FileKind::Model => {
                let (clean, reading) = (CleanOptions::welding(read.weld), context.reading());
                Self::Model(Box::new(fantex::Mesh::load_watched(path, &clean, &reading)?))
            }
        })
    }
}

/// Loads and cleans a model; an asset is refused.
pub(crate) fn open_model(path: &Path, context: &Context) -> Result<fantex::Mesh> {
    match FileKind::of(path)? {
        FileKind::Model => fantex::Mesh::load_watched(path, &CleanOptions::default(), &context.reading()),
        FileKind::Look => Err(FileKind::look_instead(path)),
        FileKind::World => Err(FileKind::world_instead(path)),
        FileKind::Asset => Err(fantex::Asset::open(path).err().unwrap_or_else(|| Error::unsupported(format!(
            "{} is an asset, already baked; give the model (.glb .gltf .obj .ply .stl) that it was baked from",
            path.display()
        )))),
    }
}

/// Loads and cleans a model, or takes the mesh of an asset.
pub(crate) fn open_shape(path: &Path, read: ReadArgs, context: &Context) -> Result<fantex::Mesh> {
    match FileKind::of(path)? {
        FileKind::Look => Err(FileKind::look_instead(path)),
        FileKind::Asset | FileKind::Model | FileKind::World => {
            fantex::Mesh::open_watched(path, &CleanOptions::welding(read.weld), &context.reading())
        }
    }
}

/// Notes what loading and cleaning have found.
pub(crate) fn show_notes(mesh: &fantex::Mesh, context: &Context) {
    mesh.notes().iter().for_each(|note| context.note(format!("{}: {note}", mesh.path().display())));
}

/// Opens an asset; a model is refused.
pub(crate) fn open_asset(path: &Path) -> Result<Arc<Asset>> {
    FileKind::check_is_asset(path)?;
    Ok(Arc::clone(fantex::Asset::open(path)?.shared()))
}

/// Refuses what is no asset that can be changed: in a file, or an object in a store.
pub(crate) fn check_is_asset_file(path: &Path) -> Result<()> {
    check_can_change(path)?;
    FileKind::check_is_asset(path)
}

/// Refuses the name of a picture that says no format, or one that does not hold what is transparent: a fault of the command line, known
/// before any work is done.
pub(crate) fn check_picture_name(path: &Path, has_alpha: bool) -> Result<()> {
    let texels = [[0.0, 0.0, 0.0, 1.0]];
    let pixel = match has_alpha {
        true => Image::from_linear_rgba(1, 1, &texels),
        false => Image::from_linear_rgb(1, 1, &texels),
    };
    pixel.encoded(path).map(drop).map_err(|error| Error::invalid(error.to_string()))
}

/// Refuses the name of a model that says no format which is written.
pub(crate) fn check_model_name(path: &Path) -> Result<()> {
    written_format(path).map(drop).map_err(|error| Error::invalid(error.to_string()))
}

/// The extension of a picture or a model.
pub(crate) fn known_extension(path: &Path) -> Option<&'static str> {
    const KNOWN: [&str; 23] = [
        "png", "jpg", "jpeg", "tif", "tiff", "webp", "hdr", "exr", "ktx2", "gif", "bmp", "tga", "glb",
        "gltf", "obj", "ply", "stl", "fbx", "usd", "usda", "usdc", "usdz", "mtl",
    ];
    let extension = path.extension()?;
    KNOWN.into_iter().find(|known| extension.eq_ignore_ascii_case(known))
}

/// Refuses the name of an asset that ends in something else than `.fan`. `others`: what may be written there instead.
pub(crate) fn check_asset_name(path: &Path, others: &str) -> Result<()> {
    check_extension(path, "an asset", "fan", others)
}

/// Refuses the name of `what` that ends in something else than an extension; names without any are allowed. `others`: what may be written
/// there instead.
pub(crate) fn check_extension(path: &Path, what: &str, expected: &str, others: &str) -> Result<()> {
    match path.extension().filter(|extension| !extension.eq_ignore_ascii_case(expected)) {
        None => Ok(()),
        Some(extension) => {
            let advice = format!("that ends in .{expected}{others}");
            Err(named_otherwise(path, what, extension.display(), &advice))
        }
    }
}

fn named_otherwise(path: &Path, what: &str, extension: impl Display, advice: &str) -> Error {
    let path = path.display();
    Error::invalid(format!(
        "{path} would be {what}, and .{extension} is the name of something else; give a name {advice}"
    ))
}

/// Refuses the name of a picture or a model for `what`, whose names have no extension of their own but usually `usual`.
pub(crate) fn check_is_no_model_name(path: &Path, what: &str, usual: &str) -> Result<()> {
    known_extension(path)
        .map_or(Ok(()), |extension| Err(named_otherwise(path, what, extension, &format!("such as {usual}"))))
}

/// True for files that are named `.toml`.
pub(crate) fn is_look(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// Options about surroundings.
#[derive(Args, Debug)]
pub(crate) struct SurroundingsArgs {
    /// Light and background from a picture of the surroundings (.hdr .exr .png ...): a panorama (2:1), a cube's cross (4:3
    /// or 3:4), a strip of its faces (6:1, 1:6), a KTX2 or DDS file of a cube; or "sky" for a computed one with the sun at --light
    #[arg(long, value_name = "FILE|sky")]
    environment: Option<PathBuf>,
    /// Degrees by which the environment is turned to the left
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, requires = "environment", value_parser = finite)]
    environment_rotation: f32,
    /// Factor of the environment's light
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, default_value_t = 1.0, requires = "environment", value_parser = not_negative)]
    environment_strength: f32,
    /// What is seen behind the model: the environment by default, the gradient without one
    #[arg(long, value_enum)]
    background: Option<BackgroundArg>,
    /// How much the environment is blurred behind the model, 0 to 1; its light and reflections stay as they are
    #[arg(long, value_name = "0..1", allow_negative_numbers = true, default_value_t = 0.0, requires = "environment", value_parser = share)]
    background_blur: f32,
}

/// What is seen behind the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum BackgroundArg {
    /// The environment
    Environment,
    /// A grey gradient, as without an environment
    Gradient,
    /// Nothing: the picture gets an alpha channel
    Transparent,
}

pub(crate) fn finite(text: &str) -> Result<f32, String> {
    within(text, "expected a finite number", f32::is_finite)
}

fn not_negative(text: &str) -> Result<f32, String> {
    within(text, "expected a finite number that is not negative", |n: f32| n.is_finite() && n >= 0.0)
}

impl SurroundingsArgs {
    /// Whether an environment was asked for.
    pub(crate) fn is_given(&self) -> bool {
        self.environment.is_some()
    }

    /// Whether a background was asked for.
    pub(crate) fn has_background(&self) -> bool {
        self.background.is_some()
    }

    /// What is seen behind the model.
    pub(crate) fn background(&self) -> Result<Background> {
        if self.background_blur != 0.0 && !matches!(self.background, None | Some(BackgroundArg::Environment))
        {
            return Err(Error::invalid(
                "--background-blur is of an environment that is seen; leave it or --background out",
            ));
        }
        let environment = Background::Environment { blur: self.background_blur };
        Ok(match (self.background, self.is_given()) {
            (None | Some(BackgroundArg::Environment), true) => environment,
            (Some(BackgroundArg::Environment), false) => {
                let sentence = "there is no environment to be seen: give one with --environment, or another --background";
                return Err(Error::invalid(sentence));
            }
            (None | Some(BackgroundArg::Gradient), _) => Background::default(),
            (Some(BackgroundArg::Transparent), _) => Background::Transparent,
        })
    }

    /// Reads or computes the environment that was asked for. `to_sun` is where a computed sky has its sun.
    pub(crate) fn load(&self, to_sun: Option<Vec3>) -> Result<Option<Surroundings>> {
        let Some(path) = &self.environment else { return Ok(None) };
        let mut surroundings = Surroundings::load(path, to_sun)?;
        surroundings.light.strength = self.environment_strength;
        surroundings.light.rotation_degrees = self.environment_rotation;
        Ok(Some(surroundings))
    }
}
