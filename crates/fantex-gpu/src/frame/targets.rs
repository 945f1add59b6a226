//! The textures that a frame is drawn into before it is tone mapped.

use super::{DEPTH_FORMAT, LIGHT_FORMAT};
use crate::{Gpu, GpuError};

/// The light and depth of a frame, as large as the target.
#[derive(Debug)]
pub(crate) struct Targets {
    size: [u32; 2],
    samples: u32,
    /// Several samples per pixel, where there are.
    many: Option<wgpu::TextureView>,
    /// One sample per pixel.
    pub(crate) light: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Targets {
    /// For pictures of a size with sides of at least one pixel.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2], samples: u32) -> Result<Self, GpuError> {
        let allowed = gpu.limits().max_texture_dimension_2d;
        let side = size[0].max(size[1]);
        if side > allowed {
            return Err(gpu.too_large(
                "a picture",
                u64::from(side),
                u64::from(allowed),
                "pixels along a side",
            ));
        }
        let texture = |label: &str, format, samples: u32, usage| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let none = wgpu::TextureUsages::empty();
        Ok(Self {
            size,
            samples,
            many: (samples > 1).then(|| texture("samples", LIGHT_FORMAT, samples, none)),
            light: texture("light", LIGHT_FORMAT, 1, wgpu::TextureUsages::TEXTURE_BINDING),
            depth: texture("depth", DEPTH_FORMAT, samples, none),
        })
    }

    /// Whether they are those of pictures of this kind.
    pub(crate) fn fit(&self, size: [u32; 2], samples: u32) -> bool {
        self.size == size && self.samples == samples
    }

    /// The pass that draws the frame.
    pub(crate) fn begin<'e>(&self, encoder: &'e mut wgpu::CommandEncoder) -> wgpu::RenderPass<'e> {
        let (view, resolve_target, store) = match &self.many {
            Some(many) => (many, Some(&self.light), wgpu::StoreOp::Discard),
            None => (&self.light, None, wgpu::StoreOp::Store),
        };
        let light = wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store },
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("frame"),
            color_attachments: &[Some(light)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}
