//! Bakes, from everything that the command line takes and from Python's own functions.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::addresses::{Target, check_is_path};
use fantex::export::ExportSummary;
use fantex::glam::Vec3;
use fantex::mesh::AlphaMode;
use fantex::photos::CameraFrame;
use fantex::store;
use fantex::stream::{Replace, open_source};
use fantex::{
    BakeFormat, Baked, Baker, Fit, LongestEdge, Merge, ModelKind, PhotoSet, Quality, Source, model_notes,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::asset::{Asset, name_of};
use crate::export::AtlasFiles;
use crate::function::FunctionSource;
use crate::mesh::Mesh;
use crate::options::{ALPHA_MODES, choice, optional, word};
use crate::watch::{heard, in_python, watched};

/// What a source is made of; the Python side makes nothing else.
#[derive(FromPyObject)]
pub(crate) enum SourceParts<'py> {
    /// What it is, and what it needs.
    Named(String, Bound<'py, PyDict>),
    /// A function of points of the surface.
    Function(Bound<'py, PyAny>),
}

/// A mesh, a source and settings, as Python gives them.
struct Job {
    mesh: Arc<fantex::Mesh>,
    source: JobSource,
    settings: Settings,
}

enum JobSource {
    /// The model's own materials or colours.
    OfModel,
    Function(Py<PyAny>),
    Detailed(Py<Mesh>),
    Asset(Py<Asset>),
    Named(NamedSource),
}

impl Job {
    fn new(mesh: &Mesh, source: Option<SourceParts<'_>>, options: &Bound<'_, PyDict>) -> PyResult<Self> {
        let source = match source {
            None => JobSource::OfModel,
            Some(SourceParts::Function(function)) => JobSource::Function(function.unbind()),
            Some(SourceParts::Named(name, parts)) => {
                match (optional(&parts, "mesh")?, optional(&parts, "asset")?) {
                    (Some(detailed), _) => JobSource::Detailed(detailed),
                    (None, Some(detailed)) => JobSource::Asset(detailed),
                    (None, None) => JobSource::Named(NamedSource::new(&name, &parts)?),
                }
            }
        };
        Ok(Self { mesh: Arc::clone(&mesh.0), source, settings: Settings::new(options)? })
    }

    /// Runs `reach` with a baker that does the job and the file to write, brings that to `place`, and says what the user should know: triangles,
    /// tiles, texels, bytes, channels, seconds, notes; of photographs and baked light more.
    fn run<'py>(
        self,
        py: Python<'py>,
        progress: Option<&Bound<'py, PyAny>>,
        place: &Path,
        reach: impl FnOnce(Baker<'_>, &Path) -> fantex::Result<Baked> + Send,
    ) -> PyResult<Bound<'py, PyDict>> {
        let Self { mesh, source, settings } = self;
        let baked = watched(py, progress.map(|progress| (progress, "baking")), |watch| {
            let target = Target::new(place)?;
            target.check(settings.overwrite)?;
            let file = target.file();
            let mesh = match settings.alpha {
                Some(alpha) => Cow::Owned(mesh.with_alpha_mode(alpha)),
                None => Cow::Borrowed(&*mesh),
            };
            let baker = settings.baker(&mesh).progress(watch);
            let baked = match source {
                JobSource::OfModel => reach(baker, file),
                JobSource::Named(named) => reach(baker.source(named.source()), file),
                JobSource::Detailed(detailed) => {
                    reach(baker.source(Source::loaded_mesh(&detailed.get().0, settings.cage)), file)
                }
                JobSource::Asset(detailed) => {
                    reach(baker.source(Source::asset(detailed.get().asset(), settings.cage)), file)
                }
                JobSource::Function(callable) => {
                    let function = FunctionSource::asked(callable, &mesh, watch)?;
                    reach(baker.source(Source::custom(&function)), file)
                }
            }?;
            target.finish(&replaced(settings.overwrite), &watch.named("uploading"))?;
            Ok(baked)
        })?;
        figures(py, &mesh, baked)
    }
}

/// What the user should know of a bake.
fn figures<'py>(py: Python<'py>, mesh: &fantex::Mesh, baked: Baked) -> PyResult<Bound<'py, PyDict>> {
    let figures = PyDict::new(py);
    figures.set_item("triangles", baked.triangles)?;
    figures.set_item("texels", baked.summary.texels)?;
    figures.set_item("bytes", baked.summary.bytes)?;
    match baked.exported {
        None => {
            figures.set_item("tiles", baked.cover.groups)?;
            figures.set_item("channels", baked.summary.channels)?;
            figures.set_item("cover_seconds", baked.cover_time.as_secs_f64())?;
            figures.set_item("bake_seconds", baked.summary.bake_seconds)?;
        }
        Some(ExportSummary { files, sizes, maps, charts, padding, used_share, .. }) => {
            figures.set_item("files", files.into_iter().map(|(path, _)| path).collect::<Vec<_>>())?;
            figures.set_item("resolution", sizes.as_flattened().iter().max().copied().unwrap_or(0))?;
            figures.set_item("channels", maps.iter().map(|map| map.name()).collect::<Vec<_>>())?;
            figures.set_item("charts", charts)?;
            figures.set_item("padding", padding)?;
            figures.set_item("used_share", used_share)?;
        }
    }
    let notes = mesh.notes().iter().chain(&baked.notes).map(|note| in_python(note, None));
    figures.set_item("notes", notes.collect::<Vec<_>>())?;
    if let Some(report) = &baked.photos {
        figures.set_item("photos", report.photographs)?;
        figures.set_item("photos_used", report.used)?;
        figures.set_item("photos_masked", report.masked)?;
        figures.set_item("unseen_share", report.unseen_share)?;
        let gains: Vec<[f32; 3]> = report.gains.iter().map(|gain| gain.to_array()).collect();
        figures.set_item("gains", gains)?;
        figures.set_item("scratch_bytes", report.scratch_bytes)?;
    }
    if let Some(noise) = &baked.summary.light {
        let light = PyDict::new(py);
        light.set_item("mean_samples", noise.mean_samples)?;
        light.set_item("mean_light", noise.mean_value)?;
        light.set_item("error", noise.mean_error)?;
        light.set_item("error_left", noise.mean_error_left)?;
        figures.set_item("light", light)?;
    }
    Ok(figures)
}

/// What an object in a store may take the place of.
fn replaced(overwrite: bool) -> Replace {
    if overwrite { Replace::Anything } else { Replace::Nothing }
}

/// Bakes into a file.
#[pyfunction]
pub(crate) fn bake<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    path: PathBuf,
    source: Option<SourceParts<'py>>,
    options: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    Job::new(mesh, source, options)?.run(py, progress.as_ref(), &path, |baker, file| baker.write(file))
}

/// A plan in memory: everything of an asset but its texels.
#[pyclass(frozen, module = "fantex")]
pub(crate) struct Plan(store::Plan);

#[pymethods]
impl Plan {
    /// Reads a plan at a path or an address.
    #[new]
    fn open(py: Python<'_>, place: PathBuf) -> PyResult<Self> {
        watched(py, None, |_| store::Plan::open_source(&*open_source(&place)?)).map(Self)
    }

    /// What its writer noted.
    #[getter]
    fn about<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.about)
    }

    #[getter]
    fn channels(&self) -> Vec<&'static str> {
        self.0.channels.iter().map(|channel| name_of(channel.kind)).collect()
    }

    /// Texels per channel, tiles, triangles.
    fn figures(&self) -> (u64, usize, usize) {
        let Self(plan) = self;
        (plan.cover.stored_texels(&plan.mesh), plan.cover.groups.len(), plan.mesh.triangles.len())
    }
}

/// Writes a plan with a note.
#[pyfunction]
pub(crate) fn plan<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    path: PathBuf,
    about: &[u8],
    source: Option<SourceParts<'py>>,
    options: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    Job::new(mesh, source, options)?
        .run(py, progress.as_ref(), &path, |baker, file| baker.write_plan(file, about))
}

/// Bakes shard `shard[0]` of `shard[1]` of a plan.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
pub(crate) fn bake_part<'py>(
    py: Python<'py>,
    plan: &Plan,
    shard: [u32; 2],
    mesh: &Mesh,
    path: PathBuf,
    source: Option<SourceParts<'py>>,
    options: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let [number, count] = shard;
    Job::new(mesh, source, options)?
        .run(py, progress.as_ref(), &path, |baker, file| baker.write_part(&plan.0, number, count, file))
}

/// Merges parts into an asset, or only checks them; gives the bytes written, and what is to be known of it.
#[pyfunction]
pub(crate) fn merge(
    py: Python<'_>,
    plan: &Plan,
    parts: Vec<PathBuf>,
    path: Option<PathBuf>,
    overwrite: bool,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<(u64, Option<String>)> {
    let merged =
        watched(py, heard(&progress, if path.is_some() { "merging" } else { "checking" }), |watch| {
            let merge = Merge { plan: &plan.0, parts: &parts, force: overwrite };
            let Some(path) = &path else { return merge.check(watch) };
            Target::new(path)?.check(overwrite)?;
            merge.write(path, [watch, &watch.named("copying"), &watch.named("uploading")])
        })?;
    Ok((merged.written.bytes, merged.note))
}

/// Bakes into a `.glb` or `.gltf` with ordinary texture coordinates.
#[pyfunction]
pub(crate) fn bake_model<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    path: PathBuf,
    source: Option<SourceParts<'py>>,
    options: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    check_is_path(&path).map_err(crate::watch::exception)?;
    let files = AtlasFiles::new(options)?;
    Job::new(mesh, source, options)?.run(py, progress.as_ref(), &path, |baker, file| {
        let mut baked = baker.write_model(file, &files.options())?;
        if let Some(written) = &baked.exported {
            baked.notes.extend(model_notes(file, written, ModelKind::Baked { side: files.side }));
        }
        Ok(baked)
    })
}

enum NamedSource {
    OwnMaterials,
    VertexColors,
    Solid(String),
    Look(PathBuf),
    Image(PathBuf, fantex::MappingKind),
    Photos(PhotoSet),
}

impl NamedSource {
    fn new(name: &str, parts: &Bound<'_, PyDict>) -> PyResult<Self> {
        let missing = |key: &str| PyTypeError::new_err(format!("the source {name:?} needs {key}"));
        let path = || optional::<PathBuf>(parts, "path")?.ok_or_else(|| missing("a path"));
        Ok(match name {
            "uv" => Self::OwnMaterials,
            "vertex_colors" => Self::VertexColors,
            "mesh" => return Err(missing("a mesh")),
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
            Self::OwnMaterials => Source::own_materials(),
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
    hard_edges: Option<f32>,
    alpha: Option<AlphaMode>,
    longest_edge: Option<LongestEdge>,
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
            hard_edges: optional(options, "hard_edges")?,
            alpha: word(options, "alpha", &ALPHA_MODES)?,
            longest_edge: longest_edge(options)?,
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
        if let Some(longest_edge) = self.longest_edge {
            baker = baker.longest_edge(longest_edge);
        }
        if let Some(texels) = self.texels {
            baker = baker.texels(texels);
        }
        if let Some(density) = self.density {
            baker = baker.density(density);
        }
        if let Some(tile) = self.tile {
            baker = baker.tile(tile);
        }
        if let Some(degrees) = self.hard_edges {
            baker = baker.hard_edges(degrees);
        }
        if self.match_source { baker.matching() } else { baker }
    }
}

/// Texels or ``auto``.
fn longest_edge(options: &Bound<'_, PyDict>) -> PyResult<Option<LongestEdge>> {
    match optional(options, "longest_edge")? {
        None => Ok(None),
        Some(LongestEdgeArg::Texels(texels)) => Ok(Some(LongestEdge::Texels(texels))),
        Some(LongestEdgeArg::Word(word)) if word == "auto" => Ok(Some(LongestEdge::Automatic)),
        Some(LongestEdgeArg::Word(word)) => Err(PyValueError::new_err(format!(
            "longest_edge is {word:?}, not a number of texels or \"auto\""
        ))),
    }
}

#[derive(FromPyObject)]
enum LongestEdgeArg {
    Texels(u32),
    Word(String),
}
