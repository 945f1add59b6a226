//! Whether the viewer has been built: `cargo xtask web` puts it into `built/`, from where it goes into programs.

use std::path::Path;

fn main() {
    println!("cargo::rustc-check-cfg=cfg(has_viewer)");
    println!("cargo::rerun-if-changed=built");
    let folder = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let is_there = |name| Path::new(&folder).join("built").join(name).is_file();
    if is_there("fantex_web.js") && is_there("fantex_web_bg.wasm") {
        println!("cargo::rustc-cfg=has_viewer");
    }
}
