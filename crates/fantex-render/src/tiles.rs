//! The seam between the texture function and whatever holds the tiles.

use fantex_store::{PageCache, PageTexels, RATIO_DENOMINATOR, Tile};
use fantex_texture::filter::TexelGrid;
use glam::Vec2;

/// Something that has the tiles of a cover: an asset's cache, or tiles in memory.
pub trait TileSource: Sync {
    /// A handle to one tile at one level.
    type Tile: TileTexels;

    /// The tile of a group at a level of [`Group::level_count`](fantex_cover::Group::level_count), or a coarser one in its place.
    fn tile(&self, channel: usize, group: u32, level: u32) -> Self::Tile;

    /// Mean linear RGBA of a group.
    fn mean(&self, channel: usize, group: u32) -> [f32; 4];
}

/// Texels of one tile at one level, **linear** RGBA.
pub trait TileTexels {
    /// Columns and rows.
    fn extent(&self) -> [u32; 2];

    /// Bilinear look-up at tile coordinates, clamped half a texel inside the tile.
    fn bilinear(&self, uv: Vec2) -> [f32; 4];

    /// The texel at a column and row inside the tile.
    fn texel(&self, x: u32, y: u32) -> [f32; 4];

    /// The stored texels, where they lie in one piece and are of a kind that can be looked up many at once. That differs from
    /// [`TileTexels::bilinear`] by at most 1e-5.
    fn grid(&self) -> Option<TexelGrid<'_>> {
        None
    }
}

impl TileSource for &PageCache {
    type Tile = Tile;

    fn tile(&self, channel: usize, group: u32, level: u32) -> Tile {
        PageCache::tile(self, channel, group, level)
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.asset().mean(channel, group)
    }
}

impl TileTexels for Tile {
    fn extent(&self) -> [u32; 2] {
        Tile::extent(self)
    }

    fn bilinear(&self, uv: Vec2) -> [f32; 4] {
        Tile::bilinear(self, uv)
    }

    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        Tile::texel(self, x, y)
    }

    fn grid(&self) -> Option<TexelGrid<'_>> {
        Some(match self.page_texels()? {
            PageTexels::Rgba8 { texels, srgb } => TexelGrid::Rgba8 { texels, is_srgb: srgb },
            PageTexels::RgRatio(texels) => TexelGrid::Rg16 { texels, one: RATIO_DENOMINATOR },
        })
    }
}
