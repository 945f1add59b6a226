//! Affine maps: parallels stay parallel.

use glam::{DMat2, DVec2};

use super::{PlaneMap, PlaneMapError};

/// `position = linear uv + translation`: scaling, rotation, shear and translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AffineMap {
    linear: DMat2,
    translation: DVec2,
    inverse: DMat2,
}

impl AffineMap {
    /// From its matrix, whose columns are the images of one texture width and one texture height.
    ///
    /// # Errors
    ///
    /// A number is not finite, or the columns are parallel.
    pub fn new(linear: DMat2, translation: DVec2) -> Result<Self, PlaneMapError> {
        if !linear.is_finite() || !translation.is_finite() {
            return Err(PlaneMapError::NotFinite);
        }
        let lengths = linear.x_axis.length() * linear.y_axis.length();
        let inverse = linear.inverse();
        if linear.determinant().abs() <= 1e-12 * lengths || !inverse.is_finite() {
            return Err(PlaneMapError::Singular);
        }
        Ok(Self { linear, translation, inverse })
    }

    /// The map that takes three texture coordinates to three positions.
    ///
    /// # Errors
    ///
    /// A number is not finite, or three points lie on one line.
    pub fn from_points(uv: [DVec2; 3], positions: [DVec2; 3]) -> Result<Self, PlaneMapError> {
        let edges = |p: [DVec2; 3]| DMat2::from_cols(p[1] - p[0], p[2] - p[0]);
        let from = Self::new(edges(uv), uv[0])?;
        let linear = edges(positions) * from.inverse;
        Self::new(linear, positions[0] - linear * uv[0])
    }
}

impl PlaneMap for AffineMap {
    fn map(&self, uv: DVec2) -> DVec2 {
        self.linear * uv + self.translation
    }

    fn inverse(&self, position: DVec2) -> Option<DVec2> {
        Some(self.inverse * (position - self.translation))
    }

    fn jacobian(&self, _uv: DVec2) -> DMat2 {
        self.linear
    }
}
