//! Bakes, from everything that the command line takes and from Python's own functions.

use std::path::PathBuf;

use fantex::bake::{Prefilter, Source as BakeSource, TexelPoint};
use fantex::glam::{Vec3, Vec4};
use fantex::mesh::WorldFromMesh;
use fantex::photos::CameraFrame;
use fantex::{BakeFormat, Baker, Fit, PhotoSet, Quality, Source};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{array, rows};
use crate::mesh::Mesh;
use crate::watch::{Watch, watched};

/// What a source is made of; the Python side makes nothing else.
#[derive(FromPyObject)]
pub(crate) enum SourceParts<'py> {
    /// What it is, and what it needs.
    Named(String, Bound<'py, PyDict>),
    /// A function of points and normals.
    Function(Bound<'py, PyAny>),
}

/// Bakes into a file; says what the user should know: triangles, tiles, texels, bytes, channels, seconds, notes.
#[pyfunction]
pub(crate) fn bake<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    path: PathBuf,
    source: Option<SourceParts<'py>>,
    options: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let detailed: Option<Py<Mesh>> = match &source {
        Some(SourceParts::Named(_, parts)) => optional(parts, "mesh")?,
        _ => None,
    };
    let function: Option<Py<PyAny>> = match &source {
        Some(SourceParts::Function(function)) => Some(function.clone().unbind()),
        _ => None,
    };
    let named = match source {
        Some(SourceParts::Named(name, parts)) => Some(NamedSource::new(&name, &parts)?),
        _ => None,
    };
    let settings = Settings::new(options)?;
    let world_from_mesh = mesh.0.world_from_mesh;
    let baked = watched(py, progress.as_ref(), |watch| {
        let function = function.map(|callable| FunctionSource { callable, world_from_mesh, watch });
        let mut baker = settings.baker(&mesh.0).progress(watch);
        if let Some(function) = &function {
            baker = baker.source(Source::custom(function));
        } else if let Some(detailed) = &detailed {
            let cage = settings.cage;
            baker = baker.source(Source::loaded_mesh(&detailed.get().0, cage));
        } else if let Some(named) = named {
            baker = baker.source(named.source());
        }
        baker.write(&path)
    })?;
    let figures = PyDict::new(py);
    figures.set_item("triangles", baked.triangles)?;
    figures.set_item("tiles", baked.cover.groups)?;
    figures.set_item("texels", baked.summary.texels)?;
    figures.set_item("bytes", baked.summary.bytes)?;
    figures.set_item("channels", baked.summary.channels)?;
    figures.set_item("cover_seconds", baked.cover_time.as_secs_f64())?;
    figures.set_item("bake_seconds", baked.summary.bake_seconds)?;
    figures.set_item("notes", baked.notes)?;
    Ok(figures)
}

/// The value of a key that may be missing or None.
fn optional<'py, T>(parts: &Bound<'py, PyDict>, key: &str) -> PyResult<Option<T>>
where
    T: for<'a> FromPyObject<'a, 'py, Error: Into<PyErr>>,
{
    match parts.get_item(key)?.filter(|value| !value.is_none()) {
        Some(value) => value.extract().map(Some).map_err(Into::into),
        None => Ok(None),
    }
}

enum NamedSource {
    OwnMaterials,
    VertexColors,
    Solid(String),
    Look(PathBuf),
    Image(PathBuf, fantex::MappingKind),
    Photos(PhotoSet),
    /// Given as a mesh beside it.
    Mesh,
}

impl NamedSource {
    fn new(name: &str, parts: &Bound<'_, PyDict>) -> PyResult<Self> {
        let missing = |key: &str| PyTypeError::new_err(format!("the source {name:?} needs {key}"));
        let path = || optional::<PathBuf>(parts, "path")?.ok_or_else(|| missing("a path"));
        Ok(match name {
            "uv" => Self::OwnMaterials,
            "vertex_colors" => Self::VertexColors,
            "mesh" => Self::Mesh,
            "solid" => Self::Solid(optional(parts, "name")?.ok_or_else(|| missing("a name"))?),
            "look" => Self::Look(path()?),
            "image" => {
                let mapping: String = optional(parts, "mapping")?.ok_or_else(|| missing("a mapping"))?;
                Self::Image(path()?, mapping.parse().map_err(crate::watch::exception)?)
            }
            "photos" => Self::Photos(PhotoSet {
                path: path()?,
                images: optional(parts, "images")?,
                frame: match optional::<bool>(parts, "original_frame")? {
                    Some(true) => CameraFrame::Original,
                    _ => CameraFrame::OfFile,
                },
                keep_exposure: optional(parts, "keep_exposure")?.unwrap_or(false),
                unseen: optional::<[f32; 3]>(parts, "unseen")?.map(Vec3::from),
            }),
            _ => return Err(PyValueError::new_err(format!("there is no source {name:?}"))),
        })
    }

    fn source(self) -> Source<'static> {
        match self {
            Self::OwnMaterials | Self::Mesh => Source::own_materials(),
            Self::VertexColors => Source::vertex_colors(),
            Self::Solid(name) => Source::solid(name),
            Self::Look(path) => Source::look(path),
            Self::Image(path, mapping) => Source::image(path, mapping),
            Self::Photos(photos) => Source::photos(photos),
        }
    }
}

/// What a baker is told.
struct Settings {
    texels: Option<u64>,
    density: Option<f64>,
    match_source: bool,
    tile: Option<u32>,
    longest_edge: Option<u32>,
    format: BakeFormat,
    fit: Fit,
    quality: Quality,
    overwrite: bool,
    memory: u64,
    seed: u64,
    cage: Option<f64>,
}

impl Settings {
    fn new(options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let formats = [
            ("bc7", BakeFormat::Bc7),
            ("bc1", BakeFormat::Bc1),
            ("rgba8", BakeFormat::Rgba8),
            ("float", BakeFormat::Float),
        ];
        let fits = [("sharp", Fit::Sharp), ("point", Fit::Point), ("box", Fit::Box)];
        let qualities = [
            ("ultra-fast", Quality::UltraFast),
            ("very-fast", Quality::VeryFast),
            ("fast", Quality::Fast),
            ("basic", Quality::Basic),
        ];
        Ok(Self {
            texels: optional(options, "texels")?,
            density: optional(options, "density")?,
            match_source: optional(options, "match")?.unwrap_or(false),
            tile: optional(options, "tile")?,
            longest_edge: optional(options, "longest_edge")?,
            format: choice(options, "format", &formats)?,
            fit: choice(options, "fit", &fits)?,
            quality: choice(options, "quality", &qualities)?,
            overwrite: optional(options, "overwrite")?.unwrap_or(false),
            memory: optional(options, "memory")?.unwrap_or(1 << 30),
            seed: optional(options, "seed")?.unwrap_or(1),
            cage: optional(options, "cage")?,
        })
    }

    fn baker<'a>(&self, mesh: &'a fantex::Mesh) -> Baker<'a> {
        let mut baker = Baker::new(mesh)
            .format(self.format)
            .fit(self.fit)
            .quality(self.quality)
            .overwrite(self.overwrite)
            .memory(self.memory)
            .seed(self.seed);
        if let Some(texels) = self.texels {
            baker = baker.texels(texels);
        }
        if let Some(density) = self.density {
            baker = baker.density(density);
        }
        if let Some(tile) = self.tile {
            baker = baker.tile(tile);
        }
        if let Some(texels) = self.longest_edge {
            baker = baker.longest_edge(texels);
        }
        if self.match_source { baker.matching() } else { baker }
    }
}

/// One of several words; the first where none is given.
fn choice<T: Copy>(options: &Bound<'_, PyDict>, key: &str, choices: &[(&str, T)]) -> PyResult<T> {
    let Some(word) = optional::<String>(options, key)? else { return Ok(choices[0].1) };
    choices.iter().find(|(name, _)| *name == word).map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
        PyValueError::new_err(format!("{key} {word:?} is none of {}", names.join(", ")))
    })
}

/// A Python function of positions (world) and normals that gives linear RGBA, all as arrays with a row per point.
struct FunctionSource<'a> {
    callable: Py<PyAny>,
    world_from_mesh: WorldFromMesh,
    watch: &'a Watch,
}

impl FunctionSource<'_> {
    fn call(&self, py: Python<'_>, points: &[TexelPoint], values: &mut [Vec4]) -> PyResult<()> {
        let positions: Vec<[f64; 3]> =
            points.iter().map(|p| self.world_from_mesh.point(p.position).to_array()).collect();
        let normals: Vec<[f32; 3]> = points.iter().map(|p| p.normal.to_array()).collect();
        let colors = self.callable.bind(py).call1((array(py, &positions)?, array(py, &normals)?))?;
        let colors: PyReadonlyArray2<'_, f32> = colors.extract()?;
        let colors = rows::<4, f32>(&colors, "the source's result")?;
        if colors.len() != values.len() {
            let (asked, given) = (values.len(), colors.len());
            let message = format!("the source was asked for {asked} colours and gave {given}");
            return Err(PyValueError::new_err(message));
        }
        values.iter_mut().zip(colors).for_each(|(value, color)| *value = Vec4::from(color));
        Ok(())
    }
}

impl BakeSource for FunctionSource<'_> {
    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        self.evaluate_all(std::slice::from_ref(point), values);
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        use fantex::Progress;
        if self.watch.is_cancelled() {
            return;
        }
        if let Err(raised) = Python::attach(|py| self.call(py, points, values)) {
            self.watch.fail(raised);
        }
    }
}
