//! Pages, the stored rectangles of texels, and where they lie: within a tile's level, within a level, within a cluster.

use fantex_cover::{Cover, Group, level_count};

use crate::TexelFormat;
use crate::directory::ClusterEntry;

/// The name of one stored rectangle of texels: a tile at a level, or, where that is larger than [`PAGE`] texels, one of
/// the pages it is cut into (row-major).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PageId {
    /// Group index.
    pub group: u32,
    /// Detail level, 0 = finest.
    pub level: u32,
    /// Page column and row; `[0, 0]` for most tiles.
    pub page: [u32; 2],
}

impl std::fmt::Display for PageId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "group {}, level {}, page {},{}", self.group, self.level, self.page[0], self.page[1])
    }
}

/// A group's tile at a detail level, 0 = finest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileId {
    /// Group index.
    pub group: u32,
    /// Detail level.
    pub level: u32,
}

/// Longest side of a page in texels.
pub const PAGE: u32 = 256;

/// Columns and rows of pages that a tile level of `level_extent` texels is cut into.
pub fn page_grid(level_extent: [u32; 2]) -> [u32; 2] {
    level_extent.map(|n| n.div_ceil(PAGE))
}

/// Extent of one page in texels: [`PAGE`], except in the last column and row. `page` must lie in the [`page_grid`].
pub fn page_extent(level_extent: [u32; 2], page: [u32; 2]) -> [u32; 2] {
    let length = |i: usize| (level_extent[i] - page[i] * PAGE).min(PAGE);
    [length(0), length(1)]
}

/// Top left texel of a page within its tile level.
pub fn page_origin(page: [u32; 2]) -> [u32; 2] {
    page.map(|n| n * PAGE)
}

/// All pages of a group in the order in which the [`AssetWriter`](crate::AssetWriter) wants them: levels ascending, pages
/// row by row.
pub fn group_pages(group_index: u32, group: &Group) -> impl Iterator<Item = PageId> + use<> {
    let group_copy = *group;
    (0..group.level_count()).flat_map(move |level| {
        let [columns, rows] = page_grid(group_copy.level_extent(level));
        (0..rows)
            .flat_map(move |y| (0..columns).map(move |x| PageId { group: group_index, level, page: [x, y] }))
    })
}

/// Number of detail levels of the tile with the most.
pub fn cover_level_count(cover: &Cover) -> u32 {
    cover.groups.iter().map(Group::level_count).max().unwrap_or(0)
}

/// A page of a given level: its group and its row-major number within the tile's level. Ordered as pages are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct TilePlace {
    pub(crate) group: u32,
    pub(crate) page: u32,
}

/// Tile extent at a level, or `[0, 0]` beyond its last.
pub(crate) fn level_extent(extent: [u32; 2], level: u32) -> [u32; 2] {
    if level < level_count(extent) { fantex_cover::level_extent(extent, level) } else { [0, 0] }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct PageSize {
    extent: [u32; 2],
}

impl PageSize {
    /// `extent`: of the tile at level 0.
    pub(crate) fn new(extent: [u32; 2], level: u32) -> Self {
        Self { extent: level_extent(extent, level) }
    }

    /// Tile extent at this level; zero where it has no such level.
    pub(crate) fn extent(self) -> [u32; 2] {
        self.extent
    }

    pub(crate) fn page_count(self) -> u32 {
        let [columns, rows] = page_grid(self.extent);
        columns * rows
    }

    pub(crate) fn page(self, number: u32) -> [u32; 2] {
        let columns = page_grid(self.extent)[0].max(1);
        [number % columns, number / columns]
    }

    /// Row-major number of a page, if there is one.
    pub(crate) fn number(self, page: [u32; 2]) -> Option<u32> {
        let [columns, rows] = page_grid(self.extent);
        (page[0] < columns && page[1] < rows).then(|| page[1] * columns + page[0])
    }

    /// Extent of a page in texels.
    pub(crate) fn page_extent(self, number: u32) -> [u32; 2] {
        page_extent(self.extent, self.page(number))
    }

    /// 4x4 blocks of the level.
    pub(crate) fn blocks(self) -> u64 {
        u64::from(self.extent[0] / 4) * u64::from(self.extent[1] / 4)
    }

    /// 4x4 blocks of the pages before one.
    pub(crate) fn blocks_before(self, number: u32) -> u64 {
        let [column, row] = self.page(number).map(u64::from);
        let [width, height] = self.extent.map(|n| u64::from(n / 4));
        let side = u64::from(PAGE / 4);
        let rows_of_page = (height - (row * side).min(height)).min(side);
        row * side * width + column * side * rows_of_page
    }
}

/// Bytes of one page in all formats.
pub(crate) fn page_bytes(formats: &[TexelFormat], extent: [u32; 2]) -> Vec<usize> {
    formats.iter().map(|format| format.bytes(extent)).collect()
}

/// The pages of an unpacked cluster: channel after channel, in each the pages in order.
#[derive(Debug)]
pub struct ClusterPages {
    pub(crate) bytes: Vec<u8>,
    group: u32,
    /// 4x4 blocks of the groups before, for `group` and those after it, relative to the cluster's start (negative, modulo
    /// 2^32, for the first where the cluster starts within its tile).
    starts: Vec<u32>,
    /// All 4x4 blocks.
    blocks: usize,
    level: u32,
}

impl ClusterPages {
    /// `bytes`: unpacked, of the length that `entry` records, which has been checked against the cover.
    pub(crate) fn new(
        bytes: Vec<u8>,
        level: u32,
        entry: &ClusterEntry,
        formats: &[TexelFormat],
        extents: impl Fn(usize) -> [u32; 2],
    ) -> Self {
        let block_bytes: usize = formats.iter().map(|f| f.block_bytes()).sum();
        let blocks = bytes.len() / block_bytes;
        let group = entry.first.group;
        let first = PageSize::new(extents(group as usize), level);
        let mut start = (first.blocks_before(entry.first.page) as u32).wrapping_neg();
        let mut starts = vec![start];
        start = start.wrapping_add(first.blocks() as u32);
        // Wrapped (within the first tile) or past the end: no further group starts in this cluster.
        while (start as usize) < blocks {
            starts.push(start);
            start += PageSize::new(extents(group as usize + starts.len() - 1), level).blocks() as u32;
        }
        Self { bytes, group, starts, blocks, level }
    }

    /// The bytes of a page, if it lies in this cluster. `extent`: of its tile at level 0.
    pub(crate) fn page(
        &self,
        formats: &[TexelFormat],
        channel: usize,
        id: PageId,
        extent: [u32; 2],
    ) -> Option<&[u8]> {
        let size = PageSize::new(extent, self.level);
        let number = size.number(id.page).filter(|_| id.level == self.level)?;
        let start = *self.starts.get(id.group.checked_sub(self.group)? as usize)?;
        let block = start.wrapping_add(size.blocks_before(number) as u32) as usize;
        let extent = size.page_extent(number);
        if block + (extent[0] / 4 * (extent[1] / 4)) as usize > self.blocks {
            return None;
        }
        let before: usize = formats[..channel].iter().map(|f| f.block_bytes()).sum();
        let from = self.blocks * before + block * formats[channel].block_bytes();
        self.bytes.get(from..from + formats[channel].bytes(extent))
    }

    /// Bytes it takes in memory.
    pub fn memory_bytes(&self) -> usize {
        self.bytes.len() + 4 * self.starts.len()
    }
}

/// True for a rectangle of whole 4x4 blocks.
pub(crate) fn is_block_extent(extent: [u32; 2]) -> bool {
    extent.iter().all(|&n| n > 0 && n.is_multiple_of(4))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_before_sums_the_pages_before() {
        let size = PageSize::new([600, 772], 0);
        let mut sum = 0;
        for number in 0..size.page_count() {
            assert_eq!(size.blocks_before(number), sum);
            let [w, h] = size.page_extent(number);
            sum += u64::from(w / 4 * (h / 4));
            assert_eq!(size.number(size.page(number)), Some(number));
        }
        assert_eq!(size.blocks(), sum);
        assert_eq!(size.number([3, 0]), None);
    }
}
