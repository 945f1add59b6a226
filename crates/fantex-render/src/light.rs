//! Lights.

use glam::Vec3;

use crate::{Camera, EnvironmentLight};

/// Light from one direction, as from the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalLight {
    /// From the surface to the light; any length but zero. World directions, which are mesh space's, too.
    pub to_light: Vec3,
    /// Linear RGB: what a white, perfectly diffuse surface that faces the light reflects to every side.
    pub color: Vec3,
}

/// Light from everywhere: an environment, or one colour from above, one from below, mixed by height in between.
#[derive(Clone, Debug, PartialEq)]
pub struct AmbientLight {
    /// Linear RGB from straight above.
    pub sky: Vec3,
    /// Linear RGB from straight below.
    pub ground: Vec3,
    /// Unit vector upwards.
    pub up: Vec3,
    /// Takes the place of both colours.
    pub environment: Option<EnvironmentLight>,
}

impl AmbientLight {
    /// The same colour from all sides.
    pub fn uniform(color: Vec3) -> Self {
        Self { sky: color, ground: color, up: Vec3::Y, environment: None }
    }

    /// Colour from a (unit) direction; also what a white surface with that normal reflects.
    pub(crate) fn radiance_from(&self, direction: Vec3) -> Vec3 {
        self.ground.lerp(self.sky, 0.5 + 0.5 * direction.dot(self.up))
    }
}

/// All light of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Lights {
    /// Light from everywhere.
    pub ambient: AmbientLight,
    /// Light from certain directions.
    pub directional: Vec<DirectionalLight>,
}

impl Default for Lights {
    /// A sun high in front (+z) and to the left, and a sky a little brighter than the ground.
    fn default() -> Self {
        Self::sun(Vec3::new(-0.5, 0.8, 0.7))
    }
}

impl Lights {
    /// A white sun and a sky. Together they stay below one, so that a white model does not burn out.
    pub fn sun(to_light: Vec3) -> Self {
        Self {
            ambient: AmbientLight { sky: Vec3::splat(0.33), ..AmbientLight::uniform(Vec3::splat(0.2)) },
            directional: vec![DirectionalLight { to_light, color: Vec3::splat(0.65) }],
        }
    }

    /// The light of an environment alone.
    pub fn environment(light: EnvironmentLight) -> Self {
        Self { ambient: AmbientLight::environment(light), directional: Vec::new() }
    }

    /// A sun over the photographer's left shoulder: every side of a model gets its picture in good light.
    pub fn behind(camera: &Camera) -> Self {
        let back = (camera.eye - camera.target).normalize_or(glam::DVec3::Z);
        let right = camera.up.cross(back).normalize_or(glam::DVec3::X);
        let up = back.cross(right);
        Self::sun((back - right * 0.6 + up * 0.7).as_vec3())
    }
}
