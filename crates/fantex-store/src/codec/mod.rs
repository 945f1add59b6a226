//! Texel codecs: between texels in *stored encoding* (what the bytes mean before sRGB decoding, 0..1) and bytes.

mod decode;
mod encode;
mod plain;
mod punch_through;

use std::borrow::Cow;

pub use decode::decode;
pub(crate) use decode::{BC4_DENOMINATOR, StoredTexels};
pub use encode::{encode, encode_many};
pub use plain::decode_plain;

/// How much time the BC7 encoder takes. The other formats have one setting.
///
/// Measured on one core, million texels per second and dB for photographs of rock and of the Earth and for a normal map:
/// `UltraFast` 45 (45.8, 44.9, 31.3), `VeryFast` 6 (46.1, 47.4, 35.6), `Fast` 3 (46.2, 47.6, 35.6). So the default is right
/// for colours; channels whose components do not go together (occlusion, roughness, metallic) gain from `VeryFast`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Quality {
    /// One mode, one region per block.
    #[default]
    UltraFast,
    /// Also two regions per block.
    VeryFast,
    /// The same, with a longer search.
    Fast,
    /// All modes; about 1 million texels per second.
    Basic,
}

/// Texels to encode, row-major from v = 0, **stored encoding** (sRGB-encoded where the channel is, normals in 0..1).
#[derive(Clone, Copy, Debug)]
pub enum TexelSlice<'a> {
    /// 0..255 is 0..1.
    U8(&'a [[u8; 4]]),
    /// Clamped to 0..1 and rounded to 8 bits for all formats but [`TexelFormat::Rgba32F`](crate::TexelFormat), which
    /// keeps them. NaN becomes 0 where it is rounded.
    F32(&'a [[f32; 4]]),
}

impl TexelSlice<'_> {
    /// Number of texels.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(texels) => texels.len(),
            Self::F32(texels) => texels.len(),
        }
    }

    /// True without texels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a> TexelSlice<'a> {
    /// The texels in 8 bits.
    fn unorm8(self) -> Cow<'a, [[u8; 4]]> {
        match self {
            Self::U8(texels) => Cow::Borrowed(texels),
            Self::F32(texels) => texels.iter().map(|texel| texel.map(unorm8_from_f32)).collect(),
        }
    }
}

/// Nearest of the 256 steps of 0..1.
fn unorm8_from_f32(x: f32) -> u8 {
    // Truncation of a non-negative number plus one half rounds; the conversion clamps, and takes NaN to 0.
    (x * 255.0 + 0.5) as u8
}

/// True for a rectangle of whole 4x4 blocks.
fn is_block_extent(extent: [u32; 2]) -> bool {
    extent.iter().all(|&n| n > 0 && n.is_multiple_of(4))
}

#[cfg(test)]
mod tests;
