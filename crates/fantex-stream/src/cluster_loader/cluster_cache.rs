//! Unpacked clusters, the least recently used of which goes first.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_store::{ClusterId, ClusterPages};

#[derive(Debug)]
struct Kept {
    cluster: Arc<ClusterPages>,
    /// Time of the last use.
    used: u64,
}

/// Clusters within a budget of bytes.
#[derive(Debug)]
pub(super) struct ClusterCache {
    clusters: BTreeMap<ClusterId, Kept>,
    /// By time of the last use.
    order: BTreeMap<u64, ClusterId>,
    clock: u64,
    bytes: usize,
    budget_bytes: usize,
}

impl ClusterCache {
    pub(super) fn new(budget_bytes: usize) -> Self {
        Self { clusters: BTreeMap::new(), order: BTreeMap::new(), clock: 0, bytes: 0, budget_bytes }
    }

    pub(super) fn contains(&self, id: ClusterId) -> bool {
        self.clusters.contains_key(&id)
    }

    /// A cluster, which has been used now.
    pub(super) fn get(&mut self, id: ClusterId) -> Option<Arc<ClusterPages>> {
        let kept = self.clusters.get_mut(&id)?;
        self.clock += 1;
        self.order.remove(&kept.used);
        kept.used = self.clock;
        self.order.insert(self.clock, id);
        Some(Arc::clone(&kept.cluster))
    }

    /// Keeps a cluster, if it fits into the budget at all, and drops others for it.
    pub(super) fn insert(&mut self, id: ClusterId, cluster: &Arc<ClusterPages>) {
        let bytes = cluster.memory_bytes();
        if bytes > self.budget_bytes || self.contains(id) {
            return;
        }
        while self.bytes + bytes > self.budget_bytes
            && let Some((_, oldest)) = self.order.pop_first()
        {
            if let Some(kept) = self.clusters.remove(&oldest) {
                self.bytes -= kept.cluster.memory_bytes();
            }
        }
        self.clock += 1;
        self.clusters.insert(id, Kept { cluster: Arc::clone(cluster), used: self.clock });
        self.order.insert(self.clock, id);
        self.bytes += bytes;
    }

    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }
}
