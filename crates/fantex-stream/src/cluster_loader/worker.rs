//! The threads that unpack and decode, and the cache of what they have unpacked.

use std::collections::BTreeMap;
use std::ops::{Deref, Range};
use std::sync::Arc;

use fantex_base::Error;
use fantex_store::{ClusterId, ClusterPages, PageId, page_extent};
use web_time::Instant;

use super::board::Order;
use super::{ClusterLoaderOptions, Shared};
use crate::loader::stored_texels;
use crate::read::ReadBuffer;
use crate::{Parcel, ParcelTexels};

/// Works for a loader. See the [module](super).
pub(super) struct Worker {
    shared: Arc<Shared>,
}

impl Worker {
    pub(super) fn new(shared: Arc<Shared>) -> Self {
        Self { shared }
    }

    /// Works until the board is closed.
    pub(super) fn run(self) {
        while self.carry_out(self.shared.board.wait_for_order()) {}
    }

    /// Carries out what there is to do, until a time; something at least.
    pub(super) fn run_until(&self, deadline: Instant) {
        loop {
            let order = self.shared.board.lock().next_order();
            if !order.is_some_and(|order| self.carry_out(order)) || Instant::now() >= deadline {
                return;
            }
        }
    }

    /// False at the end.
    fn carry_out(&self, order: Order) -> bool {
        match order {
            Order::Unpack(cluster, bytes, part) => self.unpack(cluster, bytes, part, true),
            Order::UnpackKept(cluster, bytes) => {
                let all = 0..bytes.len();
                self.unpack(cluster, bytes, all, false);
            }
            Order::Make(cluster, pages) => self.make(cluster, &pages, true),
            Order::TellScheduler => {}
            Order::End => return false,
        }
        // Reads may have ended, clusters may have to be read again.
        self.shared.scheduler.wake();
        true
    }

    /// `is_read`: the bytes come from a read just now.
    fn unpack(&self, cluster: ClusterId, bytes: Arc<ReadBuffer>, part: Range<usize>, is_read: bool) {
        let begin = Instant::now();
        let stored_bytes = part.len();
        let unpacked = self.shared.asset.unpack_cluster(cluster, &bytes[part.clone()]).map(Arc::new);
        let is_kept = is_read && unpacked.is_ok() && stored_bytes <= self.shared.options.stored_cache_bytes;
        // Buffers of reads are large, and used again.
        let kept = is_kept.then(|| Arc::new(ReadBuffer::from(bytes[part].to_vec())));
        drop(bytes);
        let mut board = self.shared.board.lock();
        let counts = &mut board.counts;
        counts.unpack_seconds += begin.elapsed().as_secs_f64();
        if unpacked.is_ok() {
            counts.unpacked_bytes += self.shared.asset.cluster_page_bytes(cluster) as u64;
        }
        if is_read {
            board.finish_read(cluster, stored_bytes, kept.as_ref());
        }
        board.unpacked(cluster, unpacked.as_ref().map_err(Error::clone));
        drop(board);
        if let Ok(pages) = unpacked {
            // There is room for reads, and decoding may take a while.
            self.shared.scheduler.wake();
            self.make(cluster, &pages, !is_read);
        }
    }

    fn make(&self, cluster: ClusterId, pages: &Arc<ClusterPages>, is_hit: bool) {
        let mut made = Vec::new();
        let mut share = 0.0;
        let mut begin = Instant::now();
        loop {
            let mut board = self.shared.board.lock();
            let counts = &mut board.counts;
            counts.unpack_seconds += begin.elapsed().as_secs_f64();
            let range = self.shared.asset.cluster_range(cluster);
            counts.bytes_needed += (share * (range.end - range.start) as f64) as u64;
            counts.cache_hits += if is_hit { made.len() as u64 } else { 0 };
            board.made(cluster, std::mem::take(&mut made));
            let batch = board.next_batch(cluster, pages, |parcel| self.parcel_bytes(parcel));
            drop(board);
            if batch.is_empty() {
                return;
            }
            begin = Instant::now();
            let stored: usize = batch.iter().map(|(parcel, _)| self.stored_parcel_bytes(*parcel)).sum();
            share = stored as f64 / self.shared.asset.cluster_page_bytes(cluster).max(1) as f64;
            made = batch.into_iter().map(|(parcel, from)| (parcel, self.texels(&from, parcel))).collect();
        }
    }

    /// Columns and rows of a page that exists.
    fn extent(&self, page: PageId) -> [u32; 2] {
        let group = &self.shared.asset.cover().groups[page.group as usize];
        page_extent(group.level_extent(page.level), page.page)
    }

    /// Bytes of a parcel's pages in the atlas' formats.
    fn parcel_bytes(&self, parcel: Parcel) -> usize {
        let block_bytes: usize = self.shared.formats.iter().map(|format| format.block_bytes()).sum();
        let blocks = |page| self.extent(page).map(|n| n as usize / 4).into_iter().product::<usize>();
        parcel.pages(self.shared.asset.cover()).map(blocks).sum::<usize>() * block_bytes
    }

    /// Bytes of a parcel's pages in the formats in which they are stored.
    fn stored_parcel_bytes(&self, parcel: Parcel) -> usize {
        let bytes = |extent| -> usize {
            self.shared.asset.channels().iter().map(|channel| channel.format.bytes(extent)).sum()
        };
        parcel.pages(self.shared.asset.cover()).map(|page| bytes(self.extent(page))).sum()
    }

    /// A parcel's texels out of the clusters that hold its pages.
    fn texels(&self, from: &[Arc<ClusterPages>], parcel: Parcel) -> Result<ParcelTexels, Error> {
        let Shared { asset, formats, .. } = &*self.shared;
        stored_texels(asset, formats, parcel, |index, page| {
            asset.page_in_any(from.iter().map(Arc::as_ref), index, page)
        })
    }
}

// Clusters that have been read, the least recently used of which goes first: some unpacked, more of them as they are stored.
//
// A view is filled level by level, so that a cluster is needed several times, with hundreds of others between. Stored clusters are 1.5 to
// 6 times smaller than unpacked ones: keeping them spares most of the reads that unpacked ones alone had no room for (figures in
// `docs/benchmarks.md`).

/// What is at hand of a cluster.
#[derive(Debug)]
pub(super) enum Kept {
    /// All of its pages.
    Pages(Arc<ClusterPages>),
    /// Its stored bytes, which were good.
    Stored(Arc<ReadBuffer>),
}

#[derive(Debug)]
pub(super) struct ClusterCache {
    pub(super) unpacked: Recent<Arc<ClusterPages>>,
    /// Those whose bytes were good.
    pub(super) stored: Recent<Arc<ReadBuffer>>,
}

impl ClusterCache {
    pub(super) fn new(options: &ClusterLoaderOptions) -> Self {
        Self {
            unpacked: Recent::new(options.cache_bytes, |pages| pages.memory_bytes()),
            stored: Recent::new(options.stored_cache_bytes, |bytes| bytes.deref().len()),
        }
    }

    pub(super) fn contains(&self, id: ClusterId) -> bool {
        self.unpacked.items.contains_key(&id) || self.stored.items.contains_key(&id)
    }

    /// A cluster, which has been used now.
    pub(super) fn get(&mut self, id: ClusterId) -> Option<Kept> {
        // What is used unpacked need not stay among the stored ones.
        let pages = self.unpacked.get(id).map(Kept::Pages);
        pages.or_else(|| self.stored.get(id).map(Kept::Stored))
    }
}

#[derive(Debug)]
pub(super) struct Recent<T> {
    /// With the time of the last use.
    items: BTreeMap<ClusterId, (T, u64)>,
    /// By time of the last use.
    order: BTreeMap<u64, ClusterId>,
    clock: u64,
    pub(super) bytes: usize,
    budget_bytes: usize,
    bytes_of: fn(&T) -> usize,
}

impl<T: Clone> Recent<T> {
    fn new(budget_bytes: usize, bytes_of: fn(&T) -> usize) -> Self {
        Self { items: BTreeMap::new(), order: BTreeMap::new(), clock: 0, bytes: 0, budget_bytes, bytes_of }
    }

    fn get(&mut self, id: ClusterId) -> Option<T> {
        let (item, used) = self.items.get_mut(&id)?;
        self.clock += 1;
        self.order.remove(used);
        *used = self.clock;
        self.order.insert(self.clock, id);
        Some(item.clone())
    }

    /// Keeps it, if it fits into the budget at all, and drops others for it.
    pub(super) fn insert(&mut self, id: ClusterId, item: &T) {
        let bytes = (self.bytes_of)(item);
        if bytes > self.budget_bytes || self.items.contains_key(&id) {
            return;
        }
        while self.bytes + bytes > self.budget_bytes
            && let Some((_, oldest)) = self.order.pop_first()
        {
            if let Some((item, _)) = self.items.remove(&oldest) {
                self.bytes -= (self.bytes_of)(&item);
            }
        }
        self.clock += 1;
        self.items.insert(id, (item.clone(), self.clock));
        self.order.insert(self.clock, id);
        self.bytes += bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_last_stays() {
        let id = |index| ClusterId { level: 0, index };
        let mut recent = Recent::new(10, |bytes: &Arc<Vec<u8>>| bytes.len());
        for (index, bytes) in [(0, 4), (1, 4), (2, 2), (3, 11)] {
            recent.insert(id(index), &Arc::new(vec![index as u8; bytes]));
        }
        assert!(recent.get(id(0)).is_some() && recent.get(id(3)).is_none());
        recent.insert(id(4), &Arc::new(vec![4; 3]));
        let there: Vec<u32> = (0..5).filter(|&index| recent.items.contains_key(&id(index))).collect();
        assert_eq!((there, recent.bytes), (vec![0, 2, 4], 9));
    }
}
