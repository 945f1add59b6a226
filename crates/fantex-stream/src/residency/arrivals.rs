//! From texels that have arrived to uploads.

use fantex_store::PageError;

use super::work::{Item, Task};
use super::{Flight, Residency};
use crate::{FrameChanges, LoadedParcel, Parcel, ParcelLoader, ParcelTexels, ParcelUpload};

/// Frames after which a parcel that is not needed makes room for one that is fetched ahead: about as many as it is fetched
/// ahead. (With four times as many, a camera that flew on after a cut found no room for what it foresaw.)
const AHEAD_AGE: u32 = 15;

/// The loader is asked for so large a part of a frame's bytes at a time: parcels may be small, and then are many.
const POLLS_PER_FRAME: usize = 16;

impl Residency {
    /// Takes what has arrived and gives it places, until `max_bytes` are uploaded (at least one parcel, if there is any).
    pub(crate) fn arrive(&mut self, max_bytes: usize, loader: &mut dyn ParcelLoader) -> FrameChanges {
        let mut frame = Arrivals { changes: FrameChanges::default(), bytes: 0, max_bytes, stuck: Vec::new() };
        self.settle(&mut frame);
        while self.has_room(&frame) {
            let loaded = loader.poll((max_bytes / POLLS_PER_FRAME).clamp(1, max_bytes - frame.bytes));
            if loaded.is_empty() {
                break;
            }
            for parcel in loaded {
                self.take_in(parcel, &mut frame);
            }
            self.settle(&mut frame);
        }
        if !frame.stuck.is_empty() {
            // With another bias on its way less is needed soon.
            if self.exact_backlog == 0 {
                self.pressure.squeeze();
            }
            self.ready.extend(frame.stuck);
        }
        self.uploaded_bytes += frame.bytes as u64;
        frame.changes
    }

    /// Whether more may arrive in this frame.
    fn has_room(&self, frame: &Arrivals) -> bool {
        frame.bytes < frame.max_bytes && self.work.may(Task::Arrive)
    }

    fn take_in(&mut self, loaded: LoadedParcel, frame: &mut Arrivals) {
        let LoadedParcel { parcel, texels } = loaded;
        self.work.spend(Item::Arrival, 1);
        let index = self.shapes.index(parcel);
        // What was cancelled in the meantime is not wanted any more.
        if !matches!(self.flight(index), Flight::Asked | Flight::Ahead) {
            return;
        }
        match texels {
            Err(error) => {
                self.set_flight(parcel, index, Flight::None);
                self.give_up(parcel, index, error);
            }
            Ok(texels) => match self.pool.entry(index).place() {
                Some(place) => {
                    self.set_flight(parcel, index, Flight::None);
                    frame.upload(ParcelUpload { parcel, place, texels });
                }
                None => {
                    self.set_flight(parcel, index, Flight::Waiting);
                    self.settle_parcel(parcel, index, texels, frame);
                }
            },
        }
    }

    /// A parcel cannot be read: nobody waits for it any longer.
    fn give_up(&mut self, parcel: Parcel, index: u32, error: PageError) {
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
    pub(super) fn wake_under(&mut self, parcel: Parcel) {
        let Self { pool, ready, flights, waiting, .. } = self;
        if waiting.is_empty() {
            return;
        }
        pool.for_each_under(parcel, &mut |index| {
            if flights[index as usize] == Flight::Waiting {
                ready.push_back(index);
            }
        });
    }

    /// Gives places to parcels that have waited and need wait no longer.
    fn settle(&mut self, frame: &mut Arrivals) {
        while self.has_room(frame) {
            let Some(index) = self.ready.pop_front() else { return };
            if let Some((parcel, texels)) = self.waiting.remove(&index) {
                self.settle_parcel(parcel, index, texels, frame);
            }
        }
    }

    /// Gives a parcel a place, or lets it wait for what it needs: those over it, room, or the next frame.
    fn settle_parcel(&mut self, parcel: Parcel, index: u32, texels: ParcelTexels, frame: &mut Arrivals) {
        let is_needed = self.pool.is_needed(index);
        let blocker = self.pool.blocker(parcel);
        if let Some(missing) = blocker
            && !is_needed
            && self.flight(missing) == Flight::None
        {
            self.forget(parcel, index);
            return;
        }
        if blocker.is_some() || !self.has_room(frame) {
            if blocker.is_none() {
                self.ready.push_back(index);
            }
            // Otherwise it becomes ready when that one is placed.
            self.waiting.insert(index, (parcel, texels));
            return;
        }
        let evictions = self.pool.evictions();
        let place = self.pool.insert(parcel, index, if is_needed { 0 } else { AHEAD_AGE });
        self.work.spend(Item::Evict, (self.pool.evictions() - evictions) as u32);
        match place {
            Some(place) => {
                self.work.spend(Item::Place, 1);
                self.work.spend(Item::PlaceTile, parcel.most_tiles());
                self.set_flight(parcel, index, Flight::None);
                frame.upload(ParcelUpload { parcel, place, texels });
                if is_needed {
                    self.count_missing(parcel, false);
                    self.update_lacks(parcel);
                }
                self.wake_under(parcel);
            }
            None if is_needed => {
                frame.stuck.push(index);
                self.waiting.insert(index, (parcel, texels));
            }
            None => self.forget(parcel, index),
        }
    }
}

/// What arrives in one frame.
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
