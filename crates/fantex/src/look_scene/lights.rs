//! Lamps and surroundings of a look, and the light that is baked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::{
    BakeLight, LightMapError, LightMapOptions, LightMapSource, LightQuantity, LightScene, LitSource,
    LookSource, LookSourceError, Source, SourceReflector, baked_materials,
};
use fantex_look::data::{
    EnvironmentFormName, EnvironmentLayoutName, EnvironmentTable, LightBakeTable, LightQuantityName,
    LightTable, ProjectorTable, ShadowTable, SkyTable,
};
use fantex_look::{Key, LookError, LookProblem};
use fantex_mesh::Mesh;
use fantex_render::{
    AmbientLight, EnvironmentLight, Falloff, Lens, Light, LightKind, Lights, Penumbra, Projector,
    ShadowOptions, Slide, SpotLight,
};
use fantex_texture::environment::{
    EnvironmentForm, EnvironmentLayout, EnvironmentMap, PrefilteredEnvironment, Sky,
};
use fantex_texture::look::{LookMaterial, Resolver, Slot, linear_rgb};
use fantex_texture::{ColorSpace, Image, ImageTexture, SampleOptions, Texture};
use glam::{DVec3, Vec3};

use super::objects::displaced;
use super::{Dress, Wardrobe};

// Lamps and surroundings of a look.

impl Wardrobe<'_> {
    /// The lamps of the look, without its environment; `None` where it has neither.
    pub(super) fn lights(&self) -> Result<Option<Lights>, LookError> {
        let look = self.file.look();
        if look.light.is_empty() && look.environment.is_none() {
            return Ok(None);
        }
        let mut lights = Lights { ambient: AmbientLight::uniform(Vec3::ZERO), lamps: Vec::new() };
        for (index, table) in look.light.iter().enumerate() {
            let key = Key::of(["light"]).index(index);
            match table {
                LightTable::Ambient(table) => {
                    let (sky, ground) = (table.sky, table.ground.unwrap_or(table.sky));
                    let strength = table.strength as f32;
                    lights.ambient.sky += linear_rgb(sky) * strength;
                    lights.ambient.ground += linear_rgb(ground) * strength;
                }
                lamp => lights.lamps.push(self.lamp(lamp, &key)?),
            }
        }
        Ok(Some(lights))
    }

    fn lamp(&self, table: &LightTable, key: &Key) -> Result<Light, LookError> {
        Ok(match table {
            LightTable::Sun(table) => {
                let to_light = DVec3::from_array(table.to_light).as_vec3();
                self.check_direction(to_light, &key.name("to_light"))?;
                let color = linear_rgb(table.color) * table.strength as f32;
                shadowed(LightKind::Directional { to_light }, color, &table.shadow)
            }
            LightTable::Point(table) => {
                let falloff = self.falloff(table.full_at, table.range, key)?;
                let kind = LightKind::Point { position: DVec3::from_array(table.position), falloff };
                shadowed(kind, linear_rgb(table.color) * table.strength as f32, &table.shadow)
            }
            LightTable::Spot(table) => {
                let position = DVec3::from_array(table.position);
                let direction = (DVec3::from_array(table.target) - position).as_vec3();
                self.check_direction(direction, &key.name("target"))?;
                if table.inner > table.outer {
                    let allowed = format!("from {} to 90", table.inner);
                    let found = table.outer.to_string();
                    return Err(self.file.error(&key.name("outer"), LookProblem::Range { allowed, found }));
                }
                let spot = SpotLight {
                    position,
                    direction,
                    inner_degrees: table.inner as f32,
                    outer_degrees: table.outer as f32,
                    falloff: self.falloff(table.full_at, table.range, key)?,
                };
                let color = linear_rgb(table.color) * table.strength as f32;
                shadowed(LightKind::Spot(spot), color, &table.shadow)
            }
            LightTable::Projector(table) => self.projector(table, key)?,
            LightTable::Ambient(_) => Light::directional(Vec3::Y, Vec3::ZERO),
        })
    }

    fn projector(&self, table: &ProjectorTable, key: &Key) -> Result<Light, LookError> {
        let (position, target) = (DVec3::from_array(table.position), DVec3::from_array(table.target));
        self.check_direction((target - position).as_vec3(), &key.name("target"))?;
        let (slide, own_aspect) = match (&table.image, &table.texture) {
            (Some(_), Some(_)) => {
                return Err(self.file.error(key, LookProblem::Exclusive("image", "texture")));
            }
            (None, None) => {
                let keys = vec!["image".to_owned(), "texture".to_owned()];
                return Err(self.file.error(key, LookProblem::OneNeeded(keys)));
            }
            (Some(name), None) => {
                let image = Image::load_as(self.file.file(name), ColorSpace::Srgb);
                let image = self.accept(&key.name("image"), image)?;
                let aspect = f64::from(image.width) / f64::from(image.height);
                let image = Arc::new(ImageTexture::new(Arc::new(image)));
                (Slide::Image { image, options: SampleOptions::default() }, aspect)
            }
            (None, Some(name)) => {
                let mut resolver = Resolver::without_model(self.file, self.images, self.options);
                (Slide::Texture(resolver.texture(&name.0)?), 1.0)
            }
        };
        let lens = match table.height {
            Some(height) => Lens::Orthographic { height },
            None => Lens::Perspective { fov_degrees: table.fov },
        };
        let projector = Projector {
            position,
            target,
            up: DVec3::from_array(table.up),
            lens,
            aspect: table.aspect.unwrap_or(own_aspect),
            slide,
            falloff: self.falloff(table.full_at, table.range, key)?,
        };
        let color = linear_rgb(table.color) * table.strength as f32;
        Ok(shadowed(LightKind::Projector(projector), color, &table.shadow))
    }

    fn falloff(&self, full_at: Option<f64>, range: Option<f64>, key: &Key) -> Result<Falloff, LookError> {
        match (full_at, range) {
            (Some(reference), range) => Ok(Falloff::InverseSquare { reference, range }),
            (None, None) => Ok(Falloff::None),
            (None, Some(_)) => Err(self.file.error(key, LookProblem::MissingKey("full_at".into()))),
        }
    }

    fn check_direction(&self, direction: Vec3, key: &Key) -> Result<(), LookError> {
        if direction.try_normalize().is_some() {
            return Ok(());
        }
        Err(self.file.error(key, LookProblem::NoDirection))
    }

    fn accept<T, E: std::error::Error + Send + Sync + 'static>(
        &self,
        key: &Key,
        result: Result<T, E>,
    ) -> Result<T, LookError> {
        result.map_err(|error| self.file.error(key, LookProblem::refused(error)))
    }

    /// The environment's map, unless it is to be captured from the scene.
    pub(super) fn environment_map(
        &self,
        table: &EnvironmentTable,
    ) -> Result<Option<EnvironmentMap>, LookError> {
        let key = Key::of(["environment"]);
        let given = [
            ("image", table.image.is_some()),
            ("faces", table.faces.is_some()),
            ("sky", table.sky.is_some()),
            ("capture", table.capture.is_some()),
            ("color", table.color.is_some()),
        ];
        let mut named = given.iter().filter(|(_, is_there)| *is_there).map(|(name, _)| *name);
        match (named.next(), named.next()) {
            (None, _) => {
                let keys = given.iter().map(|(name, _)| (*name).to_owned()).collect();
                return Err(self.file.error(&key, LookProblem::OneNeeded(keys)));
            }
            (Some(first), Some(second)) => {
                return Err(self.file.error(&key, LookProblem::Exclusive(first, second)));
            }
            _ => {}
        }
        let map = if let Some(name) = &table.image {
            let path = self.file.file(name);
            let map = match table.layout {
                Some(layout) => EnvironmentMap::load_as(path, layout_of(layout)),
                None => EnvironmentMap::load(path),
            };
            self.accept(&key.name("image"), map)?
        } else if let Some(names) = &table.faces {
            let paths = names.each_ref().map(|name| self.file.file(name));
            let map = EnvironmentMap::load_faces(paths.each_ref().map(PathBuf::as_path));
            self.accept(&key.name("faces"), map)?
        } else if let Some(sky) = &table.sky {
            self.sky(sky, table.size, &key.name("sky"))?
        } else if let Some(color) = table.color {
            let color = linear_rgb(color);
            EnvironmentMap::from_function(EnvironmentForm::Cube, 4, |_, _| color)
        } else {
            return Ok(None);
        };
        Ok(Some(converted(map, table)))
    }

    pub(super) fn sky(&self, table: &SkyTable, size: u32, key: &Key) -> Result<EnvironmentMap, LookError> {
        let sky = Sky {
            to_sun: DVec3::from_array(table.to_sun).as_vec3(),
            turbidity: table.turbidity as f32,
            ground: linear_rgb(table.ground),
            has_sun: table.sun,
        };
        self.accept(key, sky.to_map(size))
    }
}

/// In the form that the look asks for.
pub(super) fn converted(map: EnvironmentMap, table: &EnvironmentTable) -> EnvironmentMap {
    let form = match table.form {
        None => return map,
        Some(EnvironmentFormName::Sphere) => EnvironmentForm::Sphere,
        Some(EnvironmentFormName::Cube) => EnvironmentForm::Cube,
        Some(EnvironmentFormName::Paraboloid) => EnvironmentForm::DualParaboloid,
    };
    map.converted(form, table.size)
}

/// A map as light.
pub(super) fn environment_light(map: EnvironmentMap, table: &EnvironmentTable) -> EnvironmentLight {
    EnvironmentLight {
        map: Arc::new(PrefilteredEnvironment::new(Arc::new(map))),
        strength: table.strength as f32,
        rotation_degrees: table.rotation as f32,
    }
}

fn layout_of(name: EnvironmentLayoutName) -> EnvironmentLayout {
    match name {
        EnvironmentLayoutName::Panorama => EnvironmentLayout::Panorama,
        EnvironmentLayoutName::HorizontalCross => EnvironmentLayout::HorizontalCross,
        EnvironmentLayoutName::VerticalCross => EnvironmentLayout::VerticalCross,
        EnvironmentLayoutName::HorizontalStrip => EnvironmentLayout::HorizontalStrip,
        EnvironmentLayoutName::VerticalStrip => EnvironmentLayout::VerticalStrip,
        EnvironmentLayoutName::Paraboloids => EnvironmentLayout::DualParaboloid,
        EnvironmentLayoutName::MirrorBall => EnvironmentLayout::MirrorBall,
    }
}

fn shadowed(kind: LightKind, color: Vec3, shadow: &Option<ShadowTable>) -> Light {
    let options = shadow.as_ref().map(|table| ShadowOptions {
        resolution: table.size,
        bias: table.bias as f32,
        normal_offset: table.normal_bias as f32,
        penumbra: match table.lamp_radius {
            Some(radius) => Penumbra::Lamp(radius as f32),
            None if table.softness > 0.0 => Penumbra::Even(table.softness as f32),
            None => Penumbra::Sharp,
        },
    });
    Light { shadow: options, ..Light::new(kind, color) }
}

// What a look puts into tiles.

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
