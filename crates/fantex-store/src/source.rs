//! Where an asset's bytes come from: positional reads, without a cursor that threads would share.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes that can be read at any place: a file, or something far away. Shared by threads: reads are positional.
pub trait ByteSource: std::fmt::Debug + Send + Sync {
    /// Path or URL, for messages.
    fn location(&self) -> &Path;

    /// Number of bytes there are. (A remote source knows it without asking once it has read anything.)
    fn length(&self) -> io::Result<u64>;

    /// What tells the version that is read from others: a tag or a date, where a server tells one and has been asked for something.
    fn version(&self) -> Option<&str> {
        None
    }

    /// Reads the bytes from `offset` on and returns how many there were: fewer than asked for only at the end.
    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize>;

    /// Fills `bytes` with those from `offset` on; [`UnexpectedEof`](io::ErrorKind::UnexpectedEof) where there are fewer.
    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        match self.read_at(bytes, offset)? {
            count if count == bytes.len() => Ok(()),
            _ => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }
}

/// Bytes in memory.
#[derive(Clone)]
pub struct BytesSource {
    location: PathBuf,
    bytes: Arc<[u8]>,
}

impl BytesSource {
    /// `location` names them in messages.
    pub fn new(location: impl Into<PathBuf>, bytes: impl Into<Arc<[u8]>>) -> Self {
        Self { location: location.into(), bytes: bytes.into() }
    }

    /// All of them.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl std::fmt::Debug for BytesSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bytes of {}", self.bytes.len(), self.location.display())
    }
}

impl ByteSource for BytesSource {
    fn location(&self) -> &Path {
        &self.location
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.bytes.len() as u64)
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let start = usize::try_from(offset).unwrap_or(usize::MAX).min(self.bytes.len());
        let count = bytes.len().min(self.bytes.len() - start);
        bytes[..count].copy_from_slice(&self.bytes[start..start + count]);
        Ok(count)
    }
}
