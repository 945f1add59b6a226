//! From linear values to the numbers and bytes that a channel stores.

use fantex_store::{Channel, ChannelKind, EncodeError, Quality, TexelFormat, TexelSlice, encode_many};
use fantex_texture::color::{srgb8_from_linear, unorm8};
use glam::Vec4;

use crate::{BakeFormat, SourceChannel};

/// How one channel of the source is stored.
#[derive(Clone, Debug)]
pub(crate) struct ChannelPlan {
    pub(crate) channel: Channel,
    pub(crate) has_alpha: bool,
}

impl ChannelPlan {
    pub(crate) fn new(source: &SourceChannel, format: BakeFormat) -> Self {
        use ChannelKind::{
            Anisotropy, BaseColor, Displacement, Emission, Light, Normal, OcclusionRoughnessMetallic,
        };
        // Values that 8 bits cannot hold are kept as they are, whatever the format.
        let format = if source.exceeds_one { BakeFormat::Float } else { format };
        let texel_format = match (format, source.kind) {
            (BakeFormat::Float, _) => TexelFormat::Rgba32F,
            (BakeFormat::Rgba8, Normal | Anisotropy) => TexelFormat::Rg8,
            (BakeFormat::Rgba8, Displacement) => TexelFormat::R8,
            (BakeFormat::Rgba8, _) => TexelFormat::Rgba8,
            (_, Normal | Anisotropy) => TexelFormat::Bc5,
            (_, Displacement) => TexelFormat::Bc4,
            (BakeFormat::Bc1, BaseColor | OcclusionRoughnessMetallic | Emission | Light) => TexelFormat::Bc1,
            (BakeFormat::Bc7, BaseColor | OcclusionRoughnessMetallic | Emission | Light) => TexelFormat::Bc7,
        };
        let srgb = format != BakeFormat::Float && matches!(source.kind, BaseColor | Emission | Light);
        let channel = Channel { kind: source.kind, format: texel_format, srgb };
        Self { channel, has_alpha: source.has_alpha }
    }

    fn float(&self, value: Vec4) -> [f32; 4] {
        let [r, g, b, a] = value.to_array();
        [r, g, b, if self.has_alpha { a } else { 1.0 }]
    }

    fn bytes(&self, value: Vec4) -> [u8; 4] {
        let [r, g, b, a] = value.to_array();
        let alpha = if self.has_alpha { unorm8(a) } else { 255 };
        let color = if self.channel.srgb { [r, g, b].map(srgb8_from_linear) } else { [r, g, b].map(unorm8) };
        [color[0], color[1], color[2], alpha]
    }
}

/// Final values of all channels, `values[texel * channels + channel]`, row-major.
pub(crate) struct Texels {
    pub(crate) extent: [u32; 2],
    pub(crate) values: Vec<Vec4>,
    pub(crate) channels: usize,
}

impl Texels {
    pub(crate) fn window(&self, origin: [u32; 2], extent: [u32; 2]) -> Window<'_> {
        Window { texels: self, origin, extent }
    }
}

/// A rectangle of texels.
pub(crate) struct Window<'a> {
    texels: &'a Texels,
    origin: [u32; 2],
    extent: [u32; 2],
}

impl Window<'_> {
    /// The values of one channel, stored as `store` says.
    fn stored<T>(&self, channel: usize, store: impl Fn(Vec4) -> T) -> Vec<T> {
        let [width, height] = self.extent.map(|n| n as usize);
        let (stride, channels) = (self.texels.extent[0] as usize, self.texels.channels);
        let mut stored = Vec::with_capacity(width * height);
        for row in 0..height {
            let first = (self.origin[1] as usize + row) * stride + self.origin[0] as usize;
            let values = &self.texels.values[first * channels..(first + width) * channels];
            stored.extend(values.chunks_exact(channels).map(|values| store(values[channel])));
        }
        stored
    }
}

/// Encodes pages of all channels: `result[page][channel]`.
pub(crate) fn encode_pages(
    plans: &[ChannelPlan],
    quality: Quality,
    pages: &[Window<'_>],
) -> Result<Vec<Vec<Vec<u8>>>, EncodeError> {
    let mut encoded = vec![Vec::with_capacity(plans.len()); pages.len()];
    for (index, plan) in plans.iter().enumerate() {
        let format = plan.channel.format;
        let bytes = if format == TexelFormat::Rgba32F {
            let texels: Vec<Vec<[f32; 4]>> =
                pages.iter().map(|p| p.stored(index, |v| plan.float(v))).collect();
            let slices: Vec<_> =
                pages.iter().zip(&texels).map(|(p, t)| (p.extent, TexelSlice::F32(t))).collect();
            encode_many(format, quality, &slices)?
        } else {
            let texels: Vec<Vec<[u8; 4]>> =
                pages.iter().map(|p| p.stored(index, |v| plan.bytes(v))).collect();
            let slices: Vec<_> =
                pages.iter().zip(&texels).map(|(p, t)| (p.extent, TexelSlice::U8(t))).collect();
            encode_many(format, quality, &slices)?
        };
        for (page, bytes) in encoded.iter_mut().zip(bytes) {
            page.push(bytes);
        }
    }
    Ok(encoded)
}
