//! Coarser levels of the texels that have changed.
//!
//! A texel of a coarser level is the mean of the known part of its footprint in the level before, weighted by area, as in
//! the bake. Only texels over something that changed are computed, from the stored texels of the finer level. Where layers show
//! nothing the texels of the base come back (`base_levels.rs`). Cut-outs keep their coverage (`cut_outs.rs`).

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use fantex_base::{Error, Result};
use fantex_store::{ChannelKind, EditorSnapshot, PAGE, PageId, page_extent, page_grid, page_origin};
use fantex_texture::levels::CutOut;
use glam::Vec4;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::Surface;
use crate::composite::replace_blocks;
use crate::cut_outs::{cut_out_of, maps_read};
use crate::texel_page::{Rect, TexelPage, TexelPages};

/// Changed texels of a level, page by page, in the level's texels.
pub(crate) type Dirty = BTreeMap<[u32; 2], Rect>;

/// Pages as they are under all layers: bytes per channel.
pub(crate) type Base = BTreeMap<PageId, Vec<Vec<u8>>>;

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
    pub(crate) pages: &'a EditorSnapshot,
    base: &'a Base,
    pub(crate) group: u32,
    pub(crate) channel: usize,
    pub(crate) maps: &'a BTreeMap<PageId, Arc<TexelPage>>,
}

impl LevelJob<'_> {
    /// Appends all coarser pages that change, and the mean.
    fn run(&self, levels: &[Dirty], result: &mut CoarserLevels) -> Result<()> {
        let mut finer = LevelPages::new();
        let shape = self.surface.cover().groups[self.group as usize];
        for (level, dirty) in (0u32..).zip(levels).skip(1) {
            let extents = [shape.level_extent(level - 1), shape.level_extent(level)];
            let mut computed = BTreeMap::new();
            for (&page, &rect) in dirty {
                let id = PageId { group: self.group, level, page };
                let values = self.page(id, rect, extents, &mut finer, result)?;
                computed.insert(page, values);
            }
            finer = computed;
        }
        let last = PageId { group: self.group, level: shape.level_count() - 1, page: [0, 0] };
        self.load(last, &mut finer)?;
        let known: Vec<Vec4> = finer[&last.page].iter().flatten().copied().collect();
        if !known.is_empty() {
            let mean = known.iter().sum::<Vec4>() / known.len() as f32;
            result.means.push((self.channel, mean.to_array()));
        }
        Ok(())
    }

    /// A page with the texels of `rect` computed anew; its decoded values, where they are known.
    fn page(
        &self,
        id: PageId,
        rect: Rect,
        [fine, coarse]: [[u32; 2]; 2],
        finer: &mut LevelPages,
        result: &mut CoarserLevels,
    ) -> Result<Vec<Option<Vec4>>> {
        let under = fine_rect(rect, fine, coarse);
        let window = self.window(id.level - 1, fine, under, finer)?;
        let before = self.read(id)?;
        let asset = self.pages.asset();
        let decoded = asset.decode_page_raw(self.channel, id, &before)?;
        let extent = decoded.extent;
        let mut values: Vec<Vec4> = decoded.rgba.into_iter().map(Vec4::from).collect();
        let mut changed = vec![false; values.len()];
        let mut known = self.known(id, values.len());
        let by_alpha = asset.channels()[self.channel].kind == ChannelKind::BaseColor;
        let local = rect.relative_to(page_origin(id.page));
        for [x, y] in local.texels() {
            let at = [x + page_origin(id.page)[0], y + page_origin(id.page)[1]];
            let texel = (y * extent[0] + x) as usize;
            let mean = window.mean(at, fine, coarse, by_alpha);
            (changed[texel], known[texel]) = (mean.is_some(), mean.is_some());
            values[texel] = mean.unwrap_or(values[texel]);
        }
        let around = local.grown(extent);
        continue_values(&mut values, &mut changed, &known, extent, around);
        let mut after = before.clone();
        let channel = &asset.channels()[self.channel];
        replace_blocks(channel, extent, &mut after, &values, around, |texel| changed[texel])?;
        // What is stored is what the next level sees.
        let decoded = asset.decode_page_raw(self.channel, id, &after)?;
        result.pages.push(PageChange { id, channel: self.channel, before, after });
        Ok(where_known(decoded.rgba, &known))
    }

    /// Which texels of a page are known.
    fn known(&self, id: PageId, texels: usize) -> Vec<bool> {
        let map = self.maps.get(&id);
        (0..texels).map(|texel| map.is_none_or(|map| map.is_known(texel))).collect()
    }

    /// Reads a page that has not changed, unless it is there.
    fn load(&self, id: PageId, pages: &mut LevelPages) -> Result<()> {
        if let Entry::Vacant(place) = pages.entry(id.page) {
            let texels = self.pages.asset().decode_page_raw(self.channel, id, &self.read(id)?)?;
            let known = self.known(id, texels.rgba.len());
            place.insert(where_known(texels.rgba, &known));
        }
        Ok(())
    }

    pub(crate) fn read(&self, id: PageId) -> Result<Vec<u8>> {
        match self.base.get(&id) {
            Some(channels) => Ok(channels[self.channel].clone()),
            None => self.pages.read_page_raw(self.channel, id),
        }
    }

    /// Values of a rectangle of the finer level, where they are known.
    fn window(&self, level: u32, extent: [u32; 2], rect: Rect, finer: &mut LevelPages) -> Result<Window> {
        let [width, height] = rect.extent().map(|n| n as usize);
        let mut window = Window { rect, values: vec![None; width * height] };
        for page in pages_of(rect) {
            let id = PageId { group: self.group, level, page };
            self.load(id, finer)?;
            let values = &finer[&page];
            let columns = page_extent(extent, page)[0];
            let part = rect.intersection(page_rect(extent, page));
            for [x, y] in part.texels() {
                let [px, py] = [x - page_origin(page)[0], y - page_origin(page)[1]];
                let texel = (py * columns + px) as usize;
                let to = (y - rect.low[1]) as usize * width + (x - rect.low[0]) as usize;
                window.values[to] = values[texel];
            }
        }
        Ok(window)
    }
}

/// Pages of a level, as they have become, where their texels are known.
type LevelPages = BTreeMap<[u32; 2], Vec<Option<Vec4>>>;

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

/// A rectangle of a level; none where a texel shows no surface.
struct Window {
    rect: Rect,
    values: Vec<Option<Vec4>>,
}

impl Window {
    fn mean(&self, at: [u32; 2], fine: [u32; 2], coarse: [u32; 2], by_alpha: bool) -> Option<Vec4> {
        let width = self.rect.extent()[0] as usize;
        let spans = [0, 1].map(|k| overlaps(at[k], fine[k], coarse[k]));
        let (mut sum, mut colored, mut total) = (Vec4::ZERO, Vec4::ZERO, 0.0);
        for (y, wy) in spans[1].clone() {
            for (x, wx) in spans[0].clone() {
                let texel = (y - self.rect.low[1]) as usize * width + (x - self.rect.low[0]) as usize;
                if let Some(value) = self.values[texel] {
                    let weight = wx * wy;
                    total += weight;
                    sum += value * weight;
                    colored += (value.truncate() * value.w).extend(value.w) * weight;
                }
            }
        }
        if total == 0.0 {
            return None;
        }
        let mean = sum / total;
        // Colours count by their coverage.
        let weighted = by_alpha && colored.w > 0.0;
        Some(if weighted { (colored.truncate() / colored.w).extend(mean.w) } else { mean })
    }
}

/// The fine texels under a coarse one along an axis, with the share of each that is.
fn overlaps(at: u32, fine: u32, coarse: u32) -> impl Iterator<Item = (u32, f32)> + Clone {
    // In units of 1 / (fine coarse) of the tile's side everything is whole.
    let [at, fine, coarse] = [at, fine, coarse].map(u64::from);
    let (from, to) = (at * fine, (at + 1) * fine);
    (from / coarse..to.div_ceil(coarse)).map(move |x| {
        let covered = to.min((x + 1) * coarse) - from.max(x * coarse);
        (x as u32, covered as f32 / coarse as f32)
    })
}

// Coarser levels of a step, at once or beside the painting.

/// Groups whose levels are worked on at a time.
pub(crate) const GROUP_BATCH: usize = 64;

pub(crate) type LevelResults = Vec<(u32, CoarserLevels)>;

#[derive(Debug)]
pub(crate) struct LevelWork {
    pub(crate) surface: Arc<Surface>,
    pub(crate) pages: EditorSnapshot,
    pub(crate) groups: Vec<(u32, Dirty)>,
    /// Those that layers lie over.
    pub(crate) layered: BTreeSet<u32>,
    /// Read instead of what is shown.
    pub(crate) base: Base,
    pub(crate) channels: Vec<usize>,
    /// Of texel maps.
    pub(crate) budget_bytes: usize,
}

impl LevelWork {
    /// What a tile is a cut-out of, where the channel that has its alpha changes.
    pub(crate) fn cut_out(&self, group: u32) -> Option<(CutOut, usize)> {
        let cut_out = cut_out_of(&self.surface, self.pages.asset(), group);
        cut_out.filter(|(_, channel)| self.channels.contains(channel))
    }

    /// Does the work, in parallel; results in the order of the groups.
    pub(crate) fn run(&self, maps: &mut TexelPages) -> Result<LevelResults> {
        let mut results = Vec::with_capacity(self.groups.len());
        for batch in self.groups.chunks(GROUP_BATCH) {
            results.extend(self.run_batch(batch, maps)?);
        }
        Ok(results)
    }

    fn run_batch(&self, groups: &[(u32, Dirty)], maps: &mut TexelPages) -> Result<LevelResults> {
        let surface = &*self.surface;
        let jobs: Vec<(u32, Vec<Dirty>)> = groups
            .par_iter()
            .map(|(group, dirty)| (*group, dirty_levels(surface, *group, dirty.clone())))
            .collect();
        let mut ids: BTreeSet<PageId> =
            jobs.iter().flat_map(|(group, levels)| pages_read(surface, *group, levels)).collect();
        let cut_outs: BTreeMap<u32, (CutOut, usize)> =
            groups.iter().filter_map(|(group, _)| Some((*group, self.cut_out(*group)?))).collect();
        for &group in cut_outs.keys() {
            ids.extend(maps_read(&surface.cover().groups[group as usize], group));
        }
        let ids: Vec<PageId> = ids.into_iter().collect();
        let maps = maps.get(surface, &ids, self.budget_bytes);
        let maps: BTreeMap<_, _> = ids.into_iter().zip(maps).collect();
        jobs.par_iter()
            .map(|(group, levels)| {
                let is_layered = self.layered.contains(group);
                let mut result = CoarserLevels { is_layered, ..CoarserLevels::default() };
                for &channel in &self.channels {
                    let (group, pages, base) = (*group, &self.pages, &self.base);
                    let job = LevelJob { surface, pages, base, group, channel, maps: &maps };
                    match cut_outs.get(&group) {
                        Some((cut_out, alpha)) if *alpha == channel => {
                            job.run_cut_out(*cut_out, &levels[0], &mut result)?;
                        }
                        _ => job.run(levels, &mut result)?,
                    }
                }
                Ok((*group, result))
            })
            .collect()
    }
}

#[derive(Debug)]
pub(crate) struct LevelsUnderway(Receiver<Result<LevelResults>>);

impl LevelsUnderway {
    /// Hands work to the thread for levels: one for all painters, so that dabs keep theirs. None where there is no such
    /// thread.
    pub(crate) fn start(work: LevelWork, maps: &Arc<Mutex<TexelPages>>) -> Option<Self> {
        static POOL: OnceLock<Option<ThreadPool>> = OnceLock::new();
        let name = |_| "paint levels".to_owned();
        let pool = POOL
            .get_or_init(|| ThreadPoolBuilder::new().num_threads(1).thread_name(name).build().ok())
            .as_ref()?;
        let (sender, receiver) = channel();
        let maps = Arc::clone(maps);
        pool.spawn(move || {
            let results = work.run(&mut maps.lock().unwrap_or_else(PoisonError::into_inner));
            // The snapshot goes before the results are known.
            drop(work);
            // A painter that is gone needs no levels.
            drop(sender.send(results));
        });
        Some(Self(receiver))
    }

    pub(crate) fn poll(&self) -> Option<Result<LevelResults>> {
        match self.0.try_recv() {
            Ok(results) => Some(results),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(levels_lost())),
        }
    }

    pub(crate) fn wait(self) -> Result<LevelResults> {
        self.0.recv().unwrap_or_else(|_| Err(levels_lost()))
    }
}

fn levels_lost() -> Error {
    let sentence =
        "the coarser levels of the last stroke could not be computed; undo the stroke and paint it again";
    Error::unavailable(sentence)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlaps_cover_the_fine_texels_exactly() {
        for (fine, coarse) in [(8, 4), (20, 12), (12, 8), (4, 4), (65536, 32768)] {
            let mut covered = vec![0.0f32; fine as usize];
            for at in 0..coarse {
                overlaps(at, fine, coarse).for_each(|(x, share)| covered[x as usize] += share);
            }
            assert!(covered.iter().all(|c| (c - 1.0).abs() < 1e-5), "{fine} {coarse}");
        }
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
