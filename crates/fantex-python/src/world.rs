//! Worlds: their index, pictures, exports and checks; splits and changes.

use std::ffi::OsString;
use std::path::PathBuf;

use fantex::addresses::{check_is_path, is_address};
use fantex::base::{are, counted};
use fantex::store::{JUMP_BOUND, VerifyOptions};
use fantex::{
    Error, PreviewOptions, SectorPreviews, SplitOptions, StoreFolder, WorldChange, WorldScene, damage_note,
    export_world, export_world_fans, verify_world,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::asset::Asset;
use crate::export::{AtlasFiles, Exported, exported_fans, fan_files};
use crate::picture::{Rendered, View, rendered};
use crate::watch::{heard, in_python, watched};

/// Triangles, texels, length of the finest detail.
type PreviewParts = (u64, u64, f64);

/// Name, place, bytes, triangles, texels, corners of the box, preview.
type ObjectParts = (String, OsString, u64, u64, u64, [f64; 3], [f64; 3], Option<PreviewParts>);

/// Name, place, bytes, triangles, texels, corners of the box, length of the finest detail, names of the parts.
type CoarseParts = (String, OsString, u64, u64, u64, [f64; 3], [f64; 3], f64, Vec<String>);

/// The index of a world, and where it was read.
#[pyclass(frozen, module = "fantex")]
pub(crate) struct World {
    place: PathBuf,
    world: fantex::World,
}

impl World {
    /// Where an asset of the index is: a path or an address.
    fn place_of(&self, asset: &str) -> OsString {
        fantex::World::place_of(&self.place, asset).into_os_string()
    }
}

#[pymethods]
impl World {
    /// Reads an index at a path or an address.
    #[new]
    fn open(py: Python<'_>, place: PathBuf) -> PyResult<Self> {
        let world = watched(py, None, |_| fantex::World::open(&place))?;
        Ok(Self { place, world })
    }

    #[getter]
    fn objects(&self) -> Vec<ObjectParts> {
        let parts = |object: &fantex::WorldObject| {
            let preview = object.preview.map(|preview| (preview.triangles, preview.texels, preview.detail));
            let (name, place) = (object.asset.clone(), self.place_of(&object.asset));
            (name, place, object.bytes, object.triangles, object.texels, object.low, object.high, preview)
        };
        self.world.objects.iter().map(parts).collect()
    }

    #[getter]
    fn coarse(&self) -> Vec<CoarseParts> {
        let parts = |coarse: &fantex::WorldCoarse| {
            let fantex::WorldCoarse { asset, bytes, triangles, texels, low, high, detail, parts } =
                coarse.clone();
            let place = self.place_of(&asset);
            (asset, place, bytes, triangles, texels, low, high, detail, parts)
        };
        self.world.coarse.iter().map(parts).collect()
    }

    /// A picture: rows, columns, RGBA of 8 bits in sRGB.
    fn render<'py>(
        &self,
        py: Python<'py>,
        options: &Bound<'py, PyDict>,
        memory: u64,
    ) -> PyResult<Rendered<'py>> {
        let view = View::new(options)?;
        let (picture, notes) = watched(py, None, |_| {
            let Self { place, world } = self;
            let camera = view.camera_of_world(place, world)?;
            if let Some(defect) = camera.defect() {
                return Err(Error::invalid(format!("the camera cannot take a picture: {defect}")));
            }
            let scene = WorldScene::open(place, world, &camera, view.size(), memory)?;
            let picture = view.take(scene.mesh(), &scene.surface(view.filter()), &camera)?;
            let mut notes: Vec<String> =
                scene.damage().filter_map(|damage| damage_note(place, &damage)).collect();
            if scene.coarse() > 0 {
                let (objects, are) = (counted(scene.coarse(), "object"), are(scene.coarse()));
                notes.push(format!("{objects} {are} coarser than the picture could show; give more memory="));
            }
            Ok((picture, notes))
        })?;
        rendered(py, &picture, notes)
    }

    /// Writes one model, a node for each asset, with ordinary texture coordinates.
    fn export(
        &self,
        py: Python<'_>,
        path: PathBuf,
        options: &Bound<'_, PyDict>,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Exported> {
        let options = AtlasFiles::new(options)?;
        let written = watched(py, heard(&progress, "exporting"), |watch| {
            check_is_path(&path)?;
            export_world(&self.place, &self.world, &path, &options.options(), watch)
        })?;
        Ok(options.exported(&self.place, &path, written))
    }

    /// Writes one model, a node for each asset, with the fans themselves.
    fn export_fans(
        &self,
        py: Python<'_>,
        path: PathBuf,
        options: &Bound<'_, PyDict>,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Exported> {
        let options = fan_files(options)?;
        let written = watched(py, heard(&progress, "exporting"), |watch| {
            check_is_path(&path)?;
            export_world_fans(&self.place, &self.world, &path, &options, watch)
        })?;
        Ok(exported_fans(&self.place, &path, written))
    }
}

/// What verification of the world at a path or an address found.
#[pyfunction]
pub(crate) fn verify_index<'py>(
    py: Python<'py>,
    place: PathBuf,
    texels: bool,
    memory: usize,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let options = VerifyOptions { memory_bytes: memory, texels };
    let report = watched(py, heard(&progress, "verifying"), |watch| verify_world(&place, &options, watch))?;
    let dict = PyDict::new(py);
    dict.set_item("ok", report.ok)?;
    dict.set_item("objects", report.objects.len())?;
    dict.set_item("coarse", report.coarse.len())?;
    let faulty = report.objects.iter().chain(&report.coarse).filter(|object| !object.ok).count();
    dict.set_item("faulty", faulty)?;
    dict.set_item("seam_edges", report.seam_edges)?;
    dict.set_item("largest_jump", report.largest_jump)?;
    dict.set_item("bound", JUMP_BOUND)?;
    dict.set_item("faults", said(report.faults()))?;
    Ok(dict)
}

/// Splits an asset into a world in a folder, of a store, too. `previews`: their triangles and texels, where any are made.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
pub(crate) fn split<'py>(
    py: Python<'py>,
    asset: &Asset,
    folder: PathBuf,
    triangles: usize,
    previews: Option<(Option<usize>, Option<u64>)>,
    overwrite: bool,
    memory: u64,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let previews = previews.map(|(triangles, texels)| SectorPreviews { triangles, texels });
    let options = SplitOptions { triangles, previews, memory_bytes: memory, force: overwrite };
    let asset = asset.asset().shared();
    let written = watched(py, heard(&progress, "splitting"), |watch| match is_address(&folder) {
        true => {
            let folder = StoreFolder::of_split(&folder, asset.path(), overwrite)?;
            folder.split(asset, &options, [watch, &watch.named("uploading")])
        }
        false => fantex::split(asset, &folder, &options, watch),
    })?;
    let figures = PyDict::new(py);
    // As text: Python's paths have one slash where addresses have two.
    figures.set_item("index", written.index.into_os_string())?;
    figures.set_item("sectors", written.world.objects.len())?;
    figures.set_item("coarse", written.world.coarse.len())?;
    figures.set_item("repeated_texels", written.repeated_texels)?;
    figures.set_item("notes", said(written.notes))?;
    Ok(figures)
}

/// Adds assets to an index, reads them again, takes them out; makes the index where there is none.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
pub(crate) fn change_world<'py>(
    py: Python<'py>,
    index: PathBuf,
    put: Vec<PathBuf>,
    remove: Vec<PathBuf>,
    make_previews: bool,
    make_coarse: bool,
    memory: u64,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let previews = PreviewOptions { keeps_borders: true, memory_bytes: memory, ..PreviewOptions::default() };
    let change = WorldChange {
        put: &put,
        remove: &remove,
        previews: make_previews.then_some(previews),
        coarse: make_coarse.then_some(previews),
    };
    let changed =
        watched(py, heard(&progress, "changing"), |watch| fantex::change_world(&index, &change, watch))?;
    let figures = PyDict::new(py);
    figures.set_item("index", index.into_os_string())?;
    figures.set_item("added", changed.added)?;
    figures.set_item("updated", changed.updated)?;
    figures.set_item("removed", changed.removed)?;
    figures.set_item("coarse_removed", changed.coarse_removed)?;
    figures.set_item("previews_made", changed.previews_made)?;
    figures.set_item("coarse_made", changed.coarse_made)?;
    figures.set_item("notes", said(changed.notes))?;
    Ok(figures)
}

/// Sentences with arguments where these name flags.
fn said(notes: Vec<String>) -> Vec<String> {
    notes.iter().map(|note| in_python(note, None)).collect()
}
