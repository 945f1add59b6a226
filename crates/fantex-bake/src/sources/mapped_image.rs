//! An image laid over the model by a mapping.

use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use fantex_texture::AnyMapping;
use fantex_texture::{ImageTexture, Wrap};
use glam::Vec4;

use crate::sources::WorldSpace;
use crate::{Prefilter, Source, SourceChannel, SurfacePoint};

/// An image through a planar, box, cylinder, sphere or triplanar mapping.
pub struct MappedImageSource {
    texture: ImageTexture,
    mapping: AnyMapping,
    wrap: [Wrap; 2],
    space: WorldSpace,
}

impl MappedImageSource {
    /// `mapping` takes world-space points relative to the mesh's centre ([`WorldSpace`]).
    pub fn new(mesh: &Mesh, texture: ImageTexture, mapping: AnyMapping, wrap: [Wrap; 2]) -> Self {
        Self { texture, mapping, wrap, space: WorldSpace::of(mesh) }
    }
}

impl Source for MappedImageSource {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel {
            kind: ChannelKind::BaseColor,
            has_alpha: self.texture.level(0).has_alpha(),
            exceeds_one: false,
        }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let p = self.space.point(point.position);
        let steps = self.space.steps(point.position_steps);
        let color = self.mapping.evaluate(p, point.normal, steps, |uv, footprint| {
            self.texture.sample_area(uv, footprint, self.wrap)
        });
        values[0] = Vec4::from_array(color);
    }
}
