//! Encoding.
//!
//! The block encoders work on several neighbouring blocks of a row at once (SIMD lanes), so small surfaces waste most of
//! their time. Pages are therefore laid out as a strip of 4 rows, block after block, several pages in a row:
//!
//! ```text
//!  8x8 page   strip, 16x4      a lane's result depends on its own block only, so a page's bytes
//!   A B        A B C D         do not depend on its neighbours in the strip
//!   C D
//! ```

use intel_tex_2::{RSurface, RgSurface, RgbaSurface, bc1, bc4, bc5, bc7};

use super::{Quality, TexelSlice, is_block_extent, punch_through};
use crate::{EncodeError, TexelFormat};

/// Encodes one page. `extent`: columns and rows, multiples of 4 (up to [`PAGE`](crate::PAGE) where the result is to be
/// stored). R formats take red, RG formats red and green, [`TexelFormat::Bc1`] alpha below 128/255 as "transparent".
/// An opaque [`TexelFormat::Bc7`] page may decode to an alpha of 254/255. Thread-safe, deterministic on a given kind of processor; a page's bytes depend on its texels only.
pub fn encode(
    format: TexelFormat,
    quality: Quality,
    extent: [u32; 2],
    texels: TexelSlice<'_>,
) -> Result<Vec<u8>, EncodeError> {
    let mut pages = encode_many(format, quality, &[(extent, texels)])?;
    Ok(pages.swap_remove(0))
}

/// Encodes several pages of one format: the same bytes as [`encode`] gives one by one, faster where pages are small.
pub fn encode_many(
    format: TexelFormat,
    quality: Quality,
    pages: &[([u32; 2], TexelSlice<'_>)],
) -> Result<Vec<Vec<u8>>, EncodeError> {
    for &(extent, texels) in pages {
        check(extent, texels)?;
    }
    if !matches!(format, TexelFormat::Bc1 | TexelFormat::Bc4 | TexelFormat::Bc5 | TexelFormat::Bc7) {
        return Ok(pages.iter().map(|(_, texels)| encode_uncompressed(format, texels)).collect());
    }
    // Opaque pages take another profile than those with alpha, hence another strip.
    let has_alpha: Vec<bool> = pages.iter().map(|(_, texels)| uses_alpha(texels)).collect();
    let mut encoded = vec![Vec::new(); pages.len()];
    for alpha in [false, true] {
        let chosen: Vec<usize> = (0..pages.len()).filter(|&i| has_alpha[i] == alpha).collect();
        let blocks = blocks_of(chosen.iter().map(|&i| pages[i]));
        let bytes = encode_blocks(format, quality, alpha, &blocks);
        let mut rest = bytes.as_slice();
        for i in chosen {
            let (page, after) = rest.split_at(format.bytes(pages[i].0));
            encoded[i] = page.to_vec();
            rest = after;
        }
    }
    Ok(encoded)
}

fn check(extent: [u32; 2], texels: TexelSlice<'_>) -> Result<(), EncodeError> {
    let [width, height] = extent;
    if !is_block_extent(extent) {
        return Err(EncodeError::Extent(width, height));
    }
    if texels.len() as u64 != u64::from(width) * u64::from(height) {
        return Err(EncodeError::TexelCount { width, height, given: texels.len() });
    }
    Ok(())
}

fn uses_alpha(texels: &TexelSlice<'_>) -> bool {
    (0..texels.len()).any(|i| texels.unorm8(i)[3] < 255)
}

fn encode_uncompressed(format: TexelFormat, texels: &TexelSlice<'_>) -> Vec<u8> {
    let indices = 0..texels.len();
    match format {
        TexelFormat::Rgba32F => indices.flat_map(|i| texels.float(i)).flat_map(f32::to_le_bytes).collect(),
        _ => indices.flat_map(|i| texels.unorm8(i).into_iter().take(format.channel_count())).collect(),
    }
}

/// Texels of one 4x4 block, row-major.
pub(super) type Block = [[u8; 4]; 16];

/// All blocks of the pages, page by page, row by row.
fn blocks_of<'a>(pages: impl Iterator<Item = ([u32; 2], TexelSlice<'a>)>) -> Vec<Block> {
    let mut blocks = Vec::new();
    for (extent, texels) in pages {
        let [width, height] = extent.map(|n| n as usize);
        for y in (0..height).step_by(4) {
            for x in (0..width).step_by(4) {
                blocks.push(std::array::from_fn(|k| texels.unorm8((y + k / 4) * width + x + k % 4)));
            }
        }
    }
    blocks
}

/// Longest strip in blocks: keeps the encoder's working set in the second-level cache.
const STRIP_BLOCKS: usize = 1024;

fn encode_blocks(format: TexelFormat, quality: Quality, alpha: bool, blocks: &[Block]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(blocks.len() * format.block_bytes());
    for strip in blocks.chunks(STRIP_BLOCKS) {
        let width = 4 * strip.len() as u32;
        match format {
            TexelFormat::Bc7 => {
                let data = strip_rows::<4>(strip);
                let surface = RgbaSurface { data: &data, width, height: 4, stride: 4 * width };
                bytes.extend(bc7::compress_blocks(&bc7_settings(quality, alpha), &surface));
            }
            TexelFormat::Bc1 => {
                let data = strip_rows::<4>(strip);
                let surface = RgbaSurface { data: &data, width, height: 4, stride: 4 * width };
                let mut encoded = bc1::compress_blocks(&surface);
                if alpha {
                    punch_through::replace_transparent(strip, &mut encoded);
                }
                bytes.extend(encoded);
            }
            TexelFormat::Bc5 => {
                let data = strip_rows::<2>(strip);
                let surface = RgSurface { data: &data, width, height: 4, stride: 2 * width };
                bytes.extend(bc5::compress_blocks(&surface));
            }
            _ => {
                let data = strip_rows::<1>(strip);
                let surface = RSurface { data: &data, width, height: 4, stride: width };
                bytes.extend(bc4::compress_blocks(&surface));
            }
        }
    }
    bytes
}

/// The blocks side by side as 4 rows of texels with the first `CHANNELS` channels.
fn strip_rows<const CHANNELS: usize>(blocks: &[Block]) -> Vec<u8> {
    let mut data = Vec::with_capacity(blocks.len() * 16 * CHANNELS);
    for row in 0..4 {
        for block in blocks {
            for texel in &block[4 * row..4 * row + 4] {
                data.extend_from_slice(&texel[..CHANNELS]);
            }
        }
    }
    data
}

fn bc7_settings(quality: Quality, alpha: bool) -> bc7::EncodeSettings {
    match (quality, alpha) {
        (Quality::UltraFast, false) => bc7::opaque_ultra_fast_settings(),
        (Quality::VeryFast, false) => bc7::opaque_very_fast_settings(),
        (Quality::Fast, false) => bc7::opaque_fast_settings(),
        (Quality::Basic, false) => bc7::opaque_basic_settings(),
        (Quality::UltraFast, true) => bc7::alpha_ultra_fast_settings(),
        (Quality::VeryFast, true) => bc7::alpha_very_fast_settings(),
        (Quality::Fast, true) => bc7::alpha_fast_settings(),
        (Quality::Basic, true) => bc7::alpha_basic_settings(),
    }
}
