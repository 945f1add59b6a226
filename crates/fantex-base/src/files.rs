//! Files that appear whole or not at all: written under a temporary name in their own folder, then renamed.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
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

/// Makes a finished file durable and gives it its name; only with `force` over another.
///
/// # Errors
/// [`exists`], or the system refuses: then the file is gone, and what was at `path` is as it was.
pub fn persist(file: TempPath, path: &Path, force: bool) -> Result<()> {
    let failed = |error| Error::writing(path, error);
    OpenOptions::new().write(true).open(&file).and_then(|file| file.sync_all()).map_err(failed)?;
    let named = if force { file.persist(path) } else { file.persist_noclobber(path) };
    named.map_err(|error| match error.error.kind() {
        io::ErrorKind::AlreadyExists => exists(path),
        _ => failed(error.error),
    })?;
    // The name is durable once the folder is.
    if cfg!(unix) {
        File::open(folder_of(path)).and_then(|folder| folder.sync_all()).map_err(failed)
    } else {
        Ok(())
    }
}

/// Writes a file whole or not at all.
///
/// # Errors
/// As [`persist`], or `write` fails.
pub fn write_whole(
    path: &Path,
    force: bool,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<()> {
    let failed = |error| Error::writing(path, error);
    let file = temporary_file(path, "").map_err(failed)?;
    let mut out = BufWriter::with_capacity(1 << 20, file.as_file());
    write(&mut out).and_then(|()| out.flush()).map_err(failed)?;
    drop(out);
    persist(file.into_temp_path(), path, force)
}

/// The output is there already.
pub fn exists(path: &Path) -> Error {
    let sentence = format!("{} exists already; use --force to overwrite it", path.display());
    Error::already_exists(sentence).with_path(path)
}
