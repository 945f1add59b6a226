//! A fingerprint of this processor's block encoders, so that parts of one bake are not mixed from encoders that differ.
//!
//! The encoders choose instructions by the processor: fused multiplications from AVX2 on, approximate reciprocals whose last bits are the
//! maker's choice. One block in ten thousand comes out otherwise, about as well. What is encoded is the same everywhere: bakes to
//! uncompressed texels give the same bytes on processors with SSE2, AVX2 and AVX-512.

use fantex_base::{Random, Result};
use xxhash_rust::xxh3::Xxh3;

use crate::{Quality, TexelFormat, TexelSlice, encode};

/// Texels of the fixed picture that is encoded: enough blocks that encoders which differ give other bytes.
const EXTENT: [u32; 2] = [1024, 512];

/// The same for BC7 with alpha, which takes seven times as long.
const SMALL_EXTENT: [u32; 2] = [512, 256];

/// What the block encoders of this processor make of fixed pictures, as a hash; 0 where all formats are uncompressed.
///
/// Processors with different fingerprints write different bytes; those with the same write the same, as far as the pictures tell. Takes some
/// 50 ms.
///
/// # Errors
/// None on any processor; the result is that of [`encode`].
pub(crate) fn encoder_fingerprint(formats: &[TexelFormat]) -> Result<u64> {
    let mut hash = Xxh3::new();
    let mut is_compressed = false;
    for format in [TexelFormat::Bc1, TexelFormat::Bc4, TexelFormat::Bc5, TexelFormat::Bc7] {
        if !formats.contains(&format) {
            continue;
        }
        is_compressed = true;
        let mut add = |quality, extent, alpha| -> Result<()> {
            let texels = picture(extent, alpha);
            hash.update(&encode(format, quality, extent, TexelSlice::U8(&texels))?);
            Ok(())
        };
        add(Quality::UltraFast, EXTENT, false)?;
        if format == TexelFormat::Bc7 {
            add(Quality::UltraFast, SMALL_EXTENT, true)?;
            add(Quality::VeryFast, SMALL_EXTENT, false)?;
        }
    }
    Ok(if is_compressed { hash.digest().max(1) } else { 0 })
}

/// Blocks of all kinds that encoders see: slopes in any direction, edges, noise.
fn picture([width, height]: [u32; 2], alpha: bool) -> Vec<[u8; 4]> {
    let mut random = Random::new(0x66_61_6e);
    let mut texels = vec![[0; 4]; (width * height) as usize];
    for block in 0..width * height / 16 {
        let [base, far]: [[i32; 4]; 2] =
            std::array::from_fn(|_| std::array::from_fn(|_| random.below(256) as i32));
        let [dx, dy, noise] = [5, 5, 40].map(|limit| random.below(limit) as i32);
        let has_edge = random.chance(0.25);
        for texel in 0..16 {
            let (x, y) = (texel % 4, texel / 4);
            // Integers only: the picture is the same on every processor.
            let along = match has_edge {
                true => 16 * i32::from(dx * x as i32 + dy * y as i32 > 12),
                false => (dx * x as i32 + dy * y as i32).min(16),
            };
            let place = (block / (width / 4) * 4 + y) * width + block % (width / 4) * 4 + x;
            texels[place as usize] = std::array::from_fn(|channel| {
                let smooth = base[channel] + (far[channel] - base[channel]) * along / 16;
                let value = smooth + random.below(noise as u64 + 1) as i32 - noise / 2;
                if channel == 3 && !alpha { 255 } else { value.clamp(0, 255) as u8 }
            });
        }
    }
    texels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fingerprints_repeat_and_depend_on_the_formats() {
        let print = |formats: &[TexelFormat]| encoder_fingerprint(formats).unwrap();
        assert_eq!(print(&[TexelFormat::Rgba8, TexelFormat::Rgba32F]), 0);
        let bc1 = print(&[TexelFormat::Bc1]);
        assert_eq!(bc1, print(&[TexelFormat::Rgba8, TexelFormat::Bc1]));
        assert_ne!(bc1, print(&[TexelFormat::Bc1, TexelFormat::Bc5]));
    }

    #[test]
    fn the_picture_has_many_kinds_of_blocks() {
        let texels = picture(SMALL_EXTENT, true);
        let mean =
            texels.iter().flatten().map(|value| u64::from(*value)).sum::<u64>() / (4 * texels.len() as u64);
        assert!((100..156).contains(&mean), "{mean}");
        assert!(picture(SMALL_EXTENT, false).iter().all(|texel| texel[3] == 255));
        let rows = |y: u32| &texels[(y * SMALL_EXTENT[0]) as usize..][..4];
        assert_ne!(rows(0), rows(4));
    }
}
