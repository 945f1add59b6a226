//! The atlas: the fixed room in graphics memory that resident pages share.

use fantex_store::TexelFormat;

/// Sides and number of the atlas' layers, the same for all channels. A layer is a square texture without mip levels; pages
/// of any level lie anywhere in it, at multiples of 4 texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasShape {
    /// Columns and rows of a layer in texels: a multiple of 256, at most 16384.
    pub side: u32,
    /// Layers, 1 to 128.
    pub layers: u32,
}

/// Where a page lies: its first texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct AtlasPlace {
    /// Layer.
    pub layer: u16,
    /// Column, a multiple of 4.
    pub x: u16,
    /// Row, a multiple of 4.
    pub y: u16,
}

/// How a channel's texels are handed over for the atlas. Values keep their encoding (sRGB stays sRGB).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AtlasFormat {
    /// 8 bytes per 4x4 block.
    Bc1,
    /// 8 bytes per 4x4 block.
    Bc4,
    /// 16 bytes per 4x4 block.
    Bc5,
    /// 16 bytes per 4x4 block.
    Bc7,
    /// One byte per texel.
    R8,
    /// Two bytes per texel.
    Rg8,
    /// Four bytes per texel.
    Rgba8,
    /// Eight bytes per texel, half floats. sRGB is decoded.
    Rgba16F,
}

impl AtlasFormat {
    /// The format of a channel's texels in an atlas on hardware that has block compression, or not.
    pub fn of(stored: TexelFormat, has_block_compression: bool) -> Self {
        match (stored, has_block_compression) {
            (TexelFormat::Bc1, true) => Self::Bc1,
            (TexelFormat::Bc4, true) => Self::Bc4,
            (TexelFormat::Bc5, true) => Self::Bc5,
            (TexelFormat::Bc7, true) => Self::Bc7,
            (TexelFormat::Bc4 | TexelFormat::R8, _) => Self::R8,
            (TexelFormat::Bc5 | TexelFormat::Rg8, _) => Self::Rg8,
            (TexelFormat::Bc1 | TexelFormat::Bc7 | TexelFormat::Rgba8, _) => Self::Rgba8,
            (TexelFormat::Rgba32F, _) => Self::Rgba16F,
        }
    }

    /// Bytes of 4x4 texels.
    pub const fn block_bytes(self) -> usize {
        match self {
            Self::Bc1 | Self::Bc4 => 8,
            Self::Bc5 | Self::Bc7 | Self::R8 => 16,
            Self::Rg8 => 32,
            Self::Rgba8 => 64,
            Self::Rgba16F => 128,
        }
    }

    /// Whether texels come in blocks of 4x4.
    pub const fn is_compressed(self) -> bool {
        matches!(self, Self::Bc1 | Self::Bc4 | Self::Bc5 | Self::Bc7)
    }
}

impl AtlasShape {
    /// The largest atlas of whole layers whose channels together take at most `budget_bytes`; at least one layer of 256x256
    /// texels, whatever the budget.
    pub fn within(budget_bytes: u64, formats: &[AtlasFormat]) -> Self {
        let block_bytes: usize = formats.iter().map(|f| f.block_bytes()).sum();
        let blocks = budget_bytes / block_bytes.max(1) as u64;
        // Few large layers: less is lost at their ends, and a page finds room more easily.
        let side =
            [4096, 2048, 1024, 512].into_iter().find(|side: &u32| u64::from(side / 4).pow(2) * 2 <= blocks);
        let side = side.unwrap_or(256);
        let layers = (blocks / u64::from(side / 4).pow(2)).clamp(1, 128) as u32;
        Self { side, layers }
    }

    /// Texels of all layers.
    pub fn texels(self) -> u64 {
        u64::from(self.side).pow(2) * u64::from(self.layers)
    }

    /// Bytes of all layers in the given formats.
    pub fn bytes(self, formats: &[AtlasFormat]) -> u64 {
        self.texels() / 16 * formats.iter().map(|f| f.block_bytes() as u64).sum::<u64>()
    }
}
