//! The pages that many look-ups are read from, each fetched once.

use fantex_texture::filter::TexelGrid;
use glam::{Vec2, Vec4};

use super::{TileSource, TileTexels};
use crate::{PAGE, TileId};

/// What a tile's look-ups are read from.
struct PageName {
    tile: TileId,
    /// Columns and rows of the whole level.
    extent: [u32; 2],
    /// None for look-ups across the border of pages.
    page: Option<[u32; 2]>,
}

/// Pages of a batch, found again by their names. A name that displaces another in the table is only fetched twice.
pub(super) struct Pages<'s, S: TileSource> {
    source: &'s S,
    channels: &'s [usize],
    names: Vec<PageName>,
    /// Of every page those of all channels.
    tiles: Vec<S::Tile>,
    /// One more than the number of the last page with this remainder; 0 without.
    table: [u32; 256],
}

impl<'s, S: TileSource> Pages<'s, S> {
    pub(super) fn new(source: &'s S, channels: &'s [usize]) -> Self {
        let tiles = Vec::with_capacity(32 * channels.len());
        Self { source, channels, names: Vec::with_capacity(32), tiles, table: [0; 256] }
    }

    /// The number of a page of a tile's level that has so many columns and rows.
    #[inline]
    pub(super) fn number(&mut self, tile: TileId, extent: [u32; 2], page: Option<[u32; 2]>) -> u32 {
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
        for &channel in self.channels {
            self.tiles.push(match page {
                Some(page) => self.source.tile_at_page(channel, tile, page),
                None => self.source.tile(channel, tile),
            });
        }
        self.names.push(PageName { tile, extent, page });
        self.table[slot] = self.names.len() as u32;
        self.names.len() as u32 - 1
    }

    fn tile(&self, page: u32, channel: usize) -> &S::Tile {
        &self.tiles[page as usize * self.channels.len() + channel]
    }

    /// What vectors can read of a page, in one of the channels. (A tile that stands in for a damaged one has another extent.)
    #[inline]
    pub(super) fn grid(&self, page: u32, channel: usize) -> Option<TexelGrid<'_>> {
        let tile = self.tile(page, channel);
        tile.grid().filter(|_| tile.extent() == self.names[page as usize].extent)
    }

    /// A look-up that vectors cannot make.
    pub(super) fn bilinear(&self, page: u32, channel: usize, uv: Vec2) -> [f32; 4] {
        self.tile(page, channel).bilinear(uv)
    }

    /// The mean of a group in one of the channels.
    pub(super) fn mean(&self, channel: usize, group: u32) -> Vec4 {
        Vec4::from_array(self.source.mean(self.channels[channel], group))
    }
}
