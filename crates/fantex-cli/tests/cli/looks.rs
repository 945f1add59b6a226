//! Looks through the binary: pictures, bakes, translations, and what is refused.

use std::fs;
use std::path::Path;

use fantex::texture::{Depth, Image, Samples};
use serde_json::Value;

use crate::{COLORED_PLY, CUBE_OBJ, bottle, fails, files, json, run, stderr, succeeds, workspace, write};

const SCENE: &str = r##"
[picture]
size = [64, 48]
samples = 2

[camera]
eye = [0, 1.5, 3]
target = [0, 0, 0]

[[light]]
kind = "sun"
to_light = [1, 2, 1]
shadow = { size = 128 }

[[light]]
kind = "ambient"
sky = "#8090a0"

[textures.rings]
kind = "wood"

[textures.bumps]
kind = "noise"
cell = 0.1

[materials.oak]
base_color = "rings"
roughness = { texture = "bumps", factor = 0.3, offset = 0.4 }
bump = { texture = "bumps", height = 0.02 }

[[object]]
shape = { kind = "torus" }
material = "oak"

[[object]]
shape = { kind = "plane", size = [4, 1, 4] }
translate = [0, -0.25, 0]
"##;

fn pixels(path: &Path) -> (u32, u32, Vec<u8>) {
    let image = fantex::texture::Image::load(path).unwrap();
    let fantex::texture::Samples::U8(samples) = image.samples else { panic!("8 bits") };
    (image.width, image.height, samples)
}

/// What `compare` has measured; infinite for equal pictures, where the key is there and null.
fn mean_psnr_db(compared: &Value) -> f64 {
    let mean = compared["psnr_db"].get("mean").expect("the key 'psnr_db.mean'");
    if mean.is_null() { f64::INFINITY } else { mean.as_f64().expect("a number") }
}

#[test]
fn a_scene_becomes_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let look = write(folder.path(), "scene.toml", SCENE);
    let picture = folder.path().join("scene.png");
    let info = json(&[&"render", &look, &"-o", &picture]);
    assert_eq!((info["width"].as_u64(), info["height"].as_u64()), (Some(64), Some(48)));
    let (width, height, samples) = pixels(&picture);
    assert_eq!((width, height), (64, 48));
    let distinct: std::collections::BTreeSet<&[u8]> = samples.chunks(3).collect();
    assert!(distinct.len() > 100, "{} colours", distinct.len());
    // The command line overrides the look.
    let small = folder.path().join("small.png");
    succeeds(&[&"render", &look, &"-o", &small, &"--size", &"20x10"]);
    assert_eq!((pixels(&small).0, pixels(&small).1), (20, 10));
    let summary = json(&[&"info", &look]);
    assert_eq!(summary["textures"]["rings"], "wood");
    assert_eq!(summary["objects"], 2);
}

#[test]
fn animations_are_numbered_pictures_that_differ() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[picture]\nsize = [32, 32]\nframes = { count = 3, to = 1 }\n[textures.a]\nkind = \"checker\"\n\
                place = { move = [0.3, 0, 0] }\n[materials.a]\nlighting = \"unlit\"\nbase_color = \"a\"\n\
                [[object]]\nshape = { kind = \"box\" }\nmaterial = \"a\"\n";
    let look = write(folder.path(), "moving.toml", text);
    let info = json(&[&"render", &look, &"-o", &folder.path().join("out.png")]);
    assert_eq!(info["pictures"].as_array().unwrap().len(), 3);
    assert_eq!(files(folder.path()), ["moving.toml", "out-0001.png", "out-0002.png", "out-0003.png"]);
    let [first, last] = ["out-0001.png", "out-0003.png"].map(|name| pixels(&folder.path().join(name)).2);
    assert!(first != last);
}

#[test]
fn looks_are_baked_and_pass() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let text = SCENE.split("[[object]]").next().unwrap();
    let look = write(folder.path(), "oak.toml", text);
    let asset = folder.path().join("oak.fan");
    let baked = json(&[&"bake", &model, &"-o", &asset, &"--look", &look, &"--texels", &"32k"]);
    let channels: Vec<&str> =
        baked["channels"].as_array().unwrap().iter().map(|c| c.as_str().unwrap()).collect();
    assert_eq!(channels, ["BaseColor", "Normal", "OcclusionRoughnessMetallic"]);
    assert_eq!(json(&[&"verify", &asset])["ok"], true);
    // The other way to say it.
    let source = format!("look={}", look.display());
    let again = folder.path().join("again.fan");
    succeeds(&[&"bake", &model, &"-o", &again, &"--source", &source, &"--texels", &"32k"]);
    assert!(std::fs::read(&asset).unwrap() == std::fs::read(&again).unwrap());
}

#[test]
fn a_solid_of_a_look_is_the_solid_itself() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let text = "[textures.stone]\nkind = \"marble\"\n[bake]\ntexture = \"stone\"\n";
    let look = write(folder.path(), "stone.toml", text);
    let [a, b] = ["a.fan", "b.fan"].map(|name| folder.path().join(name));
    let bake = |asset: &Path, option: &str, value: &Path| {
        let size: [&str; 4] = ["--texels", "64k", "--format", "float"];
        succeeds(&[&"bake", &model, &"-o", &asset, &option, &value, &size[0], &size[1], &size[2], &size[3]]);
    };
    bake(&a, "--look", &look);
    bake(&b, "--source", Path::new("solid=marble"));
    let compared = json(&[&"compare", &a, &b, &"--views", &"1", &"--size", &"64x64"]);
    assert!(mean_psnr_db(&compared) > 50.0, "{compared:#}");
}

#[test]
fn finished_light_is_baked() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let text = "[materials.white]\nbase_color = 0.8\n[bake]\nlight = { samples = 16, bounces = 1 }\n\
                [[light]]\nkind = \"sun\"\nto_light = [1, 2, 3]\n[environment]\ncolor = [0.2, 0.3, 0.4]\n";
    let look = write(folder.path(), "lit.toml", text);
    let asset = folder.path().join("lit.fan");
    let baked = json(&[&"bake", &model, &"-o", &asset, &"--look", &look, &"--texels", &"16k"]);
    assert_eq!(baked["channels"].as_array().unwrap().len(), 1);
    assert_eq!(json(&[&"verify", &asset])["ok"], true);
    // Denoised unless the look says otherwise.
    let error = |baked: &Value, name: &str| baked["light"][name].as_f64().unwrap();
    assert!(error(&baked, "error_left") < 0.5 * error(&baked, "error"), "{baked:#}");
    assert_eq!(baked["light"]["mean_samples"], 16.0);
    let noisy =
        write(folder.path(), "noisy.toml", text.replace("bounces = 1", "bounces = 1, denoise = false"));
    let asset = folder.path().join("noisy.fan");
    let baked = json(&[&"bake", &model, &"-o", &asset, &"--look", &noisy, &"--texels", &"16k"]);
    assert_eq!(error(&baked, "error_left"), error(&baked, "error"));
}

/// An image that lies by texture coordinates is one texel where there are none: told in pictures and bakes, unless it lies otherwise.
#[test]
fn images_on_a_model_without_texture_coordinates_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "bare.ply", COLORED_PLY);
    let image = workspace().join("assets/images/grass.png");
    std::fs::copy(image, folder.path().join("grass.png")).unwrap();
    let [picture, asset] = ["p.png", "a.fan"].map(|name| folder.path().join(name));
    let image = "kind = \"image\"\nimage = \"grass.png\"\ncoordinates = ";
    for (texture, wanted) in [
        (format!("{image}\"uv\""), Some("has no texture coordinates, and")),
        (format!("{image}{{ from = \"uv\", set = 7 }}"), Some("has no texture coordinates of set 7, and")),
        ("kind = \"uv\"".to_owned(), Some("has no texture coordinates, and")),
        (format!("{image}\"box\""), None),
        (format!("{image}\"triplanar\""), None),
    ] {
        let remapped = "[textures.dark]\nkind = \"remap\"\ninput = \"grass\"\nto = [0, 0.5]";
        let look =
            format!("[textures.grass]\n{texture}\n{remapped}\n[materials.lawn]\nbase_color = \"dark\"\n");
        let look = write(folder.path(), "look.toml", &look);
        let commands: [&[&dyn AsRef<std::ffi::OsStr>]; 2] = [
            &[&"render", &model, &"--look", &look, &"-o", &picture, &"--size", &"16x16", &"--force"],
            &[&"bake", &model, &"--look", &look, &"-o", &asset, &"--texels", &"5k", &"--force"],
        ];
        for command in commands {
            let told = crate::stderr(&succeeds(command));
            match wanted {
                Some(wanted) => assert_eq!(told.matches(wanted).count(), 1, "{texture}: {told}"),
                None => assert!(!told.contains("texture coordinates"), "{texture}: {told}"),
            }
        }
    }
}

#[test]
fn a_translation_bakes_what_the_model_itself_bakes() {
    let folder = tempfile::tempdir().unwrap();
    let translated = succeeds(&[&"info", &bottle(), &"--look"]);
    let text = String::from_utf8(translated.stdout).unwrap();
    assert!(text.contains("model_image") && text.contains("normal_map"), "{text}");
    let look = write(folder.path(), "bottle.toml", &text);
    let [own, dressed] = ["own.fan", "dressed.fan"].map(|name| folder.path().join(name));
    succeeds(&[&"bake", &bottle(), &"-o", &own, &"--texels", &"300k"]);
    let baked = json(&[&"bake", &bottle(), &"-o", &dressed, &"--look", &look, &"--texels", &"300k"]);
    assert_eq!(baked["channels"].as_array().unwrap().len(), 4);
    let compared = json(&[&"compare", &own, &dressed, &"--views", &"2", &"--size", &"200x200"]);
    assert!(mean_psnr_db(&compared) > 40.0, "{compared:#}");
    let machine = json(&[&"info", &bottle(), &"--look"]);
    assert_eq!(machine["materials"].as_array().unwrap().len(), 1);
}

#[test]
fn bad_looks_are_refused_with_file_line_and_key() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("out.png");
    let image = |name: &str| format!("[textures.a]\nkind = \"image\"\nimage = \"{name}\"\n");
    let object =
        "[materials.m]\nbase_color = \"a\"\n[[object]]\nshape = { kind = \"sphere\" }\nmaterial = \"m\"\n";
    let cases: [(String, &[&str]); 11] = [
        ("[picture]\nsizes = [1, 1]\n".into(), &["look.toml:2", "picture", "did you mean 'size'?"]),
        ("[camera]\nfov = \"wide\"\n".into(), &["look.toml:2", "camera.fov", "expected a number"]),
        ("[camera]\nfov = nan\n".into(), &["look.toml:2", "camera.fov", "finite"]),
        (image("missing.png") + object, &["look.toml:3", "textures.a.image", "missing.png"]),
        (image("empty.png") + object, &["look.toml:3", "textures.a.image", "empty.png"]),
        ("[materials.m]\nbase_color = \"b\"\n".into(), &["look.toml:2", "there is no texture 'b'"]),
        (
            "[textures.a]\nkind = \"mix\"\na = \"a\"\nb = 1\nmask = 1\n".into(),
            &["look.toml:3", "textures.a.a", "a -> a"],
        ),
        ("[picture]\n".into(), &["look.toml", "names no model"]),
        (
            "[textures.a]\nkind = \"ramp\"\ninput = 1\nstops = [{ at = 1, color = [1, 1, 1] }, { at = 0, color = [0, 0, 0] }]\n".to_owned()
                + object,
            &["look.toml:4", "textures.a.stops", "ascending"],
        ),
        ("[[object]]\nmodel = \"no.obj\"\n".into(), &["look.toml:2", "object[1].model", "no.obj"]),
        (
            "[camera]\neye = [1, 0, 0]\ntarget = [1, 0, 0]\n[[object]]\nshape = { kind = \"box\" }\n".into(),
            &["look.toml:1", "camera", "same point"],
        ),
    ];
    write(folder.path(), "empty.png", "");
    for (text, parts) in cases {
        let look = write(folder.path(), "look.toml", &text);
        fails(1, parts, &[&"render", &look, &"-o", &picture]);
        assert_eq!(files(folder.path()), ["empty.png", "look.toml"], "{text}");
    }
}

#[test]
fn light_that_pictures_refuse_is_not_baked() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let spot =
        "[[light]]\nkind = \"spot\"\nposition = [2, 3, 3]\ntarget = [0, 0, 0]\ninner = 50\nouter = 40\n";
    for (light, place) in [
        (spot, "look.toml:6: light[1].outer"),
        ("[[light]]\nkind = \"sun\"\nto_light = [0, 0, 0]\n", "look.toml:3: light[1].to_light"),
        ("[environment]\ncapture = { position = [0, 1, 0] }\n", "look.toml:2: environment.capture"),
    ] {
        let text = format!("{light}[materials.m]\nbase_color = 0.7\n[bake]\nlight = {{ samples = 4 }}\n");
        let look = write(folder.path(), "look.toml", text);
        fails(1, &[place], &[&"bake", &model, &"-o", &folder.path().join("out.fan"), &"--look", &look]);
    }
}

#[test]
fn what_has_no_sense_with_looks_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let look = write(
        folder.path(),
        "look.toml",
        "[materials.m]\nbase_color = \"rim\"\n[textures.rim]\nkind = \"facing\"\n",
    );
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("out.fan");
    fails(1, &["depends on the eye"], &[&"bake", &model, &"-o", &asset, &"--look", &look]);
    fails(1, &["is a look"], &[&"bake", &look, &"-o", &asset]);
    fails(1, &["is a look"], &[&"verify", &look]);
    fails(
        2,
        &["leave --light"],
        &[&"render", &look, &"-o", &folder.path().join("a.png"), &"--light", &"1,1,1"],
    );
    fails(1, &["no model"], &[&"info", &look, &"--look"]);
    assert!(run(&[&"render", &"no.toml", &"-o", &folder.path().join("a.png")]).status.code() == Some(1));
    assert_eq!(files(folder.path()), ["colored.ply", "look.toml"]);
}

#[test]
fn the_schema_is_json() {
    let text = std::fs::read_to_string(workspace().join("docs/look.schema.json")).unwrap();
    let schema: Value = serde_json::from_str(&text).unwrap();
    assert!(schema["$defs"]["TextureTable"]["oneOf"].as_array().unwrap().len() > 20);
}

#[test]
fn looks_are_compared_with_what_was_baked_from_them() {
    let folder = tempfile::tempdir().unwrap();
    let look = write(
        folder.path(),
        "marble.toml",
        "[textures.stone]\nkind = \"marble\"\n[materials.stone]\nbase_color = \"stone\"\n\n[environment]\n\
         sky = { }\nvisible = true\n",
    );
    let own = write(
        folder.path(),
        "own.toml",
        "[textures.stone]\nkind = \"marble\"\n[materials.stone]\nbase_color = \"stone\"\n",
    );
    let model = write(folder.path(), "cube.obj", crate::CUBE_OBJ);
    let asset = folder.path().join("cube.fan");
    json(&[&"bake", &model, &"-o", &asset, &"--look", &own, &"--texels", &"200k"]);
    // The look dresses the other file's model, and cameras stand around it.
    let flags = ["--views", "2", "--size", "120x90"];
    let flags: Vec<&dyn AsRef<std::ffi::OsStr>> = flags.iter().map(|f| f as _).collect();
    let compared = |a: &Path, b: &Path| {
        json(&[&[&"compare" as &dyn AsRef<std::ffi::OsStr>, &a, &b][..], &flags].concat())
    };
    let both_ways = [compared(&own, &asset), compared(&asset, &own)];
    for info in &both_ways {
        assert!(info["psnr_db"]["min"].as_f64().unwrap() > 31.5, "{info:#}");
    }
    // Another light.
    let lit = compared(&look, &asset);
    assert!(lit["psnr_db"]["min"].as_f64().unwrap() < 30.0, "{lit:#}");
    fails(1, &["names no model"], &[&"compare", &own, &own]);
    // The model itself has no colours.
    let said = |a: &Path, b: &Path| {
        stderr(&succeeds(&[&[&"compare" as &dyn AsRef<std::ffi::OsStr>, &a, &b][..], &flags].concat()))
    };
    let told = "cube.obj has no textures or colours of its own";
    for [a, b, grey] in [[&model, &asset, &asset], [&asset, &model, &asset], [&own, &asset, &own]] {
        assert_eq!(said(a, b).matches(told).count(), usize::from(grey == &asset));
    }
}

#[test]
fn displacements_become_the_geometry_of_the_asset() {
    let folder = tempfile::tempdir().unwrap();
    let look = write(
        folder.path(),
        "clods.toml",
        "[textures.clods]\nkind = \"noise\"\ncell = 0.6\n[materials.earth]\nbase_color = \"#8a6a4a\"\n\
         displacement = { texture = \"clods\", height = 0.3, middle = 0, edge = 0.1 }\n",
    );
    let model = write(folder.path(), "cube.obj", crate::CUBE_OBJ);
    let asset = folder.path().join("clods.fan");
    let info = json(&[&"bake", &model, &"-o", &asset, &"--look", &look, &"--texels", &"100k"]);
    assert!(info["triangles"].as_u64().unwrap() > 1000, "{info:#}");
    assert_eq!(json(&[&"verify", &asset])["ok"], true);
    // The picture of the look on the model is that of the asset, silhouette and all.
    let pictures = [folder.path().join("look.png"), folder.path().join("asset.png")];
    let camera = ["--size", "160x120", "--eye", "3,2,5", "--target", "0,0,0"];
    let camera: Vec<&dyn AsRef<std::ffi::OsStr>> = camera.iter().map(|f| f as _).collect();
    let render = |input: &[&dyn AsRef<std::ffi::OsStr>]| {
        succeeds(&[&[&"render" as &dyn AsRef<std::ffi::OsStr>][..], input, &camera].concat());
    };
    render(&[&model, &"--look", &look, &"-o", &pictures[0]]);
    render(&[&asset, &"-o", &pictures[1]]);
    let [look, asset] = pictures.map(|path| fantex::texture::Image::load(path).unwrap());
    let compared = fantex::texture::compare::compare(&look, &asset).unwrap();
    assert!(compared.psnr_db > 35.0, "{}", compared.psnr_db);
}

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
    let alone = folder.path().join("alone.png");
    json(&[&"render", &model, &"-o", &alone, &"--background", &"transparent", &"--size=32x24"]);
    let image = fantex::texture::Image::load(&alone).unwrap();
    assert_eq!([(0, 0), (16, 12)].map(|(x, y)| image.linear_texel(x, y)[3]), [0.0, 1.0]);
    // Known before anything is rendered.
    let look = write(folder.path(), "look.toml", "[picture]\nbackground = \"#00000000\"\n");
    let jpeg = folder.path().join("a.jpg");
    fails(2, &["JPEG cannot hold"], &[&"render", &model, &"-o", &jpeg, &"--background", &"transparent"]);
    fails(2, &["JPEG cannot hold"], &[&"render", &model, &"-o", &jpeg, &"--look", &look]);
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
    fails(2, &["--environment"], &[&"render", &model, &"-o", &picture, &"--background=environment"]);
}

/// A plane that rises to the right, from 0 to 1.
const SLOPE: &str = r#"
[textures.slope]
kind = "sines"
place = { unit = "world" }
waves = [{ direction = [1, 0, 0], length = 8, amplitude = 0.5 }]

[textures.ground]
kind = "landscape"

[materials.ground]
base_color = "ground"
lighting = "unlit"
displacement = { texture = "slope", height = 1, edge = 0.1 }
"#;

/// Sand, grass, scree and snow lie by the altitudes of the displaced ground: the flat plane has none.
#[test]
fn landscapes_know_what_displacement_has_made_of_a_plane() {
    let folder = tempfile::tempdir().unwrap();
    let look = write(folder.path(), "slope.toml", SLOPE);
    let plane = write(folder.path(), "plane.obj", "v -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nf 4 3 2 1\n");
    let asset = folder.path().join("plane.fan");
    succeeds(&[&"bake", &plane, &"-o", &asset, &"--look", &look, &"--texels", &"60k"]);
    let [of_look, of_asset] = ["look.png", "asset.png"].map(|name| folder.path().join(name));
    let from_above = ["--size=64x48", "--eye=0,6,0.001", "--target=0,0,0", "--fov=36"];
    let [size, eye, target, fov] = &from_above;
    succeeds(&[&"render", &plane, &"--look", &look, &"-o", &of_look, size, eye, target, fov]);
    succeeds(&[&"render", &asset, &"-o", &of_asset, size, eye, target, fov]);
    for picture in [of_look, of_asset] {
        let image = Image::load(&picture).unwrap();
        // The mean of a column's middle, from the lowest to the highest.
        let column = |x: u32| {
            let texels = (12..36).map(|y| image.linear_texel(x, y));
            texels.fold([0.0; 3], |sum, t| [0, 1, 2].map(|channel| sum[channel] + t[channel] / 24.0))
        };
        let [sand, grass, scree, snow] = [10, 26, 36, 50].map(column);
        assert!(sand[0] > 0.35 && sand[0] > 1.5 * sand[2], "sand {sand:?}");
        assert!(grass[1] < 0.25 && grass[1] > 2.0 * grass[2], "grass {grass:?}");
        assert!(scree[0] < 0.4 && scree[2] > 0.1, "scree {scree:?}");
        assert!(snow[0] > 0.7 && snow[2] > snow[0], "snow {snow:?}");
        let steps = (8..55).map(|x| (column(x + 1)[1] - column(x)[1]).abs());
        let largest = steps.fold(0.0, f32::max);
        assert!(largest < 0.4, "{}: a border of {largest}", picture.display());
    }
}

/// A light map is baked, verified, exported, and lights the model by a look: a cube under the sun, on which nothing leaks over edges.
#[test]
fn light_maps_go_the_whole_way() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let cube = folder.path().join("cube.obj");
    fs::write(&cube, CUBE_OBJ).unwrap();
    let sun = "[[light]]\nkind = \"sun\"\nto_light = [0, 1, 0]\nradius = 0\n";
    let bake = write(
        folder.path(),
        "bake.toml",
        format!(
            "[bake]\nlight = {{ quantity = \"direct\", colored = false, samples = 16 }}\n{sun}[materials.a]\n"
        ),
    );
    let fan = at("light.fan");
    let baked = json(&[&"bake", &cube, &"-o", &fan, &"--look", &bake, &"--texels", &"20k"]);
    assert_eq!(baked["channels"], serde_json::json!(["Light"]));
    assert_eq!(json(&[&"verify", &fan])["ok"], true);
    let exr = at("light.exr");
    succeeds(&[&"export", &fan, &"-o", &exr, &"--channel", &"light", &"--size", &"256"]);
    assert_eq!(Image::load(&exr).unwrap().width, 256);
    // The cube seen from above at an angle: its top is white, its front black up to the edge.
    let look = |light_map: &str| {
        format!(
            "[picture]\nsize = [96, 96]\nbackground = \"#0000ff\"\ntone_mapping = \"none\"\n[camera]\neye = [0, 3, 5]\ntarget = [0, 0, 0]\n\
             [[light]]\nkind = \"sun\"\nto_light = [0, 0, 1]\n[textures.baked]\nkind = \"asset\"\nasset = \"light.fan\"\n\
             [materials.a]\nlight_map = {light_map}\nspecular = 0\n"
        )
    };
    let picture = |name: &str, light_map: &str| {
        let file = write(folder.path(), &format!("{name}.toml"), look(light_map));
        let png = at(&format!("{name}.png"));
        succeeds(&[&"render", &cube, &"--look", &file, &"-o", &png]);
        pixels(&png)
    };
    let (width, height, lit) = picture("lit", "\"baked\"");
    let column: Vec<[u8; 3]> = (0..height as usize)
        .map(|y| (y * width as usize + width as usize / 2) * 3)
        .map(|i| [lit[i], lit[i + 1], lit[i + 2]])
        .collect();
    let model: Vec<u8> = column.iter().filter(|c| **c != [0, 0, 255]).map(|c| c[0]).collect();
    let white = model.iter().filter(|&&grey| grey > 250).count();
    let black = model.iter().filter(|&&grey| grey < 3).count();
    assert!(white > 8 && black > 8 && model.len() - white - black <= 3, "{model:?}");
    // Zero is black whatever shines.
    let (_, _, dark) = picture("dark", "0");
    assert!(dark.chunks(3).all(|c| c == [0, 0, 0] || c[2] > c[0]), "a light map of 0 is not black");
    let emission = look("\"baked\"").replace("light.fan\"", "light.fan\"\nchannel = \"emission\"");
    let file = write(folder.path(), "no.toml", &emission);
    let sentence =
        fails(1, &["asset", "channel"], &[&"render", &cube, &"--look", &file, &"-o", &at("no.png")]);
    assert!(sentence.contains("it has light"), "{sentence}");
}

/// Heights stay a channel where the look asks for it, and leave as a picture.
#[test]
fn displacements_are_baked_as_heights() {
    let folder = tempfile::tempdir().unwrap();
    let cube = folder.path().join("cube.obj");
    fs::write(&cube, CUBE_OBJ).unwrap();
    let look = write(
        folder.path(),
        "heights.toml",
        "[bake]\nheights = true\n[textures.half]\nkind = \"color\"\ncolor = [0.25, 0.5, 1]\n[materials.a]\n\
         displacement = { texture = \"half\", height = 0.5 }\n",
    );
    let fan = folder.path().join("h.fan");
    let mesh_as_it_is: [&dyn AsRef<std::ffi::OsStr>; 2] = [&"--longest-edge", &"0"];
    let bake: [&dyn AsRef<std::ffi::OsStr>; 8] =
        [&"bake", &cube, &"-o", &fan, &"--look", &look, &"--texels", &"20k"];
    let baked = json(&[&bake[..], &mesh_as_it_is].concat());
    assert_eq!(baked["channels"], serde_json::json!(["BaseColor", "Displacement"]));
    assert_eq!(baked["triangles"], 12);
    let png = folder.path().join("h.png");
    succeeds(&[
        &"export",
        &fan,
        &"-o",
        &png,
        &"--channel",
        &"displacement",
        &"--depth",
        &"16",
        &"--size",
        &"128",
    ]);
    let image = Image::load(&png).unwrap();
    let Samples::U16(samples) = &image.samples else { panic!("16 bits") };
    assert!(samples.iter().all(|&s| (f32::from(s) / 65535.0 - 0.25).abs() < 0.01));
}

/// Tables of a texture: what a formula says, over the domain that is asked for.
#[test]
fn textures_are_tabulated_into_files() {
    let folder = tempfile::tempdir().unwrap();
    let look = write(
        folder.path(),
        "t.toml",
        "[textures.x]\nkind = \"height\"\ndirection = [1, 0, 0]\norigin = [0, 0, 0]\n[textures.z]\nkind = \"height\"\ndirection = [0, 0, 1]\norigin = [0, 0, 0]\n",
    );
    let at = |name: &str| folder.path().join(name);
    let exr = at("x.exr");
    let base: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"table", &look, &"--texture", &"x"];
    let info = json(
        &[&base[..], &[&"-o", &exr, &"--size", &"8x2", &"--from", &"-1,1,0", &"--to", &"3,-1,0"]].concat(),
    );
    let image = Image::load(&exr).unwrap();
    for x in 0..8 {
        let expected = -1.0 + 4.0 * (x as f32 + 0.5) / 8.0;
        assert!((image.linear_texel(x, 1)[0] - expected).abs() < 1e-5);
    }
    assert!((info["min"][0].as_f64().unwrap() + 0.75).abs() < 1e-5);
    let slices = at("slices");
    succeeds(&[
        &"table",
        &look,
        &"--texture",
        &"z",
        &"-o",
        &slices,
        &"--size",
        &"4x4",
        &"--slices",
        &"4",
        &"--from",
        &"0,0,0",
        &"--to",
        &"1,1,1",
        &"--color-space",
        &"linear",
    ]);
    let values: Vec<u8> = (1..=4).map(|i| pixels(&slices.join(format!("slice-{i:04}.png"))).2[0]).collect();
    assert_eq!(values, [32, 96, 159, 223]);
    fails(2, &["2 textures", "--texture"], &[&"table", &look, &"-o", &at("no.png")]);
}

/// Images of one row are tables of one dimension: a texture's number is the place in them.
#[test]
fn images_of_one_row_are_indexed_by_textures() {
    let folder = tempfile::tempdir().unwrap();
    let row: Vec<f32> = (0..16).flat_map(|i| [i as f32 / 15.0, 1.0 - i as f32 / 15.0, 0.0]).collect();
    Image::from_linear(16, 1, 3, row).save(folder.path().join("row.exr")).unwrap();
    let look = write(
        folder.path(),
        "row.toml",
        "[textures.x]\nkind = \"height\"\ndirection = [1, 0, 0]\norigin = [0, 0, 0]\n[textures.scale]\nkind = \"image\"\nimage = \"row.exr\"\nwrap = \"clamp\"\n\
         coordinates = { from = \"texture\", u = { texture = \"x\", offset = 0.5 } }\n",
    );
    let exr = folder.path().join("scale.exr");
    succeeds(&[
        &"table",
        &look,
        &"--texture",
        &"scale",
        &"-o",
        &exr,
        &"--size",
        &"16x4",
        &"--depth",
        &"float",
    ]);
    let image = Image::load(&exr).unwrap();
    for x in 1..15 {
        let [red, green, ..] = image.linear_texel(x, 2);
        let expected = x as f32 / 15.0;
        assert!((red - expected).abs() < 0.02 && (green - 1.0 + expected).abs() < 0.02, "{x}: {red} {green}");
    }
}

#[test]
fn the_examples_of_warp_run() {
    let folder = tempfile::tempdir().unwrap();
    let row: Vec<f32> = (0..48).map(|i| i as f32 / 48.0).collect();
    Image::from_linear(4, 4, 3, row).save(folder.path().join("brick.png")).unwrap();
    let help = String::from_utf8(succeeds(&[&"warp", &"--help"]).stdout).unwrap();
    let examples = help.split("Example:").nth(1).and_then(|rest| rest.split("\n\n").next()).unwrap();
    // Long ones are broken into lines.
    let mut examples: Vec<&str> = examples.split("fantex warp ").skip(1).collect();
    assert_eq!(examples.len(), 3);
    examples.push("-o outside.png --map affine --size 30x20 --corners -10,-5 20,-5 -10,15 brick.png --json");
    for example in examples {
        let words = example.split_whitespace();
        let output = crate::fantex().arg("warp").args(words).current_dir(folder.path()).output().unwrap();
        assert!(output.status.success(), "{example}: {}", crate::stderr(&output));
    }
    let size = |name: &str| {
        let image = Image::load(folder.path().join(name)).unwrap();
        [image.width, image.height]
    };
    let sizes = ["floor.png", "turned.png", "bent.png", "outside.png"].map(size);
    assert_eq!(sizes, [[640, 360], [300, 300], [400, 400], [30, 20]]);
}

/// Warps and sizes of a user's own image.
#[test]
fn images_are_warped_and_scaled() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let image = at("a.png");
    let texels: Vec<[f32; 4]> =
        (0..100 * 60).map(|i| [(i % 100) as f32 / 99.0, (i / 100) as f32 / 59.0, 0.5, 1.0]).collect();
    Image::from_linear_rgb(100, 60, &texels)
        .converted(Depth::U8, fantex::texture::ColorSpace::Linear)
        .save(&image)
        .unwrap();
    let corners = ["10,5", "70,15", "60,50", "5,40"];
    for (map, count) in [("affine", 3), ("perspective", 4), ("bilinear", 4)] {
        let mut pictures = Vec::new();
        for way in ["inverse", "forward"] {
            let png = at(&format!("{map}-{way}.png"));
            let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![
                &"warp",
                &image,
                &"-o",
                &png,
                &"--map",
                &map,
                &"--way",
                &way,
                &"--size",
                &"80x60",
                &"--corners",
            ];
            arguments.extend(corners.iter().take(count).map(|c| c as &dyn AsRef<std::ffi::OsStr>));
            let info = json(&arguments);
            assert!(info["covered_share"].as_f64().unwrap() > 0.2, "{info}");
            pictures.push(Image::load(&png).unwrap());
        }
        // Both ways show the same inside.
        let [inverse, forward] = [0, 1].map(|k| &pictures[k]);
        let (mut sum, mut count) = (0.0, 0);
        for (x, y) in (0..60).flat_map(|y| (0..80).map(move |x| (x, y))) {
            let [a, b] = [inverse, forward].map(|image| image.linear_texel(x, y));
            if a[3] == 1.0 && b[3] == 1.0 {
                sum += (a[0] - b[0]).abs() + (a[1] - b[1]).abs();
                count += 1;
            }
        }
        assert!(count > 800 && sum / (count as f32) < 0.02, "{map}: {count} pixels, {sum}");
    }
    fails(
        2,
        &["three corners", "4 are given"],
        &[
            &"warp",
            &image,
            &"-o",
            &at("no.png"),
            &"--map",
            &"affine",
            &"--corners",
            &"0,0",
            &"1,0",
            &"1,1",
            &"0,1",
        ],
    );
    succeeds(&[&"image", &image, &"-o", &at("pot.png"), &"--power-of-two"]);
    let pot = Image::load(at("pot.png")).unwrap();
    assert_eq!([pot.width, pot.height], [128, 64]);
    let info = json(&[&"image", &image, &"-o", &at("d.png"), &"--derivatives", &"--wrap", &"clamp"]);
    assert!((info["range"].as_f64().unwrap() - 100.0 / 99.0).abs() < 0.2, "{info}");
    // A cubic through bytes is at most 1.34 steep; rounded to bytes again, it would have steps of 400 / 255.
    let info = json(&[
        &"image",
        &image,
        &"-o",
        &at("l.png"),
        &"--derivatives",
        &"--size",
        &"400x60",
        &"--wrap",
        &"clamp",
    ]);
    assert!((1.0..1.4).contains(&info["range"].as_f64().unwrap()), "{info}");
    fails(2, &["--power-of-two"], &[&"image", &image, &"-o", &at("no.png")]);
    let jpeg: [&dyn AsRef<std::ffi::OsStr>; 5] = [&"image", &image, &"-o", &at("no.jpg"), &"--power-of-two"];
    fails(2, &["eight bits", "--depth"], &[&jpeg[..], &[&"--depth", &"16"]].concat());
    let affine: [&dyn AsRef<std::ffi::OsStr>; 9] =
        [&"warp", &image, &"-o", &at("no.png"), &"--map", &"affine", &"--corners", &"0,0 9,0 0,9", &"--way"];
    let unused: [[&dyn AsRef<std::ffi::OsStr>; 3]; 3] = [
        [&"forward", &"--filter", &"nearest"],
        [&"forward", &"--wrap", &"repeat"],
        [&"inverse", &"--spread", &"area"],
    ];
    for options in unused {
        fails(2, &["belongs to"], &[&affine[..], &options].concat());
    }
}

/// The normals of a model on itself are the flat map; relative to the model's axes they are not.
#[test]
fn normals_become_a_map_of_the_coarse_model() {
    let folder = tempfile::tempdir().unwrap();
    let map = |name: &str, space: &str| {
        let path = folder.path().join(name);
        let info =
            json(&[&"normals", &bottle(), &bottle(), &"-o", &path, &"--size", &"48x48", &"--space", &space]);
        assert!(info["width"] == 48 && info["missed_share"].as_f64().unwrap() < 0.01, "{info:#}");
        pixels(&path).2
    };
    let is_flat = |texel: &&[u8]| texel[0].abs_diff(128) < 4 && texel[1].abs_diff(128) < 4 && texel[2] > 250;
    let [tangent, object] = [map("tangent.png", "tangent"), map("object.png", "object")];
    let flat = |texels: &[u8]| texels.chunks(3).filter(is_flat).count();
    assert!(
        flat(&tangent) > 2200 && flat(&object) < 1200,
        "{} and {} of 2304",
        flat(&tangent),
        flat(&object)
    );
    let plain = write(folder.path(), "cube.ply", COLORED_PLY);
    let output = folder.path().join("n.png");
    let needs_none = ["cube.ply has no texture coordinates", "fantex bake", "--source mesh="];
    fails(2, &needs_none, &[&"normals", &plain, &bottle(), &"-o", &output]);
    // A fault of the command line is told before models are read.
    fails(2, &["8193 x 4"], &[&"normals", &"none.glb", &"none.glb", &"-o", &output, &"--size", &"8193x4"]);
    let squeezed = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";
    let squeezed = write(folder.path(), "squeezed.obj", squeezed);
    let empty = succeeds(&[&"normals", &squeezed, &plain, &"-o", &output, &"--size", &"4x4"]);
    assert!(stderr(&empty).contains("cover the middle of no texel"), "{}", stderr(&empty));
    let repeated = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 4 0\nvt 0 4\nf 1/1 2/2 3/3\n";
    let repeated = write(folder.path(), "repeated.obj", repeated);
    let shared = succeeds(&[&"normals", &repeated, &plain, &"-o", &output, &"--size", &"16x16", &"--force"]);
    assert!(stderr(&shared).contains("87.5 % of what its texture coordinates cover"), "{}", stderr(&shared));
}

/// What a look makes is counted before it is made.
#[test]
fn skies_and_shapes_that_are_too_large_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let object =
        |shape: &str| format!("[[object]]\nshape = {{ {shape} }}\nmaterial = \"m\"\n[materials.m]\n");
    let plane = "kind = \"plane\"";
    let cases = [
        (
            object(plane) + "[environment]\nsky = {}\nsize = 8192\n",
            ["environment.sky", "6 x 8192 x 8192 texels"],
        ),
        (
            object(plane) + "[environment]\ncolor = \"#ffffff\"\nform = \"sphere\"\nsize = 8192\n",
            ["environment.size", "1 x 16384 x 8192 texels"],
        ),
        (object("kind = \"plane\", segments = 4096"), ["object[1].shape", "33554432 triangles"]),
    ];
    for (look, words) in cases {
        let path = write(folder.path(), "big.toml", look);
        let picture = folder.path().join("a.png");
        let render: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"render", &path, &"-o", &picture];
        fails(1, &words, &[&render[..], &[&"--memory", &"100M", &"--size", &"8x8"]].concat());
        assert!(!picture.exists());
    }
}

#[test]
fn displacement_that_is_too_fine_names_its_keys() {
    let folder = tempfile::tempdir().unwrap();
    let look = |edge: &str| {
        format!(
            "[[object]]\nshape = {{ kind = \"plane\" }}\nmaterial = \"m\"\n[textures.t]\nkind = \"noise\"\n[materials.m]\n\
             displacement = {{ texture = \"t\", height = 0.1, edge = {edge}, max_triangles = 1000 }}\n"
        )
    };
    for (edge, words) in [
        ("0.01", ["edges of 0.01 make more than the 1 000 triangles", "max_triangles larger"]),
        ("1e-9", ["edges of 0.000000001 are too short", "or more"]),
    ] {
        let path = write(folder.path(), "fine.toml", look(edge));
        fails(1, &words, &[&"render", &path, &"-o", &folder.path().join("a.png"), &"--size", &"8x8"]);
    }
}
