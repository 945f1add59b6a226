//! Projective maps: straight lines stay straight, as in a perspective picture of a plane.

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::{PlaneMap, PlaneMapError};

/// `x = (a u + b v + c) / (g u + h v + i)`, `y = (d u + e v + f) / (g u + h v + i)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectiveMap {
    matrix: DMat3,
    inverse: DMat3,
}

impl ProjectiveMap {
    /// From the matrix with the rows `(a b c)`, `(d e f)`, `(g h i)`, which counts up to a positive factor: the plane is seen
    /// where the denominator is positive.
    ///
    /// # Errors
    ///
    /// A number is not finite, or the matrix has no inverse.
    pub fn new(matrix: DMat3) -> Result<Self, PlaneMapError> {
        if !matrix.is_finite() {
            return Err(PlaneMapError::NotFinite);
        }
        let inverse = matrix.inverse();
        let volume = matrix.x_axis.length() * matrix.y_axis.length() * matrix.z_axis.length();
        if matrix.determinant().abs() <= 1e-14 * volume || !inverse.is_finite() {
            return Err(PlaneMapError::Singular);
        }
        Ok(Self { matrix, inverse })
    }

    /// The map that takes the corners (0,0), (1,0), (1,1), (0,1) of the texture to four positions in this order.
    ///
    /// # Errors
    ///
    /// A number is not finite, or three corners lie on one line.
    pub fn from_quad(corners: [DVec2; 4]) -> Result<Self, PlaneMapError> {
        let [p0, p1, p2, p3] = corners;
        // Heckbert 1989, 2.2.3: the sums and differences whose ratios are g and h.
        let sum = p0 - p1 + p2 - p3;
        let (across, down) = (p1 - p2, p3 - p2);
        let area = across.perp_dot(down);
        let g = sum.perp_dot(down) / area;
        let h = across.perp_dot(sum) / area;
        if area == 0.0 && corners.iter().all(|corner| corner.is_finite()) {
            return Err(PlaneMapError::Singular);
        }
        Self::new(DMat3::from_cols(
            (p1 - p0 + g * p1).extend(g),
            (p3 - p0 + h * p3).extend(h),
            p0.extend(1.0),
        ))
    }

    /// The map that takes four texture coordinates to four positions, both in the same order round a quadrilateral.
    ///
    /// # Errors
    ///
    /// A number is not finite, or three of the texture coordinates or of the positions lie on one line.
    pub fn from_points(uv: [DVec2; 4], positions: [DVec2; 4]) -> Result<Self, PlaneMapError> {
        let matrix = Self::from_quad(positions)?.matrix * Self::from_quad(uv)?.inverse;
        // The denominator shall be positive at the points.
        let denominator = (matrix * uv[0].extend(1.0)).z;
        Self::new(matrix * denominator.signum())
    }

    /// The matrix with the rows `(a b c)`, `(d e f)`, `(g h i)`.
    pub fn matrix(&self) -> DMat3 {
        self.matrix
    }
}

/// The foot of a homogeneous point, if it lies in front of the horizon.
fn project(point: DVec3) -> Option<DVec2> {
    let smallest = 1e-12 * point.truncate().abs().max_element();
    (point.z > smallest).then(|| point.truncate() / point.z)
}

impl PlaneMap for ProjectiveMap {
    fn map(&self, uv: DVec2) -> DVec2 {
        let point = self.matrix * uv.extend(1.0);
        point.truncate() / point.z
    }

    /// `None` beyond the horizon.
    fn inverse(&self, position: DVec2) -> Option<DVec2> {
        // The inverse's denominator is one over the map's: both have the same sign.
        project(self.inverse * position.extend(1.0))
    }

    fn jacobian(&self, uv: DVec2) -> DMat2 {
        let point = self.matrix * uv.extend(1.0);
        let position = point.truncate() / point.z;
        let column = |axis: DVec3| (axis.truncate() - position * axis.z) / point.z;
        DMat2::from_cols(column(self.matrix.x_axis), column(self.matrix.y_axis))
    }
}
