//! Residency: which pages are wanted, asked for, resident, and which leave.
//!
//! ```text
//!  changed groups --want--> needed pages --Wishes--> requests --PageLoader--> arrivals --Pool--> entries
//!                     ^                                                          |
//!                     '--------------------- Pressure (bias) <-------------------'
//! ```
//!
//! Costs follow what changes, not what is there: a group costs something when its demand changes, a page when it is asked
//! for, arrives or leaves.

mod arrivals;
mod packer;
mod pool;
mod pressure;
#[cfg(test)]
mod tests;
mod wants;
mod wishes;

pub(crate) use pool::COUNTED_LEVELS;
pub use pool::PageCount;
pub use wants::RequestLimits;

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Arc;

use fantex_store::{PageError, PageId};

use crate::shape::{Detail, TileShapes};
use crate::{AtlasShape, PageTable, PageTexels, TableChange};
use pool::Pool;
use pressure::Pressure;
use wants::Backlog;
use wishes::Wishes;

/// Where a page is that is not resident (or is read again).
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
    /// Per group the finest level that is needed.
    wanted: Vec<u8>,
    /// Per large tile that is visible the indices of the pages that are needed, ascending.
    wanted_pages: HashMap<u32, Vec<u32>>,
    /// Per group the number of needed pages that are not resident.
    missing: Vec<u32>,
    /// Groups whose demand has changed and is not taken over yet, each once.
    backlog: VecDeque<u32>,
    in_backlog: Vec<Backlog>,
    /// Groups in the backlog that wait for another bias.
    exact_backlog: usize,
    missing_pages: u64,
    visible_groups: u64,
    lacking_groups: u64,
    wishes: Wishes,
    /// Groups that may be needed soon.
    ahead: VecDeque<u32>,
    /// Per page.
    flights: Vec<Flight>,
    /// Pages that are asked for.
    pending_pages: usize,
    /// Those of them that nothing needs yet.
    asked_ahead: BTreeMap<u32, PageId>,
    /// What the loader has not been told yet; cancels come before requests.
    cancels: Vec<PageId>,
    asks: Vec<(PageId, f32)>,
    /// Pages that have arrived and wait for coarser ones, or for room.
    waiting: BTreeMap<u32, (PageId, PageTexels)>,
    /// Those of them that need wait no longer.
    ready: VecDeque<u32>,
    in_flight_texels: u64,
    damaged: BTreeMap<PageId, PageError>,
    uploaded_bytes: u64,
    requests: u64,
    pace: Pace,
}

/// How much more than in a sixtieth of a second is done in a frame: slow frames, of which there are few, may take longer.
#[derive(Clone, Copy, Debug)]
struct Pace(f32);

impl Pace {
    fn of(elapsed_seconds: f32) -> Self {
        Self((elapsed_seconds * 60.0).clamp(1.0, 2.0))
    }

    fn times(self, count: usize) -> usize {
        (count as f32 * self.0) as usize
    }
}

impl Residency {
    pub(crate) fn new(shapes: Arc<TileShapes>, table: PageTable, atlas: AtlasShape) -> Self {
        let groups = shapes.group_count();
        let wanted = (0..groups as u32).map(|g| shapes.of(g).level_count() as u8).collect();
        Self {
            pressure: Pressure::new(groups),
            wanted,
            wanted_pages: HashMap::new(),
            missing: vec![0; groups],
            backlog: VecDeque::new(),
            in_backlog: vec![Backlog::Done; groups],
            exact_backlog: 0,
            missing_pages: 0,
            visible_groups: 0,
            lacking_groups: 0,
            wishes: Wishes::new(groups),
            ahead: VecDeque::new(),
            flights: vec![Flight::None; table.len()],
            pending_pages: 0,
            asked_ahead: BTreeMap::new(),
            cancels: Vec::new(),
            asks: Vec::new(),
            waiting: BTreeMap::new(),
            ready: VecDeque::new(),
            in_flight_texels: 0,
            damaged: BTreeMap::new(),
            uploaded_bytes: 0,
            requests: 0,
            pace: Pace::of(0.0),
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

    pub(crate) fn damaged(&self) -> &BTreeMap<PageId, PageError> {
        &self.damaged
    }

    /// Groups that need pages, and those of them that lack some or whose demand is not taken over yet.
    pub(crate) fn visible_and_lacking(&self) -> (u64, u64) {
        let unknown = self.backlog.len() as u64;
        (self.visible_groups + unknown, self.lacking_groups + unknown)
    }

    /// Pages asked for that have not arrived, and those that have arrived and wait.
    pub(crate) fn in_flight(&self) -> (usize, usize) {
        (self.pending_pages, self.waiting.len())
    }

    /// Groups whose missing pages have not been asked for.
    pub(crate) fn wishes(&self) -> usize {
        self.wishes.len() + self.backlog.len()
    }

    pub(crate) fn has_backlog(&self) -> bool {
        !self.backlog.is_empty()
    }

    /// Whether a page is needed and not resident, and may become so.
    pub(crate) fn is_missing(&self, page: PageId) -> bool {
        let index = self.pool.index(page);
        self.pool.is_needed(index) && !self.pool.is_resident(index) && !self.is_damaged(page)
    }

    pub(crate) fn all_missing_pages(&self) -> Vec<PageId> {
        let lacking = (0..).zip(&self.missing).filter(|(_, missing)| **missing > 0).map(|(group, _)| group);
        lacking
            .flat_map(|group| self.pool.pages_of(group).map(move |index| self.pool.page(group, index)))
            .filter(|&page| self.is_missing(page))
            .collect()
    }

    pub(crate) fn uploaded_bytes(&self) -> u64 {
        self.uploaded_bytes
    }

    /// Pages asked for since the beginning.
    pub(crate) fn requests(&self) -> u64 {
        self.requests
    }

    /// The finest level that a group needs, with the bias; `None` where it needs none.
    pub(crate) fn wanted_level(&self, group: u32) -> Option<u32> {
        let shape = self.shapes.of(group);
        let level = if shape.is_paged() {
            let pages = self.wanted_pages.get(&group)?;
            pages.first().map_or(shape.level_count(), |&i| self.pool.page(group, i).level)
        } else {
            u32::from(self.wanted[group as usize])
        };
        (level < shape.level_count()).then_some(level)
    }

    /// The finest level of which a page is resident.
    pub(crate) fn resident_level(&self, group: u32) -> Option<u32> {
        let resident = self.pool.pages_of(group).find(|&index| self.pool.is_resident(index))?;
        Some(self.pool.page(group, resident).level)
    }

    /// A frame begins, so long after the last one.
    pub(crate) fn begin_frame(&mut self, elapsed_seconds: f32) {
        self.pace = Pace::of(elapsed_seconds);
        self.pool.begin_frame();
    }

    pub(crate) fn take_changes(&mut self) -> Vec<TableChange> {
        self.pool.take_changes()
    }

    /// Needed pages that are not resident.
    pub(crate) fn missing_pages_count(&self) -> u64 {
        self.missing_pages
    }

    #[cfg(test)]
    pub(crate) fn check(&self) {
        self.pool.check();
        let missing: u64 = self.missing.iter().map(|&n| u64::from(n)).sum();
        assert_eq!(missing, self.missing_pages);
        assert_eq!(self.missing.iter().filter(|&&n| n > 0).count() as u64, self.lacking_groups);
        let (mut pages, mut texels, mut ahead) = ([0; 4], 0, BTreeMap::new());
        for group in 0..self.missing.len() as u32 {
            for index in self.pool.pages_of(group) {
                let (flight, page) = (self.flight(index), self.pool.page(group, index));
                pages[flight as usize] += 1;
                texels += if flight == Flight::None { 0 } else { self.texels(page) };
                if flight == Flight::Ahead {
                    ahead.insert(index, page);
                }
                assert_eq!(flight == Flight::Waiting, self.waiting.contains_key(&index));
            }
        }
        for (group, &missing) in (0..).zip(&self.missing) {
            let pages = self.pool.pages_of(group).map(|index| self.pool.page(group, index));
            assert_eq!(pages.filter(|&page| self.is_missing(page)).count() as u32, missing);
        }
        assert_eq!(texels, self.in_flight_texels);
        assert_eq!(pages[1] + pages[2], self.pending_pages);
        assert_eq!(ahead, self.asked_ahead);
    }

    fn flight(&self, index: u32) -> Flight {
        self.flights[index as usize]
    }

    /// A page is elsewhere from now on; returns where it was.
    fn set_flight(&mut self, page: PageId, index: u32, flight: Flight) -> Flight {
        let last = std::mem::replace(&mut self.flights[index as usize], flight);
        let is_pending = |flight| matches!(flight, Flight::Asked | Flight::Ahead);
        self.pending_pages -= usize::from(is_pending(last));
        self.pending_pages += usize::from(is_pending(flight));
        if last == Flight::Ahead {
            self.asked_ahead.remove(&index);
        }
        if flight == Flight::Ahead {
            self.asked_ahead.insert(index, page);
        }
        match (last, flight) {
            (Flight::None, Flight::None) => {}
            (Flight::None, _) => self.in_flight_texels += self.texels(page),
            (_, Flight::None) => self.in_flight_texels -= self.texels(page),
            _ => {}
        }
        last
    }

    /// Side of a tile on the screen, pixels, as a binary logarithm.
    fn side_log2(&self, group: u32, detail: Detail) -> f32 {
        let [w, h] = self.shapes.of(group).extent(0).map(|n| n.ilog2() as f32);
        0.5 * (w + h) - f32::from(detail.0) / Detail::STEPS as f32
    }

    /// A needed page is missing from now on, or (`more` false) is not missing any more.
    fn count_missing(&mut self, group: u32, more: bool) {
        let missing = &mut self.missing[group as usize];
        if more {
            self.lacking_groups += u64::from(*missing == 0);
            self.missing_pages += 1;
            *missing += 1;
        } else {
            *missing -= 1;
            self.missing_pages -= 1;
            self.lacking_groups -= u64::from(*missing == 0);
        }
    }
}
