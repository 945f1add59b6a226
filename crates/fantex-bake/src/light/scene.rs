//! What lights a surface besides lamps: the sky, and what other surfaces reflect and emit.

use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use glam::{Vec3, Vec4};

use super::BakeLight;
use crate::{Source, SurfacePoint};

/// Radiance from where no surface is. Closures from unit directions (of the world, from the surface outwards) to linear RGB
/// are skies.
pub trait Sky: Sync {
    /// From a unit direction.
    fn radiance(&self, direction: Vec3) -> Vec3;
}

impl<F: Fn(Vec3) -> Vec3 + Sync> Sky for F {
    fn radiance(&self, direction: Vec3) -> Vec3 {
        self(direction)
    }
}

/// What surfaces do with light. Closures from a triangle and barycentric coordinates to the albedo are reflectors that do
/// not glow.
pub trait Reflector: Sync {
    /// Share of the light that is reflected diffusely, linear RGB, 0..1, on both sides.
    fn albedo(&self, triangle: usize, lambda: Vec3) -> Vec3;

    /// Emitted radiance, linear RGB, on both sides.
    fn emission(&self, triangle: usize, lambda: Vec3) -> Vec3 {
        let _ = (triangle, lambda);
        Vec3::ZERO
    }

    /// False where light passes through, as in cut-outs.
    fn is_solid(&self, triangle: usize, lambda: Vec3) -> bool {
        let _ = (triangle, lambda);
        true
    }
}

impl<F: Fn(usize, Vec3) -> Vec3 + Sync> Reflector for F {
    fn albedo(&self, triangle: usize, lambda: Vec3) -> Vec3 {
        self(triangle, lambda)
    }
}

/// All that lights a mesh.
#[derive(Clone)]
pub struct LightScene<'a> {
    /// Lights, world space.
    pub lights: Vec<BakeLight>,
    /// Light from outside.
    pub sky: &'a dyn Sky,
    /// The mesh's surface.
    pub reflector: &'a dyn Reflector,
}

impl std::fmt::Debug for LightScene<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LightScene").field("lights", &self.lights).finish_non_exhaustive()
    }
}

/// The base colour and emission that a [`Source`] would bake, as a reflector; alpha below a half lets light through.
pub struct SourceReflector<'a> {
    mesh: &'a Mesh,
    source: &'a dyn Source,
    channels: usize,
    base_color: Option<usize>,
    emission: Option<usize>,
    has_alpha: bool,
}

impl<'a> SourceReflector<'a> {
    /// `source` is a source for `mesh`; channels other than base colour and emission are ignored. Without a base colour the
    /// surface is white.
    pub fn new(mesh: &'a Mesh, source: &'a dyn Source) -> Self {
        let channels = source.channels();
        let position = |kind: ChannelKind| channels.iter().position(|c| c.kind == kind);
        let (base_color, emission) = (position(ChannelKind::BaseColor), position(ChannelKind::Emission));
        let has_alpha = base_color.is_some_and(|c| channels[c].has_alpha);
        Self { mesh, source, channels: channels.len(), base_color, emission, has_alpha }
    }

    /// One channel's value at a point.
    fn value(&self, channel: usize, triangle: usize, lambda: Vec3) -> Vec4 {
        let [a, b, c] = self.mesh.triangle_positions(triangle);
        let point = SurfacePoint {
            triangle,
            lambda,
            lambda_steps: [Vec3::ZERO; 2],
            position: a * lambda.x + b * lambda.y + c * lambda.z,
            position_steps: [Vec3::ZERO; 2],
            normal: (b - a).cross(c - a).normalize_or(Vec3::Z),
        };
        let mut values = vec![Vec4::ZERO; self.channels];
        self.source.evaluate(&point, &mut values);
        values[channel]
    }
}

impl Reflector for SourceReflector<'_> {
    fn albedo(&self, triangle: usize, lambda: Vec3) -> Vec3 {
        let color = |c| self.value(c, triangle, lambda).truncate().clamp(Vec3::ZERO, Vec3::ONE);
        self.base_color.map_or(Vec3::ONE, color)
    }

    fn emission(&self, triangle: usize, lambda: Vec3) -> Vec3 {
        let color = |c| self.value(c, triangle, lambda).truncate().max(Vec3::ZERO);
        self.emission.map_or(Vec3::ZERO, color)
    }

    fn is_solid(&self, triangle: usize, lambda: Vec3) -> bool {
        match self.base_color {
            Some(channel) if self.has_alpha => self.value(channel, triangle, lambda).w >= 0.5,
            _ => true,
        }
    }
}
