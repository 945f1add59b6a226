//! From the light of a scene to what a screen can show.

use glam::Vec3;

/// How light beyond one is brought into the range of a screen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ToneMap {
    /// It is cut off.
    #[default]
    Clip,
    /// `L (1 + L / white^2) / (1 + L)` of the luminance; hues are kept (E. Reinhard et al., "Photographic Tone Reproduction
    /// for Digital Images", 2002, equation 4).
    Reinhard {
        /// The smallest luminance that becomes one, positive.
        white: f32,
    },
    /// Per channel `x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14)`, a curve close to that of the Academy Color Encoding
    /// System (K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2015).
    Filmic,
}

impl ToneMap {
    /// Maps linear RGB of the scene to linear RGB of the screen, 0..1.
    pub fn map(self, color: Vec3) -> Vec3 {
        let color = color.max(Vec3::ZERO);
        let mapped = match self {
            Self::Clip => color,
            Self::Reinhard { white } => {
                let l = luminance(color);
                color * ((1.0 + l / (white * white)) / (1.0 + l))
            }
            Self::Filmic => {
                // Beyond this the curve is one, and its squares would overflow.
                let x = color.min(Vec3::splat(1e6));
                x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
            }
        };
        mapped.clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Luminance of linear RGB with the primaries of sRGB (ITU-R BT.709).
pub fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_black_to_white() {
        for tone_map in [ToneMap::Clip, ToneMap::Reinhard { white: 4.0 }, ToneMap::Filmic] {
            assert_eq!(tone_map.map(Vec3::ZERO), Vec3::ZERO, "{tone_map:?}");
            let mut before = 0.0;
            for i in 0..200 {
                let now = tone_map.map(Vec3::splat(i as f32 * 0.05)).x;
                assert!(now >= before && now <= 1.0, "{tone_map:?} at {i}");
                before = now;
            }
            assert!(before > 0.99, "{tone_map:?}: {before}");
            assert!(tone_map.map(Vec3::splat(f32::MAX)).is_finite());
        }
    }

    #[test]
    fn reinhard_keeps_hues_and_maps_its_white_to_one() {
        let reinhard = ToneMap::Reinhard { white: 3.0 };
        assert!((reinhard.map(Vec3::splat(3.0)) - 1.0).length() < 1e-5);
        let (color, mapped) = (Vec3::new(0.8, 0.4, 0.2), reinhard.map(Vec3::new(0.8, 0.4, 0.2)));
        assert!((mapped / mapped.x - color / color.x).length() < 1e-5);
    }

    #[test]
    fn the_filmic_curve_has_its_published_values() {
        let at = |x: f32| ToneMap::Filmic.map(Vec3::splat(x)).x;
        assert!((at(1.0) - 2.54 / 3.16).abs() < 1e-6);
        assert!((at(0.18) - 0.18 * (2.51 * 0.18 + 0.03) / (0.18 * (2.43 * 0.18 + 0.59) + 0.14)).abs() < 1e-6);
    }
}
