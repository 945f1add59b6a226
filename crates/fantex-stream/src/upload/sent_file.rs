//! The file that is sent, and what the threads that send it share.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::SystemTime;

use fantex_base::{Error, Result};

use super::request::Content;

/// A run of a file's bytes.
pub(super) struct Section<'a, R> {
    file: R,
    start: u64,
    length: u64,
    /// Bytes that are not sent yet.
    left: u64,
    upload: &'a Upload<'a>,
}

impl<R: Read + Seek> Content for Section<'_, R> {
    fn begin(&mut self) -> io::Result<Option<(u64, &mut dyn Read)>> {
        // What was sent in vain.
        self.upload.sent.fetch_sub(self.length - self.left, Relaxed);
        self.file.seek(SeekFrom::Start(self.start))?;
        self.left = self.length;
        Ok(Some((self.length, self)))
    }
}

impl<R: Read> Read for Section<'_, R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.upload.is_ended() {
            return Err(io::Error::other("the upload was ended"));
        }
        let most = bytes.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let count = self.file.read(&mut bytes[..most])?;
        if count == 0 && self.left > 0 {
            let message = "the file became shorter while it was sent";
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        self.left -= count as u64;
        self.upload.sent.fetch_add(count as u64, Relaxed);
        Ok(count)
    }
}

/// What the threads of an upload share.
pub(super) struct Upload<'a> {
    pub(super) path: &'a Path,
    pub(super) length: u64,
    /// When the file was changed last, as far as the system tells.
    pub(super) modified: Option<SystemTime>,
    pub(super) sent: AtomicU64,
    /// Somebody wants no more, or a part has failed.
    pub(super) stops: AtomicBool,
    /// There are parts in the store, or soon will be.
    pub(super) has_parts: AtomicBool,
    pub(super) watch: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
}

impl<'a> Upload<'a> {
    pub(super) fn of(
        path: &'a Path,
        watch: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
    ) -> Result<Self> {
        let found = path.metadata().map_err(|error| Error::reading(path, error))?;
        let (sent, stops, has_parts) = (AtomicU64::new(0), AtomicBool::new(false), AtomicBool::new(false));
        Ok(Self { path, length: found.len(), modified: found.modified().ok(), sent, stops, has_parts, watch })
    }

    /// Refuses a file that somebody has written to since the upload began: what was read of it may be of several states.
    pub(super) fn check_unchanged(&self) -> io::Result<()> {
        let found = self.path.metadata()?;
        if (found.len(), found.modified().ok()) == (self.length, self.modified) {
            return Ok(());
        }
        let message = format!(
            "{} was changed while it was sent; send it again when it is finished",
            self.path.display()
        );
        Err(io::Error::new(io::ErrorKind::InvalidData, message))
    }

    /// Reports; whether somebody wants no more.
    pub(super) fn is_cancelled(&self) -> bool {
        (self.watch)(self.sent.load(Relaxed), self.length).is_break()
    }

    /// Reports; whether to stop.
    pub(super) fn is_ended(&self) -> bool {
        if self.is_cancelled() {
            self.stops.store(true, Relaxed);
        }
        self.stops.load(Relaxed)
    }

    pub(super) fn section(&self, start: u64, length: u64) -> io::Result<Section<'_, File>> {
        let file = File::open(self.path)?;
        Ok(Section { file, start, length, left: length, upload: self })
    }

    /// All of a small file, as it is now.
    pub(super) fn whole(&self) -> io::Result<Section<'_, io::Cursor<Vec<u8>>>> {
        let file = io::Cursor::new(std::fs::read(self.path)?);
        self.check_unchanged()?;
        Ok(Section { file, start: 0, length: self.length, left: self.length, upload: self })
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_file_that_is_written_to_is_not_sent() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fan");
        std::fs::write(&path, "first").unwrap();
        let watch = |_: u64, _: u64| ControlFlow::Continue(());
        let upload = Upload::of(&path, &watch).unwrap();
        let mut read = String::new();
        upload.whole().unwrap().read_to_string(&mut read).unwrap();
        assert_eq!(read, "first");
        upload.check_unchanged().unwrap();
        std::fs::write(&path, "longer").unwrap();
        let said = upload.whole().err().unwrap().to_string();
        assert!(said.contains("a.fan was changed while it was sent"), "{said}");
        // Of the same length.
        std::fs::write(&path, "other").unwrap();
        let later = SystemTime::now() + Duration::from_secs(2);
        File::options().write(true).open(&path).unwrap().set_modified(later).unwrap();
        upload.check_unchanged().unwrap_err();
    }
}
