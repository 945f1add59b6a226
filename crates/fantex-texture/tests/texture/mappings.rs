//! Properties of the mappings.

use crate::common::Random;
use fantex_base::Aabb;
use fantex_texture::{
    AnyMapping, BoxMap, CylinderMap, Mapping, MappingKind, PlanarMap, SphereMap, TriplanarMap,
};
use glam::{Quat, Vec2, Vec3};

const BOUNDS: Aabb = Aabb { min: Vec3::new(-1.0, 0.5, 2.0), max: Vec3::new(3.0, 2.0, 4.5) };

fn random_vector(random: &mut Random) -> Vec3 {
    Vec3::new(random.unit() - 0.5, random.unit() - 0.5, random.unit() - 0.5)
}

/// The difference of two coordinates, unwrapped across a seam of period `period`.
fn unwrapped(difference: Vec2, period: f32) -> Vec2 {
    Vec2::new(difference.x - (difference.x / period).round() * period, difference.y)
}

#[test]
fn footprints_equal_finite_differences() {
    let mut random = Random::new(1);
    let maps: [Box<dyn Mapping>; 5] = [
        Box::new(PlanarMap::fit(BOUNDS)),
        Box::new(PlanarMap::placed(Quat::from_rotation_x(0.7), Vec3::ONE, Vec2::new(2.0, 3.0), Vec2::ONE)),
        Box::new(BoxMap::fit(BOUNDS)),
        Box::new(CylinderMap::fit(BOUNDS)),
        Box::new(SphereMap::fit(BOUNDS)),
    ];
    for map in &maps {
        for _ in 0..500 {
            let p = BOUNDS.center() + 4.0 * random_vector(&mut random);
            let n = random_vector(&mut random);
            let local = p - BOUNDS.center();
            if local.x.hypot(local.z) < 0.3 {
                continue;
            }
            let moves = [random_vector(&mut random), random_vector(&mut random)];
            let step = 1e-2;
            let footprint = map.uv_footprint(p, n, moves[0] * step, moves[1] * step);
            for (direction, got) in moves.into_iter().zip(footprint) {
                let ahead = map.uv(p + 0.5 * step * direction, n);
                let behind = map.uv(p - 0.5 * step * direction, n);
                let expected = unwrapped(ahead - behind, 1.0);
                assert!((got - expected).length() < 2e-5, "{got} against {expected} at {p}");
            }
        }
    }
}

#[test]
fn seams_and_poles_have_small_or_bounded_footprints() {
    let center = BOUNDS.center();
    let moves = [Vec3::X * 0.01, Vec3::Y * 0.01];
    for map in [&SphereMap::fit(BOUNDS) as &dyn Mapping, &CylinderMap::fit(BOUNDS)] {
        let [across, _] = map.uv_footprint(center - Vec3::Z, Vec3::NEG_Z, moves[0], moves[1]);
        assert!(across.length() < 0.01, "across the seam: {across}");
        for p in [center, center + Vec3::Y, center - Vec3::Y, center + Vec3::new(1e-20, 1.0, 0.0)] {
            for change in map.uv_footprint(p, Vec3::Y, moves[0], moves[1]) {
                assert!(change.is_finite() && change.length() <= 1.5, "{change} at {p}");
            }
            assert!(map.uv(p, Vec3::Y).is_finite());
        }
    }
}

#[test]
fn on_the_axis_of_a_cylinder_a_footprint_goes_all_round() {
    let map = CylinderMap::fit(BOUNDS);
    let step = Vec3::X * 0.01;
    let on_axis = map.uv_footprint(map.center, Vec3::X, step, step);
    let beside = map.uv_footprint(map.center + Vec3::Z * 1e-6, Vec3::X, step, step);
    assert!(beside[0].x > 0.0);
    assert_eq!(on_axis, beside);
}

#[test]
fn inverses_lead_back() {
    let (planar, cylinder, sphere) =
        (PlanarMap::fit(BOUNDS), CylinderMap::fit(BOUNDS), SphereMap::fit(BOUNDS));
    let mut random = Random::new(2);
    for _ in 0..500 {
        let uv = Vec2::new(0.01 + 0.98 * random.unit(), 0.01 + 0.98 * random.unit());
        assert!((planar.uv(planar.point(uv), Vec3::Z) - uv).length() < 1e-5);
        assert!((cylinder.uv(cylinder.point(uv), Vec3::Z) - uv).length() < 1e-5);
        let p = sphere.center + sphere.direction(uv) * (0.1 + random.unit());
        assert!((sphere.uv(p, Vec3::Z) - uv).length() < 1e-5);
    }
}

#[test]
fn fitted_maps_cover_the_image_once() {
    for kind in MappingKind::ALL {
        assert_eq!(kind.name().parse::<MappingKind>().unwrap(), kind);
        let AnyMapping::Single(map) = kind.fit(BOUNDS) else { continue };
        let mut random = Random::new(3);
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for _ in 0..5000 {
            let unit = random_vector(&mut random) + 0.5;
            let uv = map.uv(BOUNDS.min + unit * BOUNDS.extent(), Vec3::Z);
            (low, high) = (low.min(uv), high.max(uv));
        }
        assert!(low.min_element() >= -1e-5 && high.max_element() <= 1.0 + 1e-5, "{kind:?} {low} {high}");
        assert!(high.x - low.x > 0.9, "{kind:?} leaves out columns");
    }
    assert!("cube".parse::<MappingKind>().is_err());
}

#[test]
fn box_faces_use_the_longer_edge_as_u() {
    let map = BoxMap::fit(BOUNDS);
    // Edges 4, 1.5 and 2.5: x is the longest, z the second.
    let p = Vec3::new(1.0, 1.0, 3.0);
    assert_eq!(map.uv(p, Vec3::Y), Vec2::new(0.5, 0.25));
    assert_eq!(map.uv(p, Vec3::Z), Vec2::new(0.5, 0.25));
    assert_eq!(map.uv(p, Vec3::NEG_X), Vec2::new(0.25, 0.25));
}

/// Right, down and the outward normal of what a map shows on a face.
fn assert_readable(name: &str, gradients: [Vec3; 2], n: Vec3) {
    let [right, down] = gradients;
    assert!(right.cross(down).dot(n) < 0.0, "{name} mirrors the image on the face {n}");
}

#[test]
fn boxes_and_triplanar_maps_show_images_unmirrored_from_outside() {
    let gradients = |change: &dyn Fn(Vec3) -> Vec2| {
        let columns = Vec3::AXES.map(change);
        [0, 1].map(|k| Vec3::from_array(columns.map(|c| c[k])))
    };
    let faces = Vec3::AXES.into_iter().flat_map(|n| [n, -n]);
    // Every order of the axes by length.
    let boxes = [[3, 2, 1], [3, 1, 2], [2, 3, 1], [1, 3, 2], [2, 1, 3], [1, 2, 3]];
    for (n, size) in faces.flat_map(|n| boxes.map(|size| (n, size))) {
        let max = Vec3::from_array(size.map(|s| s as f32));
        let bounds = Aabb { min: Vec3::ZERO, max };
        let map = BoxMap::fit(bounds);
        let [right, down] = gradients(&|d| map.uv_footprint(Vec3::ZERO, n, d, d)[0]);
        assert_readable("a box", [right, down], n);
        assert!(down.y <= 0.0 && right.y >= 0.0, "the image on the face {n} of {max} is upside down");
        for corner in [bounds.min, bounds.max] {
            let uv = map.uv(corner, n);
            assert!(uv.min_element() >= 0.0 && uv.max_element() <= 1.0, "{uv}");
        }

        let triplanar = TriplanarMap::fit(bounds);
        let axis = n.abs().max_position();
        let [right, down] = gradients(&|d| triplanar.taps(Vec3::ZERO, n, [d; 2])[axis].footprint[0]);
        assert_readable("triplanar", [right, down], n);
        assert!(down.y <= 0.0);
    }
}

#[test]
fn triplanar_weights_add_up_and_blend_continuously() {
    let map = TriplanarMap::fit(BOUNDS);
    let mut random = Random::new(4);
    for _ in 0..200 {
        let n = random_vector(&mut random);
        assert!((map.weights(n).element_sum() - 1.0).abs() < 1e-5);
        let p = random_vector(&mut random);
        let value = map.evaluate(p, n, [Vec3::X, Vec3::Y], |_, _| [0.25, 0.5, 0.75, 1.0]);
        crate::common::assert_close(value, [0.25, 0.5, 0.75, 1.0], 1e-6, "constant");
    }
    assert_eq!(map.weights(Vec3::Z), Vec3::Z);
    assert!((map.weights(Vec3::ZERO) - Vec3::splat(1.0 / 3.0)).length() < 1e-6);
}
