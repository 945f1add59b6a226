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

mod ahead;
mod arrivals;
mod packer;
mod pool;
mod pressure;
#[cfg(test)]
mod tests;
mod wants;
mod wishes;
mod work;

pub(crate) use pool::COUNTED_LEVELS;
pub use pool::ParcelCount;
pub use wants::RequestLimits;
pub use work::{FrameWork, WORK_COSTS, WORK_KINDS};

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;

use fantex_store::PageError;

use crate::parcel::{FAMILY, SHARED_LEVELS};
use crate::shape::{Detail, TileShapes};
use crate::sparse_lists::SparseLists;
use crate::{AtlasShape, PageTable, Parcel, ParcelTexels, TableChange};
use pool::Pool;
use pressure::Pressure;
use wants::Backlog;
use wishes::Wishes;
use work::Work;

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
            frame_work: work::FRAME,
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
            true => work::FILLING_SECONDS,
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
