//! `fantex compare`: two files, the same cameras, the difference in numbers and pictures.

use std::path::{Path, PathBuf};

use clap::Args;
use fantex::Result;
use fantex::look::LookFile;
use fantex::look::{LookImages, ResolveOptions};
use fantex::look_scene::{GivenModel, LookScene, MaterialResolver, PictureChanges};
use fantex::mesh::Mesh;
use fantex::render::{Background, Camera, RenderOptions, Surface};
use fantex::texture::compare::{Comparison, compare, difference_picture};
use fantex::texture::{Filter, Image};
use serde::Serialize;

use crate::commands::render::show_damaged_tiles;
use crate::context::Context;
use crate::scene::{FILTERS, Scene, aspect, is_look, photograph, size};
use crate::text::{columns, one_of};

/// Render two files from the same cameras and compare the pictures.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex compare bottle.gltf bottle.fan
  fantex compare bottle.gltf bottle.fan --views 8 -o out/bottle
  fantex compare oak.toml chair.fan

The cameras stand around the first file's model. A look brings its own lamps and dresses the other file's model where it
names none; its background is left out. PSNR, SSIM and FLIP are those of the sRGB pictures; FLIP is 0 for
equal pictures. Difference pictures show the absolute difference, sixteen times enlarged.")]
pub(crate) struct CompareArgs {
    /// The reference: a model, an asset or a look
    a: PathBuf,
    /// What is compared with it
    b: PathBuf,
    /// Number of cameras, spread evenly around the model
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Folder for the pictures of both and their differences
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "960x720", value_parser = size)]
    size: [u32; 2],
    /// Samples per pixel, 1 to 64
    #[arg(long, value_name = "N", default_value_t = 8)]
    samples: u32,
    /// How textures are filtered
    #[arg(long, value_parser = one_of(&FILTERS), default_value = "anisotropic")]
    filter: Filter,
}

/// How much differences are enlarged.
const GAIN: f32 = 16.0;

#[derive(Debug, Serialize)]
struct MeanMin {
    mean: Option<f64>,
    min: Option<f64>,
}

#[derive(Debug, Serialize)]
struct ViewInfo {
    /// Null for equal pictures, whose ratio is infinite.
    psnr_db: Option<f64>,
    ssim: f64,
    flip: f64,
    pictures: Vec<PathBuf>,
}

#[derive(Debug, Serialize)]
struct CompareInfo {
    psnr_db: MeanMin,
    ssim: f64,
    flip: f64,
    views: u32,
    per_view: Vec<ViewInfo>,
}

#[derive(Clone, Copy)]
pub(crate) struct Subject<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) surface: &'a dyn Surface,
}

impl Subject<'_> {
    fn picture(&self, camera: &Camera, options: &RenderOptions) -> Result<Image> {
        Ok(photograph(self.mesh, self.surface, camera, options)?.picture.to_linear_image())
    }
}

enum Opened {
    Scene(Scene),
    Look(Box<LookFile>),
}

impl Opened {
    fn open(path: &Path, context: &Context) -> Result<Self> {
        if is_look(path) {
            Ok(Self::Look(Box::new(LookFile::read(path)?)))
        } else {
            Ok(Self::Scene(Scene::open(path, context)?))
        }
    }

    /// The model for a look that names none.
    fn model(&self, path: &Path) -> Option<GivenModel> {
        match self {
            Self::Scene(scene) => Some(GivenModel { path: path.into(), mesh: scene.mesh().clone() }),
            Self::Look(_) => None,
        }
    }
}

/// A file, ready for its pictures.
enum Prepared<'a> {
    Scene { scene: &'a Scene, surface: Box<dyn Surface + 'a> },
    Look(Box<LookScene<'a>>),
}

impl<'a> Prepared<'a> {
    /// `other`: the file that it is compared with, and its path.
    fn new(
        file: &'a Opened,
        other: (&Opened, &Path),
        images: &'a LookImages,
        args: &CompareArgs,
        context: &Context,
    ) -> Result<Self> {
        let file = match file {
            Opened::Scene(scene) => return Ok(Self::Scene { scene, surface: scene.surface(args.filter)? }),
            Opened::Look(file) => file,
        };
        let filter = Some(args.filter);
        let resolver = MaterialResolver {
            file,
            images,
            options: ResolveOptions { filter, ..context.resolve_options() },
        };
        let changes = PictureChanges {
            size: Some(args.size),
            samples: Some(args.samples),
            filter,
            background: Some(Background::default()),
            ..PictureChanges::default()
        };
        let given = other.0.model(other.1);
        Ok(Self::Look(Box::new(LookScene::new(resolver, given.as_ref(), changes)?)))
    }

    fn orbit(&self, args: &CompareArgs, aspect: f64) -> Result<Vec<Camera>> {
        match self {
            Self::Scene { scene, .. } => Ok(Camera::orbit(scene.mesh(), args.views as usize, aspect)),
            Self::Look(look) => Ok(look.orbit(args.views as usize, aspect)?),
        }
    }

    /// The picture, linear light. A look has its size and samples already.
    fn picture(&self, camera: &Camera, options: &RenderOptions) -> Result<Image> {
        match self {
            Self::Scene { scene, surface } => {
                Subject { mesh: scene.mesh(), surface: surface.as_ref() }.picture(camera, options)
            }
            Self::Look(look) => {
                let time = look.times().first().copied().unwrap_or(0.0);
                Ok(look.render_from(camera, time)?.picture.to_linear_image())
            }
        }
    }

    fn show_damage(&self, context: &Context) {
        match self {
            Self::Scene { scene, .. } => scene.show_damage(context),
            Self::Look(look) => show_damaged_tiles(look, context),
        }
    }
}

pub(crate) fn run(args: &CompareArgs, context: &Context) -> Result<()> {
    let files = [Opened::open(&args.a, context)?, Opened::open(&args.b, context)?];
    let images = LookImages::default();
    let a = Prepared::new(&files[0], (&files[1], &args.b), &images, args, context)?;
    let b = Prepared::new(&files[1], (&files[0], &args.a), &images, args, context)?;
    let [width, height] = args.size;
    let options = RenderOptions { width, height, samples: args.samples, ..RenderOptions::default() };
    if let Some(folder) = &args.output {
        context.make_folder(folder)?;
    }
    let cameras = a.orbit(args, aspect(&options))?;
    let mut views = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        let files = args.output.as_ref().map(|folder| {
            ["a", "b", "difference"].map(|what| folder.join(format!("view-{:02}-{what}.png", i + 1)))
        });
        files.iter().flatten().try_for_each(|path| context.check_output(path))?;
        let pictures = [a.picture(camera, &options)?, b.picture(camera, &options)?];
        views.push(compare_view(&pictures, files, context)?);
        context.check_interrupt()?;
    }
    [&a, &b].into_iter().for_each(|file| file.show_damage(context));
    let info = CompareInfo {
        psnr_db: MeanMin {
            mean: finite(views.iter().map(|(c, _)| c.psnr_db).sum::<f64>() / views.len() as f64),
            min: finite(views.iter().map(|(c, _)| c.psnr_db).fold(f64::INFINITY, f64::min)),
        },
        ssim: views.iter().map(|(c, _)| c.ssim).sum::<f64>() / views.len() as f64,
        flip: views.iter().map(|(c, _)| c.flip).sum::<f64>() / views.len() as f64,
        views: args.views,
        per_view: views
            .into_iter()
            .map(|(c, pictures)| ViewInfo {
                psnr_db: finite(c.psnr_db),
                ssim: c.ssim,
                flip: c.flip,
                pictures,
            })
            .collect(),
    };
    context.print(&info, text)
}

/// Measures, and pictures written.
fn compare_view(
    [reference, test]: &[Image; 2],
    files: Option<[PathBuf; 3]>,
    context: &Context,
) -> Result<(Comparison, Vec<PathBuf>)> {
    let comparison = compare(reference, test)?;
    let Some(files) = files else { return Ok((comparison, Vec::new())) };
    let difference = difference_picture(reference, test, GAIN)?;
    let _deferral = context.defer_interrupt();
    let images = [reference, test, &difference];
    images.into_iter().zip(&files).try_for_each(|(image, path)| image.save(path))?;
    Ok((comparison, files.to_vec()))
}

pub(crate) fn mean_psnr_db(
    subjects: [Subject; 2],
    cameras: &[Camera],
    options: &RenderOptions,
    context: &Context,
) -> Result<f64> {
    let mut sum = 0.0;
    for camera in cameras {
        let [a, b] = subjects;
        sum += compare(&a.picture(camera, options)?, &b.picture(camera, options)?)?.psnr_db;
        context.check_interrupt()?;
    }
    Ok(sum / cameras.len() as f64)
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn text(info: &CompareInfo) -> String {
    let psnr = |db: Option<f64>| db.map_or("equal".to_owned(), |db| format!("{db:.2}"));
    let mut rows = vec![["view", "PSNR dB", "SSIM", "FLIP"].map(str::to_owned).to_vec()];
    for (i, view) in info.per_view.iter().enumerate() {
        let number = (i + 1).to_string();
        rows.push(vec![number, psnr(view.psnr_db), format!("{:.4}", view.ssim), format!("{:.4}", view.flip)]);
    }
    let mean = psnr(info.psnr_db.mean);
    rows.push(vec!["mean".to_owned(), mean, format!("{:.4}", info.ssim), format!("{:.4}", info.flip)]);
    let mut text = columns(&rows);
    for path in info.per_view.iter().flat_map(|v| &v.pictures) {
        text.push_str(&format!("{}\n", path.display()));
    }
    text
}
