//! What is seen behind everything.

use glam::Vec3;

/// What is seen where no surface is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Nothing: the picture gets an alpha channel.
    Transparent,
    /// Linear RGB.
    Color(Vec3),
    /// Linear RGB from the first row to the last.
    Gradient {
        /// First row.
        top: Vec3,
        /// Last row.
        bottom: Vec3,
    },
    /// The surroundings that light the scene, as a sky box.
    Environment {
        /// Perceptual roughness, 0..1, by which they are blurred, as if seen in a rough mirror; 0 shows them sharp.
        blur: f32,
    },
}

impl Default for Background {
    /// A light grey gradient, darker below.
    fn default() -> Self {
        Self::Gradient { top: Vec3::splat(0.62), bottom: Vec3::splat(0.34) }
    }
}
