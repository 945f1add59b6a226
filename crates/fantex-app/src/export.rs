//! An asset for other programs: a model with texture coordinates, and the pictures that a program wants.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::bake::Progress;
use fantex::base::files::{check_folder_of, folder_of, temporary_folder};
use fantex::base::{Error, Result};
use fantex::export::{ChannelMap, Depth, ExportOptions, export_channels, export_model};
use fantex::store::Asset;
use fantex::texture::{ColorSpace, Image, Samples};
use serde::Deserialize;

/// For which program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// One file with everything inside.
    #[default]
    Gltf,
    /// A model and pictures beside it.
    Blender,
    /// Colour, normal (-y), and occlusion, roughness and metallic in one.
    Unreal,
    /// Colour, normal, metallic with smoothness, occlusion.
    Unity,
}

impl Preset {
    pub const ALL: [(Self, &'static str); 4] = [
        (Self::Gltf, "glTF (one .glb)"),
        (Self::Blender, "Blender (.gltf and pictures)"),
        (Self::Unreal, "Unreal (.glb and pictures)"),
        (Self::Unity, "Unity (.glb and pictures)"),
    ];

    pub fn extension(self) -> &'static str {
        if self == Self::Blender { "gltf" } else { "glb" }
    }

    /// Whether the program expects normals whose y points downwards.
    pub fn points_down(self) -> bool {
        self == Self::Unreal
    }

    /// Ends of names, and what the pictures hold.
    fn pictures(self) -> &'static [(&'static str, Map)] {
        use ChannelMap as C;
        match self {
            Self::Gltf | Self::Blender => &[],
            Self::Unreal => &[
                ("BaseColor", Map::Channel(C::BaseColor)),
                ("Normal", Map::Channel(C::Normal)),
                ("ORM", Map::Channel(C::OcclusionRoughnessMetallic)),
                ("Emissive", Map::Channel(C::Emission)),
                ("Height", Map::Channel(C::Displacement)),
            ],
            Self::Unity => &[
                ("BaseMap", Map::Channel(C::BaseColor)),
                ("Normal", Map::Channel(C::Normal)),
                ("MetallicSmoothness", Map::MetallicSmoothness),
                ("Occlusion", Map::Channel(C::Occlusion)),
                ("Emission", Map::Channel(C::Emission)),
                ("Height", Map::Channel(C::Displacement)),
            ],
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Map {
    Channel(ChannelMap),
    /// Metallic in the colour, and 1 - roughness in alpha.
    MetallicSmoothness,
}

impl Map {
    /// One that it needs.
    fn channel(self) -> ChannelMap {
        match self {
            Self::Channel(channel) => channel,
            Self::MetallicSmoothness => ChannelMap::Metallic,
        }
    }
}

/// What is exported.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportSettings {
    pub preset: Preset,
    /// Columns and rows of the pictures; as the asset's density wants by default.
    pub side: Option<u32>,
    /// The green of normal maps is turned over: y points downwards.
    pub points_down: bool,
}

/// What became of an export.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Exported {
    Written(Vec<PathBuf>),
    /// Nothing: these files lie beside the model, would be replaced, and may not be.
    Replaces(Vec<PathBuf>),
}

/// Writes an asset as a preset wants it, all or nothing. The model replaces one that is there; a file beside it is replaced where
/// `may_replace` says so.
///
/// # Errors
/// The asset cannot be read, or a file not be written.
pub fn export(
    asset: &Arc<Asset>,
    output: &Path,
    settings: &ExportSettings,
    may_replace: impl Fn(&Path) -> bool,
    progress: &dyn Progress,
) -> Result<Exported> {
    check_folder_of(output)?;
    let paths = |names: &[PathBuf]| names.iter().map(|name| output.with_file_name(name)).collect();
    let replaced = |names: &[PathBuf]| {
        let mut paths: Vec<PathBuf> = paths(names);
        paths.retain(|path| path != output && path.exists() && !may_replace(path));
        Some(paths).filter(|paths| !paths.is_empty())
    };
    // Before what takes long, as far as their names are known.
    let known: Vec<PathBuf> = pictures(asset, output, settings.preset).map(|(name, _)| name).collect();
    if let Some(paths) = replaced(&known) {
        return Ok(Exported::Replaces(paths));
    }
    let folder = temporary_folder(folder_of(output)).map_err(|source| Error::writing(output, source))?;
    let name = output.file_name().ok_or_else(|| Error::invalid("the model to write has no name"))?;
    let names = write(asset, &folder.path().join(name), settings, progress)?;
    if progress.is_cancelled() {
        return Err(Error::cancelled("exporting was cancelled"));
    }
    if let Some(paths) = replaced(&names) {
        return Ok(Exported::Replaces(paths));
    }
    folder.move_files(&names, folder_of(output), true)?;
    Ok(Exported::Written(paths(&names)))
}

/// Names of the pictures that a preset wants besides the model's own, as far as the asset has such channels.
fn pictures(asset: &Asset, output: &Path, preset: Preset) -> impl Iterator<Item = (PathBuf, Map)> {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let is_there = |map: Map| asset.channel_of_kind(map.channel().channel()).is_some();
    let wanted = preset.pictures().iter().filter(move |(_, map)| is_there(*map));
    wanted.map(move |(end, map)| (PathBuf::from(format!("{stem}_{end}.png")), *map))
}

/// Writes all files into the folder of `output`. Returns their names.
fn write(
    asset: &Arc<Asset>,
    output: &Path,
    settings: &ExportSettings,
    progress: &dyn Progress,
) -> Result<Vec<PathBuf>> {
    let options = ExportOptions { side: settings.side, force: true, ..ExportOptions::default() };
    let summary = export_model(asset, output, &options, progress)?;
    // All lie as in the model.
    let options = ExportOptions {
        side: summary.sizes.first().map(|[columns, rows]| *columns.max(rows)).or(settings.side),
        ..options
    };
    let written = summary.files.iter().filter_map(|(path, _)| path.file_name());
    let mut names: Vec<PathBuf> = written.map(PathBuf::from).collect();
    for (name, map) in pictures(asset, output, settings.preset) {
        let path = output.with_file_name(&name);
        let write = |map| export_channels(asset, &[(map, &*path)], Depth::Eight, &options, progress);
        match map {
            Map::Channel(channel) => {
                write(channel)?;
                if channel == ChannelMap::Normal && settings.points_down {
                    turned_over(Image::load(&path)?).save(&path)?;
                }
            }
            Map::MetallicSmoothness => {
                write(ChannelMap::Metallic)?;
                let metallic = Image::load(&path)?;
                write(ChannelMap::Roughness)?;
                metallic_smoothness(&metallic, &Image::load(&path)?).save(&path)?;
            }
        }
        names.push(name);
    }
    Ok(names)
}

/// With the green of 8-bit texels turned over.
fn turned_over(mut image: Image) -> Image {
    let channels = image.channels as usize;
    if let Samples::U8(samples) = &mut image.samples {
        samples.chunks_exact_mut(channels).for_each(|texel| texel[1] = 255 - texel[1]);
    }
    image
}

fn metallic_smoothness(metallic: &Image, roughness: &Image) -> Image {
    let samples = |image: &Image| -> Vec<u8> {
        let channels = image.channels as usize;
        match &image.samples {
            Samples::U8(samples) => samples.chunks_exact(channels).map(|texel| texel[0]).collect(),
            _ => Vec::new(),
        }
    };
    let texels = samples(metallic).into_iter().zip(samples(roughness));
    let samples = Samples::U8(texels.flat_map(|(m, r)| [m, m, m, 255 - r]).collect());
    let Image { width, height, .. } = *metallic;
    Image { width, height, channels: 4, space: ColorSpace::Linear, samples }
}
