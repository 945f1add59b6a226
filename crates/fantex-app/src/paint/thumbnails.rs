//! Small pictures of what layers and masks hold, on the model as it is seen from a corner.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fantex::base::Result;
use fantex::glam::{DVec2, Vec4};
use fantex::paint::{Layer, Painter, SurfacePoint, Target};
use fantex::store::ChannelKind;
use fantex::texture::color::srgb8_from_linear;

use crate::camera::ViewPreset;
use crate::paint::Viewpoint;

/// Pixels along a side.
pub const THUMBNAIL: usize = 40;

/// sRGB with straight alpha, row by row; transparent beside the model.
pub type Thumbnail = Arc<Vec<[u8; 4]>>;

/// Which pictures have to be made anew.
#[derive(Debug, Default)]
pub(super) struct Thumbnails {
    /// The pixels that show the model, and what they show; found when first asked for.
    seen: Option<(Vec<usize>, Vec<SurfacePoint>)>,
    known: BTreeMap<u64, Layer>,
    due: BTreeSet<Target>,
}

impl Thumbnails {
    /// Something was painted there.
    pub(super) fn changed(&mut self, target: Target) {
        self.due.insert(target);
    }

    /// The layers are these; what was painted on them may have `changed`, too.
    pub(super) fn follow(&mut self, layers: &[Layer], changed: bool) {
        for layer in layers {
            let known = self.known.insert(layer.id(), layer.clone());
            let differs = |what: fn(&Layer, &Layer) -> bool| {
                changed || known.as_ref().is_none_or(|known| what(known, layer))
            };
            // Groups show a folder.
            if layer.group_kind().is_none() && differs(|a, b| a.content != b.content) {
                self.due.insert(Target::Layer(layer.id()));
            }
            let is_other = |a: &Layer, b: &Layer| {
                (a.mask, a.mask_source, a.mask_inverted) != (b.mask, b.mask_source, b.mask_inverted)
            };
            if layer.mask.is_some() && differs(is_other) {
                self.due.insert(Target::Mask(layer.id()));
            }
        }
        self.known.retain(|id, _| layers.iter().any(|layer| layer.id() == *id));
        let known = &self.known;
        self.due.retain(|target| match target {
            Target::Base => true,
            Target::Layer(id) => known.contains_key(id),
            Target::Mask(id) => known.get(id).is_some_and(|layer| layer.mask.is_some()),
        });
        if changed {
            self.due.insert(Target::Base);
        }
    }

    pub(super) fn is_due(&self) -> bool {
        !self.due.is_empty()
    }

    /// Makes one that is due.
    pub(super) fn make(&mut self, painter: &mut Painter) -> Result<Option<(Target, Thumbnail)>> {
        let Some(target) = self.due.pop_first() else { return Ok(None) };
        let (pixels, points) = self.seen.get_or_insert_with(|| seen(painter));
        let channel = painter.editor().asset().channel_of_kind(ChannelKind::BaseColor).unwrap_or(0);
        let mut picture = vec![[0; 4]; THUMBNAIL * THUMBNAIL];
        for (&pixel, value) in pixels.iter().zip(painter.held_at(target, channel, points)?) {
            picture[pixel] = over_squares(value, pixel);
        }
        Ok(Some((target, Arc::new(picture))))
    }
}

fn seen(painter: &Painter) -> (Vec<usize>, Vec<SurfacePoint>) {
    let surface = painter.surface();
    let rig = ViewPreset::ThreeQuarter.rig(surface.mesh(), 1.0);
    let view = Viewpoint { rig, pixels: [THUMBNAIL as u32; 2], pixels_per_point: 1.0 };
    let hits = (0..THUMBNAIL * THUMBNAIL).filter_map(|pixel| {
        let [x, y] = [pixel % THUMBNAIL, pixel / THUMBNAIL].map(|n| (n as f64 + 0.5) / THUMBNAIL as f64);
        Some((pixel, view.hit(surface, DVec2::new(x, y))?))
    });
    hits.unzip()
}

/// What is transparent shows squares of two greys.
fn over_squares(value: Vec4, pixel: usize) -> [u8; 4] {
    let [x, y] = [pixel % THUMBNAIL / 5, pixel / THUMBNAIL / 5];
    let ground = if (x + y) % 2 == 0 { 0.09 } else { 0.05 };
    let alpha = value.w.clamp(0.0, 1.0);
    let [r, g, b] = [value.x, value.y, value.z].map(|c| srgb8_from_linear(ground + (c - ground) * alpha));
    [r, g, b, 255]
}
