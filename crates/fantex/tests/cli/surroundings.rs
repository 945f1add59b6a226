//! Pictures with surroundings.

use crate::support::{CUBE_OBJ, fails, files, json, write};

/// A Radiance picture of one colour.
fn radiance(width: u32, height: u32, rgbe: [u8; 4]) -> Vec<u8> {
    let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes();
    (0..width * height).for_each(|_| bytes.extend(rgbe));
    bytes
}

#[test]
fn a_panorama_lights_the_model_and_is_seen_behind_it() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    // A green world: 0.5 is 128 / 256 * 2^0.
    let world = write(folder.path(), "world.hdr", radiance(8, 4, [0, 128, 0, 128]));
    let picture = folder.path().join("picture.png");
    json(&[&"render", &model, &"-o", &picture, &"--size", &"32x24", &"--environment", &world]);
    let image = fantex::texture::Image::load(&picture).unwrap();
    let [corner, middle] = [(0, 0), (16, 12)].map(|(x, y)| image.linear_texel(x, y));
    assert!((corner[1] - 0.5).abs() < 0.01 && corner[0] == 0.0, "{corner:?}");
    assert!(middle[1] > 0.3 && middle[0] == 0.0, "{middle:?}");
    let through = folder.path().join("through.png");
    let transparent: [&dyn AsRef<std::ffi::OsStr>; 9] = [
        &"render",
        &model,
        &"-o",
        &through,
        &"--environment",
        &world,
        &"--background",
        &"transparent",
        &"--size=32x24",
    ];
    json(&transparent);
    assert_eq!(fantex::texture::Image::load(&through).unwrap().linear_texel(0, 0)[3], 0.0);
}

#[test]
fn a_computed_sky_needs_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let picture = folder.path().join("sky.png");
    json(&[
        &"render",
        &model,
        &"-o",
        &picture,
        &"--size=48x32",
        &"--environment",
        &"sky",
        &"--light=1,1,1",
        &"--eye=0,0,4",
        &"--target=0,3,0",
    ]);
    let [red, _, blue, _] = fantex::texture::Image::load(&picture).unwrap().linear_texel(24, 1);
    assert!(blue > red, "the sky is blue: {red} {blue}");
}

#[test]
fn what_is_no_environment_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let picture = folder.path().join("picture.png");
    let odd = write(folder.path(), "odd.hdr", radiance(9, 7, [9, 9, 9, 128]));
    let empty = write(folder.path(), "empty.hdr", radiance(0, 0, [0; 4]));
    let missing = folder.path().join("missing.exr");
    for (path, words) in [
        (&odd, vec!["odd.hdr", "9 x 7", "2:1"]),
        (&empty, vec!["empty.hdr"]),
        (&missing, vec!["missing.exr"]),
    ] {
        fails(1, &words, &[&"render", &model, &"-o", &picture, &"--environment", path]);
    }
    assert_eq!(files(folder.path()), ["cube.obj", "empty.hdr", "odd.hdr"]);
    for option in ["--environment-rotation=nan", "--environment-strength=-1", "--background-blur=2"] {
        fails(2, &["expected"], &[&"render", &model, &"-o", &picture, &"--environment=sky", &option]);
    }
    fails(2, &["--environment"], &[&"render", &model, &"-o", &picture, &"--background=transparent"]);
}
