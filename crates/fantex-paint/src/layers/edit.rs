//! Adding, removing and changing layers.

use std::collections::BTreeSet;

use fantex_store::{PAGE, PageId, page_extent, page_grid};
use rayon::prelude::*;

use super::{
    BASE_PREFIX, INDEX, Layer, LayerContent, LayerStack, base_name, flatten, keep_folders, mask_prefix,
    page_of_suffix,
};
use crate::history::PageStep;
use crate::layers::flatten::base_bytes;
use crate::tile_paint::{Changes, Rect};
use crate::work::{FlattenWork, Work};
use crate::{PaintError, Painter, StrokeSettings};

impl Painter {
    /// All layers, from the bottom to the top.
    pub fn layers(&self) -> &[Layer] {
        &self.layers.stack
    }

    /// Puts a layer on top; returns its number, by which strokes name it.
    pub fn add_layer(&mut self, layer: Layer) -> Result<u64, PaintError> {
        let number = self.start_add_layer(layer, None)?;
        self.finish_work()?;
        Ok(number)
    }

    /// The same, above another layer where one is named; what it shows is left to [`work_on`](Self::work_on).
    pub fn start_add_layer(&mut self, layer: Layer, above: Option<u64>) -> Result<u64, PaintError> {
        let mut number = 0;
        self.change_layers("add layer", |layers| {
            number = layers.add(layer);
            let place = layers.stack.iter().position(|layer| Some(layer.id()) == above);
            if let Some(place) = place
                && let Some(layer) = layers.stack.pop()
            {
                layers.stack.insert(place + 1, layer);
            }
        })?;
        Ok(number)
    }

    /// Changes layers in any way: order, names, visibility, opacity, blending, masks; or removes some. One step of the
    /// history. Layers that `change` invents are dropped: use [`add_layer`](Self::add_layer).
    pub fn edit_layers(
        &mut self,
        label: &str,
        change: impl FnOnce(&mut Vec<Layer>),
    ) -> Result<(), PaintError> {
        self.start_edit_layers(label, change)?;
        self.finish_work()
    }

    /// The same; what it shows is left to [`work_on`](Self::work_on).
    pub fn start_edit_layers(
        &mut self,
        label: &str,
        change: impl FnOnce(&mut Vec<Layer>),
    ) -> Result<(), PaintError> {
        self.change_layers(label, |layers| {
            let known: BTreeSet<u64> = layers.stack.iter().map(Layer::id).collect();
            change(&mut layers.stack);
            let mut seen = BTreeSet::new();
            layers.stack.retain(|layer| known.contains(&layer.id()) && seen.insert(layer.id()));
        })
    }

    /// Replaces all layers by others, numbers included: one step of the history. What was painted on numbers that stay, stays.
    pub fn set_layers(&mut self, label: &str, stack: Vec<Layer>) -> Result<(), PaintError> {
        self.change_layers(label, |layers| {
            let mut seen = BTreeSet::new();
            layers.stack = stack.into_iter().filter(|layer| seen.insert(layer.id())).collect();
            let next = layers.stack.iter().map(|layer| layer.id() + 1).max().unwrap_or(0);
            layers.next_id = layers.next_id.max(next);
        })?;
        self.finish_work()
    }

    fn change_layers(
        &mut self,
        label: &str,
        change: impl FnOnce(&mut super::Layers),
    ) -> Result<(), PaintError> {
        self.finish_work()?;
        self.end()?;
        let before = self.layers.clone();
        change(&mut self.layers);
        if before == self.layers {
            return Ok(());
        }
        if let Err(error) = self.fills.update(&self.surface, &self.layers) {
            self.layers = before;
            return Err(error);
        }
        self.begin_step(label);
        let path = self.editor.asset().path().to_owned();
        let list = self.layers.encoded(&path)?;
        self.attach(INDEX, list)?;
        let mut stack = self.layers.stack.clone();
        keep_folders(&mut stack, &path);
        let set_layers = Some(stack);
        self.log(&StrokeSettings { label: label.to_owned(), set_layers, ..StrokeSettings::default() })?;
        let pages = self.pages_to_flatten(&before.stack);
        self.work = Some(Work::Flatten(FlattenWork::new(label, before.stack, &pages)));
        Ok(())
    }

    pub(crate) fn flatten_pages(&mut self, ids: &[PageId], changes: &mut Changes) -> Result<(), PaintError> {
        let maps = self.maps.get(&self.surface, ids, self.options.memory_bytes / 4);
        let (editor, layers, surface, fills) = (&self.editor, &self.layers, &*self.surface, &self.fills);
        let flat: Vec<Vec<Vec<u8>>> = ids
            .par_iter()
            .zip(&maps)
            .map(|(&id, map)| {
                let group = &editor.asset().cover().groups[id.group as usize];
                let extent = page_extent(group.level_extent(0), id.page);
                let rect = Rect { low: [0; 2], high: extent };
                let replaced = None;
                flatten(&LayerStack { editor, layers, id, extent, surface, map, fills, rect, replaced })
            })
            .collect::<Result<_, _>>()?;
        for (&id, flat) in ids.iter().zip(flat) {
            let before = base_bytes(&self.editor, id, None)?;
            // The base is kept from the moment on at which something lies over it.
            let is_first_layered = !self.editor.has_attachment(&base_name(id));
            if is_first_layered {
                self.editor.attach(&base_name(id), before.concat())?;
            }
            let mut channels = Vec::with_capacity(flat.len());
            for (channel, (before, after)) in before.into_iter().zip(flat).enumerate() {
                if before != after {
                    self.editor.replace(id, channel, after.clone())?;
                    channels.push((channel, before, after));
                }
            }
            if !channels.is_empty() {
                let group = &self.editor.asset().cover().groups[id.group as usize];
                let extent = page_extent(group.level_extent(0), id.page);
                changes.add(id, Rect { low: [0; 2], high: extent });
            }
            self.remember(PageStep { id, channels, is_first_layered })?;
        }
        Ok(())
    }

    /// Pages on which some layer shows or has shown something, ascending.
    pub(crate) fn pages_to_flatten(&self, before: &[Layer]) -> Vec<PageId> {
        let everywhere = |layer: &Layer| {
            !matches!(layer.content, LayerContent::Painted) && layer.mask.is_none_or(|outside| outside > 0.0)
        };
        if self.layers.stack.iter().chain(before).any(everywhere) {
            return self.all_pages();
        }
        let names = self.editor.attachment_names();
        let masks: Vec<String> = self.layers.stack.iter().map(|layer| mask_prefix(layer.id())).collect();
        let prefixes = masks.iter().map(String::as_str).chain([BASE_PREFIX]);
        let mut pages = BTreeSet::new();
        for prefix in prefixes {
            let suffixes = names.iter().filter_map(|name| name.strip_prefix(prefix));
            pages.extend(suffixes.filter_map(page_of_suffix).filter(|id| self.has_page(*id)));
        }
        pages.into_iter().collect()
    }

    fn has_page(&self, id: PageId) -> bool {
        let group = self.editor.asset().cover().groups.get(id.group as usize);
        group.is_some_and(|group| group.extent.iter().zip(id.page).all(|(&n, page)| page < n.div_ceil(PAGE)))
    }

    pub(crate) fn all_pages(&self) -> Vec<PageId> {
        let groups = (0u32..).zip(&self.editor.asset().cover().groups);
        let pages = groups.flat_map(|(group, shape)| {
            let [columns, rows] = page_grid(shape.extent);
            (0..rows).flat_map(move |y| (0..columns).map(move |x| PageId { group, level: 0, page: [x, y] }))
        });
        pages.collect()
    }
}
