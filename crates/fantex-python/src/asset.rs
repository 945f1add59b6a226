//! Assets: look-ups, pictures, exports, checks.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::addresses::check_is_path;
use fantex::export::{
    AtlasPicture, ChannelMap, Depth, ExportOptions, FanSheetOptions, export_atlas, export_channels,
    export_fans, export_model, fan_sheets,
};
use fantex::glam::{DVec3, Vec3};
use fantex::mesh::{AlphaMode, Material, lambda_step};
use fantex::render::FanSurface;
use fantex::scene::FilterOptions;
use fantex::store::{JUMP_BOUND, PREVIEW, PageCache, VerifyOptions, verify_asset};
use fantex::{ChannelKind, Error, FileKind, Footprint, Progress, SurfacePoint, damage_note, not_verified};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray,
};
use pyo3::exceptions::{PyIndexError, PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::arrays::{array, rows};
use crate::export::{AtlasFiles, Exported, bits, channel_map, damage_notes, exported_fans, fan_files};
use crate::mesh::{upwards, world_positions};
use crate::picture::{Rendered, View, rendered};
use crate::watch::{heard, watched};

/// Names of the channels.
pub(crate) const CHANNELS: [(&str, ChannelKind); 7] = [
    ("base-color", ChannelKind::BaseColor),
    ("normal", ChannelKind::Normal),
    ("orm", ChannelKind::OcclusionRoughnessMetallic),
    ("emission", ChannelKind::Emission),
    ("displacement", ChannelKind::Displacement),
    ("light", ChannelKind::Light),
    ("anisotropy", ChannelKind::Anisotropy),
];

pub(crate) fn name_of(kind: ChannelKind) -> &'static str {
    CHANNELS.iter().find(|(_, known)| *known == kind).map_or("other", |(name, _)| name)
}

/// What lies at a path or an address: an asset, a world, a look or a model, by its name or its first bytes.
#[pyfunction]
pub(crate) fn kind(py: Python<'_>, place: PathBuf) -> PyResult<&'static str> {
    let kind = watched(py, None, |_| FileKind::of(&place))?;
    Ok(match kind {
        FileKind::Asset => "asset",
        FileKind::World => "world",
        FileKind::Look => "look",
        FileKind::Model => "model",
    })
}

/// An open asset.
#[pyclass(frozen, module = "fantex")]
pub(crate) struct Asset {
    asset: fantex::Asset,
    cache: PageCache,
    sampler: fantex::Sampler,
}

/// Name, what it makes of opacity, threshold; base colour, metallic, roughness, emission; whether it is unlit and seen from both sides.
type MaterialParts =
    (String, &'static str, Option<f32>, (f32, f32, f32, f32), f32, f32, (f32, f32, f32), bool, bool);

type Nearest<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f64>>);
type AtlasArrays<'py> = (
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray2<f32>>,
    Vec<(&'static str, Bound<'py, PyArray3<u8>>, f32)>,
    Vec<String>,
);

impl Asset {
    pub(crate) fn asset(&self) -> &fantex::Asset {
        &self.asset
    }

    pub(crate) fn cache(&self) -> &PageCache {
        &self.cache
    }
}

#[pymethods]
impl Asset {
    /// Opens a file or an address; decoded tiles take at most `memory` bytes.
    #[new]
    fn open(py: Python<'_>, place: PathBuf, memory: usize) -> PyResult<Self> {
        let asset = watched(py, None, |_| fantex::Asset::open(&place))?;
        let cache = PageCache::new(Arc::clone(asset.shared()), memory);
        let sampler = fantex::Sampler::of_cache(&cache, FilterOptions::default());
        Ok(Self { asset, cache, sampler })
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        world_positions(py, self.asset.mesh())
    }

    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        array(py, &self.asset.mesh().triangles)
    }

    #[getter]
    fn channels(&self) -> Vec<&'static str> {
        self.asset.channels().iter().map(|channel| name_of(channel.kind)).collect()
    }

    /// The materials, with the factors that count where the asset has no channel.
    #[getter]
    fn materials(&self) -> Vec<MaterialParts> {
        let parts = |material: &Material| -> MaterialParts {
            let (alpha, threshold) = match material.alpha {
                AlphaMode::Opaque => ("opaque", None),
                AlphaMode::Mask(threshold) => ("cut-out", Some(threshold)),
                AlphaMode::Blend => ("blend", None),
            };
            let Material { name, base_color, metallic, roughness, emission, unlit, double_sided, .. } =
                material.clone();
            let (base_color, emission) = (base_color.into(), emission.into());
            (name, alpha, threshold, base_color, metallic, roughness, emission, unlit, double_sided)
        };
        match &self.asset.mesh().materials[..] {
            [] => vec![parts(&Material::default())],
            materials => materials.iter().map(parts).collect(),
        }
    }

    /// The material of each face.
    #[getter]
    fn face_materials<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let mesh = self.asset.mesh();
        let materials: Vec<u32> = (0..mesh.triangles.len()).map(|t| mesh.material_of(t) as u32).collect();
        materials.to_pyarray(py)
    }

    /// Numbers of what is in it, bytes of the file and of its preview, formats of its channels.
    fn figures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (mesh, cover) = (self.asset.mesh(), self.asset.cover());
        let (texels, preview) = watched(py, None, |_| {
            Ok((cover.stored_texels(mesh), self.asset.attachment_bytes(PREVIEW).ok().flatten()))
        })?;
        let channels = PyDict::new(py);
        for channel in self.asset.channels() {
            channels.set_item(name_of(channel.kind), channel.format.to_string())?;
        }
        let figures = PyDict::new(py);
        figures.set_item("kind", "asset")?;
        figures.set_item("triangles", mesh.triangles.len())?;
        figures.set_item("vertices", mesh.positions.len())?;
        figures.set_item("texels", texels)?;
        figures.set_item("tiles", cover.groups.len())?;
        figures.set_item("levels", self.asset.level_count())?;
        figures.set_item("hard_edges", cover.hard_edges)?;
        figures.set_item("bytes", self.asset.file_bytes())?;
        figures.set_item("preview_bytes", preview)?;
        figures.set_item("channels", channels)?;
        Ok(figures)
    }

    /// The nearest points of the surface: faces, barycentric coordinates, positions. Points that are not finite get face 2^32 - 1.
    fn nearest<'py>(&self, py: Python<'py>, points: PyReadonlyArray2<'py, f64>) -> PyResult<Nearest<'py>> {
        let points = rows::<3, f64>(&points, "points")?;
        let mesh = self.asset.mesh();
        let nowhere = SurfacePoint { triangle: u32::MAX, lambda: Vec3::NAN };
        let found: Vec<SurfacePoint> = watched(py, None, |watch| {
            let nearest = |&p: &[f64; 3]| {
                let found =
                    if watch.is_cancelled() { None } else { self.asset.nearest_point(DVec3::from(p)) };
                found.unwrap_or(nowhere)
            };
            Ok(points.par_iter().map(nearest).collect())
        })?;
        let faces: Vec<u32> = found.iter().map(|at| at.triangle).collect();
        let lambda: Vec<[f32; 3]> = found.iter().map(|at| at.lambda.to_array()).collect();
        let position = |at: &SurfacePoint| match at.triangle {
            u32::MAX => [f64::NAN; 3],
            _ => mesh.world_from_mesh.point(at.position(mesh)).to_array(),
        };
        let positions: Vec<[f64; 3]> = found.iter().map(position).collect();
        Ok((faces.to_pyarray(py), array(py, &lambda)?, array(py, &positions)?))
    }

    /// Values of a channel at points of the surface. `footprint`: lengths of squares in the world, one or as many as points.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        channel: &str,
        faces: PyReadonlyArray1<'py, i64>,
        barycentric: PyReadonlyArray2<'py, f32>,
        footprint: Option<PyReadonlyArray1<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let kind = self.channel(channel)?;
        let mesh = self.asset.mesh();
        let at = self.points(&faces, &barycentric)?;
        let lengths = footprint.as_ref().map(|lengths| lengths.as_array());
        if let Some(lengths) = lengths.filter(|lengths| lengths.len() != 1 && lengths.len() != at.len()) {
            let message = format!("footprint has {} lengths; expected 1 or {}", lengths.len(), at.len());
            return Err(PyValueError::new_err(message));
        }
        let points: Vec<(SurfacePoint, Footprint)> = (0..)
            .zip(at)
            .map(|(i, point): (usize, SurfacePoint)| {
                let length = lengths.map_or(0.0, |lengths| lengths[if lengths.len() == 1 { 0 } else { i }]);
                (point, square(mesh, point, length))
            })
            .collect();
        let values = watched(py, None, |watch| {
            let sample = |points| match watch.is_cancelled() {
                true => Err(Error::cancelled("the look-up was cancelled")),
                false => self.sampler.sample_many(kind, points),
            };
            let parts: fantex::Result<Vec<_>> = points.par_chunks(1 << 14).map(sample).collect();
            Ok(parts?.concat())
        })?;
        let values: Vec<[f32; 4]> = values.iter().map(|value| value.to_array()).collect();
        array(py, &values)
    }

    /// A picture: rows, columns, RGBA of 8 bits in sRGB.
    fn render<'py>(&self, py: Python<'py>, options: &Bound<'py, PyDict>) -> PyResult<Rendered<'py>> {
        let view = View::new(options)?;
        let mesh = self.asset.mesh();
        let picture = watched(py, None, |_| {
            let surface = FanSurface::of_asset(&self.cache, view.filter());
            view.take(mesh, &surface, &view.camera(mesh))
        })?;
        let damage = damage_note(self.asset.path(), &self.cache.damage());
        rendered(py, &picture, damage.into_iter().collect())
    }

    /// Vertex mapping, faces, texture coordinates with v upwards, and pictures with their names and with what their values were divided by; and what
    /// is to be known, a sentence each.
    fn atlas<'py>(
        &self,
        py: Python<'py>,
        resolution: Option<u32>,
        padding: Option<u32>,
        memory: u64,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<AtlasArrays<'py>> {
        let options =
            ExportOptions { side: resolution, padding, memory_bytes: memory, ..ExportOptions::default() };
        let asset = self.asset.shared();
        let atlas = watched(py, heard(&progress, "exporting"), |watch| export_atlas(asset, &options, watch))?;
        let uv: Vec<[f32; 2]> = atlas.mesh.uv.iter().map(upwards).collect();
        let picture = |picture: AtlasPicture| {
            let side = picture.side as usize;
            let samples = picture.samples.into_pyarray(py).reshape([side, side, picture.components])?;
            Ok((picture.map.name(), samples, picture.scale))
        };
        let pictures = atlas.pictures.into_iter().map(picture).collect::<PyResult<_>>()?;
        let notes = damage_notes(asset.path(), atlas.summary.damage);
        let (vertices, faces) = (atlas.mesh.vertices.to_pyarray(py), array(py, &atlas.mesh.triangles)?);
        Ok((vertices, faces, array(py, &uv)?, pictures, notes))
    }

    /// Writes a `.glb` or `.gltf` with ordinary texture coordinates.
    fn export(
        &self,
        py: Python<'_>,
        path: PathBuf,
        options: &Bound<'_, PyDict>,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Exported> {
        let options = AtlasFiles::new(options)?;
        let asset = self.asset.shared();
        let written = watched(py, heard(&progress, "exporting"), |watch| {
            check_is_path(&path)?;
            export_model(asset, &path, &options.options(), watch)
        })?;
        Ok(options.exported(asset.path(), &path, written))
    }

    /// Writes channels, laid out like the pictures of a model, to files of their own.
    fn export_channels(
        &self,
        py: Python<'_>,
        channels: Vec<(String, PathBuf)>,
        depth: u32,
        options: &Bound<'_, PyDict>,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Exported> {
        let (options, depth) = (AtlasFiles::new(options)?, bits(depth)?);
        let channels = channels.into_iter().map(|(name, path)| channel_map(&name).map(|map| (map, path)));
        let channels: Vec<(ChannelMap, PathBuf)> = channels.collect::<PyResult<_>>()?;
        let asset = self.asset.shared();
        let written = watched(py, heard(&progress, "exporting"), |watch| {
            channels.iter().try_for_each(|(_, path)| check_is_path(path))?;
            let channels: Vec<(ChannelMap, &Path)> =
                channels.iter().map(|(map, path)| (*map, path.as_path())).collect();
            export_channels(asset, &channels, depth, &options.options(), watch)
        })?;
        // Notes on one picture are on its file, others on the asset.
        let subject = if let [(_, path)] = &channels[..] { path.as_path() } else { asset.path() };
        Ok(options.exported(asset.path(), subject, written))
    }

    /// Writes the fans themselves: `.glb`; `.gltf` or `.usda` with sheets beside it; and shaders in the languages that are named.
    fn export_fans(
        &self,
        py: Python<'_>,
        path: PathBuf,
        options: &Bound<'_, PyDict>,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Exported> {
        let options = fan_files(options)?;
        let asset = self.asset.shared();
        let written = watched(py, heard(&progress, "exporting"), |watch| {
            check_is_path(&path)?;
            export_fans(asset, &path, &options, watch)
        })?;
        Ok(exported_fans(asset.path(), &path, written))
    }

    /// Fans for other programs: delta; per face, slot and corner coordinates with v upwards; each face's sheet; each sheet's pictures;
    /// and what is to be known, a sentence each.
    fn fans<'py>(
        &self,
        py: Python<'py>,
        gutter: u32,
        largest_side: u32,
        memory: u64,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let options = FanSheetOptions { gutter, largest_side, memory_bytes: memory };
        let asset = self.asset.shared();
        let fans = watched(py, heard(&progress, "exporting"), |watch| fan_sheets(asset, &options, watch))?;
        let uv: Vec<[f32; 2]> = fans.uv.iter().flatten().flatten().map(upwards).collect();
        let mut sheets = Vec::new();
        for sheet in fans.sheets {
            let pictures = PyDict::new(py);
            for (map, samples) in fans.maps.iter().zip(sheet.pictures) {
                let [width, height] = sheet.size.map(|n| n as usize);
                let shape = [height, width, map.components];
                match map.depth {
                    Depth::Eight => {
                        pictures.set_item(map.map.name(), samples.into_pyarray(py).reshape(shape)?)?
                    }
                    Depth::Sixteen => {
                        let wide: Vec<u16> = samples
                            .chunks_exact(2)
                            .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
                            .collect();
                        pictures.set_item(map.map.name(), wide.into_pyarray(py).reshape(shape)?)?;
                    }
                }
            }
            sheets.push(pictures);
        }
        let scales = PyDict::new(py);
        for map in &fans.maps {
            scales.set_item(map.map.name(), map.scale)?;
        }
        let dict = PyDict::new(py);
        dict.set_item("delta", fans.delta)?;
        dict.set_item("uv", uv.as_flattened().to_pyarray(py).reshape([fans.uv.len(), 3, 3, 2])?)?;
        dict.set_item("sheet", fans.sheet_of_triangle.to_pyarray(py))?;
        dict.set_item("sheets", sheets)?;
        dict.set_item("scales", scales)?;
        dict.set_item("notes", damage_notes(asset.path(), fans.damage))?;
        Ok(dict)
    }

    /// What verification found.
    fn verify<'py>(&self, py: Python<'py>, texels: bool, memory: usize) -> PyResult<Bound<'py, PyDict>> {
        let options = VerifyOptions { memory_bytes: memory, texels };
        let report = watched(py, None, |_| Ok(verify_asset(self.asset.shared(), &options)))?;
        let fault = (!report.ok).then(|| not_verified(self.asset.path(), &report).to_string());
        let dict = PyDict::new(py);
        dict.set_item("ok", report.ok)?;
        dict.set_item("largest_jump", report.continuity.largest_jump)?;
        dict.set_item("bound", JUMP_BOUND)?;
        dict.set_item("edges", report.continuity.edges)?;
        dict.set_item("exempt_edges", report.continuity.exempt_edges)?;
        dict.set_item("hard_edges", report.continuity.exempt.hard)?;
        dict.set_item("largest_hard_jump", report.continuity.largest_hard_jump)?;
        dict.set_item("needless_splits", report.continuity.needless_splits)?;
        dict.set_item("levels", report.levels)?;
        dict.set_item("damaged_tiles", report.damaged_tiles)?;
        dict.set_item("damage", report.first_damage)?;
        dict.set_item("mesh_faults", report.mesh_faults.iter().map(ToString::to_string).collect::<Vec<_>>())?;
        dict.set_item("damaged_headers", report.damaged_headers)?;
        dict.set_item("damaged_attachments", report.damaged_attachments)?;
        dict.set_item("bytes", report.bytes)?;
        dict.set_item("fault", fault)?;
        if let Some(texels) = report.texels {
            dict.set_item("texels_compared", texels.compared)?;
            dict.set_item("contradictions", texels.contradictions + texels.empty_blocks)?;
            dict.set_item("texel_faults", texels.first)?;
        }
        Ok(dict)
    }

    /// Unit vertex normals at points of the surface.
    fn normals<'py>(
        &self,
        py: Python<'py>,
        faces: PyReadonlyArray1<'py, i64>,
        barycentric: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let points = self.points(&faces, &barycentric)?;
        let normals: Vec<[f32; 3]> = watched(py, None, |_| {
            Ok(points.par_iter().map(|&point| self.sampler.vertex_normal(point).to_array()).collect())
        })?;
        array(py, &normals)
    }
}

impl Asset {
    /// Points of the surface, checked against its triangles.
    fn points(
        &self,
        faces: &PyReadonlyArray1<'_, i64>,
        barycentric: &PyReadonlyArray2<'_, f32>,
    ) -> PyResult<Vec<SurfacePoint>> {
        let lambda = rows::<3, f32>(barycentric, "barycentric")?;
        let faces = faces.as_array();
        if faces.len() != lambda.len() {
            let counts = format!("{} faces and {} barycentric coordinates", faces.len(), lambda.len());
            return Err(PyValueError::new_err(format!("there are {counts}; expected as many of each")));
        }
        let count = self.asset.mesh().triangles.len();
        let point = |(&face, lambda): (&i64, [f32; 3])| {
            let triangle = u32::try_from(face).ok().filter(|&t| (t as usize) < count).ok_or_else(|| {
                PyIndexError::new_err(format!("there is no face {face}; the asset has {count}"))
            })?;
            Ok(SurfacePoint { triangle, lambda: Vec3::from(lambda) })
        };
        faces.iter().zip(lambda).map(point).collect()
    }

    fn channel(&self, name: &str) -> PyResult<ChannelKind> {
        let present = || self.channels().join(", ");
        let kind = CHANNELS.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind);
        kind.filter(|&kind| self.asset.channel_of_kind(kind).is_some()).ok_or_else(|| {
            PyKeyError::new_err(format!("the asset has no channel {name:?}; it has {}", present()))
        })
    }
}

/// A square in the plane of the triangle, `length` world units wide.
fn square(mesh: &fantex::mesh::Mesh, point: SurfacePoint, length: f64) -> Footprint {
    if length.is_nan() || length <= 0.0 {
        return Footprint::NONE;
    }
    let corners = mesh.triangle_positions(point.index());
    let (along, across) = point.facet_normal(mesh).any_orthonormal_pair();
    let length = (length / mesh.world_from_mesh.scale) as f32;
    Footprint { lambda_steps: [along, across].map(|axis| lambda_step(corners, axis * length)) }
}
