//! From world space to mesh space: the box of the positions that matter, and the rounding to single precision.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::WorldFromMesh;

/// Coordinates beyond this are treated as damage: their squares and differences must stay finite.
const ABSURD: f64 = 1e100;
/// A box smaller than this is a point: a power of two near it must still be a normal number.
const COINCIDENT: f64 = 1e-300;
/// Mesh-space coordinates are whole multiples of `1 / GRID`. Differences of positions then never underflow single
/// precision when they are multiplied, and 128-bit integers evaluate determinants of positions exactly.
const GRID: f64 = (1_u64 << 60) as f64;
/// Below this magnitude single precision is finer than the grid.
const GRID_MATTERS: f32 = 1.0 / (1_u64 << 36) as f32;

/// True for positions that cleaning accepts: finite, and of a magnitude that can be computed with.
pub(super) fn is_usable(p: DVec3) -> bool {
    p.abs().max_element() <= ABSURD && p.is_finite()
}

/// Centre and scale for the used positions; `None` where they all coincide (to 1e-300) or none is used.
///
/// The centre is the middle of the box, rounded to a few bits relative to the scale: subtracting it then loses nothing
/// of positions that were single precision in the file.
pub(super) fn world_from_mesh(
    positions: &[DVec3],
    used: impl Fn(usize) -> bool + Sync,
) -> Option<WorldFromMesh> {
    let (low, high) = positions
        .par_iter()
        .enumerate()
        .with_min_len(1 << 14)
        .filter(|&(i, _)| used(i))
        .fold(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (_, &p)| (low.min(p), high.max(p)))
        .reduce(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let half_extent = (0.5 * (high - low)).max_element();
    if half_extent.is_nan() || half_extent < COINCIDENT {
        return None;
    }
    let middle = 0.5 * (low + high);
    let mut scale = power_of_two_at_least(half_extent);
    loop {
        let step = scale / 8.0;
        let rounded = (middle / step).round() * step;
        let offset = if rounded.is_finite() { rounded } else { middle };
        if (high - offset).max_element() <= scale && (offset - low).max_element() <= scale {
            return Some(WorldFromMesh { offset, scale });
        }
        scale *= 2.0;
    }
}

/// A position in mesh space, rounded to the grid; zero is always positive.
pub(super) fn mesh_position(world_from_mesh: &WorldFromMesh, p_world: DVec3) -> Vec3 {
    let p = world_from_mesh.inverse_point(p_world);
    if p.abs().min_element() < GRID_MATTERS { p.map(on_grid) } else { p }
}

/// Rounds to a multiple of `1 / GRID` and turns -0 into +0.
fn on_grid(x: f32) -> f32 {
    if x.abs() < GRID_MATTERS { ((f64::from(x) * GRID).round() / GRID) as f32 + 0.0 } else { x }
}

/// A mesh-space coordinate as a whole number of grid steps, exactly.
fn grid_steps(x: f32) -> i128 {
    (f64::from(x) * GRID) as i128
}

/// The smallest power of two that is not below `x` (positive, normal).
fn power_of_two_at_least(x: f64) -> f64 {
    let below = f64::from_bits(x.to_bits() & !((1 << (f64::MANTISSA_DIGITS - 1)) - 1));
    if below < x { 2.0 * below } else { below }
}

// Which triangles have no area, decided exactly.

/// Relative error of a cross product of two differences in double precision, with room to spare.
const CROSS_ERROR: f64 = 16.0 * f64::EPSILON;

/// True where a triangle with these corners (mesh space, on the grid) has no area: two corners coincide or all three are
/// exactly collinear, or its area is too small for double precision.
///
/// A floating-point filter decides all but nearly collinear triangles; those are decided with 128-bit integers (after
/// J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997, whose
/// filters these are; the grid of mesh space makes plain integers do for the exact stage).
pub(super) fn has_no_area([a, b, c]: [Vec3; 3]) -> bool {
    let [a64, b64, c64] = [a, b, c].map(|p| p.as_dvec3());
    let (u, v) = (b64 - a64, c64 - a64);
    let cross = u.cross(v).length_squared();
    if cross > CROSS_ERROR * CROSS_ERROR * u.length_squared() * v.length_squared() {
        return false;
    }
    cross == 0.0 || are_collinear(a, b, c)
}

/// Exactly collinear: all three projections onto coordinate planes have no area.
fn are_collinear(a: Vec3, b: Vec3, c: Vec3) -> bool {
    let [a, b, c] = [a, b, c].map(|p| p.to_array().map(grid_steps));
    // Differences of coordinates are below 2^62, their products below 2^124.
    let u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    (0..3).all(|i| {
        let j = (i + 1) % 3;
        u[i] * v[j] == u[j] * v[i]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space(points: &[DVec3]) -> WorldFromMesh {
        world_from_mesh(points, |_| true).unwrap()
    }

    #[test]
    fn every_magnitude_lands_in_the_unit_box_with_full_precision() {
        for magnitude in [1e-299, 1e-45, 1e-30, 1e-3, 1.0, 3.0, 1e30, f64::from(f32::MAX), 1e100] {
            let points = [DVec3::ZERO, DVec3::new(magnitude, 0.0, -magnitude)];
            let space = space(&points);
            let mesh = points.map(|p| mesh_position(&space, p));
            assert!(mesh.iter().all(|p| p.abs().max_element() <= 1.0), "{magnitude}: {mesh:?}");
            assert!(mesh[0].distance(mesh[1]) >= 0.25, "{magnitude}: {mesh:?}");
            assert_eq!(space.scale, power_of_two_at_least(space.scale));
        }
    }

    #[test]
    fn a_far_offset_keeps_short_edges_apart() {
        let base = DVec3::splat(1e7);
        let points: Vec<DVec3> = (0..100).map(|i| base + DVec3::new(1e-3 * f64::from(i), 0.0, 0.0)).collect();
        let space = space(&points);
        for (i, &p) in points.iter().enumerate() {
            let back = space.point(mesh_position(&space, p));
            assert!((back - p).abs().max_element() < 1e-8, "point {i}");
        }
    }

    #[test]
    fn single_precision_positions_survive_unrounded() {
        let points: Vec<DVec3> =
            (0..1000).map(|i| (Vec3::new(0.1, 0.7, -0.3) * (1.0 + i as f32)).as_dvec3()).collect();
        let space = space(&points);
        let distinct: std::collections::HashSet<[u32; 3]> =
            points.iter().map(|&p| mesh_position(&space, p).to_array().map(f32::to_bits)).collect();
        assert_eq!(distinct.len(), points.len());
    }

    #[test]
    fn zero_has_one_sign_and_coinciding_points_have_no_scale() {
        let space = WorldFromMesh::default();
        assert_eq!(mesh_position(&space, DVec3::splat(-0.0)).x.to_bits(), 0);
        assert_eq!(mesh_position(&space, DVec3::splat(-1e-300)).x.to_bits(), 0);
        assert!(world_from_mesh(&[DVec3::ONE; 4], |_| true).is_none());
        assert!(world_from_mesh(&[DVec3::ZERO, DVec3::splat(5e-324)], |_| true).is_none());
        assert!(world_from_mesh(&[], |_| true).is_none());
        assert!(!is_usable(DVec3::new(0.0, f64::NAN, 0.0)) && !is_usable(DVec3::new(0.0, -1e101, 0.0)));
    }

    #[test]
    fn points_and_segments_have_no_area() {
        let (a, b) = (Vec3::new(0.3, -0.7, 0.1), Vec3::new(0.9, 0.2, -0.4));
        assert!(has_no_area([a, a, a]));
        assert!(has_no_area([a, b, a]));
        assert!(has_no_area([Vec3::ZERO, Vec3::new(0.1, 0.2, 0.3), 2.0 * Vec3::new(0.1, 0.2, 0.3)]));
        assert!(has_no_area([-b, Vec3::ZERO, b]));
    }

    #[test]
    fn needles_and_caps_have_area() {
        let needle = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1e-7, 0.0)];
        let cap = [-Vec3::X, Vec3::X, Vec3::new(0.0, 1e-6, 0.0)];
        let tiny = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p * (1.0_f32 / (1_u64 << 60) as f32));
        assert!(![needle, cap, tiny].into_iter().any(has_no_area));
    }

    #[test]
    fn one_unit_in_the_last_place_off_a_line_is_area() {
        let (a, c) = (Vec3::new(0.1, 0.3, 0.7), Vec3::new(0.2, 0.6, 1.4) * 0.7);
        let b = 0.5 * (a + c);
        let off = Vec3::new(b.x, b.y, f32::from_bits(b.z.to_bits() + 1));
        assert!(!has_no_area([a, off, c]) || !has_no_area([a, b, c]));
    }
}
