//! Triangles are cut before covering where that makes textures sharper, and nowhere else.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use fantex::LongestEdge;
use fantex_cover::{CoverOptions, CoverStats, TexelBudget, build_cover};
use fantex_mesh::generate::{cube, grid, icosphere, torus, uv_sphere};
use fantex_mesh::{Mesh, Model};
use fantex_test::cleaned;
use glam::DVec3;

const TEXELS: u64 = 1_000_000;

fn automatic(mesh: &Mesh) -> Mesh {
    LongestEdge::Automatic.refined(mesh, &TexelBudget::Total(TEXELS), 1024).into_owned()
}

fn loss(mesh: &Mesh) -> f64 {
    let options = CoverOptions { budget: TexelBudget::Total(TEXELS), ..CoverOptions::default() };
    let (_, CoverStats { loss_db, .. }) = build_cover(mesh, &options).unwrap();
    loss_db
}

/// Thin, flat slabs that stand apart.
fn slabs() -> Model {
    let mut slabs = Model::default();
    let slab = cube(1);
    for number in 0..24_u32 {
        let first = slabs.positions.len() as u32;
        let size = DVec3::new(1.0, 0.05 + 0.01 * f64::from(number), 0.3);
        let place = DVec3::new(3.0 * f64::from(number), 0.0, 0.0);
        slabs.positions.extend(slab.positions.iter().map(|p| *p * size + place));
        slabs.triangles.extend(slab.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    slabs
}

#[test]
fn boxes_gain_what_cuts_can_gain() {
    for (name, model, gain) in [("cube", cube(1), 1.8), ("slabs", slabs(), 0.8)] {
        let mesh = cleaned(model);
        let cut = automatic(&mesh);
        assert!(cut.triangles.len() > mesh.triangles.len() && cut.triangles.len() <= 64_000, "{name}");
        assert!((cut.area() / mesh.area() - 1.0).abs() < 1e-5, "{name}");
        // Painters know an asset of a model by these.
        assert!(cut.positions.starts_with(&mesh.positions), "{name}");
        let (whole, cut) = (loss(&mesh), loss(&cut));
        assert!(cut < whole - gain, "{name}: {whole} dB whole, {cut} dB cut");
    }
}

#[test]
fn no_model_loses_by_cuts_that_nobody_asked_for() {
    let models = [
        icosphere(0),
        icosphere(2),
        icosphere(4),
        uv_sphere(12, 6),
        torus(24, 8),
        grid(1),
        grid(30),
        cube(7),
    ];
    for (number, model) in models.into_iter().enumerate() {
        let mesh = cleaned(model);
        let cut = automatic(&mesh);
        if cut.triangles.len() > mesh.triangles.len() {
            assert!(loss(&cut) < loss(&mesh) - 0.5, "model {number}");
        } else {
            assert_eq!(cut.triangles, mesh.triangles, "model {number}");
        }
    }
}

#[test]
fn nothing_is_cut_where_there_is_one_fan_per_tile_or_where_that_was_asked_for() {
    let mesh = cleaned(cube(1));
    for (longest_edge, tile) in
        [(LongestEdge::Automatic, 0), (LongestEdge::Texels(16), 0), (LongestEdge::Texels(0), 1024)]
    {
        assert_eq!(longest_edge.refined(&mesh, &TexelBudget::Total(TEXELS), tile).triangles, mesh.triangles);
    }
    let cut = LongestEdge::Texels(64).refined(&mesh, &TexelBudget::Total(TEXELS), 1024).into_owned();
    assert!(cut.triangles.len() > 100);
}
