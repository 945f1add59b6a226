//! Owners that lack parcels, the most urgent first.
//!
//! Urgency is the error on the screen: by how many levels a tile is too coarse, then how large it is. Within one urgency
//! owners come in order, so that neighbours, which lie in one cluster, are asked for together. Weighing the picture's middle
//! more was left out, unmeasured: the eye is wherever it is, and a cut is sharp only when the last tile is.

use std::collections::VecDeque;

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
