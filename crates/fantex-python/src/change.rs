//! Changes to assets: strokes, channels, previews.

use std::path::{Path, PathBuf};

use fantex::addresses::{change, change_copy, check_is_path};
use fantex::paint::{PaintOptions, Painter, ReplaySummary, StrokeFile, StrokeLog, replay, without_room};
use fantex::store::MAX_GAPS;
use fantex::{ChannelKind, Error, Preview, PreviewOptions, Progress};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::asset::{Asset, CHANNELS};
use crate::options::{ALPHA_MODES, named, optional, word};
use crate::watch::{heard, watched};

/// Channels that a list names.
fn kinds(options: &Bound<'_, PyDict>, key: &str) -> PyResult<Vec<ChannelKind>> {
    let names: Vec<String> = optional(options, key)?.unwrap_or_default();
    names.iter().map(|name| named("channel", name, &CHANNELS)).collect()
}

/// Takes out channels, adds others, applies strokes to an asset at a path or in a store, and commits, all of it or nothing: strokes, dabs,
/// changed pages, strokes that a log could not record. `strokes`: a stroke file and the folder that its paths are relative to; `log`: an asset
/// whose strokes are applied.
#[pyfunction]
pub(crate) fn paint(
    py: Python<'_>,
    asset: PathBuf,
    strokes: Option<(PathBuf, PathBuf)>,
    log: Option<Py<Asset>>,
    options: &Bound<'_, PyDict>,
) -> PyResult<(usize, usize, usize, usize)> {
    let (added, removed) = (kinds(options, "add_channels")?, kinds(options, "remove_channels")?);
    let alpha = word(options, "alpha", &ALPHA_MODES)?;
    let options = PaintOptions {
        memory_bytes: optional(options, "memory")?.unwrap_or(256 << 20),
        history: optional(options, "history")?.unwrap_or(true),
    };
    watched(py, None, |watch| {
        let log = log.as_ref().map(|other| StrokeLog::of(other.get().asset())).transpose()?;
        let file = match &strokes {
            Some((path, folder)) => Some((StrokeFile::load(path)?, folder)),
            None => None,
        };
        let paint = |path: &Path| {
            let mut painter = Painter::open(path, &options)?;
            if let Some(alpha) = alpha {
                painter.set_alpha_mode(alpha)?;
            }
            painter.remove_channels(&removed)?;
            painter.add_channels(&added)?;
            let summary = match (&file, &log) {
                (Some((file, folder)), _) => replay(&mut painter, file, folder)?,
                (None, Some(log)) => log.replay(&mut painter)?,
                (None, None) => ReplaySummary::default(),
            };
            if watch.is_cancelled() {
                return Err(Error::cancelled("painting was ended; nothing was painted"));
            }
            painter.commit()?;
            if !options.history {
                // What was painted is there without that, too.
                painter.close_gaps(MAX_GAPS).unwrap_or_default();
            }
            Ok(summary)
        };
        let strokes = file.as_ref().map(|(file, _)| file).or(log.as_ref().map(|log| &log.strokes));
        let commits_between = !added.is_empty()
            || !removed.is_empty()
            || alpha.is_some()
            || strokes.is_some_and(StrokeFile::commits_between);
        let summary = match commits_between {
            true => {
                change_copy(&asset, [watch, watch], paint).map_err(|error| without_room(error, &asset))?
            }
            false => {
                change(&asset, [watch, watch], |path| paint(path).map_err(|error| without_room(error, path)))?
            }
        };
        Ok((summary.strokes, summary.dabs, summary.pages, summary.unrecorded))
    })
}

/// Writes the strokes of an asset as a stroke file, with the pictures that it mentions in the folder `files` beside it: strokes, and those that
/// could not be recorded.
#[pyfunction]
pub(crate) fn save_strokes(py: Python<'_>, asset: &Asset, path: PathBuf) -> PyResult<(usize, usize)> {
    watched(py, None, |_| {
        check_is_path(&path)?;
        let log = StrokeLog::of(asset.asset())?;
        log.save(&path)?;
        let unrecorded = log.strokes.strokes.iter().filter(|stroke| stroke.unrecorded).count();
        Ok((log.strokes.strokes.len() - unrecorded, unrecorded))
    })
}

/// Gives an asset at a path or in a store a preview: triangles, texels, bytes.
#[pyfunction]
pub(crate) fn make_preview(
    py: Python<'_>,
    asset: PathBuf,
    triangles: usize,
    texels: Option<u64>,
    keep_borders: bool,
    memory: u64,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<(u64, u64, usize)> {
    let options = PreviewOptions {
        triangles,
        texels,
        keeps_borders: keep_borders,
        memory_bytes: memory,
        ..PreviewOptions::default()
    };
    let made = watched(py, heard(&progress, "baking"), |watch| {
        let [fetching, sending] = [watch.named("fetching"), watch.named("uploading")];
        Preview::add_at(&asset, &options, [&fetching, &sending])
    })?;
    Ok((made.triangles, made.texels, made.bytes.len()))
}

/// Takes the preview out of an asset at a path or in a store; false where there is none.
#[pyfunction]
pub(crate) fn remove_preview(py: Python<'_>, asset: PathBuf) -> PyResult<bool> {
    watched(py, None, |watch| Preview::remove_at(&asset, [watch, watch]))
}
