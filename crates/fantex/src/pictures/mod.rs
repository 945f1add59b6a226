//! The three pictures that explain a cover: the cover on the model, the projection directions, the packed texture.

mod arrows;
mod cover_picture;
mod palette;
mod sheet;

use std::path::{Path, PathBuf};

use fantex::cover::Cover;
use fantex::mesh::Mesh;
use fantex::render::{Picture, RenderOptions};

use crate::commands::render::save;
use crate::context::Context;
use crate::error::CliError;
use palette::group_colors;

/// Draws all three and returns their paths: `DIR/cover.png`, `DIR/directions.png` and `DIR/tiles.png` for a folder, else
/// `PREFIX-cover.png` and so on.
pub(crate) fn draw(
    mesh: &Mesh,
    cover: &Cover,
    target: &Path,
    context: &Context,
) -> Result<Vec<PathBuf>, CliError> {
    let paths = paths(target, context)?;
    for path in &paths {
        context.check_output(path)?;
    }
    let options = RenderOptions { width: 1280, height: 960, ..RenderOptions::default() };
    for (picture, path) in cover_pictures(mesh, cover, &options)?.iter().zip(&paths) {
        save(picture, path, context)?;
    }
    Ok(paths.to_vec())
}

/// The cover on the model, the projection directions, and the packed texture (which has its own size).
pub(crate) fn cover_pictures(
    mesh: &Mesh,
    cover: &Cover,
    options: &RenderOptions,
) -> Result<[Picture; 3], CliError> {
    let colors = group_colors(cover);
    Ok([
        cover_picture::draw(mesh, cover, &colors, options)?,
        arrows::draw(mesh, cover, &colors, options)?,
        sheet::draw(mesh, cover, &colors),
    ])
}

fn paths(target: &Path, context: &Context) -> Result<[PathBuf; 3], CliError> {
    let names = ["cover.png", "directions.png", "tiles.png"];
    let ends_like_folder = target.as_os_str().to_string_lossy().ends_with(['/', '\\']);
    if target.is_dir() || ends_like_folder {
        context.make_folder(target)?;
        return Ok(names.map(|name| target.join(name)));
    }
    if let Some(folder) = target.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        context.make_folder(folder)?;
    }
    Ok(names.map(|name| {
        let mut path = target.as_os_str().to_owned();
        path.push(format!("-{name}"));
        path.into()
    }))
}
