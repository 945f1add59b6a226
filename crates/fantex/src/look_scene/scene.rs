//! A look as a scene, and its pictures.

use fantex_base::{Aabb, Error, Result};
use fantex_look::Key;
use fantex_look::data::{CameraTable, CaptureTable, EnvironmentTable, PictureTable};
use fantex_look::problem;
use fantex_mesh::ObjectSpace;
use fantex_render::{
    AmbientLight, Background, Camera, CaptureOptions, FilterOptions, Lights, RenderOptions, Rendering, Scene,
    SceneObject, StopSignal, Surface, ToneMap, capture_environment, render, render_with_glow,
};
use fantex_scene::world_bounds;
use fantex_texture::Filter;
use fantex_texture::environment::EnvironmentMap;
use fantex_texture::material::LeftOut;
use glam::DVec3;

use super::lights::environment_light;
use super::objects::{GivenModel, Object, Shape};
use super::{MaterialResolver, note_of_lacking_coordinates};

/// What the command line, or a program, says instead of the look.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PictureChanges {
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// Samples per pixel.
    pub samples: Option<u32>,
    /// Filter of an asset's tiles. (That of images is a matter of the [`MaterialResolver`].)
    pub filter: Option<Filter>,
    /// Where the camera is, world units.
    pub eye: Option<DVec3>,
    /// What it looks at, world units.
    pub target: Option<DVec3>,
    /// Vertical opening angle in degrees.
    pub fov_degrees: Option<f64>,
    /// What is seen behind everything.
    pub background: Option<Background>,
}

/// A look with all that it shows.
#[derive(Debug)]
pub struct LookScene<'a> {
    resolver: MaterialResolver<'a>,
    objects: Vec<Object>,
    lights: Option<Lights>,
    changes: PictureChanges,
}

impl<'a> LookScene<'a> {
    /// Reads all models and images. `given` is the model of objects that name none.
    ///
    /// # Errors
    /// A model or an image cannot be read, a texture cannot be made, or the look names nothing to show.
    pub fn new(
        resolver: MaterialResolver<'a>,
        given: Option<&GivenModel>,
        changes: PictureChanges,
    ) -> Result<Self> {
        let objects = resolver.objects(given)?;
        let mut lights = resolver.lights()?;
        if let (Some(lights), Some(table)) = (&mut lights, &resolver.file.look().environment)
            && let Some(environment) = resolver.environment_light(table)?
        {
            lights.ambient = AmbientLight::environment(environment);
        }
        Ok(Self { resolver, objects, lights, changes })
    }

    /// What whoever looks at it should know, a sentence each.
    pub fn notes(&self) -> Vec<String> {
        let notes = |(index, object): (usize, &Object)| {
            let lacking = match &object.shape {
                Shape::Model { mesh, materials } => {
                    let textures: Vec<_> = materials.iter().flat_map(|m| m.textures()).collect();
                    note_of_lacking_coordinates(mesh, &textures)
                }
                Shape::Asset(_) => None,
            };
            let name = match &object.name {
                Some(name) => Some(format!("object {name}")),
                None => (self.objects.len() > 1).then(|| Key::of(["object"]).index(index).to_string()),
            };
            let named = move |note| match &name {
                Some(name) => format!("{name}: {note}"),
                None => note,
            };
            object.left_out.notes().into_iter().chain(lacking).map(named)
        };
        self.objects.iter().enumerate().flat_map(notes).collect()
    }

    /// Images of all models that could not be read.
    pub fn left_out(&self) -> LeftOut {
        let mut all = LeftOut::default();
        self.objects.iter().for_each(|object| all.extend(object.left_out.clone()));
        all
    }

    /// The times of all pictures, in seconds: one, or those of the animation.
    pub fn times(&self) -> Vec<f32> {
        let picture = self.picture();
        match &picture.frames {
            None => vec![picture.time as f32],
            Some(frames) => {
                let step = (frames.to - frames.from) / f64::from(frames.count);
                (0..frames.count).map(|i| (frames.from + step * f64::from(i)) as f32).collect()
            }
        }
    }

    /// The picture at a time in seconds.
    ///
    /// # Errors
    /// The renderer refuses: a camera without direction, objects that are flattened.
    pub fn render(&self, time: f32) -> Result<Rendering> {
        self.with_scene(time, |scene| {
            let options = self.options(time);
            self.render_scene(scene, &self.camera(scene, &options)?, options)
        })
    }

    /// The picture at a time in seconds from a camera other than the look's.
    ///
    /// # Errors
    /// As those of [`render`](Self::render).
    pub fn render_from(&self, camera: &Camera, time: f32) -> Result<Rendering> {
        self.with_scene(time, |scene| self.render_scene(scene, camera, self.options(time)))
    }

    /// A quick picture, for whoever looks around: of another size, and with other samples, than the look says.
    ///
    /// # Errors
    /// As those of [`render`](Self::render), or it was stopped.
    pub fn render_sized(
        &self,
        camera: &Camera,
        time: f32,
        [width, height]: [u32; 2],
        samples: u32,
        stop: Option<StopSignal>,
    ) -> Result<Rendering> {
        let options = RenderOptions { width, height, samples, stop, ..self.options(time) };
        self.with_scene(time, |scene| self.render_scene(scene, camera, options))
    }

    /// The look's camera for a picture of so many pixels, and the box that holds the whole scene; world space.
    ///
    /// # Errors
    /// Objects are flattened.
    pub fn view(&self, [width, height]: [u32; 2]) -> Result<(Camera, Aabb<DVec3>)> {
        let time = self.times()[0];
        let options = RenderOptions { width, height, ..self.options(time) };
        self.with_scene(time, |scene| Ok((self.camera(scene, &options)?, world_bounds(scene.mesh()))))
    }

    /// Cameras that stand evenly around the whole scene, as those of [`Camera::orbit`]. `aspect` is width / height.
    ///
    /// # Errors
    /// Objects are flattened.
    pub fn orbit(&self, count: usize, aspect: f64) -> Result<Vec<Camera>> {
        self.with_scene(0.0, |scene| Ok(Camera::orbit(scene.mesh(), count, aspect)))
    }

    fn with_scene<R>(&self, time: f32, then: impl FnOnce(&Scene<'_>) -> Result<R>) -> Result<R> {
        let filter = FilterOptions {
            filter: self.changes.filter.unwrap_or(Filter::Anisotropic),
            ..FilterOptions::default()
        };
        let surfaces: Vec<Box<dyn Surface + '_>> =
            self.objects.iter().map(|object| object.surface(time, filter)).collect();
        let placed = self.objects.iter().zip(&surfaces).map(|(object, surface)| {
            SceneObject::new(object.mesh(), surface.as_ref()).placed(object.world_from_object)
        });
        then(&Scene::new(placed.collect())?)
    }

    fn render_scene(
        &self,
        scene: &Scene<'_>,
        camera: &Camera,
        mut options: RenderOptions,
    ) -> Result<Rendering> {
        let lights = self.lights_of(scene, camera)?;
        let is_open = self.changes.background.is_none() && options.background == Background::default();
        if is_open && self.shows_environment(&lights) {
            options.background = Background::Environment { blur: 0.0 };
        }
        let picture = self.picture();
        let seen = match &picture.glow {
            Some(glow) if glow.threshold.is_none() => {
                render_with_glow(scene.mesh(), scene, camera, &lights, &options, glow)
            }
            _ => render(scene.mesh(), scene, camera, &lights, &options),
        };
        let mut rendering = seen?;
        if let Some(glow) = picture.glow.filter(|glow| glow.threshold.is_some()) {
            rendering.picture = rendering.picture.with_glow(&rendering.picture, &glow);
        }
        if picture.tone_mapping != ToneMap::Clip {
            rendering.picture = rendering.picture.tone_mapped(picture.tone_mapping);
        }
        Ok(rendering)
    }

    /// Tiles of assets that were damaged and replaced by coarser ones, so far.
    pub fn damaged_tiles(&self) -> u64 {
        self.objects.iter().map(Object::damaged_tiles).sum()
    }

    fn picture(&self) -> &PictureTable {
        &self.resolver.file.look().picture
    }

    fn options(&self, time: f32) -> RenderOptions {
        let picture = self.picture();
        let [width, height] = self.changes.size.unwrap_or(picture.size.map(|side| side.0));
        RenderOptions {
            width,
            height,
            samples: self.changes.samples.unwrap_or(picture.samples),
            shading_rate: picture.shading,
            interpolation: picture.interpolation,
            background: match (self.changes.background, picture.background) {
                (Some(background), _) => background,
                (None, None) => Background::default(),
                (None, Some(color)) if color.0.w == 0.0 => Background::Transparent,
                (None, Some(color)) => Background::Color(color.rgb()),
            },
            exposure: picture.exposure.exp2() as f32,
            time,
            ..RenderOptions::default()
        }
    }

    fn camera(&self, scene: &Scene<'_>, options: &RenderOptions) -> Result<Camera> {
        let aspect = f64::from(options.width) / f64::from(options.height);
        let table = self.resolver.file.look().camera.clone();
        let CameraTable { eye, target, up, fov } = table.unwrap_or_default();
        let point =
            |given: Option<DVec3>, of_look: Option<[f64; 3]>| given.or(of_look.map(DVec3::from_array));
        let eye = point(self.changes.eye, eye);
        let target = point(self.changes.target, target);
        let fov_degrees = self.changes.fov_degrees.unwrap_or(fov);
        let (view, up) = (Camera::THREE_QUARTER, DVec3::from_array(up));
        let framed = Camera::framing_mesh_with(scene.mesh(), view, aspect, up, fov_degrees);
        let camera = match (eye, target) {
            (None, None) => Camera { up, ..framed },
            (eye, target) => Camera {
                eye: eye.unwrap_or(framed.eye),
                target: target.unwrap_or(scene.bounds().center()),
                up,
                fov_degrees,
            },
        };
        let PictureChanges { eye, target, fov_degrees, .. } = self.changes;
        // What the look does not say is told by whoever renders.
        let is_of_look = eye.is_none() && target.is_none() && fov_degrees.is_none();
        match camera.defect() {
            Some(defect) if is_of_look => {
                let sentence = format!("no picture is taken by a camera like this: {defect}");
                Err(self.resolver.file.error(&Key::of(["camera"]), Error::malformed(sentence)))
            }
            _ => Ok(camera),
        }
    }

    fn lights_of(&self, scene: &Scene<'_>, camera: &Camera) -> Result<Lights> {
        let Some(lights) = &self.lights else { return Ok(Lights::behind(camera)) };
        let mut lights = lights.clone();
        let environment = self.resolver.file.look().environment.as_ref();
        if let Some((table, capture)) = environment.and_then(|table| Some((table, table.capture.as_ref()?))) {
            let map = self.captured(scene, &lights, capture)?;
            lights.ambient =
                AmbientLight::environment(environment_light(self.resolver.converted(map, table)?, table));
        }
        Ok(lights)
    }

    fn shows_environment(&self, lights: &Lights) -> bool {
        let environment = self.resolver.file.look().environment.as_ref();
        lights.ambient.environment.is_some() && environment.is_some_and(|table| table.visible)
    }

    /// What an object sees of the scene.
    fn captured(&self, scene: &Scene<'_>, lights: &Lights, table: &CaptureTable) -> Result<EnvironmentMap> {
        let key = Key::of(["environment", "capture"]);
        let mut lights = lights.clone();
        let mut background = Background::default();
        if let Some(sky) = &table.sky {
            let map = self.resolver.sky(sky, table.size, &key.name("sky"))?;
            let sky = environment_light(map, &EnvironmentTable::default());
            lights.ambient = AmbientLight::environment(sky);
            background = Background::Environment { blur: 0.0 };
        }
        let object = match &table.object {
            None => 0,
            Some(name) => {
                let known = self.objects.iter().filter_map(|object| object.name.as_deref());
                let problem = || problem::undefined("object", &name.0, known.clone());
                self.objects
                    .iter()
                    .position(|object| object.name.as_deref() == Some(&name.0))
                    .ok_or_else(|| self.resolver.file.error(&key.name("object"), problem()))?
            }
        };
        let center = match table.position {
            Some(position) => DVec3::from_array(position),
            None => {
                let shape = &self.objects[object];
                let mesh = shape.mesh();
                let middle = mesh.world_from_mesh.point(ObjectSpace::of(mesh).origin_mesh());
                shape.world_from_object.transform_point3(middle)
            }
        };
        let options = CaptureOptions { side: table.size, samples: table.samples, background };
        let hidden = |triangle: usize| scene.object_of(triangle).0 == object;
        capture_environment(scene.mesh(), scene, &lights, center, &options, &hidden)
    }
}
