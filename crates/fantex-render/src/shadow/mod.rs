//! Shadow maps (L. Williams, "Casting Curved Shadows on Curved Surfaces", 1978).
//!
//! ```text
//!  lamp, scene --fit--> LampView(s) --draw--> nearness per texel --filter--> share of the light that arrives
//! ```
//!
//! A map holds, for every texel, how near to the lamp the nearest surface is. Nearness is linear over the map on every plane
//! (it is `1 / depth`, or where light is parallel the distance from the far end), so a receiver is compared not with one
//! number but with its own facet's plane under every texel of the filter: no bias can be too small on a plane, however it
//! is inclined.

mod draw;
mod filter;
mod fit;

pub(crate) use fit::projector_view;

use fantex_mesh::Mesh;
use glam::{DVec3, Vec3};

use crate::lamp_view::{LampView, Spread};
use crate::{Light, Surface};

/// How a lamp casts shadows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowOptions {
    /// Texels along each side of a map, [`ShadowOptions::MIN_RESOLUTION`] to [`ShadowOptions::MAX_RESOLUTION`]. A
    /// directional lamp has one map over the whole scene, a point light six.
    pub resolution: u32,
    /// How far a receiver is lifted towards the lamp before it is compared, in texels.
    pub bias: f32,
    /// How far a receiver is lifted along its normal, in texels, where light grazes it; less where light falls steeply.
    pub normal_offset: f32,
    /// How soft the border is.
    pub penumbra: Penumbra,
}

/// How soft the border of a shadow is; never sharper than the map and the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Penumbra {
    /// As sharp as the map.
    #[default]
    Sharp,
    /// With the same half width everywhere, world units.
    Even(f32),
    /// Wider the farther the shadow falls, by the lamp's radius in world units (for parallel light: the tangent of the angle
    /// that the radius appears under, 0.0047 for the sun): R. Fernando, "Percentage-Closer Soft Shadows", 2005.
    Lamp(f32),
}

impl Default for ShadowOptions {
    /// Sharp shadows from a map of 2048 x 2048 texels (16 MiB).
    fn default() -> Self {
        Self { resolution: 2048, bias: 1.0, normal_offset: 1.5, penumbra: Penumbra::Sharp }
    }
}

impl ShadowOptions {
    /// Least texels along a side.
    pub const MIN_RESOLUTION: u32 = 16;

    /// Most texels along a side: 256 MiB per map.
    pub const MAX_RESOLUTION: u32 = 8_192;

    /// Why no shadow can be cast, or nothing.
    pub(crate) fn defect(&self) -> Option<&'static str> {
        let width = match self.penumbra {
            Penumbra::Sharp => 0.0,
            Penumbra::Even(width) | Penumbra::Lamp(width) => width,
        };
        if !(Self::MIN_RESOLUTION..=Self::MAX_RESOLUTION).contains(&self.resolution) {
            Some("its shadow map must have between 16 and 8192 texels along a side")
        } else if !(self.bias.is_finite() && self.normal_offset.is_finite()) {
            Some("the bias of its shadows is not finite")
        } else if !(width.is_finite() && width >= 0.0) {
            Some("the penumbra of its shadows must not be negative")
        } else {
            None
        }
    }
}

/// The maps of a lamp.
#[derive(Debug)]
pub(crate) struct ShadowMaps {
    faces: Vec<ShadowFace>,
    options: ShadowOptions,
    /// Mesh units per world unit.
    mesh_per_world: f32,
}

/// One map.
#[derive(Debug)]
pub(crate) struct ShadowFace {
    view: LampView,
    resolution: u32,
    /// Largest depth of the scene, mesh units.
    far: f64,
    /// Row-major; zero where there is no surface.
    nearness: Vec<f32>,
}

/// Who asks whether light arrives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    /// Mesh space.
    pub(crate) position: Vec3,
    /// Change of the position along the pixel's edges, mesh space.
    pub(crate) steps: [Vec3; 2],
    /// Unit normal of the facet on the side that is seen.
    pub(crate) facet_normal: Vec3,
    /// Unit normal of the smooth surface on the side that is seen.
    pub(crate) normal: Vec3,
}

impl ShadowMaps {
    /// Draws the maps of a lamp; none where it has no shadows.
    pub(crate) fn draw(light: &Light, mesh: &Mesh, surface: &dyn Surface) -> Option<Self> {
        let options = light.shadow?;
        let faces = fit::views(&light.kind, mesh, surface)
            .into_iter()
            .map(|fitted| draw::draw(fitted, options.resolution, mesh, surface))
            .collect();
        Some(Self { faces, options, mesh_per_world: (1.0 / mesh.world_from_mesh.scale) as f32 })
    }

    /// Share of the lamp's light that arrives, 0..1. `to_light` is a unit vector.
    pub(crate) fn visibility(&self, receiver: &Receiver, to_light: Vec3) -> f32 {
        let face = match &self.faces[..] {
            [only] => only,
            six => &six[cube_face(receiver.position.as_dvec3() - six[0].view.origin)],
        };
        filter::visibility(face, &self.options, self.mesh_per_world, receiver, to_light)
    }
}

/// Index of the cube's face that a direction meets, in the order of [`fit::CUBE`].
fn cube_face(direction: DVec3) -> usize {
    let axis = direction.abs().max_position();
    2 * axis + usize::from(direction[axis] < 0.0)
}

impl ShadowFace {
    /// The map's measure of a depth, larger for what is nearer: positive up to the far end and some way beyond.
    fn nearness_of(&self, depth: f64) -> f64 {
        match self.view.spread() {
            Spread::Perspective => 1.0 / depth,
            Spread::Parallel => 1.0 + (self.far - depth) / self.far,
        }
    }

    /// The depth of a nearness.
    fn depth_of(&self, nearness: f64) -> f64 {
        match self.view.spread() {
            Spread::Perspective => 1.0 / nearness,
            Spread::Parallel => self.far * (2.0 - nearness),
        }
    }

    /// Change of the nearness per unit of depth (positive: per unit towards the lamp).
    fn nearness_per_depth(&self, depth: f64) -> f64 {
        match self.view.spread() {
            Spread::Perspective => 1.0 / (depth * depth),
            Spread::Parallel => 1.0 / self.far,
        }
    }
}
