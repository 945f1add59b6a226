//! Places of results: paths, and objects in stores.

use std::io::Write;
use std::path::PathBuf;

use fantex::Upload;
use fantex::addresses::Target;
use fantex::base::files;
use fantex::stream::ObjectTarget;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

use crate::watch::{heard, watched};

/// Refuses an address to which nothing could be written; of paths nothing is asked.
#[pyfunction]
pub(crate) fn check_target(py: Python<'_>, place: PathBuf, overwrite: bool) -> PyResult<()> {
    watched(py, None, |_| Target::new(&place)?.check(overwrite))
}

/// Whether there is an object at an address in a store.
#[pyfunction]
pub(crate) fn is_there(py: Python<'_>, place: PathBuf) -> PyResult<bool> {
    watched(py, None, |_| Ok(ObjectTarget::at(&place)?.version()?.is_some()))
}

/// Removes the object at an address in a store, if it is there.
#[pyfunction]
pub(crate) fn remove_object(py: Python<'_>, place: PathBuf) -> PyResult<()> {
    watched(py, None, |_| ObjectTarget::at(&place)?.remove())
}

/// Sends a finished file, or a world with its assets: objects, bytes, and what is to be known of it.
#[pyfunction]
pub(crate) fn upload(
    py: Python<'_>,
    file: PathBuf,
    place: PathBuf,
    overwrite: bool,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<(u64, u64, Vec<String>)> {
    let upload = Upload { file: &file, place: &place, force: overwrite };
    let sent = watched(py, heard(&progress, "uploading"), |watch| upload.run(watch))?;
    Ok((sent.objects, sent.bytes, sent.notes))
}

/// Writes a file, whole or not at all.
#[pyfunction]
pub(crate) fn write_whole(
    py: Python<'_>,
    path: PathBuf,
    bytes: PyBackedBytes,
    overwrite: bool,
) -> PyResult<()> {
    watched(py, None, |_| files::write_whole(&path, overwrite, |out| out.write_all(&bytes)))
}
