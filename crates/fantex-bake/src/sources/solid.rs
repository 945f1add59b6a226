//! Solid textures.

use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use fantex_texture::{Solid, SolidPoint};
use glam::Vec4;

use crate::sources::WorldSpace;
use crate::{Prefilter, Source, SourceChannel, SurfacePoint, TriangleFootprint, TriangleSource};

/// A recipe that is defined everywhere in space, evaluated in world space.
pub struct SolidSource {
    solid: Box<dyn Solid>,
    space: WorldSpace,
}

impl SolidSource {
    /// `solid` takes world-space points relative to the mesh's centre ([`WorldSpace`]).
    pub fn new(mesh: &Mesh, solid: Box<dyn Solid>) -> Self {
        Self { solid, space: WorldSpace::of(mesh) }
    }

    fn solid_point(&self, point: &SurfacePoint) -> SolidPoint {
        let steps = self.space.steps(point.position_steps);
        let footprint = (0.5 * (steps[0].length_squared() + steps[1].length_squared())).sqrt();
        SolidPoint { p: self.space.point(point.position), n: point.normal, footprint, time: 0.0 }
    }
}

impl Source for SolidSource {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        // Solids fade what is finer than the footprint, as a mean over the texel would.
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        values[0] = Vec4::from_array(self.solid.color(&self.solid_point(point)));
    }

    fn on_triangle(&self, _footprint: &TriangleFootprint) -> TriangleSource<'_> {
        Box::new(|points, values| {
            let at: Vec<SolidPoint> = points.iter().map(|point| self.solid_point(point)).collect();
            self.solid.colors(&at, bytemuck::cast_slice_mut(values));
        })
    }
}
