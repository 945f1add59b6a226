//! Places that are addresses: results that go to object stores, assets there that are changed, and `file://`.

use std::ffi::OsString;
use std::fs::File;
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use fantex::bake::Progress as _;
use fantex::stream::{ObjectTarget, Replace, open_source};
use fantex::{Error, Result};
use percent_encoding::percent_decode_str;
use tempfile::TempDir;

use crate::context::{Bar, Context};

/// Bytes of an object that are fetched at once, over several connections.
const FETCHED_AT_ONCE: u64 = 24 << 20;

/// Whether a place is no path.
pub(crate) fn is_address(place: &Path) -> bool {
    scheme(place).is_some_and(|scheme| {
        !scheme.is_empty()
            && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"+-.".contains(&byte))
    })
}

/// Whether a place names an object in a store that can be written.
pub(crate) fn is_object(place: &Path) -> bool {
    scheme(place)
        .is_some_and(|scheme| ["s3", "gs", "az"].iter().any(|known| scheme.eq_ignore_ascii_case(known)))
}

/// What stands before `://`.
fn scheme(place: &Path) -> Option<&str> {
    Some(place.to_str()?.split_once("://")?.0)
}

/// Arguments with paths in the place of `file://` addresses (RFC 8089), also after `=`.
pub(crate) fn with_local_files(arguments: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    arguments
        .into_iter()
        .map(|argument| argument.to_str().and_then(local_file).map_or(argument, OsString::from))
        .collect()
}

/// None where there is no such address, or one on another machine.
fn local_file(argument: &str) -> Option<String> {
    const SCHEME: &str = "file://";
    let lower = argument.to_ascii_lowercase();
    let start = match lower.starts_with(SCHEME) {
        true => 0,
        false => lower.find(&format!("={SCHEME}"))? + 1,
    };
    let rest = &argument[start + SCHEME.len()..];
    let path = rest.strip_prefix("localhost").unwrap_or(rest);
    let path = percent_decode_str(path).decode_utf8().ok().filter(|path| path.starts_with('/'))?;
    // The drive follows the slash.
    let path = if cfg!(windows) { &path[1..] } else { &*path };
    Some(format!("{}{path}", &argument[..start]))
}

/// Where a result goes. To a store it goes by a file on this machine, in the folder for temporary files.
#[derive(Debug)]
pub(crate) struct Target<'a> {
    place: &'a Path,
    staged: Option<Staged>,
}

#[derive(Debug)]
struct Staged {
    object: ObjectTarget,
    file: PathBuf,
    /// Goes away with the value.
    _folder: TempDir,
}

impl<'a> Target<'a> {
    /// Ctrl-C has to be [deferred](Context::defer_interrupt) while it lives, so that its file is removed.
    pub(crate) fn new(place: &'a Path) -> Result<Self> {
        if !is_address(place) {
            return Ok(Self { place, staged: None });
        }
        let object = ObjectTarget::at(place)?;
        let folder = Context::temporary_folder()?;
        let file = folder.path().join(place.file_name().unwrap_or_default());
        Ok(Self { place, staged: Some(Staged { object, file, _folder: folder }) })
    }

    /// The file to write.
    pub(crate) fn file(&self) -> &Path {
        self.staged.as_ref().map_or(self.place, |staged| &staged.file)
    }

    /// The object in a store that it is.
    pub(crate) fn object(&self) -> Option<&ObjectTarget> {
        self.staged.as_ref().map(|staged| &staged.object)
    }

    /// Brings what was written to where it goes.
    pub(crate) fn finish(self, replace: &Replace, context: &Context) -> Result<()> {
        let Some(staged) = self.staged else { return Ok(()) };
        let bar = context.progress_of_bytes("uploading");
        staged.object.put(&staged.file, replace, &|done, total| watched(&bar, done, total))
    }
}

/// Shows how far an upload is.
pub(crate) fn watched(bar: &Bar<'_>, done: u64, total: u64) -> ControlFlow<()> {
    bar.report(done, total);
    if bar.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// Changes a file. An object is fetched, changed here, and put back whole, unless somebody else has changed it meanwhile.
pub(crate) fn change<T>(
    place: &Path,
    context: &Context,
    change: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    if !is_object(place) {
        return change(place);
    }
    let _deferral = context.defer_interrupt();
    let target = Target::new(place)?;
    let object = ObjectTarget::at(place)?;
    object.check(true)?;
    let version =
        object.version()?.ok_or_else(|| Error::not_found(format!("there is no {}", place.display())))?;
    fetch(place, target.file(), context)?;
    let changed = change(target.file())?;
    target.finish(&Replace::Version(version), context)?;
    Ok(changed)
}

/// Writes what lies at an address into a new file.
fn fetch(place: &Path, path: &Path, context: &Context) -> Result<()> {
    let reading = |error| Error::reading(place, error);
    let writing = |error| Error::writing(path, error);
    let source = open_source(place)?;
    let length = source.length().map_err(reading)?;
    let bar = context.progress_of_bytes("fetching");
    let mut file = File::create(path).map_err(writing)?;
    let mut bytes = vec![0; length.min(FETCHED_AT_ONCE) as usize];
    let mut done = 0;
    while done < length {
        context.check_interrupt()?;
        let bytes = &mut bytes[..(length - done).min(FETCHED_AT_ONCE) as usize];
        source.read_exact_at(bytes, done).map_err(reading)?;
        file.write_all(bytes).map_err(writing)?;
        done += bytes.len() as u64;
        bar.report(done, length);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[cfg(unix)]
    #[test]
    fn local_addresses_become_paths() {
        for (argument, path) in [
            ("file:///a/b%20c.fan", "/a/b c.fan"),
            ("FILE://localhost/a.fan", "/a.fan"),
            ("--output=file:///a.fan", "--output=/a.fan"),
            ("image=file:///a.png,mapping=box", "image=/a.png,mapping=box"),
        ] {
            assert_eq!(local_file(argument).as_deref(), Some(path));
        }
        for argument in ["file://elsewhere/a.fan", "file:a", "a.fan", "https://a.org/b?c=d"] {
            assert_eq!(local_file(argument), None, "{argument}");
        }
    }
}
