//! Lamps and surroundings of a look, and the light that is baked.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::{
    BakeLight, LightMapOptions, LightMapSource, LightScene, LitSource, LookSource, Source, SourceReflector,
};
use fantex_base::{Error, Result};
use fantex_look::data::{Beam, EnvironmentTable, LightBakeTable, LightTable, ProjectorTable};
use fantex_look::problem;
use fantex_look::{Key, Resolver};
use fantex_mesh::{Mesh, inward_parts};
use fantex_render::{
    AmbientLight, Cookie, EnvironmentLight, Falloff, Lens, Light, LightKind, Lights, Projector, SpotLight,
};
use fantex_texture::environment::{EnvironmentForm, EnvironmentMap, PrefilteredEnvironment, Sky};
use fantex_texture::look::{LookMaterial, Slot};
use fantex_texture::material::LeftOut;
use fantex_texture::{ColorSpace, Image, ImageTexture, SampleOptions, Texture};
use glam::{DVec3, Vec3};

use super::{MaterialResolver, ResolvedMaterials, note_of_lacking_coordinates};
use crate::baker::materials::of_look;
use crate::notes::counted;

impl MaterialResolver<'_> {
    /// The lamps of the look, without its environment; `None` where it has neither.
    pub(super) fn lights(&self) -> Result<Option<Lights>> {
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
                    let strength = table.strength;
                    lights.ambient.sky += sky.rgb() * strength;
                    lights.ambient.ground += ground.rgb() * strength;
                }
                lamp => lights.lamps.push(self.lamp(lamp, &key)?),
            }
        }
        Ok(Some(lights))
    }

    fn lamp(&self, table: &LightTable, key: &Key) -> Result<Light> {
        Ok(match table {
            LightTable::Sun(table) => {
                let to_light = DVec3::from_array(table.to_light).as_vec3();
                self.check_direction(to_light, &key.name("to_light"))?;
                let color = table.color.rgb() * table.strength;
                Light { shadow: table.shadow, ..Light::directional(to_light, color) }
            }
            LightTable::Point(table) => {
                let falloff = self.falloff(&table.beam, key)?;
                let kind = LightKind::Point { position: DVec3::from_array(table.position), falloff };
                beaming(kind, &table.beam)
            }
            LightTable::Spot(table) => {
                let position = DVec3::from_array(table.position);
                let direction = (DVec3::from_array(table.target) - position).as_vec3();
                self.check_direction(direction, &key.name("target"))?;
                if table.inner > table.outer {
                    let (inner, outer) = (table.inner, table.outer);
                    let sentence = format!("expected a number from {inner} to 90, found {outer}");
                    return Err(self.file.error(&key.name("outer"), Error::malformed(sentence)));
                }
                let spot = SpotLight {
                    position,
                    direction,
                    inner_degrees: table.inner as f32,
                    outer_degrees: table.outer as f32,
                    falloff: self.falloff(&table.beam, key)?,
                };
                beaming(LightKind::Spot(spot), &table.beam)
            }
            LightTable::Projector(table) => self.projector(table, key)?,
            LightTable::Ambient(_) => Light::directional(Vec3::Y, Vec3::ZERO),
        })
    }

    fn projector(&self, table: &ProjectorTable, key: &Key) -> Result<Light> {
        let (position, target) = (DVec3::from_array(table.position), DVec3::from_array(table.target));
        self.check_direction((target - position).as_vec3(), &key.name("target"))?;
        let (cookie, own_aspect) = match (&table.image, &table.texture) {
            (Some(_), Some(_)) => {
                return Err(self.file.error(key, problem::exclusive("image", "texture")));
            }
            (None, None) => {
                return Err(self.file.error(key, problem::one_needed(&["image", "texture"])));
            }
            (Some(name), None) => {
                let image = Image::load_as(self.file.file(name), ColorSpace::Srgb);
                let image = self.accept(&key.name("image"), image)?;
                let aspect = f64::from(image.width) / f64::from(image.height);
                let image = Arc::new(ImageTexture::new(Arc::new(image)));
                (Cookie::Image { image, options: SampleOptions::default() }, aspect)
            }
            (None, Some(name)) => {
                let mut resolver = Resolver::without_model(self.file, self.images, self.options);
                (Cookie::Texture(resolver.texture(&name.0)?), 1.0)
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
            cookie,
            falloff: self.falloff(&table.beam, key)?,
        };
        Ok(beaming(LightKind::Projector(projector), &table.beam))
    }

    fn falloff(&self, beam: &Beam, key: &Key) -> Result<Falloff> {
        match (beam.full_at, beam.range) {
            (Some(reference), range) => Ok(Falloff::InverseSquare { reference, range }),
            (None, None) => Ok(Falloff::None),
            (None, Some(_)) => Err(self.file.error(key, problem::missing_key("full_at"))),
        }
    }

    fn check_direction(&self, direction: Vec3, key: &Key) -> Result<()> {
        if direction.try_normalize().is_some() {
            return Ok(());
        }
        Err(self.file.error(key, problem::no_direction()))
    }

    pub(super) fn accept<T>(&self, key: &Key, result: Result<T>) -> Result<T> {
        result.map_err(|error| self.file.error(key, error))
    }

    /// The environment's light, unless it is to be captured from the scene.
    pub(super) fn environment_light(&self, table: &EnvironmentTable) -> Result<Option<EnvironmentLight>> {
        // These leave the map as it is.
        let map_alone = EnvironmentTable { strength: 1.0, rotation: 0.0, visible: true, ..table.clone() };
        let name = format!("{} {map_alone:?}", self.file.path().display());
        let map = self.images.environment(name, || self.environment_map(table))?;
        Ok(map.map(|map| lit_by(map, table)))
    }

    /// The environment's map, unless it is to be captured from the scene.
    fn environment_map(&self, table: &EnvironmentTable) -> Result<Option<EnvironmentMap>> {
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
                return Err(self.file.error(&key, problem::one_needed(&given.map(|(name, _)| name))));
            }
            (Some(first), Some(second)) => {
                return Err(self.file.error(&key, problem::exclusive(first, second)));
            }
            _ => {}
        }
        let map = if let Some(name) = &table.image {
            let path = self.file.file(name);
            let map = match table.layout {
                Some(layout) => EnvironmentMap::load_as(path, layout),
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
            let color = color.rgb();
            EnvironmentMap::from_function(EnvironmentForm::Cube, 4, |_, _| color)
        } else {
            return Ok(None);
        };
        self.converted(map, table).map(Some)
    }

    pub(super) fn sky(&self, sky: &Sky, size: u32, key: &Key) -> Result<EnvironmentMap> {
        self.accept(key, sky.to_map(size))
    }

    /// A map in the form that the look asks for.
    pub(super) fn converted(&self, map: EnvironmentMap, table: &EnvironmentTable) -> Result<EnvironmentMap> {
        let Some(form) = table.form else { return Ok(map) };
        let key = Key::of(["environment"]).name("size");
        let _held = self.accept(&key, EnvironmentMap::reserve(form, table.size))?;
        Ok(map.converted(form, table.size))
    }
}

/// A map as light.
pub(super) fn environment_light(map: EnvironmentMap, table: &EnvironmentTable) -> EnvironmentLight {
    lit_by(Arc::new(PrefilteredEnvironment::new(Arc::new(map))), table)
}

fn lit_by(map: Arc<PrefilteredEnvironment>, table: &EnvironmentTable) -> EnvironmentLight {
    EnvironmentLight { map, strength: table.strength, rotation_degrees: table.rotation as f32 }
}

fn beaming(kind: LightKind, beam: &Beam) -> Light {
    Light { shadow: beam.shadow, ..Light::new(kind, beam.color.rgb() * beam.strength) }
}

/// A look on a model, ready to be baked.
#[derive(Clone, Debug)]
pub struct LookBake {
    materials: Vec<Arc<LookMaterial>>,
    time: f32,
    /// Per material; empty where displacements are geometry.
    heights: Vec<Option<Slot>>,
    light: Option<BakedLight>,
    left_out: LeftOut,
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

impl LookBake {
    /// Resolves a look on a model for a bake. Displacements become its geometry, or heights where the look says so; its materials are replaced by those that the asset needs
    /// beside its tiles.
    ///
    /// # Errors
    /// A texture cannot be made, or the look does not say which material the model has.
    pub fn new(resolver: &MaterialResolver<'_>, mesh: &mut Mesh, model: &Path) -> Result<Self> {
        let bake = &resolver.file.look().bake;
        let object = resolver.model_object();
        let mut heights = Vec::new();
        let ResolvedMaterials { mut materials, names, left_out } = if bake.heights {
            let resolved = resolver.materials(mesh, model, object)?;
            let mut textures = Resolver::new(resolver.file, mesh, resolver.images, resolver.options);
            let of_name = |name: &Option<String>| match name {
                Some(name) => textures.displacement(name),
                None => Ok(None),
            };
            heights = resolved.names.iter().map(of_name).collect::<Result<_>>()?;
            resolved
        } else {
            let (shape, resolved) = resolver.shape_and_materials(std::mem::take(mesh), model, object)?;
            *mesh = shape;
            resolved
        };
        if bake.heights && heights.iter().all(Option::is_none) {
            let key = Key::of(["bake", "heights"]);
            let used: Vec<&str> = names.iter().flatten().map(String::as_str).collect();
            let sentence = format!("no material of the model ({}) has a displacement", used.join(", "));
            return Err(resolver.file.error(&key, Error::malformed(sentence)));
        }
        if let Some(name) = &bake.texture {
            let mut textures = Resolver::new(resolver.file, mesh, resolver.images, resolver.options);
            let texture = textures.texture(&name.0)?;
            let painted = Arc::new(painted(texture));
            materials.iter_mut().for_each(|material| *material = Arc::clone(&painted));
        }
        let light = bake.light.as_ref().map(|table| resolver.baked_light(table)).transpose()?;
        mesh.materials = of_look(&materials, light.is_some());
        Ok(Self { materials, time: bake.time as f32, heights, light, left_out })
    }

    /// Images of the model that could not be read.
    pub fn left_out(&self) -> &LeftOut {
        &self.left_out
    }

    /// Whether light is baked in.
    pub fn has_light(&self) -> bool {
        self.light.is_some()
    }

    /// Says that light cannot reach the fronts of parts that are inside out, if there are such. Not where surfaces glow: a part may be a room
    /// that lights itself.
    fn note_of_inward_parts(&self, mesh: &Mesh) -> Option<String> {
        let light = self.light.as_ref()?;
        let glows = |material: &Arc<LookMaterial>| match &material.emission {
            Slot::Constant(value) => value.truncate() != Vec3::ZERO,
            Slot::Texture(_) => true,
        };
        if self.materials.iter().any(glows) {
            return None;
        }
        let lamps = light.lamps.iter().filter_map(|lamp| match lamp {
            BakeLight::Directional { .. } => None,
            BakeLight::Point { position, .. } | BakeLight::Spot { position, .. } => Some(*position),
        });
        let lamps: Vec<Vec3> = lamps.map(|position| mesh.world_from_mesh.inverse_point(position)).collect();
        let parts = inward_parts(mesh, &lamps);
        let triangles: usize = parts.iter().map(Vec::len).sum();
        (triangles > 0).then(|| {
            format!(
                "no light reaches the fronts of {} ({}): the model is inside out there; turn these triangles over",
                counted(parts.len() as u64, "closed part"),
                counted(triangles as u64, "triangle")
            )
        })
    }

    /// What whoever bakes it should know, a sentence each. The mesh is the one of [`LookBake::new`].
    pub fn notes(&self, mesh: &Mesh) -> Vec<String> {
        let heights = self.heights.iter().flatten().filter_map(Slot::texture);
        let textures: Vec<_> = self.materials.iter().flat_map(|m| m.textures()).chain(heights).collect();
        let notes = [note_of_lacking_coordinates(mesh, &textures), self.note_of_inward_parts(mesh)];
        self.left_out.notes().into_iter().chain(notes.into_iter().flatten()).collect()
    }

    /// Hands what is baked to `then`. The mesh is the one of [`LookBake::new`].
    ///
    /// # Errors
    /// A texture depends on the eye, or a number of the light is out of range.
    pub fn with_source<R>(&self, mesh: &Mesh, then: impl FnOnce(&dyn Source) -> R) -> Result<R> {
        let mut source = LookSource::new(mesh, self.materials.clone(), self.time)?;
        if !self.heights.is_empty() {
            source = source.with_heights(self.heights.clone())?;
        }
        let Some(light) = &self.light else { return Ok(then(&source)) };
        let source = source.with_all_emission();
        let reflector = SourceReflector::new(mesh, &source);
        let sky = |direction: Vec3| light.sky.radiance(direction);
        let scene = LightScene { lights: light.lamps.clone(), sky: &sky, reflector: &reflector };
        let map = LightMapSource::new(mesh, &scene, light.options)?;
        Ok(if light.is_colored { then(&LitSource::new(map, Some(&source))) } else { then(&map) })
    }
}

impl SkyLight {
    /// Of the sky above the horizon and of the ground below it: what a surface that nothing hides gets of both goes from one to the other with the
    /// cosine of its slope, as [`AmbientLight`] has it.
    fn radiance(&self, direction: Vec3) -> Vec3 {
        match &self.environment {
            Some(light) => light.reflected(direction, [Vec3::ZERO; 2], 0.0),
            None if direction.y > 0.0 => self.sky,
            None => self.ground,
        }
    }
}

impl MaterialResolver<'_> {
    fn baked_light(&self, table: &LightBakeTable) -> Result<BakedLight> {
        // What pictures refuse is not baked.
        self.lights()?;
        let look = self.file.look();
        let mut sky = SkyLight { sky: Vec3::ZERO, ground: Vec3::ZERO, environment: None };
        if look.light.is_empty() && look.environment.is_none() {
            (sky.sky, sky.ground) = (Vec3::ONE, Vec3::ONE);
        }
        if let Some(table) = &look.environment {
            let environment = self.environment_light(table)?.ok_or_else(|| {
                let sentence = "light is baked without a scene that could be captured; give surroundings by image, faces, sky or color";
                self.file.error(&Key::of(["environment", "capture"]), Error::unsupported(sentence))
            })?;
            sky.environment = Some(environment);
        }
        let mut lamps = Vec::new();
        for lamp in &look.light {
            match lamp {
                LightTable::Ambient(table) => {
                    sky.sky += table.sky.rgb() * table.strength;
                    sky.ground += table.ground.unwrap_or(table.sky).rgb() * table.strength;
                }
                lamp => lamps.extend(bake_light(lamp)),
            }
        }
        let options = LightMapOptions {
            quantity: table.quantity,
            samples: table.samples,
            target_error: table.target_error.map(|error| error as f32),
            max_samples: table.max_samples.max(table.samples),
            bounces: table.bounces,
            occlusion_distance: table.occlusion_distance,
            denoise: table.denoise,
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
    let at_one =
        |beam: &Beam| beam.color.rgb() * (beam.strength * beam.full_at.map_or(1.0, |d| d * d) as f32);
    match lamp {
        LightTable::Sun(sun) => Some(BakeLight::Directional {
            to_light: direction(sun.to_light),
            color: sun.color.rgb() * sun.strength,
            radius_degrees: sun.radius as f32,
        }),
        LightTable::Point(point) => Some(BakeLight::Point {
            position: DVec3::from_array(point.position),
            color: at_one(&point.beam),
            radius: point.radius,
        }),
        LightTable::Spot(spot) => Some(BakeLight::Spot {
            position: DVec3::from_array(spot.position),
            axis: (DVec3::from_array(spot.target) - DVec3::from_array(spot.position)).as_vec3(),
            color: at_one(&spot.beam),
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
