//! Assets in local files: positional reads and writes.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::ByteSource;
use crate::edit::lock::keep_generation;

/// A local file.
#[derive(Debug)]
pub struct FileSource {
    path: PathBuf,
    file: Arc<File>,
}

impl FileSource {
    /// Opens a file for reading.
    ///
    /// # Errors
    /// The system's, or it is no regular file.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self::from_file(path, Arc::new(fantex_base::input::open(path)?)))
    }

    /// A file that has been opened for reading; `path` is for messages. From now on nobody overwrites what the asset in it
    /// names.
    pub fn from_file(path: &Path, file: Arc<File>) -> Self {
        keep_generation(&file);
        Self { path: path.to_owned(), file }
    }
}

impl ByteSource for FileSource {
    fn location(&self) -> &Path {
        &self.path
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        let mut filled = 0;
        while filled < bytes.len() {
            match read_some_at(&self.file, &mut bytes[filled..], offset + filled as u64) {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(filled)
    }
}

#[cfg(unix)]
fn read_some_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_some_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, bytes, offset)
}

/// Reads as many bytes as there is room for, from an offset on.
///
/// # Errors
/// The system's; of kind [`UnexpectedEof`](io::ErrorKind::UnexpectedEof) where the file ends before.
#[cfg(unix)]
pub fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Writes all bytes at an offset; the file grows as needed.
///
/// # Errors
/// The system's.
#[cfg(unix)]
pub fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

/// Reads as many bytes as there is room for, from an offset on.
///
/// # Errors
/// The system's; of kind [`UnexpectedEof`](io::ErrorKind::UnexpectedEof) where the file ends before.
#[cfg(windows)]
pub fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            count => {
                bytes = &mut bytes[count..];
                offset += count as u64;
            }
        }
    }
    Ok(())
}

/// Writes all bytes at an offset; the file grows as needed.
///
/// # Errors
/// The system's.
#[cfg(windows)]
pub fn write_all_at(file: &File, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            count => {
                bytes = &bytes[count..];
                offset += count as u64;
            }
        }
    }
    Ok(())
}
