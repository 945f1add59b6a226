//! A ray against a triangle, watertight: a ray through a common edge or corner of triangles meets at least one of them.
//!
//! S. Woop, C. Benthin and I. Wald, "Watertight Ray/Triangle Intersection", 2013. The ray becomes the z axis by a shear; what
//! is left are three edge functions in the plane, and those of a common edge differ in sign only, bit for bit. Where one
//! of them rounds to zero, they are evaluated again in double precision, in which products of floats are exact.

use glam::{DVec2, Vec3};

/// A ray, prepared.
pub(super) struct Shear {
    origin: Vec3,
    /// The axis along which the direction is longest comes last.
    axes: [usize; 3],
    shear: Vec3,
}

/// What a triangle says about a ray.
pub(super) struct Crossing {
    pub(super) lambda: Vec3,
    pub(super) distance: f32,
    pub(super) front: bool,
}

impl Shear {
    /// `direction` is not zero.
    pub(super) fn new(origin: Vec3, direction: Vec3) -> Self {
        let z = direction.abs().max_position();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            // Keeps the winding of triangles.
            std::mem::swap(&mut x, &mut y);
        }
        let inverse = 1.0 / direction[z];
        let shear = Vec3::new(direction[x] * inverse, direction[y] * inverse, inverse);
        Self { origin, axes: [x, y, z], shear }
    }

    /// Where the ray crosses a triangle in front of its origin.
    #[inline]
    pub(super) fn intersect(&self, corners: &[Vec3; 3]) -> Option<Crossing> {
        let [x, y, z] = self.axes;
        let relative = corners.map(|corner| corner - self.origin);
        let [a, b, c] =
            relative.map(|p| glam::Vec2::new(p[x] - self.shear.x * p[z], p[y] - self.shear.y * p[z]));
        let mut edges = Vec3::new(c.perp_dot(b), a.perp_dot(c), b.perp_dot(a));
        if edges.cmpeq(Vec3::ZERO).any() {
            let [a, b, c] = [a, b, c].map(|p| p.as_dvec2());
            let exact = |p: DVec2, q: DVec2| p.perp_dot(q) as f32;
            edges = Vec3::new(exact(c, b), exact(a, c), exact(b, a));
        }
        if edges.min_element() < 0.0 && edges.max_element() > 0.0 {
            return None;
        }
        let sum = edges.element_sum();
        if sum == 0.0 {
            // The ray runs within the triangle's plane; its neighbours are met.
            return None;
        }
        let heights = Vec3::from(relative.map(|p| p[z])) * self.shear.z;
        let lambda = edges / sum;
        let distance = lambda.dot(heights);
        // The order of the corners, seen along the ray, is clockwise where the front looks at the origin.
        (distance >= 0.0).then_some(Crossing { lambda, distance, front: sum > 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

    #[test]
    fn a_crossing_is_where_the_barycentric_coordinates_say() {
        for (origin, front) in [(Vec3::new(0.3, 0.1, 2.0), true), (Vec3::new(-0.4, 0.2, -3.0), false)] {
            let target = Vec3::new(0.25, 0.25, 0.0);
            let direction = (target - origin) * 0.5;
            let crossing = Shear::new(origin, direction).intersect(&TRIANGLE).unwrap();
            assert!((crossing.lambda - Vec3::new(0.5, 0.25, 0.25)).length() < 1e-6, "{}", crossing.lambda);
            assert!((crossing.distance - 2.0).abs() < 1e-6);
            assert_eq!(crossing.front, front);
        }
    }

    #[test]
    fn what_lies_behind_or_beside_is_not_met() {
        let meets = |o: Vec3, d: Vec3| Shear::new(o, d).intersect(&TRIANGLE).is_some();
        assert!(meets(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z));
        assert!(!meets(Vec3::new(0.2, 0.2, 1.0), Vec3::Z));
        assert!(!meets(Vec3::new(0.6, 0.6, 1.0), Vec3::NEG_Z));
        assert!(!meets(Vec3::new(-1.0, 0.2, 0.0), Vec3::X), "within the plane");
    }

    #[test]
    fn corners_and_edges_belong_to_the_triangle() {
        for corner in TRIANGLE {
            assert!(Shear::new(corner + Vec3::Z, Vec3::NEG_Z).intersect(&TRIANGLE).is_some());
        }
        let on_edge = Vec3::new(0.5, 0.5, 1.0);
        assert!(Shear::new(on_edge, Vec3::NEG_Z).intersect(&TRIANGLE).is_some());
    }
}
