//! How to render.

use crate::pattern::MAX_SAMPLES;
use crate::{Background, Camera, Interpolation, Shading};

/// Where materials are evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShadingRate {
    /// Once per pixel and visible triangle, in the middle of its visible samples (multi-sampling).
    #[default]
    PerPixel,
    /// At every sample (supersampling), with footprints as small as the samples are close.
    PerSample,
}

/// How to render.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOptions {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel, 1..=64; 4, 8 and 16 have the best patterns.
    pub samples: u32,
    /// Where materials are evaluated.
    pub shading_rate: ShadingRate,
    /// Perspective-correct or affine.
    pub interpolation: Interpolation,
    /// Lighting model.
    pub shading: Shading,
    /// What is seen where no surface is. Of these, exposure affects environments only.
    pub background: Background,
    /// Factor of the light that reaches the eye.
    pub exposure: f32,
    /// Seconds since the start of an animation, for what lamps project. (Surfaces have a time of their own.)
    pub time: f32,
}

impl Default for RenderOptions {
    /// 1280x720, 8 samples.
    fn default() -> Self {
        Self {
            width: 1280,
            height: 720,
            samples: 8,
            shading_rate: ShadingRate::default(),
            interpolation: Interpolation::default(),
            shading: Shading::default(),
            background: Background::default(),
            exposure: 1.0,
            time: 0.0,
        }
    }
}

/// Longest side of a picture in pixels.
pub const MAX_PICTURE_SIDE: u32 = 16_384;

/// A picture cannot be rendered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// Empty or absurdly large.
    #[error("cannot render {width}x{height} pixels: both sides must be between 1 and {MAX_PICTURE_SIDE}")]
    Size {
        /// Columns asked for.
        width: u32,
        /// Rows asked for.
        height: u32,
    },
    /// None or too many.
    #[error("cannot render with {0} samples per pixel: ask for 1 to {MAX_SAMPLES}")]
    Samples(u32),
    /// Not a view.
    #[error("cannot render from this camera: {0}")]
    Camera(&'static str),
    /// Not a lamp.
    #[error("cannot render with lamp {lamp} of the scene: {defect}")]
    Light {
        /// Which lamp, from 0.
        lamp: usize,
        /// What is wrong with it.
        defect: &'static str,
    },
}

impl RenderOptions {
    /// Checks options and camera.
    pub(crate) fn check(&self, camera: &Camera) -> Result<(), RenderError> {
        let (width, height) = (self.width, self.height);
        if !(1..=MAX_PICTURE_SIDE).contains(&width) || !(1..=MAX_PICTURE_SIDE).contains(&height) {
            return Err(RenderError::Size { width, height });
        }
        if !(1..=MAX_SAMPLES).contains(&self.samples) {
            return Err(RenderError::Samples(self.samples));
        }
        camera.defect().map_or(Ok(()), |defect| Err(RenderError::Camera(defect)))
    }
}
