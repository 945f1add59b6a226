//! Vertex colours.

use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use glam::Vec4;

use crate::{Prefilter, Source, SourceChannel, SurfacePoint};

/// The mesh has no vertex colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the model has no vertex colours; choose another source")]
pub struct NoVertexColors;

/// The mesh's vertex colours, interpolated over the triangles.
#[derive(Clone, Copy, Debug)]
pub struct VertexColorSource<'a> {
    colors: &'a [Vec4],
    has_alpha: bool,
}

impl<'a> VertexColorSource<'a> {
    /// Takes the mesh's colours.
    ///
    /// # Errors
    ///
    /// The mesh has none.
    pub fn new(mesh: &'a Mesh) -> Result<Self, NoVertexColors> {
        let colors = mesh.corners.colors.as_slice();
        if colors.len() != 3 * mesh.triangles.len() || colors.is_empty() {
            return Err(NoVertexColors);
        }
        Ok(Self { colors, has_alpha: colors.iter().any(|c| c.w < 1.0) })
    }
}

impl Source for VertexColorSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: self.has_alpha, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let c = &self.colors[3 * point.triangle..3 * point.triangle + 3];
        let l = point.lambda;
        let color = c[0] * l.x + c[1] * l.y + c[2] * l.z;
        // Just off the surface the plane of colours goes on, but not beyond the corners' range.
        values[0] = color.clamp(c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]));
    }
}
