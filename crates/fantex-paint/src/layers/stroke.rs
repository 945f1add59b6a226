//! A stroke onto a layer, a mask, or what lies under the layers.

use std::sync::OnceLock;

use fantex_store::{AssetEditor, EditError, PageId};
use glam::Vec3;

use super::flatten::base_bytes;
use super::{
    FillTextures, Layer, LayerStack, Layers, Target, base_name, decode_mask, decode_values, encode_mask,
    encode_values, flatten, layer_name, mask_name,
};
use crate::PaintError;
use crate::tile_paint::{Ink, StrokePage, TexelPage, composite};

/// What a page becomes.
#[derive(Debug, Default)]
pub(crate) struct ShownPage {
    /// Bytes per affected channel.
    pub(crate) channels: Vec<Vec<u8>>,
    /// Attachments that change, with their contents.
    pub(crate) attachments: Vec<(String, Vec<u8>)>,
}

impl ShownPage {
    /// Puts it in its place.
    pub(crate) fn put(
        self,
        editor: &mut AssetEditor,
        id: PageId,
        affected: &[usize],
    ) -> Result<(), EditError> {
        for (&channel, bytes) in affected.iter().zip(self.channels) {
            editor.replace(id, channel, bytes)?;
        }
        self.attachments.into_iter().try_for_each(|(name, contents)| editor.attach(&name, contents))
    }
}

/// A stroke on a page with layers.
pub(crate) struct LayeredPage<'a> {
    pub(crate) editor: &'a AssetEditor,
    pub(crate) layers: &'a Layers,
    pub(crate) fills: &'a FillTextures,
    pub(crate) map: &'a TexelPage,
    pub(crate) id: PageId,
    pub(crate) page: &'a StrokePage,
    pub(crate) ink: &'a Ink<'a>,
    pub(crate) target: Target,
    /// The channels of the asset that the stroke can change.
    pub(crate) affected: &'a [usize],
}

/// The attachment that a stroke changes on a page.
pub(crate) fn target_name(target: Target, id: PageId) -> String {
    match target {
        Target::Base => base_name(id),
        Target::Layer(layer) => layer_name(layer, id),
        Target::Mask(layer) => mask_name(layer, id),
    }
}

impl LayeredPage<'_> {
    /// The page with the stroke.
    pub(crate) fn show(&self) -> Result<ShownPage, PaintError> {
        // Kept behind the bytes of the channels.
        let before = self.page.originals.last().map_or(&[][..], Vec::as_slice);
        let contents = match self.target {
            Target::Base => self.painted_base(before)?,
            Target::Layer(_) => self.painted_layer(before),
            Target::Mask(layer) => self.painted_mask(before, self.layers.find(layer)),
        };
        let name = target_name(self.target, self.id);
        let mut shown = ShownPage::default();
        let extent = self.map.block.extent;
        let replaced = Some((name.as_str(), contents.as_slice()));
        let stack = LayerStack {
            editor: self.editor,
            layers: self.layers,
            id: self.id,
            extent,
            surface: self.ink.surface,
            map: self.map,
            fills: self.fills,
            rect: self.page.stale.blocks(),
            replaced,
        };
        let mut flat = flatten(&stack)?;
        shown.channels = self.affected.iter().map(|&channel| std::mem::take(&mut flat[channel])).collect();
        if self.target != Target::Base && self.editor.attachment(&base_name(self.id))?.is_none() {
            let base = base_bytes(self.editor, self.id, None)?.concat();
            shown.attachments.push((base_name(self.id), base));
        }
        shown.attachments.push((name, contents));
        Ok(shown)
    }

    fn painted_base(&self, before: &[u8]) -> Result<Vec<u8>, PaintError> {
        let asset = self.editor.asset();
        let mut base = base_bytes(self.editor, self.id, Some(before.to_vec()))?;
        let originals: Vec<Vec<u8>> =
            self.ink.paint.channels.iter().map(|painted| base[painted.channel].clone()).collect();
        let page = StrokePage {
            originals: originals.clone(),
            stale: self.page.touched,
            decoded: OnceLock::new(),
            ..self.page.clone()
        };
        let painted = composite(asset, self.map, self.id, &page, originals, self.ink)?;
        for (channel, bytes) in self.ink.paint.channels.iter().zip(painted) {
            base[channel.channel] = bytes;
        }
        Ok(base.concat())
    }

    fn painted_layer(&self, before: &[u8]) -> Vec<u8> {
        let channels = self.editor.asset().channels().len();
        let mut values = decode_values(before, channels, self.page.coverage.len());
        self.for_each_covered(|texel, place| {
            for (number, painted) in self.ink.paint.channels.iter().enumerate() {
                if let Some(color) = self.ink.color(self.map, self.page, place, number) {
                    let value = &mut values[painted.channel][texel];
                    *value = self.ink.paint.apply(*value, color, self.page.covered(texel));
                }
            }
        });
        encode_values(&values)
    }

    fn painted_mask(&self, before: &[u8], layer: Option<&Layer>) -> Vec<u8> {
        let outside = layer.and_then(|layer| layer.mask).unwrap_or(1.0);
        let mut mask = decode_mask(before, self.page.coverage.len(), outside);
        self.for_each_covered(|texel, place| {
            if let Some(color) = self.ink.color(self.map, self.page, place, 0) {
                // Luminance (ITU-R BT.709).
                let goal = color.truncate().dot(Vec3::new(0.2126, 0.7152, 0.0722)).clamp(0.0, 1.0);
                let share = self.page.covered(texel) * self.ink.paint.opacity.clamp(0.0, 1.0);
                mask[texel] += (goal - mask[texel]) * share;
            }
        });
        encode_mask(&mask)
    }

    fn for_each_covered(&self, mut visit: impl FnMut(usize, [u32; 2])) {
        for (x, y) in self.page.touched.texels() {
            let texel = (y * self.map.block.extent[0] + x) as usize;
            if self.page.covered(texel) > 0.0 && self.map.is_valid(texel) {
                visit(texel, [x, y]);
            }
        }
    }
}
