//! What every cleaned mesh must satisfy, and short ways to build models.

use std::collections::HashSet;
use std::f64::consts::TAU;

use fantex_base::{ErrorKind, Random};
use fantex_mesh::generate::{book, cube, grid, icosphere, torus};
use fantex_mesh::{CleanOptions, CleanReport, CornerAttributes, Mesh, Model, Topology, clean, clean_traced};
use glam::{DVec3, Vec2, Vec3, Vec4};
use proptest::prelude::*;

use crate::common::PROJECTIVE_PLANE;

/// A model without attributes.
pub(crate) fn soup(
    positions: impl IntoIterator<Item = [f64; 3]>,
    triangles: impl Into<Vec<[u32; 3]>>,
) -> Model {
    Model {
        name: "test".to_owned(),
        positions: positions.into_iter().map(DVec3::from).collect(),
        triangles: triangles.into(),
        ..Model::default()
    }
}

/// Cleans with the default options and checks what [`Mesh`] promises.
pub(crate) fn cleaned(model: Model) -> (Mesh, CleanReport) {
    let (mesh, report) = try_clean(model).unwrap_or_else(|error| panic!("{error}"));
    check(&mesh, &report);
    (mesh, report)
}

/// Cleans with the default options.
pub(crate) fn try_clean(model: Model) -> fantex_base::Result<(Mesh, CleanReport)> {
    clean(model, &CleanOptions::default())
}

/// Panics unless the mesh keeps the promises of [`Mesh`] and the report adds up.
pub(crate) fn check(mesh: &Mesh, report: &CleanReport) {
    assert!(mesh.positions.iter().all(|p| p.is_finite() && p.abs().max_element() <= 1.0));
    let places: HashSet<_> = mesh.positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
    assert_eq!(places.len(), mesh.positions.len(), "two vertices at the same position");
    assert!(mesh.positions.iter().flat_map(|p| p.to_array()).all(|x| x != 0.0 || x.is_sign_positive()));
    let used: HashSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    assert_eq!(used.len(), mesh.positions.len(), "unused vertices");
    assert!(used.iter().all(|&v| (v as usize) < mesh.positions.len()));
    let mut cycles = HashSet::new();
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
        assert!((b - a).cross(c - a).length_squared() > 0.0, "triangle {t} has no area");
        let mut turned = *triangle;
        while turned[0] > turned[1] || turned[0] > turned[2] {
            turned.rotate_left(1);
        }
        assert!(cycles.insert(turned), "triangle {t} is a duplicate");
    }
    assert!(!mesh.materials.is_empty() && !mesh.triangles.is_empty());
    let sets = mesh.corners.uv_sets.iter().map(Vec::len);
    let lengths = sets.chain([mesh.corners.normals.len(), mesh.corners.colors.len()]);
    assert!(lengths.into_iter().all(|n| n == 0 || n == 3 * mesh.triangles.len()));
    let dropped = report.triangles_non_finite + report.triangles_degenerate + report.triangles_duplicate;
    assert_eq!(report.triangles_in - dropped, mesh.triangles.len() as u64);
    let gone = report.vertices_welded + report.vertices_isolated;
    assert_eq!(report.vertices_in - gone, mesh.positions.len() as u64);
    assert_eq!(report.topology.vertices, mesh.positions.len() as u64);
    assert_eq!(report.topology.triangles, mesh.triangles.len() as u64);
}

// Cleaning on hand-built worst cases, each with its expected outcome.

fn circle(n: u32) -> impl Iterator<Item = [f64; 3]> {
    (0..n).map(move |i| (TAU * f64::from(i) / f64::from(n)).sin_cos()).map(|(s, c)| [c, s, 0.0])
}

/// A closed double cone over `n` rim vertices; vertices `n` and `n + 1` are its tips.
fn bipyramid(n: u32) -> Model {
    let positions = circle(n).chain([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]);
    let triangles: Vec<_> = (0..n).flat_map(|i| [[i, (i + 1) % n, n], [(i + 1) % n, i, n + 1]]).collect();
    soup(positions, triangles)
}

/// A strip of `n` quadrilaterals whose last is glued to the first, upside down for odd `half_turns`.
fn strip(n: u32, half_turns: u32) -> Model {
    let at = |i: u32, side: u32| {
        let side = if i == n && half_turns % 2 == 1 { 1 - side } else { side };
        2 * (i % n) + side
    };
    let positions = (0..2 * n).map(|v| {
        let u = TAU * f64::from(v / 2) / f64::from(n);
        let w = (f64::from(v % 2) - 0.5) * 0.6;
        let twist = 0.5 * f64::from(half_turns) * u;
        let r = 1.0 + w * twist.cos();
        [r * u.cos(), r * u.sin(), w * twist.sin()]
    });
    let triangles: Vec<_> = (0..n)
        .flat_map(|i| {
            let [a, b, c, d] = [at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    soup(positions, triangles)
}

fn topology(model: Model) -> Topology {
    cleaned(model).1.topology
}

#[test]
fn hubs_of_any_degree_are_manifold() {
    for n in [3, 7, 64, 10_000, 300_000] {
        let (mesh, report) = cleaned(bipyramid(n));
        assert_eq!(report.lines(), Vec::<String>::new(), "degree {n}");
        assert_eq!(report.topology.genus(), Some(0));
        assert_eq!(mesh.triangles.len(), 2 * n as usize);
        let fan: Vec<_> = (0..n - 1).map(|i| [i, i + 1, n]).collect();
        let fan = topology(soup(circle(n).chain([[0.0, 0.0, 1.0]]), fan));
        assert_eq!((fan.edges_boundary, fan.vertices_non_manifold), (u64::from(n) + 1, 0));
    }
}

#[test]
fn bow_ties_have_one_non_manifold_vertex_and_a_component_per_wing() {
    for k in 2..=50_u32 {
        let rim = circle(3 * k).flat_map(|p| [p, [0.9 * p[0], 0.9 * p[1], 0.3]]);
        let wings: Vec<_> = (0..k).map(|i| [6 * i, 6 * i + 2, 6 * k]).collect();
        let bow_tie = topology(soup(rim.chain([[0.0; 3]]), wings));
        assert_eq!(bow_tie.vertices_non_manifold, 1);
        assert_eq!((bow_tie.components, bow_tie.edges_boundary), (u64::from(k), 3 * u64::from(k)));
    }
}

#[test]
fn one_sided_surfaces_keep_a_seam_and_are_reported() {
    let (_, moebius) = cleaned(strip(12, 1));
    assert_eq!(moebius.non_orientable_components, 1);
    assert_eq!(moebius.topology.edges_inconsistent, 1);
    assert_eq!(moebius.topology.euler_characteristic(), 0);
    // To move the seam elsewhere is no gain.
    assert_eq!(moebius.triangles_flipped, 0);
    let mut mixed = strip(12, 1);
    mixed.triangles.iter_mut().step_by(3).for_each(|triangle| triangle.swap(1, 2));
    let (_, mixed) = cleaned(mixed);
    assert!(mixed.triangles_flipped > 0);
    assert_eq!((mixed.non_orientable_components, mixed.topology.edges_inconsistent), (1, 1));
    let (_, twisted_twice) = cleaned(strip(12, 2));
    assert_eq!((twisted_twice.non_orientable_components, twisted_twice.topology.edges_inconsistent), (0, 0));
}

#[test]
fn the_projective_plane_of_six_vertices_is_closed_but_not_orientable() {
    let positions = (0..6).map(|i| [f64::from(i), f64::from(i * i), f64::from(i * i * i)]);
    let (_, report) = cleaned(soup(positions, PROJECTIVE_PLANE));
    assert_eq!((report.topology.euler_characteristic(), report.topology.edges_boundary), (1, 0));
    assert_eq!(report.non_orientable_components, 1);
    assert!(report.topology.edges_inconsistent > 0 && report.topology.genus().is_none());
}

#[test]
fn the_klein_bottle_is_closed_but_not_orientable() {
    let (n, m) = (16_u32, 8_u32);
    let at = |i: u32, j: u32| if i == n { (m - j % m) % m } else { i * m + j % m };
    // A figure eight turned by half a turn on its way round, moved apart where it would cross itself.
    let positions = (0..n * m).map(|v| {
        let (u, w) = (TAU * f64::from(v / m) / f64::from(n), TAU * (f64::from(v % m) + 0.02) / f64::from(m));
        let r = 2.0 + (0.5 * u).cos() * w.sin() - (0.5 * u).sin() * (2.0 * w).sin();
        [r * u.cos(), r * u.sin(), (0.5 * u).sin() * w.sin() + (0.5 * u).cos() * (2.0 * w).sin()]
    });
    let triangles: Vec<_> = (0..n * m)
        .flat_map(|v| {
            let (i, j) = (v / m, v % m);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let (_, report) = cleaned(soup(positions, triangles));
    assert_eq!((report.topology.euler_characteristic(), report.topology.edges_boundary), (0, 0));
    assert_eq!((report.non_orientable_components, report.topology.components), (1, 1));
}

#[test]
fn books_have_one_edge_of_many_pages() {
    for pages in [3, 4, 17, 100] {
        let book = topology(book(pages));
        assert_eq!((book.edges_non_manifold, book.edges_inconsistent), (1, 0));
        assert_eq!((book.vertices_non_manifold, book.components), (2, 1));
    }
}

fn two_cubes(shift: DVec3) -> Model {
    let mut both = cube(1);
    let other = cube(1);
    both.positions.extend(other.positions.iter().map(|&p| p + shift));
    both.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + 8)));
    both
}

#[test]
fn cubes_that_touch_are_welded_at_what_they_share() {
    let (_, at_edge) = cleaned(two_cubes(DVec3::new(2.0, 2.0, 0.0)));
    assert_eq!((at_edge.vertices_welded, at_edge.topology.edges_non_manifold), (2, 1));
    let (_, at_vertex) = cleaned(two_cubes(DVec3::splat(2.0)));
    assert_eq!((at_vertex.vertices_welded, at_vertex.topology.vertices_non_manifold), (1, 1));
    assert_eq!(at_vertex.topology.components, 2);
    // Sharing a face: an internal wall of two opposite triangles each.
    let (_, at_face) = cleaned(two_cubes(DVec3::new(2.0, 0.0, 0.0)));
    assert_eq!(at_face.vertices_welded, 4);
    assert!(at_face.topology.edges_non_manifold >= 4);
}

#[test]
fn repeated_triangles_go_and_reversed_twins_stay() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let (mesh, report) = cleaned(soup(corners, [[0, 1, 2], [2, 0, 3], [2, 1, 0], [1, 2, 0]]));
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 0]]);
    assert_eq!((report.triangles_duplicate, report.double_sided_pairs, report.vertices_welded), (2, 1, 1));
    assert_eq!((report.topology.edges_boundary, report.triangles_flipped), (0, 0));
}

#[test]
fn a_doubled_sheet_keeps_both_sides() {
    let mut sheet = grid(4);
    let back: Vec<_> = sheet.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    sheet.triangles.extend(back);
    let (mesh, report) = cleaned(sheet);
    assert_eq!((mesh.triangles.len(), report.double_sided_pairs), (64, 32));
    assert_eq!((report.triangles_flipped, report.triangles_duplicate), (0, 0));
}

#[test]
fn positions_one_and_two_units_apart_stay_apart() {
    let ulp = f64::from(f32::EPSILON);
    let positions = [
        [1.0, 0.0, 0.0],
        [1.0 - ulp, 0.0, 0.0],
        [1.0 - 2.0 * ulp, 0.0, 0.0],
        [-1.0, 1.0, 0.0],
        [-1.0, -1.0, 0.0],
    ];
    let fans = [[0, 3, 4], [1, 3, 4], [2, 3, 4]];
    assert_eq!(cleaned(soup(positions, fans)).1.vertices_welded, 0);
    let options = CleanOptions { weld_distance: 1e-5, ..CleanOptions::default() };
    let (mesh, report) = clean(soup(positions, fans), &options).unwrap();
    check(&mesh, &report);
    assert_eq!((report.vertices_welded, report.triangles_duplicate), (2, 2));
}

/// Every triangle with vertices of its own, each moved by up to `noise` units.
fn scattered(model: &Model, noise: f64, seed: u64) -> Model {
    let mut random = Random::new(seed);
    let mut moved = |x: f64| x + noise * (2.0 * random.unit() - 1.0);
    let corners = model.triangles.as_flattened().iter();
    let positions: Vec<[f64; 3]> =
        corners.map(|&v| model.positions[v as usize].to_array().map(&mut moved)).collect();
    let mut triangles: Vec<[u32; 3]> =
        (0..model.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let mut random = Random::new(seed + 1);
    for i in 1..triangles.len() {
        triangles.swap(i, random.below(i as u64 + 1) as usize);
    }
    soup(positions, triangles)
}

#[test]
fn soups_that_rounding_tears_are_told_of_and_welded() {
    for (seed, model) in (0..).zip([icosphere(3), torus(24, 12), grid(12), cube(6)]) {
        let whole = cleaned(model.clone()).1.topology;
        // 1e-7 of the size, where a millionth is enough.
        let torn = scattered(&model, 1e-7, seed);
        let report = cleaned(torn.clone()).1;
        let extra = 3 * model.triangles.len() as u64 - report.vertices_welded - whole.vertices;
        let near = report.vertices_near;
        assert!(near <= extra && near as f64 > 0.97 * extra as f64, "{near} of {extra}, model {seed}");
        let lines = report.lines();
        let line = lines.last().unwrap();
        assert!(line.starts_with(&format!("{near} vertices within a millionth")), "{line}");
        // Not every program that says so has such an option.
        assert!(line.contains("'fantex bake --weld' joins"), "{line}");
        let length: f64 = line.trim_end_matches('.').rsplit(' ').next().unwrap().parse().unwrap();
        assert!(length >= report.near_distance && length < 1.1 * report.near_distance, "{line}");
        let options = CleanOptions { weld_distance: length, ..CleanOptions::default() };
        let (mesh, report) = clean(torn, &options).unwrap();
        check(&mesh, &report);
        assert_eq!((report.topology, report.vertices_near), (whole, 0), "model {seed}");
    }
}

/// A boundary alone, layers that lie over each other, and triangles smaller than what is looked for are no seams.
#[test]
fn only_vertices_that_close_a_seam_are_told_of() {
    let sheet = grid(6);
    let with_layer = |offset: f64, is_turned: bool| {
        let mut model = sheet.clone();
        let count = model.positions.len() as u32;
        model.positions.extend(sheet.positions.iter().map(|&p| p + offset * DVec3::Z + offset * DVec3::Y));
        model.triangles.extend(sheet.triangles.iter().map(|&[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|v| v + count);
            if is_turned { [a, c, b] } else { [a, b, c] }
        }));
        model.corners = CornerAttributes::default();
        model
    };
    let tiny = soup(
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1e-7, 1.0, 0.0], [2e-7, 1.0, 0.0], [-1.0, 0.5, 0.0]],
        [[0, 1, 4], [0, 4, 3], [0, 3, 2], [0, 2, 5]],
    );
    // Needles across a strip that is as narrow.
    let rungs = (0..20).flat_map(|i| [[0.05 * f64::from(i), 0.0, 0.0], [0.05 * f64::from(i), 5e-7, 0.0]]);
    let needles: Vec<[u32; 3]> =
        (0..19).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 1], [2 * i + 1, 2 * i + 2, 2 * i + 3]]).collect();
    let strip = soup(rungs, needles);
    // Two sheets with a gap that is wider than a rounding.
    let mut gap = with_layer(0.0, false);
    let count = sheet.positions.len();
    let width = 2.0 + 1e-5;
    gap.positions[count..].iter_mut().for_each(|p| p.x += width);
    for (i, model) in [
        sheet.clone(),
        scattered(&sheet, 0.0, 1),
        with_layer(1e-7, false),
        with_layer(1e-7, true),
        tiny,
        strip,
        gap,
    ]
    .into_iter()
    .enumerate()
    {
        assert_eq!(cleaned(model).1.vertices_near, 0, "model {i}");
    }
}

#[test]
fn absurd_weld_distances_do_no_harm() {
    let with = |weld_distance| {
        clean(icosphere(1), &CleanOptions { weld_distance, ..CleanOptions::default() }).map(|(mesh, _)| mesh)
    };
    let plain = cleaned(icosphere(1)).0;
    for none in [f64::NAN, -1.0, 1e-320, 1e-30] {
        assert_eq!(with(none).unwrap(), plain, "distance {none}");
    }
    for all in [10.0, 1e300, f64::INFINITY] {
        let error = with(all).unwrap_err();
        assert!(error.to_string().starts_with("nothing is left"), "distance {all}: {error}");
    }
}

#[test]
fn needles_and_caps_stay_but_lines_and_points_go() {
    let p = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1e-7, 0.0], [0.5, 1e-6, 0.0], [0.5, 0.0, 0.0], [0.0; 3]];
    let needle_and_cap = [[0, 1, 2], [0, 3, 1]];
    let lines = [[0, 1, 4], [0, 0, 1], [0, 5, 1], [3, 3, 3]];
    let (mesh, report) = cleaned(soup(p, [needle_and_cap.to_vec(), lines.to_vec()].concat()));
    assert_eq!((mesh.triangles.len(), report.triangles_degenerate), (2, 4));
    assert_eq!(report.vertices_isolated + report.vertices_welded, 2);
}

#[test]
fn nothing_left_is_an_error_that_says_why() {
    let line = soup((0..9).map(|i| [f64::from(i); 3]), [[0, 1, 2], [3, 4, 8], [0, 4, 8]]);
    refused(line, "3 without area");
    refused(soup([[5.0; 3]; 4], [[0, 1, 2], [1, 2, 3]]), "nothing is left");
    for unusable in [f64::NAN, 1e101] {
        let bad = soup([[unusable; 3], [0.0; 3], [1.0; 3]], [[0, 1, 2]]);
        refused(bad, "1 triangle: 1 with unusable positions (NaN, infinite or beyond 1e100)");
    }
}

#[test]
fn a_stray_vertex_does_not_take_the_model_with_it() {
    // At 1e6 no triangle loses its area, but steps of 0.06 are all that is left of edges of 0.03.
    for far in [1e6, 1e8, 1e38, 1e60] {
        let mut ball = icosphere(4);
        ball.name = "test".to_owned();
        let stray = ball.positions.len() as u32;
        // Along an axis the ball would keep the area that it has across it.
        ball.positions.push(DVec3::splat(far));
        ball.triangles[7][0] = stray;
        let error = try_clean(ball).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Unsupported);
        let sentence = error.to_string();
        let reach =
            format!("test: positions reach {:.0e} while most triangles lie within ", 3f64.sqrt() * far);
        assert!(sentence.starts_with(&reach), "{sentence}");
        assert!(sentence.ends_with(&format!("(first: vertex {stray}, counted from 0)")), "{sentence}");
    }
    // It may lie far away, as long as there is room for the model.
    let mut ball = icosphere(4);
    let stray = ball.positions.len() as u32;
    ball.positions.push(DVec3::new(1e3, 0.0, 0.0));
    ball.triangles[7][0] = stray;
    assert!(try_clean(ball).unwrap().0.triangles.len() > 5000);
}

#[test]
fn contradictions_are_errors() {
    refused(soup([], []), "no triangles (0 vertices)");
    refused(soup([[0.0; 3]; 5], []), "no triangles (5 vertices)");
    let out = soup(circle(3), [[0, 1, 2], [0, 1, u32::MAX]]);
    refused(out, "triangle 1 of test refers to vertex 4294967295, but there are 3");
    let mut short = soup(circle(3), [[0, 1, 2]]);
    short.corners.uv_sets.push(vec![Vec2::ZERO; 2]);
    refused(short, "2 texture coordinates for 1 triangle; expected 3");
}

/// Asserts that a model cannot be cleaned, and why.
#[track_caller]
fn refused(model: Model, why: &str) {
    let error = try_clean(model).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Malformed);
    assert!(error.to_string().contains(why), "{error}");
}

#[test]
fn broken_numbers_cost_only_the_triangles_that_use_them() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200, f64::MAX] {
        let mut unused = icosphere(1);
        unused.positions.push(DVec3::new(bad, 0.0, 0.0));
        let (mesh, report) = cleaned(unused);
        assert_eq!((mesh.triangles.len(), report.vertices_isolated), (80, 1));
        assert_eq!(mesh.world_from_mesh.scale, 1.0);
        let mut used = icosphere(1);
        used.positions[0].y = bad;
        let (mesh, report) = cleaned(used);
        assert_eq!((mesh.triangles.len(), report.triangles_non_finite, report.vertices_isolated), (75, 5, 1));
    }
}

#[test]
fn every_magnitude_keeps_the_shape() {
    let expected = cleaned(icosphere(3)).0;
    for (scale, offset) in [
        (1e-30, 0.0),
        (1e-45, 0.0),
        (1e-300, 0.0),
        (1e30, 0.0),
        (f64::from(f32::MAX), 0.0),
        (1e-2, 1e7),
        (1.0, -3e8),
        (1e-3, 123_456.789),
    ] {
        let mut model = icosphere(3);
        model.positions.iter_mut().for_each(|p| *p = *p * scale + DVec3::new(offset, -offset, 0.5 * offset));
        let originals = model.positions.clone();
        let (mesh, report) = cleaned(model);
        assert_eq!(mesh.triangles, expected.triangles, "scale {scale}, offset {offset}");
        assert_eq!(report.lines(), Vec::<String>::new());
        let tolerance = 1e-6 * scale + 1e-15 * offset.abs();
        for (p, original) in mesh.positions.iter().zip(originals) {
            let error = (mesh.world_from_mesh.point(*p) - original).abs().max_element();
            assert!(error <= tolerance, "scale {scale}, offset {offset}: off by {error}");
        }
    }
}

#[test]
fn minus_zero_is_zero() {
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.0, 0.0, -0.0], [0.0, -1.0, 0.0]];
    let (_, report) = cleaned(soup(positions, [[0, 1, 2], [3, 4, 1]]));
    assert_eq!((report.vertices_welded, report.topology.components), (1, 1));
}

/// A sphere by angles from 0 to a full turn, both included. The seam and the poles close up to the rounding of sines.
fn sphere_by_angles(columns: u32, rows: u32, radius: f64) -> Model {
    let positions = (0..=rows).flat_map(move |row| {
        let (sin, cos) = (0.5 * TAU * f64::from(row) / f64::from(rows)).sin_cos();
        (0..=columns).map(move |column| {
            let around = TAU * f64::from(column) / f64::from(columns);
            [sin * around.cos(), sin * around.sin(), cos].map(|x| radius * x)
        })
    });
    let quad = move |row: u32, column: u32| {
        let a = row * (columns + 1) + column;
        let [b, c, d] = [a + columns + 1, a + columns + 2, a + 1];
        [[a, b, c], [a, c, d]]
    };
    let triangles = (0..rows).flat_map(move |row| (0..columns).flat_map(move |column| quad(row, column)));
    soup(positions, triangles.collect::<Vec<_>>())
}

#[test]
fn surfaces_that_close_up_to_rounding_are_closed() {
    for (columns, rows, radius) in [(60, 30, 1.0), (30, 20, 1e-3), (64, 32, 12_345.6)] {
        let open = sphere_by_angles(columns, rows, radius);
        let first = columns + 1;
        assert_ne!(open.positions[first as usize], open.positions[(first + columns) as usize]);
        let (mesh, report) = cleaned(open);
        assert_eq!((report.topology.edges_boundary, report.topology.genus()), (0, Some(0)), "{report:?}");
        assert_eq!(mesh.positions.len() as u32, columns * (rows - 1) + 2);
    }
}

#[test]
fn sheets_that_are_apart_stay_apart() {
    for distance in [1e-3, 1e-6, 1e-12] {
        let (one, alone) = cleaned(grid(4));
        let mut both = grid(4);
        let count = both.positions.len() as u32;
        let height = both.positions[0].y;
        let above: Vec<DVec3> = both.positions.iter().map(|p| *p + DVec3::Y * distance).collect();
        assert!(both.positions.iter().all(|p| p.y == height) && above[0].y != height);
        both.positions.extend(above);
        let other: Vec<_> = both.triangles.iter().map(|t| t.map(|v| v + count)).collect();
        both.triangles.extend(other);
        let (mesh, report) = cleaned(both);
        assert_eq!(mesh.positions.len(), 2 * one.positions.len(), "{distance}");
        assert_eq!((report.vertices_welded, report.topology.components), (0, 2), "{distance}");
        assert_eq!(report.topology.edges_boundary, 2 * alone.topology.edges_boundary);
    }
}

#[test]
fn random_flips_are_undone_and_attributes_follow() {
    let mut model = torus(40, 20);
    let original = model.clone();
    let mut state = 1_u32;
    for triangle in &mut model.triangles {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        if state >> 31 == 1 {
            triangle.swap(0, 2);
        }
    }
    let uv = |v: u32| Vec2::new(v as f32, 0.5 * v as f32);
    model.corners.uv_sets = vec![model.triangles.iter().flatten().map(|&v| uv(v)).collect()];
    let (mesh, report) = cleaned(model);
    assert_eq!((report.topology.edges_inconsistent, report.topology.genus()), (0, Some(1)));
    assert!(report.triangles_flipped > 300 && report.triangles_flipped <= 800);
    for (corner, &v) in mesh.triangles.iter().flatten().enumerate() {
        assert_eq!(mesh.corners.uv_sets[0][corner], uv(v));
    }
    assert_eq!(mesh.positions.len(), original.positions.len());
}

/// A ball with the normals of a sphere.
fn ball() -> Model {
    let mut ball = icosphere(2);
    ball.corners.normals =
        ball.triangles.iter().flatten().map(|&v| ball.positions[v as usize].as_vec3()).collect();
    ball
}

/// Six times what a mesh encloses.
fn volume(mesh: &Mesh) -> f32 {
    (0..mesh.triangles.len()).map(|t| mesh.triangle_positions(t)).map(|[a, b, c]| a.dot(b.cross(c))).sum()
}

#[track_caller]
fn assert_outward(mesh: &Mesh) {
    assert!(volume(mesh) > 0.0);
    for (corner, &v) in mesh.triangles.iter().flatten().enumerate() {
        let (normal, outward) = (mesh.corners.normals[corner], mesh.positions[v as usize]);
        assert!(normal.dot(outward.normalize()) > 0.999, "corner {corner}: {normal}");
    }
}

#[test]
fn normals_decide_which_side_is_the_front() {
    let count = ball().triangles.len();
    // Fewer than half, half, and nearly all of the triangles are the wrong way round; their normals are not.
    for turned in [count / 4, count / 2, count - 1] {
        let mut model = ball();
        for t in 0..turned {
            model.triangles[t].swap(1, 2);
            model.corners.normals.swap(3 * t + 1, 3 * t + 2);
        }
        let (mesh, report) = cleaned(model);
        assert_eq!((report.triangles_flipped, report.topology.edges_inconsistent), (turned as u64, 0));
        assert_outward(&mesh);
    }
}

#[test]
fn normals_follow_when_triangles_turn() {
    let count = ball().triangles.len();
    // Some of the triangles are seen from behind, and so are their normals.
    for turned in [count / 4, count / 2] {
        let mut model = ball();
        model.corners.tangents = vec![Vec3::X.extend(1.0); 3 * count];
        for t in 0..turned {
            model.triangles[t].swap(1, 2);
            model.corners.normals.swap(3 * t + 1, 3 * t + 2);
            for corner in 3 * t..3 * t + 3 {
                model.corners.normals[corner] *= -1.0;
                model.corners.tangents[corner].w = -1.0;
            }
        }
        let (mesh, report) = cleaned(model);
        assert_eq!(report.triangles_flipped, turned as u64);
        assert_outward(&mesh);
        assert_eq!(mesh.corners.tangents, vec![Vec3::X.extend(1.0); 3 * count]);
    }
}

#[test]
fn a_closed_patch_of_which_half_is_turned_has_its_outside_outside() {
    let mut model = icosphere(2);
    let half = model.triangles.len() / 2;
    model.triangles[..half].iter_mut().for_each(|triangle| triangle.swap(1, 2));
    let (mesh, report) = cleaned(model);
    assert_eq!(report.triangles_flipped, half as u64);
    assert!(volume(&mesh) > 0.0);
}

#[test]
fn dropped_triangles_take_their_attributes_and_materials_along() {
    let mut model = soup(circle(6), [[0, 1, 2], [0, 0, 3], [2, 3, 4], [0, 1, 2], [4, 5, 0]]);
    model.triangle_materials = vec![0, 1, 2, 3, 4];
    model.materials = vec![Default::default(); 5];
    model.corners.uv_sets = vec![(0..15).map(|c| Vec2::splat(c as f32)).collect()];
    let (mesh, _) = cleaned(model);
    assert_eq!(mesh.triangle_materials, [0, 2, 4]);
    let kept: Vec<f32> = mesh.corners.uv_sets[0].iter().map(|uv| uv.x).collect();
    assert_eq!(kept, [0.0, 1.0, 2.0, 6.0, 7.0, 8.0, 12.0, 13.0, 14.0]);
}

#[test]
fn inside_out_components_are_believed_unless_asked() {
    let mut shells = icosphere(2);
    let inner = icosphere(2);
    let count = shells.positions.len() as u32;
    shells.positions.extend(inner.positions.iter().map(|&p| 0.5 * p));
    shells.triangles.extend(inner.triangles.iter().map(|&[a, b, c]| [a, c, b].map(|v| v + count)));
    let (_, believed) = cleaned(shells.clone());
    assert_eq!((believed.triangles_flipped, believed.topology.components), (0, 2));
    let options = CleanOptions { turn_outward: true, ..CleanOptions::default() };
    let (mesh, turned) = clean(shells, &options).unwrap();
    check(&mesh, &turned);
    assert_eq!(turned.triangles_flipped, 320);
}

#[test]
fn isolated_vertices_and_many_components_are_no_trouble() {
    let count = 100_000_u32;
    let tetrahedron = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.2]];
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..count {
        let first = positions.len() as u32;
        let [x, y] = [f64::from(i % 317), f64::from(i / 317)];
        positions.extend(tetrahedron.map(|p| [p[0] + x, p[1] + y, p[2]]));
        positions.extend([[x, y, -5.0]; 4]);
        triangles.extend([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map(|t| t.map(|v| v + first)));
    }
    let (_, report) = cleaned(soup(positions, triangles));
    assert_eq!(report.topology.components, u64::from(count));
    assert_eq!((report.vertices_isolated, report.vertices_welded), (4 * u64::from(count), 0));
    assert_eq!(report.topology.genus(), Some(0));
}

#[test]
fn split_vertices_are_welded_in_the_order_they_first_appear() {
    let sphere = icosphere(3);
    let split: Vec<[f64; 3]> =
        sphere.triangles.iter().flatten().map(|&v| sphere.positions[v as usize].to_array()).collect();
    let triangles: Vec<_> =
        (0..sphere.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let (mesh, report) = cleaned(soup(split, triangles));
    assert_eq!((report.topology.genus(), mesh.positions.len()), (Some(0), sphere.positions.len()));
    let mut next = 0;
    for &v in mesh.triangles.iter().flatten() {
        assert!(v <= next, "vertex {v} before {next}");
        next = next.max(v + 1);
    }
}

#[test]
fn corner_values_that_are_no_numbers_are_replaced() {
    let mut model = soup([[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], [[0, 1, 2]]);
    let good = Vec2::new(1e30, -2.0);
    model.corners.uv_sets = vec![vec![good, Vec2::new(f32::NAN, 0.0), Vec2::new(0.0, f32::INFINITY)]];
    model.corners.colors = vec![Vec4::splat(0.5), Vec4::NAN, Vec4::ONE];
    model.corners.normals = vec![Vec3::Z, Vec3::Z, Vec3::NAN];
    let (mesh, report) = cleaned(model);
    assert_eq!(report.corner_values_non_finite, 4);
    assert_eq!(mesh.corners.uv_sets[0], [good, Vec2::ZERO, Vec2::ZERO]);
    assert_eq!(mesh.corners.colors, [Vec4::splat(0.5), Vec4::ONE, Vec4::ONE]);
    assert_eq!(mesh.corners.normals, [Vec3::Z, Vec3::Z, Vec3::ZERO]);
    assert!(report.lines()[0].starts_with("4 corner values replaced"), "{:?}", report.lines());
}

// Properties of cleaning that hold for any triangle soup.

/// Soups on a small grid, so that coinciding vertices, collinear corners and repeated triangles are common; every corner
/// carries a colour that tells its position in the model.
fn any_model() -> impl Strategy<Value = Model> {
    let coordinate = prop_oneof![6 => (0..4_i32).prop_map(f64::from), 1 => Just(-0.0), 1 => Just(f64::NAN)];
    let position = [coordinate.clone(), coordinate.clone(), coordinate];
    (prop::collection::vec(position, 3..60), prop::collection::vec(any::<[u16; 3]>(), 1..150)).prop_map(
        |(positions, raw)| {
            let count = positions.len() as u32;
            let triangles: Vec<_> = raw.iter().map(|t| t.map(|v| u32::from(v) % count)).collect();
            let mut model = soup(positions, triangles);
            let color = |&v: &u32| model.positions[v as usize].as_vec3().extend(1.0);
            model.corners.colors = model.triangles.iter().flatten().map(color).collect();
            model
        },
    )
}

/// The mesh as a model again.
fn model_of(mesh: &Mesh) -> Model {
    Model {
        positions: mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p)).collect(),
        triangles: mesh.triangles.clone(),
        corners: mesh.corners.clone(),
        ..Model::default()
    }
}

fn on_threads(threads: usize, model: Model) -> Option<(Mesh, CleanReport)> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
    pool.install(|| clean(model, &CleanOptions::default()).ok())
}

proptest! {
    #[test]
    fn promises_hold_and_attributes_stay_with_their_corners(model in any_model()) {
        if let Ok((mesh, report)) = clean(model, &CleanOptions::default()) {
            check(&mesh, &report);
            for (corner, &v) in mesh.triangles.iter().flatten().enumerate() {
                let world: Vec4 = mesh.world_from_mesh.point(mesh.positions[v as usize]).as_vec3().extend(1.0);
                prop_assert_eq!(mesh.corners.colors[corner], world);
            }
        }
    }

    #[test]
    fn cleaning_twice_changes_nothing_more(model in any_model()) {
        if let Ok((once, first)) = clean(model, &CleanOptions::default()) {
            let (twice, second) = clean(model_of(&once), &CleanOptions::default()).unwrap();
            prop_assert_eq!(&twice.triangles, &once.triangles);
            prop_assert_eq!(&twice.corners, &once.corners);
            prop_assert_eq!(model_of(&twice).positions, model_of(&once).positions);
            prop_assert_eq!(second.topology, first.topology);
            prop_assert_eq!(second.triangles_flipped, 0);
        }
    }

    #[test]
    fn the_order_of_triangles_does_not_change_the_counts(model in any_model()) {
        let mut reversed = model.clone();
        reversed.triangles.reverse();
        reversed.corners = Default::default();
        let (a, b) = (clean(model, &CleanOptions::default()), clean(reversed, &CleanOptions::default()));
        prop_assert_eq!(a.is_ok(), b.is_ok());
        if let (Ok((_, a)), Ok((_, b))) = (a, b) {
            prop_assert_eq!(a.triangles_duplicate, b.triangles_duplicate);
            prop_assert_eq!(a.double_sided_pairs, b.double_sided_pairs);
            prop_assert_eq!(a.non_orientable_components, b.non_orientable_components);
            prop_assert_eq!(a.topology.edges, b.topology.edges);
            prop_assert_eq!(a.topology.components, b.topology.components);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_number_of_threads_does_not_matter(model in any_model()) {
        let same_on_one = on_threads(1, model.clone());
        prop_assert_eq!(same_on_one.is_some(), clean(model.clone(), &CleanOptions::default()).is_ok());
        prop_assert_eq!(same_on_one, on_threads(7, model));
    }
}

#[test]
fn large_soups_do_not_depend_on_threads_either() {
    let mut state = 7_u32;
    let mut random = |n: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) % n
    };
    let positions: Vec<[f64; 3]> = (0..200_000).map(|_| [(); 3].map(|()| f64::from(random(40)))).collect();
    let triangles: Vec<[u32; 3]> = (0..300_000).map(|_| [(); 3].map(|()| random(200_000))).collect();
    let model = soup(positions, triangles);
    let one = on_threads(1, model.clone());
    assert!(one.is_some() && one == on_threads(6, model));
}

#[test]
fn a_clean_mesh_has_nothing_to_say() {
    assert!(CleanReport { triangles_in: 12, vertices_in: 8, ..Default::default() }.lines().is_empty());
}

#[test]
fn findings_are_counted_in_words() {
    let report = CleanReport { vertices_welded: 2, triangles_degenerate: 1, ..Default::default() };
    assert_eq!(
        report.lines(),
        ["1 triangle dropped: no area.", "2 vertices welded to an earlier vertex at the same place."]
    );
}

/// At two millions, numbers of single precision lie an eighth apart, and edges are 0.04 long.
#[test]
fn coordinates_too_far_from_the_origin_for_their_file_are_told() {
    let told = |round: bool, at: f64| {
        let mut ball = icosphere(5);
        for p in &mut ball.positions {
            *p += DVec3::splat(at);
            *p = if round { p.as_vec3().as_dvec3() } else { *p };
        }
        let report = try_clean(ball).unwrap().1;
        report.lines().iter().any(|line| line.contains("lie 0.2 units apart there"))
    };
    assert!(told(true, 2e6));
    assert!(!told(false, 2e6) && !told(true, 10.0));
}

/// Two triangles beside each other, each with vertices of its own: a seam only where their texture coordinates differ.
#[test]
fn seams_of_texture_coordinates_are_nothing_to_speak_of() {
    let positions =
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    let at = |shift: [f32; 2]| {
        let mut model = soup(positions, [[0, 1, 2], [3, 4, 5]]);
        let uv = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0 + shift[0]], [1.0, shift[1]], [1.0, 1.0]];
        model.corners.uv_sets = vec![uv.map(Vec2::from).to_vec()];
        let report = cleaned(model).1;
        assert_eq!(report.vertices_welded, 2);
        let is_told = report.lines().iter().any(|line| line.contains("2 vertices welded"));
        (report.vertices_at_seams, is_told)
    };
    assert_eq!(at([0.5, 0.5]), (2, false));
    assert_eq!(at([0.0, 0.5]), (1, true));
    assert_eq!(at([0.0, 0.0]), (0, true));
}

#[test]
fn single_precision_positions_survive_unrounded() {
    let on_line = (0..1000).map(|i| (Vec3::new(0.1, 0.7, -0.3) * (1.0 + i as f32)).as_dvec3().to_array());
    let fan: Vec<[u32; 3]> = (0..999).map(|i| [i, i + 1, 1000]).collect();
    let (mesh, report) = cleaned(soup(on_line.chain([[-500.0, 0.0, 0.0]]), fan));
    assert_eq!((mesh.positions.len(), report.vertices_welded), (1001, 0));
}

#[test]
fn a_triangle_has_area_unless_it_is_exactly_a_line() {
    let is_kept =
        |corners: [Vec3; 3]| try_clean(soup(corners.map(|p| p.as_dvec3().to_array()), [[0, 1, 2]])).is_ok();
    let (a, b) = (Vec3::new(0.3, -0.7, 0.1), Vec3::new(0.9, 0.2, -0.4));
    let along = Vec3::new(0.1, 0.2, 0.3);
    for line in [[a, a, a], [a, b, a], [Vec3::ZERO, along, 2.0 * along], [-b, Vec3::ZERO, b]] {
        assert!(!is_kept(line), "{line:?}");
    }
    let needle = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1e-7, 0.0)];
    let cap = [-Vec3::X, Vec3::X, Vec3::new(0.0, 1e-6, 0.0)];
    let tiny = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p * (1.0_f32 / (1_u64 << 60) as f32));
    for triangle in [needle, cap, tiny] {
        assert!(is_kept(triangle), "{triangle:?}");
    }
    // One unit in the last place off a line.
    let (a, c) = (Vec3::new(0.1, 0.3, 0.7), Vec3::new(0.2, 0.6, 1.4) * 0.7);
    let b = 0.5 * (a + c);
    assert!(is_kept([a, Vec3::new(b.x, b.y, b.z.next_up()), c]) || is_kept([a, b, c]));
}

#[test]
fn every_corner_knows_where_it_came_from() {
    // Every other triangle is turned round, some are repeated, some have no area.
    let mut model = torus(12, 8);
    let triangles = model.triangles.clone();
    let repeated = triangles.iter().step_by(5).copied();
    model.triangles = [[3, 3, 9]].into_iter().chain(triangles.iter().copied()).chain(repeated).collect();
    (1..model.triangles.len()).step_by(2).for_each(|t| model.triangles[t].swap(0, 1));
    model.corners.colors =
        (0..3 * model.triangles.len()).map(|corner| Vec4::splat(corner as f32 / 4096.0)).collect();
    let colors = model.corners.colors.clone();
    let (mesh, report, origins) = clean_traced(model, &CleanOptions::default()).unwrap();
    assert!(report.triangles_flipped > 10 && report.triangles_degenerate == 1, "{report:?}");
    for t in 0..mesh.triangles.len() {
        for k in 0..3 {
            let source = 3 * origins.triangle(t) + origins.corner(t, k);
            assert_eq!(mesh.corners.colors[3 * t + k], colors[source]);
        }
    }
}
