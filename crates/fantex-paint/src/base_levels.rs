//! Coarser levels under the layers.
//!
//! Texels that are averaged anew differ a little from those of the bake. So coarser pages under layers are put aside like those of
//! level 0 (`layers.rs`), and come back block by block: where all finer texels that a block is made of are the base's, so is
//! the block. Those of cut-outs come back where all of level 0 that their scale is found from is the base's (`cut_outs.rs`). A stroke
//! on the base brings them up to date.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use fantex_base::Result;
use fantex_store::{AssetEditor, Channel, PageId, page_extent, page_origin};

use crate::composite::copy_blocks;
use crate::cut_outs::{cut_outs_of, made_of};
use crate::history::PageStep;
use crate::layers::{base_bytes, base_mean_name, base_name, base_page, base_page_of_suffix, prefix};
use crate::levels::{CoarserLevels, fine_rect, pages_of};
use crate::texel_page::{Rect, blocks_of};
use crate::{Painter, Target};

/// Bytes of a mean that is put aside.
pub(crate) const MEAN_BYTES: usize = 16;

impl Painter {
    /// What coarser levels of a group change, page by page. First layered are pages whose base is to be put aside.
    pub(crate) fn page_steps(&self, group: u32, result: &mut CoarserLevels) -> Result<Vec<PageStep>> {
        let mut steps: BTreeMap<PageId, PageStep> = BTreeMap::new();
        for change in result.pages.drain(..) {
            let new = || PageStep { id: change.id, channels: Vec::new(), is_first_layered: false };
            let step = steps.entry(change.id).or_insert_with(new);
            step.channels.push((change.channel, change.before, change.after));
        }
        if result.is_layered {
            self.restore_base(group, &mut steps)?;
            self.restore_means(group, &steps, &mut result.means)?;
        }
        for step in steps.values_mut() {
            step.channels.retain(|(_, before, after)| before != after);
            let is_kept = || self.editor.has_attachment(&base_name(step.id));
            step.is_first_layered = result.is_layered && !step.channels.is_empty() && !is_kept();
        }
        Ok(steps.into_values().filter(|step| !step.channels.is_empty()).collect())
    }

    /// Gives blocks that show nothing but the base the base's bytes.
    fn restore_base(&self, group: u32, steps: &mut BTreeMap<PageId, PageStep>) -> Result<()> {
        // Of finer pages.
        let mut layered: BTreeMap<PageId, Vec<Vec<Rect>>> = BTreeMap::new();
        let ids: Vec<PageId> = steps.keys().copied().collect();
        let cut_outs = cut_outs_of(&self.surface, self.editor.asset(), group);
        let alpha = cut_outs.map(|(_, channel)| channel);
        // Of parts of level 0, by their corners.
        let mut is_base_below: BTreeMap<[[u32; 2]; 2], bool> = BTreeMap::new();
        for id in ids {
            let Some(mut step) = steps.remove(&id) else { continue };
            let base = self.base_of(id)?;
            let shape = self.editor.asset().cover().groups[id.group as usize];
            let [fine, coarse] = [shape.level_extent(id.level - 1), shape.level_extent(id.level)];
            let extent = page_extent(coarse, id.page);
            for (channel, _, after) in &mut step.channels {
                if alpha == Some(*channel) {
                    let part = made_of(&shape, id);
                    let is_base = match is_base_below.entry([part.low, part.high]) {
                        Entry::Occupied(known) => *known.get(),
                        Entry::Vacant(new) => *new.insert(self.is_base(id.group, *channel, part)?),
                    };
                    if is_base {
                        after.clone_from(&base[*channel]);
                    }
                    continue;
                }
                let kind = &self.editor.asset().channels()[*channel];
                for block in differing_blocks(kind, extent, after, &base[*channel]) {
                    let seen = fine_rect(block.moved(page_origin(id.page)).grown(coarse), fine, coarse);
                    let mut is_base = true;
                    for page in pages_of(seen) {
                        let finer = PageId { level: id.level - 1, page, ..id };
                        let blocks = match layered.entry(finer) {
                            Entry::Occupied(known) => known.into_mut(),
                            Entry::Vacant(new) => new.insert(self.layered_blocks(finer, steps)?),
                        };
                        let meets = |block: &Rect| !block.intersection(seen).is_empty();
                        is_base &= !blocks[*channel].iter().any(meets);
                    }
                    if is_base {
                        copy_blocks(kind, extent, &base[*channel], after, block);
                    }
                }
            }
            steps.insert(id, step);
        }
        Ok(())
    }

    /// Whether a part of level 0 shows nothing but the base in a channel.
    fn is_base(&self, group: u32, channel: usize, part: Rect) -> Result<bool> {
        let asset = self.editor.asset();
        let shape = &asset.cover().groups[group as usize];
        for id in pages_of(part).map(|page| PageId { group, level: 0, page }) {
            if !self.editor.has_attachment(&base_name(id)) {
                continue;
            }
            let [shown, base] =
                [self.editor.read_page_raw(channel, id)?, base_page(&self.editor, channel, id)?];
            let extent = page_extent(shape.extent, id.page);
            let blocks = differing_blocks(&asset.channels()[channel], extent, &shown, &base);
            let origin = page_origin(id.page);
            if blocks.into_iter().any(|block| !block.moved(origin).intersection(part).is_empty()) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The blocks of a page that differ from the base, per channel, in texels of its level.
    fn layered_blocks(&self, id: PageId, steps: &BTreeMap<PageId, PageStep>) -> Result<Vec<Vec<Rect>>> {
        let asset = self.editor.asset();
        let (channels, step) = (asset.channels(), steps.get(&id));
        if step.is_none() && !self.editor.has_attachment(&base_name(id)) {
            return Ok(vec![Vec::new(); channels.len()]);
        }
        let level = asset.cover().groups[id.group as usize].level_extent(id.level);
        let extent = page_extent(level, id.page);
        let base = self.base_of(id)?;
        let blocks = channels.iter().zip(base).enumerate().map(|(index, (channel, base))| {
            let changed = step.and_then(|step| step.channels.iter().find(|(c, ..)| *c == index));
            let bytes = match changed {
                Some((_, _, after)) => after.clone(),
                None => self.editor.read_page_raw(index, id)?,
            };
            let blocks = differing_blocks(channel, extent, &bytes, &base).into_iter();
            Ok(blocks.map(|block| block.moved(page_origin(id.page))).collect())
        });
        blocks.collect()
    }

    /// A page's bytes under all layers, per channel.
    fn base_of(&self, id: PageId) -> Result<Vec<Vec<u8>>> {
        base_bytes(&self.editor, id, self.editor.attachment(&base_name(id))?)
    }

    /// Where the coarsest page of a group shows nothing but the base, so does its mean.
    fn restore_means(
        &self,
        group: u32,
        steps: &BTreeMap<PageId, PageStep>,
        means: &mut [(usize, [f32; 4])],
    ) -> Result<()> {
        let Some(kept) = self.editor.attachment(&base_mean_name(group))? else { return Ok(()) };
        let numbers: Vec<f32> =
            kept.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let last = self.coarsest(group);
        let layered = self.layered_blocks(last, steps)?;
        for (channel, mean) in means {
            let is_base = layered[*channel].is_empty();
            if let Some(kept) = numbers.chunks_exact(4).nth(*channel).filter(|_| is_base) {
                mean.copy_from_slice(kept);
            }
        }
        Ok(())
    }

    /// Puts the means of a group aside, if they are not.
    pub(crate) fn keep_means(&mut self, group: u32) -> Result<()> {
        let name = base_mean_name(group);
        if self.editor.has_attachment(&name) {
            return Ok(());
        }
        let channels = 0..self.editor.asset().channels().len();
        let means: Vec<[f32; 4]> = channels.map(|channel| self.editor.mean(channel, group)).collect();
        self.attach(&name, means.into_iter().flatten().flat_map(f32::to_le_bytes).collect())
    }

    fn coarsest(&self, group: u32) -> PageId {
        let levels = self.editor.asset().cover().groups[group as usize].level_count();
        PageId { group, level: levels - 1, page: [0, 0] }
    }

    /// True where coarser levels of a group's base have been put aside.
    pub(crate) fn keeps_base_levels(&self, group: u32) -> bool {
        self.editor.has_attachment(&base_mean_name(group))
    }

    /// Keeps the coarser levels of what lies under the layers of a group.
    pub(crate) fn put_base_levels(&mut self, group: u32, result: CoarserLevels) -> Result<()> {
        let mut bases: BTreeMap<PageId, Vec<Vec<u8>>> = BTreeMap::new();
        for change in result.pages {
            let base = match bases.entry(change.id) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => new.insert(self.base_of(change.id)?),
            };
            base[change.channel] = change.after;
        }
        for (id, base) in bases {
            self.attach(&base_name(id), base.concat())?;
        }
        let name = base_mean_name(group);
        let mut means = self.editor.attachment(&name)?.unwrap_or_default();
        for (channel, mean) in result.means {
            if let Some(kept) = means.chunks_exact_mut(MEAN_BYTES).nth(channel) {
                kept.copy_from_slice(&mean.map(f32::to_le_bytes).concat());
            }
        }
        self.attach(&name, means)
    }
}

/// An attachment that keeps pages or means under the layers, with the channels that the asset was given since it was written. Over
/// these nothing has been painted: what is seen is their base.
pub(crate) fn with_added_channels(
    editor: &AssetEditor,
    name: &str,
    mut contents: Vec<u8>,
) -> Result<Vec<u8>> {
    let Some(suffix) = name.strip_prefix(&prefix(Target::Base)) else { return Ok(contents) };
    if contents.is_empty() {
        return Ok(contents);
    }
    let channels = editor.asset().channels().len();
    if let Some(group) = suffix.strip_suffix("/mean").and_then(|group| group.parse::<u32>().ok()) {
        if (group as usize) < editor.asset().cover().groups.len() {
            let missing = contents.len() / MEAN_BYTES..channels;
            missing.for_each(|channel| {
                contents.extend(editor.mean(channel, group).into_iter().flat_map(f32::to_le_bytes));
            });
        }
        return Ok(contents);
    }
    let Some(id) = base_page_of_suffix(suffix) else { return Ok(contents) };
    let mut known = 0;
    for channel in 0..channels {
        if known == contents.len() {
            contents.extend(editor.read_page_raw(channel, id)?);
        }
        known += editor.asset().page_bytes(channel, id)?;
    }
    Ok(contents)
}

/// The blocks of a page that differ from another of the same extent, relative to the page.
fn differing_blocks(channel: &Channel, extent: [u32; 2], a: &[u8], b: &[u8]) -> Vec<Rect> {
    if a == b {
        return Vec::new();
    }
    let differs = |block: &Rect| {
        channel.format.block_ranges(extent[0], block.low).any(|bytes| a[bytes.clone()] != b[bytes])
    };
    blocks_of(Rect::of(extent)).filter(differs).collect()
}
