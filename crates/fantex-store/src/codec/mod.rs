//! Texel codecs: between texels in *stored encoding* (what the bytes mean before sRGB decoding, 0..1) and bytes.

use crate::{DecodeError, EncodeError, TexelFormat};

/// How much time the BC7 encoder takes. The other formats have one setting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Quality {
    /// About 60 million texels per second and core.
    #[default]
    UltraFast,
    /// About a tenth of that, 2 dB better.
    VeryFast,
    /// Slower, slightly better.
    Fast,
    /// About 1 million texels per second and core.
    Basic,
}

/// Texels to encode, row-major from v = 0, **stored encoding** (sRGB-encoded where the channel is, normals in 0..1).
#[derive(Clone, Copy, Debug)]
pub enum TexelSlice<'a> {
    /// 0..255 is 0..1.
    U8(&'a [[u8; 4]]),
    /// Rounded to 8 bits (clamped to 0..1) for all formats but [`TexelFormat::Rgba32F`], which keeps them.
    F32(&'a [[f32; 4]]),
}

/// Encodes one page. `extent`: columns and rows, multiples of 4 (up to [`PAGE`](crate::PAGE) where the result is to be
/// stored). R formats take red, RG formats red and green, [`TexelFormat::Bc1`] alpha below 1/2 as "transparent".
/// Thread-safe, deterministic; a page's bytes depend on its texels only.
pub fn encode(
    format: TexelFormat,
    quality: Quality,
    extent: [u32; 2],
    texels: TexelSlice<'_>,
) -> Result<Vec<u8>, EncodeError> {
    let _ = (format, quality, extent, texels);
    todo!()
}

/// Decodes one page into **stored encoding**, exactly as `docs/format.md` defines the rounding. Missing channels are
/// `0, 0, 1` (green, blue, alpha).
pub fn decode(format: TexelFormat, extent: [u32; 2], bytes: &[u8]) -> Result<Vec<[f32; 4]>, DecodeError> {
    let _ = (format, extent, bytes);
    todo!()
}
