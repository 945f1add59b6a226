//! What is wrong with a volume.

use std::fmt;
use std::io;
use std::path::PathBuf;

use super::MAX_VOLUME_SIDE;
use crate::LoadImageError;

/// Sizes that no volume has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VolumeSizeError {
    /// A side or the number of channels is out of range.
    #[error(
        "a volume of {} x {} x {} voxels with {channels} channels is not possible: each side must be 1 to \
         {MAX_VOLUME_SIDE}, the channels 1 to 4",
        .size[0], .size[1], .size[2]
    )]
    Size {
        /// Voxels along x, y and z.
        size: [u32; 3],
        /// Numbers per voxel.
        channels: u8,
    },
    /// The samples do not fit the size.
    #[error(
        "a volume of {} x {} x {} voxels with {channels} channels takes {expected} numbers, not {got}",
        .size[0], .size[1], .size[2]
    )]
    Samples {
        /// Voxels along x, y and z.
        size: [u32; 3],
        /// Numbers per voxel.
        channels: u8,
        /// How many there must be.
        expected: u64,
        /// How many there are.
        got: u64,
    },
    /// There is no image to stack.
    #[error("a volume needs at least one slice")]
    NoSlices,
    /// An image differs from the first.
    #[error("slice {index} of the volume differs from slice 0 in size, channels or depth; all must be equal")]
    UnequalSlices {
        /// Which one, from 0.
        index: usize,
    },
}

/// Why a volume could not be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadVolumeError {
    /// The file could not be read.
    #[error("cannot read volume '{path}': {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The header is no MetaImage header, or one of a variant that is not supported.
    #[error("'{path}', line {line}: {fault}")]
    Header {
        /// The header's file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        fault: HeaderFault,
    },
    /// An image of a stack could not be read.
    #[error("slice {index} of a volume: {source}")]
    Slice {
        /// Which one, from 0.
        index: usize,
        /// What is wrong with it.
        source: LoadImageError,
    },
    /// The images of a stack do not fit together.
    #[error("the slices of a volume do not fit: {0}")]
    Slices(#[from] VolumeSizeError),
    /// The size is impossible.
    #[error("'{path}': {source}")]
    Size {
        /// The file.
        path: PathBuf,
        /// Which rule it breaks.
        source: VolumeSizeError,
    },
    /// The file of numbers is too short.
    #[error("'{path}' ends after {got} bytes; the volume needs {expected}")]
    Truncated {
        /// The file of numbers.
        path: PathBuf,
        /// Bytes needed, with what is skipped.
        expected: u64,
        /// Bytes there are.
        got: u64,
    },
    /// Reading would take too much memory.
    #[error(
        "'{path}' would take {needed} bytes of memory with its levels, {limit} are allowed; raise the limit or scale the volume down"
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes of the voxels and all coarser levels.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
}

/// What is wrong in a header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HeaderFault {
    /// A line is no `Key = value`, or the file is no text.
    NoEntry,
    /// A value that must be something else.
    Value {
        /// The key.
        key: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        got: String,
    },
    /// A key that must be there.
    Missing {
        /// The key.
        key: &'static str,
    },
}

impl fmt::Display for HeaderFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoEntry => f.write_str("a MetaImage header has lines like 'DimSize = 64 64 64'"),
            Self::Value { key, expected, got } => write!(f, "{key} is '{got}'; it must be {expected}"),
            Self::Missing { key } => write!(f, "the header ends without {key}"),
        }
    }
}
