//! What painting fails with: sentences that several places share. What was committed before a failure stays.

use std::error::Error as StdError;
use std::io;
use std::path::Path;

use fantex_base::{Error, ErrorKind, Result};
use fantex_store::{Asset, io_cause, is_disk_full};
use serde::Serialize;

/// The temporary files of a stroke cannot be written or read. They have no path.
pub(crate) fn temporary(source: io::Error) -> Error {
    let sentence = format!(
        "cannot keep the stroke's pages in a temporary file: {source}; free some space or raise the memory budget"
    );
    Error::new(ErrorKind::Io, sentence).with_source(source)
}

/// That the asset's disk is full, as somebody needs to know it whose changes go with the [`Painter`](crate::Painter); other errors, that of the disk
/// of temporary files among them, as they are.
pub fn without_room(error: Error, asset: &Path) -> Error {
    let is_of_asset = error.path().is_some();
    match io_cause(&error).filter(|_| is_of_asset && is_disk_full(&error)) {
        Some(cause) => {
            let asset_text = asset.display();
            let sentence = format!(
                "no space is left for {asset_text}: {cause}; nothing was painted, the asset is as it was; make room, then apply the \
                 strokes again"
            );
            Error::new(ErrorKind::Io, sentence).with_path(asset)
        }
        None => error,
    }
}

/// What an asset keeps beside its texels cannot be understood.
pub(crate) fn damaged(asset: &Asset, what: &str, reason: &str) -> Error {
    let path = asset.path();
    let sentence =
        format!("the {what} of {} is damaged: {reason}; the texels are not affected", path.display());
    Error::damaged(sentence).with_path(path)
}

/// Something of another crate that failed: its kind is lost, its sentence stays.
pub(crate) fn malformed(source: impl StdError + Send + Sync + 'static) -> Error {
    Error::malformed(source.to_string()).with_source(source)
}

/// A value as JSON, for an attachment.
pub(crate) fn encoded(value: &impl Serialize) -> Result<Vec<u8>> {
    serde_json::to_vec(value).map_err(malformed)
}
