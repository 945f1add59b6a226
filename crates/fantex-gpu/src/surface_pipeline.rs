//! Pipelines of surfaces: what all kinds of models have in common.

use fantex_scene::Shading;
use fantex_texture::Filter;

use crate::frame::{DEPTH_FORMAT, LIGHT_FORMAT};
use crate::{Gpu, Overlay};

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

/// How a surface covers what lies behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Coat {
    /// It hides it.
    #[default]
    Opaque,
    /// It is laid over it, premultiplied by its opacity, without hiding what is drawn later behind it.
    Layered,
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
    pub coat: Coat,
    /// Whether triangles are seen from behind.
    pub is_double_sided: bool,
    /// Triangles or lines.
    pub topology: wgpu::PrimitiveTopology,
}

impl SurfaceKey {
    /// The number that shaders know the lighting model by.
    fn shading_code(self) -> u32 {
        match self.shading {
            Shading::MetallicRoughness => 0,
            Shading::BlinnPhong => 1,
            Shading::BaseColor => 2,
            Shading::Normal => 3,
            Shading::OcclusionRoughnessMetallic => 4,
            Shading::Emission => 5,
        }
    }

    /// Values of the overrides of [`crate::shader::SURFACE`].
    pub fn constants(self) -> [(&'static str, f64); 3] {
        [
            ("SHADING", f64::from(self.shading_code())),
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
        let device = &gpu.device;
        let groups: Vec<_> =
            [gpu.frame_layout().surfaces()].iter().chain(self.groups).copied().map(Some).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.label),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        let compilation_options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
        let is_opaque = self.coat == Coat::Opaque;
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
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
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(is_opaque),
                depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
                stencil: Default::default(),
                bias: Default::default(),
            }),
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
        let device = &gpu.device;
        let groups: Vec<_> =
            [gpu.frame_layout().casters()].iter().chain(self.groups).copied().map(Some).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.label),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        let options = wgpu::PipelineCompilationOptions { constants: self.constants, ..Default::default() };
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: self.module,
                entry_point: Some(self.vertex),
                compilation_options: options.clone(),
                buffers: self.buffers,
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
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
