//! What can go wrong while painting.

use std::path::PathBuf;

use fantex_store::{EditError, EncodeError, PageError};

/// Painting failed. What was committed before stays.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaintError {
    /// The asset cannot be changed.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// A page cannot be read.
    #[error(transparent)]
    Page(#[from] PageError),
    /// Texels cannot be encoded.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The temporary file of a stroke cannot be written or read.
    #[error(
        "cannot keep the stroke's pages in a temporary file: {0}; free some space or raise the memory budget"
    )]
    Spill(#[from] std::io::Error),
    /// A channel that the asset lacks.
    #[error("the asset has {count} channels; there is no channel {channel} to paint")]
    NoChannel {
        /// What was asked for.
        channel: usize,
        /// Channels of the asset.
        count: usize,
    },
    /// A layer that does not exist.
    #[error("there is no layer number {0} to paint on")]
    NoLayer(u64),
    /// The layers of an asset cannot be understood.
    #[error("the layers of {} are damaged: {reason}; its texels are not affected", path.display())]
    Layers {
        /// The asset's path.
        path: PathBuf,
        /// What is wrong.
        reason: &'static str,
    },
    /// The history of an asset cannot be understood.
    #[error("the history of {} is damaged: {reason}; the texels are not affected", path.display())]
    History {
        /// The asset's path.
        path: PathBuf,
        /// What is wrong.
        reason: &'static str,
    },
}
