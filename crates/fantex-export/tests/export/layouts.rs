//! Model coordinates that do not fit.

use fantex_bake::{BakeFormat, NoProgress};
use fantex_export::{ExportError, ExportOptions, UvChoice, export_model};
use fantex_mesh::generate::{cube, icosphere};
use fantex_mesh::{Mesh, Model};
use glam::{DVec3, Vec2};

use crate::support::{Waves, baked, cleaned, loaded, worst_psnr_db};

/// A cube each of whose sides fills a repeated picture or the same unit square.
fn with_uv(mut model: Model, scale: f32) -> Mesh {
    let uv = model.triangles.iter().flat_map(|t| {
        let [a, b, c] = t.map(|v| model.positions[v as usize]);
        let normal = (b - a).cross(c - a).abs();
        let flat = |p: DVec3| match normal.max_position() {
            0 => Vec2::new(p.y as f32, p.z as f32),
            1 => Vec2::new(p.x as f32, p.z as f32),
            _ => Vec2::new(p.x as f32, p.y as f32),
        };
        [a, b, c].map(|p| (flat(p) * 0.5 + 0.5) * scale)
    });
    model.corners.uv_sets = vec![uv.collect()];
    cleaned(model)
}

#[test]
fn overlapping_coordinates_are_reported() {
    let baked = baked(&with_uv(cube(2), 1.0), &Waves::color(3.0), 1 << 14, BakeFormat::Rgba8);
    let options = ExportOptions { uv: UvChoice::OfAsset, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &baked.path("x.glb"), &options, &NoProgress).unwrap();
    assert!(summary.overlapping_share > 0.9, "{summary:?}");
}

#[test]
fn coordinates_beyond_one_repeat() {
    let mut model = cube(2);
    model.triangles.truncate(8);
    // One side, moved by three pictures: nothing overlaps.
    let mut mesh = with_uv(model, 0.9);
    mesh.corners.uv_sets[0].iter_mut().for_each(|uv| *uv += Vec2::new(2.3, -1.0));
    let baked = baked(&mesh, &Waves::color(3.0), 1 << 16, BakeFormat::Rgba8);
    let path = baked.path("x.glb");
    let options = ExportOptions { uv: UvChoice::OfAsset, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    assert!(summary.overlapping_share < 0.02, "{summary:?}");
    let db = worst_psnr_db(&baked.asset, &path);
    assert!(db > 38.0, "{db} dB");
}

#[test]
fn another_models_coordinates_are_taken_where_its_triangles_are_the_same() {
    let bare = cleaned(cube(3));
    let baked = baked(&bare, &Waves::color(3.0), 1 << 14, BakeFormat::Rgba8);
    let path = baked.path("x.glb");
    let refused = export_model(
        &baked.asset,
        &path,
        &ExportOptions { uv: UvChoice::OfAsset, ..ExportOptions::default() },
        &NoProgress,
    );
    assert!(matches!(refused, Err(ExportError::NoUv)));
    // The same cube, its triangles in another order and turned.
    let mut other = cube(3);
    other.triangles.reverse();
    other.triangles.iter_mut().for_each(|t| t.rotate_left(1));
    let other = with_uv(other, 1.0);
    let options = ExportOptions { uv: UvChoice::OfModel(&other), ..ExportOptions::default() };
    export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    let expected = with_uv(cube(3), 1.0);
    assert_eq!(loaded(&path).corners.uv_sets[0], expected.corners.uv_sets[0]);
    let wrong = with_uv(icosphere(1), 1.0);
    let options = ExportOptions { uv: UvChoice::OfModel(&wrong), force: true, ..ExportOptions::default() };
    let refused = export_model(&baked.asset, &path, &options, &NoProgress);
    assert!(matches!(refused, Err(ExportError::OtherModel { triangle: 0 })));
}
