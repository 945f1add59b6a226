//! Images from and to files.
//!
//! The format is recognised by the content when reading and chosen by the extension when writing. Row 0 of the file is row
//! 0 of the image; orientation tags and colour profiles are not applied, so nothing is ever flipped or converted silently.
//! OpenEXR files store colours multiplied with alpha; an [`Image`] holds straight alpha, so reading divides and writing
//! multiplies. Numbers of floating-point files that are none become 0 and infinite ones 65 504, the largest of half precision:
//! they would spoil every mean that they enter.

mod exr_channels;

use std::borrow::Cow;
use std::io::{Cursor, Write};
use std::path::Path;

use fantex_base::files::write_whole;
use fantex_base::{Error, Result, counted, input};
use image::codecs::hdr::HdrEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::openexr::OpenExrEncoder;
use image::codecs::png::PngEncoder;
use image::codecs::tiff::TiffEncoder;
use image::codecs::webp::WebPEncoder;
use image::error::{ImageError, LimitErrorKind};
use image::{ColorType, DynamicImage, ImageDecoder, ImageEncoder, ImageFormat, ImageReader};

use crate::container;
use crate::image::{ColorSpace, Depth, Image, Samples};

/// What a reader may allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageLimits {
    /// Longest side, in texels.
    pub side: u32,
    /// Decoded bytes.
    pub bytes: u64,
}

impl Default for ImageLimits {
    /// 65 536 texels per side, and what is [left](input::memory_left) of the budget for input.
    fn default() -> Self {
        Self { side: 65_536, bytes: input::memory_left() }
    }
}

fn name_of(format: ImageFormat) -> &'static str {
    match format {
        ImageFormat::Png => "PNG",
        ImageFormat::Jpeg => "JPEG",
        ImageFormat::Tiff => "TIFF",
        ImageFormat::WebP => "WebP",
        ImageFormat::Hdr => "Radiance HDR",
        ImageFormat::OpenExr => "OpenEXR",
        ImageFormat::Tga => "TGA",
        ImageFormat::Bmp => "BMP",
        _ => "unknown",
    }
}

/// Refuses sides that are zero or too long.
pub(crate) fn check_sides(label: &str, width: u32, height: u32, limits: ImageLimits) -> Result<()> {
    if width > 0 && height > 0 && width.max(height) <= limits.side {
        return Ok(());
    }
    let limit = limits.side;
    Err(Error::too_large(format!("'{label}' has {width} x {height} texels; each side must be 1 to {limit}")))
}

/// Counts what an image takes while it is decoded.
pub(crate) fn reserve(label: &str, bytes: u64, limits: ImageLimits) -> Result<input::Held> {
    match bytes > limits.bytes {
        true => Err(too_much_memory(label, bytes, limits)),
        false => Ok(input::hold(bytes)),
    }
}

fn too_much_memory(label: &str, bytes: u64, limits: ImageLimits) -> Error {
    input::too_large(format_args!("'{label}'"), bytes, limits.bytes)
}

impl Image {
    /// Reads a PNG, JPEG, TIFF, WebP, Radiance HDR, OpenEXR, KTX2, DDS, TGA or BMP file with the default limits. Fixed-point samples
    /// are taken as sRGB-encoded colours, unless the file says otherwise (as KTX2 does); for other data use
    /// [`Image::load_as`]. Of files with several images (faces, layers, slices), this is the first one.
    ///
    /// # Errors
    /// The file cannot be read, is none of these, is damaged, or exceeds the limits.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Self::load_as(path, ColorSpace::Srgb)
    }

    /// As [`Image::load`], with the meaning of 8- and 16-bit samples said. Floating-point samples are always linear.
    ///
    /// # Errors
    /// As [`Image::load`].
    pub fn load_as(path: impl AsRef<Path>, default_space: ColorSpace) -> Result<Self> {
        let path = path.as_ref();
        Self::decode(&input::read(path)?, &path.display().to_string(), default_space)
    }

    /// Reads an image from the bytes of a file with the default limits; `label` names it in errors.
    ///
    /// # Errors
    /// As [`Image::decode_within`].
    pub fn decode(bytes: &[u8], label: &str, default_space: ColorSpace) -> Result<Self> {
        Self::decode_within(bytes, label, default_space, ImageLimits::default())
    }

    /// As [`Image::decode`], refusing what exceeds `limits` before it is allocated.
    ///
    /// # Errors
    /// The bytes are no image of a known format, are damaged, or exceed the limits.
    pub fn decode_within(
        bytes: &[u8],
        label: &str,
        default_space: ColorSpace,
        limits: ImageLimits,
    ) -> Result<Self> {
        let unknown = || {
            Error::unsupported(format!(
                "'{label}' is no image that can be read here (known: PNG, JPEG, TIFF, WebP, HDR, OpenEXR, KTX2, DDS, TGA, BMP)"
            ))
        };
        if let Some(container) = container::recognise(bytes) {
            let images = container::decode(container, bytes, label, default_space, limits, 1)?;
            return images.into_iter().next().ok_or_else(unknown);
        }
        let format = match image::guess_format(bytes) {
            Ok(format) if format == ImageFormat::Bmp || WRITABLE.contains(&format) => format,
            _ if is_tga(bytes) => ImageFormat::Tga,
            _ => return Err(unknown()),
        };
        let decoded = input::guarded(|| {
            if format == ImageFormat::OpenExr {
                let headers = checked_exr(bytes, label, limits)?;
                if let Some(image) = exr_channels::decode(bytes, &headers, label, limits)? {
                    return Ok(image);
                }
            }
            if format == ImageFormat::Tiff {
                check_tiff(bytes, label)?;
                if let Some(image) = decode_numbers(bytes, label, limits)? {
                    return Ok(image);
                }
            }
            Ok(from_dynamic(decode_dynamic(bytes, label, format, limits)?, default_space))
        });
        let damaged = || Err(not_readable(label, format, "the data is damaged"));
        let mut image = decoded.unwrap_or_else(damaged)?;
        if format == ImageFormat::OpenExr
            && let (Samples::F32(values), 4) = (&mut image.samples, image.channels)
        {
            divide_floats_by_alpha(values);
        }
        make_finite(&mut image);
        Ok(image)
    }

    /// All images of a KTX2 or DDS file, by layer, then face (right, left, up, down, front, back, as cube maps have them),
    /// then slice; of other files the only one. All have the same size.
    ///
    /// # Errors
    /// As [`Image::decode_within`]; the limit of memory holds for all images together.
    pub fn decode_all(
        bytes: &[u8],
        label: &str,
        default_space: ColorSpace,
        limits: ImageLimits,
    ) -> Result<Vec<Self>> {
        match container::recognise(bytes) {
            Some(format) => container::decode(format, bytes, label, default_space, limits, usize::MAX),
            None => Ok(vec![Self::decode_within(bytes, label, default_space, limits)?]),
        }
    }

    /// As [`Image::decode_all`], from a file with the default limits.
    ///
    /// # Errors
    /// As [`Image::load_as`].
    pub fn load_all(path: impl AsRef<Path>, default_space: ColorSpace) -> Result<Vec<Self>> {
        let path = path.as_ref();
        Self::decode_all(
            &input::read(path)?,
            &path.display().to_string(),
            default_space,
            ImageLimits::default(),
        )
    }

    /// Writes the image in the format of the path's extension, whole or not at all (a temporary file beside it is renamed
    /// at the end). What a format cannot hold is converted as [`Image::converted`] does: floats become 8-bit sRGB in PNG,
    /// JPEG and WebP, 16-bit samples 8-bit in JPEG and WebP, fixed point linear floats in HDR and OpenEXR; grey
    /// becomes RGB where a format knows no grey.
    ///
    /// # Errors
    /// The extension names no format, the format has no room for the channels, or the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let bytes = self.encoded(path)?;
        write_whole(path, true, |out| out.write_all(&bytes))
    }

    /// The bytes that [`save`](Self::save) would write to such a path.
    ///
    /// # Errors
    /// The extension names no format, or the format has no room for the channels.
    pub fn encoded(&self, path: impl AsRef<Path>) -> Result<Vec<u8>> {
        let path = path.as_ref();
        let format = ImageFormat::from_path(path).ok().filter(|format| WRITABLE.contains(format));
        let unknown = || {
            let known = "use .png, .jpg, .tif, .webp, .hdr or .exr";
            Error::unsupported(format!("cannot tell the image format of '{}'; {known}", path.display()))
        };
        let format = format.ok_or_else(unknown)?;
        let fits = match format {
            ImageFormat::Jpeg => !self.has_alpha(),
            ImageFormat::Hdr => self.channels == 3,
            _ => true,
        };
        let mut image = convert_for(self, format);
        if format == ImageFormat::Hdr && self.channels == 1 {
            image = Cow::Owned(spread_grey(&image).into_owned());
        } else if !fits {
            let (name, channels) = (name_of(format), counted(self.channels, "channel"));
            let path = path.display();
            let message = format!("{name} cannot hold {channels} ('{path}'); use .png or .exr");
            return Err(Error::unsupported(message));
        }
        encode(&image, format).map_err(|source| {
            let message = format!("cannot encode '{}' as {}: {source}", path.display(), name_of(format));
            Error::unsupported(message).with_path(path).with_source(source)
        })
    }
}

/// Those that are written. They, and BMP, are read by what their first bytes tell.
const WRITABLE: [ImageFormat; 6] = [
    ImageFormat::Png,
    ImageFormat::Jpeg,
    ImageFormat::Tiff,
    ImageFormat::WebP,
    ImageFormat::Hdr,
    ImageFormat::OpenExr,
];

/// Whether bytes begin as a TGA file, which has no magic number: with a header whose fields are possible together.
fn is_tga(bytes: &[u8]) -> bool {
    let Some(&[_, map, kind, _, _, _, _, map_bits, _, _, _, _, w0, w1, h0, h1, bits, flags]) =
        bytes.first_chunk::<18>()
    else {
        return false;
    };
    let is_kind = match (map, kind) {
        (1, 1 | 9) => [8, 16].contains(&bits) && [15, 16, 24, 32].contains(&map_bits),
        (0 | 1, 2 | 10) => [15, 16, 24, 32].contains(&bits),
        (0 | 1, 3 | 11) => [8, 16].contains(&bits),
        _ => false,
    };
    // The two highest bits said how rows were interleaved, which nobody does.
    is_kind && (w0 | w1) > 0 && (h0 | h1) > 0 && flags < 64
}

/// Damaged, cut short, or of a variant that is not supported.
fn not_readable(label: &str, format: ImageFormat, cause: &str) -> Error {
    Error::malformed(format!("'{label}' is not a readable {} image: {cause}", name_of(format)))
}

/// With a palette, or another interpretation of samples that the decoder lacks.
fn tiff_not_read(label: &str) -> Error {
    Error::unsupported(format!(
        "'{label}' is a TIFF image of a kind that is not read, such as one with a palette; save it as RGB or as PNG"
    ))
}

fn decode_dynamic(
    bytes: &[u8],
    label: &str,
    format: ImageFormat,
    limits: ImageLimits,
) -> Result<DynamicImage> {
    let report = |error: ImageError| match &error {
        ImageError::Limits(limit) if matches!(limit.kind(), LimitErrorKind::InsufficientMemory) => {
            too_much_memory(label, limits.bytes + 1, limits)
        }
        ImageError::Unsupported(_) if format == ImageFormat::Tiff => tiff_not_read(label).with_source(error),
        _ => not_readable(label, format, &error.to_string()).with_source(error),
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut decoder_limits = image::Limits::no_limits();
    decoder_limits.max_alloc = Some(limits.bytes);
    reader.limits(decoder_limits);
    let decoder = reader.into_decoder().map_err(report)?;
    let (width, height) = decoder.dimensions();
    check_sides(label, width, height, limits)?;
    let _held = reserve(label, decoder.total_bytes().saturating_mul(copies(format)), limits)?;
    DynamicImage::from_decoder(decoder).map_err(report)
}

/// How often a decoder holds an image's samples at once, rounded up; two copies hold all levels of a texture, too.
fn copies(format: ImageFormat) -> u64 {
    match format {
        ImageFormat::OpenExr | ImageFormat::WebP => 3,
        _ => 2,
    }
}

/// The headers of an OpenEXR file. Refuses those that claim more than the file can hold or than may be allocated: the decoder believes them.
fn checked_exr(bytes: &[u8], label: &str, limits: ImageLimits) -> Result<exr::meta::Headers> {
    let refused = |cause: String| not_readable(label, ImageFormat::OpenExr, &cause);
    let read = exr::meta::MetaData::read_from_buffered(bytes, false);
    let headers = read.map_err(|error| refused(error.to_string()))?.headers;
    for header in &headers {
        let [window, display] = [header.layer_size, header.shared_attributes.display_window.size];
        for size in [window, display] {
            let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
            check_sides(label, side(size.0), side(size.1), limits)?;
        }
        // Each has a place in a table of the file, and a header of its own.
        if header.chunk_count as u64 > bytes.len() as u64 / 16 {
            let (chunks, length) = (counted(header.chunk_count, "part"), counted(bytes.len(), "byte"));
            return Err(refused(format!("it claims {chunks} in {length}")));
        }
        let pixel_bytes = header.channels.bytes_per_pixel as u64;
        let block = match header.blocks {
            exr::meta::BlockDescription::Tiles(tiles) => tiles.tile_size,
            _ => exr::math::Vec2(window.0, header.compression.scan_lines_per_block()),
        };
        let area = |size: exr::math::Vec2<usize>| (size.0 as u64).saturating_mul(size.1 as u64);
        // A part is unpacked on each thread, twice.
        let threads = 2 * rayon::current_num_threads() as u64;
        let parts = area(block)
            .saturating_mul(pixel_bytes)
            .saturating_mul(threads.min(header.chunk_count as u64 + 1));
        reserve(label, parts.saturating_add(area(window).saturating_mul(pixel_bytes)), limits)?;
    }
    Ok(headers)
}

/// Refuses TIFF files with a field of more values than the file has bytes for: the decoder makes room for all before it reads one. Fields of the
/// first picture only, which is the one that is read.
fn check_tiff(bytes: &[u8], label: &str) -> Result<()> {
    let is_little = bytes.starts_with(b"II");
    let number = |at: usize, length: usize| -> Option<u64> {
        let mut digits: Vec<u8> = bytes.get(at..at.checked_add(length)?)?.to_vec();
        if is_little {
            digits.reverse();
        }
        Some(digits.into_iter().fold(0, |sum, digit| sum << 8 | u64::from(digit)))
    };
    let is_big = number(2, 2) == Some(43);
    // Lengths of the place of the directory, the number of fields, a field, and its number of values.
    let (place, many, field, count) = if is_big { (8, 8, 20, 8) } else { (4, 2, 12, 4) };
    let Some(directory) = number(if is_big { 8 } else { 4 }, place) else { return Ok(()) };
    let Ok(directory) = usize::try_from(directory) else { return Ok(()) };
    // What is cut short is reported by the decoder.
    let Some(fields) = number(directory, many) else { return Ok(()) };
    for i in 0..fields.min(bytes.len() as u64 / field as u64) as usize {
        let at = directory + many + i * field;
        let (Some(tag), Some(kind), Some(values)) = (number(at, 2), number(at + 2, 2), number(at + 4, count))
        else {
            return Ok(());
        };
        let value_bytes: u64 = match kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16 | 17 | 18 => 8,
            _ => 1,
        };
        if values.saturating_mul(value_bytes) > bytes.len() as u64 {
            let (values, length) = (counted(values, "value"), counted(bytes.len(), "byte"));
            let cause = format!("its field {tag} claims {values} in {length}");
            return Err(not_readable(label, ImageFormat::Tiff, &cause));
        }
    }
    Ok(())
}

/// A grey TIFF of signed, wide or floating-point numbers, as terrain comes in: floats as they are (those that are no number as 0),
/// whole numbers as shares of the largest of their kind. None for other TIFFs.
fn decode_numbers(bytes: &[u8], label: &str, limits: ImageLimits) -> Result<Option<Image>> {
    use tiff::ColorType::Gray;
    use tiff::decoder::{Decoder, DecodingResult as Numbers, Limits};
    let report = |error: tiff::TiffError| {
        not_readable(label, ImageFormat::Tiff, &error.to_string()).with_source(error)
    };
    // What cannot be opened here is reported by the decoder of pictures.
    let Ok(mut decoder) = Decoder::new(Cursor::new(bytes)) else { return Ok(None) };
    let Ok(Gray(bits)) = decoder.colortype() else { return Ok(None) };
    let format = decoder.find_tag_unsigned_vec::<u16>(tiff::tags::Tag::SampleFormat).ok().flatten();
    let is_unsigned = format.and_then(|formats| formats.first().copied()).is_none_or(|format| format == 1);
    if is_unsigned && bits <= 16 {
        return Ok(None);
    }
    let (width, height) = decoder.dimensions().map_err(report)?;
    check_sides(label, width, height, limits)?;
    let _held = reserve(label, u64::from(width) * u64::from(height) * 12, limits)?;
    let mut allowed = Limits::default();
    allowed.decoding_buffer_size = usize::try_from(limits.bytes).unwrap_or(usize::MAX);
    allowed.intermediate_buffer_size = allowed.decoding_buffer_size;
    let mut decoder = decoder.with_limits(allowed);
    let shares = |numbers: Vec<f64>, largest: f64| numbers.iter().map(|n| (n / largest) as f32).collect();
    let samples: Vec<f32> = match decoder.read_image().map_err(report)? {
        Numbers::I8(n) => shares(n.into_iter().map(f64::from).collect(), f64::from(i8::MAX)),
        Numbers::I16(n) => shares(n.into_iter().map(f64::from).collect(), f64::from(i16::MAX)),
        Numbers::I32(n) => shares(n.into_iter().map(f64::from).collect(), f64::from(i32::MAX)),
        Numbers::U32(n) => shares(n.into_iter().map(f64::from).collect(), f64::from(u32::MAX)),
        Numbers::F16(n) => n.into_iter().map(f32::from).collect(),
        Numbers::F32(n) => n,
        Numbers::F64(n) => n.into_iter().map(|n| n as f32).collect(),
        _ => return Ok(None),
    };
    let samples = samples.into_iter().map(|n| if n.is_finite() { n } else { 0.0 }).collect();
    let (space, samples) = (ColorSpace::Linear, Samples::F32(samples));
    Ok(Some(Image { width, height, channels: 1, space, samples }))
}

fn from_dynamic(decoded: DynamicImage, default_space: ColorSpace) -> Image {
    let (width, height) = (decoded.width(), decoded.height());
    let channels = decoded.color().channel_count();
    let samples = match decoded {
        DynamicImage::ImageLuma8(buffer) => Samples::U8(buffer.into_raw()),
        DynamicImage::ImageLumaA8(buffer) => Samples::U8(buffer.into_raw()),
        DynamicImage::ImageRgb8(buffer) => Samples::U8(buffer.into_raw()),
        DynamicImage::ImageRgba8(buffer) => Samples::U8(buffer.into_raw()),
        DynamicImage::ImageLuma16(buffer) => Samples::U16(buffer.into_raw()),
        DynamicImage::ImageLumaA16(buffer) => Samples::U16(buffer.into_raw()),
        DynamicImage::ImageRgb16(buffer) => Samples::U16(buffer.into_raw()),
        DynamicImage::ImageRgba16(buffer) => Samples::U16(buffer.into_raw()),
        DynamicImage::ImageRgb32F(buffer) => Samples::F32(buffer.into_raw()),
        other => {
            let samples = Samples::F32(other.into_rgba32f().into_raw());
            return Image { width, height, channels: 4, space: ColorSpace::Linear, samples };
        }
    };
    let space = if samples.depth() == Depth::F32 { ColorSpace::Linear } else { default_space };
    Image { width, height, channels, space, samples }
}

/// What takes the place of infinite numbers: the largest of half precision.
pub(crate) const BRIGHTEST: f32 = 65_504.0;

/// Replaces numbers that are not finite by the nearest ones that are allowed, and those that are none by 0.
pub(crate) fn make_finite(image: &mut Image) {
    if let Samples::F32(values) = &mut image.samples {
        for value in values.iter_mut().filter(|value| !value.is_finite()) {
            *value = if value.is_nan() { 0.0 } else { BRIGHTEST.copysign(*value) };
        }
    }
}

/// RGBA: straight from associated alpha; colours of fully transparent texels stay as they are.
pub(crate) fn divide_floats_by_alpha(values: &mut [f32]) {
    for [r, g, b, a] in values.as_chunks_mut::<4>().0 {
        if *a > 0.0 {
            (*r, *g, *b) = (*r / *a, *g / *a, *b / *a);
        }
    }
}

/// The image with samples that `format` can hold.
fn convert_for(image: &Image, format: ImageFormat) -> Cow<'_, Image> {
    let depth = image.samples.depth();
    let (depth, space) = match format {
        ImageFormat::Hdr | ImageFormat::OpenExr => (Depth::F32, ColorSpace::Linear),
        ImageFormat::Jpeg | ImageFormat::WebP if depth == Depth::U16 => (Depth::U8, image.space),
        ImageFormat::Tiff if depth == Depth::F32 => (Depth::F32, ColorSpace::Linear),
        _ if depth == Depth::F32 => (Depth::U8, ColorSpace::Srgb),
        _ => (depth, image.space),
    };
    if (depth, space) == (image.samples.depth(), image.space) {
        return Cow::Borrowed(image);
    }
    Cow::Owned(image.converted(depth, space))
}

/// Grey as three equal channels, grey + alpha as four; others unchanged.
fn spread_grey(image: &Image) -> Cow<'_, Image> {
    fn spread<T: Copy>(values: &[T], channels: u8) -> Vec<T> {
        match channels {
            1 => values.iter().flat_map(|&grey| [grey; 3]).collect(),
            _ => values.as_chunks().0.iter().flat_map(|&[grey, alpha]| [grey, grey, grey, alpha]).collect(),
        }
    }
    if image.channels > 2 {
        return Cow::Borrowed(image);
    }
    let samples = match &image.samples {
        Samples::U8(values) => Samples::U8(spread(values, image.channels)),
        Samples::U16(values) => Samples::U16(spread(values, image.channels)),
        Samples::F32(values) => Samples::F32(spread(values, image.channels)),
    };
    Cow::Owned(Image { channels: image.channels + 2, samples, ..*image })
}

fn encode(image: &Image, format: ImageFormat) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    let to = &mut bytes;
    match format {
        ImageFormat::OpenExr => {
            write_samples(&multiplied_by_alpha(&spread_grey(image)), OpenExrEncoder::new(to))?;
        }
        ImageFormat::WebP => write_samples(&spread_grey(image), WebPEncoder::new_lossless(to))?,
        ImageFormat::Jpeg => write_samples(image, JpegEncoder::new_with_quality(to, 95))?,
        ImageFormat::Tiff if image.samples.depth() == Depth::F32 || image.channels == 2 => {
            write_samples(&spread_grey(image), TiffEncoder::new(to))?;
        }
        ImageFormat::Tiff => write_samples(image, TiffEncoder::new(to))?,
        ImageFormat::Hdr => write_samples(image, HdrEncoder::new(to))?,
        _ => write_samples(image, PngEncoder::new(to))?,
    }
    Ok(bytes.into_inner())
}

/// The encoders expect native-endian bytes.
fn write_samples(image: &Image, encoder: impl ImageEncoder) -> Result<(), ImageError> {
    let color = match (image.samples.depth(), image.channels) {
        (Depth::U8, 1) => ColorType::L8,
        (Depth::U8, 2) => ColorType::La8,
        (Depth::U8, 3) => ColorType::Rgb8,
        (Depth::U8, _) => ColorType::Rgba8,
        (Depth::U16, 1) => ColorType::L16,
        (Depth::U16, 2) => ColorType::La16,
        (Depth::U16, 3) => ColorType::Rgb16,
        (Depth::U16, _) => ColorType::Rgba16,
        (Depth::F32, 3) => ColorType::Rgb32F,
        (Depth::F32, _) => ColorType::Rgba32F,
    };
    let data = match &image.samples {
        Samples::U8(values) => values,
        Samples::U16(values) => bytemuck::cast_slice(values),
        Samples::F32(values) => bytemuck::cast_slice(values),
    };
    encoder.write_image(data, image.width, image.height, color.into())
}

fn multiplied_by_alpha(image: &Image) -> Cow<'_, Image> {
    let mut associated = Cow::Borrowed(image);
    if image.channels == 4
        && let Samples::F32(values) = &mut associated.to_mut().samples
    {
        for [r, g, b, a] in values.as_chunks_mut::<4>().0 {
            (*r, *g, *b) = (*r * *a, *g * *a, *b * *a);
        }
    }
    associated
}
