//! The overlay that gives every partial fan a colour: of all triangles, whichever groups their fans are in.

use bytemuck::{Pod, Zeroable};
use fantex_mesh::OpposedTriangles;
use fantex_stream::drawing::CHUNK_TRIANGLES;

use super::bindings::{FanBindings, FanMaterials};
use crate::shader::{FAN_COLORS, FAN_GEOMETRY, FAN_LOOKUP, compose_surface, module};
use crate::{Blending, Gpu, ModelSpace, SurfaceKey, SurfacePipeline};

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct FanVertex {
    /// Mesh space.
    position: [f32; 3],
    /// The fans at the triangle's corners, by their vertices.
    fans: [u32; 3],
}

#[derive(Debug)]
pub(crate) struct FanColors {
    /// Buffers and their numbers of vertices: of triangles that are not opposed by others and of those that are.
    chunks: [Vec<(wgpu::Buffer, u32)>; 2],
    module: wgpu::ShaderModule,
    /// For the same.
    pipelines: Option<(SurfaceKey, [wgpu::RenderPipeline; 2])>,
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
        let opposed = OpposedTriangles::of(&space.triangles);
        let of_kind = |is_opposed: bool| -> Vec<_> {
            let triangles = space.triangles.iter().enumerate();
            let chosen =
                triangles.filter(|(t, _)| opposed.contains(*t) == is_opposed).map(|(_, triangle)| *triangle);
            chosen.collect::<Vec<[u32; 3]>>().chunks(CHUNK_TRIANGLES).map(chunk).collect()
        };
        let source = compose_surface(&[FAN_LOOKUP, FAN_GEOMETRY, FAN_COLORS]);
        Self {
            chunks: [false, true].map(of_kind),
            module: module(&gpu.device, "fan colours", &source),
            pipelines: None,
        }
    }

    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        key: SurfaceKey,
        bindings: &FanBindings,
        materials: &FanMaterials,
    ) {
        if self.pipelines.as_ref().is_some_and(|(of, _)| *of == key) {
            return;
        }
        let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Uint32x3];
        let layout = [Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<FanVertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &attributes,
        })];
        let groups = [&bindings.layout, &materials.layout];
        let pipeline = |is_double_sided| SurfacePipeline {
            label: "fan colours",
            module: &self.module,
            vertex: "vs_fan_colors",
            fragment: "fs_fan_colors",
            buffers: &layout,
            groups: &groups,
            constants: &[],
            blending: Blending::Opaque,
            is_double_sided,
            topology: wgpu::PrimitiveTopology::TriangleList,
        };
        self.pipelines = Some((key, [true, false].map(|sides| pipeline(sides).build(gpu, key))));
    }

    /// Groups 1 and 2 are bound.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, key: SurfaceKey) {
        let Some((of, pipelines)) = &self.pipelines else { return };
        for (pipeline, chunks) in pipelines.iter().zip(&self.chunks).filter(|_| *of == key) {
            pass.set_pipeline(pipeline);
            for (buffer, count) in chunks {
                pass.set_vertex_buffer(0, buffer.slice(..));
                pass.draw(0..*count, 0..1);
            }
        }
    }
}
