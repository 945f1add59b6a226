//! Wavefront OBJ with MTL ("Object Files (.obj)", Advanced Visualizer manual, appendix B1, Wavefront, about 1992).
//!
//! The parser is our own because the common crate (tobj) cuts every polygon into a fan, which is wrong for concave ones,
//! reports errors without their line, and takes four times as long (3.6 s against 0.9 s for 2 million triangles).
//!
//! ```text
//!  text --parse--> ObjText (numbers and faces as written) --build--> Model
//!  MTL  --mtl----> materials, images --------------------------^
//! ```

mod build;
mod mtl;
mod parse;

use super::{LoadError, SourceFile};
use crate::{Model, counted};

/// What is wrong with a line of an OBJ or MTL file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ObjProblem {
    /// Not a number.
    #[error("expected a number, found {found:?}")]
    Number {
        /// What stands there.
        found: String,
    },
    /// Too few numbers.
    #[error("{keyword} needs at least {}, but has {found}", counted(*needed, "number"))]
    TooFewNumbers {
        /// The line's first word.
        keyword: &'static str,
        /// How many it needs.
        needed: usize,
        /// How many there are.
        found: usize,
    },
    /// A face corner that is not `position/coordinate/normal`.
    #[error("expected a face corner like 1, 1/2, 1//3 or 1/2/3, found {found:?}")]
    Corner {
        /// What stands there.
        found: String,
    },
    /// An index of 0, or one beyond what the file defines.
    #[error(
        "the face refers to {what} {index}, but there are {count} (counting starts at 1, or at -1 backwards)"
    )]
    Index {
        /// `position`, `texture coordinate` or `normal`.
        what: &'static str,
        /// The index as written.
        index: i64,
        /// How many the file defines (for a negative index: up to this line).
        count: usize,
    },
    /// A polygon beyond [`LoadLimits::max_face_corners`](crate::LoadLimits::max_face_corners).
    #[error("the face has {corners} corners, more than the limit of {limit}")]
    FaceTooLarge {
        /// Its corners.
        corners: usize,
        /// The limit.
        limit: usize,
    },
    /// An MTL property before the first `newmtl`.
    #[error("{keyword} stands before the first newmtl")]
    NoMaterial {
        /// The line's first word.
        keyword: String,
    },
}

/// Loads an OBJ file and the MTL files beside it that it names.
pub(super) fn load(file: &SourceFile) -> Result<Model, LoadError> {
    let text = parse::parse(file)?;
    let library = mtl::load_libraries(file, &text.libraries)?;
    build::build(file, text, library)
}

/// The words of a line, up to white space.
fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

fn number(word: &[u8]) -> Result<f64, ObjProblem> {
    // Rust's own parser rounds correctly and takes "nan" and "inf", which cleaning deals with.
    let parsed = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok());
    parsed.ok_or_else(|| ObjProblem::Number { found: shown(word) })
}

/// A piece of the file for a message, shortened.
fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned()
}

/// What ends the lines of a text: a line feed, maybe after a carriage return, or, in files of old systems, which hold no line
/// feed at all, a carriage return.
fn line_end(text: &[u8]) -> u8 {
    if text.contains(&b'\n') { b'\n' } else { b'\r' }
}
