//! How models are written for other programs.

use std::path::{Path, PathBuf};

use fantex::export::{
    ChannelMap, Depth, ExportOptions, ExportSummary, FanFileOptions, FanSheetOptions, ShaderLanguage,
    SheetPictures, UvChoice,
};
use fantex::{ModelKind, model_notes, stand_in_note};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::mesh::Mesh;
use crate::options::{choice, named, optional};
use crate::watch::in_python;

/// Files, and what is to be known of them, a sentence each.
pub(crate) type Exported = (Vec<PathBuf>, Vec<String>);

/// What was written of the asset or world at a place, to `output`.
fn exported(place: &Path, output: &Path, written: ExportSummary, kind: ModelKind) -> Exported {
    let notes = model_notes(output, &written, kind);
    let mut notes: Vec<String> = notes.iter().map(|note| in_python(note, Some(output))).collect();
    notes.extend(damage_notes(place, written.damage));
    (written.files.into_iter().map(|(path, _)| path).collect(), notes)
}

/// What was written of the fans of the asset or world at a place, to `output`.
pub(crate) fn exported_fans(place: &Path, output: &Path, written: ExportSummary) -> Exported {
    exported(place, output, written, ModelKind::Exported { fans: true, padding: None })
}

/// What is to be known of texels of the asset or world at a place: numbers of damaged tiles, and the first.
pub(crate) fn damage_notes(place: &Path, damage: Option<(u64, String)>) -> Vec<String> {
    damage.map(|(tiles, first)| stand_in_note(place, tiles, first)).into_iter().collect()
}

/// How models with an atlas, and single channels, are written.
pub(crate) struct AtlasFiles {
    uv: Uv,
    /// Of the pictures.
    pub(crate) side: Option<u32>,
    largest_side: u32,
    padding: Option<u32>,
    with_ktx2: bool,
    force: bool,
    memory_bytes: u64,
}

/// Whose texture coordinates.
enum Uv {
    Atlas,
    OfAsset,
    OfModel(Py<Mesh>),
}

impl AtlasFiles {
    pub(crate) fn new(options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let defaults = ExportOptions::default();
        let is_of_asset = optional(options, "source_uv")?.unwrap_or(false);
        let uv = match optional::<Py<Mesh>>(options, "model")? {
            Some(model) => Uv::OfModel(model),
            None if is_of_asset => Uv::OfAsset,
            None => Uv::Atlas,
        };
        Ok(Self {
            uv,
            side: optional(options, "resolution")?,
            largest_side: optional(options, "largest_side")?.unwrap_or(defaults.largest_side),
            padding: optional(options, "padding")?,
            with_ktx2: optional(options, "ktx2")?.unwrap_or(false),
            force: optional(options, "overwrite")?.unwrap_or(false),
            memory_bytes: optional(options, "memory")?.unwrap_or(defaults.memory_bytes),
        })
    }

    /// What was written of the asset or world at a place, to `output`.
    pub(crate) fn exported(&self, place: &Path, output: &Path, written: ExportSummary) -> Exported {
        exported(place, output, written, ModelKind::Exported { fans: false, padding: self.padding })
    }

    pub(crate) fn options(&self) -> ExportOptions<'_> {
        ExportOptions {
            uv: match &self.uv {
                Uv::Atlas => UvChoice::Atlas,
                Uv::OfAsset => UvChoice::OfAsset,
                Uv::OfModel(model) => UvChoice::OfModel(model.get().geometry()),
            },
            side: self.side,
            largest_side: self.largest_side,
            texels: None,
            padding: self.padding,
            with_ktx2: self.with_ktx2,
            force: self.force,
            strict: false,
            memory_bytes: self.memory_bytes,
        }
    }
}

/// How fans are written.
pub(crate) fn fan_files(options: &Bound<'_, PyDict>) -> PyResult<FanFileOptions> {
    let defaults = FanSheetOptions::default();
    let pictures = [
        ("png", SheetPictures::Png),
        ("png+ktx2", SheetPictures::PngAndKtx2),
        ("png+exr", SheetPictures::PngAndExr),
        ("exr", SheetPictures::Exr),
    ];
    let languages = [
        ("glsl", ShaderLanguage::Glsl),
        ("wgsl", ShaderLanguage::Wgsl),
        ("hlsl", ShaderLanguage::Hlsl),
        ("godot", ShaderLanguage::Godot),
    ];
    let shaders: Vec<String> = optional(options, "shaders")?.unwrap_or_default();
    let sheets = FanSheetOptions {
        gutter: optional(options, "gutter")?.unwrap_or(defaults.gutter),
        largest_side: optional(options, "largest_side")?.unwrap_or(defaults.largest_side),
        memory_bytes: optional(options, "memory")?.unwrap_or(defaults.memory_bytes),
    };
    Ok(FanFileOptions {
        sheets,
        pictures: choice(options, "textures", &pictures)?,
        shaders: shaders.iter().map(|name| named("shader", name, &languages)).collect::<PyResult<_>>()?,
        force: optional(options, "overwrite")?.unwrap_or(false),
        strict: false,
    })
}

/// A channel by its name on the command line.
pub(crate) fn channel_map(name: &str) -> PyResult<ChannelMap> {
    named("channel", name, &ChannelMap::ALL.map(|map| (map.name(), map)))
}

/// Bits per sample of a PNG file.
pub(crate) fn bits(depth: u32) -> PyResult<Depth> {
    match depth {
        8 => Ok(Depth::Eight),
        16 => Ok(Depth::Sixteen),
        _ => Err(PyValueError::new_err(format!("depth is {depth}; samples have 8 or 16 bits"))),
    }
}
