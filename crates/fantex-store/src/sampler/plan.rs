//! What many points read: taps, levels, probes in pages.

use fantex_cover::{Tap, TriangleTiles};
use fantex_mesh::SurfacePoint;
use glam::Vec2;

use super::levels::{ChosenLevels, LevelBlock};
use super::{Footprint, Sampler, TileSource};
use crate::cache::TexelQuad;
use crate::{PAGE, TileId, page_extent};

/// A tile's share in a point's values.
pub(super) struct Entry {
    pub(super) point: u32,
    pub(super) group: u32,
    pub(super) weight: f32,
}

/// A bilinear look-up in a tile.
pub(super) struct Probe {
    pub(super) entry: u32,
    /// Which one of the batch's pages.
    pub(super) page: u32,
    /// Tile coordinates, and texels from the page's corner.
    pub(super) uv: Vec2,
    pub(super) place: Vec2,
    pub(super) share: f32,
}

/// What an entry takes from the mean of its group.
pub(super) struct MeanShare {
    pub(super) entry: u32,
    pub(super) share: f32,
}

/// What a tile's look-ups are read from.
pub(super) struct PageName {
    pub(super) tile: TileId,
    /// Columns and rows of the whole level.
    pub(super) extent: [u32; 2],
    /// None for look-ups across the border of pages.
    pub(super) page: Option<[u32; 2]>,
    /// Columns and rows of the page, and its upper left corner in texels of the level; those of the level without a page.
    pub(super) page_extent: [u32; 2],
    corner: Vec2,
}

impl PageName {
    fn new(tile: TileId, extent: [u32; 2], page: Option<[u32; 2]>) -> Self {
        Self {
            tile,
            extent,
            page,
            page_extent: page.map_or(extent, |page| page_extent(extent, page)),
            corner: page.map_or(Vec2::ZERO, |page| Vec2::from(page.map(|n| (n * PAGE) as f32))),
        }
    }
}

/// Pages of a batch, found again by their names. A name that displaces another in the table is only fetched twice.
pub(super) struct PageNames {
    pub(super) names: Vec<PageName>,
    /// One more than the index of the last page with this remainder; 0 without.
    table: [u32; 256],
    /// Of levels of one page that were met last, by the level's remainder: points beside each other mostly read the same two.
    recent: [Recent; 2],
}

/// A tile, in one number as that is compared at once, and the index of its page.
#[derive(Clone, Copy)]
struct Recent {
    tile: u64,
    index: u32,
}

impl Recent {
    /// No tile has such a level.
    const NONE: Self = Self { tile: u64::MAX, index: 0 };
}

impl PageNames {
    /// The page that a look-up is read from, and the place in it.
    #[inline]
    fn find(&mut self, tile: TileId, extent: [u32; 2], uv: Vec2) -> (u32, Vec2) {
        let place = uv * Vec2::from(extent.map(|n| n as f32));
        if extent[0].max(extent[1]) <= PAGE {
            let remainder = (tile.level % 2) as usize;
            let number = u64::from(tile.group) << 32 | u64::from(tile.level);
            if self.recent[remainder].tile != number {
                let index = self.index(tile, extent, Some([0; 2]));
                self.recent[remainder] = Recent { tile: number, index };
            }
            return (self.recent[remainder].index, place);
        }
        let index = self.index(tile, extent, TexelQuad::new(uv, extent).in_one_page().0);
        (index, place - self.names[index as usize].corner)
    }

    #[inline]
    fn index(&mut self, tile: TileId, extent: [u32; 2], page: Option<[u32; 2]>) -> u32 {
        // Odd, so that the levels of neighbouring groups spread.
        let [column, row] = page.unwrap_or([PAGE; 2]);
        let place = tile.level + 11 * column + 101 * row;
        let slot = (tile.group.wrapping_mul(37).wrapping_add(place) % 256) as usize;
        if let Some(known) = self.table[slot].checked_sub(1)
            && let Some(name) = self.names.get(known as usize)
            && (name.tile, name.page) == (tile, page)
        {
            return known;
        }
        self.names.push(PageName::new(tile, extent, page));
        self.table[slot] = self.names.len() as u32;
        self.names.len() as u32 - 1
    }
}

/// What many points read.
pub(super) struct Plan {
    pub(super) entries: Vec<Entry>,
    pub(super) probes: Vec<Probe>,
    pub(super) means: Vec<MeanShare>,
    pub(super) pages: PageNames,
}

impl Plan {
    pub(super) fn new<S: TileSource>(
        sampler: &Sampler<S>,
        count: usize,
        point: impl Fn(usize) -> (SurfacePoint, Footprint),
    ) -> Self {
        let (cover, mesh) = (sampler.cover(), sampler.mesh());
        let mut plan = Self {
            entries: Vec::with_capacity(count + count / 4),
            probes: Vec::with_capacity(2 * count),
            means: Vec::new(),
            pages: PageNames { names: Vec::with_capacity(64), table: [0; 256], recent: [Recent::NONE; 2] },
        };
        let (mut levels, mut places) = (LevelBlock::new(), Vec::new());
        // Where the triangle of several points in a row lies in its tiles.
        let mut of_triangle: Option<(u32, TriangleTiles)> = None;
        for index in 0..count {
            let (at, footprint) = point(index);
            let mut add = |tap: Tap| {
                if levels.is_full() {
                    plan.add_probes(sampler, &mut levels, &mut places);
                }
                levels.push(&cover.groups[tap.group as usize], tap.steps(footprint.lambda_steps));
                places.push(tap.uv);
                plan.entries.push(Entry { point: index as u32, group: tap.group, weight: tap.weight });
            };
            let is_same = |other: u32| other == at.triangle;
            if !of_triangle.as_ref().is_some_and(|(known, _)| is_same(*known)) {
                let goes_on = index + 1 < count && is_same(point(index + 1).0.triangle);
                let tiles = || (at.triangle, cover.triangle_tiles(mesh, at.triangle));
                of_triangle = goes_on.then(tiles);
            }
            match &of_triangle {
                Some((_, tiles)) => tiles.taps(at.lambda).for_each(&mut add),
                None => sampler.taps(at).for_each(&mut add),
            }
        }
        plan.add_probes(sampler, &mut levels, &mut places);
        plan
    }

    /// Adds what the last entries read, those of the block, at their `places` in tile coordinates.
    fn add_probes<S: TileSource>(
        &mut self,
        sampler: &Sampler<S>,
        levels: &mut LevelBlock,
        places: &mut Vec<Vec2>,
    ) {
        levels.choose(&sampler.filter);
        let first = self.entries.len() - levels.len();
        for (index, &uv) in places.iter().enumerate() {
            let entry = (first + index) as u32;
            let chosen = levels.chosen(index);
            let group = self.entries[first + index].group;
            let share = chosen.coarse_share;
            if share != 1.0 {
                let tile = TileId { group, level: chosen.fine };
                self.add_level(entry, tile, chosen.fine_extent, 1.0 - share, uv, &chosen);
            }
            if share != 0.0 {
                let tile = TileId { group, level: chosen.fine + 1 };
                match chosen.coarse_extent {
                    Some(extent) => self.add_level(entry, tile, extent, share, uv, &chosen),
                    None => self.means.push(MeanShare { entry, share }),
                }
            }
        }
        levels.clear();
        places.clear();
    }

    /// Adds what an entry reads of a level.
    #[inline(always)]
    fn add_level(
        &mut self,
        entry: u32,
        tile: TileId,
        extent: [u32; 2],
        share: f32,
        uv: Vec2,
        &ChosenLevels { probes, span, .. }: &ChosenLevels,
    ) {
        let mut add = |uv: Vec2, share: f32| {
            let (page, place) = self.pages.find(tile, extent, uv);
            self.probes.push(Probe { entry, page, uv, place, share });
        };
        if probes == 1 {
            // As the loop below has it.
            return add(uv, share);
        }
        let share = share / probes as f32;
        for probe in 0..probes {
            let along = (probe as f32 + 0.5) / probes as f32 - 0.5;
            add(uv + span * along, share);
        }
    }
}
