//! Vertices and indices on the device.

use super::vertices::{Attributes, Vertices};
use crate::sorted::SortedTriangles;
use crate::{Gpu, GpuError};

/// Vertices and indices on the device.
#[derive(Debug)]
pub(super) struct Buffers {
    positions: wgpu::Buffer,
    attributes: wgpu::Buffer,
    uv: Option<wgpu::Buffer>,
    uv_pairs: usize,
    /// Of what is not blended.
    pub(super) indices: wgpu::Buffer,
    /// Of what is blended, in drawing order.
    pub(super) sorted: wgpu::Buffer,
}

impl Buffers {
    /// Uploads vertices and the indices of what is not blended.
    pub(super) fn new(
        gpu: &Gpu,
        vertices: &Vertices,
        indices: &[[u32; 3]],
        sorted: &SortedTriangles,
    ) -> Result<Self, GpuError> {
        let allowed = gpu.limits().max_buffer_size;
        let buffer = |label: &str, contents: &[u8], usage| {
            if contents.len() as u64 > allowed {
                return Err(gpu.too_large("the mesh", contents.len() as u64, allowed, "bytes of a buffer"));
            }
            Ok(gpu.buffer(label, contents, usage))
        };
        let vertex = wgpu::BufferUsages::VERTEX;
        let has_uv = vertices.uv_pairs > 0;
        let uv = has_uv.then(|| buffer("texture coordinates", bytemuck::cast_slice(&vertices.uv), vertex));
        Ok(Self {
            positions: buffer("positions", bytemuck::cast_slice(&vertices.positions), vertex)?,
            attributes: buffer("attributes", bytemuck::cast_slice(&vertices.attributes), vertex)?,
            uv: uv.transpose()?,
            uv_pairs: vertices.uv_pairs,
            indices: buffer("triangles", bytemuck::cast_slice(indices), wgpu::BufferUsages::INDEX)?,
            sorted: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("sorted triangles"),
                size: (4 * sorted.index_count() as u64).max(16),
                usage: wgpu::BufferUsages::INDEX | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
        })
    }

    /// Binds the vertex buffers.
    pub(super) fn set_vertices(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.positions.slice(..));
        pass.set_vertex_buffer(1, self.attributes.slice(..));
        pass.set_vertex_buffer(2, self.uv.as_ref().unwrap_or(&self.attributes).slice(..));
    }

    /// Calls `with` with the layout of the vertex buffers. Without a second pair of texture coordinates the first is read
    /// twice, and without any the attributes stand in for them: no texture asks.
    pub(super) fn with_layout<R>(
        &self,
        with: impl FnOnce(&[Option<wgpu::VertexBufferLayout<'_>>]) -> R,
    ) -> R {
        use wgpu::VertexFormat::Float32x4;
        let buffer = |array_stride: usize, attributes| wgpu::VertexBufferLayout {
            array_stride: array_stride as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes,
        };
        let position = wgpu::vertex_attr_array![0 => Float32x3];
        let attributes = wgpu::vertex_attr_array![1 => Snorm16x4, 2 => Snorm16x4, 5 => Unorm16x4];
        let (stride, second) = match self.uv_pairs {
            0 => (size_of::<Attributes>(), 0),
            1 => (16, 0),
            _ => (32, 16),
        };
        let uv = [(3, 0), (4, second)].map(|(shader_location, offset)| wgpu::VertexAttribute {
            format: Float32x4,
            offset,
            shader_location,
        });
        with(&[
            Some(buffer(12, &position)),
            Some(buffer(size_of::<Attributes>(), &attributes)),
            Some(buffer(stride, &uv)),
        ])
    }
}
