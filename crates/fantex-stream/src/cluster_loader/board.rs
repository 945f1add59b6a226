//! The state of a loader: which parcels are wanted, how far their clusters are, and what is ready.
//!
//! The pages of a bundle may lie in several clusters. Such a parcel is wanted of all of them; clusters that come are kept for it
//! (in its [`Assembly`]) until the last one does.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;

use fantex_base::{Error, ErrorKind};
use fantex_store::{ClusterId, ClusterPages, io_cause};
use web_time::Instant;

use super::worker::{ClusterCache, Kept};
use super::{ClusterLoaderOptions, Effects, LoaderStatistics};
use crate::read::{ReadBuffer, RetryPolicy, is_transient};
use crate::{LoadedParcel, Parcel, ParcelTexels};

/// Texels that a worker makes between two looks at the board.
const BATCH_BYTES: usize = 256 << 10;

/// A cluster of which something is wanted, or that is being worked on.
#[derive(Debug)]
struct Wanted {
    /// Parcels that are not ready, with their urgencies.
    parcels: BTreeMap<Parcel, Urgency>,
    stage: Stage,
    failures: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// In [`Board::to_read`].
    Queued,
    /// In [`Board::paused`], until then.
    Paused(Instant),
    /// In a read.
    Reading,
    /// In [`Board::jobs`], or in a worker's hands.
    InWork,
}

/// That of the most urgent parcel; below all others where none is wanted.
fn urgency_of(clusters: &BTreeMap<ClusterId, Wanted>, id: ClusterId) -> Urgency {
    let urgency = clusters.get(&id).and_then(|wanted| wanted.parcels.values().copied().max());
    urgency.unwrap_or(Urgency(f32::NEG_INFINITY))
}

/// A parcel whose pages lie in several clusters.
#[derive(Debug)]
struct Assembly {
    /// Clusters of which it is wanted.
    awaited: Vec<ClusterId>,
    /// Those that have come.
    come: Vec<Arc<ClusterPages>>,
}

/// A parcel that a worker can make, with the clusters that hold its pages.
pub(super) type AssemblableParcel = (Parcel, Vec<Arc<ClusterPages>>);

/// Where a worker finds a cluster's bytes.
#[derive(Clone, Debug)]
pub(super) enum Job {
    /// Read and not checked: a part of a buffer.
    Stored(Arc<ReadBuffer>, Range<usize>),
    /// In the cache, in one form or the other (unless it has left meanwhile).
    Cached,
}

pub(super) enum Order {
    /// Check and unpack a cluster that has been read.
    Unpack(ClusterId, Arc<ReadBuffer>, Range<usize>),
    /// Unpack a cluster whose stored bytes were kept.
    UnpackKept(ClusterId, Arc<ReadBuffer>),
    /// Make parcels of an unpacked cluster.
    Make(ClusterId, Arc<ClusterPages>),
    /// Tell the scheduler: a cluster has to be read again, or there is room for reads.
    TellScheduler,
    /// End.
    End,
}

#[derive(Debug)]
pub(super) struct Board {
    clusters: BTreeMap<ClusterId, Wanted>,
    assemblies: BTreeMap<Parcel, Assembly>,
    /// Clusters at [`Stage::Queued`]. Urgencies are upper bounds.
    to_read: UrgencyQueue<ClusterId>,
    /// Clusters at [`Stage::Paused`], and stale entries.
    paused: BTreeSet<(Instant, ClusterId)>,
    /// Clusters of which the last parcel was cancelled while they were being read.
    abandoned: Vec<ClusterId>,
    jobs: BTreeMap<ClusterId, Job>,
    /// The same clusters. Urgencies are upper bounds.
    job_order: UrgencyQueue<ClusterId>,
    cache: ClusterCache,
    ready: Ready,
    ready_budget: usize,
    in_flight_bytes: usize,
    flight_budget: usize,
    /// Parcels in `clusters`.
    waiting: usize,
    retry: RetryPolicy,
    /// All that workers and scheduler do ends.
    pub(super) is_closed: bool,
    pub(super) counts: LoaderStatistics,
}

impl Board {
    pub(super) fn new(options: &ClusterLoaderOptions, retry: RetryPolicy) -> Self {
        Self {
            clusters: BTreeMap::new(),
            assemblies: BTreeMap::new(),
            to_read: UrgencyQueue::default(),
            paused: BTreeSet::new(),
            abandoned: Vec::new(),
            jobs: BTreeMap::new(),
            job_order: UrgencyQueue::default(),
            cache: ClusterCache::new(options),
            ready: Ready::default(),
            ready_budget: options.ready_bytes,
            in_flight_bytes: 0,
            flight_budget: options.in_flight_bytes,
            waiting: 0,
            retry,
            is_closed: false,
            counts: LoaderStatistics::default(),
        }
    }

    // Called for the caller.

    /// A parcel is wanted, whose pages lie in these clusters.
    pub(super) fn request(
        &mut self,
        parcel: Parcel,
        clusters: &[ClusterId],
        urgency: f32,
        effects: &mut Effects,
    ) {
        let urgency = Urgency(urgency);
        if self.ready.set_urgency(parcel, urgency) {
            return;
        }
        let assembled = (clusters.len() > 1).then(|| {
            let begin = || Assembly { awaited: clusters.to_vec(), come: Vec::new() };
            self.assemblies.entry(parcel).or_insert_with(begin).awaited.clone()
        });
        let mut is_new = true;
        for &cluster in assembled.as_deref().unwrap_or(clusters) {
            is_new &= self.want(parcel, cluster, urgency, effects);
        }
        self.waiting += usize::from(is_new);
    }

    /// A parcel is wanted of a cluster. Whether it was not before.
    fn want(&mut self, parcel: Parcel, cluster: ClusterId, urgency: Urgency, effects: &mut Effects) -> bool {
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            let is_new = wanted.parcels.insert(parcel, urgency).is_none();
            match wanted.stage {
                Stage::Queued => self.to_read.raise(cluster, urgency),
                Stage::InWork if self.job_order.contains(cluster) => self.job_order.raise(cluster, urgency),
                _ => {}
            }
            return is_new;
        }
        let parcels = BTreeMap::from([(parcel, urgency)]);
        self.clusters.insert(cluster, Wanted { parcels, stage: Stage::Queued, failures: 0 });
        if self.cache.contains(cluster) {
            self.add_job(cluster, Job::Cached);
            effects.jobs += 1;
        } else {
            self.to_read.set(cluster, urgency);
            effects.for_scheduler = true;
        }
        true
    }

    /// A parcel that no cluster holds arrives as an error.
    pub(super) fn refuse(&mut self, parcel: Parcel, urgency: f32, error: Error) {
        self.ready.insert(parcel, Urgency(urgency), Err(error));
    }

    /// A parcel is no longer wanted. True if the scheduler may give up a read.
    pub(super) fn cancel(&mut self, parcel: Parcel, clusters: &[ClusterId]) -> bool {
        if self.ready.remove(parcel) {
            return false;
        }
        let awaited = self.assemblies.remove(&parcel).map(|assembly| assembly.awaited);
        let (mut was_wanted, mut for_scheduler) = (false, false);
        for &cluster in awaited.as_deref().unwrap_or(clusters) {
            let is_wanted = self.clusters.get(&cluster).is_some_and(|w| w.parcels.contains_key(&parcel));
            was_wanted |= is_wanted;
            for_scheduler |= is_wanted && self.unwant(parcel, cluster);
        }
        self.waiting -= usize::from(was_wanted);
        for_scheduler
    }

    /// A parcel is no longer wanted of a cluster. True if the scheduler may give up a read.
    fn unwant(&mut self, parcel: Parcel, cluster: ClusterId) -> bool {
        let Some(wanted) = self.clusters.get_mut(&cluster) else { return false };
        if wanted.parcels.remove(&parcel).is_none() || !wanted.parcels.is_empty() {
            return false;
        }
        match wanted.stage {
            Stage::Queued | Stage::Paused(_) => {
                self.to_read.remove(cluster);
                self.clusters.remove(&cluster);
                false
            }
            Stage::Reading => {
                self.abandoned.push(cluster);
                true
            }
            Stage::InWork => false,
        }
    }

    /// What was assembled for a parcel is dropped, and it is no longer wanted of other clusters than this.
    fn end_assembly(&mut self, parcel: Parcel, cluster: ClusterId) {
        let assembly = self.assemblies.remove(&parcel);
        for other in assembly.into_iter().flat_map(|assembly| assembly.awaited) {
            if other != cluster {
                self.unwant(parcel, other);
            }
        }
    }

    /// The most urgent ready parcels, up to `max_bytes`; at least one if there is any.
    pub(super) fn take_ready(&mut self, max_bytes: usize) -> Vec<LoadedParcel> {
        let (mut parcels, mut left) = (Vec::new(), usize::MAX);
        while let Some((parcel, texels)) = self.ready.take_first(left) {
            let bytes = bytes_of(&texels);
            left = left.min(max_bytes).saturating_sub(bytes);
            self.counts.parcel_bytes += bytes as u64;
            *if texels.is_ok() { &mut self.counts.parcels } else { &mut self.counts.parcels_failed } += 1;
            parcels.push(LoadedParcel { parcel, texels });
        }
        parcels
    }

    pub(super) fn ready_is_full(&self) -> bool {
        self.ready.bytes >= self.ready_budget
    }

    pub(super) fn statistics(&self) -> LoaderStatistics {
        LoaderStatistics {
            queued_clusters: self.to_read.urgencies.len(),
            in_flight_bytes: self.in_flight_bytes,
            cache_bytes: self.cache.unpacked.bytes,
            stored_cache_bytes: self.cache.stored.bytes,
            ready_bytes: self.ready.bytes,
            pending: self.waiting + self.ready.outcomes.len(),
            ..self.counts
        }
    }

    // Called by the scheduler.

    /// Queues paused clusters whose time has come. Returns when the next one's comes.
    pub(super) fn resume_paused(&mut self, now: Instant) -> Option<Instant> {
        while let Some(&(until, cluster)) = self.paused.first() {
            if until > now {
                return Some(until);
            }
            self.paused.pop_first();
            if self.clusters.get(&cluster).is_some_and(|wanted| wanted.stage == Stage::Paused(until)) {
                self.read_again(cluster);
            }
        }
        None
    }

    /// Clusters that were given up while they were being read, and still are.
    pub(super) fn take_abandoned(&mut self) -> Vec<ClusterId> {
        let abandoned = std::mem::take(&mut self.abandoned);
        abandoned.into_iter().filter(|&cluster| self.is_abandoned(cluster)).collect()
    }

    pub(super) fn is_abandoned(&self, cluster: ClusterId) -> bool {
        self.clusters.get(&cluster).is_none_or(|wanted| wanted.parcels.is_empty())
    }

    /// Whether another read may begin.
    pub(super) fn has_room_for_reads(&self) -> bool {
        self.in_flight_bytes < self.flight_budget
    }

    /// Takes the most urgent cluster to read, and whether it may be read together with others.
    pub(super) fn next_to_read(&mut self) -> Option<(ClusterId, bool)> {
        let cluster = self.to_read.pop_exact(|id| urgency_of(&self.clusters, id))?;
        Some((cluster, !self.has_failed(cluster)))
    }

    fn has_failed(&self, cluster: ClusterId) -> bool {
        self.clusters.get(&cluster).is_some_and(|wanted| wanted.failures > 0)
    }

    /// Whether a cluster waits to be read and may be read together with others.
    pub(super) fn is_mergeable(&self, cluster: ClusterId) -> bool {
        self.to_read.contains(cluster) && !self.has_failed(cluster)
    }

    pub(super) fn read_begins(&mut self, cluster: ClusterId, stored_bytes: usize) {
        self.to_read.remove(cluster);
        self.in_flight_bytes += stored_bytes;
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            wanted.stage = Stage::Reading;
        }
    }

    pub(super) fn read_cancelled(&mut self, cluster: ClusterId, stored_bytes: usize) {
        self.in_flight_bytes -= stored_bytes;
        self.clusters.remove(&cluster);
    }

    /// A cluster's bytes have arrived. False if they are no longer wanted.
    pub(super) fn read_ends(
        &mut self,
        cluster: ClusterId,
        bytes: Arc<ReadBuffer>,
        part: Range<usize>,
    ) -> bool {
        self.counts.clusters_read += 1;
        self.counts.cluster_bytes += part.len() as u64;
        if self.is_abandoned(cluster) {
            self.counts.clusters_dropped += 1;
            self.clusters.remove(&cluster);
            self.in_flight_bytes -= part.len();
            return false;
        }
        self.add_job(cluster, Job::Stored(bytes, part));
        true
    }

    /// A read of one or more clusters went wrong. `alone`: of this one only; else each is read by itself before it counts as
    /// unreadable.
    pub(super) fn read_fails(&mut self, cluster: ClusterId, stored_bytes: usize, error: Error, alone: bool) {
        self.in_flight_bytes -= stored_bytes;
        let may_pass = io_cause(&error).is_some_and(is_transient);
        let retries = if may_pass { self.retry.retries } else { 0 };
        self.fail(cluster, error, if alone { retries } else { retries.max(1) });
    }

    // Called by workers.

    fn add_job(&mut self, cluster: ClusterId, job: Job) {
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            wanted.stage = Stage::InWork;
            self.jobs.insert(cluster, job);
            self.job_order.set(cluster, urgency_of(&self.clusters, cluster));
        }
    }

    pub(super) fn next_order(&mut self) -> Option<Order> {
        if self.is_closed {
            return Some(Order::End);
        }
        if self.ready_is_full() {
            return None;
        }
        let cluster = self.job_order.pop_exact(|id| urgency_of(&self.clusters, id))?;
        Some(match self.jobs.remove(&cluster)? {
            job if self.is_abandoned(cluster) => {
                if let Job::Stored(_, part) = job {
                    self.counts.clusters_dropped += 1;
                    self.in_flight_bytes -= part.len();
                }
                self.clusters.remove(&cluster);
                Order::TellScheduler
            }
            Job::Stored(bytes, part) => Order::Unpack(cluster, bytes, part),
            Job::Cached => match self.cache.get(cluster) {
                Some(Kept::Pages(pages)) => Order::Make(cluster, pages),
                Some(Kept::Stored(bytes)) => Order::UnpackKept(cluster, bytes),
                None => {
                    self.read_again(cluster);
                    Order::TellScheduler
                }
            },
        })
    }

    /// A cluster has waited long enough, or had been at hand and is not any more.
    fn read_again(&mut self, cluster: ClusterId) {
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            wanted.stage = Stage::Queued;
            self.to_read.set(cluster, urgency_of(&self.clusters, cluster));
        }
    }

    /// The bytes of a cluster that was read are no longer in flight. `kept`: a copy of them, if they were good.
    pub(super) fn finish_read(
        &mut self,
        cluster: ClusterId,
        stored_bytes: usize,
        kept: Option<&Arc<ReadBuffer>>,
    ) {
        self.in_flight_bytes -= stored_bytes;
        if let Some(bytes) = kept {
            self.cache.stored.insert(cluster, bytes);
        }
    }

    pub(super) fn unpacked(&mut self, cluster: ClusterId, pages: Result<&Arc<ClusterPages>, Error>) {
        match pages {
            Ok(pages) => self.cache.unpacked.insert(cluster, pages),
            // The bytes may have been damaged on their way here: once more.
            Err(error) if error.kind() == ErrorKind::Damaged => {
                self.fail(cluster, error, self.retry.retries.min(1))
            }
            Err(error) => self.fail(cluster, error, 0),
        }
    }

    /// The next parcels to make of a cluster, or none where that ends for now: all done, or no room for more. Of parcels that
    /// need other clusters, too, those are next whose last cluster this is; the others keep it until theirs comes.
    pub(super) fn next_batch(
        &mut self,
        cluster: ClusterId,
        pages: &Arc<ClusterPages>,
        bytes_of: impl Fn(Parcel) -> usize,
    ) -> Vec<AssemblableParcel> {
        let Some(wanted) = self.clusters.get_mut(&cluster) else { return Vec::new() };
        let assemblies = &mut self.assemblies;
        wanted.parcels.retain(|parcel, _| match assemblies.get_mut(parcel) {
            Some(assembly) if assembly.awaited.len() > 1 => {
                assembly.awaited.retain(|&awaited| awaited != cluster);
                assembly.come.push(Arc::clone(pages));
                false
            }
            _ => true,
        });
        if wanted.parcels.is_empty() {
            self.clusters.remove(&cluster);
            return Vec::new();
        }
        let mut by_urgency: Vec<(Urgency, Parcel)> = wanted.parcels.iter().map(|(id, u)| (*u, *id)).collect();
        if self.ready_is_full() {
            self.add_job(cluster, Job::Cached);
            return Vec::new();
        }
        by_urgency.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut bytes = 0;
        let fits = |&(_, parcel): &(Urgency, Parcel)| {
            let fits = bytes < BATCH_BYTES;
            bytes += bytes_of(parcel);
            fits
        };
        let with_clusters = |(_, parcel): (Urgency, Parcel)| {
            let come = self.assemblies.get(&parcel).map_or(&[][..], |assembly| &assembly.come);
            (parcel, come.iter().chain([pages]).map(Arc::clone).collect())
        };
        by_urgency.into_iter().take_while(fits).map(with_clusters).collect()
    }

    /// Parcels that have been made of a cluster. Those that were cancelled meanwhile are dropped.
    pub(super) fn made(&mut self, cluster: ClusterId, parcels: Vec<(Parcel, Result<ParcelTexels, Error>)>) {
        for (parcel, texels) in parcels {
            let Some(wanted) = self.clusters.get_mut(&cluster) else { return };
            if let Some(urgency) = wanted.parcels.remove(&parcel) {
                self.waiting -= 1;
                // Were it cancelled and asked for again meanwhile, others would be awaited.
                self.end_assembly(parcel, cluster);
                self.ready.insert(parcel, urgency, texels);
            }
        }
    }

    /// A cluster went wrong: it is read again after a pause, or all its parcels arrive as errors.
    fn fail(&mut self, cluster: ClusterId, error: Error, retries: u32) {
        let Some(mut wanted) = self.clusters.remove(&cluster) else { return };
        if wanted.parcels.is_empty() {
            return;
        }
        if wanted.failures < retries {
            let until = Instant::now() + self.retry.pause(wanted.failures);
            self.counts.retries += 1;
            wanted.failures += 1;
            wanted.stage = Stage::Paused(until);
            self.paused.insert((until, cluster));
            self.clusters.insert(cluster, wanted);
            return;
        }
        self.counts.clusters_failed += 1;
        self.waiting -= wanted.parcels.len();
        for (parcel, urgency) in wanted.parcels {
            self.end_assembly(parcel, cluster);
            self.ready.insert(parcel, urgency, Err(error.clone()));
        }
    }
}

/// An urgency in the order of numbers. (NaN sorts above or below all others.)
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

/// Keys, each once, by urgency. All operations take logarithmic time.
#[derive(Debug)]
pub(super) struct UrgencyQueue<K> {
    /// Ascending; equally urgent keys descending, so that the last is the most urgent, lowest key.
    order: BTreeSet<(Urgency, Reverse<K>)>,
    urgencies: BTreeMap<K, Urgency>,
}

impl<K> Default for UrgencyQueue<K> {
    fn default() -> Self {
        Self { order: BTreeSet::new(), urgencies: BTreeMap::new() }
    }
}

impl<K: Copy + Ord> UrgencyQueue<K> {
    pub(super) fn set(&mut self, key: K, urgency: Urgency) {
        if let Some(old) = self.urgencies.insert(key, urgency) {
            if old == urgency {
                return;
            }
            self.order.remove(&(old, Reverse(key)));
        }
        self.order.insert((urgency, Reverse(key)));
    }

    fn raise(&mut self, key: K, urgency: Urgency) {
        if self.urgencies.get(&key).is_none_or(|old| *old < urgency) {
            self.set(key, urgency);
        }
    }

    /// True if it was there.
    pub(super) fn remove(&mut self, key: K) -> bool {
        match self.urgencies.remove(&key) {
            Some(urgency) => self.order.remove(&(urgency, Reverse(key))),
            None => false,
        }
    }

    pub(super) fn contains(&self, key: K) -> bool {
        self.urgencies.contains_key(&key)
    }

    /// The most urgent; of several the lowest.
    pub(super) fn first(&self) -> Option<(K, Urgency)> {
        self.order.last().map(|&(urgency, Reverse(key))| (key, urgency))
    }

    /// Takes the most urgent out, where the urgencies in the queue are upper bounds: `exact` tells the true one.
    fn pop_exact(&mut self, exact: impl Fn(K) -> Urgency) -> Option<K> {
        loop {
            let (key, bound) = self.first()?;
            let urgency = exact(key);
            if urgency < bound {
                self.set(key, urgency);
            } else {
                self.remove(key);
                return Some(key);
            }
        }
    }
}

/// Texels, or why there are none.
type Outcome = Result<ParcelTexels, Error>;

/// Queues are rebuilt when stale entries exceed the others by this.
const MAX_STALE_ENTRIES: usize = 1 << 12;

/// Parcels that have arrived, until they are taken.
///
/// There are tens of thousands of them after a cut, but few urgencies. So each urgency has a queue, and a parcel that is removed or gets
/// another urgency leaves a stale entry: finding a parcel costs a hash, not a walk down a tree that no cache holds.
#[derive(Debug, Default)]
pub(super) struct Ready {
    outcomes: HashMap<Parcel, (Urgency, Outcome)>,
    /// In each queue in the order of arrival.
    queues: BTreeMap<Urgency, VecDeque<Parcel>>,
    /// In all queues, stale ones among them.
    entries: usize,
    bytes: usize,
}

impl Ready {
    pub(super) fn insert(&mut self, parcel: Parcel, urgency: Urgency, outcome: Outcome) {
        self.bytes += bytes_of(&outcome);
        let last = self.outcomes.insert(parcel, (urgency, outcome));
        if let Some((_, last)) = &last {
            self.bytes -= bytes_of(last);
        }
        if last.is_none_or(|(last, _)| last != urgency) {
            self.enqueue(parcel, urgency);
        }
    }

    /// False if the parcel is not here.
    fn set_urgency(&mut self, parcel: Parcel, urgency: Urgency) -> bool {
        let Some((known, _)) = self.outcomes.get_mut(&parcel) else { return false };
        if std::mem::replace(known, urgency) != urgency {
            self.enqueue(parcel, urgency);
        }
        true
    }

    fn enqueue(&mut self, parcel: Parcel, urgency: Urgency) {
        self.queues.entry(urgency).or_default().push_back(parcel);
        self.entries += 1;
        if self.entries > MAX_STALE_ENTRIES + 2 * self.outcomes.len() {
            let outcomes = &self.outcomes;
            self.queues.retain(|urgency, queue| {
                queue.retain(|parcel| outcomes.get(parcel).is_some_and(|(known, _)| known == urgency));
                !queue.is_empty()
            });
            self.entries = self.queues.values().map(VecDeque::len).sum();
        }
    }

    /// False if the parcel is not here.
    pub(super) fn remove(&mut self, parcel: Parcel) -> bool {
        let outcome = self.outcomes.remove(&parcel);
        self.bytes -= outcome.as_ref().map_or(0, |(_, outcome)| bytes_of(outcome));
        outcome.is_some()
    }

    /// Takes the most urgent parcel, if it has at most `max_bytes`.
    fn take_first(&mut self, max_bytes: usize) -> Option<(Parcel, Outcome)> {
        loop {
            let mut last = self.queues.last_entry()?;
            let Some(&parcel) = last.get().front() else {
                last.remove();
                continue;
            };
            let outcome = self.outcomes.get(&parcel).filter(|(urgency, _)| urgency == last.key());
            let bytes = outcome.map(|(_, outcome)| bytes_of(outcome));
            if bytes.is_some_and(|bytes| bytes > max_bytes) {
                return None;
            }
            last.get_mut().pop_front();
            self.entries -= 1;
            if let Some(bytes) = bytes {
                self.bytes -= bytes;
                return self.outcomes.remove(&parcel).map(|(_, outcome)| (parcel, outcome));
            }
        }
    }
}

/// What a parcel counts for: its texels, if any.
fn bytes_of(outcome: &Outcome) -> usize {
    outcome.as_ref().map_or(0, ParcelTexels::bytes)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn the_most_urgent_comes_first_and_changes_count() {
        let mut queue = UrgencyQueue::default();
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
        assert!(queue.urgencies.is_empty());
    }

    fn queue_urgency(name: i32) -> f32 {
        if name == 1 { 0.5 } else { 0.0 }
    }

    #[test]
    fn the_most_urgent_comes_first_whatever_its_urgency_was_before() {
        let parcel = |bundle| Parcel::Bundle { bundle, step: 0 };
        let outcome = |bytes: usize| {
            Ok(ParcelTexels {
                extent: [4, 4],
                outline: crate::Outline::WHOLE,
                channels: vec![Arc::from(vec![0; bytes])],
            })
        };
        let mut ready = Ready::default();
        for (bundle, urgency) in [(1, 0.5), (2, 3.0), (3, -1.0), (4, 3.0), (5, 2.0)] {
            ready.insert(parcel(bundle), Urgency(urgency), outcome(10 * bundle as usize));
        }
        assert!(ready.set_urgency(parcel(3), Urgency(9.0)) && !ready.set_urgency(parcel(6), Urgency(1.0)));
        ready.set_urgency(parcel(3), Urgency(-1.0));
        ready.set_urgency(parcel(3), Urgency(9.0));
        assert!(ready.remove(parcel(5)) && !ready.remove(parcel(5)));
        ready.insert(parcel(1), Urgency(0.5), outcome(11));
        assert_eq!((ready.outcomes.len(), ready.bytes), (4, 11 + 20 + 30 + 40));
        assert!(ready.take_first(29).is_none());
        let taken = std::iter::from_fn(|| ready.take_first(usize::MAX)).map(|(parcel, _)| parcel);
        assert_eq!(taken.collect::<Vec<_>>(), [3, 2, 4, 1].map(parcel));
        assert_eq!((ready.outcomes.len(), ready.bytes, ready.entries), (0, 0, 0));
    }

    #[test]
    fn stale_entries_do_not_pile_up() {
        let mut ready = Ready::default();
        for i in 0..100_000 {
            let parcel = Parcel::Bundle { bundle: i % 3, step: 0 };
            let texels =
                ParcelTexels { extent: [4, 4], outline: crate::Outline::WHOLE, channels: Vec::new() };
            ready.insert(parcel, Urgency((i % 7) as f32), Ok(texels));
            assert!(ready.entries <= MAX_STALE_ENTRIES + 7, "{}", ready.entries);
        }
    }
}
