//! The best projection direction: the axis of the narrowest cone that holds a set of normals.
//!
//! Maximising the smallest `n . d` over unit vectors is finding the smallest cap of the unit sphere that holds all
//! normals. It is an LP-type problem of dimension three (E. Welzl, "Smallest enclosing disks (balls and ellipsoids)",
//! 1991, for the planar case): the cap is determined by two or three of the normals. We start with the farthest normal and
//! keep adding the worst violator to the basis, which ends after a few rounds because the cap grows with each.

use glam::{DVec3, Vec3};

/// A cone of directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cone {
    /// Unit axis.
    pub(crate) axis: Vec3,
    /// Smallest dot product of the axis with a member: the cosine of the half angle. Not positive where no direction sees
    /// all members from the front.
    pub(crate) cos: f32,
}

/// Members this close to the cap's rim count as inside (a few ulp of a dot product of unit vectors).
const TOLERANCE: f32 = 1e-6;

/// Smallest cone around unit vectors. `normals` must not be empty.
pub(crate) fn narrowest_cone(normals: &[Vec3]) -> Cone {
    let mean: Vec3 = normals.iter().sum();
    let Some(mean) = mean.try_normalize() else {
        return Cone { axis: normals[0], cos: -1.0 };
    };
    let (worst, cos) = farthest(normals, mean);
    if cos > 1.0 - TOLERANCE {
        return Cone { axis: mean, cos };
    }
    let mut basis = Basis::of(normals[worst]);
    for _ in 0..MAX_ROUNDS {
        let (worst, cos) = farthest(normals, basis.axis);
        if cos >= basis.cos - TOLERANCE {
            return Cone { axis: basis.axis, cos };
        }
        if !basis.add(normals[worst]) {
            break;
        }
    }
    // Wider than a hemisphere, or numerically tied: the better of the two candidates, judged honestly.
    let (_, basis_cos) = farthest(normals, basis.axis);
    if basis_cos > cos { Cone { axis: basis.axis, cos: basis_cos } } else { Cone { axis: mean, cos } }
}

/// A basis of three is reached in two rounds; each further round enlarges the cap. Real fans need fewer than ten.
const MAX_ROUNDS: usize = 48;

fn farthest(normals: &[Vec3], axis: Vec3) -> (usize, f32) {
    let mut worst = (0, f32::INFINITY);
    for (i, n) in normals.iter().enumerate() {
        let cos = n.dot(axis);
        if cos < worst.1 {
            worst = (i, cos);
        }
    }
    worst
}

/// In double precision, and its members normalised to it: the axis of two nearly opposite normals is the small
/// difference of two long vectors.
struct Basis {
    members: [DVec3; 3],
    count: usize,
    axis: Vec3,
    cos: f32,
}

impl Basis {
    fn of(n: Vec3) -> Self {
        Self { members: [n.as_dvec3().normalize(); 3], count: 1, axis: n, cos: 1.0 }
    }

    /// Replaces the basis by the one of the smallest cap that holds it and `n`; false if none smaller than a hemisphere.
    fn add(&mut self, n: Vec3) -> bool {
        let n = n.as_dvec3().normalize();
        let old = self.members;
        let old = &old[..self.count];
        let mut best: Option<(f64, Basis)> = None;
        let mut consider = |members: [DVec3; 3], count: usize, axis: Option<DVec3>| {
            let Some(axis) = axis else { return false };
            let cos = n.dot(axis);
            let holds = old.iter().all(|m| m.dot(axis) >= cos - f64::from(TOLERANCE));
            let better = cos > 0.0 && holds && best.as_ref().is_none_or(|b| cos > b.0);
            if better {
                best = Some((cos, Basis { members, count, axis: axis.as_vec3(), cos: cos as f32 }));
            }
            better
        };
        // A cap between two members that holds all is the smallest.
        let mut held_by_two = false;
        for &m in old {
            held_by_two |= consider([n, m, m], 2, (n + m).try_normalize());
        }
        for (i, &a) in old.iter().enumerate().filter(|_| !held_by_two) {
            for &b in &old[i + 1..] {
                let normal = (a - n).cross(b - n).try_normalize();
                consider([n, a, b], 3, normal.map(|axis| if axis.dot(n) < 0.0 { -axis } else { axis }));
            }
        }
        match best {
            Some((_, basis)) => {
                *self = basis;
                true
            }
            None => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn narrow_pair_and_flat_set() {
        let cone = narrowest_cone(&[Vec3::Z, Vec3::X]);
        assert!((cone.axis - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-6);
        let cone = narrowest_cone(&[Vec3::Y; 5]);
        assert_eq!(cone.axis, Vec3::Y);
        assert!(narrowest_cone(&[Vec3::Z, -Vec3::Z]).cos <= 0.0);
        assert!(narrowest_cone(&[Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z]).cos <= 0.0);
    }

    /// Two of the normals are nearly opposite; single precision found no hemisphere here.
    #[test]
    fn nearly_opposite_normals_have_a_cone() {
        let normals = [
            Vec3::new(-0.6407155, -0.74389756, 0.18999988),
            Vec3::Z,
            Vec3::new(0.99999994, 0.0, 0.0),
            Vec3::new(0.6230162, 0.77880573, -0.072887816),
        ];
        assert!(narrowest_cone(&normals).cos > 0.0107);
    }

    fn unit() -> impl Strategy<Value = Vec3> {
        (-1.0f32..1.0, -1.0f32..1.0, -0.2f32..1.0)
            .prop_filter_map("too short", |(x, y, z)| Vec3::new(x, y, z).try_normalize())
    }

    proptest! {
        /// No direction on a dense sampling of the sphere does better by more than the sampling's own resolution.
        #[test]
        fn is_optimal(normals in prop::collection::vec(unit(), 1..12)) {
            let cone = narrowest_cone(&normals);
            let reached = normals.iter().map(|n| n.dot(cone.axis)).fold(f32::INFINITY, f32::min);
            prop_assert!((reached - cone.cos).abs() < 1e-5);
            let golden = 2.399_963_f32;
            for i in 0..2000 {
                let z = 1.0 - (2 * i + 1) as f32 / 2000.0;
                let r = (1.0 - z * z).sqrt();
                let d = Vec3::new(r * (golden * i as f32).cos(), r * (golden * i as f32).sin(), z);
                let cos = normals.iter().map(|n| n.dot(d)).fold(f32::INFINITY, f32::min);
                prop_assert!(cos <= cone.cos.max(0.0) + 1e-4, "{cos} beats {}", cone.cos);
            }
        }
    }
}
