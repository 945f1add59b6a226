//! Light from the surroundings: two colours, or an environment map.

use std::sync::Arc;

use fantex_texture::environment::{PrefilteredEnvironment, mirrored, mirrored_steps};
use glam::{Quat, Vec3};

use crate::AmbientLight;

/// Light from an environment map.
#[derive(Clone, Debug)]
pub struct EnvironmentLight {
    /// The map and its reflections in rough surfaces.
    pub map: Arc<PrefilteredEnvironment>,
    /// Factor of its light.
    pub strength: f32,
    /// Degrees by which it is turned to the left (seen from above: counter-clockwise) about `+y`.
    pub rotation_degrees: f32,
}

impl PartialEq for EnvironmentLight {
    /// Maps are equal if they are the same one.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.map, &other.map)
            && self.strength == other.strength
            && self.rotation_degrees == other.rotation_degrees
    }
}

impl EnvironmentLight {
    /// A map as it stands.
    pub fn new(map: Arc<PrefilteredEnvironment>) -> Self {
        Self { map, strength: 1.0, rotation_degrees: 0.0 }
    }

    /// What a white diffuse surface with a unit normal reflects, linear RGB.
    pub fn diffuse(&self, normal: Vec3) -> Vec3 {
        self.map.irradiance().diffuse(self.map_from_world() * normal) * self.strength
    }

    /// Light around a direction, gathered by a perceptual roughness (0..1), linear RGB; `steps` are the changes of the unit
    /// direction along the pixel's edges. World axes.
    pub fn reflected(&self, direction: Vec3, steps: [Vec3; 2], roughness: f32) -> Vec3 {
        let turn = self.map_from_world();
        self.map.reflected(turn * direction, steps.map(|step| turn * step), roughness) * self.strength
    }

    fn map_from_world(&self) -> Quat {
        Quat::from_rotation_y(-self.rotation_degrees.to_radians())
    }
}

/// The mirror direction of a point and how it changes over the pixel.
#[derive(Clone, Copy, Debug)]
pub struct MirrorView {
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit vector to where the eye looks in the mirror.
    pub direction: Vec3,
    /// Its change along the pixel's edges.
    pub steps: [Vec3; 2],
}

impl MirrorView {
    /// Neighbouring pixels look along nearly parallel rays: only the normal's change counts, which on anything but flat
    /// mirrors is far larger.
    pub fn new(normal: Vec3, normal_steps: [Vec3; 2], to_eye: Vec3) -> Self {
        let steps = mirrored_steps(normal, normal_steps, to_eye, [Vec3::ZERO; 2]);
        Self { normal, direction: mirrored(normal, to_eye), steps }
    }
}

impl AmbientLight {
    /// The light of an environment map.
    pub fn environment(light: EnvironmentLight) -> Self {
        Self { environment: Some(light), ..Self::uniform(Vec3::ZERO) }
    }

    /// What a white diffuse surface with a unit normal reflects.
    pub fn diffuse(&self, normal: Vec3) -> Vec3 {
        match &self.environment {
            Some(light) => light.diffuse(normal),
            None => self.radiance_from(normal),
        }
    }

    /// What a surface of a perceptual roughness gathers around the mirror direction. The lobe of a rough surface leans
    /// from there towards the normal (S. Lagarde and C. de Rousiers, "Moving Frostbite to physically based rendering",
    /// 2014, for GGX).
    pub fn specular(&self, view: &MirrorView, roughness: f32) -> Vec3 {
        let alpha = (roughness * roughness).clamp(0.0, 1.0);
        match &self.environment {
            Some(light) => {
                let share = (1.0 - alpha) * ((1.0 - alpha).sqrt() + alpha);
                let middle = view.normal.lerp(view.direction, share).normalize_or(view.normal);
                light.reflected(middle, view.steps, roughness)
            }
            None => self.radiance_from(view.direction.lerp(view.normal, alpha).normalize_or(view.normal)),
        }
    }
}
