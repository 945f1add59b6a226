//! A loader that reads nothing: it models the time that reading takes.

use std::cmp::Reverse;
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use fantex_cover::Cover;
use fantex_store::{PageError, PageId, page_extent};

use super::path::splitmix;
use crate::{Geometry, LoadedPage, PageLoader, PageTexels};

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
    /// Share of the pages that can never be read, 0 to 1.
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

/// A [`PageLoader`] whose pages arrive when a modelled disk would have read them. All channels of a page
/// come as one, which begins with the page's signature.
pub struct ModelLoader {
    geometry: Arc<dyn Geometry>,
    disk: DiskModel,
    clock: ModelClock,
    ranks: BTreeMap<PageId, Rank>,
    queue: BTreeMap<Rank, PageId>,
    /// Being read, with the time of arrival, ascending.
    reading: VecDeque<(f64, PageId)>,
    arrived: VecDeque<PageId>,
    /// When something was asked for last.
    asked_at: f64,
    /// When the disk has moved all bytes that it has begun to.
    idle_at: f64,
    requests: u64,
}

impl ModelLoader {
    /// A loader of the pages of a cover.
    pub fn new(geometry: Arc<dyn Geometry>, disk: DiskModel, clock: ModelClock) -> Self {
        Self {
            geometry,
            disk,
            clock,
            ranks: BTreeMap::new(),
            queue: BTreeMap::new(),
            reading: VecDeque::new(),
            arrived: VecDeque::new(),
            asked_at: 0.0,
            idle_at: 0.0,
            requests: 0,
        }
    }

    /// The two bytes with which a page's texels begin here.
    pub fn signature(page: PageId) -> [u8; 2] {
        let mut state = u64::from(page.group) << 32 ^ u64::from(page.level) << 24;
        state ^= u64::from(page.page[0]) << 12 ^ u64::from(page.page[1]);
        (splitmix(&mut state) as u16).to_le_bytes()
    }

    /// Whether a page can never be read.
    pub fn is_damaged(page: PageId, share: f64) -> bool {
        let mut state = u64::from(page.group) << 30 ^ u64::from(page.level) << 25;
        state ^= u64::from(page.page[0]) << 13 ^ u64::from(page.page[1]) ^ 0xDA_3A6E;
        ((splitmix(&mut state) >> 11) as f64 / (1u64 << 53) as f64) < share
    }

    /// Lets the disk work until now.
    fn advance(&mut self) {
        let now = self.clock.seconds();
        let mut free_at = self.asked_at;
        loop {
            while self.reading.len() < self.disk.queue_depth {
                let Some((_, page)) = self.queue.pop_first() else { break };
                self.ranks.remove(&page);
                self.idle_at = self.idle_at.max(free_at) + self.bytes(page) as f64 / self.disk.bandwidth;
                self.reading.push_back((self.idle_at + self.disk.latency_seconds, page));
            }
            match self.reading.front() {
                Some(&(arrival, page)) if arrival <= now => {
                    self.reading.pop_front();
                    self.arrived.push_back(page);
                    free_at = arrival.max(self.asked_at);
                }
                _ => return,
            }
        }
    }

    fn bytes(&self, page: PageId) -> usize {
        (texels(self.geometry.cover(), page) as f64 * self.disk.texel_bytes).ceil().max(2.0) as usize
    }

    fn load(&self, page: PageId) -> LoadedPage {
        if Self::is_damaged(page, self.disk.damaged_share) {
            let error = PageError::Checksum { path: PathBuf::from("model"), offset: u64::from(page.group) };
            return LoadedPage { page, texels: Err(error) };
        }
        let extent = page_extent(
            self.geometry.cover().groups[page.group as usize].level_extent(page.level),
            page.page,
        );
        let mut bytes = vec![0; self.bytes(page)];
        bytes[..2].copy_from_slice(&Self::signature(page));
        let channels = vec![Arc::from(bytes)];
        LoadedPage { page, texels: Ok(PageTexels { extent, channels }) }
    }
}

fn texels(cover: &Cover, page: PageId) -> u64 {
    let [w, h] = page_extent(cover.groups[page.group as usize].level_extent(page.level), page.page);
    u64::from(w) * u64::from(h)
}

impl PageLoader for ModelLoader {
    fn request(&mut self, page: PageId, urgency: f32) {
        if self.reading.iter().any(|&(_, reading)| reading == page) || self.arrived.contains(&page) {
            return;
        }
        self.asked_at = self.clock.seconds();
        // Finite numbers in the order of their bits, negative ones turned round.
        let bits = urgency.to_bits();
        let ordered = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
        self.requests += 1;
        let rank = (Reverse(ordered), self.requests);
        if let Some(last) = self.ranks.insert(page, rank) {
            self.queue.remove(&last);
        }
        self.queue.insert(rank, page);
    }

    fn cancel(&mut self, page: PageId) {
        if let Some(rank) = self.ranks.remove(&page) {
            self.queue.remove(&rank);
        }
        self.reading.retain(|&(_, reading)| reading != page);
        self.arrived.retain(|&arrived| arrived != page);
    }

    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedPage> {
        self.advance();
        let mut bytes = 0;
        let mut loaded = Vec::new();
        while let Some(&page) = self.arrived.front() {
            bytes += self.bytes(page);
            if bytes > max_bytes && !loaded.is_empty() {
                break;
            }
            self.arrived.pop_front();
            loaded.push(self.load(page));
        }
        loaded
    }

    fn pending(&self) -> usize {
        self.queue.len() + self.reading.len() + self.arrived.len()
    }
}
