//! Looks as scenes: from a file to models with materials, lamps, surroundings and a camera.
//!
//! ```text
//! LookFile --MaterialResolver--> ResolvedMaterials (of a model) --LookBake--> a source for tiles
//!              '-------> LookScene (all objects, lamps, surroundings) --render--> pictures
//! ```

mod lights;
mod objects;
mod scene;

use std::path::Path;
use std::sync::Arc;

use fantex_base::{Error, Result};
use fantex_look::data::{MaterialBase, ObjectTable};
use fantex_look::{Key, LookFile, LookImages, ResolveOptions, Resolver, materials_of_model, problem};
use fantex_mesh::Mesh;
use fantex_store::limits::MAX_UV_SETS;
use fantex_texture::look::LookMaterial;
use fantex_texture::material::LeftOut;
use fantex_texture::{Dependence, Texture};

pub use lights::LookBake;
pub use objects::GivenModel;
pub use scene::{LookScene, PictureChanges};

/// The materials of a model under a look.
#[derive(Clone, Debug)]
pub struct ResolvedMaterials {
    /// One for each of the mesh's materials.
    pub materials: Vec<Arc<LookMaterial>>,
    /// For each of them its name in the look; none where the model's own is kept.
    pub names: Vec<Option<String>>,
    /// Images of the model that its own materials lack. Those of the look have to be there.
    pub left_out: LeftOut,
}

/// Finds out which material of a look every material of a model has.
#[derive(Clone, Copy, Debug)]
pub struct MaterialResolver<'a> {
    /// The look.
    pub file: &'a LookFile,
    /// Images that were read before.
    pub images: &'a LookImages,
    /// How textures are made.
    pub options: ResolveOptions,
}

impl MaterialResolver<'_> {
    /// The materials of a model. `object` is the number of the look's object that it is, if it is one; `model` is its file.
    ///
    /// A material of the model becomes what the object's `materials` say of its name (or of `#N`, its number from 0), else the
    /// object's `material`; without an object, the look's only material (or `bake.material`); else it keeps its own.
    ///
    /// # Errors
    /// A texture cannot be made, the object names a material that the model does not have, or the model is too small or too large for
    /// textures.
    pub fn materials(&self, mesh: &Mesh, model: &Path, object: Option<usize>) -> Result<ResolvedMaterials> {
        self.materials_on(mesh, mesh, model, object)
    }

    /// The same with the altitudes of what displacement has made of the mesh.
    fn materials_on(
        &self,
        mesh: &Mesh,
        displaced: &Mesh,
        model: &Path,
        object: Option<usize>,
    ) -> Result<ResolvedMaterials> {
        check_size(mesh)?;
        let names = self.names(mesh, object)?;
        let needs_own = names.iter().any(|name| match name {
            None => true,
            Some(name) => {
                let table = self.file.look().materials.get(name);
                table.is_some_and(|t| t.from == MaterialBase::Model)
            }
        });
        let (own, left_out) = if needs_own {
            materials_of_model(mesh, model, self.images, self.options)?
        } else {
            (vec![LookMaterial::default(); mesh.materials.len()], LeftOut::default())
        };
        let resolver = Resolver::new(self.file, mesh, self.images, self.options);
        let mut resolver = resolver.with_altitudes_of(displaced);
        let materials = names.iter().zip(own).map(|(name, own)| match name {
            Some(name) => resolver.material(name, &own).map(Arc::new),
            None => Ok(Arc::new(own)),
        });
        Ok(ResolvedMaterials { materials: materials.collect::<Result<_>>()?, names, left_out })
    }

    fn names(&self, mesh: &Mesh, object: Option<usize>) -> Result<Vec<Option<String>>> {
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
    fn names_without_object(&self, mesh: &Mesh) -> Result<Vec<Option<String>>> {
        let look = self.file.look();
        let only = look.materials.keys().next().filter(|_| look.materials.len() == 1);
        let everywhere = look.bake.material.as_ref().map(|name| &name.0).or(only);
        let same_name = |name: &String| look.materials.contains_key(name).then(|| name.clone());
        let names = mesh.materials.iter().map(|m| everywhere.cloned().or_else(|| same_name(&m.name)));
        let names: Vec<Option<String>> = names.collect();
        let is_lost = names.iter().all(Option::is_none) && !look.materials.is_empty();
        if is_lost && look.bake.texture.is_none() {
            let problem = problem::one_needed(&["object", "bake.material"]);
            return Err(self.file.error(&Key::default(), problem));
        }
        Ok(names)
    }

    /// The number of the look's object that is the model of the command line: the first without a file or a shape.
    fn model_object(&self) -> Option<usize> {
        self.file.look().object.iter().position(|object| object.model.is_none() && object.shape.is_none())
    }

    /// Every name that the object mentions is one of the model's.
    fn check_names(&self, mesh: &Mesh, index: usize, object: &ObjectTable) -> Result<()> {
        let numbers = (0..mesh.materials.len()).map(|number| format!("#{number}"));
        let names = mesh.materials.iter().map(|m| m.name.clone()).filter(|name| !name.is_empty());
        let allowed: Vec<String> = names.chain(numbers).collect();
        let Some(wrong) = object.materials.keys().find(|name| !allowed.contains(name)) else {
            return Ok(());
        };
        let key = Key::of(["object"]).index(index).name("materials").name(wrong);
        let allowed: Vec<&str> = allowed.iter().map(String::as_str).collect();
        let problem = problem::unknown_value(wrong, &allowed);
        Err(self.file.error(&key, problem))
    }
}

/// Refuses sizes whose squares single precision, in which textures are evaluated, does not hold.
pub(crate) fn check_size(mesh: &Mesh) -> Result<()> {
    let scale = mesh.world_from_mesh.scale;
    if (1e-18..=1e18).contains(&scale) {
        return Ok(());
    }
    Err(Error::unsupported(format!(
        "the model is about {scale:.0e} units large, and textures are evaluated on 1e-18 to 1e18; scale it, or remove stray vertices"
    )))
}

/// A sentence where textures on a model lie by texture coordinates that it does not have: they are one texel everywhere then.
fn note_of_lacking_coordinates(mesh: &Mesh, textures: &[&Arc<dyn Texture>]) -> Option<String> {
    let is_asked = |set: &usize| textures.iter().any(|texture| texture.depends_on(Dependence::Uv(*set)));
    let is_there = |set: &usize| mesh.corners.uv_sets.get(*set).is_some_and(|uv| !uv.is_empty());
    let set = (0..MAX_UV_SETS).filter(|set| !is_there(set)).find(is_asked)?;
    let which = if set == 0 { String::new() } else { format!(" of set {set}") };
    Some(format!(
        "the model has no texture coordinates{which}, and where the look asks for them it is one texel everywhere; images need none \
         with coordinates = \"box\", for instance"
    ))
}
