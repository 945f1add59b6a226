//! Pages: the stored rectangles of texels.

use fantex_cover::{Cover, Group};

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

/// Longest side of a page in texels.
pub const PAGE: u32 = 256;

/// Columns and rows of pages that a tile level of `level_extent` texels is cut into.
pub fn page_grid(level_extent: [u32; 2]) -> [u32; 2] {
    level_extent.map(|n| n.div_ceil(PAGE))
}

/// Extent of one page in texels: [`PAGE`], except in the last column and row. `page` must lie in the [`page_grid`].
pub fn page_extent(level_extent: [u32; 2], page: [u32; 2]) -> [u32; 2] {
    [0, 1].map(|i| (level_extent[i] - page[i] * PAGE).min(PAGE))
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
