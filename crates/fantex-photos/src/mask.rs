//! Masks: which pixels of a photograph are to be used.

use std::path::Path;

use fantex_texture::{ColorSpace, Image};

use crate::PhotoError;
use crate::photograph::have_one_shape;

/// An image that is black where a photograph is not to be used.
pub(crate) struct Mask {
    image: Image,
    /// Pixels of the photograph.
    size: [u32; 2],
}

impl Mask {
    /// The mask of a photograph of `size` pixels; it may be smaller or larger.
    pub(crate) fn load(path: &Path, size: [u32; 2]) -> Result<Self, PhotoError> {
        let image = Image::load_as(path, ColorSpace::Linear)?;
        let found = [image.width, image.height];
        match have_one_shape(found, size) {
            true => Ok(Self { image, size }),
            false => Err(PhotoError::MaskShape { path: path.into(), found, expected: size }),
        }
    }

    /// How much of a pixel of the photograph is to be used: 0 for none of it, 1 for all.
    pub(crate) fn share(&self, x: u32, y: u32) -> f32 {
        let there =
            |at: u32, found: u32, size: u32| (u64::from(at) * u64::from(found) / u64::from(size)) as u32;
        let [width, height] = self.size;
        let at = [there(x, self.image.width, width), there(y, self.image.height, height)];
        let [value, .., alpha] = self.image.linear_texel(at[0], at[1]);
        (value * alpha).clamp(0.0, 1.0)
    }
}
