//! Locks: one writer at a time, and no overwriting under a reader.
//!
//! - *Writers* exclude each other by a lock on a file beside the asset (where symbolic links lead), `NAME.lock`. The system releases
//!   it when the process ends, however it ends, so a file that a crash leaves behind locks nobody out. Another lock, in the system's folder
//!   for temporary files, is named after the file itself: it holds for all its names (hard links).
//! - *Readers* hold a shared lock on the asset itself as long as they have it open. A writer overwrites superseded parts of
//!   the file only after it held that lock alone for a moment: then nobody has a generation open that names them. Where
//!   the system cannot tell (Windows, where such a lock would forbid writing, and file systems without locks), superseded
//!   parts are never overwritten; [`compact`](crate::AssetEditor::compact) returns their space.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
#[cfg(unix)]
use std::time::UNIX_EPOCH;

use fantex_base::files::{exists, folder_of, forget, persist, remember, sweep};
use fantex_base::{Error, ErrorKind, Result};
use tempfile::TempPath;

/// Attempts, a millisecond apart, to mark a file as being read.
const MAX_LOCK_ATTEMPTS: u32 = 500;

/// Keeps other writers away from a file while it lives, from an asset or from another file that is changed as a whole.
#[derive(Debug)]
pub struct WriterLock {
    beside: Arc<LockFile>,
    _of_inode: Option<LockFile>,
}

#[derive(Debug)]
struct LockFile {
    path: PathBuf,
    /// Locked as long as it is open.
    _file: File,
}

impl WriterLock {
    /// Locks the file at `path`, which need not be there, against other writers.
    ///
    /// # Errors
    /// Another one is at work ([`Conflict`](ErrorKind::Conflict)); the lock's file, beside it, cannot be made.
    pub fn acquire(path: &Path) -> Result<Self> {
        let real = path.canonicalize().unwrap_or_else(|_| path.into());
        Self::with_beside(path, &real, Arc::new(LockFile::acquire(path, lock_path(&real))?))
    }

    /// Locks the file at `path`, which another one is to replace; `None` where there is none.
    ///
    /// # Errors
    /// As [`acquire`](Self::acquire).
    pub fn of_replaced(path: &Path) -> Result<Option<Self>> {
        path.is_file().then(|| Self::acquire(path)).transpose()
    }

    /// The lock of who has put another file in the asset's place: that of the file that is gone ends with `self`, as the next file may get
    /// its number.
    pub(super) fn moved(&self, path: &Path) -> Result<Self> {
        let real = path.canonicalize().unwrap_or_else(|_| path.into());
        Self::with_beside(path, &real, Arc::clone(&self.beside))
    }

    fn with_beside(path: &Path, real: &Path, beside: Arc<LockFile>) -> Result<Self> {
        let of_inode = inode_lock_path(real);
        // Nobody takes the locks of killed processes whose files have gone.
        of_inode.iter().for_each(|lock_path| sweep(folder_of(lock_path)));
        let _of_inode = match of_inode.map(|lock_path| LockFile::acquire(path, lock_path)) {
            Some(Err(error)) if error.kind() == ErrorKind::Conflict => return Err(error),
            // Without such a folder the lock beside the asset is all there is.
            lock => lock.and_then(Result::ok),
        };
        Ok(Self { beside, _of_inode })
    }
}

/// The place of a new asset. One that is there is locked against other writers from the beginning on: what they write after that would be lost
/// with it.
#[derive(Debug)]
pub struct Replacement {
    path: PathBuf,
    force: bool,
    lock: Option<WriterLock>,
}

impl Replacement {
    /// Takes the place at `path`; only with `force` that of another file.
    ///
    /// # Errors
    /// There is a file, and it is not to be replaced, or as for [`WriterLock::acquire`].
    pub fn begin(path: &Path, force: bool) -> Result<Self> {
        if !force && path.symlink_metadata().is_ok() {
            return Err(exists(path));
        }
        let lock = if force { WriterLock::of_replaced(path)? } else { None };
        Ok(Self { path: path.to_owned(), force, lock })
    }

    /// Makes the finished asset durable and puts it in its place.
    ///
    /// # Errors
    /// As [`persist`], or another writer is at work on what has come there meanwhile.
    pub fn finish(mut self, file: TempPath) -> Result<()> {
        if self.lock.is_none() && self.force {
            self.lock = WriterLock::of_replaced(&self.path)?;
        }
        persist(file, &self.path, self.force)
    }
}

impl LockFile {
    fn acquire(path: &Path, lock_path: PathBuf) -> Result<Self> {
        let io = |source: std::io::Error| {
            let (path, lock) = (path.display(), lock_path.display());
            let sentence = format!(
                "cannot lock {path} against other programs: {lock} cannot be made: {source}; its folder must be writable"
            );
            Error::new(ErrorKind::Io, sentence).with_path(&lock_path).with_source(source)
        };
        loop {
            let options = OpenOptions::new().write(true).create(true).truncate(false).clone();
            let file = options.open(&lock_path).map_err(io)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::conflict(format!(
                        "{} is being edited by another program; close it there first",
                        path.display()
                    ))
                    .with_path(path));
                }
                // Without locks the file's owner takes care.
                Err(TryLockError::Error(error)) if error.kind() == std::io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(source)) => return Err(io(source)),
            }
            // The writer before may have removed the file between our opening and locking it.
            if is_same_file(&file, &lock_path) {
                // Sharing what is open keeps the lock.
                if let Ok(same) = file.try_clone() {
                    remember(&lock_path, same);
                }
                return Ok(Self { path: lock_path, _file: file });
            }
        }
    }
}

impl Drop for LockFile {
    fn drop(&mut self) {
        // A file that stays locks nobody out.
        std::fs::remove_file(&self.path).unwrap_or_default();
        forget(&self.path);
    }
}

fn lock_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    name.into()
}

/// The lock that is named after the file itself.
#[cfg(unix)]
fn inode_lock_path(path: &Path) -> Option<PathBuf> {
    use std::os::unix::fs::MetadataExt;
    let file = path.metadata().ok()?;
    // Numbers of files that are gone are given again; a copy that is being edited may still hold one.
    let born = file.created().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let born = born.map_or(0, |time| time.as_nanos());
    Some(std::env::temp_dir().join(format!(".fantex-{}-{}-{born}.lock", file.dev(), file.ino())))
}

/// Elsewhere the system does not tell.
#[cfg(not(unix))]
fn inode_lock_path(_path: &Path) -> Option<PathBuf> {
    None
}

/// True where `path` (still) names the open file.
#[cfg(unix)]
pub(super) fn is_same_file(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

/// True where `path` (still) names the open file: nobody can replace it while it is open.
#[cfg(not(unix))]
pub(super) fn is_same_file(_file: &File, _path: &Path) -> bool {
    true
}

/// A reader's mark on a file that it has open.
pub(crate) fn keep_generation(file: &File) {
    if !cfg!(unix) {
        return;
    }
    // A writer holds the file alone for a moment only. A longer lock is foreign; ignore it.
    for _ in 0..MAX_LOCK_ATTEMPTS {
        match file.try_lock_shared() {
            Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(1)),
            // Where the system has no locks writers never find the file unread.
            Ok(()) | Err(TryLockError::Error(_)) => return,
        }
    }
}

/// True where no reader but those who share `file` (the open file, not the path) has the asset open now.
pub(super) fn is_unread(file: &File) -> bool {
    if !cfg!(unix) {
        return false;
    }
    let alone = file.try_lock().is_ok();
    // The attempt replaced or lost the shared lock.
    keep_generation(file);
    alone
}
