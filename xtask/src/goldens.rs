//! Drawing the small pictures anew that guard the gallery.

use std::fs;
use std::process::Command;

use crate::shell::{Failure, cargo, root, run as run_command};

/// Width of the pictures.
const WIDTH: &str = "320";

/// Replaces all goldens by what a program draws, or the one that is built here.
pub(crate) fn run(program: Option<&str>) -> Result<(), Failure> {
    let folder = root().join("gallery/goldens");
    let failed = |error: std::io::Error| Failure::new(format!("cannot write {}: {error}", folder.display()));
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(failed)?;
    }
    let target = folder.display().to_string();
    let arguments = ["gallery", "-o", &target, "--width", WIDTH];
    match program {
        Some(program) => run_command(Command::new(program).args(arguments))?,
        None => cargo(&[&["run", "--release", "--"], &arguments[..]].concat())?,
    }
    fs::remove_file(folder.join("index.html")).map_err(failed)
}
