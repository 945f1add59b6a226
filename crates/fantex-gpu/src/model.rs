//! What the renderer draws.

use std::sync::Arc;

use fantex_mesh::{Mesh, WorldFromMesh};
use glam::Vec3;

use crate::{DrawOptions, Gpu, GpuError, SurfaceKey, View};

/// Something that can be drawn. All of its calls within one frame come in the order of this trait.
pub trait Model {
    /// Where it is, and its points.
    fn space(&self) -> &ModelSpace;

    /// A number that changes when the shadows that it casts do.
    fn shadow_revision(&self) -> u64 {
        0
    }

    /// Makes ready what the frame needs: pipelines, uploads, an order of triangles.
    ///
    /// # Errors
    ///
    /// The device cannot do it.
    fn prepare(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameContext<'_>,
    ) -> Result<(), GpuError>;

    /// Draws what casts shadows into a map, whose matrix is bound to group 0 (see [`crate::shader::CASTER`]).
    fn draw_casters(&self, pass: &mut wgpu::RenderPass<'_>);

    /// Draws what hides everything behind it, cut-outs included. Group 0 is bound.
    fn draw_opaque(&self, pass: &mut wgpu::RenderPass<'_>);

    /// Draws what lets some light through, the farthest first. Group 0 is bound.
    fn draw_layered(&self, pass: &mut wgpu::RenderPass<'_>);
}

/// What a model may know of the frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameContext<'a> {
    /// From where it is seen.
    pub view: &'a View,
    /// How to draw.
    pub options: &'a DrawOptions,
    /// What pipelines depend on.
    pub key: SurfaceKey,
    /// Whether shadow maps are drawn in this frame, so that [`Model::draw_casters`] will be called.
    pub draws_shadows: bool,
}

/// Where a model is, and its points.
#[derive(Clone, Debug)]
pub struct ModelSpace {
    /// From mesh space to the world.
    pub world_from_mesh: WorldFromMesh,
    /// Smallest and largest coordinates, mesh space.
    pub bounds: [Vec3; 2],
    /// All vertices, mesh space.
    pub points: Arc<[Vec3]>,
    /// Pairs of vertices that an edge joins, each edge once; made when lines are first drawn.
    pub(crate) triangles: Arc<[[u32; 3]]>,
}

impl ModelSpace {
    /// That of a mesh.
    pub fn of_mesh(mesh: &Mesh) -> Self {
        let first = mesh.positions.first().copied().unwrap_or(Vec3::ZERO);
        let bounds = mesh.positions.iter().fold([first; 2], |[low, high], &p| [low.min(p), high.max(p)]);
        Self {
            world_from_mesh: mesh.world_from_mesh,
            bounds,
            points: mesh.positions.as_slice().into(),
            triangles: mesh.triangles.as_slice().into(),
        }
    }
}
