//! What fan shaders are bound to: the texture function and the atlas (group 1), a material (group 2).

use std::num::NonZeroU64;

use bytemuck::{Pod, Zeroable};
use fantex_base::Result;
use fantex_cover::Cover;
use fantex_mesh::{AlphaMode, Material, ToonInterpolation, ToonScale};
use fantex_scene::FilterOptions;
use fantex_store::{Channel, ChannelKind};
use fantex_stream::drawing::{AtlasGrid, PageWords, frame_records, group_records, mean_records};
use fantex_stream::{AtlasFormat, PageTable};
use fantex_texture::Filter;
use wgpu::BindingResource;

use super::atlas::{ChannelAtlas, DRAWN_KINDS, KINDS, no_channel};
use super::programs::{Drawn, lookup_constants};
use crate::Gpu;
use crate::gpu::SAMPLED;

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
    has_branches: bool,
}

impl FanBindings {
    pub(crate) fn new(gpu: &Gpu, source: BindingSource<'_>, mean: impl Fn(usize, u32) -> [f32; 4]) -> Self {
        let BindingSource { cover, channels, formats, grid, pages } = source;
        let tables = FanTables::new(gpu, cover, channels, pages, mean);
        let params = FanParams::new(cover, channels, &FilterOptions::default());
        let layout = gpu.fan_programs().texture_layout.clone();
        Self::bind(gpu, layout, tables, params, channels, formats, grid)
    }

    /// The same asset with another atlas, in which nothing is resident. What does not depend on it is shared.
    pub(crate) fn with_atlas(&self, gpu: &Gpu, grid: AtlasGrid, formats: &[AtlasFormat]) -> Self {
        let tables = self.tables.without_pages(gpu);
        Self::bind(gpu, self.layout.clone(), tables, self.params, &self.channels, formats, grid)
    }

    /// Makes the atlas and binds everything. `formats` has an entry per channel.
    fn bind(
        gpu: &Gpu,
        layout: wgpu::BindGroupLayout,
        tables: FanTables,
        params: FanParams,
        channels: &[Channel],
        formats: &[AtlasFormat],
        grid: AtlasGrid,
    ) -> Self {
        let params = FanParams { atlas_scale: grid.extent().map(|n| 1.0 / n as f32), ..params };
        let usage = wgpu::BufferUsages::UNIFORM;
        let params_buffer = gpu.buffer("fan parameters", bytemuck::bytes_of(&params), usage);
        // Of several channels of a kind the first one counts.
        let drawn = DRAWN_KINDS.map(|kind| channels.iter().position(|c| c.kind == kind));
        let atlas = |index: usize| {
            let is_drawn = drawn.contains(&Some(index));
            is_drawn.then(|| ChannelAtlas::new(gpu, grid, &channels[index], formats[index]))
        };
        let atlases: Vec<_> = (0..channels.len()).map(atlas).collect();
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("fan atlas"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let nothing = no_channel(gpu);
        let views = drawn.map(|channel| {
            let atlas = channel.and_then(|channel| atlases[channel].as_ref());
            BindingResource::TextureView(atlas.map_or(&nothing, |atlas| &atlas.view))
        });
        let pages_view = tables.pages.create_view(&Default::default());
        let resources = [
            params_buffer.as_entire_binding(),
            tables.groups.as_entire_binding(),
            BindingResource::TextureView(&pages_view),
            tables.means.as_entire_binding(),
            tables.frames.as_entire_binding(),
            BindingResource::Sampler(&sampler),
        ];
        let group = gpu.bind_group("fan model", &layout, resources.into_iter().chain(views));
        let channels = channels.to_vec();
        let has_branches = gpu.fan_programs().has_branches;
        Self { layout, group, atlases, tables, drawn, channels, params, params_buffer, has_branches }
    }

    pub(crate) fn set_filter(&mut self, queue: &wgpu::Queue, filter: &FilterOptions) {
        let params = FanParams { max_anisotropy: max_anisotropy(filter), ..self.params };
        if params != self.params {
            self.params = params;
            queue.write_buffer(&self.params_buffer, 0, bytemuck::bytes_of(&params));
        }
    }

    /// Which kinds of channels the asset has.
    pub(crate) fn drawn_kinds(&self) -> Drawn {
        self.drawn.map(|channel| channel.is_some())
    }

    /// Values of the overrides of `fan_lookup.wgsl`.
    pub(crate) fn constants(&self, filter: Filter, is_paged: bool) -> Vec<(&'static str, f64)> {
        lookup_constants(self.drawn_kinds(), filter, is_paged, self.has_branches)
    }
}

// What the texture function needs on the GPU besides triangles and texels: groups, pages, means, frames.

/// The uniform block of `fan_lookup.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct FanParams {
    /// One over the atlas' sides in texels; of no atlas zero.
    atlas_scale: [f32; 2],
    delta: f32,
    max_anisotropy: f32,
    /// Per drawn kind but the last two the asset's channel, or 0.
    mean_of: [u32; 4],
    mean_of_light: u32,
    channels: u32,
    mean_of_anisotropy: u32,
    pad: u32,
}

impl FanParams {
    fn new(cover: &Cover, channels: &[Channel], filter: &FilterOptions) -> Self {
        let channel_of = |kind: ChannelKind| channels.iter().position(|c| c.kind == kind).unwrap_or(0) as u32;
        let [base_color, normal, material, emission, light, anisotropy] = DRAWN_KINDS.map(channel_of);
        Self {
            atlas_scale: [0.0; 2],
            delta: cover.delta,
            max_anisotropy: max_anisotropy(filter),
            mean_of: [base_color, normal, material, emission],
            mean_of_light: light,
            channels: channels.len() as u32,
            mean_of_anisotropy: anisotropy,
            pad: 0,
        }
    }
}

fn max_anisotropy(filter: &FilterOptions) -> f32 {
    filter.max_anisotropy.clamp(1.0, fantex_texture::filter::MAX_ANISOTROPY)
}

/// The tables of `fan_lookup.wgsl`: storage buffers, and a texture of [`PageWords`].
#[derive(Debug)]
pub(crate) struct FanTables {
    pub(crate) groups: wgpu::Buffer,
    pub(crate) pages: wgpu::Texture,
    pub(crate) means: wgpu::Buffer,
    pub(crate) frames: wgpu::Buffer,
}

impl FanTables {
    pub(crate) fn longest_bytes(cover: &Cover, channels: &[Channel]) -> u64 {
        let groups = cover.groups.len() as u64;
        (groups * 8 * channels.len().max(1) as u64).max(groups * FRAME_BYTES)
    }

    /// Nothing is resident. `mean` gives the mean linear RGBA of a channel and group.
    pub(crate) fn new(
        gpu: &Gpu,
        cover: &Cover,
        channels: &[Channel],
        pages: &PageTable,
        mean: impl Fn(usize, u32) -> [f32; 4],
    ) -> Self {
        Self {
            groups: storage(gpu, "fan groups", &group_records(cover, pages)),
            pages: page_texture(gpu, PageWords::extent(pages.len())),
            means: storage(gpu, "fan means", &mean_records(cover.groups.len(), channels.len(), mean)),
            frames: storage(gpu, "fan frames", &frame_records(cover, channels)),
        }
    }

    fn without_pages(&self, gpu: &Gpu) -> Self {
        let pages = page_texture(gpu, [self.pages.width(), self.pages.height()]);
        let [groups, means, frames] = [&self.groups, &self.means, &self.frames].map(wgpu::Buffer::clone);
        Self { groups, pages, means, frames }
    }
}

/// All zero: nothing is resident.
fn page_texture(gpu: &Gpu, [width, height]: [u32; 2]) -> wgpu::Texture {
    gpu.texture("fan pages", [width, height, 1], 1, wgpu::TextureFormat::R32Uint, SAMPLED)
}

const FRAME_BYTES: u64 = 24;

/// A buffer for shaders to read; with one zero item where there is none.
fn storage<T: Pod>(gpu: &Gpu, label: &str, items: &[T]) -> wgpu::Buffer {
    let nothing = [T::zeroed()];
    let items = if items.is_empty() { &nothing } else { items };
    gpu.buffer(label, bytemuck::cast_slice(items), wgpu::BufferUsages::STORAGE)
}

// Bind group 2 of fan shaders: what a material says where an asset has no channel.

/// Bytes of a material as shaders read it.
pub(crate) const MATERIAL_BYTES: u64 = size_of::<MaterialRecord>() as u64;

/// A material as `fan_geometry.wgsl` reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct MaterialRecord {
    base_color: [f32; 4],
    emission: [f32; 3],
    metallic: f32,
    roughness: f32,
    alpha_threshold: f32,
    unlit: u32,
    /// 0 for none.
    toon_stops: u32,
    /// 0 linear, 1 smooth, 2 constant.
    toon_interpolation: u32,
    pad: [u32; 3],
    /// Linear RGB and the place.
    toon: [[f32; 4]; ToonScale::MAX_STOPS],
}

impl MaterialRecord {
    pub(crate) fn new(material: &Material) -> Self {
        let alpha_threshold = if let AlphaMode::Mask(threshold) = material.alpha { threshold } else { 0.0 };
        let mut toon = [[0.0; 4]; ToonScale::MAX_STOPS];
        let stops = material.toon.iter().flat_map(|scale| &scale.stops);
        for (place, &(at, color)) in toon.iter_mut().zip(stops) {
            *place = color.extend(at).to_array();
        }
        let scale = material.toon.as_ref();
        Self {
            base_color: material.base_color.to_array(),
            emission: material.emission.to_array(),
            metallic: material.metallic,
            roughness: material.roughness,
            alpha_threshold,
            unlit: material.unlit.into(),
            toon_stops: scale.map_or(0, |scale| scale.stops.len().min(ToonScale::MAX_STOPS) as u32),
            toon_interpolation: match scale.map(|scale| scale.interpolation) {
                None | Some(ToonInterpolation::Linear) => 0,
                Some(ToonInterpolation::Smooth) => 1,
                Some(ToonInterpolation::Constant) => 2,
            },
            pad: [0; 3],
            toon,
        }
    }
}

/// All materials of a model, one of them bound at a time.
#[derive(Debug)]
pub(crate) struct FanMaterials {
    pub(crate) layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    /// Bytes from one material to the next.
    stride: u32,
}

impl FanMaterials {
    pub(crate) fn new(gpu: &Gpu, materials: &[Material]) -> Result<Self> {
        let limits = gpu.limits();
        let stride =
            size_of::<MaterialRecord>().next_multiple_of(limits.min_uniform_buffer_offset_alignment as usize);
        let allowed = limits.max_buffer_size.min(u32::MAX.into());
        gpu.allow("the materials of a model", (stride * materials.len()) as u64, allowed, "bytes")?;
        let mut contents = vec![0; stride * materials.len()];
        for (place, material) in contents.chunks_exact_mut(stride).zip(materials) {
            place[..size_of::<MaterialRecord>()]
                .copy_from_slice(bytemuck::bytes_of(&MaterialRecord::new(material)));
        }
        let buffer = gpu.buffer("fan materials", &contents, wgpu::BufferUsages::UNIFORM);
        let layout = gpu.fan_programs().material_layout.clone();
        let record =
            wgpu::BufferBinding { buffer: &buffer, offset: 0, size: NonZeroU64::new(MATERIAL_BYTES) };
        let group = gpu.bind_group("fan material", &layout, [BindingResource::Buffer(record)]);
        Ok(Self { layout, group, stride: stride as u32 })
    }

    /// Binds a material to group 2.
    pub(crate) fn bind(&self, pass: &mut wgpu::RenderPass<'_>, material: u32) {
        pass.set_bind_group(2, &self.group, &[material * self.stride]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_uniform_block_has_the_layout_of_the_shader() {
        assert_eq!(std::mem::offset_of!(FanParams, mean_of), 16);
        assert_eq!(std::mem::offset_of!(FanParams, mean_of_light), 32);
        assert_eq!(size_of::<FanParams>(), 48);
    }
}
