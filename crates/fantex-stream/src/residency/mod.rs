//! Residency: which parcels are wanted, asked for, resident, and which leave.
//!
//! ```text
//!  changed groups --want--> needed parcels --Wishes--> requests --ParcelLoader--> arrivals --Pool--> entries
//!                     ^                                                             |
//!                     '---------------------- Pressure (bias) <---------------------'
//! ```
//!
//! Costs follow what changes, not what is there: a group costs something when its demand changes, a parcel when it is asked
//! for, arrives or leaves.
//!
//! A group needs levels of its own, and with its [bundle](crate::Parcel) the coarser ones: a bundle needs what any of its groups does.

mod limits;
mod packer;
mod pool;
mod requests;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::sync::Arc;

use fantex_store::{PageError, PageId};
use limits::{FILLING_SECONDS, FRAME, Item, Pressure, Task, Work};
pub use limits::{FrameWork, WORK_COSTS, WORK_KINDS};
pub(crate) use pool::COUNTED_LEVELS;
pub use pool::ParcelCount;
use pool::Pool;
use requests::Wishes;

use crate::demand::Demand;
use crate::parcel::{FAMILY, SHARED_LEVELS};
use crate::shape::{Detail, SparseLists, TileShapes};
use crate::{AtlasShape, PageTable, Parcel, ParcelLoader, ParcelTexels, TableChange};

/// Where a parcel is that is not resident (or is read again).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Flight {
    /// Nobody has asked for it.
    None,
    /// It is asked for because it is needed.
    Asked,
    /// It is asked for, and nothing needs it yet.
    Ahead,
    /// It has arrived and waits for coarser ones, or for room.
    Waiting,
}

/// What is wanted, on its way, and resident.
pub(crate) struct Residency {
    shapes: Arc<TileShapes>,
    pool: Pool,
    pressure: Pressure,
    /// Per group the finest level that it needs.
    wanted: Vec<u8>,
    /// Per large tile that is visible the numbers of its own pages that are needed, ascending.
    wanted_pages: SparseLists<u32>,
    /// Per bundle how many of the parcels of the next finer level under it are needed.
    needed_under: Vec<u32>,
    /// Per owner the number of needed parcels that are not resident.
    missing: Vec<u32>,
    /// Per group whether it needs something that is not resident.
    lacks: Vec<bool>,
    /// Families with groups whose demand has changed and is not taken over yet, each once.
    backlog: VecDeque<u32>,
    /// Per family.
    in_backlog: Vec<Backlog>,
    /// Families in the backlog that wait for another bias.
    exact_backlog: usize,
    missing_parcels: u64,
    visible_groups: u64,
    lacking_groups: u64,
    wishes: Wishes,
    /// Groups whose demand in the predicted view has changed and is not taken over yet.
    unforeseen: VecDeque<u32>,
    /// Owners of what may be needed soon.
    ahead: VecDeque<u32>,
    /// Per parcel.
    flights: Vec<Flight>,
    /// Parcels that are asked for.
    pending: usize,
    /// Those of them that nothing needs yet.
    asked_ahead: BTreeMap<u32, Parcel>,
    /// What the loader has not been told yet; cancels come before requests.
    cancels: Vec<Parcel>,
    asks: Vec<(Parcel, f32)>,
    /// Parcels that have arrived and wait for coarser ones, or for room.
    waiting: BTreeMap<u32, (Parcel, ParcelTexels)>,
    /// Those of them that need wait no longer.
    ready: VecDeque<u32>,
    in_flight_texels: u64,
    damaged: BTreeMap<Parcel, PageError>,
    uploaded_bytes: u64,
    requests: u64,
    work: Work,
    /// Nanoseconds for a sixtieth of a second.
    frame_work: u32,
    /// The camera has jumped, and so many seconds of filling are left.
    filling_seconds: f32,
}

impl Residency {
    pub(crate) fn new(shapes: Arc<TileShapes>, table: PageTable, atlas: AtlasShape) -> Self {
        let groups = shapes.group_count();
        let wanted = (0..groups as u32).map(|g| shapes.of(g).level_count() as u8).collect();
        Self {
            pressure: Pressure::new(&shapes),
            wanted,
            wanted_pages: SparseLists::new(groups),
            needed_under: vec![0; shapes.bundle_count() as usize],
            missing: vec![0; shapes.owner_count()],
            lacks: vec![false; groups],
            backlog: VecDeque::new(),
            in_backlog: vec![Backlog::Done; groups.div_ceil(FAMILY as usize)],
            exact_backlog: 0,
            missing_parcels: 0,
            visible_groups: 0,
            lacking_groups: 0,
            wishes: Wishes::new(shapes.owner_count()),
            unforeseen: VecDeque::new(),
            ahead: VecDeque::new(),
            flights: vec![Flight::None; shapes.parcel_count()],
            pending: 0,
            asked_ahead: BTreeMap::new(),
            cancels: Vec::new(),
            asks: Vec::new(),
            waiting: BTreeMap::new(),
            ready: VecDeque::new(),
            in_flight_texels: 0,
            damaged: BTreeMap::new(),
            uploaded_bytes: 0,
            requests: 0,
            work: Work::default(),
            frame_work: FRAME,
            filling_seconds: 0.0,
            pool: Pool::new(shapes.clone(), table, atlas),
            shapes,
        }
    }

    pub(crate) fn pool(&self) -> &Pool {
        &self.pool
    }

    pub(crate) fn bias(&self) -> u8 {
        self.pressure.bias()
    }

    pub(crate) fn damaged(&self) -> &BTreeMap<Parcel, PageError> {
        &self.damaged
    }

    /// Groups that need parcels, and those of them that lack some. All groups of a family whose demand is not taken over yet count
    /// as both.
    pub(crate) fn visible_and_lacking(&self) -> (u64, u64) {
        let unknown = self.backlog.len() as u64 * u64::from(FAMILY);
        (self.visible_groups + unknown, self.lacking_groups + unknown)
    }

    /// Parcels asked for that have not arrived, and those that have arrived and wait.
    pub(crate) fn in_flight(&self) -> (usize, usize) {
        (self.pending, self.waiting.len())
    }

    /// Owners whose missing parcels have not been asked for, and groups whose demand may not have been taken over.
    pub(crate) fn wishes(&self) -> usize {
        self.wishes.len() + self.backlog.len() * FAMILY as usize
    }

    pub(crate) fn has_backlog(&self) -> bool {
        !self.backlog.is_empty()
    }

    /// Whether a parcel is needed and not resident, and may become so.
    pub(crate) fn is_missing(&self, parcel: Parcel) -> bool {
        let index = self.shapes.index(parcel);
        self.pool.is_needed(index) && !self.pool.is_resident(index) && !self.is_damaged(parcel)
    }

    pub(crate) fn all_missing(&self) -> Vec<Parcel> {
        let lacking = (0..).zip(&self.missing).filter(|(_, missing)| **missing > 0).map(|(owner, _)| owner);
        lacking
            .flat_map(|owner| self.parcels_of(owner))
            .map(|index| self.shapes.parcel(index))
            .filter(|&parcel| self.is_missing(parcel))
            .collect()
    }

    /// Numbers of all parcels of an owner, finest first.
    fn parcels_of(&self, owner: u32) -> Range<u32> {
        match self.shapes.group_of_owner(owner) {
            Some(group) => self.shapes.own_parcels(group),
            None => owner..owner + 1,
        }
    }

    pub(crate) fn uploaded_bytes(&self) -> u64 {
        self.uploaded_bytes
    }

    /// Parcels asked for since the beginning.
    pub(crate) fn requests(&self) -> u64 {
        self.requests
    }

    /// The finest level that a group needs, with the bias; `None` where it needs none.
    pub(crate) fn wanted_level(&self, group: u32) -> Option<u32> {
        let finest = self.wanted_pages.get(group).first();
        let level = match finest.map(|&index| self.shapes.own_page(group, index)) {
            Some(Parcel::Page(page)) => page.level,
            _ => u32::from(self.wanted[group as usize]),
        };
        (level < self.shapes.of(group).level_count()).then_some(level)
    }

    /// The finest level of which something is resident.
    pub(crate) fn resident_level(&self, group: u32) -> Option<u32> {
        let own = self.shapes.own_parcels(group).find(|&index| self.pool.is_resident(index));
        if let Some(Parcel::Page(page)) = own.map(|index| self.shapes.own_page(group, index)) {
            return Some(page.level);
        }
        let shape = self.shapes.of(group);
        (0..SHARED_LEVELS)
            .rev()
            .filter(|&step| self.pool.is_resident(self.shapes.index(Parcel::bundle_of(group, step))))
            .find_map(|step| shape.level_at_step(step))
    }

    /// A frame begins, so long after the last one. `is_cut`: the camera has jumped.
    pub(crate) fn begin_frame(&mut self, elapsed_seconds: f32, is_cut: bool) {
        self.filling_seconds = match is_cut {
            true => FILLING_SECONDS,
            false => (self.filling_seconds - elapsed_seconds).max(0.0),
        };
        let lacking = match self.visible_groups {
            _ if self.filling_seconds > 0.0 => 1.0,
            0 => 0.0,
            visible => self.lacking_groups as f32 / visible as f32,
        };
        self.work = self.work.next_frame(self.frame_work, elapsed_seconds, lacking);
        self.pool.begin_frame();
    }

    pub(crate) fn take_changes(&mut self) -> Vec<TableChange> {
        self.pool.take_changes()
    }

    /// How long demand may take now.
    pub(crate) fn bounding_nanoseconds(&self) -> u32 {
        self.work.bounding_nanoseconds()
    }

    /// What has been done since the frame began.
    pub(crate) fn work_done(&self) -> &FrameWork {
        self.work.done()
    }

    /// Needed parcels that are not resident.
    pub(crate) fn missing_count(&self) -> u64 {
        self.missing_parcels
    }

    /// Does so much in a sixtieth of a second.
    #[cfg(test)]
    pub(crate) fn set_frame_work(&mut self, nanoseconds: u32) {
        self.frame_work = nanoseconds;
    }

    /// Nanoseconds that the last frame should have taken, and those that it might.
    #[cfg(test)]
    pub(crate) fn work(&self) -> (u32, u32) {
        self.work.spent_of()
    }

    #[cfg(test)]
    pub(crate) fn check(&self) {
        self.pool.check();
        let missing: u64 = self.missing.iter().map(|&n| u64::from(n)).sum();
        assert_eq!(missing, self.missing_parcels);
        assert_eq!(self.lacks.iter().filter(|&&lacks| lacks).count() as u64, self.lacking_groups);
        let (mut pages, mut texels, mut ahead) = ([0; 4], 0, BTreeMap::new());
        for owner in 0..self.shapes.owner_count() as u32 {
            for index in self.parcels_of(owner) {
                let (flight, parcel) = (self.flight(index), self.shapes.parcel(index));
                assert_eq!(self.shapes.owner(parcel), owner);
                pages[flight as usize] += 1;
                texels += if flight == Flight::None { 0 } else { self.shapes.texels(parcel) };
                if flight == Flight::Ahead {
                    ahead.insert(index, parcel);
                }
                assert_eq!(flight == Flight::Waiting, self.waiting.contains_key(&index));
            }
            let parcels = self.parcels_of(owner).map(|index| self.shapes.parcel(index));
            let missing = parcels.filter(|&parcel| self.is_missing(parcel)).count() as u32;
            assert_eq!(missing, self.missing[owner as usize]);
        }
        assert_eq!(texels, self.in_flight_texels);
        assert_eq!(pages[1] + pages[2], self.pending);
        assert_eq!(ahead, self.asked_ahead);
        if self.backlog.is_empty() {
            for group in 0..self.lacks.len() as u32 {
                assert_eq!(self.lacks[group as usize], self.is_lacking(group));
            }
        }
    }

    fn flight(&self, index: u32) -> Flight {
        self.flights[index as usize]
    }

    /// A parcel is elsewhere from now on; returns where it was.
    fn set_flight(&mut self, parcel: Parcel, index: u32, flight: Flight) -> Flight {
        let last = std::mem::replace(&mut self.flights[index as usize], flight);
        let is_pending = |flight| matches!(flight, Flight::Asked | Flight::Ahead);
        self.pending -= usize::from(is_pending(last));
        self.pending += usize::from(is_pending(flight));
        if last == Flight::Ahead {
            self.asked_ahead.remove(&index);
        }
        if flight == Flight::Ahead {
            self.asked_ahead.insert(index, parcel);
        }
        match (last, flight) {
            (Flight::None, Flight::None) => {}
            (Flight::None, _) => self.in_flight_texels += self.shapes.texels(parcel),
            (_, Flight::None) => self.in_flight_texels -= self.shapes.texels(parcel),
            _ => {}
        }
        last
    }

    /// Side of a tile on the screen, pixels, as a binary logarithm.
    fn side_log2(&self, group: u32, detail: Detail) -> f32 {
        self.shapes.of(group).side_log2() - f32::from(detail.0) / Detail::STEPS as f32
    }

    /// A needed parcel is missing from now on, or (`more` false) is not missing any more. Whether its groups lack something is to
    /// be looked at then.
    fn count_missing(&mut self, parcel: Parcel, more: bool) {
        let missing = &mut self.missing[self.shapes.owner(parcel) as usize];
        if more {
            self.missing_parcels += 1;
            *missing += 1;
        } else {
            *missing -= 1;
            self.missing_parcels -= 1;
        }
    }

    /// Looks once more whether the groups of a parcel have what they need.
    fn update_lacks(&mut self, parcel: Parcel) {
        match parcel {
            Parcel::Page(page) => self.update_lack(page.group),
            Parcel::Bundle { bundle, step } => {
                self.shapes.groups(bundle, step).for_each(|group| self.update_lack(group));
            }
        }
    }

    fn is_lacking(&self, group: u32) -> bool {
        let levels = self.shapes.of(group).level_count() - u32::from(self.wanted[group as usize]);
        let is_there = |step: u32| {
            let parcel = Parcel::bundle_of(group, step);
            self.pool.is_resident(self.shapes.index(parcel)) || self.is_damaged(parcel)
        };
        let own_missing = self.missing[self.shapes.owner_of_group(group) as usize];
        self.is_wanted(group) && (own_missing > 0 || !(0..levels.min(SHARED_LEVELS)).all(is_there))
    }

    /// Looks once more whether a group has what it needs.
    fn update_lack(&mut self, group: u32) {
        let lacks = self.is_lacking(group);
        match (std::mem::replace(&mut self.lacks[group as usize], lacks), lacks) {
            (false, true) => self.lacking_groups += 1,
            (true, false) => self.lacking_groups -= 1,
            _ => {}
        }
    }
}

// From what a view needs to parcels that are needed, asked for, or cancelled.

/// Steps of [`Detail`] by which a demand must have become coarser before a finer level counts as unneeded.
const RELUCTANCE: u8 = 2;

/// Whether and how the demand of a family of groups waits to be taken over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Backlog {
    /// It does not.
    Done,
    /// It has changed.
    Changed,
    /// The bias has changed: what is no longer needed with it is released at once.
    Exact,
}

/// How much may be on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RequestLimits {
    /// Parcels asked for or waiting for coarser ones.
    pub parcels: usize,
    /// Their texels.
    pub texels: u64,
}

impl Default for RequestLimits {
    /// Enough to keep a fast disk busy: 16384 parcels, 8 Mi texels.
    fn default() -> Self {
        Self { parcels: 1 << 14, texels: 8 << 20 }
    }
}

impl Residency {
    /// Takes over the demand of the groups for which it has changed, of so many families per frame: a cut to a view of hundreds
    /// of thousands of tiles, or another bias for them, is spread over some frames.
    pub(crate) fn want(&mut self, changed: &[u32], demand: &Demand) {
        self.work.spend(Item::Bounding, demand.nanoseconds());
        let mut last = None;
        for family in changed.iter().map(|group| group / FAMILY) {
            if last.replace(family) != Some(family) {
                self.put_off(family, Backlog::Changed);
            }
        }
        while !self.backlog.is_empty() && self.work.may(Task::Want) {
            let Some(family) = self.backlog.pop_front() else { break };
            let reluctance = match std::mem::replace(&mut self.in_backlog[family as usize], Backlog::Done) {
                Backlog::Exact => {
                    self.exact_backlog -= 1;
                    0
                }
                Backlog::Changed | Backlog::Done => RELUCTANCE,
            };
            self.want_family(family, demand, reluctance);
        }
    }

    fn put_off(&mut self, family: u32, how: Backlog) {
        let waits = &mut self.in_backlog[family as usize];
        if *waits == Backlog::Done {
            self.backlog.push_back(family);
        }
        if how == Backlog::Exact && *waits != Backlog::Exact {
            self.exact_backlog += 1;
        }
        if *waits != Backlog::Exact {
            *waits = how;
        }
    }

    /// Takes over the demand of a family, then what it means for the bundles.
    fn want_family(&mut self, family: u32, demand: &Demand, reluctance: u8) {
        // A bit for each group.
        let mut changed = 0u32;
        for (i, group) in self.shapes.groups(family, 0).enumerate() {
            // What has not changed is wanted as before, unless the bias is another one.
            let has_changed = demand.detail(group) != self.pressure.counted(group);
            if has_changed || reluctance == 0 || self.shapes.of(group).is_paged() {
                changed |= 1 << i;
                self.want_with(group, demand, reluctance);
            }
        }
        self.work.spend(Item::Family, 1);
        self.work.spend(Item::Group, changed.count_ones());
        if self.want_bundles(family, reluctance) {
            changed = u32::MAX;
        }
        for (i, group) in self.shapes.groups(family, 0).enumerate() {
            if changed >> i & 1 == 1 {
                self.update_lack(group);
            }
        }
    }

    /// Takes over the demand of a group. Whether it lacks something is seen later.
    fn want_with(&mut self, group: u32, demand: &Demand, reluctance: u8) {
        self.pressure.count(group, demand, &self.shapes);
        let detail = demand.detail(group);
        let level = self.level_for(group, detail, reluctance);
        let is_paged = self.shapes.of(group).is_paged();
        let is_plain = !is_paged || demand.pages(group).is_empty() && self.wanted_pages.get(group).is_empty();
        if !is_plain || level != u32::from(self.wanted[group as usize]) {
            let was_visible = self.is_wanted(group);
            let current = u32::from(std::mem::replace(&mut self.wanted[group as usize], level as u8));
            if is_paged {
                self.want_pages(group, demand);
            } else {
                self.want_own_levels(group, current, level);
            }
            match (was_visible, self.is_wanted(group)) {
                (false, true) => self.visible_groups += 1,
                (true, false) => self.visible_groups -= 1,
                _ => {}
            }
        }
        let missing = self.missing[self.shapes.owner_of_group(group) as usize];
        if missing > 0 {
            self.wish_for(group, missing, detail);
        }
    }

    fn is_wanted(&self, group: u32) -> bool {
        u32::from(self.wanted[group as usize]) < self.shapes.of(group).level_count()
    }

    /// Puts the own pages of a group among the wishes.
    fn wish_for(&mut self, group: u32, missing: u32, detail: Detail) {
        let side = self.side_log2(group, detail);
        self.wishes.put(self.shapes.owner_of_group(group), missing, side);
    }

    /// Puts a bundle among the wishes, if it is missing.
    fn wish_for_bundle(&mut self, index: u32, parcel: Parcel) {
        if self.missing[index as usize] > 0 {
            let (levels, side) = self.bundle_error(parcel);
            self.wishes.put(index, levels.saturating_sub(self.step_of(parcel)), side);
        }
    }

    /// How many levels a tile of a bundle needs at most, and the largest of their sides on the screen, pixels, as a binary
    /// logarithm.
    fn bundle_error(&self, parcel: Parcel) -> (u32, f32) {
        let Parcel::Bundle { bundle, step } = parcel else { return (1, 0.0) };
        let visible = self.shapes.groups(bundle, step).filter(|&group| self.is_wanted(group));
        visible.fold((step + 1, 0.0), |(levels, side): (u32, f32), group| {
            let needed = self.shapes.of(group).level_count() - u32::from(self.wanted[group as usize]);
            (levels.max(needed), side.max(self.side_log2(group, self.pressure.counted(group))))
        })
    }

    /// Bundles need what their groups do. Whether any becomes needed or unneeded.
    fn want_bundles(&mut self, family: u32, reluctance: u8) -> bool {
        self.pressure.count_family(family, &self.shapes);
        let bias = self.pressure.bias();
        let mut has_changed = false;
        // Finest first, so that they leave in this order; what lies over something needed is needed.
        for step in (0..SHARED_LEVELS).rev() {
            for bundle in self.shapes.family_bundles(family, step) {
                let parcel = Parcel::Bundle { bundle, step };
                let index = self.shapes.index(parcel);
                let (until, was_needed) = (self.pressure.bundle_until(index), self.pool.is_needed(index));
                let reluctance = if was_needed { reluctance } else { 0 };
                let is_needed = until > 0 && until.saturating_add(reluctance) > bias;
                // Groups whose demand is not taken over yet may still need theirs.
                match (was_needed, is_needed || self.needed_under[index as usize] > 0) {
                    (false, true) => self.need(parcel, index),
                    (true, false) => self.release(parcel, index),
                    _ => {}
                }
                has_changed |= was_needed != self.pool.is_needed(index);
                self.wish_for_bundle(index, parcel);
            }
        }
        has_changed
    }

    fn level_for(&self, group: u32, detail: Detail, reluctance: u8) -> u32 {
        let shape = self.shapes.of(group);
        let current = u32::from(self.wanted[group as usize]);
        let level = shape.wanted_level(detail.biased(self.pressure.bias()));
        if level <= current || !detail.is_visible() {
            return level;
        }
        let reluctant = Detail(detail.0.saturating_sub(reluctance)).biased(self.pressure.bias());
        shape.wanted_level(reluctant).max(current)
    }

    /// A tile of one page per level needs another finest level: what becomes of its own ones.
    fn want_own_levels(&mut self, group: u32, current: u32, level: u32) {
        let own_levels = self.shapes.of(group).own_levels();
        let first = self.shapes.own_parcels(group).start;
        let page = |level| Parcel::Page(PageId { group, level, page: [0, 0] });
        for finer in current..level.min(own_levels) {
            self.release(page(finer), first + finer);
        }
        for needed in level..current.min(own_levels) {
            self.need(page(needed), first + needed);
        }
    }

    fn want_pages(&mut self, group: u32, demand: &Demand) {
        let first = self.shapes.own_parcels(group).start;
        let (bias, shape) = (self.pressure.bias(), self.shapes.of(group));
        let next: Vec<u32> = demand
            .pages(group)
            .iter()
            .filter(|p| p.detail.biased(bias).0 < shape.leaves(shape.page(group, p.index).level))
            .map(|p| first + p.index)
            .collect();
        if next == self.wanted_pages.get(group) {
            return;
        }
        let last = self.wanted_pages.set(group, next.clone());
        // Finest first, so that pages leave in this order.
        for &index in last.iter().filter(|i| next.binary_search(i).is_err()) {
            self.release(self.shapes.own_page(group, index), index);
        }
        for &index in next.iter().filter(|i| last.binary_search(i).is_err()) {
            self.need(self.shapes.own_page(group, index), index);
        }
    }

    fn need(&mut self, parcel: Parcel, index: u32) {
        self.work.spend(Item::Need, 1);
        self.pool.need(parcel, index);
        if let Some(over) = parcel.bundle_over() {
            self.needed_under[self.shapes.index(over) as usize] += 1;
        }
        if self.is_damaged(parcel) {
            self.pool.add_hole(index);
        } else if !self.pool.is_resident(index) {
            self.count_missing(parcel, true);
        }
    }

    fn release(&mut self, parcel: Parcel, index: u32) {
        self.work.spend(Item::Need, 1);
        self.pool.release(parcel, index);
        if let Some(over) = parcel.bundle_over() {
            self.needed_under[self.shapes.index(over) as usize] -= 1;
        }
        if !self.pool.is_resident(index) && !self.is_damaged(parcel) {
            self.count_missing(parcel, false);
            self.forget(parcel, index);
        }
    }

    /// Cancels a parcel that is on its way, or drops it.
    fn forget(&mut self, parcel: Parcel, index: u32) {
        match self.set_flight(parcel, index, Flight::None) {
            Flight::Asked | Flight::Ahead => {
                self.work.spend(Item::Cancel, 1);
                self.cancels.push(parcel);
            }
            Flight::Waiting => {
                self.waiting.remove(&index);
            }
            Flight::None => return,
        }
        self.wake_under(parcel);
    }

    /// Tells the loader what has been cancelled and asked for since it was told last.
    pub(crate) fn tell(&mut self, loader: &mut dyn ParcelLoader) {
        loader.cancel_all(&self.cancels);
        loader.request_all(&self.asks);
        self.cancels.clear();
        self.asks.clear();
    }

    /// Lets the bias follow the demand.
    pub(crate) fn adapt(&mut self, demand: &Demand, is_moving: bool) {
        if is_moving {
            self.pressure.relax();
        }
        // As long as the last bias has not reached all groups, more is needed than need be.
        if self.exact_backlog > 0 {
            return;
        }
        let (needed, atlas) = (self.pool.needed().texels, self.pool.shape().texels());
        if self.pressure.update(needed, atlas) {
            for (family, details) in (0..).zip(demand.details().chunks(FAMILY as usize)) {
                if details.iter().any(|detail| detail.is_visible()) {
                    self.put_off(family, Backlog::Exact);
                }
            }
        }
    }

    /// Asks for what is missing, the most urgent first, within limits.
    pub(crate) fn request(&mut self, demand: &Demand, limits: &RequestLimits) {
        while self.has_free_request(limits) && self.work.may(Task::Ask) {
            let Some((owner, urgency)) = self.wishes.take() else { return };
            let (levels, side) = match self.shapes.group_of_owner(owner) {
                Some(group) => {
                    let finest = self.wanted_level(group).unwrap_or(0);
                    let levels = self.shapes.of(group).level_count() - finest;
                    (levels, self.side_log2(group, demand.detail(group)))
                }
                None => self.bundle_error(self.shapes.parcel(owner)),
            };
            for (parcel, index) in self.missing_parcels(owner) {
                if !self.has_free_request(limits) {
                    self.wishes.put_back(owner, urgency);
                    break;
                }
                let urgency = requests::urgency(levels.saturating_sub(self.step_of(parcel)), side);
                self.ask(parcel, index, f32::from(urgency), false);
            }
        }
    }

    /// Levels from the coarsest.
    fn step_of(&self, parcel: Parcel) -> u32 {
        match parcel {
            Parcel::Bundle { step, .. } => step,
            Parcel::Page(page) => self.shapes.of(page.group).level_count() - 1 - page.level,
        }
    }

    fn has_free_request(&self, limits: &RequestLimits) -> bool {
        self.pending + self.waiting.len() < limits.parcels && self.in_flight_texels < limits.texels
    }

    /// The needed parcels of an owner that are neither resident, nor on their way, nor known to be damaged; the coarsest first.
    fn missing_parcels(&self, owner: u32) -> Vec<(Parcel, u32)> {
        let all = self.parcels_of(owner);
        let needed: Vec<u32> = match self.shapes.group_of_owner(owner) {
            Some(group) if self.shapes.of(group).is_paged() => self.wanted_pages.get(group).to_vec(),
            Some(group) => (all.start + u32::from(self.wanted[group as usize])..all.end).collect(),
            None => all.filter(|&index| self.pool.is_needed(index)).collect(),
        };
        let is_asked = |index: &u32| matches!(self.flight(*index), Flight::Asked | Flight::Waiting);
        needed
            .into_iter()
            .rev()
            .filter(|&index| !self.pool.is_resident(index) && !is_asked(&index))
            .map(|index| match self.shapes.group_of_owner(owner) {
                Some(group) => (self.shapes.own_page(group, index), index),
                None => (self.shapes.parcel(index), index),
            })
            .filter(|&(parcel, _)| !self.is_damaged(parcel))
            .collect()
    }

    fn is_damaged(&self, parcel: Parcel) -> bool {
        !self.damaged.is_empty() && self.damaged.contains_key(&parcel)
    }

    fn ask(&mut self, parcel: Parcel, index: u32, urgency: f32, is_ahead: bool) {
        self.work.spend(Item::Ask, 1);
        self.asks.push((parcel, urgency));
        let flight = if is_ahead { Flight::Ahead } else { Flight::Asked };
        if self.set_flight(parcel, index, flight) == Flight::None {
            self.requests += 1;
        }
    }

    /// The texels of these pages are others now. What is resident stays until its new texels arrive.
    pub(crate) fn invalidate(&mut self, pages: &[PageId], demand: &Demand) {
        let parcels: BTreeSet<Parcel> = pages.iter().map(|&page| self.shapes.parcel_of(page)).collect();
        for parcel in parcels {
            let index = self.shapes.index(parcel);
            self.hope_for(parcel, index);
            self.forget(parcel, index);
            if self.pool.is_resident(index) {
                self.ask(parcel, index, f32::from(u8::MAX), false);
            } else {
                self.wish(self.shapes.owner(parcel), demand);
            }
        }
    }

    /// Puts an owner among the wishes, if it lacks anything.
    fn wish(&mut self, owner: u32, demand: &Demand) {
        match self.shapes.group_of_owner(owner) {
            Some(group) if self.missing[owner as usize] > 0 => {
                self.wish_for(group, self.missing[owner as usize], demand.detail(group));
            }
            Some(_) => {}
            None => self.wish_for_bundle(owner, self.shapes.parcel(owner)),
        }
    }

    /// Asks for damaged parcels again.
    pub(crate) fn retry_damaged(&mut self, demand: &Demand) {
        for parcel in self.damaged.keys().copied().collect::<Vec<_>>() {
            self.hope_for(parcel, self.shapes.index(parcel));
            self.wish(self.shapes.owner(parcel), demand);
        }
    }

    /// A parcel may be readable again. (It stays a hole until it has been read: what lies under it keeps its place.)
    fn hope_for(&mut self, parcel: Parcel, index: u32) {
        let was_damaged = self.damaged.remove(&parcel).is_some();
        if was_damaged && self.pool.is_needed(index) && !self.pool.is_resident(index) {
            self.count_missing(parcel, true);
            self.update_lacks(parcel);
        }
    }

    /// Begins anew in an empty atlas of another shape.
    pub(crate) fn set_atlas(&mut self, atlas: AtlasShape, demand: &Demand) {
        self.pressure.reset();
        let lost: Vec<Parcel> = (0..self.flights.len() as u32)
            .filter(|&index| self.pool.is_needed(index) && self.pool.is_resident(index))
            .map(|index| self.shapes.parcel(index))
            .collect();
        self.pool.reset(atlas);
        for parcel in lost {
            if !self.is_damaged(parcel) {
                self.count_missing(parcel, true);
                self.update_lacks(parcel);
            }
        }
        for &parcel in self.damaged.keys() {
            self.pool.add_hole(self.shapes.index(parcel));
        }
        self.ready.extend(self.waiting.keys().copied());
        for owner in 0..self.missing.len() as u32 {
            self.wish(owner, demand);
        }
    }
}
