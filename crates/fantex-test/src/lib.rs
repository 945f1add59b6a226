//! What tests of several crates share: where test data are, and short ways to meshes.
//!
//! Only tests depend on this crate. What fails here fails the test.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

pub mod fan_file;

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fantex_mesh::{CleanOptions, LoadOptions, Material, Mesh, Model, clean, generate, load};
use glam::DVec3;

/// How long is waited for what takes seconds at most: machines may be busy.
pub const PATIENCE: Duration = Duration::from_secs(600);

/// The folder of the workspace.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The folder of test data: `FANTEX_DATA`, or `../shared/data` beside the workspace. Where there is none, that is said, and the test passes without it.
pub fn data_folder() -> Option<PathBuf> {
    data("")
}

/// A file or folder of the test data, as [`data_folder`].
pub fn data(name: &str) -> Option<PathBuf> {
    let beside = || workspace().join("../shared/data");
    let path = std::env::var_os("FANTEX_DATA").map_or_else(beside, PathBuf::from).join(name);
    if path.exists() {
        return Some(path);
    }
    skip(&format!("no test data at {} (set FANTEX_DATA)", path.display()));
    None
}

/// Says that a test cannot run here. `cargo xtask test` counts these lines at its end, in the file that `FANTEX_SKIPPED` names.
pub fn skip(reason: &str) {
    eprintln!("SKIPPED: {reason}");
    let Some(list) = std::env::var_os("FANTEX_SKIPPED") else { return };
    let mut list = OpenOptions::new().create(true).append(true).open(list).unwrap();
    // One write, so that lines of several tests do not mix.
    list.write_all(format!("{reason}\n").as_bytes()).unwrap();
}

/// Seeds of an attack: so many by default; with `FANTEX_FUZZ_SECONDS` as many as that time allows, from `FANTEX_FUZZ_SEED` on.
pub fn rounds(default: u64) -> impl Iterator<Item = u64> {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let end = number("FANTEX_FUZZ_SECONDS").map(|seconds| Instant::now() + Duration::from_secs(seconds));
    let first = number("FANTEX_FUZZ_SEED").unwrap_or(1);
    (0..)
        .take_while(move |&done| end.map_or(done < default, |end| Instant::now() < end))
        .map(move |n| first + n)
}

/// A model with the default options of cleaning.
pub fn cleaned(model: Model) -> Mesh {
    clean(model, &CleanOptions::default()).unwrap().0
}

/// A model file, cleaned.
pub fn opened(path: &Path) -> Mesh {
    cleaned(load(path, &LoadOptions::default()).unwrap())
}

/// A model file of a folder, cleaned.
pub fn loaded(folder: &Path, name: &str) -> Mesh {
    opened(&folder.join(name))
}

/// The bottle that comes with the repository: textures in every channel.
pub fn bottle() -> Mesh {
    opened(&workspace().join("assets/WaterBottle/WaterBottle.gltf"))
}

/// A mesh of world-space positions and triangles, cleaned, with one material.
pub fn mesh_of(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    let materials = vec![Material::default()];
    cleaned(Model { name: "test".into(), positions, triangles, materials, ..Model::default() })
}

/// A ball above a plane.
pub fn ball_on_a_plane() -> Mesh {
    let mut ball = generate::icosphere(4);
    ball.positions.iter_mut().for_each(|p| *p = *p * 0.3 + DVec3::new(0.1, 0.4, 0.0));
    let mut model = generate::grid(8);
    let first = model.positions.len() as u32;
    model.positions.extend(&ball.positions);
    model.triangles.extend(ball.triangles.iter().map(|t| t.map(|v| v + first)));
    cleaned(model)
}
