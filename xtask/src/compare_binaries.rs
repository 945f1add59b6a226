//! Proof that a change keeps behaviour: runs two builds of the command line on the same input and compares everything they write,
//! byte for byte.
//!
//! Every model of the data folder and of `assets` goes through every command that needs no window; the gallery stands for the looks.
//! Of JSON output times, memory and the names of graphics cards are left out. Both programs run side by side, on one thread each, in
//! folders of their own with relative outputs. Extents are small: whatever differs differs in small pictures, too.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Instant;

use serde_json::Value;

use crate::shell::{Failure, data_folder, root};

/// Keys of JSON output that may differ from run to run.
const VOLATILE_KEYS: [&str; 4] = ["seconds", "peak_memory_bytes", "adapter", "scratch_bytes"];

/// Commands that build on each other, one a line: `MODEL` stands for the path of a model, `ASSETS` for the folder of assets.
const OF_MODEL: &str = "
    info MODEL --texels 200k
    info MODEL --look
    bake MODEL -o own.fan --texels 20k --format rgba8
    bake MODEL -o uv.fan --texels 20k --format rgba8 --source uv
    bake MODEL -o vertex.fan --texels 20k --format rgba8 --source vertex
    bake MODEL -o solid.fan --texels 20k --format rgba8 --source solid=marble
    bake MODEL -o image.fan --texels 20k --format rgba8 --source image=ASSETS/images/rock-color.jpg,mapping=triplanar
    bake MODEL -o mesh.fan --texels 20k --format rgba8 --source mesh=ASSETS/models/suzanne.ply
    bake MODEL -o look.fan --texels 20k --format rgba8 --source look=look.toml
    bake MODEL -o coarse.fan --texels 8k --source solid=wood --fit box --tile 32
    bake MODEL -o bc7.fan --texels 8k --source solid=rock
    info solid.fan
    verify solid.fan
    verify mesh.fan
    render MODEL -o model.png --size 64x48 --samples 2
    render own.fan -o own.png --size 64x48 --samples 2 --filter ewa
    render look.fan -o look.exr --size 64x48 --samples 2
    render MODEL --look look.toml -o dressed.png --size 64x48 --samples 2
    render mesh.fan -o sky.png --size 64x48 --samples 2 --environment sky --filter trilinear
    compare MODEL own.fan --views 1 -o views --size 64x48 --samples 2
    export own.fan -o own.glb --size 128
    export solid.fan -o color.png --channel base-color --size 64
    paint solid.fan --replay strokes.json -o painted.fan
    paint coarse.fan --replay-log painted.fan -o repainted.fan
    paint painted.fan --export-log log.json
    verify painted.fan";

const OF_PHOTOGRAPHS: &str = "
    generate photographs ASSETS/WaterBottle/WaterBottle.gltf -o shoot --count 6 --size 160x120 --lens radial
    bake ASSETS/WaterBottle/WaterBottle.gltf -o photos.fan --source photos=shoot --texels 40k
    bake ASSETS/WaterBottle/WaterBottle.gltf -o plain.fan --source photos=shoot,exposure=off,unseen=ff8000 --texels 40k
    verify photos.fan
    export photos.fan -o turn.png --turntable 3 --size 96x72 --samples 1
    bake ASSETS/models/spot.obj -o match.fan --match --format bc1";

const OF_LANDSCAPE: &str = "
    generate landscape -o cave.ply --triangles 10k --seed 7
    generate landscape -o world.fan --triangles 10k --texels 100k
    verify world.fan
    info world.fan
    demo -o demo --triangles 10k --texels 100k";

const OF_GALLERY: &str = "gallery -o gallery --width 32";

/// A brush stroke, a fill, and a stroke in a mirror.
const STROKES: &str = r#"{ "version": 1, "strokes": [
  { "label": "line", "brush": { "size": { "texels": 24 }, "hardness": 0.3, "opacity": 0.8 }, "tool": { "paint": "multiply" },
    "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
    "samples": [{ "at": { "position": [0, 0, 0] } }, { "at": { "position": [0.3, 0.4, 0.5] }, "pressure": 0.5 }] },
  { "label": "cap", "fill": { "angle": 20 }, "channels": [{ "kind": "base_color", "color": { "srgb": [0.1, 0.6, 0.2] } }],
    "samples": [{ "at": { "position": [0, 1, 0] } }] },
  { "label": "dots", "brush": { "size": { "texels": 9 }, "spacing": 2 }, "symmetry": { "mirror": { "axis": 0 } },
    "channels": [{ "kind": "base_color", "color": { "srgb": [0.1, 0.2, 0.7] } }],
    "samples": [{ "at": { "position": [1, 0, 0] } }, { "at": { "position": [0, 1, 1] } }] } ] }"#;

const LOOK: &str = "\
[textures.rings]\nkind = \"wood\"\n\n[textures.bumps]\nkind = \"noise\"\ncell = 0.1\n\n\
[materials.oak]\nbase_color = \"rings\"\nroughness = { texture = \"bumps\", factor = 0.3, offset = 0.4 }\n";

struct Series {
    name: String,
    commands: Vec<Vec<String>>,
}

impl Series {
    fn new(name: &str, commands: &str, model: &Path) -> Self {
        let (model, assets) = (model.display().to_string(), root().join("assets").display().to_string());
        let word = |word: &str| word.replace("MODEL", &model).replace("ASSETS", &assets);
        let lines = commands.lines().filter(|line| !line.trim().is_empty());
        let commands = lines.map(|line| line.split_whitespace().map(word).collect()).collect();
        Self { name: name.to_owned(), commands }
    }
}

/// Runs both programs on the series whose name contains `only`, and prints a table of differences.
pub(crate) fn run(old: &str, new: &str, only: &str) -> Result<(), Failure> {
    let started = Instant::now();
    let program = |path: &str| Path::new(path).canonicalize().map_err(|e| Failure(format!("{path}: {e}")));
    let programs = [program(old)?, program(new)?];
    let folder = std::env::temp_dir().join(format!("fantex-compare-{}", std::process::id()));
    let series: Vec<Series> = all_series()?.into_iter().filter(|series| series.name.contains(only)).collect();
    if series.is_empty() {
        return Err(Failure(format!("nothing to compare is called {only}")));
    }
    let mut differences = Vec::new();
    for (number, series) in (1..).zip(&series) {
        let found = compare(series, &programs, &folder);
        let (word, secs) =
            (if found.is_empty() { "equal" } else { "DIFFERENT" }, started.elapsed().as_secs());
        eprintln!("{number:>3}  {word:<9}  {} ({secs} s)", series.name);
        differences.extend(found.into_iter().map(|what| format!("{:<28} {what}", series.name)));
        // The next one begins from nothing; what is left at the end is nobody's.
        fs::remove_dir_all(&folder).unwrap_or_else(|e| eprintln!("cannot remove {}: {e}", folder.display()));
    }
    differences.iter().for_each(|difference| println!("{difference}"));
    let commands: usize = series.iter().map(|series| series.commands.len()).sum();
    let (count, secs) = (differences.len(), started.elapsed().as_secs());
    println!("{commands} commands in {} series, {count} differences, {secs} s", series.len());
    if differences.is_empty() { Ok(()) } else { Err(Failure::new("the programs differ")) }
}

/// Quick models first; of equal files the first.
fn all_series() -> Result<Vec<Series>, Failure> {
    let mut models = Vec::new();
    match data_folder() {
        Some(data) => find_models(&data.join("meshes"), &mut models)?,
        None => eprintln!("SKIPPED: the real models (set FANTEX_DATA to the folder that holds them)"),
    }
    find_models(&root().join("assets/models"), &mut models)?;
    models.sort_by_key(|model| fs::metadata(model).map_or(0, |metadata| metadata.len()));
    let mut known = BTreeSet::new();
    models.retain(|model| known.insert(fs::read(model).unwrap_or_default()));
    let of_model = |model: &PathBuf| {
        Series::new(&model.file_name().unwrap_or_default().to_string_lossy(), OF_MODEL, model)
    };
    let mut all: Vec<Series> = models.iter().map(of_model).collect();
    for (name, commands) in
        [("landscape", OF_LANDSCAPE), ("photographs", OF_PHOTOGRAPHS), ("gallery", OF_GALLERY)]
    {
        all.push(Series::new(name, commands, Path::new("")));
    }
    Ok(all)
}

/// Runs a series by both programs; a sentence per difference.
fn compare(series: &Series, programs: &[PathBuf; 2], folder: &Path) -> Vec<String> {
    let folders = ["old", "new"].map(|side| folder.join(side));
    for folder in &folders {
        let files = [("look.toml", LOOK), ("strokes.json", STROKES)];
        let made = fs::create_dir_all(folder)
            .and_then(|()| files.iter().try_for_each(|(name, text)| fs::write(folder.join(name), text)));
        if let Err(error) = made {
            return vec![format!("cannot write {}: {error}", folder.display())];
        }
    }
    let mut found = Vec::new();
    for command in &series.commands {
        let shown: Vec<&str> = command.iter().map(|word| word.rsplit('/').next().unwrap_or(word)).collect();
        let shown: String = shown.join(" ").chars().take(60).collect();
        let (old, new) = std::thread::scope(|scope| {
            let old = scope.spawn(|| execute(&programs[0], command, &folders[0]));
            let new = execute(&programs[1], command, &folders[1]);
            (old.join(), new)
        });
        let (Ok(Ok(old)), Ok(new)) = (old, new) else {
            found.push(format!("{shown:<60} cannot be run"));
            continue;
        };
        found.extend(differences(&old, &new).into_iter().map(|what| format!("{shown:<60} {what}")));
    }
    let [old, new] = folders.each_ref().map(|folder| contents(folder));
    for name in old.keys().chain(new.keys()).collect::<BTreeSet<_>>() {
        match (old.get(name), new.get(name)) {
            (Some(old), Some(new)) if old == new => {}
            (Some(old), Some(new)) => {
                let at = old.iter().zip(new).take_while(|(a, b)| a == b).count();
                let (old, new) = (old.len(), new.len());
                found.push(format!("{name} differs from byte {at} on ({new} bytes, {old} before)"));
            }
            (Some(_), None) => found.push(format!("{name} is missing")),
            (None, _) => found.push(format!("{name} is new")),
        }
    }
    found
}

fn execute(program: &Path, command: &[String], folder: &Path) -> std::io::Result<Output> {
    let mut run = Command::new(program);
    run.args(command).args(["--json", "--threads", "1"]).current_dir(folder).stdin(Stdio::null()).output()
}

fn differences(old: &Output, new: &Output) -> Vec<String> {
    let mut found = Vec::new();
    if old.status != new.status {
        found.push(format!("ends with {} instead of {}", new.status, old.status));
    }
    found.extend(different_output(&old.stdout, &new.stdout));
    let [old, new] = [old, new].map(|output| String::from_utf8_lossy(&output.stderr).trim().to_owned());
    if old != new {
        found.push(format!("says {new:?} instead of {old:?}"));
    }
    found
}

/// What differs between two JSON outputs, volatile keys apart.
fn different_output(old: &[u8], new: &[u8]) -> Option<String> {
    if old == new {
        return None;
    }
    let parsed = [old, new].map(|bytes| serde_json::from_slice::<Value>(bytes).ok().map(settled));
    match parsed {
        [Some(old), Some(new)] if old == new => None,
        [Some(Value::Object(old)), Some(Value::Object(new))] => {
            let keys = old.keys().chain(new.keys()).filter(|key| old.get(*key) != new.get(*key));
            let keys: BTreeSet<&str> = keys.map(String::as_str).collect();
            Some(format!("printed other values of {}", Vec::from_iter(keys).join(", ")))
        }
        _ => Some("printed something else".to_owned()),
    }
}

/// Without what differs from run to run.
fn settled(value: Value) -> Value {
    match value {
        Value::Object(map) => {
            let kept = map.into_iter().filter(|(key, _)| !VOLATILE_KEYS.contains(&key.as_str()));
            Value::Object(kept.map(|(key, value)| (key, settled(value))).collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(settled).collect()),
        value => value,
    }
}

/// All files below a folder by their paths in it.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let (mut found, mut folders) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(current) = folders.pop() {
        for entry in fs::read_dir(&current).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap_or(&path).display().to_string();
                found.insert(name, fs::read(&path).unwrap_or_default());
            }
        }
    }
    found
}

fn find_models(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let failed = |e| Failure(format!("cannot list {}: {e}", folder.display()));
    for path in fs::read_dir(folder).map_err(failed)?.flatten().map(|entry| entry.path()) {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if path.is_dir() {
            find_models(&path, found)?;
        } else if matches!(extension.as_deref(), Some("gltf" | "glb" | "obj" | "ply" | "stl")) {
            found.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_do_not_count() {
        let old = br#"{"a": 1, "seconds": {"load": 1.0}, "parts": [{"seconds": 2.0, "texels": 3}]}"#;
        let new = br#"{"a": 1, "seconds": {"load": 9.0}, "parts": [{"seconds": 7.0, "texels": 3}]}"#;
        assert_eq!(different_output(old, new), None);
        let other = br#"{"a": 2, "seconds": {"load": 9.0}, "parts": [{"seconds": 7.0, "texels": 3}]}"#;
        assert_eq!(different_output(old, other).unwrap(), "printed other values of a");
        assert!(different_output(b"", new).is_some());
    }
}
