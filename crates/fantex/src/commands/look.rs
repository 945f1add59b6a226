//! `fantex info` of looks: what is in one, and a model's own materials as one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fantex::look::LookFile;
use fantex::look::data::{FileName, Look};
use fantex::texture::look::look_of_model;
use serde::Serialize;

use crate::context::Context;
use crate::error::CliError;
use crate::input::CleanModel;
use crate::table::Table;

#[derive(Debug, Serialize)]
struct LookInfo {
    kind: &'static str,
    file: PathBuf,
    /// Kind of each texture by its name.
    textures: BTreeMap<String, String>,
    materials: Vec<String>,
    objects: u64,
    lights: u64,
    has_environment: bool,
    frames: u32,
    /// Models and assets that the look names.
    models: Vec<PathBuf>,
}

/// Shows what is in a look.
pub(crate) fn print(file: &LookFile, context: &Context) -> Result<(), CliError> {
    let look = file.look();
    let resolved = |name: &FileName| file.file(name);
    let info = LookInfo {
        kind: "look",
        file: file.path().into(),
        textures: kinds(look)?,
        materials: look.materials.keys().cloned().collect(),
        objects: look.object.len() as u64,
        lights: look.light.len() as u64,
        has_environment: look.environment.is_some(),
        frames: look.picture.frames.as_ref().map_or(1, |frames| frames.count),
        models: look.object.iter().filter_map(|object| object.model.as_ref().map(resolved)).collect(),
    };
    context.print(&info, text)
}

/// The key `kind` of each texture.
fn kinds(look: &Look) -> Result<BTreeMap<String, String>, CliError> {
    let kind = |value: serde_json::Value| value["kind"].as_str().unwrap_or_default().to_owned();
    let textures = look.textures.iter();
    textures.map(|(name, table)| Ok((name.clone(), kind(serde_json::to_value(table)?)))).collect()
}

fn text(info: &LookInfo) -> String {
    let mut table = Table::default();
    table.row("look", info.file.display().to_string());
    info.textures.iter().for_each(|(name, kind)| {
        table.row("texture", format!("{name}: {kind}"));
    });
    info.materials.iter().for_each(|name| {
        table.row("material", name.as_str());
    });
    table.row("objects", info.objects.to_string()).row("lights", info.lights.to_string());
    table.row("environment", if info.has_environment { "yes" } else { "no" });
    table.row("frames", info.frames.to_string());
    info.models.iter().for_each(|path| {
        table.row("model", path.display().to_string());
    });
    table.to_text()
}

#[derive(Debug, Serialize)]
struct Translation {
    look: Look,
    /// For each material of the model its name in the look.
    materials: Vec<String>,
}

/// Prints a model's own materials as a look.
pub(crate) fn print_of_model(model: &CleanModel, path: &Path, context: &Context) -> Result<(), CliError> {
    let translated = look_of_model(&model.mesh);
    let text = translated.look.to_toml();
    let text = text.map_err(|problem| CliError::LookContent { path: path.into(), problem })?;
    let head = format!("# The materials of {}, as a look.\n\n", path.display());
    let translation = Translation { look: translated.look, materials: translated.materials };
    context.print(&translation, |_| head + &text)
}
