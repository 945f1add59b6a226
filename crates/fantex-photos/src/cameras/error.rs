//! Why cameras could not be read or written.

use std::io;
use std::path::PathBuf;

use super::CameraProblem;

/// Why the cameras of a set of photographs could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadCamerasError {
    /// The operating system refused.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// No set of cameras where one was looked for.
    #[error(
        "{} holds no cameras: expected cameras.bin and images.bin, or cameras.txt and images.txt, in it or in its \
         folder sparse/0, or a transforms.json", path.display()
    )]
    NoCameras {
        /// The folder.
        path: PathBuf,
    },
    /// More bytes than are read.
    #[error("{} has {bytes} bytes, more than the limit of {limit}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// A text file is wrong.
    #[error("{}, line {line}: {problem}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        problem: EntryProblem,
    },
    /// A binary file is wrong.
    #[error("{}, byte {byte}: {problem}", path.display())]
    Binary {
        /// The file.
        path: PathBuf,
        /// Where the entry or number begins, from 0.
        byte: u64,
        /// What is wrong.
        problem: EntryProblem,
    },
    /// A JSON file is wrong; the parser names line and column.
    #[error("{} is no transforms.json: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What the parser found.
        source: serde_json::Error,
    },
    /// What a JSON file says about how its cameras were moved cannot be undone.
    #[error(
        "{}: its applied_transform is not a rotation and a translation, or its applied_scale is not positive; leave out \
         frame=original and bring the model into the coordinates of the cameras", path.display()
    )]
    AppliedTransform {
        /// The file.
        path: PathBuf,
    },
    /// A frame of a JSON file is wrong.
    #[error("{}, frame {frame}: {problem}", path.display())]
    Frame {
        /// The file.
        path: PathBuf,
        /// Its index, from 0.
        frame: usize,
        /// What is wrong.
        problem: EntryProblem,
    },
    /// Cameras, but not one photograph.
    #[error("{} names no photograph", path.display())]
    NoPhotographs {
        /// The file.
        path: PathBuf,
    },
    /// A mask that a file of cameras names is not there.
    #[error("the mask {} is missing; give it, or take its mask_path out of the file of cameras", path.display())]
    MissingMask {
        /// Where it should be.
        path: PathBuf,
    },
    /// Photographs that are not there.
    #[error(
        "{missing} of {total} photographs are missing, the first is {}; say where they are with images=FOLDER",
        first.display()
    )]
    MissingPhotographs {
        /// The first of them.
        first: PathBuf,
        /// How many are missing.
        missing: usize,
        /// How many there are in all.
        total: usize,
    },
}

/// What is wrong with an entry of a file of cameras.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EntryProblem {
    /// A camera that is none, or of an unknown kind.
    #[error(transparent)]
    Camera(#[from] CameraProblem),
    /// Words that are missing or no numbers.
    #[error("expected {expected}, found '{found}'")]
    Syntax {
        /// What the format prescribes.
        expected: &'static str,
        /// What stands there, shortened.
        found: String,
    },
    /// The file ends in the middle of an entry.
    #[error("the file ends here, in the middle of {what}")]
    Truncated {
        /// What it should hold.
        what: &'static str,
    },
    /// A name that is no name.
    #[error("the name of a photograph is {0}")]
    Name(&'static str),
    /// A reference to a camera that is not there.
    #[error("the photograph '{name}' is of camera {camera}, which is not in the file of cameras")]
    UnknownCamera {
        /// The photograph.
        name: String,
        /// The camera's number.
        camera: u32,
    },
    /// Two cameras of one number.
    #[error("there are two cameras {camera}")]
    Duplicate {
        /// The number.
        camera: u32,
    },
    /// More entries than are read.
    #[error("more than {limit} {what}")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// Nothing says how wide the lens sees.
    #[error("there is no focal length: expected fl_x or camera_angle_x")]
    NoFocalLength,
    /// The size of a picture is not said, and the picture cannot be asked.
    #[error("w and h are not given, and the size of {} cannot be read: {source}", path.display())]
    Size {
        /// The picture.
        path: PathBuf,
        /// What the decoder said.
        source: image::ImageError,
    },
}

/// Why a set of cameras could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteCamerasError {
    /// The operating system refused.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// Lenses that a `transforms.json` cannot hold.
    #[error(
        "transforms.json cannot hold fisheyes beside other lenses, thin prisms or field-of-view lenses; write COLMAP's files \
         instead"
    )]
    Lenses,
}
