//! How long large files take to write and to load: `cargo run --release -p fantex-mesh --example load_speed`.

#![allow(clippy::unwrap_used, reason = "a step that fails ends the measurement")]

use std::time::Instant;

use fantex_mesh::{LoadOptions, WriteGeometry, load, write_model};
use glam::{DVec3, Vec4};

/// A wavy grid of `2 * side^2` triangles.
fn grid(side: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let row = side + 1;
    let position = |i: u32| {
        let (x, y) = (f64::from(i % row) / f64::from(side), f64::from(i / row) / f64::from(side));
        DVec3::new(x, y, 0.1 * (20.0 * x).sin() * (13.0 * y).cos()).as_vec3().as_dvec3()
    };
    let cell = |i: u32| {
        let a = i / side * row + i % side;
        [[a, a + 1, a + row], [a + 1, a + row + 1, a + row]]
    };
    ((0..row * row).map(position).collect(), (0..side * side).flat_map(cell).collect())
}

fn main() {
    let folder = tempfile::tempdir().unwrap();
    let (positions, triangles) = grid(1000);
    let colors: Vec<Vec4> = positions.iter().map(|p| p.as_vec3().extend(1.0)).collect();
    for (name, colors) in
        [("a.ply", None), ("colors.ply", Some(&colors[..])), ("a.glb", None), ("a.obj", None)]
    {
        let path = folder.path().join(name);
        let geometry = WriteGeometry { positions: &positions, triangles: &triangles, colors };
        let start = Instant::now();
        write_model(&path, &geometry, false).unwrap();
        let write_secs = start.elapsed().as_secs_f64();
        let bytes = std::fs::metadata(&path).unwrap().len();
        let load_secs: Vec<f64> = (0..5)
            .map(|_| {
                let start = Instant::now();
                let model = load(&path, &LoadOptions::default()).unwrap();
                let elapsed = start.elapsed().as_secs_f64();
                assert_eq!(model.triangles.len(), triangles.len());
                elapsed
            })
            .collect();
        let best = load_secs.iter().copied().fold(f64::MAX, f64::min);
        println!(
            "{name}: {} triangles, {} MB, written in {write_secs:.3} s, loaded in {best:.3} s",
            triangles.len(),
            bytes >> 20
        );
    }
}
