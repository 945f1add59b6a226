//! What the texture function needs on the GPU besides triangles and texels: groups, pages, means, frames.

use bytemuck::{Pod, Zeroable};
use fantex_cover::{Cover, Group};
use fantex_scene::FilterOptions;
use fantex_store::{Channel, ChannelKind};
use fantex_stream::PageTable;
use fantex_texture::Filter;
use half::f16;

use super::atlas::DRAWN_KINDS;
use super::grid::AtlasGrid;
use super::page_words::PageWords;
use crate::Gpu;

/// The uniform block of `fan_lookup.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct FanParams {
    /// One over the atlas' sides in texels.
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
    pub(crate) fn new(cover: &Cover, channels: &[Channel], grid: AtlasGrid, filter: &FilterOptions) -> Self {
        let channel_of = |kind: ChannelKind| channels.iter().position(|c| c.kind == kind).unwrap_or(0) as u32;
        let [base_color, normal, material, emission, light, anisotropy] = DRAWN_KINDS.map(channel_of);
        Self {
            atlas_scale: atlas_scale(grid),
            delta: cover.delta,
            max_anisotropy: max_anisotropy(filter),
            mean_of: [base_color, normal, material, emission],
            mean_of_light: light,
            channels: channels.len() as u32,
            mean_of_anisotropy: anisotropy,
            pad: 0,
        }
    }

    /// Of another atlas.
    pub(crate) fn with_grid(self, grid: AtlasGrid) -> Self {
        Self { atlas_scale: atlas_scale(grid), ..self }
    }

    /// With a filter's parameters.
    pub(crate) fn with_filter(self, filter: &FilterOptions) -> Self {
        Self { max_anisotropy: max_anisotropy(filter), ..self }
    }
}

fn atlas_scale(grid: AtlasGrid) -> [f32; 2] {
    grid.extent().map(|n| 1.0 / n as f32)
}

fn max_anisotropy(filter: &FilterOptions) -> f32 {
    filter.max_anisotropy.clamp(1.0, fantex_texture::filter::MAX_ANISOTROPY)
}

/// The filter as the shader's constant `FAN_FILTER` names it. The two filters that only the CPU has are replaced by their
/// nearest relatives: bicubic by bilinear, the elliptical weighted average by anisotropic probes.
pub(crate) fn shader_filter(filter: Filter) -> u32 {
    match filter {
        Filter::Nearest => 0,
        Filter::Bilinear | Filter::Bicubic => 1,
        Filter::Trilinear => 2,
        Filter::Anisotropic | Filter::Ewa => 3,
    }
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
    /// The longest of the buffers for a cover, in bytes.
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
        let groups = cover.groups.iter().zip(0..).map(|(group, index)| {
            let [columns, rows] = group.extent.map(|n| n / 4);
            [pages.first(index), columns | rows << 16]
        });
        let means = (0..cover.groups.len() as u32).flat_map(|group| {
            let mean = &mean;
            (0..channels.len()).map(move |channel| mean(channel, group).map(f16::from_f32))
        });
        // Frames turn normals and directions; without those nothing reads them.
        let is_turned = |kind| matches!(kind, ChannelKind::Normal | ChannelKind::Anisotropy);
        let has_vectors = channels.iter().any(|channel| is_turned(channel.kind));
        let frames = cover.groups.iter().filter(|_| has_vectors).map(frame);
        Self {
            groups: storage(gpu, "fan groups", &groups.collect::<Vec<[u32; 2]>>()),
            pages: page_texture(&gpu.device, PageWords::extent(pages.len())),
            means: storage(gpu, "fan means", &means.collect::<Vec<[f16; 4]>>()),
            frames: storage(gpu, "fan frames", &frames.collect::<Vec<[f32; 6]>>()),
        }
    }

    /// The same tables, but nothing is resident.
    pub(crate) fn without_pages(&self, device: &wgpu::Device) -> Self {
        let pages = page_texture(device, [self.pages.width(), self.pages.height()]);
        let [groups, means, frames] = [&self.groups, &self.means, &self.frames].map(wgpu::Buffer::clone);
        Self { groups, pages, means, frames }
    }
}

/// All zero: nothing is resident.
fn page_texture(device: &wgpu::Device, [width, height]: [u32; 2]) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("fan pages"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R32Uint,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Bytes of a group's frame.
const FRAME_BYTES: u64 = 24;

fn frame(group: &Group) -> [f32; 6] {
    let (d, x) = (group.frame.direction, group.frame.x_axis);
    [d.x, d.y, d.z, x.x, x.y, x.z]
}

/// A buffer for shaders to read; with one zero item where there is none.
fn storage<T: Pod>(gpu: &Gpu, label: &str, items: &[T]) -> wgpu::Buffer {
    let nothing = [T::zeroed()];
    let items = if items.is_empty() { &nothing } else { items };
    gpu.buffer(label, bytemuck::cast_slice(items), wgpu::BufferUsages::STORAGE)
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
