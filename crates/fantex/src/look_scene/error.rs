//! Why a look cannot be shown.

use std::path::PathBuf;

use fantex_look::LookError;
use fantex_mesh::{CleanError, LoadError};
use fantex_render::{RenderError, SceneError};
use fantex_store::OpenError;

/// Why a look is no scene, or no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LookSceneError {
    /// The look itself, or a texture of it.
    #[error(transparent)]
    Look(#[from] LookError),
    /// A model cannot be read.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Nothing of a model is left after cleaning.
    #[error(transparent)]
    Clean(#[from] CleanError),
    /// An asset cannot be read.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Objects do not go together.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The renderer refuses.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Nothing says what is to be shown.
    #[error(
        "{} names no model: give it an [[object]] with the key 'model' or 'shape', or render a model with --look",
        path.display()
    )]
    NothingToShow {
        /// The look.
        path: PathBuf,
    },
}
