//! Looks: their pictures, tables of their textures; normal maps.

use std::path::PathBuf;

use fantex::bake::{NormalMapOptions, NormalSpace, bake_normal_map_until};
use fantex::base::counted;
use fantex::base::random::{DEFAULT_SEED, folded_seed};
use fantex::look::{LookFile, LookImages, ResolveOptions};
use fantex::look_scene::{GivenModel, LookScene, MaterialResolver, PictureChanges};
use fantex::scene::Background;
use fantex::texture::Samples;
use fantex::{Error, LookTable, Progress, look_texture};
use numpy::{PyArray3, PyArray4, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::mesh::Mesh;
use crate::options::{choice, optional};
use crate::picture::{Rendered, View, rendered};
use crate::watch::{heard, watched};

fn resolve_options(seed: u64, memory_bytes: u64) -> ResolveOptions {
    ResolveOptions { memory_bytes, seed: folded_seed(seed), ..ResolveOptions::default() }
}

/// What is in a look.
#[pyfunction]
pub(crate) fn look_figures<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyDict>> {
    let file = watched(py, None, |_| LookFile::read(&path))?;
    let look = file.look();
    let models = look.object.iter().filter_map(|object| object.model.as_ref());
    let figures = PyDict::new(py);
    figures.set_item("kind", "look")?;
    figures.set_item("textures", look.textures.keys().collect::<Vec<_>>())?;
    figures.set_item("materials", look.materials.keys().collect::<Vec<_>>())?;
    figures.set_item("objects", look.object.len())?;
    figures.set_item("lights", look.light.len())?;
    figures.set_item("has_environment", look.environment.is_some())?;
    figures.set_item("frames", look.picture.frames.as_ref().map_or(1, |frames| frames.count))?;
    figures.set_item("models", models.map(|name| file.file(name)).collect::<Vec<_>>())?;
    Ok(figures)
}

/// A picture of a look, on a model where one is given; of an animation at a time in seconds, the first without one.
#[pyfunction]
pub(crate) fn render_look<'py>(
    py: Python<'py>,
    look: PathBuf,
    model: Option<&Mesh>,
    options: &Bound<'py, PyDict>,
    time: Option<f32>,
    seed: u64,
    memory: u64,
) -> PyResult<Rendered<'py>> {
    let view = View::new(options)?;
    let (picture, notes) = watched(py, None, |watch| {
        let file = LookFile::read(&look)?;
        let images = LookImages::default();
        let options = ResolveOptions { filter: view.filter, ..resolve_options(seed, memory) };
        let resolver = MaterialResolver { file: &file, images: &images, options };
        let changes = PictureChanges {
            size: view.size,
            samples: view.samples,
            filter: view.filter,
            background: view.is_transparent.then_some(Background::Transparent),
            ..PictureChanges::default()
        };
        let given =
            model.map(|model| GivenModel { path: model.0.path().to_owned(), mesh: model.geometry().clone() });
        let scene = LookScene::new(resolver, given.as_ref(), changes)?;
        if watch.is_cancelled() {
            return Err(Error::cancelled("the picture was cancelled"));
        }
        let time = time.unwrap_or_else(|| scene.times().first().copied().unwrap_or(0.0));
        let rendering = match &view.camera {
            Some(camera) => scene.render_from(camera, time)?,
            None => scene.render(time)?,
        };
        let mut notes = scene.notes();
        if let count @ 1.. = scene.damaged_tiles() {
            notes.push(format!("coarser texels stand in for {}", counted(count, "damaged tile")));
        }
        Ok((rendering.picture, notes))
    })?;
    rendered(py, &picture, notes)
}

/// A texture of a look as numbers: slices, rows, columns, linear RGBA.
#[pyfunction]
pub(crate) fn table<'py>(
    py: Python<'py>,
    look: PathBuf,
    texture: Option<String>,
    size: [u32; 3],
    options: &Bound<'py, PyDict>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray4<f32>>> {
    let defaults = LookTable::default();
    let corner = |key: &str| optional::<[f64; 3]>(options, key);
    let table = LookTable {
        size,
        from: corner("start")?.map_or(defaults.from, Into::into),
        to: corner("end")?.map_or(defaults.to, Into::into),
        samples: optional(options, "samples")?.unwrap_or(defaults.samples),
        time: optional(options, "time")?.unwrap_or(defaults.time),
        memory_bytes: optional(options, "memory")?.unwrap_or(defaults.memory_bytes),
    };
    let seed: u64 = optional(options, "seed")?.unwrap_or(DEFAULT_SEED);
    let [width, height, slices] = size;
    let texels = watched(py, heard(&progress, "drawing"), |watch| {
        let file = LookFile::read(&look)?;
        let resolve = resolve_options(seed, table.memory_bytes);
        let (_, texture) = look_texture(&file, texture.as_deref(), resolve)?;
        let mut texels: Vec<[f32; 4]> = Vec::new();
        for slice in 0..slices {
            if watch.is_cancelled() {
                return Err(Error::cancelled("the table was cancelled"));
            }
            texels.extend(table.slice(texture.as_ref(), slice)?);
            watch.report(u64::from(slice) + 1, u64::from(slices));
        }
        Ok(texels)
    })?;
    let shape = [slices, height, width, 4].map(|n| n as usize);
    texels.as_flattened().to_pyarray(py).reshape(shape)
}

/// A normal map, its cage in world units, the share of points that found nothing within that, and notes.
type BakedNormals<'py> = (Bound<'py, PyArray3<f32>>, f64, f64, Vec<String>);

/// The normals of a detailed mesh over the texture coordinates of a coarse one: rows, columns, RGB of 0..1; the cage; the share of points that
/// found nothing within it.
#[pyfunction]
pub(crate) fn normal_map<'py>(
    py: Python<'py>,
    coarse: &Mesh,
    detailed: &Mesh,
    options: &Bound<'py, PyDict>,
) -> PyResult<BakedNormals<'py>> {
    let defaults = NormalMapOptions::default();
    let spaces = [("tangent", NormalSpace::Tangent), ("object", NormalSpace::Object)];
    let options = NormalMapOptions {
        size: optional(options, "size")?.unwrap_or(defaults.size),
        uv_set: optional(options, "uv_set")?.unwrap_or(defaults.uv_set),
        space: choice(options, "space", &spaces)?,
        padding: optional(options, "padding")?.unwrap_or(defaults.padding),
        samples: optional(options, "samples")?.unwrap_or(defaults.samples),
        cage: optional(options, "cage")?,
    };
    let (image, report) = watched(py, None, |watch| {
        let is_cancelled = || watch.is_cancelled();
        bake_normal_map_until(coarse.geometry(), detailed.geometry(), &options, &is_cancelled)
    })?;
    let samples = match image.samples {
        Samples::F32(samples) => samples,
        _ => Vec::new(),
    };
    let shape = [image.height as usize, image.width as usize, usize::from(image.channels)];
    let missed = report.missed as f64 / report.points.max(1) as f64;
    let notes = report.coordinates_note().map(|note| format!("the coarse mesh: {note}"));
    Ok((samples.to_pyarray(py).reshape(shape)?, report.cage, missed, notes.into_iter().collect()))
}
