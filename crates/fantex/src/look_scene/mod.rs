//! Looks as scenes: from a file to dressed models, lamps, surroundings and a camera.
//!
//! ```text
//! LookFile --Wardrobe--> Dress (a model's materials) --LookBake--> a source for tiles
//!              '-------> LookScene (all objects, lamps, surroundings) --render--> pictures
//! ```

mod lights;
mod objects;
mod scene;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_look::data::ObjectTable;
use fantex_look::{Key, LookError, LookFile, LookProblem};
use fantex_mesh::Mesh;
use fantex_render::{RenderError, SceneError};
use fantex_texture::look::{LookImages, LookMaterial, ResolveOptions, Resolver, materials_of_model};

pub use lights::{LookBake, LookBakeError};
pub use objects::GivenModel;
pub use scene::{LookScene, PictureChanges};

// Why a look cannot be shown.

/// Why a look is no scene, or no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LookSceneError {
    /// The look itself, or a texture of it.
    #[error(transparent)]
    Look(#[from] LookError),
    /// A model or asset cannot be read, or nothing of a model is left after cleaning.
    #[error(transparent)]
    Model(#[from] fantex_base::Error),
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

// Which material of a look every material of a model wears.

/// A model's materials, dressed.
#[derive(Clone, Debug)]
pub struct Dress {
    /// One for each of the mesh's materials.
    pub materials: Vec<Arc<LookMaterial>>,
    /// For each of them its name in the look; none where the model's own is kept.
    pub names: Vec<Option<String>>,
}

/// What a model is dressed with.
#[derive(Clone, Copy, Debug)]
pub struct Wardrobe<'a> {
    /// The look.
    pub file: &'a LookFile,
    /// Images that were read before.
    pub images: &'a LookImages,
    /// How textures are made.
    pub options: ResolveOptions,
}

impl Wardrobe<'_> {
    /// Dresses a model. `object` is the number of the look's object that it is, if it is one; `model` is its file.
    ///
    /// A material of the model wears what the object's `materials` say of its name (or of `#N`, its number from 0), else the
    /// object's `material`; without an object, the look's only material (or `bake.material`); else it keeps its own.
    ///
    /// # Errors
    ///
    /// A texture cannot be made, or the object names a material that the model does not have.
    pub fn dress(&self, mesh: &Mesh, model: &Path, object: Option<usize>) -> Result<Dress, LookError> {
        let names = self.names(mesh, object)?;
        let needs_own = names.iter().any(|name| match name {
            None => true,
            Some(name) => {
                let table = self.file.look().materials.get(name);
                table.is_some_and(|t| t.from == fantex_look::data::MaterialBase::Model)
            }
        });
        let own = if needs_own {
            materials_of_model(mesh, model, self.images, self.options)?
        } else {
            vec![LookMaterial::default(); mesh.materials.len()]
        };
        let mut resolver = Resolver::new(self.file, mesh, self.images, self.options);
        let materials = names.iter().zip(own).map(|(name, own)| match name {
            Some(name) => resolver.material(name, &own).map(Arc::new),
            None => Ok(Arc::new(own)),
        });
        Ok(Dress { materials: materials.collect::<Result<_, _>>()?, names })
    }

    fn names(&self, mesh: &Mesh, object: Option<usize>) -> Result<Vec<Option<String>>, LookError> {
        let look = self.file.look();
        let Some((index, object)) = object.and_then(|i| Some((i, look.object.get(i)?))) else {
            return self.names_without_object(mesh);
        };
        self.check_names(mesh, index, object)?;
        let of_material = |(number, material): (usize, &fantex_mesh::Material)| {
            let by_name = object.materials.get(&material.name).filter(|_| !material.name.is_empty());
            let by_number = || object.materials.get(&format!("#{number}"));
            by_name.or_else(by_number).or(object.material.as_ref()).map(|name| name.0.clone())
        };
        Ok(mesh.materials.iter().enumerate().map(of_material).collect())
    }

    /// What `bake.material` says, else materials of the same names, else the only one.
    fn names_without_object(&self, mesh: &Mesh) -> Result<Vec<Option<String>>, LookError> {
        let look = self.file.look();
        let only = look.materials.keys().next().filter(|_| look.materials.len() == 1);
        let everywhere = look.bake.material.as_ref().map(|name| &name.0).or(only);
        let same_name = |name: &String| look.materials.contains_key(name).then(|| name.clone());
        let names = mesh.materials.iter().map(|m| everywhere.cloned().or_else(|| same_name(&m.name)));
        let names: Vec<Option<String>> = names.collect();
        let is_lost = names.iter().all(Option::is_none) && !look.materials.is_empty();
        if is_lost && look.bake.texture.is_none() {
            let keys = vec!["object".to_owned(), "bake.material".to_owned()];
            return Err(self.file.error(&Key::default(), LookProblem::OneNeeded(keys)));
        }
        Ok(names)
    }

    /// The number of the look's object that is the model of the command line: the first without a file or a shape.
    pub fn model_object(&self) -> Option<usize> {
        self.file.look().object.iter().position(|object| object.model.is_none() && object.shape.is_none())
    }

    /// Every name that the object mentions is one of the model's.
    fn check_names(&self, mesh: &Mesh, index: usize, object: &ObjectTable) -> Result<(), LookError> {
        let numbers = (0..mesh.materials.len()).map(|number| format!("#{number}"));
        let names = mesh.materials.iter().map(|m| m.name.clone()).filter(|name| !name.is_empty());
        let allowed: Vec<String> = names.chain(numbers).collect();
        let Some(wrong) = object.materials.keys().find(|name| !allowed.contains(name)) else {
            return Ok(());
        };
        let key = Key::of(["object"]).index(index).name("materials").name(wrong);
        let problem = LookProblem::UnknownValue { name: wrong.clone(), nearest: None, allowed };
        Err(self.file.error(&key, problem))
    }
}
