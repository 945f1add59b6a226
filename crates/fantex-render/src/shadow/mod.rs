//! Shadow maps (L. Williams, "Casting Curved Shadows on Curved Surfaces", 1978).
//!
//! ```text
//!  lamp, scene --lamp_views--> LampView(s) --draw--> nearness per texel --filter--> share of the light that arrives
//! ```
//!
//! A map holds, for every texel, how near to the lamp the nearest surface is. Nearness is linear over the map on every plane
//! (it is `1 / depth`, or where light is parallel the distance from the far end), so a receiver is compared not with one
//! number but with its own facet's plane under every texel of the filter: no bias can be too small on a plane, however it
//! is inclined.

mod draw;
mod filter;

use fantex_mesh::Mesh;
use glam::{DVec3, Vec3};

use crate::{Light, Surface};
use fantex_scene::{LampView, ShadowOptions, Spread, lamp_views};

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
        let casters = (0..mesh.triangles.len())
            .filter(|&triangle| surface.casts_shadow(triangle))
            .flat_map(|triangle| mesh.triangle_positions(triangle));
        let faces = lamp_views(&light.kind, &mesh.world_from_mesh, &mesh.positions, casters)
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

/// Index of the cube's face that a direction meets, in the order of [`lamp_views`].
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
