//! All layers of a page, one over the other.

use fantex_store::{AssetEditor, PageId};
use glam::Vec4;

use super::{
    FillTextures, Layer, LayerContent, Layers, base_name, decode_mask, decode_values, layer_name, mask_name,
};
use crate::tile_paint::{Rect, TexelPage, copy_blocks, replace_blocks};
use crate::{PaintError, Surface};

/// What a page is flattened from.
pub(crate) struct LayerStack<'a> {
    pub(crate) editor: &'a AssetEditor,
    pub(crate) layers: &'a Layers,
    pub(crate) id: PageId,
    pub(crate) extent: [u32; 2],
    /// Which texels show what.
    pub(crate) surface: &'a Surface,
    pub(crate) map: &'a TexelPage,
    pub(crate) fills: &'a FillTextures,
    /// Whole blocks; what lies outside stays as it is shown.
    pub(crate) rect: Rect,
    /// An attachment that is about to change, with what it will be.
    pub(crate) replaced: Option<(&'a str, &'a [u8])>,
}

/// A layer's part of a page.
struct LayerPage<'a> {
    layer: &'a Layer,
    /// Per channel; empty for fills of one colour, and where a graph shows nothing.
    values: Vec<Vec<Vec4>>,
    /// Empty without a mask.
    mask: Vec<f32>,
}

impl LayerPage<'_> {
    fn source(&self, channel: usize, texel: usize) -> Vec4 {
        match &self.layer.content {
            LayerContent::Painted | LayerContent::Graph(_) => {
                let values = self.values.get(channel).and_then(|values| values.get(texel));
                values.copied().unwrap_or(Vec4::ZERO)
            }
            LayerContent::Fill(colors) => colors.get(channel).map_or(Vec4::ZERO, |&color| color.into()),
        }
    }
}

/// The bytes of the page in all channels of the asset.
pub(crate) fn flatten(stack: &LayerStack<'_>) -> Result<Vec<Vec<u8>>, PaintError> {
    let asset = stack.editor.asset();
    let texels = stack.extent[0] as usize * stack.extent[1] as usize;
    let pages = stack.pages(texels)?;
    let mut flat = Vec::with_capacity(asset.channels().len());
    for (index, (channel, base)) in asset.channels().iter().zip(stack.base()?).enumerate() {
        let decoded = asset.decode_page_raw(index, stack.id, &base)?;
        let mut values: Vec<Vec4> = decoded.rgba.into_iter().map(Vec4::from).collect();
        let mut changed = vec![false; texels];
        let mut rect = Rect::EMPTY;
        for (x, y) in stack.rect.texels() {
            let texel = (y * stack.extent[0] + x) as usize;
            let value = &mut values[texel];
            let before = *value;
            for page in pages.iter().filter(|page| page.layer.shows(index)) {
                let share = page.layer.opacity.clamp(0.0, 1.0) * page.mask.get(texel).copied().unwrap_or(1.0);
                *value = page.layer.blend.compose(*value, page.source(index, texel), share);
            }
            if *value != before {
                changed[texel] = true;
                rect.add(x, y);
            }
        }
        let mut bytes = stack.editor.read_page_raw(index, stack.id)?;
        copy_blocks(channel, stack.extent, &base, &mut bytes, stack.rect);
        if !rect.is_empty() {
            replace_blocks(channel, stack.extent, &mut bytes, &values, rect, |texel| changed[texel])?;
        }
        flat.push(bytes);
    }
    Ok(flat)
}

impl<'a> LayerStack<'a> {
    fn attachment(&self, name: &str) -> Result<Option<Vec<u8>>, PaintError> {
        match self.replaced {
            Some((replaced, contents)) if replaced == name => Ok(Some(contents.to_vec())),
            _ => Ok(self.editor.attachment(name)?),
        }
    }

    /// The page's bytes under all layers, per channel of the asset.
    fn base(&self) -> Result<Vec<Vec<u8>>, PaintError> {
        base_bytes(self.editor, self.id, self.attachment(&base_name(self.id))?)
    }

    /// The layers that show something here.
    fn pages(&self, texels: usize) -> Result<Vec<LayerPage<'a>>, PaintError> {
        let channels = self.editor.asset().channels().len();
        let mut pages = Vec::new();
        for layer in &self.layers.stack {
            let values = match layer.content {
                LayerContent::Fill(_) | LayerContent::Graph(_) => Vec::new(),
                LayerContent::Painted => match self.attachment(&layer_name(layer.id(), self.id))? {
                    Some(bytes) => decode_values(&bytes, channels, texels),
                    None => continue,
                },
            };
            let mask = match layer.mask {
                Some(outside) => {
                    let bytes = self.attachment(&mask_name(layer.id(), self.id))?;
                    decode_mask(&bytes.unwrap_or_default(), texels, outside)
                }
                None => Vec::new(),
            };
            let mut page = LayerPage { layer, values, mask };
            if matches!(layer.content, LayerContent::Graph(_)) {
                let is_hidden = |texel: usize| page.mask.get(texel).is_some_and(|shown| *shown <= 0.0);
                page.values = self.fills.values(self.surface, layer.id(), self.map, self.rect, is_hidden);
            }
            pages.push(page);
        }
        Ok(pages)
    }
}

/// A page's bytes under all layers, per channel: from the attachment that keeps them, or, where nothing lies over the page
/// yet, the page itself.
pub(crate) fn base_bytes(
    editor: &AssetEditor,
    id: PageId,
    kept: Option<Vec<u8>>,
) -> Result<Vec<Vec<u8>>, PaintError> {
    let channels = editor.asset().channels().len();
    let current = (0..channels).map(|channel| editor.read_page_raw(channel, id));
    let current = current.collect::<Result<Vec<_>, _>>()?;
    let Some(kept) = kept.filter(|kept| kept.len() == current.iter().map(Vec::len).sum::<usize>()) else {
        return Ok(current);
    };
    let mut rest = kept.as_slice();
    let mut base = Vec::with_capacity(channels);
    for page in &current {
        let (bytes, after) = rest.split_at(page.len());
        base.push(bytes.to_vec());
        rest = after;
    }
    Ok(base)
}
