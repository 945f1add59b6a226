//! Every real model, broken ones included: a correct report or a clear refusal.

use std::path::{Path, PathBuf};

use crate::support::{data, json, run, stderr, succeeds};

/// Files in `meshes/` that must be refused, with a word of the reason.
const REFUSED: [(&str, &str); 0] = [];

#[test]
fn every_model_is_described_or_refused_with_a_reason() {
    let Some(data) = data() else { return };
    let mut count = 0;
    for path in models(&data.join("meshes")).into_iter().chain(models(&data.join("landscapes"))) {
        let output = run(&[&"info", &path, &"--json", &"--texels", &"1M"]);
        let errors = stderr(&output);
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        match REFUSED.iter().find(|(refused, _)| *refused == name) {
            Some((_, reason)) => {
                assert_eq!(output.status.code(), Some(1), "{name}: {errors}");
                assert!(errors.contains(reason) && errors.lines().count() == 1, "{name}: {errors}");
            }
            None => {
                assert_eq!(output.status.code(), Some(0), "{name}: {errors}");
                let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
                let count = |key: &str| info[key].as_u64().unwrap();
                assert!(count("triangles") > 0, "{name}");
                let laid_flat = count("fans_projected") + count("fans_unfolded");
                assert!(laid_flat + 2 * count("fans_split") >= count("fans"), "{name}: {info:#}");
            }
        }
        count += 1;
    }
    assert!(count >= 20, "only {count} models in {}", data.display());
}

#[test]
fn every_model_bakes_without_a_jump() {
    let Some(data) = data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("out.fan");
    for path in models(&data.join("meshes")) {
        succeeds(&[
            &"bake",
            &path,
            &"-o",
            &asset,
            &"--source",
            &"solid=marble",
            &"--texels",
            &"1M",
            &"--force",
            &"--quiet",
        ]);
        let verified = json(&[&"verify", &asset]);
        assert_eq!(verified["ok"], true, "{}: {verified:#}", path.display());
    }
}

/// All model files below a folder, sorted.
fn models(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if path.is_dir() {
            found.extend(models(&path));
        } else if matches!(extension.as_deref(), Some("gltf" | "glb" | "obj" | "ply" | "stl")) {
            found.push(path);
        }
    }
    found
}
