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
    /// The folder of its files is gone.
    #[error(
        "the files of the look with the texture {name:?} are not found ({source}): their folder was {}; put them there \
         again, or move asset and look together",
        folder.display()
    )]
    Folder {
        /// The texture.
        name: String,
        /// Where the look's files should be.
        folder: PathBuf,
        /// What was not found.
        source: LookError,
    },
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
        match self.made(surface, name) {
            Err(GraphError::Look(source)) if !self.folder.is_dir() => {
                Err(GraphError::Folder { name: name.to_owned(), folder: self.folder.clone(), source })
            }
            made => made,
        }
    }

    /// The names of the look's textures, ascending.
    ///
    /// # Errors
    ///
    /// The look is wrong.
    pub fn names(&self) -> Result<Vec<String>, GraphError> {
        let file = LookFile::parse(&self.look, &self.folder.join("look.toml"))?;
        Ok(file.look().textures.keys().cloned().collect())
    }

    fn made(&self, surface: &Surface, name: &str) -> Result<Arc<dyn Texture>, GraphError> {
        let file = LookFile::parse(&self.look, &self.folder.join("look.toml"))?;
        let images = LookImages::default();
        let mut resolver = Resolver::new(&file, surface.mesh(), &images, ResolveOptions::default());
        let texture = resolver.texture(name)?;
        let is_fixed = !texture.is_view_dependent();
        is_fixed.then_some(texture).ok_or_else(|| GraphError::ViewDependent(name.to_owned()))
    }
}
