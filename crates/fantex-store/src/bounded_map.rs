//! A map from keys to values that are loaded on demand and evicted by the clock algorithm (F. J. Corbató, "A Paging
//! Experiment with the Multics System", 1969): entries stand in a circle; a hand passes over those that were used since it
//! came by last, and takes the first that was not.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Locks that threads share the keys among.
const SHARDS: usize = 16;

/// A value that one thread loads while the others wait.
#[derive(Debug)]
struct Entry<V> {
    value: OnceLock<V>,
    used: AtomicBool,
}

#[derive(Debug)]
struct Shard<V> {
    entries: HashMap<u64, Arc<Entry<V>>, BuildHasherDefault<KeyHasher>>,
    /// Loaded entries and their bytes, in no order: the clock's circle.
    circle: Vec<(u64, usize)>,
    hand: usize,
    bytes: usize,
}

/// A sharded map of values within a budget of bytes.
#[derive(Debug)]
pub(super) struct BoundedMap<V> {
    shards: Vec<Mutex<Shard<V>>>,
    shard_budget: usize,
}

impl<V: Clone> BoundedMap<V> {
    pub(super) fn new(budget_bytes: usize) -> Self {
        let shard = || Shard { entries: HashMap::default(), circle: Vec::new(), hand: 0, bytes: 0 };
        Self {
            shards: (0..SHARDS).map(|_| Mutex::new(shard())).collect(),
            shard_budget: budget_bytes / SHARDS,
        }
    }

    /// The value of a key. If it is not there, `load` gives it and its size in bytes.
    pub(super) fn get_or_load(&self, key: u64, load: impl FnOnce() -> (V, usize)) -> V {
        let entry = {
            let mut shard = self.shard(key);
            let new = || Arc::new(Entry { value: OnceLock::new(), used: AtomicBool::new(false) });
            Arc::clone(shard.entries.entry(key).or_insert_with(new))
        };
        let mut loaded_bytes = None;
        let value = entry.value.get_or_init(|| {
            let (value, bytes) = load();
            loaded_bytes = Some(bytes);
            value
        });
        match loaded_bytes {
            Some(bytes) => self.shard(key).admit(key, bytes, self.shard_budget),
            None => entry.used.store(true, Ordering::Relaxed),
        }
        value.clone()
    }

    fn shard(&self, key: u64) -> MutexGuard<'_, Shard<V>> {
        let index = (mix(key) >> 60) as usize % SHARDS;
        // A shard is consistent between any two statements, so a panic elsewhere does no harm.
        self.shards[index].lock().unwrap_or_else(PoisonError::into_inner)
    }

    #[cfg(test)]
    fn bytes(&self) -> usize {
        self.shards.iter().map(|s| s.lock().unwrap().bytes).sum()
    }
}

impl<V> Shard<V> {
    /// Puts a loaded entry into the circle, right behind the hand, and evicts others until the budget holds. An entry that
    /// exceeds the budget by itself stays until the next one comes.
    fn admit(&mut self, key: u64, bytes: usize, budget: usize) {
        while self.bytes + bytes > budget && !self.circle.is_empty() {
            self.hand %= self.circle.len();
            let (candidate, candidate_bytes) = self.circle[self.hand];
            let used = self.entries.get(&candidate).is_some_and(|e| e.used.swap(false, Ordering::Relaxed));
            if used {
                self.hand += 1;
            } else {
                self.entries.remove(&candidate);
                self.circle.swap_remove(self.hand);
                self.bytes -= candidate_bytes;
            }
        }
        self.circle.push((key, bytes));
        self.bytes += bytes;
    }
}

/// Spreads keys that differ in few bits over all bits (the finaliser of splitmix64: G. L. Steele, D. Lea, C. H. Flood, "Fast
/// Splittable Pseudorandom Number Generators", 2014).
fn mix(key: u64) -> u64 {
    let x = (key ^ (key >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Hashes the 64-bit keys; they are ours, so nobody can choose them to collide.
#[derive(Default)]
struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = mix(self.0 ^ u64::from(byte));
        }
    }

    fn write_u64(&mut self, key: u64) {
        self.0 = mix(key);
    }

    fn finish(&self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_budget_holds_and_values_are_loaded_once_while_they_stay() {
        let map = BoundedMap::new(1600);
        let mut loads = 0;
        for round in 0..3 {
            for key in 0..5u64 {
                let value = map.get_or_load(key, || {
                    loads += 1;
                    (key * 7, 10)
                });
                assert_eq!(value, key * 7, "round {round}");
            }
        }
        assert_eq!(loads, 5);
        for key in 0..10_000u64 {
            map.get_or_load(key, || (key * 7, 10));
            assert!(map.bytes() <= 1600);
        }
        assert!(map.bytes() > 800);
    }

    #[test]
    fn used_entries_outlive_unused_ones() {
        let map = BoundedMap::new(SHARDS * 100);
        map.get_or_load(1, || ((), 10));
        for key in 100..2000u64 {
            map.get_or_load(key, || ((), 10));
            map.get_or_load(1, || panic!("the entry in use was evicted"));
        }
    }

    #[test]
    fn threads_load_a_value_together_only_once() {
        let map = BoundedMap::new(1 << 20);
        let loads = std::sync::atomic::AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for key in 0..1000u64 {
                        map.get_or_load(key, || {
                            loads.fetch_add(1, Ordering::Relaxed);
                            ((), 1)
                        });
                    }
                });
            }
        });
        assert_eq!(loads.into_inner(), 1000);
    }
}
