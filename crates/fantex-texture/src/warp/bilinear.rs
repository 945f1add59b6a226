//! Bilinear maps: the square becomes any quadrilateral, diagonals become curves.

use glam::{DMat2, DVec2};

use super::{PlaneMap, PlaneMapError};

/// `q(u,v) = (1-u)(1-v) P00 + u(1-v) P10 + (1-u)v P01 + uv P11`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BilinearMap {
    /// `P00`.
    origin: DVec2,
    /// `P10 - P00`.
    along_u: DVec2,
    /// `P01 - P00`.
    along_v: DVec2,
    /// `P00 - P10 + P11 - P01`: 0 for a parallelogram.
    twist: DVec2,
}

/// How far beyond the square coordinates still count as inside: rounding errors on its edges.
const TOLERANCE: f64 = 1e-9;

impl BilinearMap {
    /// The map that takes the corners (0,0), (1,0), (1,1), (0,1) of the texture to four positions in this order.
    ///
    /// # Errors
    ///
    /// A number is not finite, or all corners lie on one line.
    pub fn from_quad([p00, p10, p11, p01]: [DVec2; 4]) -> Result<Self, PlaneMapError> {
        let map = Self { origin: p00, along_u: p10 - p00, along_v: p01 - p00, twist: p00 - p10 + p11 - p01 };
        if ![p00, p10, p11, p01].iter().all(|corner| corner.is_finite()) {
            return Err(PlaneMapError::NotFinite);
        }
        let edges = [map.along_u, map.along_v, p11 - p00];
        let longest = edges.iter().map(|edge| edge.length_squared()).fold(0.0, f64::max);
        let area = |a: usize, b: usize| edges[a].perp_dot(edges[b]).abs();
        if area(0, 1).max(area(0, 2)).max(area(1, 2)) <= 1e-12 * longest {
            return Err(PlaneMapError::Singular);
        }
        Ok(map)
    }

    /// `u` for the right `v`: by the coordinate in which the line of that `v` is longer.
    fn u_at(&self, position: DVec2, v: f64) -> f64 {
        let line = self.along_u + self.twist * v;
        let offset = position - self.origin - self.along_v * v;
        if line.x.abs() >= line.y.abs() { offset.x / line.x } else { offset.y / line.y }
    }
}

/// The real solutions of `a x^2 + b x + c = 0`, without cancellation, and with the right limit for small `a`; NaN or infinite
/// where there is none.
fn quadratic_roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    let discriminant = b * b - 4.0 * a * c;
    // At a double root, rounding may make it negative.
    let root = if discriminant > -1e-12 * b * b { discriminant.max(0.0).sqrt() } else { f64::NAN };
    let q = -0.5 * (b + root.copysign(b));
    [c / q, q / a]
}

impl PlaneMap for BilinearMap {
    fn map(&self, uv: DVec2) -> DVec2 {
        self.origin + self.along_u * uv.x + self.along_v * uv.y + self.twist * (uv.x * uv.y)
    }

    /// `None` outside the quadrilateral: the inverse has two values, and only one in the unit square is of use. (A
    /// quadrilateral that is not convex covers some positions twice; then it is the one with the smaller `v`.)
    fn inverse(&self, position: DVec2) -> Option<DVec2> {
        // Eliminating u leaves a quadratic in v: (along_u + twist v) x (offset - along_v v) = 0.
        let offset = position - self.origin;
        let a = self.along_v.perp_dot(self.twist);
        let b = self.twist.perp_dot(offset) - self.along_u.perp_dot(self.along_v);
        let c = self.along_u.perp_dot(offset);
        let [first, second] = quadratic_roots(a, b, c);
        let inside = 0.5 + TOLERANCE;
        [first.min(second), first.max(second)]
            .into_iter()
            .map(|v| DVec2::new(self.u_at(position, v), v))
            .find(|uv| (*uv - 0.5).abs().max_element() <= inside)
            .map(|uv| uv.clamp(DVec2::ZERO, DVec2::ONE))
    }

    fn jacobian(&self, uv: DVec2) -> DMat2 {
        DMat2::from_cols(self.along_u + self.twist * uv.y, self.along_v + self.twist * uv.x)
    }
}
