//! Reads by threads: one per lane, each blocking in its read.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use fantex_store::{ByteSource, FileSource};

use super::buffer::{BufferPool, ReadBuffer};
use super::direct_file::{self, Span};
use super::queue::{OwnerEnd, ReadWaker};
use super::{QueuedReader, ReadCompletion, ReadRequest, ReaderInfo, ReaderKind};

/// Idle buffers kept for the next reads.
pub(super) const KEPT_BUFFER_BYTES: usize = 16 << 20;

/// What a lane does with a request.
type Read = dyn Fn(&ReadRequest, &Arc<BufferPool>) -> io::Result<ReadBuffer> + Send + Sync;

/// A reader whose lanes are threads.
#[derive(Debug)]
pub struct ThreadedReader {
    owner: OwnerEnd,
    info: ReaderInfo,
    lanes: Vec<JoinHandle<()>>,
}

impl ThreadedReader {
    /// A reader of a file with `depth` threads.
    pub fn open(path: &Path, depth: usize, direct: bool) -> io::Result<Self> {
        let buffered = FileSource::from_file(path, Arc::new(direct_file::open(path, false)?));
        let direct_source = match direct {
            true => Some(FileSource::from_file(path, Arc::new(direct_file::open(path, true)?))),
            false => None,
        };
        let info = ReaderInfo { kind: ReaderKind::Threads, direct, depth };
        Self::start(info, "fan-read", move |request, pool| match &direct_source {
            Some(source) => match read_span(source, request, true, pool) {
                // Refused after all.
                Err(error) if error.kind() == io::ErrorKind::InvalidInput => {
                    read_span(&buffered, request, false, pool)
                }
                result => result,
            },
            None => read_span(&buffered, request, false, pool),
        })
    }

    /// Starts `info.depth` lanes that do the given.
    pub(super) fn start(
        info: ReaderInfo,
        name: &str,
        read: impl Fn(&ReadRequest, &Arc<BufferPool>) -> io::Result<ReadBuffer> + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let read: Arc<Read> = Arc::new(read);
        let pool = BufferPool::new(KEPT_BUFFER_BYTES);
        let mut reader = Self { owner: OwnerEnd::new(), info, lanes: Vec::new() };
        for lane in 0..info.depth {
            let (queue, reports) = (Arc::clone(&reader.owner.queue), reader.owner.reports());
            let (read, pool) = (Arc::clone(&read), Arc::clone(&pool));
            let thread = std::thread::Builder::new().name(format!("{name}-{lane}")).stack_size(256 << 10);
            reader.lanes.push(thread.spawn(move || {
                while let Some(request) = queue.next() {
                    let result = read(&request, &pool);
                    reports.send(ReadCompletion { token: request.token, result });
                }
            })?);
        }
        Ok(reader)
    }
}

/// Reads what was asked for, and for direct I/O what is around it.
fn read_span(
    source: &dyn ByteSource,
    request: &ReadRequest,
    direct: bool,
    pool: &Arc<BufferPool>,
) -> io::Result<ReadBuffer> {
    let Span { offset, length, part } = Span::new(request, direct)?;
    let mut memory = pool.take(length);
    let start = memory.start;
    let count = source.read_at(&mut memory.bytes[start..start + length], offset);
    let buffer = ReadBuffer::new(memory, part.clone(), Arc::clone(pool));
    if count? < part.end { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(buffer) }
}

impl QueuedReader for ThreadedReader {
    fn submit(&mut self, request: ReadRequest) {
        self.owner.queue.push(request);
    }

    fn cancel(&mut self, token: u64) -> bool {
        self.owner.queue.remove(token)
    }

    fn wait(&mut self, timeout: Option<Duration>) -> Option<ReadCompletion> {
        self.owner.wait(timeout)
    }

    fn waker(&self) -> ReadWaker {
        self.owner.waker()
    }

    fn info(&self) -> ReaderInfo {
        self.info
    }
}

impl Drop for ThreadedReader {
    fn drop(&mut self) {
        self.owner.queue.close();
        for lane in self.lanes.drain(..) {
            // A lane that panicked has said so.
            lane.join().unwrap_or_default();
        }
    }
}
