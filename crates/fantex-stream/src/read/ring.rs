//! Reads through the system's completion queue: io_uring on Linux, completion ports on Windows (crate `compio`).
//!
//! One thread owns the queue; lanes are tasks on it, each with one read in flight. Buffers are aligned, and used again
//! instead of registered: the crate registers only rings of equal buffers that it allocates itself.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use compio::buf::{BufResult, IntoInner, IoBuf};
use compio::driver::{DriverType, ProactorBuilder};
use compio::fs::{File, OpenOptions};
use compio::io::AsyncReadAt;
use compio::runtime::{Runtime, RuntimeBuilder};

use super::buffer::{ALIGNMENT, BufferPool, ReadBuffer};
use super::direct_file::{DIRECT_FLAG, Span};
use super::queue::{OwnerEnd, ReadWaker, Reports, RequestQueue};
use super::threaded::KEPT_BUFFER_BYTES;
use super::{QueuedReader, ReadCompletion, ReadRequest, ReaderInfo, ReaderKind};

/// A reader whose lanes are tasks over one completion queue.
#[derive(Debug)]
pub struct RingReader {
    owner: OwnerEnd,
    info: ReaderInfo,
    thread: Option<JoinHandle<()>>,
}

impl RingReader {
    /// A reader of a file with `depth` reads in flight; [`Unsupported`](io::ErrorKind::Unsupported) where the system has no
    /// completion queue, or lets us have none.
    pub fn open(path: &Path, depth: usize, direct: bool) -> io::Result<Self> {
        let owner = OwnerEnd::new();
        let lanes = Lanes { queue: Arc::clone(&owner.queue), reports: owner.reports(), depth, direct };
        let (started, start) = channel();
        let path = path.to_owned();
        let thread = std::thread::Builder::new().name("fan-ring".into());
        let thread = thread.spawn(move || lanes.run(path, &started))?;
        let mut reader = Self {
            owner,
            info: ReaderInfo { kind: ReaderKind::IoUring, direct, depth },
            thread: Some(thread),
        };
        // A thread that ends without a word has panicked.
        reader.info.kind = start.recv().unwrap_or_else(|_| Err(io::ErrorKind::Unsupported.into()))?;
        Ok(reader)
    }
}

impl QueuedReader for RingReader {
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

impl Drop for RingReader {
    fn drop(&mut self) {
        self.owner.queue.close();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so.
            thread.join().unwrap_or_default();
        }
    }
}

/// A runtime over a completion queue of so many entries, and what kind it is.
pub(crate) fn ring_runtime(depth: usize) -> io::Result<(Runtime, ReaderKind)> {
    let mut proactor = ProactorBuilder::new();
    proactor.capacity(depth.next_power_of_two().max(8) as u32);
    let runtime = RuntimeBuilder::new().with_proactor(proactor).build()?;
    match runtime.driver_type() {
        DriverType::IoUring => Ok((runtime, ReaderKind::IoUring)),
        DriverType::IOCP => Ok((runtime, ReaderKind::CompletionPort)),
        DriverType::Poll => Err(io::ErrorKind::Unsupported.into()),
    }
}

/// Opens a file on the current runtime.
pub(crate) async fn open_in_runtime(path: &Path, direct: bool) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    if let (true, Some(flag)) = (direct, DIRECT_FLAG) {
        options.custom_flags(flag);
    }
    options.open(path).await
}

/// What the thread of the queue works with.
struct Lanes {
    queue: Arc<RequestQueue>,
    reports: Reports,
    depth: usize,
    direct: bool,
}

/// The file, opened once or twice.
struct Files {
    direct: Option<File>,
    buffered: File,
}

impl Lanes {
    /// The thread: says whether it started, then works until the queue is closed.
    fn run(self, path: PathBuf, started: &Sender<io::Result<ReaderKind>>) {
        let (runtime, kind) = match ring_runtime(self.depth) {
            Ok(runtime) => runtime,
            Err(error) => return started.send(Err(error)).unwrap_or_default(),
        };
        runtime.block_on(async move {
            let files = match self.open_files(&path).await {
                Ok(files) => std::rc::Rc::new(files),
                Err(error) => return started.send(Err(error)).unwrap_or_default(),
            };
            started.send(Ok(kind)).unwrap_or_default();
            let pool = BufferPool::new(KEPT_BUFFER_BYTES);
            let lanes: Vec<_> = (0..self.depth)
                .map(|lane| {
                    let (queue, reports) = (Arc::clone(&self.queue), self.reports.clone());
                    let (files, pool) = (std::rc::Rc::clone(&files), Arc::clone(&pool));
                    compio::runtime::spawn(async move {
                        while let Some(request) = queue.next_async(lane).await {
                            let result = files.read(&request, &pool).await;
                            reports.send(ReadCompletion { token: request.token, result });
                        }
                    })
                })
                .collect();
            for lane in lanes {
                // A lane that panicked has said so.
                lane.await.unwrap_or_default();
            }
        });
    }

    async fn open_files(&self, path: &Path) -> io::Result<Files> {
        let buffered = open_in_runtime(path, false).await?;
        let direct = if self.direct { Some(open_in_runtime(path, true).await?) } else { None };
        Ok(Files { direct, buffered })
    }
}

impl Files {
    async fn read(&self, request: &ReadRequest, pool: &Arc<BufferPool>) -> io::Result<ReadBuffer> {
        if let Some(file) = &self.direct {
            match read_span(file, request, true, pool).await {
                // Refused after all.
                Err(error) if error.kind() == io::ErrorKind::InvalidInput => {}
                result => return result,
            }
        }
        read_span(&self.buffered, request, false, pool).await
    }
}

/// Reads what was asked for, and for direct I/O what is around it.
async fn read_span(
    file: &File,
    request: &ReadRequest,
    direct: bool,
    pool: &Arc<BufferPool>,
) -> io::Result<ReadBuffer> {
    let Span { offset, length, part } = Span::new(request, direct)?;
    let mut memory = pool.take(length);
    let start = memory.start;
    let mut filled = 0;
    let result = loop {
        if filled >= part.end {
            break Ok(());
        }
        // After a direct read that ends elsewhere than asked for, the file has ended.
        if direct && !filled.is_multiple_of(ALIGNMENT) {
            break Err(io::ErrorKind::UnexpectedEof.into());
        }
        let slice = std::mem::take(&mut memory.bytes).slice(start + filled..start + length);
        let BufResult(count, slice) = file.read_at(slice, offset + filled as u64).await;
        memory.bytes = slice.into_inner();
        match count {
            Ok(0) => break Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => filled += count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => break Err(error),
        }
    };
    let buffer = ReadBuffer::new(memory, part, Arc::clone(pool));
    result.map(|()| buffer)
}
