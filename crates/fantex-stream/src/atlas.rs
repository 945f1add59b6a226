//! The atlas, the fixed room in graphics memory that resident pages share; the page table; what changes of both in a frame.

use fantex_cover::Cover;
use fantex_store::{PageId, TexelFormat, page_grid};

use crate::{Parcel, ParcelTexels};

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

// The page table: which pages are resident, and where.

/// Where a page is, in one word: zero where it is not resident, else
/// `1 << 31 | layer << 24 (7 bits) | (y / 4) << 12 | x / 4`. (7 bits of layers: at most 128 layers are used.)
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct TableEntry(pub u32);

impl TableEntry {
    /// Not resident.
    pub const ABSENT: Self = Self(0);

    /// Resident at a place.
    pub fn at(place: AtlasPlace) -> Self {
        let AtlasPlace { layer, x, y } = place;
        Self(1 << 31 | u32::from(layer) << 24 | u32::from(y / 4) << 12 | u32::from(x / 4))
    }

    /// Where it is, if it is resident.
    pub fn place(self) -> Option<AtlasPlace> {
        let Self(bits) = self;
        (bits >> 31 == 1).then_some(AtlasPlace {
            layer: (bits >> 24 & 0x7F) as u16,
            x: (bits & 0xFFF) as u16 * 4,
            y: (bits >> 12 & 0xFFF) as u16 * 4,
        })
    }
}

/// The numbering of all pages of a cover: group by group, in each level by level from the finest, in each row by row. Group
/// `g`'s entries start at `first(g)`; those of the levels after follow from the tile's extent alone.
#[derive(Clone, Debug)]
pub struct PageTable {
    /// Per group the index of its first page, and the number of all pages.
    firsts: Vec<u32>,
}

impl PageTable {
    /// The numbering for a cover. Panics where there are more than 2^32 pages (a cover of 2^48 texels).
    pub fn new(cover: &Cover) -> Self {
        let mut firsts = Vec::with_capacity(cover.groups.len() + 1);
        let mut next = 0u64;
        for group in &cover.groups {
            firsts.push(next);
            next += (0..group.level_count()).map(|level| pages(group.level_extent(level))).sum::<u64>();
        }
        firsts.push(next);
        assert!(next <= u64::from(u32::MAX), "{next} pages are more than a page table can number");
        Self { firsts: firsts.into_iter().map(|first| first as u32).collect() }
    }

    /// Number of pages.
    pub fn len(&self) -> usize {
        self.firsts.last().map_or(0, |&count| count as usize)
    }

    /// Whether there are no pages.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Index of a group's first page (level 0, page 0).
    pub fn first(&self, group: u32) -> u32 {
        self.firsts[group as usize]
    }

    /// Index of a page. `cover` is that of [`PageTable::new`]; the page must exist.
    pub fn index(&self, cover: &Cover, page: PageId) -> u32 {
        let group = &cover.groups[page.group as usize];
        let before: u64 = (0..page.level).map(|level| pages(group.level_extent(level))).sum();
        let columns = page_grid(group.level_extent(page.level))[0];
        self.first(page.group) + before as u32 + page.page[1] * columns + page.page[0]
    }
}

fn pages(level_extent: [u32; 2]) -> u64 {
    let [columns, rows] = page_grid(level_extent);
    u64::from(columns) * u64::from(rows)
}

// What the owner of the atlas does in one frame.

/// A parcel to copy into the atlas.
#[derive(Debug)]
pub struct ParcelUpload {
    /// Which.
    pub parcel: Parcel,
    /// Where to.
    pub place: AtlasPlace,
    /// Its texels, per channel.
    pub texels: ParcelTexels,
}

/// An entry of the page table that has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableChange {
    /// Index in the [`PageTable`](crate::PageTable).
    pub index: u32,
    /// Its new value.
    pub entry: TableEntry,
}

/// What to do before the next picture, in this order: uploads, then entries. After that no entry names a place that holds
/// anything but its page.
#[derive(Debug, Default)]
pub struct FrameChanges {
    /// Parcels that have arrived. Places may be those of others that left in the same frame.
    pub uploads: Vec<ParcelUpload>,
    /// Entries, ascending by index, each at most once.
    pub entries: Vec<TableChange>,
}
