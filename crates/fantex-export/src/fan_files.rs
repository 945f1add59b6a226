//! Fans in other programs' files: glTF with four sets of coordinates, USD and MaterialX with the texture function as a graph.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::files::folder_of;
use fantex_base::{Error, Result};
use fantex_mesh::Material;
use fantex_store::Asset;
use glam::Vec2;

use crate::ShaderLanguage;
use crate::export::{ExportSummary, Map, damage_of, write_model};
use crate::fans::{DrawnMap, FanSheetOptions, FanSheets, Packer, SampleKind, SheetMap, depth_of};
use crate::materialx::materialx;
use crate::model_file::{Document, Geometry, Outputs};
use crate::pictures::{Ktx2Sink, Packing, PngSink, values_of_halves, write_exr};
use crate::texels::RowSink as _;
use crate::usd::write_usda;

/// How files with fans are written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FanFileOptions {
    /// How sheets are made.
    pub sheets: FanSheetOptions,
    /// Which files sheets become.
    pub pictures: SheetPictures,
    /// Shaders that are written beside the model, named after it.
    pub shaders: Vec<ShaderLanguage>,
    /// Overwrite existing files.
    pub force: bool,
}

/// The files that sheets become.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SheetPictures {
    /// PNG, 8 bits per sample, 16 for normals.
    #[default]
    Png,
    /// PNG, and KTX2 beside the model: BC7, normals and light maps in half floats, all levels.
    PngAndKtx2,
    /// PNG, and OpenEXR beside the model: linear half floats.
    PngAndExr,
    /// OpenEXR alone; glTF knows none.
    Exr,
}

impl SheetPictures {
    fn kinds(self) -> &'static [SampleKind] {
        match self {
            Self::Png => &[SampleKind::Fixed],
            Self::PngAndKtx2 | Self::PngAndExr => &[SampleKind::Fixed, SampleKind::Half],
            Self::Exr => &[SampleKind::Half],
        }
    }
}

/// Writes an asset with its fans: a `.glb` with sheets inside, a `.gltf` with its buffer and sheets beside it, or a `.usda` with a
/// MaterialX file and sheets beside it. All files appear at the end, or none.
///
/// Vertices are split by corners. `TEXCOORD_0` to `2` (in USD `st`, `st1`, `st2`, v upwards) are a corner's places in the tiles of the
/// fans at its triangle's corners 0, 1 and 2; the first two barycentric coordinates are `TEXCOORD_3` (`st3`). Programs that know no fans
/// show each triangle of a glTF by the tile of its first corner.
///
/// # Errors
/// Those of [`fan_sheets`](crate::fan_sheets), with one picture in memory at a time; the output's extension is none of these, a file
/// exists, or it cannot be written.
pub fn export_fans(
    asset: &Arc<Asset>,
    output: &Path,
    options: &FanFileOptions,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    let extension = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if !["glb", "gltf", "usda"].contains(&extension.as_str()) {
        let path = output.display();
        let message = format!("fans are written as .glb, .gltf or .usda, and {path} is none of them");
        return Err(Error::invalid(message).with_path(output));
    }
    let is_binary = extension == "glb";
    if extension != "usda" && options.pictures == SheetPictures::Exr {
        let message = "glTF refers to PNG; have OpenEXR files written beside it (png+exr), or write a .usda";
        return Err(Error::invalid(message).with_path(output));
    }
    let mesh = asset.mesh();
    let packer = Packer::new(asset, &options.sheets)?;
    let kinds = options.pictures.kinds();
    let bytes = |(sheet, map)| kinds.iter().map(move |&kind| (sheet, map, kind));
    let bytes = packer.pictures().flat_map(bytes).map(|(s, m, kind)| packer.picture_bytes(s, m, kind));
    packer.check_memory(bytes.max().unwrap_or(0))?;
    let sheets = packer.described();
    let stem = output.file_stem().map_or_else(|| "model".to_owned(), |s| s.to_string_lossy().into_owned());
    let mut files = SheetFiles {
        packer: &packer,
        sheets: &sheets,
        stem: &stem,
        output,
        is_binary,
        pictures: options.pictures,
        outputs: Outputs::new(options.force),
        images: Vec::new(),
    };
    packer.draw(kinds, progress, &mut |drawn| files.write(&drawn))?;
    let SheetFiles { mut outputs, images, .. } = files;
    let uv = |corner: usize| {
        let (t, k) = (corner / 3, corner % 3);
        let [a, b, c] = [0, 1, 2].map(|slot: usize| sheets.uv[t][slot][k]);
        [a, b, c, [Vec2::X, Vec2::Y, Vec2::ZERO][k]]
    };
    let sheet = |t: usize| sheets.sheet_of_triangle[t] as usize;
    let geometry = Geometry::new(mesh, &packer.shapes.normals, &[], uv, sheet);
    if extension != "usda" {
        let document = Document {
            name: &stem,
            parts: &mesh.parts.names,
            geometry: &geometry,
            materials: &mesh.materials,
            maps: &packer.maps,
            repeats: false,
            delta: Some(sheets.delta),
        };
        write_model(&document, images, is_binary, output, &mut outputs)?;
    } else {
        let path = output.with_extension("mtlx");
        let (mut file, _) = outputs.create(&path)?;
        let pictures =
            PictureFiles { stem: &stem, sheets: &sheets, is_exr: options.pictures == SheetPictures::Exr };
        let text = materialx(&pictures, &geometry, &mesh.materials);
        file.write_all(text.as_bytes()).map_err(|e| Error::writing(&path, e))?;
        let (file, _) = outputs.create(output)?;
        write_usda(mesh, &pictures, &geometry, &file).map_err(|e| Error::writing(output, e))?;
    }
    for (path, text) in shader_files(&sheets, &geometry, &mesh.materials, output, &options.shaders) {
        let (mut file, _) = outputs.create(&path)?;
        file.write_all(text.as_bytes()).map_err(|e| Error::writing(&path, e))?;
    }
    let texels = sheets.sheets.iter().map(|sheet| u64::from(sheet.size[0]) * u64::from(sheet.size[1])).sum();
    Ok(ExportSummary {
        files: outputs.commit()?,
        sizes: sheets.sheets.iter().map(|sheet| sheet.size).collect(),
        maps: sheets.maps.iter().map(|map| map.map).collect(),
        charts: asset.cover().groups.len(),
        padding: options.sheets.gutter,
        used_share: sheets.used_share,
        density_share: 1.0,
        points: 0,
        texels,
        vertices: geometry.positions.len(),
        damage: damage_of(&packer.cache),
        ..ExportSummary::default()
    })
}

/// The files of the sheets on their way.
struct SheetFiles<'a> {
    packer: &'a Packer<'a>,
    sheets: &'a FanSheets,
    stem: &'a str,
    output: &'a Path,
    /// Whether PNG goes into the model.
    is_binary: bool,
    pictures: SheetPictures,
    outputs: Outputs,
    /// Names without extensions, and files, of the pictures that a glTF refers to.
    images: Vec<(String, File)>,
}

impl SheetFiles<'_> {
    fn write(&mut self, drawn: &DrawnMap) -> Result<()> {
        let (map, size) = (&self.packer.maps[drawn.map], self.sheets.sheets[drawn.sheet].size);
        let name = picture_name(self.stem, self.sheets, drawn.sheet, &self.sheets.maps[drawn.map]);
        let path = |extension: &str| self.output.with_file_name(format!("{name}.{extension}"));
        if drawn.kind == SampleKind::Fixed {
            return self.write_png(name, map, size, &drawn.samples);
        }
        if self.pictures != SheetPictures::PngAndKtx2 {
            let path = path("exr");
            let (file, _) = self.outputs.create(&path)?;
            return write_exr(&file, &path, size, map, &drawn.samples);
        }
        let path = path("ktx2");
        let (file, _) = self.outputs.create(&path)?;
        let mut ktx2 = Ktx2Sink::new(file, &path, size, map, Packing::of_sheet(map))?;
        let row_bytes = 2 * map.components.count() * size[0] as usize;
        for rows in drawn.samples.chunks(64 * row_bytes) {
            ktx2.rows(&values_of_halves(rows, map.components))?;
        }
        ktx2.finish()
    }

    fn write_png(&mut self, name: String, map: &Map, size: [u32; 2], samples: &[u8]) -> Result<()> {
        let path = self.output.with_file_name(format!("{name}.png"));
        let file = match self.is_binary {
            true => {
                let unnamed = tempfile::tempfile_in(folder_of(self.output));
                unnamed.map_err(|e| Error::writing(self.output, e))?
            }
            false => self.outputs.create(&path)?.0,
        };
        let copy = file.try_clone().map_err(|e| Error::writing(&path, e))?;
        let named = if self.is_binary { self.output } else { &path };
        let mut png = PngSink::new(copy, named.into(), size, *map, depth_of(map))?;
        png.write_samples(samples)?;
        self.images.push((name, file));
        png.finish()
    }
}

/// Shaders, and what their files are called: functions are the same for all materials, a shader for Godot is one material's.
fn shader_files(
    sheets: &FanSheets,
    geometry: &Geometry,
    materials: &[Material],
    output: &Path,
    languages: &[ShaderLanguage],
) -> BTreeMap<PathBuf, String> {
    let used: BTreeSet<usize> = geometry.looks().into_iter().map(|(material, _)| material).collect();
    let default_material = Material::default();
    let mut files = BTreeMap::new();
    for language in languages {
        let path = output.with_extension(language.extension());
        let is_shared = *language != ShaderLanguage::Godot || used.len() < 2;
        for &material in used.iter().take(if is_shared { 1 } else { used.len() }) {
            let text = sheets.shader(*language, materials.get(material).unwrap_or(&default_material));
            let stem = output.file_stem().unwrap_or_default().to_string_lossy();
            let numbered = format!("{stem}-material-{}.{}", material + 1, language.extension());
            files.insert(if is_shared { path.clone() } else { output.with_file_name(numbered) }, text);
        }
    }
    files
}

/// The pictures that a graph of nodes refers to.
pub(crate) struct PictureFiles<'a> {
    pub(crate) stem: &'a str,
    pub(crate) sheets: &'a FanSheets,
    /// Linear, unscaled numbers in OpenEXR files; else PNG.
    pub(crate) is_exr: bool,
}

impl PictureFiles<'_> {
    pub(crate) fn file(&self, sheet: usize, map: &SheetMap) -> String {
        let extension = if self.is_exr { "exr" } else { "png" };
        format!("{}.{extension}", picture_name(self.stem, self.sheets, sheet, map))
    }

    /// What a look-up is multiplied by.
    pub(crate) fn scale(&self, map: &SheetMap) -> f32 {
        if self.is_exr { 1.0 } else { map.scale }
    }

    /// The colour space of pictures with colours.
    pub(crate) fn color_space(&self) -> &'static str {
        if self.is_exr { "lin_rec709" } else { "srgb_texture" }
    }
}

/// The name of a sheet's picture, without its extension.
fn picture_name(stem: &str, sheets: &FanSheets, sheet: usize, map: &SheetMap) -> String {
    let number = if sheets.sheets.len() > 1 { format!("-{}", sheet + 1) } else { String::new() };
    format!("{stem}-fans-{}{number}", map.map.name())
}
