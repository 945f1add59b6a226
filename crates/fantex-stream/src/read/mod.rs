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
//!   next. In [`RingReader`] lanes are tasks on one thread that owns an io_uring (or a completion port); in
//!   [`ThreadedReader`] they are threads.
//! - The bytes of a read lie in a [`ReadBuffer`], which whoever holds it may send anywhere; when dropped it goes back to the
//!   back end's [`BufferPool`] and is used again.
//!
//! [`open_file_reader`] chooses the back end by trying: a ring where the system has one, else threads; direct I/O where the
//! file system takes it, else buffered. [`FaultyReader`] makes any reader slow or unreliable, for tests and simulations.

mod buffer;
mod direct_file;
mod faulty;
mod http;
mod queue;
pub(crate) mod random;
mod retry;
mod ring;
mod threaded;

use std::io;
use std::path::Path;
use std::time::Duration;

pub use buffer::{BufferPool, ReadBuffer};
pub use faulty::{FaultyReader, ReadFaults};
pub use http::{HttpSource, http_reader};
pub use queue::ReadWaker;
pub use retry::{RetryPolicy, is_transient};
pub use ring::RingReader;
pub use threaded::ThreadedReader;

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

/// Most bytes of one read: a cluster, the largest there is, and some.
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

/// Reads in the background. Dropping it waits for the reads that are in flight and gives up the others.
pub trait QueuedReader: Send {
    /// Queues a read. It completes once, with bytes or an error, unless it is cancelled before it begins. Reads begin in the
    /// order of their submission.
    fn submit(&mut self, request: ReadRequest);

    /// Gives up a read that has not begun: true if it will never complete. False: it has begun or is done; its completion
    /// comes.
    fn cancel(&mut self, token: u64) -> bool;

    /// The next completion. Waits for it at most so long (without a limit where none is given), or until somebody wakes;
    /// none then.
    fn wait(&mut self, timeout: Option<Duration>) -> Option<ReadCompletion>;

    /// Interrupts [`QueuedReader::wait`], the current one or the next one.
    fn waker(&self) -> ReadWaker;

    /// How it reads.
    fn info(&self) -> ReaderInfo;
}

impl QueuedReader for Box<dyn QueuedReader> {
    fn submit(&mut self, request: ReadRequest) {
        (**self).submit(request);
    }

    fn cancel(&mut self, token: u64) -> bool {
        (**self).cancel(token)
    }

    fn wait(&mut self, timeout: Option<Duration>) -> Option<ReadCompletion> {
        (**self).wait(timeout)
    }

    fn waker(&self) -> ReadWaker {
        (**self).waker()
    }

    fn info(&self) -> ReaderInfo {
        (**self).info()
    }
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
pub fn open_file_reader(path: &Path, options: &FileReadOptions) -> io::Result<Box<dyn QueuedReader>> {
    let options = FileReadOptions { depth: options.depth.clamp(1, 256), ..*options };
    let direct = options.direct && direct_file::takes_direct_io(path);
    if options.ring
        && let Ok(reader) = RingReader::open(path, options.depth, direct)
    {
        return Ok(Box::new(reader));
    }
    Ok(Box::new(ThreadedReader::open(path, options.depth, direct)?))
}
