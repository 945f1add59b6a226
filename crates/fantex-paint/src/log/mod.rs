//! The log: what was painted, in terms that outlive resolution, density and mesh.
//!
//! ```text
//!  strokes/NUMBER         a stroke of a stroke file, as JSON: lengths in world units, places with their normals
//!  strokes/files/HASH.EXT the pictures and fonts that strokes mention
//! ```
//!
//! Both are attachments of the asset, committed with the texels and undone with them. So the log always says how the asset came to
//! look as it does, and can be replayed on another density or cover of the model, or on an edited mesh.

mod portable;

use std::path::{Path, PathBuf};

use fantex_store::{Asset, AssetEditor};

use crate::replay::{ReplayError, ReplaySummary, StrokeFile, StrokeSettings, prepare_fill, replay};
use crate::{FillArea, Paint, PaintError, Painter};

pub(crate) use portable::{Portable, Recording, portable};

/// What the names of all attachments begin with.
pub(crate) const PREFIX: &str = "strokes/";

const FILES: &str = "strokes/files/";

pub(crate) fn stroke_name(number: u64) -> String {
    format!("{PREFIX}{number:012}")
}

pub(crate) fn file_name(name: &str) -> String {
    format!("{PREFIX}{name}")
}

/// The number of the next stroke.
pub(crate) fn next_number(editor: &AssetEditor) -> u64 {
    let names = editor.attachment_names();
    let numbers = names.iter().filter_map(|name| name.strip_prefix(PREFIX)?.parse::<u64>().ok());
    numbers.max().map_or(0, |number| number + 1)
}

/// What a stroke of the log fills, and with what; none where that cannot be told any more.
pub(crate) fn logged_fill(painter: &Painter, number: u64) -> Option<(Paint, FillArea)> {
    let editor = painter.editor();
    let bytes = editor.attachment(&stroke_name(number)).ok()??;
    let mut stroke: StrokeSettings =
        serde_json::from_slice(&bytes).ok().filter(|s: &StrokeSettings| !s.unrecorded)?;
    portable::find_looks(&mut stroke, editor.asset().path());
    let folder = tempfile::tempdir().ok()?;
    for name in editor.attachment_names().iter().filter(|name| name.starts_with(FILES)) {
        let contents = editor.attachment(name).ok()??;
        save_file(folder.path(), Path::new(name.strip_prefix(PREFIX)?), &contents).ok()?;
    }
    prepare_fill(painter, &stroke, folder.path()).ok()?
}

fn save_file(folder: &Path, path: &Path, contents: &[u8]) -> std::io::Result<()> {
    let path = folder.join(path);
    path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    std::fs::write(path, contents)
}

/// The strokes of an asset, with the files that they mention.
#[derive(Clone, Debug, PartialEq)]
pub struct StrokeLog {
    /// In the order in which they were painted; what was undone is not among them.
    pub strokes: StrokeFile,
    /// Paths relative to the stroke file, and contents.
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl StrokeLog {
    /// Reads the log of an asset; empty where nothing was painted.
    ///
    /// # Errors
    ///
    /// An attachment cannot be read, or is no stroke.
    pub fn of(asset: &Asset) -> Result<Self, PaintError> {
        let damaged = || PaintError::Log { path: asset.path().to_owned() };
        let names = asset.attachment_names().map_err(|_| damaged())?;
        let (mut strokes, mut files) = (Vec::new(), Vec::new());
        for name in names {
            let Some(rest) = name.strip_prefix(PREFIX) else { continue };
            let bytes = asset.attachment(name).ok().flatten().ok_or_else(damaged)?;
            if name.starts_with(FILES) {
                files.push((PathBuf::from(rest), bytes));
            } else {
                let mut stroke: StrokeSettings = serde_json::from_slice(&bytes).map_err(|_| damaged())?;
                portable::find_looks(&mut stroke, asset.path());
                strokes.push(stroke);
            }
        }
        Ok(Self { strokes: StrokeFile { version: 1, strokes }, files })
    }

    /// Writes a stroke file that can be replayed, and beside it the folder `files` with what it mentions.
    ///
    /// # Errors
    ///
    /// The system refuses.
    pub fn save(&self, path: &Path) -> std::io::Result<()> {
        let folder = path.parent().unwrap_or(Path::new(""));
        self.save_files(folder)?;
        let text = serde_json::to_string_pretty(&self.strokes).map_err(std::io::Error::other)?;
        std::fs::write(path, text)
    }

    /// Paints all strokes onto another asset, by their places in the world. Commits nothing.
    ///
    /// # Errors
    ///
    /// As [`replay`], and where no temporary folder can be made for the files.
    pub fn replay(&self, painter: &mut Painter) -> Result<ReplaySummary, ReplayError> {
        let folder = tempfile::tempdir().map_err(PaintError::Spill)?;
        self.save_files(folder.path()).map_err(PaintError::Spill)?;
        replay(painter, &self.strokes, folder.path())
    }

    fn save_files(&self, folder: &Path) -> std::io::Result<()> {
        self.files.iter().try_for_each(|(path, bytes)| save_file(folder, path, bytes))
    }
}
