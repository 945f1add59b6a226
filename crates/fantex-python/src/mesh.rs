//! Meshes: from files, from arrays, and their unwrapping.

use std::path::PathBuf;
use std::sync::Arc;

use fantex::addresses::check_is_path;
use fantex::base::counted;
use fantex::export::{UnwrapOptions, unwrap_triangles};
use fantex::glam::{DVec3, Mat3, Vec2, Vec3, Vec4};
use fantex::look::look_of_model;
use fantex::mesh::{
    CleanOptions, CornerAttributes, ImageSource, LoadOptions, Material, Mesh as Geometry, Model, TextureRef,
    Topology, VertexCorners, WrapMode, WriteGeometry, cut_polygons as cut, load_bytes, write_model,
};
use fantex::render::LookSurface;
use fantex::texture::ColorSpace;
use fantex::texture::material::read_image;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyDict;

use crate::arrays::{array, rows, triangles};
use crate::asset::Asset;
use crate::picture::{Rendered, View, rendered};
use crate::watch::{heard, in_python, watched};

/// A mesh, loaded and cleaned.
#[pyclass(frozen, module = "fantex")]
pub(crate) struct Mesh(pub(crate) Arc<fantex::Mesh>);

impl Mesh {
    /// The triangles, with what lies at their corners.
    pub(crate) fn geometry(&self) -> &Geometry {
        &self.0
    }
}

#[pymethods]
impl Mesh {
    /// Reads a model file, or the mesh of an asset.
    #[staticmethod]
    #[pyo3(signature = (path, weld=None))]
    fn load(py: Python<'_>, path: PathBuf, weld: Option<f64>) -> PyResult<Self> {
        watched(py, None, |_| fantex::Mesh::open_with(&path, &CleanOptions::welding(weld)))
            .map(|mesh| Self(Arc::new(mesh)))
    }

    /// Reads a model from the bytes of a `.glb`; `path` names it in messages, `notes` are known of it already.
    #[staticmethod]
    #[pyo3(signature = (bytes, path, notes, weld=None))]
    fn of_glb(
        py: Python<'_>,
        bytes: PyBackedBytes,
        path: PathBuf,
        notes: Vec<String>,
        weld: Option<f64>,
    ) -> PyResult<Self> {
        let mesh = watched(py, None, |_| {
            let mut model = load_bytes(&path, &bytes, &LoadOptions::default())?;
            model.notes.splice(0..0, notes);
            fantex::Mesh::from_model_with(model, &path, &CleanOptions::welding(weld))
        })?;
        Ok(Self(Arc::new(mesh)))
    }

    /// Takes triangles: positions in world units, colours linear RGBA, texture coordinates with v upwards, an encoded image, and whether
    /// that is known to be sound.
    #[staticmethod]
    #[pyo3(signature = (positions, faces, colors=None, normals=None, uv=None, image=None, is_sound=false, weld=None))]
    #[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
    fn of_arrays(
        py: Python<'_>,
        positions: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, i64>,
        colors: Option<PyReadonlyArray2<'_, f32>>,
        normals: Option<PyReadonlyArray2<'_, f32>>,
        uv: Option<PyReadonlyArray2<'_, f32>>,
        image: Option<Vec<u8>>,
        is_sound: bool,
        weld: Option<f64>,
    ) -> PyResult<Self> {
        let positions = rows::<3, f64>(&positions, "positions")?;
        let faces = triangles(&faces, positions.len())?;
        let count = positions.len();
        let colors = per_corner::<4, Vec4>(colors, "colors", &faces, count)?;
        let normals = per_corner::<3, Vec3>(normals, "normals", &faces, count)?;
        let mut uv = per_corner::<2, Vec2>(uv, "uv", &faces, count)?;
        uv.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
        let corners = CornerAttributes {
            normals: normals.into_iter().map(Vec3::normalize_or_zero).collect(),
            uv_sets: if uv.is_empty() { Vec::new() } else { vec![uv] },
            colors,
            tangents: Vec::new(),
        };
        let mut model = Model {
            name: "the mesh".to_owned(),
            positions: positions.into_iter().map(DVec3::from).collect(),
            triangles: faces,
            corners,
            ..Model::default()
        };
        if let Some(bytes) = image {
            let texture = TextureRef {
                image: 0,
                uv_set: 0,
                uv_transform: Mat3::IDENTITY,
                wrap: [WrapMode::Repeat; 2],
                nearest: false,
            };
            let label = "the image of the mesh".to_owned();
            model.images = vec![ImageSource::Embedded { label, bytes: bytes.into() }];
            model.materials = vec![Material { base_color_texture: Some(texture), ..Material::default() }];
        }
        let mesh = watched(py, None, |_| {
            // Given by hand, it is not left out.
            if !is_sound {
                model.images.iter().try_for_each(|image| read_image(image, ColorSpace::Srgb).map(drop))?;
            }
            fantex::Mesh::from_model_with(model, "the mesh", &CleanOptions::welding(weld))
        })?;
        Ok(Self(Arc::new(mesh)))
    }

    /// The mesh of an open asset.
    #[staticmethod]
    fn of_asset(py: Python<'_>, asset: &Asset) -> Self {
        Self(Arc::new(py.detach(|| fantex::Mesh::of_asset(asset.asset()))))
    }

    /// The same shape with about so many triangles.
    fn simplified(&self, py: Python<'_>, triangles: usize) -> PyResult<Self> {
        watched(py, None, |_| self.0.simplified(triangles)).map(|mesh| Self(Arc::new(mesh)))
    }

    /// Writes positions and triangles: `.ply`, `.obj` or `.glb`.
    fn save(&self, py: Python<'_>, path: PathBuf, overwrite: bool) -> PyResult<()> {
        let mesh = self.geometry();
        watched(py, None, |_| {
            check_is_path(&path)?;
            let positions: Vec<DVec3> =
                mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p)).collect();
            let geometry = WriteGeometry { positions: &positions, triangles: &mesh.triangles, colors: None };
            write_model(&path, &geometry, overwrite)
        })
    }

    /// Its own materials as a look, TOML.
    fn look(&self, py: Python<'_>) -> PyResult<String> {
        let path = self.0.path();
        let text = watched(py, None, |_| {
            look_of_model(self.geometry()).look.to_toml().map_err(|problem| problem.in_file(path))
        })?;
        Ok(format!("# The materials of {}, as a look.\n\n{text}", path.display()))
    }

    /// A picture of it with its own materials: rows, columns, RGBA of 8 bits in sRGB.
    fn render<'py>(&self, py: Python<'py>, options: &Bound<'py, PyDict>) -> PyResult<Rendered<'py>> {
        let view = View::new(options)?;
        let mesh = self.geometry();
        let (picture, notes) = watched(py, None, |_| {
            let surface = LookSurface::of_model(mesh, view.filter())?;
            Ok((view.take(mesh, &surface, &view.camera(mesh))?, surface.left_out().notes()))
        })?;
        rendered(py, &picture, notes)
    }

    /// Counts of what it is made of, and its shape.
    fn figures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mesh = self.geometry();
        let shape = watched(py, None, |_| {
            let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
            Ok(Topology::of(&mesh.triangles, &corners))
        })?;
        let figures = PyDict::new(py);
        figures.set_item("kind", "model")?;
        figures.set_item("triangles", mesh.triangles.len())?;
        figures.set_item("vertices", mesh.positions.len())?;
        figures.set_item("components", shape.components)?;
        figures.set_item("boundary_edges", shape.edges_boundary)?;
        figures.set_item("nonmanifold_edges", shape.edges_non_manifold)?;
        figures.set_item("nonmanifold_vertices", shape.vertices_non_manifold)?;
        figures.set_item("genus", shape.genus())?;
        figures.set_item("materials", mesh.materials.len())?;
        figures.set_item("uv_sets", mesh.corners.uv_sets.len())?;
        figures.set_item("has_colors", self.0.has_vertex_colors())?;
        Ok(figures)
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        world_positions(py, &self.0)
    }

    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        array(py, &self.0.triangles)
    }

    /// Linear RGBA by face and corner, and likewise the next two.
    #[getter]
    fn colors<'py>(&self, py: Python<'py>) -> PyResult<Option<ByCorner<'py>>> {
        by_corner(py, &self.0.corners.colors, Vec4::to_array)
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Option<ByCorner<'py>>> {
        by_corner(py, &self.0.corners.normals, Vec3::to_array)
    }

    /// With v upwards.
    #[getter]
    fn uv<'py>(&self, py: Python<'py>) -> PyResult<Option<ByCorner<'py>>> {
        self.0.corners.uv_sets.first().map_or(Ok(None), |uv| by_corner(py, uv, upwards))
    }

    #[getter]
    fn source_faces<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let sources: Vec<u32> =
            (0..self.0.triangles.len()).map(|t| self.0.origins().triangle(t) as u32).collect();
        sources.to_pyarray(py)
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes().iter().map(|note| in_python(note, None)).collect()
    }

    #[getter]
    fn has_materials(&self) -> bool {
        self.0.has_materials()
    }

    #[getter]
    fn has_colors(&self) -> bool {
        self.0.has_vertex_colors()
    }
}

/// Values per vertex as values per corner; empty where there are none.
fn per_corner<const N: usize, T: From<[f32; N]> + Copy>(
    values: Option<PyReadonlyArray2<'_, f32>>,
    name: &str,
    faces: &[[u32; 3]],
    vertices: usize,
) -> PyResult<Vec<T>> {
    let Some(values) = values else { return Ok(Vec::new()) };
    let values = rows::<N, f32>(&values, name)?;
    if values.len() != vertices {
        let (rows, positions) = (counted(values.len(), "row"), counted(vertices, "position"));
        return Err(PyValueError::new_err(format!(
            "{name} has {rows}, but it needs one for each of {positions}"
        )));
    }
    Ok(faces.as_flattened().iter().map(|&v| T::from(values[v as usize])).collect())
}

type ByCorner<'py> = Bound<'py, PyArray3<f32>>;

/// Values of corners, three of each face; none where there are none.
fn by_corner<'py, const N: usize, T>(
    py: Python<'py>,
    values: &[T],
    numbers: impl Fn(&T) -> [f32; N],
) -> PyResult<Option<ByCorner<'py>>> {
    if values.is_empty() {
        return Ok(None);
    }
    let numbers: Vec<f32> = values.iter().flat_map(numbers).collect();
    numbers.to_pyarray(py).reshape([values.len() / 3, 3, N]).map(Some)
}

/// Positions of a mesh in the world.
pub(crate) fn world_positions<'py>(
    py: Python<'py>,
    mesh: &fantex::mesh::Mesh,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let world: Vec<[f64; 3]> =
        mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p).to_array()).collect();
    array(py, &world)
}

type Unwrapping<'py> =
    (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<u32>>, Bound<'py, PyArray2<f32>>, usize, (u32, u32));

/// Unwraps triangles: vertex mapping, faces, texture coordinates with v upwards, number of charts, columns and rows of the picture.
#[pyfunction]
#[pyo3(signature = (positions, faces, side, padding, square, weld, progress))]
#[expect(clippy::too_many_arguments, reason = "the Python side has names and defaults for them")]
pub(crate) fn parametrize<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f64>,
    faces: PyReadonlyArray2<'py, i64>,
    side: u32,
    padding: Option<u32>,
    square: bool,
    weld: Option<f64>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Unwrapping<'py>> {
    let positions: Vec<DVec3> =
        rows::<3, f64>(&positions, "positions")?.into_iter().map(DVec3::from).collect();
    let faces = triangles(&faces, positions.len())?;
    let options = UnwrapOptions { side, padding, is_square: square };
    let clean = CleanOptions::welding(weld);
    let (mesh, unwrapped) = watched(py, heard(&progress, "unwrapping"), |watch| {
        unwrap_triangles(&positions, &faces, &clean, &options, watch)
    })?;
    let uv: Vec<[f32; 2]> = mesh.uv.iter().map(upwards).collect();
    let (vertices, faces) = (mesh.vertices.to_pyarray(py), array(py, &mesh.triangles)?);
    Ok((vertices, faces, array(py, &uv)?, unwrapped.charts, unwrapped.size.into()))
}

/// Texture coordinates with v upwards, as OBJ files, Blender and trimesh have them.
pub(crate) fn upwards(uv: &Vec2) -> [f32; 2] {
    [uv.x, 1.0 - uv.y]
}

/// Cuts polygons into triangles, which index `points`: `counts` says how many of these each polygon has, and they index `positions`.
#[pyfunction]
pub(crate) fn cut_polygons<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f64>,
    counts: PyReadonlyArray1<'py, i64>,
    points: PyReadonlyArray1<'py, i64>,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let positions: Vec<DVec3> =
        rows::<3, f64>(&positions, "positions")?.into_iter().map(DVec3::from).collect();
    let indices = |array: &PyReadonlyArray1<'_, i64>| -> Option<Vec<usize>> {
        array.as_array().iter().map(|&n| usize::try_from(n).ok()).collect()
    };
    let found = indices(&counts).zip(indices(&points)).filter(|(counts, points)| {
        counts.iter().try_fold(0usize, |sum, &n| sum.checked_add(n)) == Some(points.len())
            && points.iter().all(|&point| point < positions.len())
    });
    let Some((counts, points)) = found else {
        return Err(PyValueError::new_err("the polygons do not fit their positions"));
    };
    let triangles = py.detach(|| cut(&positions, &counts, &points));
    let triangles: Vec<[i64; 3]> = triangles.into_iter().map(|t| t.map(|k| k as i64)).collect();
    array(py, &triangles)
}
