//! Encoding.
//!
//! The block encoders work on several neighbouring blocks of a row at once (SIMD lanes), so small surfaces waste most of
//! their time. Pages are therefore laid out as a strip of 4 rows, one row of blocks after the other, several pages in a row:
//!
//! ```text
//!  8x8 page   strip, 16x4      a lane's result depends on its own block only, so a page's bytes
//!   A B        A B C D         do not depend on its neighbours in the strip
//!   C D
//! ```
//!
//! Measured with BC7 on one core: 4x4 pages one by one 3.5, together 37 million texels per second; from 16x16 on 45 either way.

use std::borrow::Cow;

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
    let pages: Vec<Page<'_>> = pages.iter().map(|&(extent, texels)| Page::new(extent, texels)).collect();
    // Opaque pages take another profile than those with alpha, hence another strip.
    let mut encoded = vec![Vec::new(); pages.len()];
    for alpha in [false, true] {
        let chosen: Vec<usize> = (0..pages.len()).filter(|&i| pages[i].has_alpha == alpha).collect();
        let rows: Vec<BlockRow<'_>> = chosen.iter().flat_map(|&i| pages[i].block_rows()).collect();
        let bytes = encode_rows(format, quality, alpha, &rows);
        let mut rest = bytes.as_slice();
        for i in chosen {
            let (page, after) = rest.split_at(format.bytes(pages[i].extent));
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

fn encode_uncompressed(format: TexelFormat, texels: &TexelSlice<'_>) -> Vec<u8> {
    match (format, texels) {
        (TexelFormat::Rgba32F, TexelSlice::F32(texels)) => {
            texels.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()
        }
        (TexelFormat::Rgba32F, TexelSlice::U8(texels)) => {
            texels.iter().flatten().flat_map(|&x| (f32::from(x) / 255.0).to_le_bytes()).collect()
        }
        _ if format.channel_count() == 4 => texels.unorm8().as_flattened().to_vec(),
        _ => texels.unorm8().iter().flat_map(|texel| &texel[..format.channel_count()]).copied().collect(),
    }
}

/// A page in 8 bits.
struct Page<'a> {
    extent: [u32; 2],
    texels: Cow<'a, [[u8; 4]]>,
    has_alpha: bool,
}

/// Four rows of texels of a page, one after the other.
type BlockRow<'a> = &'a [[u8; 4]];

impl<'a> Page<'a> {
    fn new(extent: [u32; 2], texels: TexelSlice<'a>) -> Self {
        let texels = texels.unorm8();
        let has_alpha = texels.iter().any(|texel| texel[3] < 255);
        Self { extent, texels, has_alpha }
    }

    fn block_rows(&self) -> impl Iterator<Item = BlockRow<'_>> {
        self.texels.chunks_exact(4 * self.extent[0] as usize)
    }
}

/// Texels of a strip: keeps the encoder's working set in the second-level cache.
const STRIP_TEXELS: usize = 1 << 14;

fn encode_rows(format: TexelFormat, quality: Quality, alpha: bool, rows: &[BlockRow<'_>]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = rows;
    while !rest.is_empty() {
        let mut texels = 0;
        let fitting = rest.iter().take_while(|row| {
            texels += row.len();
            texels <= STRIP_TEXELS
        });
        let (strip, after) = rest.split_at(fitting.count().max(1));
        bytes.extend(encode_strip(format, quality, alpha, strip));
        rest = after;
    }
    bytes
}

fn encode_strip(format: TexelFormat, quality: Quality, alpha: bool, rows: &[BlockRow<'_>]) -> Vec<u8> {
    let width = rows.iter().map(|row| row.len() as u32 / 4).sum();
    match format {
        TexelFormat::Bc7 => {
            let data = strip_of::<4>(rows);
            let surface = RgbaSurface { data: &data, width, height: 4, stride: 4 * width };
            bc7::compress_blocks(&bc7_settings(quality, alpha), &surface)
        }
        TexelFormat::Bc1 => {
            let data = strip_of::<4>(rows);
            let surface = RgbaSurface { data: &data, width, height: 4, stride: 4 * width };
            let mut encoded = bc1::compress_blocks(&surface);
            if alpha {
                punch_through::replace_transparent(&data, &mut encoded);
            }
            encoded
        }
        TexelFormat::Bc5 => {
            let data = strip_of::<2>(rows);
            bc5::compress_blocks(&RgSurface { data: &data, width, height: 4, stride: 2 * width })
        }
        _ => {
            let data = strip_of::<1>(rows);
            bc4::compress_blocks(&RSurface { data: &data, width, height: 4, stride: width })
        }
    }
}

/// The rows of blocks side by side as 4 rows of texels with the first `CHANNELS` channels.
fn strip_of<const CHANNELS: usize>(rows: &[BlockRow<'_>]) -> Vec<u8> {
    let texels = rows.iter().map(|row| row.len()).sum::<usize>();
    let mut data = Vec::with_capacity(texels * CHANNELS);
    for k in 0..4 {
        for row in rows {
            let width = row.len() / 4;
            let row = &row[k * width..(k + 1) * width];
            if CHANNELS == 4 {
                data.extend_from_slice(row.as_flattened());
            } else {
                data.extend(row.iter().flat_map(|texel| &texel[..CHANNELS]));
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
