//! Why an export ended without its files.

use std::io;
use std::path::PathBuf;

use fantex_texture::SaveImageError;

/// An export's failure. Each message is one sentence; no unfinished file is left behind.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The progress receiver asked to stop.
    #[error("the export was cancelled; nothing was written")]
    Cancelled,
    /// The asset's model had no texture coordinates.
    #[error(
        "the asset holds no texture coordinates of its model; leave --uv source out, or give the model that has some with --model"
    )]
    NoUv,
    /// The model that was given has no texture coordinates.
    #[error("the model has no texture coordinates; leave --uv and --model out for an own packing")]
    NoUvInModel,
    /// The model is not that of the asset.
    #[error(
        "triangle {triangle} of the asset is none of the model's; give the model that the asset was baked from"
    )]
    OtherModel {
        /// The asset's triangle, from 0.
        triangle: usize,
    },
    /// Texture coordinates that no picture holds.
    #[error(
        "the texture coordinates of triangle {triangle} reach from {low:?} to {high:?}; use an own packing (without --uv)"
    )]
    UvRange {
        /// The asset's triangle, from 0.
        triangle: usize,
        /// Least u and v.
        low: [f32; 2],
        /// Largest u and v.
        high: [f32; 2],
    },
    /// The picture is too small for its pieces.
    #[error(
        "{charts} pieces of the surface do not fit a picture of {side} x {side} texels; give a larger --size or a smaller --padding"
    )]
    TooManyCharts {
        /// Number of pieces.
        charts: usize,
        /// Columns and rows.
        side: u32,
    },
    /// A side that is no power of two or out of range.
    #[error("a picture cannot have {side} x {side} texels; give a power of two from {least} to {most}")]
    Side {
        /// What was asked for.
        side: u32,
        /// The smallest allowed.
        least: u32,
        /// The largest allowed.
        most: u32,
    },
    /// A padding that is no power of two or out of range.
    #[error("the padding cannot be {padding} texels; give a power of two up to {most}")]
    Padding {
        /// What was asked for.
        padding: u32,
        /// The largest allowed.
        most: u32,
    },
    /// The asset lacks the channel.
    #[error("the asset has no channel for {name}; it has {present}")]
    NoChannel {
        /// What was asked for.
        name: &'static str,
        /// What there is.
        present: String,
    },
    /// Several materials use the model's coordinates, each with a picture of its own.
    #[error(
        "the model's coordinates need {pages} pictures, one per material, and a single file holds one; use an own packing or write a .gltf"
    )]
    SeveralPages {
        /// Number of pictures.
        pages: usize,
    },
    /// The extension names nothing that is written.
    #[error("{} names no kind of file that is exported; use {known}", path.display())]
    UnknownKind {
        /// The file.
        path: PathBuf,
        /// The extensions that are known.
        known: &'static str,
    },
    /// A format that needs the whole picture in memory.
    #[error("{} needs {needed} bytes at once, but --memory allows {allowed}; use .png or .ktx2, a smaller --size, or more --memory", path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes.
        needed: u64,
        /// Bytes.
        allowed: u64,
    },
    /// More than a binary glTF can hold.
    #[error("{} would take {bytes} bytes, but a GLB file holds 4 GiB; write a .gltf", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes it would take.
        bytes: u64,
    },
    /// Something of that name is there already.
    #[error("{} exists already; use --force to overwrite it", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// Texels could not be encoded.
    #[error(transparent)]
    Encode(#[from] fantex_base::Error),
    /// A picture could not be written.
    #[error(transparent)]
    SaveImage(#[from] SaveImageError),
}
