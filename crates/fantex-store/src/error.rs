//! Errors, one enum per operation.

use std::path::PathBuf;
use std::sync::Arc;

use crate::{ContentError, PageId};

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
    /// Some other kind of file.
    #[error("{} is not a .fan asset: it does not start with the asset signature", path.display())]
    NotAnAsset {
        /// The file's path.
        path: PathBuf,
    },
    /// A later format.
    #[error(
        "{} has format version {version}, flags {flags:#x}; this program reads version {supported}, flags 0: \
         use a newer program",
        path.display()
    )]
    Version {
        /// The asset's path.
        path: PathBuf,
        /// Its version.
        version: u32,
        /// Its feature flags.
        flags: u32,
        /// The version that this program reads.
        supported: u32,
    },
    /// Neither header slot is whole.
    #[error("{} is damaged: neither of its two headers has a valid checksum; bake it anew", path.display())]
    Header {
        /// The asset's path.
        path: PathBuf,
    },
    /// Shorter than its header says.
    #[error("{} is truncated: {length} bytes of {expected}; copy or bake it anew", path.display())]
    Truncated {
        /// The asset's path.
        path: PathBuf,
        /// Bytes there are.
        length: u64,
        /// Bytes its header records.
        expected: u64,
    },
    /// A section lies outside of the file.
    #[error("{} is damaged: its {section} section claims bytes {offset} to {end}", path.display())]
    SectionPlace {
        /// The asset's path.
        path: PathBuf,
        /// Which section.
        section: &'static str,
        /// Its start.
        offset: u64,
        /// Its end.
        end: u64,
    },
    /// A section's checksum is wrong.
    #[error("{} is damaged: its {section} section has a wrong checksum; copy or bake it anew", path.display())]
    SectionChecksum {
        /// The asset's path.
        path: PathBuf,
        /// Which section.
        section: &'static str,
    },
    /// A section does not unpack to what the header says.
    #[error("{} is damaged: its {section} section does not unpack to {expected} bytes", path.display())]
    SectionPacking {
        /// The asset's path.
        path: PathBuf,
        /// Which section.
        section: &'static str,
        /// Bytes expected.
        expected: u64,
    },
    /// A section breaks a rule of the format.
    #[error("{} cannot be used: in its {section} section {source}", path.display())]
    Content {
        /// The asset's path.
        path: PathBuf,
        /// Which section.
        section: &'static str,
        /// Which rule.
        source: ContentError,
    },
}

/// An attachment could not be read. Cloneable: an asset keeps what was wrong with the list.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AttachmentError {
    /// The list of attachments is damaged.
    #[error("the attachments of {} cannot be read; its texels can: {source}", path.display())]
    List {
        /// The asset's path.
        path: PathBuf,
        /// What is wrong with the list.
        source: Arc<OpenError>,
    },
    /// One of them is damaged.
    #[error("attachment {name:?} of {} cannot be read: {source}", path.display())]
    Damaged {
        /// The asset's path.
        path: PathBuf,
        /// Its name.
        name: String,
        /// What is wrong.
        source: Arc<OpenError>,
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
    /// The system refused.
    #[error("cannot read {} bytes at byte {offset} of {}: {source}", length, path.display())]
    Io {
        /// The asset's path.
        path: PathBuf,
        /// Start of the cluster.
        offset: u64,
        /// Its length.
        length: u64,
        /// Why.
        source: Arc<std::io::Error>,
    },
    /// The stored bytes changed since they were written.
    #[error("{} is damaged: the cluster at byte {offset} has a wrong checksum", path.display())]
    Checksum {
        /// The asset's path.
        path: PathBuf,
        /// Start of the cluster.
        offset: u64,
    },
    /// A cluster does not unpack to its pages.
    #[error("{} is damaged: the cluster at byte {offset} does not unpack to {expected} bytes", path.display())]
    Packing {
        /// The asset's path.
        path: PathBuf,
        /// Start of the cluster.
        offset: u64,
        /// Bytes expected.
        expected: u64,
    },
}
