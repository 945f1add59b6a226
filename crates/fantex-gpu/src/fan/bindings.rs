//! Bind group 1 of fan shaders: texture function and atlas.

use fantex_cover::Cover;
use fantex_scene::FilterOptions;
use fantex_store::Channel;
use fantex_stream::{AtlasFormat, PageTable};
use wgpu::{BindingResource, BindingType, BufferBindingType, ShaderStages};

use super::atlas::{ChannelAtlas, DRAWN_KINDS, KINDS, no_channel};
use super::grid::AtlasGrid;
use super::tables::{FanParams, FanTables};
use crate::Gpu;

/// What an asset's texture function is made of, as far as the GPU is concerned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BindingSource<'a> {
    pub(crate) cover: &'a Cover,
    pub(crate) channels: &'a [Channel],
    /// Per channel.
    pub(crate) formats: &'a [AtlasFormat],
    pub(crate) grid: AtlasGrid,
    pub(crate) pages: &'a PageTable,
}

/// Bind group 1 and what is in it.
#[derive(Debug)]
pub(crate) struct FanBindings {
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) group: wgpu::BindGroup,
    /// Per channel of the asset; none where it is not drawn.
    pub(crate) atlases: Vec<Option<ChannelAtlas>>,
    pub(crate) tables: FanTables,
    /// Per item of [`DRAWN_KINDS`] the channel, if there is one.
    pub(crate) drawn: [Option<usize>; KINDS],
    channels: Vec<Channel>,
    params: FanParams,
    params_buffer: wgpu::Buffer,
}

impl FanBindings {
    pub(crate) fn new(gpu: &Gpu, source: BindingSource<'_>, mean: impl Fn(usize, u32) -> [f32; 4]) -> Self {
        let BindingSource { cover, channels, formats, grid, pages } = source;
        let parts = Parts {
            layout: layout(&gpu.device),
            tables: FanTables::new(gpu, cover, channels, pages, mean),
            params: FanParams::new(cover, channels, grid, &FilterOptions::default()),
            channels: channels.to_vec(),
        };
        parts.bind(gpu, grid, formats)
    }

    /// The same asset with another atlas, in which nothing is resident. What does not depend on it is shared.
    pub(crate) fn with_atlas(&self, gpu: &Gpu, grid: AtlasGrid, formats: &[AtlasFormat]) -> Self {
        let parts = Parts {
            layout: self.layout.clone(),
            tables: self.tables.without_pages(&gpu.device),
            params: self.params.with_grid(grid),
            channels: self.channels.clone(),
        };
        parts.bind(gpu, grid, formats)
    }

    /// Writes the filter's parameters if they have changed.
    pub(crate) fn set_filter(&mut self, queue: &wgpu::Queue, filter: &FilterOptions) {
        let params = self.params.with_filter(filter);
        if params != self.params {
            self.params = params;
            queue.write_buffer(&self.params_buffer, 0, bytemuck::bytes_of(&params));
        }
    }

    /// Values of the overrides of `fan_lookup.wgsl` that say which channels there are.
    pub(crate) fn channel_constants(&self) -> [(&'static str, f64); KINDS] {
        let [base_color, normal, material, emission, light, anisotropy] =
            self.drawn.map(|channel| f64::from(u8::from(channel.is_some())));
        [
            ("FAN_BASE_COLOR", base_color),
            ("FAN_NORMAL", normal),
            ("FAN_MATERIAL", material),
            ("FAN_EMISSION", emission),
            ("FAN_LIGHT", light),
            ("FAN_ANISOTROPY", anisotropy),
        ]
    }
}

/// All but the atlas.
struct Parts {
    layout: wgpu::BindGroupLayout,
    tables: FanTables,
    params: FanParams,
    channels: Vec<Channel>,
}

impl Parts {
    /// Makes the atlas and binds everything. `formats` has an entry per channel.
    fn bind(self, gpu: &Gpu, grid: AtlasGrid, formats: &[AtlasFormat]) -> FanBindings {
        let Self { layout, tables, params, channels } = self;
        let device = &gpu.device;
        let usage = wgpu::BufferUsages::UNIFORM;
        let params_buffer = gpu.buffer("fan parameters", bytemuck::bytes_of(&params), usage);
        // Of several channels of a kind the first one counts.
        let drawn = DRAWN_KINDS.map(|kind| channels.iter().position(|c| c.kind == kind));
        let atlas = |index: usize| {
            let is_drawn = drawn.contains(&Some(index));
            is_drawn.then(|| ChannelAtlas::new(device, grid, &channels[index], formats[index]))
        };
        let atlases: Vec<_> = (0..channels.len()).map(atlas).collect();
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("fan atlas"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let nothing = no_channel(device);
        let view = |kind: usize| {
            let atlas = drawn[kind].and_then(|channel| atlases[channel].as_ref());
            BindingResource::TextureView(atlas.map_or(&nothing, |atlas| &atlas.view))
        };
        let pages_view = tables.pages.create_view(&Default::default());
        let resources = [
            params_buffer.as_entire_binding(),
            tables.groups.as_entire_binding(),
            BindingResource::TextureView(&pages_view),
            tables.means.as_entire_binding(),
            tables.frames.as_entire_binding(),
            BindingResource::Sampler(&sampler),
            view(0),
            view(1),
            view(2),
            view(3),
            view(4),
            view(5),
        ];
        let entries: Vec<_> = resources
            .into_iter()
            .zip(0..)
            .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("fan model"),
            layout: &layout,
            entries: &entries,
        });
        FanBindings { layout, group, atlases, tables, drawn, channels, params, params_buffer }
    }
}

fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let storage = buffer(BufferBindingType::Storage { read_only: true });
    let texture = |sample_type| BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let words = texture(wgpu::TextureSampleType::Uint);
    let texture = texture(wgpu::TextureSampleType::Float { filterable: true });
    let sampler = BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
    let uniform = buffer(BufferBindingType::Uniform);
    let tables = [uniform, storage, words, storage, storage, sampler];
    let types = tables.into_iter().chain([texture; KINDS]);
    let entry = |(ty, binding)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX_FRAGMENT,
        ty,
        count: None,
    };
    let entries: Vec<_> = types.zip(0..).map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("fan model"),
        entries: &entries,
    })
}
