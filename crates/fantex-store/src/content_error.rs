//! The rules of the format that contents can break.

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
