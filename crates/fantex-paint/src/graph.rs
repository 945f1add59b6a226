//! Texture graphs: textures of a look, on the model that is painted on.

use std::path::PathBuf;
use std::sync::Arc;

use fantex_look::{LookError, LookFile};
use fantex_texture::Texture;
use fantex_texture::look::{LookImages, ResolveOptions, Resolver};
use serde::{Deserialize, Serialize};

use crate::Surface;

/// A look's text, and the folder that the files it mentions are relative to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TextureGraph {
    /// TOML.
    pub look: String,
    /// Of images and volumes.
    pub folder: PathBuf,
}

/// A texture cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GraphError {
    /// The look is wrong, or has no texture of that name, or a file is missing.
    #[error(transparent)]
    Look(#[from] LookError),
    /// It depends on the eye.
    #[error("the texture {0:?} depends on the eye and cannot be painted with")]
    ViewDependent(String),
}

impl TextureGraph {
    /// The texture of a name.
    ///
    /// # Errors
    ///
    /// The look is wrong, has no such texture, or the texture cannot be made or depends on the eye.
    pub fn texture(&self, surface: &Surface, name: &str) -> Result<Arc<dyn Texture>, GraphError> {
        let file = LookFile::parse(&self.look, &self.folder.join("look.toml"))?;
        let images = LookImages::default();
        let mut resolver = Resolver::new(&file, surface.mesh(), &images, ResolveOptions::default());
        let texture = resolver.texture(name)?;
        let is_fixed = !texture.is_view_dependent();
        is_fixed.then_some(texture).ok_or_else(|| GraphError::ViewDependent(name.to_owned()))
    }
}
