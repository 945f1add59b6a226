//! Decoding to what graphics hardware samples without block compression.

use half::f16;

use super::StoredTexels;
use crate::srgb::linear_from_srgb;
use crate::{DecodeError, TexelFormat};

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
pub fn decode_plain(
    format: TexelFormat,
    srgb: bool,
    extent: [u32; 2],
    bytes: &[u8],
) -> Result<Vec<u8>, DecodeError> {
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
    let rgba = if srgb { [r, g, b].map(linear_from_srgb) } else { [r, g, b] };
    let [r, g, b] = rgba.map(|x| f16::from_f32(x.clamp(-limit, limit)).to_le_bytes());
    let a = f16::from_f32(a.clamp(-limit, limit)).to_le_bytes();
    [r[0], r[1], g[0], g[1], b[0], b[1], a[0], a[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Quality, TexelSlice, decode, encode};

    /// Every format's plain texels are the decoded ones, rounded.
    #[test]
    fn plain_texels_are_the_decoded_ones() {
        let extent = [8, 12];
        let texels: Vec<[f32; 4]> = (0..96)
            .map(|i| {
                let x = i as f32 / 96.0;
                [x, 1.0 - x, (7.0 * x).fract(), 1.0]
            })
            .collect();
        for format in TexelFormat::ALL {
            let bytes = encode(format, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap();
            let decoded = decode(format, extent, &bytes).unwrap();
            let plain = decode_plain(format, false, extent, &bytes).unwrap();
            let channels = format.channel_count();
            for (i, texel) in decoded.iter().enumerate() {
                for (k, value) in texel.iter().take(channels).enumerate() {
                    let at = i * channels + k;
                    if format == TexelFormat::Rgba32F {
                        let half = f16::from_le_bytes([plain[2 * at], plain[2 * at + 1]]);
                        assert_eq!(half, f16::from_f32(*value));
                    } else {
                        assert_eq!(f32::from(plain[at]), (value * 255.0).round(), "{format:?} {value}");
                    }
                }
            }
            let texel_bytes = if format == TexelFormat::Rgba32F { 8 } else { channels };
            assert_eq!(plain.len(), 96 * texel_bytes);
        }
        assert!(decode_plain(TexelFormat::Bc7, true, [4, 4], &[0; 15]).is_err());
    }

    #[test]
    fn ratios_round_to_the_nearest_step() {
        for numerator in 0..=8925u16 {
            let exact = f64::from(numerator) / 35.0;
            assert_eq!(f64::from(unorm8_from_ratio(numerator)), exact.round(), "{numerator}");
        }
    }

    #[test]
    fn floats_beyond_the_half_floats_range_are_clamped() {
        let texel = [1e9f32, -1e9, 0.5, 1.0].map(f32::to_le_bytes).concat();
        let plain = decode_plain(TexelFormat::Rgba32F, true, [4, 4], &texel.repeat(16)).unwrap();
        let half = |k: usize| f16::from_le_bytes([plain[2 * k], plain[2 * k + 1]]).to_f32();
        assert_eq!((half(0), half(1), half(3)), (65504.0, -65504.0, 1.0));
        assert!((half(2) - 0.214).abs() < 1e-3);
    }
}
