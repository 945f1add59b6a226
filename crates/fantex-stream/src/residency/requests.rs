//! Owners that lack parcels, the most urgent first.
//!
//! Urgency is the error on the screen: by how many levels a tile is too coarse, then how large it is. Within one urgency
//! owners come in order, so that neighbours, which lie in one cluster, are asked for together. Weighing the picture's middle
//! more was left out, unmeasured: the eye is wherever it is, and a cut is sharp only when the last tile is.

use std::collections::VecDeque;

use super::limits::{Item, Task};
use super::{Flight, RequestLimits, Residency};
use crate::Parcel;
use crate::demand::Demand;
use crate::parcel::{FAMILY, SHARED_LEVELS};

/// Urgencies, 0 to 63.
const BUCKETS: usize = 64;
const NONE: u8 = u8::MAX;

/// A queue with one place per owner.
pub(crate) struct Wishes {
    buckets: Vec<VecDeque<u32>>,
    /// Per owner the bucket it waits in.
    places: Vec<u8>,
    waiting: usize,
    /// Entries since the last clearing, at most.
    moved: usize,
}

impl Wishes {
    pub(crate) fn new(owner_count: usize) -> Self {
        Self {
            buckets: vec![VecDeque::new(); BUCKETS],
            places: vec![NONE; owner_count],
            waiting: 0,
            moved: 0,
        }
    }

    /// Puts an owner in, or moves it. `levels`: how many levels are missing; `side_log2`: of the tile on the screen, pixels.
    pub(crate) fn put(&mut self, owner: u32, levels: u32, side_log2: f32) {
        let bucket = urgency(levels, side_log2);
        let place = &mut self.places[owner as usize];
        if *place == bucket {
            return;
        }
        self.waiting += usize::from(*place == NONE);
        *place = bucket;
        self.buckets[usize::from(bucket)].push_back(owner);
        self.moved += 1;
        if self.moved > self.places.len() {
            self.drop_moved();
        }
    }

    /// Removes what owners that were moved have left behind.
    fn drop_moved(&mut self) {
        self.moved = 0;
        for (bucket, owners) in (0..).zip(&mut self.buckets) {
            owners.retain(|&owner| self.places[owner as usize] == bucket);
        }
    }

    /// Takes the most urgent owner out, with its urgency.
    pub(crate) fn take(&mut self) -> Option<(u32, u8)> {
        for (bucket, owners) in (0..BUCKETS as u8).zip(&mut self.buckets).rev() {
            while let Some(owner) = owners.pop_front() {
                let place = &mut self.places[owner as usize];
                if *place == bucket {
                    *place = NONE;
                    self.waiting -= 1;
                    return Some((owner, bucket));
                }
            }
        }
        None
    }

    /// Puts an owner back where it was taken.
    pub(crate) fn put_back(&mut self, owner: u32, urgency: u8) {
        let place = &mut self.places[owner as usize];
        if *place == NONE {
            *place = urgency;
            self.waiting += 1;
            self.buckets[usize::from(urgency)].push_front(owner);
        }
    }

    /// Number of owners.
    pub(crate) fn len(&self) -> usize {
        self.waiting
    }
}

/// The bucket for an error on the screen.
pub(crate) fn urgency(levels: u32, side_log2: f32) -> u8 {
    (4 * levels.min(13) + side_log2.clamp(0.0, 11.0) as u32) as u8
}

// What the camera will see if it goes on as it does, fetched while there is nothing better to do.

/// Share of the atlas that needed parcels and those fetched ahead may fill together.
const AHEAD_SHARE: f64 = 0.85;

impl Residency {
    /// Groups whose demand in the predicted view has changed: what is no longer expected is cancelled, what is now expected
    /// is asked for when there is nothing better to do.
    pub(crate) fn expect(&mut self, changed: &[u32], predicted: &Demand) {
        if !self.has_unforeseen() {
            self.work.spend(Item::Bounding, predicted.nanoseconds());
        }
        self.unforeseen.extend(changed);
        let mut last_family = None;
        while self.work.may(Task::Ask)
            && let Some(group) = self.unforeseen.pop_front()
        {
            let family = group / FAMILY;
            if last_family.replace(family) != Some(family) {
                for step in 0..SHARED_LEVELS {
                    for bundle in self.shapes.family_bundles(family, step) {
                        self.expect_owner(self.shapes.index(Parcel::Bundle { bundle, step }), predicted);
                    }
                }
            }
            if self.shapes.of(group).own_levels() > 0 {
                self.expect_owner(self.shapes.owner_of_group(group), predicted);
            }
        }
    }

    fn expect_owner(&mut self, owner: u32, predicted: &Demand) {
        self.work.spend(Item::Foresee, 1);
        let unexpected: Vec<(Parcel, u32)> = self
            .parcels_of(owner)
            .filter(|&index| self.flight(index) == Flight::Ahead)
            .map(|index| (self.shapes.parcel(index), index))
            .filter(|&(parcel, index)| !self.is_expected(parcel, index, predicted))
            .collect();
        for (parcel, index) in unexpected {
            self.forget(parcel, index);
        }
        let needs_any = match self.shapes.group_of_owner(owner) {
            Some(group) => {
                let wanted = self.shapes.of(group).wanted_level(predicted.detail(group));
                wanted < self.shapes.of(group).own_levels()
            }
            None => self.is_expected(self.shapes.parcel(owner), owner, predicted),
        };
        if needs_any {
            self.ahead.push_back(owner);
        }
    }

    /// Asks for parcels that the predicted view needs, while all that is missing has been asked for and there is
    /// room to spare.
    pub(crate) fn request_ahead(&mut self, predicted: &Demand, limits: &RequestLimits) {
        if self.wishes() > 0 {
            return;
        }
        let limits = RequestLimits { parcels: limits.parcels / 4, texels: limits.texels / 4 };
        let room = (self.pool.shape().texels() as f64 * AHEAD_SHARE) as u64;
        while self.work.may(Task::Ask)
            && self.has_free_request(&limits)
            && self.pool.needed().texels + self.in_flight_texels < room
        {
            let Some(owner) = self.ahead.pop_front() else { return };
            let all = self.parcels_of(owner);
            let candidates: Vec<u32> = match self.shapes.group_of_owner(owner) {
                Some(group) if self.shapes.of(group).is_paged() => {
                    predicted.pages(group).iter().rev().map(|p| all.start + p.index).collect()
                }
                _ => all.rev().collect(),
            };
            for index in candidates {
                let known = self.pool.is_resident(index) || self.flight(index) != Flight::None;
                let parcel = self.shapes.parcel(index);
                if !known && self.is_expected(parcel, index, predicted) && !self.is_damaged(parcel) {
                    self.ask(parcel, index, -1.0 - 0.01 * self.step_of(parcel) as f32, true);
                }
            }
        }
    }

    /// Whether a predicted view needs a parcel.
    fn is_expected(&self, parcel: Parcel, index: u32, predicted: &Demand) -> bool {
        let bias = self.bias();
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

    /// Whether some groups whose demand in the predicted view has changed wait for the next frame.
    pub(crate) fn has_unforeseen(&self) -> bool {
        !self.unforeseen.is_empty()
    }

    /// Nothing is expected any more.
    pub(crate) fn expect_nothing(&mut self) {
        self.unforeseen.clear();
        self.ahead.clear();
        let ahead: Vec<(Parcel, u32)> =
            self.asked_ahead.iter().map(|(&index, &parcel)| (parcel, index)).collect();
        for (parcel, index) in ahead {
            self.forget(parcel, index);
        }
    }
}
