//! Fans against a slow and obvious reference, on known surfaces and on random soups.

use std::collections::{BTreeMap, BTreeSet};

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use fantex_mesh::{
    CleanOptions, EdgeSide, FanCorner, Fans, LoadOptions, Mesh, Model, SURFACE_OFFSET, TriangleBvh,
    VertexCorners, clean, continued, corner_tangents, generate, interpolate, load, origin_beside,
    shading_normals,
};
use fantex_test::{cleaned, loaded};
use glam::{DVec3, Vec2, Vec3, Vec4};
use proptest::prelude::*;

use crate::common::{PROJECTIVE_PLANE, data_folder};

fn fans_of(triangles: &[[u32; 3]]) -> Fans {
    let vertices = triangles.iter().flatten().max().map_or(0, |&v| v as usize + 1);
    Fans::of(triangles, &VertexCorners::of(triangles, vertices))
}

/// For every corner the smallest corner of its fan: corners at a vertex, joined wherever triangles continue each other.
fn reference(triangles: &[[u32; 3]]) -> Vec<usize> {
    let mut fan: Vec<usize> = (0..3 * triangles.len()).collect();
    let corner_at = |t: usize, v: u32| 3 * t + triangles[t].iter().position(|&w| w == v).unwrap();
    for (&edge, sides) in &edges(triangles) {
        for [t, u] in pairs(triangles, edge, sides) {
            for v in [edge.0, edge.1] {
                let (p, q) = (fan[corner_at(t, v)], fan[corner_at(u, v)]);
                fan.iter_mut().filter(|f| **f == p || **f == q).for_each(|f| *f = p.min(q));
            }
        }
    }
    fan
}

/// The triangles that continue each other at an edge.
fn pairs(triangles: &[[u32; 3]], (a, b): (u32, u32), at_edge: &[usize]) -> Vec<[usize; 2]> {
    let side = |&t: &usize| {
        let k = triangles[t].iter().position(|&v| v != a && v != b).unwrap();
        EdgeSide { opposite: triangles[t][k], is_forward: triangles[t][(k + 1) % 3] == a }
    };
    let sides: Vec<EdgeSide> = at_edge.iter().map(side).collect();
    continued(&sides).iter().map(|pair| pair.map(|i| at_edge[i])).collect()
}

/// The triangles at every edge.
fn edges(triangles: &[[u32; 3]]) -> BTreeMap<(u32, u32), Vec<usize>> {
    let mut edges: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (t, triangle) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            edges.entry((a.min(b), a.max(b))).or_default().push(t);
        }
    }
    edges
}

/// All that the documentation of `Fans` promises, checked one by one.
fn assert_are_fans(triangles: &[[u32; 3]], fans: &Fans) {
    assert_eq!(fans.triangle_count(), triangles.len());
    let edges = edges(triangles);
    let goes_on = |t: usize, a: u32, b: u32| {
        let edge = (a.min(b), a.max(b));
        pairs(triangles, edge, &edges[&edge]).as_flattened().contains(&t)
    };
    let mut seen = vec![0; 3 * triangles.len()];
    let mut previous_center = 0;
    for fan in 0..fans.len() {
        let corners = fans.corners(fan);
        let ring = |i: usize| {
            let corner: fantex_mesh::FanCorner = corners[i];
            corner.slots().map(|k| triangles[corner.triangle()][k])
        };
        let center = ring(0)[0];
        assert!(center >= previous_center, "fans ascend by centre vertex");
        previous_center = center;
        for (i, corner) in corners.iter().enumerate() {
            seen[corner.corner() as usize] += 1;
            assert_eq!(fans.of_corner(corner.corner() as usize), fan as u32);
            assert_eq!(ring(i)[0], center);
            if i > 0 {
                assert_eq!(ring(i - 1)[2], ring(i)[1], "fan {fan} is not in order");
                assert!(goes_on(corner.triangle(), center, ring(i)[1]));
            }
        }
        let (first, last) = (ring(0)[1], ring(corners.len() - 1)[2]);
        let [begin, end] = [corners[0], corners[corners.len() - 1]].map(|c| c.triangle());
        if fans.is_closed(fan) {
            assert_eq!(first, last);
            assert!(goes_on(begin, center, first) && corners.len() >= 3);
        } else {
            assert!(!goes_on(begin, center, first) && !goes_on(end, center, last), "fan {fan} could go on");
        }
    }
    assert!(seen.iter().all(|&n| n == 1), "every corner is in exactly one fan");
    for (&(a, b), sides) in &edges {
        for [t, u] in pairs(triangles, (a, b), sides) {
            let at =
                |t: usize, v: u32| fans.of_triangle(t)[triangles[t].iter().position(|&w| w == v).unwrap()];
            assert_eq!([at(t, a), at(t, b)], [at(u, a), at(u, b)], "both triangles name the same two fans");
        }
    }
}

/// The number of reversed corners after all checks; the reference agrees.
fn checked(triangles: &[[u32; 3]]) -> (Fans, usize) {
    let fans = fans_of(triangles);
    assert_are_fans(triangles, &fans);
    let expected = reference(triangles);
    let smallest =
        |c: usize| fans.corners(fans.of_corner(c) as usize).iter().map(|f| f.corner()).min().unwrap();
    for (c, &e) in expected.iter().enumerate() {
        assert_eq!(smallest(c) as usize, e, "corner {c}");
    }
    let reversed = (0..fans.len()).flat_map(|f| fans.corners(f)).filter(|c| c.reversed()).count();
    (fans, reversed)
}

#[test]
fn manifold_surfaces_have_one_fan_per_vertex_and_none_is_reversed() {
    let shapes: [Model; 5] = [
        generate::icosphere(2),
        generate::torus(7, 5),
        generate::cube(2),
        generate::uv_sphere(60, 4),
        generate::grid(5),
    ];
    for shape in shapes {
        let (fans, reversed) = checked(&shape.triangles);
        assert_eq!((fans.len(), reversed), (shape.positions.len(), 0), "{}", shape.name);
        let closed = (0..fans.len()).filter(|&f| fans.is_closed(f)).count();
        let boundary = if shape.name == "grid" { 20 } else { 0 };
        assert_eq!(closed + boundary, shape.positions.len(), "{}", shape.name);
    }
}

#[test]
fn no_triangles_no_fans() {
    let fans = fans_of(&[]);
    assert!(fans.is_empty());
    assert_eq!(fans.triangle_count(), 0);
}

/// A strip of `n` squares whose end is glued to its beginning upside down.
fn moebius(n: u32) -> Vec<[u32; 3]> {
    let at = |i: u32, j: u32| if i < n { 2 * i + j } else { 1 - j };
    (0..n)
        .flat_map(|i| {
            let [a, b, c, d] = [at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// A grid of `n * m` squares, glued along one direction straight and along the other upside down.
fn klein_bottle(n: u32, m: u32) -> Vec<[u32; 3]> {
    let at = |i: u32, j: u32| if i < n { i * m + j % m } else { (m - j % m) % m };
    (0..n * m)
        .flat_map(|q| {
            let (i, j) = (q / m, q % m);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

#[test]
fn surfaces_that_cannot_be_oriented_have_reversed_corners() {
    let (fans, reversed) = checked(&moebius(9));
    assert_eq!(fans.len(), 18);
    assert!((0..18).all(|f| !fans.is_closed(f)));
    assert!(reversed > 0);

    let (fans, reversed) = checked(&klein_bottle(6, 5));
    assert_eq!(fans.len(), 30);
    assert!((0..30).all(|f| fans.is_closed(f) && fans.corners(f).len() == 6));
    assert!(reversed > 0);

    let (fans, reversed) = checked(&PROJECTIVE_PLANE);
    assert_eq!(fans.len(), 6);
    assert!((0..6).all(|f| fans.is_closed(f) && fans.corners(f).len() == 5));
    assert!(reversed > 0);
}

/// `k` umbrellas of `n` triangles around vertex 0.
fn bow_tie(k: u32, n: u32) -> Vec<[u32; 3]> {
    (0..k * n).map(|i| [0, 1 + i, 1 + i / n * n + (i + 1) % n]).collect()
}

#[test]
fn a_vertex_where_sheets_touch_has_a_fan_for_each() {
    for k in 1..5 {
        let (fans, reversed) = checked(&bow_tie(k, 5));
        let around: BTreeSet<u32> = (0..5 * k).map(|t| fans.of_triangle(t as usize)[0]).collect();
        assert_eq!((around.len(), reversed), (k as usize, 0));
        assert!(around.iter().all(|&f| fans.is_closed(f as usize)));
    }
}

#[test]
fn the_pages_of_a_book_are_not_linked() {
    for pages in [1, 2, 3, 7, 40] {
        let (fans, _) = checked(&generate::book(pages).triangles);
        let expected = if pages == 2 { 4 } else { 3 * pages as usize };
        assert_eq!(fans.len(), expected);
        assert!((0..fans.len()).all(|f| !fans.is_closed(f)));
    }
}

#[test]
fn twins_are_two_sheets() {
    for twins in [[[0, 1, 2], [0, 2, 1]], [[0, 1, 2], [1, 2, 0]]] {
        let (fans, reversed) = checked(&twins);
        assert_eq!((fans.len(), reversed), (6, 0));
        assert!((0..6).all(|f| !fans.is_closed(f) && fans.corners(f).len() == 1));
    }
}

/// A surface and the same surface with its other side has the same fans, and once more these.
#[test]
fn the_other_side_of_a_surface_has_fans_of_its_own() {
    for shape in [generate::icosphere(2), generate::grid(5), generate::uv_sphere(60, 4)] {
        let mut both = shape.triangles.clone();
        both.extend(shape.triangles.iter().map(|&[a, b, c]| [a, c, b]));
        let (one, _) = checked(&shape.triangles);
        let (fans, reversed) = checked(&both);
        assert_eq!((fans.len(), reversed), (2 * one.len(), 0), "{}", shape.name);
        for fan in 0..fans.len() {
            let front = shape.triangles.len();
            let is_front = fans.corners(fan)[0].triangle() < front;
            assert!(fans.corners(fan).iter().all(|c| (c.triangle() < front) == is_front), "{}", shape.name);
        }
    }
}

#[test]
fn a_hub_of_a_hundred_thousand_triangles_is_one_fan() {
    const N: u32 = 100_000;
    // The triangles come in an order and winding that say nothing about their place around the hub.
    let shuffled = |i: u32| ((u64::from(i) * 77_777) % u64::from(N)) as u32;
    let spoke = |i: u32| {
        let (a, b) = (1 + i, 1 + (i + 1) % N);
        [[0, a, b], [b, 0, a], [0, b, a]][i as usize % 3]
    };
    let closed: Vec<[u32; 3]> = (0..N).map(|i| spoke(shuffled(i))).collect();
    let fans = fans_of(&closed);
    assert_are_fans(&closed, &fans);
    assert_eq!(fans.corners(0).len(), N as usize);
    assert!(fans.is_closed(0));
    let open: Vec<[u32; 3]> = closed[1..].to_vec();
    let fans = fans_of(&open);
    assert_are_fans(&open, &fans);
    assert!(fans.corners(0).len() == N as usize - 1 && !fans.is_closed(0));
}

#[test]
fn fans_do_not_depend_on_threads() {
    let mut triangles = generate::torus(150, 90).triangles;
    // Make some of it non-manifold: extra triangles between vertices that are there already.
    triangles.extend((0..2000u32).map(|i| [i * 5, i * 5 + 1, (i * 7919) % 13_000]));
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    let listed = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let fans = fans_of(&triangles);
            (0..fans.len()).map(|f| (fans.corners(f).to_vec(), fans.is_closed(f))).collect::<Vec<_>>()
        })
    };
    let one = listed(1);
    assert_eq!(one, listed(2));
    assert_eq!(one, listed(4));
}

/// Soups with so few vertices that everything non-manifold happens: books, bow-ties, twins, duplicates.
fn soup() -> impl Strategy<Value = Vec<[u32; 3]>> {
    (4u32..12).prop_flat_map(|n| {
        let triangle = [0..n, 0..n, 0..n].prop_filter("degenerate", |[a, b, c]| a != b && b != c && c != a);
        prop::collection::vec(triangle, 1..40)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn random_soups_agree_with_the_reference(triangles in soup()) {
        checked(&triangles);
    }

    /// A vertex of high degree takes another way than a small one: around a hub both give the same.
    #[test]
    fn busy_hubs_agree_with_the_reference(
        spokes in prop::collection::vec((1u32..30, 1u32..30), 25..60),
    ) {
        let triangles: Vec<[u32; 3]> =
            spokes.into_iter().filter(|(a, b)| a != b).map(|(a, b)| [a, 0, b]).collect();
        if !triangles.is_empty() {
            checked(&triangles);
        }
    }
}

// Rays and nearest points on real meshes, compared with asking every triangle.

/// Deterministic numbers in -1..1.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.point();
            if (0.01..1.0).contains(&p.length_squared()) {
                return p.normalize();
            }
        }
    }

    fn lambda(&mut self) -> Vec3 {
        let (a, b) = (0.5 + 0.5 * self.next(), 0.5 + 0.5 * self.next());
        let r = a.sqrt();
        Vec3::new(1.0 - r, r * (1.0 - b), r * b)
    }
}

fn at(mesh: &Mesh, triangle: usize, lambda: Vec3) -> Vec3 {
    interpolate(mesh.triangle_positions(triangle), lambda)
}

fn face_normal(mesh: &Mesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle).map(|p| p.as_dvec3());
    (b - a).cross(c - a).normalize().as_vec3()
}

/// Distance along the ray and triangle, in double precision, of the first triangle (Moeller and Trumbore).
fn slowly(mesh: &Mesh, origin: Vec3, direction: Vec3) -> Option<(f64, usize)> {
    let (o, d) = (origin.as_dvec3(), direction.as_dvec3());
    let hit = |t: usize| {
        let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
        let (e, f) = (b - a, c - a);
        let p = d.cross(f);
        let determinant = e.dot(p);
        let (s, q) = (o - a, (o - a).cross(e));
        let (u, v, t_ray) = (s.dot(p) / determinant, d.dot(q) / determinant, f.dot(q) / determinant);
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t_ray > 0.0).then_some((t_ray, t))
    };
    (0..mesh.triangles.len()).filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0))
}

#[test]
fn hits_are_those_of_asking_every_triangle() {
    let Some(folder) = data_folder() else { return };
    for name in ["suzanne.ply", "teapot.stl", "WaterBottle/WaterBottle.gltf"] {
        let mesh = loaded(&folder.join("meshes"), name);
        let bvh = TriangleBvh::new(&mesh);
        let mut numbers = Numbers(1);
        let mut hits = 0;
        for _ in 0..3000 {
            let origin = numbers.point() * 1.5;
            let direction = (numbers.point() * 0.6 - origin).normalize();
            let expected = slowly(&mesh, origin, direction);
            let found = bvh.first_hit(origin, direction, f32::INFINITY);
            assert_eq!(found.is_some(), bvh.is_occluded(origin, direction, f32::INFINITY));
            let (Some((distance, triangle)), Some(hit)) = (expected, found) else {
                assert_eq!(expected.is_some(), found.is_some(), "{name}: {origin} {direction}");
                continue;
            };
            hits += 1;
            assert!((f64::from(hit.distance) - distance).abs() < 1e-5, "{name}");
            assert!(hit.point.position(&mesh).distance(origin + direction * hit.distance) < 1e-5);
            assert_eq!(hit.front, face_normal(&mesh, hit.point.index()).dot(direction) < 0.0);
            // Triangles that meet there may stand for each other.
            assert!(hit.point.index() == triangle || hit.point.lambda.min_element() < 1e-4, "{name}");
            assert!(bvh.first_hit(origin, direction, hit.distance * 0.999).is_none());
            assert!(bvh.is_occluded(origin, direction, hit.distance * 1.001));
        }
        assert!(hits > 300, "{name}: {hits}");
    }
}

#[test]
fn no_ray_escapes_from_a_closed_mesh() {
    let mesh = cleaned(generate::uv_sphere(64, 33));
    let bvh = TriangleBvh::new(&mesh);
    for origin in [Vec3::ZERO, Vec3::new(0.3, -0.2, 0.11), Vec3::new(0.0, 0.9, 0.0)] {
        // At corners and at the middles of edges, where triangles meet.
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let corners = mesh.triangle_positions(t);
            for k in 0..3 {
                for target in [corners[k], 0.5 * (corners[k] + corners[(k + 1) % 3])] {
                    let hit = bvh.first_hit(origin, target - origin, f32::INFINITY);
                    let hit = hit.unwrap_or_else(|| panic!("{origin} to {target} of {triangle:?}"));
                    assert!((hit.distance - 1.0).abs() < 1e-5 && !hit.front);
                }
            }
        }
        let mut numbers = Numbers(2);
        assert!((0..100_000).all(|_| bvh.is_occluded(origin, numbers.direction(), 4.0)));
    }
    // Along the axes, in planes that hold vertices, boxes are entered through their corners.
    let cube = cleaned(generate::cube(8));
    let bvh = TriangleBvh::new(&cube);
    for i in -16..=16 {
        for j in -16..=16 {
            for direction in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
                let (u, v) = direction.any_orthonormal_pair();
                let origin = u * (i as f32 / 17.0) + v * (j as f32 / 17.0);
                assert!(bvh.is_occluded(origin, direction, f32::INFINITY), "{origin} {direction}");
                let on_lines = u * (i as f32 / 16.0) + v * (j as f32 / 16.0) - 2.0 * direction;
                assert!(bvh.is_occluded(on_lines, direction, f32::INFINITY), "{on_lines} {direction}");
            }
        }
    }
}

#[test]
fn rays_from_the_surface_do_not_see_where_they_start() {
    let mesh = cleaned(generate::icosphere(5));
    let bvh = TriangleBvh::new(&mesh);
    let mut numbers = Numbers(3);
    for i in 0..200_000 {
        let triangle = i * 7 % mesh.triangles.len();
        let normal = face_normal(&mesh, triangle);
        let p = at(&mesh, triangle, numbers.lambda());
        let direction = numbers.direction();
        let outwards = direction * direction.dot(normal).signum();
        // The sphere is convex: outwards there is nothing at all, and inwards there is the other side.
        assert!(!bvh.is_occluded(origin_beside(p, normal, outwards), outwards, f32::INFINITY), "{i}");
        let inwards = -outwards;
        if inwards.dot(normal) < -0.05 {
            let hit = bvh.first_hit(origin_beside(p, normal, inwards), inwards, f32::INFINITY).unwrap();
            assert!(hit.distance > 0.02 && !hit.front, "{i}: {hit:?}");
        }
    }
    assert_eq!(origin_beside(Vec3::ZERO, Vec3::Z, Vec3::new(1.0, 0.0, -0.1)).z, -SURFACE_OFFSET);
}

#[test]
fn nearest_points_are_those_of_asking_every_triangle() {
    let Some(folder) = data_folder() else { return };
    let mesh = loaded(&folder.join("meshes"), "suzanne.ply");
    let bvh = TriangleBvh::new(&mesh);
    let mut numbers = Numbers(4);
    for _ in 0..2000 {
        let p = numbers.point() * 1.2;
        let found = bvh.nearest_point(p, f32::INFINITY).unwrap();
        assert!((found.point.position(&mesh) - found.position).length() < 1e-6);
        assert!((found.position.distance(p) - found.distance).abs() < 1e-6);
        // A mesh of one triangle at a time.
        let alone = |t: usize| {
            let triangle = Mesh {
                positions: mesh.triangle_positions(t).to_vec(),
                triangles: vec![[0, 1, 2]],
                ..Mesh::default()
            };
            TriangleBvh::new(&triangle).nearest_point(p, f32::INFINITY).unwrap().distance
        };
        let nearest = (0..mesh.triangles.len()).step_by(3).map(alone).fold(f32::INFINITY, f32::min);
        assert!(found.distance <= nearest + 1e-6);
        assert!((alone(found.point.index()) - found.distance).abs() < 1e-6);
        assert!(bvh.nearest_point(p, found.distance * 0.999).is_none());
        assert!(bvh.nearest_point(p, found.distance * 1.001).is_some());
    }
}

#[test]
fn cut_outs_let_rays_through() {
    let model = generate::grid(2);
    let mut doubled = model.clone();
    doubled.positions.extend(model.positions.iter().map(|p| p - DVec3::Y));
    let count = model.positions.len() as u32;
    doubled.triangles.extend(model.triangles.iter().map(|t| t.map(|v| v + count)));
    let mesh = cleaned(doubled);
    let bvh = TriangleBvh::new(&mesh);
    let (origin, down) = (Vec3::new(0.3, 2.0, 0.2), Vec3::NEG_Y);
    let top = bvh.first_hit(origin, down, f32::INFINITY).unwrap();
    let through =
        bvh.first_hit_where(origin, down, f32::INFINITY, |h| h.point.triangle != top.point.triangle).unwrap();
    assert!((through.distance - top.distance - 1.0).abs() < 1e-5);
    assert!(!bvh.is_occluded_where(origin, down, f32::INFINITY, |_| false));
}

#[test]
fn what_is_no_ray_hits_nothing() {
    let mesh = cleaned(generate::icosphere(1));
    let bvh = TriangleBvh::new(&mesh);
    for bad in [Vec3::ZERO, Vec3::NAN, Vec3::new(f32::INFINITY, 0.0, 0.0)] {
        assert!(bvh.first_hit(Vec3::ZERO, bad, f32::INFINITY).is_none());
        assert!(!bvh.is_occluded(Vec3::ZERO, bad, 1.0));
    }
    assert!(bvh.first_hit(Vec3::NAN, Vec3::X, 1.0).is_none());
    assert!(bvh.first_hit(Vec3::ZERO, Vec3::X, f32::NAN).is_none());
    assert!(bvh.nearest_point(Vec3::NAN, 1.0).is_none());
    let empty = TriangleBvh::new(&Mesh::default());
    assert!(
        empty.first_hit(Vec3::ZERO, Vec3::X, 1.0).is_none() && empty.nearest_point(Vec3::X, 9.0).is_none()
    );
}

/// The boxes of all triangles around a vertex of high degree overlap; the tree is right all the same. (That it is built another way,
/// and how deep it is, is tested where it is built.)
/// (Straight down is -0 along the other axes.)
#[test]
fn rays_find_the_needles_of_a_disc_of_fifty_thousand() {
    for count in [50_u32, 50_000] {
        let mut mesh = Mesh { positions: vec![Vec3::ZERO], ..Mesh::default() };
        let rim =
            |i: u32| glam::Vec2::from_angle(i as f32 / count as f32 * std::f32::consts::TAU).extend(0.0);
        mesh.positions.extend((0..count).map(rim));
        mesh.triangles.extend((0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]));
        let tree = TriangleBvh::new(&mesh);
        for i in 0..100 {
            let at = glam::Vec2::from_angle(i as f32).extend(0.0) * 0.7;
            for direction in [-Vec3::Z, Vec3::new(0.0, 0.0, -1.0), Vec3::new(0.1, 0.2, -1.0)] {
                let hit = tree.first_hit(at - direction, direction, f32::INFINITY);
                assert!(hit.is_some_and(|hit| (hit.distance - 1.0).abs() < 1e-5), "{i}: {hit:?}");
            }
        }
    }
}

// Tangents against the reference implementation of MikkTSpace.

struct Reference<'a> {
    mesh: &'a Mesh,
    normals: &'a [Vec3],
    uv: &'a [Vec2],
    tangents: Vec<Option<Vec4>>,
}

impl Geometry for Reference<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.triangle_positions(face)[corner].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.normals[3 * face + corner].to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        // Its v points upwards.
        let uv = self.uv[3 * face + corner];
        [uv.x, 1.0 - uv.y]
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        self.tangents[3 * face + corner] = tangent.map(|t| Vec4::from(t.tangent_encoded()));
    }
}

#[test]
fn tangents_are_those_of_mikktspace() {
    let Some(folder) = data_folder() else { return };
    for name in ["WaterBottle/WaterBottle.gltf", "spot/spot_triangulated.obj", "suzanne.ply"] {
        let model = load(&folder.join("meshes").join(name), &LoadOptions::default()).unwrap();
        let mesh = clean(model, &CleanOptions::default()).unwrap().0;
        let normals = shading_normals(&mesh);
        let uv = &mesh.corners.uv_sets[0];
        let tangents = corner_tangents(&mesh, &normals, |t| Some([0, 1, 2].map(|k| uv[3 * t + k])));
        let empty = vec![None; tangents.len()];
        let mut reference = Reference { mesh: &mesh, normals: &normals, uv, tangents: empty };
        generate_tangents(&mut reference).unwrap();
        let (mut compared, mut different, mut flipped) = (0, 0, 0);
        for (own, theirs) in tangents.iter().zip(&reference.tangents) {
            let Some(theirs) = theirs else { continue };
            compared += 1;
            flipped += u32::from(own.w != theirs.w);
            different += u32::from(own.truncate().angle_between(theirs.truncate()).to_degrees() > 0.1);
        }
        eprintln!(
            "{name}: {compared} corners, {different} differ by more than 0.1 degrees, {flipped} in handedness"
        );
        assert!(compared > tangents.len() as u32 / 2, "{name}");
        // Corners where triangles touch in the vertex alone, or without area in the image, are joined differently.
        assert!(different * 1000 <= compared && flipped == 0, "{name}");
    }
}

/// As MikkTSpace has it: what has no area in the image does not turn the tangents of its neighbours.
#[test]
fn facets_without_area_in_the_image_turn_no_tangents() {
    // A square that shows the image, and a third triangle at its right side on which the image is a line.
    let places = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (1.5, 0.2)];
    let positions = places.map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec();
    let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]];
    let uv = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0), (1.0, 3.0)].map(|(u, v)| Vec2::new(u, v));
    let mesh = Mesh { positions, triangles, ..Mesh::default() };
    let normals = [Vec3::Z; 9];
    let tangents =
        corner_tangents(&mesh, &normals, |t| Some(mesh.triangles[t].map(|vertex| uv[vertex as usize])));
    for (corner, tangent) in tangents.iter().enumerate().filter(|(corner, _)| *corner != 7) {
        assert!((*tangent - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-6, "corner {corner}: {tangent}");
    }
}

fn one_triangle(corners: [Vec3; 3]) -> TriangleBvh {
    TriangleBvh::new(&Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Mesh::default() })
}

#[test]
fn a_crossing_is_where_the_barycentric_coordinates_say() {
    let bvh = one_triangle([Vec3::ZERO, Vec3::X, Vec3::Y]);
    for (origin, front) in [(Vec3::new(0.3, 0.1, 2.0), true), (Vec3::new(-0.4, 0.2, -3.0), false)] {
        let target = Vec3::new(0.25, 0.25, 0.0);
        let hit = bvh.first_hit(origin, (target - origin) * 0.5, f32::INFINITY).unwrap();
        assert!((hit.point.lambda - Vec3::new(0.5, 0.25, 0.25)).length() < 1e-6, "{}", hit.point.lambda);
        assert!((hit.distance - 2.0).abs() < 1e-6);
        assert_eq!(hit.front, front);
    }
}

#[test]
fn corners_and_edges_belong_to_the_triangle_and_nothing_beside_it() {
    let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let bvh = one_triangle(triangle);
    let meets = |o: Vec3, d: Vec3| bvh.is_occluded(o, d, f32::INFINITY);
    assert!(triangle.iter().all(|&corner| meets(corner + Vec3::Z, Vec3::NEG_Z)));
    assert!(meets(Vec3::new(0.5, 0.5, 1.0), Vec3::NEG_Z), "on an edge");
    assert!(meets(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z));
    assert!(!meets(Vec3::new(0.2, 0.2, 1.0), Vec3::Z));
    assert!(!meets(Vec3::new(0.6, 0.6, 1.0), Vec3::NEG_Z));
    assert!(!meets(Vec3::new(-1.0, 0.2, 0.0), Vec3::X), "within the plane");
}

/// The smallest of many distances to a fine grid of points on the triangle bounds the nearest from above.
#[test]
fn no_other_point_of_the_triangle_is_nearer() {
    let triangle = [Vec3::new(0.1, -0.3, 0.2), Vec3::new(0.9, 0.2, -0.4), Vec3::new(-0.2, 0.7, 0.5)];
    let bvh = one_triangle(triangle);
    let n = 60_u16;
    for i in 0..500_u32 {
        let coordinate = |k: u32| ((i * 7919 + k * 104_729) % 1000) as f32 / 250.0 - 2.0;
        let p = Vec3::new(coordinate(1), coordinate(2), coordinate(3));
        let nearest = bvh.nearest_point(p, f32::INFINITY).unwrap();
        let lambda = nearest.point.lambda;
        assert!(lambda.min_element() >= 0.0 && (lambda.element_sum() - 1.0).abs() < 1e-6);
        let sampled = (0..=n)
            .flat_map(|i| (0..=n - i).map(move |j| [i, j, n - i - j]))
            .map(|l| p.distance(interpolate(triangle, Vec3::from(l.map(f32::from)) / f32::from(n))))
            .fold(f32::INFINITY, f32::min);
        let distance = nearest.distance;
        assert!(distance <= sampled + 1e-6 && sampled - distance < 0.03, "{distance} {sampled}");
    }
}

/// A cube whose fans are cut at its edges: six faces, whose fans share no corner, and every corner is in one.
#[test]
fn fans_are_cut_at_spokes() {
    let mesh = fantex_test::cleaned(generate::cube(2));
    let fans = Fans::of(&mesh.triangles, &VertexCorners::of(&mesh.triangles, mesh.positions.len()));
    let normal = |corner: FanCorner| mesh.facet_normal(corner.triangle());
    let cut = fans.cut(|before, after| normal(before).dot(normal(after)) < 0.5);
    // Per face nine vertices, of which only the middle one's fan is closed.
    assert_eq!(cut.len(), 6 * 9);
    assert_eq!((0..cut.len()).filter(|&fan| cut.is_closed(fan)).count(), 6);
    let mut seen = vec![0; 3 * mesh.triangles.len()];
    for fan in 0..cut.len() {
        let corners = cut.corners(fan);
        for pair in corners.windows(2) {
            // Neighbours in the list share the spoke between them.
            let [a, b] = [pair[0], pair[1]].map(|c| (mesh.triangles[c.triangle()], c.slots()));
            assert_eq!(a.0[a.1[2]], b.0[b.1[1]]);
        }
        for &corner in corners {
            assert_eq!(normal(corner), normal(corners[0]));
            assert_eq!(cut.of_corner(corner.corner() as usize), fan as u32);
            seen[corner.corner() as usize] += 1;
        }
    }
    assert!(seen.iter().all(|&n| n == 1));
    // One cut alone leaves a closed fan as it is.
    let first = fans.corners(0)[0];
    assert_eq!(fans.cut(|before, _| before == first).len(), fans.len());
}
