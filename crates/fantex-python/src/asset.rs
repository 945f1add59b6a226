//! Assets: look-ups, pictures, exports, checks, strokes.

use std::path::PathBuf;
use std::sync::Arc;

use fantex::export::{
    Depth, ExportOptions, FanFileOptions, FanSheetOptions, ShaderLanguage, SheetPictures, UvChoice,
    export_atlas, export_fans, export_model, fan_sheets,
};
use fantex::glam::{DVec3, Vec3};
use fantex::mesh::lambda_step;
use fantex::paint::{PaintOptions, Painter, StrokeFile, replay};
use fantex::render::{AmbientLight, EnvironmentLight, FanSurface, RenderOptions, render};
use fantex::scene::{Background, Camera, FilterOptions, Lights};
use fantex::store::{JUMP_BOUND, PageCache, VerifyOptions, verify_asset};
use fantex::texture::environment::{EnvironmentMap, PrefilteredEnvironment};
use fantex::texture::{ColorSpace, Image, Samples};
use fantex::{ChannelKind, FileKind, Footprint, SurfacePoint};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
};
use numpy::{PyUntypedArrayMethods, ToPyArray};
use pyo3::exceptions::{PyIndexError, PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use rayon::prelude::*;

use crate::arrays::{array, rows};
use crate::mesh::{upwards, world_positions};
use crate::watch::{exception, watched};

/// Names of the channels.
const CHANNELS: [(&str, ChannelKind); 7] = [
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

fn language(name: &str) -> PyResult<ShaderLanguage> {
    match name {
        "glsl" => Ok(ShaderLanguage::Glsl),
        "wgsl" => Ok(ShaderLanguage::Wgsl),
        "hlsl" => Ok(ShaderLanguage::Hlsl),
        "godot" => Ok(ShaderLanguage::Godot),
        _ => Err(PyValueError::new_err(format!(
            "no shader is written in {name:?}; give \"glsl\", \"wgsl\", \"hlsl\" or \"godot\""
        ))),
    }
}

fn sheet_pictures(name: &str) -> PyResult<SheetPictures> {
    match name {
        "png" => Ok(SheetPictures::Png),
        "png+ktx2" => Ok(SheetPictures::PngAndKtx2),
        "png+exr" => Ok(SheetPictures::PngAndExr),
        "exr" => Ok(SheetPictures::Exr),
        _ => Err(PyValueError::new_err(format!(
            "textures cannot be {name:?}; give \"png\", \"png+ktx2\", \"png+exr\" or \"exr\""
        ))),
    }
}

/// Whether a path or address leads to an asset.
#[pyfunction]
pub(crate) fn is_asset(py: Python<'_>, path: PathBuf) -> PyResult<bool> {
    watched(py, None, |_| FileKind::of(&path)).map(|kind| kind == FileKind::Asset)
}

/// An open asset.
#[pyclass(frozen, module = "fantex")]
pub(crate) struct Asset {
    asset: fantex::Asset,
    cache: PageCache,
    sampler: fantex::Sampler,
}

/// Eye, target, up, opening angle in degrees.
type CameraParts = ([f64; 3], [f64; 3], [f64; 3], f64);
type Nearest<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f64>>);
type AtlasArrays<'py> = (
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray2<f32>>,
    Vec<(&'static str, Bound<'py, PyArray3<u8>>)>,
);

impl Asset {
    pub(crate) fn asset(&self) -> &fantex::Asset {
        &self.asset
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

    /// Texels per channel, tiles, levels, bytes of the file.
    fn figures(&self) -> (u64, usize, u32, u64) {
        let cover = self.asset.cover();
        let texels = cover.stored_texels(self.asset.mesh());
        (texels, cover.groups.len(), self.asset.level_count(), self.asset.file_bytes())
    }

    /// The nearest points of the surface: faces, barycentric coordinates, positions. Points that are not finite get face 2^32 - 1.
    fn nearest<'py>(&self, py: Python<'py>, points: PyReadonlyArray2<'py, f64>) -> PyResult<Nearest<'py>> {
        let points = rows::<3, f64>(&points, "points")?;
        let mesh = self.asset.mesh();
        let nowhere = SurfacePoint { triangle: u32::MAX, lambda: Vec3::NAN };
        let found: Vec<SurfacePoint> = watched(py, None, |watch| {
            let nearest = |&p: &[f64; 3]| {
                use fantex::Progress;
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
        let lambda = rows::<3, f32>(&barycentric, "barycentric")?;
        let faces = faces.as_array();
        if faces.len() != lambda.len() {
            let counts = format!("{} faces and {} barycentric coordinates", faces.len(), lambda.len());
            return Err(PyValueError::new_err(format!("there are {counts}; expected as many of each")));
        }
        let count = mesh.triangles.len();
        let known = |&face: &i64| usize::try_from(face).is_ok_and(|face| face < count);
        if let Some(face) = faces.iter().find(|face| !known(face)) {
            return Err(PyIndexError::new_err(format!("there is no face {face}; the asset has {count}")));
        }
        let lengths = footprint.as_ref().map(|lengths| lengths.as_array());
        if let Some(lengths) = lengths.filter(|lengths| lengths.len() != 1 && lengths.len() != lambda.len()) {
            let message = format!("footprint has {} lengths; expected 1 or {}", lengths.len(), lambda.len());
            return Err(PyValueError::new_err(message));
        }
        let points: Vec<(SurfacePoint, Footprint)> = (0..lambda.len())
            .map(|i| {
                let point = SurfacePoint { triangle: faces[i] as u32, lambda: Vec3::from(lambda[i]) };
                let length = lengths.map_or(0.0, |lengths| lengths[if lengths.len() == 1 { 0 } else { i }]);
                (point, square(mesh, point, length))
            })
            .collect();
        let values = watched(py, None, |_| {
            let sample = |points| self.sampler.sample_many(kind, points);
            let parts: fantex::Result<Vec<_>> = points.par_chunks(1 << 14).map(sample).collect();
            Ok(parts?.concat())
        })?;
        let values: Vec<[f32; 4]> = values.iter().map(|value| value.to_array()).collect();
        array(py, &values)
    }

    /// A picture: rows, columns, RGBA of 8 bits in sRGB.
    #[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        size: [u32; 2],
        camera: Option<CameraParts>,
        samples: u32,
        light: Option<[f32; 3]>,
        environment: Option<PathBuf>,
        transparent: bool,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let mesh = self.asset.mesh();
        let [width, height] = size;
        let mut options = RenderOptions { width, height, samples, ..RenderOptions::default() };
        if transparent {
            options.background = Background::Transparent;
        } else if environment.is_some() {
            options.background = Background::Environment { blur: 0.0 };
        }
        let picture = watched(py, None, |_| {
            let aspect = f64::from(width) / f64::from(height.max(1));
            let camera = match camera {
                Some((eye, target, up, fov_degrees)) => {
                    Camera { eye: eye.into(), target: target.into(), up: up.into(), fov_degrees }
                }
                None => Camera::framing_mesh(mesh, Camera::THREE_QUARTER, aspect),
            };
            let sun = light.map(Vec3::from);
            let mut lights = sun.map_or_else(|| Lights::behind(&camera), Lights::sun);
            if let Some(path) = environment {
                let map = PrefilteredEnvironment::new(Arc::new(EnvironmentMap::load(&path)?));
                let light = EnvironmentLight { map: Arc::new(map), strength: 1.0, rotation_degrees: 0.0 };
                lights.ambient = AmbientLight::environment(light);
                lights.lamps.retain(|_| sun.is_some());
            }
            let surface = FanSurface::of_asset(&self.cache, FilterOptions::default());
            Ok(render(mesh, &surface, &camera, &lights, &options)?.picture)
        })?;
        let mut image = picture.to_srgb_image();
        if image.channels == 3
            && let Samples::U8(rgb) = &image.samples
        {
            let rgba = rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
            image = Image { channels: 4, samples: Samples::U8(rgba), ..image };
        }
        let Samples::U8(samples) = image.samples else { return Err(PyValueError::new_err("no picture")) };
        samples.to_pyarray(py).reshape([height as usize, width as usize, 4])
    }

    /// Vertex mapping, faces, texture coordinates with v upwards, and pictures by name.
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
        let atlas = watched(py, progress.as_ref(), |watch| export_atlas(asset, &options, watch))?;
        let uv: Vec<[f32; 2]> = atlas.mesh.uv.iter().map(upwards).collect();
        let picture = |picture: &fantex::export::AtlasPicture| {
            let side = picture.side as usize;
            let samples = picture.samples.to_pyarray(py).reshape([side, side, picture.components])?;
            Ok((picture.map.name(), samples))
        };
        let pictures = atlas.pictures.iter().map(picture).collect::<PyResult<_>>()?;
        Ok((atlas.mesh.vertices.to_pyarray(py), array(py, &atlas.mesh.triangles)?, array(py, &uv)?, pictures))
    }

    /// Writes a `.glb` or `.gltf` with ordinary texture coordinates.
    #[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
    fn export(
        &self,
        py: Python<'_>,
        path: PathBuf,
        resolution: Option<u32>,
        padding: Option<u32>,
        source_uv: bool,
        ktx2: bool,
        overwrite: bool,
        memory: u64,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Vec<PathBuf>> {
        let options = ExportOptions {
            uv: if source_uv { UvChoice::OfAsset } else { UvChoice::Atlas },
            side: resolution,
            padding,
            with_ktx2: ktx2,
            force: overwrite,
            memory_bytes: memory,
            ..ExportOptions::default()
        };
        let asset = self.asset.shared();
        let summary = watched(py, progress.as_ref(), |watch| export_model(asset, &path, &options, watch))?;
        Ok(summary.files.into_iter().map(|(path, _)| path).collect())
    }

    /// Writes the fans themselves: `.glb`; `.gltf` or `.usda` with sheets beside it; and shaders in the languages that are named.
    #[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
    fn export_fans(
        &self,
        py: Python<'_>,
        path: PathBuf,
        gutter: u32,
        largest_side: u32,
        textures: &str,
        shaders: Vec<String>,
        overwrite: bool,
        memory: u64,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Vec<PathBuf>> {
        let shaders = shaders.iter().map(|name| language(name)).collect::<PyResult<_>>()?;
        let sheets = FanSheetOptions { gutter, largest_side, memory_bytes: memory };
        let pictures = sheet_pictures(textures)?;
        let options = FanFileOptions { sheets, pictures, shaders, force: overwrite };
        let asset = self.asset.shared();
        let summary = watched(py, progress.as_ref(), |watch| export_fans(asset, &path, &options, watch))?;
        Ok(summary.files.into_iter().map(|(path, _)| path).collect())
    }

    /// Fans for other programs: delta; per face, slot and corner coordinates with v upwards; each face's sheet; each sheet's pictures.
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
        let fans = watched(py, progress.as_ref(), |watch| fan_sheets(asset, &options, watch))?;
        let uv: Vec<[f32; 2]> = fans.uv.iter().flatten().flatten().map(upwards).collect();
        let mut sheets = Vec::new();
        for sheet in fans.sheets {
            let pictures = PyDict::new(py);
            for (map, samples) in fans.maps.iter().zip(sheet.pictures) {
                let [width, height] = sheet.size.map(|n| n as usize);
                let shape = [height, width, map.components];
                match map.depth {
                    Depth::Eight => {
                        pictures.set_item(map.map.name(), samples.to_pyarray(py).reshape(shape)?)?
                    }
                    Depth::Sixteen => {
                        let wide: Vec<u16> = samples
                            .chunks_exact(2)
                            .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
                            .collect();
                        pictures.set_item(map.map.name(), wide.to_pyarray(py).reshape(shape)?)?;
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
        Ok(dict)
    }

    /// What verification found.
    fn verify<'py>(&self, py: Python<'py>, texels: bool, memory: usize) -> PyResult<Bound<'py, PyDict>> {
        let options = VerifyOptions { memory_bytes: memory, texels };
        let report = watched(py, None, |_| Ok(verify_asset(self.asset.shared(), &options)))?;
        let dict = PyDict::new(py);
        dict.set_item("ok", report.ok)?;
        dict.set_item("largest_jump", report.continuity.largest_jump)?;
        dict.set_item("bound", JUMP_BOUND)?;
        dict.set_item("edges", report.continuity.edges)?;
        dict.set_item("exempt_edges", report.continuity.exempt_edges)?;
        dict.set_item("needless_splits", report.continuity.needless_splits)?;
        dict.set_item("levels", report.levels)?;
        dict.set_item("damaged_tiles", report.damaged_tiles)?;
        dict.set_item("damage", report.first_damage)?;
        dict.set_item("mesh_faults", report.mesh_faults.iter().map(ToString::to_string).collect::<Vec<_>>())?;
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
        let lambda = rows::<3, f32>(&barycentric, "barycentric")?;
        let faces = faces.as_array();
        let count = self.asset.mesh().triangles.len();
        let normal = |(&face, &lambda): (&i64, &[f32; 3])| {
            let triangle = u32::try_from(face).ok().filter(|&t| (t as usize) < count).ok_or_else(|| {
                PyIndexError::new_err(format!("there is no face {face}; the asset has {count}"))
            })?;
            let point = SurfacePoint { triangle, lambda: Vec3::from(lambda) };
            Ok(self.sampler.vertex_normal(point).to_array())
        };
        let normals = faces.iter().zip(&lambda).map(normal).collect::<PyResult<Vec<_>>>()?;
        array(py, &normals)
    }
}

impl Asset {
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

/// Applies strokes (the JSON of stroke files) to an asset and commits them: strokes, dabs, changed pages.
#[pyfunction]
pub(crate) fn paint(
    py: Python<'_>,
    asset: PathBuf,
    strokes: PathBuf,
    folder: PathBuf,
    history: bool,
    memory: usize,
) -> PyResult<(usize, usize, usize)> {
    watched(py, None, |_| {
        let file = StrokeFile::load(&strokes)?;
        let mut painter = Painter::open(&asset, &PaintOptions { memory_bytes: memory, history })?;
        let summary = replay(&mut painter, &file, &folder)?;
        painter.commit()?;
        Ok((summary.strokes, summary.dabs, summary.pages))
    })
}

/// A picture of 8 bits per sample as a PNG file: grey, RGB or RGBA.
#[pyfunction]
pub(crate) fn encode_png<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray3<'py, u8>,
) -> PyResult<Bound<'py, PyBytes>> {
    let [height, width, channels] = *picture.shape() else {
        return Err(PyValueError::new_err("a picture has rows, columns and channels"));
    };
    if !(1..=4).contains(&channels) || width == 0 || height == 0 {
        let shape = format!("({height}, {width}, {channels})");
        return Err(PyValueError::new_err(format!("a picture has the shape (h, w, 1 to 4), not {shape}")));
    }
    let image = Image {
        width: width as u32,
        height: height as u32,
        channels: channels as u8,
        space: ColorSpace::Srgb,
        samples: Samples::U8(picture.as_array().iter().copied().collect()),
    };
    let bytes = py.detach(|| image.encoded("picture.png")).map_err(exception)?;
    Ok(PyBytes::new(py, &bytes))
}
