//! Places that are addresses: results that go to object stores, and assets there that are changed.

pub(crate) mod staging;
pub(crate) mod upload;

use std::error::Error as _;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::Progress;
use fantex_base::files::{persist, temporary_file};
use fantex_base::input::{ReadLimits, ReadOptions};
use fantex_base::{Error, ErrorKind, Result, input};
use fantex_store::{Asset, FileSource, MAX_GAPS_COPIED, Replacement, WriterLock};
use fantex_stream::{ObjectTarget, Replace, open_source, url_of};
use tempfile::TempPath;

use self::staging::{SendTarget, Staging};

/// Bytes of an object that are fetched at once, over several connections.
const FETCHED_AT_ONCE: u64 = 24 << 20;

/// Bytes of a file that are copied between two reports.
const COPIED_AT_ONCE: u64 = 16 << 20;

/// Whether a place is no path.
pub fn is_address(place: &Path) -> bool {
    scheme(place).is_some_and(|scheme| {
        !scheme.is_empty()
            && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"+-.".contains(&byte))
    })
}

/// Refuses addresses where a result may have several files.
///
/// # Errors
/// The place is an address.
pub fn check_is_path(place: &Path) -> Result<()> {
    match is_address(place) {
        true => Err(Error::invalid(format!(
            "cannot write {}: files are written here; give a path, and copy them to their addresses afterwards",
            place.display()
        ))),
        false => Ok(()),
    }
}

/// Whether a place names an object in a store that can be written.
pub fn is_object(place: &Path) -> bool {
    scheme(place)
        .is_some_and(|scheme| ["s3", "gs", "az"].iter().any(|known| scheme.eq_ignore_ascii_case(known)))
}

/// What stands before `://`.
fn scheme(place: &Path) -> Option<&str> {
    Some(place.to_str()?.split_once("://")?.0)
}

/// Where a result goes. To a store it goes by a file on this machine, in the folder for temporary files.
#[derive(Debug)]
pub struct Target<'a> {
    place: &'a Path,
    staged: Option<Staged>,
}

#[derive(Debug)]
struct Staged {
    object: ObjectTarget,
    folder: Staging,
    file: PathBuf,
}

impl<'a> Target<'a> {
    /// For an address, makes a temporary folder for the file, which goes away with the value. Sends nothing yet.
    ///
    /// # Errors
    /// The place is an address of no store that is written to, or names no object; there is no room for the folder.
    pub fn new(place: &'a Path) -> Result<Self> {
        if !is_address(place) {
            return Ok(Self { place, staged: None });
        }
        let object = ObjectTarget::at(place)?;
        let folder = Staging::new()?;
        let file = folder.path().join(place.file_name().unwrap_or_default());
        Ok(Self { place, staged: Some(Staged { object, folder, file }) })
    }

    /// Refuses, before any work is done, an object that could not be written at its end. Of files nothing is asked.
    ///
    /// # Errors
    /// As [`ObjectTarget::check`].
    pub fn check(&self, force: bool) -> Result<()> {
        self.staged.as_ref().map_or(Ok(()), |staged| staged.object.check(force))
    }

    /// The file to write.
    pub fn file(&self) -> &Path {
        self.staged.as_ref().map_or(self.place, |staged| &staged.file)
    }

    /// The object in a store that it is.
    pub fn object(&self) -> Option<&ObjectTarget> {
        self.staged.as_ref().map(|staged| &staged.object)
    }

    /// Brings what was written to where it goes. `progress` counts bytes that are sent; what is a file is there already.
    ///
    /// # Errors
    /// As [`ObjectTarget::put`]. The file is kept then, and the error says where, unless somebody else has changed what it was to replace.
    pub fn finish(self, replace: &Replace, progress: &dyn Progress) -> Result<()> {
        let Some(Staged { object, folder, file }) = self.staged else { return Ok(()) };
        let name = Path::new(file.file_name().unwrap_or_default());
        let target = SendTarget {
            place: self.place,
            force: *replace != Replace::Nothing,
            is_version: matches!(replace, Replace::Version(_)),
        };
        folder.send(name, &target, |folder| {
            object.put(&folder.join(name), replace, &|done, total| watched(progress, done, total))
        })
    }
}

/// Reports, and says whether to go on: for what takes such a function.
pub fn watched(progress: &dyn Progress, done: u64, total: u64) -> ControlFlow<()> {
    progress.report(done, total);
    if progress.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// Refuses what [`change`] cannot change: what lies at an address, but in no store.
///
/// # Errors
/// It is such.
pub fn check_can_change(place: &Path) -> Result<()> {
    match url_of(place) {
        Some(url) if !is_object(place) => {
            Err(Error::unsupported(format!("{url} can only be read: download it to change it")))
        }
        _ => Ok(()),
    }
}

/// Changes a file. An object is fetched, changed here, and put back whole, unless somebody else has changed it meanwhile. Progress counts the bytes
/// that are fetched, and those that are sent.
///
/// # Errors
/// As [`check_can_change`]; those of the change; the store does not answer or refuses, or the object has changed meanwhile. Then it is as it was.
pub fn change<T>(
    place: &Path,
    [fetching, sending]: [&dyn Progress; 2],
    change: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    check_can_change(place)?;
    if !is_object(place) {
        return change(place);
    }
    let target = Target::new(place)?;
    let object = ObjectTarget::at(place)?;
    object.check(true)?;
    let version =
        object.version()?.ok_or_else(|| Error::not_found(format!("there is no {}", place.display())))?;
    fetch(place, target.file(), fetching)?;
    let changed = change(target.file()).map_err(|error| match error.kind() {
        // The folder for temporary files is what cannot be written.
        ErrorKind::Io => error,
        _ => error.renamed(target.file(), place),
    })?;
    target.finish(&Replace::Version(version), sending)?;
    Ok(changed)
}

/// As [`change`], but a file is changed as an object is: by a copy, which takes its place at the end. What a change that fails has made durable goes
/// with the copy. Other hard links keep what was there. Of a file the first progress counts the bytes that are copied.
///
/// # Errors
/// As [`change`]; there is no room for the copy; somebody else changes the file.
pub fn change_copy<T>(
    place: &Path,
    transfers: [&dyn Progress; 2],
    change: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    if is_address(place) {
        return self::change(place, transfers, change);
    }
    let reading = |error| Error::reading(place, error);
    let writing = |error| Error::writing(place, error);
    // Where a symbolic link leads.
    let target = place.canonicalize().map_err(reading)?;
    let _lock = WriterLock::acquire(place)?;
    // What must not be written is not replaced either.
    OpenOptions::new().write(true).open(&target).map_err(writing)?;
    // It is to be written, and so not protected as an input.
    let options = ReadOptions { protect_inputs: false, ..*ReadLimits::current().options() };
    let copy = ReadLimits::new(options).run(|| copy_beside(&target, &target, place, transfers[0]))?;
    let changed = change(&copy).map_err(|error| named(error, &copy, [place; 2]))?;
    let permissions = target.metadata().map_err(reading)?.permissions();
    fs::set_permissions(&copy, permissions).map_err(writing)?;
    persist(copy, &target, true)?;
    Ok(changed)
}

/// Copies an asset and changes the copy, which is called `output` when it is whole. An existing file is replaced if `overwrite` says so. What earlier
/// changes have left unused of the file is not copied where that is more than an eighth.
///
/// # Errors
/// Those of the change; there is no room for the copy; there is a file of that name, or somebody else changes it.
pub fn change_into<T>(
    from: &Path,
    output: &Path,
    overwrite: bool,
    copying: &dyn Progress,
    change: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let replacement = Replacement::begin(output, overwrite)?;
    let gapless = Asset::open(from).ok().filter(|asset| asset.gap_share() > MAX_GAPS_COPIED);
    let copy = match gapless
        .map(|asset| asset.copy_without_gaps(output, &mut |done, total| copied(copying, from, done, total)))
    {
        Some(Ok(copy)) => copy.into_temp_path(),
        Some(Err(error)) if error.kind() == ErrorKind::Io || error.is_cancelled() => return Err(error),
        // Damage is copied, and the change says what is wrong with what is no asset.
        _ => copy_beside(from, output, output, copying)?,
    };
    let changed = change(&copy).map_err(|error| named(error, &copy, [from, output]))?;
    replacement.finish(copy)?;
    Ok(changed)
}

/// A copy in the folder of another file, which goes away unless it is renamed. `name`: what users call what it becomes.
fn copy_beside(from: &Path, beside: &Path, name: &Path, progress: &dyn Progress) -> Result<TempPath> {
    let reading = |error| Error::reading(from, error);
    let writing = |error| Error::writing(name, error);
    let mut copy = temporary_file(beside, ".tmp").map_err(writing)?;
    let original = Arc::new(input::open(from).map_err(reading)?);
    // The header is copied first: what it names is not overwritten by somebody who paints on the asset as long as this is read.
    let _marked = FileSource::from_file(from, Arc::clone(&original));
    let length = original.metadata().map_err(reading)?.len();
    let mut done = 0;
    loop {
        copied(progress, from, done, length.max(done))?;
        let mut part = (&*original).take(COPIED_AT_ONCE);
        match io::copy(&mut part, copy.as_file_mut()).map_err(writing)? {
            0 => return Ok(copy.into_temp_path()),
            count => done += count,
        }
    }
}

/// Reports what is copied of a file, and ends that where it is not wanted any more.
fn copied(progress: &dyn Progress, from: &Path, done: u64, total: u64) -> Result<()> {
    match watched(progress, done, total) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => {
            Err(Error::cancelled(format!("copying {} was ended; nothing was changed", from.display())))
        }
    }
}

/// An error about a copy, which nobody knows, by the name of what it was made from; one in writing to it, by the name that it is to have.
fn named(error: Error, copy: &Path, [from, name]: [&Path; 2]) -> Error {
    if error.path() != Some(copy) || error.kind() != ErrorKind::Io {
        return error.renamed(copy, from);
    }
    let why = error.source().map_or_else(|| "it cannot be written".into(), ToString::to_string);
    let sentence = format!("cannot write {}: {why}; nothing was written", name.display());
    Error::new(ErrorKind::Io, sentence).with_path(name)
}

/// Writes what lies at an address into a new file.
fn fetch(place: &Path, path: &Path, progress: &dyn Progress) -> Result<()> {
    let reading = |error| Error::reading(place, error);
    let writing = |error| Error::writing(path, error);
    let source = open_source(place)?;
    let length = source.length().map_err(reading)?;
    let mut file = File::create(path).map_err(writing)?;
    let mut bytes = vec![0; length.min(FETCHED_AT_ONCE) as usize];
    let mut done = 0;
    progress.report(done, length);
    while done < length {
        if progress.is_cancelled() {
            return Err(Error::cancelled(format!("fetching {} was ended", place.display())));
        }
        let bytes = &mut bytes[..(length - done).min(FETCHED_AT_ONCE) as usize];
        source.read_exact_at(bytes, done).map_err(reading)?;
        file.write_all(bytes).map_err(writing)?;
        done += bytes.len() as u64;
        progress.report(done, length);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn errors_about_copies_name_what_they_were_made_from() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("a.fan");
        fs::write(&place, "asset").unwrap();
        let refuse = |copy: &Path| -> Result<()> {
            let sentence = format!("cannot remove the channel from {}: it has no other", copy.display());
            Err(Error::invalid(sentence).with_path(copy))
        };
        let none = fantex_bake::NoProgress;
        let errors = [
            change_copy(&place, [&none, &none], refuse).unwrap_err(),
            change_into(&place, &folder.path().join("b.fan"), false, &none, refuse).unwrap_err(),
        ];
        for error in errors {
            let sentence = format!("cannot remove the channel from {}: it has no other", place.display());
            assert_eq!((error.to_string(), error.path()), (sentence, Some(&*place)));
        }
    }

    /// Remembers the last report, and wants an end of what it is told of where it is true.
    struct Ending(bool, Mutex<(u64, u64)>);

    impl Progress for Ending {
        fn report(&self, done: u64, total: u64) {
            *self.1.lock().unwrap() = (done, total);
        }

        fn is_cancelled(&self) -> bool {
            self.0
        }
    }

    #[test]
    fn copies_are_reported_and_can_be_ended() {
        let folder = tempfile::tempdir().unwrap();
        let (place, output) = (folder.path().join("a.fan"), folder.path().join("b.fan"));
        fs::write(&place, "asset").unwrap();
        let [goes_on, ends] = [false, true].map(|ends| Ending(ends, Mutex::default()));
        let append = |copy: &Path| {
            fs::write(copy, "changed").unwrap();
            Ok(())
        };
        for error in [
            change_copy(&place, [&ends, &ends], append).unwrap_err(),
            change_into(&place, &output, false, &ends, append).unwrap_err(),
        ] {
            assert!(error.is_cancelled() && error.to_string().contains("a.fan"), "{error}");
        }
        assert_eq!(fs::read(&place).unwrap(), b"asset");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left");
        change_into(&place, &output, false, &goes_on, append).unwrap();
        assert_eq!(*goes_on.1.lock().unwrap(), (5, 5));
        *goes_on.1.lock().unwrap() = (0, 0);
        change_copy(&place, [&goes_on, &goes_on], append).unwrap();
        assert_eq!(*goes_on.1.lock().unwrap(), (5, 5));
        assert_eq!(fs::read(&place).unwrap(), b"changed");
    }

    /// Who paints on it meanwhile would else write over what is still to be copied.
    #[cfg(unix)]
    #[test]
    fn what_is_copied_is_marked_as_being_read() {
        struct Marks(PathBuf, Mutex<Vec<bool>>);
        impl Progress for Marks {
            fn report(&self, _: u64, _: u64) {
                let is_marked = File::open(&self.0).unwrap().try_lock().is_err();
                self.1.lock().unwrap().push(is_marked);
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let marks = Marks(folder.path().join("a.fan"), Mutex::default());
        fs::write(&marks.0, "asset").unwrap();
        change_into(&marks.0, &folder.path().join("b.fan"), false, &marks, |_| Ok(())).unwrap();
        assert_eq!(*marks.1.lock().unwrap(), [true, true]);
        File::open(&marks.0).unwrap().try_lock().unwrap();
    }

    #[test]
    fn addresses_are_told_from_paths() {
        for place in ["s3://a/b", "GS://a/b", "https://a.org/b", "az://a/b"] {
            assert!(is_address(Path::new(place)), "{place}");
        }
        for place in ["a/b", "/a/b", "C:\\a", "a:b", "://a", "a b://c"] {
            assert!(!is_address(Path::new(place)), "{place}");
        }
        for (place, is_it) in
            [("S3://a/b", true), ("az://a/b", true), ("https://a.org/b", false), ("a/b", false)]
        {
            assert_eq!(is_object(Path::new(place)), is_it, "{place}");
        }
    }
}
