//! The pool: which pages are resident, where, and which of them may leave.
//!
//! Invariants. A page is resident only if the pages of the next coarser level over it are, or cannot be read (a *hole*, through
//! which the rule goes on to the level after it). Every resident page is either
//! needed or in the queue of those that may leave, in the order in which they were last needed. A needed page never leaves.

use std::collections::{BTreeSet, VecDeque};
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use fantex_store::PageId;

use super::packer::{KINDS, Packer};
use crate::shape::{TileShapes, cells};
use crate::{AtlasPlace, AtlasShape, PageTable, TableChange, TableEntry};

/// Levels that are counted apart.
pub(crate) const COUNTED_LEVELS: usize = 20;

/// How much of something there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageCount {
    /// Pages.
    pub pages: u64,
    /// Their texels.
    pub texels: u64,
}

impl PageCount {
    pub(crate) fn add(&mut self, texels: u64) {
        self.pages += 1;
        self.texels += texels;
    }

    pub(crate) fn remove(&mut self, texels: u64) {
        self.pages -= 1;
        self.texels -= texels;
    }
}

/// A page that was needed until a frame.
#[derive(Clone, Copy, Debug)]
struct Leaver {
    index: u32,
    group: u32,
    stamp: u32,
}

/// A page is needed; otherwise its stamp is the frame in which it was needed last.
const NEEDED: u32 = u32::MAX;

pub(crate) struct Pool {
    shapes: Arc<TileShapes>,
    table: PageTable,
    shape: AtlasShape,
    packer: Packer,
    entries: Vec<TableEntry>,
    stamps: Vec<u32>,
    /// Pages that could not be read, and have not been since: what lies under them needs them no longer.
    holes: BTreeSet<u32>,
    /// By kind (of [`Packer::kind_of`]): a page that leaves makes room for pages of its own kind.
    leavers: [VecDeque<Leaver>; KINDS],
    /// Entries that changed since they were taken, in any order, some of them twice.
    touched: Vec<u32>,
    resident: [PageCount; COUNTED_LEVELS],
    needed: PageCount,
    evictions: u64,
    /// Where the pages lay that left last.
    freed: Vec<AtlasPlace>,
    frame: u32,
}

impl Pool {
    pub(crate) fn new(shapes: Arc<TileShapes>, table: PageTable, shape: AtlasShape) -> Self {
        let pages = table.len();
        Self {
            shapes,
            table,
            shape,
            packer: Packer::new(shape),
            entries: vec![TableEntry::ABSENT; pages],
            stamps: vec![0; pages],
            holes: BTreeSet::new(),
            leavers: [const { VecDeque::new() }; KINDS],
            touched: Vec::new(),
            resident: [PageCount::default(); COUNTED_LEVELS],
            needed: PageCount::default(),
            evictions: 0,
            freed: Vec::new(),
            frame: 1,
        }
    }

    pub(crate) fn begin_frame(&mut self) {
        self.frame += 1;
        let waiting: usize = self.leavers.iter().map(VecDeque::len).sum();
        if waiting > 1024 + 2 * self.resident().pages as usize {
            let (entries, stamps) = (&self.entries, &self.stamps);
            let may_leave = |leaver: &Leaver| may_leave(leaver, entries, stamps);
            self.leavers.iter_mut().for_each(|leavers| leavers.retain(may_leave));
        }
    }

    pub(crate) fn shape(&self) -> AtlasShape {
        self.shape
    }

    pub(crate) fn table(&self) -> &PageTable {
        &self.table
    }

    pub(crate) fn entry(&self, index: u32) -> TableEntry {
        self.entries[index as usize]
    }

    pub(crate) fn index(&self, page: PageId) -> u32 {
        self.table.first(page.group) + self.shapes.of(page.group).page_index(page.level, page.page)
    }

    pub(crate) fn page(&self, group: u32, index: u32) -> PageId {
        self.shapes.of(group).page(group, index - self.table.first(group))
    }

    /// Indices of all pages of a group.
    pub(crate) fn pages_of(&self, group: u32) -> RangeInclusive<u32> {
        let shape = self.shapes.of(group);
        let first = self.table.first(group);
        first..=first + shape.page_index(shape.level_count() - 1, [0, 0])
    }

    pub(crate) fn is_resident(&self, index: u32) -> bool {
        self.entries[index as usize] != TableEntry::ABSENT
    }

    pub(crate) fn is_needed(&self, index: u32) -> bool {
        self.stamps[index as usize] == NEEDED
    }

    /// A page cannot be read: those under it may be resident without it.
    pub(crate) fn add_hole(&mut self, index: u32) {
        if !self.is_resident(index) {
            self.holes.insert(index);
        }
    }

    fn is_hole(&self, index: u32) -> bool {
        !self.holes.is_empty() && self.holes.contains(&index)
    }

    /// A page that must be resident before a page may be, and is not.
    pub(crate) fn blocker(&self, page: PageId) -> Option<u32> {
        self.coarser(page).find_map(|coarser| {
            let index = self.index(coarser);
            if self.is_resident(index) {
                None
            } else if self.is_hole(index) {
                self.blocker(coarser)
            } else {
                Some(index)
            }
        })
    }

    /// Calls `visit` with the pages for which a page may have been the [blocker](Self::blocker).
    pub(crate) fn for_each_under(&self, page: PageId, visit: &mut impl FnMut(u32)) {
        for finer in self.finer(page) {
            let index = self.index(finer);
            visit(index);
            if self.is_hole(index) {
                self.for_each_under(finer, visit);
            }
        }
    }

    pub(crate) fn needed(&self) -> PageCount {
        self.needed
    }

    pub(crate) fn resident_by_level(&self) -> &[PageCount] {
        &self.resident
    }

    pub(crate) fn resident(&self) -> PageCount {
        self.resident.iter().fold(PageCount::default(), |sum, level| PageCount {
            pages: sum.pages + level.pages,
            texels: sum.texels + level.texels,
        })
    }

    pub(crate) fn evictions(&self) -> u64 {
        self.evictions
    }

    fn texels(&self, page: PageId) -> u64 {
        let [w, h] = self.extent(page).map(u64::from);
        w * h
    }

    /// A page is needed from now on.
    pub(crate) fn need(&mut self, page: PageId, index: u32) {
        debug_assert!(!self.is_needed(index));
        self.stamps[index as usize] = NEEDED;
        self.needed.add(self.texels(page));
    }

    /// A page is no longer needed.
    pub(crate) fn release(&mut self, page: PageId, index: u32) {
        debug_assert!(self.is_needed(index));
        self.needed.remove(self.texels(page));
        self.let_leave(page, index);
    }

    fn let_leave(&mut self, page: PageId, index: u32) {
        self.stamps[index as usize] = self.frame;
        if self.is_resident(index) {
            let kind = Packer::kind_of(self.extent(page));
            self.leavers[kind].push_back(Leaver { index, group: page.group, stamp: self.frame });
        }
    }

    fn extent(&self, page: PageId) -> [u32; 2] {
        self.shapes.of(page.group).page_extent(page.level, page.page)
    }

    /// The pages of the next coarser level that lie over a page.
    pub(crate) fn coarser(&self, page: PageId) -> impl Iterator<Item = PageId> + use<> {
        let shape = self.shapes.of(page.group);
        let range = (page.level + 1 < shape.level_count())
            .then(|| shape.overlapping(page.level, page.page, page.level + 1));
        let PageId { group, level, .. } = page;
        range.into_iter().flat_map(cells).map(move |page| PageId { group, level: level + 1, page })
    }

    /// The pages of the next finer level that lie under a page.
    pub(crate) fn finer(&self, page: PageId) -> impl Iterator<Item = PageId> + use<> {
        let shape = self.shapes.of(page.group);
        let range = (page.level > 0).then(|| shape.overlapping(page.level, page.page, page.level - 1));
        let PageId { group, level, .. } = page;
        range.into_iter().flat_map(cells).map(move |page| PageId { group, level: level - 1, page })
    }

    /// Gives a page a place, evicting pages that were last needed at least `min_age` (at least 1 for a page that is not
    /// needed) frames ago, the longest ago first. `None` where that does not make room.
    pub(crate) fn insert(&mut self, page: PageId, index: u32, min_age: u32) -> Option<AtlasPlace> {
        debug_assert!(!self.is_resident(index) && self.blocker(page).is_none());
        if !self.is_needed(index) {
            self.stay_below(page);
        }
        let extent = self.extent(page);
        let mut place = self.packer.take(extent);
        while place.is_none() {
            self.freed.clear();
            if !self.evict_oldest(min_age, Packer::kind_of(extent)) {
                return None;
            }
            let Self { packer, freed, .. } = self;
            place = freed.iter().find_map(|&freed| packer.take_where_freed(extent, freed));
        }
        let place = place?;
        self.entries[index as usize] = TableEntry::at(place);
        self.holes.remove(&index);
        self.touched.push(index);
        let texels = self.texels(page);
        self.resident[page.level as usize].add(texels);
        if !self.is_needed(index) {
            self.let_leave(page, index);
        }
        Some(place)
    }

    /// What carries a page that comes unneeded leaves no earlier than that page.
    fn stay_below(&mut self, page: PageId) {
        for coarser in self.coarser(page) {
            let index = self.index(coarser);
            if !self.is_needed(index) {
                self.stay_below(coarser);
                self.let_leave(coarser, index);
            }
        }
    }

    /// Evicts the page that was needed longest ago, of those that leave room for a page of a kind; of the smaller ones where
    /// there is no other. (By age alone, room became free all over the atlas and nowhere enough: a page took tens of others.)
    fn evict_oldest(&mut self, min_age: u32, kind: usize) -> bool {
        let leaver = self.take_leaver(min_age, kind..KINDS).or_else(|| self.take_leaver(min_age, 0..kind));
        let Some(leaver) = leaver else { return false };
        let page = self.page(leaver.group, leaver.index);
        self.remove(page, leaver.index);
        true
    }

    /// The oldest page of some kinds that may leave.
    fn take_leaver(&mut self, min_age: u32, kinds: Range<usize>) -> Option<Leaver> {
        let (entries, stamps, now) = (&self.entries, &self.stamps, self.frame);
        let queues = &mut self.leavers[kinds];
        for leavers in queues.iter_mut() {
            while leavers.pop_front_if(|leaver| !may_leave(leaver, entries, stamps)).is_some() {}
        }
        let oldest =
            queues.iter_mut().filter(|l| !l.is_empty()).min_by_key(|l| l.front().map(|l| l.stamp))?;
        oldest.pop_front_if(|leaver| now - leaver.stamp >= min_age)
    }

    /// Removes a page and what lies under it.
    fn remove(&mut self, page: PageId, index: u32) {
        self.remove_under(page);
        debug_assert!(!self.is_needed(index), "{page} is needed");
        let entry = std::mem::take(&mut self.entries[index as usize]);
        if let Some(place) = entry.place() {
            self.packer.give_back(place, self.extent(page));
            self.freed.push(place);
        }
        self.touched.push(index);
        let texels = self.texels(page);
        self.resident[page.level as usize].remove(texels);
        self.evictions += 1;
    }

    fn remove_under(&mut self, page: PageId) {
        for finer in self.finer(page) {
            let index = self.index(finer);
            if self.is_resident(index) {
                self.remove(finer, index);
            } else if self.is_hole(index) {
                self.remove_under(finer);
            }
        }
    }

    /// Empties the pool and gives it another shape.
    pub(crate) fn reset(&mut self, shape: AtlasShape) {
        self.shape = shape;
        self.packer = Packer::new(shape);
        self.leavers.iter_mut().for_each(VecDeque::clear);
        self.resident = [PageCount::default(); COUNTED_LEVELS];
        for (index, entry) in (0..).zip(&mut self.entries) {
            if std::mem::take(entry) != TableEntry::ABSENT {
                self.touched.push(index);
            }
        }
    }

    /// The entries that have changed, ascending, each once.
    pub(crate) fn take_changes(&mut self) -> Vec<TableChange> {
        let mut touched = std::mem::take(&mut self.touched);
        touched.sort_unstable();
        touched.dedup();
        let change = |index: u32| TableChange { index, entry: self.entries[index as usize] };
        touched.into_iter().map(change).collect()
    }

    /// Checks the invariants that need a look at everything; for tests.
    #[cfg(test)]
    pub(crate) fn check(&self) {
        use fantex_store::PAGE;
        let mut used = std::collections::HashSet::new();
        let mut count = PageCount::default();
        let leavers: std::collections::HashSet<u32> = self
            .leavers
            .iter()
            .flatten()
            .filter(|l| may_leave(l, &self.entries, &self.stamps))
            .map(|l| l.index)
            .collect();
        for group in 0..self.shapes.group_count() as u32 {
            for index in self.pages_of(group) {
                let Some(place) = self.entry(index).place() else { continue };
                let page = self.page(group, index);
                assert_eq!(self.index(page), index);
                assert_eq!(self.blocker(page), None, "{page} is resident without what lies over it");
                assert!(!self.is_hole(index));
                for above in self.coarser(page) {
                    assert!(!self.is_needed(index) || self.is_needed(self.index(above)));
                }
                assert_ne!(
                    self.is_needed(index),
                    leavers.contains(&index),
                    "{page} cannot leave, or must not"
                );
                let [w, h] = self.shapes.of(group).page_extent(page.level, page.page);
                assert!(w <= PAGE && h <= PAGE && u32::from(place.layer) < self.shape.layers);
                assert!(
                    u32::from(place.x) + w <= self.shape.side && u32::from(place.y) + h <= self.shape.side
                );
                for y in 0..h / 4 {
                    for x in 0..w / 4 {
                        let unit = (place.layer, u32::from(place.x) / 4 + x, u32::from(place.y) / 4 + y);
                        assert!(used.insert(unit), "{page} overlaps");
                    }
                }
                count.add(u64::from(w * h));
            }
        }
        assert_eq!(count, self.resident());
        assert!(count.texels <= self.shape.texels());
    }
}

/// Whether an entry of the queue still says what is the case.
fn may_leave(leaver: &Leaver, entries: &[TableEntry], stamps: &[u32]) -> bool {
    stamps[leaver.index as usize] == leaver.stamp && entries[leaver.index as usize] != TableEntry::ABSENT
}
