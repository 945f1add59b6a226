//! What can go wrong while painting.

use std::path::PathBuf;

use fantex_base::Error;

/// Painting failed. What was committed before stays.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaintError {
    /// The asset cannot be read or changed.
    #[error(transparent)]
    Asset(#[from] Error),
    /// The temporary file of a stroke cannot be written or read.
    #[error(
        "cannot keep the stroke's pages in a temporary file: {0}; free some space or raise the memory budget"
    )]
    Spill(#[from] std::io::Error),
    /// The thread that computes coarser levels has stopped.
    #[error(
        "the coarser levels of the last stroke could not be computed; undo the stroke and paint it again"
    )]
    LevelsLost,
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
    /// The texture graph of a layer cannot be evaluated.
    #[error("the layer {layer:?} cannot be shown: {source}; correct its textures or hide it")]
    Graph {
        /// The layer's name.
        layer: String,
        /// Why.
        source: Box<crate::GraphError>,
    },
    /// The layers of an asset cannot be understood.
    #[error("the layers of {} are damaged: {reason}; its texels are not affected", path.display())]
    Layers {
        /// The asset's path.
        path: PathBuf,
        /// What is wrong.
        reason: &'static str,
    },
    /// The log of an asset cannot be understood.
    #[error("the log of strokes of {} is damaged; its texels are not affected", path.display())]
    Log {
        /// The asset's path.
        path: PathBuf,
    },
    /// A file that a stroke mentions cannot be taken into the log.
    #[error("cannot read {} for the log of strokes: {source}", path.display())]
    LogFile {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
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
