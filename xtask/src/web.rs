//! The viewer for browsers: built, and put where programs take it from.

use std::path::PathBuf;
use std::process::Command;

use crate::shell::{Failure, capture, cargo, root};
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

/// Builds the viewer into `crates/fantex-web/built`. Programs that are built later have it.
pub(crate) fn build() -> Result<(), Failure> {
    if !has_target() {
        return Err(Failure::new(HOW));
    }
    cargo(&["build", "--profile", "web", "-p", "fantex-web", "--lib", "--target", TARGET])?;
    // The library that writes scripts is compiled for those only who want it.
    cargo(&["run", "--quiet", "-p", "xtask", "--features", "web", "--", "web-scripts"])
}

/// Writes the scripts and the finished program beside them.
#[cfg(feature = "web")]
pub(crate) fn write_scripts() -> Result<(), Failure> {
    let program = target_folder().join(TARGET).join("web/fantex_web.wasm");
    let folder = root().join("crates/fantex-web/built");
    let mut bindgen = wasm_bindgen_cli_support::Bindgen::new();
    bindgen.input_path(program).typescript(false).remove_name_section(true).remove_producers_section(true);
    let prepared = bindgen.web(true).and_then(|bindgen| bindgen.generate(&folder));
    prepared.map_err(|error| Failure(format!("cannot write the viewer's scripts: {error:#}")))?;
    for name in ["fantex_web.js", "fantex_web_bg.wasm"] {
        let bytes = folder.join(name).metadata().map_or(0, |file| file.len());
        eprintln!("crates/fantex-web/built/{name}: {} kB", bytes / 1000);
    }
    Ok(())
}

/// Only with the feature.
#[cfg(not(feature = "web"))]
pub(crate) fn write_scripts() -> Result<(), Failure> {
    let _paths = (root(), target_folder());
    Err(Failure::new("cargo xtask web does that"))
}
