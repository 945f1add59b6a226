//! Files that a model names: where they are, and their bytes.

use std::io;
use std::path::{Component, Path, PathBuf};

use super::{LoadError, LoadLimits, read_file};

/// Reads a file that a model names. Only regular files: a path from a file must not make us read a device.
pub(super) fn read_companion(path: &Path, limits: &LoadLimits) -> Result<Vec<u8>, LoadError> {
    match std::fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => {
            let source = io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file");
            Err(LoadError::Read { path: path.into(), source })
        }
        _ => read_file(path, limits),
    }
}

/// A path as written in a file from any system: backslashes separate too; of an absolute path only the name is kept,
/// because it points into the author's computer.
pub(super) fn relative_path(written: &str) -> Option<PathBuf> {
    let path = written.trim().trim_matches('"').replace('\\', "/");
    let is_absolute = path.starts_with('/') || path.as_bytes().get(1) == Some(&b':');
    let path = if is_absolute { path.rsplit('/').next().unwrap_or_default() } else { &path };
    (!path.is_empty()).then(|| PathBuf::from(path))
}

/// Where a relative path leads from a folder. Models from systems that do not tell upper from lower case name
/// `Textures/Oak.PNG` where `textures/oak.png` lies: a name that is not there stands for the first one that differs
/// in case only.
pub(super) fn locate(folder: &Path, relative: &Path) -> PathBuf {
    let exact = folder.join(relative);
    if exact.exists() {
        return exact;
    }
    let mut found = folder.to_path_buf();
    for component in relative.components() {
        let next = found.join(component);
        found = match component {
            Component::Normal(name) if !next.exists() => {
                match same_but_for_case(&found, &name.to_string_lossy()) {
                    Some(name) => found.join(name),
                    None => return exact,
                }
            }
            _ => next,
        };
    }
    found
}

/// The name in a folder that differs from `name` in upper and lower case only; the first of several.
fn same_but_for_case(folder: &Path, name: &str) -> Option<std::ffi::OsString> {
    // The folder of a plain file name is the current one.
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let name = name.to_lowercase();
    let names = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    names.filter(|n| n.to_string_lossy().to_lowercase() == name).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_whatever_their_case() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("textures")).unwrap();
        for name in ["textures/oak.png", "textures/\u{e4}.png"] {
            std::fs::write(at(name), b"x").unwrap();
        }
        // Compared as files, because systems that do not tell cases apart find the name as it was written.
        let is_at = |name: &str, expected: &str| {
            let found = locate(folder.path(), Path::new(name)).canonicalize().unwrap();
            let expected = at(expected).canonicalize().unwrap();
            assert_eq!(found, expected, "{name}");
        };
        is_at("textures/oak.png", "textures/oak.png");
        is_at("Textures/Oak.PNG", "textures/oak.png");
        is_at("./Textures/\u{c4}.PNG", "textures/\u{e4}.png");
        is_at("textures/../Textures/oak.png", "textures/oak.png");
        // What is not there keeps its name for the message.
        assert_eq!(locate(folder.path(), Path::new("Textures/ash.png")), at("Textures/ash.png"));
    }

    #[test]
    fn paths_into_another_computer_become_names() {
        let relative = |written: &str| relative_path(written).map(|p| p.display().to_string());
        assert_eq!(relative("C:\\work\\a b.png").as_deref(), Some("a b.png"));
        assert_eq!(relative("/home/someone/a.png").as_deref(), Some("a.png"));
        assert_eq!(relative("tex\\a.png").as_deref(), Some("tex/a.png"));
        assert_eq!(relative(" \"a.png\" ").as_deref(), Some("a.png"));
        assert_eq!(relative("  "), None);
    }
}
