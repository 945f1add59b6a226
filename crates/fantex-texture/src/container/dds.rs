//! The header of DDS files (Microsoft, "Programming Guide for DDS").

use super::texel_format::TexelFormat;
use super::{ContainerFault, Layout, slice_at, u32_at};
use crate::ColorSpace;

pub(super) const MAGIC: [u8; 4] = *b"DDS ";
/// Bytes of the header with its magic number, and of the extension that follows the code `DX10`.
const HEADER: usize = 128;
const EXTENSION: usize = 20;

const HAS_CODE: u32 = 0x4;
const IS_CUBE: u32 = 0x200;
const CUBE_FACES: u32 = 0xfc00;
const IS_VOLUME: u32 = 0x20_0000;
const EXTENDED_CUBE: u32 = 0x4;

/// What is needed of a header.
#[derive(Clone, Copy, Debug)]
pub(super) struct Header {
    pub(super) layout: Layout,
    /// Images that follow each other without coarser levels between them: the slices of a volume.
    slices: u64,
    levels: u32,
    /// Where the texels begin.
    start: u64,
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, ContainerFault> {
        let word = |offset: usize| u32_at(bytes, offset);
        let [height, width, depth, levels] = [word(12)?, word(16)?, word(24)?, word(28)?];
        let [flags, code, complexity] = [word(80)?, word(84)?, word(112)?];
        let is_volume = complexity & IS_VOLUME != 0;
        let mut faces = if complexity & IS_CUBE != 0 { (complexity & CUBE_FACES).count_ones() } else { 1 };
        let mut layers = 1;
        let mut start = HEADER;
        let (format, space) = if flags & HAS_CODE == 0 {
            (masked_format(bytes)?, None)
        } else if code == u32::from_le_bytes(*b"DX10") {
            start += EXTENSION;
            let number = word(HEADER)?;
            faces = if word(HEADER + 8)? & EXTENDED_CUBE != 0 { 6 } else { 1 };
            layers = word(HEADER + 12)?.max(1);
            extended_format(number)
                .ok_or_else(|| ContainerFault::TexelFormat { name: format!("{number} (DXGI)") })?
        } else {
            let name = || code.to_le_bytes().escape_ascii().to_string();
            (coded_format(code).ok_or_else(|| ContainerFault::TexelFormat { name: name() })?, None)
        };
        if faces == 0 {
            return Err(ContainerFault::Header { field: "the number of faces", value: 0 });
        }
        if levels > 32 {
            return Err(ContainerFault::Header { field: "the number of levels", value: u64::from(levels) });
        }
        let slices = if is_volume { u64::from(depth.max(1)) } else { 1 };
        let images = (u64::from(layers) * u64::from(faces)).saturating_mul(slices);
        let layout = Layout { format, width, height, images, space };
        Ok(Self { layout, slices, levels: levels.max(1), start: start as u64 })
    }

    /// The bytes of all images of the finest level; the layout must have been checked against limits.
    pub(super) fn images<'a>(&self, bytes: &'a [u8]) -> Result<Vec<&'a [u8]>, ContainerFault> {
        let image_bytes = self.layout.image_bytes();
        let stride: u64 = (0..self.levels).map(|level| self.level_bytes(level)).sum();
        (0..self.layout.images)
            .map(|image| {
                let offset = image / self.slices * stride + image % self.slices * image_bytes;
                slice_at(bytes, self.start.saturating_add(offset), image_bytes)
            })
            .collect()
    }

    /// Bytes of a level of a face or volume.
    fn level_bytes(&self, level: u32) -> u64 {
        let side = |n: u32| n.checked_shr(level).unwrap_or(0).max(1);
        let slices = self.slices.checked_shr(level).unwrap_or(0).max(1);
        self.layout.format.byte_len(side(self.layout.width), side(self.layout.height)) * slices
    }
}

/// Uncompressed texels by the masks of their channels, each a whole byte.
fn masked_format(bytes: &[u8]) -> Result<TexelFormat, ContainerFault> {
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
            let name = format!("{bits} bits with masks {r:x} {g:x} {b:x} {a:x}");
            return Err(ContainerFault::TexelFormat { name });
        }
    })
}

/// By four characters, or the numbers of Direct3D 9's floating-point formats.
fn coded_format(code: u32) -> Option<TexelFormat> {
    Some(match &code.to_le_bytes() {
        b"DXT1" => TexelFormat::Bc1,
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

/// By the numbers of `DXGI_FORMAT`. Many programs store sRGB colours without saying so: only formats that say it count.
fn extended_format(number: u32) -> Option<(TexelFormat, Option<ColorSpace>)> {
    use TexelFormat as F;
    const SRGB: Option<ColorSpace> = Some(ColorSpace::Srgb);
    Some(match number {
        2 => (F::F32 { channels: 4 }, None),
        6 => (F::F32 { channels: 3 }, None),
        10 => (F::F16 { channels: 4 }, None),
        11 => (F::U16 { channels: 4 }, None),
        16 => (F::F32 { channels: 2 }, None),
        26 => (F::B10G11R11, None),
        28 => (F::U8 { channels: 4 }, None),
        29 => (F::U8 { channels: 4 }, SRGB),
        34 => (F::F16 { channels: 2 }, None),
        35 => (F::U16 { channels: 2 }, None),
        41 => (F::F32 { channels: 1 }, None),
        49 => (F::U8 { channels: 2 }, None),
        54 => (F::F16 { channels: 1 }, None),
        56 => (F::U16 { channels: 1 }, None),
        61 => (F::U8 { channels: 1 }, None),
        67 => (F::E5B9G9R9, None),
        71 => (F::Bc1, None),
        72 => (F::Bc1, SRGB),
        74 => (F::Bc2, None),
        75 => (F::Bc2, SRGB),
        77 => (F::Bc3, None),
        78 => (F::Bc3, SRGB),
        80 => (F::Bc4, None),
        83 => (F::Bc5, None),
        87 => (F::Bgr8 { channels: 4 }, None),
        88 => (F::Bgrx8, None),
        91 => (F::Bgr8 { channels: 4 }, SRGB),
        93 => (F::Bgrx8, SRGB),
        95 => (F::Bc6h { is_signed: false }, None),
        96 => (F::Bc6h { is_signed: true }, None),
        98 => (F::Bc7, None),
        99 => (F::Bc7, SRGB),
        _ => return None,
    })
}
