//! Reads from files: through the system's completion queue (io_uring on Linux, completion ports on Windows, by the crate `compio`), or
//! by threads that each block in their read. Both read directly, past the system's page cache, where the file system takes that.

use std::fs;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};

use compio::buf::{BufResult, IntoInner, IoBuf};
use compio::driver::{DriverType, ProactorBuilder};
use compio::fs::{File as RingFile, OpenOptions as RingOpenOptions};
use compio::io::AsyncReadAt;
use compio::runtime::{Runtime, RuntimeBuilder};
use fantex_store::{ByteSource, FileSource};

use super::buffer::ALIGNMENT;
use super::{
    BufferPool, LaneReader, MAX_READ_BYTES, ReadBuffer, ReadCompletion, ReadRequest, ReaderInfo, ReaderKind,
    Reports, RequestQueue,
};

/// Idle buffers kept for the next reads.
const KEPT_BUFFER_BYTES: usize = 16 << 20;

// Direct I/O: where it works, and which bytes it has to read.

/// The flag with which a file is opened for direct reads, if the system has one that suits.
#[cfg(target_os = "linux")]
const DIRECT_FLAG: Option<i32> = Some(libc::O_DIRECT);
/// `FILE_FLAG_NO_BUFFERING`.
#[cfg(windows)]
const DIRECT_FLAG: Option<u32> = Some(0x2000_0000);
/// Elsewhere reads go through the page cache.
#[cfg(not(any(target_os = "linux", windows)))]
const DIRECT_FLAG: Option<i32> = None;

/// Opens a file for reading, by direct I/O where asked for.
fn open_file(path: &Path, direct: bool) -> io::Result<fs::File> {
    let mut options = fs::OpenOptions::new();
    options.read(true);
    if let (true, Some(flag)) = (direct, DIRECT_FLAG) {
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, flag);
        #[cfg(windows)]
        std::os::windows::fs::OpenOptionsExt::custom_flags(&mut options, flag);
    }
    options.open(path)
}

/// Whether a file can be read by direct I/O: tries it. (Some file systems refuse to open, some only to read.)
pub(crate) fn takes_direct_io(path: &Path) -> bool {
    if DIRECT_FLAG.is_none() {
        return false;
    }
    let Ok(file) = open_file(path, true) else { return false };
    let mut memory = BufferPool::new(0).take(ALIGNMENT);
    let start = memory.start;
    let source = FileSource::unmarked(path, Arc::new(file));
    source.read_at(&mut memory.bytes[start..start + ALIGNMENT], 0).is_ok()
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Span {
    /// First byte in the file.
    offset: u64,
    length: usize,
    /// The bytes that were asked for, relative to the first.
    part: Range<usize>,
}

impl Span {
    /// The smallest span that holds a request and, for direct I/O, begins and ends at multiples of [`ALIGNMENT`].
    fn new(request: &ReadRequest, direct: bool) -> io::Result<Self> {
        let &ReadRequest { offset, length, .. } = request;
        if length > MAX_READ_BYTES {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        if !direct {
            return Ok(Self { offset, length, part: 0..length });
        }
        let before = (offset % ALIGNMENT as u64) as usize;
        Ok(Self {
            offset: offset - before as u64,
            length: (before + length).next_multiple_of(ALIGNMENT),
            part: before..before + length,
        })
    }
}

// Threads: one per lane.

/// A reader of a file whose lanes are `depth` threads. As [`ring_reader`], it does not keep writers from what they may overwrite: that does an
/// [`Asset`](fantex_store::Asset) that is open.
///
/// # Errors
/// If the file cannot be opened (for direct I/O, where asked for), or the system refuses a thread.
pub fn threaded_reader(path: &Path, depth: usize, direct: bool) -> io::Result<LaneReader> {
    let open = |direct| Ok::<_, io::Error>(FileSource::unmarked(path, Arc::new(open_file(path, direct)?)));
    let buffered = open(false)?;
    let direct_source = if direct { Some(open(true)?) } else { None };
    let info = ReaderInfo { kind: ReaderKind::Threads, direct, depth };
    start_threads(info, "fan-read", move |request, pool| {
        if let Some(source) = &direct_source {
            match read_blocking(source, request, true, pool) {
                // Refused after all.
                Err(error) if error.kind() == io::ErrorKind::InvalidInput => {}
                result => return result,
            }
        }
        read_blocking(&buffered, request, false, pool)
    })
}

/// A reader with `info.depth` threads that call `read`.
pub(super) fn start_threads(
    info: ReaderInfo,
    name: &str,
    read: impl Fn(&ReadRequest, &Arc<BufferPool>) -> io::Result<ReadBuffer> + Send + Sync + 'static,
) -> io::Result<LaneReader> {
    let read = Arc::new(read);
    let pool = BufferPool::new(KEPT_BUFFER_BYTES);
    let mut reader = LaneReader::new(info);
    for lane in 0..info.depth {
        let (queue, reports) = (Arc::clone(&reader.queue), reader.reports());
        let (read, pool) = (Arc::clone(&read), Arc::clone(&pool));
        let thread = std::thread::Builder::new().name(format!("{name}-{lane}")).stack_size(256 << 10);
        reader.threads.push(thread.spawn(move || {
            while let Some(request) = queue.next() {
                let result = read(&request, &pool);
                reports.send(ReadCompletion { token: request.token, result });
            }
        })?);
    }
    Ok(reader)
}

/// Reads what was asked for, and for direct I/O what is around it.
fn read_blocking(
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

// The completion queue: one thread owns it; lanes are tasks on it, each with one read in flight. Buffers are aligned and used again
// instead of registered: the crate registers only rings of equal buffers that it allocates itself.

/// A reader of a file with `depth` tasks over one completion queue.
///
/// # Errors
/// [`Unsupported`](io::ErrorKind::Unsupported) where the system has no completion queue, or lets us have none; if the file cannot be
/// opened.
pub fn ring_reader(path: &Path, depth: usize, direct: bool) -> io::Result<LaneReader> {
    let mut reader = LaneReader::new(ReaderInfo { kind: ReaderKind::IoUring, direct, depth });
    let lanes = Lanes { queue: Arc::clone(&reader.queue), reports: reader.reports(), depth, direct };
    let (started, start) = channel();
    let path = path.to_owned();
    let thread = std::thread::Builder::new().name("fan-ring".into());
    reader.threads.push(thread.spawn(move || lanes.run(path, &started))?);
    // A thread that ends without a word has panicked.
    reader.info.kind = start.recv().unwrap_or_else(|_| Err(io::ErrorKind::Unsupported.into()))?;
    Ok(reader)
}

/// A runtime over a completion queue of `depth` entries, and its kind.
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

pub(crate) async fn open_in_runtime(path: &Path, direct: bool) -> io::Result<RingFile> {
    let mut options = RingOpenOptions::new();
    options.read(true);
    if let (true, Some(flag)) = (direct, DIRECT_FLAG) {
        options.custom_flags(flag);
    }
    options.open(path).await
}

struct Lanes {
    queue: Arc<RequestQueue>,
    reports: Reports,
    depth: usize,
    direct: bool,
}

/// The file, opened once or twice.
struct Files {
    direct: Option<RingFile>,
    buffered: RingFile,
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
                Ok(files) => Rc::new(files),
                Err(error) => return started.send(Err(error)).unwrap_or_default(),
            };
            started.send(Ok(kind)).unwrap_or_default();
            let pool = BufferPool::new(KEPT_BUFFER_BYTES);
            let lanes: Vec<_> = (0..self.depth)
                .map(|lane| {
                    let (queue, reports) = (Arc::clone(&self.queue), self.reports.clone());
                    let (files, pool) = (Rc::clone(&files), Arc::clone(&pool));
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
            match read_on_ring(file, request, true, pool).await {
                // Refused after all.
                Err(error) if error.kind() == io::ErrorKind::InvalidInput => {}
                result => return result,
            }
        }
        read_on_ring(&self.buffered, request, false, pool).await
    }
}

/// Reads what was asked for, and for direct I/O what is around it.
async fn read_on_ring(
    file: &RingFile,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_hold_what_was_asked_for_and_are_aligned() {
        let request = |offset, length| ReadRequest { token: 0, offset, length };
        let span = Span::new(&request(5000, 4000), true).unwrap();
        assert_eq!(span, Span { offset: 4096, length: 8192, part: 904..4904 });
        let span = Span::new(&request(8192, 4096), true).unwrap();
        assert_eq!(span, Span { offset: 8192, length: 4096, part: 0..4096 });
        let span = Span::new(&request(5, 7), false).unwrap();
        assert_eq!(span, Span { offset: 5, length: 7, part: 0..7 });
        assert!(Span::new(&request(0, MAX_READ_BYTES + 1), true).is_err());
    }
}
