//! Three planar projections, blended by the normal.

use fantex_base::Aabb;
use glam::{Vec2, Vec3};

use crate::Allowed;

/// Projections along x, y and z with weights `|n|^sharpness`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriplanarMap {
    /// The point with `u = v = 0` in all three projections.
    pub origin: Vec3,
    /// Images per unit of length.
    pub scale: f32,
    /// Exponent of the normal's coordinates: the larger, the narrower the blend. 4 is a good start.
    pub sharpness: f32,
}

/// One of the three look-ups.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriplanarTap {
    /// Coordinates.
    pub uv: Vec2,
    /// Change of the coordinates along the two moves of the point.
    pub footprint: [Vec2; 2],
    /// Share in the result; the three add up to 1.
    pub weight: f32,
}

impl TriplanarMap {
    /// The image once along the longest edge of `bounds`.
    pub fn fit(bounds: Aabb) -> Self {
        let origin = Vec3::new(bounds.min.x, bounds.max.y, bounds.min.z);
        Self { origin, scale: 1.0 / bounds.extent().max_element(), sharpness: 4.0 }
    }

    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
        const OWNER: &str = "a triplanar mapping";
        Allowed::Finite.check(OWNER, "the origin", &self.origin.to_array())?;
        Allowed::NotZero.check(OWNER, "the scale", &[self.scale])?;
        Allowed::Positive.check(OWNER, "the sharpness", &[self.sharpness])
    }

    /// The shares of the projections along x, y and z.
    pub fn weights(&self, n: Vec3) -> Vec3 {
        let largest = n.abs().max_element();
        if largest.is_nan() || largest <= 0.0 {
            return Vec3::splat(1.0 / 3.0);
        }
        let powers = (n.abs() / largest).powf(self.sharpness);
        powers / powers.element_sum()
    }

    /// The look-ups along x, y and z. From outside, nothing is mirrored: sides see y up, the top sees +x to the right and +z
    /// down. Where the normal's coordinate changes its sign and the image flips, it has no weight.
    pub fn taps(&self, p: Vec3, n: Vec3, moves: [Vec3; 2]) -> [TriplanarTap; 3] {
        let weights = self.weights(n);
        let front = n.signum();
        let project = |axis: usize, local: Vec3| {
            let uv = match axis {
                0 => Vec2::new(-local.z * front.x, -local.y),
                1 => Vec2::new(local.x, local.z * front.y),
                _ => Vec2::new(local.x * front.z, -local.y),
            };
            uv * self.scale
        };
        std::array::from_fn(|axis| TriplanarTap {
            uv: project(axis, p - self.origin),
            footprint: moves.map(|direction| project(axis, direction)),
            weight: weights[axis],
        })
    }

    /// The blend of `look_up(uv, footprint)` over the taps that count (weights below 1/1024 are left out).
    pub fn evaluate(
        &self,
        p: Vec3,
        n: Vec3,
        moves: [Vec3; 2],
        mut look_up: impl FnMut(Vec2, [Vec2; 2]) -> [f32; 4],
    ) -> [f32; 4] {
        // The cut-off is subtracted, so that a tap comes in continuously.
        let counts = |tap: &TriplanarTap| (tap.weight - 1.0 / 1024.0).max(0.0);
        let taps = self.taps(p, n, moves);
        let total: f32 = taps.iter().map(counts).sum();
        let mut sum = [0.0; 4];
        for tap in taps.iter().filter(|tap| counts(tap) > 0.0) {
            let value = look_up(tap.uv, tap.footprint);
            let share = counts(tap) / total;
            sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += share * value);
        }
        sum
    }
}
