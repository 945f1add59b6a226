//! Passes over the whole picture: the sky behind the model, the tone map at the end.

use std::collections::HashMap;

use wgpu::{BindingType, ShaderStages, TextureSampleType, TextureViewDimension};

use crate::frame::Targets;
use crate::shader::{ENVIRONMENT, FRAME, SKY, TONE, compose, module};
use crate::{Coat, Gpu, SurfaceKey, SurfacePipeline};

/// Pipelines of passes over the whole picture.
#[derive(Debug)]
pub(crate) struct ScreenPipelines {
    output: wgpu::TextureFormat,
    sky_module: wgpu::ShaderModule,
    /// By the samples per pixel and whether the surroundings are an environment map.
    skies: HashMap<(u32, bool), wgpu::RenderPipeline>,
    tone: wgpu::RenderPipeline,
    tone_layout: wgpu::BindGroupLayout,
    /// The light that the tone map reads, and its bind group.
    light: Option<(wgpu::TextureView, wgpu::BindGroup)>,
}

impl ScreenPipelines {
    pub(crate) fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> Self {
        let device = &gpu.device;
        let tone_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("tone map"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: ShaderStages::FRAGMENT,
                ty: BindingType::Texture {
                    sample_type: TextureSampleType::Float { filterable: false },
                    view_dimension: TextureViewDimension::D2,
                    multisampled: false,
                },
                count: None,
            }],
        });
        let tone_module = module(device, "tone map", &compose(&[FRAME, TONE]));
        Self {
            output,
            sky_module: module(device, "sky", &compose(&[FRAME, ENVIRONMENT, SKY])),
            skies: HashMap::new(),
            tone: tone_pipeline(gpu, &tone_module, &tone_layout, output),
            tone_layout,
            light: None,
        }
    }

    /// Whether the shader must encode sRGB, because the target's format does not.
    pub(crate) fn must_encode_srgb(&self) -> bool {
        let is_float = matches!(
            self.output,
            wgpu::TextureFormat::Rgba16Float
                | wgpu::TextureFormat::Rgba32Float
                | wgpu::TextureFormat::Rg11b10Ufloat
        );
        !self.output.is_srgb() && !is_float
    }

    /// Makes ready what a frame with this key needs.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, targets: &Targets, key: SurfaceKey) {
        let Self { skies, sky_module, .. } = self;
        skies.entry((key.samples, key.has_environment)).or_insert_with(|| {
            let pipeline = SurfacePipeline {
                label: "sky",
                module: sky_module,
                vertex: "vs_sky",
                fragment: "fs_sky",
                buffers: &[],
                groups: &[],
                constants: &[],
                coat: Coat::Opaque,
                is_double_sided: true,
                topology: wgpu::PrimitiveTopology::TriangleList,
            };
            let constants = [("HAS_ENVIRONMENT", f64::from(u8::from(key.has_environment)))];
            pipeline.build_with(gpu, key.samples, &constants)
        });
        if self.light.as_ref().is_none_or(|(view, _)| *view != targets.light) {
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("tone map"),
                layout: &self.tone_layout,
                entries: &[wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&targets.light),
                }],
            });
            self.light = Some((targets.light.clone(), group));
        }
    }

    /// Fills what no surface has covered. Group 0 is bound.
    pub(crate) fn draw_sky(&self, pass: &mut wgpu::RenderPass<'_>, key: SurfaceKey) {
        if let Some(sky) = self.skies.get(&(key.samples, key.has_environment)) {
            pass.set_pipeline(sky);
            pass.draw(0..3, 0..1);
        }
    }

    /// Brings the light of the targets of the last [`ScreenPipelines::prepare`] to a target; `group` is group 0.
    pub(crate) fn draw_tone_mapped(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        group: &wgpu::BindGroup,
        target: &wgpu::TextureView,
    ) {
        let Some((_, light)) = &self.light else { return };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("tone map"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.tone);
        pass.set_bind_group(0, group, &[]);
        pass.set_bind_group(1, light, &[]);
        pass.draw(0..3, 0..1);
    }
}

fn tone_pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    layout: &wgpu::BindGroupLayout,
    output: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let device = &gpu.device;
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("tone map"),
        bind_group_layouts: &[Some(gpu.frame_layout().surfaces()), Some(layout)],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("tone map"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vs_tone"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("fs_tone"),
            compilation_options: Default::default(),
            targets: &[Some(output.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
