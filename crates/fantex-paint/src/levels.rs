//! Coarser levels of the texels that have changed.
//!
//! A texel of a coarser level is the mean of the known part of its footprint in the level before, weighted by area, as in
//! the bake. Only texels over something that changed are computed, from the stored texels of the finer level. Where layers show
//! nothing the texels of the base come back (`base_levels.rs`). Cut-outs keep their coverage (`cut_outs.rs`).

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fantex_base::Result;
use fantex_store::{Asset, AssetEditor, ChannelKind, PAGE, PageId, page_extent, page_grid, page_origin};
use fantex_texture::levels::{CutOuts, Raster, TexelMean};
use glam::Vec4;
use rayon::prelude::*;

use crate::Surface;
use crate::composite::replace_blocks;
use crate::cut_outs::{cut_outs_of, maps_read, working_bytes};
use crate::layers::base_page;
use crate::texel_page::{Rect, TexelPage, TexelPages};

/// Changed texels of a level, page by page, in the level's texels.
pub(crate) type Dirty = BTreeMap<[u32; 2], Rect>;

#[derive(Debug)]
pub(crate) struct PageChange {
    pub(crate) id: PageId,
    pub(crate) channel: usize,
    pub(crate) before: Vec<u8>,
    pub(crate) after: Vec<u8>,
}

#[derive(Debug, Default)]
pub(crate) struct CoarserLevels {
    /// Whether or not their bytes differ; levels ascend within a channel.
    pub(crate) pages: Vec<PageChange>,
    /// Layers lie over the tile.
    pub(crate) is_layered: bool,
    /// Channel and mean.
    pub(crate) means: Vec<(usize, [f32; 4])>,
}

/// The changed texels of all levels of a tile, from those of level 0.
pub(crate) fn dirty_levels(surface: &Surface, group: u32, finest: Dirty) -> Vec<Dirty> {
    let shape = &surface.cover().groups[group as usize];
    let mut levels = vec![finest];
    for level in 1..shape.level_count() {
        let (fine, coarse) = (shape.level_extent(level - 1), shape.level_extent(level));
        let mut dirty = Dirty::new();
        for rect in levels[level as usize - 1].values() {
            add_by_page(&mut dirty, coarse_rect(*rect, fine, coarse), coarse);
        }
        levels.push(dirty);
    }
    levels
}

/// The coarse texels over fine ones.
fn coarse_rect(rect: Rect, fine: [u32; 2], coarse: [u32; 2]) -> Rect {
    let scale = |n: u32, k: usize| u64::from(n) * u64::from(coarse[k]);
    Rect {
        low: [0, 1].map(|k| (scale(rect.low[k], k) / u64::from(fine[k])) as u32),
        high: [0, 1].map(|k| scale(rect.high[k], k).div_ceil(u64::from(fine[k])) as u32),
    }
}

/// The fine texels under coarse ones.
pub(crate) fn fine_rect(rect: Rect, fine: [u32; 2], coarse: [u32; 2]) -> Rect {
    coarse_rect(rect, coarse, fine)
}

fn add_by_page(dirty: &mut Dirty, rect: Rect, extent: [u32; 2]) {
    let [columns, rows] = page_grid(extent);
    for y in rect.low[1] / PAGE..rect.high[1].div_ceil(PAGE).min(rows) {
        for x in rect.low[0] / PAGE..rect.high[0].div_ceil(PAGE).min(columns) {
            let part = rect.intersection(page_rect(extent, [x, y]));
            let known = dirty.entry([x, y]).or_insert(Rect::EMPTY);
            *known = known.union(part);
        }
    }
}

pub(crate) fn page_rect(extent: [u32; 2], page: [u32; 2]) -> Rect {
    Rect::of(page_extent(extent, page)).moved(page_origin(page))
}

/// The pages of a level that a rectangle meets.
pub(crate) fn pages_of(rect: Rect) -> impl Iterator<Item = [u32; 2]> {
    let to = rect.high.map(|n| n.div_ceil(PAGE));
    (rect.low[1] / PAGE..to[1]).flat_map(move |y| (rect.low[0] / PAGE..to[0]).map(move |x| [x, y]))
}

/// Pages that the coarser levels ask for.
pub(crate) fn pages_read(surface: &Surface, group: u32, levels: &[Dirty]) -> Vec<PageId> {
    let shape = &surface.cover().groups[group as usize];
    let mut ids = BTreeSet::new();
    for (level, dirty) in (0u32..).zip(levels) {
        let id = |level: u32, page| PageId { group, level, page };
        if level > 0 {
            let (fine, coarse) = (shape.level_extent(level - 1), shape.level_extent(level));
            for rect in dirty.values() {
                ids.extend(pages_of(fine_rect(*rect, fine, coarse)).map(|page| id(level - 1, page)));
            }
        }
        if level + 1 == shape.level_count() {
            ids.insert(id(level, [0, 0]));
        }
    }
    ids.into_iter().collect()
}

pub(crate) struct LevelJob<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) editor: &'a AssetEditor,
    /// What lies under the layers is read, not what is shown.
    is_base: bool,
    pub(crate) group: u32,
    pub(crate) channel: usize,
    pub(crate) maps: &'a BTreeMap<PageId, Arc<TexelPage>>,
    /// Of blocks of a cut-out that are in work at once.
    pub(crate) budget_bytes: usize,
}

impl LevelJob<'_> {
    /// Appends all coarser pages that change, and the mean. Of what is decoded, only the pages under one page are held at a time.
    fn run(&self, levels: &[Dirty], result: &mut CoarserLevels) -> Result<()> {
        let mut made = MadePages::new();
        let shape = self.surface.cover().groups[self.group as usize];
        for (level, dirty) in (0u32..).zip(levels).skip(1) {
            let extents = [shape.level_extent(level - 1), shape.level_extent(level)];
            let (mut finer, mut next) = (LevelPages::new(), MadePages::new());
            for (&page, &rect) in dirty {
                let id = PageId { group: self.group, level, page };
                let under = fine_rect(rect, extents[0], extents[1]);
                finer.retain(|page, _| !under.intersection(page_rect(extents[0], *page)).is_empty());
                for page in pages_of(under) {
                    if let Entry::Vacant(place) = finer.entry(page) {
                        let id = PageId { level: level - 1, page, ..id };
                        place.insert(self.load(id, &made, &result.pages)?);
                    }
                }
                let (change, known) = self.page(id, rect, extents, &finer)?;
                next.insert(page, (result.pages.len(), known));
                result.pages.push(change);
            }
            made = next;
        }
        let last = PageId { group: self.group, level: shape.level_count() - 1, page: [0, 0] };
        let add = if self.is_color() { TexelMean::add_covered } else { TexelMean::add };
        let mut mean = TexelMean::default();
        self.load(last, &made, &result.pages)?.iter().flatten().for_each(|value| add(&mut mean, *value));
        result.means.extend(mean.value().map(|mean| (self.channel, mean.to_array())));
        Ok(())
    }

    /// A page with the texels of `rect` computed anew, and which of its texels are known.
    fn page(
        &self,
        id: PageId,
        rect: Rect,
        [fine, coarse]: [[u32; 2]; 2],
        finer: &LevelPages,
    ) -> Result<(PageChange, Vec<bool>)> {
        let under = fine_rect(rect, fine, coarse);
        let below = self.window(fine, under, finer);
        let means = below.halved_part(under.low, [fine, coarse], rect.low, rect.extent());
        let before = self.read(id)?;
        let asset = self.editor.asset();
        let decoded = asset.decode_page_raw(self.channel, id, &before)?;
        let extent = decoded.extent;
        let mut values: Vec<Vec4> = decoded.rgba.into_iter().map(Vec4::from).collect();
        let mut changed = vec![false; values.len()];
        let mut known = self.known(id, values.len());
        let local = rect.relative_to(page_origin(id.page));
        for ([x, y], (&mean, &is_known)) in local.texels().zip(means.values.iter().zip(&means.valid)) {
            let texel = (y * extent[0] + x) as usize;
            (changed[texel], known[texel]) = (is_known, is_known);
            if is_known {
                values[texel] = mean;
            }
        }
        let around = local.grown(extent);
        continue_values(&mut values, &mut changed, &known, extent, around);
        let mut after = before.clone();
        let channel = &asset.channels()[self.channel];
        replace_blocks(channel, extent, &mut after, &values, around, |texel| changed[texel])?;
        Ok((PageChange { id, channel: self.channel, before, after }, known))
    }

    /// Which texels of a page are known.
    fn known(&self, id: PageId, texels: usize) -> Vec<bool> {
        let map = self.map(id);
        (0..texels).map(|texel| map.is_known(texel)).collect()
    }

    /// The texel map of a page, built where it is not at hand.
    pub(crate) fn map(&self, id: PageId) -> Arc<TexelPage> {
        self.maps.get(&id).map_or_else(|| Arc::new(TexelPage::build(self.surface, id)), Arc::clone)
    }

    /// A page's values, where they are known: as it has become (what is stored is what the next level sees), or as it is.
    fn load(&self, id: PageId, made: &MadePages, changes: &[PageChange]) -> Result<Vec<Option<Vec4>>> {
        let decode = |bytes: &[u8]| self.editor.asset().decode_page_raw(self.channel, id, bytes);
        if let Some((index, known)) = made.get(&id.page) {
            return Ok(where_known(decode(&changes[*index].after)?.rgba, known));
        }
        let texels = decode(&self.read(id)?)?;
        let known = self.known(id, texels.rgba.len());
        Ok(where_known(texels.rgba, &known))
    }

    pub(crate) fn read(&self, id: PageId) -> Result<Vec<u8>> {
        match self.is_base {
            true => base_page(self.editor, self.channel, id),
            false => self.editor.read_page_raw(self.channel, id),
        }
    }

    /// Whether values count by their coverage.
    fn is_color(&self) -> bool {
        self.editor.asset().channels()[self.channel].kind == ChannelKind::BaseColor
    }

    /// Values of a rectangle of a level, where they are known.
    fn window(&self, extent: [u32; 2], rect: Rect, pages: &LevelPages) -> Raster {
        let mut window = Raster::empty(rect.extent(), 1, self.is_color().then_some(0));
        for (&page, values) in pages {
            let columns = page_extent(extent, page)[0];
            let part = rect.intersection(page_rect(extent, page));
            for [x, y] in part.texels() {
                let [px, py] = [x - page_origin(page)[0], y - page_origin(page)[1]];
                if let Some(value) = values[(py * columns + px) as usize] {
                    let to = ((y - rect.low[1]) * window.extent[0] + (x - rect.low[0])) as usize;
                    (window.values[to], window.valid[to]) = (value, true);
                }
            }
        }
        window
    }
}

/// Pages of a level, where their texels are known.
type LevelPages = BTreeMap<[u32; 2], Vec<Option<Vec4>>>;

/// Pages of a level that are made anew: the numbers of their changes, and which of their texels are known.
type MadePages = BTreeMap<[u32; 2], (usize, Vec<bool>)>;

fn where_known(rgba: Vec<[f32; 4]>, known: &[bool]) -> Vec<Option<Vec4>> {
    rgba.into_iter().zip(known).map(|(rgba, known)| known.then_some(rgba.into())).collect()
}

/// Gives texels beside the surface the mean of their neighbours on it: look-ups at its outline read them.
pub(crate) fn continue_values(
    values: &mut [Vec4],
    changed: &mut [bool],
    known: &[bool],
    extent: [u32; 2],
    rect: Rect,
) {
    for [x, y] in rect.texels() {
        let texel = (y * extent[0] + x) as usize;
        if known[texel] {
            continue;
        }
        let around = Rect { low: [x, y], high: [x + 1, y + 1] }.grown(extent);
        let near = around.texels().map(|[x, y]| (y * extent[0] + x) as usize).filter(|&t| known[t]);
        let (sum, count) = near.fold((Vec4::ZERO, 0), |(sum, count), t| (sum + values[t], count + 1));
        if count > 0 {
            values[texel] = sum / count as f32;
            changed[texel] = true;
        }
    }
}

// Coarser levels of some groups.

/// Most groups whose levels are worked on at a time.
pub(crate) const GROUP_BATCH: usize = 64;

const PAGE_TEXELS: usize = (PAGE * PAGE) as usize;

/// What a texel of a texel map takes, about.
const MAP_BYTES_PER_TEXEL: usize = 6;

/// What a texel takes of the four pages under a page that is made: its value, in two places, and the mean above it.
const WORKING_BYTES_PER_TEXEL: usize = 64;

pub(crate) type LevelResults = Vec<(u32, CoarserLevels)>;

#[derive(Debug)]
pub(crate) struct LevelWork {
    pub(crate) surface: Arc<Surface>,
    pub(crate) groups: Vec<(u32, Dirty)>,
    /// Those that layers lie over.
    pub(crate) layered: BTreeSet<u32>,
    pub(crate) channels: Vec<usize>,
    /// Of texel maps, and of what is in work at once.
    pub(crate) budget_bytes: usize,
}

impl LevelWork {
    /// The cut-outs that a tile shows, where the channel that has their alpha changes.
    fn cut_outs(&self, asset: &Asset, group: u32) -> Option<(CutOuts, usize)> {
        let cut_outs = cut_outs_of(&self.surface, asset, group);
        cut_outs.filter(|(_, channel)| self.channels.contains(channel))
    }

    /// Does the work, in parallel; results in the order of the groups. The levels are those of what is shown, or (`is_base`) of what
    /// lies under the layers.
    pub(crate) fn run(
        &self,
        editor: &AssetEditor,
        is_base: bool,
        maps: &mut TexelPages,
    ) -> Result<LevelResults> {
        let mut results = Vec::with_capacity(self.groups.len());
        let mut left = self.groups.as_slice();
        while !left.is_empty() {
            let bytes = left.iter().map(|(group, dirty)| self.working_bytes(editor.asset(), *group, dirty));
            let (batch, others) = left.split_at(batch_length(bytes, self.budget_bytes));
            results.extend(self.run_batch(batch, editor, is_base, maps)?);
            left = others;
        }
        Ok(results)
    }

    /// What a group takes: texel maps, what is in work, and what is made.
    fn working_bytes(&self, asset: &Asset, group: u32, dirty: &Dirty) -> usize {
        let shape = &self.surface.cover().groups[group as usize];
        let texels = (shape.texels() as usize).min(dirty.len() * PAGE_TEXELS);
        let in_work = WORKING_BYTES_PER_TEXEL * texels.min(4 * PAGE_TEXELS);
        let in_channel = |&channel: &usize| {
            // Bytes before and after, of a third as many texels.
            in_work + texels * asset.channels()[channel].format.bytes([4, 4]) / 24
        };
        let all: usize = self.channels.iter().map(in_channel).sum();
        let cut_outs = self.cut_outs(asset, group).map_or(0, |_| working_bytes(shape, self.budget_bytes));
        all.saturating_add(MAP_BYTES_PER_TEXEL * texels).saturating_add(cut_outs)
    }

    fn run_batch(
        &self,
        groups: &[(u32, Dirty)],
        editor: &AssetEditor,
        is_base: bool,
        maps: &mut TexelPages,
    ) -> Result<LevelResults> {
        let (surface, budget_bytes) = (&*self.surface, self.budget_bytes);
        let jobs: Vec<(u32, Vec<Dirty>)> = groups
            .par_iter()
            .map(|(group, dirty)| (*group, dirty_levels(surface, *group, dirty.clone())))
            .collect();
        let with_cut_outs: BTreeMap<u32, (CutOuts, usize)> = groups
            .iter()
            .filter_map(|(group, _)| Some((*group, self.cut_outs(editor.asset(), *group)?)))
            .collect();
        let has_means = |(group, _): &&(u32, Vec<Dirty>)| {
            let cut_outs = with_cut_outs.get(group);
            cut_outs.is_none_or(|(_, alpha)| self.channels.iter().any(|channel| channel != alpha))
        };
        let with_means = jobs.iter().filter(has_means);
        let mut ids: BTreeSet<PageId> =
            with_means.flat_map(|(group, levels)| pages_read(surface, *group, levels)).collect();
        for &group in with_cut_outs.keys() {
            ids.extend(maps_read(&surface.cover().groups[group as usize], group));
        }
        let bytes = |id: &PageId| {
            let extent = surface.cover().groups[id.group as usize].level_extent(id.level);
            MAP_BYTES_PER_TEXEL * page_extent(extent, id.page).into_iter().product::<u32>() as usize
        };
        if ids.iter().map(bytes).sum::<usize>() > budget_bytes {
            // Each is built when it is wanted, and not kept.
            ids.clear();
        }
        let ids: Vec<PageId> = ids.into_iter().collect();
        let maps = maps.get(surface, &ids, budget_bytes);
        let maps: BTreeMap<_, _> = ids.into_iter().zip(maps).collect();
        // A few groups with their channels keep all threads busy.
        let parts: Vec<(usize, usize)> = (0..jobs.len())
            .flat_map(|index| self.channels.iter().map(move |&channel| (index, channel)))
            .collect();
        let run = |&(index, channel): &(usize, usize)| -> Result<CoarserLevels> {
            let (group, levels) = &jobs[index];
            let mut result = CoarserLevels::default();
            let maps = &maps;
            let job = LevelJob { surface, editor, is_base, group: *group, channel, maps, budget_bytes };
            match with_cut_outs.get(group) {
                Some((cut_outs, alpha)) if *alpha == channel => {
                    job.run_cut_outs(cut_outs, &levels[0], &mut result)?;
                }
                _ => job.run(levels, &mut result)?,
            }
            Ok(result)
        };
        let made = parts.par_iter().map(run).collect::<Result<Vec<CoarserLevels>>>()?;
        let mut made = made.into_iter();
        let whole = jobs.iter().map(|(group, _)| {
            let is_layered = self.layered.contains(group);
            let mut whole = CoarserLevels { is_layered, ..CoarserLevels::default() };
            for part in made.by_ref().take(self.channels.len()) {
                whole.pages.extend(part.pages);
                whole.means.extend(part.means);
            }
            (*group, whole)
        });
        Ok(whole.collect())
    }
}

/// How many groups that take so much each are worked on at a time: as many as fit into the budget, one at least.
fn batch_length(bytes: impl Iterator<Item = usize>, budget_bytes: usize) -> usize {
    let mut sum = 0usize;
    let fits = |own: &usize| {
        sum = sum.saturating_add(*own);
        sum <= budget_bytes
    };
    bytes.take(GROUP_BATCH).take_while(fits).count().max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_fit_into_the_budget() {
        let length = |bytes: &[usize]| batch_length(bytes.iter().copied(), 20);
        assert_eq!(length(&[10, 10, 0, 1, 0]), 3);
        assert_eq!(length(&[0, 20, 20]), 2);
        assert_eq!(length(&[21, 1]), 1);
        assert_eq!(length(&[usize::MAX, usize::MAX]), 1);
        assert_eq!(length(&[0; GROUP_BATCH + 1]), GROUP_BATCH);
    }

    #[test]
    fn rectangles_of_neighbouring_levels_cover_each_other() {
        let (fine, coarse) = ([20, 300], [12, 148]);
        let rect = Rect { low: [3, 257], high: [4, 258] };
        let above = coarse_rect(rect, fine, coarse);
        assert_eq!(above, Rect { low: [1, 126], high: [3, 128] });
        let under = fine_rect(above, fine, coarse);
        assert_eq!(rect.intersection(under), rect);
    }
}
