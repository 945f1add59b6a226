//! A queue of names by urgency, in which urgencies change.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

/// An urgency in the order of numbers. (NaN, which nobody should give, is above or below all others.)
#[derive(Clone, Copy, Debug)]
pub(super) struct Urgency(pub(super) f32);

impl PartialEq for Urgency {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Urgency {}

impl PartialOrd for Urgency {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Urgency {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Names, each once, with an urgency. All operations take logarithmic time.
#[derive(Debug)]
pub(super) struct ByUrgency<K> {
    /// Ascending; equally urgent names descending, so that the last is the most urgent, lowest name.
    order: BTreeSet<(Urgency, Reverse<K>)>,
    urgencies: BTreeMap<K, Urgency>,
}

impl<K> Default for ByUrgency<K> {
    fn default() -> Self {
        Self { order: BTreeSet::new(), urgencies: BTreeMap::new() }
    }
}

impl<K: Copy + Ord> ByUrgency<K> {
    /// Puts a name into the queue, or changes its urgency.
    pub(super) fn set(&mut self, name: K, urgency: Urgency) {
        if let Some(old) = self.urgencies.insert(name, urgency) {
            if old == urgency {
                return;
            }
            self.order.remove(&(old, Reverse(name)));
        }
        self.order.insert((urgency, Reverse(name)));
    }

    /// Puts a name into the queue, or makes it at least so urgent.
    pub(super) fn raise(&mut self, name: K, urgency: Urgency) {
        if self.urgencies.get(&name).is_none_or(|old| *old < urgency) {
            self.set(name, urgency);
        }
    }

    /// True if it was there.
    pub(super) fn remove(&mut self, name: K) -> bool {
        match self.urgencies.remove(&name) {
            Some(urgency) => self.order.remove(&(urgency, Reverse(name))),
            None => false,
        }
    }

    pub(super) fn contains(&self, name: K) -> bool {
        self.urgencies.contains_key(&name)
    }

    /// The most urgent; of several the lowest.
    pub(super) fn first(&self) -> Option<(K, Urgency)> {
        self.order.last().map(|&(urgency, Reverse(name))| (name, urgency))
    }

    /// Takes the most urgent out, where the urgencies in the queue are upper bounds: `exact` tells the true one.
    pub(super) fn pop_exact(&mut self, exact: impl Fn(K) -> Urgency) -> Option<K> {
        loop {
            let (name, bound) = self.first()?;
            let urgency = exact(name);
            if urgency < bound {
                self.set(name, urgency);
            } else {
                self.remove(name);
                return Some(name);
            }
        }
    }

    pub(super) fn len(&self) -> usize {
        self.urgencies.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_urgent_comes_first_and_changes_count() {
        let mut queue = ByUrgency::default();
        for (name, urgency) in [(1, 0.5), (2, 3.0), (3, -1.0), (4, 3.0)] {
            queue.set(name, Urgency(urgency));
        }
        assert_eq!(queue.first(), Some((2, Urgency(3.0))));
        queue.raise(1, Urgency(0.1));
        queue.raise(3, Urgency(9.0));
        assert_eq!(queue.first(), Some((3, Urgency(9.0))));
        queue.set(3, Urgency(0.0));
        assert!(queue.remove(2) && !queue.remove(2));
        // 4 turns out to be less urgent than 1.
        let exact = |name| Urgency(if name == 4 { 0.2 } else { queue_urgency(name) });
        let mut taken = Vec::new();
        while let Some(name) = queue.pop_exact(exact) {
            taken.push(name);
        }
        assert_eq!(taken, [1, 4, 3]);
        assert_eq!(queue.len(), 0);
    }

    fn queue_urgency(name: i32) -> f32 {
        if name == 1 { 0.5 } else { 0.0 }
    }
}
