//! The two exports: a model with all its pictures, and one picture.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::{Progress, Source};
use fantex_base::files::folder_of;
use fantex_base::{Error, Result, counted};
use fantex_mesh::{AlphaMode, Material, Mesh, corner_tangents, shading_normals};
use fantex_store::{Asset, ChannelKind, Damage, PageCache, TexelFormat, TileId, TileSource, TileTexels};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::asset_surface::AssetSurface;
use crate::layout::{AtlasRequest, Layout, atlas};
use crate::model_file::{Document, Geometry, Gltf, Outputs, extension, stem_of, translation_of};
use crate::model_uv::{model_uv, uv_of_asset, uv_of_model};
use crate::pictures::{Depth, FloatSink, Ktx2Sink, Packing, PngSink};
use crate::source_surface::SourceSurface;
use crate::surface::{Frames, Surface};
use crate::texels::{RowSink, largest, make_page};

/// What was exported.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExportSummary {
    /// The files, and their lengths in bytes.
    pub files: Vec<(PathBuf, u64)>,
    /// Columns and rows of the pictures of each page or sheet; the model's coordinates may need one page per material.
    pub sizes: Vec<[u32; 2]>,
    /// What the pictures show.
    pub maps: Vec<ChannelMap>,
    /// Pieces of an own packing; 0 for the model's coordinates.
    pub charts: usize,
    /// Texels around the pieces of an own packing.
    pub padding: u32,
    /// Share of the texels that lie on the surface.
    pub used_share: f64,
    /// Share of those that several triangles claim: coordinates of a model that overlap.
    pub overlapping_share: f64,
    /// Texels per mesh unit, relative to the asset's, or to what was asked for.
    pub density_share: f64,
    /// Triangles that a model's coordinates give no area, as where they point into a palette: each shows one colour.
    pub points: usize,
    /// Texels of all pictures of one map.
    pub texels: u64,
    /// Triangles of the asset, or of all assets.
    pub triangles: u64,
    /// Vertices of the model; 0 for a single picture.
    pub vertices: usize,
    /// Channels that the model has no place for.
    pub left_out: Vec<ChannelKind>,
    /// Light that is brighter than 1 and cut off there, as PNG holds no more: what, and its largest number.
    pub cut_off: Vec<(ChannelMap, f32)>,
    /// Pages of the asset that could not be read and were replaced by coarser ones; the first, with its reason.
    pub damage: Option<(u64, String)>,
}

impl ExportSummary {
    /// Refuses what coarser texels stand in for, where that is asked for.
    pub(crate) fn check_damage(&self, is_strict: bool) -> Result<()> {
        match &self.damage {
            Some((pages, first)) if is_strict => Err(Error::damaged(format!(
                "coarser texels stand in for {}; the first: {first}",
                counted(*pages, "damaged tile")
            ))),
            _ => Ok(()),
        }
    }
}

/// Refuses, before there is anything to write, what [`export_model`] would refuse of its output and its options.
///
/// # Errors
/// As there.
pub fn check_export(output: &Path, options: &ExportOptions<'_>) -> Result<()> {
    options.check()?;
    ModelFile::new(output, None, options).map(|_| ())
}

/// What a glTF material can show, in the order of the pictures.
pub(crate) const MODEL_MAPS: [ChannelMap; 4] =
    [ChannelMap::BaseColor, ChannelMap::OcclusionRoughnessMetallic, ChannelMap::Normal, ChannelMap::Emission];

/// Writes an asset as a model with texture coordinates: `.glb` with its pictures inside, or `.gltf` with a `.bin` and PNG
/// files beside it. All files appear at the end, or none.
///
/// # Errors
/// The options or the output's extension are none that exist, the model's coordinates are missing or do not fit, the output
/// exists, or it cannot be written. The kind is [`Cancelled`](fantex_base::ErrorKind::Cancelled) where `progress` asked to stop.
pub fn export_model(
    asset: &Arc<Asset>,
    output: &Path,
    options: &ExportOptions<'_>,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    export_surface(&AssetSurface::new(asset, options), output, options, progress)
}

/// Writes a mesh and a source on it as [`export_model`] writes an asset, without one between. `texels_per_unit`: wanted per mesh unit of
/// length; what decides where the options have no side.
///
/// # Errors
/// As [`export_model`]. Sources that [bake light](Source::light_map) need an asset.
pub fn export_source(
    mesh: &Mesh,
    source: &dyn Source,
    texels_per_unit: f32,
    output: &Path,
    options: &ExportOptions<'_>,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    if source.channels().is_empty() {
        return Err(Error::invalid("the source has no channel to bake"));
    }
    if source.light_map().is_some() {
        return Err(Error::unsupported(
            "light is baked into assets; export the asset that it was baked into",
        ));
    }
    export_surface(&SourceSurface::new(mesh, source, texels_per_unit), output, options, progress)
}

fn export_surface(
    surface: &dyn Surface,
    output: &Path,
    options: &ExportOptions<'_>,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    options.check()?;
    let mut model = ModelFile::new(output, None, options)?;
    let mut summary = model.add(surface, None, progress)?;
    summary.check_damage(options.strict)?;
    summary.files = model.finish()?;
    Ok(summary)
}

/// A model with texture coordinates on its way.
pub(crate) struct ModelFile<'a> {
    output: &'a Path,
    options: &'a ExportOptions<'a>,
    gltf: Gltf,
    outputs: Outputs,
}

impl<'a> ModelFile<'a> {
    /// Nothing yet. With `root`, objects are added below a node of that name.
    ///
    /// # Errors
    /// The output's extension is none that exists; the output exists.
    pub(crate) fn new(output: &'a Path, root: Option<&str>, options: &'a ExportOptions<'a>) -> Result<Self> {
        let gltf = Gltf::new(output, root).ok_or_else(|| unknown_kind(output, "a model", ".glb or .gltf"))?;
        let outputs = Outputs::new(options.force);
        outputs.check(output)?;
        if !gltf.is_binary() {
            outputs.check(&output.with_extension("bin"))?;
        }
        Ok(Self { output, options, gltf, outputs })
    }

    /// Adds a surface, as an object of this name where there is one. The summary lacks the files.
    pub(crate) fn add(
        &mut self,
        surface: &dyn Surface,
        object: Option<&str>,
        progress: &dyn Progress,
    ) -> Result<ExportSummary> {
        let job = Job::new(surface, self.options, progress)?;
        let maps = job.model_maps(progress);
        let (stem, is_binary) = (file_stem(self.output, object), self.gltf.is_binary());
        let pages = job.layout.pages.len();
        let name = |page: usize, map: &Map| {
            let number = if pages > 1 { format!("-{}", page + 1) } else { String::new() };
            format!("{stem}-{}{number}", map.kind.name())
        };
        let beside = [("png", !is_binary), ("ktx2", self.options.with_ktx2)];
        for (page, map) in (0..pages).flat_map(|page| maps.iter().map(move |map| (page, map))) {
            let written = beside.iter().filter(|(_, is_written)| *is_written);
            let path = |extension| self.output.with_file_name(format!("{}.{extension}", name(page, map)));
            written.map(|(extension, _)| path(extension)).try_for_each(|path| self.outputs.check(&path))?;
        }
        let mut images = Vec::new();
        let sinks = (0..pages).map(|page| {
            let sink = |map| {
                let name = name(page, map);
                let (sink, file) = job.image(page, map, &name, is_binary, self.output, &mut self.outputs)?;
                images.push((name, file));
                Ok(sink)
            };
            maps.iter().map(sink).collect()
        });
        let tangents = job.tangents(&maps);
        let mut summary = job.run(&maps, &tangents, sinks, progress)?;
        let (mesh, layout) = (surface.mesh(), &job.layout);
        let page =
            |t: usize| layout.page_of_material.get(mesh.material_of(t)).copied().flatten().unwrap_or(0);
        let uv = |corner: usize| [layout.uv[corner / 3][corner % 3]];
        let translation = translation_of(mesh, object.is_some());
        let geometry = Geometry::new(mesh, translation, &job.normals, &tangents, uv, page);
        let document = Document {
            name: object.unwrap_or(&stem),
            parts: &mesh.parts.names,
            geometry: &geometry,
            materials: &mesh.materials,
            maps: &maps,
            repeats: layout.repeats,
            delta: None,
        };
        self.gltf.add(&document, images, &mut self.outputs)?;
        summary.vertices = geometry.positions.len();
        let is_shown = |kind: ChannelKind| maps.iter().any(|m| m.kind.channel() == kind);
        summary.left_out = surface.channels().into_iter().filter(|&k| !is_shown(k)).collect();
        Ok(summary)
    }

    /// Gives all files their names; returns these with lengths in bytes.
    pub(crate) fn finish(mut self) -> Result<Vec<(PathBuf, u64)>> {
        self.gltf.finish(&mut self.outputs)?;
        self.outputs.commit()
    }
}

/// What the names of a model's files begin with, or of those of one of its objects.
pub(crate) fn file_stem(output: &Path, object: Option<&str>) -> String {
    let stem = stem_of(output);
    object.map_or(stem.clone(), |object| format!("{stem}-{object}"))
}

/// Writes channels of an asset, laid out as [`export_model`] does, each to a file of its own: `.png` (of `depth`), `.exr` or `.ktx2`. All
/// files appear at the end, or none.
///
/// # Errors
/// As [`export_model`]; the asset may lack a channel, one may be named twice, or the pictures need more memory than is allowed.
pub fn export_channels(
    asset: &Arc<Asset>,
    channels: &[(ChannelMap, &Path)],
    depth: Depth,
    options: &ExportOptions<'_>,
    progress: &dyn Progress,
) -> Result<ExportSummary> {
    options.check()?;
    let mut outputs = Outputs::new(options.force);
    let mut maps = Vec::with_capacity(channels.len());
    for (index, &(kind, output)) in channels.iter().enumerate() {
        if !["png", "exr", "ktx2"].contains(&extension(output).as_str()) {
            return Err(unknown_kind(output, "a channel", ".png, .exr or .ktx2"));
        }
        outputs.check(output)?;
        if channels[..index].iter().any(|(earlier, _)| *earlier == kind) {
            return Err(Error::invalid(format!("the channel {} is named twice; name it once", kind.name())));
        }
        maps.push(Map::of(asset, kind).ok_or_else(|| no_channel(asset, kind))?);
    }
    let surface = AssetSurface::new(asset, options);
    let job = Job::new(&surface, options, progress)?;
    let [page] = &job.layout.pages[..] else {
        let message = format!(
            "the model's coordinates need {} pictures, one per material, and a single file holds one; use an own packing or write \
             a .gltf",
            job.layout.pages.len()
        );
        return Err(Error::unsupported(message));
    };
    let floats = channels.iter().zip(&maps).filter(|((_, output), _)| extension(output) == "exr");
    let needed: u64 = floats.clone().map(|(_, map)| FloatSink::memory_bytes(page.side, map)).sum();
    if needed > options.memory_bytes
        && let Some(((_, output), _)) = floats.clone().next()
    {
        let message = format!(
            "{} needs {needed} bytes at once, but --memory allows {}; use .png or .ktx2, a smaller --size, or more --memory",
            output.display(),
            options.memory_bytes
        );
        return Err(Error::too_large(message).with_path(output));
    }
    let mut sinks: Vec<Box<dyn RowSink>> = Vec::with_capacity(maps.len());
    let mut cut_off = Vec::new();
    for (&(kind, output), map) in channels.iter().zip(&maps) {
        let extension = extension(output);
        let largest = if extension == "exr" { 1.0 } else { surface.brightest(map, progress) };
        if extension == "png" && largest > 1.0 {
            cut_off.push((kind, largest));
        }
        let file = outputs.create(output)?;
        sinks.push(match extension.as_str() {
            "png" => Box::new(PngSink::new(file, output.into(), [page.side; 2], *map, depth)?),
            "ktx2" => {
                let packing = Packing::of_single(map, largest);
                Box::new(Ktx2Sink::new(file, output, [page.side; 2], map, packing)?)
            }
            _ => Box::new(FloatSink::new(file, output.into(), page.side, map)),
        });
    }
    let mut summary = job.run(&maps, &job.tangents(&maps), [Ok(sinks)], progress)?;
    summary.check_damage(options.strict)?;
    summary.cut_off = cut_off;
    summary.files = outputs.commit()?;
    Ok(summary)
}

pub(crate) struct Job<'a> {
    surface: &'a dyn Surface,
    options: &'a ExportOptions<'a>,
    pub(crate) layout: Layout,
    /// Unit normals, one per corner.
    normals: Vec<Vec3>,
}

impl<'a> Job<'a> {
    pub(crate) fn new(
        surface: &'a dyn Surface,
        options: &'a ExportOptions<'a>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let (mesh, texels_per_unit) = (surface.mesh(), surface.texels_per_unit());
        let (side, largest_side) = (options.side, options.largest_side);
        let with_uv = |uv| model_uv(mesh, uv, texels_per_unit, side, largest_side);
        let layout = || match options.uv {
            UvChoice::OfAsset => with_uv(uv_of_asset(mesh)?),
            UvChoice::OfModel(model) => with_uv(uv_of_model(mesh, model)?),
            UvChoice::Atlas => {
                let request = AtlasRequest {
                    texels_per_unit,
                    texels: options.texels,
                    side,
                    largest_side,
                    padding: options.padding,
                };
                atlas(mesh, &request, progress)
            }
        };
        // Steps of the layout run on one thread.
        let (layout, normals) = rayon::join(layout, || shading_normals(mesh));
        Ok(Self { surface, options, layout: layout?, normals })
    }

    /// The maps of a model, scaled to what pictures hold; to anything once `progress` is cancelled.
    pub(crate) fn model_maps(&self, progress: &dyn Progress) -> Vec<Map> {
        let scaled = |map: Map| {
            let frames = Frames { normals: &self.normals, tangents: &[] };
            let found = || {
                let of_page = |page| largest(page, &map, (self.surface, &frames), progress);
                self.layout.pages.iter().map(of_page).fold(1.0, f32::max)
            };
            map.scaled(self.surface.largest(&map, progress).unwrap_or_else(found))
        };
        MODEL_MAPS.into_iter().filter_map(|kind| self.surface.map(kind)).map(scaled).collect()
    }

    /// Tangents of the layout's coordinates, one per corner; none where no map needs them.
    pub(crate) fn tangents(&self, maps: &[Map]) -> Vec<Vec4> {
        if !maps.iter().any(Map::has_normals) {
            return Vec::new();
        }
        corner_tangents(self.surface.mesh(), &self.normals, |t| Some(self.layout.uv[t]))
    }

    /// The sink of a model's picture, and its PNG file where that goes into the model.
    fn image(
        &self,
        page: usize,
        map: &Map,
        name: &str,
        is_binary: bool,
        output: &Path,
        outputs: &mut Outputs,
    ) -> Result<(Box<dyn RowSink>, Option<File>)> {
        let side = self.layout.pages[page].side;
        let path = output.with_file_name(format!("{name}.png"));
        let failed = |source| Error::writing(output, source);
        let file = match is_binary {
            true => tempfile::tempfile_in(folder_of(output)).map_err(failed)?,
            false => outputs.create(&path)?,
        };
        let inside = if is_binary { Some(file.try_clone().map_err(failed)?) } else { None };
        let named = if is_binary { output } else { &path };
        let png = PngSink::new(file, named.into(), [side; 2], *map, Depth::Eight)?;
        if !self.options.with_ktx2 {
            return Ok((Box::new(png), inside));
        }
        let path = output.with_file_name(format!("{name}.ktx2"));
        let ktx2 = outputs.create(&path)?;
        let ktx2 = Ktx2Sink::new(ktx2, &path, [side; 2], map, Packing::of(map))?;
        Ok((Box::new(Both(png, ktx2)), inside))
    }

    /// Makes all pages, one after the other. `sinks` gives those of a page, one per map, when it is made: each may have many open files.
    pub(crate) fn run(
        &self,
        maps: &[Map],
        tangents: &[Vec4],
        sinks: impl IntoIterator<Item = Result<Vec<Box<dyn RowSink>>>>,
        progress: &dyn Progress,
    ) -> Result<ExportSummary> {
        let frames = Frames { normals: &self.normals, tangents };
        // The layout's texels were another step.
        let total: u64 = self.layout.pages.iter().map(|p| u64::from(p.side).pow(2)).sum();
        let (mut done, mut covered, mut contested) = (0, 0, 0);
        progress.report(0, total);
        for (page, sinks) in self.layout.pages.iter().zip(sinks) {
            let mut sinks = sinks?;
            let memory = self.options.memory_bytes;
            let shown = (self.surface, &frames);
            let stats = make_page(page, maps, shown, memory, &mut sinks, (progress, &mut done, total))?;
            covered += stats.covered;
            contested += stats.contested;
        }
        Ok(ExportSummary {
            sizes: self.layout.pages.iter().map(|p| [p.side; 2]).collect(),
            maps: maps.iter().map(|m| m.kind).collect(),
            charts: self.layout.charts,
            padding: self.layout.padding,
            used_share: covered as f64 / total.max(1) as f64,
            overlapping_share: contested as f64 / covered.max(1) as f64,
            density_share: f64::from(self.layout.texels_per_unit / self.surface.texels_per_unit()),
            points: self.layout.points,
            texels: total,
            triangles: self.surface.mesh().triangles.len() as u64,
            damage: self.surface.damage(),
            ..ExportSummary::default()
        })
    }
}

struct Both<A, B>(A, B);

impl<A: RowSink, B: RowSink> RowSink for Both<A, B> {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<()> {
        self.0.rows(values)?;
        self.1.rows(values)
    }

    fn finish(&mut self) -> Result<()> {
        self.0.finish()?;
        self.1.finish()
    }
}

/// What values must be divided by to lie in 0..1: the largest number of a channel that holds floats of emitted light.
/// Anything once `progress` is cancelled.
pub(crate) fn scale_of(cache: &PageCache, map: &Map, progress: &dyn Progress) -> f32 {
    if map.kind == ChannelMap::Emission { brightest(cache, map, progress) } else { 1.0 }
}

/// The largest number of a channel that holds floats of light, at least 1. Anything once `progress` is cancelled.
pub(crate) fn brightest(cache: &PageCache, map: &Map, progress: &dyn Progress) -> f32 {
    let asset = cache.asset();
    let channel = &asset.channels()[map.channel];
    let is_light = matches!(map.kind, ChannelMap::Emission | ChannelMap::Light);
    if !is_light || channel.format != TexelFormat::Rgba32F {
        return 1.0;
    }
    let brightest = |group: usize| {
        if progress.is_cancelled() {
            return 1.0;
        }
        let tile = cache.tile(map.channel, TileId { group: group as u32, level: 0 });
        let [columns, rows] = tile.extent();
        let texels = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
        let numbers = texels.flat_map(|[x, y]| tile.texel(x, y).into_iter().take(3));
        numbers.filter(|x| x.is_finite()).fold(1.0, f32::max)
    };
    (0..asset.cover().groups.len()).into_par_iter().map(brightest).reduce(|| 1.0, f32::max)
}

/// Pages that could not be read, and the first with its reason.
pub(crate) fn told(damage: &Damage) -> Option<(u64, String)> {
    damage.first.first().map(|(_, page, why)| (damage.pages, format!("{page}: {why}")))
}

pub(crate) fn cancelled() -> Error {
    Error::cancelled("the export was cancelled; nothing was written")
}

fn unknown_kind(path: &Path, what: &str, known: &str) -> Error {
    let message = format!("{} is no name for {what}; use {known}", path.display());
    Error::invalid(message).with_path(path)
}

fn no_channel(asset: &Asset, kind: ChannelMap) -> Error {
    let names: Vec<&str> = asset.channels().iter().map(|c| name_of(c.kind)).collect();
    let present = names.join(", ");
    Error::not_found(format!("the asset has no channel for {}; it has {present}", kind.name()))
}

fn name_of(kind: ChannelKind) -> &'static str {
    let map = match kind {
        ChannelKind::BaseColor => ChannelMap::BaseColor,
        ChannelKind::Normal => ChannelMap::Normal,
        ChannelKind::OcclusionRoughnessMetallic => ChannelMap::OcclusionRoughnessMetallic,
        ChannelKind::Emission => ChannelMap::Emission,
        ChannelKind::Displacement => ChannelMap::Displacement,
        ChannelKind::Light => ChannelMap::Light,
        // Its numbers mean nothing without the tiles' frames, so no picture is made of it.
        ChannelKind::Anisotropy => return "anisotropy",
    };
    map.name()
}

// ---- What an export is asked for.

/// Texture coordinates of an exported model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum UvChoice<'a> {
    /// A packing of its own.
    #[default]
    Atlas,
    /// Those that the asset kept of its model.
    OfAsset,
    /// Those of this model, which must have the asset's triangles.
    OfModel(&'a fantex_mesh::Mesh),
}

/// How to export.
#[derive(Clone, Debug)]
pub struct ExportOptions<'a> {
    /// Whose texture coordinates.
    pub uv: UvChoice<'a>,
    /// Columns and rows of the pictures, a power of two; without it, as many as give the density of the asset.
    pub side: Option<u32>,
    /// The most columns that are chosen without `side`.
    pub largest_side: u32,
    /// Texels that a picture of an own packing was asked to have: without `side`, it has 16 times as many at most, and a lower density
    /// then, unless the charts ask for more.
    pub texels: Option<u64>,
    /// Texels around the charts of an own packing, a power of two; without it, a 128th of the side, 2 to 16.
    pub padding: Option<u32>,
    /// Write each picture of a model as KTX2, too, beside it.
    pub with_ktx2: bool,
    /// Overwrite existing files.
    pub force: bool,
    /// Fail, and write nothing, where coarser texels stand in for damaged ones.
    pub strict: bool,
    /// Bytes that texels may take.
    pub memory_bytes: u64,
}

impl Default for ExportOptions<'_> {
    /// An own packing of at most 8192 columns, PNG alone, no overwriting, damage allowed, 1 GiB.
    fn default() -> Self {
        Self {
            uv: UvChoice::default(),
            side: None,
            largest_side: 8192,
            texels: None,
            padding: None,
            with_ktx2: false,
            force: false,
            strict: false,
            memory_bytes: 1 << 30,
        }
    }
}

/// The smallest picture.
pub const MIN_SIDE: u32 = 16;

/// The largest picture.
pub const MAX_SIDE: u32 = 32_768;

/// The widest padding.
pub const MAX_PADDING: u32 = 64;

impl ExportOptions<'_> {
    pub(crate) fn check(&self) -> Result<()> {
        for side in self.side.into_iter().chain([self.largest_side]) {
            if !side.is_power_of_two() || !(MIN_SIDE..=MAX_SIDE).contains(&side) {
                return Err(Error::invalid(format!(
                    "a picture cannot have {side} x {side} texels; give a power of two from {MIN_SIDE} to {MAX_SIDE}"
                )));
            }
        }
        match self.padding {
            Some(padding) if !padding.is_power_of_two() || padding > MAX_PADDING => Err(Error::invalid(
                format!("the padding cannot be {padding} texels; give a power of two up to {MAX_PADDING}"),
            )),
            _ => Ok(()),
        }
    }
}

// ---- The pictures that an asset gives.

/// A picture of one channel, or of one component of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelMap {
    /// RGB colour; with opacity where a material lets something show through.
    BaseColor,
    /// The alpha of the base colour.
    Opacity,
    /// Normals in tangent space, +y up.
    Normal,
    /// Red = occlusion, green = roughness, blue = metallic.
    OcclusionRoughnessMetallic,
    /// Occlusion alone.
    Occlusion,
    /// Roughness alone.
    Roughness,
    /// Metallic alone.
    Metallic,
    /// Emitted light.
    Emission,
    /// Height.
    Displacement,
    /// Light that arrives.
    Light,
}

impl ChannelMap {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::BaseColor,
        Self::Opacity,
        Self::Normal,
        Self::OcclusionRoughnessMetallic,
        Self::Occlusion,
        Self::Roughness,
        Self::Metallic,
        Self::Emission,
        Self::Displacement,
        Self::Light,
    ];

    fn words(self) -> (ChannelKind, &'static str) {
        match self {
            Self::BaseColor => (ChannelKind::BaseColor, "base-color"),
            Self::Opacity => (ChannelKind::BaseColor, "opacity"),
            Self::Normal => (ChannelKind::Normal, "normal"),
            Self::OcclusionRoughnessMetallic => (ChannelKind::OcclusionRoughnessMetallic, "orm"),
            Self::Occlusion => (ChannelKind::OcclusionRoughnessMetallic, "occlusion"),
            Self::Roughness => (ChannelKind::OcclusionRoughnessMetallic, "roughness"),
            Self::Metallic => (ChannelKind::OcclusionRoughnessMetallic, "metallic"),
            Self::Emission => (ChannelKind::Emission, "emission"),
            Self::Displacement => (ChannelKind::Displacement, "displacement"),
            Self::Light => (ChannelKind::Light, "light"),
        }
    }

    /// The channel that it is taken from.
    pub fn channel(self) -> ChannelKind {
        self.words().0
    }

    /// What it is called in names of files and on the command line.
    pub fn name(self) -> &'static str {
        self.words().1
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Components {
    /// One of them, as grey.
    One(usize),
    /// Red, green, blue.
    Rgb,
    /// All.
    Rgba,
}

impl Components {
    pub(crate) fn count(self) -> usize {
        match self {
            Self::One(_) => 1,
            Self::Rgb => 3,
            Self::Rgba => 4,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Map {
    pub(crate) kind: ChannelMap,
    pub(crate) channel: usize,
    pub(crate) components: Components,
    /// True where fixed-point numbers of red, green and blue are sRGB-encoded.
    pub(crate) is_srgb: bool,
    /// Values are divided by this, so that fixed-point numbers hold them.
    pub(crate) scale: f32,
    /// What unused texels hold, linear.
    pub(crate) background: [f32; 4],
}

impl Map {
    /// The map of an asset; none where it has no such channel.
    pub(crate) fn of(asset: &Asset, kind: ChannelMap) -> Option<Self> {
        let channel = asset.channel_of_kind(kind.channel())?;
        Some(Self::new(kind, channel, &asset.mesh().materials, mean(asset, channel)))
    }

    /// The map of a channel with that index, on materials, with that mean.
    pub(crate) fn new(kind: ChannelMap, channel: usize, materials: &[Material], mean: [f32; 4]) -> Self {
        let shows_through = materials.iter().any(|m| m.alpha != AlphaMode::Opaque);
        let components = match kind {
            ChannelMap::BaseColor if shows_through => Components::Rgba,
            ChannelMap::BaseColor
            | ChannelMap::Normal
            | ChannelMap::OcclusionRoughnessMetallic
            | ChannelMap::Emission
            | ChannelMap::Light => Components::Rgb,
            ChannelMap::Occlusion | ChannelMap::Displacement => Components::One(0),
            ChannelMap::Roughness => Components::One(1),
            ChannelMap::Metallic => Components::One(2),
            ChannelMap::Opacity => Components::One(3),
        };
        let is_srgb = matches!(kind, ChannelMap::BaseColor | ChannelMap::Emission | ChannelMap::Light);
        let background = match kind {
            ChannelMap::Normal => [0.5, 0.5, 1.0, 1.0],
            _ => mean,
        };
        Self { kind, channel, components, is_srgb, scale: 1.0, background }
    }

    /// Whether it shows normals, which have frames of their own.
    pub(crate) fn has_normals(&self) -> bool {
        self.kind == ChannelMap::Normal
    }

    pub(crate) fn scaled(self, scale: f32) -> Self {
        Self { scale, background: self.background.map(|x| x / scale), ..self }
    }
}

fn mean(asset: &Asset, channel: usize) -> [f32; 4] {
    let (mut sum, mut texels) = ([0.0f64; 4], 0.0);
    for (i, group) in (0u32..).zip(&asset.cover().groups) {
        let weight = f64::from(group.extent[0]) * f64::from(group.extent[1]);
        let value = asset.mean(channel, i);
        (0..4).for_each(|k| sum[k] += weight * f64::from(value[k]));
        texels += weight;
    }
    sum.map(|s| (s / f64::max(texels, 1.0)) as f32)
}
