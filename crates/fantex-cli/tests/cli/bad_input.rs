//! Help, wrong command lines, bad files, and interruption.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::{COLORED_PLY, CUBE_OBJ, bottle, fails, fantex, files, json, run, stderr, succeeds, write};

const COMMANDS: [&str; 9] =
    ["info", "bake", "verify", "render", "compare", "export", "generate", "bench", "demo"];

#[test]
fn every_command_explains_itself_with_an_example() {
    for command in COMMANDS {
        let output = succeeds(&[&command, &"--help"]);
        let help = String::from_utf8(output.stdout).unwrap();
        assert!(help.contains(&format!("Example:\n  fantex {command}")), "{help}");
    }
    succeeds(&[&"--version"]);
}

#[test]
fn wrong_command_lines_end_with_two() {
    fails(2, &["Usage"], &[]);
    fails(2, &["unrecognized"], &[&"fold"]);
    fails(2, &["unexpected argument '--fold'"], &[&"info", &"x.ply", &"--fold"]);
    fails(2, &["--texels", "expected a number such as"], &[&"info", &"x.ply", &"--texels", &"lots"]);
    fails(2, &["above zero"], &[&"info", &"x.ply", &"--density", &"-3"]);
    fails(2, &["expected a whole number"], &[&"info", &"x.ply", &"--seed", &"-1"]);
    fails(2, &["expected a whole number"], &[&"compare", &"x.ply", &"y.ply", &"--samples", &"many"]);
    fails(2, &["above zero"], &[&"bench", &"fidelity", &"x.ply", &"--wavelength", &"0"]);
    fails(2, &["1 to 65535"], &[&"serve", &"x.fan", &"--port", &"80000"]);
    fails(2, &["finite number"], &[&"table", &"x.toml", &"-o", &"a.png", &"--time", &"nan"]);
    fails(
        2,
        &["corner 2 is '1e300,0'"],
        &[&"warp", &"x.png", &"-o", &"a.png", &"--map", &"affine", &"--corners", &"0,0 1e300,0 0,9"],
    );
    fails(2, &["cannot be used with"], &[&"info", &"x.ply", &"--density", &"3", &"--texels", &"4M"]);
    fails(2, &["--memory"], &[&"info", &"x.ply", &"--memory", &"big"]);
    fails(2, &["--threads"], &[&"info", &"x.ply", &"--threads", &"0"]);
    fails(2, &["'cheese' is no solid"], &[&"bake", &"x.ply", &"-o", &"x.fan", &"--source", &"solid=cheese"]);
    fails(2, &["1280x720"], &[&"render", &"x.ply", &"-o", &"x.png", &"--size", &"big"]);
    fails(2, &["three numbers"], &[&"render", &"x.ply", &"-o", &"x.png", &"--eye", &"1,2"]);
}

#[test]
fn a_source_that_the_model_lacks_is_a_usage_error() {
    let folder = tempfile::tempdir().unwrap();
    let cube = write(folder.path(), "cube.obj", CUBE_OBJ);
    let colored = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("x.fan");
    fails(2, &["neither textures nor colours", "--source"], &[&"bake", &cube, &"-o", &asset]);
    fails(2, &["no textures"], &[&"bake", &colored, &"-o", &asset, &"--source", &"uv"]);
    fails(2, &["--match", "vertex"], &[&"bake", &colored, &"-o", &asset, &"--match"]);
    assert!(!asset.exists());
}

#[test]
fn models_and_assets_are_not_mistaken_for_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("colored.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"4k"]);
    fails(1, &["already baked"], &[&"bake", &asset, &"-o", &folder.path().join("again.fan")]);
    for command in ["verify", "serve"] {
        fails(1, &["is not an asset; give a .fan file", "fantex bake"], &[&command, &bottle()]);
    }
    fails(2, &["has its cover already"], &[&"info", &asset, &"--texels", &"4M"]);
    // An asset by another name is still an asset.
    let renamed = folder.path().join("colored.glb");
    std::fs::rename(&asset, &renamed).unwrap();
    succeeds(&[&"verify", &renamed]);
}

#[test]
fn missing_files_are_named() {
    for command in ["info", "verify"] {
        fails(1, &["nowhere.glb", "No such file"], &[&command, &"nowhere.glb"]);
    }
    fails(1, &["nowhere.fan"], &[&"verify", &"nowhere.fan"]);
    fails(1, &["nowhere.ply"], &[&"bake", &"nowhere.ply", &"-o", &"x.fan"]);
    fails(1, &["nowhere.ply"], &[&"render", &"nowhere.ply", &"-o", &"x.png"]);
    fails(1, &["nowhere.ply"], &[&"compare", &bottle(), &"nowhere.ply"]);
    assert!(!Path::new("x.fan").exists());
}

#[test]
fn files_that_hold_something_else_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str, content: &[u8]| write(folder.path(), name, content);
    fails(1, &["empty"], &[&"info", &path("empty.glb", b"")]);
    fails(1, &["zeros.stl"], &[&"info", &path("zeros.stl", &[0; 84])]);
    fails(1, &["PNG"], &[&"info", &path("picture.glb", b"\x89PNG\r\n\x1a\n and so on")]);
    fails(1, &["noise.xyz"], &[&"info", &path("noise.xyz", &[7, 200, 3, 0, 1, 99])]);
    fails(1, &["points.obj"], &[&"info", &path("points.obj", b"v 0 0 0\nv 1 0 0\n")]);
    fails(1, &["flat.obj"], &[&"info", &path("flat.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")]);
    fails(1, &["nan.obj"], &[&"info", &path("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")]);
    fails(1, &["model.fan", "not a .fan asset"], &[&"info", &path("model.fan", COLORED_PLY.as_bytes())]);
    fails(1, &["empty.fan"], &[&"verify", &path("empty.fan", b"")]);
    fails(1, &["folder"], &[&"info", &folder.path()]);
}

#[test]
fn a_model_cut_off_anywhere_is_refused_or_loads() {
    let folder = tempfile::tempdir().unwrap();
    let model = COLORED_PLY.as_bytes();
    for length in (0..model.len()).step_by(31) {
        let path = write(folder.path(), "cut.ply", &model[..length]);
        let output = run(&[&"info", &path]);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{length} bytes");
    }
}

#[test]
fn names_of_outputs_say_what_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let at = |name: &str| folder.path().join(name);
    for name in ["x.png", "x.USDA", "x.obj", "x.exr"] {
        fails(2, &[name, "ends in .fan"], &[&"bake", &model, &"-o", &at(name)]);
    }
    let asset = at("x.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"4k"]);
    for (name, how) in [("x.usda", "--fans"), ("x.usdc", ".usda and with --fans"), ("x.obj", "simplify")] {
        fails(2, &[name, how, ".glb or .gltf"], &[&"export", &asset, &"-o", &at(name)]);
    }
    assert_eq!(files(folder.path()), ["colored.ply", "x.fan"]);
}

#[test]
fn a_source_that_a_model_lacks_is_named_with_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let cube = write(folder.path(), "cube.obj", CUBE_OBJ);
    let asset = folder.path().join("x.fan");
    for source in ["uv", "vertex"] {
        fails(2, &["cube.obj has no", source], &[&"bake", &cube, &"-o", &asset, &"--source", &source]);
    }
}

#[test]
fn negative_numbers_are_values_and_no_options() {
    for option in ["--texels", "--density"] {
        let errors = fails(2, &["expected a number", option], &[&"info", &"x.ply", &option, &"-5"]);
        assert!(!errors.contains("-- -5"), "{errors}");
    }
}

#[test]
fn a_stray_vertex_is_an_error_that_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "stray.obj", format!("{CUBE_OBJ}v 1e9 0 0\nf 1 2 9\n"));
    let (named, asset) = (model.display().to_string(), folder.path().join("x.fan"));
    let words = [named.as_str(), "stray vertices (first: vertex 8"];
    fails(1, &words, &[&"bake", &model, &"-o", &asset]);
}

#[test]
fn what_is_no_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let index = folder.path().join("none/town.fanworld");
    fails(1, &["cannot write", "town.fanworld: there is no folder", "none"], &[&"world", &index, &"a.fan"]);
    fails(1, &["colored.ply: it is a file; give a folder"], &[&"demo", &"-o", &model]);
    fails(1, &["colored.ply: it is a file; give a folder"], &[&"gallery", &"-o", &model, &"wood"]);
    assert_eq!(files(folder.path()), ["colored.ply"]);
}

#[test]
fn an_image_that_is_missing_or_damaged_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("x.fan");
    let source = |image: &str| format!("image={},mapping=box", folder.path().join(image).display());
    write(folder.path(), "broken.png", b"\x89PNG\r\n\x1a\nnonsense");
    for image in ["missing.png", "broken.png"] {
        fails(1, &[image], &[&"bake", &model, &"-o", &asset, &"--source", &source(image)]);
    }
    assert_eq!(files(folder.path()), ["broken.png", "colored.ply"]);
}

/// A model without some of its images is shown and baked without them; not if that is refused.
#[test]
fn textures_that_are_missing_are_left_out_and_named_with_their_material() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "mtllib a.mtl\nusemtl oak\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    let model = write(folder.path(), "a.obj", obj);
    write(folder.path(), "a.mtl", "# made by hand\nnewmtl oak\nmap_Kd bark.png\n");
    let at = |name: &str| folder.path().join(name);
    let (asset, picture, look) = (at("x.fan"), at("x.png"), at("a.toml"));
    let small = &"--size=32x32";
    std::fs::write(&look, "[materials.oak]\nfrom = \"model\"\nroughness = 0.5\n").unwrap();
    let words = ["the base colour of material \"oak\" (line 3 of a.mtl)", "bark.png", "put the file there"];
    let commands: [&[&dyn AsRef<OsStr>]; 6] = [
        &[&"bake", &model, &"-o", &asset, &"--texels=1k"],
        &[&"render", &model, &"-o", &picture, small],
        &[&"render", &model, &"--look", &look, &"-o", &picture, small],
        &[&"compare", &model, &model, &"--views=1", small],
        &[&"info", &model],
        &[&"bake", &model, &"-o", &asset, &"--texels=1k", &"--look", &look],
    ];
    let (strict, force): ([&dyn AsRef<OsStr>; 1], [&dyn AsRef<OsStr>; 1]) = ([&"--strict"], [&"--force"]);
    for command in commands {
        fails(1, &words, &[command, &strict].concat());
        assert_eq!(files(folder.path()), ["a.mtl", "a.obj", "a.toml"]);
    }
    for command in commands {
        let output = succeeds(&[command, &force].concat());
        let told = stderr(&output) + &String::from_utf8_lossy(&output.stdout);
        assert!(words.iter().all(|word| told.contains(word)), "{told}");
        assert!(told.contains("a texture was left out"), "{told}");
    }
    // What is named by hand has to be there.
    std::fs::write(
        &look,
        "[textures.t]\nkind = \"image\"\nimage = \"bark.png\"\n[materials.oak]\nbase_color = \"t\"\n",
    )
    .unwrap();
    fails(1, &["a.toml:3", "bark.png"], &[commands[2], &force].concat());
}

#[test]
fn models_with_missing_and_broken_images_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("x.png");
    let gltf = |image: &str| {
        let positions = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
            "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],"textures":[{{"source":0}}],
            "images":[{{"uri":"{image}"}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
            {{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],
            "buffers":[{{"byteLength":36,"uri":"data:application/octet-stream;base64,{positions}"}}]}}"#
        )
    };
    let cases = [
        ("gone.png", "put the file there"),
        ("data:image/png;base64,iVBORw0KGgoAAAANSUhEUg==", "is not a readable PNG image"),
    ];
    for (image, why) in cases {
        let model = write(folder.path(), "a.gltf", gltf(image));
        let output = succeeds(&[&"render", &model, &"-o", &picture, &"--size=32x32", &"--force"]);
        let told = stderr(&output);
        let what = "a.gltf: a texture was left out: the base colour of material 0";
        assert!(told.contains(what) && told.contains(why), "{told}");
        fails(
            1,
            &["the base colour of material 0", why],
            &[&"render", &model, &"-o", &picture, &"--strict", &"--force"],
        );
    }
}

#[test]
fn what_is_read_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let words = ["cube.obj would be an asset"];
    fails(2, &words, &[&"bake", &model, &"-o", &model, &"--source", &"solid=wood", &"--force"]);
    assert_eq!(std::fs::read_to_string(&model).unwrap(), CUBE_OBJ);
    let asset = folder.path().join("cube.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--source", &"solid=wood", &"--texels", &"1000"]);
    let before = std::fs::read(&asset).unwrap();
    let source = format!("mesh={}", asset.display());
    fails(
        1,
        &["cube.fan is what is read"],
        // It is known before such a bake would fail by itself, or take days.
        &[&"bake", &model, &"-o", &asset, &"--source", &source, &"--force", &"--texels", &"1T"],
    );
    assert!(std::fs::read(&asset).unwrap() == before);
}

/// What is not written in a kind of its own is a fault of the command line, which is known before anything is read.
#[test]
fn names_of_unknown_kinds_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let at = |name: &str| folder.path().join(name);
    let asset = at("cube.fan");
    let (wood, texels) = (&"--source=solid=wood", &"--texels=1k");
    succeeds(&[&"bake", &model, &"-o", &asset, wood, texels]);
    let none = at("none");
    let words = ["x.foo would be an asset", "ends in .fan, or in .glb or .gltf"];
    fails(2, &words, &[&"bake", &model, &"-o", &at("x.foo"), wood, texels]);
    let merged = ["x.foo would be an asset", "ends in .fan"];
    fails(2, &merged, &[&"merge", &none, &none, &"-o", &at("x.foo")]);
    fails(2, &merged, &[&"paint", &asset, &"--alpha", &"blend", &"-o", &at("x.foo")]);
    fails(2, &["stroke file", "ends in .json"], &[&"paint", &asset, &"--export-log", &at("x.foo")]);
    let plan = at("cube.plan");
    succeeds(&[&"plan", &model, &"-o", &plan, wood, texels]);
    let words = ["would be a part", "such as 1.part"];
    fails(2, &words, &[&"bake", &plan, &"--shard=1/1", &"-o", &at("x.glb")]);
    let written = ["use .ply, .obj or .glb"];
    fails(2, &written, &[&"simplify", &none, &"-o", &at("x.foo"), &"--triangles=8"]);
    let landscape = ["use .ply, .obj or .glb, or .fan for an asset"];
    fails(2, &landscape, &[&"generate", &"landscape", &"-o", &at("x.foo")]);
    fails(2, &["use .png"], &[&"render", &none, &"-o", &at("x.foo")]);
    assert_eq!(files(folder.path()), ["cube.fan", "cube.obj", "cube.plan"]);
}

/// Numbers that the graphics card or a lamp cannot have are named with their option, before any device or file is opened.
#[test]
fn options_of_pictures_are_checked_first() {
    let folder = tempfile::tempdir().unwrap();
    let (none, picture) = (folder.path().join("none.fan"), folder.path().join("x.png"));
    let words = ["--samples 7", "--gpu", "1 or 4"];
    fails(2, &words, &[&"render", &none, &"-o", &picture, &"--gpu", &"--samples=7"]);
    for light in ["0,0,0", "1e-60,0,0", "1e60,0,0"] {
        let words = ["--light", light, "expected a direction"];
        fails(2, &words, &[&"render", &none, &"-o", &picture, &"--light", &light]);
    }
    fails(1, &["cannot read"], &[&"render", &none, &"-o", &picture, &"--light", &"1,2,3"]);
}

#[test]
fn landscapes_that_are_too_large_are_refused_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let land = folder.path().join("land.ply");
    for (triangles, words) in [("1T", "at most 715827882 are supported"), ("3M", "allow more (--memory)")] {
        let arguments: [&dyn AsRef<std::ffi::OsStr>; 7] =
            [&"generate", &"landscape", &"-o", &land, &"--triangles", &triangles, &"--memory=64M"];
        fails(1, &[words], &arguments);
    }
    assert!(files(folder.path()).is_empty());
}

/// Each tile has at least 16 texels.
#[test]
fn more_texels_than_were_asked_for_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let asset = folder.path().join("x.fan");
    let arguments: [&dyn AsRef<std::ffi::OsStr>; 9] =
        [&"bake", &model, &"-o", &asset, &"--source", &"solid=wood", &"--tile=0", &"--texels=10", &"--json"];
    let output = succeeds(&arguments);
    let note = "128 texels instead of the 10 asked for: 8 tiles cannot be smaller";
    assert!(stderr(&output).contains(note), "{}", stderr(&output));
    let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&info["texels"], &info["texels_asked"]), (&128.into(), &10.into()));
    let info = json(&[&"info", &model, &"--tile=0", &"--texels=10"]);
    assert_eq!((&info["texels"], &info["texels_asked"]), (&128.into(), &10.into()));
    assert!(info["report"].to_string().contains("instead of the 10"), "{info}");
    let info = json(&[&"info", &model, &"--density=4"]);
    assert!(info["texels_asked"].is_null());
}

#[test]
fn nothing_is_overwritten_without_force() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    for (command, name) in [("bake", "out.fan"), ("render", "out.png")] {
        let path = write(folder.path(), name, "precious");
        fails(1, &[name, "--force"], &[&command, &model, &"-o", &path]);
        assert_eq!(std::fs::read(&path).unwrap(), b"precious");
        succeeds(&[&command, &model, &"-o", &path, &"--force"]);
        assert_ne!(std::fs::read(&path).unwrap(), b"precious");
    }
    let land = write(folder.path(), "land.ply", "precious");
    fails(1, &["land.ply"], &[&"generate", &"landscape", &"-o", &land, &"--triangles", &"1k"]);
    assert_eq!(std::fs::read(&land).unwrap(), b"precious");
    assert_eq!(files(folder.path()), ["colored.ply", "land.ply", "out.fan", "out.png"]);
}

#[test]
fn places_that_cannot_be_written_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let missing = folder.path().join("no/such/out");
    for (command, extension) in [("bake", "fan"), ("render", "png")] {
        let path = missing.with_extension(extension);
        fails(1, &["there is no folder"], &[&command, &model, &"-o", &path]);
        fails(1, &["is a folder"], &[&command, &model, &"-o", &folder.path()]);
    }
    assert_eq!(files(folder.path()), ["colored.ply"]);
}

/// What an output is called is a matter of the command line.
#[test]
fn names_that_say_no_format_are_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let look = write(folder.path(), "look.toml", "[textures.wood]\nkind = 'wood'\n");
    let picture = folder.path().join("a.png");
    succeeds(&[&"render", &model, &"-o", &picture, &"--size", &"40x40"]);
    let [xyz, stl] = ["out.xyz", "out.stl"].map(|name| folder.path().join(name));
    fails(2, &["out.xyz", ".png"], &[&"render", &model, &"-o", &xyz]);
    fails(2, &["out.xyz", ".png"], &[&"image", &picture, &"-o", &xyz, &"--power-of-two"]);
    fails(2, &["out.xyz", ".png"], &[&"table", &look, &"-o", &xyz]);
    let corners: [&dyn AsRef<OsStr>; 6] = [&"--map", &"affine", &"--corners", &"0,0", &"9,0", &"0,9"];
    fails(
        2,
        &["out.xyz", ".png"],
        &[&[&"warp" as &dyn AsRef<OsStr>, &picture, &"-o", &xyz][..], &corners].concat(),
    );
    let png = folder.path().join("b.png");
    let crossed: [&dyn AsRef<OsStr>; 7] =
        [&"--map", &"perspective", &"--corners", &"0,0", &"9,9", &"9,0", &"0,9"];
    fails(
        2,
        &["convex quadrilateral", "cross"],
        &[&[&"warp" as &dyn AsRef<OsStr>, &picture, &"-o", &png][..], &crossed].concat(),
    );
    fails(1, &["a.png is no look"], &[&"table", &picture, &"-o", &png]);
    fails(2, &["number above zero"], &[&"image", &picture, &"-o", &png, &"--derivatives", &"--range", &"-1"]);
    fails(2, &["out.stl", ".ply"], &[&"simplify", &model, &"-o", &stl, &"--triangles", &"2"]);
    fails(2, &["out.stl", ".ply"], &[&"generate", &"landscape", &"-o", &stl]);
    assert_eq!(files(folder.path()), ["a.png", "colored.ply", "look.toml"]);
}

#[cfg(unix)]
#[test]
fn devices_are_not_replaced_by_files() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    for command in ["bake", "render"] {
        fails(1, &["/dev/null", "no ordinary file"], &[&command, &model, &"-o", &"/dev/null", &"--force"]);
    }
}

#[cfg(unix)]
#[test]
fn full_disks_leave_no_partial_file() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    // Beyond a limit on the size of files, writes fail like those on a full disk. Its signal does not end the program.
    let limited = |arguments: &str| {
        let program = env!("CARGO_BIN_EXE_fantex");
        let script = format!("ulimit -f 8; exec '{program}' {arguments}");
        std::process::Command::new("bash").args(["-c", &script]).current_dir(folder.path()).output().unwrap()
    };
    let model = model.display();
    for arguments in [
        format!("bake {model} -o out.fan --texels 1M --format float"),
        format!("render {model} -o out.exr --size 400x400"),
        "generate landscape -o out.ply --triangles 20k".to_owned(),
    ] {
        let output = limited(&arguments);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments}: {errors}");
        let sentence = errors.lines().last().unwrap_or_default();
        assert!(sentence.starts_with("fantex: cannot write") && sentence.contains("out."), "{errors}");
        assert_eq!(files(folder.path()), ["colored.ply"], "{arguments}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_output_is_an_error() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = crate::fantex().arg("info").arg(bottle()).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("cannot write to standard output"));
}

#[test]
fn damaged_assets_do_not_pass() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("good.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"64k", &"--format", &"rgba8"]);
    succeeds(&[&"verify", &asset]);
    let bytes = std::fs::read(&asset).unwrap();
    // The last cluster ends within the last block of the file; texels lie before it.
    let mut flipped = bytes.clone();
    let texel = bytes.len() - 4096;
    flipped[texel] ^= 0x10;
    let path = write(folder.path(), "flipped.fan", &flipped);
    let output = run(&[&"verify", &path, &"--json"]);
    assert_eq!(output.status.code(), Some(1));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["ok"], false);
    assert!(report["damaged_tiles"].as_u64().unwrap() > 0);
    // A damaged asset is still shown, from coarser levels.
    succeeds(&[&"render", &path, &"-o", &folder.path().join("flipped.png"), &"--size", &"64x64"]);
    for length in [0, 7, 4096, 9000, bytes.len() - 5000] {
        let path = write(folder.path(), "cut.fan", &bytes[..length]);
        fails(1, &["cut.fan"], &[&"verify", &path]);
        fails(1, &["cut.fan"], &[&"render", &path, &"-o", &folder.path().join("cut.png")]);
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_bake_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("out.fan");
    let bake: [&dyn AsRef<OsStr>; 8] =
        [&"bake", &bottle(), &"--source", &"solid=marble", &"--texels", &"200M", &"-o", &asset];
    // The temporary file appears once the bake has begun.
    let line = interrupted(&bake, folder.path(), 1);
    assert!(line.contains("interrupted; no unfinished file was left behind"), "{line}");
    assert!(files(folder.path()).is_empty(), "{:?}", files(folder.path()));
}

/// `nohup` ignores the signal that a closed terminal sends.
#[cfg(unix)]
#[test]
fn a_hang_up_stays_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let turn = folder.path().join("turn");
    let mut child = Command::new("sh")
        .args(["-c", "trap '' HUP; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_fantex")])
        .args(["export", "--turntable", "3600", "--size", "320x240", "-o"])
        .args([&turn, &model])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let process = child.id().to_string();
    for (count, signal) in [(2, "-HUP"), (20, "-TERM")] {
        wait_for_files(&mut child, &turn, count);
        assert!(Command::new("kill").args([signal, &process]).status().unwrap().success());
    }
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
}

/// Waits until a command has written some files into a folder.
#[cfg(unix)]
fn wait_for_files(child: &mut std::process::Child, folder: &Path, count: usize) {
    let deadline = Instant::now() + fantex_test::PATIENCE;
    while !folder.is_dir() || files(folder).len() < count {
        assert!(child.try_wait().unwrap().is_none(), "the command ended with fewer than {count} files");
        assert!(Instant::now() < deadline, "the command has not written {count} files");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Interrupts a command that has written some files into a folder; its last line.
#[cfg(unix)]
fn interrupted(arguments: &[&dyn AsRef<OsStr>], folder: &Path, count: usize) -> String {
    let mut command = fantex();
    command.args(arguments.iter().map(|a| a.as_ref()));
    interrupted_command(command, folder, count)
}

#[cfg(unix)]
fn interrupted_command(mut command: Command, folder: &Path, count: usize) -> String {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for_files(&mut child, folder, count);
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let output = child.wait_with_output().unwrap();
    let errors = stderr(&output);
    assert_eq!(output.status.code(), Some(130), "{errors}");
    errors.lines().last().unwrap_or_default().to_owned()
}

#[cfg(unix)]
#[test]
fn pictures_of_an_interrupted_turntable_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let turn = folder.path().join("turn");
    let line = interrupted(
        &[&"export", &model, &"-o", &turn, &"--turntable", &"3600", &"--size", &"320x240"],
        &turn,
        3,
    );
    let (count, turn) = (files(&turn).len(), turn.display());
    let expected =
        format!("interrupted after {count} of 3 600 pictures in {turn}; no unfinished file was left");
    assert!(line.contains(&expected), "{line}");
}

#[cfg(unix)]
#[test]
fn pictures_that_were_finished_before_a_failure_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let [turn, moved] = ["turn", "moved"].map(|name| folder.path().join(name));
    let mut command = fantex();
    command.arg("export").arg(model).arg("-o").arg(&turn);
    command.args(["--turntable", "3600", "--size", "320x240"]);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for_files(&mut child, &turn, 3);
    std::fs::rename(&turn, &moved).unwrap();
    let output = child.wait_with_output().unwrap();
    let errors = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    let is_picture = |name: &&String| name.len() == "turn-0001.png".len() && name.starts_with("turn-");
    let count = files(&moved).iter().filter(is_picture).count();
    let expected = format!("; finished before that: {count} of 3 600 pictures in {}", turn.display());
    assert!(errors.trim_end().ends_with(&expected), "{errors}");
}

/// Outside the project's folder its looks and models lie in a temporary one.
#[cfg(unix)]
#[test]
fn an_interrupted_gallery_leaves_no_temporary_folder() {
    let folder = tempfile::tempdir().unwrap();
    let [out, temporary] = ["out", "tmp"].map(|name| folder.path().join(name));
    std::fs::create_dir(&temporary).unwrap();
    let mut gallery = fantex();
    gallery.current_dir(folder.path()).env("TMPDIR", &temporary);
    gallery.args(["gallery", "--width", "32", "-o"]).arg(&out);
    let line = interrupted_command(gallery, &out, 1);
    assert!(line.contains("no unfinished file was left behind"), "{line}");
    assert!(files(&temporary).is_empty(), "{:?}", files(&temporary));
}

/// What failed or was interrupted before its first file leaves no folder, however deep that is.
#[cfg(unix)]
#[test]
fn empty_folders_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let out = folder.path().join("made/out");
    let none = folder.path().join("none.hdr");
    let turntable: [&dyn AsRef<OsStr>; 8] =
        [&"export", &model, &"-o", &out, &"--turntable", &"2", &"--environment", &none];
    fails(1, &["none.hdr"], &turntable);
    assert_eq!(files(folder.path()), ["colored.ply"]);
    interrupted(&[&"demo", &"-o", &out, &"--triangles", &"20M"], folder.path(), 2);
    assert_eq!(files(folder.path()), ["colored.ply"]);
}

/// Some of the slices would be read as a volume that is less deep.
#[cfg(unix)]
#[test]
fn interrupted_slices_and_photographs_leave_nothing_new() {
    const NOTHING: &str = "fantex: interrupted; no unfinished file was left behind";
    let folder = tempfile::tempdir().unwrap();
    let look = write(folder.path(), "look.toml", "[textures.wood]\nkind = 'wood'\n");
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let slices = folder.path().join("made/slices");
    let table: [&dyn AsRef<OsStr>; 8] =
        [&"table", &look, &"-o", &slices, &"--size", &"256x256", &"--slices", &"16384"];
    assert_eq!(interrupted(&table, &slices, 2), NOTHING);
    assert_eq!(files(folder.path()), ["colored.ply", "look.toml"]);
    let shoot = folder.path().join("shoot");
    let photographs: [&dyn AsRef<OsStr>; 9] =
        [&"generate", &"photographs", &model, &"-o", &shoot, &"--count", &"10000", &"--size", &"320x240"];
    assert_eq!(interrupted(&photographs, &shoot.join("images"), 2), NOTHING);
    assert_eq!(files(folder.path()), ["colored.ply", "look.toml"]);
    // One that would take an hour.
    let large: [&dyn AsRef<OsStr>; 9] =
        [&"generate", &"photographs", &model, &"-o", &shoot, &"--size", &"8192x8192", &"--samples", &"16"];
    assert_eq!(interrupted(&large, &shoot.join("images"), 0), NOTHING);
    assert_eq!(files(folder.path()), ["colored.ply", "look.toml"]);
    // What was there is not removed, and what was replaced is counted.
    std::fs::create_dir_all(&slices).unwrap();
    write(&slices, "notes.txt", "precious");
    write(&slices, "slice-0001.png", "replaced");
    let line = interrupted(&[&table[..], &[&"--force"]].concat(), &slices, 4);
    assert!(line.contains("interrupted after 1 of 16 384 slices in"), "{line}");
    assert_eq!(files(&slices), ["notes.txt", "slice-0001.png"]);
}

#[cfg(unix)]
#[test]
fn an_interrupted_export_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("bottle.fan");
    succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"64k"]);
    let output_folder = folder.path().join("out");
    std::fs::create_dir(&output_folder).unwrap();
    let out = output_folder.join("out.png");
    let export: [&dyn AsRef<OsStr>; 8] =
        [&"export", &asset, &"--channel", &"base-color", &"--size", &"16384", &"-o", &out];
    interrupted(&export, &output_folder, 1);
    assert!(files(&output_folder).is_empty(), "{:?}", files(&output_folder));
}

#[cfg(unix)]
#[test]
fn an_interrupted_replay_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("bottle.fan");
    succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"64k"]);
    let stroke = r#"{ "brush": { "size": { "world": 5 } }, "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
        "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 0] } }] }"#;
    let strokes = format!(r#"{{ "version": 1, "strokes": [{}] }}"#, vec![stroke; 20_000].join(","));
    let strokes = write(folder.path(), "strokes.json", strokes);
    let output_folder = folder.path().join("out");
    std::fs::create_dir(&output_folder).unwrap();
    let out = output_folder.join("out.fan");
    // The copy and its lock.
    interrupted(&[&"paint", &asset, &"--replay", &strokes, &"-o", &out], &output_folder, 2);
    assert!(files(&output_folder).is_empty(), "{:?}", files(&output_folder));
}

/// Every output on a medium that takes 4 KiB of a file: an error in one sentence, no rest, and what was there is as it was.
#[cfg(unix)]
#[test]
fn a_full_disk_is_said_and_destroys_nothing() {
    const BEFORE: &str = "what was there";
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("bottle.fan");
    succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"64k"]);
    let stroke = r#"{ "version": 1, "strokes": [{ "brush": { "size": { "texels": 30 } },
        "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
        "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 0] } }] }] }"#;
    let strokes = write(folder.path(), "strokes.json", stroke);
    let (asset, strokes, model) = [asset, strokes, bottle()].map(|path| path.display().to_string()).into();
    let commands: [(&str, &str, &[&str]); 11] = [
        ("land.ply", "generate", &["landscape", "--triangles", "2k"]),
        ("land.obj", "generate", &["landscape", "--triangles", "2k"]),
        ("bottle.fan", "bake", &[&model, "--texels", "64k"]),
        ("model.glb", "bake", &[&model, "--texels", "64k"]),
        ("color.png", "export", &[&asset, "--channel", "base-color", "--size", "256"]),
        ("color.exr", "export", &[&asset, "--channel", "base-color", "--size", "256"]),
        ("color.ktx2", "export", &[&asset, "--channel", "base-color", "--size", "256"]),
        ("bottle.glb", "export", &[&asset, "--size", "256"]),
        ("turn.png", "export", &[&asset, "--turntable", "3", "--size", "128x96"]),
        ("picture.png", "render", &[&asset, "--size", "320x240"]),
        ("painted.fan", "paint", &[&asset, "--replay", &strokes]),
    ];
    for (name, command, arguments) in commands {
        let outputs = folder.path().join(name.replace('.', "-"));
        std::fs::create_dir(&outputs).unwrap();
        let target = write(&outputs, name, BEFORE);
        let output = Command::new("sh")
            .args([
                "-c",
                "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"",
                env!("CARGO_BIN_EXE_fantex"),
                command,
            ])
            .args(arguments)
            .args(["--force".as_ref(), "-o".as_ref(), target.as_os_str()])
            .output()
            .unwrap();
        let errors = crate::stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{command} {name}: {errors}");
        assert!(
            errors.lines().last().is_some_and(|line| line.starts_with("fantex: ")),
            "{command} {name}: {errors}"
        );
        assert!(!errors.contains("panicked"), "{command} {name}: {errors}");
        assert_eq!(files(&outputs), [name], "{command}");
        assert_eq!(std::fs::read_to_string(&target).unwrap(), BEFORE, "{command} {name}");
    }
}
