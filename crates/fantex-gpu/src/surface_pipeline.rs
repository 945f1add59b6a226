//! What all kinds of models have in common: pipelines of surfaces and of their shadows, the order of blended triangles.

use fantex_mesh::AlphaMode;
use fantex_scene::{Lights, Shading};
use fantex_texture::Filter;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::frame::{DEPTH_FORMAT, LIGHT_FORMAT};
use crate::{DrawOptions, Gpu, Overlay, View};

/// What a surface's pipelines depend on besides the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SurfaceKey {
    /// Lighting model.
    pub shading: Shading,
    /// Colours that explain.
    pub overlay: Overlay,
    /// How textures are filtered.
    pub filter: Filter,
    /// Samples per pixel.
    pub samples: u32,
    /// Whether any lamp casts shadows.
    pub has_shadows: bool,
    /// Whether the ambient light is an environment map.
    pub has_environment: bool,
}

/// What alpha means, as shaders know it. The entry points of cut-outs are those that end in `_cut_out`.
pub(crate) fn alpha_code(mode: AlphaMode) -> u32 {
    match mode {
        AlphaMode::Opaque => 0,
        AlphaMode::Mask(_) => 1,
        AlphaMode::Blend => 2,
    }
}

/// How a surface covers what lies behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Blending {
    /// It hides it.
    #[default]
    Opaque,
    /// It is laid over it, premultiplied by its opacity, without hiding what is drawn later behind it.
    Over,
}

/// The parts of a surface's pipeline that differ.
#[derive(Clone, Debug)]
pub struct SurfacePipeline<'a> {
    /// For debuggers.
    pub label: &'a str,
    /// Its composed shader.
    pub module: &'a wgpu::ShaderModule,
    /// Entry points.
    pub vertex: &'a str,
    /// Returns linear light, premultiplied.
    pub fragment: &'a str,
    /// Vertex buffers.
    pub buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    /// Bind groups from group 1.
    pub groups: &'a [&'a wgpu::BindGroupLayout],
    /// Values of the shader's own overrides.
    pub constants: &'a [(&'a str, f64)],
    /// How it covers what lies behind it.
    pub blending: Blending,
    /// Whether triangles are seen from behind.
    pub is_double_sided: bool,
    /// Triangles or lines.
    pub topology: wgpu::PrimitiveTopology,
}

impl SurfaceKey {
    /// Of frames with these options and lights.
    pub fn new(options: &DrawOptions, lights: &Lights) -> Self {
        let is_lit = options.shading.is_lit();
        Self {
            shading: options.shading,
            overlay: options.overlay,
            filter: options.filter.filter,
            samples: options.samples,
            has_shadows: is_lit && lights.lamps.iter().any(|lamp| lamp.shadow.is_some()),
            has_environment: lights.ambient.environment.is_some(),
        }
    }

    /// Values of the overrides of [`crate::shader::SURFACE`].
    pub fn constants(self) -> [(&'static str, f64); 4] {
        let shading = match self.shading {
            Shading::MetallicRoughness => 0.0,
            Shading::BlinnPhong => 1.0,
            Shading::BaseColor => 2.0,
            Shading::Normal => 3.0,
            Shading::OcclusionRoughnessMetallic => 4.0,
            Shading::Emission => 5.0,
        };
        [
            ("SHADING", shading),
            ("SAMPLES", self.samples.into()),
            ("HAS_SHADOWS", f64::from(u8::from(self.has_shadows))),
            ("HAS_ENVIRONMENT", f64::from(u8::from(self.has_environment))),
        ]
    }
}

impl SurfacePipeline<'_> {
    /// Compiles it for frames with a key, whose overrides the module states all.
    pub fn build(&self, gpu: &Gpu, key: SurfaceKey) -> wgpu::RenderPipeline {
        let constants: Vec<_> = key.constants().into_iter().chain(self.constants.iter().copied()).collect();
        self.build_with(gpu, key.samples, &constants)
    }

    /// Compiles it with the given overrides only.
    pub(crate) fn build_with(
        &self,
        gpu: &Gpu,
        samples: u32,
        constants: &[(&str, f64)],
    ) -> wgpu::RenderPipeline {
        let layout = pipeline_layout(gpu, self.label, gpu.frame_layout().surfaces(), self.groups);
        let compilation_options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
        let is_opaque = self.blending == Blending::Opaque;
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: self.module,
                entry_point: Some(self.vertex),
                compilation_options: compilation_options.clone(),
                buffers: self.buffers,
            },
            primitive: wgpu::PrimitiveState {
                topology: self.topology,
                cull_mode: (!self.is_double_sided).then_some(wgpu::Face::Back),
                ..Default::default()
            },
            depth_stencil: Some(depth_test(wgpu::CompareFunction::GreaterEqual, is_opaque)),
            multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module: self.module,
                entry_point: Some(self.fragment),
                compilation_options,
                targets: &[Some(wgpu::ColorTargetState {
                    format: LIGHT_FORMAT,
                    blend: (!is_opaque).then_some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// The parts of a caster's pipeline that differ. Both sides of triangles cast shadows.
#[derive(Clone, Debug)]
pub struct CasterPipeline<'a> {
    /// For debuggers.
    pub label: &'a str,
    /// Its composed shader, which begins with [`crate::shader::CASTER`].
    pub module: &'a wgpu::ShaderModule,
    /// Entry point.
    pub vertex: &'a str,
    /// Discards what casts no shadow; not needed for what is opaque.
    pub fragment: Option<&'a str>,
    /// Vertex buffers.
    pub buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    /// Bind groups from group 1.
    pub groups: &'a [&'a wgpu::BindGroupLayout],
    /// Values of the shader's overrides.
    pub constants: &'a [(&'a str, f64)],
}

impl CasterPipeline<'_> {
    /// Compiles it.
    pub fn build(&self, gpu: &Gpu) -> wgpu::RenderPipeline {
        let layout = pipeline_layout(gpu, self.label, gpu.frame_layout().casters(), self.groups);
        let options = wgpu::PipelineCompilationOptions { constants: self.constants, ..Default::default() };
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: self.module,
                entry_point: Some(self.vertex),
                compilation_options: options.clone(),
                buffers: self.buffers,
            },
            primitive: Default::default(),
            depth_stencil: Some(depth_test(wgpu::CompareFunction::Greater, true)),
            multisample: Default::default(),
            fragment: self.fragment.map(|entry_point| wgpu::FragmentState {
                module: self.module,
                entry_point: Some(entry_point),
                compilation_options: options,
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// Group 0 of a frame, then others.
pub(crate) fn pipeline_layout(
    gpu: &Gpu,
    label: &str,
    first: &wgpu::BindGroupLayout,
    others: &[&wgpu::BindGroupLayout],
) -> wgpu::PipelineLayout {
    let groups: Vec<_> = [first].iter().chain(others).copied().map(Some).collect();
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &groups,
        immediate_size: 0,
    })
}

fn depth_test(compare: wgpu::CompareFunction, is_written: bool) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(is_written),
        depth_compare: Some(compare),
        stencil: Default::default(),
        bias: Default::default(),
    }
}

// Blended triangles, the farthest first.

/// The blended triangles of a mesh and their order for one eye.
///
/// They are sorted by the depth of their centres, anew whenever the camera has moved: fine for panes and leaves, but a million
/// blended triangles take longer than a frame should. Triangles that intersect, or overlap in a cycle, have no right order.
#[derive(Debug)]
pub(crate) struct SortedTriangles {
    triangles: Vec<SortedTriangle>,
    /// Indices into `triangles`, the farthest first.
    order: Vec<u32>,
    /// What the order is for.
    seen: Option<(DVec3, Vec3)>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct SortedTriangle {
    pub(crate) centre: Vec3,
    pub(crate) corners: [u32; 3],
    pub(crate) material: u32,
    /// It is not seen from behind.
    pub(crate) is_opposed: bool,
}

/// Triangles of one material that follow each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub(crate) material: u32,
    /// Whether they are opposed by others, and so are not seen from behind.
    pub(crate) is_opposed: bool,
    /// Of the sorted indices.
    pub(crate) indices: std::ops::Range<u32>,
}

impl SortedTriangles {
    pub(crate) fn new(triangles: Vec<SortedTriangle>) -> Self {
        let order = (0..triangles.len() as u32).collect();
        Self { triangles, order, seen: None }
    }

    /// Room for the indices of all corners; none where there are no triangles.
    pub(crate) fn index_buffer(&self, gpu: &Gpu) -> Option<wgpu::Buffer> {
        (!self.triangles.is_empty()).then(|| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("sorted triangles"),
                size: 12 * self.triangles.len() as u64,
                usage: wgpu::BufferUsages::INDEX | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })
    }

    /// Sorts for a view; the corners in drawing order and their runs, or nothing where the order is already that.
    pub(crate) fn sort(&mut self, view: &View) -> Option<(Vec<[u32; 3]>, Vec<Run>)> {
        let backward = view.axes.z_axis;
        if self.triangles.is_empty() || self.seen == Some((view.eye, backward)) {
            return None;
        }
        self.seen = Some((view.eye, backward));
        let nearness: Vec<f32> = self.triangles.iter().map(|t| t.centre.dot(backward)).collect();
        // Of equally near ones, the mesh's later triangle lies on top.
        self.order.par_sort_unstable_by(|&a, &b| {
            nearness[a as usize].total_cmp(&nearness[b as usize]).then_with(|| a.cmp(&b))
        });
        let sorted = self.order.iter().map(|&i| self.triangles[i as usize]);
        let mut runs: Vec<Run> = Vec::new();
        for (triangle, first) in sorted.clone().zip((0u32..).step_by(3)) {
            match runs.last_mut() {
                Some(run) if run.material == triangle.material && run.is_opposed == triangle.is_opposed => {
                    run.indices.end = first + 3;
                }
                _ => runs.push(Run {
                    material: triangle.material,
                    is_opposed: triangle.is_opposed,
                    indices: first..first + 3,
                }),
            }
        }
        Some((sorted.map(|t| t.corners).collect(), runs))
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat3;

    use super::*;

    #[test]
    fn the_farthest_comes_first() {
        let triangle = |z: f32, material| SortedTriangle {
            centre: Vec3::Z * z,
            corners: [material; 3],
            material,
            is_opposed: false,
        };
        let mut sorted = SortedTriangles::new(vec![triangle(0.5, 1), triangle(-0.5, 1), triangle(0.0, 2)]);
        let mut view =
            View { size: [8, 8], eye: DVec3::Z * 3.0, axes: Mat3::IDENTITY, fov_radians: 1.0, near: 0.1 };
        let (corners, runs) = sorted.sort(&view).unwrap();
        assert_eq!(corners, [[1; 3], [2; 3], [1; 3]]);
        assert_eq!(runs.len(), 3);
        assert_eq!(sorted.sort(&view), None, "nothing has moved");
        view.axes.z_axis = Vec3::NEG_Z;
        let (corners, runs) = sorted.sort(&view).unwrap();
        assert_eq!(corners.len(), 3);
        assert_eq!(runs[0], Run { material: 1, is_opposed: false, indices: 0..3 });
    }
}
