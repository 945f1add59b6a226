//! `fantex bake` into a model with texture coordinates.

use fantex::texture::Image;
use serde_json::json as value;

use crate::{COLORED_PLY, CUBE_OBJ, bottle, fails, files, json, succeeds, write};

#[test]
fn a_bottle_is_baked_into_a_model_that_looks_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("out.glb");
    let info = json(&[&"bake", &bottle(), &"-o", &model, &"--texels", &"1M"]);
    assert_eq!(info["channels"], value!(["base-color", "orm", "normal", "emission"]));
    assert_eq!((info["source"].as_str(), &info["sizes"]), (Some("uv"), &value!([1024])));
    assert_eq!(info["files"][0]["bytes"], std::fs::metadata(&model).unwrap().len());
    let compared = json(&[&"compare", &bottle(), &model, &"--views", &"3", &"--size", &"320x240"]);
    assert!(compared["psnr_db"]["min"].as_f64().unwrap() > 38.0, "{compared}");
    fails(1, &["exists already"], &[&"bake", &bottle(), &"-o", &model]);
    let text = folder.path().join("text.gltf");
    succeeds(&[&"bake", &bottle(), &"-o", &text, &"--source", &"solid=marble", &"--texels", &"64k"]);
    assert_eq!(files(folder.path()), ["out.glb", "text-base-color.png", "text.bin", "text.gltf"]);
}

/// Sharper than by way of an asset with as many texels on the surface, where these are seen: in smaller pictures mip levels decide.
#[test]
fn less_is_lost_than_by_way_of_an_asset() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let psnr = |model: &std::path::Path| {
        let compared = json(&[&"compare", &bottle(), &model, &"--views", &"3", &"--size", &"960x720"]);
        compared["psnr_db"]["mean"].as_f64().unwrap()
    };
    succeeds(&[&"bake", &bottle(), &"-o", &at("direct.glb"), &"--texels", &"1M"]);
    succeeds(&[&"bake", &bottle(), &"-o", &at("asset.fan"), &"--texels", &"1M"]);
    succeeds(&[&"export", &at("asset.fan"), &"-o", &at("exported.glb"), &"--size", &"1024"]);
    let [direct, exported] = ["direct.glb", "exported.glb"].map(|name| psnr(&at(name)));
    eprintln!("direct {direct:.2} dB, by way of an asset {exported:.2} dB");
    assert!(direct > exported, "{direct} {exported}");
}

/// Baked light comes by way of an asset, of which nothing stays.
#[test]
fn light_is_baked_into_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let text = "[materials.white]\nbase_color = 0.8\n[bake]\nlight = { samples = 16, bounces = 1 }\n\
                [[light]]\nkind = \"sun\"\nto_light = [1, 2, 3]\n[environment]\ncolor = [0.2, 0.3, 0.4]\n";
    let look = write(folder.path(), "lit.toml", text);
    let at = |name: &str| folder.path().join(name);
    let info = json(&[&"bake", &model, &"-o", &at("lit.glb"), &"--look", &look, &"--texels", &"64k"]);
    assert_eq!(info["light"]["mean_samples"], 16.0);
    assert_eq!(info["bytes"], std::fs::metadata(at("lit.glb")).unwrap().len());
    assert!(
        info["seconds"]["total"].as_f64().unwrap() >= info["seconds"]["bake"].as_f64().unwrap(),
        "{info}"
    );
    assert_eq!(files(folder.path()), ["colored.ply", "lit.glb", "lit.toml"]);
    succeeds(&[&"bake", &model, &"-o", &at("lit.fan"), &"--look", &look, &"--texels", &"64k"]);
    let compared =
        json(&[&"compare", &at("lit.fan"), &at("lit.glb"), &"--views", &"2", &"--size", &"160x120"]);
    assert!(compared["psnr_db"]["min"].as_f64().unwrap() > 35.0, "{compared}");
}

/// Walls that glow are lamps, whether a number or a texture says so: in a closed room light is `e (1 + r + r^2 ...)`.
#[test]
fn surfaces_that_glow_light_others() {
    let folder = tempfile::tempdir().unwrap();
    let inward: String = CUBE_OBJ
        .lines()
        .map(|line| match line.strip_prefix("f ") {
            Some(corners) => format!("f {}\n", corners.split(' ').rev().collect::<Vec<_>>().join(" ")),
            None => format!("{line}\n"),
        })
        .collect();
    let model = write(folder.path(), "room.obj", inward);
    let light = |emission: &str, quantity: &str| {
        let text = format!(
            "[textures.t]\nkind = \"color\"\ncolor = [0.2, 0.2, 0.2]\n[materials.m]\nbase_color = 0.5\nemission = {emission}\n\
             [bake]\nlight = {{ samples = 16, bounces = 1, quantity = \"{quantity}\" }}\n"
        );
        let look = write(folder.path(), "room.toml", text);
        let out = folder.path().join("room.fan");
        let info = json(&[&"bake", &model, &"-o", &out, &"--look", &look, &"--texels", &"1k", &"--force"]);
        info["light"]["mean_light"].as_f64().unwrap()
    };
    for emission in ["0.2", "[0.2, 0.2, 0.2]", "\"t\""] {
        assert!((light(emission, "direct") - 0.2).abs() < 1e-3, "{emission}");
        assert!((light(emission, "full") - 0.3).abs() < 1e-3, "{emission}");
    }
    assert_eq!(light("0", "full"), 0.0);
}

/// A slope gets of sky and ground what pictures show of them: all of the sky from above, half of both on a wall.
#[test]
fn baked_ambient_light_is_that_of_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let lamp = "[[light]]\nkind = \"ambient\"\nsky = [1, 0.2, 0]\nground = [0, 0.2, 1]\n";
    let bake = "[bake]\nlight = { samples = 4096, bounces = 0, colored = false }\n";
    let look = write(folder.path(), "sky.toml", format!("{lamp}[materials.m]\n{bake}"));
    let plane = |name: &str, corners: [[i32; 3]; 4]| {
        let vertices: String = corners.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        write(folder.path(), name, format!("{vertices}f 1 2 3\nf 1 3 4\n"))
    };
    let floor = plane("floor.obj", [[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]]);
    let wall = plane("wall.obj", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]);
    for (model, expected) in [(floor, [1.0, 0.2, 0.0]), (wall, [0.5, 0.2, 0.5])] {
        let (fan, exr) = (folder.path().join("a.fan"), folder.path().join("a.exr"));
        succeeds(&[&"bake", &model, &"-o", &fan, &"--look", &look, &"--texels", &"256", &"--force"]);
        succeeds(&[&"export", &fan, &"-o", &exr, &"--channel", &"light", &"--size", &"16", &"--force"]);
        let image = Image::load(&exr).unwrap();
        let middle = image.linear_texel(8, 8);
        let difference = (0..3).map(|c| (middle[c] - expected[c]).abs()).fold(0.0, f32::max);
        assert!(difference < 0.01, "{middle:?}, expected {expected:?}");
    }
}

#[test]
fn what_is_an_assets_alone_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let out = folder.path().join("x.glb");
    for (option, given) in [
        ("--tile", "64"),
        ("--hard-edges", "60"),
        ("--format", "bc1"),
        ("--fit", "point"),
        ("--quality", "basic"),
    ] {
        let arguments: &[&dyn AsRef<std::ffi::OsStr>] =
            &[&"bake", &model, &"-o", &out, &"--source", &"solid=marble", &option, &given];
        fails(2, &[option, "bake an asset (.fan)"], arguments);
    }
    fails(2, &["cannot write s3://a/x.glb", "copy"], &[&"bake", &model, &"-o", &"s3://a/x.glb"]);
    fails(2, &["neither textures nor colours"], &[&"bake", &model, &"-o", &out]);
    fails(
        2,
        &["would be a plan", "such as bottle.plan"],
        &[&"plan", &model, &"-o", &out, &"--source", &"solid=marble"],
    );
    assert_eq!(files(folder.path()), ["cube.obj"]);
}
