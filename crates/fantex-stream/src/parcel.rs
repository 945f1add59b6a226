//! Parcels: what is read, uploaded, placed and evicted as one.
//!
//! A page is the unit of a large tile. The coarse levels of small tiles are too small for that: a cover of half a million
//! tiles, seen from afar, is hundreds of thousands of pages of 4x4 to 24x24 texels, each of which costs as much as
//! a large one to ask for, to place and to copy. So tiles that follow each other in the cover, which are neighbours on the
//! surface, are bundled: the coarsest level of 32 tiles is one parcel, the next one that of 16, the one after that of four
//! ([`BUNDLE_TILES`]); in its rectangle every tile's level has its place ([`ParcelLayout`]).
//!
//! A slope needs finer levels than its surroundings, so few neighbours need the finest level of a bundle: bundles of sixteen at all of
//! four levels took 2.7 times the texels of single tiles, these take 1.5 times (a landscape of 459 k tiles; `docs/benchmarks.md`).

use std::fmt;
use std::ops::Range;

use fantex_cover::{Cover, Group};
use fantex_store::PageId;

/// Per step, which counts levels from the coarsest, the number of tiles whose levels are one parcel: groups `n b` to `n b + n - 1`
/// are bundle `b` of that step.
pub const BUNDLE_TILES: [u32; SHARED_LEVELS as usize] = [32, 16, 4];

/// Levels of a tile, counted from the coarsest, that are bundled with those of other tiles. Those of the last step have sides of at
/// most 24 texels.
pub const SHARED_LEVELS: u32 = 3;

/// Groups whose shared parcels are theirs alone: those of a bundle of the first step.
pub(crate) const FAMILY: u32 = BUNDLE_TILES[0];

/// What is read, uploaded, placed and evicted as one. Ordered with bundles first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Parcel {
    /// A coarse level of all tiles of a bundle that have it.
    Bundle {
        /// Number of the bundle among those of the step: see [`BUNDLE_TILES`].
        bundle: u32,
        /// Levels from the coarsest (0) of each tile.
        step: u32,
    },
    /// A page of one tile, of a level that tiles do not share.
    Page(PageId),
}

impl Parcel {
    /// The parcel that brings a page of a group.
    pub fn of(group: &Group, page: PageId) -> Self {
        Self::with_levels(group.level_count(), page)
    }

    /// The parcel that brings a page of a tile with `level_count` levels.
    pub(crate) fn with_levels(level_count: u32, page: PageId) -> Self {
        let step = level_count - 1 - page.level;
        if step < SHARED_LEVELS { Self::bundle_of(page.group, step) } else { Self::Page(page) }
    }

    /// The parcel that brings a group's level of a step.
    #[inline]
    pub(crate) fn bundle_of(group: u32, step: u32) -> Self {
        Self::Bundle { bundle: group / BUNDLE_TILES[step as usize], step }
    }

    /// The bundle over a parcel: that of the next coarser level; for a tile's own pages, of whichever level, the finest of its
    /// bundles.
    #[inline]
    pub(crate) fn bundle_over(self) -> Option<Self> {
        Some(match self {
            Self::Bundle { bundle, step } => {
                Self::bundle_of(bundle * BUNDLE_TILES[step as usize], step.checked_sub(1)?)
            }
            Self::Page(page) => Self::bundle_of(page.group, SHARED_LEVELS - 1),
        })
    }

    /// Tiles that it has something of, at most.
    pub(crate) fn max_tiles(self) -> u32 {
        match self {
            Self::Bundle { step, .. } => BUNDLE_TILES[step as usize],
            Self::Page(_) => 1,
        }
    }

    /// Its pages, ascending by group. The parcel must be one of the cover's.
    pub fn pages(self, cover: &Cover) -> impl Iterator<Item = PageId> {
        let (own, shared) = match self {
            Self::Bundle { bundle, step } => (None, Some((bundle, step))),
            Self::Page(page) => (Some(page), None),
        };
        let groups = shared.map(|(bundle, step)| groups_of(bundle, step, cover.groups.len() as u32));
        let shared = groups.into_iter().flatten().filter_map(move |group| {
            let last = cover.groups[group as usize].level_count() - 1;
            let level = last.checked_sub(shared?.1)?;
            Some(PageId { group, level, page: [0, 0] })
        });
        own.into_iter().chain(shared)
    }

    /// Its pages, and where they lie in it. The parcel must be one of the cover's.
    pub fn layout(self, cover: &Cover) -> ParcelLayout {
        match self {
            Self::Bundle { bundle, step } => {
                ParcelLayout::new(slots(bundle, step, cover.groups.len() as u32, |group| {
                    let tile = &cover.groups[group as usize];
                    let level = (tile.level_count() - 1).checked_sub(step)?;
                    Some((level, tile.level_extent(level)))
                }))
            }
            Self::Page(page) => {
                let tile = &cover.groups[page.group as usize];
                let extent = fantex_store::page_extent(tile.level_extent(page.level), page.page);
                ParcelLayout { extent, slots: vec![Slot { page, at: [0, 0], extent }] }
            }
        }
    }
}

impl From<PageId> for Parcel {
    /// Of a level that tiles do not share.
    fn from(page: PageId) -> Self {
        Self::Page(page)
    }
}

impl fmt::Display for Parcel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bundle { bundle, step } => {
                let tiles = BUNDLE_TILES.get(*step as usize).copied().unwrap_or(1);
                let first = u64::from(*bundle) * u64::from(tiles);
                let last = first + u64::from(tiles) - 1;
                write!(f, "tiles {first} to {last}, level {step} from the coarsest")
            }
            Self::Page(page) => page.fmt(f),
        }
    }
}

#[inline]
pub(crate) fn groups_of(bundle: u32, step: u32, group_count: u32) -> Range<u32> {
    let tiles = BUNDLE_TILES.get(step as usize).copied().unwrap_or(0);
    let first = bundle.saturating_mul(tiles).min(group_count);
    first..group_count.min(first.saturating_add(tiles))
}

/// A page within a parcel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// Which.
    pub page: PageId,
    /// Column and row of its first texel in the parcel, multiples of 4.
    pub at: [u32; 2],
    /// Columns and rows.
    pub extent: [u32; 2],
}

/// A parcel's rectangle and the pages in it: rows of tiles, the highest first, each row as high as its highest tile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParcelLayout {
    /// Columns and rows in texels; zero where no tile has the level.
    pub extent: [u32; 2],
    /// In the order of the rows.
    pub slots: Vec<Slot>,
}

impl ParcelLayout {
    /// Of [`slots`], in the width that leaves least between them.
    pub(crate) fn new(mut slots: Vec<Slot>) -> Self {
        // The widths of 1, 2, ... of the highest pages side by side.
        let mut widths = vec![0];
        for slot in slots.iter().take(MAX_COLUMNS) {
            widths.push(widths[widths.len() - 1] + slot.extent[0]);
        }
        let max_width = slots.iter().map(|slot| slot.extent[0]).max().unwrap_or(0);
        widths.retain(|&width| width >= max_width);
        let cost = |&width: &u32| {
            let [columns, rows] = place(&mut slots, width);
            (columns.max(rows) > MAX_SIDE, columns * rows, columns.max(rows))
        };
        let width = widths.into_iter().min_by_key(cost).unwrap_or(max_width);
        Self { extent: place(&mut slots, width), slots }
    }
}

/// Columns and rows of a bundle's rectangle, where that is possible: strips are hard to place.
const MAX_SIDE: u32 = 64;

/// Tiles side by side, at most.
const MAX_COLUMNS: usize = 8;

/// A bundle's pages, the highest first, not placed yet. `level`: level and extent that a group contributes, if any.
pub(crate) fn slots(
    bundle: u32,
    step: u32,
    group_count: u32,
    level: impl Fn(u32) -> Option<(u32, [u32; 2])>,
) -> Vec<Slot> {
    let slot = |group| {
        let (level, extent) = level(group)?;
        Some(Slot { page: PageId { group, level, page: [0, 0] }, at: [0, 0], extent })
    };
    let mut slots: Vec<Slot> = groups_of(bundle, step, group_count).filter_map(slot).collect();
    slots.sort_unstable_by_key(|slot| (std::cmp::Reverse([slot.extent[1], slot.extent[0]]), slot.page.group));
    slots
}

/// Places pages in rows of at most `width` columns; returns the rectangle that they take.
fn place(slots: &mut [Slot], width: u32) -> [u32; 2] {
    let ([mut x, mut y], mut extent) = ([0, 0], [0, 0]);
    for slot in slots {
        if x + slot.extent[0] > width {
            (x, y) = (0, extent[1]);
        }
        slot.at = [x, y];
        x += slot.extent[0];
        extent = [extent[0].max(x), extent[1].max(y + slot.extent[1])];
    }
    extent
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_hold_all_tiles_apart() {
        let mut random = fantex_base::Random::new(1);
        let mut next = |n: u32| random.below(u64::from(n)) as u32;
        let (mut used, mut taken) = (0, 0);
        for _ in 0..500 {
            let step = next(SHARED_LEVELS);
            let sides = [[4, 4], [8, 12], [12, 24]][step as usize];
            let extents: Vec<[u32; 2]> =
                (0..40).map(|_| [0, 1].map(|_| sides[0] + 4 * next((sides[1] - sides[0]) / 4 + 1))).collect();
            let level = |group: u32| (group % 7 != 3).then(|| (2, extents[group as usize]));
            let bundle = next(40u32.div_ceil(BUNDLE_TILES[step as usize]));
            let layout = ParcelLayout::new(slots(bundle, step, 40, level));
            assert!(layout.extent.iter().all(|&n| n <= MAX_SIDE), "{:?}", layout.extent);
            let mut cells = std::collections::HashSet::new();
            for slot in &layout.slots {
                assert_eq!(slot.extent, extents[slot.page.group as usize]);
                for x in slot.at[0]..slot.at[0] + slot.extent[0] {
                    for y in slot.at[1]..slot.at[1] + slot.extent[1] {
                        assert!(x < layout.extent[0] && y < layout.extent[1] && cells.insert([x, y]));
                    }
                }
            }
            assert_eq!(layout.slots.len(), groups_of(bundle, step, 40).filter(|g| g % 7 != 3).count());
            used += cells.len();
            taken += (layout.extent[0] * layout.extent[1]) as usize;
        }
        assert!(used * 100 > taken * 88, "{used} of {taken}");
    }
}
