//! Blocks of large tiles.
//!
//! What works on a whole tile, such as a bake, cuts longer ones into blocks with a margin, so that a texel's value does not depend on
//! the cut, and memory does not grow with the tile. From [`SHARED_LEVEL`] on the tile is whole again.

use crate::{TexelBlock, level_extent};

/// Longest side of a block, texels of level 0. Tiles longer than this have sides that are multiples of 32, so that blocks halve exactly
/// down to [`SHARED_LEVEL`].
pub const MAX_BLOCK_SIDE: u32 = 1024;

/// The finest level at which a block is smaller than a page.
pub const SHARED_LEVEL: u32 = 3;

/// The margin of a block, texels of level 0: two texels of [`SHARED_LEVEL`], and four of the level before, so that 4x4 blocks stay whole.
pub const BLOCK_MARGIN: u32 = 16;

/// A block of a tile. Along a short side it is the whole tile, and nothing is cut there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileBlock {
    /// Of the tile.
    extent: [u32; 2],
    low: [u32; 2],
    high: [u32; 2],
    /// The block with its margin, in texels of level 0.
    pub around: TexelBlock,
}

/// A block at a level, in texels of that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockPart {
    /// Where the block begins in what it is with its margin.
    pub start: [u32; 2],
    /// Columns and rows, without the margin.
    pub size: [u32; 2],
    /// Its first texel in the tile.
    pub first: [u32; 2],
}

impl TileBlock {
    /// The blocks of a tile of `extent` texels, row by row, with a margin within the tile.
    ///
    /// # Panics
    /// If the margin is not a multiple of [`BLOCK_MARGIN`].
    pub fn all(extent: [u32; 2], margin: u32) -> Vec<Self> {
        assert!(margin.is_multiple_of(BLOCK_MARGIN), "a margin of {margin} texels");
        let [columns, rows] = extent.map(|n| n.div_ceil(MAX_BLOCK_SIDE));
        let places = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
        let block = |at: [u32; 2]| {
            let low = at.map(|n| n * MAX_BLOCK_SIDE);
            let high = [0, 1].map(|k| (low[k] + MAX_BLOCK_SIDE).min(extent[k]));
            let origin = low.map(|n| n.saturating_sub(margin));
            let end = [0, 1].map(|k| (high[k] + margin).min(extent[k]));
            let around = TexelBlock { origin, extent: [end[0] - origin[0], end[1] - origin[1]] };
            Self { extent, low, high, around }
        };
        places.map(block).collect()
    }

    /// Texels of level 0, without the margin.
    pub fn texel_count(&self) -> u64 {
        u64::from(self.high[0] - self.low[0]) * u64::from(self.high[1] - self.low[1])
    }

    /// The block at a level up to [`SHARED_LEVEL`].
    pub fn at_level(&self, level: u32) -> BlockPart {
        // Where a side is cut, offsets halve exactly; where it is not, they are zero and the extent is the level's own.
        let of_tile = level_extent(self.extent, level);
        let start = [0, 1].map(|k| (self.low[k] - self.around.origin[k]) >> level);
        let first = self.low.map(|n| n >> level);
        let end =
            [0, 1].map(|k| if self.high[k] == self.extent[k] { of_tile[k] } else { self.high[k] >> level });
        BlockPart { start, size: [end[0] - first[0], end[1] - first[1]], first }
    }

    /// The extent of the block with its margin at the level after `level`, at which it is `extent`.
    pub fn halved(&self, level: u32, extent: [u32; 2]) -> [u32; 2] {
        let next = level_extent(self.extent, level + 1);
        [0, 1].map(|k| if self.extent[k] <= MAX_BLOCK_SIDE { next[k] } else { extent[k] / 2 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At every level the blocks lie side by side and are the whole tile, and lie within what they are with their margin. That
    /// consists of blocks of 4x4 texels wherever it is encoded.
    #[test]
    fn blocks_are_the_tile_at_every_level() {
        let extents = [[1056, 40], [2048, 1024], [3104, 2080]];
        let cases = extents.into_iter().flat_map(|extent| [1, 2].map(|n| (extent, n * BLOCK_MARGIN)));
        for (extent, margin) in cases {
            let blocks = TileBlock::all(extent, margin);
            let texels: u64 = extent.map(u64::from).iter().product();
            assert_eq!(blocks.iter().map(TileBlock::texel_count).sum::<u64>(), texels);
            let mut around: Vec<[u32; 2]> = blocks.iter().map(|block| block.around.extent).collect();
            for level in 0..=SHARED_LEVEL {
                let of_tile = level_extent(extent, level);
                let mut seen = vec![0; of_tile[0] as usize * of_tile[1] as usize];
                for (block, around) in blocks.iter().zip(&mut around) {
                    let BlockPart { start, size, first } = block.at_level(level);
                    assert!((0..2).all(|k| start[k] + size[k] <= around[k]), "{extent:?} {level} {block:?}");
                    let is_whole = start.iter().chain(&*around).all(|n| n.is_multiple_of(4));
                    assert!(is_whole || level == SHARED_LEVEL, "{extent:?} {level} {block:?}");
                    for y in first[1]..first[1] + size[1] {
                        for x in first[0]..first[0] + size[0] {
                            seen[(y * of_tile[0] + x) as usize] += 1;
                        }
                    }
                    *around = block.halved(level, *around);
                }
                assert!(seen.iter().all(|&count| count == 1), "{extent:?} {level}");
            }
        }
    }
}
