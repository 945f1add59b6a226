//! Three-dimensional textures: measured volumes and stacks of images.
//!
//! A volume fills the unit cube: voxel `i` of an axis with `n` has its centre at `(i + 1/2) / n`. Where the cube stands in an
//! object's space is said by a [`SpaceMatrix`](crate::coordinates::SpaceMatrix) around the look-up
//! ([`InSpace`](crate::coordinates::InSpace)).

mod error;
mod file;
mod levels;
mod meta_image;
mod texture;

use glam::Vec3;

use crate::{ColorSpace, Depth, Image, Samples};

pub use error::{HeaderFault, LoadVolumeError, VolumeSizeError};
pub use file::{ByteOrder, RawLayout};
pub use texture::{VolumeFilter, VolumeLookup, VolumeOptions, VolumeTexture};

/// The longest side of a volume, in voxels.
pub const MAX_VOLUME_SIDE: u32 = 65_536;

/// A discrete three-dimensional texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    size: [u32; 3],
    channels: u8,
    space: ColorSpace,
    samples: Samples,
    spacing: Vec3,
}

impl Volume {
    /// A volume of `size[0] * size[1] * size[2]` voxels with 1 (grey), 2 (grey + alpha), 3 (RGB) or 4 (RGBA) channels:
    /// x fastest, then y, then z, channels interleaved. `space` is the encoding of the colour channels; floats that are
    /// encoded in sRGB are decoded at every look-up.
    ///
    /// # Errors
    ///
    /// A side is 0 or above [`MAX_VOLUME_SIDE`], the channels are not 1 to 4, or the samples do not fit the size.
    pub fn new(
        size: [u32; 3],
        channels: u8,
        space: ColorSpace,
        samples: Samples,
    ) -> Result<Self, VolumeSizeError> {
        let expected = checked_samples(size, channels)?;
        if samples.len() as u64 != expected {
            return Err(VolumeSizeError::Samples { size, channels, expected, got: samples.len() as u64 });
        }
        Ok(Self { size, channels, space, samples, spacing: Vec3::ONE })
    }

    /// A stack of images of one size and kind, the first at the lowest z; row 0 of an image lies at the lowest y.
    ///
    /// # Errors
    ///
    /// There is no image, one differs from the first, or a side is too long.
    pub fn from_slices(slices: &[Image]) -> Result<Self, VolumeSizeError> {
        let first = slices.first().ok_or(VolumeSizeError::NoSlices)?;
        let kind =
            |image: &Image| (image.width, image.height, image.channels, image.space, image.samples.depth());
        if let Some(index) = slices.iter().position(|slice| kind(slice) != kind(first)) {
            return Err(VolumeSizeError::UnequalSlices { index });
        }
        let size = [first.width, first.height, u32::try_from(slices.len()).unwrap_or(u32::MAX)];
        checked_samples(size, first.channels)?;
        macro_rules! joined {
            ($variant:ident) => {
                Samples::$variant(
                    slices
                        .iter()
                        .flat_map(|slice| match &slice.samples {
                            Samples::$variant(values) => values.as_slice(),
                            _ => &[],
                        })
                        .copied()
                        .collect(),
                )
            };
        }
        let samples = match first.samples.depth() {
            Depth::U8 => joined!(U8),
            Depth::U16 => joined!(U16),
            Depth::F32 => joined!(F32),
        };
        Self::new(size, first.channels, first.space, samples)
    }

    /// The same volume with the distances between voxels, in any unit; all three must be above 0 and finite, others stay
    /// as they were.
    #[must_use]
    pub fn with_spacing(mut self, spacing: Vec3) -> Self {
        if spacing.is_finite() && spacing.min_element() > 0.0 {
            self.spacing = spacing;
        }
        self
    }

    /// Voxels along x, y and z.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// 1 grey, 2 grey + alpha, 3 RGB, 4 RGBA.
    pub fn channels(&self) -> u8 {
        self.channels
    }

    /// Encoding of the colour channels.
    pub fn space(&self) -> ColorSpace {
        self.space
    }

    /// The numbers: x fastest, then y, then z, channels interleaved.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Distances between voxels along x, y and z, in the file's unit; 1 where none was said.
    pub fn spacing(&self) -> Vec3 {
        self.spacing
    }

    /// Size times spacing: the proportions of the volume.
    pub fn extent(&self) -> Vec3 {
        Vec3::from(self.size.map(|n| n as f32)) * self.spacing
    }

    fn has_alpha(&self) -> bool {
        self.channels == 2 || self.channels == 4
    }

    /// Bytes of the samples.
    pub fn byte_len(&self) -> u64 {
        self.samples.len() as u64 * sample_bytes(self.samples.depth())
    }
}

fn sample_bytes(depth: Depth) -> u64 {
    match depth {
        Depth::U8 => 1,
        Depth::U16 => 2,
        Depth::F32 => 4,
    }
}

/// Samples of a volume of this size.
fn checked_samples(size: [u32; 3], channels: u8) -> Result<u64, VolumeSizeError> {
    if size.iter().any(|side| !(1..=MAX_VOLUME_SIDE).contains(side)) || !(1..=4).contains(&channels) {
        return Err(VolumeSizeError::Size { size, channels });
    }
    // At most 2^50.
    Ok(size.iter().map(|&side| u64::from(side)).product::<u64>() * u64::from(channels))
}
