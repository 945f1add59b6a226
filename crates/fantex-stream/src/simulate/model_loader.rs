//! A loader that reads nothing: it models the time that reading takes.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use fantex_store::{PageError, PageId};

use super::path::splitmix;
use crate::{Geometry, LoadedParcel, Parcel, ParcelLoader, ParcelTexels};

/// A disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskModel {
    /// From a request's start to its arrival, seconds.
    pub latency_seconds: f64,
    /// Bytes per second.
    pub bandwidth: f64,
    /// Requests that are worked on at a time.
    pub queue_depth: usize,
    /// Bytes of a texel, all channels together.
    pub texel_bytes: f64,
    /// Share of the parcels that can never be read, 0 to 1.
    pub damaged_share: f64,
}

impl Default for DiskModel {
    /// A solid-state disk: 0.1 ms, 1 GB/s, 64 requests; one byte per texel; nothing is damaged.
    fn default() -> Self {
        Self { latency_seconds: 1e-4, bandwidth: 1e9, queue_depth: 64, texel_bytes: 1.0, damaged_share: 0.0 }
    }
}

/// The time in which a [`ModelLoader`] lives; shared with whoever lets it pass.
#[derive(Clone, Debug, Default)]
pub struct ModelClock(Arc<AtomicU64>);

impl ModelClock {
    /// Seconds since the beginning.
    pub fn seconds(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }

    /// Sets the time.
    pub fn set(&self, seconds: f64) {
        self.0.store(seconds.to_bits(), Ordering::Relaxed);
    }
}

/// Order in which requests are served: the most urgent first, then as they came.
type Rank = (Reverse<u32>, u64);

/// A [`ParcelLoader`] whose parcels arrive when a modelled disk would have read them. All channels of a parcel come as one.
pub struct ModelLoader {
    geometry: Arc<dyn Geometry>,
    disk: DiskModel,
    clock: ModelClock,
    ranks: BTreeMap<Parcel, Rank>,
    queue: BTreeMap<Rank, Parcel>,
    /// All that are being read or have arrived.
    begun: BTreeSet<Parcel>,
    /// Being read, with the time of arrival, ascending.
    reading: VecDeque<(f64, Parcel)>,
    arrived: VecDeque<Parcel>,
    /// When something was asked for last.
    asked_at: f64,
    /// When the disk has moved all bytes that it has begun to.
    idle_at: f64,
    requests: u64,
}

impl ModelLoader {
    /// A loader of the parcels of a cover.
    pub fn new(geometry: Arc<dyn Geometry>, disk: DiskModel, clock: ModelClock) -> Self {
        Self {
            geometry,
            disk,
            clock,
            ranks: BTreeMap::new(),
            queue: BTreeMap::new(),
            begun: BTreeSet::new(),
            reading: VecDeque::new(),
            arrived: VecDeque::new(),
            asked_at: 0.0,
            idle_at: 0.0,
            requests: 0,
        }
    }

    /// Two bytes that stand for a page. A parcel's texels begin with those of its pages, in the order of its layout.
    pub fn signature(page: PageId) -> [u8; 2] {
        let mut state = u64::from(page.group) << 32 ^ u64::from(page.level) << 24;
        state ^= u64::from(page.page[0]) << 12 ^ u64::from(page.page[1]);
        (splitmix(&mut state) as u16).to_le_bytes()
    }

    /// Whether a parcel can never be read.
    pub fn is_damaged(parcel: Parcel, share: f64) -> bool {
        let mut state = match parcel {
            Parcel::Bundle { bundle, step } => u64::from(bundle) << 8 ^ u64::from(step) << 62 ^ 0xB0,
            Parcel::Page(PageId { group, level, page }) => {
                let [x, y] = page.map(u64::from);
                u64::from(group) << 30 ^ u64::from(level) << 25 ^ x << 13 ^ y ^ 0xDA_3A6E
            }
        };
        ((splitmix(&mut state) >> 11) as f64 / (1u64 << 53) as f64) < share
    }

    /// Lets the disk work until now.
    fn advance(&mut self) {
        let now = self.clock.seconds();
        let mut free_at = self.asked_at;
        loop {
            while self.reading.len() < self.disk.queue_depth {
                let Some((_, parcel)) = self.queue.pop_first() else { break };
                self.ranks.remove(&parcel);
                self.begun.insert(parcel);
                self.idle_at = self.idle_at.max(free_at) + self.bytes(parcel) as f64 / self.disk.bandwidth;
                self.reading.push_back((self.idle_at + self.disk.latency_seconds, parcel));
            }
            match self.reading.front() {
                Some(&(arrival, parcel)) if arrival <= now => {
                    self.reading.pop_front();
                    self.arrived.push_back(parcel);
                    free_at = arrival.max(self.asked_at);
                }
                _ => return,
            }
        }
    }

    fn bytes(&self, parcel: Parcel) -> usize {
        let slots = parcel.layout(self.geometry.cover()).slots;
        let texels = slots.iter().map(|slot| f64::from(slot.extent[0]) * f64::from(slot.extent[1]));
        (texels.sum::<f64>() * self.disk.texel_bytes).ceil() as usize
    }

    fn load(&self, parcel: Parcel) -> LoadedParcel {
        if Self::is_damaged(parcel, self.disk.damaged_share) {
            let error = PageError::Checksum { path: PathBuf::from("model"), offset: 0 };
            return LoadedParcel { parcel, texels: Err(error) };
        }
        let layout = parcel.layout(self.geometry.cover());
        let mut signatures =
            layout.slots.iter().flat_map(|slot| Self::signature(slot.page)).collect::<Vec<_>>();
        signatures.resize(self.bytes(parcel).max(signatures.len()), 0);
        let channels = vec![Arc::from(signatures)];
        LoadedParcel { parcel, texels: Ok(ParcelTexels { extent: layout.extent, channels }) }
    }
}

impl ParcelLoader for ModelLoader {
    fn request(&mut self, parcel: Parcel, urgency: f32) {
        if self.begun.contains(&parcel) {
            return;
        }
        self.asked_at = self.clock.seconds();
        // Finite numbers in the order of their bits, negative ones turned round.
        let bits = urgency.to_bits();
        let ordered = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
        self.requests += 1;
        let rank = (Reverse(ordered), self.requests);
        if let Some(last) = self.ranks.insert(parcel, rank) {
            self.queue.remove(&last);
        }
        self.queue.insert(rank, parcel);
    }

    fn cancel(&mut self, parcel: Parcel) {
        if let Some(rank) = self.ranks.remove(&parcel) {
            self.queue.remove(&rank);
        }
        if self.begun.remove(&parcel) {
            self.reading.retain(|&(_, reading)| reading != parcel);
            self.arrived.retain(|&arrived| arrived != parcel);
        }
    }

    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedParcel> {
        self.advance();
        let mut bytes = 0;
        let mut loaded = Vec::new();
        while let Some(&parcel) = self.arrived.front() {
            bytes += self.bytes(parcel);
            if bytes > max_bytes && !loaded.is_empty() {
                break;
            }
            self.arrived.pop_front();
            self.begun.remove(&parcel);
            loaded.push(self.load(parcel));
        }
        loaded
    }

    fn pending(&self) -> usize {
        self.queue.len() + self.reading.len() + self.arrived.len()
    }
}
