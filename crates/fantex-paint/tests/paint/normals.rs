//! Normals are moved as directions on the surface, whatever frame their tile has.

use crate::common::{cleaned, cover};
use fantex_bake::{
    BakeFormat, BakeOptions, NoProgress, Prefilter, Source, SourceChannel, SurfacePoint, bake,
};
use fantex_mesh::{generate, shading_normals};
use fantex_paint::{PaintOptions, Painter, StrokeFile, replay};
use fantex_store::{Asset, ChannelKind, PageCache};
use fantex_texture::Image;
use glam::{Vec3, Vec4};

/// A flat normal map.
struct Flat;

impl Source for Flat {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::Normal, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        values[0] = point.normal.extend(1.0);
    }
}

/// The part of the normal along the surface, mesh space, by each tile that shows a point.
fn tangents(cache: &PageCache, normals: &[Vec3], triangle: usize, lambda: Vec3) -> Vec<Vec3> {
    let (mesh, cover) = (cache.asset().mesh(), cache.asset().cover());
    let corners = [0, 1, 2].map(|k| normals[3 * triangle + k]);
    let normal = (corners[0] * lambda.x + corners[1] * lambda.y + corners[2] * lambda.z).normalize();
    let tangent = |slot: usize| {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = a * lambda.x + b * lambda.y + c * lambda.z;
        let group = cover.corner_groups[triangle][slot];
        let [x, y, ..] = cache.bilinear(0, group, 0, uv);
        let [x_axis, y_axis] = cover.groups[group as usize].shading_axes(normal);
        x_axis * (2.0 * x - 1.0) + y_axis * (2.0 * y - 1.0)
    };
    cover.weights(triangle, lambda).iter().map(|(slot, _)| tangent(slot)).collect()
}

#[test]
fn tiles_agree_on_normals_that_are_laid_and_moved() {
    let mesh = cleaned(generate::icosphere(4));
    let cover = cover(&mesh, 48, 200_000);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let options = BakeOptions { format: BakeFormat::Float, ..BakeOptions::default() };
    bake(&mesh, &cover, &Flat, &path, &options, &NoProgress).unwrap();
    // Leaning to the right by half.
    let texels = vec![[0.75, 0.5, 1.0, 1.0]; 64];
    Image::from_linear_rgba(8, 8, &texels).save(folder.path().join("lean.exr")).unwrap();
    let text = r#"{ "version": 1, "strokes": [
        { "decal": { "size": { "world": 0.9 } }, "channels": [{ "kind": "normal", "color": { "image": "lean.exr" } }],
          "samples": [{ "at": { "position": [0, 0, 1] } }] },
        { "tool": { "smudge": { "strength": 0.9 } }, "brush": { "size": { "world": 0.4 } }, "channels": [{ "kind": "normal" }],
          "samples": [{ "at": { "position": [0, 0, 1] } }, { "at": { "position": [0.8, 0, 0.6] } }] },
        { "tool": { "blur": { "radius": { "world": 0.02 } } }, "brush": { "size": { "world": 0.6 } },
          "channels": [{ "kind": "normal" }], "samples": [{ "at": { "position": [0, 0.2, 1] } }] }] }"#;
    let file: StrokeFile = serde_json::from_str(text).unwrap();
    let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
    replay(&mut painter, &file, folder.path()).unwrap();
    painter.commit().unwrap();
    let cache = PageCache::new(std::sync::Arc::new(Asset::open(&path).unwrap()), 1 << 26);
    let normals = shading_normals(&mesh);
    let (mut overlaps, mut leaning, mut apart) = (0, 0, 0);
    for triangle in 0..mesh.triangles.len() {
        for lambda in [Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.1, 0.46, 0.44), Vec3::splat(1.0 / 3.0)] {
            let [a, b, c] = mesh.triangle_positions(triangle);
            let position = a * lambda.x + b * lambda.y + c * lambda.z;
            let parts = tangents(&cache, &normals, triangle, lambda);
            let inside = position.z > 0.93;
            for part in &parts {
                overlaps += usize::from(parts.len() > 1);
                apart += usize::from(part.distance(parts[0]) > 0.02);
                leaning += usize::from(inside);
                let right = Vec3::new(position.z, 0.0, -position.x).normalize();
                assert!(!inside || part.distance(right * 0.5) < 0.08, "{part} at {position}");
            }
        }
    }
    assert!(overlaps > 500 && leaning > 100, "{overlaps} {leaning}");
    assert!(apart * 50 < overlaps, "{apart} of {overlaps} differ");
    let back = tangents(
        &cache,
        &normals,
        painter.surface().nearest(Vec3::NEG_Z, 1.0).unwrap().triangle as usize,
        Vec3::splat(1.0 / 3.0),
    );
    assert!(back.iter().all(|part| part.length() < 0.01), "the back stays flat: {back:?}");
}
