//! Placed intermediate surfaces and the four ways from an object to them.

use std::f32::consts::{FRAC_PI_2, TAU};

use fantex_base::Aabb;
use fantex_texture::{
    HemisphereLayout, HemisphereMap, Mapping, OMap, Placement, SMap, ShadingPoint, Shape, ShapeKind,
    SphereMap, TwoPartMapping,
};
use glam::{Quat, Vec2, Vec3};

use crate::common::{Random, shading_point};

const BOUNDS: Aabb = Aabb { min: Vec3::new(-1.0, -1.5, -0.8), max: Vec3::new(1.2, 1.0, 1.1) };

fn shapes() -> Vec<Shape> {
    let side_by_side = HemisphereMap { layout: HemisphereLayout::SideBySide, ..HemisphereMap::fit(BOUNDS) };
    let mut shapes: Vec<_> = ShapeKind::ALL.into_iter().map(|kind| kind.fit(BOUNDS)).collect();
    shapes.push(Shape::Hemispheres(side_by_side));
    shapes
}

fn placement(random: &mut Random) -> Placement {
    Placement {
        pivot: BOUNDS.center(),
        scale: Vec3::splat(1.2) + 0.5 * random.vector(),
        rotation: Quat::from_scaled_axis(2.0 * random.vector()),
        translation: 0.3 * random.vector(),
    }
}

fn o_maps() -> [OMap; 4] {
    [OMap::Reflection, OMap::ObjectNormal, OMap::Centroid { center: Vec3::splat(0.1) }, OMap::SurfaceNormal]
}

/// A point of a bumpy ball well inside all surfaces, with a footprint that is as wide as `step`.
fn ball_point(random: &mut Random, step: f32) -> ShadingPoint<'static> {
    let n = random.direction();
    let (right, down) = n.any_orthonormal_pair();
    let tilt = 0.2 * random.vector();
    ShadingPoint {
        position_steps: [right * step, down * step],
        normal_steps: [right * step * (2.0 + tilt.x), down * step * (2.0 + tilt.y)],
        eye: Some((n + 0.5 * random.vector()).normalize().into()),
        ..shading_point(0.4 * n, n)
    }
}

/// The difference of coordinates, across a seam if that is shorter.
fn difference(a: Vec2, b: Vec2) -> Vec2 {
    let d = a - b;
    Vec2::new(d.x - d.x.round(), d.y)
}

#[test]
fn footprints_of_placed_surfaces_equal_finite_differences() {
    let mut random = Random::new(11);
    for shape in shapes() {
        let mut compared = 0;
        for _ in 0..400 {
            let map = SMap::new(shape, &placement(&mut random)).unwrap();
            let (p, n) = (2.0 * random.vector(), random.direction());
            let moves = [random.direction(), random.direction()].map(|d| d * 4e-3);
            let got = map.uv_footprint(p, n, moves[0], moves[1]);
            for (direction, got) in moves.into_iter().zip(got) {
                let ahead = map.uv(p + 0.5 * direction, n);
                let behind = map.uv(p - 0.5 * direction, n);
                let expected = difference(ahead, behind);
                // Left out: where another disc begins, and the axis, where the derivative changes within the step.
                if expected.length() < 0.02 {
                    compared += 1;
                    assert!((got - expected).length() < 2e-4, "{shape:?} at {p}: {got} against {expected}");
                }
            }
        }
        assert!(compared > 700, "{shape:?}: only {compared} comparisons");
    }
}

#[test]
fn points_of_placed_surfaces_have_the_coordinates_they_were_asked_by() {
    let mut random = Random::new(12);
    for shape in shapes() {
        for _ in 0..300 {
            let map = SMap::new(shape, &placement(&mut random)).unwrap();
            let n = random.direction();
            // Within the disc of the hemispheres, and on the faces of a box.
            let uv = match shape {
                Shape::Hemispheres(map) => {
                    let disc = 0.5 + 0.69 * Vec2::new(random.unit() - 0.5, random.unit() - 0.5);
                    match map.layout {
                        HemisphereLayout::Shared => disc,
                        HemisphereLayout::SideBySide => {
                            Vec2::new(0.5 * disc.x + 0.5 * random.unit().round(), disc.y)
                        }
                    }
                }
                _ => 0.05 + 0.9 * Vec2::new(random.unit(), random.unit()),
            };
            let p = map.point(uv, n);
            assert!((map.uv(p, n) - uv).length() < 2e-5, "{shape:?}: {uv} became {}", map.uv(p, n));
        }
    }
}

#[test]
fn spheres_are_those_of_the_lecture_when_turned() {
    // x = r cos v cos u, y = r cos v sin u, z = r sin v has its axis along z and u = 0 at +x.
    let sphere = SphereMap { center: Vec3::ZERO, radius: 2.0, repeat: Vec2::ONE };
    let turn = Quat::from_mat3(&glam::Mat3::from_cols(Vec3::NEG_Y, Vec3::Z, Vec3::NEG_X));
    let map =
        SMap::new(Shape::Sphere(sphere), &Placement { rotation: turn, ..Placement::default() }).unwrap();
    let mut random = Random::new(13);
    for _ in 0..200 {
        let (u, v) = (TAU * random.unit(), FRAC_PI_2 * 0.99 * (2.0 * random.unit() - 1.0));
        let p = 2.0 * Vec3::new(v.cos() * u.cos(), v.cos() * u.sin(), v.sin());
        let expected = Vec2::new(u / TAU, 0.5 - v / (2.0 * FRAC_PI_2));
        assert!(difference(map.uv(p, p), expected).length() < 1e-5, "{} at {p}", map.uv(p, p));
        assert!(map.point(expected, p).distance(p) < 1e-5);
    }
}

#[test]
fn all_ways_meet_on_concentric_spheres() {
    let map = SMap::new(
        Shape::Sphere(SphereMap { center: Vec3::ZERO, radius: 3.0, repeat: Vec2::ONE }),
        &Placement::default(),
    )
    .unwrap();
    let mut random = Random::new(14);
    for _ in 0..200 {
        let n = random.direction();
        let at = shading_point(0.5 * n, n);
        for o_map in
            [OMap::Reflection, OMap::ObjectNormal, OMap::Centroid { center: Vec3::ZERO }, OMap::SurfaceNormal]
        {
            let uv = TwoPartMapping { s_map: map, o_map }.coordinates(&at).uv;
            assert!(difference(uv, map.uv(n, n)).length() < 1e-5, "{o_map:?}");
        }
    }
}

#[test]
fn rays_arrive_where_they_point() {
    let mut random = Random::new(15);
    for kind in ShapeKind::ALL {
        let s_map = SMap::new(kind.fit(BOUNDS), &Placement::default()).unwrap();
        for o_map in o_maps() {
            let mut skipped = 0;
            for _ in 0..300 {
                let at = ball_point(&mut random, 0.0);
                let (p, n) = (at.position, at.normal);
                let ray = match o_map {
                    OMap::Reflection => {
                        2.0 * n.dot(at.eye.unwrap().direction) * n - at.eye.unwrap().direction
                    }
                    OMap::ObjectNormal => n,
                    OMap::Centroid { center } => p - center,
                    OMap::SurfaceNormal => continue,
                };
                let uv = TwoPartMapping { s_map, o_map }.coordinates(&at).uv;
                // Rays through the ends of the cylinder arrive at the mantle beyond; rays along a plane go far.
                if (kind == ShapeKind::Cylinder && !(0.001..0.999).contains(&uv.y)) || uv.length() > 100.0 {
                    skipped += 1;
                    continue;
                }
                let sides = Vec3::AXES.into_iter().flat_map(|n| [n, -n]);
                let error = sides
                    .map(|side| (s_map.point(uv, side) - p).normalize().cross(ray.normalize()).length())
                    .fold(f32::INFINITY, f32::min);
                assert!(error < 2e-3, "{kind:?} {o_map:?}: off by {error} rad from {p} along {ray}");
            }
            assert!(skipped < 200, "{kind:?} {o_map:?}: {skipped} rays skipped");
        }
    }
}

#[test]
fn the_surface_normal_leads_to_the_nearest_point() {
    let mut random = Random::new(16);
    for kind in ShapeKind::ALL {
        let shape = kind.fit(BOUNDS);
        for _ in 0..300 {
            let p = BOUNDS.center() + 0.9 * random.vector() * 0.5 * BOUNDS.extent();
            let foot = shape.foot(p);
            let line = (foot.position - p).cross(foot.normal).length();
            assert!(line < 1e-5, "{kind:?}: {} is not above {p}", foot.position);
        }
    }
}

#[test]
fn footprints_of_two_part_mappings_equal_finite_differences() {
    let mut random = Random::new(17);
    for kind in ShapeKind::ALL {
        for o_map in o_maps() {
            let s_map = SMap::new(kind.fit(BOUNDS), &Placement::default()).unwrap();
            let mapping = TwoPartMapping { s_map, o_map };
            let (mut compared, mut agreeing) = (0, 0);
            for _ in 0..300 {
                let at = ball_point(&mut random, 4e-3);
                let got = mapping.coordinates(&at).steps;
                for (edge, [a, b]) in [[0.5, 0.0], [0.0, 0.5]].into_iter().enumerate() {
                    let ahead = at.shifted(a, b, |point| mapping.coordinates(point).uv);
                    let behind = at.shifted(-a, -b, |point| mapping.coordinates(point).uv);
                    let expected = difference(ahead, behind);
                    // Left out: edges of the box and the rim, the equator, poles, and rays along a plane.
                    if expected.length() < 0.02 {
                        let error = (got[edge] - expected).length();
                        compared += 1;
                        agreeing += usize::from(error < 2e-4 + 0.02 * expected.length());
                    }
                }
            }
            assert!(compared > 200, "{kind:?} {o_map:?}: only {compared} comparisons");
            // Some steps lie across an edge of the box or the rim.
            let share = agreeing as f32 / compared as f32;
            assert!(share > 0.97, "{kind:?} {o_map:?}: {share} of {compared} agree");
        }
    }
}

#[test]
fn both_sides_of_a_seam_have_the_same_footprint() {
    for kind in [ShapeKind::Sphere, ShapeKind::Cylinder] {
        let s_map = SMap::new(kind.fit(BOUNDS), &Placement::default()).unwrap();
        let center = BOUNDS.center();
        let beside = |x: f32| {
            let n = Vec3::new(x, 0.1, -1.0).normalize();
            ShadingPoint {
                position_steps: [Vec3::NEG_X * 0.01, Vec3::NEG_Y * 0.01],
                normal_steps: [Vec3::NEG_X * 0.02, Vec3::NEG_Y * 0.02],
                ..shading_point(center + 0.5 * n, n)
            }
        };
        let ways = [OMap::Reflection, OMap::ObjectNormal, OMap::Centroid { center }, OMap::SurfaceNormal];
        for o_map in ways {
            let mapping = TwoPartMapping { s_map, o_map };
            let [left, on, right] = [1e-4, 0.0, -1e-4].map(|x| mapping.coordinates(&beside(x)));
            assert!(
                (left.uv.x - right.uv.x).abs() > 0.99,
                "{kind:?}: {} and {} lie beside the seam",
                left.uv,
                right.uv
            );
            for point in [left, on, right] {
                for (edge, step) in point.steps.into_iter().enumerate() {
                    assert!(step.length() < 0.02, "{kind:?} {o_map:?}: {step} at the seam");
                    assert!((step - left.steps[edge]).length() < 1e-4, "{kind:?} {o_map:?}");
                }
            }
        }
    }
}

#[test]
fn nothing_is_infinite_at_poles_centres_and_along_axes() {
    for shape in shapes() {
        let s_map = SMap::new(shape, &Placement::default()).unwrap();
        let center = BOUNDS.center();
        let ways = [OMap::Reflection, OMap::ObjectNormal, OMap::Centroid { center }, OMap::SurfaceNormal];
        for o_map in ways {
            for n in Vec3::AXES.into_iter().flat_map(|n| [n, -n, Vec3::ZERO]) {
                for distance in [0.0, 0.5, 10.0] {
                    let at = ShadingPoint {
                        position_steps: [Vec3::X * 0.01, Vec3::Z * 0.01],
                        normal_steps: [Vec3::X * 0.02, Vec3::Z * 0.02],
                        ..shading_point(center + distance * n, n)
                    };
                    let point = TwoPartMapping { s_map, o_map }.coordinates(&at);
                    assert!(point.uv.is_finite(), "{shape:?} {o_map:?} along {n}");
                    assert!(point.steps.iter().all(|s| s.is_finite()), "{shape:?} {o_map:?} along {n}");
                }
            }
        }
    }
}

#[test]
fn ends_of_cylinders_are_folded_up() {
    // Radius 1 and height 2: a ray straight up, 0.75 from the axis, leaves a quarter from the rim.
    let bounds = Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE };
    let shape = ShapeKind::Cylinder.fit(bounds);
    let height = |origin: Vec3, direction: Vec3| shape.leave(origin, direction).unwrap().position.y;
    assert!((height(Vec3::X * 0.75, Vec3::Y) - 1.25).abs() < 1e-6);
    assert!((height(Vec3::X * 0.75, Vec3::NEG_Y) + 1.25).abs() < 1e-6);
    // Nothing breaks at the rim.
    let [below, above] = [0.999, 1.001].map(|slope| height(Vec3::ZERO, Vec3::new(1.0, slope, 0.0)));
    assert!(below < 1.0 && above > 1.0 && above - below < 3e-3, "{below} {above}");
}

#[test]
fn any_numbers_are_refused_or_mapped() {
    let mut random = Random::new(18);
    for round in 0..20_000 {
        let mut any = || match random.bits() % 4 {
            0 => f32::from_bits(random.bits() as u32),
            1 => 0.0,
            _ => 2.0 * random.unit() - 1.0,
        };
        let mut any3 = || Vec3::new(any(), any(), any());
        let bounds = Aabb { min: any3(), max: any3() };
        let placement = Placement {
            pivot: any3(),
            scale: any3(),
            rotation: Quat::from_vec4(any3().extend(1.0)),
            translation: any3(),
        };
        let at = ShadingPoint {
            position_steps: [any3(), any3()],
            normal_steps: [any3(), any3()],
            eye: Some(any3().into()),
            ..shading_point(any3(), any3())
        };
        let kind = ShapeKind::ALL[round % 5];
        if let Ok(s_map) = SMap::new(kind.fit(bounds), &placement) {
            for o_map in o_maps() {
                let point = TwoPartMapping { s_map, o_map }.coordinates(&at);
                assert!(point.steps.iter().all(|step| step.is_finite()), "{kind:?} {o_map:?}: {point:?}");
            }
        }
    }
}

#[test]
fn numbers_out_of_range_are_refused() {
    let sphere = SphereMap { center: Vec3::ZERO, radius: f32::NAN, repeat: Vec2::ONE };
    let error = SMap::new(Shape::Sphere(sphere), &Placement::default()).unwrap_err();
    assert_eq!(error.to_string(), "the radius of a sphere mapping is NaN; it must be finite and above 0");
    let sphere = ShapeKind::Sphere.fit(BOUNDS);
    let refused = |placement: Placement| SMap::new(sphere, &placement).unwrap_err();
    for placement in [
        Placement { scale: Vec3::new(1.0, 0.0, 1.0), ..Placement::default() },
        Placement { rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..Placement::default() },
        Placement { pivot: Vec3::NAN, ..Placement::default() },
        Placement { translation: Vec3::INFINITY, ..Placement::default() },
    ] {
        assert!(refused(placement).to_string().contains("must be finite"));
    }
    let Shape::Plane(mut plane) = ShapeKind::Plane.fit(BOUNDS) else { unreachable!() };
    plane.v_gradient = 2.0 * plane.u_gradient;
    let error = SMap::new(Shape::Plane(plane), &Placement::default()).unwrap_err();
    assert!(error.to_string().ends_with("it must have an inverse"), "{error}");
}
