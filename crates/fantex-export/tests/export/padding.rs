//! What detail levels of other programs read beside the pieces.

use std::sync::Arc;

use fantex_bake::{BakeFormat, NoProgress, sample_finest};
use fantex_export::{ChannelMap, Depth, ExportOptions, export_channel, export_model};
use fantex_mesh::generate::icosphere;
use fantex_store::PageCache;
use fantex_texture::{ColorSpace, Image, Samples};
use glam::{Vec2, Vec3};

use crate::support::{Waves, baked, cleaned, opened};

/// Level `l` of a grey picture as the mean of 2 x 2 texels, again and again.
fn halved(texels: &[f32], side: usize) -> Vec<f32> {
    let at = |x: usize, y: usize| texels[y * side + x];
    let mean = |i: usize| {
        let (x, y) = (2 * (i % (side / 2)), 2 * (i / (side / 2)));
        0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
    };
    (0..side * side / 4).map(mean).collect()
}

fn bilinear(texels: &[f32], side: usize, uv: Vec2) -> f32 {
    let p = (uv * side as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(side as f32 - 1.0));
    let (x, y) = (p.x as usize, p.y as usize);
    let at = |x: usize, y: usize| texels[y.min(side - 1) * side + x.min(side - 1)];
    let (fx, fy) = (p.x.fract(), p.y.fract());
    let row = |y| at(x, y) * (1.0 - fx) + at(x + 1, y) * fx;
    row(y) * (1.0 - fy) + row(y + 1) * fy
}

/// The sphere whose pieces are numbered: every corner's piece, by connected texture coordinates.
fn pieces(mesh: &fantex_mesh::Mesh) -> Vec<u32> {
    let uv = &mesh.corners.uv_sets[0];
    let mut parents: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    fn root(parents: &mut [u32], mut i: u32) -> u32 {
        while parents[i as usize] != i {
            i = parents[i as usize];
        }
        i
    }
    let mut seen = std::collections::BTreeMap::new();
    for (corner, uv) in uv.iter().enumerate() {
        let t = corner as u32 / 3;
        let first = *seen.entry([uv.x.to_bits(), uv.y.to_bits()]).or_insert(t);
        let (a, b) = (root(&mut parents, first), root(&mut parents, t));
        parents[a.max(b) as usize] = a.min(b);
    }
    (0..parents.len() as u32).map(|t| root(&mut parents, t)).collect()
}

#[test]
fn no_foreign_texel_is_read_down_to_the_level_that_is_promised() {
    let baked = baked(&cleaned(icosphere(3)), &Waves::color(2.0), 1 << 18, BakeFormat::Rgba8);
    let path = baked.path("x.glb");
    let options = ExportOptions { side: Some(1024), padding: Some(16), ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    assert!(summary.charts > 3 && summary.padding == 16, "{summary:?}");
    let mesh = opened(&path);
    let pieces = pieces(&mesh);
    let side = 1024usize;
    let uv = &mesh.corners.uv_sets[0];
    let mut numbers: Vec<u32> = pieces.clone();
    numbers.sort_unstable();
    numbers.dedup();
    assert_eq!(numbers.len(), summary.charts);
    let owner = nearest_pieces(&mesh, &pieces, side);
    for &piece in &numbers {
        let mut level: Vec<f32> = owner.iter().map(|&o| f32::from(u8::from(o == piece))).collect();
        let mut level_side = side;
        for _ in 0..5 {
            for (t, _) in pieces.iter().enumerate().filter(|(_, p)| **p == piece) {
                for k in 0..3 {
                    let (a, b) = (uv[3 * t + k], uv[3 * t + (k + 1) % 3]);
                    for share in [0.0, 0.3, 0.6] {
                        let read = bilinear(&level, level_side, a.lerp(b, share));
                        assert!(read > 0.999, "piece {piece} reads {read} at {level_side} columns");
                    }
                }
            }
            level = halved(&level, level_side);
            level_side /= 2;
        }
    }
}

/// For every texel the piece whose block of 16 x 16 texels it lies in: that of any of its texels within 8 of a triangle.
fn nearest_pieces(mesh: &fantex_mesh::Mesh, pieces: &[u32], side: usize) -> Vec<u32> {
    let uv = &mesh.corners.uv_sets[0];
    let blocks = side / 16;
    let mut owner = vec![u32::MAX; blocks * blocks];
    for (t, &piece) in pieces.iter().enumerate() {
        // Points of the triangle, closer together than a texel, and what lies half a block around them.
        let corners = [0, 1, 2].map(|k| uv[3 * t + k] * side as f32);
        let steps = 96;
        for i in 0..=steps {
            for j in 0..=(steps - i) {
                let (s, r) = (i as f32 / steps as f32, j as f32 / steps as f32);
                let p = corners[0] * (1.0 - s - r) + corners[1] * s + corners[2] * r;
                for d in [[-7.9, -7.9], [7.9, -7.9], [-7.9, 7.9], [7.9, 7.9]] {
                    let block = ((p + Vec2::from(d)) / 16.0).floor().as_uvec2();
                    let owner = &mut owner[block.y as usize * blocks + block.x as usize];
                    assert!(*owner == u32::MAX || *owner == piece, "two pieces claim a block");
                    *owner = piece;
                }
            }
        }
    }
    (0..side * side).map(|i| owner[i / side / 16 * blocks + i % side / 16]).collect()
}

#[test]
fn borders_keep_their_colours_at_every_level_that_is_promised() {
    let mesh = cleaned(icosphere(3));
    let baked = baked(&mesh, &Waves::color(2.0), 1 << 18, BakeFormat::Float);
    let (model, picture) = (baked.path("x.glb"), baked.path("x.exr"));
    let side = 1024usize;
    let options = ExportOptions { side: Some(side as u32), padding: Some(16), ..ExportOptions::default() };
    export_model(&baked.asset, &model, &options, &NoProgress).unwrap();
    export_channel(&baked.asset, ChannelMap::BaseColor, Depth::Eight, &picture, &options, &NoProgress)
        .unwrap();
    let image = Image::load_as(&picture, ColorSpace::Linear).unwrap();
    let Samples::F32(samples) = &image.samples else { panic!("floats") };
    let mut level: Vec<f32> = samples.as_chunks::<3>().0.iter().map(|t| t[0]).collect();
    // Nothing is left empty.
    assert!(level.iter().all(|&red| red > 0.05));
    let uv = &opened(&model).corners.uv_sets[0];
    let cache = PageCache::new(Arc::clone(&baked.asset), 64 << 20);
    let mut level_side = side;
    // The colours go from 0.1 to 0.9 and change by 0.8 per mesh unit, over which there are about 150 texels: a texel of the
    // last level is a tenth of a unit long. A foreign or an empty texel would be off by several tenths.
    for tolerance in [0.004, 0.008, 0.016, 0.035, 0.07] {
        for t in 0..mesh.triangles.len() {
            for (k, lambda) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
                let truth = sample_finest(&cache, 0, t, lambda).0.x;
                let off = (bilinear(&level, level_side, uv[3 * t + k]) - truth).abs();
                assert!(
                    off < tolerance,
                    "corner {k} of triangle {t} at {level_side} columns is off by {off}"
                );
            }
        }
        level = halved(&level, level_side);
        level_side /= 2;
    }
}
