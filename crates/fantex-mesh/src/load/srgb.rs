//! The sRGB transfer curve (IEC 61966-2-1) for vertex colours.

use glam::{Vec3, Vec4};

/// Linear light of an sRGB-encoded value. Values outside 0..1 are continued by the same formulas; NaN stays NaN.
pub(crate) fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The inverse of [`linear_from_srgb`].
pub(crate) fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Linear RGBA of an sRGB colour with linear alpha. A colour that is not a number becomes white, so that one broken
/// vertex cannot spread through filters.
pub(crate) fn linear_rgba(rgb_srgb: Vec3, alpha: f32) -> Vec4 {
    let linear = rgb_srgb.to_array().map(linear_from_srgb);
    let color = Vec3::from(linear).extend(alpha);
    if color.is_finite() { color } else { Vec4::ONE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_and_its_inverse_agree() {
        for byte in 0..=255u8 {
            let encoded = f32::from(byte) / 255.0;
            let back = srgb_from_linear(linear_from_srgb(encoded));
            assert!((back - encoded).abs() < 1e-5, "{byte}");
        }
        assert!((linear_from_srgb(0.5) - 0.214_041).abs() < 1e-5);
    }

    #[test]
    fn a_nan_colour_becomes_white() {
        assert_eq!(linear_rgba(Vec3::new(f32::NAN, 0.0, 0.0), 1.0), Vec4::ONE);
    }
}
