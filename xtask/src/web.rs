//! What runs in browsers, the viewer and the core of the npm package: built, and put where they are taken from.

use std::path::PathBuf;
use std::process::Command;

use crate::shell::{Failure, capture, cargo, root, succeeds};
use crate::test::target_folder;

const TARGET: &str = "wasm32-unknown-unknown";

/// What to do where the target's standard library is missing.
pub(crate) const HOW: &str =
    "the target wasm32-unknown-unknown is not installed: rustup target add wasm32-unknown-unknown";

/// Whether Rust can be compiled for browsers here.
pub(crate) fn has_target() -> bool {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let folder = capture(Command::new(rustc).args(["--print", "target-libdir", "--target", TARGET]));
    folder.is_ok_and(|folder| PathBuf::from(folder.trim()).is_dir())
}

/// Builds the viewer into `crates/fantex-web/built`, where programs that are built later take it from, and the core of the npm package into
/// `three/built`.
pub(crate) fn build() -> Result<(), Failure> {
    if !has_target() {
        return Err(Failure::new(HOW));
    }
    for package in ["fantex-web", "fantex-three"] {
        // Each by itself: the smaller one does without what the other asks of the crates that both use.
        cargo(&["build", "--profile", "web", "-p", package, "--lib", "--target", TARGET])?;
    }
    // The library that writes scripts is compiled for those only who want it.
    cargo(&["run", "--quiet", "-p", "xtask", "--features", "web", "--", "web-scripts"])
}

/// Writes the scripts and the finished programs beside them.
#[cfg(feature = "web")]
pub(crate) fn write_scripts() -> Result<(), Failure> {
    for (name, folder) in [("fantex_web", "crates/fantex-web/built"), ("fantex_three", "three/built")] {
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
