//! Figures of fidelity and speed, beside peers where they are installed.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::shell::{Failure, capture, cargo, data_folder, root, succeeds};
use crate::test::target_folder;

/// The peer: UV unwrapping by xatlas, from Python.
const XATLAS: &str = "crates/fantex-bench/src/xatlas_peer.py";
/// Landscapes for the speed of covering, in triangles.
const LANDSCAPES: [&str; 3] = ["100k", "500k", "2M"];

/// Runs all rows in release, prints them and writes `bench.json` where cargo builds.
pub(crate) fn run() -> Result<(), Failure> {
    cargo(&["build", "--release", "--package", "fantex-cli", "--package", "fantex-bench"])?;
    let program = |name: &str| Program { path: target_folder().join("release").join(name) };
    let (fantex, bench) = (program("fantex"), program("fantex-bench"));
    let mut rows = Vec::new();
    if let Some(bunny) = data("meshes/bunny/stanford_bunny.ply") {
        rows.extend(fidelity(&fantex, &bunny)?);
        rows.extend(peer(&fantex, "bunny", &bunny)?);
    }
    for triangles in LANDSCAPES {
        let measured = fantex.json(&["bench", "cover", "--triangles", triangles])?;
        rows.extend(named(measured, &format!("landscape {triangles}, ")));
    }
    let bottle = text(&root().join("assets/WaterBottle/WaterBottle.gltf"));
    for what in ["bake", "render"] {
        rows.extend(named(fantex.json(&["bench", what, &bottle])?, "bottle, "));
    }
    rows.extend(named(fantex.json(&["bench", "sample", "--quiet"])?, ""));
    rows.extend(named(bench.json(&[])?, ""));
    print(&rows);
    let path = target_folder().join("bench.json");
    let document = format!("{:#}\n", json!({ "rows": rows }));
    std::fs::write(&path, document).map_err(|e| Failure(format!("cannot write {}: {e}", path.display())))?;
    eprintln!("written to {}", path.display());
    Ok(())
}

struct Program {
    path: PathBuf,
}

impl Program {
    fn json(&self, arguments: &[&str]) -> Result<Value, Failure> {
        let name = self.path.file_name().unwrap_or_default().display();
        eprintln!("> {name} {}", arguments.join(" "));
        let text = capture(Command::new(&self.path).args(arguments).arg("--json"))?;
        serde_json::from_str(&text).map_err(|e| Failure(format!("{name} did not print JSON: {e}")))
    }
}

/// The figures of the fidelity measurement as rows.
fn fidelity(fantex: &Program, bunny: &Path) -> Result<Vec<Value>, Failure> {
    let measured =
        fantex.json(&["bench", "fidelity", &text(bunny), "--texels", "5592405", "--wavelength", "16"])?;
    let row = |name: &str, key: &str, unit: &str| json!({ "name": format!("bunny, {name}"), "value": measured[key], "unit": unit, "peer": null, "ratio": null });
    Ok(vec![
        row("fidelity", "psnr_db", "dB"),
        row("share of ideal density", "density_share", ""),
        row("look-ups per sample", "lookups_per_sample", ""),
    ])
}

/// Seconds to cover a mesh, beside the seconds that xatlas takes to unwrap it.
fn peer(fantex: &Program, name: &str, mesh: &Path) -> Result<Option<Value>, Failure> {
    if !succeeds(Command::new("python3").args(["-c", "import xatlas, numpy"])) {
        eprintln!("SKIPPED: no comparison with xatlas (Python packages xatlas and numpy are not installed)");
        return Ok(None);
    }
    let info = fantex.json(&["info", &text(mesh)])?;
    let cover = info["seconds"]["cover"].as_f64().unwrap_or(f64::NAN);
    eprintln!("> python3 {XATLAS} {}", mesh.display());
    let output = capture(Command::new("python3").arg(root().join(XATLAS)).arg(mesh))?;
    let printed: Value = serde_json::from_str(&output)
        .map_err(|_| Failure(format!("{XATLAS} did not print its figures: {output}")))?;
    let xatlas = printed["seconds"].as_f64().unwrap_or(f64::NAN);
    Ok(Some(json!({
        "name": format!("{name}, cover beside xatlas"),
        "value": cover,
        "unit": "s",
        "peer": xatlas,
        "ratio": cover / xatlas,
    })))
}

/// The rows of a measurement with the start of their names.
fn named(measured: Value, start: &str) -> Vec<Value> {
    let rows = measured["rows"].as_array().cloned().unwrap_or_default();
    rows.into_iter()
        .map(|mut row| {
            row["name"] = json!(format!("{start}{}", row["name"].as_str().unwrap_or_default()));
            row
        })
        .collect()
}

fn print(rows: &[Value]) {
    let number = |value: &Value| value.as_f64().map_or(String::new(), |v| format!("{v:.3}"));
    println!("{:<44} {:>12} {:<14} {:>12} {:>8}", "", "value", "unit", "peer", "ratio");
    for row in rows {
        println!(
            "{:<44} {:>12} {:<14} {:>12} {:>8}",
            row["name"].as_str().unwrap_or_default(),
            number(&row["value"]),
            row["unit"].as_str().unwrap_or_default(),
            number(&row["peer"]),
            number(&row["ratio"])
        );
    }
}

/// A file of the real models, if they are there.
fn data(file: &str) -> Option<PathBuf> {
    let path = data_folder().map(|folder| folder.join(file)).filter(|path| path.is_file());
    if path.is_none() {
        eprintln!("SKIPPED: {file} is not there (set FANTEX_DATA to the folder of the real models)");
    }
    path
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
