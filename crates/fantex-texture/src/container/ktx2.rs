//! The header of KTX2 files (Khronos, "KTX File Format Specification", version 2.0).

use std::borrow::Cow;

use super::texel_format::TexelFormat;
use super::{ContainerFault, Layout, slice_at, u32_at};
use crate::ColorSpace;

pub(super) const MAGIC: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";
/// Where the index of the levels begins; the finest comes first.
const LEVEL_INDEX: usize = 80;
const ZSTANDARD: u32 = 2;
const BASIS_LZ: u32 = 1;

/// What is needed of a header.
#[derive(Clone, Copy, Debug)]
pub(super) struct Header {
    pub(super) layout: Layout,
    packing: u32,
    /// Of the finest level.
    offset: u64,
    packed_bytes: u64,
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, ContainerFault> {
        let word = |index: usize| u32_at(bytes, MAGIC.len() + 4 * index);
        let wide = |offset: usize| {
            Ok(u64::from(u32_at(bytes, offset)?) | u64::from(u32_at(bytes, offset + 4)?) << 32)
        };
        let [code, width, height, depth] = [word(0)?, word(2)?, word(3)?, word(4)?];
        let [layers, faces, packing] = [word(5)?, word(6)?, word(8)?];
        if packing == BASIS_LZ || code == 0 {
            return Err(ContainerFault::Basis);
        }
        if ![0, ZSTANDARD].contains(&packing) {
            return Err(ContainerFault::Packing { method: packing });
        }
        if ![1, 6].contains(&faces) {
            return Err(ContainerFault::Header { field: "the number of faces", value: u64::from(faces) });
        }
        let (format, space) = texel_format(code)
            .ok_or_else(|| ContainerFault::TexelFormat { name: format!("{code} (VkFormat)") })?;
        let images = [layers, faces, depth].map(|count| u64::from(count.max(1)));
        let images = images.into_iter().fold(1_u64, u64::saturating_mul);
        Ok(Self {
            layout: Layout { format, width, height: height.max(1), images, space: Some(space) },
            packing,
            offset: wide(LEVEL_INDEX)?,
            packed_bytes: wide(LEVEL_INDEX + 8)?,
        })
    }

    /// The unpacked bytes of all images of the finest level; the layout must have been checked against limits.
    pub(super) fn level<'a>(&self, bytes: &'a [u8]) -> Result<Cow<'a, [u8]>, ContainerFault> {
        let packed = slice_at(bytes, self.offset, self.packed_bytes)?;
        let needed = self.layout.image_bytes() * self.layout.images;
        let level = if self.packing == ZSTANDARD {
            let unpacked = zstd::bulk::decompress(packed, needed as usize);
            Cow::Owned(unpacked.map_err(|_| ContainerFault::Damaged)?)
        } else {
            Cow::Borrowed(packed)
        };
        if (level.len() as u64) < needed {
            return Err(ContainerFault::TooShort { needed, got: level.len() as u64 });
        }
        Ok(level)
    }
}

/// By the numbers of Vulkan's `VkFormat`.
fn texel_format(code: u32) -> Option<(TexelFormat, ColorSpace)> {
    use ColorSpace::{Linear, Srgb};
    use TexelFormat as F;
    Some(match code {
        9 => (F::U8 { channels: 1 }, Linear),
        15 => (F::U8 { channels: 1 }, Srgb),
        16 => (F::U8 { channels: 2 }, Linear),
        22 => (F::U8 { channels: 2 }, Srgb),
        23 => (F::U8 { channels: 3 }, Linear),
        29 => (F::U8 { channels: 3 }, Srgb),
        30 => (F::Bgr8 { channels: 3 }, Linear),
        36 => (F::Bgr8 { channels: 3 }, Srgb),
        37 => (F::U8 { channels: 4 }, Linear),
        43 => (F::U8 { channels: 4 }, Srgb),
        44 => (F::Bgr8 { channels: 4 }, Linear),
        50 => (F::Bgr8 { channels: 4 }, Srgb),
        70 => (F::U16 { channels: 1 }, Linear),
        77 => (F::U16 { channels: 2 }, Linear),
        84 => (F::U16 { channels: 3 }, Linear),
        91 => (F::U16 { channels: 4 }, Linear),
        76 => (F::F16 { channels: 1 }, Linear),
        83 => (F::F16 { channels: 2 }, Linear),
        90 => (F::F16 { channels: 3 }, Linear),
        97 => (F::F16 { channels: 4 }, Linear),
        100 => (F::F32 { channels: 1 }, Linear),
        103 => (F::F32 { channels: 2 }, Linear),
        106 => (F::F32 { channels: 3 }, Linear),
        109 => (F::F32 { channels: 4 }, Linear),
        122 => (F::B10G11R11, Linear),
        123 => (F::E5B9G9R9, Linear),
        131 | 133 => (F::Bc1, Linear),
        132 | 134 => (F::Bc1, Srgb),
        135 => (F::Bc2, Linear),
        136 => (F::Bc2, Srgb),
        137 => (F::Bc3, Linear),
        138 => (F::Bc3, Srgb),
        139 => (F::Bc4, Linear),
        141 => (F::Bc5, Linear),
        143 => (F::Bc6h { is_signed: false }, Linear),
        144 => (F::Bc6h { is_signed: true }, Linear),
        145 => (F::Bc7, Linear),
        146 => (F::Bc7, Srgb),
        _ => return None,
    })
}
