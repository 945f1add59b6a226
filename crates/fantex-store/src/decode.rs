//! Decoding texels: from bytes to stored encoding, or to what graphics hardware samples without block compression.
//!
//! The formats leave some rounding open; here it is fixed (and written down in `docs/format.md`):
//! - BC7 is exact by its definition, 8 bits.
//! - BC1: the palette's exact rational values, rounded to the nearest of 256 steps.
//! - BC4, BC5: the palette's exact rational values. All are multiples of 1/8925 (8925 = 5 * 7 * 255), so they are kept
//!   as integer numerators, without rounding.

use fantex_base::srgb::{linear_from_srgb, linear_from_srgb8_table, unit_from_u8_table};
use fantex_base::{Error, Result};
use half::f16;

use crate::TexelFormat;
use crate::bytes::values_from_bytes;
use crate::layout::is_block_extent;

/// Common denominator of all values that a BC4 block can hold.
pub(crate) const BC4_DENOMINATOR: f32 = 8925.0;

/// Decodes one page into **stored encoding**, exactly as `docs/format.md` defines the rounding. Missing channels are
/// `0, 0, 1` (green, blue, alpha).
///
/// # Errors
/// The extent is not one of whole 4x4 blocks, or the number of bytes does not match it.
pub fn decode(format: TexelFormat, extent: [u32; 2], bytes: &[u8]) -> Result<Vec<[f32; 4]>> {
    let texels = StoredTexels::decode(format, extent, bytes)?;
    Ok((0..extent[0] as usize * extent[1] as usize).map(|i| texels.stored(i)).collect())
}

/// Decoded texels of a rectangle, row-major, in the smallest form that keeps their exact values.
#[derive(Debug)]
pub(crate) enum StoredTexels {
    R8(Vec<u8>),
    Rg8(Vec<[u8; 2]>),
    Rgba8(Vec<[u8; 4]>),
    /// Numerators over [`BC4_DENOMINATOR`].
    RRatio(Vec<u16>),
    /// Numerators over [`BC4_DENOMINATOR`].
    RgRatio(Vec<[u16; 2]>),
    Rgba32F(Vec<[f32; 4]>),
}

impl StoredTexels {
    pub(crate) fn decode(format: TexelFormat, extent: [u32; 2], bytes: &[u8]) -> Result<Self> {
        let [width, height] = extent;
        if !is_block_extent(extent) {
            return Err(Error::invalid(format!(
                "cannot decode {width}x{height} texels: both sides must be positive multiples of 4"
            )));
        }
        let expected = format.bytes(extent);
        if bytes.len() != expected {
            return Err(Error::invalid(format!(
                "{width}x{height} texels take {expected} bytes, but there are {}",
                bytes.len()
            )));
        }
        Ok(match format {
            TexelFormat::Bc1 => Self::Rgba8(decode_color(extent, bytes, 8, bcdec_rs::bc1)),
            TexelFormat::Bc7 => Self::Rgba8(decode_color(extent, bytes, 16, bcdec_rs::bc7)),
            TexelFormat::Bc4 => {
                Self::RRatio(decode_ratios::<1>(extent, bytes).into_iter().flatten().collect())
            }
            TexelFormat::Bc5 => Self::RgRatio(decode_ratios::<2>(extent, bytes)),
            TexelFormat::R8 => Self::R8(bytes.to_vec()),
            TexelFormat::Rg8 => Self::Rg8(values_from_bytes(bytes)),
            TexelFormat::Rgba8 => Self::Rgba8(values_from_bytes(bytes)),
            TexelFormat::Rgba32F => Self::Rgba32F(
                values_from_bytes::<[[u8; 4]; 4]>(bytes)
                    .into_iter()
                    .map(|texel| texel.map(f32::from_le_bytes).map(finite))
                    .collect(),
            ),
        })
    }

    pub(crate) fn stored(&self, i: usize) -> [f32; 4] {
        match self {
            Self::Rgba8(texels) => texels[i].map(|x| unit_from_u8_table()[usize::from(x)]),
            Self::Rgba32F(texels) => texels[i],
            Self::R8(texels) => [unit_from_u8_table()[usize::from(texels[i])], 0.0, 0.0, 1.0],
            Self::Rg8(texels) => {
                let [r, g] = texels[i].map(|x| unit_from_u8_table()[usize::from(x)]);
                [r, g, 0.0, 1.0]
            }
            Self::RRatio(texels) => [f32::from(texels[i]) / BC4_DENOMINATOR, 0.0, 0.0, 1.0],
            Self::RgRatio(texels) => {
                let [r, g] = texels[i].map(|x| f32::from(x) / BC4_DENOMINATOR);
                [r, g, 0.0, 1.0]
            }
        }
    }

    /// A texel in linear light. Of the compact forms only those of four channels can be sRGB-encoded.
    pub(crate) fn linear(&self, i: usize, srgb: bool) -> [f32; 4] {
        match self {
            Self::Rgba8(texels) if srgb => {
                let [r, g, b, a] = texels[i].map(usize::from);
                let table = linear_from_srgb8_table();
                [table[r], table[g], table[b], unit_from_u8_table()[a]]
            }
            Self::Rgba32F(texels) if srgb => {
                let [r, g, b, a] = texels[i];
                [linear_from_stored(r), linear_from_stored(g), linear_from_stored(b), a]
            }
            _ => self.stored(i),
        }
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        match self {
            Self::R8(texels) => texels.len(),
            Self::Rg8(texels) => 2 * texels.len(),
            Self::Rgba8(texels) => 4 * texels.len(),
            Self::RRatio(texels) => 2 * texels.len(),
            Self::RgRatio(texels) => 4 * texels.len(),
            Self::Rgba32F(texels) => 16 * texels.len(),
        }
    }
}

/// Linear light of an sRGB-encoded float: the format continues the curve below zero by its straight part.
pub(crate) fn linear_from_stored(encoded: f32) -> f32 {
    if encoded < 0.0 { encoded / 12.92 } else { linear_from_srgb(encoded) }
}

/// Stored floats are finite; a file that says otherwise reads as zero there.
fn finite(x: f32) -> f32 {
    if x.is_finite() { x } else { 0.0 }
}

/// Decodes blocks of `block_bytes` to RGBA8 with `decode_block` (block, output, bytes per output row).
fn decode_color(
    extent: [u32; 2],
    bytes: &[u8],
    block_bytes: usize,
    decode_block: fn(&[u8], &mut [u8], usize),
) -> Vec<[u8; 4]> {
    let [width, height] = extent.map(|n| n as usize);
    let mut texels = vec![[0u8; 4]; width * height];
    let output: &mut [u8] = bytemuck::cast_slice_mut(&mut texels);
    let mut blocks = bytes.chunks_exact(block_bytes);
    for y in (0..height).step_by(4) {
        for (x, block) in (0..width).step_by(4).zip(&mut blocks) {
            decode_block(block, &mut output[4 * (y * width + x)..], 4 * width);
        }
    }
    texels
}

/// Decodes blocks of `CHANNELS` BC4 blocks each to numerators over [`BC4_DENOMINATOR`].
fn decode_ratios<const CHANNELS: usize>(extent: [u32; 2], bytes: &[u8]) -> Vec<[u16; CHANNELS]> {
    let [width, height] = extent.map(|n| n as usize);
    let mut texels = vec![[0u16; CHANNELS]; width * height];
    let mut blocks = bytes.chunks_exact(8);
    for y in (0..height).step_by(4) {
        for x in (0..width).step_by(4) {
            for (channel, block) in (0..CHANNELS).zip(&mut blocks) {
                let palette = bc4_palette(block[0], block[1]);
                let mut indices = block[2..8].iter().rev().fold(0u64, |bits, &b| (bits << 8) | u64::from(b));
                for k in 0..16 {
                    texels[(y + k / 4) * width + x + k % 4][channel] = palette[(indices & 7) as usize];
                    indices >>= 3;
                }
            }
        }
    }
    texels
}

/// The eight values of a BC4 block as numerators over [`BC4_DENOMINATOR`].
fn bc4_palette(end0: u8, end1: u8) -> [u16; 8] {
    let (e0, e1) = (u16::from(end0), u16::from(end1));
    let mut palette = [35 * e0, 35 * e1, 0, 0, 0, 0, 0, 8925];
    if e0 > e1 {
        for k in 1..7 {
            palette[1 + k as usize] = 5 * ((7 - k) * e0 + k * e1);
        }
    } else {
        for k in 1..5 {
            palette[1 + k as usize] = 7 * ((5 - k) * e0 + k * e1);
        }
    }
    palette
}

/// Decodes one page into plain texels, row-major from v = 0, without padding:
///
/// | format | bytes per texel |
/// |---|---|
/// | BC4, R8 | 1: red |
/// | BC5, RG8 | 2: red, green |
/// | BC1, BC7, RGBA8 | 4: RGBA |
/// | RGBA32F | 8: RGBA as little-endian half floats; `srgb` colours are decoded, values clamped to their range |
///
/// Bytes are of 0..1 in the **stored encoding** (sRGB stays encoded); BC4 and BC5 are rounded to the nearest 1/255.
///
/// # Errors
/// As [`decode`].
pub fn decode_plain(format: TexelFormat, srgb: bool, extent: [u32; 2], bytes: &[u8]) -> Result<Vec<u8>> {
    Ok(match StoredTexels::decode(format, extent, bytes)? {
        StoredTexels::R8(texels) => texels,
        StoredTexels::Rg8(texels) => texels.into_flattened(),
        StoredTexels::Rgba8(texels) => texels.into_flattened(),
        StoredTexels::RRatio(texels) => texels.into_iter().map(unorm8_from_ratio).collect(),
        StoredTexels::RgRatio(texels) => texels.into_iter().flatten().map(unorm8_from_ratio).collect(),
        StoredTexels::Rgba32F(texels) => texels.into_iter().flat_map(|texel| halves(texel, srgb)).collect(),
    })
}

/// Nearest of 256 steps to a numerator over 8925 = 35 * 255.
fn unorm8_from_ratio(numerator: u16) -> u8 {
    ((u32::from(numerator) + 17) / 35) as u8
}

fn halves([r, g, b, a]: [f32; 4], srgb: bool) -> [u8; 8] {
    let limit = f32::from(f16::MAX);
    let rgba = if srgb { [r, g, b].map(linear_from_stored) } else { [r, g, b] };
    let [r, g, b] = rgba.map(|x| f16::from_f32(x.clamp(-limit, limit)).to_le_bytes());
    let a = f16::from_f32(a.clamp(-limit, limit)).to_le_bytes();
    [r[0], r[1], g[0], g[1], b[0], b[1], a[0], a[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_round_to_the_nearest_step() {
        for numerator in 0..=8925u16 {
            let exact = f64::from(numerator) / 35.0;
            assert_eq!(f64::from(unorm8_from_ratio(numerator)), exact.round(), "{numerator}");
        }
    }
}
