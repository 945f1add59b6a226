//! Light from surroundings, for pictures.

use std::path::Path;
use std::sync::Arc;

use fantex_base::Result;
use fantex_scene::{AmbientLight, EnvironmentLight, Lights};
use fantex_texture::environment::{EnvironmentMap, PrefilteredEnvironment, Sky};
use glam::Vec3;

/// Surroundings that light a scene.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// Their light.
    pub light: EnvironmentLight,
    /// Colour of the lamp that stands for the sun of a computed sky.
    pub sun: Option<Vec3>,
}

impl Surroundings {
    /// The name that stands for a computed sky instead of a file.
    pub const SKY: &'static str = "sky";

    /// Side of the faces of a computed sky.
    const SKY_SIDE: u32 = 512;

    /// Reads a picture of surroundings, or computes a sky where the path is [`SKY`](Self::SKY), with the sun in the direction `to_sun`, world axes.
    ///
    /// # Errors
    /// The picture cannot be read, or has no form that surroundings have; there is no such direction.
    pub fn load(path: &Path, to_sun: Option<Vec3>) -> Result<Self> {
        let (map, sun) = if path == Path::new(Self::SKY) {
            let sky = Sky { to_sun: to_sun.unwrap_or(Sky::default().to_sun), ..Sky::default() };
            // The disc would be seen, but also light the model a second time: the lamp stands for it.
            (sky.to_map(Self::SKY_SIDE)?, Some(sky.sun_color()))
        } else {
            (EnvironmentMap::load(path)?, None)
        };
        let map = Arc::new(PrefilteredEnvironment::new(Arc::new(map)));
        Ok(Self { light: EnvironmentLight::new(map), sun })
    }

    /// Puts their light in the place of the ambient one. Lamps shine like the sun of a computed sky; beside a picture they go unless `keeps_lamps`.
    pub fn shine(&self, lights: &mut Lights, keeps_lamps: bool) {
        lights.ambient = AmbientLight::environment(self.light.clone());
        lights.lamps.retain_mut(|lamp| match self.sun {
            Some(color) => {
                lamp.color = color;
                true
            }
            None => keeps_lamps,
        });
    }
}
