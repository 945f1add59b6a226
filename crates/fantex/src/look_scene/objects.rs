//! The objects of a look: their shapes, what they wear, where they stand.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_look::data::ObjectTable;
use fantex_look::{Key, LookProblem};
use fantex_mesh::{CleanOptions, LoadOptions, Mesh, clean, load};
use fantex_render::{FanSurface, FilterOptions, LookSurface, Surface};
use fantex_store::{Asset, PageCache};
use fantex_texture::look::LookMaterial;
use glam::{DAffine3, DQuat, DVec3, EulerRot};

use super::displaced::displaced;
use super::{LookSceneError, Wardrobe, shapes};

/// A model of the command line.
#[derive(Clone, Debug)]
pub struct GivenModel {
    /// Its file, for messages and as base of nothing else.
    pub path: PathBuf,
    /// Its geometry and own materials.
    pub mesh: Mesh,
}

/// An object that is ready to be shown.
#[derive(Debug)]
pub(super) struct Object {
    pub(super) shape: Shape,
    pub(super) name: Option<String>,
    pub(super) world_from_object: DAffine3,
}

#[derive(Debug)]
pub(super) enum Shape {
    Dressed { mesh: Box<Mesh>, materials: Vec<Arc<LookMaterial>> },
    Asset(Box<PageCache>),
}

impl Object {
    pub(super) fn mesh(&self) -> &Mesh {
        match &self.shape {
            Shape::Dressed { mesh, .. } => mesh,
            Shape::Asset(cache) => cache.asset().mesh(),
        }
    }

    /// Tiles of an asset that could not be read.
    pub(super) fn damaged_tiles(&self) -> u64 {
        match &self.shape {
            Shape::Dressed { .. } => 0,
            Shape::Asset(cache) => cache.damage().pages,
        }
    }

    pub(super) fn surface(&self, time: f32, filter: FilterOptions) -> Box<dyn Surface + '_> {
        match &self.shape {
            Shape::Dressed { mesh, materials } => {
                Box::new(LookSurface::new(mesh, materials.clone()).at_time(time))
            }
            Shape::Asset(cache) => Box::new(FanSurface::of_asset(cache, filter)),
        }
    }
}

impl Wardrobe<'_> {
    /// All objects of the look; the given model alone where it has none.
    pub(super) fn objects(&self, given: Option<&GivenModel>) -> Result<Vec<Object>, LookSceneError> {
        let tables = &self.file.look().object;
        if tables.is_empty() {
            let given = given.ok_or_else(|| self.nothing_to_show())?;
            return Ok(vec![self.dressed(given.mesh.clone(), &given.path, None, &ObjectTable::default())?]);
        }
        let objects = tables.iter().enumerate();
        objects.map(|(index, table)| self.object(index, table, given)).collect()
    }

    fn nothing_to_show(&self) -> LookSceneError {
        LookSceneError::NothingToShow { path: self.file.path().into() }
    }

    fn object(
        &self,
        index: usize,
        table: &ObjectTable,
        given: Option<&GivenModel>,
    ) -> Result<Object, LookSceneError> {
        let key = Key::of(["object"]).index(index);
        let (mesh, path) = match (&table.model, &table.shape) {
            (Some(_), Some(_)) => {
                return Err(self.file.error(&key, LookProblem::Exclusive("model", "shape")).into());
            }
            (None, Some(shape)) => (cleaned(shapes::model_of(shape))?, PathBuf::from("shape")),
            (Some(name), None) => {
                let path = self.file.file(name);
                if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("fan")) {
                    return self.asset(&path, table, &key);
                }
                (cleaned(load(&path, &LoadOptions::default())?)?, path)
            }
            (None, None) => {
                let given = given.ok_or_else(|| self.nothing_to_show())?;
                (given.mesh.clone(), given.path.clone())
            }
        };
        self.dressed(mesh, &path, Some(index), table)
    }

    fn asset(&self, path: &Path, table: &ObjectTable, key: &Key) -> Result<Object, LookSceneError> {
        if table.material.is_some() || !table.materials.is_empty() {
            return Err(self.file.error(&key.name("material"), LookProblem::BakedAsset).into());
        }
        let cache = PageCache::new(Arc::new(Asset::open(path)?), self.options.memory_bytes as usize);
        Ok(Object {
            shape: Shape::Asset(Box::new(cache)),
            name: table.name.clone(),
            world_from_object: placement(table),
        })
    }

    fn dressed(
        &self,
        mesh: Mesh,
        path: &Path,
        index: Option<usize>,
        table: &ObjectTable,
    ) -> Result<Object, LookSceneError> {
        let dress = self.dress(&mesh, path, index)?;
        let mesh = displaced(self, mesh, &dress)?;
        Ok(Object {
            shape: Shape::Dressed { mesh: Box::new(mesh), materials: dress.materials },
            name: table.name.clone(),
            world_from_object: placement(table),
        })
    }
}

fn cleaned(model: fantex_mesh::Model) -> Result<Mesh, LookSceneError> {
    Ok(clean(model, &CleanOptions::default())?.0)
}

fn placement(table: &ObjectTable) -> DAffine3 {
    let [x, y, z] = table.rotate.map(f64::to_radians);
    DAffine3::from_scale_rotation_translation(
        DVec3::from_array(table.scale.axes()),
        DQuat::from_euler(EulerRot::ZYX, z, y, x),
        DVec3::from_array(table.translate),
    )
}
