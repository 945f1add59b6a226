//! From a need to texels in the atlas: what is asked for next, what is on its way, what has arrived.
//!
//! ```text
//!  needed and missing --> RequestQueue --request--> Transfers --ParcelLoader--> arrivals --Pool--> uploads, entries
//!  expected soon      -->
//! ```

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use fantex_base::Error;
use fantex_store::{PageId, io_cause};

use super::Residency;
use super::budget::{Item, Task};
use crate::demand::Demand;
use crate::read::is_transient;
use crate::shape::TileShapes;
use crate::{FrameChanges, LoadedParcel, Parcel, ParcelLoader, ParcelTexels, ParcelUpload};

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

impl RequestLimits {
    /// The share of what is fetched ahead.
    fn ahead(self) -> Self {
        Self { parcels: self.parcels / 4, texels: self.texels / 4 }
    }
}

/// How urgent a request is, greater numbers first: what only the predicted view needs comes last, the rest by its error on the
/// screen.
///
/// The error: by how many levels a tile is too coarse, then how large it is. The picture's middle counts no more than its rim: a
/// cut is sharp only when the last tile is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Priority(u8);

impl Priority {
    /// Nothing on the screen needs it yet.
    const AHEAD: Self = Self(0);
    const COUNT: usize = 65;

    /// `levels`: how many are missing; `side_log2`: of the tile on the screen, pixels.
    pub(super) fn of_error(levels: u32, side_log2: f32) -> Self {
        Self((1 + 4 * levels.min(13) + side_log2.clamp(0.0, 11.0) as u32) as u8)
    }
}

/// Urgency of texels that are shown and have changed.
const STALE_URGENCY: f32 = 255.0;

/// Parcels that are asked for at once when it is time to try them again.
const RETRIED_AT_ONCE: usize = 256;

/// Owners that lack parcels, each once, the most urgent first. Within one priority they come in order, so that neighbours, which lie in
/// one cluster, are asked for together.
pub(super) struct RequestQueue {
    /// Per priority; an owner whose priority changed leaves a stale entry.
    buckets: Vec<VecDeque<u32>>,
    /// Per owner.
    priorities: Vec<Option<Priority>>,
    /// Owners that the present view waits for.
    pub(super) urgent: usize,
    /// Entries since the last clearing, at most.
    moved: usize,
}

impl RequestQueue {
    pub(super) fn new(owner_count: usize) -> Self {
        Self {
            buckets: vec![VecDeque::new(); Priority::COUNT],
            priorities: vec![None; owner_count],
            urgent: 0,
            moved: 0,
        }
    }

    /// Puts an owner in, or moves it.
    pub(super) fn put(&mut self, owner: u32, priority: Priority) {
        if self.set(owner, Some(priority)) == Some(priority) {
            return;
        }
        self.buckets[usize::from(priority.0)].push_back(owner);
        self.moved += 1;
        if self.moved > self.priorities.len() {
            self.moved = 0;
            for (bucket, owners) in (0..).zip(&mut self.buckets) {
                owners.retain(|&owner| self.priorities[owner as usize] == Some(Priority(bucket)));
            }
        }
    }

    /// Puts an owner in for the predicted view, if it is not in.
    pub(super) fn put_ahead(&mut self, owner: u32) {
        if self.priorities[owner as usize].is_none() {
            self.put(owner, Priority::AHEAD);
        }
    }

    /// Puts an owner back where it was taken.
    fn put_back(&mut self, owner: u32, priority: Priority) {
        if self.priorities[owner as usize].is_none() {
            self.set(owner, Some(priority));
            self.buckets[usize::from(priority.0)].push_front(owner);
        }
    }

    fn set(&mut self, owner: u32, priority: Option<Priority>) -> Option<Priority> {
        let last = std::mem::replace(&mut self.priorities[owner as usize], priority);
        self.urgent -= usize::from(last > Some(Priority::AHEAD));
        self.urgent += usize::from(priority > Some(Priority::AHEAD));
        last
    }

    /// The priority of the most urgent owner.
    fn first_priority(&mut self) -> Option<Priority> {
        for (bucket, owners) in (0..Priority::COUNT as u8).zip(&mut self.buckets).rev() {
            let priority = Some(Priority(bucket));
            while owners.pop_front_if(|owner| self.priorities[*owner as usize] != priority).is_some() {}
            if !owners.is_empty() {
                return priority;
            }
        }
        None
    }

    /// Takes the first owner of the [`first_priority`](Self::first_priority) out.
    fn take(&mut self, priority: Priority) -> Option<u32> {
        let owner = self.buckets[usize::from(priority.0)].pop_front()?;
        self.set(owner, None);
        Some(owner)
    }

    /// Drops what only the predicted view needs.
    fn clear_ahead(&mut self) {
        for owner in std::mem::take(&mut self.buckets[0]) {
            if self.priorities[owner as usize] == Some(Priority::AHEAD) {
                self.priorities[owner as usize] = None;
            }
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RequestState {
    /// Not requested.
    Idle,
    /// Requested because it is needed.
    Requested,
    /// Requested for the predicted view only.
    Prefetched,
    /// Arrived; waits for coarser parcels or for room.
    Arrived,
}

/// Parcels between request and place.
pub(super) struct Transfers {
    shapes: Arc<TileShapes>,
    /// Per parcel.
    states: Vec<RequestState>,
    /// Parcels that are asked for and have not arrived.
    pub(super) pending: usize,
    /// Texels of all parcels that are not idle.
    pub(super) texels: u64,
    pub(super) prefetched: BTreeMap<u32, Parcel>,
    pub(super) arrived: BTreeMap<u32, (Parcel, ParcelTexels)>,
    /// Arrived parcels that may be placeable now.
    pub(super) placeable: VecDeque<u32>,
    /// Not sent to the loader yet; cancels go first.
    cancels: Vec<Parcel>,
    requests: Vec<(Parcel, f32)>,
    /// Since the beginning.
    pub(super) request_count: u64,
}

impl Transfers {
    pub(super) fn new(shapes: Arc<TileShapes>) -> Self {
        Self {
            states: vec![RequestState::Idle; shapes.parcel_count()],
            shapes,
            pending: 0,
            texels: 0,
            prefetched: BTreeMap::new(),
            arrived: BTreeMap::new(),
            placeable: VecDeque::new(),
            cancels: Vec::new(),
            requests: Vec::new(),
            request_count: 0,
        }
    }

    pub(super) fn state(&self, index: u32) -> RequestState {
        self.states[index as usize]
    }

    /// Returns the last state.
    fn set(&mut self, parcel: Parcel, index: u32, state: RequestState) -> RequestState {
        use RequestState::{Idle, Prefetched, Requested};
        let last = std::mem::replace(&mut self.states[index as usize], state);
        self.pending -= usize::from(matches!(last, Requested | Prefetched));
        self.pending += usize::from(matches!(state, Requested | Prefetched));
        if last == Prefetched {
            self.prefetched.remove(&index);
        }
        if state == Prefetched {
            self.prefetched.insert(index, parcel);
        }
        match (last, state) {
            (Idle, Idle) => {}
            (Idle, _) => self.texels += self.shapes.texels(parcel),
            (_, Idle) => self.texels -= self.shapes.texels(parcel),
            _ => {}
        }
        last
    }

    fn has_room(&self, limits: &RequestLimits) -> bool {
        self.pending + self.arrived.len() < limits.parcels && self.texels < limits.texels
    }

    fn request(&mut self, parcel: Parcel, index: u32, urgency: f32, state: RequestState) {
        self.requests.push((parcel, urgency));
        if self.set(parcel, index, state) == RequestState::Idle {
            self.request_count += 1;
        }
    }

    /// Sends cancels and requests to the loader.
    pub(super) fn tell(&mut self, loader: &mut dyn ParcelLoader) {
        loader.cancel_all(&self.cancels);
        loader.request_all(&self.requests);
        self.cancels.clear();
        self.requests.clear();
    }
}

/// Share of the atlas that needed parcels and those fetched ahead may fill together.
const AHEAD_SHARE: f64 = 0.85;

/// Frames after which a parcel that is not needed makes room for one that is fetched ahead: about as many as it is fetched
/// ahead.
const AHEAD_AGE: u32 = 15;

/// A poll asks for this fraction of a frame's bytes: parcels may be small and many.
const POLLS_PER_FRAME: usize = 16;

impl Residency {
    /// Asks for what is missing, the most urgent first, within limits; then, given a predicted view, for what that needs, while there
    /// is room to spare.
    pub(crate) fn request(&mut self, demand: &Demand, predicted: Option<&Demand>, limits: &RequestLimits) {
        while self.work.may(Task::Request)
            && let Some(priority) = self.queue.first_priority()
        {
            let is_ahead = priority == Priority::AHEAD;
            let limits = if is_ahead { limits.ahead() } else { *limits };
            let may = self.transfers.has_room(&limits)
                && (!is_ahead || predicted.is_some() && self.has_room_ahead() && self.backlog.is_done());
            if !may {
                return;
            }
            let Some(owner) = self.queue.take(priority) else { return };
            match predicted.filter(|_| is_ahead) {
                Some(predicted) => self.request_ahead(owner, predicted),
                None => self.request_missing(owner, priority, demand, &limits),
            }
        }
    }

    /// Whether the atlas has room for more than what is needed.
    fn has_room_ahead(&self) -> bool {
        let room = (self.pool.rectangle_texels() as f64 * AHEAD_SHARE) as u64;
        self.pool.needed.texels + self.transfers.texels < room
    }

    /// Asks for the needed parcels of an owner that are neither resident, nor on their way, nor known to be damaged; the coarsest
    /// first.
    fn request_missing(&mut self, owner: u32, priority: Priority, demand: &Demand, limits: &RequestLimits) {
        let (levels, side_log2) = match self.shapes.group_of_owner(owner) {
            Some(group) => {
                let finest = self.wanted_level(group).unwrap_or(0);
                let levels = self.shapes.of(group).level_count() - finest;
                (levels, self.side_log2(group, demand.detail(group)))
            }
            None => self.bundle_error(self.shapes.parcel(owner)),
        };
        for index in self.needed_parcels(owner).into_iter().rev() {
            let is_coming =
                matches!(self.transfers.state(index), RequestState::Requested | RequestState::Arrived);
            let parcel = self.parcel_of_owner(owner, index);
            if is_coming || self.pool.is_resident(index) || self.is_damaged(parcel) {
                continue;
            }
            if !self.transfers.has_room(limits) {
                self.queue.put_back(owner, priority);
                return;
            }
            let error = Priority::of_error(levels.saturating_sub(self.step_of(parcel)), side_log2);
            self.work.spend(Item::Request, 1);
            self.transfers.request(parcel, index, f32::from(error.0), RequestState::Requested);
        }
    }

    fn request_ahead(&mut self, owner: u32, predicted: &Demand) {
        let all = self.parcels_of(owner);
        let candidates: Vec<u32> = match self.shapes.group_of_owner(owner) {
            Some(group) if self.shapes.of(group).is_paged() => {
                predicted.pages(group).iter().rev().map(|p| all.start + p.index).collect()
            }
            _ => all.rev().collect(),
        };
        for index in candidates {
            let is_known = self.pool.is_resident(index) || self.transfers.state(index) != RequestState::Idle;
            let parcel = self.parcel_of_owner(owner, index);
            if !is_known && self.is_expected(parcel, index, predicted) && !self.is_damaged(parcel) {
                let urgency = f32::from(Priority::AHEAD.0) - 0.01 * self.step_of(parcel) as f32;
                self.work.spend(Item::Request, 1);
                self.transfers.request(parcel, index, urgency, RequestState::Prefetched);
            }
        }
    }

    /// Cancels a parcel that is on its way, or drops it.
    pub(super) fn cancel(&mut self, parcel: Parcel, index: u32) {
        match self.transfers.set(parcel, index, RequestState::Idle) {
            RequestState::Requested | RequestState::Prefetched => {
                self.work.spend(Item::Cancel, 1);
                self.transfers.cancels.push(parcel);
            }
            RequestState::Arrived => {
                self.transfers.arrived.remove(&index);
            }
            RequestState::Idle => return,
        }
        self.wake_under(parcel);
    }

    /// The camera does nothing that can be predicted: nothing is fetched ahead any more.
    pub(crate) fn expect_nothing(&mut self) {
        self.backlog.clear_predicted();
        self.queue.clear_ahead();
        let prefetched: Vec<_> = self.transfers.prefetched.iter().map(|(&i, &parcel)| (parcel, i)).collect();
        for (parcel, index) in prefetched {
            self.cancel(parcel, index);
        }
    }

    /// The texels of these pages are others now. What is resident stays until its new texels arrive.
    pub(crate) fn invalidate(&mut self, pages: &[PageId], demand: &Demand) {
        let parcels: BTreeSet<Parcel> = pages.iter().map(|&page| self.shapes.parcel_of(page)).collect();
        for parcel in parcels {
            let index = self.shapes.index(parcel);
            self.clear_damage(parcel, index);
            self.cancel(parcel, index);
            if self.pool.is_resident(index) {
                self.work.spend(Item::Request, 1);
                self.transfers.request(parcel, index, STALE_URGENCY, RequestState::Requested);
            } else {
                self.enqueue(self.shapes.owner(parcel), demand);
            }
        }
    }

    pub(crate) fn retry_damaged(&mut self, demand: &Demand) {
        for parcel in self.damaged.keys().copied().collect::<Vec<_>>() {
            self.clear_damage(parcel, self.shapes.index(parcel));
            self.enqueue(self.shapes.owner(parcel), demand);
        }
    }

    /// Parcels that failed for reasons that may pass.
    pub(crate) fn passing(&self) -> impl Iterator<Item = &Parcel> {
        let may_pass = |error| io_cause(error).is_some_and(is_transient);
        self.damaged.iter().filter(move |(_, error)| may_pass(error)).map(|(parcel, _)| parcel)
    }

    /// Asks for some of these again, those that are needed; they count as damaged until they arrive. Whether there are any.
    pub(crate) fn retry_passing(&mut self) -> bool {
        let passing: Vec<Parcel> = self.passing().copied().collect();
        let (mut has_any, mut asked) = (false, 0);
        for parcel in passing {
            let index = self.shapes.index(parcel);
            if !self.pool.is_needed(index) && !self.pool.is_resident(index) {
                // It is asked for when it is needed.
                self.clear_damage(parcel, index);
                continue;
            }
            has_any = true;
            if asked < RETRIED_AT_ONCE && self.transfers.state(index) == RequestState::Idle {
                asked += 1;
                let urgency = f32::from(Priority::AHEAD.0) - 0.01 * self.step_of(parcel) as f32;
                self.work.spend(Item::Request, 1);
                self.transfers.request(parcel, index, urgency, RequestState::Requested);
            }
        }
        has_any
    }

    /// Whether a damaged parcel has arrived since this was asked last.
    pub(crate) fn take_recovery(&mut self) -> bool {
        std::mem::take(&mut self.has_recovered)
    }

    /// A parcel may be readable again. (It stays a hole until it has been read: what lies under it keeps its place.)
    fn clear_damage(&mut self, parcel: Parcel, index: u32) {
        let was_damaged = self.damaged.remove(&parcel).is_some();
        if was_damaged && self.pool.is_needed(index) && !self.pool.is_resident(index) {
            self.count_missing(parcel, true);
            self.update_lacks(parcel);
        }
    }

    // Arrivals.

    /// Takes what has arrived and gives it places, until `max_bytes` are uploaded (at least one parcel, if there is any).
    pub(crate) fn arrive(&mut self, max_bytes: usize, loader: &mut dyn ParcelLoader) -> FrameChanges {
        let mut frame = Arrivals { changes: FrameChanges::default(), bytes: 0, max_bytes, stuck: Vec::new() };
        self.place_all(&mut frame);
        while self.may_arrive(&frame) {
            let loaded = loader.poll((max_bytes / POLLS_PER_FRAME).clamp(1, max_bytes - frame.bytes));
            if loaded.is_empty() {
                break;
            }
            for parcel in loaded {
                self.take_in(parcel, &mut frame);
            }
            self.place_all(&mut frame);
        }
        if !frame.stuck.is_empty() {
            // With another bias on its way less is needed soon.
            if !self.backlog.has_exact() {
                self.bias_control.squeeze();
            }
            self.transfers.placeable.extend(frame.stuck);
        }
        self.uploaded_bytes += frame.bytes as u64;
        frame.changes
    }

    fn may_arrive(&self, frame: &Arrivals) -> bool {
        frame.bytes < frame.max_bytes && self.work.may(Task::Arrive)
    }

    fn take_in(&mut self, loaded: LoadedParcel, frame: &mut Arrivals) {
        let LoadedParcel { parcel, texels } = loaded;
        self.work.spend(Item::Arrival, 1);
        let index = self.shapes.index(parcel);
        // What was cancelled in the meantime is not wanted any more.
        if !matches!(self.transfers.state(index), RequestState::Requested | RequestState::Prefetched) {
            return;
        }
        if texels.is_ok() && self.is_damaged(parcel) {
            self.clear_damage(parcel, index);
            self.has_recovered = true;
        }
        match (texels, self.pool.entries[index as usize].place()) {
            (Err(error), _) => {
                self.transfers.set(parcel, index, RequestState::Idle);
                self.give_up(parcel, index, error);
            }
            (Ok(mut texels), Some(place)) => {
                self.transfers.set(parcel, index, RequestState::Idle);
                // What is read is the same; more has no room.
                texels.outline = self.pool.outline(index).clone();
                frame.upload(ParcelUpload { parcel, place, texels });
            }
            (Ok(texels), None) => {
                self.transfers.set(parcel, index, RequestState::Arrived);
                self.place(parcel, index, texels, frame);
            }
        }
    }

    /// A parcel cannot be read: nothing waits for it any longer.
    fn give_up(&mut self, parcel: Parcel, index: u32, error: Error) {
        let is_new = self.damaged.insert(parcel, error).is_none();
        // What is resident has the texels from before it was to be read again.
        if self.pool.is_resident(index) {
            return;
        }
        if is_new && self.pool.is_needed(index) {
            self.count_missing(parcel, false);
            self.update_lacks(parcel);
        }
        self.pool.add_hole(index);
        self.wake_under(parcel);
    }

    /// Parcels that have waited for one over them look again: it has come, or will not.
    fn wake_under(&mut self, parcel: Parcel) {
        let Self { pool, transfers: Transfers { arrived, states, placeable, .. }, .. } = self;
        if arrived.is_empty() {
            return;
        }
        pool.for_each_under(parcel, &mut |index| {
            if states[index as usize] == RequestState::Arrived {
                placeable.push_back(index);
            }
        });
    }

    fn place_all(&mut self, frame: &mut Arrivals) {
        while self.may_arrive(frame) {
            let Some(index) = self.transfers.placeable.pop_front() else { return };
            if let Some((parcel, texels)) = self.transfers.arrived.remove(&index) {
                self.place(parcel, index, texels, frame);
            }
        }
    }

    /// Gives a parcel a place, or lets it wait for what it needs: those over it, room, or the next frame.
    fn place(&mut self, parcel: Parcel, index: u32, texels: ParcelTexels, frame: &mut Arrivals) {
        let is_needed = self.pool.is_needed(index);
        let blocker = self.pool.blocker(parcel);
        if let Some(missing) = blocker
            && !is_needed
            && self.transfers.state(missing) == RequestState::Idle
        {
            self.cancel(parcel, index);
            return;
        }
        if blocker.is_some() || !self.may_arrive(frame) {
            if blocker.is_none() {
                self.transfers.placeable.push_back(index);
            }
            // Otherwise it becomes placeable when that one is placed.
            self.transfers.arrived.insert(index, (parcel, texels));
            return;
        }
        let evictions = self.pool.evictions;
        let place = self.pool.insert(parcel, index, &texels.outline, if is_needed { 0 } else { AHEAD_AGE });
        self.work.spend(Item::Evict, (self.pool.evictions - evictions) as u32);
        match place {
            Some(place) => {
                self.work.spend(Item::Place, 1);
                self.work.spend(Item::PlaceTile, parcel.max_tiles());
                self.transfers.set(parcel, index, RequestState::Idle);
                frame.upload(ParcelUpload { parcel, place, texels });
                if is_needed {
                    self.count_missing(parcel, false);
                    self.update_lacks(parcel);
                }
                self.wake_under(parcel);
            }
            None if is_needed => {
                frame.stuck.push(index);
                self.transfers.arrived.insert(index, (parcel, texels));
            }
            None => self.cancel(parcel, index),
        }
    }
}

struct Arrivals {
    changes: FrameChanges,
    /// Of the uploads.
    bytes: usize,
    max_bytes: usize,
    /// Needed parcels without room.
    stuck: Vec<u32>,
}

impl Arrivals {
    fn upload(&mut self, upload: ParcelUpload) {
        self.bytes += upload.texels.bytes();
        self.changes.uploads.push(upload);
    }
}
