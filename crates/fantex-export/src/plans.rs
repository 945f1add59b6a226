//! Unions of two pieces that may be made, the cheapest first.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rustc_hash::FxHashMap;

/// Unions with all neighbours are planned anew once a piece has grown by this factor; until then, those with neighbours whose border with it
/// has changed.
pub(crate) const GROWTH_OF_ALL: f32 = 1.1;

/// A union that may be made. Ordered so that the heap gives the cheapest first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plan {
    pub(crate) cost: f64,
    pub(crate) pieces: [u32; 2],
    /// Of the pieces when it was made.
    pub(crate) versions: [u32; 2],
}

impl Eq for Plan {}

impl Ord for Plan {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then_with(|| other.pieces.cmp(&self.pieces))
    }
}

impl PartialOrd for Plan {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Unions that are worth a try, the cheapest first; at most one that counts of every two pieces.
#[derive(Default)]
pub(crate) struct Plans {
    heap: BinaryHeap<Plan>,
    /// Of two pieces the versions of the plan that counts.
    versions: FxHashMap<[u32; 2], [u32; 2]>,
}

impl Plans {
    /// Adds plans, each in the place of an older one of the same pieces.
    pub(crate) fn extend(&mut self, plans: impl IntoIterator<Item = Plan>) {
        for plan in plans {
            if self.versions.insert(plan.pieces, plan.versions) != Some(plan.versions) {
                self.heap.push(plan);
            }
        }
    }

    /// The cheapest one, which stays the one that counts.
    pub(crate) fn pop(&mut self) -> Option<Plan> {
        std::iter::from_fn(|| self.heap.pop())
            .find(|plan| self.versions.get(&plan.pieces) == Some(&plan.versions))
    }

    /// Puts plans back that were popped.
    pub(crate) fn put_back(&mut self, plans: Vec<Plan>) {
        self.heap.extend(plans);
    }

    pub(crate) fn forget(&mut self, pieces: [u32; 2]) {
        self.versions.remove(&pieces);
    }
}
