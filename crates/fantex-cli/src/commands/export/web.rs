//! A page that shows an asset or a world in a browser.

use std::collections::HashSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::base::files::{folder_of, persist_all, temporary_file};
use fantex::base::uri_escaped;
use fantex::render::{FilterOptions, RenderOptions};
use fantex::scene::Camera;
use fantex::store::{FileSource, PREVIEW};
use fantex::stream::url_of;
use fantex::texture::Filter;
use fantex::{Error, ErrorKind, FileKind, Preview, PreviewOptions, Result, World, WorldScene, frame_world};
use fantex_web::Page;
use serde::Serialize;
use tempfile::TempPath;

use super::ExportArgs;
use crate::commands::serve::{NO_VIEWER, file_name, path_below, ranges_ahead};
use crate::context::Context;
use crate::scene::{Scene, aspect, open_asset, photograph, portrait, report_damage};
use crate::text::{ShownPath, counted, megabytes};

/// Of the preview, in pixels: what services that show links ask for.
const PREVIEW_SIZE: [u32; 2] = [1200, 630];

/// Assets whose mesh, cover and directory take more get a preview, unless they have one.
const MAX_BYTES_WITHOUT_PREVIEW: u64 = 1 << 20;

/// Bytes of the asset that are copied at a time.
const CHUNK_BYTES: u64 = 4 << 20;

#[derive(Debug, Serialize)]
struct WebInfo {
    output: ShownPath,
    files: Vec<ShownPath>,
    bytes: u64,
}

/// Writes the page, the viewer, the asset or the world, and a picture for previews of links.
pub(super) fn run(args: &ExportArgs, context: &Context) -> Result<()> {
    let base = base_url(&args.base_url)?;
    let viewer = fantex_web::files().ok_or_else(|| Error::unavailable(NO_VIEWER))?;
    let shown = Shown::open(&args.asset, context)?;
    let without_query = |url: &str| PathBuf::from(url.split(['?', '#']).next().unwrap_or(url));
    let name = file_name(&url_of(&args.asset).map_or_else(|| args.asset.clone(), without_query))?;
    let title =
        args.title.as_deref().unwrap_or_else(|| name.strip_suffix(shown.extension()).unwrap_or(&name));
    let assets = shown.assets(&args.asset, &name)?;
    let own = ["index.html", "preview.png"].into_iter().chain(viewer.iter().map(|(name, _)| *name));
    check_outputs(&own.collect::<Vec<_>>(), &name, &assets, args, context)?;
    let place = |name: &str| args.output.join(name);
    let _deferral = context.defer_interrupt();
    let mut files = Vec::new();
    let mut bytes = 0;
    for (name, content) in viewer {
        bytes += content.len() as u64;
        files.push(written(&place(name), |file| file.write_all(content))?);
    }
    for (path, from) in &assets {
        let copy = shown.copy_asset(from, &place(path), context)?;
        bytes += std::fs::metadata(&copy.0).map_err(|error| Error::reading(&copy.0, error))?.len();
        files.push(copy);
    }
    let mut ranges = Vec::new();
    if let (Shown::Asset(_), Some((copy, _))) = (&shown, files.last()) {
        let copied = FileSource::open(copy).map_err(|error| Error::reading(copy, error))?;
        ranges = ranges_ahead(&copied);
    }
    if let Shown::World(world) = &shown {
        let index = world.to_bytes()?;
        bytes += index.len() as u64;
        files.push(written(&place(&name), |file| file.write_all(&index))?);
    }
    let picture = shown.picture(&args.asset, context)?;
    bytes += picture.len() as u64;
    files.push(written(&place("preview.png"), |file| file.write_all(&picture))?);
    let asset = uri_escaped(&name);
    let page = Page { title, credits: &args.credits, asset: &asset, ranges: &ranges, base: &base }.html();
    bytes += page.len() as u64;
    files.push(written(&place("index.html"), |file| file.write_all(page.as_bytes()))?);
    let info = WebInfo {
        output: (&args.output).into(),
        files: files.iter().map(|(_, path)| path.into()).collect(),
        bytes,
    };
    context.check_interrupt()?;
    if let Shown::Asset(scene) = &shown {
        scene.show_damage(context)?;
    }
    persist_all(files, context.force)?;
    context.print(&info, |info| {
        format!(
            "{}: a page of {}, {}\n",
            info.output.display(),
            counted(info.files.len() as u64, "file"),
            megabytes(info.bytes)
        )
    })
}

/// Makes the folders of the page; refuses to write over what is there, and over its `own` files with what it shows, of this `name` and in these
/// `assets`.
fn check_outputs(
    own: &[&str],
    name: &str,
    assets: &[(String, PathBuf)],
    args: &ExportArgs,
    context: &Context,
) -> Result<()> {
    let mut names = assets.iter().map(|(path, _)| path.as_str()).chain([name]);
    if let Some(name) = names.find(|name| own.contains(name)) {
        return Err(Error::invalid(format!(
            "{name} is a file of the page itself: give the asset another name"
        )));
    }
    context.make_folder(&args.output)?;
    for (path, from) in assets {
        let place = args.output.join(path);
        context.make_folder(folder_of(&place))?;
        context.check_output_of(&place, from)?;
    }
    let mut rest = own.iter().copied().chain([name]);
    rest.try_for_each(|name| context.check_output_of(&args.output.join(name), &args.asset))
}

/// What the page shows.
enum Shown {
    Asset(Box<Scene>),
    World(World),
}

impl Shown {
    fn open(path: &Path, context: &Context) -> Result<Self> {
        if World::is_named(path) {
            let world = World::open(path)?;
            world.space_to_show(path)?;
            return Ok(Self::World(world));
        }
        FileKind::check_is_asset(path)?;
        Ok(Self::Asset(Box::new(Scene::open(path, context)?)))
    }

    /// What its name ends with.
    fn extension(&self) -> &'static str {
        match self {
            Self::Asset(_) => ".fan",
            Self::World(_) => ".fanworld",
        }
    }

    /// The assets that are copied: below the folder of the page, and where they are. Those of a world that have addresses of their own are
    /// read there.
    fn assets(&self, shown: &Path, name: &str) -> Result<Vec<(String, PathBuf)>> {
        let Self::World(world) = self else { return Ok(vec![(name.to_owned(), shown.to_owned())]) };
        let below = world.assets().filter(|asset| url_of(Path::new(asset)).is_none());
        let mut seen = HashSet::new();
        let mut assets = Vec::new();
        for asset in below {
            let path = path_below(shown, asset)?;
            if seen.insert(path.clone()) {
                assets.push((path, World::place_of(shown, asset)));
            }
        }
        Ok(assets)
    }

    /// Copies an asset. One that is shown alone and has no preview gets one where it takes long to open; an index knows which of its assets have one.
    fn copy_asset(&self, from: &Path, to: &Path, context: &Context) -> Result<(TempPath, PathBuf)> {
        let asset = match self {
            Self::Asset(scene) => {
                scene.asset().map_or_else(|| open_asset(from), |asset| Ok(Arc::clone(asset)))?
            }
            Self::World(_) => open_asset(from)?,
        };
        let copy = written(to, |file| {
            let mut chunk = Vec::new();
            for start in (0..asset.file_bytes()).step_by(CHUNK_BYTES as usize) {
                chunk.resize((asset.file_bytes() - start).min(CHUNK_BYTES) as usize, 0);
                asset.source().read_exact_at(&mut chunk, start)?;
                file.write_all(&chunk)?;
            }
            Ok(())
        })?;
        context.check_interrupt()?;
        let may_gain = matches!(self, Self::Asset(_)) && asset.head_bytes() > MAX_BYTES_WITHOUT_PREVIEW;
        if may_gain && asset.attachment_bytes(PREVIEW)?.is_none() {
            let options = PreviewOptions {
                memory_bytes: context.memory_bytes,
                strict: context.strict,
                ..PreviewOptions::default()
            };
            let added = Preview::add_to(&copy.0, &options);
            let preview = added.map_err(|error| match error.kind() {
                ErrorKind::Damaged => error.in_file(from),
                _ => error,
            })?;
            report_damage(from, &preview.damage, context)?;
            context.check_interrupt()?;
        }
        Ok(copy)
    }

    /// What services that show links show, and the page where it cannot show more: drawn by the CPU renderer, as PNG.
    fn picture(&self, path: &Path, context: &Context) -> Result<Vec<u8>> {
        let [width, height] = PREVIEW_SIZE;
        let options = RenderOptions { width, height, ..RenderOptions::default() };
        let picture = match self {
            Self::Asset(scene) => {
                let surface = scene.surface(Filter::Anisotropic, context)?;
                let camera = portrait(scene.mesh(), &options);
                photograph(scene.mesh(), surface.as_ref(), &camera, &options)?.picture
            }
            Self::World(world) => {
                let (view, fov) = (Camera::THREE_QUARTER, Camera::FRAMING_FOV_DEGREES);
                let camera = frame_world(path, world, view, aspect(&options), fov)?;
                let scene = WorldScene::open(path, world, &camera, PREVIEW_SIZE, context.memory_bytes)?;
                let filter = FilterOptions { filter: Filter::Anisotropic, ..FilterOptions::default() };
                let surface = scene.surface(filter);
                let picture = photograph(scene.mesh(), &surface, &camera, &options)?.picture;
                scene.damage().try_for_each(|damage| report_damage(path, &damage, context))?;
                picture
            }
        };
        picture.to_srgb_image().encoded("preview.png")
    }
}

/// What is to become a file, under a temporary name.
fn written(
    path: &Path,
    write: impl FnOnce(&mut std::fs::File) -> std::io::Result<()>,
) -> Result<(TempPath, PathBuf)> {
    let failed = |error| Error::writing(path, error);
    let mut file = temporary_file(path, ".tmp").map_err(failed)?;
    write(file.as_file_mut()).map_err(failed)?;
    Ok((file.into_temp_path(), path.to_owned()))
}

/// With a slash at its end.
fn base_url(text: &str) -> Result<String> {
    let is_whole = ["https://", "http://"].iter().any(|scheme| text.starts_with(scheme));
    match text {
        "" => Ok(String::new()),
        _ if !is_whole => Err(Error::invalid(format!(
            "--base-url {text} is no whole address: give one such as https://example.org/bottle/"
        ))),
        _ if text.ends_with('/') => Ok(text.to_owned()),
        _ => Ok(format!("{text}/")),
    }
}
