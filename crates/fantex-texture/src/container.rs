//! Textures as graphics processors take them: KTX2 and DDS files, with several images and compressed blocks.
//!
//! Only the finest level is read: coarser ones are made anew, by the same filter for all files.

mod basis;

use std::borrow::Cow;
use std::fmt;

use fantex_base::input::Held;
use fantex_base::srgb::{linear_from_srgb, srgb_from_linear, unorm8, unorm16};
use fantex_base::{Error, Result, counted, zstandard};

use crate::image_file::{ImageLimits, check_sides, divide_floats_by_alpha, make_finite, reserve};
use crate::{ColorSpace, Image, Samples};

/// A kind of file that holds textures for graphics processors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum ContainerFormat {
    /// Khronos texture, version 2.
    Ktx2,
    /// DirectDraw surface.
    Dds,
}

impl fmt::Display for ContainerFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ktx2 => "KTX2",
            Self::Dds => "DDS",
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    format: TexelFormat,
    width: u32,
    height: u32,
    /// Layers times faces times slices.
    images: u64,
    /// `None` where the file does not say it.
    space: Option<ColorSpace>,
    /// Whether colours are stored multiplied with alpha.
    is_multiplied: bool,
}

impl Layout {
    fn image_bytes(&self) -> u64 {
        self.format.byte_len(self.width, self.height)
    }

    /// `stored` bytes of texels are unpacked, too.
    fn check(&self, label: &str, stored: u64, limits: ImageLimits) -> Result<Held> {
        check_sides(label, self.width, self.height, limits)?;
        let texels = (u64::from(self.width) * u64::from(self.height)).saturating_mul(self.images);
        reserve(label, texels.saturating_mul(self.format.decoded_bytes()).saturating_add(stored), limits)
    }

    fn decode(&self, bytes: &[u8], default_space: ColorSpace) -> Image {
        let space = self.space.unwrap_or(default_space);
        let mut image = self.format.decode(bytes, self.width, self.height, space);
        if self.is_multiplied && image.channels == 4 {
            self.divide_by_alpha(&mut image.samples);
        }
        make_finite(&mut image);
        image
    }

    /// Straight from multiplied alpha. Files that say sRGB multiply light, others the numbers that they store.
    fn divide_by_alpha(&self, samples: &mut Samples) {
        let divided = |color: f32, alpha: f32| match self.space {
            Some(ColorSpace::Srgb) => srgb_from_linear((linear_from_srgb(color) / alpha).min(1.0)),
            _ => color / alpha,
        };
        // Colours of fully transparent texels stay as they are.
        match samples {
            Samples::U8(values) => {
                for [color @ .., alpha] in values.as_chunks_mut::<4>().0.iter_mut().filter(|t| t[3] > 0) {
                    let alpha = f32::from(*alpha) / 255.0;
                    color.iter_mut().for_each(|c| *c = unorm8(divided(f32::from(*c) / 255.0, alpha)));
                }
            }
            Samples::U16(values) => {
                for [color @ .., alpha] in values.as_chunks_mut::<4>().0.iter_mut().filter(|t| t[3] > 0) {
                    let alpha = f32::from(*alpha) / 65_535.0;
                    color.iter_mut().for_each(|c| *c = unorm16(divided(f32::from(*c) / 65_535.0, alpha)));
                }
            }
            Samples::F32(values) => divide_floats_by_alpha(values),
        }
    }
}

pub(crate) fn recognise(bytes: &[u8]) -> Option<ContainerFormat> {
    if bytes.starts_with(&KTX2_MAGIC) {
        return Some(ContainerFormat::Ktx2);
    }
    bytes.starts_with(&DDS_MAGIC).then_some(ContainerFormat::Dds)
}

/// The images of the finest level, at most `most` of them: by layer, then face (right, left, up, down, front, back), then
/// slice.
pub(crate) fn decode(
    container: ContainerFormat,
    bytes: &[u8],
    label: &str,
    default_space: ColorSpace,
    limits: ImageLimits,
    most: usize,
) -> Result<Vec<Image>> {
    let fail = |error: Error| error.context(format!("'{label}' is not a readable {container} file"));
    match container {
        ContainerFormat::Ktx2 if basis::is_basis(bytes) => {
            let basis = basis::Basis::parse(bytes).map_err(fail)?;
            let unpacked = basis.layout.image_bytes().saturating_mul(basis.layout.images);
            let _held = basis.layout.check(label, unpacked.saturating_add(2 * bytes.len() as u64), limits)?;
            let images = basis.decode(bytes, most).map_err(fail)?;
            Ok(images.iter().map(|image| basis.layout.decode(image, default_space)).collect())
        }
        ContainerFormat::Ktx2 => {
            let header = Ktx2Header::parse(bytes).map_err(fail)?;
            let unpacked = header.layout.image_bytes().saturating_mul(header.layout.images);
            let _held = header.layout.check(label, unpacked, limits)?;
            let level = header.level(bytes).map_err(fail)?;
            let images = level.chunks_exact(header.layout.image_bytes() as usize).take(most);
            Ok(images.map(|image| header.layout.decode(image, default_space)).collect())
        }
        ContainerFormat::Dds => {
            let header = DdsHeader::parse(bytes).map_err(fail)?;
            let _held = header.layout.check(label, 0, limits)?;
            let images = header.images(bytes).map_err(fail)?;
            let decoded =
                images.into_iter().take(most).map(|image| header.layout.decode(image, default_space));
            Ok(decoded.collect())
        }
    }
}

fn u32_at(bytes: &[u8], offset: usize) -> Result<u32> {
    let number = bytes.get(offset..).and_then(|rest| rest.first_chunk());
    let number = number.ok_or_else(|| too_short(offset as u64 + 4, bytes.len()))?;
    Ok(u32::from_le_bytes(*number))
}

fn u64_at(bytes: &[u8], offset: usize) -> Result<u64> {
    Ok(u64::from(u32_at(bytes, offset)?) | u64::from(u32_at(bytes, offset + 4)?) << 32)
}

fn slice_at(bytes: &[u8], offset: u64, length: u64) -> Result<&[u8]> {
    let end = offset.saturating_add(length);
    let is_inside = end <= bytes.len() as u64;
    if is_inside { Ok(&bytes[offset as usize..end as usize]) } else { Err(too_short(end, bytes.len())) }
}

fn too_short(needed: u64, got: usize) -> Error {
    Error::malformed(format!("the file ends after {}; it needs {needed}", counted(got, "byte")))
}

/// A number of the header that cannot be.
fn impossible(field: &str, value: u32) -> Error {
    Error::malformed(format!("the header says {value} for {field}, which cannot be"))
}

/// Texels of a format that is not read, as the file names it.
fn unread_format(name: &str) -> Error {
    Error::unsupported(format!(
        "texels of format {name} are not read; use 8-, 16- or 32-bit channels or BC1 to BC7"
    ))
}

// ---- The header of DDS files (Microsoft, "Programming Guide for DDS").

const DDS_MAGIC: [u8; 4] = *b"DDS ";
/// Bytes of the header with its magic number, and of the extension that follows the code `DX10`.
const HEADER: usize = 128;
const EXTENSION: usize = 20;

const HAS_CODE: u32 = 0x4;
const IS_CUBE: u32 = 0x200;
const CUBE_FACES: u32 = 0xfc00;
const IS_VOLUME: u32 = 0x20_0000;
const EXTENDED_CUBE: u32 = 0x4;
const ALPHA_MODE: u32 = 0x7;
const MULTIPLIED_ALPHA: u32 = 0x2;

#[derive(Clone, Copy, Debug)]
struct DdsHeader {
    layout: Layout,
    /// Images that follow each other without coarser levels between them: the slices of a volume.
    slices: u64,
    levels: u32,
    start: u64,
}

impl DdsHeader {
    fn parse(bytes: &[u8]) -> Result<Self> {
        let word = |offset: usize| u32_at(bytes, offset);
        let [height, width, depth, levels] = [word(12)?, word(16)?, word(24)?, word(28)?];
        let [flags, code, complexity] = [word(80)?, word(84)?, word(112)?];
        let is_volume = complexity & IS_VOLUME != 0;
        let mut faces = if complexity & IS_CUBE != 0 { (complexity & CUBE_FACES).count_ones() } else { 1 };
        let mut layers = 1;
        let mut start = HEADER;
        let is_multiplied_code = matches!(&code.to_le_bytes(), b"DXT2" | b"DXT4");
        let mut is_multiplied = flags & HAS_CODE != 0 && is_multiplied_code;
        let (format, space) = if flags & HAS_CODE == 0 {
            (masked_format(bytes)?, None)
        } else if code == u32::from_le_bytes(*b"DX10") {
            start += EXTENSION;
            let number = word(HEADER)?;
            faces = if word(HEADER + 8)? & EXTENDED_CUBE != 0 { 6 } else { 1 };
            layers = word(HEADER + 12)?.max(1);
            is_multiplied = word(HEADER + 16)? & ALPHA_MODE == MULTIPLIED_ALPHA;
            extended_format(number).ok_or_else(|| unread_format(&format!("{number} (DXGI)")))?
        } else {
            let unread = || unread_format(&code.to_le_bytes().escape_ascii().to_string());
            (coded_format(code).ok_or_else(unread)?, None)
        };
        if faces == 0 {
            return Err(impossible("the number of faces", 0));
        }
        if levels > 32 {
            return Err(impossible("the number of levels", levels));
        }
        let slices = if is_volume { u64::from(depth.max(1)) } else { 1 };
        let images = (u64::from(layers) * u64::from(faces)).saturating_mul(slices);
        let layout = Layout { format, width, height, images, space, is_multiplied };
        Ok(Self { layout, slices, levels: levels.max(1), start: start as u64 })
    }

    /// The bytes of all images of the finest level; the layout must have been checked against limits.
    fn images<'a>(&self, bytes: &'a [u8]) -> Result<Vec<&'a [u8]>> {
        let image_bytes = self.layout.image_bytes();
        let stride: u64 = (0..self.levels).map(|level| self.level_bytes(level)).sum();
        (0..self.layout.images)
            .map(|image| {
                let offset = image / self.slices * stride + image % self.slices * image_bytes;
                slice_at(bytes, self.start.saturating_add(offset), image_bytes)
            })
            .collect()
    }

    fn level_bytes(&self, level: u32) -> u64 {
        let side = |n: u32| n.checked_shr(level).unwrap_or(0).max(1);
        let slices = self.slices.checked_shr(level).unwrap_or(0).max(1);
        self.layout.format.byte_len(side(self.layout.width), side(self.layout.height)) * slices
    }
}

/// Uncompressed texels by the masks of their channels, each a whole byte.
fn masked_format(bytes: &[u8]) -> Result<TexelFormat> {
    const HAS_ALPHA: u32 = 0x1;
    const ALPHA_ONLY: u32 = 0x2;
    let bits = u32_at(bytes, 88)?;
    let mut masks = [u32_at(bytes, 92)?, u32_at(bytes, 96)?, u32_at(bytes, 100)?, u32_at(bytes, 104)?];
    let flags = u32_at(bytes, 80)?;
    if flags & (HAS_ALPHA | ALPHA_ONLY) == 0 {
        masks[3] = 0;
    }
    Ok(match (bits, masks) {
        (8, [0xff, 0, 0, 0] | [0, 0, 0, 0xff]) => TexelFormat::U8 { channels: 1 },
        (16, [0xff, 0, 0, 0xff00]) => TexelFormat::GreyAlpha8,
        (16, [0xff, 0xff00, 0, 0]) => TexelFormat::U8 { channels: 2 },
        (24, [0xff, 0xff00, 0xff_0000, _]) => TexelFormat::U8 { channels: 3 },
        (24, [0xff_0000, 0xff00, 0xff, _]) => TexelFormat::Bgr8 { channels: 3 },
        (32, [0xff, 0xff00, 0xff_0000, 0xff00_0000]) => TexelFormat::U8 { channels: 4 },
        (32, [0xff_0000, 0xff00, 0xff, 0xff00_0000]) => TexelFormat::Bgr8 { channels: 4 },
        (32, [0xff_0000, 0xff00, 0xff, 0]) => TexelFormat::Bgrx8,
        (bits, [r, g, b, a]) => {
            return Err(unread_format(&format!("{bits} bits with masks {r:x} {g:x} {b:x} {a:x}")));
        }
    })
}

/// By four characters, or the numbers of Direct3D 9's floating-point formats.
fn coded_format(code: u32) -> Option<TexelFormat> {
    Some(match &code.to_le_bytes() {
        b"DXT1" => TexelFormat::Bc1 { has_alpha: true },
        b"DXT2" | b"DXT3" => TexelFormat::Bc2,
        b"DXT4" | b"DXT5" => TexelFormat::Bc3,
        b"ATI1" | b"BC4U" => TexelFormat::Bc4,
        b"ATI2" | b"BC5U" => TexelFormat::Bc5,
        [36, 0, 0, 0] => TexelFormat::U16 { channels: 4 },
        [111, 0, 0, 0] => TexelFormat::F16 { channels: 1 },
        [112, 0, 0, 0] => TexelFormat::F16 { channels: 2 },
        [113, 0, 0, 0] => TexelFormat::F16 { channels: 4 },
        [114, 0, 0, 0] => TexelFormat::F32 { channels: 1 },
        [115, 0, 0, 0] => TexelFormat::F32 { channels: 2 },
        [116, 0, 0, 0] => TexelFormat::F32 { channels: 4 },
        _ => return None,
    })
}

/// By the numbers of `DXGI_FORMAT`. Many programs store sRGB colours without saying so: only formats that say it count. Typeless formats,
/// which some programs write, are taken as unsigned.
fn extended_format(number: u32) -> Option<(TexelFormat, Option<ColorSpace>)> {
    let number = match number {
        27 | 48 | 60 | 70 | 73 | 76 | 79 | 82 | 94 | 97 => number + 1,
        90 => 87,
        92 => 88,
        _ => number,
    };
    let of = |number| {
        FORMATS.iter().find(|(_, _, [linear, srgb])| number != 0 && [*linear, *srgb].contains(&number))
    };
    of(number).map(|(format, _, [_, srgb])| (*format, (number == *srgb).then_some(ColorSpace::Srgb)))
}

// ---- The header of KTX2 files (Khronos, "KTX File Format Specification", version 2.0).

const KTX2_MAGIC: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";
/// Where the index of the levels begins; the finest comes first.
const LEVEL_INDEX: usize = 80;
const ZSTANDARD: u32 = 2;
const BASIS_LZ: u32 = 1;

#[derive(Clone, Copy, Debug)]
struct Ktx2Header {
    layout: Layout,
    packing: u32,
    /// Of the finest level.
    offset: u64,
    packed_bytes: u64,
}

impl Ktx2Header {
    fn parse(bytes: &[u8]) -> Result<Self> {
        let word = |index: usize| u32_at(bytes, KTX2_MAGIC.len() + 4 * index);
        let [code, width, height, depth] = [word(0)?, word(2)?, word(3)?, word(4)?];
        let [layers, faces, packing] = [word(5)?, word(6)?, word(8)?];
        if ![0, ZSTANDARD].contains(&packing) {
            let message =
                format!("texels packed by method {packing} are not read; use Zstandard (2) or none (0)");
            return Err(Error::unsupported(message));
        }
        if ![1, 6].contains(&faces) {
            return Err(impossible("the number of faces", faces));
        }
        let (format, space) =
            texel_format(code).ok_or_else(|| unread_format(&format!("{code} (VkFormat)")))?;
        let images = [layers, faces, depth].map(|count| u64::from(count.max(1)));
        let images = images.into_iter().fold(1_u64, u64::saturating_mul);
        let (height, space) = (height.max(1), Some(space));
        let descriptor = slice_at(bytes, word(9)?.into(), word(10)?.into())?;
        let is_multiplied = is_multiplied(descriptor);
        Ok(Self {
            layout: Layout { format, width, height, images, space, is_multiplied },
            packing,
            offset: u64_at(bytes, LEVEL_INDEX)?,
            packed_bytes: u64_at(bytes, LEVEL_INDEX + 8)?,
        })
    }

    /// The unpacked bytes of all images of the finest level; the layout must have been checked against limits.
    fn level<'a>(&self, bytes: &'a [u8]) -> Result<Cow<'a, [u8]>> {
        let packed = slice_at(bytes, self.offset, self.packed_bytes)?;
        let needed = self.layout.image_bytes() * self.layout.images;
        let level = if self.packing == ZSTANDARD {
            let unpacked = zstandard::unpack(packed, needed as usize);
            Cow::Owned(unpacked.ok_or_else(|| Error::malformed("the packed texels are damaged"))?)
        } else {
            Cow::Borrowed(packed)
        };
        if (level.len() as u64) < needed {
            return Err(too_short(needed, level.len()));
        }
        Ok(level)
    }
}

/// Whether the description of a file's texels says that colours are multiplied with alpha.
fn is_multiplied(descriptor: &[u8]) -> bool {
    descriptor.get(15).is_some_and(|flags| flags & 1 != 0)
}

/// By the numbers of `VkFormat`.
fn texel_format(code: u32) -> Option<(TexelFormat, ColorSpace)> {
    let of =
        |code| FORMATS.iter().find(|(_, [linear, srgb], _)| code != 0 && [*linear, *srgb].contains(&code));
    of(code).map(|(format, [_, srgb], _)| {
        (*format, if code == *srgb { ColorSpace::Srgb } else { ColorSpace::Linear })
    })
}

/// The numbers of formats, linear and sRGB: Vulkan's `VkFormat` and Direct3D's `DXGI_FORMAT`; 0 where there is none.
const FORMATS: [(TexelFormat, [u32; 2], [u32; 2]); 30] = {
    use TexelFormat as F;
    [
        (F::U8 { channels: 1 }, [9, 15], [61, 0]),
        (F::U8 { channels: 2 }, [16, 22], [49, 0]),
        (F::U8 { channels: 3 }, [23, 29], [0, 0]),
        (F::Bgr8 { channels: 3 }, [30, 36], [0, 0]),
        (F::U8 { channels: 4 }, [37, 43], [28, 29]),
        (F::Bgr8 { channels: 4 }, [44, 50], [87, 91]),
        (F::Bgrx8, [0, 0], [88, 93]),
        (F::U16 { channels: 1 }, [70, 0], [56, 0]),
        (F::U16 { channels: 2 }, [77, 0], [35, 0]),
        (F::U16 { channels: 3 }, [84, 0], [0, 0]),
        (F::U16 { channels: 4 }, [91, 0], [11, 0]),
        (F::F16 { channels: 1 }, [76, 0], [54, 0]),
        (F::F16 { channels: 2 }, [83, 0], [34, 0]),
        (F::F16 { channels: 3 }, [90, 0], [0, 0]),
        (F::F16 { channels: 4 }, [97, 0], [10, 0]),
        (F::F32 { channels: 1 }, [100, 0], [41, 0]),
        (F::F32 { channels: 2 }, [103, 0], [16, 0]),
        (F::F32 { channels: 3 }, [106, 0], [6, 0]),
        (F::F32 { channels: 4 }, [109, 0], [2, 0]),
        (F::B10G11R11, [122, 0], [26, 0]),
        (F::E5B9G9R9, [123, 0], [67, 0]),
        (F::Bc1 { has_alpha: false }, [131, 132], [0, 0]),
        (F::Bc1 { has_alpha: true }, [133, 134], [71, 72]),
        (F::Bc2, [135, 136], [74, 75]),
        (F::Bc3, [137, 138], [77, 78]),
        (F::Bc4, [139, 0], [80, 0]),
        (F::Bc5, [141, 0], [83, 0]),
        (F::Bc6h { is_signed: false }, [143, 0], [95, 0]),
        (F::Bc6h { is_signed: true }, [144, 0], [96, 0]),
        (F::Bc7, [145, 146], [98, 99]),
    ]
};

// ---- Texels as they lie in KTX2 and DDS files.

/// The storage of texels. Formats with two channels become RGB with blue 0, since they hold no grey and alpha; all but
/// 8- and 16-bit channels become floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TexelFormat {
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
    /// 4 x 4 texels in 8 bytes, RGBA. Without alpha what would be transparent is black.
    Bc1 { has_alpha: bool },
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
    fn block_bytes(self) -> Option<usize> {
        match self {
            Self::Bc1 { .. } | Self::Bc4 => Some(8),
            Self::Bc2 | Self::Bc3 | Self::Bc5 | Self::Bc6h { .. } | Self::Bc7 => Some(16),
            _ => None,
        }
    }

    fn texel_bytes(self) -> usize {
        match self {
            Self::U8 { channels } | Self::Bgr8 { channels } => usize::from(channels),
            Self::GreyAlpha8 => 2,
            Self::U16 { channels } | Self::F16 { channels } => 2 * usize::from(channels),
            Self::F32 { channels } => 4 * usize::from(channels),
            _ => 4,
        }
    }

    fn byte_len(self, width: u32, height: u32) -> u64 {
        match self.block_bytes() {
            Some(bytes) => {
                (u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4))).saturating_mul(bytes as u64)
            }
            None => (u64::from(width) * u64::from(height)).saturating_mul(self.texel_bytes() as u64),
        }
    }

    /// Bytes of a texel in memory, at most.
    fn decoded_bytes(self) -> u64 {
        match self {
            Self::U8 { .. } | Self::Bgr8 { .. } | Self::Bgrx8 | Self::GreyAlpha8 => 4,
            Self::Bc1 { .. } | Self::Bc2 | Self::Bc3 | Self::Bc4 | Self::Bc5 | Self::Bc7 => 4,
            Self::U16 { .. } => 8,
            _ => 16,
        }
    }

    /// The image in `bytes`, of which there are [`TexelFormat::byte_len`]. Floats are linear, whatever `space` says.
    fn decode(self, bytes: &[u8], width: u32, height: u32, space: ColorSpace) -> Image {
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
            Self::Bc1 { has_alpha } => {
                let mut samples = blocks.texels::<8, _, 64>(4, bcdec_rs::bc1);
                if !has_alpha {
                    samples.iter_mut().skip(3).step_by(4).for_each(|alpha| *alpha = u8::MAX);
                }
                image(4, Samples::U8(samples))
            }
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
    fn opaque_blocks_have_no_holes() {
        // The first end point is the smaller one, so the last index is no colour: a hole, or black.
        let block = [0, 0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        for (code, texel) in [(131, [0, 0, 0, 255]), (133, [0; 4])] {
            let (format, space) = texel_format(code).unwrap();
            let image = format.decode(&block, 4, 4, space);
            assert_eq!(image.samples, Samples::U8(texel.repeat(16)), "{code}");
        }
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
