//! Opening models and assets.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use fantex::look::LookFile;
use fantex::mesh::{self, CleanOptions, CleanReport, LoadOptions, Mesh, Model};
use fantex::store::Asset;

use crate::context::Context;
use crate::error::CliError;

/// A model, cleaned.
#[derive(Debug)]
pub(crate) struct CleanModel {
    pub(crate) mesh: Mesh,
    pub(crate) report: CleanReport,
    /// What the loader noticed, then what cleaning did: one sentence each.
    pub(crate) notes: Vec<String>,
    pub(crate) load_seconds: f64,
    pub(crate) clean_seconds: f64,
}

/// What a file holds.
#[derive(Debug)]
pub(crate) enum Input {
    Model(Box<CleanModel>),
    Asset(Arc<Asset>),
    Look(Box<LookFile>),
}

impl Input {
    /// Opens a model, an asset or a look.
    pub(crate) fn open(path: &Path) -> Result<Self, CliError> {
        if is_look(path) {
            return Ok(Self::Look(Box::new(LookFile::read(path)?)));
        }
        if is_asset(path)? {
            return Ok(Self::Asset(Arc::new(Asset::open(path)?)));
        }
        Ok(Self::Model(Box::new(CleanModel::load(path)?)))
    }
}

impl CleanModel {
    /// Loads and cleans a model; an asset is refused.
    pub(crate) fn open(path: &Path) -> Result<Self, CliError> {
        refuse_asset(path)?;
        Self::load(path)
    }

    fn load(path: &Path) -> Result<Self, CliError> {
        let started = Instant::now();
        let model = mesh::load(path, &LoadOptions::default())?;
        let load_seconds = started.elapsed().as_secs_f64();
        let mut notes = model.notes.clone();
        let started = Instant::now();
        let (mesh, report) = mesh::clean(model, &CleanOptions::default())?;
        notes.extend(report.lines());
        Ok(Self { mesh, report, notes, load_seconds, clean_seconds: started.elapsed().as_secs_f64() })
    }

    /// Tells the user what was noticed.
    pub(crate) fn show_notes(&self, path: &Path, context: &Context) {
        self.notes.iter().for_each(|note| context.note(format!("{}: {note}", path.display())));
    }
}

/// Loads a model as its file says; an asset is refused.
pub(crate) fn open_model(path: &Path) -> Result<Model, CliError> {
    refuse_asset(path)?;
    Ok(mesh::load(path, &LoadOptions::default())?)
}

fn refuse_asset(path: &Path) -> Result<(), CliError> {
    refuse_look(path)?;
    if is_asset(path)? { Err(CliError::AssetInsteadOfModel { path: path.into() }) } else { Ok(()) }
}

/// Opens an asset; a model is refused.
pub(crate) fn open_asset(path: &Path) -> Result<Arc<Asset>, CliError> {
    refuse_look(path)?;
    if !is_asset(path)? {
        return Err(CliError::ModelInsteadOfAsset { path: path.into() });
    }
    Ok(Arc::new(Asset::open(path)?))
}

/// True for files that are named `.toml`.
pub(crate) fn is_look(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

fn refuse_look(path: &Path) -> Result<(), CliError> {
    if is_look(path) { Err(CliError::LookInstead { path: path.into() }) } else { Ok(()) }
}

/// True for files that are named `.fan` or start like an asset, whatever they are named.
fn is_asset(path: &Path) -> Result<bool, CliError> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("fan")) {
        return Ok(true);
    }
    let mut start = Vec::with_capacity(4);
    match File::open(path).and_then(|file| file.take(4).read_to_end(&mut start)) {
        Ok(_) => Ok(start == *b"\x89FAN"),
        // The loader has a sentence for folders.
        Err(_) if path.is_dir() => Ok(false),
        Err(source) => Err(CliError::Read { path: path.into(), source }),
    }
}
