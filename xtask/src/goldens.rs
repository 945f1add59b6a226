//! Drawing the small pictures anew that guard the gallery.

use std::fs;

use crate::shell::{Failure, cargo, root};

/// Replaces all goldens by what is drawn now.
pub(crate) fn run() -> Result<(), Failure> {
    let folder = root().join("gallery/goldens");
    let failed = |error: std::io::Error| Failure::new(format!("cannot write {}: {error}", folder.display()));
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(failed)?;
    }
    let target = folder.display().to_string();
    cargo(&["run", "--release", "--", "gallery", "-o", &target, "--width", "120"])?;
    fs::remove_file(folder.join("index.html")).map_err(failed)
}
