//! The atlas as a picture: its texels made small, in the encoding of screens.

use eframe::wgpu;
use fantex::gpu::{AtlasViewer, FanModel, Gpu};

use crate::scene_view::FORMAT;

/// Longest side of the picture.
const MAX_SIDE: u32 = 1024;

/// Seconds between pictures while pages arrive.
const INTERVAL_SECONDS: f64 = 0.2;

#[derive(Debug, Default)]
pub(super) struct AtlasView {
    is_stale: bool,
    drawn: Option<Drawn>,
    viewer: Option<AtlasViewer>,
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

#[derive(Debug)]
pub struct AtlasPicture<'a> {
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
        model: &FanModel,
        channel: usize,
        seconds: f64,
    ) {
        let is_other = self.drawn.as_ref().is_none_or(|drawn| drawn.channel != channel);
        let is_due = self.drawn.as_ref().is_none_or(|drawn| seconds - drawn.seconds >= INTERVAL_SECONDS);
        if !(is_other || self.is_stale && is_due) {
            return;
        }
        self.is_stale = false;
        let Some(atlas) = model.atlas_texture(channel) else {
            // Not the picture of another channel.
            self.drawn = None;
            return;
        };
        let extent = [atlas.width(), atlas.height()];
        let mut drawn = match self.drawn.take() {
            Some(drawn) if drawn.extent == extent => drawn,
            _ => Drawn { view: small_target(gpu, extent), is_new: true, channel, seconds, extent },
        };
        (drawn.channel, drawn.seconds) = (channel, seconds);
        let viewer = self.viewer.get_or_insert_with(|| AtlasViewer::new(gpu, FORMAT));
        viewer.draw(gpu, encoder, &drawn.view, model, channel);
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

fn small_target(gpu: &Gpu, extent: [u32; 2]) -> wgpu::TextureView {
    let longest = extent[0].max(extent[1]).max(1);
    let shrink = longest.div_ceil(MAX_SIDE).max(1);
    let [width, height] = extent.map(|n| (n / shrink).max(1));
    let usage = wgpu::TextureUsages::TEXTURE_BINDING;
    super::target(gpu, "picture of the atlas", [width, height], usage).create_view(&Default::default())
}
