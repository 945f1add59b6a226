//! What can go wrong while an asset is edited.

use std::path::PathBuf;

use crate::{AttachmentError, CreateError, OpenError, PageError, PageId};

/// An asset could not be changed. Whatever is said here, the file holds its last committed state, and changes that are not
/// committed stay with the editor, so that [`commit`](crate::AssetEditor::commit) can be tried again.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// Another writer is at work.
    #[error("{} is being edited by another program; close it there first", path.display())]
    Locked {
        /// The asset's path.
        path: PathBuf,
    },
    /// It cannot be read.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The part of it that is to be changed cannot be read.
    #[error(transparent)]
    Page(#[from] PageError),
    /// Its attachments cannot be read.
    #[error(transparent)]
    Attachment(#[from] AttachmentError),
    /// A new file could not be written.
    #[error(transparent)]
    Create(#[from] CreateError),
    /// No room.
    #[error(
        "no space is left for {}: {source}; nothing is lost: its last committed state stays, and the changes can be \
         committed once there is room",
        path.display()
    )]
    Full {
        /// The asset's path.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The system refused.
    #[error("cannot write {}: {source}; its last committed state stays", path.display())]
    Io {
        /// The asset's path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Someone put another file in its place.
    #[error("{} was replaced or removed while it was edited; the changes cannot be saved there", path.display())]
    Replaced {
        /// The asset's path.
        path: PathBuf,
    },
    /// A page's channel has the wrong number of bytes.
    #[error(
        "cannot change {}: page ({page}) takes {expected} bytes in channel {channel}, but {got} were given",
        path.display()
    )]
    PageBytes {
        /// The asset's path.
        path: PathBuf,
        /// Which page.
        page: PageId,
        /// Which channel.
        channel: usize,
        /// Bytes due.
        expected: usize,
        /// Bytes given.
        got: usize,
    },
    /// An attachment beyond the limits.
    #[error(
        "attachment {name:?} has {bytes} bytes; names may have up to 255 and contents up to {limit} bytes"
    )]
    AttachmentSize {
        /// Its name.
        name: String,
        /// Bytes of its contents.
        bytes: u64,
        /// Bytes that it may have.
        limit: u64,
    },
}

impl EditError {
    /// From a failed write.
    pub(super) fn write(path: PathBuf, source: std::io::Error) -> Self {
        use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        match source.kind() {
            StorageFull | QuotaExceeded | FileTooLarge => Self::Full { path, source },
            _ => Self::Io { path, source },
        }
    }
}
