//! Where an editor writes: the file, or, in tests, something that fails on purpose.

use std::fs::File;
use std::io;
use std::sync::Arc;

use crate::positional::write_all_at;

/// Positional writes, made durable on demand. Writes between two calls of `sync` may reach the disk in any order, in part
/// or not at all.
pub(crate) trait Output: Send + Sync + std::fmt::Debug {
    /// Writes all bytes at an offset; the file grows as needed.
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()>;
    /// Cuts or extends the file.
    fn set_len(&mut self, length: u64) -> io::Result<()>;
    /// Makes everything written so far durable.
    fn sync(&mut self) -> io::Result<()>;
}

/// The file itself.
#[derive(Debug)]
pub(super) struct FileOutput(pub(super) Arc<File>);

impl Output for FileOutput {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        write_all_at(&self.0, bytes, offset)
    }

    fn set_len(&mut self, length: u64) -> io::Result<()> {
        self.0.set_len(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.0.sync_all()
    }
}
