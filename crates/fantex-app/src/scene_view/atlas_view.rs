//! The atlas as a picture: its texels made small, in the encoding of screens.

use eframe::wgpu;
use fantex_gpu::Gpu;

use crate::scene_view::FORMAT;

/// Longest side of the picture.
const LONGEST_SIDE: u32 = 1024;

/// Seconds between pictures while pages arrive.
const INTERVAL_SECONDS: f64 = 0.2;

const SHADER: &str = include_str!("atlas_view.wgsl");

/// Makes pictures of an atlas.
#[derive(Debug, Default)]
pub(super) struct AtlasView {
    is_stale: bool,
    drawn: Option<Drawn>,
    pipeline: Option<wgpu::RenderPipeline>,
}

#[derive(Debug)]
struct Drawn {
    view: wgpu::TextureView,
    is_new: bool,
    channel: usize,
    seconds: f64,
    /// Width and height of the atlas in texels.
    extent: [u32; 2],
}

/// A picture of the atlas.
#[derive(Debug)]
pub struct AtlasPicture<'a> {
    /// The picture.
    pub view: &'a wgpu::TextureView,
    /// Whether it is another texture than at the last call.
    pub is_new: bool,
    /// Width and height of the atlas in texels.
    pub extent: [u32; 2],
}

impl AtlasView {
    /// Pages have arrived.
    pub(super) fn changed(&mut self) {
        self.is_stale = true;
    }

    /// Draws the picture anew where it is not right any more, not too often.
    pub(super) fn update(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        atlas: &wgpu::Texture,
        is_srgb: bool,
        channel: usize,
        seconds: f64,
    ) {
        let is_other = self.drawn.as_ref().is_none_or(|drawn| drawn.channel != channel);
        let is_due = self.drawn.as_ref().is_none_or(|drawn| seconds - drawn.seconds >= INTERVAL_SECONDS);
        if !(is_other || self.is_stale && is_due) {
            return;
        }
        self.is_stale = false;
        let extent = [atlas.width(), atlas.height()];
        let mut drawn = match self.drawn.take() {
            Some(drawn) if drawn.extent == extent => drawn,
            _ => Drawn { view: target(gpu, extent), is_new: true, channel, seconds, extent },
        };
        (drawn.channel, drawn.seconds) = (channel, seconds);
        let pipeline = self.pipeline.get_or_insert_with(|| pipeline(&gpu.device));
        draw(gpu, encoder, pipeline, &drawn.view, atlas, is_srgb);
        self.drawn = Some(drawn);
    }

    /// The picture, if there is one yet.
    pub(super) fn picture(&mut self) -> Option<AtlasPicture<'_>> {
        let drawn = self.drawn.as_mut()?;
        let is_new = std::mem::take(&mut drawn.is_new);
        Some(AtlasPicture { view: &drawn.view, is_new, extent: drawn.extent })
    }

    /// Whether a picture is due later.
    pub(super) fn is_stale(&self) -> bool {
        self.is_stale
    }
}

fn target(gpu: &Gpu, extent: [u32; 2]) -> wgpu::TextureView {
    let longest = extent[0].max(extent[1]).max(1);
    let shrink = longest.div_ceil(LONGEST_SIDE).max(1);
    let [width, height] = extent.map(|n| (n / shrink).max(1));
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("picture of the atlas"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    texture.create_view(&Default::default())
}

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("picture of the atlas"),
        source: wgpu::ShaderSource::Wgsl(SHADER.into()),
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("picture of the atlas"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("texel"),
            compilation_options: Default::default(),
            targets: &[Some(FORMAT.into())],
        }),
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        multiview_mask: None,
        cache: None,
    })
}

fn draw(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    pipeline: &wgpu::RenderPipeline,
    target: &wgpu::TextureView,
    atlas: &wgpu::Texture,
    is_srgb: bool,
) {
    let components = u32::from(atlas.format().components());
    let about = [components, u32::from(is_srgb), 0, 0];
    let usage = wgpu::BufferUsages::UNIFORM;
    let about = gpu.buffer("picture of the atlas", bytemuck::bytes_of(&about), usage);
    let source = atlas.create_view(&Default::default());
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("picture of the atlas"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&source) },
            wgpu::BindGroupEntry { binding: 1, resource: about.as_entire_binding() },
        ],
    });
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("picture of the atlas"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.draw(0..3, 0..1);
}
