//! What a look puts into tiles.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::{
    BakeLight, LightMapError, LightMapOptions, LightMapSource, LightQuantity, LightScene, LitSource,
    LookSource, LookSourceError, Source, SourceReflector, baked_materials,
};
use fantex_look::LookError;
use fantex_look::data::{LightBakeTable, LightQuantityName, LightTable};
use fantex_mesh::Mesh;
use fantex_render::EnvironmentLight;
use fantex_texture::Texture;
use fantex_texture::look::{LookMaterial, Resolver, Slot, linear_rgb};
use glam::{DVec3, Vec3};

use super::displaced::displaced;
use super::lights::environment_light;
use super::{Dress, Wardrobe};

/// A look on a model, ready to be baked.
#[derive(Clone, Debug)]
pub struct LookBake {
    materials: Vec<Arc<LookMaterial>>,
    time: f32,
    light: Option<BakedLight>,
}

/// The light that is baked, if it is.
#[derive(Clone, Debug)]
struct BakedLight {
    options: LightMapOptions,
    is_colored: bool,
    lamps: Vec<BakeLight>,
    sky: SkyLight,
}

/// Light from everywhere.
#[derive(Clone, Debug)]
struct SkyLight {
    sky: Vec3,
    ground: Vec3,
    environment: Option<EnvironmentLight>,
}

/// Why a look on a model cannot be baked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LookBakeError {
    /// A texture depends on the eye.
    #[error(transparent)]
    Source(#[from] LookSourceError),
    /// A lamp or an option of the light is out of range.
    #[error(transparent)]
    Light(#[from] LightMapError),
}

impl LookBake {
    /// Dresses a model for a bake. Displacements become its geometry; its materials are replaced by those that the asset needs
    /// beside its tiles.
    ///
    /// # Errors
    ///
    /// A texture cannot be made, or the look does not say which material the model wears.
    pub fn new(wardrobe: &Wardrobe<'_>, mesh: &mut Mesh, model: &Path) -> Result<Self, LookError> {
        let bake = &wardrobe.file.look().bake;
        let dress = wardrobe.dress(mesh, model, wardrobe.model_object())?;
        *mesh = displaced(wardrobe, std::mem::take(mesh), &dress)?;
        let Dress { mut materials, .. } = dress;
        if let Some(name) = &bake.texture {
            let mut resolver = Resolver::new(wardrobe.file, mesh, wardrobe.images, wardrobe.options);
            let texture = resolver.texture(&name.0)?;
            let painted = Arc::new(painted(texture));
            materials.iter_mut().for_each(|material| *material = Arc::clone(&painted));
        }
        mesh.materials = baked_materials(&materials);
        let light = bake.light.as_ref().map(|table| wardrobe.baked_light(table)).transpose()?;
        if light.is_some() {
            // What is baked is the finished picture.
            mesh.materials.iter_mut().for_each(|material| {
                material.unlit = true;
                material.emission = Vec3::ZERO;
            });
        }
        Ok(Self { materials, time: bake.time as f32, light })
    }

    /// Hands what is baked to `then`. The mesh is the one that was dressed.
    ///
    /// # Errors
    ///
    /// A texture depends on the eye, or a number of the light is out of range.
    pub fn with_source<R>(
        &self,
        mesh: &Mesh,
        then: impl FnOnce(&dyn Source) -> R,
    ) -> Result<R, LookBakeError> {
        let source = LookSource::new(mesh, self.materials.clone(), self.time)?;
        let Some(light) = &self.light else { return Ok(then(&source)) };
        let reflector = SourceReflector::new(mesh, &source);
        let sky = |direction: Vec3| light.sky.radiance(direction);
        let scene = LightScene { lights: light.lamps.clone(), sky: &sky, reflector: &reflector };
        let map = LightMapSource::new(mesh, &scene, light.options)?;
        let colors: Option<&dyn Source> = if light.is_colored { Some(&source) } else { None };
        Ok(then(&LitSource::new(map, colors)))
    }
}

impl SkyLight {
    fn radiance(&self, direction: Vec3) -> Vec3 {
        match &self.environment {
            Some(light) => light.reflected(direction, [Vec3::ZERO; 2], 0.0),
            None => self.ground.lerp(self.sky, 0.5 + 0.5 * direction.y),
        }
    }
}

impl Wardrobe<'_> {
    fn baked_light(&self, table: &LightBakeTable) -> Result<BakedLight, LookError> {
        let look = self.file.look();
        let mut sky = SkyLight { sky: Vec3::ZERO, ground: Vec3::ZERO, environment: None };
        if look.light.is_empty() && look.environment.is_none() {
            (sky.sky, sky.ground) = (Vec3::ONE, Vec3::ONE);
        }
        if let Some(table) = &look.environment {
            sky.environment = self.environment_map(table)?.map(|map| environment_light(map, table));
        }
        let mut lamps = Vec::new();
        for lamp in &look.light {
            match lamp {
                LightTable::Ambient(table) => {
                    sky.sky += linear_rgb(table.sky) * table.strength as f32;
                    sky.ground += linear_rgb(table.ground.unwrap_or(table.sky)) * table.strength as f32;
                }
                lamp => lamps.extend(bake_light(lamp)),
            }
        }
        let options = LightMapOptions {
            quantity: match table.quantity {
                LightQuantityName::Direct => LightQuantity::Direct,
                LightQuantityName::AmbientOcclusion => LightQuantity::AmbientOcclusion,
                LightQuantityName::Full => LightQuantity::Full,
            },
            samples: table.samples,
            target_error: table.target_error.map(|error| error as f32),
            max_samples: table.max_samples.max(table.samples),
            bounces: table.bounces,
            occlusion_distance: table.occlusion_distance,
            seed: self.options.seed,
            ..LightMapOptions::default()
        };
        Ok(BakedLight { options, is_colored: table.colored, lamps, sky })
    }
}

/// A lamp for path tracing. Its light falls off with the square of the distance; projectors have no place there.
fn bake_light(lamp: &LightTable) -> Option<BakeLight> {
    let direction = |v: [f64; 3]| DVec3::from_array(v).as_vec3();
    // What it would be at the distance 1.
    let at_one = |full_at: Option<f64>| full_at.map_or(1.0, |d| d * d) as f32;
    match lamp {
        LightTable::Sun(sun) => Some(BakeLight::Directional {
            to_light: direction(sun.to_light),
            color: linear_rgb(sun.color) * sun.strength as f32,
            radius_degrees: sun.radius as f32,
        }),
        LightTable::Point(point) => Some(BakeLight::Point {
            position: DVec3::from_array(point.position),
            color: linear_rgb(point.color) * (point.strength as f32 * at_one(point.full_at)),
            radius: point.radius,
        }),
        LightTable::Spot(spot) => Some(BakeLight::Spot {
            position: DVec3::from_array(spot.position),
            axis: (DVec3::from_array(spot.target) - DVec3::from_array(spot.position)).as_vec3(),
            color: linear_rgb(spot.color) * (spot.strength as f32 * at_one(spot.full_at)),
            radius: spot.radius,
            inner_degrees: spot.inner as f32,
            outer_degrees: (spot.outer as f32).max(spot.inner as f32 + 0.01),
        }),
        LightTable::Projector(_) | LightTable::Ambient(_) => None,
    }
}

/// A material that is nothing but a texture's colour.
fn painted(texture: Arc<dyn Texture>) -> LookMaterial {
    LookMaterial { base_color: Slot::Texture(texture), ..LookMaterial::default() }
}
