//! Where an asset's bytes come from: positional reads, without a cursor that threads would share.

use std::io;
use std::path::Path;

/// Bytes that can be read at any place: a file, or something far away. Shared by threads: reads are positional.
pub trait ByteSource: std::fmt::Debug + Send + Sync {
    /// Path or URL, for messages.
    fn location(&self) -> &Path;

    /// Number of bytes there are. (A remote source knows it without asking once it has read anything.)
    fn length(&self) -> io::Result<u64>;

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
