//! Errors, one enum per operation.

use std::path::PathBuf;
use std::sync::Arc;

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

/// A rule that mesh, cover, channels or directory of an asset break.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ContentError {
    /// The bytes end too early.
    #[error("the data end after {offset} bytes, within {what}")]
    Ends {
        /// What was being read.
        what: &'static str,
        /// Where the data end, bytes from the section's start.
        offset: usize,
    },
    /// The bytes do not end where they should.
    #[error("{count} bytes are left over at the end")]
    TrailingBytes {
        /// How many.
        count: usize,
    },
    /// More than the format's limits allow.
    #[error("there are {count} {what}, but at most {limit} are allowed")]
    TooMany {
        /// What was counted.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// How many there may be.
        limit: u64,
    },
    /// Not as many as something else demands.
    #[error("there are {got} {what}, but {expected} are due")]
    Count {
        /// What was counted.
        what: &'static str,
        /// How many there should be.
        expected: u64,
        /// How many there are.
        got: u64,
    },
    /// An index or code beyond its range.
    #[error("{what} {index} is {value}, but must be below {limit}")]
    OutOfRange {
        /// What the value is.
        what: &'static str,
        /// Which of them.
        index: usize,
        /// The value.
        value: u64,
        /// First value that is too large.
        limit: u64,
    },
    /// NaN or infinite.
    #[error("{what} {index} is not a finite number")]
    NotFinite {
        /// What the value is.
        what: &'static str,
        /// Which of them.
        index: usize,
    },
    /// A triangle uses a vertex twice.
    #[error("triangle {triangle} uses a vertex more than once")]
    Degenerate {
        /// Which.
        triangle: usize,
    },
    /// A parameter outside its range.
    #[error("{what} is {value}, but must lie within {range}")]
    Parameter {
        /// What the value is.
        what: &'static str,
        /// The value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// A tile extent that is no multiple of 4 or out of limits.
    #[error(
        "group {group} has a tile of {}x{} texels; both sides must be multiples of 4 up to {limit}",
        extent[0],
        extent[1]
    )]
    Extent {
        /// Which group.
        group: usize,
        /// Its extent.
        extent: [u32; 2],
        /// Longest side.
        limit: u32,
    },
    /// Items are not in their order.
    #[error("{what} {index} is out of order")]
    Order {
        /// What is ordered.
        what: &'static str,
        /// The first one out of order.
        index: usize,
    },
    /// The coordinates of unfolded fans do not match the groups that need them.
    #[error("corner {corner} has unfolded coordinates, but its group is projected")]
    NotUnfolded {
        /// Corner index.
        corner: u32,
    },
    /// sRGB with a format of one or two channels.
    #[error("channel {channel} is sRGB-encoded, which formats of one or two channels cannot be")]
    Srgb {
        /// Channel index.
        channel: usize,
    },
    /// A name that is not UTF-8.
    #[error("the name of material {material} is not valid UTF-8")]
    Name {
        /// Material index.
        material: usize,
    },
    /// A cluster lies where it cannot.
    #[error(
        "cluster {cluster} claims bytes {offset} to {end}, but clusters start at multiples of 4096 within bytes \
         {first} to {last}"
    )]
    ClusterPlace {
        /// Cluster index.
        cluster: usize,
        /// Its start.
        offset: u64,
        /// Its end.
        end: u64,
        /// First byte that clusters may use.
        first: u64,
        /// End of the bytes that clusters may use.
        last: u64,
    },
    /// A cluster's recorded length differs from that of its pages.
    #[error(
        "cluster {cluster} records {got} bytes, but its pages take {expected} (at most {limit} are allowed)"
    )]
    ClusterLength {
        /// Cluster index within its level.
        cluster: usize,
        /// Bytes of its pages, as far as counted.
        expected: u64,
        /// Bytes recorded.
        got: u64,
        /// Bytes allowed.
        limit: u64,
    },
}

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
    pub(crate) fn write(path: PathBuf, source: std::io::Error) -> Self {
        use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        match source.kind() {
            StorageFull | QuotaExceeded | FileTooLarge => Self::Full { path, source },
            _ => Self::Io { path, source },
        }
    }
}
