//! The light of the scene, as the light panel states it.

use std::path::PathBuf;
use std::sync::Arc;

use fantex::base::Result;
use fantex::glam::{DVec2, Vec3};
use fantex::scene::{AmbientLight, Background, EnvironmentLight, Light, Lights, ShadowOptions};
use fantex::texture::environment::{EnvironmentMap, PrefilteredEnvironment, Sky};
use serde::{Deserialize, Serialize};

/// Side of the faces of a computed sky in texels.
const SKY_SIDE: u32 = 256;

/// Degrees that the sun turns by a drag over the picture's height.
const TURN_PER_HEIGHT: f32 = 180.0;

#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surroundings {
    /// A grey sky over a darker ground.
    #[default]
    Studio,
    /// A computed sky with the sun where the lamp is.
    Sky,
    File(PathBuf),
}

/// What is seen where no surface is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BackgroundChoice {
    #[default]
    Dark,
    /// A light gradient, as in pictures of the command line.
    Light,
    /// The surroundings, where they are a map.
    Surroundings,
}

impl BackgroundChoice {
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Dark, "Dark"), (Self::Light, "Light"), (Self::Surroundings, "Surroundings")];
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LightSettings {
    pub has_sun: bool,
    /// Degrees to the right of +z (seen from above: counter-clockwise), 0..360.
    pub sun_azimuth: f32,
    /// Degrees above the horizon, -90..90.
    pub sun_elevation: f32,
    pub sun_strength: f32,
    pub has_shadows: bool,
    pub surroundings: Surroundings,
    pub surroundings_strength: f32,
    /// Degrees by which the surroundings are turned to the left.
    pub surroundings_rotation: f32,
    pub background: BackgroundChoice,
    /// How much surroundings are blurred behind the model, 0..1.
    pub background_blur: f32,
}

impl Default for LightSettings {
    /// The sun over the left shoulder of a photographer in front.
    fn default() -> Self {
        Self {
            has_sun: true,
            sun_azimuth: 324.0,
            sun_elevation: 43.0,
            sun_strength: 1.0,
            has_shadows: true,
            surroundings: Surroundings::Studio,
            surroundings_strength: 1.0,
            surroundings_rotation: 0.0,
            background: BackgroundChoice::Dark,
            background_blur: 0.25,
        }
    }
}

/// What has to be computed or read for some surroundings.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum MapKey {
    /// A sky with the sun in this direction, thousandths.
    Sky([i32; 3]),
    File(PathBuf),
}

#[derive(Clone, Debug)]
pub struct SurroundingsMap {
    pub key: MapKey,
    pub map: Arc<PrefilteredEnvironment>,
    /// Colour of the sun that belongs to it.
    pub sun_color: Option<Vec3>,
}

impl MapKey {
    /// Computes or reads the map; takes up to seconds, so in the background.
    ///
    /// # Errors
    /// The file is no picture of surroundings.
    pub fn make(self) -> Result<SurroundingsMap> {
        let (map, sun_color) = match &self {
            Self::Sky(thousandths) => {
                let to_sun = Vec3::from_array(thousandths.map(|n| n as f32 / 1000.0));
                let sky = Sky { to_sun, ..Sky::default() };
                (sky.to_map(SKY_SIDE)?, Some(sky.sun_color()))
            }
            Self::File(path) => (EnvironmentMap::load(path)?, None),
        };
        let map = Arc::new(PrefilteredEnvironment::new(Arc::new(map)));
        Ok(SurroundingsMap { key: self, map, sun_color })
    }
}

impl LightSettings {
    /// Unit vector to the sun, world axes.
    pub fn to_sun(&self) -> Vec3 {
        let (sin_azimuth, cos_azimuth) = self.sun_azimuth.to_radians().sin_cos();
        let (sin_elevation, cos_elevation) = self.sun_elevation.to_radians().sin_cos();
        Vec3::new(sin_azimuth * cos_elevation, sin_elevation, cos_azimuth * cos_elevation)
    }

    /// Turns the sun by a drag, in units of the picture's height: to the right and down are those of the hand.
    pub fn drag_sun(&mut self, drag: DVec2) {
        let drag = drag.as_vec2() * TURN_PER_HEIGHT;
        self.sun_azimuth = (self.sun_azimuth + drag.x).rem_euclid(360.0);
        self.sun_elevation = (self.sun_elevation - drag.y).clamp(-90.0, 90.0);
    }

    pub fn map_key(&self) -> Option<MapKey> {
        match &self.surroundings {
            Surroundings::Studio => None,
            Surroundings::Sky => {
                let to_sun = self.to_sun().with_y(self.to_sun().y.max(0.0));
                Some(MapKey::Sky(to_sun.to_array().map(|n| (n * 1000.0).round() as i32)))
            }
            Surroundings::File(path) => Some(MapKey::File(path.clone())),
        }
    }

    /// The lights for renderers, with the map as far as it is there.
    pub fn lights(&self, map: Option<&SurroundingsMap>) -> Lights {
        let ambient = match map {
            Some(found) => AmbientLight::environment(EnvironmentLight {
                map: found.map.clone(),
                strength: self.surroundings_strength,
                rotation_degrees: self.surroundings_rotation,
            }),
            None => AmbientLight {
                sky: Vec3::splat(0.36 * self.surroundings_strength),
                ..AmbientLight::uniform(Vec3::splat(0.18 * self.surroundings_strength))
            },
        };
        let color = map.and_then(|found| found.sun_color).unwrap_or(Vec3::splat(0.65));
        let shadow = self.has_shadows.then(ShadowOptions::default);
        let sun = Light { shadow, ..Light::directional(self.to_sun(), color * self.sun_strength) };
        Lights { ambient, lamps: if self.has_sun { vec![sun] } else { Vec::new() } }
    }

    /// What is seen behind the model. Surroundings that are no map have the light gradient.
    pub fn background(&self, map: Option<&SurroundingsMap>) -> Background {
        match (self.background, map) {
            (BackgroundChoice::Dark, _) => {
                Background::Gradient { top: Vec3::splat(0.055), bottom: Vec3::splat(0.016) }
            }
            (BackgroundChoice::Surroundings, Some(_)) => {
                Background::Environment { blur: self.background_blur }
            }
            (BackgroundChoice::Light | BackgroundChoice::Surroundings, _) => Background::default(),
        }
    }

    /// Numbers brought into their ranges.
    pub(crate) fn sanitized(mut self) -> Self {
        let default = Self::default();
        let within = |value: f32, low: f32, high: f32, default: f32| {
            if value.is_finite() { value.clamp(low, high) } else { default }
        };
        self.sun_azimuth = within(self.sun_azimuth, 0.0, 360.0, default.sun_azimuth);
        self.sun_elevation = within(self.sun_elevation, -90.0, 90.0, default.sun_elevation);
        self.sun_strength = within(self.sun_strength, 0.0, 10.0, 1.0);
        self.surroundings_strength = within(self.surroundings_strength, 0.0, 10.0, 1.0);
        self.surroundings_rotation = within(self.surroundings_rotation, -360.0, 360.0, 0.0);
        self.background_blur = within(self.background_blur, 0.0, 1.0, default.background_blur);
        self
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightPreset {
    /// A lamp over the shoulder.
    Studio,
    /// The same from everywhere: colours as they are.
    Even,
    /// A low lamp from the side, which shows relief.
    Grazing,
    Rim,
    Noon,
    Evening,
}

impl LightPreset {
    pub const ALL: [(Self, &'static str); 6] = [
        (Self::Studio, "Studio"),
        (Self::Even, "Even"),
        (Self::Grazing, "Grazing"),
        (Self::Rim, "Rim"),
        (Self::Noon, "Noon"),
        (Self::Evening, "Evening"),
    ];

    /// The light; what is seen behind the model stays as it is in `now`.
    pub fn light(self, now: &LightSettings) -> LightSettings {
        let usual = LightSettings {
            background: now.background,
            background_blur: now.background_blur,
            ..LightSettings::default()
        };
        let sun = |sun_azimuth: f32, sun_elevation: f32| LightSettings {
            sun_azimuth,
            sun_elevation,
            ..usual.clone()
        };
        match self {
            Self::Studio => usual,
            Self::Even => LightSettings { has_sun: false, surroundings_strength: 1.8, ..usual },
            Self::Grazing => {
                LightSettings { sun_strength: 1.3, surroundings_strength: 0.5, ..sun(275.0, 14.0) }
            }
            Self::Rim => LightSettings { sun_strength: 1.6, surroundings_strength: 0.6, ..sun(160.0, 25.0) },
            Self::Noon => LightSettings { surroundings: Surroundings::Sky, ..sun(330.0, 62.0) },
            Self::Evening => LightSettings { surroundings: Surroundings::Sky, ..sun(285.0, 9.0) },
        }
    }

    pub fn is_in(self, light: &LightSettings) -> bool {
        self.light(light) == *light
    }
}
