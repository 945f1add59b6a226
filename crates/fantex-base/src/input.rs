//! Files that others made: how they are opened, which other files they may name, how much memory their contents may take.
//!
//! Memory is one budget of the process for all that is read whole: images, volumes, tables, meshes. It is checked before
//! anything is allocated; caches have budgets of their own.

use std::cell::Cell;
use std::collections::HashSet;
use std::fmt::Display;
use std::fs::{File, Metadata};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, Once, PoisonError};

use crate::{Error, Result};

static BUDGET: AtomicU64 = AtomicU64::new(8 << 30);
static HELD: AtomicU64 = AtomicU64::new(0);
static MAY_LEAVE_FOLDER: AtomicBool = AtomicBool::new(false);
/// Files that were opened, by device and number, where they are protected.
static OPENED: Mutex<Option<HashSet<[u64; 2]>>> = Mutex::new(None);

/// Sets how many bytes all that is read whole may take together; 8 GiB at first.
pub fn set_memory(bytes: u64) {
    BUDGET.store(bytes, Relaxed);
}

/// Bytes of the budget that nothing holds.
pub fn memory_left() -> u64 {
    BUDGET.load(Relaxed).saturating_sub(HELD.load(Relaxed))
}

/// Memory that counts against the budget as long as this or a clone of it lives.
#[derive(Clone, Debug)]
pub struct Held(#[expect(dead_code, reason = "what matters is when it is dropped")] Arc<Counted>);

#[derive(Debug)]
struct Counted(u64);

impl Drop for Counted {
    fn drop(&mut self) {
        HELD.fetch_sub(self.0, Relaxed);
    }
}

/// Counts memory that is there already.
pub fn hold(bytes: u64) -> Held {
    HELD.fetch_add(bytes, Relaxed);
    Held(Arc::new(Counted(bytes)))
}

/// Counts memory that will be allocated; `what` begins the sentence where there is not enough.
///
/// # Errors
/// The budget does not allow it ([`too_large`]).
pub fn reserve(what: impl Display, bytes: u64) -> Result<Held> {
    let left = memory_left();
    if bytes > left { Err(too_large(what, bytes, left)) } else { Ok(hold(bytes)) }
}

/// What would take more memory than it may.
pub fn too_large(what: impl Display, bytes: u64, limit: u64) -> Error {
    let unit = if bytes < 1 << 20 { (1, "bytes") } else { (1 << 20, "MiB") };
    let (needed, allowed) = (bytes.div_ceil(unit.0), limit / unit.0);
    Error::too_large(format!(
        "{what} would take {needed} {} of memory, {allowed} are allowed; allow more (--memory) or make it smaller",
        unit.1
    ))
}

/// Opens a regular file for reading: no folder, and neither a device nor a pipe, which may never end.
///
/// # Errors
/// The system's, or it is something else.
pub fn open(path: &Path) -> io::Result<File> {
    // Before it is opened: opening a pipe waits for a writer.
    let metadata = std::fs::metadata(path)?;
    if metadata.is_file() {
        let file = File::open(path)?;
        if let Some(opened) = &mut *OPENED.lock().unwrap_or_else(PoisonError::into_inner) {
            opened.extend(identity(&file.metadata()?));
        }
        return Ok(file);
    }
    let kind = if metadata.is_dir() { "a folder" } else { "a device or a pipe" };
    let kind = format!("it is {kind}, not a regular file");
    Err(io::Error::new(io::ErrorKind::InvalidInput, kind))
}

/// From now on no file that was [opened](open) can be overwritten, whatever name is given for it: for programs that end when
/// their work is done.
pub fn protect() {
    OPENED.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_default();
}

/// Refuses to overwrite a file that is read, by any of its names.
///
/// # Errors
/// It was opened, and inputs are [protected](protect).
pub fn check_output(path: &Path) -> Result<()> {
    let opened = OPENED.lock().unwrap_or_else(PoisonError::into_inner);
    let is_read = |id| opened.as_ref().is_some_and(|opened| opened.contains(&id));
    if !std::fs::metadata(path).is_ok_and(|found| identity(&found).is_some_and(is_read)) {
        return Ok(());
    }
    let path = path.display();
    Err(Error::conflict(format!("{path} is what is read; give what is written another name")))
}

#[cfg(unix)]
fn identity(file: &Metadata) -> Option<[u64; 2]> {
    use std::os::unix::fs::MetadataExt;
    Some([file.dev(), file.ino()])
}

/// Elsewhere the system does not tell.
#[cfg(not(unix))]
fn identity(_file: &Metadata) -> Option<[u64; 2]> {
    None
}

/// Reads a regular file whole.
///
/// # Errors
/// It cannot be read, or has more bytes than the budget has left.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    let failed = |source| Error::reading(path, source);
    let file = open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let left = memory_left();
    if length > left {
        return Err(too_large(path.display(), length, left).with_path(path));
    }
    let mut bytes = Vec::with_capacity(length as usize + 1);
    // It may have grown.
    file.take(left).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// Reads a regular file of UTF-8 text.
///
/// # Errors
/// As [`read`], or it is no text.
pub fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read(path)?).map_err(|_| {
        let source = io::Error::new(io::ErrorKind::InvalidData, "it is no UTF-8 text");
        Error::reading(path, source)
    })
}

/// Lets files name others that lie outside their folder. Without that, opening what somebody else made reads nothing but what
/// came with it.
pub fn allow_outside(is_allowed: bool) {
    MAY_LEAVE_FOLDER.store(is_allowed, Relaxed);
}

/// Refuses a path that `owner` names and that leads out of its folder, unless that is allowed. Symbolic links in the folder are
/// followed: whoever made them has access to the computer.
///
/// # Errors
/// It leads out of the folder.
pub fn check_inside(owner: &Path, named: &Path) -> Result<()> {
    if MAY_LEAVE_FOLDER.load(Relaxed) {
        return Ok(());
    }
    let absolute = |path: &Path| lexical(&std::path::absolute(path).unwrap_or_else(|_| path.to_owned()));
    let folder = absolute(crate::files::folder_of(owner));
    if absolute(&folder.join(named)).starts_with(&folder) {
        return Ok(());
    }
    let (owner, named) = (owner.display(), named.display());
    Err(Error::invalid(format!(
        "{owner} names {named}, which lies outside its folder; copy it there, or allow such files (--allow-outside)"
    )))
}

thread_local! {
    /// Whether a panic on this thread is caught.
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder that is meant to report errors, but may panic on damaged data; then there is nothing, and nothing is printed.
pub fn guarded<T>(decode: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !IS_GUARDED.get() {
                before(panic);
            }
        }));
    });
    let outer = IS_GUARDED.replace(true);
    // What a decoder leaves half done goes with it.
    let decoded = std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode));
    IS_GUARDED.set(outer);
    decoded.ok()
}

/// Without `.` and `..`.
fn lexical(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => drop(plain.pop()),
            Component::CurDir => {}
            _ => plain.push(component),
        }
    }
    plain
}
