//! What the texture function needs on the GPU besides triangles and texels: groups, pages, means, frames.

use bytemuck::{Pod, Zeroable};
use fantex_cover::{Cover, Group};
use fantex_scene::FilterOptions;
use fantex_store::{Channel, ChannelKind};
use fantex_stream::PageTable;
use fantex_texture::Filter;
use half::f16;
use wgpu::util::DeviceExt;

use super::atlas::DRAWN_KINDS;
use super::grid::AtlasGrid;
use super::page_words::PageWords;

/// The uniform block of `fan_lookup.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct FanParams {
    /// One over the atlas' sides in texels.
    atlas_scale: [f32; 2],
    delta: f32,
    max_anisotropy: f32,
    /// Per drawn kind but the last the asset's channel, or 0.
    mean_of: [u32; 4],
    mean_of_light: u32,
    channels: u32,
    pad: [u32; 2],
}

impl FanParams {
    pub(crate) fn new(cover: &Cover, channels: &[Channel], grid: AtlasGrid, filter: &FilterOptions) -> Self {
        let channel_of = |kind: ChannelKind| channels.iter().position(|c| c.kind == kind).unwrap_or(0) as u32;
        let [base_color, normal, material, emission, light] = DRAWN_KINDS.map(channel_of);
        Self {
            atlas_scale: grid.extent().map(|n| 1.0 / n as f32),
            delta: cover.delta,
            max_anisotropy: max_anisotropy(filter),
            mean_of: [base_color, normal, material, emission],
            mean_of_light: light,
            channels: channels.len() as u32,
            pad: [0; 2],
        }
    }

    /// With a filter's parameters.
    pub(crate) fn with_filter(self, filter: &FilterOptions) -> Self {
        Self { max_anisotropy: max_anisotropy(filter), ..self }
    }
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
        device: &wgpu::Device,
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
        // Frames turn normals; without those nothing reads them.
        let has_normals = channels.iter().any(|c| c.kind == ChannelKind::Normal);
        let frames = cover.groups.iter().filter(|_| has_normals).map(frame);
        Self {
            groups: storage(device, "fan groups", &groups.collect::<Vec<[u32; 2]>>()),
            pages: page_texture(device, pages),
            means: storage(device, "fan means", &means.collect::<Vec<[f16; 4]>>()),
            frames: storage(device, "fan frames", &frames.collect::<Vec<[f32; 6]>>()),
        }
    }
}

/// All zero: nothing is resident.
fn page_texture(device: &wgpu::Device, pages: &PageTable) -> wgpu::Texture {
    let [width, height] = PageWords::extent(pages.len());
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
fn storage<T: Pod>(device: &wgpu::Device, label: &str, items: &[T]) -> wgpu::Buffer {
    let nothing = [T::zeroed()];
    let items = if items.is_empty() { &nothing } else { items };
    device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some(label),
        contents: bytemuck::cast_slice(items),
        usage: wgpu::BufferUsages::STORAGE,
    })
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
