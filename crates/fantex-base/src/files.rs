//! Files that appear whole or not at all: written under a temporary name in their own folder, then renamed. Where a symbolic link is to be
//! written over, the file that it leads to is replaced, and the link stays.
//!
//! A process that is killed leaves what it had under temporary names. Locks tell it from what others write: the next one that writes into
//! the folder removes it.

use std::collections::{BTreeMap, VecDeque};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::ops::Bound;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tempfile::{Builder, NamedTempFile, TempDir, TempPath};

use crate::{Error, Result, input};

/// The folder that a file lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Where symbolic links lead, whether something is there or not; other paths, and links that lead back to themselves, are their own places.
pub fn followed(path: &Path) -> PathBuf {
    let mut place = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(target) = std::fs::read_link(&place) else { return place };
        place = folder_of(&place).join(target);
    }
    path.to_owned()
}

/// Links that lead to each other, at most: as many as Linux follows.
const MAX_LINKS: usize = 40;

/// Refuses a file in a folder that is not there.
///
/// # Errors
/// There is no such folder.
pub fn check_folder_of(path: &Path) -> Result<()> {
    let place = followed(path);
    let folder = folder_of(&place);
    if folder.is_dir() {
        return Ok(());
    }
    let sentence = format!("cannot write {}: there is no folder {}", path.display(), folder.display());
    Err(Error::not_found(sentence).with_path(path))
}

/// A new file in the folder of `path` (where a symbolic link [leads](followed)), with the permissions that any new file gets (temporary files are
/// private by default). It goes away unless it gets another name.
///
/// # Errors
/// The system's.
pub fn temporary_file(path: &Path, suffix: &str) -> io::Result<NamedTempFile> {
    let mut builder = Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let place = followed(path);
    let folder = folder_of(&place);
    sweep(folder);
    let file = builder.prefix(PREFIX).suffix(suffix).tempfile_in(folder).map_err(without_name)?;
    let same = file.as_file().try_clone()?;
    // Where there are no locks, others leave it alone for a while only.
    same.try_lock_shared().unwrap_or_default();
    remember(file.path(), same);
    Ok(file)
}

/// The error without the temporary name, which says nothing to anybody.
fn without_name(error: io::Error) -> io::Error {
    let text = error.to_string();
    let Some((cause, _)) = text.split_once(" at path ") else { return error };
    // The system's own error is not to be had otherwise.
    let number =
        cause.rsplit_once("(os error ").and_then(|(_, number)| number.strip_suffix(')')?.parse().ok());
    number.map_or_else(|| io::Error::new(error.kind(), cause), io::Error::from_raw_os_error)
}

/// A folder in another one, for files that belong together, which goes away with the value and all that is in it.
#[derive(Debug)]
pub struct TemporaryFolder(TempDir);

impl TemporaryFolder {
    /// Where it is.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Makes files of the folder durable and gives them the same names in another folder of the same file system; only with `force` over
    /// others.
    ///
    /// # Errors
    /// As [`persist_all`].
    pub fn move_files(&self, names: &[PathBuf], to: &Path, force: bool) -> Result<()> {
        let file = |name: &PathBuf| -> Result<(TempPath, PathBuf)> {
            let path = to.join(name);
            let file = TempPath::try_from_path(self.path().join(name));
            Ok((file.map_err(|error| Error::writing(&path, error))?, path))
        };
        persist_all(names.iter().map(file).collect::<Result<_>>()?, force)
    }

    /// Lets the folder stay, under another name, which begins with `prefix`; returns its path. Where the system does not rename it, it stays where it
    /// is. Nobody removes it then.
    pub fn keep(mut self, prefix: &str) -> PathBuf {
        self.0.disable_cleanup(true);
        let path = self.path().to_owned();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let kept = path.with_file_name(format!("{prefix}{}", name.strip_prefix(PREFIX).unwrap_or(&name)));
        let renamed = || std::fs::rename(&path, &kept).is_ok();
        // Some systems rename no folder in which a file is open.
        let is_renamed = renamed() || {
            forget(&path);
            renamed()
        };
        let path = if is_renamed { kept } else { path };
        // What has a lock that is free would be removed.
        std::fs::remove_file(path.join(FOLDER_LOCK)).unwrap_or_default();
        path
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        forget(self.path());
    }
}

/// A new folder in another one.
///
/// # Errors
/// The system's.
pub fn temporary_folder(folder: &Path) -> io::Result<TemporaryFolder> {
    sweep(folder);
    let made = Builder::new().prefix(PREFIX).tempdir_in(folder).map_err(without_name)?;
    let [unnamed, path] = [UNNAMED_LOCK, FOLDER_LOCK].map(|name| made.path().join(name));
    let lock = File::create(&unnamed)?;
    // Where there are no locks, nobody else can take it either.
    lock.try_lock_shared().unwrap_or_default();
    // A lock by this name that is free was held by a process that is gone.
    std::fs::rename(unnamed, path)?;
    remember(made.path(), lock);
    Ok(TemporaryFolder(made))
}

/// A new folder in that for temporary files, for what a library can write to files only. It does not outlive the process either.
///
/// # Errors
/// It cannot be made.
pub fn scratch_folder() -> Result<TemporaryFolder> {
    let parent = std::env::temp_dir();
    temporary_folder(&parent).map_err(|error| Error::writing(parent, error))
}

/// What the names of temporary files and folders begin with.
const PREFIX: &str = ".fantex-";

/// The file in a temporary folder that is locked as long as the folder is in use.
const FOLDER_LOCK: &str = ".fantex-lock";

/// What that file is called until it is locked.
const UNNAMED_LOCK: &str = ".fantex-new";

/// A temporary file that nobody has locked for so long was left by a process that was killed.
const STALE_AFTER: Duration = Duration::from_secs(60);

/// Files and folders of this process that shall not outlive it.
#[derive(Debug)]
struct Temporaries {
    /// Kept open and locked, so that others see that they are in use; of a folder the file that says so.
    files: BTreeMap<PathBuf, File>,
    /// The last one that was looked for.
    looked_for: Option<PathBuf>,
}

static TEMPORARIES: Mutex<Temporaries> = Mutex::new(Temporaries { files: BTreeMap::new(), looked_for: None });

/// Files that are looked for whenever one is added, in turn: all of them would make time grow with the square of their number.
const LOOKED_FOR_AT_ONCE: usize = 4;

impl Temporaries {
    fn add(&mut self, path: &Path, file: File) {
        self.forget_gone();
        self.files.insert(path.to_owned(), file);
    }

    /// Closes those of the next files that are gone.
    fn forget_gone(&mut self) {
        let after: Bound<PathBuf> = self.looked_for.take().map_or(Bound::Unbounded, Bound::Excluded);
        let following = self.files.range::<PathBuf, _>((after, Bound::Unbounded)).chain(&self.files);
        let count = LOOKED_FOR_AT_ONCE.min(self.files.len());
        let next: Vec<PathBuf> = following.take(count).map(|(path, _)| path.clone()).collect();
        self.looked_for = next.last().cloned();
        for path in next.iter().filter(|path| !path.exists()) {
            self.files.remove(path);
        }
    }
}

fn temporaries() -> MutexGuard<'static, Temporaries> {
    TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps a file open, and marks it for [`remove_temporaries`], until it is [forgotten](forget) or gone.
pub fn remember(path: &Path, file: File) {
    temporaries().add(path, file);
}

/// A file that stays, or has gone.
pub fn forget(path: &Path) {
    temporaries().files.remove(path);
}

/// Removes all temporary files, folders and locks of this process, which is about to end without unwinding: at once, as other threads may still
/// write to what these locks keep from others.
pub fn remove_temporaries() {
    let files = std::mem::take(&mut temporaries().files);
    for (path, file) in locks_last(files) {
        drop(file);
        let removed = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        removed.unwrap_or_default();
    }
}

/// Removing all else may take a while.
fn locks_last(files: BTreeMap<PathBuf, File>) -> Vec<(PathBuf, File)> {
    let mut files: Vec<_> = files.into_iter().collect();
    files.sort_by_key(|(path, _)| path.extension().is_some_and(|extension| extension == "lock"));
    files
}

/// Folders that were looked through for what killed processes have left, and when: the last ones.
static SWEPT: Mutex<VecDeque<(PathBuf, Instant)>> = Mutex::new(VecDeque::new());

/// Folders of which that is known.
const MAX_SWEPT: usize = 16;

/// Removes what killed processes have left in a folder, unless that was done within the last minute: whoever writes many files looks
/// through their folder once.
pub fn sweep(folder: &Path) {
    let mut swept = SWEPT.lock().unwrap_or_else(PoisonError::into_inner);
    swept.retain(|(_, at)| at.elapsed() < STALE_AFTER);
    if swept.iter().any(|(known, _)| known == folder) {
        return;
    }
    swept.push_back((folder.to_owned(), Instant::now()));
    if swept.len() > MAX_SWEPT {
        swept.pop_front();
    }
    drop(swept);
    remove_leftovers(folder);
}

/// Removes temporary files and folders in a folder whose process was killed, as far as that is possible.
pub fn remove_leftovers(folder: &Path) {
    let Ok(entries) = folder.read_dir() else { return };
    let is_ours = |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(PREFIX));
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_ours) {
        let Ok(found) = path.symlink_metadata() else { continue };
        let is_old = found.modified().is_ok_and(|at| at.elapsed().is_ok_and(|age| age > STALE_AFTER));
        if found.is_dir() {
            remove_left_folder(&path, is_old);
        } else if found.is_file() && is_old {
            remove_unlocked(&path);
        }
    }
}

/// Removes a file that nobody has locked. It stays locked until it is gone: who locked it in between would hold the lock of a file without a name, and
/// the next one that of a new file.
fn remove_unlocked(path: &Path) {
    if let Ok(file) = File::open(path)
        && file.try_lock().is_ok()
    {
        std::fs::remove_file(path).unwrap_or_default();
    }
}

/// Removes a temporary folder whose lock is free, or that has been without one for so long that its process was killed when it made it.
fn remove_left_folder(path: &Path, is_old: bool) {
    match File::open(path.join(FOLDER_LOCK)) {
        Ok(lock) if lock.try_lock().is_ok() => std::fs::remove_dir_all(path).unwrap_or_default(),
        Err(error) if error.kind() == io::ErrorKind::NotFound && is_old => {
            remove_unlocked(&path.join(UNNAMED_LOCK));
            // Not one that has something else in it: others may give their folders such names.
            std::fs::remove_dir(path).unwrap_or_default();
        }
        _ => {}
    }
}

/// Makes a finished file durable and gives it its name; only with `force` over another, which is the one that a link [leads](followed) to.
///
/// # Errors
/// [`exists`], or the system refuses: then the file is gone, and what was at `path` is as it was. Where only the folder cannot be
/// made durable, the new file is there.
pub fn persist(file: TempPath, path: &Path, force: bool) -> Result<()> {
    persist_all(vec![(file, path.to_owned())], force)
}

/// As [`persist`], for files that belong together: all are durable before the first one gets its name.
///
/// # Errors
/// As [`persist`]. Where one cannot be named after others were, those that were new are gone.
pub fn persist_all(files: Vec<(TempPath, PathBuf)>, force: bool) -> Result<()> {
    let failed = |path: &Path, error| Error::writing(path, error);
    for (file, path) in &files {
        input::check_output(path)?;
        let synced = OpenOptions::new().write(true).open(file).and_then(|file| file.sync_all());
        synced.map_err(|error| failed(path, error))?;
    }
    let mut named: Vec<PathBuf> = Vec::with_capacity(files.len());
    for (file, path) in files {
        let temporary = file.to_path_buf();
        let place = if force { followed(&path) } else { path.clone() };
        if let Err(error) = rename(file, &place, force) {
            if !force {
                named.iter().for_each(|path| std::fs::remove_file(path).unwrap_or_default());
            }
            return Err(match error.kind() {
                io::ErrorKind::AlreadyExists => exists(&path),
                _ => failed(&path, error),
            });
        }
        forget(&temporary);
        named.push(place);
    }
    // Names are durable once their folders are.
    named.dedup_by(|a, b| folder_of(a) == folder_of(b));
    named.iter().try_for_each(|path| sync_folder(folder_of(path)))
}

/// Gives a file its name; with `force` over another, also where a link has led to another file system than the file was written to.
fn rename(file: TempPath, place: &Path, force: bool) -> io::Result<()> {
    if !force {
        return file.persist_noclobber(place).map_err(|refused| refused.error);
    }
    let Err(refused) = file.persist(place) else { return Ok(()) };
    if refused.error.kind() != io::ErrorKind::CrossesDevices {
        return Err(refused.error);
    }
    let mut copy = temporary_file(place, "")?;
    io::copy(&mut File::open(&refused.path)?, copy.as_file_mut())?;
    copy.as_file().sync_all()?;
    let copy = copy.into_temp_path();
    let temporary = copy.to_path_buf();
    copy.persist(place).map_err(|refused| refused.error)?;
    forget(&temporary);
    Ok(())
}

/// Makes the names of a folder's files durable, where the system can.
///
/// # Errors
/// The system refuses.
pub fn sync_folder(folder: &Path) -> Result<()> {
    if !cfg!(unix) {
        return Ok(());
    }
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        Err(error) if !is_without_sync(&error) => Err(Error::writing(folder, error)),
        _ => Ok(()),
    }
}

/// The folder may be written to and not be listed, or its file system (of a network, by FUSE) knows nothing of the kind. The files have their
/// names all the same.
fn is_without_sync(error: &io::Error) -> bool {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    matches!(error.kind(), InvalidInput | PermissionDenied | Unsupported)
}

/// Removes a file, if it is there.
///
/// # Errors
/// The system refuses.
pub fn remove_if_there(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Error::writing(path, error)),
        _ => Ok(()),
    }
}

/// Writes a file whole or not at all.
///
/// # Errors
/// As [`persist`], or `write` fails.
pub fn write_whole(
    path: &Path,
    force: bool,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<()> {
    let failed = |error| Error::writing(path, error);
    let file = temporary_file(path, "").map_err(failed)?;
    let mut out = BufWriter::with_capacity(1 << 20, file.as_file());
    write(&mut out).and_then(|()| out.flush()).map_err(failed)?;
    drop(out);
    persist(file.into_temp_path(), path, force)
}

/// The output is there already.
pub fn exists(path: &Path) -> Error {
    let sentence = format!("{} exists already; use --force to overwrite it", path.display());
    Error::already_exists(sentence).with_path(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_gone_are_forgotten_and_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let [there, gone] = ["there", "gone"].map(|name| folder.path().join(name));
        let mut known = Temporaries { files: BTreeMap::new(), looked_for: None };
        for number in 0..100 {
            let path = there.with_extension(number.to_string());
            known.add(&path, File::create(&path).unwrap());
            known.add(
                &gone.with_extension(number.to_string()),
                File::create(folder.path().join("x")).unwrap(),
            );
        }
        (0..known.files.len()).for_each(|_| known.forget_gone());
        assert!(known.files.len() == 100 && known.files.keys().all(|path| path.exists()));
    }

    #[test]
    fn locks_are_removed_last() {
        let file = || tempfile::tempfile().unwrap();
        let files = ["a.fan.lock", "b.tmp", "c.lock", "d"].map(|name| (PathBuf::from(name), file()));
        let names: Vec<_> = locks_last(files.into()).into_iter().map(|(path, _)| path).collect();
        assert_eq!(names, ["b.tmp", "d", "a.fan.lock", "c.lock"].map(PathBuf::from));
    }

    #[test]
    fn errors_do_not_name_temporary_files() {
        let folder = tempfile::tempdir().unwrap();
        let none = folder.path().join("none");
        let errors =
            [temporary_file(&none.join("a.fan"), ".tmp").unwrap_err(), temporary_folder(&none).unwrap_err()];
        for error in errors {
            assert_eq!(error.kind(), io::ErrorKind::NotFound);
            assert!(!error.to_string().contains(PREFIX), "{error}");
        }
    }

    #[test]
    fn a_folder_is_looked_through_once_for_many_files() {
        let folder = tempfile::tempdir().unwrap();
        let leave = |name: &str| {
            let path = folder.path().join(name);
            let file = File::create(&path).unwrap();
            file.set_modified(std::time::SystemTime::now() - 2 * STALE_AFTER).unwrap();
            path
        };
        let first = leave(".fantex-first");
        drop(temporary_file(&folder.path().join("a"), "").unwrap());
        assert!(!first.exists());
        let second = leave(".fantex-second");
        drop(temporary_file(&folder.path().join("b"), "").unwrap());
        assert!(second.exists());
        // As another process would.
        remove_leftovers(folder.path());
        assert!(!second.exists());
    }

    #[test]
    fn folders_go_once_their_lock_is_free() {
        let parent = tempfile::tempdir().unwrap();
        let at = |name: &str| parent.path().join(name);
        let used = temporary_folder(parent.path()).unwrap();
        std::fs::write(used.path().join("a"), "a").unwrap();
        for name in [".fantex-left", ".fantex-other", "left"] {
            std::fs::create_dir(at(name)).unwrap();
            std::fs::write(at(name).join("a"), "a").unwrap();
        }
        for name in [".fantex-left", "left"] {
            std::fs::write(at(name).join(FOLDER_LOCK), "").unwrap();
        }
        // A process is between making the lock and naming it.
        std::fs::create_dir(at(".fantex-young")).unwrap();
        std::fs::write(at(".fantex-young").join(UNNAMED_LOCK), "").unwrap();
        remove_leftovers(parent.path());
        assert!(!at(".fantex-left").exists());
        for name in [".fantex-other", "left", ".fantex-young"] {
            assert!(at(name).exists(), "{name}");
        }
        assert!(used.path().join("a").exists());
        let path = used.path().to_owned();
        drop(used);
        assert!(!path.exists() && !temporaries().files.contains_key(&path));
        // It was killed there.
        remove_left_folder(&at(".fantex-young"), true);
        remove_left_folder(&at(".fantex-other"), true);
        assert!(!at(".fantex-young").exists() && at(".fantex-other/a").exists());
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_what_they_lead_to_is_replaced() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("below")).unwrap();
        std::fs::write(at("below/file"), "old").unwrap();
        for (target, link) in
            [("file", "below/link"), ("below/link", "link"), ("below/none", "dangling"), ("loop", "loop")]
        {
            symlink(target, at(link)).unwrap();
        }
        let write = |name: &str, force| write_whole(&at(name), force, |out| out.write_all(b"new"));
        assert_eq!(write("link", false).unwrap_err().kind(), crate::ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(at("below/file")).unwrap(), b"old");
        // By a chain of links, to a file that is not there yet, and back to itself.
        for (link, file) in [("link", "below/file"), ("dangling", "below/none")] {
            write(link, true).unwrap();
            assert!(at(link).is_symlink() && !at(file).is_symlink());
            assert_eq!(std::fs::read(at(file)).unwrap(), b"new");
        }
        write("loop", true).unwrap();
        assert_eq!(std::fs::read(at("loop")).unwrap(), b"new");
        let names = |folder: &Path| folder.read_dir().unwrap().count();
        assert_eq!([names(folder.path()), names(&at("below"))], [4, 3], "nothing else is left");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn folders_that_cannot_be_made_durable_are_told_from_those_that_fail() {
        // EACCES, EINVAL, EOPNOTSUPP; EIO, ENOSPC.
        let is_without = |number| is_without_sync(&io::Error::from_raw_os_error(number));
        assert_eq!([13, 22, 95, 5, 28].map(is_without), [true, true, true, false, false]);
    }

    #[test]
    fn files_of_a_folder_move_together() {
        let parent = tempfile::tempdir().unwrap();
        let folder = temporary_folder(parent.path()).unwrap();
        let names = ["a", "b"].map(PathBuf::from);
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "new").unwrap());
        std::fs::write(parent.path().join("b"), "old").unwrap();
        let read = |name| std::fs::read_to_string(parent.path().join(name));
        assert!(folder.move_files(&names, parent.path(), false).is_err());
        assert!(read("a").is_err() && read("b").unwrap() == "old");
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "new").unwrap());
        folder.move_files(&names, parent.path(), true).unwrap();
        assert!(read("a").unwrap() == "new" && read("b").unwrap() == "new");
    }

    #[test]
    fn folders_that_are_kept_stay_under_a_name_of_their_own() {
        let parent = tempfile::tempdir().unwrap();
        let folder = temporary_folder(parent.path()).unwrap();
        let path = folder.path().to_owned();
        std::fs::write(path.join("a"), "a").unwrap();
        let kept = folder.keep("kept-");
        assert!(!path.exists() && !temporaries().files.contains_key(&path));
        assert!(kept.file_name().unwrap().to_str().unwrap().starts_with("kept-"), "{}", kept.display());
        remove_leftovers(parent.path());
        let names: Vec<_> = kept.read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names, ["a"]);
    }
}
