//! Lines along the edges of a mesh.

use std::collections::HashMap;
use std::sync::Arc;

use fantex_base::Result;
use glam::Vec3;

use crate::frame::LinesRecord;
use crate::gpu::UNIFORM;
use crate::shader::{FRAME, LINES, compose, module};
use crate::{Blending, Gpu, ModelSpace, SurfaceKey, SurfacePipeline, WireframeOptions};

#[derive(Debug)]
pub(crate) struct Wireframe {
    /// Whose edges.
    points: Arc<[Vec3]>,
    positions: wgpu::Buffer,
    edges: wgpu::Buffer,
    count: u32,
    options: WireframeOptions,
    uniforms: wgpu::Buffer,
    group: wgpu::BindGroup,
    layout: wgpu::BindGroupLayout,
    module: wgpu::ShaderModule,
    /// By the samples per pixel.
    pipelines: HashMap<u32, wgpu::RenderPipeline>,
}

impl Wireframe {
    /// Makes `lines` those of a mesh with these options, if they are not.
    pub(crate) fn update(
        lines: &mut Option<Self>,
        gpu: &Gpu,
        space: &ModelSpace,
        options: &WireframeOptions,
    ) -> Result<()> {
        match lines {
            Some(lines) if Arc::ptr_eq(&lines.points, &space.points) => {
                if lines.options != *options {
                    gpu.queue.write_buffer(&lines.uniforms, 0, bytemuck::bytes_of(&record(options)));
                    lines.options = *options;
                }
            }
            _ => *lines = Some(Self::new(gpu, space, options)?),
        }
        Ok(())
    }

    fn new(gpu: &Gpu, space: &ModelSpace, options: &WireframeOptions) -> Result<Self> {
        let device = &gpu.device;
        let edges = edges(&space.triangles);
        let bytes = size_of_val(&edges[..]) as u64;
        gpu.allow("the wireframe", bytes, gpu.limits().max_buffer_size, "bytes of a buffer")?;
        let record = record(options);
        let uniforms = gpu.buffer("lines", bytemuck::bytes_of(&record), wgpu::BufferUsages::UNIFORM);
        let layout = gpu.bind_layout("lines", wgpu::ShaderStages::FRAGMENT, [UNIFORM]);
        let group = gpu.bind_group("lines", &layout, [uniforms.as_entire_binding()]);
        Ok(Self {
            points: Arc::clone(&space.points),
            positions: gpu.buffer(
                "line ends",
                bytemuck::cast_slice(&space.points),
                wgpu::BufferUsages::VERTEX,
            ),
            edges: gpu.buffer("lines", bytemuck::cast_slice(&edges), wgpu::BufferUsages::INDEX),
            count: 2 * edges.len() as u32,
            options: *options,
            uniforms,
            group,
            layout,
            module: module(device, "lines", &compose(&[FRAME, LINES])),
            pipelines: HashMap::new(),
        })
    }

    /// Group 0 is bound.
    pub(crate) fn draw(&mut self, gpu: &Gpu, pass: &mut wgpu::RenderPass<'_>, key: SurfaceKey) {
        if self.count == 0 {
            return;
        }
        let Self { pipelines, module, layout, .. } = self;
        let pipeline = pipelines.entry(key.samples).or_insert_with(|| {
            let pipeline = SurfacePipeline {
                label: "lines",
                module,
                vertex: "vs_lines",
                fragment: "fs_lines",
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<Vec3>() as u64,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x3],
                })],
                groups: &[layout],
                constants: &[],
                blending: Blending::Over,
                is_double_sided: true,
                topology: wgpu::PrimitiveTopology::LineList,
            };
            pipeline.build_with(gpu, key.samples, &[])
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(1, &self.group, &[]);
        pass.set_vertex_buffer(0, self.positions.slice(..));
        pass.set_index_buffer(self.edges.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..self.count, 0, 0..1);
    }
}

fn record(options: &WireframeOptions) -> LinesRecord {
    let opacity = options.opacity.clamp(0.0, 1.0);
    LinesRecord { color: (options.color * opacity).extend(opacity) }
}

/// The pairs of vertices that an edge joins, each once.
fn edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let sides = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)]);
    let mut edges: Vec<_> = triangles.iter().flat_map(sides).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_edges_are_drawn_once() {
        assert_eq!(edges(&[[0, 1, 2], [2, 1, 3]]), [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]);
        assert_eq!(edges(&[]), [[0; 2]; 0]);
    }
}
