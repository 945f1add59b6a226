//! What tiles' extents alone decide: which level a pixel's width asks for, how pages lie in a tile's levels, and how all parcels
//! are numbered.

use std::collections::HashMap;
use std::ops::Range;

use fantex_cover::{Cover, Group};
use fantex_store::{PAGE, PageId, page_extent, page_grid};
use rayon::prelude::*;

use crate::parcel::{BUNDLE_TILES, FAMILY, Parcel, ParcelLayout, SHARED_LEVELS, Slot, groups_of, slots};

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
    /// Per step the least detail that does without the level; zero where there is none.
    shared_leaves: [u8; SHARED_LEVELS as usize],
    /// The binary logarithm of the side in texels of level 0, about.
    pub(crate) side_log2: f32,
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
        let at_step = |step: usize| last.checked_sub(step).map_or(0, |level| leaves[level]);
        let shared_leaves = std::array::from_fn(at_step);
        let side_log2 = 0.5 * extents[0].map(|n| n.ilog2() as f32).iter().sum::<f32>();
        Self { wanted, leaves, texels, first_pages, extents, first_single, shared_leaves, side_log2 }
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

    /// Per step the least detail from which on the level is not read; zero where the tile has no such level.
    #[inline]
    pub(crate) fn shared_leaves(&self) -> [u8; SHARED_LEVELS as usize] {
        self.shared_leaves
    }

    #[inline]
    pub(crate) fn level_count(&self) -> u32 {
        self.leaves.len() as u32
    }

    #[inline]
    pub(crate) fn texels(&self, level: u32) -> u64 {
        self.texels[level as usize]
    }

    /// Columns and rows of a level in texels.
    pub(crate) fn extent(&self, level: u32) -> [u32; 2] {
        self.extents[level as usize]
    }

    /// Number of finest levels that the tile does not share with its bundle.
    #[inline]
    pub(crate) fn own_levels(&self) -> u32 {
        self.level_count().saturating_sub(SHARED_LEVELS)
    }

    /// Pages of these levels; they come first among the tile's.
    #[inline]
    pub(crate) fn own_pages(&self) -> u32 {
        self.first_pages[self.own_levels() as usize]
    }

    /// The level `step` above the coarsest, if there is one.
    #[inline]
    pub(crate) fn level_at_step(&self, step: u32) -> Option<u32> {
        (self.level_count() - 1).checked_sub(step)
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

/// The shapes of a cover's tiles, each kept once, and the numbering of its parcels: first the bundles', step by step from the
/// coarsest, then the tiles' own pages, group by group.
///
/// *Owners* are what the request queue holds: bundles, by their numbers, and (numbered after them) groups with own pages.
#[derive(Debug)]
pub(crate) struct TileShapes {
    of_group: Vec<u32>,
    shapes: Vec<TileShape>,
    /// Per step the number of its first bundle; at the end that of all bundles.
    bundle_firsts: [u32; SHARED_LEVELS as usize + 1],
    /// Per bundle columns and rows, in units of 4 texels; zero where no tile has the level.
    bundle_extents: Vec<[u8; 2]>,
    /// Per step and group where its level lies in the bundle, in units of 4 texels; zero where it has none.
    places_in_bundle: [Vec<[u8; 2]>; SHARED_LEVELS as usize],
    /// Per group the number of its first own page; at the end that of all parcels.
    own_firsts: Vec<u32>,
}

impl TileShapes {
    pub(crate) fn new(cover: &Cover) -> Self {
        let mut known: HashMap<[u32; 2], u32> = HashMap::new();
        let mut shapes = Vec::new();
        let of_group: Vec<u32> = cover
            .groups
            .iter()
            .map(|group| {
                *known.entry(group.extent).or_insert_with(|| {
                    shapes.push(TileShape::new(group));
                    shapes.len() as u32 - 1
                })
            })
            .collect();
        let mut bundle_firsts = [0; SHARED_LEVELS as usize + 1];
        for (step, tiles) in BUNDLE_TILES.into_iter().enumerate() {
            bundle_firsts[step + 1] = bundle_firsts[step] + (of_group.len() as u32).div_ceil(tiles);
        }
        let (bundle_extents, own_firsts) = (Vec::new(), Vec::new());
        let places_in_bundle = [const { Vec::new() }; SHARED_LEVELS as usize];
        let mut all = Self { of_group, shapes, bundle_firsts, bundle_extents, places_in_bundle, own_firsts };
        let mut next = all.bundle_count();
        for group in 0..all.of_group.len() as u32 {
            all.own_firsts.push(next);
            next += all.of(group).own_pages();
        }
        all.own_firsts.push(next);
        for step in 0..SHARED_LEVELS {
            let (mut extents, places) = all.layouts(step);
            all.bundle_extents.append(&mut extents);
            all.places_in_bundle[step as usize] = places;
        }
        all
    }

    /// How the bundles of a step are laid out: their extents, and per group its place, in units of 4 texels.
    fn layouts(&self, step: u32) -> (Vec<[u8; 2]>, Vec<[u8; 2]>) {
        let tiles = BUNDLE_TILES[step as usize];
        let mut places = vec![[0; 2]; self.of_group.len()];
        let lay_out = |(bundle, places): (usize, &mut [[u8; 2]])| {
            let bundle = bundle as u32;
            let layout = ParcelLayout::new(self.slots(bundle, step));
            for slot in layout.slots {
                places[(slot.page.group - bundle * tiles) as usize] = slot.at.map(|n| (n / 4) as u8);
            }
            layout.extent.map(|n| (n / 4) as u8)
        };
        let extents = places.par_chunks_mut(tiles as usize).enumerate().map(lay_out).collect();
        (extents, places)
    }

    #[inline]
    pub(crate) fn of(&self, group: u32) -> &TileShape {
        &self.shapes[self.of_group[group as usize] as usize]
    }

    pub(crate) fn group_count(&self) -> usize {
        self.of_group.len()
    }

    #[inline]
    pub(crate) fn bundle_count(&self) -> u32 {
        self.bundle_firsts[SHARED_LEVELS as usize]
    }

    /// Number of parcels. (Some of the bundles' may be empty.)
    pub(crate) fn parcel_count(&self) -> usize {
        self.own_firsts.last().map_or(0, |&count| count as usize)
    }

    #[inline]
    pub(crate) fn groups(&self, bundle: u32, step: u32) -> Range<u32> {
        groups_of(bundle, step, self.of_group.len() as u32)
    }

    /// The bundles of a step whose groups are a family's.
    #[inline]
    pub(crate) fn family_bundles(&self, family: u32, step: u32) -> Range<u32> {
        let share = FAMILY / BUNDLE_TILES[step as usize];
        let [first, end] = [0, 1].map(|i| self.bundle_firsts[step as usize + i]);
        family * share..(end - first).min((family + 1) * share)
    }

    #[inline]
    pub(crate) fn index(&self, parcel: Parcel) -> u32 {
        match parcel {
            Parcel::Bundle { bundle, step } => self.bundle_firsts[step as usize] + bundle,
            Parcel::Page(page) => {
                self.own_firsts[page.group as usize] + self.of(page.group).page_index(page.level, page.page)
            }
        }
    }

    pub(crate) fn parcel_of(&self, page: PageId) -> Parcel {
        Parcel::with_levels(self.of(page.group).level_count(), page)
    }

    pub(crate) fn parcel(&self, index: u32) -> Parcel {
        if index < self.bundle_count() {
            let step = self.bundle_firsts.partition_point(|&first| first <= index) - 1;
            return Parcel::Bundle { bundle: index - self.bundle_firsts[step], step: step as u32 };
        }
        let group = self.own_firsts.partition_point(|&first| first <= index) - 1;
        self.own_page(group as u32, index)
    }

    /// The parcel of a number that is one of a group's own pages.
    pub(crate) fn own_page(&self, group: u32, index: u32) -> Parcel {
        Parcel::Page(self.of(group).page(group, index - self.own_firsts[group as usize]))
    }

    /// Numbers of a group's own pages, finest first.
    #[inline]
    pub(crate) fn own_parcels(&self, group: u32) -> Range<u32> {
        self.own_firsts[group as usize]..self.own_firsts[group as usize + 1]
    }

    /// Columns and rows of a parcel in texels.
    #[inline]
    pub(crate) fn extent(&self, parcel: Parcel) -> [u32; 2] {
        match parcel {
            Parcel::Bundle { .. } => {
                self.bundle_extents[self.index(parcel) as usize].map(|n| 4 * u32::from(n))
            }
            Parcel::Page(page) => self.of(page.group).page_extent(page.level, page.page),
        }
    }

    #[inline]
    pub(crate) fn texels(&self, parcel: Parcel) -> u64 {
        let [columns, rows] = self.extent(parcel).map(u64::from);
        columns * rows
    }

    /// Column and row of a group's level in the bundle of a step.
    #[inline]
    pub(crate) fn place_in_bundle(&self, group: u32, step: u32) -> [u16; 2] {
        self.places_in_bundle[step as usize][group as usize].map(|n| 4 * u16::from(n))
    }

    fn slots(&self, bundle: u32, step: u32) -> Vec<Slot> {
        slots(bundle, step, self.of_group.len() as u32, |group| {
            let shape = self.of(group);
            shape.level_at_step(step).map(|level| (level, shape.extent(level)))
        })
    }

    pub(crate) fn owner_count(&self) -> usize {
        self.bundle_count() as usize + self.group_count()
    }

    #[inline]
    pub(crate) fn owner(&self, parcel: Parcel) -> u32 {
        match parcel {
            Parcel::Bundle { .. } => self.index(parcel),
            Parcel::Page(page) => self.owner_of_group(page.group),
        }
    }

    /// The owner that stands for a group's own pages.
    #[inline]
    pub(crate) fn owner_of_group(&self, group: u32) -> u32 {
        self.bundle_count() + group
    }

    /// The group whose own pages an owner stands for, if it is no bundle.
    #[inline]
    pub(crate) fn group_of_owner(&self, owner: u32) -> Option<u32> {
        owner.checked_sub(self.bundle_count())
    }

    /// The parcels of the next coarser level that lie over one.
    pub(crate) fn coarser(&self, parcel: Parcel) -> impl Iterator<Item = Parcel> + use<> {
        let own = match parcel {
            Parcel::Page(PageId { group, level, page }) if level + 1 < self.of(group).own_levels() => {
                Some((group, level + 1, self.of(group).overlapping(level, page, level + 1)))
            }
            _ => None,
        };
        let bundle = if own.is_none() { parcel.bundle_over() } else { None };
        bundle.into_iter().chain(pages(own))
    }

    /// Calls `visit` with the parcels of the next finer level that lie under one.
    pub(crate) fn for_each_finer(&self, parcel: Parcel, visit: &mut impl FnMut(Parcel)) {
        match parcel {
            Parcel::Bundle { bundle, step } if step + 1 < SHARED_LEVELS => {
                let groups = self.groups(bundle, step);
                for first in groups.step_by(BUNDLE_TILES[step as usize + 1] as usize) {
                    let finer = Parcel::bundle_of(first, step + 1);
                    if self.texels(finer) > 0 {
                        visit(finer);
                    }
                }
            }
            Parcel::Bundle { bundle, step } => {
                for group in self.groups(bundle, step) {
                    // The coarsest of its own levels is one page.
                    if let Some(level) = self.of(group).own_levels().checked_sub(1) {
                        visit(Parcel::Page(PageId { group, level, page: [0, 0] }));
                    }
                }
            }
            Parcel::Page(PageId { group, level, page }) => {
                let finer = level.checked_sub(1);
                let under = finer.map(|finer| (group, finer, self.of(group).overlapping(level, page, finer)));
                pages(under).for_each(visit);
            }
        }
    }
}

/// Pages of a level of a group, between two of them.
fn pages(range: Option<(u32, u32, [[u32; 2]; 2])>) -> impl Iterator<Item = Parcel> {
    range.into_iter().flat_map(|(group, level, range)| {
        cells(range).map(move |page| Parcel::Page(PageId { group, level, page }))
    })
}

// Lists that few groups have.

/// A list per group, most of them empty. Asking a group that has none costs a look at one byte.
#[derive(Clone, Debug)]
pub(crate) struct SparseLists<T> {
    lists: HashMap<u32, Vec<T>>,
    has_list: Vec<bool>,
}

impl<T> SparseLists<T> {
    /// All lists are empty.
    pub(crate) fn new(group_count: usize) -> Self {
        Self { lists: HashMap::new(), has_list: vec![false; group_count] }
    }

    #[inline]
    pub(crate) fn get(&self, group: u32) -> &[T] {
        if !self.has_list[group as usize] {
            return &[];
        }
        self.lists.get(&group).map_or(&[], Vec::as_slice)
    }

    /// Replaces a list; returns the last one.
    pub(crate) fn set(&mut self, group: u32, list: Vec<T>) -> Vec<T> {
        let has_list = !list.is_empty();
        let had_list = std::mem::replace(&mut self.has_list[group as usize], has_list);
        let last = match (had_list, has_list) {
            (false, false) => None,
            (_, true) => self.lists.insert(group, list),
            (true, false) => self.lists.remove(&group),
        };
        last.unwrap_or_default()
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
