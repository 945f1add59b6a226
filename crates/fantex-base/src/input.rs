//! Files that others made: how they are opened, which other files they may name, how much memory their contents may take.
//!
//! [`ReadLimits`] are a value: a program makes one, or one for each of several tasks. They hold for what is called within
//! [`ReadLimits::run`], on the thread that calls; elsewhere those of the process hold ([`ReadLimits::make_default`]). They are not an
//! argument of every loader because decoders stand at the end of long chains of calls (a look names a texture, that an asset,
//! that an image), in closures of other crates too. Where fantex itself reads on other threads, those inherit the limits.
//!
//! Memory is one budget for all that is read whole: images, volumes, tables, meshes. It is checked before anything is
//! allocated; caches have budgets of their own, which shrink by what inputs hold ([`share_of_cache`]).

use std::cell::{Cell, RefCell};
use std::collections::{BTreeSet, HashSet};
use std::fmt::Display;
use std::fs::{File, Metadata};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, Once, PoisonError};

use crate::{Error, Result, are, counted};

/// What [`ReadLimits`] allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadOptions {
    /// Bytes that all that is read whole may take together.
    pub memory_bytes: u64,
    /// Whether files may name others that lie outside their folders. Without that, opening what somebody else made reads nothing
    /// but what came with it.
    pub allow_outside: bool,
    /// Whether no file that was [opened](open) can be overwritten, whatever name is given for it: for programs that end when
    /// their work is done.
    pub protect_inputs: bool,
}

/// Bytes that all that is read whole may take unless it is said otherwise. Pages have 4 GiB, in which what is made of it must find room, too.
const MEMORY_BYTES: u64 = if cfg!(target_arch = "wasm32") { 3 << 29 } else { 8 << 30 };

impl Default for ReadOptions {
    /// 8 GiB (1.5 GiB in WebAssembly), nothing outside, inputs may be overwritten.
    fn default() -> Self {
        Self { memory_bytes: MEMORY_BYTES, allow_outside: false, protect_inputs: false }
    }
}

/// Limits for files that others made, with one budget of memory. Clones share the budget.
#[derive(Clone, Debug)]
pub struct ReadLimits {
    limits: Arc<Limits>,
    /// Files that were opened, if that is [noted](Self::noting_files).
    noted: Option<Arc<Mutex<BTreeSet<PathBuf>>>>,
}

#[derive(Debug)]
struct Limits {
    options: ReadOptions,
    held: AtomicU64,
    /// Files that were opened, by device and number, where they are protected.
    opened: Mutex<HashSet<[u64; 2]>>,
}

/// Those of the process, made when they are first asked for.
static DEFAULT: Mutex<Option<ReadLimits>> = Mutex::new(None);

thread_local! {
    static CURRENT: RefCell<Option<ReadLimits>> = const { RefCell::new(None) };
}

impl ReadLimits {
    /// Limits with a budget of their own.
    pub fn new(options: ReadOptions) -> Self {
        let limits = Limits { options, held: AtomicU64::new(0), opened: Mutex::default() };
        Self { limits: Arc::new(limits), noted: None }
    }

    /// The same limits, which also note the paths of the files that are [opened](open) within them.
    #[must_use]
    pub fn noting_files(&self) -> Self {
        Self { limits: Arc::clone(&self.limits), noted: Some(Arc::default()) }
    }

    /// The paths that were [noted](Self::noting_files), in order.
    pub fn noted_files(&self) -> Vec<PathBuf> {
        self.noted.iter().flat_map(|paths| locked(paths).clone()).collect()
    }

    /// Those that hold here and now: of the innermost [`run`](Self::run) on this thread, else of the process.
    pub fn current() -> Self {
        let process = || locked(&DEFAULT).get_or_insert_with(|| Self::new(ReadOptions::default())).clone();
        CURRENT.with_borrow(Clone::clone).unwrap_or_else(process)
    }

    /// Makes these the limits of the process, which hold on all threads outside [`run`](Self::run).
    pub fn make_default(&self) {
        *locked(&DEFAULT) = Some(self.clone());
    }

    /// Does work within these limits, on this thread. Work that is given to other threads takes a clone along.
    pub fn run<T>(&self, work: impl FnOnce() -> T) -> T {
        /// Puts back what was, also when the work panics.
        struct Outer(Option<ReadLimits>);
        impl Drop for Outer {
            fn drop(&mut self) {
                CURRENT.set(self.0.take());
            }
        }
        let _outer = Outer(CURRENT.replace(Some(self.clone())));
        work()
    }

    /// What is allowed.
    pub fn options(&self) -> &ReadOptions {
        &self.limits.options
    }

    /// Bytes of the budget that nothing holds.
    pub fn memory_left(&self) -> u64 {
        self.limits.options.memory_bytes.saturating_sub(self.limits.held.load(Relaxed))
    }
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Memory that counts against a budget as long as this or a clone of it lives.
#[derive(Clone, Debug)]
pub struct Held(#[expect(dead_code, reason = "what matters is when it is dropped")] Arc<Counted>);

#[derive(Debug)]
struct Counted(u64, ReadLimits);

impl Drop for Counted {
    fn drop(&mut self) {
        self.1.limits.held.fetch_sub(self.0, Relaxed);
    }
}

/// Bytes of the current budget that nothing holds.
pub fn memory_left() -> u64 {
    ReadLimits::current().memory_left()
}

/// What a cache may take that could do with so many bytes: what inputs have left of the current budget, and a quarter of the
/// wish in any case. Caches do not count against the budget.
pub fn share_of_cache(bytes: u64) -> u64 {
    bytes.min(memory_left()).max(bytes / 4)
}

/// Counts memory that is there already.
pub fn hold(bytes: u64) -> Held {
    let limits = ReadLimits::current();
    limits.limits.held.fetch_add(bytes, Relaxed);
    Held(Arc::new(Counted(bytes, limits)))
}

/// Counts memory that will be allocated; `what` begins the sentence where there is not enough.
///
/// # Errors
/// The budget does not allow it ([`too_large`]).
pub fn reserve(what: impl Display, bytes: u64) -> Result<Held> {
    let limits = ReadLimits::current();
    let (held, most) = (&limits.limits.held, limits.options().memory_bytes);
    let add = |held: u64| held.checked_add(bytes).filter(|&sum| sum <= most);
    match held.fetch_update(Relaxed, Relaxed, add) {
        Ok(_) => Ok(Held(Arc::new(Counted(bytes, limits)))),
        Err(held) => Err(too_large(what, bytes, most.saturating_sub(held))),
    }
}

/// What can be done where there is not enough memory.
const REMEDY: &str = if cfg!(target_arch = "wasm32") {
    "a page has no more; it can be made smaller, or split (fantex split)"
} else {
    "allow more (--memory) or make it smaller"
};

/// What would take more memory than is left of what is allowed.
pub fn too_large(what: impl Display, bytes: u64, left: u64) -> Error {
    let (needed, left, are) = if bytes < 1 << 20 {
        (counted(bytes, "byte").to_string(), counted(left, "byte").to_string(), are(left))
    } else {
        let left = left >> 20;
        (format!("{} MiB", bytes.div_ceil(1 << 20)), format!("{left} MiB"), are(left))
    };
    Error::too_large(format!("{what} would take {needed} of memory, {left} {are} left; {REMEDY}"))
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
        let limits = ReadLimits::current();
        if limits.options().protect_inputs {
            locked(&limits.limits.opened).extend(identity(&file.metadata()?));
        }
        if let Some(paths) = &limits.noted {
            locked(paths).insert(path.to_owned());
        }
        return Ok(file);
    }
    let kind = if metadata.is_dir() { "a folder" } else { "a device or a pipe" };
    let kind = format!("it is {kind}, not a regular file");
    Err(io::Error::new(io::ErrorKind::InvalidInput, kind))
}

/// Refuses to overwrite a file that is read, by any of its names.
///
/// # Errors
/// It was opened, and inputs are [protected](ReadOptions::protect_inputs).
pub fn check_output(path: &Path) -> Result<()> {
    let limits = ReadLimits::current();
    let is_opened = |id| locked(&limits.limits.opened).contains(&id);
    if !std::fs::metadata(path).is_ok_and(|found| identity(&found).is_some_and(is_opened)) {
        return Ok(());
    }
    Err(is_read(path))
}

/// The error of a place that would be written although it is read.
pub fn is_read(place: &Path) -> Error {
    let place = place.display();
    Error::conflict(format!("{place} is what is read; give what is written another name"))
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

/// Refuses a path that `owner` names and that leads out of its folder, unless that is allowed. Symbolic links in the folder are
/// followed: whoever made them has access to the computer.
///
/// # Errors
/// It leads out of the folder.
pub fn check_inside(owner: &Path, named: &Path) -> Result<()> {
    check_below(owner, crate::files::folder_of(owner), named)
}

/// As [`check_inside`], for names that are relative to another folder than that of `owner`.
///
/// # Errors
/// It leads out of the folder.
pub fn check_below(owner: &Path, folder: &Path, named: &Path) -> Result<()> {
    if ReadLimits::current().options().allow_outside {
        return Ok(());
    }
    let absolute = |path: &Path| lexical(&std::path::absolute(path).unwrap_or_else(|_| path.to_owned()));
    let folder = absolute(folder);
    if absolute(&folder.join(named)).starts_with(&folder) {
        return Ok(());
    }
    let (owner, named) = (owner.display(), named.display());
    Err(Error::unsupported(format!(
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
