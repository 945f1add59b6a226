//! Everything that can be checked without running the product.

use std::fs;
use std::path::{Path, PathBuf};

use crate::shell::{self, Failure, capture, cargo, cargo_command, root};
use crate::{advisories, crates, licenses};

/// A source file longer than this has more than one subject.
const MAX_FILE_LINES: usize = 900;

/// A source file shorter than this seldom holds a whole one.
const MIN_FILE_LINES: usize = 40;

/// Crates that nobody who embeds the library without features should build, by what is in their names.
const HEAVY: [&str; 9] = ["wgpu", "winit", "eframe", "egui", "naga", "ureq", "rustls", "clap", "indicatif"];

pub(crate) fn run() -> Result<(), Failure> {
    check_sizes()?;
    crates::check_directions()?;
    check_weight()?;
    licenses::check()?;
    advisories::check()?;
    cargo(&["fmt", "--all", "--check"])?;
    cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"])?;
    // With examples, and so with the features that clippy has checked other crates with: these are checked once.
    eprintln!("> cargo doc --workspace --no-deps, warnings denied");
    let mut doc = cargo_command(&["doc", "--workspace", "--no-deps", "--quiet", "--lib", "--examples"]);
    shell::run(doc.env("RUSTDOCFLAGS", "-D warnings"))?;
    // Trees are looked at before they are committed, too, and may have a built viewer.
    cargo(&["package", "--workspace", "--no-verify", "--allow-dirty", "--quiet"])
}

/// No Rust file of the workspace may be too long; the figures tell whether files hold whole subjects.
fn check_sizes() -> Result<(), Failure> {
    let mut files = Vec::new();
    for folder in ["crates", "xtask"] {
        find_files(&root().join(folder), &["rs"], &mut files)?;
    }
    let mut sizes = Vec::with_capacity(files.len());
    for file in &files {
        let text =
            fs::read_to_string(file).map_err(|e| Failure(format!("cannot read {}: {e}", file.display())))?;
        sizes.push((text.lines().count(), file));
    }
    sizes.sort_unstable();
    let total: usize = sizes.iter().map(|(lines, _)| lines).sum();
    let short = sizes.partition_point(|(lines, _)| *lines < MIN_FILE_LINES);
    let median = sizes.get(sizes.len() / 2).map_or(0, |(lines, _)| *lines);
    eprintln!(
        "> sizes of {} source files: {total} lines, median {median}, {short} files of fewer than {MIN_FILE_LINES} lines",
        sizes.len()
    );
    let long: Vec<String> = sizes
        .iter()
        .filter(|(lines, _)| *lines > MAX_FILE_LINES)
        .map(|(lines, file)| format!("{} has {lines} lines", file.display()))
        .collect();
    match long.is_empty() {
        true => Ok(()),
        false => Err(Failure(format!("{} (at most {MAX_FILE_LINES}); split by subject", long.join(", ")))),
    }
}

/// The library without features builds no window, GPU, network or command-line crates.
fn check_weight() -> Result<(), Failure> {
    eprintln!("> weight of the library without features");
    let tree = capture(&mut cargo_command(&["tree", "-p", "fantex", "-e", "normal", "--prefix", "none"]))?;
    let mut heavy: Vec<&str> = tree
        .lines()
        .filter_map(|line| line.split(' ').next())
        .filter(|name| HEAVY.iter().any(|heavy| name.contains(heavy)))
        .collect();
    heavy.sort_unstable();
    heavy.dedup();
    match heavy.is_empty() {
        true => Ok(()),
        false => Err(Failure(format!("fantex without features builds {}", heavy.join(", ")))),
    }
}

/// The files in a folder, and in those below it, that end with one of the extensions.
pub(crate) fn find_files(
    folder: &Path,
    extensions: &[&str],
    files: &mut Vec<PathBuf>,
) -> Result<(), Failure> {
    let failed = |e| Failure(format!("cannot list {}: {e}", folder.display()));
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_dir() {
            find_files(&path, extensions, files)?;
        } else if path.extension().is_some_and(|e| extensions.iter().any(|wanted| e == *wanted)) {
            files.push(path);
        }
    }
    Ok(())
}
