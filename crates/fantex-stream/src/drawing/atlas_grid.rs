//! Layers of an atlas beside each other in one texture.
//!
//! The atlas' layers are the cells of a grid in one texture per channel: shaders then know of no layers, and look-ups are
//! those of a plain texture, the kind that software adapters do best.

use fantex_cover::Cover;
use fantex_store::PAGE;

use crate::{AtlasFormat, AtlasPlace, AtlasShape, TableEntry};

/// Where layers lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasGrid {
    side: u32,
    /// Columns and rows of layers, all of them used.
    pub cells: [u32; 2],
}

impl AtlasGrid {
    /// The grid of a shape in a texture of at most `longest` texels per side, as square as it comes. A shape that does not
    /// fit ([`AtlasGrid::fitting`]) gives one row.
    pub fn new(shape: AtlasShape, longest: u32) -> Self {
        let most = (longest / shape.side).max(1);
        let fits = |columns: &u32| shape.layers.is_multiple_of(*columns) && shape.layers / columns <= most;
        let columns = (1..=most.min(shape.layers)).filter(fits).min_by_key(|&c| c.abs_diff(shape.layers / c));
        let columns = columns.unwrap_or(shape.layers);
        Self { side: shape.side, cells: [columns, shape.layers / columns] }
    }

    /// The shape with as many of its layers as fill a grid in a texture of at most `longest` texels per side. (Entries of the
    /// page table can name places in 16384x16384 texels.)
    pub fn fitting(shape: AtlasShape, longest: u32) -> AtlasShape {
        let side = shape.side.min(longest);
        let most = (longest.min(16384) / side).max(1);
        let is_grid = |layers: &u32| (1..=most).any(|c| layers.is_multiple_of(c) && layers / c <= most);
        AtlasShape { side, layers: (1..=shape.layers).rev().find(is_grid).unwrap_or(1) }
    }

    /// The shape for a cover: all of a budget that [fits](Self::fitting), but no more than room for all pages.
    pub fn shape_for(cover: &Cover, budget_bytes: u64, formats: &[AtlasFormat], longest: u32) -> AtlasShape {
        let allowed = Self::fitting(AtlasShape::within(budget_bytes, formats), longest);
        let room = room_for(cover);
        let area = |side: u32| u64::from(side).pow(2);
        let side = [256, 512, 1024, 2048].into_iter().find(|&side| 16 * area(side) >= room).unwrap_or(4096);
        let mut shapes =
            (room.div_ceil(area(side))..=128).map(|layers| AtlasShape { side, layers: layers as u32 });
        let enough = shapes.find(|&shape| Self::fitting(shape, longest) == shape);
        enough.filter(|shape| shape.texels() < allowed.texels()).unwrap_or(allowed)
    }

    /// Columns and rows in texels.
    pub fn extent(self) -> [u32; 2] {
        self.cells.map(|n| n * self.side)
    }

    /// The first texel of a page.
    pub fn texel(self, place: AtlasPlace) -> [u32; 2] {
        let (column, row) = (u32::from(place.layer) % self.cells[0], u32::from(place.layer) / self.cells[0]);
        [column * self.side + u32::from(place.x), row * self.side + u32::from(place.y)]
    }

    /// An entry as the shader reads it: zero, or quarters of the first texel: column, row << 12, and 1 << 31.
    pub fn word(self, entry: TableEntry) -> u32 {
        entry.place().map_or(0, |place| {
            let [x, y] = self.texel(place);
            1 << 31 | (y / 4) << 12 | (x / 4)
        })
    }
}

/// Squares of [`PAGE`] texels per side in which sizes of pages may begin before the last one is full.
const BEGUN_SQUARES: u64 = 7;

/// Texels that an atlas must have so that all pages of a cover find room, in whatever order they come. With sides rounded up to powers
/// of two they lose nothing between them; of what is there, a bit must be left over, lest coarser levels are wanted.
fn room_for(cover: &Cover) -> u64 {
    let side = |texels: u32| match texels % PAGE {
        0 => texels.into(),
        rest => u64::from(texels - rest + rest.next_power_of_two()),
    };
    let levels = cover.groups.iter().flat_map(|tile| (0..tile.level_count()).map(|l| tile.level_extent(l)));
    let texels: u64 = levels.map(|[columns, rows]| side(columns) * side(rows)).sum();
    texels / 4 * 5 + BEGUN_SQUARES * u64::from(PAGE).pow(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_lie_beside_each_other() {
        for (side, layers) in [(256, 1), (1024, 4), (2048, 12), (4096, 16), (512, 31)] {
            let shape = AtlasShape { side, layers };
            let fitting = AtlasGrid::fitting(shape, 16384);
            assert_eq!(fitting, shape);
            let grid = AtlasGrid::new(shape, 16384);
            assert_eq!(grid.cells[0] * grid.cells[1], layers, "nothing is wasted");
            assert!(grid.extent().iter().all(|&n| n <= 16384));
            let mut places: Vec<_> =
                (0..layers as u16).map(|layer| grid.texel(AtlasPlace { layer, x: 0, y: 0 })).collect();
            places.dedup();
            assert_eq!(places.len(), layers as usize);
        }
    }

    #[test]
    fn what_is_no_grid_loses_layers() {
        let fitting = |side, layers, longest| {
            let AtlasShape { side, layers } = AtlasGrid::fitting(AtlasShape { side, layers }, longest);
            (side, layers)
        };
        assert_eq!(fitting(4096, 5, 16384), (4096, 4));
        assert_eq!(fitting(4096, 128, 16384), (4096, 16));
        assert_eq!(fitting(4096, 3, 8192), (4096, 2));
        assert_eq!(fitting(4096, 3, 2048), (2048, 1));
    }

    #[test]
    fn words_name_places() {
        let grid = AtlasGrid::new(AtlasShape { side: 1024, layers: 4 }, 16384);
        assert_eq!(grid.word(TableEntry::ABSENT), 0);
        let word = grid.word(TableEntry::at(AtlasPlace { layer: 3, x: 8, y: 256 }));
        assert_eq!(word, 1 << 31 | (1280 / 4) << 12 | (1032 / 4));
    }
}
