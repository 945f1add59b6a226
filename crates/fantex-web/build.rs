//! Whether the viewer has been built: `cargo xtask web` puts it into `built/`, from where it goes into programs.

use std::path::Path;

fn main() {
    println!("cargo::rustc-check-cfg=cfg(has_viewer)");
    let folder = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let built = Path::new(&folder).join("built");
    // What is missing counts as changed, and programs would be compiled anew at every call of cargo: as long as there is no such
    // folder, the one that it will lie in is watched.
    println!("cargo::rerun-if-changed={}", if built.is_dir() { "built" } else { "." });
    let is_there = |name| built.join(name).is_file();
    if is_there("fantex_web.js") && is_there("fantex_web_bg.wasm") {
        println!("cargo::rustc-cfg=has_viewer");
    }
}
