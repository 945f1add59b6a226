//! What was painted on layers goes to others: copies, merges, masks that are dropped; and what single layers hold, for pictures of them.

use std::collections::{BTreeMap, BTreeSet};

use fantex_base::{Error, Result};
use fantex_store::{ChannelKind, PAGE, PageId, page_extent, page_origin};
use glam::Vec4;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::composite::{replace_blocks, texels_around};
use crate::layer_groups::{
    become_painted, groups_around, layer_below, move_layer, only_erases, remove_layer, with_members,
};
use crate::layer_stack::LayerStack;
use crate::layers::{Held, Layers, TEXEL_BYTES, base_bytes, base_name, float_of, page_name, prefix};
use crate::levels::{fine_rect, pages_of};
use crate::texel_page::Rect;
use crate::{BlendMode, GroupKind, Layer, LayerContent, LayerPlace, Painter, SurfacePoint, Target};

/// What was painted on a layer, mask included, goes to another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LayerMove {
    /// From a layer's number to that of a new one.
    Copy([u64; 2]),
    /// From a layer's number, as it is shown, over what another one shows, to that one: both as they were before the step. A group shows
    /// what lies within it; one that is merged with itself becomes a layer of that.
    Merge([u64; 2]),
}

/// Pages that are merged at a time.
const BATCH: usize = 16;

/// Refuses to merge or copy layers that are not there `before` the step, and to copy to one that is not there `after` it.
pub(crate) fn check_moves(before: &Layers, after: &Layers, moves: &[LayerMove]) -> Result<()> {
    let check = |layers: &Layers, id: u64, what: &str| {
        let none = || Error::not_found(format!("there is no layer number {id} to {what}"));
        layers.find(id).map(|_| ()).ok_or_else(none)
    };
    moves.iter().try_for_each(|step| match *step {
        LayerMove::Merge(ids) => ids.into_iter().try_for_each(|id| check(before, id, "be merged")),
        LayerMove::Copy([from, to]) => {
            check(before, from, "be copied").and_then(|()| check(after, to, "copy to"))
        }
    })
}

impl Painter {
    /// Puts a copy of a layer above it, with what was painted on it and its mask, of a group with all within it; returns the copy's number.
    ///
    /// # Errors
    /// There is no such layer, or the asset cannot be read or changed.
    pub fn duplicate_layer(&mut self, id: u64) -> Result<u64> {
        let copy = self.start_duplicate_layer(id)?;
        self.finish_work()?;
        Ok(copy)
    }

    /// The same; what it shows is left to [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// As [`duplicate_layer`](Self::duplicate_layer).
    pub fn start_duplicate_layer(&mut self, id: u64) -> Result<u64> {
        self.finish_work()?;
        self.end()?;
        let name = self.free_copy_name(&self.known_layer(id)?.name);
        let stack = self.layers.stack.clone();
        // Members come before their group.
        let originals = with_members(&stack, id);
        let copies: BTreeMap<u64, u64> = originals.iter().copied().zip(self.layers.next_id..).collect();
        let moves: Vec<LayerMove> = copies.iter().map(|(&from, &to)| LayerMove::Copy([from, to])).collect();
        let number = copies[&id];
        self.change_layers("duplicate layer", &moves, |layers| {
            for original in stack.iter().filter(|layer| copies.contains_key(&layer.id())) {
                let mut copy = original.clone();
                if original.id() == id {
                    copy.name.clone_from(&name);
                } else {
                    copy.parent = original.parent.map(|parent| copies[&parent]);
                }
                let added = layers.add(copy);
                debug_assert_eq!(added, copies[&original.id()]);
            }
            move_layer(&mut layers.stack, number, LayerPlace::Above(id));
        })?;
        Ok(number)
    }

    fn free_copy_name(&self, name: &str) -> String {
        let taken: BTreeSet<&str> = self.layers.stack.iter().map(|layer| layer.name.as_str()).collect();
        let first = std::iter::once(format!("{name} copy"));
        let mut names = first.chain((2..).map(|n| format!("{name} copy {n}")));
        names.find(|name| !taken.contains(name.as_str())).unwrap_or_default()
    }

    /// Makes one layer of a layer and the one below it, which then holds what both show: masks, opacity and channels are applied. The
    /// picture stays as it is where both blend as `Normal`, or both as `Erase`; other modes of the upper layer act on the lower one alone.
    /// Both lie in the same group; a group counts as a layer of what lies within it.
    ///
    /// # Errors
    /// There is no such layer, none below it, one of them is hidden, the lower one erases and the upper one paints, or the asset cannot
    /// be read or changed.
    pub fn merge_layer_down(&mut self, id: u64) -> Result<()> {
        self.start_merge_layer_down(id)?;
        self.finish_work()
    }

    /// The same; what it shows is left to [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// As [`merge_layer_down`](Self::merge_layer_down).
    pub fn start_merge_layer_down(&mut self, id: u64) -> Result<()> {
        self.finish_work()?;
        self.end()?;
        let upper = self.known_layer(id)?.clone();
        let Some(lower) = layer_below(&self.layers.stack, id).cloned() else {
            let sentence = format!("below the layer {:?} is none that it could be merged with", upper.name);
            return Err(Error::invalid(sentence));
        };
        if let Some(hidden) = [&upper, &lower].into_iter().find(|layer| !layer.visible) {
            let name = &hidden.name;
            let sentence = format!("the layer {name:?} is hidden, and would be lost: show it, then merge");
            return Err(Error::invalid(sentence));
        }
        let to = lower.id();
        let [upper_erases, lower_erases] = [id, to].map(|id| only_erases(&self.layers.stack, id));
        if lower_erases && !upper_erases {
            let (upper, lower) = (&upper.name, &lower.name);
            let sentence = format!(
                "the layer {lower:?} erases what lies below it, and {upper:?} above it paints: one layer cannot do both"
            );
            return Err(Error::invalid(sentence));
        }
        self.change_layers("merge layers", &[LayerMove::Merge([id, to])], |layers| {
            remove_layer(&mut layers.stack, id);
            become_painted(layers, to);
        })
    }

    pub(crate) fn known_layer(&self, id: u64) -> Result<&Layer> {
        let none = || Error::not_found(format!("there is no layer number {id}"));
        self.layers.find(id).ok_or_else(none)
    }

    /// Moves what was painted, with the layers as they were before the step.
    pub(crate) fn move_painted(&mut self, before: &Layers, step: LayerMove) -> Result<()> {
        match step {
            LayerMove::Copy([from, to]) => {
                for part in [Target::Mask, Target::Layer] {
                    let [from, to] = [from, to].map(|id| prefix(part(id)));
                    for name in self.editor.attachment_names_with(&from) {
                        if let Some(page) = name.strip_prefix(&from)
                            && let Some(contents) = self.editor.attachment(&name)?
                        {
                            self.attach(&format!("{to}{page}"), contents)?;
                        }
                    }
                }
                Ok(())
            }
            LayerMove::Merge([upper, lower]) => {
                let mut stack = Vec::new();
                let members: BTreeSet<u64> =
                    [upper, lower].into_iter().flat_map(|id| with_members(&before.stack, id)).collect();
                // What does nothing but erase is laid over nothing as paint: what that covers, the layer erases.
                let is_hole = [upper, lower].iter().all(|&id| only_erases(&before.stack, id));
                let lets_pass = |id: &u64| {
                    let group = before.find(*id).and_then(Layer::group_kind);
                    !members.contains(id) || group == Some(GroupKind::PassThrough)
                };
                for layer in before.stack.iter().filter(|layer| members.contains(&layer.id())) {
                    let mut layer = layer.clone();
                    let erases = is_hole && groups_around(&before.stack, layer.id()).iter().all(lets_pass);
                    if layer.id() == lower || erases {
                        layer.blend = BlendMode::Normal;
                    }
                    if [upper, lower].contains(&layer.id()) {
                        layer.parent = None;
                    }
                    stack.push(layer);
                }
                self.merge(&Layers { next_id: 0, stack }, lower)
            }
        }
    }

    fn merge(&mut self, layers: &Layers, to: u64) -> Result<()> {
        // With the layers as they were: those of the step are known already.
        let mut fills = self.fills.clone();
        fills.update(&self.surface, layers)?;
        let pages = self.pages_of_layers(&layers.stack);
        for ids in pages.chunks(BATCH) {
            let maps = self.maps.get(&self.surface, ids, self.options.budget());
            let (editor, surface, fills) = (&self.editor, &*self.surface, &fills);
            let merged = ids.par_iter().zip(&maps).map(|(&id, map)| {
                let rect = Rect::of(map.block.extent);
                LayerStack { editor, layers, id, surface, map, fills, rect, replaced: None }.merged()
            });
            let merged: Vec<Held> = merged.collect::<Result<_>>()?;
            for (&id, held) in ids.iter().zip(merged) {
                if held.values.iter().flatten().any(|value| value.w > 0.0) {
                    self.attach(&page_name(Target::Layer(to), id), held.encode())?;
                } else {
                    self.detach(&page_name(Target::Layer(to), id))?;
                }
            }
        }
        Ok(())
    }

    /// Pages of level 0 on which one of some layers has something, ascending.
    fn pages_of_layers(&self, stack: &[Layer]) -> Vec<PageId> {
        if stack.iter().any(Layer::is_everywhere) {
            return self.all_pages();
        }
        self.pages_of_targets(stack.iter().flat_map(|l| [Target::Layer(l.id()), Target::Mask(l.id())]))
    }

    /// Drops what was painted on masks that are gone.
    pub(crate) fn forget_masks(&mut self, before: &Layers) -> Result<()> {
        let is_gone = |layer: &&Layer| {
            layer.mask.is_some() && self.layers.find(layer.id()).is_some_and(|now| now.mask.is_none())
        };
        let gone: Vec<u64> = before.stack.iter().filter(is_gone).map(Layer::id).collect();
        for prefix in gone.into_iter().map(|id| prefix(Target::Mask(id))) {
            let names = self.editor.attachment_names_with(&prefix);
            names.iter().try_for_each(|name| self.detach(name))?;
        }
        Ok(())
    }
}

// What single layers hold.

impl Painter {
    /// What a layer (without its mask, opacity and blending; a group shows what lies within it over nothing), a mask (as a grey) or the base holds in a channel at points: straight
    /// linear RGBA, of the texel that is nearest.
    ///
    /// # Errors
    /// There is no such channel or layer, or the asset cannot be read.
    pub fn held_at(&mut self, target: Target, channel: usize, points: &[SurfacePoint]) -> Result<Vec<Vec4>> {
        self.check_channel(channel)?;
        let layer = match target {
            Target::Base => None,
            Target::Layer(id) | Target::Mask(id) => Some(self.known_layer(id)?.clone()),
        };
        self.fills.update(&self.surface, &self.layers)?;
        let places: Vec<(PageId, [u32; 2])> = points.iter().map(|&point| self.texel_at(point)).collect();
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&k| places[k].0);
        let mut values = vec![Vec4::ZERO; points.len()];
        for run in order.chunk_by(|&a, &b| places[a].0 == places[b].0) {
            let id = places[run[0]].0;
            let texels: Vec<[u32; 2]> = run.iter().map(|&k| places[k].1).collect();
            let held = match &layer {
                None => self.base_texels(channel, id, &texels)?,
                Some(layer) => self.layer_texels(target, layer, channel, id, &texels)?,
            };
            run.iter().zip(held).for_each(|(&k, value)| values[k] = value);
        }
        Ok(values)
    }

    /// The texel nearest to a point, within its page: in the tile that counts most there.
    fn texel_at(&self, point: SurfacePoint) -> (PageId, [u32; 2]) {
        let cover = self.surface.cover();
        let taps = cover.taps(self.surface.mesh(), point);
        let Some(tap) = taps.max_by(|a, b| a.weight.total_cmp(&b.weight)) else {
            return (PageId { group: 0, level: 0, page: [0; 2] }, [0; 2]);
        };
        let extent = cover.groups[tap.group as usize].extent;
        let (places, f) = texels_around(extent, tap.uv);
        let [x, y] = places[usize::from(f.x >= 0.5) + 2 * usize::from(f.y >= 0.5)];
        (PageId { group: tap.group, level: 0, page: [x / PAGE, y / PAGE] }, [x % PAGE, y % PAGE])
    }

    fn base_texels(&self, channel: usize, id: PageId, texels: &[[u32; 2]]) -> Result<Vec<Vec4>> {
        let bytes = base_bytes(&self.editor, id, self.editor.attachment(&base_name(id))?)?;
        let page = self.editor.asset().decode_page_raw(channel, id, &bytes[channel])?;
        let texel = |&[x, y]: &[u32; 2]| page.rgba[(y * page.extent[0] + x) as usize].into();
        Ok(texels.iter().map(texel).collect())
    }

    fn layer_texels(
        &mut self,
        target: Target,
        layer: &Layer,
        channel: usize,
        id: PageId,
        texels: &[[u32; 2]],
    ) -> Result<Vec<Vec4>> {
        let extent = self.surface.cover().groups[id.group as usize].extent;
        let [width, height] = page_extent(extent, id.page).map(|n| n as usize);
        let number = |&[x, y]: &[u32; 2]| y as usize * width + x as usize;
        if let (Target::Layer(_), LayerContent::Painted) = (target, &layer.content) {
            let bytes = self.editor.attachment(&page_name(target, id))?.unwrap_or_default();
            let value = |place: &[u32; 2]| {
                let at = TEXEL_BYTES * (channel * width * height + number(place));
                let halves = bytes.get(at..at + TEXEL_BYTES).unwrap_or(&[0; TEXEL_BYTES]);
                Vec4::from_array(std::array::from_fn(|k| float_of([halves[2 * k], halves[2 * k + 1]])))
            };
            return Ok(texels.iter().map(value).collect());
        }
        if let (Target::Layer(_), LayerContent::Fill(colors)) = (target, &layer.content) {
            let color = colors.get(channel).map_or(Vec4::ZERO, |&color| color.into());
            return Ok(vec![color; texels.len()]);
        }
        let map = self.maps.get(&self.surface, &[id], self.options.budget()).swap_remove(0);
        let rect_of = |&[x, y]: &[u32; 2]| Rect { low: [x, y], high: [x + 1, y + 1] };
        let (editor, layers, surface, fills) = (&self.editor, &self.layers, &*self.surface, &self.fills);
        let rect = texels.iter().map(rect_of).fold(Rect::EMPTY, Rect::union);
        let stack = LayerStack { editor, layers, id, surface, map: &map, fills, rect, replaced: None };
        if let (Target::Layer(group), LayerContent::Group(_)) = (target, &layer.content) {
            let values = stack.composed(Some(group), channel)?;
            return Ok(texels.iter().map(|place| values[number(place)]).collect());
        }
        if let Target::Mask(_) = target {
            let mask = stack.mask(layer)?;
            let grey = |shown: f32| Vec4::new(shown, shown, shown, 1.0);
            let value = |place: &[u32; 2]| grey(mask.get(number(place)).copied().unwrap_or(1.0));
            return Ok(texels.iter().map(value).collect());
        }
        let value = |place: &[u32; 2]| {
            let values = fills.values(surface, layer.id(), &map, rect_of(place), |_| false);
            let value = values.get(channel).and_then(|values| values.get(number(place)));
            value.copied().unwrap_or(Vec4::ZERO)
        };
        Ok(texels.iter().map(value).collect())
    }

    /// A page of any level as it would be stored if the base colour (else the first channel) were a layer's mask, as a grey; and
    /// that channel.
    ///
    /// # Errors
    /// As [`mask_on_page`](Self::mask_on_page).
    pub fn mask_as_color(&mut self, id: u64, page: PageId) -> Result<(usize, Vec<u8>)> {
        let mask = self.mask_on_page(id, page)?;
        let index = self.editor.asset().channel_of_kind(ChannelKind::BaseColor).unwrap_or(0);
        self.grey_page(index, page, mask)
    }

    /// The same of the height. `height`: the page's bytes in that channel, where they are to be others than it has. None where the asset
    /// has no height or no base colour.
    ///
    /// # Errors
    /// There is no such page, or it cannot be read or encoded.
    pub fn height_as_color(&self, page: PageId, height: Option<&[u8]>) -> Result<Option<(usize, Vec<u8>)>> {
        let asset = self.editor.asset();
        let channels = [ChannelKind::Displacement, ChannelKind::BaseColor];
        let [Some(from), Some(index)] = channels.map(|kind| asset.channel_of_kind(kind)) else {
            return Ok(None);
        };
        let texels = match height {
            Some(bytes) => asset.decode_page_raw(from, page, bytes)?,
            None => self.editor.read_page(from, page)?,
        };
        let values = texels.rgba.into_iter().map(|value| value[0].clamp(0.0, 1.0));
        self.grey_page(index, page, values).map(Some)
    }

    /// A page of greys in a channel, with its number.
    fn grey_page(
        &self,
        index: usize,
        page: PageId,
        greys: impl IntoIterator<Item = f32>,
    ) -> Result<(usize, Vec<u8>)> {
        let shape = self.surface.cover().groups[page.group as usize];
        let extent = page_extent(shape.level_extent(page.level), page.page);
        let values: Vec<Vec4> = greys.into_iter().map(|grey| Vec4::new(grey, grey, grey, 1.0)).collect();
        let mut bytes = self.editor.read_page_raw(index, page)?;
        let channel = &self.editor.asset().channels()[index];
        replace_blocks(channel, extent, &mut bytes, &values, Rect::of(extent), |_| true)?;
        Ok((index, bytes))
    }

    /// A layer's mask on a page of any level, row by row: of coarser levels some of the texels below each. 1 without a mask.
    ///
    /// # Errors
    /// There is no such layer, or the asset cannot be read.
    pub fn mask_on_page(&mut self, id: u64, page: PageId) -> Result<Vec<f32>> {
        let layer = self.known_layer(id)?.clone();
        self.fills.update(&self.surface, &self.layers)?;
        let shape = self.surface.cover().groups[page.group as usize];
        let (fine, coarse) = (shape.extent, shape.level_extent(page.level));
        let texels = Rect::of(page_extent(coarse, page.page)).moved(page_origin(page.page));
        if layer.mask.is_none() {
            return Ok(vec![1.0; texels.texels().count()]);
        }
        let under = fine_rect(texels, fine, coarse);
        let finest = |place| PageId { level: 0, page: place, ..page };
        let ids: Vec<PageId> = pages_of(under).map(finest).collect();
        let maps = self.maps.get(&self.surface, &ids, self.options.budget());
        let mut masks = BTreeMap::new();
        for (id, map) in ids.into_iter().zip(&maps) {
            let (editor, layers, surface, fills) = (&self.editor, &self.layers, &*self.surface, &self.fills);
            let rect = Rect::of(map.block.extent);
            let stack = LayerStack { editor, layers, id, surface, map, fills, rect, replaced: None };
            masks.insert(id.page, (map.block.extent[0], stack.mask(&layer)?));
        }
        let at = |[x, y]: [u32; 2]| {
            let (width, mask) = &masks[&[x / PAGE, y / PAGE]];
            mask[(y % PAGE * width + x % PAGE) as usize]
        };
        let mean = |place: [u32; 2]| {
            const STEPS: u32 = 4;
            let steps = if page.level == 0 { 1 } else { STEPS };
            let along = |k: usize, s: u32| {
                let n = u64::from(place[k] * steps + s) * u64::from(fine[k]);
                ((n / u64::from(coarse[k] * steps)) as u32).min(fine[k] - 1)
            };
            let places = (0..steps).flat_map(|t| (0..steps).map(move |s| [s, t]));
            places.map(|[s, t]| at([along(0, s), along(1, t)])).sum::<f32>() / (steps * steps) as f32
        };
        Ok(texels.texels().map(mean).collect())
    }
}
