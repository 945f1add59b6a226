//! Distances along the surface.

use std::sync::Arc;

use fantex_mesh::{Mesh, generate};
use fantex_paint::{Region, Surface, SurfacePoint};
use glam::{DVec3, Vec3};
use proptest::prelude::*;

use crate::{cleaned, cover, mesh_of, plate};

fn surface(mesh: &Mesh) -> Surface {
    Surface::new(Arc::new(mesh.clone()), Arc::new(cover(mesh, 64, 4000)))
}

fn grid() -> impl Iterator<Item = Vec3> {
    let n = 6;
    (0..=n).flat_map(move |i| {
        (0..=n - i).map(move |j| Vec3::new(i as f32, j as f32, (n - i - j) as f32) / n as f32)
    })
}

/// Calls back with every reached point on a grid, its distance and its position.
fn for_each_point(surface: &Surface, region: &Region, mut visit: impl FnMut(u32, f32, DVec3)) {
    for entry in &region.triangles {
        for lambda in grid() {
            let point = SurfacePoint { triangle: entry.triangle, lambda };
            visit(entry.triangle, entry.distance(lambda), surface.position(point));
        }
    }
}

#[test]
fn in_a_plane_distances_are_straight() {
    // From two large triangles to many small irregular ones.
    for n in [1u32, 4, 23] {
        let side = n + 1;
        let positions = (0..side * side).map(|i| {
            let (x, y) = (i % side, i / side);
            let inner =
                |k: u32| if k == 0 || k == n { 0.0 } else { 0.35 * f64::from((i * 37 + k * 11) % 17) / 17.0 };
            DVec3::new(f64::from(x) + inner(x), 0.0, f64::from(y) + inner(y)) / f64::from(n)
        });
        let triangles = (0..n * n).flat_map(|i| {
            let a = i / n * side + i % n;
            [[a, a + side, a + 1], [a + 1, a + side, a + side + 1]]
        });
        let mesh = mesh_of(positions.collect(), triangles.collect());
        let surface = surface(&mesh);
        let center = surface.nearest(Vec3::new(0.1, 0.0, -0.2), f32::INFINITY).unwrap();
        let origin = surface.position(center);
        for radius in [0.05, 0.3, 3.0] {
            let region = Region::grow(&surface, center, radius);
            for_each_point(&surface, &region, |_, distance, p| {
                let straight = p.distance(origin) as f32;
                assert!((distance - straight).abs() < 1e-5 * (1.0 + straight), "{n}: {distance} {straight}");
            });
            if radius > 2.0 {
                assert_eq!(region.triangles.len(), mesh.triangles.len());
            }
        }
    }
}

#[test]
fn on_a_sphere_distances_are_arcs() {
    let mesh = cleaned(generate::icosphere(5));
    let surface = surface(&mesh);
    let center = surface.nearest(Vec3::new(0.3, 0.8, 0.1), f32::INFINITY).unwrap();
    let origin = surface.position(center).normalize();
    let radius = surface.position(center).length();
    let region = Region::grow(&surface, center, 1.2 * radius as f32);
    let mut worst = 0.0f64;
    for_each_point(&surface, &region, |_, distance, p| {
        let arc = radius * origin.angle_between(p.normalize());
        if arc > 0.1 * radius {
            worst = worst.max((f64::from(distance) / arc - 1.0).abs());
        }
    });
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn the_back_of_a_thin_plate_is_far() {
    let mesh = plate(20, 0.002);
    let surface = surface(&mesh);
    let middle = surface.hit(Vec3::Y, Vec3::new(0.013, -1.0, 0.02)).unwrap();
    let region = Region::grow(&surface, middle, 0.8);
    assert!(region.triangles.len() > 100);
    assert!(region.triangles.iter().all(|t| surface.facet_normal(t.triangle).y > 0.9), "the back is reached");
    // Near the rim the way around is short, and that is what counts.
    let rim = surface.hit(Vec3::new(0.85, 1.0, 0.02), Vec3::NEG_Y).unwrap();
    let region = Region::grow(&surface, rim, 0.5);
    let below = surface.hit(Vec3::new(0.85, -1.0, 0.02), Vec3::Y).unwrap();
    let distance = region.get(below.triangle).unwrap().distance(below.lambda);
    assert!((distance - 0.302).abs() < 0.01, "{distance}");
    // Farther from the rim it is farther than it seems from either side.
    let inner = surface.hit(Vec3::new(0.72, 1.0, 0.02), Vec3::NEG_Y).unwrap();
    let below = surface.hit(Vec3::new(0.72, -1.0, 0.02), Vec3::Y).unwrap();
    assert!(Region::grow(&surface, inner, 0.4).get(below.triangle).is_none());
}

/// Two halves of the square -1..1 in x and z that are `gap` apart in x, the right one with `n` times as many rows and turned by
/// `bend` about the gap; they share no vertices.
fn halves(n: u32, gap: f64, bend: f64) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (side, columns, rows) in [(-1.0, 3, 3), (1.0, 3 * n, 3 * n)] {
        let first = positions.len() as u32;
        for k in 0..(columns + 1) * (rows + 1) {
            let (i, j) = (k % (columns + 1), k / (columns + 1));
            let x = 0.5 * gap + f64::from(i) / f64::from(columns);
            let turned =
                if side > 0.0 { DVec3::new(x * bend.cos(), x * bend.sin(), 0.0) } else { DVec3::X * -x };
            positions.push(turned + DVec3::Z * (2.0 * f64::from(j) / f64::from(rows) - 1.0));
        }
        for k in 0..columns * rows {
            let a = first + k / columns * (columns + 1) + k % columns;
            triangles.extend([[a, a + columns + 1, a + 1], [a + 1, a + columns + 1, a + columns + 2]]);
        }
    }
    mesh_of(positions, triangles)
}

#[test]
fn across_gaps_distances_are_straight_as_well() {
    // The border's vertices do not meet: three rows beside seven times as many, and without a gap T-junctions.
    for (n, gap, from) in [(7, 0.0, -0.1), (7, 0.004, -0.1), (5, 0.004, 0.1), (1, 0.0, 0.2)] {
        let surface = surface(&halves(n, gap, 0.0));
        let scale = 1.0 / surface.mesh().world_from_mesh.scale;
        let at =
            |x: f64| surface.nearest((DVec3::new(x, 0.0, 0.13) * scale).as_vec3(), f32::INFINITY).unwrap();
        let (center, radius) = (at(from), (0.5 * scale) as f32);
        let beyond = at(-from);
        assert!(n == 1 || Region::grow(&surface, center, radius).get(beyond.triangle).is_none());
        let region = Region::grow_across(&surface, center, radius, (0.01 * scale) as f32);
        assert!(region.get(beyond.triangle).is_some(), "{n} {gap}");
        let origin = surface.position(center);
        for_each_point(&surface, &region, |_, distance, p| {
            let straight = p.distance(origin) as f32;
            let is_far = straight > radius && distance > radius - 1e-4;
            assert!(
                is_far || (distance - straight).abs() < 4e-3 * radius,
                "{n} {gap}: {distance} {straight}"
            );
        });
        // A gap that is wider ends it.
        let region = Region::grow_across(&surface, center, radius, (0.5 * gap * scale) as f32);
        assert_eq!(region.get(beyond.triangle).is_some(), gap == 0.0);
    }
}

#[test]
fn gaps_are_crossed_around_corners_and_not_onto_the_back() {
    for (degrees, is_reached) in [(0.0f64, true), (90.0, true), (-90.0, true), (178.0, false)] {
        let surface = surface(&halves(4, 0.004, degrees.to_radians()));
        let scale = (1.0 / surface.mesh().world_from_mesh.scale) as f32;
        // The left half begins with the first vertex.
        let center = SurfacePoint { triangle: 0, lambda: Vec3::new(0.4, 0.3, 0.3) };
        let region = Region::grow_across(&surface, center, 0.6 * scale, 0.02 * scale);
        let right = |t: &fantex_paint::RegionTriangle| t.triangle >= 18 && t.distance(Vec3::X) < 0.6 * scale;
        assert_eq!(region.triangles.iter().any(right), is_reached, "{degrees}");
    }
}

/// Where two triangles meet they agree; where the region ends, the brush has ended before.
fn check_continuity(mesh: &Mesh, start: u32, radius: f32) {
    let surface = surface(mesh);
    let center = SurfacePoint { triangle: start, lambda: Vec3::new(0.2, 0.5, 0.3) };
    let region = Region::grow(&surface, center, radius);
    assert!(region.triangles.windows(2).all(|pair| pair[0].triangle < pair[1].triangle));
    let mut edges = std::collections::BTreeMap::<[u32; 2], Vec<(u32, [usize; 2])>>::new();
    for (t, triangle) in (0u32..).zip(&mesh.triangles) {
        for k in 0..3 {
            let (i, j) = (k, (k + 1) % 3);
            let ends = if triangle[i] < triangle[j] { [i, j] } else { [j, i] };
            edges.entry(ends.map(|e| triangle[e])).or_default().push((t, ends));
        }
    }
    for sides in edges.values().filter(|sides| sides.len() == 2) {
        for s in [0.0, 0.2, 0.5, 0.9, 1.0] {
            let distances: Vec<f32> = sides
                .iter()
                .map(|&(t, [i, j])| {
                    let mut lambda = Vec3::ZERO;
                    (lambda[i], lambda[j]) = (1.0 - s, s);
                    region.get(t).map_or(f32::INFINITY, |entry| entry.distance(lambda))
                })
                .collect();
            let [a, b] = [distances[0], distances[1]];
            let agree = (a - b).abs() < 1e-5 || a.min(b) >= radius - 1e-5;
            assert!(agree, "{a} {b} at an edge of {} and {}", sides[0].0, sides[1].0);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn distances_are_continuous(seed in 0u32..1_000_000, radius in 0.02f32..1.5, bumps in 0.0f64..0.6) {
        let mut model = generate::icosphere(3);
        for (i, p) in (0u32..).zip(&mut model.positions) {
            let noise = f64::from((i ^ seed).wrapping_mul(2_654_435_761) >> 16) / 65536.0;
            *p *= 1.0 + bumps * (noise - 0.5);
        }
        let mesh = cleaned(model);
        check_continuity(&mesh, seed % mesh.triangles.len() as u32, radius);
    }
}
