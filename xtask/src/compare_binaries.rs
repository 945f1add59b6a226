//! Proof that a change keeps behaviour: runs two builds of the command line on the same input and compares everything they write,
//! byte for byte.
//!
//! Every model of the data folder and of `assets` goes through every command that needs no window; the gallery stands for the looks.
//! Of JSON output times, memory and the names of graphics cards are left out. Both programs run in folders of their own with
//! relative outputs, on one thread each, several models at a time.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use serde_json::Value;

use crate::shell::{Failure, data_folder, root};

/// Keys of JSON output that may differ from run to run.
const VOLATILE_KEYS: [&str; 4] = ["seconds", "peak_memory_bytes", "adapter", "scratch_bytes"];

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

/// One series of commands that build on each other, in a folder of its own.
struct Series {
    name: String,
    /// Files that are there at the start: name, content.
    files: Vec<(&'static str, String)>,
    commands: Vec<Vec<String>>,
}

/// What a program did.
struct Outcome {
    exit_code: Option<i32>,
    stdout: Vec<u8>,
    stderr: String,
}

/// A difference between the programs.
struct Difference {
    series: String,
    command: String,
    what: String,
}

/// Runs both programs and prints a table of differences.
pub(crate) fn run(old: &str, new: &str) -> Result<(), Failure> {
    let started = Instant::now();
    let programs =
        [old, new].map(|path| Path::new(path).canonicalize().map_err(|e| Failure(format!("{path}: {e}"))));
    let [old, new] = programs;
    let programs = [old?, new?];
    let folder = std::env::temp_dir().join(format!("fantex-compare-{}", std::process::id()));
    let all = all_series()?;
    let differences = Mutex::new(Vec::new());
    let (next, commands) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let workers = std::thread::available_parallelism().map_or(2, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some(series) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let found = compare(series, &programs, &folder);
                    commands.fetch_add(series.commands.len(), Ordering::Relaxed);
                    let done = if found.is_empty() { "equal" } else { "DIFFERENT" };
                    eprintln!("{done:<9} {} ({:.0} s)", series.name, started.elapsed().as_secs_f64());
                    differences.lock().unwrap_or_else(std::sync::PoisonError::into_inner).extend(found);
                }
            });
        }
    });
    remove(&folder);
    let differences = differences.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    for Difference { series, command, what } in &differences {
        println!("{series:<28} {command:<60} {what}");
    }
    let (series, commands) = (all.len(), commands.into_inner());
    println!(
        "{commands} commands in {series} series, {} differences, {:.0} s",
        differences.len(),
        started.elapsed().as_secs_f64()
    );
    if differences.is_empty() { Ok(()) } else { Err(Failure::new("the programs differ")) }
}

fn all_series() -> Result<Vec<Series>, Failure> {
    let mut models = Vec::new();
    match data_folder() {
        Some(data) => find_models(&data.join("meshes"), &mut models)?,
        None => eprintln!("SKIPPED: the real models (set FANTEX_DATA to the folder that holds them)"),
    }
    find_models(&root().join("assets/models"), &mut models)?;
    let assets = root().join("assets");
    let file = |name: &str| assets.join(name).display().to_string();
    let mut all = vec![
        // The longest first.
        Series {
            name: "gallery".to_owned(),
            files: Vec::new(),
            commands: vec![words(&["gallery", "-o", "gallery", "--width", "48"])],
        },
        photographs(&file("WaterBottle/WaterBottle.gltf")),
        landscape(),
    ];
    all.extend(models.iter().map(|model| series_of(model, &file)));
    Ok(all)
}

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

/// All commands on one model.
fn series_of(model: &Path, file: &dyn Fn(&str) -> String) -> Series {
    let path = model.display().to_string();
    let image = format!("image={},mapping=triplanar", file("images/rock-color.jpg"));
    let detailed = format!("mesh={}", file("models/suzanne.ply"));
    let mut commands = vec![words(&["info", &path, "--texels", "200k"]), words(&["info", &path, "--look"])];
    for (name, source) in [
        ("own", None),
        ("uv", Some("uv")),
        ("vertex", Some("vertex")),
        ("solid", Some("solid=marble")),
        ("image", Some(image.as_str())),
        ("mesh", Some(detailed.as_str())),
        ("look", Some("look=look.toml")),
    ] {
        let asset = format!("{name}.fan");
        let mut bake = words(&["bake", &path, "-o", &asset, "--texels", "60k", "--format", "rgba8"]);
        bake.extend(source.into_iter().flat_map(|source| words(&["--source", source])));
        commands.push(bake);
    }
    let picture = ["--size", "128x96", "--samples", "2"];
    let with_picture = |start: &[&str]| words(&[start, &picture[..]].concat());
    commands.extend([
        words(&[
            "bake",
            &path,
            "-o",
            "coarse.fan",
            "--source",
            "solid=wood",
            "--texels",
            "20k",
            "--fit",
            "box",
            "--tile",
            "32",
        ]),
        words(&["bake", &path, "-o", "bc7.fan", "--source", "solid=rock", "--texels", "20k"]),
        words(&["info", "solid.fan"]),
        words(&["verify", "solid.fan"]),
        words(&["verify", "mesh.fan"]),
        with_picture(&["render", &path, "-o", "model.png"]),
        with_picture(&["render", "own.fan", "-o", "own.png", "--filter", "ewa"]),
        with_picture(&["render", "look.fan", "-o", "look.exr"]),
        with_picture(&["render", &path, "--look", "look.toml", "-o", "dressed.png"]),
        with_picture(&[
            "render",
            "mesh.fan",
            "-o",
            "sky.png",
            "--environment",
            "sky",
            "--filter",
            "trilinear",
        ]),
        with_picture(&["compare", &path, "own.fan", "--views", "1", "-o", "views"]),
        words(&["export", "own.fan", "-o", "own.glb", "--size", "256"]),
        words(&["export", "solid.fan", "-o", "color.png", "--channel", "base-color", "--size", "128"]),
        words(&["paint", "solid.fan", "--replay", "strokes.json", "-o", "painted.fan"]),
        words(&["paint", "coarse.fan", "--replay-log", "painted.fan", "-o", "repainted.fan"]),
        words(&["paint", "painted.fan", "--export-log", "log.json"]),
        words(&["verify", "painted.fan"]),
    ]);
    let name = model.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Series {
        name,
        files: vec![("look.toml", LOOK.to_owned()), ("strokes.json", STROKES.to_owned())],
        commands,
    }
}

/// A look for any model.
const LOOK: &str = "\
[textures.rings]\nkind = \"wood\"\n\n[textures.bumps]\nkind = \"noise\"\ncell = 0.1\n\n\
[materials.oak]\nbase_color = \"rings\"\nroughness = { texture = \"bumps\", factor = 0.3, offset = 0.4 }\n";

fn photographs(model: &str) -> Series {
    let take = words(&[
        "generate",
        "photographs",
        model,
        "-o",
        "shoot",
        "--count",
        "6",
        "--size",
        "160x120",
        "--lens",
        "radial",
    ]);
    let bake = |source: &str, asset: &str| {
        words(&["bake", model, "-o", asset, "--source", source, "--texels", "60k"])
    };
    let commands = vec![
        take,
        bake("photos=shoot", "photos.fan"),
        bake("photos=shoot,exposure=off,unseen=ff8000", "plain.fan"),
        words(&["verify", "photos.fan"]),
        words(&[
            "export",
            "photos.fan",
            "-o",
            "turn.png",
            "--turntable",
            "3",
            "--size",
            "96x72",
            "--samples",
            "1",
        ]),
        words(&["bake", model, "-o", "match.fan", "--match", "--format", "bc1"]),
    ];
    Series { name: "photographs".to_owned(), files: Vec::new(), commands }
}

fn landscape() -> Series {
    let commands = vec![
        words(&["generate", "landscape", "-o", "cave.ply", "--triangles", "20k", "--seed", "7"]),
        words(&["generate", "landscape", "-o", "world.fan", "--triangles", "20k", "--texels", "200k"]),
        words(&["verify", "world.fan"]),
        words(&["info", "world.fan"]),
        words(&["demo", "-o", "demo", "--triangles", "20k", "--texels", "200k"]),
    ];
    Series { name: "landscape".to_owned(), files: Vec::new(), commands }
}

/// Runs a series by both programs.
fn compare(series: &Series, programs: &[PathBuf; 2], folder: &Path) -> Vec<Difference> {
    let difference = |command: &[String], what: String| {
        let shown: Vec<&str> = command.iter().map(|word| word.rsplit('/').next().unwrap_or(word)).collect();
        Difference { series: series.name.clone(), command: shown.join(" ").chars().take(60).collect(), what }
    };
    let folders = ["old", "new"].map(|side| folder.join(&series.name).join(side));
    let mut found = Vec::new();
    for folder in &folders {
        let made = fs::create_dir_all(folder).and_then(|()| {
            series.files.iter().try_for_each(|(name, text)| fs::write(folder.join(name), text))
        });
        if let Err(error) = made {
            return vec![difference(&[], format!("cannot write {}: {error}", folder.display()))];
        }
    }
    for command in &series.commands {
        let [old, new] = [0, 1].map(|side| execute(&programs[side], command, &folders[side]));
        let (old, new) = match (old, new) {
            (Ok(old), Ok(new)) => (old, new),
            (Err(error), _) | (_, Err(error)) => {
                found.push(difference(command, format!("cannot run: {error}")));
                continue;
            }
        };
        if old.exit_code != new.exit_code {
            let why = new.stderr.lines().last().unwrap_or_default();
            found.push(difference(
                command,
                format!("exit code {:?} instead of {:?}: {why}", new.exit_code, old.exit_code),
            ));
        }
        if let Some(what) = different_output(&old.stdout, &new.stdout) {
            found.push(difference(command, what));
        }
        if old.stderr != new.stderr {
            found.push(difference(
                command,
                format!("says {:?} instead of {:?}", new.stderr.trim(), old.stderr.trim()),
            ));
        }
        let [old, new] = folders.each_ref().map(|folder| contents(folder));
        for (name, bytes) in &old {
            match new.get(name) {
                None => found.push(difference(command, format!("{name} is missing"))),
                Some(other) if other != bytes => {
                    let at = bytes.iter().zip(other).take_while(|(a, b)| a == b).count();
                    let (old, new) = (bytes.len(), other.len());
                    found.push(difference(
                        command,
                        format!("{name} differs from byte {at} on ({new} bytes, {old} before)"),
                    ));
                }
                Some(_) => {}
            }
        }
        let more = new.keys().filter(|name| !old.contains_key(*name));
        found.extend(more.map(|name| difference(command, format!("{name} is new"))));
        // Compared once: what follows reads the inputs only.
        if !found.is_empty() && found.len() > 20 {
            break;
        }
    }
    folders.iter().for_each(|folder| remove(folder));
    found
}

fn execute(program: &Path, command: &[String], folder: &Path) -> std::io::Result<Outcome> {
    let output = Command::new(program)
        .args(command)
        .args(["--json", "--threads", "1"])
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()?;
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    Ok(Outcome { exit_code: output.status.code(), stdout: output.stdout, stderr })
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
            let mut keys: Vec<&str> = keys.map(String::as_str).collect();
            keys.sort_unstable();
            keys.dedup();
            Some(format!("printed other values of {}", keys.join(", ")))
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

fn remove(folder: &Path) {
    if let Err(error) = fs::remove_dir_all(folder) {
        eprintln!("cannot remove {}: {error}", folder.display());
    }
}

/// All model files below a folder, sorted.
fn find_models(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let failed = |e| Failure(format!("cannot list {}: {e}", folder.display()));
    let entries = fs::read_dir(folder).map_err(failed)?;
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
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
