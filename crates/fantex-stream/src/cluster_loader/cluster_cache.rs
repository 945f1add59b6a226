//! Clusters that have been read, the least recently used of which goes first: some unpacked, more of them as they are stored.
//!
//! A view is filled level by level, so that a cluster is needed several times, with hundreds of others between. Stored bytes,
//! of which there are one and a half to six times fewer, spare the disk what unpacked ones alone had no room for. What a flight over
//! landscapes read (the tour of `fantex bench stream`), counted, MB:
//!
//! | | 440 k tiles, 4 G texels | 52 k tiles, 512 M texels |
//! |---|---|---|
//! | stored bytes of the parcels that came | 13 to 17 | 55 to 60 |
//! | different clusters of which something was needed | 40 to 43 | 116 |
//! | read with 32 MiB of unpacked clusters | 170 | 437 |
//! | with 64, 128, 192, 256 MiB of them | 130, 93, 63, 42 | 118 with 256 |
//! | with 64 MiB of them and 64 MiB of stored ones | 42 | 188 |
//! | with 64 MiB of them and 96 MiB of stored ones | 42 to 48 | 131 to 141 |
//!
//! So reading again and again was what weighed most. Gaps between clusters and alignment are 4 %, what was fetched ahead and cancelled
//! less than 1 %. What is left is that clusters are larger than what is needed of them: cut at 64 KiB instead of 256 KiB there
//! would be 1.4 times fewer bytes, in 2.8 times as many reads. Clusters of levels counted from the coarsest, as parcels are, would change
//! nothing (260 MB unpacked beside 259).

use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::Arc;

use fantex_store::{ClusterId, ClusterPages};

use super::ClusterLoaderOptions;
use crate::read::ReadBuffer;

/// What is at hand of a cluster.
#[derive(Debug)]
pub(super) enum Kept {
    /// All of its pages.
    Pages(Arc<ClusterPages>),
    /// Its stored bytes, which were good.
    Stored(Arc<ReadBuffer>),
}

/// Clusters within budgets of bytes.
#[derive(Debug)]
pub(super) struct ClusterCache {
    unpacked: Recent<Arc<ClusterPages>>,
    stored: Recent<Arc<ReadBuffer>>,
}

impl ClusterCache {
    pub(super) fn new(options: &ClusterLoaderOptions) -> Self {
        Self {
            unpacked: Recent::new(options.cache_bytes, |pages| pages.memory_bytes()),
            stored: Recent::new(options.stored_cache_bytes, |bytes| bytes.deref().len()),
        }
    }

    pub(super) fn contains(&self, id: ClusterId) -> bool {
        self.unpacked.contains(id) || self.stored.contains(id)
    }

    /// A cluster, which has been used now.
    pub(super) fn get(&mut self, id: ClusterId) -> Option<Kept> {
        // What is used unpacked need not stay among the stored ones.
        let pages = self.unpacked.get(id).map(Kept::Pages);
        pages.or_else(|| self.stored.get(id).map(Kept::Stored))
    }

    /// Keeps a cluster that has been unpacked.
    pub(super) fn insert(&mut self, id: ClusterId, pages: &Arc<ClusterPages>) {
        self.unpacked.insert(id, pages);
    }

    /// Keeps a cluster's stored bytes.
    pub(super) fn insert_stored(&mut self, id: ClusterId, bytes: &Arc<ReadBuffer>) {
        self.stored.insert(id, bytes);
    }

    /// Bytes of unpacked clusters.
    pub(super) fn unpacked_bytes(&self) -> usize {
        self.unpacked.bytes
    }

    /// Bytes of clusters as they are stored.
    pub(super) fn stored_bytes(&self) -> usize {
        self.stored.bytes
    }
}

/// Things within a budget of bytes.
#[derive(Debug)]
struct Recent<T> {
    /// With the time of the last use.
    items: BTreeMap<ClusterId, (T, u64)>,
    /// By time of the last use.
    order: BTreeMap<u64, ClusterId>,
    clock: u64,
    bytes: usize,
    budget_bytes: usize,
    bytes_of: fn(&T) -> usize,
}

impl<T: Clone> Recent<T> {
    fn new(budget_bytes: usize, bytes_of: fn(&T) -> usize) -> Self {
        Self { items: BTreeMap::new(), order: BTreeMap::new(), clock: 0, bytes: 0, budget_bytes, bytes_of }
    }

    fn contains(&self, id: ClusterId) -> bool {
        self.items.contains_key(&id)
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
    fn insert(&mut self, id: ClusterId, item: &T) {
        let bytes = (self.bytes_of)(item);
        if bytes > self.budget_bytes || self.contains(id) {
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
        let there: Vec<u32> = (0..5).filter(|&index| recent.contains(id(index))).collect();
        assert_eq!((there, recent.bytes), (vec![0, 2, 4], 9));
    }
}
