//! Places of results: paths, and objects in stores.

use std::path::PathBuf;

use fantex::addresses::Target;
use fantex::stream::ObjectTarget;
use pyo3::prelude::*;

use crate::watch::watched;

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
