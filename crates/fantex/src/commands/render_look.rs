//! `fantex render` of looks: one picture, or the numbered pictures of an animation.

use std::path::{Path, PathBuf};

use fantex::look::LookFile;
use fantex::look_scene::{GivenModel, LookScene, PictureChanges, Wardrobe};
use fantex::render::{RenderStats, Rendering};
use fantex::texture::Filter;
use fantex::texture::look::{LookImages, ResolveOptions};
use serde::Serialize;

use crate::commands::render::{RenderArgs, save};
use crate::context::Context;
use crate::error::CliError;
use crate::input::CleanModel;
use crate::size::counted;

#[derive(Debug, Serialize)]
struct LookRenderInfo {
    output: PathBuf,
    /// All pictures that were written.
    pictures: Vec<PathBuf>,
    width: u32,
    height: u32,
    seconds: f64,
    triangles: u64,
    shaded: u64,
    lookups: u64,
}

/// Renders a look, on a model where one is given.
pub(crate) fn run(
    args: &RenderArgs,
    file: &LookFile,
    model: Option<&Path>,
    context: &Context,
) -> Result<(), CliError> {
    let given = model.map(|path| given_model(path, context)).transpose()?;
    let images = LookImages::default();
    let options = ResolveOptions { filter: args.filter.map(filter_of), ..context.resolve_options() };
    let wardrobe = Wardrobe { file, images: &images, options };
    let scene = LookScene::new(wardrobe, given.as_ref(), changes(args))?;
    let times = scene.times();
    let pictures = names(&args.output, times.len());
    pictures.iter().try_for_each(|path| context.check_output(path))?;
    let mut info = LookRenderInfo {
        output: args.output.clone(),
        pictures: Vec::new(),
        width: 0,
        height: 0,
        seconds: 0.0,
        triangles: 0,
        shaded: 0,
        lookups: 0,
    };
    for (time, path) in times.into_iter().zip(pictures) {
        let Rendering { picture, stats } = scene.render(time)?;
        save(&picture, &path, context)?;
        (info.width, info.height) = (picture.width, picture.height);
        info.add(&stats);
        info.pictures.push(path);
        context.check_interrupt()?;
    }
    show_damaged_tiles(&scene, context);
    context.print(&info, text)
}

/// Tells the user about tiles of assets that could not be read, after they were looked at.
pub(crate) fn show_damaged_tiles(scene: &LookScene, context: &Context) {
    match scene.damaged_tiles() {
        0 => {}
        count => context.note(format!("coarser texels stand in for {}", counted(count, "damaged tile"))),
    }
}

fn given_model(path: &Path, context: &Context) -> Result<GivenModel, CliError> {
    let model = CleanModel::open(path)?;
    model.show_notes(path, context);
    Ok(GivenModel { path: path.into(), mesh: model.mesh })
}

fn changes(args: &RenderArgs) -> PictureChanges {
    PictureChanges {
        size: args.size.map(|size| size.0),
        samples: args.samples,
        filter: args.filter.map(filter_of),
        eye: args.eye.map(|v| v.0),
        target: args.target.map(|v| v.0),
        fov_degrees: args.fov,
        background: None,
    }
}

pub(crate) fn filter_of(filter: crate::scene::FilterArg) -> Filter {
    filter.options().filter
}

/// `picture.png` for one picture, `picture-0001.png` and so on for several.
fn names(output: &Path, count: usize) -> Vec<PathBuf> {
    if count == 1 {
        return vec![output.into()];
    }
    let stem = output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let extension = output.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    (1..=count).map(|i| output.with_file_name(format!("{stem}-{i:04}{extension}"))).collect()
}

impl LookRenderInfo {
    fn add(&mut self, stats: &RenderStats) {
        self.seconds += stats.elapsed.as_secs_f64();
        self.triangles = stats.triangles;
        self.shaded += stats.shaded;
        self.lookups += stats.lookups;
    }
}

fn text(info: &LookRenderInfo) -> String {
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
