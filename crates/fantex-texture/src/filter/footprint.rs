//! The footprint of a look-up as an ellipse.

use glam::Vec2;

/// The longest ratio of a footprint's axes that any filter honours; also the most probes of an anisotropic look-up.
pub const MAX_ANISOTROPY: f32 = 64.0;

/// The axes of the ellipse onto which the derivatives map the unit circle of the pixel's plane, in texels.
#[derive(Clone, Copy, Debug)]
pub struct FootprintAxes {
    /// Unit vector along the longer axis.
    pub direction: Vec2,
    /// Half length of the longer axis: the width of the pixel along it.
    pub major: f32,
    /// Half length of the shorter axis.
    pub minor: f32,
}

impl FootprintAxes {
    /// From the derivatives of the texel position along the pixel's x and y: the singular values and the first left
    /// singular vector of the matrix with these columns.
    pub fn new(texels_dx: Vec2, texels_dy: Vec2) -> Self {
        let xx = texels_dx.x * texels_dx.x + texels_dy.x * texels_dy.x;
        let xy = texels_dx.x * texels_dx.y + texels_dy.x * texels_dy.y;
        let yy = texels_dx.y * texels_dx.y + texels_dy.y * texels_dy.y;
        let half_difference = 0.5 * (xx - yy);
        let root = (half_difference * half_difference + xy * xy).sqrt();
        let axis = if half_difference >= 0.0 {
            Vec2::new(half_difference + root, xy)
        } else {
            Vec2::new(xy, root - half_difference)
        };
        let major = (0.5 * (xx + yy) + root).sqrt();
        // The determinant is the product of the singular values; a difference of squares would cancel.
        let minor = if major > 0.0 { texels_dx.perp_dot(texels_dy).abs() / major } else { 0.0 };
        Self { direction: axis.normalize_or(Vec2::X), major, minor }
    }

    /// The square of the longer axis of [`FootprintAxes::new`] alone.
    #[inline(always)]
    pub fn squared_major(texels_dx: Vec2, texels_dy: Vec2) -> f32 {
        let (xx, yy) = (texels_dx.length_squared(), texels_dy.length_squared());
        let (half_difference, xy) = (0.5 * (xx - yy), texels_dx.dot(texels_dy));
        0.5 * (xx + yy) + (half_difference * half_difference + xy * xy).sqrt()
    }

    /// The shorter axis widened until the ratio of both is at most `max_anisotropy`, which counts as 1 to
    /// [`MAX_ANISOTROPY`].
    pub fn limited_minor(&self, max_anisotropy: f32) -> f32 {
        self.minor.max(self.major / max_anisotropy.clamp(1.0, MAX_ANISOTROPY))
    }

    /// With the shorter axis as [`FootprintAxes::limited_minor`] says.
    pub fn limited(&self, max_anisotropy: f32) -> Self {
        Self { minor: self.limited_minor(max_anisotropy), ..*self }
    }

    /// Both axes as vectors, the longer one first.
    pub fn vectors(&self) -> [Vec2; 2] {
        [self.direction * self.major, self.direction.perp() * self.minor]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_a_rotated_rectangle() {
        let (sin, cos) = 0.7_f32.sin_cos();
        let long = Vec2::new(cos, sin);
        let axes = FootprintAxes::new(long.perp() * 2.0, long * 5.0);
        assert!((axes.major - 5.0).abs() < 1e-5 && (axes.minor - 2.0).abs() < 1e-5);
        assert!(axes.direction.perp_dot(long).abs() < 1e-5);
    }

    #[test]
    fn the_longer_axis_alone_is_the_same() {
        for (dx, dy) in [((3.0, 1.0), (-2.0, 0.5)), ((0.0, 0.0), (1.0, 7.0)), ((1e4, 2.0), (1e-3, 1e4))] {
            let (dx, dy) = (Vec2::from(dx), Vec2::from(dy));
            let (squared, axes) = (FootprintAxes::squared_major(dx, dy), FootprintAxes::new(dx, dy));
            assert!((squared.sqrt() - axes.major).abs() < 1e-6 * axes.major);
        }
    }

    #[test]
    fn axes_of_nothing_and_of_a_line() {
        let point = FootprintAxes::new(Vec2::ZERO, Vec2::ZERO);
        assert_eq!((point.major, point.minor), (0.0, 0.0));
        let line = FootprintAxes::new(Vec2::new(3.0, 4.0), Vec2::ZERO);
        assert!((line.major - 5.0).abs() < 1e-5 && line.minor == 0.0);
        assert!((line.limited_minor(10.0) - 0.5).abs() < 1e-6);
    }
}
