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
        Self::unmarked(path, file)
    }

    /// As [`from_file`](Self::from_file), but nobody sees that it is read: for who keeps an [`Asset`](crate::Asset) open beside it. With a mark of its own no
    /// writer, not even the one that knows all assets of its process, would find the file unread.
    pub fn unmarked(path: &Path, file: Arc<File>) -> Self {
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

/// A local file that is open only while it is read: of thousands, as many parts of a bake, systems hold too few open at a time.
#[derive(Clone, Debug)]
pub struct PathSource(PathBuf);

impl PathSource {
    /// The file at a path. Nothing is opened yet.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self(path.into())
    }

    fn opened(&self) -> io::Result<FileSource> {
        Ok(FileSource::unmarked(&self.0, Arc::new(fantex_base::input::open(&self.0)?)))
    }
}

impl ByteSource for PathSource {
    fn location(&self) -> &Path {
        &self.0
    }

    fn length(&self) -> io::Result<u64> {
        self.opened()?.length()
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        self.opened()?.read_at(bytes, offset)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_at_a_path_is_read_as_it_is_then() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.part");
        let source = PathSource::new(&path);
        assert_eq!(source.location(), path);
        let kind = |result: io::Result<u64>| result.unwrap_err().kind();
        assert_eq!(kind(source.length()), io::ErrorKind::NotFound);
        std::fs::write(&path, b"0123456789").unwrap();
        assert_eq!(source.length().unwrap(), 10);
        let mut bytes = [0; 4];
        source.read_exact_at(&mut bytes, 3).unwrap();
        assert_eq!(&bytes, b"3456");
        assert_eq!(source.read_at(&mut bytes, 8).unwrap(), 2);
        // It is open no longer, so that it can go on every system.
        std::fs::remove_file(&path).unwrap();
        assert_eq!(kind(source.read_at(&mut bytes, 0).map(|count| count as u64)), io::ErrorKind::NotFound);
    }
}
