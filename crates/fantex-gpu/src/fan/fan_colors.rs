//! The overlay that gives every partial fan a colour: of all triangles, whichever groups their fans are in.

use bytemuck::{Pod, Zeroable};

use super::bindings::FanBindings;
use super::materials::FanMaterials;
use crate::shader::{FAN_COLORS, FAN_GEOMETRY, FAN_LOOKUP, compose_surface, module};
use crate::{Coat, Gpu, ModelSpace, SurfaceKey, SurfacePipeline};

/// A corner of a triangle.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct FanVertex {
    /// Mesh space.
    position: [f32; 3],
    /// The fans at the triangle's corners, by their vertices.
    fans: [u32; 3],
}

/// Triangles per buffer: 38 MB.
const CHUNK: usize = 1 << 19;

#[derive(Debug)]
pub(crate) struct FanColors {
    /// Buffers and their numbers of vertices.
    chunks: Vec<(wgpu::Buffer, u32)>,
    module: wgpu::ShaderModule,
    pipeline: Option<(SurfaceKey, wgpu::RenderPipeline)>,
}

impl FanColors {
    pub(crate) fn new(gpu: &Gpu, space: &ModelSpace) -> Self {
        let corners = |triangle: &[u32; 3]| {
            triangle.map(|v| FanVertex { position: space.points[v as usize].to_array(), fans: *triangle })
        };
        let chunk = |triangles: &[[u32; 3]]| {
            let vertices: Vec<FanVertex> = triangles.iter().flat_map(corners).collect();
            let bytes = bytemuck::cast_slice(&vertices);
            (gpu.buffer("fan colours", bytes, wgpu::BufferUsages::VERTEX), vertices.len() as u32)
        };
        let source = compose_surface(&[FAN_LOOKUP, FAN_GEOMETRY, FAN_COLORS]);
        Self {
            chunks: space.triangles.chunks(CHUNK).map(chunk).collect(),
            module: module(&gpu.device, "fan colours", &source),
            pipeline: None,
        }
    }

    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        key: SurfaceKey,
        bindings: &FanBindings,
        materials: &FanMaterials,
    ) {
        if self.pipeline.as_ref().is_some_and(|(of, _)| *of == key) {
            return;
        }
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Uint32x3];
        let layout = wgpu::VertexBufferLayout {
            array_stride: size_of::<FanVertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &attributes,
        };
        let pipeline = SurfacePipeline {
            label: "fan colours",
            module: &self.module,
            vertex: "vs_fan_colors",
            fragment: "fs_fan_colors",
            buffers: &[Some(layout)],
            groups: &[&bindings.layout, &materials.layout],
            constants: &[],
            coat: Coat::Opaque,
            is_double_sided: true,
            topology: wgpu::PrimitiveTopology::TriangleList,
        };
        self.pipeline = Some((key, pipeline.build(gpu, key)));
    }

    /// Groups 1 and 2 are bound.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, key: SurfaceKey) {
        let Some((of, pipeline)) = &self.pipeline else { return };
        if *of == key {
            pass.set_pipeline(pipeline);
            for (buffer, count) in &self.chunks {
                pass.set_vertex_buffer(0, buffer.slice(..));
                pass.draw(0..*count, 0..1);
            }
        }
    }
}
