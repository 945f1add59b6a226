//! Errors, one enum per operation.

use std::path::PathBuf;

use crate::PageId;

/// Texels could not be encoded: the caller's mistake.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// Not a rectangle of whole 4x4 blocks.
    #[error("cannot encode {0}x{1} texels: both sides must be positive multiples of 4")]
    Extent(u32, u32),
    /// More or fewer texels than the extent says.
    #[error("cannot encode {width}x{height} texels: {given} were given")]
    TexelCount {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Texels in the slice.
        given: usize,
    },
}

/// Bytes could not be decoded into texels.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// Not a rectangle of whole 4x4 blocks.
    #[error("cannot decode {0}x{1} texels: both sides must be positive multiples of 4")]
    Extent(u32, u32),
    /// More or fewer bytes than the extent and format need.
    #[error("{width}x{height} texels take {expected} bytes, but there are {given}")]
    ByteCount {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// What they take.
        expected: usize,
        /// What there is.
        given: usize,
    },
}

/// An asset could not be created. Nothing is left behind: the temporary file is removed when the writer is dropped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CreateError {
    /// The target exists and overwriting was not asked for.
    #[error("{} exists already; pass --force to overwrite it", .0.display())]
    Exists(PathBuf),
    /// The system refused.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// The asset's path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The mesh, cover or channels break a rule of the format.
    #[error("cannot write {}: {source}", path.display())]
    Content {
        /// The asset's path.
        path: PathBuf,
        /// Which rule.
        source: ContentError,
    },
    /// A page came out of turn.
    #[error("cannot write {}: page ({got}) came where ({expected}) was due", path.display())]
    Order {
        /// The asset's path.
        path: PathBuf,
        /// What was due.
        expected: PageId,
        /// What came.
        got: PageId,
    },
    /// A page after the last.
    #[error("cannot write {}: page ({got}) is not part of the cover", path.display())]
    NoSuchPage {
        /// The asset's path.
        path: PathBuf,
        /// What came.
        got: PageId,
    },
    /// A page's channel has the wrong number of bytes, or channels are missing.
    #[error("cannot write {}: page ({page}) needs {expected:?} bytes per channel, but has {got:?}", path.display())]
    PageBytes {
        /// The asset's path.
        path: PathBuf,
        /// Which page.
        page: PageId,
        /// Bytes due per channel.
        expected: Vec<usize>,
        /// Bytes given per channel.
        got: Vec<usize>,
    },
    /// `finish` before the last page.
    #[error("cannot finish {}: page ({missing}) has not been written", path.display())]
    Incomplete {
        /// The asset's path.
        path: PathBuf,
        /// The first one missing.
        missing: PageId,
    },
    /// Not one mean per group and channel.
    #[error("cannot finish {}: {expected} means are due (one per group and channel), {got} were given", path.display())]
    Means {
        /// The asset's path.
        path: PathBuf,
        /// Groups times channels.
        expected: usize,
        /// Given.
        got: usize,
    },
}

/// A rule that mesh, cover, channels or directory of an asset break.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ContentError {}

/// An asset could not be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The system refused.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The asset's path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// A page could not be read. Cloneable, so that caches can keep it.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageError {
    /// The asset has no such page or channel: the caller's mistake.
    #[error("{} has no page ({page}) in channel {channel}", path.display())]
    NoSuchPage {
        /// The asset's path.
        path: PathBuf,
        /// Channel index.
        channel: usize,
        /// The page.
        page: PageId,
    },
}
