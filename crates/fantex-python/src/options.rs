//! Settings that come in dictionaries, with names for what stands in each.

use fantex::mesh::AlphaMode;
use fantex::{ReadLimits, ReadOptions};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The value of a key that may be missing or None.
pub(crate) fn optional<'py, T>(parts: &Bound<'py, PyDict>, key: &str) -> PyResult<Option<T>>
where
    T: for<'a> FromPyObject<'a, 'py, Error: Into<PyErr>>,
{
    match parts.get_item(key)?.filter(|value| !value.is_none()) {
        Some(value) => value.extract().map(Some).map_err(Into::into),
        None => Ok(None),
    }
}

/// One of several words, where one is given.
pub(crate) fn word<T: Copy>(
    options: &Bound<'_, PyDict>,
    key: &str,
    choices: &[(&str, T)],
) -> PyResult<Option<T>> {
    let Some(value) = options.get_item(key)?.filter(|value| !value.is_none()) else { return Ok(None) };
    let word: String = value.extract().map_err(|_: PyErr| {
        let kind =
            value.get_type().name().map_or_else(|_| "another type".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!("{key} is of type {kind}; expected one of {}", listed(choices)))
    })?;
    named(key, &word, choices).map(Some)
}

/// One of several words; the first where none is given.
pub(crate) fn choice<T: Copy>(options: &Bound<'_, PyDict>, key: &str, choices: &[(&str, T)]) -> PyResult<T> {
    Ok(word(options, key, choices)?.unwrap_or(choices[0].1))
}

/// What a word stands for; `key` is what has it.
pub(crate) fn named<T: Copy>(key: &str, word: &str, choices: &[(&str, T)]) -> PyResult<T> {
    choices
        .iter()
        .find(|(name, _)| *name == word)
        .map(|(_, value)| *value)
        .ok_or_else(|| PyValueError::new_err(format!("{key} {word:?} is none of {}", listed(choices))))
}

fn listed<T>(choices: &[(&str, T)]) -> String {
    let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
    names.join(", ")
}

/// What materials make of opacity, by the words for it.
pub(crate) const ALPHA_MODES: [(&str, AlphaMode); 3] =
    [("opaque", AlphaMode::Opaque), ("cut-out", AlphaMode::Mask(0.5)), ("blend", AlphaMode::Blend)];

/// How much memory files of others may take that are read whole, and whether they may name files outside their folders: from now on, in
/// all threads.
#[pyfunction]
pub(crate) fn set_read_limits(memory: u64, allow_outside: bool) {
    let options = ReadOptions { memory_bytes: memory, allow_outside, ..ReadOptions::default() };
    ReadLimits::new(options).make_default();
}
