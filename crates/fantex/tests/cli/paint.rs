//! `fantex paint`.

use crate::support::{fails, json};

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
    // In place.
    json(&[&"paint", &asset, &"--replay", &at("strokes.json")]);
    assert!(std::fs::read(&asset).unwrap() == std::fs::read(&painted).unwrap());

    fails(1, &["exists already"], &[&"paint", &asset, &"--replay", &at("strokes.json"), &"-o", &painted]);
    fails(1, &["channel Normal"], &[&"paint", &asset, &"--replay", &at("wrong.json")]);
    fails(1, &["not a stroke file"], &[&"paint", &asset, &"--replay", &model]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 5, "nothing is left behind");
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
fn painting_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("model.obj"), TETRAHEDRON).unwrap();
    json(&[&"bake", &at("model.obj"), &"-o", &at("a.fan"), &"--source", &"solid=wood", &"--texels", &"20k"]);
    let before = std::fs::read(at("a.fan")).unwrap();
    let measured = json(&[&"bench", &"paint", &at("a.fan"), &"--dabs", &"5", &"--brush", &"20"]);
    let names: Vec<&str> =
        measured["rows"].as_array().unwrap().iter().filter_map(|r| r["name"].as_str()).collect();
    for expected in ["dab, median", "dab, 99 of 100", "undo", "end of the stroke"] {
        assert!(names.contains(&expected), "{names:?}");
    }
    assert!(std::fs::read(at("a.fan")).unwrap() == before, "it works on a copy");
}
