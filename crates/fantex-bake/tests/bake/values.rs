//! What was baked is what is read: constants, linear functions, waves, and tiles that are baked in blocks.

use std::f32::consts::TAU;

use crate::common::{
    Constant, OfPosition, baked, barycentric_points, cleaned, cover, data_folder, float_options, loaded,
    mesh_of, needles, rectangle, sample,
};
use fantex_bake::{Fidelity, Fit, SineSource, fidelity};
use fantex_cover::Cover;
use fantex_mesh::{Mesh, generate};
use fantex_store::{ChannelKind, PageCache};
use glam::{DVec3, Vec2, Vec3, Vec4};

const COLOR: Vec4 = Vec4::new(0.25, 0.5, 0.75, 0.625);
const EMISSION: Vec4 = Vec4::new(4.0, 0.03, 1.0, 1.0);

/// A constant comes back from everywhere, at every level: no texel that is read was left without a value.
#[track_caller]
fn assert_constant(name: &str, mesh: &Mesh, cover: &Cover, points: u32) {
    let source = Constant(vec![(ChannelKind::BaseColor, COLOR), (ChannelKind::Emission, EMISSION)]);
    let baked = baked(mesh, cover, &source, &float_options(Fit::Sharp));
    let levels = baked.cache.asset().level_count();
    let points = barycentric_points(points);
    for triangle in 0..mesh.triangles.len() {
        for &lambda in &points {
            for level in 0..levels {
                for (channel, expected) in [COLOR, EMISSION].into_iter().enumerate() {
                    let value = sample(&baked.cache, channel, level, triangle, lambda);
                    assert!(
                        (value - expected).abs().max_element() < 1e-5,
                        "{name}: {value} at triangle {triangle} {lambda}, level {level}"
                    );
                }
            }
        }
    }
    for group in 0..cover.groups.len() as u32 {
        let mean = Vec4::from_array(baked.cache.asset().mean(0, group));
        assert!((mean - COLOR).abs().max_element() < 1e-5, "{name}: mean {mean} of group {group}");
    }
}

#[test]
fn constants_on_known_shapes() {
    let shapes = [
        ("cube", cleaned(generate::cube(3))),
        ("icosphere", cleaned(generate::icosphere(3))),
        ("torus", cleaned(generate::torus(20, 12))),
        ("book", cleaned(generate::book(9))),
        ("triangle", mesh_of(vec![DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2]])),
        ("twins", mesh_of(vec![DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2], [0, 2, 1]])),
        (
            "acute",
            mesh_of(
                vec![DVec3::ZERO, DVec3::new(1.0, 0.02, 0.0), DVec3::new(1.0, -0.02, 0.0)],
                vec![[0, 1, 2]],
            ),
        ),
    ];
    for (name, mesh) in shapes {
        for (tile, texels) in [(0, 20_000), (64, 20_000), (256, 300_000)] {
            assert_constant(name, &mesh, &cover(&mesh, tile, texels), 23);
        }
    }
}

/// A star of acute triangles that stand apart, each alone in its tips.
#[test]
fn constants_on_acute_tips() {
    let n = 9;
    let mut positions = vec![DVec3::ZERO];
    positions.extend((0..2 * n).map(|i| {
        let (sin, cos) = (f64::from(i / 2) * 0.69 + f64::from(i % 2) * 0.04).sin_cos();
        DVec3::new(cos, sin, 0.01 * f64::from(i))
    }));
    let mesh = mesh_of(positions, (0..n as u32).map(|i| [0, 1 + 2 * i, 2 + 2 * i]).collect());
    for (tile, texels) in [(0, 5_000), (128, 50_000), (2048, 200_000), (2048, 1_000_000)] {
        assert_constant("star", &mesh, &cover(&mesh, tile, texels), 40);
    }
}

#[test]
fn constants_on_needles() {
    for width in [1e-2, 1e-4, 1e-7] {
        for (tile, texels) in [(0, 3_000), (64, 100_000), (0, 300_000)] {
            let mesh = needles(width);
            assert_constant(&format!("needles {width}"), &mesh, &cover(&mesh, tile, texels), 23);
        }
    }
}

#[test]
fn constants_on_difficult_models() {
    let Some(folder) = data_folder() else { return };
    for (name, points) in [
        ("meshes/broken/chair_model.obj", 5),
        ("meshes/mengerSponge3.glb", 4),
        ("meshes/broken/soup.stl", 12),
        ("meshes/suzanne.ply", 8),
        ("meshes/broken/wallhole.obj", 12),
        ("meshes/teapot.stl", 8),
    ] {
        let mesh = loaded(&folder, name);
        for (tile, texels) in [(0, 300_000), (64, 500_000)] {
            assert_constant(name, &mesh, &cover(&mesh, tile, texels), points);
        }
    }
}

/// Bilinear look-ups keep linear functions, and so does the fit.
#[test]
fn linear_functions_come_back_from_a_plane() {
    let linear = |p: Vec3| Vec4::new(0.5 + 0.3 * p.x - 0.2 * p.z, 0.5 + 0.4 * p.z, 0.2 - 0.1 * p.x, 1.0);
    let mesh = cleaned(generate::grid(6));
    for tile in [0, 64, 256] {
        for fit in [Fit::Sharp, Fit::Point] {
            let baked = baked(&mesh, &cover(&mesh, tile, 100_000), &OfPosition(linear), &float_options(fit));
            for triangle in 0..mesh.triangles.len() {
                let [a, b, c] = mesh.triangle_positions(triangle);
                for lambda in barycentric_points(9) {
                    let value = sample(&baked.cache, 0, 0, triangle, lambda);
                    let expected = linear(a * lambda.x + b * lambda.y + c * lambda.z);
                    assert!(
                        (value - expected).abs().max_element() < 2e-5,
                        "{value} for {expected}, tile {tile}"
                    );
                }
            }
        }
    }
}

fn wave_fidelity(mesh: &Mesh, cover: &Cover, wavelength: f64, fit: Fit) -> Fidelity {
    let texel = (mesh.area() / cover.texels() as f64).sqrt();
    let source = SineSource { k: TAU / (wavelength * texel) as f32 };
    let baked = baked(mesh, cover, &source, &float_options(fit));
    fidelity(&baked.cache, 60_000, 7, &|p| source.value(p))
}

#[test]
fn the_sharp_fit_beats_point_samples_by_decibels() {
    let mut meshes =
        vec![("icosphere", cleaned(generate::icosphere(5))), ("torus", cleaned(generate::torus(96, 48)))];
    if let Some(folder) = data_folder() {
        meshes.push(("bunny", loaded(&folder, "meshes/bunny/stanford_bunny.ply")));
    }
    for (name, mesh) in meshes {
        let cover = cover(&mesh, 128, 1_400_000);
        let [sharp, point] = [Fit::Sharp, Fit::Point].map(|fit| wave_fidelity(&mesh, &cover, 16.0, fit));
        eprintln!("{name}: sharp {:.1} dB, point {:.1} dB", sharp.psnr_db, point.psnr_db);
        assert!(sharp.psnr_db > 55.0, "{name}: {sharp:?}");
        assert!(sharp.psnr_db > point.psnr_db + 6.0, "{name}: {sharp:?} {point:?}");
    }
}

/// The texels of a flat tile that lie on the surface, with their position.
fn flat_texels(cover: &Cover, group: usize, step: usize) -> Vec<([u32; 2], Vec3)> {
    let shape = &cover.groups[group];
    let extent = Vec2::new(shape.extent[0] as f32, shape.extent[1] as f32);
    (0..shape.extent[1])
        .flat_map(|y| (0..shape.extent[0]).map(move |x| [x, y]))
        .filter(|[x, y]| {
            // All of the texels around the borders between blocks, some of the others.
            let near = |c: u32| c % 1024 < 20 || c % 1024 > 1004;
            near(*x) || near(*y) || (x + 7 * y).is_multiple_of(step as u32)
        })
        .map(|[x, y]| {
            let uv = (Vec2::new(x as f32, y as f32) + 0.5) / extent;
            let q = (uv - shape.uv_offset) / shape.uv_scale;
            ([x, y], shape.frame.origin + shape.frame.x_axis * q.x + shape.frame.y_axis() * q.y)
        })
        .collect()
}

fn texel(cache: &PageCache, group: usize, level: u32, [x, y]: [u32; 2]) -> Vec4 {
    Vec4::from_array(cache.tile(0, group as u32, level).texel(x, y))
}

/// Tiles longer than a block give what direct evaluation gives: no border between blocks, at no level.
#[track_caller]
fn assert_blocks_are_seamless(mesh: &Mesh, texels: u64) -> Vec<[u32; 2]> {
    let cover = cover(mesh, 1 << 16, texels);
    let wave = SineSource { k: 40.0 };
    let value = OfPosition(|p| Vec4::splat(wave.value(p)));
    let point = baked(mesh, &cover, &value, &float_options(Fit::Point)).cache;
    let sharp = baked(mesh, &cover, &value, &float_options(Fit::Sharp)).cache;
    for (group, shape) in cover.groups.iter().enumerate() {
        let inner = |c: [u32; 2], n: [u32; 2]| (0..2).all(|k| c[k] > 0 && c[k] + 1 < n[k]);
        for (at, p) in flat_texels(&cover, group, 101) {
            let expected = wave.value(p);
            assert!((texel(&point, group, 0, at).x - expected).abs() < 1e-4, "{at:?} of {:?}", shape.extent);
            if inner(at, shape.extent) {
                let [x, y] = at;
                let around = [[x - 1, y], [x + 1, y], [x, y - 1], [x, y + 1]];
                let sum: f32 = around.into_iter().map(|n| texel(&point, group, 0, n).x).sum();
                let center = texel(&point, group, 0, at).x;
                let fitted = center - (sum - 4.0 * center) / 12.0;
                assert!(
                    (texel(&sharp, group, 0, at).x - fitted).abs() < 1e-5,
                    "{at:?} of {:?}",
                    shape.extent
                );
            }
        }
        for level in 1..shape.level_count() {
            let (fine, coarse) = (shape.level_extent(level - 1), shape.level_extent(level));
            let mean_of = |x: u32, y: u32| {
                let (mut sum, mut area) = (0.0, 0.0);
                let range = |k: usize, c: u32| {
                    let ratio = f64::from(fine[k]) / f64::from(coarse[k]);
                    (f64::from(c) * ratio, f64::from(c + 1) * ratio)
                };
                let ((x0, x1), (y0, y1)) = (range(0, x), range(1, y));
                let weight = |i: u32, low: f64, high: f64| {
                    (high.min(f64::from(i) + 1.0) - low.max(f64::from(i))).max(0.0)
                };
                for j in y0 as u32..(y1.ceil() as u32).min(fine[1]) {
                    for i in x0 as u32..(x1.ceil() as u32).min(fine[0]) {
                        let w = weight(i, x0, x1) * weight(j, y0, y1);
                        sum += w * f64::from(texel(&point, group, level - 1, [i, j]).x);
                        area += w;
                    }
                }
                sum / area
            };
            let stride = (coarse[0] * coarse[1] / 3000 + 1) as usize;
            let all = (0..coarse[1]).flat_map(|y| (0..coarse[0]).map(move |x| (x, y)));
            for (x, y) in all.step_by(stride) {
                let found = f64::from(texel(&point, group, level, [x, y]).x);
                assert!((found - mean_of(x, y)).abs() < 1e-5, "level {level} of {:?}, {x} {y}", shape.extent);
            }
        }
    }
    cover.groups.iter().map(|g| g.extent).collect()
}

#[test]
fn large_tiles_have_no_borders_between_blocks() {
    let extents = assert_blocks_are_seamless(&rectangle(2.0, 1.1), 3_200_000);
    assert!(extents.len() == 1 && extents[0].into_iter().all(|n| n > 1024), "{extents:?}");
}

#[test]
fn long_tiles_are_cut_along_their_length_only() {
    for (height, texels) in [(0.1, 600_000), (0.4, 2_000_000)] {
        let extents = assert_blocks_are_seamless(&rectangle(1.0, height), texels);
        let [longer, shorter] =
            [extents[0].into_iter().max().unwrap(), extents[0].into_iter().min().unwrap()];
        assert!(extents.len() == 1 && longer > 2048 && shorter <= 1024, "{extents:?}");
    }
}

/// A large tile with holes and slopes in it: constants and waves through the texture function.
#[test]
fn a_coarse_cube_under_a_large_texture() {
    let mesh = cleaned(generate::cube(1));
    let cover = cover(&mesh, 0, 16 << 20);
    assert!(
        cover.groups.iter().any(|g| g.extent.into_iter().all(|n| n > 1024)),
        "{:?}",
        cover.groups[0].extent
    );
    assert_constant("cube", &mesh, &cover, 60);
}
