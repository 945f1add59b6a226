//! The live atlas: what is in graphics memory, as a picture.

use fantex_store::ChannelKind;

use super::FanModel;
use crate::Gpu;
use crate::shader::{FAN_ATLAS, module};

/// Draws atlases into targets of one format.
#[derive(Debug)]
pub struct AtlasViewer {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

/// Around the atlas where the target has other proportions, linear.
const MARGIN: wgpu::Color = wgpu::Color { r: 0.01, g: 0.01, b: 0.01, a: 1.0 };

impl AtlasViewer {
    /// For targets of a format.
    pub fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> Self {
        let device = &gpu.device;
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: true },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("live atlas"),
            entries: &[entry(0, texture), entry(1, sampler)],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("live atlas"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = module(device, "live atlas", FAN_ATLAS);
        let encodes = f64::from(u8::from(!output.is_srgb()));
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("live atlas"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vs_fan_atlas"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fs_fan_atlas"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &[("FAN_ATLAS_ENCODES", encodes)],
                    ..Default::default()
                },
                targets: &[Some(output.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("live atlas"),
            mag_filter: wgpu::FilterMode::Nearest,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Self { pipeline, layout, sampler }
    }

    /// Draws the whole atlas of a channel as large as it fits into a target of `size` pixels, in its own proportions. Places that
    /// pages have left show what was there until others come. Nothing is drawn where the model lacks the channel, and
    /// `false` is returned.
    pub fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        size: [u32; 2],
        model: &FanModel,
        kind: ChannelKind,
    ) -> bool {
        let Some(atlas) = model.atlas(kind) else { return false };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("live atlas"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&atlas.view),
                },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&self.sampler) },
            ],
        });
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("live atlas"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(MARGIN), store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        let [width, height] = size.map(|n| n as f32);
        let [columns, rows] = [atlas.texture.width(), atlas.texture.height()].map(|n| n as f32);
        let scale = (width / columns).min(height / rows);
        if scale > 0.0 {
            let (w, h) = (columns * scale, rows * scale);
            pass.set_viewport(0.5 * (width - w), 0.5 * (height - h), w, h, 0.0, 1.0);
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
        true
    }
}
