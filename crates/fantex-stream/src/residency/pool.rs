//! The pool: which parcels are resident, where, and which of them may leave.
//!
//! Invariants. A parcel is resident only if those of the next coarser level over it are, or cannot be read (a *hole*, through
//! which the rule goes on to the level after it). Every resident parcel is either
//! needed or in the queue of those that may leave, in the order in which they were last needed. A needed parcel never leaves.

use std::collections::{BTreeSet, HashMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;

use super::packer::{FreedRoom, KINDS, Packer};
use crate::shape::TileShapes;
use crate::{AtlasPlace, AtlasShape, Outline, PageTable, Parcel, TableChange, TableEntry};

/// Levels that are counted apart.
pub(crate) const COUNTED_LEVELS: usize = 20;

/// How much of something there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParcelCount {
    /// Parcels.
    pub parcels: u64,
    /// Their texels.
    pub texels: u64,
}

impl ParcelCount {
    pub(crate) fn add(&mut self, texels: u64) {
        self.parcels += 1;
        self.texels += texels;
    }

    pub(crate) fn remove(&mut self, texels: u64) {
        self.parcels -= 1;
        self.texels -= texels;
    }
}

/// A parcel that was needed until a frame.
#[derive(Clone, Copy, Debug)]
struct EvictionCandidate {
    index: u32,
    parcel: Parcel,
    stamp: u32,
}

/// A parcel is needed; otherwise its stamp is the frame in which it was needed last.
const NEEDED: u32 = u32::MAX;

pub(crate) struct Pool {
    shapes: Arc<TileShapes>,
    pub(crate) table: PageTable,
    pub(crate) shape: AtlasShape,
    packer: Packer,
    /// Per parcel where it lies.
    pub(crate) entries: Vec<TableEntry>,
    /// Of resident parcels that are not whole rectangles.
    outlines: HashMap<u32, Outline>,
    stamps: Vec<u32>,
    /// Parcels that could not be read, and have not been since: what lies under them needs them no longer.
    holes: BTreeSet<u32>,
    /// By kind (of [`Packer::kind_of`]): a parcel that leaves makes room for those of its own kind.
    candidates: [VecDeque<EvictionCandidate>; KINDS],
    /// Parcels whose place changed since the changes were taken, in any order, some of them twice.
    touched: Vec<(u32, Parcel)>,
    /// With the texels that are stored.
    pub(crate) resident: ParcelCount,
    /// Texels of the rectangles of all parcels that have been placed, and those of them that are stored.
    placed_texels: [u64; 2],
    /// Per level texels of tiles, in whole rectangles.
    pub(crate) resident_by_level: [u64; COUNTED_LEVELS],
    /// With the texels of whole rectangles.
    pub(crate) needed: ParcelCount,
    pub(crate) evictions: u64,
    /// Where the parcels lay that left last.
    freed: Vec<FreedRoom>,
    frame: u32,
}

impl Pool {
    pub(crate) fn new(shapes: Arc<TileShapes>, table: PageTable, shape: AtlasShape) -> Self {
        let parcels = shapes.parcel_count();
        Self {
            shapes,
            table,
            shape,
            packer: Packer::new(shape),
            entries: vec![TableEntry::ABSENT; parcels],
            outlines: HashMap::new(),
            stamps: vec![0; parcels],
            holes: BTreeSet::new(),
            candidates: [const { VecDeque::new() }; KINDS],
            touched: Vec::new(),
            resident: ParcelCount::default(),
            placed_texels: [0; 2],
            resident_by_level: [0; COUNTED_LEVELS],
            needed: ParcelCount::default(),
            evictions: 0,
            freed: Vec::new(),
            frame: 1,
        }
    }

    pub(crate) fn begin_frame(&mut self) {
        self.frame += 1;
        let waiting: usize = self.candidates.iter().map(VecDeque::len).sum();
        if waiting > 1024 + 2 * self.resident.parcels as usize {
            let (entries, stamps) = (&self.entries, &self.stamps);
            let is_evictable = |candidate: &EvictionCandidate| is_evictable(candidate, entries, stamps);
            self.candidates.iter_mut().for_each(|candidates| candidates.retain(is_evictable));
        }
    }

    pub(crate) fn is_resident(&self, index: u32) -> bool {
        self.entries[index as usize] != TableEntry::ABSENT
    }

    pub(crate) fn is_needed(&self, index: u32) -> bool {
        self.stamps[index as usize] == NEEDED
    }

    /// What of a resident parcel is stored in the atlas.
    pub(crate) fn outline(&self, index: u32) -> &Outline {
        self.outlines.get(&index).unwrap_or(&Outline::WHOLE)
    }

    /// Texels of rectangles of which the atlas can hold what is stored, as far as experience tells.
    pub(crate) fn rectangle_texels(&self) -> u64 {
        let [all, stored] = self.placed_texels;
        if stored == 0 {
            return self.shape.texels();
        }
        (self.shape.texels() as f64 * all as f64 / stored as f64) as u64
    }

    /// A parcel cannot be read: those under it may be resident without it.
    pub(crate) fn add_hole(&mut self, index: u32) {
        if !self.is_resident(index) {
            self.holes.insert(index);
        }
    }

    fn is_hole(&self, index: u32) -> bool {
        !self.holes.is_empty() && self.holes.contains(&index)
    }

    /// A parcel that must be resident before another may be, and is not.
    pub(crate) fn blocker(&self, parcel: Parcel) -> Option<u32> {
        self.shapes.coarser(parcel).find_map(|coarser| {
            let index = self.shapes.index(coarser);
            if self.is_resident(index) {
                None
            } else if self.is_hole(index) {
                self.blocker(coarser)
            } else {
                Some(index)
            }
        })
    }

    /// Calls `visit` with the parcels of which one may have been the [blocker](Self::blocker).
    pub(crate) fn for_each_under(&self, parcel: Parcel, visit: &mut impl FnMut(u32)) {
        let mut under = Vec::new();
        self.shapes.for_each_finer(parcel, &mut |finer| under.push(finer));
        while let Some(finer) = under.pop() {
            let index = self.shapes.index(finer);
            visit(index);
            if self.is_hole(index) {
                self.shapes.for_each_finer(finer, &mut |finer| under.push(finer));
            }
        }
    }

    pub(crate) fn need(&mut self, parcel: Parcel, index: u32) {
        debug_assert!(!self.is_needed(index));
        self.stamps[index as usize] = NEEDED;
        self.needed.add(self.shapes.texels(parcel));
    }

    pub(crate) fn release(&mut self, parcel: Parcel, index: u32) {
        debug_assert!(self.is_needed(index));
        self.needed.remove(self.shapes.texels(parcel));
        self.allow_eviction(parcel, index);
    }

    fn allow_eviction(&mut self, parcel: Parcel, index: u32) {
        self.stamps[index as usize] = self.frame;
        if self.is_resident(index) {
            let kind = Packer::kind_of(self.shapes.extent(parcel), self.outline(index));
            self.candidates[kind].push_back(EvictionCandidate { index, parcel, stamp: self.frame });
        }
    }

    /// Gives the outline of a parcel a place, evicting what was last needed at least `min_age` (at least 1 for a parcel that is not
    /// needed) frames ago, the longest ago first. `None` where that does not make room.
    pub(crate) fn insert(
        &mut self,
        parcel: Parcel,
        index: u32,
        outline: &Outline,
        min_age: u32,
    ) -> Option<AtlasPlace> {
        debug_assert!(!self.is_resident(index) && self.blocker(parcel).is_none());
        if !self.is_needed(index) {
            self.protect_coarser(parcel);
        }
        let extent = self.shapes.extent(parcel);
        let mut place = self.packer.take(extent, outline);
        while place.is_none() {
            self.freed.clear();
            if !self.evict_oldest(min_age, Packer::kind_of(extent, outline)) {
                return None;
            }
            let Self { packer, freed, .. } = self;
            place = freed.iter().find_map(|&freed| packer.take_where_freed(extent, outline, freed));
        }
        let place = place?;
        self.entries[index as usize] = TableEntry::at(place);
        if !outline.is_whole() {
            self.outlines.insert(index, outline.clone());
        }
        self.holes.remove(&index);
        self.touched.push((index, parcel));
        let stored = outline.texels(extent);
        self.resident.add(stored);
        self.placed_texels[0] += self.shapes.texels(parcel);
        self.placed_texels[1] += stored;
        self.count_levels(parcel, true);
        if !self.is_needed(index) {
            self.allow_eviction(parcel, index);
        }
        Some(place)
    }

    fn count_levels(&mut self, parcel: Parcel, more: bool) {
        let Self { resident_by_level, shapes, .. } = self;
        let mut count = |level: u32, [columns, rows]: [u32; 2]| {
            let texels = &mut resident_by_level[level as usize];
            let here = u64::from(columns) * u64::from(rows);
            *texels = if more { *texels + here } else { *texels - here };
        };
        match parcel {
            Parcel::Page(page) => count(page.level, shapes.extent(parcel)),
            Parcel::Bundle { bundle, step } => {
                for shape in shapes.groups(bundle, step).map(|group| shapes.of(group)) {
                    if let Some(level) = shape.level_at_step(step) {
                        count(level, shape.extent(level));
                    }
                }
            }
        }
    }

    /// What carries a parcel that comes unneeded leaves no earlier than that.
    fn protect_coarser(&mut self, parcel: Parcel) {
        for coarser in self.shapes.coarser(parcel) {
            let index = self.shapes.index(coarser);
            if !self.is_needed(index) {
                self.protect_coarser(coarser);
                self.allow_eviction(coarser, index);
            }
        }
    }

    /// Evicts the parcel that was needed longest ago, of those that leave room for one of a kind; of the smaller ones where
    /// there is no other. (By age alone, room became free all over the atlas and nowhere enough: a page took tens of others.)
    fn evict_oldest(&mut self, min_age: u32, kind: usize) -> bool {
        let candidate =
            self.take_candidate(min_age, kind..KINDS).or_else(|| self.take_candidate(min_age, 0..kind));
        let Some(candidate) = candidate else { return false };
        self.remove(candidate.parcel, candidate.index);
        true
    }

    /// The oldest parcel of some kinds that may leave.
    fn take_candidate(&mut self, min_age: u32, kinds: Range<usize>) -> Option<EvictionCandidate> {
        let (entries, stamps, now) = (&self.entries, &self.stamps, self.frame);
        let queues = &mut self.candidates[kinds];
        for candidates in queues.iter_mut() {
            while candidates.pop_front_if(|candidate| !is_evictable(candidate, entries, stamps)).is_some() {}
        }
        let oldest =
            queues.iter_mut().filter(|l| !l.is_empty()).min_by_key(|l| l.front().map(|l| l.stamp))?;
        oldest.pop_front_if(|candidate| now - candidate.stamp >= min_age)
    }

    /// Removes a parcel and what lies under it.
    fn remove(&mut self, parcel: Parcel, index: u32) {
        self.remove_under(parcel);
        debug_assert!(!self.is_needed(index), "{parcel} is needed");
        let entry = std::mem::take(&mut self.entries[index as usize]);
        let (extent, outline) =
            (self.shapes.extent(parcel), self.outlines.remove(&index).unwrap_or_default());
        if let Some(place) = entry.place() {
            self.freed.extend(self.packer.release_place(place, extent, &outline));
        }
        self.touched.push((index, parcel));
        self.resident.remove(outline.texels(extent));
        self.count_levels(parcel, false);
        self.evictions += 1;
    }

    fn remove_under(&mut self, parcel: Parcel) {
        let shapes = Arc::clone(&self.shapes);
        shapes.for_each_finer(parcel, &mut |finer| {
            let index = shapes.index(finer);
            if self.is_resident(index) {
                self.remove(finer, index);
            } else if self.is_hole(index) {
                self.remove_under(finer);
            }
        });
    }

    /// Empties the pool and gives it another shape.
    pub(crate) fn reset(&mut self, shape: AtlasShape) {
        self.shape = shape;
        self.packer = Packer::new(shape);
        self.candidates.iter_mut().for_each(VecDeque::clear);
        self.outlines.clear();
        self.resident = ParcelCount::default();
        self.resident_by_level = [0; COUNTED_LEVELS];
        for (index, entry) in (0..).zip(&mut self.entries) {
            if std::mem::take(entry) != TableEntry::ABSENT {
                self.touched.push((index, self.shapes.parcel(index)));
            }
        }
    }

    /// The entries of pages that have changed, ascending, each once.
    pub(crate) fn take_changes(&mut self) -> Vec<TableChange> {
        let mut touched = std::mem::take(&mut self.touched);
        touched.sort_unstable_by_key(|(index, _)| *index);
        touched.dedup_by_key(|(index, _)| *index);
        let mut changes = Vec::with_capacity(touched.len());
        for (index, parcel) in touched {
            self.push_entries(index, parcel, &mut changes);
        }
        // They ascend for each step of bundles, and for own pages: a few runs are merged.
        changes.sort_by_key(|change: &TableChange| change.index);
        changes
    }

    /// Adds the entries of a parcel's pages, ascending.
    fn push_entries(&self, index: u32, parcel: Parcel, changes: &mut Vec<TableChange>) {
        let place = self.entries[index as usize].place();
        match parcel {
            Parcel::Page(page) => {
                let in_tile = self.shapes.of(page.group).page_index(page.level, page.page);
                let entry = place.map_or(TableEntry::ABSENT, TableEntry::at);
                changes.push(TableChange { index: self.table.first(page.group) + in_tile, entry });
            }
            Parcel::Bundle { bundle, step } => {
                for group in self.shapes.groups(bundle, step) {
                    let shape = self.shapes.of(group);
                    let Some(level) = shape.level_at_step(step) else { continue };
                    let entry = place.map_or(TableEntry::ABSENT, |AtlasPlace { layer, x, y }| {
                        let [right, down] = self.shapes.place_in_bundle(group, step);
                        TableEntry::at(AtlasPlace { layer, x: x + right, y: y + down })
                    });
                    let index = self.table.first(group) + shape.page_index(level, [0, 0]);
                    changes.push(TableChange { index, entry });
                }
            }
        }
    }

    /// Panics where an invariant does not hold. Takes time linear in all parcels.
    pub(crate) fn check(&self) {
        use fantex_store::PAGE;
        let mut used = std::collections::HashSet::new();
        let mut count = ParcelCount::default();
        let candidates: std::collections::HashSet<u32> = self
            .candidates
            .iter()
            .flatten()
            .filter(|l| is_evictable(l, &self.entries, &self.stamps))
            .map(|l| l.index)
            .collect();
        for index in 0..self.entries.len() as u32 {
            let Some(place) = self.entries[index as usize].place() else { continue };
            let parcel = self.shapes.parcel(index);
            assert_eq!(self.shapes.index(parcel), index);
            assert_eq!(self.blocker(parcel), None, "{parcel} is resident without what lies over it");
            assert!(!self.is_hole(index));
            for above in self.shapes.coarser(parcel) {
                assert!(!self.is_needed(index) || self.is_needed(self.shapes.index(above)));
            }
            assert_ne!(
                self.is_needed(index),
                candidates.contains(&index),
                "{parcel} cannot leave, or must not"
            );
            let extent = self.shapes.extent(parcel);
            assert!(extent.iter().all(|&n| n <= PAGE) && u32::from(place.layer) < self.shape.layers);
            let outline = self.outline(index);
            for (band, [first, end]) in (0..).zip(outline.spans(extent)) {
                for block in first..end {
                    let [x, y] = [u32::from(place.x) / 4 + block, u32::from(place.y) / 4 + band];
                    assert!(4 * x < self.shape.side && 4 * y < self.shape.side);
                    assert!(used.insert((place.layer, x, y)), "{parcel} overlaps");
                }
            }
            count.add(outline.texels(extent));
        }
        assert_eq!(count, self.resident);
        assert!(count.texels <= self.shape.texels());
        assert!(self.outlines.len() <= count.parcels as usize);
    }
}

/// Whether an entry of the queue still says what is the case.
fn is_evictable(candidate: &EvictionCandidate, entries: &[TableEntry], stamps: &[u32]) -> bool {
    stamps[candidate.index as usize] == candidate.stamp
        && entries[candidate.index as usize] != TableEntry::ABSENT
}
