//! The parcel loader over clusters: from requests to texels.
//!
//! ```text
//!   caller's thread                    scheduler                reader              workers
//!  request, cancel --> Inbox --> Board --most urgent clusters--> reads --bytes--> check, unpack, assemble
//!   poll <--------------------- ready parcels <----------------------------------------'
//! ```
//!
//! Who owns what, on which thread:
//! - The [`Board`] holds all state, behind one lock that is never held while reading, unpacking or decoding. A parcel that was asked for
//!   stands with its clusters until its texels are there, then among the ready ones until [`poll`](ParcelLoader::poll) takes it. So none
//!   is lost and none comes twice.
//! - The *scheduler* thread owns the [`QueuedReader`]. It turns the most urgent clusters into reads, neighbours in the file
//!   joined, and completed reads into jobs.
//! - *Workers* check, unpack and assemble (and decode, where the atlas asks for it) the parcels that are still wanted. Clusters stay in a
//!   [cache](worker), unpacked or as they are stored, because tiles that are neighbours on the surface lie together.
//! - The caller's thread never waits: its messages lie in an [`Inbox`] until the scheduler takes them over, and where the board is not
//!   free, it takes ready parcels in the next frame.
//!
//! A web page may have no threads. There ([`ClusterLoader::without_threads`]) scheduler and worker take a step within every
//! [`poll`](ParcelLoader::poll): the same pieces, in slices of time.
//!
//! Memory is bounded by the options, whatever the asset's size: bytes in flight (being read, or read and not unpacked), the cache, and
//! ready parcels. When nobody takes these, workers pause; when workers pause, reading does.
//!
//! Errors that may pass are met by reading the cluster again, alone, after a pause, a few times; a wrong checksum once (the bytes may
//! have been damaged on their way). Then every parcel that needs the cluster arrives as an error. So an unreadable cluster takes one
//! level of whole bundles with it, also of tiles whose pages lie in good clusters; finer and coarser levels stay.

mod board;
mod scheduler;
mod worker;

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread::JoinHandle;
use std::time::Duration;

use board::{Board, Order};
use fantex_base::{Error, ErrorKind, Result};
use fantex_store::{Asset, ClusterId, PageId};
use scheduler::{FileOrder, Scheduler};
use web_time::Instant;
use worker::Worker;

use crate::read::{FileReadOptions, QueuedReader, ReadWaker, ReaderInfo, ReaderKind, RetryPolicy};
use crate::{AtlasFormat, LoadedParcel, Parcel, ParcelLoader};

/// How a [`ClusterLoader`] works and what it may use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClusterLoaderOptions {
    /// Whether the atlas takes block-compressed texels; else they are decoded. See [`AtlasFormat::of`].
    pub block_compressed: bool,
    /// Threads that unpack and decode, at least 1.
    pub worker_threads: usize,
    /// Stored bytes that are being read or wait to be unpacked, at most (one read may exceed it).
    pub in_flight_bytes: usize,
    /// Maximum bytes of unpacked clusters that are cached.
    pub cache_bytes: usize,
    /// Maximum bytes of clusters that are cached as they are stored.
    pub stored_cache_bytes: usize,
    /// Maximum bytes of texels that wait to be taken (plus one batch of 256 KiB per worker).
    pub ready_bytes: usize,
    /// Neighbouring clusters are read together up to this number of bytes.
    pub merge_bytes: u64,
    /// Unwanted bytes between two clusters that are read along rather than two reads made.
    pub merge_gap_bytes: u64,
    /// What to do about errors that may pass. None: what suits the reader.
    pub retry: Option<RetryPolicy>,
    /// How files are read.
    pub file: FileReadOptions,
}

impl Default for ClusterLoaderOptions {
    /// Block-compressed; one worker per core, 1 to 4; 16 MiB in flight, 64 MiB of clusters unpacked and 96 MiB of them stored,
    /// 16 MiB ready; reads of up to 1 MiB.
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
        Self {
            block_compressed: true,
            worker_threads: cores.clamp(1, 4),
            in_flight_bytes: 16 << 20,
            cache_bytes: 64 << 20,
            stored_cache_bytes: 96 << 20,
            ready_bytes: 16 << 20,
            merge_bytes: 1 << 20,
            merge_gap_bytes: 16 << 10,
            retry: None,
            file: FileReadOptions::default(),
        }
    }
}

struct Shared {
    asset: Arc<Asset>,
    formats: Vec<AtlasFormat>,
    options: ClusterLoaderOptions,
    board: SharedBoard,
    inbox: Inbox,
    scheduler: SchedulerWaker,
}

impl std::fmt::Debug for Shared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shared").field("path", &self.asset.path()).finish_non_exhaustive()
    }
}

impl Shared {
    fn tell(&self, messages: impl Iterator<Item = Message>) {
        // Made before the lock is taken.
        let mut messages: VecDeque<Message> = messages.collect();
        if !messages.is_empty() {
            self.inbox.lock().append(&mut messages);
            self.scheduler.wake();
        }
    }

    /// Wakes the threads that have something to do after messages were taken over.
    fn notify(&self, effects: Effects) {
        if effects.for_scheduler || effects.has_more {
            self.scheduler.wake();
        }
        match effects.jobs {
            _ if effects.has_room => self.board.work.notify_all(),
            0 => {}
            1 => self.board.work.notify_one(),
            _ => self.board.work.notify_all(),
        }
    }

    fn statistics(&self) -> LoaderStatistics {
        let mut board = self.board.lock();
        let effects = self.inbox.take_all(&mut board);
        let statistics = board.statistics();
        drop(board);
        self.notify(effects);
        statistics
    }
}

/// Wakes the scheduler, once however often it is asked before the scheduler looks.
struct SchedulerWaker {
    waker: ReadWaker,
    pending: AtomicBool,
}

impl SchedulerWaker {
    fn wake(&self) {
        if !self.pending.swap(true, Ordering::AcqRel) {
            self.waker.wake();
        }
    }

    /// The scheduler is about to look.
    fn clear(&self) {
        self.pending.store(false, Ordering::Release);
    }
}

/// Loads pages of an asset through its clusters. Dropping it ends its threads, after the reads that are in flight.
#[derive(Debug)]
pub struct ClusterLoader {
    shared: Arc<Shared>,
    info: ReaderInfo,
    scheduler: Option<JoinHandle<()>>,
    workers: Vec<JoinHandle<()>>,
    /// What the caller's own thread does, where there are no others.
    own_steps: Option<OwnSteps>,
    /// Polls in a row that returned nothing because the board was locked.
    missed_polls: u32,
}

struct OwnSteps {
    scheduler: Scheduler,
    worker: Worker,
    slice: Duration,
}

impl std::fmt::Debug for OwnSteps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OwnSteps").field("slice", &self.slice).finish_non_exhaustive()
    }
}

/// Polls in a row that may return nothing because the board is locked; the next one waits for it.
const MAX_MISSED_POLLS: u32 = 3;

impl ClusterLoader {
    /// A loader that reads the asset where it was opened: its file, or its URL.
    ///
    /// # Errors
    /// The file cannot be opened, or the system refuses a thread.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open(asset: Arc<Asset>, options: &ClusterLoaderOptions) -> Result<Self> {
        let reader = crate::read::open_reader(&asset, &options.file).map_err(|error| {
            set_up_error(&asset, &format!("open {} for streaming", asset.path().display()), error)
        })?;
        Self::with_reader(asset, reader, options)
    }

    /// A loader that reads the asset's bytes through `reader`.
    ///
    /// # Errors
    /// The system refuses a thread.
    pub fn with_reader(
        asset: Arc<Asset>,
        reader: Box<dyn QueuedReader>,
        options: &ClusterLoaderOptions,
    ) -> Result<Self> {
        let mut loader = Self::idle(asset, &*reader, options);
        let shared = Arc::clone(&loader.shared);
        let what = format!("start a thread for streaming {}", shared.asset.path().display());
        let thread_error = |error| set_up_error(&shared.asset, &what, error);
        for index in 0..options.worker_threads.max(1) {
            let worker = Worker::new(Arc::clone(&shared));
            let thread = std::thread::Builder::new().name(format!("fan-unpack-{index}"));
            loader.workers.push(thread.spawn(move || worker.run()).map_err(thread_error)?);
        }
        let scheduler = Scheduler::new(Arc::clone(&shared), reader, FileOrder::new(&shared.asset));
        let thread = std::thread::Builder::new().name("fan-schedule".into());
        loader.scheduler = Some(thread.spawn(move || scheduler.run()).map_err(thread_error)?);
        Ok(loader)
    }

    /// A loader without threads of its own: every [`poll`](ParcelLoader::poll) hands bytes that have come from the reader to the one that
    /// unpacks, which works for `slice`, and one cluster longer at most. The reader must complete reads meanwhile without being waited
    /// for (see [`task_reader`](crate::read::task_reader)).
    pub fn without_threads(
        asset: Arc<Asset>,
        reader: Box<dyn QueuedReader>,
        options: &ClusterLoaderOptions,
        slice: Duration,
    ) -> Self {
        let mut loader = Self::idle(asset, &*reader, options);
        let shared = &loader.shared;
        let scheduler = Scheduler::new(Arc::clone(shared), reader, FileOrder::new(&shared.asset));
        let worker = Worker::new(Arc::clone(shared));
        loader.own_steps = Some(OwnSteps { scheduler, worker, slice });
        loader
    }

    /// Nobody works for it yet.
    fn idle(asset: Arc<Asset>, reader: &dyn QueuedReader, options: &ClusterLoaderOptions) -> Self {
        let info = reader.info();
        let patience =
            if info.kind == ReaderKind::Http { RetryPolicy::NETWORK } else { RetryPolicy::default() };
        let retry = options.retry.unwrap_or(patience);
        let stored_formats = asset.channels().iter().map(|channel| channel.format);
        let formats =
            stored_formats.map(|format| AtlasFormat::of(format, options.block_compressed)).collect();
        let shared = Arc::new(Shared {
            formats,
            options: options.clone(),
            board: SharedBoard::new(Board::new(options, retry)),
            inbox: Inbox::default(),
            scheduler: SchedulerWaker { waker: reader.waker(), pending: AtomicBool::new(false) },
            asset,
        });
        Self { shared, info, scheduler: None, workers: Vec::new(), own_steps: None, missed_polls: 0 }
    }

    /// The asset.
    pub fn asset(&self) -> &Arc<Asset> {
        &self.shared.asset
    }

    /// Formats of the texels, per channel of the asset.
    pub fn formats(&self) -> &[AtlasFormat] {
        &self.shared.formats
    }

    /// How it reads.
    pub fn reader_info(&self) -> ReaderInfo {
        self.info
    }

    /// What has been done so far, and what is going on.
    pub fn statistics(&self) -> LoaderStatistics {
        self.shared.statistics()
    }

    /// Access to the statistics after the loader has been moved into a streamer.
    pub fn monitor(&self) -> LoaderMonitor {
        LoaderMonitor { shared: Arc::clone(&self.shared) }
    }
}

/// Sees a [`ClusterLoader`]'s statistics, from any thread, also after its end.
#[derive(Clone, Debug)]
pub struct LoaderMonitor {
    shared: Arc<Shared>,
}

impl LoaderMonitor {
    /// As [`ClusterLoader::statistics`].
    pub fn statistics(&self) -> LoaderStatistics {
        self.shared.statistics()
    }
}

/// Streaming of an asset cannot begin.
fn set_up_error(asset: &Asset, what: &str, error: io::Error) -> Error {
    let is_missing = error.kind() == io::ErrorKind::NotFound;
    let kind = if is_missing { ErrorKind::NotFound } else { ErrorKind::Io };
    let message = format!("cannot {what}: {error}");
    Error::new(kind, message).with_path(asset.path()).with_source(error)
}

fn clusters_of(asset: &Asset, parcel: Parcel) -> Result<Vec<ClusterId>> {
    if let Parcel::Page(page) = parcel {
        return Ok(vec![asset.cluster_of(page)?]);
    }
    // Per level the first and the last page there; they ascend by group.
    let mut levels: Vec<[PageId; 2]> = Vec::new();
    for page in parcel.pages(asset.cover()) {
        match levels.iter_mut().find(|[first, _]| first.level == page.level) {
            Some([_, last]) => *last = page,
            None => levels.push([page; 2]),
        }
    }
    if levels.is_empty() {
        let page = PageId { group: u32::MAX, level: 0, page: [0, 0] };
        return Err(asset.no_such_page(0, page));
    }
    let mut clusters = Vec::new();
    for ends in levels {
        let [first, last] = [asset.cluster_of(ends[0])?, asset.cluster_of(ends[1])?];
        if last.index - first.index <= 1 {
            clusters.extend((first.index..=last.index).map(|index| ClusterId { index, ..first }));
        } else {
            // A large tile between them fills clusters of its own.
            for page in parcel.pages(asset.cover()).filter(|page| page.level == first.level) {
                clusters.push(asset.cluster_of(page)?);
            }
            clusters.dedup();
        }
    }
    Ok(clusters)
}

impl ParcelLoader for ClusterLoader {
    fn request(&mut self, parcel: Parcel, urgency: f32) {
        self.request_all(&[(parcel, urgency)]);
    }

    fn request_all(&mut self, parcels: &[(Parcel, f32)]) {
        let asset = &self.shared.asset;
        self.shared.tell(
            parcels
                .iter()
                .map(|&(parcel, urgency)| Message::Request(parcel, urgency, clusters_of(asset, parcel))),
        );
    }

    fn cancel(&mut self, parcel: Parcel) {
        self.cancel_all(&[parcel]);
    }

    fn cancel_all(&mut self, parcels: &[Parcel]) {
        // What no cluster holds has been refused, or will be.
        let clusters = |parcel| clusters_of(&self.shared.asset, parcel).unwrap_or_default();
        self.shared.tell(parcels.iter().map(|&parcel| Message::Cancel(parcel, clusters(parcel))));
    }

    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedParcel> {
        if let Some(OwnSteps { scheduler, worker, slice }) = &mut self.own_steps {
            let deadline = Instant::now() + *slice;
            scheduler.step();
            worker.run_until(deadline);
        }
        let board = if self.missed_polls == MAX_MISSED_POLLS {
            Some(self.shared.board.lock())
        } else if self.shared.inbox.is_long() {
            // The scheduler is about to take them over, or does so now.
            None
        } else {
            self.shared.board.try_lock()
        };
        let Some(mut board) = board else {
            self.missed_polls += 1;
            return Vec::new();
        };
        self.missed_polls = 0;
        let mut effects = self.shared.inbox.take_all(&mut board);
        let was_full = board.ready_is_full();
        let parcels = board.take_ready(max_bytes);
        effects.has_room |= was_full && !board.ready_is_full();
        drop(board);
        self.shared.notify(effects);
        parcels
    }

    fn pending(&self) -> usize {
        self.shared.statistics().pending
    }

    fn is_remote(&self) -> bool {
        self.info.kind == ReaderKind::Http
    }
}

impl Drop for ClusterLoader {
    fn drop(&mut self) {
        self.shared.board.close();
        self.shared.scheduler.waker.wake();
        // Threads that panicked have said so.
        for worker in self.workers.drain(..) {
            worker.join().unwrap_or_default();
        }
        if let Some(scheduler) = self.scheduler.take() {
            scheduler.join().unwrap_or_default();
        }
    }
}

// What a loader has done and is doing.

/// Counts since the loader was opened, then the present state. For tables and graphs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoaderStatistics {
    /// Reads made.
    pub reads: u64,
    /// Bytes read, with gaps between clusters and what alignment adds.
    pub bytes_read: u64,
    /// Clusters read.
    pub clusters_read: u64,
    /// Stored bytes of those.
    pub cluster_bytes: u64,
    /// Bytes of the pages of clusters that were unpacked, as they are stored without packing: block-compressed texels.
    pub unpacked_bytes: u64,
    /// Stored bytes of the parcels that were handed over: their shares of their clusters. With [`Self::bytes_read`] it tells how
    /// much was read in vain (less than nothing where the cache served parcels more than once).
    pub bytes_needed: u64,
    /// Clusters that were read and no longer wanted when they arrived.
    pub clusters_dropped: u64,
    /// Clusters that were read again after an error.
    pub retries: u64,
    /// Clusters that were given up.
    pub clusters_failed: u64,
    /// Parcels that arrived.
    pub parcels: u64,
    /// Their bytes in the atlas' formats.
    pub parcel_bytes: u64,
    /// Parcels that came from a cluster which was at hand.
    pub cache_hits: u64,
    /// Parcels that arrived as errors.
    pub parcels_failed: u64,
    /// Time from submission to completion, summed over reads.
    pub read_seconds: f64,
    /// Time of checksums, unpacking, decoding and assembling, summed over workers.
    pub unpack_seconds: f64,

    /// Clusters that wait to be read.
    pub queued_clusters: usize,
    /// Reads in flight.
    pub reads_in_flight: usize,
    /// The most reads there have been in flight.
    pub max_reads_in_flight: usize,
    /// Stored bytes that are being read or wait to be unpacked.
    pub in_flight_bytes: usize,
    /// Bytes of unpacked clusters that are kept.
    pub cache_bytes: usize,
    /// Bytes of clusters that are kept as they are stored.
    pub stored_cache_bytes: usize,
    /// Bytes of texels that wait to be taken.
    pub ready_bytes: usize,
    /// Parcels that were asked for and have not been handed over.
    pub pending: usize,
}

// The board as threads share it.

#[derive(Debug)]
struct SharedBoard {
    board: Mutex<Board>,
    /// For workers: there are jobs, or room for ready pages, or an end.
    work: Condvar,
}

impl SharedBoard {
    fn new(board: Board) -> Self {
        Self { board: Mutex::new(board), work: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, Board> {
        self.board.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// None where somebody else has it.
    fn try_lock(&self) -> Option<MutexGuard<'_, Board>> {
        match self.board.try_lock() {
            Ok(board) => Some(board),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    fn wait_for_order(&self) -> Order {
        let mut board = self.lock();
        loop {
            if let Some(order) = board.next_order() {
                return order;
            }
            board = self.work.wait(board).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn close(&self) {
        self.lock().is_closed = true;
        self.work.notify_all();
    }
}

// What the caller has asked for and the board does not know yet.
//
// The caller's thread draws pictures and must not wait. So it puts its messages here, under a lock that is held for no longer
// than it takes to move them, and the next holder of the board takes them over: usually the scheduler.

/// Messages that are taken over before others may have the board.
const CHUNK: usize = 256;

/// A caller's request or cancel, with the clusters that hold the parcel's pages.
#[derive(Debug)]
enum Message {
    /// It is wanted, so urgently.
    Request(Parcel, f32, Result<Vec<ClusterId>>),
    /// It is not wanted any more.
    Cancel(Parcel, Vec<ClusterId>),
}

/// Messages in the order in which they came.
#[derive(Debug, Default)]
struct Inbox {
    messages: Mutex<VecDeque<Message>>,
}

/// What there is to do when messages have been taken over.
#[derive(Clone, Copy, Debug, Default)]
struct Effects {
    /// There are clusters to read, or reads to give up.
    for_scheduler: bool,
    /// So many jobs have come.
    jobs: usize,
    has_room: bool,
    /// Messages are left.
    has_more: bool,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, VecDeque<Message>> {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether there are more messages than are taken over at a time.
    fn is_long(&self) -> bool {
        self.lock().len() > CHUNK
    }

    /// Takes over some messages. Whoever holds the board sees each either here or there.
    fn take_some(&self, board: &mut Board, effects: &mut Effects) {
        let mut inbox = self.lock();
        let count = inbox.len().min(CHUNK);
        let messages: Vec<Message> = inbox.drain(..count).collect();
        effects.has_more = !inbox.is_empty();
        drop(inbox);
        let was_full = board.ready_is_full();
        for message in messages {
            match message {
                Message::Request(parcel, urgency, Ok(clusters)) => {
                    board.request(parcel, &clusters, urgency, effects);
                }
                Message::Request(parcel, urgency, Err(error)) => board.refuse(parcel, urgency, error),
                Message::Cancel(parcel, clusters) => {
                    effects.for_scheduler |= board.cancel(parcel, &clusters);
                }
            }
        }
        effects.has_room |= was_full && !board.ready_is_full();
    }

    fn take_all(&self, board: &mut Board) -> Effects {
        let mut effects = Effects { has_more: true, ..Effects::default() };
        while effects.has_more {
            self.take_some(board, &mut effects);
        }
        effects
    }
}
