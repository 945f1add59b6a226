//! `fantex split` and `fantex world`, and what `info` and `verify` say of worlds.

use std::collections::HashSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use fantex::texture::compare::psnr_db;
use fantex::texture::{Image, Samples};
use serde_json::Value;

use crate::{COLORED_PLY, CUBE_OBJ, fails, files, json, succeeds, write};

/// A landscape as an asset.
fn land(folder: &Path) -> PathBuf {
    let (model, asset) = (folder.join("land.ply"), folder.join("land.fan"));
    succeeds(&[&"generate", &"landscape", &"-o", &model, &"--triangles", &"30k"]);
    succeeds(&[&"bake", &model, &"-o", &asset, &"--source", &"solid=landscape", &"--texels", &"300k"]);
    asset
}

#[test]
fn an_asset_is_split_and_verified() {
    let folder = tempfile::tempdir().unwrap();
    let asset = land(folder.path());
    let before = std::fs::read(&asset).unwrap();
    let target = folder.path().join("out/land");
    let split = [&"split" as &dyn AsRef<OsStr>, &asset, &"-o", &target, &"--triangles", &"8k"];
    let info = json(&split);
    let sectors = info["sectors"].as_u64().unwrap();
    assert!((3..=6).contains(&sectors), "{info}");
    assert_eq!(std::fs::read(&asset).unwrap(), before);
    let index = target.join("land.fanworld");
    assert_eq!(info["index"], index.to_str().unwrap());
    let mut expected: Vec<String> = (1..=sectors).map(|number| format!("sector-{number:04}.fan")).collect();
    expected.insert(0, "land.fanworld".into());
    assert_eq!(files(&target), expected);

    let whole = json(&[&"info", &asset]);
    let world = json(&[&"info", &index]);
    assert_eq!(world["kind"], "world");
    assert_eq!(world["triangles"], whole["triangles"]);
    assert_eq!(world["objects"], sectors);
    assert_eq!(world["previews"], sectors);
    assert_eq!(world["bytes"], info["bytes"]);
    // Those at borders are read on both sides.
    let texels = |info: &Value| info["texels"].as_u64().unwrap();
    assert!(texels(&world) > texels(&whole) && texels(&world) < 2 * texels(&whole), "{world}");
    assert!(
        world["preview_triangles"].as_u64().unwrap() * 4 < world["triangles"].as_u64().unwrap(),
        "{world}"
    );
    let shown = String::from_utf8(succeeds(&[&"info", &index]).stdout).unwrap();
    assert!(shown.contains("sector-0001.fan"), "{shown}");

    let verified = json(&[&"verify", &index]);
    assert_eq!(verified["ok"], true, "{verified}");
    assert!(verified["seam_edges"].as_u64().unwrap() > 100, "{verified}");
    assert!(verified["largest_jump"].as_f64().unwrap() < 1e-5, "{verified}");

    // The same bytes again, on another number of threads.
    let again = folder.path().join("again");
    succeeds(&[&"split", &asset, &"-o", &again, &"--triangles", &"8k", &"--threads", &"1"]);
    for name in &expected {
        assert!(
            std::fs::read(again.join(name)).unwrap() == std::fs::read(target.join(name)).unwrap(),
            "{name}"
        );
    }

    // As a process leaves it that is killed.
    let left = folder.path().join("third/.fantex-left");
    std::fs::create_dir_all(&left).unwrap();
    write(&left, ".fantex-lock", "");
    write(&left, "sector-0001.fan", "unfinished");
    succeeds(&[&"split", &asset, &"-o", &folder.path().join("third"), &"--triangles", &"8k"]);
    assert_eq!(files(&folder.path().join("third")), expected);

    fails(1, &["is not empty", "--force"], &split);
    succeeds(&[&split[..], &[&"--force", &"--no-previews"]].concat());
    assert!(files(&target).iter().all(|name| name == "land.fanworld" || name.ends_with("-2.fan")));
    assert_eq!(json(&[&"info", &index])["previews"], 0);
    let told = succeeds(&[&"info", &index]).stdout;
    let told = String::from_utf8_lossy(&told).into_owned();
    assert!(told.contains("previews") && told.matches("triangles").count() == 1, "{told}");
    fails(1, &["--memory"], &[&"split", &asset, &"-o", &folder.path().join("no"), &"--memory", &"1M"]);
    assert!(!folder.path().join("no").exists());
    fails(1, &["it is a file"], &[&"split", &asset, &"-o", &asset]);
    fails(
        1,
        &["is not an asset"],
        &[&"split", &folder.path().join("land.ply"), &"-o", &folder.path().join("no")],
    );
    fails(
        1,
        &["cannot read", "none.fan"],
        &[&"split", &folder.path().join("none.fan"), &"-o", &folder.path().join("no")],
    );
    fails(2, &["--triangles"], &[&"split", &asset, &"-o", &folder.path().join("no"), &"--triangles", &"0"]);
    fails(
        2,
        &["--no-previews"],
        &[&"split", &asset, &"-o", &target, &"--no-previews", &"--preview-texels", &"9k"],
    );
}

#[test]
fn many_sectors_get_coarse_assets() {
    let folder = tempfile::tempdir().unwrap();
    let asset = land(folder.path());
    let place = |name: &str| folder.path().join(name);
    let (target, index) = (place("out"), place("out/land.fanworld"));
    let info = json(&[&"split", &asset, &"-o", &target, &"--triangles", &"1k"]);
    let sectors = info["sectors"].as_u64().unwrap();
    // Runs of at most 16, and one above them.
    let coarse = sectors.div_ceil(16) + 1;
    assert!(coarse > 2, "{info}");
    assert_eq!(info["coarse"], coarse);
    let mut expected: Vec<String> = (1..=coarse).map(|number| format!("coarse-{number:04}.fan")).collect();
    expected.push("land.fanworld".into());
    expected.extend((1..=sectors).map(|number| format!("sector-{number:04}.fan")));
    assert_eq!(files(&target), expected);
    let world = json(&[&"info", &index]);
    assert_eq!((&world["objects"], &world["coarse"]), (&info["sectors"], &info["coarse"]), "{world}");
    for key in ["coarse_triangles", "coarse_bytes"] {
        assert_eq!(world[key], info[key], "{key}");
    }
    assert!(
        world["coarse_triangles"].as_u64().unwrap() * 2 < world["triangles"].as_u64().unwrap(),
        "{world}"
    );
    let verified = json(&[&"verify", &index]);
    assert_eq!((&verified["ok"], &verified["coarse"]), (&true.into(), &info["coarse"]), "{verified}");
    let text = std::fs::read_to_string(&index).unwrap();
    assert!(text.contains("\"version\": 2"), "{text}");

    // The same bytes again, on another number of threads.
    let again = place("again");
    succeeds(&[&"split", &asset, &"-o", &again, &"--triangles", &"1k", &"--threads", &"1"]);
    for name in &expected {
        assert!(
            std::fs::read(again.join(name)).unwrap() == std::fs::read(target.join(name)).unwrap(),
            "{name}"
        );
    }

    // Exports have the sectors alone; pages have all files.
    let model = place("land.gltf");
    assert_eq!(json(&[&"export", &index, &"-o", &model, &"--size", &"64"])["objects"], sectors);
    if fantex_web::files().is_some() {
        let page = place("page");
        json(&[&"export", &index, &"-o", &page, &"--web"]);
        assert!(expected.iter().all(|name| page.join(name).exists()), "{:?}", files(&page));
    }

    // What is read again and has not changed is shown as before; without a sector, what shows it goes.
    let sector = target.join("sector-0001.fan");
    assert_eq!(json(&[&"world", &index, &sector])["coarse_removed"], 0);
    let removed = [&"world" as &dyn AsRef<OsStr>, &index, &"--remove", &sector];
    assert_eq!(json(&removed)["coarse_removed"], 2);
    assert_eq!(json(&[&"verify", &index])["ok"], true);
    std::fs::write(&index, text.replace("\"coarse-0001.fan\"", "\"coarse-0009.fan\"")).unwrap();
    fails_to_verify(&index, &["cannot read", "coarse-0009.fan"]);
    std::fs::write(&index, text.replacen("\"sector-0001.fan\"", "\"sector-0077.fan\"", 1)).unwrap();
    fails(1, &["coarse-0001.fan", "sector-0001.fan, which is not in the world"], &[&"info", &index]);

    // Fewer sectors need none.
    let fewer = json(&[&"split", &asset, &"-o", &target, &"--triangles", &"8k", &"--force"]);
    assert_eq!(fewer["coarse"], 0);
    assert!(files(&target).iter().all(|name| !name.starts_with("coarse-")));
    assert!(std::fs::read_to_string(&index).unwrap().contains("\"version\": 1"));
}

#[test]
fn what_is_wrong_with_a_world_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let asset = land(folder.path());
    let target = folder.path().join("land");
    let index = target.join("land.fanworld");
    succeeds(&[&"split", &asset, &"-o", &target, &"--triangles", &"8k", &"--no-previews"]);
    let sound = std::fs::read_to_string(&index).unwrap();
    let sector = target.join("sector-0002.fan");
    let of_sector = std::fs::read(&sector).unwrap();

    // A sector that is painted on shows a seam.
    let object = &serde_json::from_str::<Value>(&sound).unwrap()["objects"][1];
    let strokes =
        STROKES.replace("LOW", &object["low"].to_string()).replace("HIGH", &object["high"].to_string());
    let strokes = write(folder.path(), "strokes.json", strokes);
    succeeds(&[&"paint", &sector, &"--replay", &strokes]);
    succeeds(&[&"world", &index, &sector]);
    fails_to_verify(&index, &["jumps by", "sector-0002.fan"]);

    // An asset changed behind the index' back, a damaged one, none at all.
    std::fs::write(&sector, &of_sector).unwrap();
    fails_to_verify(&index, &["the index says bytes", "sector-0002.fan"]);
    std::fs::write(&index, &sound).unwrap();
    assert_eq!(json(&[&"verify", &index])["ok"], true);
    let mut damaged = of_sector.clone();
    let middle = damaged.len() / 2;
    damaged[middle..middle + 64].fill(0x55);
    std::fs::write(&sector, &damaged).unwrap();
    fails_to_verify(&index, &["sector-0002.fan", "damaged"]);
    std::fs::remove_file(&sector).unwrap();
    fails_to_verify(&index, &["cannot read", "sector-0002.fan"]);
    // Without it the rest is a world.
    succeeds(&[&"world", &index, &"--remove", &"sector-0002.fan"]);
    assert_eq!(json(&[&"verify", &index])["ok"], true);

    for (code, text, word) in [
        (1, "{", "is no world"),
        (1, "", "is no world"),
        (1, &*sound.replace("\"version\": 1", "\"version\": 3"), "version 3"),
        (1, &*sound.replace("\"bytes\"", "\"colour\": 1, \"bytes\""), "colour"),
        (1, &*sound.replace("sector-0001", "../sector-0001"), "--allow-outside"),
    ] {
        std::fs::write(&index, text).unwrap();
        for command in ["info", "verify"] {
            fails(code, &[word], &[&command, &index]);
        }
    }
    // Commands that take one asset say so.
    std::fs::write(&index, &sound).unwrap();
    let out = folder.path().join("a");
    fails(1, &["is a world", "one of its assets"], &[&"preview", &index]);
    fails(1, &["is a world", "one of its assets"], &[&"split", &index, &"-o", &out]);
    fails(1, &["is a world"], &[&"info", &index, &"--texels", &"1M"]);
    fails(1, &["is a world"], &[&"bake", &index, &"-o", &folder.path().join("a.fan")]);
    fails(
        1,
        &["is a world"],
        &[&"simplify", &index, &"-o", &folder.path().join("a.ply"), &"--triangles", &"9"],
    );
}

/// A broad stroke from one corner of a sector's box to the other one.
const STROKES: &str = r#"{ "version": 1, "strokes": [{
    "brush": { "size": { "texels": 400 } },
    "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.9] } }],
    "samples": [{ "at": { "position": LOW } }, { "at": { "position": HIGH } }] }] }"#;

/// The largest difference of two pictures, and their likeness.
fn difference(a: &Path, b: &Path) -> (u8, f64) {
    let [a, b] = [a, b].map(|path| Image::load(path).unwrap());
    let (Samples::U8(x), Samples::U8(y)) = (&a.samples, &b.samples) else { panic!("pictures are bytes") };
    let largest = x.iter().zip(y).map(|(x, y)| x.abs_diff(*y)).max().unwrap();
    (largest, psnr_db(&a, &b).unwrap())
}

#[test]
fn a_world_is_rendered_like_the_asset_that_was_split() {
    let folder = tempfile::tempdir().unwrap();
    let asset = land(folder.path());
    let place = |name: &str| folder.path().join(name);
    let (target, index) = (place("out"), place("out/land.fanworld"));
    succeeds(&[&"split", &asset, &"-o", &target, &"--triangles", &"8k"]);
    let rendered = |subject: &Path, name: &str, more: &[&str]| {
        let picture = place(name);
        let mut arguments: Vec<&dyn AsRef<OsStr>> = vec![&"render", &subject, &"-o", &picture];
        arguments.extend([&"--size" as &dyn AsRef<OsStr>, &"240x160", &"--samples", &"4"]);
        arguments.extend([&"--eye" as &dyn AsRef<OsStr>, &"0,60,260", &"--target", &"0,20,0"]);
        arguments.extend(more.iter().map(|text| text as &dyn AsRef<OsStr>));
        (json(&arguments), picture)
    };
    let (info, whole) = rendered(&asset, "whole.png", &[]);
    let (world_info, world) = rendered(&index, "world.png", &[]);
    assert_eq!(world_info["triangles"], info["triangles"]);
    assert_eq!(world_info["lookups"], info["lookups"]);
    let (largest, _) = difference(&whole, &world);
    assert!(largest <= 1, "{largest}");

    // What does not fit is shown by its preview, and said.
    let (info, coarse) = rendered(&index, "coarse.png", &["--memory", "8M"]);
    assert!(info["triangles"].as_u64() < world_info["triangles"].as_u64(), "{info}");
    let (_, psnr) = difference(&whole, &coarse);
    assert!(psnr > 25.0 && psnr < 60.0, "{psnr} dB");
    let near = [&"--eye" as &dyn AsRef<OsStr>, &"0,60,260", &"--target", &"0,20,0", &"--size", &"240x160"];
    let render = [&"render" as &dyn AsRef<OsStr>, &index, &"-o", &place("a.png"), &"--memory", &"8M"];
    let said = crate::stderr(&crate::run(&[&render[..], &near].concat()));
    assert!(said.contains("coarser than the picture could show"), "{said}");

    std::fs::remove_file(place("out/sector-0001.fan")).unwrap();
    fails(1, &["sector-0001.fan"], &[&"render", &index, &"-o", &place("none.png")]);
    fails(1, &["world"], &[&"render", &index, &"--look", &index, &"-o", &place("none.png")]);
    assert!(!place("none.png").exists());
}

/// The positions of a `.gltf` with a buffer beside it, as bits, relative to their nodes.
fn positions(model: &Path, gltf: &Value) -> HashSet<[u32; 3]> {
    let buffer = std::fs::read(model.with_extension("bin")).unwrap();
    let number = |value: &Value| value.as_u64().unwrap_or(0) as usize;
    let primitives =
        gltf["meshes"].as_array().unwrap().iter().flat_map(|mesh| mesh["primitives"].as_array().unwrap());
    let mut found = HashSet::new();
    for primitive in primitives {
        let accessor = &gltf["accessors"][number(&primitive["attributes"]["POSITION"])];
        let view = &gltf["bufferViews"][number(&accessor["bufferView"])];
        let start = number(&view["byteOffset"]) + number(&accessor["byteOffset"]);
        let bytes = &buffer[start..start + 12 * number(&accessor["count"])];
        let word =
            |at: usize, k: usize| u32::from_le_bytes(bytes[at + 4 * k..at + 4 * k + 4].try_into().unwrap());
        found.extend((0..bytes.len()).step_by(12).map(|at| [0, 1, 2].map(|k| word(at, k))));
    }
    found
}

#[test]
fn a_world_is_exported_as_one_model_without_cracks() {
    let folder = tempfile::tempdir().unwrap();
    let asset = land(folder.path());
    let place = |name: &str| folder.path().join(name);
    let (target, index) = (place("out"), place("out/land.fanworld"));
    succeeds(&[&"split", &asset, &"-o", &target, &"--triangles", &"8k"]);
    let whole = json(&[&"info", &asset]);
    let sectors = json(&[&"info", &index])["objects"].as_u64().unwrap();

    let model = place("land.gltf");
    let info = json(&[&"export", &index, &"-o", &model]);
    assert_eq!(info["triangles"], whole["triangles"]);
    assert_eq!(info["objects"], sectors);
    assert!(place("land-sector-0001-base-color.png").exists());
    let gltf: Value = serde_json::from_slice(&std::fs::read(&model).unwrap()).unwrap();
    let node = |index: &Value| &gltf["nodes"][index.as_u64().unwrap() as usize];
    assert_eq!(gltf["scenes"][0]["nodes"].as_array().unwrap().len(), 1);
    let root = node(&gltf["scenes"][0]["nodes"][0]);
    assert_eq!(root["name"], "land");
    let objects: Vec<&Value> = root["children"].as_array().unwrap().iter().map(node).collect();
    assert_eq!(objects.len() as u64, sectors);
    assert_eq!(objects[1]["name"], "sector-0002");
    // One origin, and what was one vertex is so again, to the last bit.
    assert!(objects.iter().all(|object| object["translation"] == objects[0]["translation"]));
    assert_eq!(positions(&model, &gltf).len() as u64, whole["vertices"].as_u64().unwrap());
    let compared = json(&[&"compare", &asset, &model, &"--views", &"2", &"--size", &"320x240"]);
    assert!(compared["psnr_db"]["min"].as_f64().unwrap() > 35.0, "{compared}");

    // A reader that joins equal places finds the surface of the asset, with no other borders.
    let glb = place("land.glb");
    let info = json(&[&"export", &index, &"-o", &glb, &"--size", &"128"]);
    assert_eq!(info["files"].as_array().unwrap().len(), 1);
    assert!(info["sizes"].as_array().unwrap().iter().all(|side| *side == 128), "{info}");
    json(&[&"export", &asset, &"-o", &place("whole.glb"), &"--size", &"128"]);
    let [joined, whole_model] = [&glb, &place("whole.glb")].map(|model| json(&[&"info", model]));
    for key in ["triangles", "vertices", "boundary_edges", "components"] {
        assert_eq!(joined[key], whole_model[key], "{key}");
    }

    let usd = json(&[&"export", &index, &"-o", &place("fans.usda"), &"--fans"]);
    let pictures = usd["sizes"].as_array().unwrap().len() * usd["channels"].as_array().unwrap().len();
    assert_eq!(usd["files"].as_array().unwrap().len(), pictures + 2 * sectors as usize + 1, "{usd}");
    let text = std::fs::read_to_string(place("fans.usda")).unwrap();
    assert_eq!(text.matches("prepend references = @@@./fans-sector-").count() as u64, sectors, "{text}");
    let fans = json(&[&"export", &index, &"-o", &place("fans.glb"), &"--fans"]);
    assert_eq!((&fans["triangles"], &fans["objects"]), (&whole["triangles"], &sectors.into()));

    let out = place("a.png");
    fails(2, &["--channel", "is a world"], &[&"export", &index, &"-o", &out, &"--channel", &"base-color"]);
    fails(1, &["is a world"], &[&"export", &index, &"-o", &out, &"--turntable", &"3"]);
    let shader = [&"--fans" as &dyn AsRef<OsStr>, &"--shader", &"glsl"];
    let export = [&"export" as &dyn AsRef<OsStr>, &index, &"-o", &place("b.glb")];
    fails(2, &["--shader", "is a world"], &[&export[..], &shader].concat());
    std::fs::remove_file(place("out/sector-0002.fan")).unwrap();
    let before = files(folder.path());
    fails(1, &["sector-0002.fan"], &export);
    assert_eq!(files(folder.path()), before);
}

fn fails_to_verify(index: &Path, words: &[&str]) {
    let output = crate::run(&[&"--json", &"verify", &index]);
    assert_eq!(output.status.code(), Some(1));
    let said = crate::stderr(&output);
    words.iter().for_each(|word| assert!(said.contains(word), "'{word}' is missing in: {said}"));
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["ok"], false);
    assert!(!info["faults"].as_array().unwrap().is_empty());
}

#[test]
fn existing_assets_become_a_world() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    std::fs::create_dir(place("houses")).unwrap();
    let (cube, tent) =
        (write(folder.path(), "cube.obj", CUBE_OBJ), write(folder.path(), "tent.ply", COLORED_PLY));
    let (cube_asset, tent_asset) = (place("houses/cube.fan"), place("tent.fan"));
    succeeds(&[&"bake", &cube, &"-o", &cube_asset, &"--source", &"solid=marble", &"--texels", &"20k"]);
    succeeds(&[&"bake", &tent, &"-o", &tent_asset, &"--texels", &"20k"]);
    let index = place("town.fanworld");
    let info = json(&[&"world", &index, &cube_asset, &tent_asset]);
    assert_eq!(
        (&info["added"], &info["updated"], &info["previews"]),
        (&2.into(), &0.into(), &0.into()),
        "{info}"
    );
    assert_eq!(info["assets"], serde_json::json!(["houses/cube.fan", "tent.fan"]));
    let world = json(&[&"info", &index]);
    assert_eq!(world["low"], serde_json::json!([-1.0, -1.0, -1.0]));
    assert_eq!(world["high"], serde_json::json!([1.0, 1.0, 1.0]));
    assert_eq!(json(&[&"verify", &index])["ok"], true);

    let info = json(&[&"world", &index, &"--make-previews"]);
    assert_eq!(
        (&info["updated"], &info["previews_made"], &info["previews"]),
        (&2.into(), &2.into(), &2.into()),
        "{info}"
    );
    assert_eq!(json(&[&"verify", &index])["ok"], true);
    let info = json(&[&"world", &index, &"--make-coarse"]);
    assert_eq!((&info["coarse_made"], &info["coarse"]), (&1.into(), &1.into()), "{info}");
    assert!(place("town-coarse-0001.fan").exists());
    assert_eq!(json(&[&"verify", &index])["ok"], true);
    let model = place("town.gltf");
    assert_eq!(json(&[&"export", &index, &"-o", &model, &"--size", &"64"])["objects"], 2);
    let gltf: Value = serde_json::from_slice(&std::fs::read(&model).unwrap()).unwrap();
    let nodes = gltf["nodes"].as_array().unwrap().iter().map(|node| node["name"].as_str().unwrap());
    assert_eq!(nodes.collect::<Vec<_>>(), ["houses-cube", "tent", "town"]);
    let info = json(&[&"world", &index, &tent_asset, &"--remove", &cube_asset]);
    assert_eq!(
        (&info["updated"], &info["removed"], &info["objects"]),
        (&1.into(), &1.into(), &1.into()),
        "{info}"
    );
    assert!(cube_asset.exists());
    assert_eq!(info["coarse_removed"], 1);

    // There is nothing to show in an empty one.
    let empty = place("empty.fanworld");
    fails(1, &["empty.fanworld is not there", "name the assets"], &[&"world", &empty, &"--make-previews"]);
    assert!(!empty.exists());
    json(&[&"world", &empty, &tent_asset]);
    json(&[&"world", &empty, &"--remove", &tent_asset]);
    fails(1, &["nothing to show", "empty.fanworld"], &[&"render", &empty, &"-o", &place("empty.png")]);
    fails(1, &["nothing to show", "empty.fanworld"], &[&"export", &empty, &"-o", &place("empty.glb")]);

    fails(1, &["has no asset", "cube.fan"], &[&"world", &index, &"--remove", &cube_asset]);
    fails(1, &["cannot read", "none.fan"], &[&"world", &index, &place("none.fan")]);
    fails(1, &["is not an asset"], &[&"world", &index, &cube]);
    let elsewhere = place("houses/town.fanworld");
    fails(1, &["does not lie below"], &[&"world", &elsewhere, &tent_asset]);
    assert!(!elsewhere.exists());
    fails(1, &["can only be read"], &[&"world", &"https://example.org/a.fanworld", &tent_asset]);
    fails(2, &["end it with .fanworld"], &[&"world", &place("town.fan"), &tent_asset]);
    fails(2, &["ASSET"], &[&"world", &index]);
    assert_eq!(json(&[&"info", &index])["objects"], 1);
}
