//! The state of a loader: which pages are wanted, how far their clusters are, and what is ready.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use fantex_store::{ClusterId, ClusterPages, PageError, PageId};

use super::by_urgency::{ByUrgency, Urgency};
use super::cluster_cache::ClusterCache;
use super::{ClusterLoaderOptions, LoaderStatistics};
use crate::read::{ReadBuffer, RetryPolicy, is_transient};
use crate::{LoadedPage, PageTexels};

/// Texels that a worker makes between two looks at the board.
const BATCH_BYTES: usize = 256 << 10;

/// A cluster of which pages are wanted, or that is being worked on.
#[derive(Debug)]
struct Wanted {
    /// Pages that are not ready, with their urgencies.
    pages: BTreeMap<PageId, Urgency>,
    stage: Stage,
    /// Reads that went wrong.
    failures: u32,
}

/// How far a cluster is.
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

impl Wanted {
    fn urgency(&self) -> Urgency {
        self.pages.values().copied().max().unwrap_or(Urgency(f32::NEG_INFINITY))
    }
}

/// Where a worker finds a cluster's bytes.
#[derive(Clone, Debug)]
pub(super) enum Job {
    /// Read and not checked: a part of a buffer.
    Stored(Arc<ReadBuffer>, Range<usize>),
    /// In the cache (unless it has left meanwhile).
    Cached,
}

/// What a request calls for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// Nothing new.
    None,
    /// There is a cluster to read.
    Read,
    /// There is a job for a worker.
    Job,
}

/// What a worker shall do.
pub(super) enum Order {
    /// Check and unpack a cluster.
    Unpack(ClusterId, Arc<ReadBuffer>, Range<usize>),
    /// Decode pages of an unpacked cluster.
    Decode(ClusterId, Arc<ClusterPages>),
    /// Tell the scheduler: a cluster has to be read again, or there is room for reads.
    TellScheduler,
    /// End.
    End,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Board {
    clusters: BTreeMap<ClusterId, Wanted>,
    /// Clusters at [`Stage::Queued`]. Urgencies are upper bounds.
    to_read: ByUrgency<ClusterId>,
    /// Clusters at [`Stage::Paused`], and remains of those that are no more.
    paused: BTreeMap<(Instant, ClusterId), ()>,
    /// Clusters of which the last page was cancelled while they were being read.
    given_up: Vec<ClusterId>,
    jobs: BTreeMap<ClusterId, Job>,
    /// The same clusters. Urgencies are upper bounds.
    job_order: ByUrgency<ClusterId>,
    cache: ClusterCache,
    ready: BTreeMap<PageId, Result<PageTexels, PageError>>,
    /// The same pages.
    ready_order: ByUrgency<PageId>,
    ready_bytes: usize,
    ready_budget: usize,
    flight_bytes: usize,
    flight_budget: usize,
    /// Pages in `clusters`.
    waiting_pages: usize,
    retry: RetryPolicy,
    closed: bool,
    counts: LoaderStatistics,
}

impl Board {
    pub(super) fn new(options: &ClusterLoaderOptions, retry: RetryPolicy) -> Self {
        Self {
            clusters: BTreeMap::new(),
            to_read: ByUrgency::default(),
            paused: BTreeMap::new(),
            given_up: Vec::new(),
            jobs: BTreeMap::new(),
            job_order: ByUrgency::default(),
            cache: ClusterCache::new(options.cache_bytes),
            ready: BTreeMap::new(),
            ready_order: ByUrgency::default(),
            ready_bytes: 0,
            ready_budget: options.ready_bytes,
            flight_bytes: 0,
            flight_budget: options.flight_bytes,
            waiting_pages: 0,
            retry,
            closed: false,
            counts: LoaderStatistics::default(),
        }
    }

    // What the caller does.

    /// A page of a cluster is wanted.
    pub(super) fn request(&mut self, page: PageId, cluster: ClusterId, urgency: f32) -> Change {
        let urgency = Urgency(urgency);
        if self.ready_order.contains(page) {
            self.ready_order.set(page, urgency);
            return Change::None;
        }
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            self.waiting_pages += usize::from(wanted.pages.insert(page, urgency).is_none());
            match wanted.stage {
                Stage::Queued => self.to_read.raise(cluster, urgency),
                Stage::InWork if self.job_order.contains(cluster) => self.job_order.raise(cluster, urgency),
                _ => {}
            }
            return Change::None;
        }
        let pages = BTreeMap::from([(page, urgency)]);
        self.waiting_pages += 1;
        self.clusters.insert(cluster, Wanted { pages, stage: Stage::Queued, failures: 0 });
        if self.cache.contains(cluster) {
            self.add_job(cluster, Job::Cached);
            Change::Job
        } else {
            self.to_read.set(cluster, urgency);
            Change::Read
        }
    }

    /// A page that no cluster holds arrives as an error.
    pub(super) fn refuse(&mut self, page: PageId, urgency: f32, error: PageError) {
        self.make_ready(page, Urgency(urgency), Err(error));
    }

    pub(super) fn cancel_refused(&mut self, page: PageId) {
        self.remove_ready(page);
    }

    /// A page is no longer wanted. True if the scheduler may give up a read.
    pub(super) fn cancel(&mut self, page: PageId, cluster: ClusterId) -> bool {
        if self.remove_ready(page).is_some() {
            return false;
        }
        let Some(wanted) = self.clusters.get_mut(&cluster) else { return false };
        if wanted.pages.remove(&page).is_none() {
            return false;
        }
        self.waiting_pages -= 1;
        if !wanted.pages.is_empty() {
            return false;
        }
        match wanted.stage {
            Stage::Queued => {
                self.to_read.remove(cluster);
                self.clusters.remove(&cluster);
                false
            }
            Stage::Paused(_) => {
                self.clusters.remove(&cluster);
                false
            }
            Stage::Reading => {
                self.given_up.push(cluster);
                true
            }
            Stage::InWork => false,
        }
    }

    /// The most urgent ready pages of at most so many bytes, at least one if there is any.
    pub(super) fn take_ready(&mut self, max_bytes: usize) -> Vec<LoadedPage> {
        let (mut pages, mut sum) = (Vec::new(), 0);
        while let Some((page, _)) = self.ready_order.first() {
            let bytes = self.ready.get(&page).map_or(0, ready_bytes);
            if !pages.is_empty() && sum + bytes > max_bytes {
                break;
            }
            sum += bytes;
            if let Some(texels) = self.remove_ready(page) {
                match &texels {
                    Ok(texels) => {
                        self.counts.pages += 1;
                        self.counts.page_bytes += texels.bytes() as u64;
                    }
                    Err(_) => self.counts.pages_failed += 1,
                }
                pages.push(LoadedPage { page, texels });
            }
        }
        pages
    }

    pub(super) fn pending(&self) -> usize {
        self.waiting_pages + self.ready.len()
    }

    pub(super) fn ready_is_full(&self) -> bool {
        self.ready_bytes >= self.ready_budget
    }

    pub(super) fn statistics(&self) -> LoaderStatistics {
        LoaderStatistics {
            queued_clusters: self.to_read.len(),
            flight_bytes: self.flight_bytes,
            cache_bytes: self.cache.bytes(),
            ready_bytes: self.ready_bytes,
            pending_pages: self.pending(),
            ..self.counts
        }
    }

    /// All that workers and scheduler do ends.
    pub(super) fn close(&mut self) {
        self.closed = true;
    }

    // What the scheduler does.

    pub(super) fn counts(&mut self) -> &mut LoaderStatistics {
        &mut self.counts
    }

    pub(super) fn is_closed(&self) -> bool {
        self.closed
    }

    /// Queues paused clusters whose time has come. Returns when the next one's comes.
    pub(super) fn resume_paused(&mut self, now: Instant) -> Option<Instant> {
        while let Some((&(until, cluster), ())) = self.paused.first_key_value() {
            if until > now {
                return Some(until);
            }
            self.paused.pop_first();
            if let Some(wanted) = self.clusters.get_mut(&cluster)
                && wanted.stage == Stage::Paused(until)
            {
                wanted.stage = Stage::Queued;
                let urgency = wanted.urgency();
                self.to_read.set(cluster, urgency);
            }
        }
        None
    }

    /// Clusters that were given up while they were being read, and still are.
    pub(super) fn take_given_up(&mut self) -> Vec<ClusterId> {
        let given_up = std::mem::take(&mut self.given_up);
        given_up.into_iter().filter(|&cluster| self.is_given_up(cluster)).collect()
    }

    pub(super) fn is_given_up(&self, cluster: ClusterId) -> bool {
        self.clusters.get(&cluster).is_none_or(|wanted| wanted.pages.is_empty())
    }

    /// Whether another read may begin.
    pub(super) fn has_room_for_reads(&self) -> bool {
        self.flight_bytes < self.flight_budget
    }

    /// Takes the most urgent cluster to read, and whether it may be read together with others.
    pub(super) fn next_to_read(&mut self) -> Option<(ClusterId, bool)> {
        let clusters = &self.clusters;
        let exact = |id: ClusterId| clusters.get(&id).map_or(Urgency(f32::NEG_INFINITY), Wanted::urgency);
        let cluster = self.to_read.pop_exact(exact)?;
        Some((cluster, !self.has_failed(cluster)))
    }

    fn has_failed(&self, cluster: ClusterId) -> bool {
        self.clusters.get(&cluster).is_some_and(|wanted| wanted.failures > 0)
    }

    /// Whether a cluster waits to be read and may be read together with others.
    pub(super) fn is_mergeable(&self, cluster: ClusterId) -> bool {
        self.to_read.contains(cluster) && !self.has_failed(cluster)
    }

    /// A cluster is in a read now.
    pub(super) fn read_begins(&mut self, cluster: ClusterId, stored_bytes: usize) {
        self.to_read.remove(cluster);
        self.flight_bytes += stored_bytes;
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            wanted.stage = Stage::Reading;
        }
    }

    /// A read was cancelled before it began.
    pub(super) fn read_cancelled(&mut self, cluster: ClusterId, stored_bytes: usize) {
        self.flight_bytes -= stored_bytes;
        self.clusters.remove(&cluster);
    }

    /// A cluster's bytes have come. False if nobody wants them any more.
    pub(super) fn read_ends(
        &mut self,
        cluster: ClusterId,
        bytes: Arc<ReadBuffer>,
        part: Range<usize>,
    ) -> bool {
        self.counts.clusters_read += 1;
        self.counts.cluster_bytes += part.len() as u64;
        if self.is_given_up(cluster) {
            self.counts.clusters_dropped += 1;
            self.clusters.remove(&cluster);
            self.flight_bytes -= part.len();
            return false;
        }
        self.add_job(cluster, Job::Stored(bytes, part));
        true
    }

    /// A read of one or more clusters went wrong. `alone`: of this one only; else each is read by itself before it counts as
    /// unreadable.
    pub(super) fn read_fails(
        &mut self,
        cluster: ClusterId,
        stored_bytes: usize,
        error: PageError,
        alone: bool,
    ) {
        self.flight_bytes -= stored_bytes;
        let may_pass = matches!(&error, PageError::Io { source, .. } if is_transient(source));
        let retries = if may_pass { self.retry.retries } else { 0 };
        self.fail(cluster, error, if alone { retries } else { retries.max(1) });
    }

    // What workers do.

    fn add_job(&mut self, cluster: ClusterId, job: Job) {
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            wanted.stage = Stage::InWork;
            let urgency = wanted.urgency();
            self.jobs.insert(cluster, job);
            self.job_order.set(cluster, urgency);
        }
    }

    /// The next thing to do, if there is any.
    pub(super) fn next_order(&mut self) -> Option<Order> {
        if self.closed {
            return Some(Order::End);
        }
        if self.ready_is_full() {
            return None;
        }
        let clusters = &self.clusters;
        let exact = |id: ClusterId| clusters.get(&id).map_or(Urgency(f32::NEG_INFINITY), Wanted::urgency);
        let cluster = self.job_order.pop_exact(exact)?;
        Some(match self.jobs.remove(&cluster)? {
            Job::Stored(_, part) if self.is_given_up(cluster) => {
                self.counts.clusters_dropped += 1;
                self.flight_bytes -= part.len();
                self.clusters.remove(&cluster);
                Order::TellScheduler
            }
            Job::Stored(bytes, part) => Order::Unpack(cluster, bytes, part),
            Job::Cached => match self.cache.get(cluster) {
                Some(pages) => Order::Decode(cluster, pages),
                None => {
                    self.read_again(cluster);
                    Order::TellScheduler
                }
            },
        })
    }

    /// A cluster that had been at hand is not any more.
    fn read_again(&mut self, cluster: ClusterId) {
        if let Some(wanted) = self.clusters.get_mut(&cluster) {
            wanted.stage = Stage::Queued;
            let urgency = wanted.urgency();
            self.to_read.set(cluster, urgency);
        }
    }

    /// A cluster has been unpacked, or cannot be. Its stored bytes are gone.
    pub(super) fn unpacked(
        &mut self,
        cluster: ClusterId,
        stored_bytes: usize,
        pages: Result<&Arc<ClusterPages>, PageError>,
    ) {
        self.flight_bytes -= stored_bytes;
        match pages {
            Ok(pages) => self.cache.insert(cluster, pages),
            // The bytes may have been damaged on their way here: once more.
            Err(error @ PageError::Checksum { .. }) => self.fail(cluster, error, self.retry.retries.min(1)),
            Err(error) => self.fail(cluster, error, 0),
        }
    }

    /// The next pages of a cluster to decode, or none where that ends for now: all done, or no room for more.
    pub(super) fn next_batch(
        &mut self,
        cluster: ClusterId,
        bytes_of: impl Fn(PageId) -> usize,
    ) -> Vec<PageId> {
        let Some(wanted) = self.clusters.get(&cluster) else { return Vec::new() };
        if wanted.pages.is_empty() {
            self.clusters.remove(&cluster);
            return Vec::new();
        }
        if self.ready_bytes >= self.ready_budget {
            self.add_job(cluster, Job::Cached);
            return Vec::new();
        }
        let mut by_urgency: Vec<(Urgency, PageId)> = wanted.pages.iter().map(|(id, u)| (*u, *id)).collect();
        by_urgency.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut bytes = 0;
        let fits = |&(_, page): &(Urgency, PageId)| {
            let fits = bytes < BATCH_BYTES;
            bytes += bytes_of(page);
            fits
        };
        by_urgency.into_iter().take_while(fits).map(|(_, page)| page).collect()
    }

    /// Pages of a cluster that have been decoded. Those that were cancelled meanwhile are dropped.
    pub(super) fn decoded(
        &mut self,
        cluster: ClusterId,
        pages: Vec<(PageId, Result<PageTexels, PageError>)>,
    ) {
        for (page, texels) in pages {
            let Some(wanted) = self.clusters.get_mut(&cluster) else { return };
            if let Some(urgency) = wanted.pages.remove(&page) {
                self.waiting_pages -= 1;
                self.make_ready(page, urgency, texels);
            }
        }
    }

    // Together.

    /// A cluster went wrong: it is read again after a pause, or all its pages arrive as errors.
    fn fail(&mut self, cluster: ClusterId, error: PageError, retries: u32) {
        let Some(mut wanted) = self.clusters.remove(&cluster) else { return };
        if wanted.pages.is_empty() {
            return;
        }
        if wanted.failures < retries {
            let until = Instant::now() + self.retry.pause(wanted.failures);
            self.counts.retries += 1;
            wanted.failures += 1;
            wanted.stage = Stage::Paused(until);
            self.paused.insert((until, cluster), ());
            self.clusters.insert(cluster, wanted);
            return;
        }
        self.counts.clusters_failed += 1;
        self.waiting_pages -= wanted.pages.len();
        for (page, urgency) in wanted.pages {
            self.make_ready(page, urgency, Err(error.clone()));
        }
    }

    fn make_ready(&mut self, page: PageId, urgency: Urgency, texels: Result<PageTexels, PageError>) {
        self.ready_bytes += ready_bytes(&texels);
        if let Some(old) = self.ready.insert(page, texels) {
            self.ready_bytes -= ready_bytes(&old);
        }
        self.ready_order.set(page, urgency);
    }

    fn remove_ready(&mut self, page: PageId) -> Option<Result<PageTexels, PageError>> {
        self.ready_order.remove(page);
        let texels = self.ready.remove(&page)?;
        self.ready_bytes -= ready_bytes(&texels);
        Some(texels)
    }
}

/// What a ready page counts for: its texels, if any.
fn ready_bytes(texels: &Result<PageTexels, PageError>) -> usize {
    texels.as_ref().map_or(0, PageTexels::bytes)
}
