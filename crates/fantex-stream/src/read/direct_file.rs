//! Direct I/O: where it works, and which bytes it has to read.

use std::fs::{File, OpenOptions};
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use fantex_store::{ByteSource, FileSource};

use super::buffer::{ALIGNMENT, BufferPool};
use super::{MAX_READ_BYTES, ReadRequest};

/// The flag with which a file is opened for direct reads, if the system has one that suits.
#[cfg(target_os = "linux")]
pub(super) const DIRECT_FLAG: Option<i32> = Some(libc::O_DIRECT);
/// `FILE_FLAG_NO_BUFFERING`.
#[cfg(windows)]
pub(super) const DIRECT_FLAG: Option<u32> = Some(0x2000_0000);
/// Elsewhere reads go through the page cache.
#[cfg(not(any(target_os = "linux", windows)))]
pub(super) const DIRECT_FLAG: Option<i32> = None;

/// Opens a file for reading, by direct I/O where asked for.
pub(super) fn open(path: &Path, direct: bool) -> io::Result<File> {
    let mut options = OpenOptions::new();
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
pub(super) fn takes_direct_io(path: &Path) -> bool {
    if DIRECT_FLAG.is_none() {
        return false;
    }
    let Ok(file) = open(path, true) else { return false };
    let mut memory = BufferPool::new(0).take(ALIGNMENT);
    let start = memory.start;
    let source = FileSource::from_file(path, Arc::new(file));
    source.read_at(&mut memory.bytes[start..start + ALIGNMENT], 0).is_ok()
}

/// What to read for a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Span {
    /// First byte in the file.
    pub(super) offset: u64,
    /// Number of bytes.
    pub(super) length: usize,
    /// The bytes that were asked for, relative to the first.
    pub(super) part: Range<usize>,
}

impl Span {
    /// The smallest span that holds a request and, for direct I/O, begins and ends at multiples of [`ALIGNMENT`].
    pub(super) fn new(request: &ReadRequest, direct: bool) -> io::Result<Self> {
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
