//! How a model becomes an asset to paint on, and what is asked before.

use std::path::{Path, PathBuf};

use fantex::base::files::{folder_of, followed, persist, temporary_file};
use fantex::base::{Error, Result, counted};
use fantex::mesh::{LoadOptions, load};
use fantex::paint::{PaintOptions, Painter, ReplaySummary, StrokeLog};
use fantex::store::{Asset, WriterLock};
use fantex::{Baker, Mesh, OwnLook, Progress};
use serde::Deserialize;

use super::{NewAsset, asset_beside, bake_model};
use crate::document::{OpenProgress, Stage, cancelled};
use crate::settings::next_free;
use crate::text::grouped;

/// What is asked before a model is painted on.
#[derive(Clone, Debug, PartialEq)]
pub enum Question {
    /// What its asset is to be like.
    New {
        asset: PathBuf,
        /// What the model says itself.
        look: OwnLook,
    },
    /// The asset beside it was made of another mesh.
    Foreign {
        asset: PathBuf,
        /// Of the model and of the asset.
        triangles: [usize; 2],
        texels: u64,
        /// In the asset's log.
        strokes: usize,
    },
}

/// The answer to a [`Question`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// Make an asset, where there is none.
    New(NewAsset),
    /// Make a new one, which has the channels and the hard edges of the one that is there, too, and paint on it what was painted on that, which
    /// is kept under another name.
    Replay(NewAsset),
    /// Paint on the one that is there, whatever it was made of.
    Keep,
}

/// What a model became.
pub enum Made {
    Asset(PathBuf),
    Question(Question),
}

/// The asset beside a model, made if it is not there. Adds sentences for the user to the notes.
///
/// # Errors
/// The model or the asset cannot be read; the asset cannot be made; another program paints on it; it was made of another mesh, and the
/// answer says nothing of that.
pub fn asset_of_model(
    model: &Path,
    answer: Option<&Answer>,
    memory_bytes: usize,
    progress: &OpenProgress,
    notes: &mut Vec<String>,
) -> Result<Made> {
    let path = asset_beside(model);
    let is_there = path.is_file();
    if is_there && answer == Some(&Answer::Keep) {
        return Ok(Made::Asset(path));
    }
    let loaded = load(model, &LoadOptions::default())?;
    progress.enter(Stage::Cleaning)?;
    let mesh = Mesh::from_model(loaded, model)?;
    progress.enter(Stage::Reading)?;
    if !is_there {
        let Some(Answer::New(new) | Answer::Replay(new)) = answer else {
            let look = Baker::new(&mesh).own_look()?;
            return Ok(Made::Question(Question::New { asset: path, look }));
        };
        let told = make_asset(&mesh, new, &path, progress)?;
        notes.push(format!("The model became the asset {}, which is painted on.", path.display()));
        notes.extend(told);
        return Ok(Made::Asset(path));
    }
    let asset = Asset::open(&path)?;
    if is_made_of(asset.mesh(), &mesh) {
        notes.push(format!("{} was there already and is painted on.", path.display()));
        return Ok(Made::Asset(path));
    }
    let triangles = [&*mesh, asset.mesh()].map(|mesh| mesh.triangles.len());
    match answer {
        None => {
            let strokes = StrokeLog::of(&asset)?.strokes.strokes.len();
            let texels = asset.cover().stored_texels(asset.mesh());
            Ok(Made::Question(Question::Foreign { asset: path, triangles, texels, strokes }))
        }
        Some(Answer::Replay(new)) => {
            drop(asset);
            replay_onto(&mesh, new, &path, memory_bytes, progress, notes)?;
            Ok(Made::Asset(path))
        }
        Some(_) => {
            let [of_model, of_asset] = triangles.map(|count| counted(count as u64, "triangle"));
            let (asset, model) = (path.display(), model.display());
            Err(Error::invalid(format!(
                "{asset} was made of another mesh ({of_asset}) than {model} ({of_model}): open the \
                 asset itself to paint on it, or move it away"
            ))
            .with_path(&path))
        }
    }
}

/// Whether an asset's mesh is the model, or the model with triangles cut, which leaves its vertices in front.
fn is_made_of(asset: &fantex::mesh::Mesh, model: &fantex::mesh::Mesh) -> bool {
    let same_surface = || {
        let (a, b) = (asset.area(), model.area());
        asset.triangles == model.triangles
            || asset.triangles.len() > model.triangles.len() && (a - b).abs() <= 1e-4 * b
    };
    asset.world_from_mesh == model.world_from_mesh
        && asset.positions.starts_with(&model.positions)
        && same_surface()
}

/// Returns sentences for the user.
fn make_asset(mesh: &Mesh, new: &NewAsset, path: &Path, progress: &OpenProgress) -> Result<Vec<String>> {
    progress.enter(Stage::Baking)?;
    match bake_model(mesh, new, path, progress) {
        Err(_) if progress.is_cancelled() => Err(cancelled()),
        result => result,
    }
}

/// A new asset of a mesh in the place of another one, with what was painted on that. It takes the place once all is painted, and the old
/// one gets another name. Adds sentences for the user to the notes.
fn replay_onto(
    mesh: &Mesh,
    new: &NewAsset,
    path: &Path,
    memory_bytes: usize,
    progress: &OpenProgress,
    notes: &mut Vec<String>,
) -> Result<()> {
    // Nobody else is to paint on the old one meanwhile.
    let lock = WriterLock::acquire(path)?;
    let before = Asset::open(path)?;
    let (log, new) = (StrokeLog::of(&before)?, new.clone().like(&before));
    drop(before);
    // In the same folder, from which the looks of its log are found.
    let made = temporary_file(path, ".fan").map_err(|source| Error::writing(path, source))?.into_temp_path();
    // Only the name is needed.
    std::fs::remove_file(&made).map_err(|source| Error::writing(path, source))?;
    let told = make_asset(mesh, &new, &made, progress)?;
    let mut painter = Painter::open(&made, &PaintOptions { memory_bytes, history: true })?;
    let summary = log.replay(&mut painter)?;
    painter.commit()?;
    drop(painter);
    progress.enter(Stage::Baking)?;
    // The file gets another name, not a link to it.
    let place = followed(path);
    let stem = place.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let old = next_free(folder_of(&place), &format!("{stem}-old"), "fan", &[]);
    // With two names there is an asset at any time; some file systems know one name only.
    std::fs::hard_link(&place, &old)
        .or_else(|_| std::fs::rename(&place, &old))
        .map_err(|source| Error::writing(&old, source))?;
    if let Err(error) = persist(made, &place, true) {
        if !place.exists() {
            // As it was; where even that fails the old one is beside it under its other name.
            std::fs::rename(&old, &place).unwrap_or_default();
        }
        return Err(error);
    }
    drop(lock);
    notes.push(replayed(&summary, path, &old));
    notes.extend(told);
    Ok(())
}

fn replayed(summary: &ReplaySummary, path: &Path, old: &Path) -> String {
    let mut lost = String::new();
    if summary.unrecorded > 0 {
        lost += &format!(", {} could not be repeated", summary.unrecorded);
    }
    if summary.missed_samples > 0 {
        lost += &format!(", and {} of their points met no surface", grouped(summary.missed_samples as u64));
    }
    let (path, old) = (path.display(), old.display());
    let strokes = counted(summary.strokes, "stroke");
    format!("Painted {strokes} on the new {path}{lost}; the old one is {old}.")
}
