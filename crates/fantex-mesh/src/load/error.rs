//! Why a model could not be loaded.

use std::fmt;
use std::io;
use std::path::PathBuf;

use crate::{GltfProblem, ModelFormat, ObjProblem, PlyProblem, StlProblem, counted};

/// Why a model could not be loaded. Each message is one sentence that names the file and the place.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The operating system refused.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// A folder instead of a file.
    #[error("{} is a folder; name a model file in it", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
    },
    /// More bytes than [`LoadLimits::max_file_bytes`](crate::LoadLimits::max_file_bytes).
    #[error("{} has {bytes} bytes, more than the limit of {limit}", path.display())]
    FileTooLarge {
        /// The file.
        path: PathBuf,
        /// Its length (at least).
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// The file does not fit into memory.
    #[error("{} has {bytes} bytes, more than there is memory for", path.display())]
    OutOfMemory {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// A file without a byte in it.
    #[error("{} is empty", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The content is of a known kind that is not a model fantex reads.
    #[error("{} is {found}, not a model that fantex reads; convert it to glTF, GLB, OBJ, PLY or STL", path.display())]
    NotAModel {
        /// The file.
        path: PathBuf,
        /// What it is, with its article.
        found: &'static str,
    },
    /// The extension promises a format that the content is not.
    #[error("{} is named like {named} file, but its content is not: {expected}", path.display(), named = named.with_article())]
    Mislabelled {
        /// The file.
        path: PathBuf,
        /// The format that the extension names.
        named: ModelFormat,
        /// What such a file would look like.
        expected: &'static str,
    },
    /// Neither content nor extension name a format.
    #[error("{} is in no format that fantex knows: its content does not tell, and its extension is none of .gltf, .glb, .obj, .ply, .stl", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// More triangles or positions than [`LoadLimits`](crate::LoadLimits) allow.
    #[error("{} has {count} {quantity}, more than the limit of {limit}", path.display())]
    TooMany {
        /// The file.
        path: PathBuf,
        /// What there is too much of.
        quantity: Quantity,
        /// How many there are (at least).
        count: usize,
        /// The limit.
        limit: usize,
    },
    /// The file was read, but there is no triangle in it.
    #[error("{} holds no triangles, only {}{notes}", path.display(), counted(*positions, "position"))]
    NoTriangles {
        /// The file.
        path: PathBuf,
        /// Positions without a triangle.
        positions: usize,
        /// What was skipped.
        notes: NoteList,
    },
    /// A glTF or GLB file is wrong.
    #[error("{}: {problem}", path.display())]
    Gltf {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: GltfProblem,
    },
    /// An OBJ or MTL file is wrong.
    #[error("{}, line {line}: {problem}", path.display())]
    Obj {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        problem: ObjProblem,
    },
    /// A PLY file is wrong.
    #[error("{}: {problem}", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: PlyProblem,
    },
    /// An STL file is wrong.
    #[error("{}: {problem}", path.display())]
    Stl {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: StlProblem,
    },
}

/// What [`LoadError::TooMany`] counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Triangles after cutting polygons.
    Triangles,
    /// Positions.
    Positions,
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Triangles => "triangles",
            Self::Positions => "positions",
        })
    }
}

/// A loader's notes, shown as `(first; second)`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NoteList(pub Vec<String>);

impl fmt::Display for NoteList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.is_empty() {
            true => Ok(()),
            false => write!(f, " ({})", self.0.join("; ")),
        }
    }
}
