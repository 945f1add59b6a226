//! What can be wrong with a glTF file.

use crate::counted;

/// What is wrong with a glTF or GLB file.
#[derive(Debug, thiserror::Error)]
pub enum GltfProblem {
    /// The GLB container is damaged.
    #[error("at byte {offset}: expected {expected}; the file is truncated or damaged")]
    Container {
        /// Where.
        offset: usize,
        /// What the format prescribes there.
        expected: &'static str,
    },
    /// A GLB container of another version.
    #[error("it is a GLB container of version {version}, but fantex reads version 2")]
    ContainerVersion {
        /// The version.
        version: u32,
    },
    /// The JSON text is broken or says something that glTF does not allow.
    #[error("its JSON does not describe a glTF model: {0}")]
    Json(serde_json::Error),
    /// Another version of glTF.
    #[error("it is glTF of version {version:?}, but fantex reads 2.0")]
    Version {
        /// The version as written.
        version: String,
    },
    /// The file cannot be understood without these extensions.
    #[error("it requires {}, which fantex does not read; export it without", extensions.join(", "))]
    RequiredExtensions {
        /// Their names.
        extensions: Vec<String>,
    },
    /// A reference to something that is not there.
    #[error("{from} refers to {what} {index}, but there are {count} (counting starts at 0)")]
    Index {
        /// Where the reference stands.
        from: String,
        /// What it refers to.
        what: &'static str,
        /// The index as written.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A buffer cannot be used.
    #[error("buffer {buffer}: {problem}")]
    Buffer {
        /// Its index.
        buffer: usize,
        /// What is wrong.
        problem: BufferProblem,
    },
    /// A buffer view reaches beyond its buffer.
    #[error("buffer view {view} covers bytes {offset} to {end} of buffer {buffer}, which has {length}")]
    View {
        /// Its index.
        view: usize,
        /// Its buffer.
        buffer: usize,
        /// First byte.
        offset: usize,
        /// Byte after the last.
        end: u128,
        /// Bytes of the buffer.
        length: usize,
    },
    /// An accessor cannot be used.
    #[error("accessor {accessor}: {problem}")]
    Accessor {
        /// Its index.
        accessor: usize,
        /// What is wrong.
        problem: AccessorProblem,
    },
    /// An attribute that has not one value per position.
    #[error("{primitive} has {}, but {} of {attribute}", counted(*positions, "position"), counted(*count, "value"))]
    AttributeCount {
        /// Which primitive.
        primitive: String,
        /// Its positions.
        positions: usize,
        /// The attribute.
        attribute: String,
        /// Its values.
        count: usize,
    },
    /// A vertex index beyond the primitive's positions.
    #[error("{primitive} refers to vertex {index}, but it has {count} (counting starts at 0)")]
    Vertex {
        /// Which primitive.
        primitive: String,
        /// The index.
        index: u32,
        /// Its positions.
        count: usize,
    },
    /// A primitive mode that glTF does not define.
    #[error("{primitive} has the unknown mode {mode}; modes are 0 to 6")]
    Mode {
        /// Which primitive.
        primitive: String,
        /// The mode.
        mode: u64,
    },
    /// Attributes of instances that do not agree on how many there are.
    #[error("node {node} has {} of {} for its instances, but {} of {}", counted(counts[0].1, "value"), counts[0].0, counts[1].1, counts[1].0)]
    InstanceCount {
        /// Its index.
        node: usize,
        /// Two attributes that differ, with their counts.
        counts: [(&'static str, usize); 2],
    },
    /// A node that is its own ancestor or has several parents.
    #[error("node {node} is reached twice; nodes must form a tree")]
    NodeReachedTwice {
        /// Its index.
        node: usize,
    },
    /// An image without data.
    #[error("image {image}: {problem}")]
    Image {
        /// Its index.
        image: usize,
        /// What is wrong.
        problem: BufferProblem,
    },
}

/// Why the bytes of a buffer or image cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum BufferProblem {
    /// Neither a URI nor, for the first buffer of a GLB file, a binary chunk; for an image no buffer view either.
    #[error("it names no data (no URI, and no binary chunk or buffer view stands for it)")]
    NoData,
    /// Shorter than `byteLength`.
    #[error("it should have {}, but there are {found}", counted(*expected, "byte"))]
    TooShort {
        /// `byteLength`.
        expected: usize,
        /// Bytes there are.
        found: usize,
    },
    /// All buffers together exceed [`LoadLimits::max_file_bytes`](crate::LoadLimits::max_file_bytes).
    #[error("the buffers up to this one have more than {limit} bytes, the limit for one file")]
    TooLarge {
        /// The limit.
        limit: u64,
    },
    /// A data URI that cannot be decoded.
    #[error("its data URI is broken: {0}")]
    DataUri(&'static str),
    /// An absolute path or a network address.
    #[error("its URI {uri:?} is not relative; put the file beside the model and name it by a relative path")]
    NotRelative {
        /// The URI, shortened.
        uri: String,
    },
    /// The file beside the model cannot be read.
    #[error(transparent)]
    File(Box<crate::LoadError>),
}

/// What is wrong with an accessor.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AccessorProblem {
    /// A component type that glTF does not define.
    #[error("unknown component type {0}")]
    ComponentType(u64),
    /// Not the shape or component type that its use needs.
    #[error("it holds {found}, but {used_for} needs {expected}")]
    Shape {
        /// What it is used for.
        used_for: String,
        /// What it holds.
        found: String,
        /// What is needed.
        expected: &'static str,
    },
    /// The data lie outside their buffer view.
    #[error(
        "it needs {needed} bytes for {}, but buffer view {view} has {available} from its offset on",
        counted(*count, "element")
    )]
    Range {
        /// Elements.
        count: usize,
        /// Bytes they take.
        needed: u128,
        /// The buffer view.
        view: usize,
        /// Bytes from the accessor's offset on.
        available: usize,
    },
    /// A stride shorter than an element.
    #[error("buffer view {view} has a stride of {}, shorter than an element of {element}", counted(*stride, "byte"))]
    Stride {
        /// The buffer view.
        view: usize,
        /// Its stride.
        stride: usize,
        /// Bytes of an element.
        element: usize,
    },
    /// A sparse index beyond the accessor's elements.
    #[error("its sparse data replace element {index}, but it has {count}")]
    SparseIndex {
        /// The index.
        index: u32,
        /// The accessor's elements.
        count: usize,
    },
    /// More elements than [`LoadLimits::max_positions`](crate::LoadLimits::max_positions) allows.
    #[error("it announces {count} elements, more than the limit of {limit}")]
    TooMany {
        /// Elements.
        count: usize,
        /// The limit.
        limit: usize,
    },
}
