//! Sentences of errors that are made in more than one place.

use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use fantex_base::{Error, ErrorKind, counted};

use crate::PageId;

/// True where a write failed because no room was left, so that it may be tried again later.
pub fn is_disk_full(error: &Error) -> bool {
    io_cause(error).is_some_and(says_full)
}

/// What the system said, where that is why.
pub fn io_cause(error: &Error) -> Option<&io::Error> {
    let source = std::error::Error::source(error)?;
    source.downcast_ref().or_else(|| source.downcast_ref().map(Arc::as_ref))
}

fn says_full(error: &io::Error) -> bool {
    use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge)
}

/// An asset could not be changed. The file holds its last committed state, and changes stay with the editor.
pub fn write_error(path: &Path, source: io::Error) -> Error {
    let sentence = if says_full(&source) {
        format!(
            "no space is left for {}: {source}; nothing is lost: its last committed state stays, and the changes can be \
             committed once there is room",
            path.display()
        )
    } else {
        format!("cannot write {}: {source}; its last committed state stays", path.display())
    };
    Error::new(ErrorKind::Io, sentence).with_path(path).with_source(source)
}

pub(crate) fn invalid(path: &Path, sentence: String) -> Error {
    Error::invalid(sentence).with_path(path)
}

/// `PATH is damaged: ...`.
pub(crate) fn damaged(path: &Path, what: impl std::fmt::Display) -> Error {
    Error::damaged(format!("{} is damaged: {what}", path.display())).with_path(path)
}

pub(crate) fn no_such_page(path: &Path, channel: usize, page: PageId) -> Error {
    invalid(path, format!("{} has no page ({page}) in channel {channel}", path.display()))
}

// Rules of the format that contents can break.

pub(crate) fn ends(what: &str, offset: usize) -> Error {
    Error::malformed(format!("the data end after {}, within {what}", counted(offset, "byte")))
}

pub(crate) fn too_many(what: &str, count: u64, limit: u64) -> Error {
    Error::too_large(format!("there are {count} {what}, but at most {limit} are allowed"))
}

pub(crate) fn wrong_count(what: &str, expected: u64, got: u64) -> Error {
    Error::malformed(format!("there are {got} {what}, but {expected} are due"))
}

pub(crate) fn out_of_range(what: &str, index: usize, value: u64, limit: u64) -> Error {
    Error::malformed(format!("{what} {index} is {value}, but must be below {limit}"))
}

pub(crate) fn not_finite(what: &str, index: usize) -> Error {
    Error::malformed(format!("{what} {index} is not a finite number"))
}

pub(crate) fn out_of_order(what: &str, index: usize) -> Error {
    Error::malformed(format!("{what} {index} is out of order"))
}

/// `places`: where such parts may lie.
pub(crate) fn misplaced(what: &str, index: usize, claimed: Range<u64>, places: &Range<u64>) -> Error {
    Error::malformed(format!(
        "{what} {index} claims bytes {} to {}, but must start at a multiple of 4096 and lie within bytes {} to {}",
        claimed.start, claimed.end, places.start, places.end
    ))
}

pub(crate) fn wrong_cluster_length(cluster: usize, expected: u64, got: u64, limit: u64) -> Error {
    Error::malformed(format!(
        "cluster {cluster} records {got} bytes, but its pages take {expected} (at most {limit} are allowed)"
    ))
}
