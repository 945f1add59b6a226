//! `fantex export` and `fantex paint`.

use std::path::Path;

use crate::{COLORED_PLY, bottle, fails, fantex, files, json, stderr, succeeds, workspace, write};

/// The bottle, baked small.
fn baked(folder: &Path) -> std::path::PathBuf {
    let asset = folder.join("bottle.fan");
    succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--texels", &"200k"]);
    asset
}

#[test]
fn a_bottle_becomes_a_model_that_looks_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let asset = baked(folder.path());
    let model = folder.path().join("out.glb");
    let info = json(&[&"export", &asset, &"-o", &model]);
    assert_eq!(info["channels"], serde_json::json!(["base-color", "orm", "normal", "emission"]));
    assert!(info["charts"].as_u64().unwrap() > 1 && info["density_share"].as_f64().unwrap() >= 0.95);
    let compared = json(&[&"compare", &asset, &model, &"--views", &"3", &"--size", &"320x240"]);
    assert!(compared["psnr_db"]["min"].as_f64().unwrap() > 38.0, "{compared}");
    fails(1, &["exists already"], &[&"export", &asset, &"-o", &model]);
    let reduced = fails_not(&[&"export", &asset, &"-o", &model, &"--force", &"--size", &"128"]);
    assert!(reduced.contains("% of the asset's density"), "{reduced}");
}

#[test]
fn fans_are_written_for_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let asset = baked(folder.path());
    let out = |name: &str| folder.path().join(name);
    let info = json(&[&"export", &asset, &"-o", &out("fans.glb"), &"--fans"]);
    assert_eq!((info["fans"].as_bool(), info["padding"].as_u64()), (Some(true), Some(4)));
    assert_eq!(info["channels"], serde_json::json!(["base-color", "orm", "normal", "emission"]));
    assert!(info["used_share"].as_f64().unwrap() > 0.6, "{info}");
    // The sheet lies in the model as PNG, whose header has its sides behind the first sixteen bytes.
    let model = std::fs::read(out("fans.glb")).unwrap();
    let png = model
        .windows(16)
        .position(|bytes| bytes.starts_with(b"\x89PNG") && bytes.ends_with(b"IHDR"))
        .unwrap();
    let side = |at: usize| u32::from_be_bytes(model[png + at..png + at + 4].try_into().unwrap());
    let [columns, rows] = [side(16), side(20)];
    assert_ne!(columns, rows, "a square sheet proves nothing");
    assert_eq!(info["extents"], serde_json::json!([[columns, rows]]));
    assert_eq!(info["sizes"], serde_json::json!([columns.max(rows)]));
    let told = succeeds(&[&"export", &asset, &"-o", &out("told.glb"), &"--fans"]);
    let told = String::from_utf8(told.stdout).unwrap();
    assert!(told.contains(&format!("{columns} x {rows} texels")), "{told}");
    // Each triangle by the tile of its first corner: few are wrong.
    let compared = json(&[&"compare", &asset, &out("fans.glb"), &"--views", &"1", &"--size", &"160x120"]);
    assert!(compared["psnr_db"]["min"].as_f64().unwrap() > 15.0, "{compared}");
    let info = json(&[
        &"export",
        &asset,
        &"-o",
        &out("fans.usda"),
        &"--fans",
        &"--padding",
        &"16",
        &"--max-size",
        &"512",
    ]);
    let sheets = info["sizes"].as_array().unwrap().len();
    assert!(sheets > 1 && info["files"].as_array().unwrap().len() == 4 * sheets + 2, "{info}");
    let command = |name: &str, more: &'static str| {
        [asset.clone(), "-o".into(), out(name), "--fans".into(), more.into()]
    };
    let refused = |code: i32, words: &str, arguments: &[std::path::PathBuf]| {
        let arguments: Vec<&dyn AsRef<std::ffi::OsStr>> = std::iter::once(&"export" as &dyn AsRef<_>)
            .chain(arguments.iter().map(|a| a as &dyn AsRef<_>))
            .collect();
        fails(code, &[words], &arguments);
    };
    refused(2, "fans are written as .glb, .gltf or .usda", &command("fans.obj", "--padding=2"));
    refused(2, "a gutter cannot be 3 texels", &command("b.glb", "--padding=3"));
    refused(1, "do not fit into a sheet of 64 columns", &command("b.glb", "--max-size=64"));
    refused(2, "cannot be used with", &command("b.glb", "--uv=source"));
}

/// Small pictures have no room for it.
#[test]
fn less_padding_than_was_asked_for_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let (model, asset) = (crate::write(folder.path(), "cube.obj", crate::CUBE_OBJ), out("cube.fan"));
    succeeds(&[&"bake", &model, &"-o", &asset, &"--source=solid=wood", &"--texels=4k"]);
    let padded = |padding: &str, name: &str| {
        fails_not(&[&"export", &asset, &"-o", &out(name), &"--size", &"64", &"--padding", &padding])
    };
    let note =
        "less.glb: a padding of 16 texels instead of the 64 asked for: it is at most a quarter of the side";
    let told = padded("64", "less.glb");
    assert!(told.contains(note), "{told}");
    assert!(!padded("16", "as_asked.glb").contains("asked for"));
}

/// Runs the program, which must succeed, and returns its notes.
fn fails_not(arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> String {
    crate::stderr(&succeeds(arguments))
}

#[test]
fn single_channels_and_turntables_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let asset = baked(folder.path());
    let out = |name: &str| folder.path().join(name);
    let size: [&dyn AsRef<std::ffi::OsStr>; 2] = [&"--size", &"256"];
    for (name, channel, depth) in
        [("a.png", "normal", "16"), ("b.ktx2", "base-color", "8"), ("c.exr", "roughness", "8")]
    {
        let path = out(name);
        let info = json(&[
            &"export",
            &asset,
            &"-o",
            &path,
            &"--channel",
            &channel,
            &"--depth",
            &depth,
            size[0],
            size[1],
        ]);
        assert_eq!(info["sizes"], serde_json::json!([256]));
        assert!(path.exists());
    }
    let turn: [&dyn AsRef<std::ffi::OsStr>; 5] = [&"export", &asset, &"--turntable", &"2", &"-o"];
    fails(2, &["a turntable", "turn.glb", ".png"], &[&turn[..], &[&out("turn.glb")]].concat());
    assert!(!out("turn.glb").exists());
    // Several at once are the same bytes as one by one; all are there, or none.
    let several: [&dyn AsRef<std::ffi::OsStr>; 5] =
        [&"export", &asset, &"--channel", &"normal,roughness", &"-o"];
    let info = json(&[&several[..], &[&out("all.png"), &"--depth", &"16", size[0], size[1]]].concat());
    assert_eq!(info["channels"], serde_json::json!(["normal", "roughness"]));
    assert_eq!(std::fs::read(out("all-normal.png")).unwrap(), std::fs::read(out("a.png")).unwrap());
    assert!(out("all-roughness.png").exists() && !out("all.png").exists());
    // What is not written may be there.
    std::fs::write(out("some.png"), "mine").unwrap();
    let told = succeeds(&[&several[..], &[&out("some.png"), size[0], size[1]]].concat());
    assert_eq!(std::fs::read(out("some.png")).unwrap(), b"mine");
    fails(1, &["some-normal.png exists already"], &[&several[..], &[&out("some.png")]].concat());
    let told = String::from_utf8(told.stdout).unwrap();
    assert!(told.contains("some-normal.png") && !told.contains("some.png"), "{told}");
    let command: [&dyn AsRef<std::ffi::OsStr>; 5] = [&"export", &asset, &"-o", &out("no.png"), &"--channel"];
    for (code, words, channels) in
        [(1, "no channel for light", "normal,light"), (2, "normal is named twice", "normal,normal")]
    {
        fails(code, &[words], &[&command[..], &[&channels]].concat());
    }
    assert!(!out("no-normal.png").exists());
    let turn = json(&[&"export", &asset, &"-o", &out("turn.png"), &"--turntable", &"3", &"--size", &"64x48"]);
    assert_eq!(turn["frames"], 3);
    let animated = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(out("turn.png")).unwrap()));
    assert_eq!(animated.read_info().unwrap().info().animation_control.unwrap().num_frames, 3);
    json(&[&"export", &asset, &"-o", &out("turn"), &"--turntable", &"2", &"--size", &"64"]);
    assert_eq!(files(&out("turn")), ["turn-0001.png", "turn-0002.png"]);
}

#[test]
fn what_makes_no_sense_is_said_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("colored.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"4k"]);
    let out = |name: &str| folder.path().join(name);
    fails(2, &["say which with --channel"], &[&"export", &asset, &"-o", &out("x.png")]);
    fails(
        2,
        &["x.fbx is no name for a model; use .glb or .gltf"],
        &[&"export", &asset, &"-o", &out("x.fbx")],
    );
    fails(
        2,
        &["x.glb is no name for a channel; use .png"],
        &[&"export", &asset, &"-o", &out("x.glb"), &"--channel", &"base-color"],
    );
    fails(2, &["square"], &[&"export", &asset, &"-o", &out("x.glb"), &"--size", &"640x480"]);
    fails(2, &["power of two"], &[&"export", &asset, &"-o", &out("x.glb"), &"--size", &"1000"]);
    fails(2, &["--turntable"], &[&"export", &asset, &"-o", &out("x.glb"), &"--environment", &"sky"]);
    fails(
        1,
        &["no channel for normal", "base-color"],
        &[&"export", &asset, &"-o", &out("x.png"), &"--channel", &"normal"],
    );
    fails(1, &["no texture coordinates"], &[&"export", &asset, &"-o", &out("x.glb"), &"--uv", &"source"]);
    fails(1, &["no texture coordinates"], &[&"export", &asset, &"-o", &out("x.glb"), &"--model", &model]);
    fails(1, &["is not an asset"], &[&"export", &model, &"-o", &out("x.glb")]);
    assert_eq!(files(folder.path()), ["colored.fan", "colored.ply"]);
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_one_sentence_and_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let asset = baked(folder.path());
    std::fs::create_dir(folder.path().join("out")).unwrap();
    for name in ["x.glb", "x.gltf", "x.ktx2"] {
        let program = fantex().get_program().to_owned();
        let path = folder.path().join("out").join(name);
        let channel: &[&str] = if name == "x.ktx2" { &["--channel", "base-color"] } else { &[] };
        // Files may not grow beyond a few blocks.
        let output = std::process::Command::new("sh")
            .args(["-c", "ulimit -f 8; exec \"$0\" \"$@\""])
            .arg(program)
            .args(["export".as_ref(), asset.as_os_str(), "-o".as_ref(), path.as_os_str()])
            .args(channel)
            .output()
            .unwrap();
        let said = crate::stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(said.starts_with("fantex: cannot write "), "{said}");
        assert!(files(&folder.path().join("out")).is_empty());
    }
}

const STROKES: &str = r#"{ "version": 1, "strokes": [{
    "brush": { "size": { "texels": 30 } },
    "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
    "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 0] } }] }] }"#;

const TETRAHEDRON: &str = "v 1 1 1\nv 1 -1 -1\nv -1 1 -1\nv -1 -1 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";

#[test]
fn strokes_are_replayed_and_the_result_is_certified() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    std::fs::write(at("strokes.json"), STROKES).unwrap();
    std::fs::write(at("wrong.json"), STROKES.replace("base_color", "normal")).unwrap();
    let (model, asset, painted) = (at("model.obj"), at("a.fan"), at("painted.fan"));
    json(&[&"bake", &model, &"-o", &asset, &"--source", &"solid=wood", &"--texels", &"20k"]);
    let before = std::fs::read(&asset).unwrap();
    let done = json(&[&"paint", &asset, &"--replay", &at("strokes.json"), &"-o", &painted]);
    assert_eq!((&done["strokes"], &done["generation"]), (&1.into(), &2.into()));
    assert!(done["dabs"].as_u64().unwrap() > 5);
    assert!(std::fs::read(&asset).unwrap() == before && std::fs::read(&painted).unwrap() != before);
    assert_eq!(json(&[&"verify", &painted])["ok"], true);
    // In place, and before that without room.
    let full = std::process::Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_fantex"), "paint"])
        .args([asset.as_os_str(), "--replay".as_ref(), at("strokes.json").as_os_str()])
        .output()
        .unwrap();
    let said = stderr(&full);
    assert!(
        said.contains("nothing was painted, the asset is as it was; make room, then apply the strokes again")
            && !said.contains("commit"),
        "{said}"
    );
    assert_eq!(json(&[&"info", &asset])["texels"], json(&[&"info", &painted])["texels"]);
    json(&[&"paint", &asset, &"--replay", &at("strokes.json")]);
    assert!(std::fs::read(&asset).unwrap() == std::fs::read(&painted).unwrap());

    fails(1, &["exists already"], &[&"paint", &asset, &"--replay", &at("strokes.json"), &"-o", &painted]);
    fails(
        1,
        &["channel normal", "--add-channel normal"],
        &[&"paint", &asset, &"--replay", &at("wrong.json")],
    );
    let small = r#"{ "version": 1, "strokes": [{ "brush": { "size": { "world": -1 } }, "samples": [{ "at": { "position": [0, 0, 0] } }],
        "channels": [{ "kind": "base_color", "color": { "srgb": [1, 0, 0] } }] }] }"#;
    std::fs::write(at("small.json"), small).unwrap();
    fails(1, &["small.json: stroke 0", "above 0"], &[&"paint", &asset, &"--replay", &at("small.json")]);
    fails(
        1,
        &["not a stroke file: line 1, column 1: this is no JSON"],
        &[&"paint", &asset, &"--replay", &model],
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 6, "nothing is left behind");
}

/// Space that painting leaves behind is not copied, and comes back where what undoes strokes is forgotten.
#[test]
fn free_space_is_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    std::fs::write(at("strokes.json"), STROKES).unwrap();
    std::fs::write(at("broad.json"), STROKES.replace("30", "600")).unwrap();
    let [asset, other, copy] = ["a.fan", "other.fan", "copy.fan"].map(at);
    json(&[&"bake", &at("model.obj"), &"-o", &asset, &"--source", &"solid=wood", &"--texels", &"60k"]);
    let bytes = |done: &serde_json::Value| done["bytes"].as_u64().unwrap();
    let painted = bytes(&json(&[&"paint", &asset, &"--replay", &at("broad.json")]));
    std::fs::copy(&asset, &other).unwrap();
    let in_place = bytes(&json(&[&"paint", &other, &"--replay", &at("strokes.json")]));
    let copied = bytes(&json(&[&"paint", &asset, &"--replay", &at("strokes.json"), &"-o", &copy]));
    assert!(copied < in_place, "{copied} {in_place}");
    assert_eq!(std::fs::metadata(&asset).unwrap().len(), painted, "the asset itself stays");
    let forgotten = json(&[&"paint", &asset, &"--replay", &at("strokes.json"), &"--no-history"]);
    assert!(2 * bytes(&forgotten) < in_place, "{forgotten} {in_place}");
    for path in [&asset, &copy] {
        assert_eq!(json(&[&"verify", path])["ok"], true);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 6, "nothing is left behind");
}

/// Channels that are added, and tools that read the surface, make what was before them durable: not in the asset before all is done.
#[test]
fn strokes_that_fail_in_the_middle_leave_the_asset_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let asset = baked(folder.path());
    let before = std::fs::read(&asset).unwrap();
    let stroke = |tool: &str, channel: &str| {
        format!(
            r#"{{"tool": {tool}, "brush": {{"size": {{"texels": 20}}}},
                "channels": [{{"kind": "{channel}", "color": {{"srgb": [1, 0, 0]}}}}],
                "samples": [{{"at": {{"position": [0, 0, 1]}}}}]}}"#
        )
    };
    let good = [
        stroke(r#"{"paint": "normal"}"#, "base_color"),
        stroke(r#"{"blur": {"radius": {"texels": 4}}}"#, "base_color"),
    ];
    let strokes = |added: &str, last: &str| {
        let text = format!(
            r#"{{"version": 1, "add_channels": [{added}], "strokes": [{}, {}, {last}]}}"#,
            good[0], good[1]
        );
        write(folder.path(), "strokes.json", text.as_bytes())
    };
    for added in ["", r#""displacement""#] {
        let file = strokes(added, &stroke(r#"{"paint": "normal"}"#, "light"));
        fails(1, &["light"], &[&"paint", &asset, &"--replay", &file]);
        assert!(std::fs::read(&asset).unwrap() == before, "{added}");
    }
    assert_eq!(files(folder.path()).len(), 2, "{:?}", files(folder.path()));
    // In place and into another file it is the same.
    let copy = folder.path().join("copy.fan");
    let file = strokes(r#""displacement""#, &good[0]);
    succeeds(&[&"paint", &asset, &"--replay", &file, &"-o", &copy]);
    succeeds(&[&"paint", &asset, &"--replay", &file]);
    assert!(std::fs::read(&asset).unwrap() == std::fs::read(&copy).unwrap());
    assert_ne!(std::fs::read(&asset).unwrap(), before);
}

#[test]
fn a_stroke_beside_the_model_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    let strokes = r#"{ "version": 1, "strokes": [{ "label": "red", "channels": [{ "kind": "base_color" }],
        "samples": [{ "at": { "ray": { "origin": [0, 9, 9], "direction": [0, 0, -1] } } }] }] }"#;
    std::fs::write(at("strokes.json"), strokes).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    let output = succeeds(&[&"paint", &at("a.fan"), &"--replay", &at("strokes.json")]);
    let note = "stroke 'red' (number 0) touches nothing; numbers begin with 0";
    assert!(stderr(&output).contains(note), "{}", stderr(&output));
}

#[test]
fn characters_that_a_font_lacks_are_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    let strokes = r#"{ "version": 1, "strokes": [{ "text": { "text": "a\u6f22\u5b57\u6f22", "size": { "world": 0.2 } },
        "channels": [{ "kind": "base_color", "color": { "srgb": [0, 0, 0] } }],
        "samples": [{ "at": { "position": [0.5, 0.5, 0.5] } }] }] }"#;
    std::fs::write(at("strokes.json"), strokes).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    let output = succeeds(&[&"--json", &"paint", &at("a.fan"), &"--replay", &at("strokes.json")]);
    let note = "the font lacks '\u{6f22}', '\u{5b57}':";
    assert!(stderr(&output).contains(note), "{}", stderr(&output));
    let done: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(done["missing_characters"], "\u{6f22}\u{5b57}");
}

#[test]
fn the_example_of_the_documentation_is_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let page = std::fs::read_to_string(workspace().join("docs/painting.md")).unwrap();
    let example = page.split("```json\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    std::fs::write(at("strokes.json"), example).unwrap();
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    let done = json(&[&"paint", &at("a.fan"), &"--replay", &at("strokes.json")]);
    assert_eq!(done["strokes"], 2);
}

#[test]
fn the_log_of_an_asset_is_replayed_on_a_denser_one() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    std::fs::write(at("strokes.json"), STROKES).unwrap();
    let (model, painted, denser) = (at("model.obj"), at("painted.fan"), at("denser.fan"));
    json(&[&"bake", &model, &"-o", &painted, &"--source", &"solid=wood", &"--texels", &"20k"]);
    json(&[&"bake", &model, &"-o", &denser, &"--source", &"solid=wood", &"--texels", &"60k"]);
    json(&[&"paint", &painted, &"--replay", &at("strokes.json")]);
    let done = json(&[&"paint", &denser, &"--replay-log", &painted]);
    assert_eq!((&done["strokes"], &done["unrecorded"]), (&1.into(), &0.into()));
    assert_eq!(json(&[&"verify", &denser])["ok"], true);
    let exported = json(&[&"paint", &denser, &"--export-log", &at("log.json")]);
    assert_eq!(exported["strokes"], 1);
    // What was exported can be replayed.
    json(&[&"paint", &painted, &"--replay", &at("log.json"), &"-o", &at("twice.fan")]);
    fails(1, &["exists already"], &[&"paint", &denser, &"--export-log", &at("log.json")]);
}

#[test]
fn channels_are_added_and_the_log_brings_them_along() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    let glow = STROKES.replace("base_color", "emission");
    std::fs::write(at("strokes.json"), &glow).unwrap();
    let adding = glow.replace("\"version\": 1,", "\"version\": 1, \"add_channels\": [\"emission\"],");
    std::fs::write(at("adding.json"), adding).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    let before = std::fs::read(at("a.fan")).unwrap();
    fails(
        1,
        &["channel emission", "--add-channel emission"],
        &[&"paint", &at("a.fan"), &"--replay", &at("strokes.json")],
    );
    fails(2, &["invalid value 'light'"], &[&"paint", &at("a.fan"), &"--add-channel", &"light"]);
    json(&[&"paint", &at("a.fan"), &"--add-channel", &"emission,normal", &"-o", &at("richer.fan")]);
    assert!(std::fs::read(at("a.fan")).unwrap() == before);
    let done = json(&[&"paint", &at("richer.fan"), &"--replay", &at("strokes.json")]);
    assert_eq!(done["strokes"], 1);
    assert_eq!(json(&[&"verify", &at("richer.fan")])["ok"], true);
    json(&[&"paint", &at("a.fan"), &"--replay", &at("adding.json"), &"-o", &at("painted.fan")]);
    json(&[&"paint", &at("a.fan"), &"--replay-log", &at("richer.fan"), &"-o", &at("again.fan")]);
    for (name, count) in [("painted.fan", 2), ("again.fan", 3)] {
        let asset = fantex::store::Asset::open(&at(name)).unwrap();
        assert_eq!(asset.channels().len(), count, "{name}");
        assert_eq!(json(&[&"verify", &at(name)])["ok"], true);
    }
}

#[test]
fn channels_are_removed_and_opacity_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    std::fs::write(at("glow.json"), STROKES.replace("base_color", "emission")).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    json(&[&"paint", &at("a.fan"), &"--add-channel", &"emission,normal", &"--replay", &at("glow.json")]);
    let before = std::fs::read(at("a.fan")).unwrap();
    let channels = |name: &str| fantex::store::Asset::open(&at(name)).unwrap().channels().to_vec();
    let all = channels("a.fan");
    json(&[&"paint", &at("a.fan"), &"--remove-channel", &"emission", &"-o", &at("less.fan")]);
    assert!(std::fs::read(at("a.fan")).unwrap() == before);
    assert_eq!(channels("less.fan"), [all[0].clone(), all[2].clone()]);
    assert_eq!(json(&[&"verify", &at("less.fan")])["ok"], true);
    assert_eq!(json(&[&"paint", &at("less.fan"), &"--export-log", &at("log.json")])["strokes"], 0);
    // Taken out and given again, it is as the model has it.
    json(&[&"paint", &at("a.fan"), &"--remove-channel", &"emission", &"--add-channel", &"emission"]);
    assert_eq!(channels("a.fan"), [all[0].clone(), all[2].clone(), all[1].clone()]);
    fails(
        1,
        &["channel emission", "it has none"],
        &[&"paint", &at("less.fan"), &"--remove-channel", &"emission"],
    );
    let both = "base-color,normal";
    fails(
        2,
        &["less.fan: it has no other channel"],
        &[&"paint", &at("less.fan"), &"--remove-channel", &both],
    );
    fails(2, &["invalid value 'colour'"], &[&"paint", &at("less.fan"), &"--remove-channel", &"colour"]);
    // Materials.
    json(&[&"paint", &at("less.fan"), &"--alpha", &"cut-out"]);
    let asset = fantex::store::Asset::open(&at("less.fan")).unwrap();
    let cut_out = fantex::mesh::AlphaMode::Mask(0.5);
    assert!(asset.mesh().materials.iter().all(|material| material.alpha == cut_out));
    assert_eq!(json(&[&"verify", &at("less.fan")])["ok"], true);
    fails(2, &["invalid value 'glass'"], &[&"paint", &at("less.fan"), &"--alpha", &"glass"]);
}

/// Whenever the program is killed, the asset has the channel with its paint, or lacks it.
#[cfg(unix)]
#[test]
fn a_removal_that_is_killed_leaves_the_old_asset_or_the_new_one() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    std::fs::write(at("glow.json"), STROKES.replace("base_color", "emission")).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"400k"]);
    json(&[&"paint", &at("a.fan"), &"--add-channel", &"emission", &"--replay", &at("glow.json")]);
    json(&[&"paint", &at("a.fan"), &"--remove-channel", &"emission", &"-o", &at("less.fan")]);
    let seen = |path: &std::path::Path| -> Vec<Vec<u8>> {
        let asset = fantex::store::Asset::open(path).unwrap();
        let pages = |(g, group)| fantex::store::group_pages(g, group);
        let all = (0u32..).zip(&asset.cover().groups).flat_map(pages);
        let channels = asset.channels().len();
        all.flat_map(|id| (0..channels).map(|c| asset.read_page_raw(c, id).unwrap()).collect::<Vec<_>>())
            .collect()
    };
    let [old, new] = ["a.fan", "less.fan"].map(|name| seen(&at(name)));
    let started = std::time::Instant::now();
    let remove = |path: &std::path::Path| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_fantex"));
        command.arg("paint").arg(path).args(["--remove-channel", "emission"]);
        command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
        command
    };
    std::fs::copy(at("a.fan"), at("whole.fan")).unwrap();
    assert!(remove(&at("whole.fan")).status().unwrap().success());
    let takes = started.elapsed();
    let (mut olds, mut news) = (0, 0);
    for k in 0..24 {
        let path = at(&format!("killed{k}.fan"));
        std::fs::copy(at("a.fan"), &path).unwrap();
        let mut child = remove(&path).spawn().unwrap();
        std::thread::sleep(takes.mul_f64(f64::from(k) / 20.0));
        child.kill().unwrap();
        child.wait().unwrap();
        let found = seen(&path);
        assert!(found == old || found == new, "{k}");
        assert_eq!(json(&[&"verify", &path])["ok"], true);
        let count = if found == old { &mut olds } else { &mut news };
        *count += 1;
        std::fs::remove_file(path).unwrap();
    }
    assert!(olds > 0 && news > 0, "{olds} {news}");
}

#[test]
fn painting_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    let before = std::fs::read(at("a.fan")).unwrap();
    let measured = json(&[&"bench", &"paint", &at("a.fan"), &"--dabs", &"5", &"--brush", &"20"]);
    let names: Vec<&str> =
        measured["rows"].as_array().unwrap().iter().filter_map(|r| r["name"].as_str()).collect();
    for expected in [
        "dab, median",
        "dab, 99 of 100",
        "undo",
        "end of the stroke",
        "first dab of the next one, in the same place",
        "end of a large stroke, all channels",
        "end of a stroke under layers",
    ] {
        assert!(names.contains(&expected), "{names:?}");
    }
    assert!(std::fs::read(at("a.fan")).unwrap() == before, "it works on a copy");
}

/// What the loader reads twice comes from its cache: that is no figure of the disk.
#[test]
fn disks_are_not_measured_through_a_cache() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    let key = r#"{"seconds": 0, "eye": [2, 2, 3], "target": [0, 0, 0], "up": [0, 1, 0], "fov_degrees": 40}"#;
    let path = format!("{{\"keys\": [{key}, {}]}}", key.replace("\"seconds\": 0", "\"seconds\": 0.1"));
    std::fs::write(at("flight.json"), path).unwrap();
    let output = succeeds(&[&"bench", &"stream", &at("a.fan"), &"--path", &at("flight.json")]);
    let said = stderr(&output);
    assert!(said.contains("what it gets out of the disk cannot be measured; take a larger asset"), "{said}");
    let rows = String::from_utf8_lossy(&output.stdout);
    assert!(rows.contains("plain loop of direct reads"), "{rows}");
    assert!(!rows.contains("clusters read and unpacked") && !rows.contains("texels delivered"), "{rows}");
}
