//! What an asset shows, as a source for another bake.

use fantex_mesh::AlphaMode;
use fantex_store::{Damage, Footprint, PageCache, Sampler, TexelFormat};
use fantex_texture::{Filter, FilterOptions};
use glam::Vec4;

use crate::{Source, SourceChannel, TexelPoint};

/// All channels of an asset, filtered, on the asset's own mesh. With a [`TransferSource`](crate::TransferSource) in between they go to
/// another mesh.
#[derive(Debug)]
pub struct AssetSource {
    sampler: Sampler,
    channels: Vec<SourceChannel>,
}

impl AssetSource {
    /// Reads through a cache.
    pub fn new(cache: &PageCache) -> Self {
        let asset = cache.asset();
        let uses_alpha = asset.mesh().materials.iter().any(|material| material.alpha != AlphaMode::Opaque);
        let channel = |channel: &fantex_store::Channel| SourceChannel {
            has_alpha: uses_alpha && channel.kind == fantex_store::ChannelKind::BaseColor,
            exceeds_one: channel.format == TexelFormat::Rgba32F,
            ..SourceChannel::new(channel.kind)
        };
        let channels = asset.channels().iter().map(channel).collect();
        // Wider filters step over open borders of the surface, and beyond these nothing is stored: previews of sectors have many.
        let filter = FilterOptions { filter: Filter::Trilinear, ..FilterOptions::default() };
        Self { sampler: Sampler::of_cache(cache, filter), channels }
    }
}

impl Source for AssetSource {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn damage(&self) -> Damage {
        self.sampler.cache().damage()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let footprint = Footprint { lambda_steps: point.lambda_steps };
        for (channel, value) in values.iter_mut().enumerate() {
            *value = self.sampler.sample_channel(channel, point.at.clamped(), footprint);
            if self.channels[channel].has_alpha
                && self.sampler.mesh().alpha_mode(point.at.index()) == AlphaMode::Opaque
            {
                // What is stored there has no meaning: it may have been scaled with cut-outs beside it.
                value.w = 1.0;
            }
        }
    }
}
