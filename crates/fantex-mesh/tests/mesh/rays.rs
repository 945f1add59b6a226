//! Rays and nearest points on real meshes, compared with asking every triangle.

use crate::common::data_folder;
use fantex_mesh::{Mesh, SURFACE_OFFSET, TriangleBvh, generate, origin_beside};
use fantex_test::{cleaned, loaded};
use glam::{DVec3, Vec3};

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
    let [a, b, c] = mesh.triangle_positions(triangle);
    a * lambda.x + b * lambda.y + c * lambda.z
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
            assert!(at(&mesh, hit.triangle, hit.lambda).distance(origin + direction * hit.distance) < 1e-5);
            assert_eq!(hit.front, face_normal(&mesh, hit.triangle).dot(direction) < 0.0);
            // Triangles that meet there may stand for each other.
            assert!(hit.triangle == triangle || hit.lambda.min_element() < 1e-4, "{name}");
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
        assert!((at(&mesh, found.triangle, found.lambda) - found.position).length() < 1e-6);
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
        assert!((alone(found.triangle) - found.distance).abs() < 1e-6);
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
    let through = bvh.first_hit_where(origin, down, f32::INFINITY, |h| h.triangle != top.triangle).unwrap();
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
