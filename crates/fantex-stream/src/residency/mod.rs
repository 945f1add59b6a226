//! Residency: which parcels are needed, asked for, resident, and which leave.
//!
//! ```text
//!  demand of the present view ---.                 .--> RequestQueue --> Transfers --> arrivals --> Pool --> entries
//!                                 >--> Backlog --->                                      |
//!  demand of the predicted view -'        ^        '--> needs, bias <--------------------'
//! ```
//!
//! Both views feed one backlog and one queue; what only the predicted view needs has the lowest priority.
//!
//! Costs follow what changes, not what is there: a group costs something when its demand changes, a parcel when it is asked
//! for, arrives or leaves.
//!
//! A group needs levels of its own, and with its [bundle](crate::Parcel) the coarser ones: a bundle needs what any of its groups does.

mod budget;
mod packer;
mod pool;
mod requests;

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;

pub(crate) use budget::FRAME_NANOSECONDS;
use budget::{BiasControl, Item, Task, Work};
pub use budget::{FrameWork, WORK_COSTS, WORK_KINDS};
use fantex_base::Error;
use fantex_store::{PAGE, PageId};
use glam::Vec2;
pub(crate) use pool::COUNTED_LEVELS;
pub use pool::ParcelCount;
use pool::Pool;
pub use requests::RequestLimits;
use requests::{Priority, RequestQueue, RequestState, Transfers};

use crate::demand::{Demand, DemandWork};
use crate::parcel::{FAMILY, SHARED_LEVELS};
use crate::shape::{Detail, SparseLists, TileShapes};
use crate::{AtlasShape, Outline, PageTable, Parcel, ParcelLoader, StreamStatistics, UpdateTimes};

pub(crate) struct Residency {
    shapes: Arc<TileShapes>,
    pub(crate) pool: Pool,
    bias_control: BiasControl,
    backlog: Backlog,
    queue: RequestQueue,
    transfers: Transfers,
    pub(crate) work: Work,
    pub(crate) damaged: BTreeMap<Parcel, Error>,
    /// A damaged parcel has arrived after all, so that others may, too.
    has_recovered: bool,
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
    /// Per group what the predicted view needs, as far as it is taken over.
    expected: Vec<Detail>,
    missing_parcels: u64,
    visible_groups: u64,
    lacking_groups: u64,
    uploaded_bytes: u64,
}

impl Residency {
    /// `frame_nanoseconds`: counted work in a sixtieth of a second.
    pub(crate) fn new(
        shapes: Arc<TileShapes>,
        table: PageTable,
        atlas: AtlasShape,
        frame_nanoseconds: u32,
    ) -> Self {
        let groups = shapes.group_count();
        let wanted = (0..groups as u32).map(|g| shapes.of(g).level_count() as u8).collect();
        Self {
            pool: Pool::new(shapes.clone(), table, atlas),
            bias_control: BiasControl::new(&shapes),
            backlog: Backlog::new(groups.div_ceil(FAMILY as usize)),
            queue: RequestQueue::new(shapes.owner_count()),
            transfers: Transfers::new(shapes.clone()),
            work: Work::new(frame_nanoseconds),
            damaged: BTreeMap::new(),
            has_recovered: false,
            wanted,
            wanted_pages: SparseLists::new(groups),
            needed_under: vec![0; shapes.bundle_count() as usize],
            missing: vec![0; shapes.owner_count()],
            lacks: vec![false; groups],
            expected: vec![Detail::HIDDEN; groups],
            missing_parcels: 0,
            visible_groups: 0,
            lacking_groups: 0,
            uploaded_bytes: 0,
            shapes,
        }
    }

    /// Figures for graphs, without those of demand.
    pub(crate) fn statistics(&self) -> StreamStatistics {
        let pool = &self.pool;
        let (requested, waiting) = self.in_flight();
        // Of a family whose demand is not taken over yet all groups count as visible and lacking.
        let unknown = self.backlog.present.len() as u64 * u64::from(FAMILY);
        StreamStatistics {
            resident: pool.resident,
            resident_texels_by_level: pool.resident_by_level,
            needed: pool.needed,
            missing: self.missing_parcels,
            atlas_texels: pool.shape.texels(),
            evictions: pool.evictions,
            requested,
            waiting,
            queued: self.queued(),
            requests: self.transfers.request_count,
            uploaded_bytes: self.uploaded_bytes,
            bias_levels: f32::from(self.bias_control.bias) / Detail::STEPS as f32,
            visible_groups: self.visible_groups + unknown,
            complete_groups: self.visible_groups - self.lacking_groups,
            damaged: self.damaged.len(),
            recoverable: 0,
            work: DemandWork::default(),
            frame_work: self.work.done,
            frame_limit: self.work.frame,
            times: UpdateTimes::default(),
        }
    }

    /// Parcels asked for that have not arrived, and those that have arrived and wait.
    pub(crate) fn in_flight(&self) -> (usize, usize) {
        (self.transfers.pending, self.transfers.arrived.len())
    }

    /// Owners whose missing parcels have not been asked for, and groups whose demand may not have been taken over.
    pub(crate) fn queued(&self) -> usize {
        self.queue.urgent + self.backlog.present.len() * FAMILY as usize
    }

    pub(crate) fn has_backlog(&self) -> bool {
        !self.backlog.is_done()
    }

    /// What the atlas stores of a resident page.
    pub(crate) fn outline(&self, page: PageId) -> Outline {
        let parcel = self.shapes.parcel_of(page);
        let outline = self.pool.outline(self.shapes.index(parcel));
        let Parcel::Bundle { step, .. } = parcel else { return outline.clone() };
        let at = self.shapes.place_in_bundle(page.group, step).map(u32::from);
        outline.part(self.shapes.extent(parcel), at, self.shapes.of(page.group).extent(page.level))
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

    /// The finest level from `level` on whose page at a place of a tile, 0..1 along its sides, is resident.
    pub(crate) fn drawn_level(&self, group: u32, level: u32, uv: Vec2) -> Option<u32> {
        let shape = self.shapes.of(group);
        (level..shape.level_count()).find(|&level| {
            let extent = shape.extent(level);
            let page = [0, 1].map(|k| ((uv[k] * extent[k] as f32) as u32).min(extent[k] - 1) / PAGE);
            let parcel = self.shapes.parcel_of(PageId { group, level, page });
            self.pool.is_resident(self.shapes.index(parcel))
        })
    }

    /// Begins a frame. `is_cut`: the camera has jumped.
    pub(crate) fn begin_frame(&mut self, elapsed_seconds: f32, is_cut: bool) {
        let lacking = self.lacking_groups as f32 / self.visible_groups.max(1) as f32;
        self.work.begin_frame(elapsed_seconds, is_cut, lacking);
        self.pool.begin_frame();
    }

    /// Panics where an invariant does not hold. Takes time linear in all parcels.
    pub(crate) fn check(&self) {
        self.pool.check();
        let missing: u64 = self.missing.iter().map(|&n| u64::from(n)).sum();
        assert_eq!(missing, self.missing_parcels);
        assert_eq!(self.lacks.iter().filter(|&&lacks| lacks).count() as u64, self.lacking_groups);
        let (mut counts, mut texels, mut prefetched) = ([0; 4], 0, BTreeMap::new());
        for owner in 0..self.shapes.owner_count() as u32 {
            for index in self.parcels_of(owner) {
                let (state, parcel) = (self.transfers.state(index), self.shapes.parcel(index));
                assert_eq!(self.shapes.owner(parcel), owner);
                counts[state as usize] += 1;
                texels += if state == RequestState::Idle { 0 } else { self.shapes.texels(parcel) };
                if state == RequestState::Prefetched {
                    prefetched.insert(index, parcel);
                }
                assert_eq!(state == RequestState::Arrived, self.transfers.arrived.contains_key(&index));
            }
            let parcels = self.parcels_of(owner).map(|index| self.shapes.parcel(index));
            let missing = parcels.filter(|&parcel| self.is_missing(parcel)).count() as u32;
            assert_eq!(missing, self.missing[owner as usize]);
        }
        assert_eq!(texels, self.transfers.texels);
        assert_eq!(counts[1] + counts[2], self.transfers.pending);
        assert_eq!(prefetched, self.transfers.prefetched);
        if self.backlog.is_done() {
            for group in 0..self.lacks.len() as u32 {
                assert_eq!(self.lacks[group as usize], self.is_lacking(group));
            }
        }
    }

    /// Side of a tile on the screen, pixels, as a binary logarithm.
    fn side_log2(&self, group: u32, detail: Detail) -> f32 {
        self.shapes.of(group).side_log2 - f32::from(detail.0) / Detail::STEPS as f32
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

/// Steps of [`Detail`] by which a demand must have become coarser before a finer level counts as unneeded.
const HYSTERESIS: u8 = 2;

/// Families of groups whose demand has changed and is not taken over yet.
struct Backlog {
    present: VecDeque<u32>,
    predicted: VecDeque<u32>,
    /// Per family which of the bits below hold.
    reasons: Vec<u8>,
    /// Families with the bit [`Backlog::EXACT`].
    exact: usize,
}

impl Backlog {
    /// The demand of the present view has changed.
    const CHANGED: u8 = 1;
    /// The bias has changed: what is no longer needed with it is released at once.
    const EXACT: u8 = 2;
    /// The demand of the predicted view has changed.
    const PREDICTED: u8 = 4;

    fn new(family_count: usize) -> Self {
        let (present, predicted) = (VecDeque::new(), VecDeque::new());
        Self { present, predicted, reasons: vec![0; family_count], exact: 0 }
    }

    fn put(&mut self, family: u32, reason: u8) {
        let reasons = &mut self.reasons[family as usize];
        let last = std::mem::replace(reasons, *reasons | reason);
        match (reason, last) {
            (Self::PREDICTED, _) if last & Self::PREDICTED == 0 => self.predicted.push_back(family),
            (Self::PREDICTED, _) => {}
            _ if last & !Self::PREDICTED == 0 => self.present.push_back(family),
            _ => {}
        }
        self.exact += usize::from(reason == Self::EXACT && last & Self::EXACT == 0);
    }

    /// A family with changes in the present view, and whether another bias is among them.
    fn take_present(&mut self) -> Option<(u32, bool)> {
        let family = self.present.pop_front()?;
        let reasons = &mut self.reasons[family as usize];
        let is_exact = *reasons & Self::EXACT != 0;
        *reasons &= Self::PREDICTED;
        self.exact -= usize::from(is_exact);
        Some((family, is_exact))
    }

    fn take_predicted(&mut self) -> Option<u32> {
        let family = self.predicted.pop_front()?;
        self.reasons[family as usize] &= !Self::PREDICTED;
        Some(family)
    }

    fn clear_predicted(&mut self) {
        while self.take_predicted().is_some() {}
    }

    /// Whether the present view's demand is taken over.
    fn is_done(&self) -> bool {
        self.present.is_empty()
    }

    fn has_exact(&self) -> bool {
        self.exact > 0
    }
}

impl Residency {
    /// Takes over the demand of the groups for which it has changed, within the frame's work: a cut to a view of hundreds of
    /// thousands of tiles, or another bias for them, is spread over some frames.
    pub(crate) fn want(&mut self, changed: &[u32], demand: &Demand) {
        self.work.spend(Item::Bounding, demand.nanoseconds());
        self.defer(changed, Backlog::CHANGED);
        while !self.backlog.is_done() && self.work.may(Task::Want) {
            let Some((family, is_exact)) = self.backlog.take_present() else { break };
            self.want_family(family, demand, if is_exact { 0 } else { HYSTERESIS });
        }
    }

    /// The same for the predicted view: what is no longer expected is cancelled, what is now expected is asked for when there is
    /// nothing better to do.
    pub(crate) fn expect(&mut self, changed: &[u32], predicted: &Demand) {
        if !self.has_unexpected() {
            self.work.spend(Item::Bounding, predicted.nanoseconds());
        }
        self.defer(changed, Backlog::PREDICTED);
        while self.work.may(Task::Request)
            && let Some(family) = self.backlog.take_predicted()
        {
            for step in 0..SHARED_LEVELS {
                for bundle in self.shapes.family_bundles(family, step) {
                    self.expect_owner(self.shapes.index(Parcel::Bundle { bundle, step }), predicted);
                }
            }
            for group in self.shapes.groups(family, 0) {
                let detail = predicted.detail(group);
                let last = std::mem::replace(&mut self.expected[group as usize], detail);
                let shape = self.shapes.of(group);
                if shape.own_levels() > 0 && (last != detail || shape.is_paged()) {
                    self.expect_owner(self.shapes.owner_of_group(group), predicted);
                }
            }
        }
    }

    /// Whether some changes in the predicted view wait for the next frame.
    pub(crate) fn has_unexpected(&self) -> bool {
        !self.backlog.predicted.is_empty()
    }

    fn defer(&mut self, changed: &[u32], reason: u8) {
        let mut last = None;
        for family in changed.iter().map(|group| group / FAMILY) {
            if last.replace(family) != Some(family) {
                self.backlog.put(family, reason);
            }
        }
    }

    fn expect_owner(&mut self, owner: u32, predicted: &Demand) {
        self.work.spend(Item::Expect, 1);
        let unexpected: Vec<(Parcel, u32)> = self
            .parcels_of(owner)
            .filter(|&index| self.transfers.state(index) == RequestState::Prefetched)
            .map(|index| (self.parcel_of_owner(owner, index), index))
            .filter(|&(parcel, index)| !self.is_expected(parcel, index, predicted))
            .collect();
        for (parcel, index) in unexpected {
            self.cancel(parcel, index);
        }
        let needs_any = match self.shapes.group_of_owner(owner) {
            Some(group) => {
                let wanted = self.shapes.of(group).wanted_level(predicted.detail(group));
                wanted < self.shapes.of(group).own_levels()
            }
            None => self.is_expected(self.shapes.parcel(owner), owner, predicted),
        };
        if needs_any {
            self.queue.put_ahead(owner);
        }
    }

    fn is_expected(&self, parcel: Parcel, index: u32, predicted: &Demand) -> bool {
        let bias = self.bias_control.bias;
        let wants = |group: u32, level: u32| {
            self.shapes.of(group).wanted_level(predicted.detail(group).biased(bias)) <= level
        };
        match parcel {
            Parcel::Bundle { bundle, step } => self.shapes.groups(bundle, step).any(|group| {
                self.shapes.of(group).level_at_step(step).is_some_and(|level| wants(group, level))
            }),
            Parcel::Page(page) if self.shapes.of(page.group).is_paged() => {
                let pages = predicted.pages(page.group);
                let in_tile = index - self.shapes.own_parcels(page.group).start;
                let leaves = self.shapes.of(page.group).leaves(page.level);
                pages
                    .binary_search_by_key(&in_tile, |p| p.index)
                    .is_ok_and(|i| pages[i].detail.biased(bias).0 < leaves)
            }
            Parcel::Page(page) => wants(page.group, page.level),
        }
    }

    /// Takes over the demand of a family, then what it means for the bundles.
    fn want_family(&mut self, family: u32, demand: &Demand, hysteresis: u8) {
        // A bit for each group.
        let mut changed = 0u32;
        for (i, group) in self.shapes.groups(family, 0).enumerate() {
            // What has not changed is wanted as before, unless the bias is another one.
            let has_changed = demand.detail(group) != self.bias_control.counted[group as usize];
            if has_changed || hysteresis == 0 || self.shapes.of(group).is_paged() {
                changed |= 1 << i;
                self.want_with(group, demand, hysteresis);
            }
        }
        self.work.spend(Item::Family, 1);
        self.work.spend(Item::Group, changed.count_ones());
        if self.want_bundles(family, hysteresis) {
            changed = u32::MAX;
        }
        for (i, group) in self.shapes.groups(family, 0).enumerate() {
            if changed >> i & 1 == 1 {
                self.update_lack(group);
            }
        }
    }

    /// Takes over the demand of a group. Whether it lacks something is seen later.
    fn want_with(&mut self, group: u32, demand: &Demand, hysteresis: u8) {
        self.bias_control.count(group, demand, &self.shapes);
        let detail = demand.detail(group);
        let level = self.level_for(group, detail, hysteresis);
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
            self.enqueue_group(group, missing, detail);
        }
    }

    fn is_wanted(&self, group: u32) -> bool {
        u32::from(self.wanted[group as usize]) < self.shapes.of(group).level_count()
    }

    /// Has the own pages of a group asked for.
    fn enqueue_group(&mut self, group: u32, missing: u32, detail: Detail) {
        let side_log2 = self.side_log2(group, detail);
        self.queue.put(self.shapes.owner_of_group(group), Priority::of_error(missing, side_log2));
    }

    /// Has a bundle asked for, if it is missing.
    fn enqueue_bundle(&mut self, index: u32, parcel: Parcel) {
        if self.missing[index as usize] > 0 {
            let (levels, side_log2) = self.bundle_error(parcel);
            let levels = levels.saturating_sub(self.step_of(parcel));
            self.queue.put(index, Priority::of_error(levels, side_log2));
        }
    }

    fn enqueue(&mut self, owner: u32, demand: &Demand) {
        match self.shapes.group_of_owner(owner) {
            Some(group) if self.missing[owner as usize] > 0 => {
                self.enqueue_group(group, self.missing[owner as usize], demand.detail(group));
            }
            Some(_) => {}
            None => self.enqueue_bundle(owner, self.shapes.parcel(owner)),
        }
    }

    /// How many levels a tile of a bundle needs at most, and the largest of their sides on the screen, pixels, as a binary
    /// logarithm.
    fn bundle_error(&self, parcel: Parcel) -> (u32, f32) {
        let Parcel::Bundle { bundle, step } = parcel else { return (1, 0.0) };
        let visible = self.shapes.groups(bundle, step).filter(|&group| self.is_wanted(group));
        visible.fold((step + 1, 0.0), |(levels, side): (u32, f32), group| {
            let needed = self.shapes.of(group).level_count() - u32::from(self.wanted[group as usize]);
            (levels.max(needed), side.max(self.side_log2(group, self.bias_control.counted[group as usize])))
        })
    }

    /// Bundles need what their groups do. Whether any becomes needed or unneeded.
    fn want_bundles(&mut self, family: u32, hysteresis: u8) -> bool {
        self.bias_control.count_family(family, &self.shapes);
        let bias = self.bias_control.bias;
        let mut has_changed = false;
        // Finest first, so that they leave in this order; what lies over something needed is needed.
        for step in (0..SHARED_LEVELS).rev() {
            for bundle in self.shapes.family_bundles(family, step) {
                let parcel = Parcel::Bundle { bundle, step };
                let index = self.shapes.index(parcel);
                let (until, was_needed) =
                    (self.bias_control.untils[index as usize], self.pool.is_needed(index));
                let hysteresis = if was_needed { hysteresis } else { 0 };
                let is_needed = until > 0 && until.saturating_add(hysteresis) > bias;
                // Groups whose demand is not taken over yet may still need theirs.
                match (was_needed, is_needed || self.needed_under[index as usize] > 0) {
                    (false, true) => self.need(parcel, index),
                    (true, false) => self.release(parcel, index),
                    _ => {}
                }
                has_changed |= was_needed != self.pool.is_needed(index);
                self.enqueue_bundle(index, parcel);
            }
        }
        has_changed
    }

    fn level_for(&self, group: u32, detail: Detail, hysteresis: u8) -> u32 {
        let shape = self.shapes.of(group);
        let current = u32::from(self.wanted[group as usize]);
        let level = shape.wanted_level(detail.biased(self.bias_control.bias));
        if level <= current || !detail.is_visible() {
            return level;
        }
        let reluctant = Detail(detail.0.saturating_sub(hysteresis)).biased(self.bias_control.bias);
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
        let (bias, shape) = (self.bias_control.bias, self.shapes.of(group));
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
            self.cancel(parcel, index);
        }
    }

    pub(crate) fn tell(&mut self, loader: &mut dyn ParcelLoader) {
        self.transfers.tell(loader);
    }

    /// Lets the bias follow the demand.
    pub(crate) fn adapt(&mut self, demand: &Demand, is_moving: bool) {
        if is_moving {
            self.bias_control.relax();
        }
        // As long as the last bias has not reached all groups, more is needed than need be.
        if self.backlog.has_exact() {
            return;
        }
        let (needed, atlas) = (self.pool.needed.texels, self.pool.rectangle_texels());
        if self.bias_control.update(needed, atlas) {
            for (family, details) in (0..).zip(demand.details.chunks(FAMILY as usize)) {
                if details.iter().any(|detail| detail.is_visible()) {
                    self.backlog.put(family, Backlog::EXACT);
                }
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

    /// Numbers of the needed parcels of an owner, finest first.
    fn needed_parcels(&self, owner: u32) -> Vec<u32> {
        let all = self.parcels_of(owner);
        match self.shapes.group_of_owner(owner) {
            Some(group) if self.shapes.of(group).is_paged() => self.wanted_pages.get(group).to_vec(),
            Some(group) => (all.start + u32::from(self.wanted[group as usize])..all.end).collect(),
            None => all.filter(|&index| self.pool.is_needed(index)).collect(),
        }
    }

    /// The parcel of a number that is one of an owner's.
    fn parcel_of_owner(&self, owner: u32, index: u32) -> Parcel {
        match self.shapes.group_of_owner(owner) {
            Some(group) => self.shapes.own_page(group, index),
            None => self.shapes.parcel(index),
        }
    }

    fn is_damaged(&self, parcel: Parcel) -> bool {
        !self.damaged.is_empty() && self.damaged.contains_key(&parcel)
    }

    /// Begins anew in an empty atlas of another shape.
    pub(crate) fn set_atlas(&mut self, atlas: AtlasShape, demand: &Demand) {
        self.bias_control.reset();
        let lost: Vec<Parcel> = (0..self.shapes.parcel_count() as u32)
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
        self.transfers.placeable.extend(self.transfers.arrived.keys().copied());
        for owner in 0..self.missing.len() as u32 {
            self.enqueue(owner, demand);
        }
    }
}
