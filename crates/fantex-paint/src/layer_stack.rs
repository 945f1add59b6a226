//! All layers of a page, one over the other.

use fantex_base::Result;
use fantex_store::{AssetEditor, ChannelKind, PageId};
use glam::{Vec3, Vec4};

use crate::composite::{copy_blocks, position_steps, replace_blocks};
use crate::graph::FillTextures;
use crate::layers::{Held, Layers, base_bytes, base_name, decode_mask, page_name};
use crate::paint::mixed;
use crate::relief::Relief;
use crate::texel_page::{Rect, TexelPage};
use crate::{BlendMode, GroupKind, Layer, LayerContent, Surface, Target};

#[derive(Clone, Copy)]
pub(crate) struct LayerStack<'a> {
    pub(crate) editor: &'a AssetEditor,
    pub(crate) layers: &'a Layers,
    pub(crate) id: PageId,
    /// Which texels show what.
    pub(crate) surface: &'a Surface,
    pub(crate) map: &'a TexelPage,
    pub(crate) fills: &'a FillTextures,
    /// Whole blocks; what lies outside stays as it is shown.
    pub(crate) rect: Rect,
    /// An attachment that is about to change, with what it will be.
    pub(crate) replaced: Option<(&'a str, &'a [u8])>,
}

struct LayerPage<'a> {
    layer: &'a Layer,
    /// Per channel; empty for fills of one colour, for groups, and where a graph shows nothing.
    held: Held,
    /// Empty without a mask.
    mask: Vec<f32>,
    /// What lies in it, from the bottom to the top.
    members: Vec<LayerPage<'a>>,
}

impl LayerPage<'_> {
    fn source(&self, channel: usize, texel: usize) -> Vec4 {
        match &self.layer.content {
            LayerContent::Painted | LayerContent::Graph(_) => {
                let values = self.held.values.get(channel).and_then(|values| values.get(texel));
                values.copied().unwrap_or(Vec4::ZERO)
            }
            LayerContent::Fill(colors) => colors.get(channel).map_or(Vec4::ZERO, |&color| color.into()),
            LayerContent::Group(_) => Vec4::ZERO,
        }
    }

    /// Whether components have alphas of their own, here or within.
    fn has_parts(&self) -> bool {
        !self.held.parts.is_empty() || self.members.iter().any(LayerPage::has_parts)
    }

    /// The layer over what lies below it.
    fn over(&self, below: Composed, at: Texel) -> Composed {
        let share = self.layer.opacity.clamp(0.0, 1.0) * self.mask.get(at.texel).copied().unwrap_or(1.0);
        if share <= 0.0 {
            return below;
        }
        // What else has no opacity stays.
        if self.layer.erases() && !at.has_opacity {
            return below;
        }
        let blend = self.layer.blend;
        match self.layer.content {
            LayerContent::Group(GroupKind::PassThrough) => {
                below.toward(compose_all(&self.members, below, at), share, at)
            }
            LayerContent::Group(GroupKind::Isolated) => {
                below.under(compose_all(&self.members, Composed::CLEAR, at), blend, share, at)
            }
            _ => {
                let value = self.source(at.channel, at.texel);
                let alphas = if at.has_parts { self.held.alphas(at.texel, value) } else { Vec3::ZERO };
                below.under(Composed { value, alphas }, blend, share, at)
            }
        }
    }
}

/// What is asked for.
#[derive(Clone, Copy)]
struct Texel {
    channel: usize,
    texel: usize,
    /// Whether components have alphas of their own.
    has_parts: bool,
    /// Whether alpha is the opacity of the model.
    has_opacity: bool,
}

/// Layers, from the bottom to the top, over what lies below them.
fn compose_all(pages: &[LayerPage<'_>], below: Composed, at: Texel) -> Composed {
    let shown = pages.iter().filter(|page| page.layer.shows(at.channel));
    shown.fold(below, |below, page| page.over(below, at))
}

/// What some layers make together.
#[derive(Clone, Copy)]
struct Composed {
    /// Straight linear RGBA.
    value: Vec4,
    /// Of the components, where these have alphas of their own.
    alphas: Vec3,
}

impl Composed {
    const CLEAR: Self = Self { value: Vec4::ZERO, alphas: Vec3::ZERO };

    /// Something that covers all components alike.
    fn whole(value: Vec4) -> Self {
        Self { value, alphas: Vec3::splat(value.w) }
    }

    /// A source over this.
    fn under(self, source: Self, mode: BlendMode, share: f32, at: Texel) -> Self {
        self.by_component(source, at, |below, over| mode.compose(below, over, share))
    }

    /// So far on the way to something else.
    fn toward(self, other: Self, share: f32, at: Texel) -> Self {
        if share >= 1.0 {
            return other;
        }
        self.by_component(other, at, |before, after| mixed(before, after, share))
    }

    fn by_component(self, other: Self, at: Texel, act: impl Fn(Vec4, Vec4) -> Vec4) -> Self {
        if !at.has_parts {
            return Self { value: act(self.value, other.value), alphas: Vec3::ZERO };
        }
        let (mut color, mut alphas) = (self.value.truncate(), self.alphas);
        let (below, over) = (color, other.value.truncate());
        for k in 0..3 {
            let made = act(below.extend(self.alphas[k]), over.extend(other.alphas[k]));
            (color[k], alphas[k]) = (made[k], made.w);
        }
        Self { value: color.extend(alphas.max_element()), alphas }
    }
}

impl<'a> LayerStack<'a> {
    /// The bytes of the page in all channels of the asset.
    pub(crate) fn flatten(&self) -> Result<Vec<Vec<u8>>> {
        let asset = self.editor.asset();
        let shows = |relief: &Relief| self.layers.stack.iter().any(|layer| layer.shows(relief.height));
        let Some(relief) = Relief::of(self.surface, asset).filter(shows) else {
            return self.flatten_around(self.rect, None);
        };
        // Normals follow heights around them.
        let extent = self.map.block.extent;
        let rect = Relief::reach(self.rect, extent).blocks();
        let evaluated = Relief::reach(rect, extent).blocks();
        LayerStack { rect: evaluated, ..*self }.flatten_around(rect, Some(relief))
    }

    /// The same, written in a part of the rectangle that is evaluated.
    fn flatten_around(&self, written: Rect, relief: Option<Relief>) -> Result<Vec<Vec<u8>>> {
        let asset = self.editor.asset();
        let (extent, texels) = (self.map.block.extent, self.map.block.texel_count());
        let pages = self.pages(None, texels)?;
        let mut flat = Vec::with_capacity(asset.channels().len());
        let mut heights = [Vec::new(), Vec::new()];
        let mut layered = Vec::with_capacity(asset.channels().len());
        let base = self.base()?;
        for (index, base) in base.iter().enumerate() {
            let decoded = asset.decode_page_raw(index, self.id, base)?;
            let mut values: Vec<Vec4> = decoded.rgba.into_iter().map(Vec4::from).collect();
            let is_height = relief.is_some_and(|relief| relief.height == index);
            if is_height {
                heights[0].clone_from(&values);
            }
            let mut changed = vec![false; texels];
            let channel = self.channel(index, &pages);
            for place in self.rect.texels() {
                let texel = self.map.texel(place);
                let value = &mut values[texel];
                let before = *value;
                let at = Texel { texel, ..channel };
                *value = compose_all(&pages, Composed::whole(before), at).value;
                changed[texel] |= *value != before;
            }
            if is_height {
                heights[1].clone_from(&values);
            }
            layered.push((values, changed));
        }
        if let Some(relief) = relief {
            let (normals, changed) = &mut layered[relief.normal];
            let [before, after] = &heights;
            relief.bend(self.surface, self.map, written, [before, after], normals, |texel| {
                changed[texel] = true
            });
        }
        for ((index, channel), (base, (values, changed))) in
            asset.channels().iter().enumerate().zip(base.iter().zip(&layered))
        {
            let mut rect = Rect::EMPTY;
            let is_changed = |place: &[u32; 2]| changed[self.map.texel(*place)];
            written.texels().filter(is_changed).for_each(|place| rect.add(place));
            let mut bytes = self.editor.read_page_raw(index, self.id)?;
            copy_blocks(channel, extent, base, &mut bytes, written);
            if !rect.is_empty() {
                replace_blocks(channel, extent, &mut bytes, values, rect, |texel| changed[texel])?;
            }
            flat.push(bytes);
        }
        Ok(flat)
    }

    fn attachment(&self, name: &str) -> Result<Option<Vec<u8>>> {
        match self.replaced {
            Some((replaced, contents)) if replaced == name => Ok(Some(contents.to_vec())),
            _ => Ok(self.editor.attachment(name)?),
        }
    }

    /// The page's bytes under all layers, per channel of the asset.
    fn base(&self) -> Result<Vec<Vec<u8>>> {
        base_bytes(self.editor, self.id, self.attachment(&base_name(self.id))?)
    }

    /// The layers of a group, or of none, that show something here.
    fn pages(&self, parent: Option<u64>, texels: usize) -> Result<Vec<LayerPage<'a>>> {
        let channels = self.editor.asset().channels().len();
        let mut pages = Vec::new();
        for layer in self.layers.stack.iter().filter(|layer| layer.parent == parent && layer.visible) {
            let (mut held, mut members) = (Held::default(), Vec::new());
            match layer.content {
                LayerContent::Fill(_) | LayerContent::Graph(_) => {}
                LayerContent::Painted => {
                    match self.attachment(&page_name(Target::Layer(layer.id()), self.id))? {
                        Some(bytes) => held = Held::decode(&bytes, channels, texels),
                        None => continue,
                    }
                }
                LayerContent::Group(_) => {
                    members = self.pages(Some(layer.id()), texels)?;
                    if members.is_empty() {
                        continue;
                    }
                }
            }
            let mask = self.mask(layer)?;
            if matches!(layer.content, LayerContent::Graph(_)) {
                let is_hidden = |texel: usize| mask.get(texel).is_some_and(|shown| *shown <= 0.0);
                held.values = self.fills.values(self.surface, layer.id(), self.map, self.rect, is_hidden);
            }
            pages.push(LayerPage { layer, held, mask, members });
        }
        Ok(pages)
    }

    /// What the members of a group, or layers in none, show over nothing in a channel, at texels of the rectangle.
    pub(crate) fn composed(&self, parent: Option<u64>, channel: usize) -> Result<Vec<Vec4>> {
        let texels = self.map.block.texel_count();
        let pages = self.pages(parent, texels)?;
        let mut values = vec![Vec4::ZERO; texels];
        let channel = self.channel(channel, &pages);
        for place in self.rect.texels() {
            let texel = self.map.texel(place);
            let at = Texel { texel, ..channel };
            values[texel] = compose_all(&pages, Composed::CLEAR, at).value;
        }
        Ok(values)
    }

    /// What to ask for in a channel, at its first texel.
    fn channel(&self, channel: usize, pages: &[LayerPage<'_>]) -> Texel {
        let asset = self.editor.asset();
        let is_of = |kind| asset.channel_of_kind(kind) == Some(channel);
        let has_parts =
            is_of(ChannelKind::OcclusionRoughnessMetallic) && pages.iter().any(LayerPage::has_parts);
        Texel { channel, texel: 0, has_parts, has_opacity: is_of(ChannelKind::BaseColor) }
    }
}

impl LayerStack<'_> {
    /// How far a layer is shown at each texel of the rectangle; empty without a mask.
    pub(crate) fn mask(&self, layer: &Layer) -> Result<Vec<f32>> {
        let Some(outside) = layer.mask else { return Ok(Vec::new()) };
        let bytes = self.attachment(&page_name(Target::Mask(layer.id()), self.id))?.unwrap_or_default();
        let mut mask = decode_mask(&bytes, self.map.block.texel_count());
        for place in self.rect.texels() {
            let value = &mut mask[self.map.texel(place)];
            if value.is_nan() {
                *value = self.unpainted_mask(layer, outside, place);
            }
            if layer.mask_inverted {
                *value = 1.0 - *value;
            }
        }
        Ok(mask)
    }

    /// A mask where nothing was painted on it, before it is inverted.
    pub(crate) fn unpainted_mask(&self, layer: &Layer, outside: f32, place: [u32; 2]) -> f32 {
        match (layer.mask_source, self.fills.measured(layer.id())) {
            (Some(source), Some(measured)) if self.map.is_valid(self.map.texel(place)) => {
                let width = position_steps(self.surface, self.map.triangle(place));
                let width = width[0].length().max(width[1].length());
                source.mask(measured.at(self.surface, self.map.point(place).clamped(), width))
            }
            _ => outside,
        }
    }

    /// All layers over nothing, per channel and texel.
    pub(crate) fn merged(&self) -> Result<Held> {
        let texels = self.map.block.texel_count();
        let pages = self.pages(None, texels)?;
        let mut merged = Held::default();
        for channel in 0..self.editor.asset().channels().len() {
            let first = self.channel(channel, &pages);
            let at = |texel| Texel { texel, ..first };
            let made: Vec<Composed> =
                (0..texels).map(|texel| compose_all(&pages, Composed::CLEAR, at(texel))).collect();
            merged.values.push(made.iter().map(|made| made.value).collect());
            if first.has_parts {
                merged.parts = made.iter().map(|made| made.alphas).collect();
            }
        }
        Ok(merged)
    }
}
