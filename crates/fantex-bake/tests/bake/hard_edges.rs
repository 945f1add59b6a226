//! Textures that are cut at hard edges, as asked: sharper there, and continuous everywhere else.

use fantex_bake::{BakeFormat, Fit, Prefilter, SineSource, Source, SourceChannel, TexelPoint, fidelity};
use fantex_cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{Edges, HardEdges, Mesh, SurfacePoint, generate};
use fantex_store::{ChannelKind, Footprint, Sampler, VerifyOptions, VerifyReport, verify};
use fantex_texture::FilterOptions;
use glam::{DVec3, Vec3, Vec4};

use crate::common::{Baked, baked, cleaned, float_options, mesh_of};

fn covered(mesh: &Mesh, tile: u32, texels: u64, hard_edges: Option<f32>) -> Cover {
    let budget = TexelBudget::Total(texels);
    build_cover(mesh, &CoverOptions { tile, budget, hard_edges, ..CoverOptions::default() }).unwrap().0
}

fn waves(mesh: &Mesh, cover: &Cover, k: f32) -> Baked {
    baked(mesh, cover, &SineSource { k }, &float_options(Fit::Sharp))
}

fn verified(baked: &Baked) -> VerifyReport {
    let report = verify(&baked.path, &VerifyOptions { texels: true, ..VerifyOptions::default() }).unwrap();
    assert!(report.ok, "{report:?}");
    assert!(report.continuity.largest_jump < 1e-6, "{:?}", report.continuity);
    report
}

/// Steps of different heights, each of one square cell, closed at the sides and below.
fn terraces(cells: u32) -> Mesh {
    let height = |x: u32, y: u32| 1 + (3 * x + 5 * y + x * y) % 4;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut quad = |corners: [[u32; 3]; 4]| {
        let first = positions.len() as u32;
        positions.extend(corners.map(|[x, y, z]| DVec3::new(f64::from(x), f64::from(y), 0.5 * f64::from(z))));
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    };
    let is_inside = |x: u32, y: u32| x < cells && y < cells;
    for (x, y) in (0..cells).flat_map(|y| (0..cells).map(move |x| (x, y))) {
        let around = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
        let own = height(x, y);
        quad(around.map(|[x, y]| [x, y, own]));
        let [a, b, c, d] = around.map(|[x, y]| [x, y, 0]);
        quad([d, c, b, a]);
        let beside = [[x, y.wrapping_sub(1)], [x + 1, y], [x, y + 1], [x.wrapping_sub(1), y]];
        for (k, [u, v]) in beside.into_iter().enumerate() {
            let low = if is_inside(u, v) { height(u, v) } else { 0 };
            // In layers, so that walls meet in whole edges.
            for z in low..own {
                let ([ax, ay], [bx, by]) = (around[k], around[(k + 1) % 4]);
                quad([[ax, ay, z], [bx, by, z], [bx, by, z + 1], [ax, ay, z + 1]]);
            }
        }
    }
    mesh_of(positions, triangles)
}

#[test]
fn a_cube_is_cut_at_its_twelve_edges() {
    let mesh = cleaned(generate::cube(1));
    for (degrees, cut) in [(0.0, 18), (60.0, 12), (90.0, 12), (91.0, 0), (180.0, 0)] {
        for tile in [0, 256] {
            let asset = waves(&mesh, &covered(&mesh, tile, 60_000, Some(degrees)), 12.0);
            assert_eq!(asset.cache.asset().cover().hard_edges, Some(degrees));
            let found = verified(&asset).continuity;
            let whole = 18 - cut;
            assert_eq!((found.exempt.hard, found.exempt_edges, found.edges), (cut, cut, whole), "{degrees}");
            // That of a tile is 0.002.
            assert!((found.largest_hard_jump > 0.0) == (cut > 0) && found.largest_hard_jump < 0.01);
        }
    }
    let whole = verified(&waves(&mesh, &covered(&mesh, 256, 20_000, None), 12.0)).continuity;
    assert_eq!((whole.exempt_edges, whole.edges), (0, 18));
}

/// No tile has triangles on both sides of a hard edge.
#[test]
fn no_tile_lies_across_a_hard_edge() {
    let mesh = terraces(6);
    let cover = covered(&mesh, 1024, 60_000, Some(60.0));
    let hard = HardEdges::of(&mesh, 60.0);
    let mut count = 0;
    for edge in Edges::of(&mesh.triangles).iter() {
        let ends = edge.vertices();
        for pair in edge.continued_by_angle(&mesh.positions) {
            let triangles = pair.map(|half_edge| half_edge / 3);
            let groups = triangles.map(|t| {
                let at = |v: u32| mesh.triangles[t as usize].iter().position(|&w| w == v).unwrap();
                ends.map(|v| cover.corner_groups[t as usize][at(v)])
            });
            if hard.is_hard(triangles, ends) {
                assert!(groups[0].iter().all(|group| !groups[1].contains(group)), "{ends:?}");
                count += 1;
            } else {
                assert_eq!(groups[0], groups[1], "{ends:?}");
            }
        }
    }
    assert_eq!(verified(&waves(&mesh, &cover, 20.0)).continuity.exempt.hard, count);
}

/// What is smooth in space has a kink where a tile is laid over an edge.
#[test]
fn models_of_flat_faces_are_sharper() {
    for (name, mesh, texels) in
        [("cube", cleaned(generate::cube(6)), 30_000), ("terraces", terraces(8), 150_000)]
    {
        let ideal_texel = (mesh.area() / texels as f64).sqrt();
        let k = (std::f64::consts::TAU / (16.0 * ideal_texel)) as f32;
        let [whole, cut] = [None, Some(60.0)].map(|degrees| {
            let cover = covered(&mesh, 1024, texels, degrees);
            let stored = cover.stored_texels(&mesh);
            assert!(stored <= texels && stored > texels * 98 / 100, "{name}: {stored}");
            let asset = waves(&mesh, &cover, k);
            fidelity(&asset.cache, 40_000, 1, &|p| SineSource { k }.value(p)).psnr_db
        });
        println!("{name}: {whole:.2} dB, {cut:.2} dB");
        assert!(cut > whole + 2.0, "{name}: {whole} dB, {cut} dB");
    }
}

#[test]
fn a_smooth_surface_stays_as_it_is() {
    for mesh in [cleaned(generate::icosphere(3)), cleaned(generate::torus(24, 12))] {
        for tile in [0, 256] {
            let whole = covered(&mesh, tile, 30_000, None);
            let asked = covered(&mesh, tile, 30_000, Some(60.0));
            assert!(Cover { hard_edges: None, ..asked } == whole);
        }
    }
}

/// Baked light is cut at creases, which of a cube are its hard edges.
#[test]
fn creases_and_hard_edges_are_cut_once() {
    let mesh = cleaned(generate::cube(3));
    let options =
        CoverOptions { budget: TexelBudget::Total(20_000), cut_creases: true, ..CoverOptions::default() };
    let creased = build_cover(&mesh, &options).unwrap().0;
    let both = build_cover(&mesh, &CoverOptions { hard_edges: Some(60.0), ..options }).unwrap().0;
    assert_eq!(verified(&waves(&mesh, &both, 12.0)).continuity.exempt.hard, 36);
    assert_eq!(verified(&waves(&mesh, &creased, 12.0)).continuity.exempt.crease, 36);
    assert!(Cover { hard_edges: None, ..both } == creased);
}

/// Where a hard edge ends within a smooth part, whatever is hard around it, the others stay continuous.
#[test]
fn all_other_edges_are_continuous_at_any_angle() {
    let mut model = generate::grid(12);
    for (i, p) in model.positions.iter_mut().enumerate() {
        p.y += 0.04 * (i as f64 * 2.4).sin() + 0.03 * (i as f64 * 0.7).cos();
    }
    let mesh = cleaned(model);
    let edges = verified(&waves(&mesh, &covered(&mesh, 256, 40_000, None), 10.0)).continuity.edges;
    let mut before = edges + 1;
    for degrees in [0.0, 10.0, 20.0, 35.0, 50.0, 70.0] {
        let found = verified(&waves(&mesh, &covered(&mesh, 256, 40_000, Some(degrees)), 10.0)).continuity;
        assert_eq!(found.edges + found.exempt.hard, edges);
        assert!(found.exempt.hard < before, "{degrees}: {}", found.exempt.hard);
        before = found.exempt.hard;
    }
}

/// Normals that follow the direction from the middle, with waves.
struct Bumps;

fn bumpy(p: Vec3) -> Vec3 {
    (p + 0.1 * Vec3::new((6.0 * p.y).sin(), (5.0 * p.z).sin(), (7.0 * p.x).sin())).normalize()
}

impl Source for Bumps {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::Normal, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = bumpy(point.position).extend(1.0);
    }
}

/// Only texels are cut: a mesh that is shaded smooth over its edges stays so, and so do its normal maps.
#[test]
fn normals_are_smooth_over_hard_edges_where_the_mesh_is() {
    let mut mesh = cleaned(generate::cube(3));
    mesh.corners.normals =
        mesh.triangles.as_flattened().iter().map(|&v| mesh.positions[v as usize].normalize()).collect();
    for hard_edges in [None, Some(60.0)] {
        let cover = covered(&mesh, 256, 40_000, hard_edges);
        for format in [BakeFormat::Float, BakeFormat::Rgba8] {
            let options = fantex_bake::BakeOptions { format, ..float_options(Fit::Sharp) };
            let asset = baked(&mesh, &cover, &Bumps, &options);
            verified(&asset);
            let sampler = Sampler::of_cache(&asset.cache, FilterOptions::default());
            let mut largest = 0.0_f32;
            for (triangle, edge) in (0..mesh.triangles.len() as u32).flat_map(|t| (0..3).map(move |k| (t, k)))
            {
                for s in [0.02, 0.3, 0.5, 0.71] {
                    let mut lambda = Vec3::ZERO;
                    (lambda[edge], lambda[(edge + 1) % 3]) = (1.0 - s, s);
                    let point = SurfacePoint { triangle, lambda };
                    let normal = sampler.sample_channel(0, point, Footprint::NONE).truncate();
                    largest = largest.max(normal.angle_between(bumpy(point.position(&mesh))));
                }
            }
            assert!(largest < 0.02, "{hard_edges:?}, {format:?}: {largest} radians");
        }
    }
}

#[test]
fn what_is_no_angle_is_refused() {
    let mesh = cleaned(generate::cube(1));
    for degrees in [-1.0, 180.5, f32::NAN, f32::INFINITY] {
        let options = CoverOptions { hard_edges: Some(degrees), ..CoverOptions::default() };
        let error = build_cover(&mesh, &options).unwrap_err().to_string();
        assert!(
            error.contains("an angle of 0 to 180 degrees") && error.ends_with(&degrees.to_string()),
            "{error}"
        );
    }
}
