//! Encoding texels: from *stored encoding* (what the bytes mean before sRGB decoding, 0..1) to bytes.
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

use fantex_base::{Error, Result};
use intel_tex_2::{RSurface, RgSurface, RgbaSurface, bc1, bc4, bc5, bc7};

use crate::TexelFormat;
use crate::layout::is_block_extent;

mod constant;
mod opaque;
mod selectors;

/// How much time the BC7 encoder takes. The other formats have one setting.
///
/// Measured on one core, million texels per second and dB for photographs of rock and of the Earth and for a normal map:
/// `UltraFast` 23 (45.8, 44.9, 31.3), `VeryFast` 5 (46.1, 47.4, 35.6), `Fast` 3 (46.2, 47.6, 35.6). So the default is right
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

/// A page to encode.
#[derive(Clone, Copy, Debug)]
pub struct PageTexels<'a> {
    /// Columns and rows, multiples of 4.
    pub extent: [u32; 2],
    /// All texels.
    pub texels: TexelSlice<'a>,
    /// Per block of 4x4, row by row, whether anything reads it; `None` where all are read. Block-compressed formats store others as
    /// zero bytes.
    pub read: Option<&'a [bool]>,
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

/// Encodes one page. `extent`: columns and rows, multiples of 4 (up to [`PAGE`](crate::PAGE) where the result is to be
/// stored). R formats take red, RG formats red and green, [`TexelFormat::Bc1`] alpha below 128/255 as "transparent".
/// An opaque [`TexelFormat::Bc7`] page may decode to an alpha of 254/255; blocks of one colour are exact. Thread-safe, deterministic on
/// a given kind of processor; a page's bytes depend on its texels only.
///
/// # Errors
/// The extent is not one of whole 4x4 blocks, or the number of texels does not match it.
pub fn encode(
    format: TexelFormat,
    quality: Quality,
    extent: [u32; 2],
    texels: TexelSlice<'_>,
) -> Result<Vec<u8>> {
    let mut pages = encode_many(format, quality, &[PageTexels { extent, texels, read: None }])?;
    Ok(pages.swap_remove(0))
}

/// Encodes several pages of one format: the same bytes as [`encode`] gives one by one, faster where pages are small.
///
/// # Errors
/// As [`encode`].
pub fn encode_many(format: TexelFormat, quality: Quality, pages: &[PageTexels<'_>]) -> Result<Vec<Vec<u8>>> {
    pages.iter().try_for_each(check)?;
    if !matches!(format, TexelFormat::Bc1 | TexelFormat::Bc4 | TexelFormat::Bc5 | TexelFormat::Bc7) {
        return Ok(pages.iter().map(|page| encode_uncompressed(format, &page.texels)).collect());
    }
    let pages: Vec<Page<'_>> = pages.iter().map(Page::new).collect();
    // Opaque pages take another profile than those with alpha, hence another strip.
    let mut encoded = vec![Vec::new(); pages.len()];
    for alpha in [false, true] {
        let chosen: Vec<usize> = (0..pages.len()).filter(|&i| pages[i].has_alpha == alpha).collect();
        let rows: Vec<BlockRow<'_>> = chosen.iter().flat_map(|&i| pages[i].block_rows()).collect();
        let bytes = encode_rows(format, quality, alpha, &rows);
        let mut rest = bytes.as_slice();
        for i in chosen {
            let (page, after) = rest.split_at(pages[i].texels.len() / 16 * format.block_bytes());
            encoded[i] = pages[i].spread(page, format.block_bytes());
            rest = after;
        }
    }
    Ok(encoded)
}

fn check(&PageTexels { extent, texels, read }: &PageTexels<'_>) -> Result<()> {
    let [width, height] = extent;
    if !is_block_extent(extent) {
        return Err(Error::invalid(format!(
            "cannot encode {width}x{height} texels: both sides must be positive multiples of 4"
        )));
    }
    if texels.len() as u64 != u64::from(width) * u64::from(height) {
        return Err(Error::invalid(format!(
            "cannot encode {width}x{height} texels: {} were given",
            texels.len()
        )));
    }
    if let Some(read) = read
        && 16 * read.len() != texels.len()
    {
        return Err(Error::invalid(format!(
            "cannot encode {width}x{height} texels: {} blocks are said to be read or not",
            read.len()
        )));
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

/// The blocks of a page that are read, in 8 bits.
struct Page<'a> {
    extent: [u32; 2],
    /// All, or block rows of up to [`BLOCKS_PER_ROW`] of the blocks that are read.
    texels: Cow<'a, [[u8; 4]]>,
    has_alpha: bool,
    /// Which blocks these are, if not all.
    read: Option<Vec<u32>>,
}

const BLOCKS_PER_ROW: usize = 64;

/// Four rows of texels of a page, one after the other.
type BlockRow<'a> = &'a [[u8; 4]];

impl<'a> Page<'a> {
    fn new(&PageTexels { extent, texels, read }: &PageTexels<'a>) -> Self {
        let mut texels = texels.unorm8();
        let read: Option<Vec<u32>> = read
            .filter(|read| read.contains(&false))
            .map(|read| (0..).zip(read).filter(|(_, is_read)| **is_read).map(|(block, _)| block).collect());
        if let Some(read) = &read {
            let (stride, columns) = (extent[0] as usize, extent[0] / 4);
            let mut gathered = Vec::with_capacity(16 * read.len());
            for blocks in read.chunks(BLOCKS_PER_ROW) {
                for k in 0..4 {
                    for block in blocks {
                        let [x, y] = [block % columns, block / columns].map(|n| 4 * n as usize);
                        let start = (y + k) * stride + x;
                        gathered.extend_from_slice(&texels[start..start + 4]);
                    }
                }
            }
            texels = Cow::Owned(gathered);
        }
        let has_alpha = texels.iter().any(|texel| texel[3] < 255);
        Self { extent, texels, has_alpha, read }
    }

    fn block_rows(&self) -> impl Iterator<Item = BlockRow<'_>> {
        let columns = if self.read.is_some() { BLOCKS_PER_ROW } else { self.extent[0] as usize / 4 };
        self.texels.chunks(16 * columns)
    }

    /// The bytes of the whole page from those of the blocks that are read.
    fn spread(&self, bytes: &[u8], block_bytes: usize) -> Vec<u8> {
        let Some(read) = &self.read else { return bytes.to_vec() };
        let mut page = vec![0; (self.extent[0] * self.extent[1] / 16) as usize * block_bytes];
        for (&block, bytes) in read.iter().zip(bytes.chunks_exact(block_bytes)) {
            page[block as usize * block_bytes..][..block_bytes].copy_from_slice(bytes);
        }
        page
    }
}

fn blocks_of_row(row: BlockRow<'_>) -> impl Iterator<Item = Block> {
    let width = row.len() / 4;
    (0..width / 4).map(move |x| {
        let mut block = [[0; 4]; 16];
        for (k, texels) in block.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            texels.copy_from_slice(&row[k * width + 4 * x..][..4]);
        }
        block
    })
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
        let mut encoded = encode_strip(format, quality, alpha, strip);
        let blocks = || strip.iter().flat_map(|row| blocks_of_row(row));
        constant::replace(format, &mut encoded, blocks());
        if format == TexelFormat::Bc7 {
            selectors::prefer_cheap(alpha, &mut encoded, blocks());
        }
        bytes.extend(encoded);
        rest = after;
    }
    bytes
}

fn encode_strip(format: TexelFormat, quality: Quality, alpha: bool, rows: &[BlockRow<'_>]) -> Vec<u8> {
    let width = rows.iter().map(|row| row.len() as u32 / 4).sum();
    match format {
        TexelFormat::Bc7 if quality == Quality::UltraFast && !alpha => opaque::encode(rows),
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
                replace_transparent(&data, &mut encoded);
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

/// Texels of one 4x4 block, row-major.
type Block = [[u8; 4]; 16];

/// Alpha below this is transparent.
const OPAQUE_FROM: u8 = 128;

/// Re-encodes the blocks of a strip that have transparent texels. `strip`: 4 rows of RGBA texels; `encoded`: 8 bytes per
/// block.
fn replace_transparent(strip: &[u8], encoded: &mut [u8]) {
    let (texels, _) = strip.as_chunks::<4>();
    let width = texels.len() / 4;
    for (x, bytes) in encoded.chunks_exact_mut(8).enumerate() {
        let block: Block = std::array::from_fn(|i| texels[i / 4 * width + 4 * x + i % 4]);
        if block.iter().any(|texel| texel[3] < OPAQUE_FROM) {
            bytes.copy_from_slice(&encode_punch_through(&block));
        }
    }
}

/// Three-colour mode: end points are the corners of the opaque texels' bounding box, on the diagonal along which they
/// spread, ordered so that the first is not the greater one.
fn encode_punch_through(block: &Block) -> [u8; 8] {
    let opaque = || block.iter().filter(|texel| texel[3] >= OPAQUE_FROM);
    let mut ends = diagonal(opaque()).map(rgb565);
    ends.sort_unstable();
    let [a, b] = ends.map(rgb_from_565);
    let middle = [0, 1, 2].map(|k| (a[k] + b[k]) / 2);
    let mut indices = 0u32;
    for (i, texel) in block.iter().enumerate() {
        let index = if texel[3] < OPAQUE_FROM {
            3
        } else {
            let distances = [a, b, middle].map(|c| squared_distance(texel, c));
            (0..3).min_by_key(|&k| distances[k]).unwrap_or(0) as u32
        };
        indices |= index << (2 * i);
    }
    let mut bytes = [0; 8];
    bytes[..2].copy_from_slice(&ends[0].to_le_bytes());
    bytes[2..4].copy_from_slice(&ends[1].to_le_bytes());
    bytes[4..].copy_from_slice(&indices.to_le_bytes());
    bytes
}

/// The two ends of the texels' spread: green rises from the first to the second, red and blue as they go with green.
fn diagonal<'a>(texels: impl Iterator<Item = &'a [u8; 4]> + Clone) -> [[i32; 3]; 2] {
    let count = texels.clone().count().max(1) as i32;
    let rgb = |texel: &[u8; 4]| [0, 1, 2].map(|k| i32::from(texel[k]));
    let (mut low, mut high, mut sum) = ([255; 3], [0; 3], [0; 3]);
    for texel in texels.clone().map(rgb) {
        for k in 0..3 {
            low[k] = low[k].min(texel[k]);
            high[k] = high[k].max(texel[k]);
            sum[k] += texel[k];
        }
    }
    if low[0] > high[0] {
        return [[0; 3]; 2];
    }
    for k in [0, 2] {
        let covariance: i32 = texels
            .clone()
            .map(rgb)
            .map(|c| (count * c[k] - sum[k]) / count * (count * c[1] - sum[1]) / count)
            .sum();
        if covariance < 0 {
            std::mem::swap(&mut low[k], &mut high[k]);
        }
    }
    [low, high]
}

fn rgb565(rgb: [i32; 3]) -> u16 {
    let round = |x: i32, steps: i32| ((x * steps + 127) / 255) as u16;
    (round(rgb[0], 31) << 11) | (round(rgb[1], 63) << 5) | round(rgb[2], 31)
}

fn rgb_from_565(packed: u16) -> [i32; 3] {
    let packed = i32::from(packed);
    [(packed >> 11) * 255 / 31, ((packed >> 5) & 63) * 255 / 63, (packed & 31) * 255 / 31]
}

fn squared_distance(texel: &[u8; 4], color: [i32; 3]) -> i32 {
    (0..3).map(|k| (i32::from(texel[k]) - color[k]).pow(2)).sum()
}
