//! What runs in browsers, the viewer and the core of the npm package: built, and put where they are taken from.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use crate::lint::find_files;
use crate::shell::{Failure, capture, cargo, cargo_command, root, succeeds};
use crate::test::target_folder;

const TARGET: &str = "wasm32-unknown-unknown";

/// Packages, what they are called when they are built, and where they go.
const PROGRAMS: [(&str, &str, &str); 2] = [
    ("fantex-web", "fantex_web", "crates/fantex-web/built"),
    ("fantex-three", "fantex_three", "three/built"),
];

/// What to do where the target's standard library is missing.
pub(crate) const HOW: &str =
    "the target wasm32-unknown-unknown is not installed: rustup target add wasm32-unknown-unknown";

/// Whether Rust can be compiled for browsers here.
pub(crate) fn has_target() -> bool {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let folder = capture(Command::new(rustc).args(["--print", "target-libdir", "--target", TARGET]));
    folder.is_ok_and(|folder| PathBuf::from(folder.trim()).is_dir())
}

/// What was built before, if its sources have changed since: tests in a browser would run it as it is.
pub(crate) fn stale() -> Option<String> {
    let outdated = PROGRAMS.iter().find(|(package, name, folder)| {
        let built =
            root().join(folder).join(format!("{name}_bg.wasm")).metadata().and_then(|file| file.modified());
        built.is_ok_and(|built| newest_source(package).is_some_and(|source| source > built))
    })?;
    Some(format!("{} is older than its sources; cargo xtask web builds it anew", outdated.2))
}

/// When a package, or one of this workspace that it is built of, was changed last.
fn newest_source(package: &str) -> Option<SystemTime> {
    let arguments = ["tree", "-p", package, "-e", "normal", "--target", TARGET, "--prefix", "none"];
    let tree = capture(&mut cargo_command(&arguments)).ok()?;
    let packages = tree.lines().filter_map(|line| line.split_once(" (/")?.1.split_once(')'));
    let mut files = Vec::new();
    for (folder, _) in packages {
        find_files(&Path::new("/").join(folder).join("src"), &["rs", "wgsl"], &mut files).ok()?;
    }
    files.iter().filter_map(|file| file.metadata().ok()?.modified().ok()).max()
}

/// Builds the viewer into `crates/fantex-web/built`, where programs that are built later take it from, and the core of the npm package into
/// `three/built`.
pub(crate) fn build() -> Result<(), Failure> {
    if !has_target() {
        return Err(Failure::new(HOW));
    }
    for (package, _, _) in PROGRAMS {
        // Each by itself: the smaller one does without what the other asks of the crates that both use.
        cargo(&["build", "--profile", "web", "-p", package, "--lib", "--target", TARGET])?;
    }
    // The library that writes scripts is compiled for those only who want it.
    cargo(&["run", "--quiet", "-p", "xtask", "--features", "web", "--", "web-scripts"])
}

/// Writes the scripts and the finished programs beside them.
#[cfg(feature = "web")]
pub(crate) fn write_scripts() -> Result<(), Failure> {
    for (_, name, folder) in PROGRAMS {
        let program = target_folder().join(TARGET).join("web").join(name).with_extension("wasm");
        let mut bindgen = wasm_bindgen_cli_support::Bindgen::new();
        bindgen
            .input_path(program)
            .typescript(false)
            .remove_name_section(true)
            .remove_producers_section(true);
        let prepared = bindgen.web(true).and_then(|bindgen| bindgen.generate(root().join(folder)));
        prepared.map_err(|error| Failure(format!("cannot write the scripts of {name}: {error:#}")))?;
        for file in [format!("{name}.js"), format!("{name}_bg.wasm")] {
            let bytes = root().join(folder).join(&file).metadata().map_or(0, |file| file.len());
            eprintln!("{folder}/{file}: {} kB", bytes / 1000);
        }
    }
    Ok(())
}

/// Fetches what tests of the npm package want, where that is possible.
pub(crate) fn install_three() {
    let mut npm = Command::new("npm");
    if !succeeds(npm.args(["ci", "--no-audit", "--no-fund"]).current_dir(root().join("three"))) {
        eprintln!("no three.js for the tests of the npm package: npm ci in the folder three brings it");
    }
}

/// Only with the feature.
#[cfg(not(feature = "web"))]
pub(crate) fn write_scripts() -> Result<(), Failure> {
    let _paths = (root(), target_folder());
    Err(Failure::new("cargo xtask web does that"))
}
