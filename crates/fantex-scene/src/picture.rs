//! Rendered pictures.

use fantex_texture::color::{srgb8_from_linear, unorm8};
use fantex_texture::{ColorSpace, Image, Samples};
use glam::Vec3;

use crate::ToneMap;

/// A picture in linear light.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major from the top: linear RGB and straight alpha. RGB may exceed one.
    pub rgba: Vec<[f32; 4]>,
}

impl Picture {
    /// The pixel in column `x` and row `y`. Panics outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 4] {
        assert!(x < self.width && y < self.height, "pixel {x},{y} of {}x{}", self.width, self.height);
        self.rgba[(y * self.width + x) as usize]
    }

    /// True where every pixel is opaque.
    pub fn is_opaque(&self) -> bool {
        self.rgba.iter().all(|p| p[3] == 1.0)
    }

    /// As floats in linear light, for OpenEXR and HDR files.
    pub fn to_linear_image(&self) -> Image {
        self.image(ColorSpace::Linear, |channels| {
            Samples::F32(self.rgba.iter().flat_map(|p| p[..channels].iter().copied()).collect())
        })
    }

    /// As 8-bit sRGB, values above one cut off, for PNG and JPEG files.
    pub fn to_srgb_image(&self) -> Image {
        self.image(ColorSpace::Srgb, |channels| {
            let byte = |(c, &v): (usize, &f32)| if c == 3 { unorm8(v) } else { srgb8_from_linear(v) };
            Samples::U8(self.rgba.iter().flat_map(|p| p[..channels].iter().enumerate().map(byte)).collect())
        })
    }

    /// The picture with all its light in 0..1.
    pub fn tone_mapped(&self, tone_map: ToneMap) -> Picture {
        let map = |&[r, g, b, alpha]: &[f32; 4]| tone_map.map(Vec3::new(r, g, b)).extend(alpha).to_array();
        Picture { rgba: self.rgba.iter().map(map).collect(), ..*self }
    }

    /// Without an alpha channel where the picture is opaque.
    fn image(&self, space: ColorSpace, samples: impl FnOnce(usize) -> Samples) -> Image {
        let channels: u8 = if self.is_opaque() { 3 } else { 4 };
        let samples = samples(usize::from(channels));
        Image { width: self.width, height: self.height, channels, space, samples }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_have_the_right_encoding_and_channels() {
        let opaque =
            Picture { width: 2, height: 1, rgba: vec![[0.0, 0.5, 1.0, 1.0], [2.0, 0.215_861, 0.0, 1.0]] };
        let bytes = opaque.to_srgb_image();
        assert_eq!((bytes.channels, bytes.space), (3, ColorSpace::Srgb));
        assert_eq!(bytes.samples, Samples::U8(vec![0, 188, 255, 255, 128, 0]));
        let see_through = Picture { width: 1, height: 1, rgba: vec![[0.5, 0.25, 3.0, 0.5]] };
        assert_eq!(see_through.to_srgb_image().samples, Samples::U8(vec![188, 137, 255, 128]));
        assert_eq!(see_through.to_linear_image().samples, Samples::F32(vec![0.5, 0.25, 3.0, 0.5]));
    }
}
