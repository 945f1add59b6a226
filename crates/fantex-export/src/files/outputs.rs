//! Files that appear together, whole, or not at all.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::ExportError;

/// Files under temporary names beside their places. Dropping them removes them.
#[derive(Debug)]
pub(crate) struct Outputs {
    force: bool,
    files: Vec<(NamedTempFile, PathBuf)>,
}

/// The folder that a file lies in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

impl Outputs {
    /// Nothing yet. With `force`, files that exist are replaced.
    pub(crate) fn new(force: bool) -> Self {
        Self { force, files: Vec::new() }
    }

    /// A file that will be `path`, open for writing, and its temporary path.
    pub(crate) fn create(&mut self, path: &Path) -> Result<(File, PathBuf), ExportError> {
        let failed = |source| ExportError::Write { path: path.into(), source };
        if !self.force && path.symlink_metadata().is_ok() {
            return Err(ExportError::Exists { path: path.into() });
        }
        let suffix = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
        let mut builder = tempfile::Builder::new();
        builder.prefix(".fantex-").suffix(&suffix);
        // Temporary files are private by default.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.tempfile_in(folder_of(path)).map_err(failed)?;
        let opened = (file.as_file().try_clone().map_err(failed)?, file.path().to_owned());
        self.files.push((file, path.into()));
        Ok(opened)
    }

    /// Makes all files durable, then gives them their names, in the order in which they were made. Returns these with
    /// lengths in bytes.
    pub(crate) fn commit(self) -> Result<Vec<(PathBuf, u64)>, ExportError> {
        let mut lengths = Vec::with_capacity(self.files.len());
        for (file, path) in &self.files {
            // By name: a writer may have put another file there.
            let synced = File::open(file.path()).and_then(|f| f.sync_all().and_then(|()| f.metadata()));
            let metadata = synced.map_err(|source| ExportError::Write { path: path.clone(), source })?;
            lengths.push(metadata.len());
        }
        let mut named: Vec<PathBuf> = Vec::with_capacity(self.files.len());
        for (file, path) in self.files {
            let persisted = if self.force { file.persist(&path) } else { file.persist_noclobber(&path) };
            if let Err(error) = persisted {
                // Only what was new is taken back; what was replaced is gone.
                if !self.force {
                    named.iter().for_each(|path| drop(std::fs::remove_file(path)));
                }
                return Err(match error.error.kind() {
                    io::ErrorKind::AlreadyExists => ExportError::Exists { path },
                    _ => ExportError::Write { path, source: error.error },
                });
            }
            named.push(path);
        }
        Ok(named.into_iter().zip(lengths).collect())
    }
}
