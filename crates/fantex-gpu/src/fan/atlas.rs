//! The atlas in graphics memory: a texture per channel.

use fantex_store::{Channel, ChannelKind};
use fantex_stream::AtlasFormat;

use super::grid::AtlasGrid;

/// How many kinds of channel are drawn.
pub(crate) const KINDS: usize = 6;

/// The kinds of channel that are drawn, in the order of their bindings.
pub(crate) const DRAWN_KINDS: [ChannelKind; KINDS] = [
    ChannelKind::BaseColor,
    ChannelKind::Normal,
    ChannelKind::OcclusionRoughnessMetallic,
    ChannelKind::Emission,
    ChannelKind::Light,
    ChannelKind::Anisotropy,
];

/// The formats in which an asset's channels are handed over, in their order: block-compressed as they are stored where the
/// device samples that at full speed, else decoded.
pub(crate) fn atlas_formats(channels: &[Channel], has_block_compression: bool) -> Vec<AtlasFormat> {
    channels.iter().map(|channel| AtlasFormat::of(channel.format, has_block_compression)).collect()
}

/// The texture format that decodes a channel's texels, sRGB included.
pub(crate) fn texture_format(format: AtlasFormat, srgb: bool) -> wgpu::TextureFormat {
    use wgpu::TextureFormat as T;
    match (format, srgb) {
        (AtlasFormat::Bc1, false) => T::Bc1RgbaUnorm,
        (AtlasFormat::Bc1, true) => T::Bc1RgbaUnormSrgb,
        (AtlasFormat::Bc4, _) => T::Bc4RUnorm,
        (AtlasFormat::Bc5, _) => T::Bc5RgUnorm,
        (AtlasFormat::Bc7, false) => T::Bc7RgbaUnorm,
        (AtlasFormat::Bc7, true) => T::Bc7RgbaUnormSrgb,
        (AtlasFormat::R8, _) => T::R8Unorm,
        (AtlasFormat::Rg8, _) => T::Rg8Unorm,
        (AtlasFormat::Rgba8, false) => T::Rgba8Unorm,
        (AtlasFormat::Rgba8, true) => T::Rgba8UnormSrgb,
        (AtlasFormat::Rgba16F, _) => T::Rgba16Float,
    }
}

/// One channel's texels.
#[derive(Debug)]
pub(crate) struct ChannelAtlas {
    pub(crate) format: AtlasFormat,
    pub(crate) texture: wgpu::Texture,
    pub(crate) view: wgpu::TextureView,
}

impl ChannelAtlas {
    pub(crate) fn new(
        device: &wgpu::Device,
        grid: AtlasGrid,
        channel: &Channel,
        format: AtlasFormat,
    ) -> Self {
        let texture = texture(device, grid.extent(), texture_format(format, channel.srgb));
        Self { format, view: texture.create_view(&Default::default()), texture }
    }
}

/// What stands for a channel that an asset has not; it is never read.
pub(crate) fn no_channel(device: &wgpu::Device) -> wgpu::TextureView {
    texture(device, [1, 1], wgpu::TextureFormat::Rgba8Unorm).create_view(&Default::default())
}

fn texture(device: &wgpu::Device, [width, height]: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("fan atlas"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}
