//! Everything that can be checked without running the product.

use std::fs;
use std::path::{Path, PathBuf};

use crate::crates;
use crate::shell::{self, Failure, cargo, cargo_command, root};

/// A source file longer than this has more than one subject.
const LONGEST_FILE_LINES: usize = 900;

/// Runs all checks; the quick ones first.
pub(crate) fn run() -> Result<(), Failure> {
    check_lengths()?;
    crates::check_directions()?;
    cargo(&["fmt", "--all", "--check"])?;
    cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"])?;
    eprintln!("> cargo doc --workspace --no-deps, warnings denied");
    shell::run(
        cargo_command(&["doc", "--workspace", "--no-deps", "--quiet"]).env("RUSTDOCFLAGS", "-D warnings"),
    )
}

/// No Rust file of the workspace may be too long.
fn check_lengths() -> Result<(), Failure> {
    eprintln!("> length of source files");
    let mut files = Vec::new();
    for folder in ["crates", "xtask"] {
        rust_files(&root().join(folder), &mut files)?;
    }
    let mut long = Vec::new();
    for file in &files {
        let text =
            fs::read_to_string(file).map_err(|e| Failure(format!("cannot read {}: {e}", file.display())))?;
        let lines = text.lines().count();
        if lines > LONGEST_FILE_LINES {
            long.push(format!("{} has {lines} lines", file.display()));
        }
    }
    match long.is_empty() {
        true => Ok(()),
        false => {
            Err(Failure(format!("{} (at most {LONGEST_FILE_LINES}); split by subject", long.join(", "))))
        }
    }
}

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let failed = |e| Failure(format!("cannot list {}: {e}", folder.display()));
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_dir() {
            rust_files(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    Ok(())
}
