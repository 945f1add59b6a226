//! Which levels a footprint is looked up in.

use std::f32::consts::{LN_2, SQRT_2};

/// The logarithm to base 2 of a finite number above 0 (normal, no denormal), to 3e-7 or one part in ten million: exponent,
/// and `artanh` of the mantissa. A library call takes three times as long.
#[inline(always)]
pub(crate) fn log2(x: f32) -> f32 {
    const MANTISSA: u32 = 0x007f_ffff;
    // Mantissas in [1/sqrt 2, sqrt 2).
    let bits = x.to_bits().wrapping_sub((SQRT_2 * 0.5).to_bits());
    let exponent = (bits as i32) >> 23;
    let mantissa = f32::from_bits((bits & MANTISSA).wrapping_add((SQRT_2 * 0.5).to_bits()));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let series = 1.0 + s2 * (1.0 / 3.0 + s2 * (1.0 / 5.0 + s2 * (1.0 / 7.0)));
    exponent as f32 + (2.0 / LN_2) * s * series
}

/// Two neighbouring levels and the share of the coarser one; the same level twice at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LevelPair {
    pub(crate) fine: usize,
    pub(crate) coarse: usize,
    pub(crate) share: f32,
}

impl LevelPair {
    /// The levels between which a texel is as wide as the square root of `squared_texels` texels of level 0.
    #[inline(always)]
    pub(crate) fn for_squared_width(squared_texels: f32, last: usize) -> Self {
        // A NaN is no width; beyond the last level, everything is the same.
        let lod = if squared_texels > 1.0 {
            (0.5 * log2(squared_texels.min(f32::MAX))).min(last as f32)
        } else {
            0.0
        };
        let fine = lod as usize;
        Self { fine, coarse: (fine + 1).min(last), share: lod - fine as f32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_are_those_of_the_library() {
        let mut x = 1.2e-38_f32;
        while x < 3e38 {
            let truth = f64::from(x).log2();
            let error = (f64::from(log2(x)) - truth).abs();
            assert!(error < 3e-7 + 1e-7 * truth.abs(), "log2 {x}: off by {error}");
            x *= 1.003_7;
        }
        assert_eq!((log2(1.0), log2(2.0), log2(0.25), log2(65_536.0)), (0.0, 1.0, -2.0, 16.0));
    }

    #[test]
    fn levels_are_continuous_and_bounded() {
        let pair = |texels: f32| LevelPair::for_squared_width(texels * texels, 5);
        assert_eq!(pair(0.3), LevelPair { fine: 0, coarse: 1, share: 0.0 });
        assert_eq!(pair(4.0), LevelPair { fine: 2, coarse: 3, share: 0.0 });
        for texels in [32.0, 1e9, f32::MAX, f32::INFINITY] {
            assert_eq!(pair(texels), LevelPair { fine: 5, coarse: 5, share: 0.0 });
        }
        assert_eq!(pair(f32::NAN).share, 0.0);
        let mut last = 0.0;
        for step in 0..10_000 {
            let LevelPair { fine, share, .. } = pair(1.0 + step as f32 * 0.004);
            let level = fine as f32 + share;
            assert!(level >= last && level - last < 0.01);
            last = level;
        }
    }
}
