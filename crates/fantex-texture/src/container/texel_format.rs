//! Texels as they lie in KTX2 and DDS files.

use crate::{ColorSpace, Image, Samples};

/// The storage of texels. Formats with two channels become RGB with blue 0, since they hold no grey and alpha; all but
/// 8- and 16-bit channels become floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TexelFormat {
    /// Bytes.
    U8 { channels: u8 },
    /// Bytes, blue first.
    Bgr8 { channels: u8 },
    /// Four bytes, blue first, the last one unused.
    Bgrx8,
    /// Two bytes.
    GreyAlpha8,
    /// 16 bits, 0..65535 for 0..1.
    U16 { channels: u8 },
    /// Half floats.
    F16 { channels: u8 },
    /// Floats.
    F32 { channels: u8 },
    /// Three unsigned small floats in 32 bits: 11 bits of red (lowest), 11 of green, 10 of blue.
    B10G11R11,
    /// Three mantissas of 9 bits, red lowest, and a common exponent.
    E5B9G9R9,
    /// 4 x 4 texels in 8 bytes, RGBA.
    Bc1,
    /// In 16 bytes, RGBA.
    Bc2,
    /// In 16 bytes, RGBA.
    Bc3,
    /// In 8 bytes, grey.
    Bc4,
    /// In 16 bytes, red and green.
    Bc5,
    /// In 16 bytes, RGB floats.
    Bc6h { is_signed: bool },
    /// In 16 bytes, RGBA.
    Bc7,
}

/// Texels along a side of a block.
const BLOCK: usize = 4;

impl TexelFormat {
    /// Bytes of a block, for formats that have blocks.
    fn block_bytes(self) -> Option<usize> {
        match self {
            Self::Bc1 | Self::Bc4 => Some(8),
            Self::Bc2 | Self::Bc3 | Self::Bc5 | Self::Bc6h { .. } | Self::Bc7 => Some(16),
            _ => None,
        }
    }

    /// Bytes of a texel, for formats without blocks.
    fn texel_bytes(self) -> usize {
        match self {
            Self::U8 { channels } | Self::Bgr8 { channels } => usize::from(channels),
            Self::GreyAlpha8 => 2,
            Self::U16 { channels } | Self::F16 { channels } => 2 * usize::from(channels),
            Self::F32 { channels } => 4 * usize::from(channels),
            _ => 4,
        }
    }

    /// Bytes of an image in the file.
    pub(super) fn byte_len(self, width: u32, height: u32) -> u64 {
        match self.block_bytes() {
            Some(bytes) => u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4)) * bytes as u64,
            None => u64::from(width) * u64::from(height) * self.texel_bytes() as u64,
        }
    }

    /// Bytes of a texel in memory, at most.
    pub(super) fn decoded_bytes(self) -> u64 {
        match self {
            Self::U8 { .. } | Self::Bgr8 { .. } | Self::Bgrx8 | Self::GreyAlpha8 => 4,
            Self::Bc1 | Self::Bc2 | Self::Bc3 | Self::Bc4 | Self::Bc5 | Self::Bc7 => 4,
            Self::U16 { .. } => 8,
            _ => 16,
        }
    }

    /// The image in `bytes`, of which there are [`TexelFormat::byte_len`]. Floats are linear, whatever `space` says.
    pub(super) fn decode(self, bytes: &[u8], width: u32, height: u32, space: ColorSpace) -> Image {
        let image = |channels, samples| Image { width, height, channels, space, samples };
        let floats = |channels, samples| Image::from_linear(width, height, channels, samples);
        let shorts = || bytes.as_chunks().0.iter().map(|&pair| u16::from_le_bytes(pair));
        let words = || bytes.as_chunks().0.iter().map(|&word| u32::from_le_bytes(word));
        let blocks = Blocks { bytes, width: width as usize, height: height as usize };
        match self {
            Self::U8 { channels } => {
                let (channels, samples) = without_pairs(bytes.to_vec(), channels);
                image(channels, Samples::U8(samples))
            }
            Self::Bgr8 { channels } => {
                let mut samples = bytes.to_vec();
                samples.chunks_exact_mut(usize::from(channels)).for_each(|texel| texel.swap(0, 2));
                image(channels, Samples::U8(samples))
            }
            Self::Bgrx8 => {
                let texels = bytes.as_chunks::<4>().0;
                image(3, Samples::U8(texels.iter().flat_map(|&[b, g, r, _]| [r, g, b]).collect()))
            }
            Self::GreyAlpha8 => image(2, Samples::U8(bytes.to_vec())),
            Self::U16 { channels } => {
                let (channels, samples) = without_pairs(shorts().collect(), channels);
                image(channels, Samples::U16(samples))
            }
            Self::F16 { channels } => {
                let numbers = shorts().map(|bits| finite(half::f16::from_bits(bits).to_f32()));
                let (channels, samples) = without_pairs(numbers.collect(), channels);
                floats(channels, samples)
            }
            Self::F32 { channels } => {
                let numbers = words().map(|bits| finite(f32::from_bits(bits)));
                let (channels, samples) = without_pairs(numbers.collect(), channels);
                floats(channels, samples)
            }
            Self::B10G11R11 => floats(3, words().flat_map(b10g11r11).collect()),
            Self::E5B9G9R9 => floats(3, words().flat_map(e5b9g9r9).collect()),
            Self::Bc1 => image(4, Samples::U8(blocks.texels::<8, _, 64>(4, bcdec_rs::bc1))),
            Self::Bc2 => image(4, Samples::U8(blocks.texels::<16, _, 64>(4, bcdec_rs::bc2))),
            Self::Bc3 => image(4, Samples::U8(blocks.texels::<16, _, 64>(4, bcdec_rs::bc3))),
            Self::Bc7 => image(4, Samples::U8(blocks.texels::<16, _, 64>(4, bcdec_rs::bc7))),
            Self::Bc4 => {
                let decode = |block: &[u8], out: &mut [u8], pitch| bcdec_rs::bc4(block, out, pitch, false);
                image(1, Samples::U8(blocks.texels::<8, _, 16>(1, decode)))
            }
            Self::Bc5 => {
                let decode = |block: &[u8], out: &mut [u8], pitch| bcdec_rs::bc5(block, out, pitch, false);
                let (channels, samples) = without_pairs(blocks.texels::<16, _, 32>(2, decode), 2);
                image(channels, Samples::U8(samples))
            }
            Self::Bc6h { is_signed } => {
                let decode =
                    |block: &[u8], out: &mut [f32], pitch| bcdec_rs::bc6h_float(block, out, pitch, is_signed);
                let numbers = blocks.texels::<16, f32, 48>(3, decode);
                floats(3, numbers.into_iter().map(finite).collect())
            }
        }
    }
}

/// Blocks of 4 x 4 texels, row by row; those at the right and lower edges are cut off.
struct Blocks<'a> {
    bytes: &'a [u8],
    width: usize,
    height: usize,
}

impl Blocks<'_> {
    /// All samples, of blocks with `BYTES` bytes that `decode` turns into `SAMPLES` samples (with the samples of a row).
    fn texels<const BYTES: usize, S: Copy + Default, const SAMPLES: usize>(
        &self,
        channels: usize,
        decode: impl Fn(&[u8], &mut [S], usize),
    ) -> Vec<S> {
        let mut samples = vec![S::default(); self.width * self.height * channels];
        let columns = self.width.div_ceil(BLOCK);
        for (index, block) in self.bytes.as_chunks::<BYTES>().0.iter().enumerate() {
            let (x, y) = (index % columns * BLOCK, index / columns * BLOCK);
            let mut decoded = [S::default(); SAMPLES];
            decode(block, &mut decoded, BLOCK * channels);
            let run = BLOCK.min(self.width - x) * channels;
            for (row, texels) in decoded.chunks_exact(BLOCK * channels).enumerate().take(self.height - y) {
                let first = ((y + row) * self.width + x) * channels;
                samples[first..first + run].copy_from_slice(&texels[..run]);
            }
        }
        samples
    }
}

/// Red and green as RGB.
fn without_pairs<S: Copy + Default>(samples: Vec<S>, channels: u8) -> (u8, Vec<S>) {
    if channels != 2 {
        return (channels, samples);
    }
    (3, samples.as_chunks().0.iter().flat_map(|&[red, green]| [red, green, S::default()]).collect())
}

/// One infinite or undefined number would spread over all coarser levels: the largest half float instead, or 0.
fn finite(value: f32) -> f32 {
    match value {
        _ if value.is_nan() => 0.0,
        _ if value.is_infinite() => half::f16::MAX.to_f32().copysign(value),
        _ => value,
    }
}

/// Unsigned floats with 5 bits of exponent: half floats without their sign and lowest bits.
fn b10g11r11(bits: u32) -> [f32; 3] {
    let small = |bits: u32, missing: u32| finite(half::f16::from_bits((bits << missing) as u16).to_f32());
    [small(bits & 0x7ff, 4), small(bits >> 11 & 0x7ff, 4), small(bits >> 22, 5)]
}

fn e5b9g9r9(bits: u32) -> [f32; 3] {
    let scale = ((bits >> 27) as f32 - 24.0).exp2();
    [0, 9, 18].map(|shift| (bits >> shift & 0x1ff) as f32 * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_floats_are_decoded() {
        // 1.0 has the exponent 15: shifted by 6 bits of mantissa in 11 bits, by 5 in 10.
        assert_eq!(b10g11r11(15 << 6 | 16 << 17 | 14 << 27), [1.0, 2.0, 0.5]);
        assert_eq!(b10g11r11(0), [0.0; 3]);
        // Infinity and what is none.
        assert!(b10g11r11(u32::MAX).iter().all(|value| value.is_finite()));
        // 256 / 512 * 2^(16 - 15) = 1.
        assert_eq!(e5b9g9r9(16 << 27 | 256 | 128 << 9), [1.0, 0.5, 0.0]);
    }

    #[test]
    fn blocks_are_cut_at_the_edges() {
        // Two endpoints of BC4 with all indices 0: each block is its first endpoint.
        let block = |value: u8| [value, 0, 0, 0, 0, 0, 0, 0];
        let bytes: Vec<u8> = [10, 20, 30, 40].into_iter().flat_map(block).collect();
        let image = TexelFormat::Bc4.decode(&bytes, 6, 5, ColorSpace::Linear);
        assert_eq!((image.width, image.height, image.channels), (6, 5, 1));
        let Samples::U8(values) = image.samples else { panic!() };
        for (index, value) in values.into_iter().enumerate() {
            let (right, lower) = (index % 6 >= 4, index / 6 >= 4);
            assert_eq!(value, 10 + 10 * u8::from(right) + 20 * u8::from(lower), "texel {index}");
        }
        assert_eq!(TexelFormat::Bc4.byte_len(6, 5), 32);
    }
}
