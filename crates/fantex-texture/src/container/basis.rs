//! KTX2 files with Basis Universal texels: ETC1S with their own packing, UASTC plain or packed by Zstandard.
//!
//! The crate `basisu` decodes them: Rust, equal to the C++ original bit by bit. Damaged files make it allocate what their headers ask
//! for, and panic now and then. So it is given a file whose sizes were checked and whose levels were unpacked here, and panics are
//! caught: that takes a program whose panics unwind.

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use fantex_base::{Error, Result, input, zstandard};

use super::{
    BASIS_LZ, KTX2_MAGIC, LEVEL_INDEX, Layout, TexelFormat, ZSTANDARD, impossible, is_multiplied, slice_at,
    too_short, u32_at, u64_at,
};
use crate::ColorSpace;

/// Words of the header behind the magic number.
const FORMAT: usize = KTX2_MAGIC.len();
const PACKING: usize = FORMAT + 32;
const DESCRIPTOR: usize = FORMAT + 36;
const KEYS: usize = FORMAT + 44;

const ETC1S: u8 = 163;
const UASTC: u8 = 166;
const SRGB: u8 = 2;

pub(super) fn is_basis(bytes: &[u8]) -> bool {
    u32_at(bytes, FORMAT).is_ok_and(|code| code == 0) || u32_at(bytes, PACKING).is_ok_and(|p| p == BASIS_LZ)
}

pub(super) struct Basis {
    /// Of the decoded texels.
    pub(super) layout: Layout,
    faces: u32,
    packing: u32,
    /// At least 1.
    levels: u32,
    is_etc1s: bool,
}

impl Basis {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self> {
        let word = |index: usize| u32_at(bytes, FORMAT + 4 * index);
        let [width, height, depth, layers, faces] = [word(2)?, word(3)?, word(4)?, word(5)?, word(6)?];
        let [levels, packing] = [word(7)?.max(1), word(8)?];
        let descriptor =
            slice_at(bytes, u32_at(bytes, DESCRIPTOR)?.into(), u32_at(bytes, DESCRIPTOR + 4)?.into())?;
        let Some(&[model, _, transfer]) = descriptor.get(12..15) else {
            return Err(Error::malformed("the description of its Basis Universal texels is too short"));
        };
        let is_etc1s = match (model, packing) {
            (ETC1S, BASIS_LZ) => true,
            (UASTC, 0 | ZSTANDARD) => false,
            _ => {
                return Err(Error::unsupported(format!(
                    "Basis Universal texels of kind {model} with packing {packing} are not read; ETC1S and UASTC are"
                )));
            }
        };
        if ![1, 6].contains(&faces) {
            return Err(impossible("the number of faces", faces));
        }
        if depth > 1 {
            return Err(impossible("the depth", depth));
        }
        if levels > 32 {
            return Err(impossible("the number of levels", levels));
        }
        let space = Some(if transfer == SRGB { ColorSpace::Srgb } else { ColorSpace::Linear });
        let images = u64::from(layers.max(1)) * u64::from(faces);
        let format = TexelFormat::U8 { channels: 4 };
        let (height, is_multiplied) = (height.max(1), is_multiplied(descriptor));
        let layout = Layout { format, width, height, images, space, is_multiplied };
        Ok(Self { layout, faces, packing, levels, is_etc1s })
    }

    /// RGBA bytes of so many images; the layout must have been checked against limits.
    pub(super) fn decode(&self, bytes: &[u8], most: usize) -> Result<Vec<Vec<u8>>> {
        let file = self.checked(bytes)?;
        let images = (self.layout.images as usize).min(most);
        let decoded = input::guarded(|| {
            let transcoder = Transcoder::new(&file)?;
            let image = |image: u32| {
                let (layer, face) = (image / self.faces, image % self.faces);
                transcoder.transcode_image(0, layer, face, TargetFormat::Rgba32, DecodeFlags::NONE)
            };
            (0..images as u32).map(image).collect::<std::result::Result<Vec<_>, _>>()
        });
        let damaged = |why: String| Error::malformed(format!("the Basis Universal texels are damaged{why}"));
        let decoded = decoded.ok_or_else(|| damaged(String::new()))?;
        let decoded = decoded.map_err(|error| damaged(format!(" ({error:?})")))?;
        let length = self.layout.image_bytes();
        match decoded.iter().all(|image| image.len() as u64 == length) {
            true => Ok(decoded),
            false => Err(damaged(String::new())),
        }
    }

    /// The file without what is not needed, all ranges within it, UASTC unpacked.
    fn checked(&self, bytes: &[u8]) -> Result<Vec<u8>> {
        // What is read of the header may lie before its end.
        slice_at(bytes, LEVEL_INDEX as u64, 24 * u64::from(self.levels))?;
        let mut file = bytes.to_vec();
        file[KEYS..KEYS + 8].fill(0);
        for level in 0..self.levels as usize {
            let entry = LEVEL_INDEX + 24 * level;
            slice_at(bytes, u64_at(bytes, entry)?, u64_at(bytes, entry + 8)?)?;
            // Only packed levels say how long they become, and here none are.
            let length = if self.is_etc1s { 0 } else { u64_at(bytes, entry + 8)? };
            file[entry + 16..entry + 24].copy_from_slice(&length.to_le_bytes());
        }
        if self.is_etc1s {
            return Ok(file);
        }
        let mut level =
            slice_at(bytes, u64_at(bytes, LEVEL_INDEX)?, u64_at(bytes, LEVEL_INDEX + 8)?)?.to_vec();
        let blocks = u64::from(self.layout.width.div_ceil(4)) * u64::from(self.layout.height.div_ceil(4));
        let needed = 16 * blocks * self.layout.images;
        if self.packing == ZSTANDARD {
            let unpacked = zstandard::unpack(&level, needed as usize);
            level = unpacked.ok_or_else(|| Error::malformed("the packed texels are damaged"))?;
        }
        if (level.len() as u64) < needed {
            return Err(too_short(needed, level.len()));
        }
        // One level, plain, at the end.
        file[FORMAT + 28..FORMAT + 36].copy_from_slice(&[1, 0, 0, 0, 0, 0, 0, 0]);
        let entry = [file.len() as u64, needed, needed].map(u64::to_le_bytes);
        file[LEVEL_INDEX..LEVEL_INDEX + 24].copy_from_slice(entry.as_flattened());
        file.extend_from_slice(&level[..needed as usize]);
        Ok(file)
    }
}
