//! Queued reads: many at a time, from a file or a server, in the background.
//!
//! ```text
//!                  submit, cancel                    pull (a lane each: task or thread)
//!  owner of the reader ------------> RequestQueue <------------------------------ back end
//!                    <------------------------------------------------------------
//!                         wait: ReadCompletion, through a channel
//! ```
//!
//! Who owns what, on which thread:
//! - The owner of a [`QueuedReader`] submits, cancels and waits on one thread. Anybody may interrupt its wait by a
//!   [`ReadWaker`].
//! - A back end has *lanes*, as many as reads shall be in flight. A lane takes a request, reads it, reports, and takes the
//!   next. In `ring_reader` lanes are tasks on one thread that owns an io_uring (or a completion port); in
//!   `threaded_reader` they are threads. In [`task_reader`] they are tasks of whoever runs them, such as a web page.
//! - The bytes of a read lie in a [`ReadBuffer`], which may be sent to any thread; when dropped it goes back to the
//!   back end's [`BufferPool`] and is used again.
//!
//! `open_file_reader` chooses the back end by trying: a ring where the system has one, else threads; direct I/O where the
//! file system takes it, else buffered.

#[cfg(feature = "http")]
mod azure;
#[cfg(target_arch = "wasm32")]
mod browser;
mod buffer;
mod fetched;
#[cfg(not(target_arch = "wasm32"))]
mod file;
#[cfg(feature = "http")]
pub(crate) mod http;
#[cfg(feature = "http")]
mod keys;
#[cfg(feature = "http")]
pub(crate) mod object;
pub(crate) mod ranges;
#[cfg(feature = "http")]
mod s3;
mod task;

use std::collections::VecDeque;
use std::io;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, Waker};
use std::thread::JoinHandle;
use std::time::Duration;

#[cfg(not(target_arch = "wasm32"))]
use fantex_store::{Asset, ByteSource, FileSource};

#[cfg(target_arch = "wasm32")]
pub use browser::{BROWSER_CONNECTIONS, RemoteAccess, RemoteFile, spawn};
pub use buffer::{BufferPool, ReadBuffer};
#[cfg(not(target_arch = "wasm32"))]
pub use fetched::first_ranges;
pub use fetched::{Fetched, FetchedFile, open_fetched};
#[cfg(not(target_arch = "wasm32"))]
pub(crate) use file::{open_in_runtime, ring_runtime, takes_direct_io};
#[cfg(not(target_arch = "wasm32"))]
pub use file::{ring_reader, threaded_reader};
#[cfg(feature = "http")]
pub use http::{HttpSource, http_reader};
pub use ranges::{Answered, RangeAnswer, ended_early};
pub use task::{Task, task_reader};

/// A read to be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadRequest {
    /// Names the read; no two unfinished reads may have the same.
    pub token: u64,
    /// First byte.
    pub offset: u64,
    /// Number of bytes, at most [`MAX_READ_BYTES`].
    pub length: usize,
}

/// Maximum bytes of one read: more than the largest cluster.
pub const MAX_READ_BYTES: usize = 64 << 20;

/// A read that was made, or failed.
#[derive(Debug)]
pub struct ReadCompletion {
    /// As in its [`ReadRequest`].
    pub token: u64,
    /// Exactly the bytes that were asked for, or why there are none
    /// ([`UnexpectedEof`](io::ErrorKind::UnexpectedEof) where they lie beyond the end).
    pub result: io::Result<ReadBuffer>,
}

/// How a reader reads, for people and statistics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReaderInfo {
    /// What carries the reads.
    pub kind: ReaderKind,
    /// Whether reads bypass the system's page cache.
    pub direct: bool,
    /// Reads in flight at most.
    pub depth: usize,
}

/// What carries the reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReaderKind {
    /// Linux' io_uring.
    IoUring,
    /// Windows' completion ports.
    CompletionPort,
    /// Threads that read at positions.
    Threads,
    /// HTTP range requests.
    Http,
}

impl std::fmt::Display for ReaderInfo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = match self.kind {
            ReaderKind::IoUring => "io_uring",
            ReaderKind::CompletionPort => "completion port",
            ReaderKind::Threads => "threads",
            ReaderKind::Http => return write!(f, "HTTP, {} connections", self.depth),
        };
        let way = if self.direct { "direct" } else { "buffered" };
        write!(f, "{kind}, {way}, {} reads at a time", self.depth)
    }
}

/// Reads in the background. Dropping it gives up the reads that have not begun and waits for those that are in flight: those of a file, so
/// that it is closed. A server may take a minute to answer; its reads end by themselves.
pub trait QueuedReader: Send {
    /// Queues a read. It completes once, with bytes or an error, unless it is cancelled before it begins. Reads begin in the
    /// order of their submission.
    fn submit(&mut self, request: ReadRequest);

    /// Gives up a read that has not begun: true if it will never complete. False: it has begun or is done; its completion
    /// comes.
    fn cancel(&mut self, token: u64) -> bool;

    /// The next completion. Waits until `timeout` (forever without one), or until woken; `None` then.
    fn wait(&mut self, timeout: Option<Duration>) -> Option<ReadCompletion>;

    /// Interrupts [`QueuedReader::wait`], the current one or the next one.
    fn waker(&self) -> ReadWaker;

    /// How it reads.
    fn info(&self) -> ReaderInfo;
}

/// How to read a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileReadOptions {
    /// Reads in flight at most, 1 to 256. Beyond 32 a solid-state disk gains nothing but waiting.
    pub depth: usize,
    /// Bypass the system's page cache where that is possible: what was streamed once is kept in our own small caches.
    pub direct: bool,
    /// Use the system's completion queue where there is one.
    pub ring: bool,
}

impl Default for FileReadOptions {
    /// 32 reads, direct, with a ring.
    fn default() -> Self {
        Self { depth: 32, direct: true, ring: true }
    }
}

/// A reader of a file: of all ways that `options` allow the first that works here.
///
/// # Errors
/// The file cannot be opened, or the system refuses a thread.
#[cfg(not(target_arch = "wasm32"))]
pub fn open_file_reader(path: &Path, options: &FileReadOptions) -> io::Result<Box<dyn QueuedReader>> {
    let options = FileReadOptions { depth: options.depth.clamp(1, 256), ..*options };
    let direct = options.direct && takes_direct_io(path);
    if options.ring
        && let Ok(reader) = ring_reader(path, options.depth, direct)
    {
        return Ok(Box::new(reader));
    }
    Ok(Box::new(threaded_reader(path, options.depth, direct)?))
}

// Assets in files and on web servers.

/// The location as a URL, if it is one.
pub fn url_of(location: &Path) -> Option<&str> {
    let text = location.to_str()?;
    let scheme = text.split_once("://")?.0.to_ascii_lowercase();
    matches!(scheme.as_str(), "http" | "https" | "s3" | "gs" | "az").then_some(text)
}

/// Opens an asset at a path or at a URL: `http://` or `https://`, from any server that supports range requests, `s3://bucket/key`,
/// `gs://bucket/key` or `az://container/blob`.
///
/// # Errors
/// It cannot be read, is no asset, or is damaged; or it is at a URL, and this crate was built without the feature `http`.
#[cfg(not(target_arch = "wasm32"))]
pub fn open_asset(location: &Path) -> fantex_base::Result<Asset> {
    match url_of(location) {
        #[cfg(feature = "http")]
        Some(url) => Asset::open_source(Arc::new(HttpSource::new(url, 1))),
        #[cfg(not(feature = "http"))]
        Some(_) => Err(fantex_base::Error::reading(location, no_http())),
        None => Asset::open(location),
    }
}

/// Opens a file, or what lies at a URL, to read it whole, from front to back: long reads are made over several connections, and a server that has
/// answered once is waited for half a minute.
///
/// # Errors
/// The file cannot be opened, or the location is a URL, and this crate was built without the feature `http`. A server is not asked yet.
#[cfg(not(target_arch = "wasm32"))]
pub fn open_source(location: &Path) -> fantex_base::Result<Arc<dyn ByteSource>> {
    let failed = |source| fantex_base::Error::reading(location, source);
    match url_of(location) {
        #[cfg(feature = "http")]
        Some(url) => Ok(Arc::new(HttpSource::new(url, CONNECTIONS).patient())),
        #[cfg(not(feature = "http"))]
        Some(_) => Err(failed(no_http())),
        None => Ok(Arc::new(FileSource::open(location).map_err(failed)?)),
    }
}

/// Opens the preview of an asset at a path or URL, without reading more of the asset than it must; none where it has none.
///
/// # Errors
/// As [`open_asset`].
#[cfg(not(target_arch = "wasm32"))]
pub fn open_preview(location: &Path) -> fantex_base::Result<Option<Asset>> {
    match url_of(location) {
        #[cfg(feature = "http")]
        Some(url) => Asset::open_preview(&HttpSource::new(url, 1)),
        #[cfg(not(feature = "http"))]
        Some(_) => Err(fantex_base::Error::reading(location, no_http())),
        None => {
            let file = FileSource::open(location);
            Asset::open_preview(&file.map_err(|source| fantex_base::Error::reading(location, source))?)
        }
    }
}

/// Reads what lies at a path or URL whole, where it has at most `most` bytes.
///
/// # Errors
/// It cannot be read, is longer, or is at a URL, and this crate was built without the feature `http`.
#[cfg(not(target_arch = "wasm32"))]
pub fn read_whole(location: &Path, most: u64) -> fantex_base::Result<Vec<u8>> {
    let failed = |source| fantex_base::Error::reading(location, source);
    let check = |length: u64| if length > most { Err(too_long(location, length, most)) } else { Ok(length) };
    match url_of(location) {
        #[cfg(feature = "http")]
        Some(url) => {
            let source = HttpSource::new(url, 1);
            let length = check(source.length().map_err(failed)?)?;
            let mut bytes = vec![0; length as usize];
            source.read_exact_at(&mut bytes, 0).map_err(failed)?;
            Ok(bytes)
        }
        #[cfg(not(feature = "http"))]
        Some(_) => Err(failed(no_http())),
        None => {
            check(std::fs::metadata(location).map_err(failed)?.len())?;
            fantex_base::input::read(location)
        }
    }
}

/// The error of what has more bytes than it may.
fn too_long(location: &Path, length: u64, most: u64) -> fantex_base::Error {
    let location = location.display();
    fantex_base::Error::too_large(format!("{location} has {length} bytes, at most {most} were expected"))
}

/// A reader of an asset where it was opened: of its file, or of the version of a file on a web server that was opened.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn open_reader(asset: &Asset, options: &FileReadOptions) -> io::Result<Box<dyn QueuedReader>> {
    let location = asset.path();
    match url_of(location) {
        #[cfg(feature = "http")]
        Some(url) => {
            let version = asset.source().version();
            let source = Arc::new(HttpSource::new(url, CONNECTIONS).of_version(version));
            Ok(Box::new(http_reader(source, CONNECTIONS)?))
        }
        #[cfg(not(feature = "http"))]
        Some(_) => Err(no_http()),
        None => open_file_reader(location, options),
    }
}

/// Connections to a server.
#[cfg(feature = "http")]
const CONNECTIONS: usize = 6;

#[cfg(not(any(feature = "http", target_arch = "wasm32")))]
fn no_http() -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, "this program was built without the feature 'http'")
}

// Which errors pass, and how long to wait for that.

/// How often and how soon to try again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryPolicy {
    /// Attempts after the first.
    pub retries: u32,
    /// Pause before the first retry; doubled before each further one.
    pub first_pause: Duration,
}

impl Default for RetryPolicy {
    /// Three retries after 5, 10 and 20 ms: what a flaky cable or a busy disk needs.
    fn default() -> Self {
        Self { retries: 3, first_pause: Duration::from_millis(5) }
    }
}

impl RetryPolicy {
    /// For servers: three retries after 0.1, 0.2 and 0.4 s.
    pub const NETWORK: Self = Self { retries: 3, first_pause: Duration::from_millis(100) };

    /// For long work with a server that has answered before: seven retries within 25 s, as a router takes to start anew.
    #[cfg(feature = "http")]
    pub(crate) const PATIENT: Self = Self { retries: 7, first_pause: Duration::from_millis(200) };

    /// The pause before retry `attempt` (0 is the first).
    pub fn pause(&self, attempt: u32) -> Duration {
        self.first_pause * (1 << attempt.min(16))
    }

    /// Makes attempts until one succeeds, an error is not `worth` another, or there have been enough. `wait` passes the time between them.
    #[cfg(feature = "http")]
    pub(crate) fn run<T>(
        &self,
        mut attempt: impl FnMut() -> io::Result<T>,
        worth: impl Fn(&io::Error) -> bool,
        wait: impl Fn(Duration),
    ) -> io::Result<T> {
        for retry in 0..self.retries {
            match attempt() {
                Err(error) if worth(&error) => wait(self.pause(retry)),
                result => return result,
            }
        }
        attempt()
    }
}

/// Whether the same read may well succeed a moment later. Where there is no such file, no permission, no support, or too few
/// bytes, it will not.
pub fn is_transient(error: &io::Error) -> bool {
    use io::ErrorKind::{
        InvalidData, InvalidInput, NotFound, PermissionDenied, StorageFull, UnexpectedEof, Unsupported,
    };
    !matches!(
        error.kind(),
        InvalidData | InvalidInput | NotFound | PermissionDenied | StorageFull | UnexpectedEof | Unsupported
    )
}

// What the owner of a reader and its lanes share.

/// What comes through the channel to the owner.
#[derive(Debug)]
enum Event {
    Completed(ReadCompletion),
    Woken,
}

/// Interrupts a reader's wait, from any thread.
#[derive(Clone, Debug)]
pub struct ReadWaker(Sender<Event>);

impl ReadWaker {
    /// Interrupts. No effect on a reader that is gone.
    pub fn wake(&self) {
        self.0.send(Event::Woken).unwrap_or_default();
    }
}

#[derive(Debug, Default)]
struct Waiting {
    requests: VecDeque<ReadRequest>,
    /// Lanes that are tasks and have nothing to do, each once.
    idle_tasks: Vec<(usize, Waker)>,
    closed: bool,
}

/// The queue from the owner to the lanes.
#[derive(Debug, Default)]
struct RequestQueue {
    waiting: Mutex<Waiting>,
    arrived: Condvar,
}

impl RequestQueue {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next request, for a lane that is a thread; none after closing.
    fn next(&self) -> Option<ReadRequest> {
        let mut waiting = self.lock();
        loop {
            if waiting.closed {
                return None;
            }
            if let Some(request) = waiting.requests.pop_front() {
                return Some(request);
            }
            waiting = self.arrived.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The next request, for a lane that is a task and has this number; none after closing.
    fn next_async(&self, lane: usize) -> impl Future<Output = Option<ReadRequest>> + '_ {
        std::future::poll_fn(move |context| {
            let mut waiting = self.lock();
            waiting.idle_tasks.retain(|(idle, _)| *idle != lane);
            if waiting.closed {
                return Poll::Ready(None);
            }
            if let Some(request) = waiting.requests.pop_front() {
                return Poll::Ready(Some(request));
            }
            waiting.idle_tasks.push((lane, context.waker().clone()));
            Poll::Pending
        })
    }

    fn push(&self, request: ReadRequest) {
        let idle_task = {
            let mut waiting = self.lock();
            waiting.requests.push_back(request);
            waiting.idle_tasks.pop()
        };
        self.arrived.notify_one();
        if let Some((_, task)) = idle_task {
            task.wake();
        }
    }

    /// True if the request had not begun.
    fn remove(&self, token: u64) -> bool {
        let mut waiting = self.lock();
        let place = waiting.requests.iter().position(|request| request.token == token);
        place.and_then(|place| waiting.requests.remove(place)).is_some()
    }

    /// Lets all lanes end. Requests that have not begun are dropped.
    fn close(&self) {
        let idle_tasks = {
            let mut waiting = self.lock();
            waiting.closed = true;
            waiting.requests.clear();
            std::mem::take(&mut waiting.idle_tasks)
        };
        self.arrived.notify_all();
        idle_tasks.into_iter().for_each(|(_, task)| task.wake());
    }
}

#[derive(Clone, Debug)]
struct Reports(Sender<Event>);

impl Reports {
    /// Hands a completion to the owner, if there is one still.
    fn send(&self, completion: ReadCompletion) {
        self.0.send(Event::Completed(completion)).unwrap_or_default();
    }
}

/// A reader over lanes: a queue towards them, a channel back.
#[derive(Debug)]
pub struct LaneReader {
    queue: Arc<RequestQueue>,
    events: Receiver<Event>,
    sender: Sender<Event>,
    info: ReaderInfo,
    threads: Vec<JoinHandle<()>>,
}

impl LaneReader {
    fn new(info: ReaderInfo) -> Self {
        let (sender, events) = channel();
        Self { queue: Arc::default(), events, sender, info, threads: Vec::new() }
    }

    fn reports(&self) -> Reports {
        Reports(self.sender.clone())
    }
}

impl QueuedReader for LaneReader {
    fn submit(&mut self, request: ReadRequest) {
        self.queue.push(request);
    }

    fn cancel(&mut self, token: u64) -> bool {
        self.queue.remove(token)
    }

    fn wait(&mut self, timeout: Option<Duration>) -> Option<ReadCompletion> {
        let event = match timeout {
            // A disconnected channel cannot be: this end holds a sender.
            None => self.events.recv().ok(),
            // Never blocks, and so needs no clock. Who does not wait need not be woken.
            Some(Duration::ZERO) => self.events.try_iter().find(|event| matches!(event, Event::Completed(_))),
            Some(timeout) => self.events.recv_timeout(timeout).ok(),
        };
        match event {
            Some(Event::Completed(completion)) => Some(completion),
            Some(Event::Woken) | None => None,
        }
    }

    fn waker(&self) -> ReadWaker {
        ReadWaker(self.sender.clone())
    }

    fn info(&self) -> ReaderInfo {
        self.info
    }
}

impl Drop for LaneReader {
    fn drop(&mut self) {
        self.queue.close();
        // Whoever draws must not wait for a server.
        if self.info.kind == ReaderKind::Http {
            return;
        }
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so.
            thread.join().unwrap_or_default();
        }
    }
}
