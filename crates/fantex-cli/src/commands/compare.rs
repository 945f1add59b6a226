//! `fantex compare`: two files, the same cameras, the difference in numbers and pictures.

use std::path::{Path, PathBuf};

use clap::Args;
use fantex::look::LookFile;
use fantex::look::{LookImages, ResolveOptions};
use fantex::look_scene::{GivenModel, LookScene, MaterialResolver, PictureChanges};
use fantex::mesh::Mesh;
use fantex::render::{Background, Camera, RenderOptions, Surface};
use fantex::store::{Asset, ChannelKind};
use fantex::texture::Filter;
use fantex::texture::compare::difference_picture;
use fantex::{Error, ModelPicture, Result, ViewComparison};
use serde::Serialize;

use crate::commands::render::show_damaged_tiles;
use crate::context::Context;
use crate::scene::{FILTERS, Scene, aspect, is_look, photograph, size};
use crate::series::Series;
use crate::text::{ShownPath, columns, counted, one_of, whole};

/// Render two files from the same cameras and compare the pictures.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex compare bottle.gltf bottle.fan
  fantex compare bottle.gltf bottle.fan --views 8 -o out/bottle
  fantex compare oak.toml chair.fan

The cameras stand around the first file's model. A look brings its own lamps and dresses the other file's model where it \
names none; its background is left out. PSNR, SSIM and FLIP are those of the sRGB pictures, over the pixels that show \
either model; 'whole' is the PSNR with the background, which is equal in both. FLIP is 0 for equal pictures. \
Difference pictures show the absolute difference, sixteen times enlarged.

A camera that sees neither model, as a flat one edge-on, does not count. The mean PSNR is over the pictures that \
differ.

With --json: psnr_db (mean and min over the views), ssim and flip are over the pixels of the model, model_share says \
how many of all these are, whole_psnr_db is over all; per_view has the same for each camera, and empty_views says how \
many cameras do not count. PSNR of equal pictures is null.")]
pub(crate) struct CompareArgs {
    /// The reference: a model, an asset or a look
    a: PathBuf,
    /// What is compared with it
    b: PathBuf,
    /// Number of cameras, spread evenly around the model
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Folder for the pictures of both and their differences
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "960x720", value_parser = size)]
    size: [u32; 2],
    /// Samples per pixel, 1 to 64
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 8, value_parser = whole::<u32>)]
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
    /// Over the pixels that show a model; null for equal pictures, whose ratio is infinite.
    psnr_db: Option<f64>,
    ssim: f64,
    flip: f64,
    /// Share of the pixels that show a model.
    model_share: f64,
    /// Over all pixels.
    whole_psnr_db: Option<f64>,
    pictures: Vec<ShownPath>,
}

#[derive(Debug, Serialize)]
struct CompareInfo {
    psnr_db: MeanMin,
    ssim: f64,
    flip: f64,
    model_share: f64,
    whole_psnr_db: MeanMin,
    views: u32,
    /// Of these, such that show neither model and do not count.
    empty_views: u32,
    per_view: Vec<ViewInfo>,
}

#[derive(Clone, Copy)]
pub(crate) struct Subject<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) surface: &'a dyn Surface,
}

impl Subject<'_> {
    fn picture(&self, camera: &Camera, options: &RenderOptions) -> Result<ModelPicture> {
        let options = RenderOptions { background: Background::Transparent, ..options.clone() };
        Ok(ModelPicture::new(&photograph(self.mesh, self.surface, camera, &options)?.picture))
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
            Opened::Scene(scene) => {
                return Ok(Self::Scene { scene, surface: scene.surface(args.filter, context)? });
            }
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
            background: Some(Background::Transparent),
            ..PictureChanges::default()
        };
        let given = other.0.model(other.1);
        let scene = LookScene::new(resolver, given.as_ref(), changes)?;
        context.report_left_out(file.path(), &scene.left_out())?;
        Ok(Self::Look(Box::new(scene)))
    }

    fn orbit(&self, args: &CompareArgs, aspect: f64) -> Result<Vec<Camera>> {
        match self {
            Self::Scene { scene, .. } => Ok(Camera::orbit(scene.mesh(), args.views as usize, aspect)),
            Self::Look(look) => Ok(look.orbit(args.views as usize, aspect)?),
        }
    }

    /// A look has its size and samples already.
    fn picture(&self, camera: &Camera, options: &RenderOptions) -> Result<ModelPicture> {
        match self {
            Self::Scene { scene, surface } => {
                Subject { mesh: scene.mesh(), surface: surface.as_ref() }.picture(camera, options)
            }
            Self::Look(look) => {
                let time = look.times().first().copied().unwrap_or(0.0);
                Ok(ModelPicture::new(&look.render_from(camera, time)?.picture))
            }
        }
    }

    fn show_damage(&self, context: &Context) -> Result<()> {
        match self {
            Self::Scene { scene, .. } => scene.show_damage(context),
            Self::Look(look) => show_damaged_tiles(look, context),
        }
    }
}

pub(crate) fn run(args: &CompareArgs, context: &Context) -> Result<()> {
    let files = [Opened::open(&args.a, context)?, Opened::open(&args.b, context)?];
    note_of_grey(&files[0], &files[1], context);
    note_of_grey(&files[1], &files[0], context);
    let images = LookImages::default();
    let a = Prepared::new(&files[0], (&files[1], &args.b), &images, args, context)?;
    let b = Prepared::new(&files[1], (&files[0], &args.a), &images, args, context)?;
    let [width, height] = args.size;
    let options = RenderOptions { width, height, samples: args.samples, ..RenderOptions::default() };
    if let Some(folder) = &args.output {
        context.make_folder(folder)?;
    }
    let cameras = a.orbit(args, aspect(&options))?;
    let pictures_of =
        |folder: &PathBuf| Series::of_files(context, folder, "picture", Some(3 * cameras.len() as u64));
    let mut series = args.output.as_ref().map(pictures_of);
    let mut views = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        let files = args.output.as_ref().map(|folder| {
            ["a", "b", "difference"].map(|what| folder.join(format!("view-{:02}-{what}.png", i + 1)))
        });
        files.iter().flatten().try_for_each(|path| context.check_output(path))?;
        let pictures = [a.picture(camera, &options)?, b.picture(camera, &options)?];
        if context.strict {
            [&a, &b].into_iter().try_for_each(|file| file.show_damage(context))?;
        }
        views.push(compare_view(&pictures, files, series.as_mut())?);
        context.check_interrupt()?;
    }
    [&a, &b].into_iter().try_for_each(|file| file.show_damage(context))?;
    let shown: Vec<ViewComparison> =
        views.iter().map(|(view, _)| *view).filter(ViewComparison::shows_model).collect();
    if shown.is_empty() {
        let [a, b] = [&args.a, &args.b].map(|path| path.display());
        let sentence =
            format!("no picture shows {a} or {b}, so there is nothing to compare; give more --views");
        return Err(Error::not_found(sentence));
    }
    let mean = |of: fn(&ViewComparison) -> f64| shown.iter().map(of).sum::<f64>() / shown.len() as f64;
    let mean_min = |of: fn(&ViewComparison) -> f64| MeanMin {
        mean: finite(ViewComparison::mean_db(shown.iter().map(of))),
        min: finite(shown.iter().map(of).fold(f64::INFINITY, f64::min)),
    };
    let info = CompareInfo {
        psnr_db: mean_min(|view| view.model.psnr_db),
        ssim: mean(|view| view.model.ssim),
        flip: mean(|view| view.model.flip),
        model_share: mean(|view| view.model_share),
        whole_psnr_db: mean_min(|view| view.whole_psnr_db),
        views: args.views,
        empty_views: (views.len() - shown.len()) as u32,
        per_view: views
            .iter()
            .map(|(view, pictures)| ViewInfo {
                psnr_db: finite(view.model.psnr_db),
                ssim: view.model.ssim,
                flip: view.model.flip,
                model_share: view.model_share,
                whole_psnr_db: finite(view.whole_psnr_db),
                pictures: pictures.iter().map(ShownPath::from).collect(),
            })
            .collect(),
    };
    context.print(&info, text)
}

/// Says that a model has nothing to show beside an asset that has colours, if so.
fn note_of_grey(model: &Opened, asset: &Opened, context: &Context) {
    let (Opened::Scene(model), Opened::Scene(asset)) = (model, asset) else { return };
    let is_coloured = |asset: &Asset| asset.channels().iter().any(|c| c.kind == ChannelKind::BaseColor);
    if model.is_grey() && asset.asset().is_some_and(|asset| is_coloured(asset)) {
        context.note(format!(
            "{} has no textures or colours of its own: it is drawn grey, and compared is the grey with what {} holds; give the look (.toml) \
             that was baked instead of the model to see what baking lost",
            model.path().display(),
            asset.path().display()
        ));
    }
}

/// Measures, and pictures written.
fn compare_view(
    pictures: &[ModelPicture; 2],
    files: Option<[PathBuf; 3]>,
    series: Option<&mut Series<'_>>,
) -> Result<(ViewComparison, Vec<PathBuf>)> {
    let comparison = ViewComparison::new(pictures)?;
    let (Some(files), Some(series)) = (files, series) else { return Ok((comparison, Vec::new())) };
    let [reference, test] = pictures.each_ref().map(|seen| &seen.image);
    let difference = difference_picture(reference, test, GAIN)?;
    let images = [reference, test, &difference];
    images.into_iter().zip(&files).try_for_each(|(image, path)| series.write(path, || image.save(path)))?;
    Ok((comparison, files.to_vec()))
}

/// Over the pixels that show either subject, and the cameras whose pictures differ.
pub(crate) fn mean_psnr_db(
    subjects: [Subject; 2],
    cameras: &[Camera],
    options: &RenderOptions,
    context: &Context,
) -> Result<f64> {
    let mut ratios = Vec::with_capacity(cameras.len());
    for camera in cameras {
        let [a, b] = subjects;
        let pictures = [a.picture(camera, options)?, b.picture(camera, options)?];
        ratios.push(ViewComparison::new(&pictures)?.model.psnr_db);
        context.check_interrupt()?;
    }
    Ok(ViewComparison::mean_db(ratios.into_iter()))
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn text(info: &CompareInfo) -> String {
    let psnr = |db: Option<f64>| db.map_or("equal".to_owned(), |db| format!("{db:.2}"));
    let mut rows = vec![["view", "PSNR dB", "SSIM", "FLIP", "model", "whole dB"].map(str::to_owned).to_vec()];
    let mut row = |name: String, db: Option<f64>, [ssim, flip, share]: [f64; 3], whole: Option<f64>| {
        let numbers =
            [psnr(db), format!("{ssim:.4}"), format!("{flip:.4}"), format!("{:.1} %", 100.0 * share)];
        rows.push([name].into_iter().chain(numbers).chain([psnr(whole)]).collect());
    };
    for (i, view) in info.per_view.iter().enumerate() {
        if view.model_share == 0.0 {
            continue;
        }
        let measures = [view.ssim, view.flip, view.model_share];
        row((i + 1).to_string(), view.psnr_db, measures, view.whole_psnr_db);
    }
    let measures = [info.ssim, info.flip, info.model_share];
    row("mean".to_owned(), info.psnr_db.mean, measures, info.whole_psnr_db.mean);
    let mut text = columns(&rows);
    if info.empty_views > 0 {
        let (empty, views) = (info.empty_views, counted(u64::from(info.views), "view"));
        text.push_str(&format!("{empty} of {views} left out: neither model is seen there\n"));
    }
    for path in info.per_view.iter().flat_map(|v| &v.pictures) {
        text.push_str(&format!("{}\n", path.display()));
    }
    text
}
