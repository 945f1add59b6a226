//! An environment as a texture of a material: reflection mapping as a colour, a picture around an object.

use std::sync::Arc;

use glam::{Vec3, Vec4};

use super::mirror::{mirrored, mirrored_steps};
use super::{EnvironmentMap, EnvironmentProxy};
use crate::{ShadingPoint, Texture};

/// Which direction looks a map up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum DirectionSource {
    /// The view ray, mirrored at the normal (J. Blinn and M. Newell 1976). Without an eye, as in a bake, the normal.
    #[default]
    Reflection,
    /// The normal.
    Normal,
    /// From a centre to the point: the map as paint on the object.
    Position {
        /// The centre, object space.
        center: Vec3,
    },
    /// The view ray as it goes on behind the surface: the surface is a window. Without an eye, against the normal.
    View,
}

/// An environment map looked up by a direction of the surface point; alpha is 1.
#[derive(Clone, Debug)]
pub struct CubeTexture {
    /// The map; of any form.
    pub map: Arc<EnvironmentMap>,
    /// Which direction looks it up.
    pub source: DirectionSource,
    /// Radians by which the map is turned to the left about `+y`.
    pub rotation: f32,
    /// A shape for the surroundings, object space, with the place where the map was taken; without, they are infinitely
    /// far away. For reflections and views.
    pub proxy: Option<(EnvironmentProxy, Vec3)>,
}

impl CubeTexture {
    /// A map as it stands, infinitely far away.
    pub fn new(map: Arc<EnvironmentMap>, source: DirectionSource) -> Self {
        Self { map, source, rotation: 0.0, proxy: None }
    }

    /// Unit direction and its change along the footprint's edges.
    fn direction(&self, at: &ShadingPoint<'_>) -> (Vec3, [Vec3; 2]) {
        match (self.source, at.to_eye) {
            (DirectionSource::Reflection, Some(to_eye)) => {
                let steps = mirrored_steps(at.normal, at.normal_steps, to_eye, [Vec3::ZERO; 2]);
                (mirrored(at.normal, to_eye), steps)
            }
            (DirectionSource::Reflection | DirectionSource::Normal, _) => (at.normal, at.normal_steps),
            (DirectionSource::Position { center }, _) => {
                let from_center = at.position - center;
                let scale = from_center.length_recip();
                let scale = if scale.is_finite() { scale } else { 0.0 };
                ((from_center * scale).normalize_or(at.normal), at.position_steps.map(|step| step * scale))
            }
            (DirectionSource::View, Some(to_eye)) => (-to_eye, [Vec3::ZERO; 2]),
            (DirectionSource::View, None) => (-at.normal, at.normal_steps.map(|step| -step)),
        }
    }
}

impl Texture for CubeTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (mut direction, mut steps) = self.direction(at);
        if let Some((proxy, center)) = self.proxy
            && matches!(self.source, DirectionSource::Reflection | DirectionSource::View)
        {
            (direction, steps) =
                proxy.corrected_footprint(at.position, at.position_steps, direction, steps, center);
        }
        let map_from_object = glam::Quat::from_rotation_y(-self.rotation);
        let color = self.map.sample(map_from_object * direction, steps.map(|step| map_from_object * step));
        color.extend(1.0)
    }

    fn is_view_dependent(&self) -> bool {
        matches!(self.source, DirectionSource::Reflection | DirectionSource::View)
    }
}
