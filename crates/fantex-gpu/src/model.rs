//! What the renderer draws, and how.

use std::sync::Arc;

use fantex_base::Result;
use fantex_mesh::{Mesh, WorldFromMesh};
use fantex_scene::{Background, FilterOptions, Shading, ToneMap};
use glam::Vec3;

use crate::{Gpu, SurfaceKey, View};

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
    /// The device cannot do it.
    fn prepare(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameContext<'_>,
    ) -> Result<()>;

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

    /// That of what lies in boxes, given by their corners in mesh space. There are no edges to draw lines along.
    pub fn of_boxes(world_from_mesh: WorldFromMesh, boxes: &[[Vec3; 2]]) -> Self {
        let corner = |of: usize, low: Vec3, high: Vec3| {
            let axis = |axis: usize| if of >> axis & 1 == 0 { low[axis] } else { high[axis] };
            Vec3::new(axis(0), axis(1), axis(2))
        };
        let points = boxes.iter().flat_map(|&[low, high]| (0..8).map(move |of| corner(of, low, high)));
        let bounds = boxes.iter().copied().reduce(|[low, high], [l, h]| [low.min(l), high.max(h)]);
        Self {
            world_from_mesh,
            bounds: bounds.unwrap_or_default(),
            points: points.collect(),
            triangles: Arc::default(),
        }
    }
}

// How to draw a frame.

/// How to draw a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawOptions {
    /// Lighting model.
    pub shading: Shading,
    /// How textures are filtered. `Bicubic` is drawn as `Bilinear`, `BicubicMipmaps` as `Trilinear`, `Ewa` as `Anisotropic`.
    pub filter: FilterOptions,
    /// What is seen where no surface is. Of these, exposure affects environments only.
    pub background: Background,
    /// Factor of the light that reaches the eye.
    pub exposure: f32,
    /// How light is brought into the range of a screen; `None` leaves it as it is, for targets of floats.
    pub tone_map: Option<ToneMap>,
    /// Samples per pixel, 1 or 4. Materials are evaluated once per pixel and triangle.
    pub samples: u32,
    /// Lines along all edges.
    pub wireframe: Option<WireframeOptions>,
    /// Colours that explain instead of the material's.
    pub overlay: Overlay,
    /// Seconds since the start of an animation, for what lamps project.
    pub seconds: f32,
}

impl Default for DrawOptions {
    /// As the CPU renderer's, with 4 samples.
    fn default() -> Self {
        Self {
            shading: Shading::default(),
            filter: FilterOptions::default(),
            background: Background::default(),
            exposure: 1.0,
            tone_map: Some(ToneMap::default()),
            samples: 4,
            wireframe: None,
            overlay: Overlay::default(),
            seconds: 0.0,
        }
    }
}

/// Lines along all edges of the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WireframeOptions {
    /// Linear RGB.
    pub color: Vec3,
    /// 0..1.
    pub opacity: f32,
}

impl Default for WireframeOptions {
    /// Thin black.
    fn default() -> Self {
        Self { color: Vec3::ZERO, opacity: 0.6 }
    }
}

/// Colours that explain what a fan-textured surface is made of. Models without fans show themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Overlay {
    /// None: the material.
    #[default]
    None,
    /// A colour per group of fans.
    Groups,
    /// A colour per partial fan.
    Fans,
    /// A colour per detail level that is shown.
    Levels,
    /// Whether the wanted level is resident, or how much coarser what is shown is.
    Residency,
    /// Where partial fans overlap and are blended.
    BlendBands,
}

impl Overlay {
    /// The number that shaders know it by, 0 for none.
    pub fn code(self) -> u32 {
        self as u32
    }
}
