//! Where the texels of covers go: shipped models, and generated ones that are rough, folded, boxy, drilled or full of needles.

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use fantex::LongestEdge;
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::glam::DVec3;
use fantex::mesh::{
    CleanOptions, LoadOptions, Material, Mesh, Model, WriteGeometry, clean, generate, load, write_model,
};
use fantex_base::Random;
use serde_json::Value;

use crate::{Measured, Row};

/// Makes a model.
type Maker = fn() -> Model;

/// Shipped models with the texels that their covers get.
const FILES: [(&str, u64); 6] = [
    ("meshes/bunny/stanford_bunny.ply", 5_592_405),
    ("meshes/suzanne.ply", 1 << 20),
    ("meshes/spot/spot_triangulated.obj", 4 << 20),
    ("meshes/teapot.stl", 1 << 20),
    ("meshes/mengerSponge3.glb", 4 << 20),
    ("meshes/WaterBottle/WaterBottle.gltf", 4 << 20),
];

const GENERATED: [(&str, u64, Maker); 8] = [
    ("cube of 12 triangles", 1 << 20, || generate::cube(1)),
    ("cube of 768 triangles", 1 << 20, || generate::cube(8)),
    ("landscape", 8 << 20, || landscape(200_000)),
    ("folded ball", 8 << 20, || folded(7, 0.25)),
    ("noisy ball", 8 << 20, || noisy(6, 1.0)),
    ("corridors", 4 << 20, || corridors(16, 220)),
    ("drilled plate", 4 << 20, || drilled(10, 48, 0.4)),
    ("needles", 1 << 20, needles),
];

/// For each model what its cover loses beside ideal texels, the share of the ideal density in the worst direction, and triangles per
/// second, beside what xatlas makes of the same mesh with as many texels. Files are those of the test data, where there are some.
pub(crate) fn rows() -> Measured {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("FANTEX_DATA").map_or_else(beside, PathBuf::from);
    let mut rows = Vec::new();
    for (name, texels) in FILES {
        let path = data.join(name);
        if path.exists() {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            rows.extend(measured(&stem, load(&path, &LoadOptions::default())?, texels)?);
        } else {
            eprintln!("SKIPPED: {} is not there", path.display());
        }
    }
    for (name, texels, make) in GENERATED {
        rows.extend(measured(name, make(), texels)?);
    }
    Ok(rows)
}

fn measured(name: &str, model: Model, texels: u64) -> Measured {
    let (mesh, _) = clean(model, &CleanOptions::default())?;
    let options = CoverOptions { budget: TexelBudget::Total(texels), ..CoverOptions::default() };
    let started = Instant::now();
    let cut = LongestEdge::Automatic.refined(&mesh, &options);
    let (_, stats) = build_cover(&cut, &options)?;
    // With the search for the length at which large triangles are cut.
    let all_seconds = started.elapsed().as_secs_f64();
    let seconds = stats.seconds_fans + stats.seconds_groups;
    let mut rows = vec![
        Row::new(format!("{name}, loss"), stats.loss_db, "dB"),
        Row::new(format!("{name}, worst direction"), stats.worst_share, "of ideal"),
        Row::new(format!("{name}, gaps"), stats.gap_share, "of texels"),
        Row::new(format!("{name}, triangles"), mesh.triangles.len() as f64, ""),
        Row::new(format!("{name}, triangles after cuts"), cut.triangles.len() as f64, ""),
        Row::new(format!("{name}, tiles"), stats.groups as f64, ""),
        Row::new(format!("{name}, speed"), cut.triangles.len() as f64 / seconds / 1e6, "M triangles/s"),
    ];
    match unwrapped(&mesh, texels) {
        Ok(peer) => {
            let of_peer = |key: &str| peer[key].as_f64().unwrap_or(f64::NAN);
            rows.push(Row::new(format!("{name}, loss of xatlas"), of_peer("loss_db"), "dB"));
            rows.push(Row::new(
                format!("{name}, worst direction of xatlas"),
                of_peer("worst_share"),
                "of ideal",
            ));
            rows.push(Row::new(
                format!("{name}, time of xatlas"),
                of_peer("seconds") / all_seconds,
                "times ours",
            ));
        }
        Err(why) => eprintln!("SKIPPED: {name} beside xatlas: {why}"),
    }
    Ok(rows)
}

/// The peer ends after so many seconds.
const PATIENCE: Duration = Duration::from_secs(180);

/// What xatlas, in Python, makes of a mesh.
fn unwrapped(mesh: &Mesh, texels: u64) -> Result<Value, String> {
    let said = |e: &dyn Display| e.to_string();
    let folder = tempfile::tempdir().map_err(|e| said(&e))?;
    let path = folder.path().join("mesh.ply");
    let positions: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
    let geometry = WriteGeometry { positions: &positions, triangles: &mesh.triangles, colors: None };
    write_model(&path, &geometry, false).map_err(|e| said(&e))?;
    let mut python = Command::new("python3")
        .args([concat!(env!("CARGO_MANIFEST_DIR"), "/src/xatlas_peer.py").as_ref(), path.as_os_str()])
        .arg(texels.to_string())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|e| format!("python3: {e}"))?;
    let started = Instant::now();
    while python.try_wait().map_err(|e| said(&e))?.is_none() {
        if started.elapsed() > PATIENCE {
            python.kill().map_err(|e| said(&e))?;
            return Err(format!("it was not done after {} s", PATIENCE.as_secs()));
        }
        sleep(Duration::from_millis(20));
    }
    let output = python.wait_with_output().map_err(|e| said(&e))?;
    serde_json::from_slice(&output.stdout)
        .map_err(|_| "it failed; it needs the Python packages xatlas and numpy".to_owned())
}

fn model_of(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Model {
    let materials = vec![Material::default()];
    Model { name: "generated".into(), positions, triangles, materials, ..Model::default() }
}

/// A ball with folds of several sizes.
fn folded(level: u32, depth: f64) -> Model {
    let mut random = Random::new(5);
    let mut waves = Vec::new();
    for octave in 0..4 {
        for _ in 0..6 {
            let mut unit = || random.unit() * 2.0 - 1.0;
            let direction = DVec3::new(unit(), unit(), unit()).normalize();
            waves.push((
                direction * 4.0 * f64::from(1 << octave),
                unit() * 9.0,
                depth / f64::from(1 << octave),
            ));
        }
    }
    let mut model = generate::icosphere(level);
    for p in &mut model.positions {
        let height: f64 =
            waves.iter().map(|(d, phase, size)| (0.4 - (p.dot(*d) + phase).sin().abs()) * size).sum();
        *p *= 1.0 + height;
    }
    model
}

/// A ball whose vertices are off by noise, as in a scan.
fn noisy(level: u32, noise: f64) -> Model {
    let mut random = Random::new(7);
    let mut model = generate::icosphere(level);
    let edge = 1.1 / f64::from(1 << level);
    for p in &mut model.positions {
        let bump = 0.15 * ((p.x * 5.0).sin() * (p.y * 4.0).cos() + (p.z * 7.0).sin() * 0.5);
        *p *= 1.0 + bump + (random.unit() - 0.5) * noise * edge;
    }
    model
}

/// Rooms and corridors: the faces between full and empty cells of a random walk, some touching along an edge only.
fn corridors(cells: i32, steps: usize) -> Model {
    let mut random = Random::new(11);
    let mut empty = BTreeSet::new();
    let mut at = [cells / 2; 3];
    for _ in 0..steps {
        let axis = random.below(3) as usize;
        let sign = if random.below(2) == 0 { 1 } else { -1 };
        for _ in 0..=random.below(4) {
            at[axis] = (at[axis] + sign).clamp(1, cells - 2);
            empty.insert(at);
        }
    }
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for &cell in &empty {
        for axis in 0..3 {
            for sign in [0, 1] {
                let mut other = cell;
                other[axis] += 2 * sign - 1;
                if empty.contains(&other) {
                    continue;
                }
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let base = positions.len() as u32;
                for (a, b) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
                    let mut p = cell;
                    p[axis] += sign;
                    p[u] += a;
                    p[v] += b;
                    positions.push(DVec3::from(p.map(f64::from)));
                }
                let quad = if sign == 0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
                triangles.extend(quad.map(|t: [u32; 3]| t.map(|i| base + i)));
            }
        }
    }
    model_of(positions, triangles)
}

/// A plate with round holes, in long triangles as CAD programs make them.
fn drilled(holes: u32, around: u32, thick: f64) -> Model {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut quad = |p: [DVec3; 4]| {
        let base = positions.len() as u32;
        positions.extend(p);
        triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    };
    let rim = |i: u32, radius: f64| {
        let (s, c) = (TAU * f64::from(i) / f64::from(around)).sin_cos();
        DVec3::new(c * radius, s * radius, 0.0)
    };
    let border = |i: u32| {
        let p = rim(i, 1.0);
        p / p.abs().max_element()
    };
    for hole in 0..holes {
        let center = DVec3::new(2.0 * f64::from(hole % 5), 2.0 * f64::from(hole / 5), 0.0);
        let up = DVec3::Z * thick;
        for i in 0..around {
            let [a, b] = [i, i + 1].map(|i| center + rim(i, 0.5));
            let [c, d] = [i, i + 1].map(|i| center + border(i));
            quad([a + up, c + up, d + up, b + up]);
            quad([a, b, d, c]);
            quad([a, a + up, b + up, b]);
        }
    }
    model_of(positions, triangles)
}

fn landscape(triangles: u64) -> Model {
    let options = generate::LandscapeOptions { triangles, ..Default::default() };
    let landscape = generate::landscape(&options).expect("the default limits allow some million triangles");
    model_of(landscape.positions.iter().map(|p| p.as_dvec3()).collect(), landscape.triangles)
}

/// Needles around a hub, and a saddle: fans that are hard to lay flat.
fn needles() -> Model {
    let mut random = Random::new(3);
    let mut model = generate::icosphere(4);
    for p in &mut model.positions {
        let stretch = 1.0 + 4.0 * random.unit().powi(12);
        *p = DVec3::new(p.x * 12.0, p.y, p.z) * stretch;
    }
    model
}
