//! What a look puts into tiles.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::{LookSource, LookSourceError, baked_materials};
use fantex_look::LookError;
use fantex_mesh::Mesh;
use fantex_texture::Texture;
use fantex_texture::look::{LookMaterial, Resolver, Slot};

use super::{Dress, Wardrobe};

/// A look on a model, ready to be baked.
#[derive(Clone, Debug)]
pub struct LookBake {
    materials: Vec<Arc<LookMaterial>>,
    time: f32,
}

impl LookBake {
    /// Dresses a model for a bake. Its materials are replaced by those that the asset needs beside its tiles.
    ///
    /// # Errors
    ///
    /// A texture cannot be made, or the look does not say which material the model wears.
    pub fn new(wardrobe: &Wardrobe<'_>, mesh: &mut Mesh, model: &Path) -> Result<Self, LookError> {
        let bake = &wardrobe.file.look().bake;
        let Dress { mut materials, .. } = wardrobe.dress(mesh, model, wardrobe.model_object())?;
        if let Some(name) = &bake.texture {
            let mut resolver = Resolver::new(wardrobe.file, mesh, wardrobe.images, wardrobe.options);
            let texture = resolver.texture(&name.0)?;
            materials = vec![Arc::new(painted(texture)); mesh.materials.len()];
        }
        mesh.materials = baked_materials(&materials);
        Ok(Self { materials, time: bake.time as f32 })
    }

    /// What is baked. The mesh is the one that was dressed.
    ///
    /// # Errors
    ///
    /// A texture depends on the eye.
    pub fn source<'m>(&self, mesh: &'m Mesh) -> Result<LookSource<'m>, LookSourceError> {
        LookSource::new(mesh, self.materials.clone(), self.time)
    }
}

/// A material that is nothing but a texture's colour.
fn painted(texture: Arc<dyn Texture>) -> LookMaterial {
    LookMaterial { base_color: Slot::Texture(texture), ..LookMaterial::default() }
}
