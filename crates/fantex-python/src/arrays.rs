//! numpy's arrays as the library's vectors, and back.

use numpy::ndarray::{ArrayView2, Axis};
use numpy::{Element, PyArray2, PyArrayMethods, PyReadonlyArray2, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The rows of an array with `N` columns; `name` is what it is called in messages.
pub(crate) fn rows<const N: usize, T: Copy + Element>(
    array: &PyReadonlyArray2<'_, T>,
    name: &str,
) -> PyResult<Vec<[T; N]>> {
    let view: ArrayView2<'_, T> = array.as_array();
    if view.len_of(Axis(1)) != N {
        let (rows, columns) = view.dim();
        return Err(PyValueError::new_err(format!(
            "{name} has the shape ({rows}, {columns}); expected (n, {N})"
        )));
    }
    Ok(view.rows().into_iter().map(|row| std::array::from_fn(|k| row[k])).collect())
}

/// An array with one row for each.
pub(crate) fn array<'py, const N: usize, T: Element + Copy>(
    py: Python<'py>,
    rows: &[[T; N]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    rows.as_flattened().to_pyarray(py).reshape([rows.len(), N])
}

/// Vertex indices of triangles, checked against the number of vertices.
pub(crate) fn triangles(faces: &PyReadonlyArray2<'_, i64>, vertices: usize) -> PyResult<Vec<[u32; 3]>> {
    let triangle = |(i, row): (usize, [i64; 3])| {
        let is_known = row.iter().all(|&v| usize::try_from(v).is_ok_and(|v| v < vertices));
        let wrong = || {
            PyValueError::new_err(format!(
                "face {i} has the vertices {row:?}, but there are {vertices} positions"
            ))
        };
        is_known.then(|| row.map(|v| v as u32)).ok_or_else(wrong)
    };
    rows::<3, i64>(faces, "faces")?.into_iter().enumerate().map(triangle).collect()
}
