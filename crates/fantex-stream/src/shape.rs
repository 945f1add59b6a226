//! What a tile's extent alone decides: which level a pixel's width asks for, and how pages lie in its levels.

use std::collections::HashMap;

use fantex_cover::{Cover, Group};
use fantex_store::{PAGE, PageId, page_extent, page_grid};

/// How fine a surface is wanted: `floor(8 log2 w)`, where `w` is the width of a pixel in texels of level 0, from 0 (a texel
/// is wider than a pixel, or just as wide) to 254. [`Detail::HIDDEN`] wants nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Detail(pub u8);

impl Detail {
    /// Not seen.
    pub const HIDDEN: Self = Self(u8::MAX);

    /// Steps of a factor of two in width.
    pub const STEPS: u32 = 8;

    /// From the binary logarithm of the width.
    #[inline]
    pub(crate) fn from_log2(log2_width: f32) -> Self {
        // Not a number (no width at all) becomes 0, the finest.
        Self((log2_width * Self::STEPS as f32).clamp(0.0, 254.0) as u8)
    }

    /// Whether something is seen.
    #[inline]
    pub fn is_visible(self) -> bool {
        self != Self::HIDDEN
    }

    /// Coarser by so many steps.
    #[inline]
    pub(crate) fn biased(self, steps: u8) -> Self {
        if self.is_visible() { Self(self.0.saturating_add(steps)) } else { self }
    }
}

/// The levels of all tiles of one extent.
#[derive(Debug)]
pub(crate) struct TileShape {
    /// Per detail the finest level wanted; the number of levels where the mean is enough.
    wanted: [u8; 256],
    /// Per level the least detail that does without it.
    leaves: Vec<u8>,
    /// Per level texels.
    texels: Vec<u64>,
    /// Per level the index of its first page among the tile's.
    first_pages: Vec<u32>,
    /// Per level columns and rows in texels.
    extents: Vec<[u32; 2]>,
    /// The finest level that is one page, as all coarser ones are.
    first_single: u32,
}

impl TileShape {
    /// The thresholds are those of trilinear look-ups: a level is read while the next coarser one would be wider than a
    /// pixel, and the last one until the pixel is four of its texels wide, from where only the mean is read.
    fn new(group: &Group) -> Self {
        let count = group.level_count();
        let extents: Vec<_> = (0..count).map(|l| group.level_extent(l)).collect();
        let shrinks = |l: usize| {
            let ratio = |axis: usize| extents[0][axis] as f32 / extents[l][axis] as f32;
            ratio(0).max(ratio(1))
        };
        let steps = |width: f32| (width.log2() * Detail::STEPS as f32).ceil().min(254.0) as u8;
        let last = count as usize - 1;
        let mut leaves: Vec<u8> = (1..=last).map(|l| steps(shrinks(l))).collect();
        leaves.push(steps(4.0 * shrinks(last)));
        let mut wanted =
            std::array::from_fn(|d| leaves.iter().filter(|&&t| usize::from(t) <= d).count() as u8);
        wanted[255] = count as u8;
        let texels = extents.iter().map(|&[w, h]| u64::from(w) * u64::from(h)).collect();
        let mut next = 0;
        let first_pages = extents
            .iter()
            .map(|&extent| {
                let first = next;
                next += pages_of(extent);
                first
            })
            .collect();
        let is_large = |extent: &&[u32; 2]| extent.iter().any(|&n| n > PAGE);
        let first_single = extents.iter().take_while(is_large).count() as u32;
        Self { wanted, leaves, texels, first_pages, extents, first_single }
    }

    /// The finest level that a look-up of this detail reads; [`TileShape::level_count`] where the mean is enough.
    #[inline]
    pub(crate) fn wanted_level(&self, detail: Detail) -> u32 {
        u32::from(self.wanted[usize::from(detail.0)])
    }

    /// The least detail from which on a level is not read.
    #[inline]
    pub(crate) fn leaves(&self, level: u32) -> u8 {
        self.leaves[level as usize]
    }

    #[inline]
    pub(crate) fn level_count(&self) -> u32 {
        self.leaves.len() as u32
    }

    /// Texels of a level.
    #[inline]
    pub(crate) fn texels(&self, level: u32) -> u64 {
        self.texels[level as usize]
    }

    /// Columns and rows of a level in texels.
    pub(crate) fn extent(&self, level: u32) -> [u32; 2] {
        self.extents[level as usize]
    }

    /// Whether any level has several pages.
    #[inline]
    pub(crate) fn is_paged(&self) -> bool {
        self.first_single > 0
    }

    /// The indices of the pages that a look-up of this detail reads, where each of its levels is one page.
    #[inline]
    pub(crate) fn single_pages(&self, detail: Detail) -> Option<std::ops::Range<u32>> {
        let wanted = self.wanted_level(detail);
        let index = |level: u32| self.first_pages[self.first_single as usize] + level - self.first_single;
        (wanted >= self.first_single).then(|| index(wanted)..index(self.level_count()))
    }

    /// Index of a page among the tile's, as in [`PageTable`](crate::PageTable).
    pub(crate) fn page_index(&self, level: u32, page: [u32; 2]) -> u32 {
        self.first_pages[level as usize] + page[1] * page_grid(self.extent(level))[0] + page[0]
    }

    /// The inverse of [`TileShape::page_index`].
    pub(crate) fn page(&self, group: u32, index: u32) -> PageId {
        let level = self.first_pages.partition_point(|&first| first <= index) as u32 - 1;
        let columns = page_grid(self.extent(level))[0];
        let within = index - self.first_pages[level as usize];
        PageId { group, level, page: [within % columns, within / columns] }
    }

    /// Columns and rows of a page in texels.
    pub(crate) fn page_extent(&self, level: u32, page: [u32; 2]) -> [u32; 2] {
        page_extent(self.extent(level), page)
    }

    /// The pages at `to` that share surface with a page at `from`: first and last column and row.
    pub(crate) fn overlapping(&self, from: u32, page: [u32; 2], to: u32) -> [[u32; 2]; 2] {
        let (here, there) = (self.extent(from), self.extent(to));
        let (mut first, mut last) = ([0; 2], [0; 2]);
        for axis in 0..2 {
            let scale = |texel: u32| u64::from(texel) * u64::from(there[axis]);
            let begin = scale(page[axis] * PAGE) / u64::from(here[axis]);
            let end = (page[axis] * PAGE + PAGE).min(here[axis]);
            let end = scale(end).div_ceil(u64::from(here[axis]));
            first[axis] = (begin / u64::from(PAGE)) as u32;
            last[axis] = ((end - 1) / u64::from(PAGE)) as u32;
        }
        [first, last]
    }
}

fn pages_of(extent: [u32; 2]) -> u32 {
    let [columns, rows] = page_grid(extent);
    columns * rows
}

/// All columns and rows between two, inclusive.
pub(crate) fn cells([first, last]: [[u32; 2]; 2]) -> impl Iterator<Item = [u32; 2]> {
    (first[1]..=last[1]).flat_map(move |y| (first[0]..=last[0]).map(move |x| [x, y]))
}

/// The shapes of a cover's tiles, each kept once.
#[derive(Debug)]
pub(crate) struct TileShapes {
    of_group: Vec<u32>,
    shapes: Vec<TileShape>,
}

impl TileShapes {
    pub(crate) fn new(cover: &Cover) -> Self {
        let mut known: HashMap<[u32; 2], u32> = HashMap::new();
        let mut shapes = Vec::new();
        let of_group = cover
            .groups
            .iter()
            .map(|group| {
                *known.entry(group.extent).or_insert_with(|| {
                    shapes.push(TileShape::new(group));
                    shapes.len() as u32 - 1
                })
            })
            .collect();
        Self { of_group, shapes }
    }

    #[inline]
    pub(crate) fn of(&self, group: u32) -> &TileShape {
        &self.shapes[self.of_group[group as usize] as usize]
    }

    /// Number of groups.
    pub(crate) fn group_count(&self) -> usize {
        self.of_group.len()
    }
}

#[cfg(test)]
mod tests {
    use fantex_cover::{Frame, GroupKind};
    use glam::{Vec2, Vec3};

    use super::*;

    fn shape(extent: [u32; 2]) -> TileShape {
        let frame = Frame { origin: Vec3::ZERO, direction: Vec3::Z, x_axis: Vec3::X };
        let group =
            Group { kind: GroupKind::Projected, frame, uv_scale: Vec2::ONE, uv_offset: Vec2::ZERO, extent };
        TileShape::new(&group)
    }

    #[test]
    fn levels_follow_the_width_of_the_pixel() {
        let shape = shape([64, 64]);
        let level = |width: f32| shape.wanted_level(Detail::from_log2(width.log2()));
        assert_eq!([0.3, 1.0, 1.9, 2.1, 4.1, 8.1, 16.1, 63.0].map(level), [0, 0, 0, 1, 2, 3, 4, 4]);
        assert_eq!(level(64.1), shape.level_count());
        assert_eq!(shape.wanted_level(Detail::HIDDEN), shape.level_count());
        assert_eq!(shape.wanted_level(Detail::from_log2(f32::NEG_INFINITY)), 0);
    }

    #[test]
    fn pages_are_numbered_and_overlap_those_of_other_levels() {
        let shape = shape([1012, 524]);
        let mut next = 0;
        for level in 0..shape.level_count() {
            let grid = page_grid(shape.extent(level));
            for page in cells([[0, 0], grid.map(|n| n - 1)]) {
                assert_eq!(shape.page_index(level, page), next);
                assert_eq!(shape.page(7, next), PageId { group: 7, level, page });
                next += 1;
                if level + 1 < shape.level_count() {
                    for coarser in cells(shape.overlapping(level, page, level + 1)) {
                        let back = shape.overlapping(level + 1, coarser, level);
                        assert!(cells(back).any(|p| p == page), "level {level} {page:?} {coarser:?}");
                    }
                }
            }
        }
    }
}
