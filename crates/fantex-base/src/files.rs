//! Files that appear whole or not at all: written under a temporary name in their own folder, then renamed.

use std::io;
use std::path::Path;

use tempfile::{Builder, NamedTempFile, TempPath};

use crate::{Error, Result};

/// The folder that a file lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new file in the folder of `path`, with the permissions that any new file gets (temporary files are private by default).
/// It goes away unless it gets another name.
///
/// # Errors
/// The system's.
pub fn temporary_file(path: &Path, suffix: &str) -> io::Result<NamedTempFile> {
    let mut builder = Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.prefix(".fantex-").suffix(suffix).tempfile_in(folder_of(path))
}

/// Gives a finished file its name; only with `force` over another.
///
/// # Errors
/// [`exists`], or the system refuses.
pub fn persist(file: TempPath, path: &Path, force: bool) -> Result<()> {
    let named = if force { file.persist(path) } else { file.persist_noclobber(path) };
    named.map_err(|error| match error.error.kind() {
        io::ErrorKind::AlreadyExists => exists(path),
        _ => Error::writing(path, error.error),
    })
}

/// The output is there already.
pub fn exists(path: &Path) -> Error {
    let sentence = format!("{} exists already; use --force to overwrite it", path.display());
    Error::already_exists(sentence).with_path(path)
}
