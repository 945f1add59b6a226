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
pub(crate) fn is_block_extent(extent: [u32; 2]) -> bool {
    extent.iter().all(|&n| n > 0 && n.is_multiple_of(4))
}

/// Encodes one page. `extent`: columns and rows, multiples of 4 (up to [`PAGE`](crate::PAGE) where the result is to be
/// stored). R formats take red, RG formats red and green, [`TexelFormat::Bc1`] alpha below 128/255 as "transparent".
/// An opaque [`TexelFormat::Bc7`] page may decode to an alpha of 254/255. Thread-safe, deterministic on a given kind of processor; a page's bytes depend on its texels only.
///
/// # Errors
/// The extent is not one of whole 4x4 blocks, or the number of texels does not match it.
pub fn encode(
    format: TexelFormat,
    quality: Quality,
    extent: [u32; 2],
    texels: TexelSlice<'_>,
) -> Result<Vec<u8>> {
    let mut pages = encode_many(format, quality, &[(extent, texels)])?;
    Ok(pages.swap_remove(0))
}

/// Encodes several pages of one format: the same bytes as [`encode`] gives one by one, faster where pages are small.
///
/// # Errors
/// As [`encode`].
pub fn encode_many(
    format: TexelFormat,
    quality: Quality,
    pages: &[([u32; 2], TexelSlice<'_>)],
) -> Result<Vec<Vec<u8>>> {
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

fn check(extent: [u32; 2], texels: TexelSlice<'_>) -> Result<()> {
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

#[cfg(test)]
mod tests {
    use crate::decode;

    use super::*;

    /// A smooth picture with some structure.
    fn picture([width, height]: [u32; 2], alpha: bool) -> Vec<[f32; 4]> {
        (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as f32, (i / width) as f32);
                let wave = |kx: f32, ky: f32, phase: f32| 0.5 + 0.4 * (kx * x + ky * y + phase).sin();
                let a = if alpha { wave(0.1, 0.07, 2.0) } else { 1.0 };
                [wave(0.11, 0.05, 0.0), wave(0.03, 0.13, 1.0), wave(0.07, -0.09, 2.0), a]
            })
            .collect()
    }

    fn rms(a: &[[f32; 4]], b: &[[f32; 4]], channels: usize) -> f32 {
        let sum: f32 = a.iter().zip(b).flat_map(|(a, b)| (0..channels).map(|k| (a[k] - b[k]).powi(2))).sum();
        (sum / (a.len() * channels) as f32).sqrt()
    }

    #[test]
    fn every_format_comes_back_within_its_precision() {
        for (format, bound) in [
            (TexelFormat::Bc1, 0.025),
            (TexelFormat::Bc4, 0.015),
            (TexelFormat::Bc5, 0.015),
            (TexelFormat::Bc7, 0.02),
            (TexelFormat::R8, 0.002),
            (TexelFormat::Rg8, 0.002),
            (TexelFormat::Rgba8, 0.002),
            (TexelFormat::Rgba32F, 0.0),
        ] {
            for extent in [[4, 4], [8, 4], [4, 12], [20, 36], [256, 64]] {
                let texels = picture(extent, format == TexelFormat::Bc7);
                let bytes = encode(format, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap();
                assert_eq!(bytes.len(), format.bytes(extent));
                let back = decode(format, extent, &bytes).unwrap();
                let error = rms(&texels, &back, format.channel_count());
                assert!(error <= bound, "{format:?} {extent:?}: {error}");
                let missing = [0.0, 0.0, 0.0, 1.0];
                assert_eq!(back[0][format.channel_count()..], missing[format.channel_count()..]);
            }
        }
    }

    #[test]
    fn pages_encode_alike_alone_and_together() {
        let extents = [[4, 4], [16, 8], [12, 20], [64, 64], [8, 8]];
        let pictures: Vec<_> = extents.iter().enumerate().map(|(i, &e)| picture(e, i % 2 == 1)).collect();
        let pages: Vec<_> =
            extents.iter().zip(&pictures).map(|(&e, p)| (e, TexelSlice::F32(p.as_slice()))).collect();
        for format in TexelFormat::ALL {
            let together = encode_many(format, Quality::UltraFast, &pages).unwrap();
            for (&(extent, texels), bytes) in pages.iter().zip(&together) {
                assert_eq!(*bytes, encode(format, Quality::UltraFast, extent, texels).unwrap(), "{format:?}");
            }
        }
    }

    #[test]
    fn opaque_pages_stay_opaque() {
        let extent = [32, 32];
        let texels = picture(extent, false);
        for format in [TexelFormat::Bc1, TexelFormat::Bc7] {
            for quality in [Quality::UltraFast, Quality::VeryFast, Quality::Fast, Quality::Basic] {
                let bytes = encode(format, quality, extent, TexelSlice::F32(&texels)).unwrap();
                let back = decode(format, extent, &bytes).unwrap();
                let least = back.iter().map(|t| t[3]).fold(1.0, f32::min);
                // BC7's mode 6 shares the lowest bit of alpha with the colours.
                let bound = if format == TexelFormat::Bc7 { 254.0 / 255.0 } else { 1.0 };
                assert!(least >= bound, "{format:?} {quality:?}: {least}");
            }
        }
    }

    #[test]
    fn bc1_keeps_cut_outs() {
        let extent = [16, 16];
        let mut texels = picture(extent, false);
        for (i, texel) in texels.iter_mut().enumerate() {
            texel[3] = if i % 5 < 2 { 0.0 } else { 1.0 };
        }
        let bytes = encode(TexelFormat::Bc1, Quality::UltraFast, extent, TexelSlice::F32(&texels)).unwrap();
        let back = decode(TexelFormat::Bc1, extent, &bytes).unwrap();
        for (a, b) in texels.iter().zip(&back) {
            assert_eq!(a[3], b[3]);
            assert!(a[3] == 0.0 || (0..3).all(|k| (a[k] - b[k]).abs() < 0.12), "{a:?} {b:?}");
        }
    }

    /// The exact palette of one BC1 block, rounded to the nearest step, for all pairs of 5-bit and 6-bit end points.
    #[test]
    fn bc1_rounds_to_the_nearest_step() {
        let nearest =
            |numerator: u32, denominator: u32| (2 * 255 * numerator + denominator) / (2 * denominator);
        for a in 0..64u16 {
            for b in 0..64u16 {
                let end = |g: u16| ((g >> 1) << 11) | (g << 5) | (g >> 1);
                let (c0, c1) = (end(a), end(b));
                let mut block = [0u8; 8];
                block[..2].copy_from_slice(&c0.to_le_bytes());
                block[2..4].copy_from_slice(&c1.to_le_bytes());
                block[4] = 0b11_10_01_00;
                let back = decode(TexelFormat::Bc1, [4, 4], &block).unwrap();
                let step = |i: usize, k: usize| (back[i][k] * 255.0).round() as u32;
                let (g0, g1, r0, r1) = (u32::from(a), u32::from(b), u32::from(a >> 1), u32::from(b >> 1));
                if c0 > c1 {
                    assert_eq!(step(2, 1), nearest(2 * g0 + g1, 3 * 63));
                    assert_eq!(step(3, 0), nearest(r0 + 2 * r1, 3 * 31));
                } else {
                    assert_eq!(step(2, 1), nearest(g0 + g1, 2 * 63));
                    assert_eq!(back[3], [0.0; 4]);
                }
                assert_eq!(step(0, 1), nearest(g0, 63));
                assert_eq!(step(1, 2), nearest(r1, 31));
            }
        }
    }

    #[test]
    fn bc4_values_are_exact_ratios() {
        // Indices 0..8, then zeros.
        let indices = [0b1000_1000, 0b1100_0110, 0b1111_1010, 0, 0, 0];
        let block = |e0, e1| [vec![e0, e1], indices.to_vec()].concat();
        let values = |e0, e1| -> Vec<f32> {
            decode(TexelFormat::Bc4, [4, 4], &block(e0, e1)).unwrap()[..8].iter().map(|t| t[0]).collect()
        };
        let wide = values(210, 0);
        for (value, sevenths) in wide.iter().zip([7, 0, 6, 5, 4, 3, 2, 1]) {
            assert!((value - 210.0 / 255.0 * sevenths as f32 / 7.0).abs() < 1e-7);
        }
        let narrow = values(0, 200);
        for (value, expected) in narrow.iter().zip([0.0, 200.0, 40.0, 80.0, 120.0, 160.0, 0.0, 255.0]) {
            assert!((value - expected / 255.0).abs() < 1e-7);
        }
    }

    #[test]
    fn reserved_bc7_blocks_are_transparent_black() {
        let block: Vec<u8> = (0..16).map(|i| if i == 0 { 0 } else { 0xa5 }).collect();
        assert_eq!(decode(TexelFormat::Bc7, [4, 4], &block).unwrap(), vec![[0.0; 4]; 16]);
    }

    #[test]
    fn wrong_sizes_are_errors() {
        let texels = vec![[0u8; 4]; 16];
        let slice = TexelSlice::U8(&texels);
        assert!(encode(TexelFormat::Bc7, Quality::UltraFast, [4, 8], slice).is_err());
        assert!(encode(TexelFormat::Bc7, Quality::UltraFast, [2, 8], slice).is_err());
        assert!(encode(TexelFormat::R8, Quality::UltraFast, [0, 4], slice).is_err());
        assert!(decode(TexelFormat::Bc7, [4, 4], &[0; 15]).is_err());
        assert!(decode(TexelFormat::Bc7, [5, 4], &[0; 16]).is_err());
    }

    /// No bit pattern makes a decoder panic or leave 0..1.
    #[test]
    fn any_bits_decode() {
        let mut state = 1u64;
        for _ in 0..2000 {
            let block: Vec<u8> = (0..256)
                .map(|_| {
                    state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (state >> 56) as u8
                })
                .collect();
            for format in TexelFormat::ALL {
                let texels = decode(format, [4, 4], &block[..format.block_bytes()]).unwrap();
                assert!(texels.iter().flatten().all(|x| x.is_finite()));
            }
        }
    }
}
