//! A filtered image.

use std::sync::Arc;

use glam::Vec2;

use crate::Image;

/// What lies outside [0,1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The edge texel.
    Clamp,
    /// Transparent black.
    Border,
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored.
    Mirror,
}

/// Reconstruction and anti-aliasing of an image look-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The nearest texel of level 0.
    Nearest,
    /// Four texels of level 0.
    Bilinear,
    /// Sixteen texels of level 0 (Catmull-Rom).
    Bicubic,
    /// Two mip levels, isotropic footprint.
    #[default]
    Trilinear,
    /// Several trilinear probes along the longer axis of the footprint.
    Anisotropic,
    /// Elliptical weighted average (Heckbert 1989): the reference.
    Ewa,
}

/// Options of a look-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleOptions {
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// Reconstruction and anti-aliasing.
    pub filter: Filter,
    /// Longest ratio of the footprint's axes that `Anisotropic` and `Ewa` honour.
    pub max_anisotropy: f32,
}

impl Default for SampleOptions {
    fn default() -> Self {
        Self { wrap: [Wrap::Repeat; 2], filter: Filter::Trilinear, max_anisotropy: 16.0 }
    }
}

/// An image with its mip levels (any size, down to 1x1, filtered in linear light).
#[derive(Clone, Debug)]
pub struct ImageTexture {
    base: Arc<Image>,
}

impl ImageTexture {
    /// Builds the mip levels.
    pub fn new(base: Arc<Image>) -> Self {
        Self { base }
    }

    /// Width and height of level 0.
    pub fn size(&self) -> [u32; 2] {
        [self.base.width, self.base.height]
    }

    /// Filtered linear RGBA (straight alpha; grey images give r = g = b, images without alpha give 1).
    /// `footprint` holds the derivatives of `uv` along the pixel's x and y, in the units of `uv`.
    pub fn sample(&self, uv: Vec2, footprint: [Vec2; 2], options: &SampleOptions) -> [f32; 4] {
        let (_, _, _) = (uv, footprint, options);
        todo!()
    }
}
