//! PLY, ASCII and binary of both endiannesses (G. Turk, "The PLY Polygon File Format", 1994).
//!
//! The parser is our own because the kept crate (ply-rs-bw) reads every row into a map from property names to tagged
//! values and every list into a vector of its own: 7.2 s for a binary file of 2 million triangles, of which this one takes
//! 0.2 s.
//!
//! ```text
//!  header --> layout of elements --> rows: a binary or an ASCII source of numbers --> vertices, faces --> Model
//! ```
//!
//! Read are vertex positions, normals, colours (`red green blue alpha`, `diffuse_*` or `r g b`: bytes or 0..1, sRGB),
//! texture coordinates (`s t`, `u v`, `texture_u texture_v`), faces with any number of corners, their texture
//! coordinates (`texcoord`) and colours, triangle strips, and `comment TextureFile NAME`. The rest is skipped.

mod body;
mod build;
mod header;
mod source;

use super::{LoadError, SourceFile};
use crate::{Model, counted};

/// What is wrong with a PLY file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlyProblem {
    /// A header line that the format does not know.
    #[error("header line {line}: expected {expected}, found {found:?}")]
    Header {
        /// Line, from 1.
        line: usize,
        /// What the format prescribes here.
        expected: &'static str,
        /// What stands there.
        found: String,
    },
    /// No `end_header` within the file.
    #[error("its header has no end (no line end_header, or a line longer than any header's)")]
    HeaderEnd,
    /// The file is too short for what the header announces.
    #[error(
        "its header announces {} {element:?}, at least {needed} bytes, but only {left} follow; it is truncated or damaged",
        counted(*count, "element")
    )]
    Count {
        /// Name of the element.
        element: String,
        /// Elements announced.
        count: u64,
        /// Bytes they take at least.
        needed: u64,
        /// Bytes that follow the header (or the elements before).
        left: u64,
    },
    /// The data ends early.
    #[error("the file ends in {element} {row} of {count}; it is truncated or damaged")]
    Truncated {
        /// Name of the element.
        element: String,
        /// Row, from 0.
        row: u64,
        /// Rows announced.
        count: u64,
    },
    /// A word of an ASCII file is not a number.
    #[error("{element} {row}, line {line}: expected a number, found {found:?}")]
    Number {
        /// Name of the element.
        element: String,
        /// Row, from 0.
        row: u64,
        /// Line, from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// No element `vertex` with properties x, y and z.
    #[error("it has no element vertex with properties x, y and z")]
    NoPositions,
    /// A face refers to a vertex that is not there.
    #[error("face {face} refers to vertex {index}, but there are {count} (counting starts at 0)")]
    Index {
        /// Face (or strip), from 0.
        face: u64,
        /// The index as written.
        index: i64,
        /// Vertices in the file.
        count: usize,
    },
    /// A polygon beyond [`LoadLimits::max_face_corners`](crate::LoadLimits::max_face_corners).
    #[error("face {face} has {corners} corners, more than the limit of {limit}")]
    FaceTooLarge {
        /// Face, from 0.
        face: u64,
        /// Its corners.
        corners: u64,
        /// The limit.
        limit: usize,
    },
}

/// Loads a PLY file.
pub(super) fn load(file: &SourceFile) -> Result<Model, LoadError> {
    let header = header::parse(file.bytes).map_err(|problem| located(file, problem))?;
    let content = body::read(file, &header)?;
    build::build(file, &header, content)
}

fn located(file: &SourceFile, problem: PlyProblem) -> LoadError {
    LoadError::Ply { path: file.path.into(), problem }
}
