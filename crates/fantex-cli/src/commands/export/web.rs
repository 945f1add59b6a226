//! A page that shows an asset in a browser.

use std::io::Write;
use std::path::{Path, PathBuf};

use fantex::base::files::{persist_all, temporary_file};
use fantex::render::RenderOptions;
use fantex::texture::Filter;
use fantex::{Error, Preview, PreviewOptions, Result};
use fantex_web::Page;
use serde::Serialize;
use tempfile::TempPath;

use super::ExportArgs;
use crate::commands::serve::{NO_VIEWER, encoded, file_name};
use crate::context::Context;
use crate::scene::{Scene, photograph, portrait};
use crate::text::megabytes;

/// Of the preview, in pixels: what services that show links ask for.
const PREVIEW_SIZE: [u32; 2] = [1200, 630];

/// Assets whose mesh, cover and directory take more get a preview.
const MAX_BYTES_WITHOUT_PREVIEW: u64 = 1 << 20;

/// Bytes of the asset that are copied at a time.
const CHUNK_BYTES: u64 = 4 << 20;

#[derive(Debug, Serialize)]
struct WebInfo {
    output: PathBuf,
    files: Vec<PathBuf>,
    bytes: u64,
}

/// Writes the page, the viewer, the asset and a picture for previews of links.
pub(super) fn run(args: &ExportArgs, context: &Context) -> Result<()> {
    let base = base_url(&args.base_url)?;
    let viewer = fantex_web::files().ok_or_else(|| Error::unavailable(NO_VIEWER))?;
    let scene = Scene::open(&args.asset, context)?;
    let asset = scene.asset().cloned().ok_or_else(|| {
        let path = args.asset.display();
        Error::unsupported(format!(
            "{path} is not an asset; give a .fan file, for example one that 'fantex bake' has written"
        ))
    })?;
    let name = file_name(&args.asset)?;
    let title = args.title.as_deref().unwrap_or_else(|| name.strip_suffix(".fan").unwrap_or(&name));
    let page = Page { title, credits: &args.credits, asset: &encoded(&name), base: &base }.html();

    let own = ["index.html", "preview.png"].into_iter().chain(viewer.iter().map(|(name, _)| *name));
    if own.clone().any(|own| own == name) {
        return Err(Error::invalid(format!(
            "{name} is a file of the page itself: give the asset another name"
        )));
    }

    context.make_folder(&args.output)?;
    let place = |name: &str| args.output.join(name);
    own.chain([name.as_str()]).try_for_each(|name| context.check_output_of(&place(name), &args.asset))?;
    let _deferral = context.defer_interrupt();
    let mut files = Vec::new();
    let mut bytes = 0;
    for (name, content) in viewer {
        bytes += content.len() as u64;
        files.push(written(&place(name), |file| file.write_all(content))?);
    }
    let copy = written(&place(&name), |file| {
        let mut chunk = Vec::new();
        for start in (0..asset.file_bytes()).step_by(CHUNK_BYTES as usize) {
            chunk.resize((asset.file_bytes() - start).min(CHUNK_BYTES) as usize, 0);
            asset.source().read_exact_at(&mut chunk, start)?;
            file.write_all(&chunk)?;
        }
        Ok(())
    })?;
    context.check_interrupt()?;
    if asset.head_bytes() > MAX_BYTES_WITHOUT_PREVIEW {
        let options = PreviewOptions { memory_bytes: context.memory_bytes, ..PreviewOptions::default() };
        Preview::add_to(&copy.0, &options)?;
        context.check_interrupt()?;
    }
    bytes += std::fs::metadata(&copy.0).map_err(|error| Error::reading(&copy.0, error))?.len();
    files.push(copy);
    let picture = picture(&scene)?;
    bytes += picture.len() as u64;
    files.push(written(&place("preview.png"), |file| file.write_all(&picture))?);
    bytes += page.len() as u64;
    files.push(written(&place("index.html"), |file| file.write_all(page.as_bytes()))?);
    let info = WebInfo {
        output: args.output.clone(),
        files: files.iter().map(|(_, path)| path.clone()).collect(),
        bytes,
    };
    context.check_interrupt()?;
    persist_all(files, context.force)?;
    scene.show_damage(context)?;
    context.print(&info, |info| {
        format!(
            "{}: a page of {} files, {}\n",
            info.output.display(),
            info.files.len(),
            megabytes(info.bytes)
        )
    })
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

/// What services that show links show, and the page where it cannot show more: drawn by the CPU renderer, as PNG.
fn picture(scene: &Scene) -> Result<Vec<u8>> {
    let [width, height] = PREVIEW_SIZE;
    let options = RenderOptions { width, height, ..RenderOptions::default() };
    let surface = scene.surface(Filter::Anisotropic)?;
    let camera = portrait(scene.mesh(), &options);
    let picture = photograph(scene.mesh(), surface.as_ref(), &camera, &options)?.picture;
    picture.to_srgb_image().encoded("preview.png")
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
