//! Functions of Python as sources of bakes.

use fantex::bake::{Prefilter, Source, SourceChannel, TexelPoint, TrianglePlane};
use fantex::glam::{Vec3, Vec4};
use fantex::mesh::{Mesh, WorldFromMesh};
use fantex::store::ChannelKind;
use fantex::{Error, Progress};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arrays::array;
use crate::asset::CHANNELS;
use crate::options::named;
use crate::watch::Watch;

/// A Python function of positions (world) and normals, and of what else it has parameters for. Python's side, an object of `_function.py`, brings
/// what it gives into one form: an array of `float32` with a row for each point, and in it four numbers for each channel.
pub(crate) struct FunctionSource<'a> {
    function: Py<PyAny>,
    parameters: Parameters,
    channels: Vec<SourceChannel>,
    world_from_mesh: WorldFromMesh,
    watch: &'a Watch,
}

/// Which parameters it has besides positions and normals.
#[derive(Clone, Copy, Default)]
struct Parameters {
    footprint: bool,
    face: bool,
    barycentric: bool,
}

impl<'a> FunctionSource<'a> {
    /// Asks for the middle of the first triangle, as if that were one texel, and so learns which channels there are.
    pub(crate) fn asked(function: Py<PyAny>, mesh: &Mesh, watch: &'a Watch) -> fantex::Result<Self> {
        let world_from_mesh = mesh.world_from_mesh;
        let (parameters, channels) = (Parameters::default(), Vec::new());
        let mut source = Self { function, parameters, channels, world_from_mesh, watch };
        let sides = [Vec3::new(-1.0, 1.0, 0.0), Vec3::new(-1.0, 0.0, 1.0)];
        let middle = TrianglePlane::new(mesh, &[], 0, sides).point(Vec3::splat(1.0 / 3.0));
        match Python::attach(|py| source.ask(py, &middle)) {
            Ok(()) => Ok(source),
            Err(raised) => {
                watch.fail(raised);
                Err(Error::cancelled("the source failed"))
            }
        }
    }

    fn ask(&mut self, py: Python<'_>, point: &TexelPoint) -> PyResult<()> {
        let function = self.function.bind(py);
        let parameters: Vec<String> = function.getattr("parameters")?.extract()?;
        let has = |name: &str| parameters.iter().any(|parameter| parameter == name);
        self.parameters =
            Parameters { footprint: has("footprint"), face: has("face"), barycentric: has("barycentric") };
        let (positional, by_name) = self.arguments(py, std::slice::from_ref(point))?;
        let channels = function.call_method("first", positional, Some(&by_name))?;
        let channels: Vec<(String, bool)> = channels.extract()?;
        let channel = |(name, has_alpha): &(String, bool)| {
            let kind = named("channel", name, &CHANNELS)?;
            Ok(SourceChannel { has_alpha: *has_alpha, ..SourceChannel::new(kind) })
        };
        self.channels = channels.iter().map(channel).collect::<PyResult<_>>()?;
        Ok(())
    }

    /// What the function is told of points: positions and normals, and the rest by name.
    fn arguments<'py>(
        &self,
        py: Python<'py>,
        points: &[TexelPoint],
    ) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let positions: Vec<[f64; 3]> =
            points.iter().map(|p| self.world_from_mesh.point(p.position).to_array()).collect();
        let normals: Vec<[f32; 3]> = points.iter().map(|p| p.normal.to_array()).collect();
        let by_name = PyDict::new(py);
        if self.parameters.footprint {
            let scale = self.world_from_mesh.scale;
            let widths: Vec<f64> = points.iter().map(|p| f64::from(p.width()) * scale).collect();
            by_name.set_item("footprint", widths.to_pyarray(py))?;
        }
        if self.parameters.face {
            let faces: Vec<u32> = points.iter().map(|p| p.at.triangle).collect();
            by_name.set_item("face", faces.to_pyarray(py))?;
        }
        if self.parameters.barycentric {
            let weights: Vec<[f32; 3]> = points.iter().map(|p| p.at.lambda.to_array()).collect();
            by_name.set_item("barycentric", array(py, &weights)?)?;
        }
        let positional = (array(py, &positions)?, array(py, &normals)?).into_pyobject(py)?;
        Ok((positional, by_name))
    }

    fn call(&self, py: Python<'_>, points: &[TexelPoint], values: &mut [Vec4]) -> PyResult<()> {
        let (positional, by_name) = self.arguments(py, points)?;
        let given = self.function.bind(py).call(positional, Some(&by_name))?;
        let given: PyReadonlyArray2<'_, f32> = given.extract()?;
        let numbers = given.as_slice()?;
        if given.shape()[0] != points.len() || numbers.len() != 4 * values.len() {
            return Err(PyValueError::new_err(
                "the source gave another number of values than it was asked for",
            ));
        }
        values.iter_mut().zip(numbers.chunks_exact(4)).for_each(|(value, n)| *value = Vec4::from_slice(n));
        let normal = self.channels.iter().position(|channel| channel.kind == ChannelKind::Normal);
        if let Some(normal) = normal {
            for (point, values) in points.iter().zip(values.chunks_mut(self.channels.len())) {
                // No direction: the surface's own.
                if values[normal] == Vec4::ZERO {
                    values[normal] = point.normal.extend(0.0);
                }
            }
        }
        Ok(())
    }
}

impl Source for FunctionSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn points_at_once(&self) -> usize {
        4096
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        self.evaluate_all(std::slice::from_ref(point), values);
    }

    fn evaluate_all(&self, points: &[TexelPoint], values: &mut [Vec4]) {
        // Functions of arrays seldom expect none: blocks that nothing reads have no points.
        if points.is_empty() || self.watch.is_cancelled() {
            return;
        }
        if let Err(raised) = Python::attach(|py| self.call(py, points, values)) {
            self.watch.fail(raised);
        }
    }
}
