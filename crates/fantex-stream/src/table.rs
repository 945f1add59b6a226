//! The page table: which pages are resident, and where.

use fantex_cover::Cover;
use fantex_store::{PageId, page_grid};

use crate::AtlasPlace;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_keep_places() {
        assert_eq!(TableEntry::ABSENT.place(), None);
        for place in [
            AtlasPlace { layer: 0, x: 0, y: 0 },
            AtlasPlace { layer: 127, x: 16380, y: 4 },
            AtlasPlace { layer: 5, x: 4, y: 16380 },
        ] {
            assert_eq!(TableEntry::at(place).place(), Some(place));
        }
    }
}
