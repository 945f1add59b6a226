//! Which triangles have no area, decided exactly.

use glam::Vec3;

use super::space::grid_steps;

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
