//! Coarser levels of cut-outs.
//!
//! In a mean of alpha, holes that are smaller than a texel close, and what is thinner than a texel goes. So the levels of a tile that shows
//! cut-outs are made as in the bake (`fantex_texture::levels`): means of level 0, with the alpha of each level scaled so that the same share
//! of each cut-out is there. Its factor holds for all of a level, so whatever changes in the tile, its levels are made anew as a whole. In
//! tiles that the bake cuts into blocks, the levels finer than [`SHARED_LEVEL`] have factors per block, and are made anew in blocks that
//! something changes in; from that level on the tile is whole. Materials of other thresholds have factors of their own; what is blended
//! holds the mean.

use std::sync::Arc;

use fantex_base::Result;
use fantex_cover::{BLOCK_MARGIN, BlockPart, Group, MAX_BLOCK_SIDE, SHARED_LEVEL, TexelBlock, TileBlock};
use fantex_mesh::AlphaMode;
use fantex_store::{Asset, ChannelKind, PageId, page_extent, page_origin};
use fantex_texture::levels::{AlphaScales, Covered, CutOuts, LargestCutOut, Raster, TexelMean};
use glam::Vec4;
use rayon::prelude::*;

use crate::composite::replace_blocks;
use crate::levels::{CoarserLevels, Dirty, LevelJob, PageChange, continue_values, page_rect, pages_of};
use crate::steps::Changes;
use crate::texel_page::Rect;
use crate::{History, Painter, Surface};

/// The cut-outs that a tile shows, if it shows any, and the channel that has their alpha.
pub(crate) fn cut_outs_of(surface: &Surface, asset: &Asset, group: u32) -> Option<(CutOuts, usize)> {
    let channel = asset.channel_of_kind(ChannelKind::BaseColor)?;
    let cut_outs = all_cut_outs(surface, group);
    (!cut_outs.is_empty()).then_some((cut_outs, channel))
}

fn all_cut_outs(surface: &Surface, group: u32) -> CutOuts {
    let triangles = surface.triangles_of_group(group).iter();
    CutOuts::of(triangles.map(|&triangle| surface.mesh().alpha_mode(triangle as usize)), false)
}

/// Pages of level 0 whose texel maps are wanted at once; none in tiles that are worked on block by block.
pub(crate) fn maps_read(shape: &Group, group: u32) -> impl Iterator<Item = PageId> + use<> {
    let rect = if is_one_block(shape) { Rect::of(shape.extent) } else { Rect::EMPTY };
    pages_of(rect).map(move |page| PageId { group, level: 0, page })
}

fn is_one_block(shape: &Group) -> bool {
    shape.extent.iter().all(|&n| n <= MAX_BLOCK_SIDE)
}

/// What a texel in work takes: its value, the levels above it, and what the scale of alpha is found from.
const WORKING_BYTES_PER_TEXEL: usize = 48;

/// The same for the largest block.
const WORKING_BYTES_PER_BLOCK: usize =
    WORKING_BYTES_PER_TEXEL * ((MAX_BLOCK_SIDE + 2 * BLOCK_MARGIN) as usize).pow(2);

/// What a tile in work takes: one that is cut into blocks, all of the budget, as so many of them are in work at once.
pub(crate) fn working_bytes(shape: &Group, budget_bytes: usize) -> usize {
    if is_one_block(shape) { WORKING_BYTES_PER_TEXEL * shape.texels() as usize } else { budget_bytes }
}

/// The texels of level 0 that a page of a coarser level and its factor are made of.
pub(crate) fn made_of(shape: &Group, id: PageId) -> Rect {
    let holds = |block: &TileBlock| {
        let BlockPart { first, size, .. } = block.at_level(id.level);
        let origin = page_origin(id.page);
        (0..2).all(|k| (first[k]..first[k] + size[k]).contains(&origin[k]))
    };
    let is_whole = is_one_block(shape) || id.level >= SHARED_LEVEL;
    let blocks = if is_whole { Vec::new() } else { TileBlock::all(shape.extent, BLOCK_MARGIN) };
    blocks.into_iter().find(holds).map_or(Rect::of(shape.extent), |block| rect_of(block.around))
}

fn rect_of(block: TexelBlock) -> Rect {
    Rect::of(block.extent).moved(block.origin)
}

/// Part of a tile at [`SHARED_LEVEL`], and what its finer levels have become.
struct Block {
    raster: Raster,
    first: [u32; 2],
    covered: Covered,
    pages: Vec<PageChange>,
}

impl LevelJob<'_> {
    /// Appends the coarser pages of a tile with cut-outs, and the mean. `dirty`: what has changed at level 0.
    pub(crate) fn run_cut_outs(
        &self,
        cut_outs: &CutOuts,
        dirty: &Dirty,
        result: &mut CoarserLevels,
    ) -> Result<()> {
        let shape = self.surface.cover().groups[self.group as usize];
        let mut covered = Covered::default();
        let (first_level, mut raster) = if is_one_block(&shape) {
            (0, self.finest(cut_outs, TexelBlock { origin: [0, 0], extent: shape.extent })?)
        } else {
            let extent = shape.level_extent(SHARED_LEVEL);
            let mut shared = Raster::empty(extent, 1, Some(0)).with_cut_outs(cut_outs);
            let (mut known, mut pages) = (Vec::new(), Vec::new());
            let at_once = (self.budget_bytes / WORKING_BYTES_PER_BLOCK).max(1);
            for blocks in TileBlock::all(shape.extent, BLOCK_MARGIN).chunks(at_once) {
                let made = blocks.par_iter().map(|block| self.block(cut_outs, block, dirty));
                for block in made.collect::<Result<Vec<Block>>>()? {
                    shared.paste(block.first, &block.raster);
                    known.push(block.covered);
                    pages.extend(block.pages);
                }
            }
            pages.sort_by_key(|change: &PageChange| change.id.level);
            result.pages.extend(pages);
            covered = Covered::mean(&known);
            (SHARED_LEVEL, shared)
        };
        for level in first_level..shape.level_count() {
            if level > first_level {
                raster = raster.halved(shape.level_extent(level));
            }
            let scales = alpha_scales(&raster, &mut covered);
            if level > 0 {
                let all = BlockPart { start: [0, 0], size: raster.extent, first: [0, 0] };
                result.pages.extend(self.stored(level, &raster, &scales, all)?);
            }
        }
        let valid = raster.values.iter().zip(&raster.valid).filter(|(_, valid)| **valid);
        let mut mean = TexelMean::default();
        valid.for_each(|(value, _)| mean.add_covered(*value));
        if let Some(mut mean) = mean.value() {
            let mesh = self.surface.mesh();
            let triangles = self.surface.triangles_of_group(self.group).iter().map(|&t| t as usize);
            if let Some(largest) =
                LargestCutOut::of(triangles.map(|t| (mesh.alpha_mode(t), mesh.triangle_area(t))))
            {
                mean.w = largest.alpha_of_mean(mean.w, &covered, self.group);
            }
            result.means.push((self.channel, mean.to_array()));
        }
        Ok(())
    }

    /// A block of a large tile.
    fn block(&self, cut_outs: &CutOuts, block: &TileBlock, dirty: &Dirty) -> Result<Block> {
        let around = rect_of(block.around);
        let is_changed = dirty.values().any(|rect| !rect.intersection(around).is_empty());
        let mut raster = self.finest(cut_outs, block.around)?;
        let (mut covered, mut pages) = (Covered::default(), Vec::new());
        for level in 0..SHARED_LEVEL {
            if is_changed || level == 0 {
                let scales = alpha_scales(&raster, &mut covered);
                if level > 0 {
                    pages.extend(self.stored(level, &raster, &scales, block.at_level(level))?);
                }
            }
            raster = raster.halved(block.halved(level, raster.extent));
        }
        let BlockPart { start, size, first } = block.at_level(SHARED_LEVEL);
        Ok(Block { raster: raster.window(start, size), first, covered, pages })
    }

    /// The texels of level 0 in a rectangle, as they are stored.
    fn finest(&self, cut_outs: &CutOuts, block: TexelBlock) -> Result<Raster> {
        let extent = self.surface.cover().groups[self.group as usize].extent;
        let rect = rect_of(block);
        let mut raster = Raster::empty(block.extent, 1, Some(0)).with_cut_outs(cut_outs);
        for page in pages_of(rect) {
            let id = PageId { group: self.group, level: 0, page };
            let map = self.map(id);
            let texels = self.editor.asset().decode_page_raw(self.channel, id, &self.read(id)?)?;
            let origin = page_origin(page);
            for [x, y] in rect.intersection(page_rect(extent, page)).texels() {
                let place = [x - origin[0], y - origin[1]];
                let from = map.texel(place);
                let to = ((y - rect.low[1]) * block.extent[0] + (x - rect.low[0])) as usize;
                raster.read[to] = map.is_in_region(from);
                if map.is_known(from) {
                    raster.values[to] = Vec4::from(texels.rgba[from]);
                    raster.valid[to] = true;
                    let triangle = map.triangle(place).triangle as usize;
                    raster.set_alpha_mode(to, self.surface.mesh().alpha_mode(triangle));
                }
            }
        }
        Ok(raster)
    }

    /// The pages of a level that a part of a raster makes anew.
    fn stored(
        &self,
        level: u32,
        raster: &Raster,
        scales: &AlphaScales,
        BlockPart { start, size, first }: BlockPart,
    ) -> Result<Vec<PageChange>> {
        let asset = self.editor.asset();
        let channel = &asset.channels()[self.channel];
        let mut pages = Vec::new();
        for page in pages_of(Rect::of(size).moved(first)) {
            let id = PageId { group: self.group, level, page };
            let before = self.read(id)?;
            let decoded = asset.decode_page_raw(self.channel, id, &before)?;
            let extent = decoded.extent;
            let mut values: Vec<Vec4> = decoded.rgba.into_iter().map(Vec4::from).collect();
            let mut known = vec![false; values.len()];
            let origin = page_origin(page);
            for (texel, [x, y]) in Rect::of(extent).texels().enumerate() {
                let at = [x, y];
                let [column, row] = [0, 1].map(|k| at[k] + origin[k] - first[k] + start[k]);
                let from = (row * raster.extent[0] + column) as usize;
                if raster.valid[from] {
                    values[texel] = raster.scaled(from, raster.values[from], scales);
                    known[texel] = true;
                }
            }
            let mut changed = known.clone();
            let all = Rect::of(extent);
            continue_values(&mut values, &mut changed, &known, extent, all);
            let mut after = before.clone();
            replace_blocks(channel, extent, &mut after, &values, all, |texel| changed[texel])?;
            pages.push(PageChange { id, channel: self.channel, before, after });
        }
        Ok(pages)
    }
}

/// What the alpha of a level is to be multiplied by.
fn alpha_scales(raster: &Raster, covered: &mut Covered) -> AlphaScales {
    let alpha: Vec<f32> = raster.values.iter().map(|value| value.w).collect();
    raster.alpha_scales(&alpha, covered)
}

// What materials make of alpha.

impl Painter {
    /// Lets all materials of the asset take the alpha of its base colour so, and commits. That is no step of the history. Where opacity
    /// has been lowered already, coarser levels of cut-outs become those that keep their coverage, or means again: that is a step, as
    /// it changes texels, and comes first: a crash after it leaves a step that can be undone, and materials as they were. Rewrites the
    /// file, which needs room for a copy.
    ///
    /// # Errors
    /// Coarser levels cannot be read or written, or as [`AssetEditor::set_alpha_mode`](fantex_store::AssetEditor::set_alpha_mode). The
    /// asset then stays as it is; but if it was the copy that failed, steps cannot be done again that were undone, and without a history
    /// coarser levels are the new ones.
    pub fn set_alpha_mode(&mut self, alpha: AlphaMode) -> Result<()> {
        self.finish_work()?;
        self.end()?;
        let committed = self.commit()?.generation;
        let (surface, steps) = (Arc::clone(&self.surface), self.history.done().len());
        let made = self.make_levels_of(alpha).and_then(|()| self.editor.set_alpha_mode(alpha));
        if let Err(error) = made {
            self.surface = surface;
            return self.take_back_levels(committed, steps).and(Err(error));
        }
        self.surface = Arc::new(Surface::of(self.editor.asset()));
        Ok(())
    }

    /// Makes the coarser levels that such materials have, as a step, and commits.
    fn make_levels_of(&mut self, alpha: AlphaMode) -> Result<()> {
        let asset = Arc::clone(self.editor.asset());
        let Some(channel) = asset.channel_of_kind(ChannelKind::BaseColor) else { return Ok(()) };
        let cut_outs = CutOuts::of([alpha], false);
        let mut changes = Changes { is_base: true, ..Changes::default() };
        for (group, shape) in (0u32..).zip(&asset.cover().groups) {
            let before = all_cut_outs(&self.surface, group);
            let is_same = before == cut_outs || (before.is_empty() && cut_outs.is_empty());
            let is_opaque = self.editor.mean(channel, group)[3] >= 1.0 && !self.keeps_base_levels(group);
            if is_opaque || is_same {
                continue;
            }
            for page in pages_of(Rect::of(shape.extent)) {
                let id = PageId { group, level: 0, page };
                changes.add(id, Rect::of(page_extent(shape.extent, page)));
            }
        }
        if changes.groups.is_empty() {
            return Ok(());
        }
        let mut mesh = self.surface.mesh().clone();
        mesh.set_alpha_mode(alpha);
        self.surface = Arc::new(Surface::new(Arc::new(mesh), asset.shared_cover()));
        self.begin_step("show opacity");
        self.finish_changes(changes, &[channel])?;
        self.history.finish(&mut self.editor)?;
        self.commit().map(drop)
    }

    /// Takes back what [`make_levels_of`](Self::make_levels_of) has done: what is not committed is dropped, a step more than there were is
    /// undone and forgotten.
    fn take_back_levels(&mut self, committed: u64, steps: usize) -> Result<()> {
        if self.editor.asset().generation() == committed {
            self.editor.discard()?;
            self.history = History::load(&self.editor)?;
        } else if self.history.done().len() > steps {
            self.take_back()?;
            self.finish_work()?;
        }
        self.commit().map(drop)
    }
}
