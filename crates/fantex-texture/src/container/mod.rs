//! Textures as graphics processors take them: KTX2 and DDS files, with several images and compressed blocks.
//!
//! Only the finest level is read: coarser ones are made anew, by the same filter for all files.

mod dds;
mod ktx2;
mod texel_format;

use std::fmt;

use crate::image_file::{ImageLimits, LoadImageError};
use crate::{ColorSpace, Image};

use texel_format::TexelFormat;

/// A kind of file that holds textures for graphics processors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ContainerFormat {
    /// Khronos texture, version 2.
    Ktx2,
    /// DirectDraw surface.
    Dds,
}

impl fmt::Display for ContainerFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ktx2 => "KTX2",
            Self::Dds => "DDS",
        })
    }
}

/// What is wrong with a KTX2 or DDS file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ContainerFault {
    /// The file ends too early.
    #[error("the file ends after {got} bytes; {needed} are needed")]
    TooShort {
        /// Bytes needed.
        needed: u64,
        /// Bytes there are.
        got: u64,
    },
    /// A number of the header that cannot be.
    #[error("the header says {value} for {field}, which cannot be")]
    Header {
        /// Which number.
        field: &'static str,
        /// What it is.
        value: u64,
    },
    /// Texels of a format that is not read.
    #[error("texels of format {name} are not read; use 8-, 16- or 32-bit channels or BC1 to BC7")]
    TexelFormat {
        /// The format, as the file names it.
        name: String,
    },
    /// The texels are Basis Universal.
    #[error("Basis Universal textures are not read; transcode the file to BC7 or to plain texels first")]
    Basis,
    /// The texels are packed by a method that is not read.
    #[error("texels packed by method {method} are not read; use Zstandard (2) or none (0)")]
    Packing {
        /// The method's number.
        method: u32,
    },
    /// Packed texels are damaged.
    #[error("the packed texels are damaged")]
    Damaged,
}

/// What a header says: images of one size, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    format: TexelFormat,
    width: u32,
    height: u32,
    /// Layers times faces times slices.
    images: u64,
    /// `None` where the file does not say it.
    space: Option<ColorSpace>,
}

impl Layout {
    /// Bytes of one image in the file.
    fn image_bytes(&self) -> u64 {
        self.format.byte_len(self.width, self.height)
    }

    /// Refuses sizes that are impossible or above the limits.
    fn check(&self, label: &str, limits: ImageLimits) -> Result<(), LoadImageError> {
        let (width, height) = (self.width, self.height);
        if width == 0 || height == 0 || width.max(height) > limits.side {
            return Err(LoadImageError::Size { label: label.to_owned(), width, height, limit: limits.side });
        }
        let texels = (u64::from(width) * u64::from(height)).saturating_mul(self.images);
        if texels.saturating_mul(self.format.decoded_bytes()) > limits.bytes {
            return Err(LoadImageError::Memory { label: label.to_owned(), limit: limits.bytes });
        }
        Ok(())
    }

    fn decode(&self, bytes: &[u8], default_space: ColorSpace) -> Image {
        let space = self.space.unwrap_or(default_space);
        self.format.decode(bytes, self.width, self.height, space)
    }
}

/// Which container the bytes begin as.
pub(crate) fn recognise(bytes: &[u8]) -> Option<ContainerFormat> {
    if bytes.starts_with(&ktx2::MAGIC) {
        return Some(ContainerFormat::Ktx2);
    }
    bytes.starts_with(&dds::MAGIC).then_some(ContainerFormat::Dds)
}

/// The images of the finest level, at most `most` of them: by layer, then face (right, left, up, down, front, back), then
/// slice.
pub(crate) fn decode(
    container: ContainerFormat,
    bytes: &[u8],
    label: &str,
    default_space: ColorSpace,
    limits: ImageLimits,
    most: usize,
) -> Result<Vec<Image>, LoadImageError> {
    let fail = |fault| LoadImageError::Container { label: label.to_owned(), format: container, fault };
    match container {
        ContainerFormat::Ktx2 => {
            let header = ktx2::Header::parse(bytes).map_err(fail)?;
            header.layout.check(label, limits)?;
            let level = header.level(bytes).map_err(fail)?;
            let images = level.chunks_exact(header.layout.image_bytes() as usize).take(most);
            Ok(images.map(|image| header.layout.decode(image, default_space)).collect())
        }
        ContainerFormat::Dds => {
            let header = dds::Header::parse(bytes).map_err(fail)?;
            header.layout.check(label, limits)?;
            let images = header.images(bytes).map_err(fail)?;
            let decoded =
                images.into_iter().take(most).map(|image| header.layout.decode(image, default_space));
            Ok(decoded.collect())
        }
    }
}

/// The little-endian number at an offset.
fn u32_at(bytes: &[u8], offset: usize) -> Result<u32, ContainerFault> {
    let too_short = || ContainerFault::TooShort { needed: offset as u64 + 4, got: bytes.len() as u64 };
    let number = bytes.get(offset..).and_then(|rest| rest.first_chunk());
    number.map(|number| u32::from_le_bytes(*number)).ok_or_else(too_short)
}

/// `length` bytes from `offset` on.
fn slice_at(bytes: &[u8], offset: u64, length: u64) -> Result<&[u8], ContainerFault> {
    let end = offset.saturating_add(length);
    let too_short = ContainerFault::TooShort { needed: end, got: bytes.len() as u64 };
    if end > bytes.len() as u64 { Err(too_short) } else { Ok(&bytes[offset as usize..end as usize]) }
}
