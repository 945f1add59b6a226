//! Drawing the small pictures anew that guard the gallery.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::shell::{Failure, cargo, root, run as run_command};

const WIDTH: &str = "320";

/// Replaces all goldens by what a program draws, or the one that is built here. Tolerances stay.
pub(crate) fn run(program: Option<&str>) -> Result<(), Failure> {
    let folder = root().join("gallery/goldens");
    let failed = |error: std::io::Error| Failure::new(format!("cannot write {}: {error}", folder.display()));
    for path in pictures(&folder).map_err(failed)? {
        fs::remove_file(&path).map_err(failed)?;
    }
    let target = folder.display().to_string();
    let arguments = ["gallery", "-o", &target, "--force", "--width", WIDTH, "--still"];
    match program {
        Some(program) => run_command(Command::new(program).args(arguments))?,
        None => cargo(&[&["run", "--release", "--"], &arguments[..]].concat())?,
    }
    fs::remove_file(folder.join("index.html")).map_err(failed)?;
    eprintln!("now: cargo run --release -p fantex-bench --example gallery_faults");
    Ok(())
}

fn pictures(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let paths: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|file| Ok(file?.path())).collect::<std::io::Result<_>>()?;
    Ok(paths
        .into_iter()
        .filter(|path| path.extension().is_some_and(|extension| extension == "png"))
        .collect())
}
