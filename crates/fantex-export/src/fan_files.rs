//! Fans in other programs' files: glTF with four sets of coordinates, USD and MaterialX with the texture function as a graph.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::files::folder_of;
use fantex_base::{Error, Result};
use fantex_mesh::{Material, Mesh};
use fantex_store::Asset;
use glam::Vec2;

use crate::ShaderLanguage;
use crate::export::{ExportSummary, Map, cancelled, file_stem, told};
use crate::fans::{DrawnMap, FanSheetOptions, FanSheets, Packer, SampleKind, SheetMap, depth_of};
use crate::materialx::materialx;
use crate::model_file::{Document, Geometry, Gltf, Outputs, extension, translation_of};
use crate::pictures::{Ktx2Sink, Packing, PngSink, values_of_halves, write_exr};
use crate::texels::RowSink as _;
use crate::usd::{check_file_name, write_usda, write_usda_objects};

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
    /// Fail, and write nothing, where coarser texels stand in for damaged ones.
    pub strict: bool,
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
    /// The extensions of the files beside a model, which holds PNG itself where it is a `.glb`.
    fn extensions(self, is_binary: bool) -> Vec<&'static str> {
        let png = (self != Self::Exr && !is_binary).then_some("png");
        let other = match self {
            Self::Png => None,
            Self::PngAndKtx2 => Some("ktx2"),
            Self::PngAndExr | Self::Exr => Some("exr"),
        };
        png.into_iter().chain(other).collect()
    }

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
    let mut file = FanFile::new(output, None, options)?;
    let mut summary = file.add(asset, None, progress)?;
    summary.check_damage(options.strict)?;
    summary.files = file.finish()?;
    Ok(summary)
}

/// A model with fans on its way.
pub(crate) struct FanFile<'a> {
    output: &'a Path,
    options: &'a FanFileOptions,
    /// None for USD, where each asset has a file.
    gltf: Option<Gltf>,
    outputs: Outputs,
    /// The node above all objects, and names and USD files of those that were added; none for a single asset.
    root: Option<(String, Vec<[String; 2]>)>,
    /// Shaders, and where they are written.
    shaders: BTreeMap<PathBuf, String>,
}

impl<'a> FanFile<'a> {
    /// Nothing yet. With `root`, objects are added below a node of that name.
    ///
    /// # Errors
    /// The output's extension is none that exists, or does not go with the options.
    pub(crate) fn new(output: &'a Path, root: Option<&str>, options: &'a FanFileOptions) -> Result<Self> {
        let gltf = Gltf::new(output, root);
        let is_usd = extension(output) == "usda";
        if !is_usd && gltf.is_none() {
            let path = output.display();
            let message = format!("fans are written as .glb, .gltf or .usda, and {path} is none of them");
            return Err(Error::invalid(message).with_path(output));
        }
        if !is_usd && options.pictures == SheetPictures::Exr {
            let message =
                "glTF refers to PNG; have OpenEXR files written beside it (png+exr), or write a .usda";
            return Err(Error::invalid(message).with_path(output));
        }
        if root.is_some() && !options.shaders.is_empty() {
            let message =
                "a shader is written for one asset's materials and blend band; export a single asset for it";
            return Err(Error::invalid(message).with_path(output));
        }
        let outputs = Outputs::new(options.force);
        outputs.check(output)?;
        gltf.as_ref().and_then(Gltf::buffer_file).map_or(Ok(()), |path| outputs.check(&path))?;
        Ok(Self {
            output,
            options,
            gltf,
            outputs,
            root: root.map(|root| (root.to_owned(), Vec::new())),
            shaders: BTreeMap::new(),
        })
    }

    /// Adds an asset, as an object of this name where there is one. The summary lacks the files.
    pub(crate) fn add(
        &mut self,
        asset: &Arc<Asset>,
        object: Option<&str>,
        progress: &dyn Progress,
    ) -> Result<ExportSummary> {
        let (options, mesh) = (self.options, asset.mesh());
        let stem = file_stem(self.output, object);
        if self.gltf.is_none() {
            check_file_name(&stem).map_err(|error| error.with_path(self.output))?;
        }
        let packer = Packer::new(asset, &options.sheets, progress)?;
        let kinds = options.pictures.kinds();
        let bytes = |(sheet, map)| kinds.iter().map(move |&kind| (sheet, map, kind));
        let bytes = packer.pictures().flat_map(bytes).map(|(s, m, kind)| packer.picture_bytes(s, m, kind));
        packer.check_memory(bytes.max().unwrap_or(0))?;
        let sheets = packer.described();
        let sheet = |t: usize| sheets.sheet_of_triangle[t] as usize;
        let looks: BTreeSet<_> = (0..mesh.triangles.len()).map(|t| (mesh.material_of(t), sheet(t))).collect();
        self.shaders = shader_files(&sheets, &looks, &mesh.materials, self.output, &options.shaders);
        self.check_files(&stem, &sheets, object)?;
        let mut files = SheetFiles {
            packer: &packer,
            sheets: &sheets,
            stem: &stem,
            output: self.output,
            is_binary: self.gltf.as_ref().is_some_and(Gltf::is_binary),
            pictures: options.pictures,
            outputs: &mut self.outputs,
            progress,
            images: Vec::new(),
        };
        packer.draw(kinds, progress, &mut |drawn| files.write(&drawn))?;
        check_wanted(progress)?;
        let images = files.images;
        let uv = |corner: usize| {
            let (t, k) = (corner / 3, corner % 3);
            let [a, b, c] = [0, 1, 2].map(|slot: usize| sheets.uv[t][slot][k]);
            [a, b, c, [Vec2::X, Vec2::Y, Vec2::ZERO][k]]
        };
        let translation = translation_of(mesh, object.is_some());
        let geometry = Geometry::new(mesh, translation, &packer.shapes.normals, &[], uv, sheet);
        check_wanted(progress)?;
        match &mut self.gltf {
            Some(gltf) => {
                let document = Document {
                    name: object.unwrap_or(&stem),
                    parts: &mesh.parts.names,
                    geometry: &geometry,
                    materials: &mesh.materials,
                    maps: &packer.maps,
                    repeats: false,
                    delta: Some(sheets.delta),
                };
                gltf.add(&document, images, &mut self.outputs)?;
            }
            None => self.add_usd(mesh, &sheets, &geometry, object)?,
        }
        let texels =
            sheets.sheets.iter().map(|sheet| u64::from(sheet.size[0]) * u64::from(sheet.size[1])).sum();
        Ok(ExportSummary {
            sizes: sheets.sheets.iter().map(|sheet| sheet.size).collect(),
            maps: sheets.maps.iter().map(|map| map.map).collect(),
            charts: asset.cover().groups.len(),
            padding: options.sheets.gutter,
            used_share: sheets.used_share,
            density_share: 1.0,
            points: 0,
            texels,
            triangles: mesh.triangles.len() as u64,
            vertices: geometry.positions.len(),
            left_out: packer.left_out(),
            cut_off: if kinds.contains(&SampleKind::Fixed) { packer.cut_off.clone() } else { Vec::new() },
            damage: told(&packer.cache.damage()),
            ..ExportSummary::default()
        })
    }

    /// Refuses files that exist, before anything is drawn.
    fn check_files(&self, stem: &str, sheets: &FanSheets, object: Option<&str>) -> Result<()> {
        let is_binary = self.gltf.as_ref().is_some_and(Gltf::is_binary);
        let extensions = self.options.pictures.extensions(is_binary);
        let mut names = Vec::new();
        for (sheet, map) in (0..sheets.sheets.len()).flat_map(|s| sheets.maps.iter().map(move |m| (s, m))) {
            let name = picture_name(stem, sheets, sheet, map);
            names.extend(extensions.iter().map(|extension| format!("{name}.{extension}")));
        }
        if self.gltf.is_none() {
            names.push(format!("{stem}.mtlx"));
            names.extend(object.map(|_| format!("{stem}.usda")));
        }
        let beside = names.into_iter().map(|name| self.output.with_file_name(name));
        beside.chain(self.shaders.keys().cloned()).try_for_each(|path| self.outputs.check(&path))
    }

    /// The files of an asset for USD: the output itself, or of an object one beside it.
    fn add_usd(
        &mut self,
        mesh: &Mesh,
        sheets: &FanSheets,
        geometry: &Geometry,
        object: Option<&str>,
    ) -> Result<()> {
        let stem = file_stem(self.output, object);
        let file_name = format!("{stem}.usda");
        let path = self.output.with_file_name(format!("{stem}.mtlx"));
        let mut file = self.outputs.create(&path)?;
        let is_exr = self.options.pictures == SheetPictures::Exr;
        let pictures = PictureFiles { stem: &stem, sheets, is_exr };
        let text = materialx(&pictures, geometry, &mesh.materials);
        file.write_all(text.as_bytes()).map_err(|e| Error::writing(&path, e))?;
        let path = match object {
            Some(_) => self.output.with_file_name(&file_name),
            None => self.output.to_owned(),
        };
        let file = self.outputs.create(&path)?;
        write_usda(mesh, &pictures, geometry, &file).map_err(|e| Error::writing(&path, e))?;
        if let (Some((_, objects)), Some(object)) = (&mut self.root, object) {
            objects.push([object.to_owned(), file_name]);
        }
        Ok(())
    }

    /// Gives all files their names; returns these with lengths in bytes.
    pub(crate) fn finish(mut self) -> Result<Vec<(PathBuf, u64)>> {
        match (self.gltf, &self.root) {
            (Some(gltf), _) => gltf.finish(&mut self.outputs)?,
            (None, Some((root, objects))) => {
                let file = self.outputs.create(self.output)?;
                write_usda_objects(root, objects, &file).map_err(|e| Error::writing(self.output, e))?;
            }
            (None, None) => {}
        }
        for (path, text) in self.shaders {
            let mut file = self.outputs.create(&path)?;
            file.write_all(text.as_bytes()).map_err(|e| Error::writing(&path, e))?;
        }
        self.outputs.commit()
    }
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
    outputs: &'a mut Outputs,
    progress: &'a dyn Progress,
    /// Names without extensions of the pictures that a glTF refers to, and files of those that go into it.
    images: Vec<(String, Option<File>)>,
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
            let file = self.outputs.create(&path)?;
            return write_exr(&file, &path, size, map, &drawn.samples);
        }
        let path = path("ktx2");
        let file = self.outputs.create(&path)?;
        let mut ktx2 = Ktx2Sink::new(file, &path, size, map, Packing::of_sheet(map))?;
        let row_bytes = 2 * map.components.count() * size[0] as usize;
        for rows in drawn.samples.chunks(64 * row_bytes) {
            check_wanted(self.progress)?;
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
            false => self.outputs.create(&path)?,
        };
        let copy = || file.try_clone().map_err(|e| Error::writing(&path, e));
        let inside = if self.is_binary { Some(copy()?) } else { None };
        let named = if self.is_binary { self.output } else { &path };
        let mut png = PngSink::new(file, named.into(), size, *map, depth_of(map))?;
        for part in samples.chunks(PART_BYTES) {
            check_wanted(self.progress)?;
            png.write_samples(part)?;
        }
        self.images.push((name, inside));
        png.finish()
    }
}

/// Bytes that are compressed between two looks at whether the export is still wanted.
const PART_BYTES: usize = 1 << 20;

fn check_wanted(progress: &dyn Progress) -> Result<()> {
    if progress.is_cancelled() { Err(cancelled()) } else { Ok(()) }
}

/// Shaders, and what their files are called: functions are the same for all materials, a shader for Godot is one material's. `looks` are the
/// materials and sheets that have triangles together, ascending, as the materials of a glTF are numbered.
fn shader_files(
    sheets: &FanSheets,
    looks: &BTreeSet<(usize, usize)>,
    materials: &[Material],
    output: &Path,
    languages: &[ShaderLanguage],
) -> BTreeMap<PathBuf, String> {
    let default_material = Material::default();
    let mut files = BTreeMap::new();
    for language in languages {
        let path = output.with_extension(language.extension());
        let is_shared = *language != ShaderLanguage::Godot || looks.len() < 2;
        for (number, &(material, _)) in (1..).zip(looks.iter().take(if is_shared { 1 } else { looks.len() }))
        {
            let text = sheets.shader(*language, materials.get(material).unwrap_or(&default_material));
            let stem = output.file_stem().unwrap_or_default().to_string_lossy();
            let numbered = format!("{stem}-material-{number}.{}", language.extension());
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
