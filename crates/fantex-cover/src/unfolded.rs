//! Coordinates of unfolded groups, found by corner.

use std::ops::Deref;

use glam::Vec2;

/// Coordinates of one triangle in the tile of an unfolded group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnfoldedCorner {
    /// Corner index `3 * triangle + k` of a vertex whose fan is in the group.
    pub corner: u32,
    /// Tile coordinates, 0..1, of the triangle's corners 0, 1, 2.
    pub uv: [Vec2; 3],
}

impl UnfoldedCorner {
    /// Steps across a tile of so many texels, of which coordinates are whole numbers where they can be: powers of two, 256 per texel at least.
    pub fn steps(extent: [u32; 2]) -> Vec2 {
        Vec2::from_array(extent.map(|n| (256 * n).next_power_of_two() as f32))
    }
}

/// Coordinates of unfolded groups, ascending by corner. Finding one takes constant time: a bit per corner tells whether it has
/// coordinates, and a count per 64 corners where they are.
#[derive(Clone, Debug, Default)]
pub struct UnfoldedCorners {
    entries: Vec<UnfoldedCorner>,
    blocks: Vec<CornerBlock>,
}

/// Which of 64 corners have coordinates, and how many corners before them do.
#[derive(Clone, Copy, Debug, Default)]
struct CornerBlock {
    present: u64,
    before: u32,
}

impl UnfoldedCorners {
    /// The coordinates of a corner's triangle in the tile of the corner's group; none where that is projected.
    #[inline]
    pub fn find(&self, corner: u32) -> Option<&UnfoldedCorner> {
        let block = self.blocks.get(corner as usize / 64)?;
        let bit = 1 << (corner % 64);
        if block.present & bit == 0 {
            return None;
        }
        let before = (block.present & (bit - 1)).count_ones();
        self.entries.get((block.before + before) as usize)
    }
}

impl From<Vec<UnfoldedCorner>> for UnfoldedCorners {
    /// The entries must ascend by corner.
    fn from(entries: Vec<UnfoldedCorner>) -> Self {
        let last = entries.iter().map(|entry| entry.corner as usize + 1).max();
        let mut blocks = vec![CornerBlock::default(); last.map_or(0, |count| count.div_ceil(64))];
        for entry in &entries {
            blocks[entry.corner as usize / 64].present |= 1 << (entry.corner % 64);
        }
        let mut before = 0;
        for block in &mut blocks {
            block.before = before;
            before += block.present.count_ones();
        }
        Self { entries, blocks }
    }
}

impl FromIterator<UnfoldedCorner> for UnfoldedCorners {
    fn from_iter<I: IntoIterator<Item = UnfoldedCorner>>(entries: I) -> Self {
        Vec::from_iter(entries).into()
    }
}

impl Deref for UnfoldedCorners {
    type Target = [UnfoldedCorner];

    fn deref(&self) -> &Self::Target {
        &self.entries
    }
}

impl PartialEq for UnfoldedCorners {
    fn eq(&self, other: &Self) -> bool {
        self.entries == other.entries
    }
}
