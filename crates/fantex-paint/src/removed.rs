//! Channels that are taken out of an asset while it is painted on.
//!
//! Many attachments count channels: pages and means under the layers, pages of layers, the list of layers, the history, the log. The
//! file that takes the asset's place has them all without the removed channels, so that a crash leaves the old asset or the new one.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fantex_base::Result;
use fantex_store::{Asset, ChannelKind};

use crate::added::without_kinds;
use crate::base_levels::MEAN_BYTES;
use crate::error::{damaged, encoded};
use crate::graph::FillTextures;
use crate::layers::{self, Layers, TEXEL_BYTES, base_page_of_suffix, page_of_suffix, prefix};
use crate::relief::Relief;
use crate::{
    FillSettings, History, HistoryStep, Layer, LayerContent, Painter, StrokeSettings, Target, added, history,
    log,
};

impl Painter {
    /// Takes channels out of the asset, with all that was baked and painted in them, and commits. That is no step of the history; earlier
    /// steps stay without what they changed in these channels, and go where they changed nothing else. Removing height takes the relief
    /// of layers out of the normals, and forgets the history. Rewrites the file, which needs room for a copy.
    ///
    /// # Errors
    /// As [`AssetEditor::remove_channels`](fantex_store::AssetEditor::remove_channels). If the file cannot be written, the asset stays as it is.
    pub fn remove_channels(&mut self, kinds: &[ChannelKind]) -> Result<()> {
        if kinds.is_empty() {
            return Ok(());
        }
        let removed = self.editor.asset().removable_channels(kinds)?;
        self.finish_work()?;
        self.end()?;
        let bends = |relief: &Relief| removed.contains(&relief.height) && !removed.contains(&relief.normal);
        let relief = Relief::of(&self.surface, self.editor.asset()).filter(bends);
        let stack = self.layers.stack.clone();
        if let Some(relief) = relief {
            // A crash after this leaves a step that can be undone.
            self.edit_layers("remove height", |layers| {
                layers.iter_mut().for_each(|layer| layer.hide_channel(relief.height));
            })?;
        }
        let result = self.rewrite_without(kinds, removed, relief.is_some());
        if result.is_err() && self.layers.stack != stack {
            self.edit_layers("keep height", |layers| *layers = stack)?;
        }
        result
    }

    fn rewrite_without(
        &mut self,
        kinds: &[ChannelKind],
        removed: Vec<usize>,
        forgets_history: bool,
    ) -> Result<()> {
        self.commit()?;
        let asset = Arc::clone(self.editor.asset());
        let mut removal = Removal {
            asset: &asset,
            kinds,
            removed,
            forgets_history,
            emptied: BTreeSet::new(),
            passed_on: BTreeMap::new(),
            dropped: BTreeSet::new(),
        };
        removal.find_emptied(&self.history)?;
        let change = |name: &str, contents| removal.changed(name, contents);
        self.editor.remove_channels(kinds, Removal::concerns, change)?;
        self.layers = Layers::load(&self.editor)?;
        self.history = History::load(&self.editor)?;
        self.fills = FillTextures::default();
        Ok(())
    }
}

/// What becomes of attachments.
struct Removal<'a> {
    /// As it was.
    asset: &'a Asset,
    kinds: &'a [ChannelKind],
    /// Numbers of the channels, ascending.
    removed: Vec<usize>,
    forgets_history: bool,
    /// Steps of the history that changed nothing else. What they put aside as the base of the layers, the next step does.
    emptied: BTreeSet<u64>,
    /// Records that a step begins with: those of emptied ones before it.
    passed_on: BTreeMap<u64, Vec<u8>>,
    /// Attachments that emptied steps put aside, with no step that was done after them.
    dropped: BTreeSet<String>,
}

impl Removal<'_> {
    fn concerns(name: &str) -> bool {
        name.starts_with("layers/")
            || name.starts_with(history::PREFIX)
            || name == added::LIST
            || log::is_stroke(name)
    }

    /// The contents of an attachment without the channels; none where nothing is left.
    fn changed(&self, name: &str, contents: Vec<u8>) -> Result<Option<Vec<u8>>> {
        if name.starts_with(history::PREFIX) {
            return if self.forgets_history { Ok(None) } else { self.history(name, contents) };
        }
        if self.dropped.contains(name) {
            return Ok(None);
        }
        self.without_channels(name, contents)
    }

    /// The same of one that is no part of the history, as it is now or as a step has it.
    fn without_channels(&self, name: &str, contents: Vec<u8>) -> Result<Option<Vec<u8>>> {
        if name == added::LIST {
            return without_kinds(contents, self.kinds).map(Some);
        }
        if log::is_stroke(name) {
            return self.stroke(contents);
        }
        if name == layers::INDEX {
            return self.list_of_layers(contents).map(Some);
        }
        if let Some(suffix) = name.strip_prefix(&prefix(Target::Base)) {
            return Ok(Some(self.base(suffix, contents)));
        }
        Ok(match page_of_layer(name) {
            Some(suffix) => self.layer(suffix, contents),
            None => Some(contents),
        })
    }

    /// A page of any level, or the means of a group, under the layers.
    fn base(&self, suffix: &str, contents: Vec<u8>) -> Vec<u8> {
        if suffix.ends_with("/mean") {
            return self.without(&contents, |_| Some(MEAN_BYTES));
        }
        let Some(id) = base_page_of_suffix(suffix) else { return contents };
        let channels = self.asset.channels();
        self.without(&contents, |index| {
            let extent = self.asset.page_extent(index, id).ok()?;
            Some(channels.get(index)?.format.bytes(extent))
        })
    }

    /// What is painted on a page of a layer; none where that is nothing.
    fn layer(&self, suffix: &str, contents: Vec<u8>) -> Option<Vec<u8>> {
        let extent = page_of_suffix(suffix).and_then(|id| self.asset.page_extent(0, id).ok());
        let Some([columns, rows]) = extent else { return Some(contents) };
        let bytes = columns as usize * rows as usize * TEXEL_BYTES;
        let known = contents.len() / bytes.max(1);
        let mut kept = self.without(&contents, |index| (index < known).then_some(bytes));
        if self.kinds.contains(&ChannelKind::OcclusionRoughnessMetallic) {
            // The alphas of its components lie behind all channels.
            kept.truncate(kept.len() / bytes.max(1) * bytes);
        }
        kept.iter().any(|byte| *byte != 0).then_some(kept)
    }

    /// Contents without the parts of the removed channels; `length` gives the bytes of each channel's part, in their order.
    fn without(&self, contents: &[u8], length: impl Fn(usize) -> Option<usize>) -> Vec<u8> {
        let (mut kept, mut rest) = (Vec::with_capacity(contents.len()), contents);
        for index in 0.. {
            let Some(part) = length(index).and_then(|length| rest.split_off(..length)) else { break };
            if !self.removed.contains(&index) {
                kept.extend_from_slice(part);
            }
        }
        kept.extend_from_slice(rest);
        kept
    }

    fn list_of_layers(&self, contents: Vec<u8>) -> Result<Vec<u8>> {
        // One that is damaged is reported by whoever reads it.
        let Ok(mut layers) = serde_json::from_slice::<Layers>(&contents) else { return Ok(contents) };
        layers.stack.iter_mut().for_each(|layer| layer.remove_channels(&self.removed));
        encoded(&layers)
    }

    /// A stroke of the log; none where it painted nothing else.
    fn stroke(&self, contents: Vec<u8>) -> Result<Option<Vec<u8>>> {
        let Ok(mut stroke) = serde_json::from_slice::<StrokeSettings>(&contents) else {
            return Ok(Some(contents));
        };
        if let Some(layers) = &mut stroke.set_layers {
            layers.iter_mut().for_each(|layer| layer.remove_channels(&self.removed));
        }
        if let Some(fill) = stroke.layer.as_mut().and_then(|layer| layer.fill.as_mut()) {
            fill.textures.retain(|texture| !self.kinds.contains(&texture.kind));
        }
        let is_gone = stroke.channels.first().is_some_and(|first| self.kinds.contains(&first.kind));
        if stroke.layer.as_ref().is_some_and(|layer| layer.mask) {
            // Its first colour counts, in whatever channel.
            let mut kinds = self.asset.channels().iter().map(|channel| channel.kind);
            stroke.channels.truncate(1);
            if is_gone
                && let Some(other) = kinds.find(|kind| !self.kinds.contains(kind))
                && let Some(first) = stroke.channels.first_mut()
            {
                first.kind = other;
            }
            return encoded(&stroke).map(Some);
        }
        let had_channels = !stroke.channels.is_empty();
        stroke.channels.retain(|channel| !self.kinds.contains(&channel.kind));
        if had_channels && stroke.channels.is_empty() {
            return Ok(None);
        }
        // What was filled cannot be told any more.
        stroke.unrecorded |= is_gone && matches!(stroke.fill, Some(FillSettings::Color(_)));
        encoded(&stroke).map(Some)
    }

    // The history.

    fn history(&self, name: &str, contents: Vec<u8>) -> Result<Option<Vec<u8>>> {
        if name == history::INDEX {
            return history::index_without(contents, &self.emptied).map(Some);
        }
        match history::step_of_part(name) {
            Some((step, _)) if self.emptied.contains(&step) => Ok(None),
            Some((step, number)) => {
                let first = self.passed_on.get(&step).filter(|_| number == 0);
                let mut records = first.cloned().unwrap_or_default();
                records.extend(self.part(&contents)?);
                Ok(Some(records))
            }
            None => Ok(Some(contents)),
        }
    }

    /// A part of a step.
    fn part(&self, contents: &[u8]) -> Result<Vec<u8>> {
        let number = |channel: usize| {
            let before = self.removed.iter().filter(|removed| **removed < channel).count();
            (!self.removed.contains(&channel)).then_some(channel - before)
        };
        let part = history::part_with(contents, number, |name, contents| match contents.is_empty() {
            true => Ok(contents),
            false => Ok(self.without_channels(name, contents)?.unwrap_or_default()),
        })?;
        part.ok_or_else(|| damaged(self.asset, "history", "a step cannot be read"))
    }

    fn find_emptied(&mut self, history: &History) -> Result<()> {
        if self.forgets_history {
            return Ok(());
        }
        let mut aside = Vec::new();
        for step in history.done() {
            self.find_if_emptied(step, &mut aside)?;
        }
        // What the last ones that were done have put aside is not needed, as if they were taken back.
        self.dropped.extend(history::put_aside(&aside).unwrap_or_default());
        for step in history.undone().iter().rev() {
            self.find_if_emptied(step, &mut aside)?;
        }
        Ok(())
    }

    /// `aside`: records of emptied steps directly before this one, which they join or which it takes over.
    fn find_if_emptied(&mut self, step: &HistoryStep, aside: &mut Vec<u8>) -> Result<()> {
        let mut records = Vec::new();
        for name in step.part_names() {
            let Some(contents) = self.asset.attachment(&name)? else { continue };
            let part = self.part(&contents)?;
            if history::put_aside(&part).is_none() {
                if !aside.is_empty() {
                    self.passed_on.insert(step.id, std::mem::take(aside));
                }
                return Ok(());
            }
            records.extend(part);
        }
        self.emptied.insert(step.id);
        aside.extend(records);
        Ok(())
    }
}

/// What stands for the page in the name of an attachment that holds what is painted on a layer.
fn page_of_layer(name: &str) -> Option<&str> {
    let (number, rest) = name.strip_prefix("layers/")?.split_once('/')?;
    number.parse::<u64>().ok()?;
    rest.strip_prefix("page/")
}

impl Layer {
    /// Lets it not show in a channel.
    fn hide_channel(&mut self, channel: usize) {
        let shown = self.channels.len().max(channel + 1);
        self.channels.resize(shown, true);
        self.channels[channel] = false;
    }

    /// Channels of these numbers, ascending, are there no more.
    fn remove_channels(&mut self, removed: &[usize]) {
        fn without<T>(list: &mut Vec<T>, removed: &[usize]) {
            for &index in removed.iter().rev().filter(|index| **index < list.len()).collect::<Vec<_>>() {
                list.remove(index);
            }
        }
        without(&mut self.channels, removed);
        match &mut self.content {
            LayerContent::Fill(colors) => without(colors, removed),
            LayerContent::Graph(fill) => without(&mut fill.textures, removed),
            LayerContent::Painted | LayerContent::Group(_) => {}
        }
    }
}
