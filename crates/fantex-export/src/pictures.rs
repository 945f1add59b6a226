//! Pictures of floats, which are kept whole until they are written.

use std::fs::File;
use std::io;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use exr::image::write::WritableImage as _;
use exr::image::write::channels::WritableChannels;
use exr::image::{Encoding, Layer, SpecificChannels};
use exr::math::Vec2;
use exr::meta::header::LayerAttributes;
use fantex_base::files::folder_of;
use fantex_base::{Error, Result};
use fantex_store::{Quality, TexelFormat, TexelSlice, encode};
use fantex_texture::Image;
use fantex_texture::color::{srgb_from_linear, srgb8_from_linear, srgb16_from_linear, unorm8, unorm16};
use fantex_texture::filter::halved_row;
use half::f16;
use png::{BitDepth, ColorType, DeflateCompression, Encoder, SrgbRenderingIntent, StreamWriter};
use rayon::prelude::*;

use crate::export::{ChannelMap, Components, Map};
use crate::texels::RowSink;

pub(crate) struct FloatSink {
    file: File,
    /// What errors name.
    path: PathBuf,
    side: u32,
    components: Components,
    samples: Vec<f32>,
}

impl FloatSink {
    pub(crate) fn memory_bytes(side: u32, map: &Map) -> u64 {
        // The samples, their copy on the way, and the encoded file.
        3 * 4 * u64::from(side) * u64::from(side) * map.components.count() as u64
    }

    /// Begins a square picture in `file`; the extension of `path`, which errors name, is its format.
    pub(crate) fn new(file: File, path: PathBuf, side: u32, map: &Map) -> Self {
        Self { file, path, side, components: map.components, samples: Vec::new() }
    }
}

impl RowSink for FloatSink {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<()> {
        match self.components {
            Components::One(k) => self.samples.extend(values.iter().map(|v| v[k])),
            Components::Rgb => self.samples.extend(values.iter().flat_map(|v| [v[0], v[1], v[2]])),
            Components::Rgba => self.samples.extend_from_slice(values.as_flattened()),
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        let samples = std::mem::take(&mut self.samples);
        let channels = self.components.count() as u8;
        let bytes = Image::from_linear(self.side, self.side, channels, samples).encoded(&self.path)?;
        self.file.write_all(&bytes).map_err(|source| Error::writing(&self.path, source))
    }
}

// ---- Detail levels, row by row.

/// Halves rows of values on and on: level `l + 1` is the mean of 2 x 2 texels of level `l`, in linear light. Rows of all
/// levels come out as soon as they are known; one row per level is kept. Where a length is odd, its last texel is left out.
#[derive(Clone, Debug)]
struct Pyramid {
    size: [u32; 2],
    /// The upper row of a pair, per level.
    waiting: Vec<Option<Vec<[f32; 4]>>>,
}

impl Pyramid {
    fn new(size: [u32; 2]) -> Self {
        Self { size, waiting: vec![None; level_count(size) as usize] }
    }

    /// Takes whole rows of level 0 and visits every row of every level that is complete, with its level.
    fn push(&mut self, rows: &[[f32; 4]], mut visit: impl FnMut(usize, &[[f32; 4]])) {
        for row in rows.chunks_exact(self.size[0] as usize) {
            let mut row = row.to_vec();
            for level in 0..self.waiting.len() {
                visit(level, &row);
                let height = level_size(self.size, level as u32)[1];
                let width = level_size(self.size, level as u32 + 1)[0] as usize;
                let upper = match self.waiting[level].take() {
                    Some(upper) => upper,
                    None if height == 1 => row.clone(),
                    None => {
                        self.waiting[level] = Some(row);
                        break;
                    }
                };
                row = match row.len() {
                    1 => vec![mean([upper[0], upper[0], row[0], row[0]])],
                    _ => halved_row(&upper, &row, [0.0; 4], mean).take(width).collect(),
                };
            }
        }
    }
}

fn mean([a, b, c, d]: [[f32; 4]; 4]) -> [f32; 4] {
    std::array::from_fn(|k| 0.25 * (a[k] + b[k] + c[k] + d[k]))
}

/// Levels down to one texel.
fn level_count([width, height]: [u32; 2]) -> u32 {
    width.max(height).ilog2() + 1
}

/// Columns and rows of a level.
fn level_size(size: [u32; 2], level: u32) -> [u32; 2] {
    size.map(|length| length.checked_shr(level).unwrap_or(0).max(1))
}

// ---- PNG, row by row.

/// Bits per sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// Eight.
    #[default]
    Eight,
    /// Sixteen.
    Sixteen,
}

pub(crate) struct PngSink {
    path: PathBuf,
    file: CheckedFile,
    writer: Option<StreamWriter<'static, CheckedFile>>,
    map: Map,
    depth: Depth,
}

/// A tenth to a third less time for a whole export than level 6, the usual one, and files 1 to 6 % larger (`docs/benchmarks.md`).
const DEFLATE_LEVEL: u8 = 4;

impl PngSink {
    /// Begins a picture of `size` columns and rows in `file`; `path` is what errors name.
    pub(crate) fn new(file: File, path: PathBuf, size: [u32; 2], map: Map, depth: Depth) -> Result<Self> {
        let file = CheckedFile { file: Arc::new(file), failure: Arc::default() };
        let mut encoder = Encoder::new(file.clone(), size[0], size[1]);
        encoder.set_color(match map.components {
            Components::One(_) => ColorType::Grayscale,
            Components::Rgb => ColorType::Rgb,
            Components::Rgba => ColorType::Rgba,
        });
        encoder.set_depth(if depth == Depth::Eight { BitDepth::Eight } else { BitDepth::Sixteen });
        if map.is_srgb {
            encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
        }
        encoder.set_deflate_compression(DeflateCompression::Level(DEFLATE_LEVEL));
        // No buffer that would swallow an error when it is dropped.
        let writer = encoder.write_header().and_then(|writer| writer.into_stream_writer_with_size(1 << 20));
        match writer {
            Ok(writer) => Ok(Self { path, file, writer: Some(writer), map, depth }),
            Err(error) => Err(Error::writing(path, error.into())),
        }
    }

    /// Samples as [`samples`] makes them, in order.
    pub(crate) fn write_samples(&mut self, bytes: &[u8]) -> Result<()> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        writer.write_all(bytes).map_err(|source| Error::writing(&self.path, source))
    }
}

impl RowSink for PngSink {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<()> {
        let Self { map, depth, .. } = *self;
        let bytes: Vec<Vec<u8>> = values.par_chunks(1 << 14).map(|v| samples(v, &map, depth)).collect();
        bytes.iter().try_for_each(|bytes| self.write_samples(bytes))
    }

    fn finish(&mut self) -> Result<()> {
        let Some(writer) = self.writer.take() else { return Ok(()) };
        let finished = writer.finish().map_err(io::Error::from).and_then(|()| self.file.check());
        finished.map_err(|source| Error::writing(&self.path, source))
    }
}

/// A file that remembers a failure: the encoder writes its last bytes when it is dropped, where errors are lost.
#[derive(Clone)]
struct CheckedFile {
    file: Arc<File>,
    /// The system's number of the first error.
    failure: Arc<OnceLock<Option<i32>>>,
}

impl CheckedFile {
    fn check(&self) -> io::Result<()> {
        match self.failure.get() {
            None => Ok(()),
            Some(number) => Err(number
                .map_or_else(|| io::Error::other("an earlier write failed"), io::Error::from_raw_os_error)),
        }
    }
}

impl Write for CheckedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = (&*self.file).write(bytes);
        written.inspect_err(|error| {
            if error.kind() != io::ErrorKind::Interrupted {
                self.failure.get_or_init(|| error.raw_os_error());
            }
        })
    }

    fn flush(&mut self) -> io::Result<()> {
        self.check()
    }
}

pub(crate) fn samples(values: &[[f32; 4]], map: &Map, depth: Depth) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(values.len() * map.components.count() * 2);
    let mut put = |value: f32, is_color: bool| match (depth, is_color && map.is_srgb) {
        (Depth::Eight, true) => bytes.push(srgb8_from_linear(value)),
        (Depth::Eight, false) => bytes.push(unorm8(value)),
        (Depth::Sixteen, true) => bytes.extend(srgb16_from_linear(value).to_be_bytes()),
        (Depth::Sixteen, false) => bytes.extend(unorm16(value).to_be_bytes()),
    };
    for value in values {
        match map.components {
            Components::One(k) => put(value[k], true),
            Components::Rgb => value[..3].iter().for_each(|&v| put(v, true)),
            Components::Rgba => (0..4).for_each(|k| put(value[k], k < 3)),
        }
    }
    bytes
}

// ---- Half floats, and OpenEXR of them.

/// Values as half floats, little-endian.
pub(crate) fn halves(values: &[[f32; 4]], components: Components) -> Vec<u8> {
    let range = match components {
        Components::One(k) => k..k + 1,
        Components::Rgb => 0..3,
        Components::Rgba => 0..4,
    };
    values.iter().flat_map(|value| &value[range.clone()]).flat_map(|&x| half_of(x).to_le_bytes()).collect()
}

/// Values of which [`halves`] were made; what has no component is 0, and opaque.
pub(crate) fn values_of_halves(bytes: &[u8], components: Components) -> Vec<[f32; 4]> {
    let numbers = |texel: &[u8]| {
        let mut value = [0.0, 0.0, 0.0, 1.0];
        let first = if let Components::One(k) = components { k } else { 0 };
        for (number, bytes) in value[first..].iter_mut().zip(texel.chunks_exact(2)) {
            *number = f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
        }
        value
    };
    bytes.chunks_exact(2 * components.count()).map(numbers).collect()
}

/// The nearest half float that is finite.
fn half_of(x: f32) -> f16 {
    f16::from_f32(x.clamp(-65504.0, 65504.0))
}

/// Writes [`halves`] of a map with red, green and blue as OpenEXR, packed without loss. Numbers are linear, the map's scale undone, and
/// colours multiplied with alpha, as the format wants it.
pub(crate) fn write_exr(file: &File, path: &Path, size: [u32; 2], map: &Map, halves: &[u8]) -> Result<()> {
    let size = size.map(|length| length as usize);
    let count = map.components.count();
    let number = |x: usize, y: usize, k: usize| {
        let at = ((y * size[0] + x) * count + k) * 2;
        f16::from_le_bytes([halves[at], halves[at + 1]])
    };
    let light = |x: usize, y: usize, k: usize| match map.scale {
        1.0 => number(x, y, k),
        scale => half_of(number(x, y, k).to_f32() * scale),
    };
    let mut out = BufWriter::with_capacity(1 << 20, file);
    let written = if map.components == Components::Rgba {
        let rgba = |Vec2(x, y)| {
            let alpha = number(x, y, 3);
            let color = |k| half_of(light(x, y, k).to_f32() * alpha.to_f32());
            (color(0), color(1), color(2), alpha)
        };
        let image = exr_image(size, SpecificChannels::rgba(rgba));
        image.write().non_parallel().to_buffered(&mut out)
    } else {
        let rgb = |Vec2(x, y)| (light(x, y, 0), light(x, y, 1), light(x, y, 2));
        let image = exr_image(size, SpecificChannels::rgb(rgb));
        image.write().non_parallel().to_buffered(&mut out)
    };
    let written = written.map_err(|error| match error {
        exr::error::Error::Io(error) => error,
        error => io::Error::other(error.to_string()),
    });
    written.and_then(|()| out.flush()).map_err(|source| Error::writing(path, source))
}

fn exr_image<'a, C: WritableChannels<'a> + 'a>(size: [usize; 2], channels: C) -> exr::image::Image<Layer<C>> {
    let attributes = LayerAttributes::default();
    exr::image::Image::from_layer(Layer::new(
        (size[0], size[1]),
        attributes,
        Encoding::SMALL_LOSSLESS,
        channels,
    ))
}

// ---- KTX2 with block-compressed texels, all detail levels, packed with zstd (Khronos, "KTX File Format Specification",
// version 2.0, and "Khronos Data Format Specification", version 1.3).

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    /// RGBA in 16 bytes per 4 x 4 texels.
    Bc7 {
        /// Red, green and blue are sRGB-encoded.
        is_srgb: bool,
    },
    /// Red and green in 16 bytes per 4 x 4 texels.
    Bc5,
    /// Grey in 8 bytes per 4 x 4 texels.
    Bc4,
    /// Grey in 16 bits.
    R16,
    /// RGBA in half floats.
    Rgba16F,
}

impl Packing {
    /// What suits the map of a sheet of fans, whose normals are in object space, with all three coordinates, and have 16 bits in PNG.
    pub(crate) fn of_sheet(map: &Map) -> Self {
        if map.kind == ChannelMap::Normal { Self::Rgba16F } else { Self::of(map) }
    }

    /// What suits a map alone in a file, which has no factor that tells how bright light is, whose numbers are so large at most.
    pub(crate) fn of_single(map: &Map, largest: f32) -> Self {
        if largest > 1.0 { Self::Rgba16F } else { Self::of(map) }
    }

    /// What suits a map: two coordinates for normals, 16 bits where steps would show, floats where values exceed 1.
    pub(crate) fn of(map: &Map) -> Self {
        match (map.kind, map.components) {
            (ChannelMap::Normal, _) => Self::Bc5,
            (ChannelMap::Displacement, _) => Self::R16,
            (ChannelMap::Light, _) => Self::Rgba16F,
            (_, Components::One(_)) => Self::Bc4,
            _ => Self::Bc7 { is_srgb: map.is_srgb },
        }
    }

    /// Vulkan's number of the format, and bytes of a block, or of a texel where there are no blocks.
    fn numbers(self) -> (u32, u32) {
        match self {
            Self::Bc7 { is_srgb: false } => (145, 16),
            Self::Bc7 { is_srgb: true } => (146, 16),
            Self::Bc5 => (141, 16),
            Self::Bc4 => (139, 8),
            Self::R16 => (70, 2),
            Self::Rgba16F => (97, 8),
        }
    }

    fn block_format(self) -> Option<TexelFormat> {
        match self {
            Self::Bc7 { .. } => Some(TexelFormat::Bc7),
            Self::Bc5 => Some(TexelFormat::Bc5),
            Self::Bc4 => Some(TexelFormat::Bc4),
            Self::R16 | Self::Rgba16F => None,
        }
    }

    fn level_bytes(self, size: [u32; 2]) -> u64 {
        let is_block = self.block_format().is_some();
        let [columns, rows] =
            size.map(|length| u64::from(if is_block { length.div_ceil(4) } else { length }));
        columns * rows * u64::from(self.numbers().1)
    }

    /// The data format descriptor: a basic block, version 2.
    fn descriptor(self) -> Vec<u8> {
        // Models of the data format specification; channel numbers of each.
        let (model, samples): (u32, &[[u32; 2]]) = match self {
            Self::Bc7 { .. } => (134, &[[0, 128]]),
            Self::Bc5 => (132, &[[0, 64], [1, 64]]),
            Self::Bc4 => (131, &[[0, 64]]),
            Self::R16 => (1, &[[0, 16]]),
            Self::Rgba16F => (1, &[[0, 16], [1, 16], [2, 16], [15, 16]]),
        };
        let is_block = self.block_format().is_some();
        let transfer = if self == (Self::Bc7 { is_srgb: true }) { TRANSFER_SRGB } else { TRANSFER_LINEAR };
        let block_bytes = 24 + 16 * samples.len() as u32;
        let dimensions = if is_block { 3 | 3 << 8 } else { 0 };
        let mut words = vec![
            4 + block_bytes,
            0,
            2 | block_bytes << 16,
            model | PRIMARIES_BT709 << 8 | transfer << 16,
            dimensions,
            // Of what is packed, too: readers cannot tell a row's length otherwise. (Validators of Khronos' KTX-Software older than its pull
            // request 988 ask for 0.)
            self.numbers().1,
            0,
        ];
        let mut offset = 0;
        for &[channel, bits] in samples {
            let (qualifiers, low, high) = match self {
                // Float and signed; the range that is meant is -1..1.
                Self::Rgba16F => (0xc0, (-1f32).to_bits(), 1f32.to_bits()),
                Self::R16 => (0, 0, 0xffff),
                _ => (0, 0, u32::MAX),
            };
            words.extend([offset | (bits - 1) << 16 | (channel | qualifiers) << 24, 0, low, high]);
            offset += bits;
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }
}

const PRIMARIES_BT709: u32 = 1;
const TRANSFER_LINEAR: u32 = 1;
const TRANSFER_SRGB: u32 = 2;
const ZSTANDARD: u32 = 2;

/// zstd level: beyond it block-compressed texels gain little.
const ZSTD_LEVEL: i32 = 5;

pub(crate) struct Ktx2Sink {
    file: File,
    path: PathBuf,
    size: [u32; 2],
    packing: Packing,
    is_normal: bool,
    components: Components,
    pyramid: Pyramid,
    levels: Vec<Level>,
}

struct Level {
    size: [u32; 2],
    /// Rows that wait for others of their blocks.
    rows: Vec<[f32; 4]>,
    /// An unnamed file.
    packed: Option<zstd::Encoder<'static, BufWriter<File>>>,
}

impl Ktx2Sink {
    /// Begins a picture of `size` columns and rows in `file`; `path` is what errors name and beside which levels wait.
    pub(crate) fn new(file: File, path: &Path, size: [u32; 2], map: &Map, packing: Packing) -> Result<Self> {
        let failed = |source| Error::writing(path, source);
        let level = |l: u32| {
            let size = level_size(size, l);
            let file = tempfile::tempfile_in(folder_of(path))?;
            let mut packed = zstd::Encoder::new(BufWriter::with_capacity(1 << 16, file), ZSTD_LEVEL)?;
            packed.set_pledged_src_size(Some(packing.level_bytes(size)))?;
            Ok(Level { size, rows: Vec::new(), packed: Some(packed) })
        };
        Ok(Self {
            file,
            path: path.into(),
            size,
            packing,
            is_normal: map.kind == ChannelMap::Normal,
            components: map.components,
            pyramid: Pyramid::new(size),
            levels: (0..level_count(size)).map(level).collect::<io::Result<_>>().map_err(failed)?,
        })
    }

    /// Values as they are stored, before blocks.
    fn stored(&self, value: [f32; 4]) -> [f32; 4] {
        let [r, g, b, a] = value;
        if self.is_normal {
            // Means of unit vectors are shorter.
            let n = (glam::Vec3::new(r, g, b) * 2.0 - 1.0).normalize_or(glam::Vec3::Z) * 0.5 + 0.5;
            return [n.x, n.y, n.z, 1.0];
        }
        match self.components {
            Components::One(k) => [value[k], 0.0, 0.0, 1.0],
            _ => {
                let alpha = if self.components == Components::Rgba { a } else { 1.0 };
                let code = |x| {
                    if self.packing == (Packing::Bc7 { is_srgb: true }) { srgb_from_linear(x) } else { x }
                };
                [code(r.max(0.0)), code(g.max(0.0)), code(b.max(0.0)), alpha]
            }
        }
    }

    /// The bytes of up to four rows of a level.
    fn encoded(&self, width: u32, rows: &[[f32; 4]]) -> Result<Vec<u8>> {
        let stored: Vec<[f32; 4]> = rows.iter().map(|&v| self.stored(v)).collect();
        match self.packing.block_format() {
            Some(format) => {
                let strip = padded_strip(width, &stored);
                let width = width.next_multiple_of(4);
                encode(format, quality(self.packing), [width, 4], TexelSlice::F32(&strip))
                    .map_err(|error| Error::unsupported(error.to_string()))
            }
            None if self.packing == Packing::R16 => Ok(stored
                .iter()
                .flat_map(|v| ((v[0].clamp(0.0, 1.0) * 65535.0).round() as u16).to_le_bytes())
                .collect()),
            None => Ok(halves(&stored, Components::Rgba)),
        }
    }

    fn flush(&mut self, index: usize, is_last: bool) -> Result<()> {
        let level = &mut self.levels[index];
        let width = level.size[0];
        let strip = 4 * width as usize;
        let count = if is_last { level.rows.len() } else { level.rows.len() / strip * strip };
        if count == 0 {
            return Ok(());
        }
        let rest = level.rows.split_off(count);
        let rows = std::mem::replace(&mut level.rows, rest);
        let bytes: Vec<Vec<u8>> =
            rows.par_chunks(strip).map(|rows| self.encoded(width, rows)).collect::<Result<_, _>>()?;
        let Some(packed) = &mut self.levels[index].packed else { return Ok(()) };
        let written = bytes.iter().try_for_each(|b| packed.write_all(b));
        written.map_err(|source| Error::writing(&self.path, source))
    }

    fn assemble(&mut self) -> io::Result<()> {
        let mut packed = Vec::with_capacity(self.levels.len());
        for level in &mut self.levels {
            let Some(encoder) = level.packed.take() else { continue };
            let mut file = encoder.finish()?.into_inner().map_err(io::IntoInnerError::into_error)?;
            let bytes = file.stream_position()?;
            file.rewind()?;
            packed.push((file, bytes, self.packing.level_bytes(level.size)));
        }
        let descriptor = self.packing.descriptor();
        let pairs = key_values();
        let index_end = 80 + 24 * packed.len() as u64;
        let pairs_at = index_end + descriptor.len() as u64;
        let mut out = BufWriter::new(&self.file);
        out.write_all(b"\xabKTX 20\xbb\r\n\x1a\n")?;
        let [width, height] = self.size;
        // Bytes of the numbers that a reader of another byte order would have to swap.
        let type_size = if self.packing.block_format().is_some() { 1 } else { 2 };
        let header = [self.packing.numbers().0, type_size, width, height, 0, 0, 1];
        let index = [index_end as u32, descriptor.len() as u32, pairs_at as u32, pairs.len() as u32];
        for word in header.into_iter().chain([packed.len() as u32, ZSTANDARD]).chain(index) {
            out.write_all(&word.to_le_bytes())?;
        }
        out.write_all(&[0; 16])?;
        // The smallest level lies first, so that it is there first where a file comes slowly.
        let mut offset = pairs_at + pairs.len() as u64;
        let mut offsets = vec![0; packed.len()];
        for (level, (_, bytes, _)) in packed.iter().enumerate().rev() {
            offsets[level] = offset;
            offset += bytes;
        }
        for (offset, (_, bytes, unpacked)) in offsets.into_iter().zip(&packed) {
            for wide in [offset, *bytes, *unpacked] {
                out.write_all(&wide.to_le_bytes())?;
            }
        }
        out.write_all(&descriptor)?;
        out.write_all(&pairs)?;
        for (file, ..) in packed.iter_mut().rev() {
            io::copy(file, &mut out)?;
        }
        out.flush()
    }
}

impl RowSink for Ktx2Sink {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<()> {
        let levels = &mut self.levels;
        self.pyramid.push(values, |level, row| levels[level].rows.extend_from_slice(row));
        (0..self.levels.len()).try_for_each(|level| self.flush(level, false))
    }

    fn finish(&mut self) -> Result<()> {
        (0..self.levels.len()).try_for_each(|level| self.flush(level, true))?;
        self.assemble().map_err(|source| Error::writing(&self.path, source))
    }
}

/// What a program may want to know: rows go down, and who wrote the file.
fn key_values() -> Vec<u8> {
    let mut bytes = Vec::new();
    for (key, value) in [("KTXorientation", "rd"), ("KTXwriter", "fantex")] {
        let entry = [key.as_bytes(), b"\0", value.as_bytes(), b"\0"].concat();
        bytes.extend((entry.len() as u32).to_le_bytes());
        bytes.extend(&entry);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    bytes
}

/// Components that do not go together (roughness, metallic) need the better encoder.
fn quality(packing: Packing) -> Quality {
    if packing == (Packing::Bc7 { is_srgb: false }) { Quality::VeryFast } else { Quality::UltraFast }
}

/// Whole blocks of up to four rows, filled up with the last texels.
fn padded_strip(width: u32, rows: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let (width, wide) = (width as usize, width.next_multiple_of(4) as usize);
    let last_row = rows.len() / width - 1;
    let texel = |x: usize, y: usize| rows[y.min(last_row) * width + x.min(width - 1)];
    (0..4).flat_map(|y| (0..wide).map(move |x| texel(x, y))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_levels_come_out_and_keep_the_mean() {
        let size = [8, 8];
        let rows: Vec<[f32; 4]> = (0..64).map(|i| [i as f32, 1.0, 0.0, (i % 2) as f32]).collect();
        let mut pyramid = Pyramid::new(size);
        let mut levels = vec![Vec::new(); level_count(size) as usize];
        for band in rows.chunks(24) {
            pyramid.push(band, |level, row| levels[level].extend_from_slice(row));
        }
        assert_eq!(levels.iter().map(Vec::len).collect::<Vec<_>>(), [64, 16, 4, 1]);
        assert_eq!(levels[3][0], [31.5, 1.0, 0.0, 0.5]);
        assert_eq!(levels[1][5], [(18 + 19 + 26 + 27) as f32 / 4.0, 1.0, 0.0, 0.5]);
    }

    #[test]
    fn levels_of_any_size_have_the_sizes_of_the_format() {
        for size in [[12, 1], [1, 7], [20, 6], [3, 64]] {
            let rows = vec![[0.25, 0.5, 0.75, 1.0]; (size[0] * size[1]) as usize];
            let mut pyramid = Pyramid::new(size);
            let mut levels = vec![Vec::new(); level_count(size) as usize];
            pyramid.push(&rows, |level, row| levels[level].extend_from_slice(row));
            for (level, texels) in (0..).zip(&levels) {
                let [width, height] = level_size(size, level);
                assert_eq!(texels.len() as u32, width * height, "level {level} of {size:?}");
                assert!(texels.iter().all(|texel| *texel == rows[0]), "level {level} of {size:?}");
            }
            assert_eq!(level_size(size, level_count(size) - 1), [1, 1]);
        }
    }

    #[test]
    fn blocks_are_filled_up_with_the_last_texels() {
        let row = |start: usize| (start..start + 6).map(|i| [i as f32; 4]).collect::<Vec<_>>();
        let strip = padded_strip(6, &[row(0), row(6)].concat());
        let first: Vec<usize> = strip.iter().map(|texel| texel[0] as usize).collect();
        let (upper, lower) = ([0, 1, 2, 3, 4, 5, 5, 5], [6, 7, 8, 9, 10, 11, 11, 11]);
        assert_eq!(first, [upper, lower, lower, lower].concat());
    }
}
