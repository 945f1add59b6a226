//! The sRGB transfer function (IEC 61966-2-1).

use std::sync::LazyLock;

/// Linear light of an sRGB-encoded value; both 0..1 (continued beyond 1 by the same power law).
pub(crate) fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Meaning of a byte in an sRGB-encoded channel: linear 0..1.
pub(crate) static LINEAR_FROM_SRGB8: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| linear_from_srgb(i as f32 / 255.0)));

/// Meaning of a byte in any other channel: 0..1.
pub(crate) static UNIT_FROM_U8: [f32; 256] = {
    let mut table = [0.0; 256];
    let mut i = 0;
    while i < 256 {
        table[i] = i as f32 / 255.0;
        i += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    /// The standard's other direction.
    fn srgb_from_linear(linear: f32) -> f32 {
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
    }

    #[test]
    fn encoding_inverts_decoding() {
        for i in 0..=1000 {
            let x = i as f32 / 1000.0;
            assert!((srgb_from_linear(linear_from_srgb(x)) - x).abs() < 1e-5, "{x}");
        }
        assert_eq!(LINEAR_FROM_SRGB8[255], 1.0);
    }
}
