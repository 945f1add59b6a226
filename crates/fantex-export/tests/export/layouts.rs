//! Texture coordinates: the model's, also those that do not fit, and what lies at the own ones.

use std::sync::Arc;

use fantex_bake::{BakeFormat, NoProgress, sample_finest};
use fantex_export::{ChannelMap, Depth, ExportError, ExportOptions, UvChoice, export_channel, export_model};
use fantex_mesh::generate::{cube, icosphere};
use fantex_mesh::{Mesh, Model};
use fantex_store::PageCache;
use fantex_texture::{ColorSpace, Image, Samples};
use glam::{DVec3, Vec2, Vec3};

use crate::support::{Waves, baked, cleaned, opened, worst_psnr_db};

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
    assert_eq!(opened(&path).corners.uv_sets[0], expected.corners.uv_sets[0]);
    let wrong = with_uv(icosphere(1), 1.0);
    let options = ExportOptions { uv: UvChoice::OfModel(&wrong), force: true, ..ExportOptions::default() };
    let refused = export_model(&baked.asset, &path, &options, &NoProgress);
    assert!(matches!(refused, Err(ExportError::OtherModel { triangle: 0 })));
}

/// Samples of the surface through the exported picture against the asset's texture function: no renderer between, no
/// coarser levels, the same density, and detail near what the density holds.
#[test]
fn pictures_hold_the_texture_function_at_equal_density() {
    let mesh = cleaned(icosphere(4));
    let texels = 190_000u64;
    let density = (texels as f64 / mesh.area()).sqrt() as f32;
    for (wavelength, least_db) in [(16.0, 50.0), (8.0, 38.0)] {
        let baked = baked(
            &mesh,
            &Waves::color(std::f32::consts::TAU * density / wavelength),
            texels,
            BakeFormat::Float,
        );
        let (model, picture) = (baked.path("x.glb"), baked.path("x.exr"));
        let options = ExportOptions { side: Some(512), padding: Some(4), ..ExportOptions::default() };
        let summary = export_model(&baked.asset, &model, &options, &NoProgress).unwrap();
        assert!((0.8..1.1).contains(&summary.density_share), "{summary:?}");
        export_channel(&baked.asset, ChannelMap::BaseColor, Depth::Eight, &picture, &options, &NoProgress)
            .unwrap();
        let image = Image::load_as(&picture, ColorSpace::Linear).unwrap();
        let Samples::F32(samples) = &image.samples else { panic!("floats") };
        let texel = |x: u32, y: u32| samples[3 * (y.min(511) * 512 + x.min(511)) as usize];
        let back = opened(&model);
        let cache = PageCache::new(Arc::clone(&baked.asset), 64 << 20);
        let (mut squares, mut count) = (0.0, 0.0);
        for t in 0..mesh.triangles.len() {
            assert!(back.triangle_positions(t)[0].distance(mesh.triangle_positions(t)[0]) < 1e-6);
            for lambda in [[0.8, 0.1, 0.1], [0.05, 0.9, 0.05], [0.02, 0.49, 0.49], [0.33, 0.33, 0.34]] {
                let lambda = Vec3::from(lambda);
                let uv = &back.corners.uv_sets[0][3 * t..3 * t + 3];
                let at = (uv[0] * lambda.x + uv[1] * lambda.y + uv[2] * lambda.z) * 512.0 - 0.5;
                let (x, y, f) = (at.x as u32, at.y as u32, at.fract());
                let row = |y| texel(x, y) * (1.0 - f.x) + texel(x + 1, y) * f.x;
                let read = row(y) * (1.0 - f.y) + row(y + 1) * f.y;
                let truth = sample_finest(&cache, 0, t, lambda).0.x;
                squares += f64::from(read - truth).powi(2);
                count += 1.0;
            }
        }
        let db = -10.0 * (squares / count).log10();
        eprintln!(
            "wavelength of {wavelength} texels, {:.2} of the density: {db:.1} dB",
            summary.density_share
        );
        assert!(db > least_db, "{db} dB at a wavelength of {wavelength} texels");
    }
}
