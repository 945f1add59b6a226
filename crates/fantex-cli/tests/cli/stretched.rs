//! Objects that are longer along one axis than they were: what depends on the eye.

use std::path::Path;

use fantex::texture::Image;

use crate::{succeeds, write};

/// The middle of a picture of a plane that leans by 45 degrees, three times as long along x, seen from above.
fn seen_from_above(folder: &Path, texture: &str) -> [f32; 4] {
    write(folder, "lean.obj", "v -1 -1 -1\nv 1 1 -1\nv 1 1 1\nv -1 -1 1\nf 4 3 2 1\n");
    let look = format!(
        "[textures.t]\n{texture}\n[materials.m]\nlighting = 'unlit'\nbase_color = 't'\n\
         [[object]]\nmodel = 'lean.obj'\nmaterial = 'm'\nscale = [3, 1, 1]\n\
         [camera]\neye = [0, 50, 0.0001]\ntarget = [0, 0, 0]\nfov = 1\n[picture]\nsize = [9, 9]\n"
    );
    let (look, picture) = (write(folder, "lean.toml", &look), folder.join("lean.exr"));
    succeeds(&[&"--force", &"render", &look, &"-o", &picture]);
    Image::load(&picture).unwrap().linear_texel(4, 4)
}

/// Its normal is (-1/3, 1, 0), normalised: 18.4 degrees from the view.
#[test]
fn facing_is_the_cosine_in_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let [cosine, ..] = seen_from_above(folder.path(), "kind = 'facing'");
    assert!((cosine - 0.948_683).abs() < 1e-3, "{cosine}");
}

/// The mirror shows (-0.6, 0.8, 0) of the scene, which is (-0.2, 0.8, 0) of surroundings that are stretched with it.
#[test]
fn mirrors_reflect_by_angles_in_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let height = |row: u32| ((row as f32 + 0.5) / 64.0 * std::f32::consts::PI).cos();
    let rows = (0..64).flat_map(|row| [0.5 + 0.5 * height(row); 3 * 128]);
    Image::from_linear(128, 64, 3, rows.collect()).save(folder.path().join("heights.exr")).unwrap();
    let [shown, ..] = seen_from_above(folder.path(), "kind = 'cube'\nimage = 'heights.exr'");
    let expected = 0.5 + 0.5 * 0.8 / 0.2f32.hypot(0.8);
    assert!((shown - expected).abs() < 5e-3, "{shown} instead of {expected}");
}
