//! Files that are written whole or not at all.

use std::io;
use std::path::{Path, PathBuf};

/// A file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// The operating system's reason.
    pub source: io::Error,
}

/// Writes a file beside its place and moves it there, so that at the place there is never half a file. Folders above are made.
///
/// # Errors
///
/// [`WriteError`], where the operating system refuses.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    let failed = |source| WriteError { path: path.into(), source };
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let mut name = path.file_name().ok_or_else(|| failed(io::ErrorKind::InvalidFilename.into()))?.to_owned();
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path));
    written.map_err(|source| {
        // The reason why writing failed matters, not whether a rest could be removed.
        std::fs::remove_file(&part).ok();
        failed(source)
    })
}

/// `name-001.ext`, `name-002.ext` ...: the first that does not exist in a folder.
pub fn next_free(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    let name = |i: u32| folder.join(format!("{stem}-{i:03}.{extension}"));
    (1..10_000).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(10_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_made_and_files_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b/c.txt");
        write_whole(&path, b"first").unwrap();
        write_whole(&path, b"second").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "no rest is left");
    }

    #[test]
    fn failures_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("file"), b"").unwrap();
        let error = write_whole(&folder.path().join("file/below"), b"").unwrap_err();
        assert!(error.to_string().contains("below"));
    }

    #[test]
    fn names_count_up() {
        let folder = tempfile::tempdir().unwrap();
        let first = next_free(folder.path(), "bunny", "png");
        assert!(first.ends_with("bunny-001.png"));
        std::fs::write(first, b"").unwrap();
        assert!(next_free(folder.path(), "bunny", "png").ends_with("bunny-002.png"));
    }
}
