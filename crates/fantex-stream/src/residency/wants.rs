//! From what a view needs to pages that are needed, asked for, or cancelled.

use fantex_store::PageId;

use super::{Flight, Residency};
use crate::demand::Demand;
use crate::shape::{Detail, TileShape};
use crate::{AtlasShape, PageLoader};

/// Steps of [`Detail`] by which a demand must have become coarser before a finer level counts as unneeded.
const RELUCTANCE: u8 = 2;

/// Groups whose demand is taken over in one frame. Each takes about 0.2 us where pages become needed or unneeded.
const WANTS_PER_FRAME: usize = 1 << 15;

/// Pages that are asked for in a sixtieth of a second. Each takes about 0.5 us, mostly the loader's.
const ASKS_PER_FRAME: usize = 1 << 12;

/// Whether and how the demand of a group waits to be taken over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Backlog {
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
    /// Pages asked for or waiting for coarser ones.
    pub pages: usize,
    /// Their texels.
    pub texels: u64,
}

impl Default for RequestLimits {
    /// Enough to keep a fast disk busy: 16384 pages, 8 Mi texels.
    fn default() -> Self {
        Self { pages: 1 << 14, texels: 8 << 20 }
    }
}

/// Share of the atlas that needed pages and pages fetched ahead may fill together.
const AHEAD_SHARE: f64 = 0.85;

impl Residency {
    /// Takes over the demand of the groups for which it has changed, of so many per frame: a cut to a view of hundreds of
    /// thousands of tiles, or another bias for them, is spread over some frames.
    pub(crate) fn want(&mut self, changed: &[u32], demand: &Demand) {
        for &group in changed {
            self.put_off(group, Backlog::Changed);
        }
        for _ in 0..self.backlog.len().min(WANTS_PER_FRAME) {
            let Some(group) = self.backlog.pop_front() else { return };
            let reluctance = match std::mem::replace(&mut self.in_backlog[group as usize], Backlog::Done) {
                Backlog::Exact => {
                    self.exact_backlog -= 1;
                    0
                }
                Backlog::Changed | Backlog::Done => RELUCTANCE,
            };
            self.want_with(group, demand, reluctance);
        }
    }

    fn put_off(&mut self, group: u32, how: Backlog) {
        let waits = &mut self.in_backlog[group as usize];
        if *waits == Backlog::Done {
            self.backlog.push_back(group);
        }
        if how == Backlog::Exact && *waits != Backlog::Exact {
            self.exact_backlog += 1;
        }
        if *waits != Backlog::Exact {
            *waits = how;
        }
    }

    fn want_with(&mut self, group: u32, demand: &Demand, reluctance: u8) {
        let detail = demand.detail(group);
        let is_paged = self.shapes.of(group).is_paged();
        self.pressure.count(group, demand, &self.shapes);
        let level = self.level_for(group, detail, reluctance);
        if !is_paged && level == u32::from(self.wanted[group as usize]) {
            if self.missing[group as usize] > 0 {
                self.wish(group, detail);
            }
            return;
        }
        let was_visible = self.is_wanted(group);
        if is_paged {
            self.want_pages(group, demand);
        } else {
            self.want_level(group, level);
        }
        match (was_visible, self.is_wanted(group)) {
            (false, true) => self.visible_groups += 1,
            (true, false) => self.visible_groups -= 1,
            _ => {}
        }
        if self.missing[group as usize] > 0 {
            self.wish(group, detail);
        }
    }

    fn is_wanted(&self, group: u32) -> bool {
        let shape = self.shapes.of(group);
        match shape.is_paged() {
            true => self.wanted_pages.contains_key(&group),
            false => u32::from(self.wanted[group as usize]) < shape.level_count(),
        }
    }

    fn wish(&mut self, group: u32, detail: Detail) {
        let side = self.side_log2(group, detail);
        self.wishes.put(group, self.missing[group as usize], side);
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

    fn want_level(&mut self, group: u32, level: u32) {
        let current = u32::from(std::mem::replace(&mut self.wanted[group as usize], level as u8));
        let first = self.pool.table().first(group);
        let page = |level| PageId { group, level, page: [0, 0] };
        for finer in current..level {
            self.release(page(finer), first + finer);
        }
        for needed in level..current {
            self.need(page(needed), first + needed);
        }
    }

    fn want_pages(&mut self, group: u32, demand: &Demand) {
        let first = self.pool.table().first(group);
        let (bias, shape) = (self.pressure.bias(), self.shapes.of(group));
        let next: Vec<u32> = demand
            .pages(group)
            .iter()
            .filter(|p| p.detail.biased(bias).0 < shape.leaves(shape.page(group, p.index).level))
            .map(|p| first + p.index)
            .collect();
        let last = self.wanted_pages.remove(&group).unwrap_or_default();
        // Finest first, so that pages leave in this order.
        for &index in last.iter().filter(|i| next.binary_search(i).is_err()) {
            self.release(self.pool.page(group, index), index);
        }
        for &index in next.iter().filter(|i| last.binary_search(i).is_err()) {
            self.need(self.pool.page(group, index), index);
        }
        if !next.is_empty() {
            self.wanted_pages.insert(group, next);
        }
    }

    fn need(&mut self, page: PageId, index: u32) {
        self.pool.need(page, index);
        if self.is_damaged(page) {
            self.pool.add_hole(index);
        } else if !self.pool.is_resident(index) {
            self.count_missing(page.group, true);
        }
    }

    fn release(&mut self, page: PageId, index: u32) {
        self.pool.release(page, index);
        if !self.pool.is_resident(index) && !self.is_damaged(page) {
            self.count_missing(page.group, false);
            self.forget(page, index);
        }
    }

    /// Cancels a page that is on its way, or drops it.
    pub(super) fn forget(&mut self, page: PageId, index: u32) {
        match self.set_flight(page, index, Flight::None) {
            Flight::Asked | Flight::Ahead => self.cancels.push(page),
            Flight::Waiting => {
                self.waiting.remove(&index);
            }
            Flight::None => {}
        }
    }

    /// Tells the loader what has been cancelled and asked for since it was told last.
    pub(crate) fn tell(&mut self, loader: &mut dyn PageLoader) {
        loader.cancel_all(&self.cancels);
        loader.request_all(&self.asks);
        self.cancels.clear();
        self.asks.clear();
    }

    pub(super) fn texels(&self, page: PageId) -> u64 {
        let [w, h] = self.shapes.of(page.group).page_extent(page.level, page.page).map(u64::from);
        w * h
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
            for (group, detail) in (0..).zip(demand.details()) {
                if detail.is_visible() {
                    self.put_off(group, Backlog::Exact);
                }
            }
        }
    }

    /// Asks for what is missing, the most urgent first, within limits.
    pub(crate) fn request(&mut self, demand: &Demand, limits: &RequestLimits) {
        let most = self.asks.len() + self.pace.times(ASKS_PER_FRAME);
        while self.has_free_request(limits) && self.asks.len() < most {
            let Some((group, urgency)) = self.wishes.take() else { return };
            let finest = self.wanted_level(group).unwrap_or(0);
            let side = self.side_log2(group, demand.detail(group));
            for (page, index) in self.missing_pages(group) {
                if !self.has_free_request(limits) {
                    self.wishes.put_back(group, urgency);
                    break;
                }
                let urgency = f32::from(super::wishes::urgency(page.level + 1 - finest, side));
                self.ask(page, index, urgency, false);
            }
        }
    }

    fn has_free_request(&self, limits: &RequestLimits) -> bool {
        self.pending_pages + self.waiting.len() < limits.pages && self.in_flight_texels < limits.texels
    }

    /// The needed pages of a group that are neither resident, nor on their way, nor known to be damaged; the coarsest first.
    fn missing_pages(&self, group: u32) -> Vec<(PageId, u32)> {
        let first = self.pool.table().first(group);
        let shape = self.shapes.of(group);
        let needed: Vec<u32> = if shape.is_paged() {
            self.wanted_pages.get(&group).cloned().unwrap_or_default()
        } else {
            (u32::from(self.wanted[group as usize])..shape.level_count()).map(|l| first + l).collect()
        };
        let is_asked = |index: &u32| matches!(self.flight(*index), Flight::Asked | Flight::Waiting);
        needed
            .into_iter()
            .rev()
            .filter(|&i| !self.pool.is_resident(i) && !is_asked(&i))
            .map(|i| (self.pool.page(group, i), i))
            .filter(|&(page, _)| !self.is_damaged(page))
            .collect()
    }

    pub(super) fn is_damaged(&self, page: PageId) -> bool {
        !self.damaged.is_empty() && self.damaged.contains_key(&page)
    }

    fn ask(&mut self, page: PageId, index: u32, urgency: f32, is_ahead: bool) {
        self.asks.push((page, urgency));
        let flight = if is_ahead { Flight::Ahead } else { Flight::Asked };
        if self.set_flight(page, index, flight) == Flight::None {
            self.requests += 1;
        }
    }

    /// Groups whose demand in the predicted view has changed: what is no longer expected is cancelled, what is now expected
    /// is asked for when there is nothing better to do.
    pub(crate) fn expect(&mut self, changed: &[u32], predicted: &Demand) {
        for &group in changed {
            let shape = self.shapes.of(group);
            let first = self.pool.table().first(group);
            let unexpected: Vec<(PageId, u32)> = self
                .pool
                .pages_of(group)
                .filter(|&index| self.flight(index) == Flight::Ahead)
                .map(|index| (self.pool.page(group, index), index))
                .filter(|&(page, index)| !is_expected(shape, page, index - first, predicted, self.bias()))
                .collect();
            for (page, index) in unexpected {
                self.forget(page, index);
            }
            if predicted.detail(group).is_visible() {
                self.ahead.push_back(group);
            }
        }
    }

    /// Asks for pages that the predicted view needs, while all that is missing has been asked for and there is
    /// room to spare.
    pub(crate) fn request_ahead(&mut self, predicted: &Demand, limits: &RequestLimits) {
        if self.wishes() > 0 {
            return;
        }
        let limits = RequestLimits { pages: limits.pages / 4, texels: limits.texels / 4 };
        let room = (self.pool.shape().texels() as f64 * AHEAD_SHARE) as u64;
        while self.has_free_request(&limits) && self.pool.needed().texels + self.in_flight_texels < room {
            let Some(group) = self.ahead.pop_front() else { return };
            let shape = self.shapes.of(group);
            let first = self.pool.table().first(group);
            let pages: Vec<u32> = if shape.is_paged() {
                predicted.pages(group).iter().rev().map(|p| p.index).collect()
            } else {
                (0..shape.level_count()).rev().collect()
            };
            for i in pages {
                let page = self.shapes.of(group).page(group, i);
                let index = first + i;
                let known = self.pool.is_resident(index) || self.flight(index) != Flight::None;
                let shape = self.shapes.of(group);
                if !known && is_expected(shape, page, i, predicted, self.bias()) && !self.is_damaged(page) {
                    self.ask(page, index, -1.0 + 0.01 * page.level as f32, true);
                }
            }
        }
    }

    /// Nothing is expected any more.
    pub(crate) fn expect_nothing(&mut self) {
        self.ahead.clear();
        let ahead: Vec<(PageId, u32)> =
            self.asked_ahead.iter().map(|(&index, &page)| (page, index)).collect();
        for (page, index) in ahead {
            self.forget(page, index);
        }
    }

    /// The texels of these pages are others now. What is resident stays until its new texels arrive.
    pub(crate) fn invalidate(&mut self, pages: &[PageId], demand: &Demand) {
        for &page in pages {
            let index = self.pool.index(page);
            self.hope_for(page, index);
            self.forget(page, index);
            if self.pool.is_resident(index) {
                self.ask(page, index, f32::from(u8::MAX), false);
            } else if self.missing[page.group as usize] > 0 {
                self.wish(page.group, demand.detail(page.group));
            }
        }
    }

    /// Asks for damaged pages again.
    pub(crate) fn retry_damaged(&mut self, demand: &Demand) {
        for page in self.damaged.keys().copied().collect::<Vec<_>>() {
            self.hope_for(page, self.pool.index(page));
            if self.missing[page.group as usize] > 0 {
                self.wish(page.group, demand.detail(page.group));
            }
        }
    }

    /// A page may be readable again. (It stays a hole until it has been read: what lies under it keeps its place.)
    fn hope_for(&mut self, page: PageId, index: u32) {
        let was_damaged = self.damaged.remove(&page).is_some();
        if was_damaged && self.pool.is_needed(index) && !self.pool.is_resident(index) {
            self.count_missing(page.group, true);
        }
    }

    /// Begins anew in an empty atlas of another shape.
    pub(crate) fn set_atlas(&mut self, atlas: AtlasShape, demand: &Demand) {
        self.pressure.reset();
        for group in 0..self.missing.len() as u32 {
            for index in self.pool.pages_of(group) {
                let is_readable = !self.is_damaged(self.pool.page(group, index));
                if self.pool.is_needed(index) && self.pool.is_resident(index) && is_readable {
                    self.count_missing(group, true);
                }
            }
        }
        self.pool.reset(atlas);
        for &page in self.damaged.keys() {
            self.pool.add_hole(self.pool.index(page));
        }
        self.ready.extend(self.waiting.keys().copied());
        for group in 0..self.missing.len() as u32 {
            if self.missing[group as usize] > 0 {
                self.wish(group, demand.detail(group));
            }
        }
    }
}

/// Whether a predicted view needs a page.
fn is_expected(shape: &TileShape, page: PageId, index_in_tile: u32, predicted: &Demand, bias: u8) -> bool {
    if shape.is_paged() {
        let pages = predicted.pages(page.group);
        pages
            .binary_search_by_key(&index_in_tile, |p| p.index)
            .is_ok_and(|i| pages[i].detail.biased(bias).0 < shape.leaves(page.level))
    } else {
        let detail = predicted.detail(page.group).biased(bias);
        shape.wanted_level(detail) <= page.level
    }
}
