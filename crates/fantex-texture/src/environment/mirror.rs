//! Mirrored view rays and their footprints.

use glam::Vec3;

/// The direction that a mirror with the unit `normal` shows to an eye in the unit direction `to_eye`.
pub fn mirrored(normal: Vec3, to_eye: Vec3) -> Vec3 {
    normal * (2.0 * normal.dot(to_eye)) - to_eye
}

/// The change of [`mirrored`] along a footprint's edges, to first order, from those of normal and eye direction: on
/// curved or bumpy mirrors neighbouring pixels look far apart.
pub fn mirrored_steps(
    normal: Vec3,
    normal_steps: [Vec3; 2],
    to_eye: Vec3,
    to_eye_steps: [Vec3; 2],
) -> [Vec3; 2] {
    [0, 1].map(|edge| {
        let (dn, dv) = (normal_steps[edge], to_eye_steps[edge]);
        let turned = dn.dot(to_eye) + normal.dot(dv);
        normal * (2.0 * turned) + dn * (2.0 * normal.dot(to_eye)) - dv
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_the_limits_of_differences() {
        let n = Vec3::new(0.2, 0.9, 0.1).normalize();
        let v = Vec3::new(-0.5, 0.6, 0.4).normalize();
        let (dn, dv) = (Vec3::new(1e-3, 0.0, -5e-4), Vec3::new(0.0, 4e-4, 1e-3));
        let seen = mirrored(n + dn * 0.5, v + dv * 0.5) - mirrored(n - dn * 0.5, v - dv * 0.5);
        let [stated, _] = mirrored_steps(n, [dn, dn], v, [dv, dv]);
        assert!((stated - seen).length() < 1e-5, "{stated} {seen}");
        assert!((mirrored(n, v).dot(n) - v.dot(n)).abs() < 1e-6);
    }
}
