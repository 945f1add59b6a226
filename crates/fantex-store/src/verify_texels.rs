//! Verifying texels: all that look-ups read, those beside the surface, too, are what the finer texels make of them.
//!
//! Of a tile by itself nothing can be said of level 0: any texels are what some source shows. But coarser levels are made of finer ones, so
//! that what is stale or missing at one level contradicts the next.
//!
//! ```text
//!   level l+1   . . R R      R: read. A texel whose area holds finer ones that surely count is their mean, each
//!                            weighted by its area; those that may count, or that are not stored, leave it open.
//!   level l     ..rrrrrr     One without such is filled from its neighbours, and lies in their range.
//! ```
//!
//! Finer texels are known within bounds (`texel_bounds.rs`): what was rounded, or fitted at level 0. Blocks are compressed by encoders
//! that promise nothing; there the contrast around counts as doubt, too.

use std::ops::Range;

use fantex_cover::{Group, GroupTriangles, MAX_BLOCK_SIDE, SHARED_LEVEL, TexelUses};
use fantex_mesh::Edges;
use fantex_texture::filter::{Overlap, overlaps};
use fantex_texture::levels::CutOuts;
use glam::Vec4;
use rayon::prelude::*;

use crate::texel_bounds::{
    Bounds, FIT_STEPS, FittedTexel, MAX_PARTS, Part, StoredValues, full_value, may_exceed_one, unfitted,
};
use crate::{
    Asset, Channel, PAGE, PREVIEW, PageCache, PageId, TexelFormat, group_pages, page_extent, page_grid,
    page_origin,
};

/// What the check of texels found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TexelReport {
    /// Texels that look-ups read and that were compared with what they are made of, in all channels, at all levels but the finest.
    pub compared: u64,
    /// Those that are not what they are made of.
    pub contradictions: u64,
    /// Blocks that look-ups read and that are zero bytes in a BC7 channel.
    pub empty_blocks: u64,
    /// Tiles that were left out, as they have more than 2^26 texels at level 0.
    pub left_out: u64,
    /// The first few contradictions and empty blocks, in words.
    pub first: Vec<String>,
}

impl TexelReport {
    /// Nothing was found.
    pub fn is_sound(&self) -> bool {
        self.contradictions == 0 && self.empty_blocks == 0
    }

    fn add(&mut self, other: Self) {
        self.compared += other.compared;
        self.contradictions += other.contradictions;
        self.empty_blocks += other.empty_blocks;
        self.left_out += other.left_out;
        let room = MAX_NAMED - self.first.len();
        self.first.extend(other.first.into_iter().take(room));
    }

    fn name(&mut self, fault: impl FnOnce() -> String) {
        if self.first.len() < MAX_NAMED {
            self.first.push(fault());
        }
    }
}

const MAX_NAMED: usize = 16;

/// Larger tiles are left out: what is known of each texel takes a byte.
const MAX_TEXELS: u64 = 1 << 26;

/// Larger tiles come one after the other.
const LARGE_TEXELS: u64 = 1 << 22;

/// Texels of a coarser level along a side of what is compared at a time: a part of a page.
const PART: u32 = 64;

/// What differs by less, as a part of 1 or of the value itself, passes: sums in another order.
const SUM_ERROR: f32 = 1e-4;

// What encoders of blocks may have changed: at least so much, and these shares of the contrast, linear.
//
// An encoder has a line of colours for a block, mostly, and gives up what lies beside it. What it gives up is not in the finer blocks, but
// shows in the coarser ones, as these are made of the texels from before. Of a coarser block it shows in the finer ones. Where both blocks are
// even, and so is what the coarser one was made of, nothing was given up.
const BLOCK_ERROR: f32 = 0.1;
const SHARE_OF_FINER: f32 = 0.5;
const SHARE_OF_OWN: f32 = 0.75;

// What is known of a texel.

/// A look-up reads it.
const READ: u8 = 1;
/// It is in a block of which a look-up reads a texel, so it is stored.
const STORED: u8 = 2;
/// It is stored, and counts in the mean of a coarser one.
const KNOWN: u8 = 4;
/// It may count in the mean of a coarser one.
const MAY_COUNT: u8 = 8;
/// A finer one that is known lies in its area; so it has a mean. (Of level 0: it shows the surface.)
const HAS_FINER: u8 = 16;

/// Compares all texels that look-ups read with what they are made of. Of an asset of which something is damaged, what is left.
pub(crate) fn check_texels(cache: &PageCache) -> TexelReport {
    let asset = cache.asset();
    let groups = &asset.cover().groups;
    let triangles = GroupTriangles::of(asset.cover());
    let (is_open, exceeding) = (open_groups(asset), exceeding_channels(cache));
    let is_painted = asset.attachment_names().is_ok_and(|names| names.iter().any(|&name| name != PREVIEW));
    let check =
        TexelCheck { cache, triangles: &triangles, is_open: &is_open, exceeding: &exceeding, is_painted };
    let texels = |group: u32| groups[group as usize].texels();
    let (fitting, left_out): (Vec<u32>, Vec<u32>) =
        (0..groups.len() as u32).partition(|&group| texels(group) <= MAX_TEXELS);
    let (large, small): (Vec<u32>, Vec<u32>) =
        fitting.into_iter().partition(|&group| texels(group) > LARGE_TEXELS);
    let of_group = |group: u32| (group, check.group(group));
    let mut found: Vec<(u32, TexelReport)> = small.into_par_iter().map(of_group).collect();
    found.extend(large.into_iter().map(of_group));
    found.sort_by_key(|(group, _)| *group);
    let mut report = TexelReport { left_out: left_out.len() as u64, ..TexelReport::default() };
    found.into_iter().for_each(|(_, found)| report.add(found));
    report
}

/// The groups at the border of the mesh. Where the asset is a part of a larger one, that may have further triangles in them.
fn open_groups(asset: &Asset) -> Vec<bool> {
    let (mesh, cover) = (asset.mesh(), asset.cover());
    let mut is_open = vec![false; cover.groups.len()];
    for edge in Edges::of(&mesh.triangles).iter().filter(|edge| edge.triangle_count() != 2) {
        for (triangle, _) in edge.triangles() {
            cover.groups_of(triangle).for_each(|group| is_open[group as usize] = true);
        }
    }
    is_open
}

/// The channels, as bits, that are clamped to 1 somewhere in a group's tile, or in one that shares a triangle with it.
fn exceeding_channels(cache: &PageCache) -> Vec<u16> {
    let asset = cache.asset();
    let cover = asset.cover();
    let is_full = |(group, shape): (u32, &Group), index: usize, channel: &Channel| {
        let (full, colors) = (full_value(channel.format), channel.format.channel_count().min(3));
        let is_full_in = |id: PageId| {
            let texels: u32 = page_extent(shape.extent, id.page).iter().product();
            cache.read_linear(index, id, |texel| {
                (0..texels as usize).any(|number| texel(number)[..colors].iter().any(|&x| x >= full))
            })
        };
        let finest = group_pages(group, shape).take_while(|id| id.level == 0);
        finest.filter_map(is_full_in).any(|is_full| is_full)
    };
    let own = |(group, shape): (usize, &Group)| {
        let full = (0..asset.channels().len()).filter(|&index| {
            let channel = &asset.channels()[index];
            may_exceed_one(channel) && is_full((group as u32, shape), index, channel)
        });
        full.fold(0_u16, |bits, index| bits | 1 << index)
    };
    let own: Vec<u16> = cover.groups.par_iter().enumerate().map(own).collect();
    let mut near = own.clone();
    for groups in &cover.corner_groups {
        let bits = groups.iter().fold(0, |bits, &group| bits | own[group as usize]);
        groups.iter().for_each(|&group| near[group as usize] |= bits);
    }
    near
}

struct TexelCheck<'a> {
    cache: &'a PageCache,
    triangles: &'a GroupTriangles,
    /// Per group.
    is_open: &'a [bool],
    /// Per group.
    exceeding: &'a [u16],
    /// A painter's layers or history are there. Levels may be those of other texels: where layers show nothing they are the bake's, which are means
    /// from before the fit.
    is_painted: bool,
}

impl TexelCheck<'_> {
    fn group(&self, group: u32) -> TexelReport {
        let asset = self.cache.asset();
        let (mesh, cover) = (asset.mesh(), asset.cover());
        let triangles = self.triangles.of_group(group);
        let uses = |level| TexelUses::of(cover, mesh, group, triangles, level);
        let is_open = self.is_open[group as usize];
        let modes = triangles.iter().map(|&triangle| mesh.alpha_mode(triangle as usize));
        let is_cut_out = !CutOuts::of(modes, false).is_empty();
        // Of a cut-out that is painted on, finer levels are made anew block by block, and from this one on as a whole.
        let is_large = cover.groups[group as usize].extent.iter().any(|&n| n > MAX_BLOCK_SIDE);
        let mut report = TexelReport::default();
        let mut finer = Level::finest(&uses(0), is_open);
        self.find_empty_blocks((group, 0), &finer, &mut report);
        for level in 1..cover.groups[group as usize].level_count() {
            let coarser = finer.coarser(&uses(level), is_open);
            self.find_empty_blocks((group, level), &coarser, &mut report);
            let [columns, rows] = coarser.extent.map(|n| n.div_ceil(PART));
            let is_left_out = is_cut_out && is_large && level == SHARED_LEVEL;
            let count = if is_left_out { 0 } else { columns * rows };
            let parts: Vec<TexelReport> = (0..count)
                .into_par_iter()
                .map(|part| {
                    let low = [part % columns * PART, part / columns * PART];
                    let high = [0, 1].map(|k| (low[k] + PART).min(coarser.extent[k]));
                    let id = PageId { group, level, page: low.map(|n| n / PAGE) };
                    self.part(id, Rect { low, high }, [&finer, &coarser], is_cut_out)
                })
                .collect();
            parts.into_iter().for_each(|found| report.add(found));
            finer = coarser;
        }
        report
    }

    /// Finds blocks that are read and hold nothing, in channels where nothing is not black.
    fn find_empty_blocks(&self, (group, level): (u32, u32), texels: &Level, report: &mut TexelReport) {
        let [columns, rows] = page_grid(texels.extent);
        for (index, channel) in self.cache.asset().channels().iter().enumerate() {
            if channel.format != TexelFormat::Bc7 {
                continue;
            }
            for page in (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])) {
                let Ok(bytes) = self.cache.page_bytes(index, PageId { group, level, page }) else { continue };
                let origin = page_origin(page);
                let width = page_extent(texels.extent, page)[0];
                for block in Rect::of_page(texels.extent, page).blocks() {
                    let local = [0, 1].map(|k| block.low[k] - origin[k]);
                    let is_empty = |range: Range<usize>| bytes[range].iter().all(|&byte| byte == 0);
                    if channel.format.block_ranges(width, local).all(is_empty)
                        && block.texels().any(|at| texels.at(at) & READ != 0)
                    {
                        let [x, y] = block.low;
                        report.empty_blocks += 1;
                        report.name(|| {
                            let kind = channel.kind;
                            format!(
                                "{kind} of tile {group}: the block from texel {x}, {y} on at level {level} is read and holds nothing"
                            )
                        });
                    }
                }
            }
        }
    }

    /// Compares a part of a page with the finer level.
    fn part(&self, id: PageId, own: Rect, [fine, coarse]: [&Level; 2], is_cut_out: bool) -> TexelReport {
        let mut report = TexelReport::default();
        if own.texels().all(|at| coarse.at(at) & READ == 0) {
            return report;
        }
        // Neighbours, and whole blocks.
        let around = own.grown(1, coarse.extent).in_blocks();
        let margin = if id.level == 1 { FIT_STEPS } else { 0 };
        let under = around.under(coarse.extent, fine.extent).grown(margin, fine.extent).in_blocks();
        let axis = |k: usize| -> Vec<Overlap> {
            let [fine, coarse] = [fine.extent[k], coarse.extent[k]];
            (around.low[k]..around.high[k])
                .map(|texel| Overlap::of(texel, fine, coarse, coarse).counted_from(under.low[k]))
                .collect()
        };
        let step = Step {
            id,
            is_painted: self.is_painted,
            own,
            around,
            under,
            columns: axis(0),
            rows: axis(1),
            finer: fine.window(under),
            coarser: coarse.window(around),
            fine_extent: fine.extent,
            coarse_extent: coarse.extent,
        };
        for (index, channel) in self.cache.asset().channels().iter().enumerate() {
            let exceeds_one = self.exceeding[id.group as usize] >> index & 1 == 1;
            let values = StoredValues::new(channel, exceeds_one, is_cut_out);
            let finer = self.texels(index, PageId { level: id.level - 1, ..id }, step.fine_extent, under);
            let coarser = self.texels(index, id, step.coarse_extent, around);
            if let (Some(finer), Some(coarser)) = (finer, coarser) {
                step.compare(channel, &values, [&finer, &coarser], &mut report);
            }
        }
        report
    }

    /// The texels of a rectangle of a tile's level, linear; none where some are damaged.
    fn texels(&self, channel: usize, id: PageId, extent: [u32; 2], rect: Rect) -> Option<Vec<Vec4>> {
        let width = rect.size()[0];
        let mut texels = vec![Vec4::ZERO; width * rect.size()[1]];
        let [first, last] = [rect.low.map(|n| n / PAGE), rect.high.map(|n| (n - 1) / PAGE)];
        for page in (first[1]..=last[1]).flat_map(|y| (first[0]..=last[0]).map(move |x| [x, y])) {
            let whole = Rect::of_page(extent, page);
            let part = rect.intersection(whole);
            self.cache.read_linear(channel, PageId { page, ..id }, |stored| {
                for y in part.low[1]..part.high[1] {
                    let first = [part.low[0], y];
                    let (from, to) = (whole.index(first), rect.index(first));
                    let row = texels[to..to + part.size()[0]].iter_mut();
                    row.zip(from..).for_each(|(texel, number)| *texel = Vec4::from_array(stored(number)));
                }
            })?;
        }
        Some(texels)
    }
}

/// A part of a page, and what it is made of.
struct Step {
    /// The page.
    id: PageId,
    /// See [`TexelCheck`].
    is_painted: bool,
    /// The part.
    own: Rect,
    /// The part and its neighbours.
    around: Rect,
    /// The finer texels under these.
    under: Rect,
    /// What texels around cover of those under them.
    columns: Vec<Overlap>,
    rows: Vec<Overlap>,
    /// What is known of the texels under and around.
    finer: Vec<u8>,
    coarser: Vec<u8>,
    fine_extent: [u32; 2],
    coarse_extent: [u32; 2],
}

impl Step {
    /// `finer`, `coarser`: texels under and around.
    fn compare(
        &self,
        channel: &Channel,
        values: &StoredValues,
        [finer, coarser]: [&[Vec4]; 2],
        report: &mut TexelReport,
    ) {
        let bounds = self.finer_bounds(values, finer);
        let means: Vec<Option<Bounds>> =
            (0..coarser.len()).map(|texel| self.mean(values, &bounds, texel)).collect();
        let is_uncertain = channel.format.is_compressed() || self.is_painted;
        let contrasts = is_uncertain.then(|| {
            let count = channel.format.channel_count();
            let mut own = contrasts(self.around, coarser, count);
            if channel.format.is_compressed() {
                let given = contrasts_of_means(self.around, &means, count);
                own.iter_mut().zip(given).for_each(|(own, given)| *own = own.max(given));
            }
            [contrasts(self.under, finer, count), own]
        });
        for at in self.own.texels() {
            let texel = self.around.index(at);
            let value = coarser[texel];
            if self.coarser[texel] & READ == 0 || values.is_transparent(value) {
                continue;
            }
            let Some(allowed) = self.allowed(values, coarser, &means, at) else { continue };
            report.compared += 1;
            let doubt = contrasts.as_ref().map_or(0.0, |contrasts| self.doubt(contrasts, at));
            let found = values.of_texel(value);
            let is_beside = |k: usize| {
                let (low, high) = (allowed.low[k], allowed.high[k]);
                found.high[k] < low - SUM_ERROR * (1.0 + low.abs()) - doubt
                    || found.low[k] > high + SUM_ERROR * (1.0 + high.abs()) + doubt
            };
            if let Some(k) = (0..values.compared()).find(|&k| is_beside(k)) {
                report.contradictions += 1;
                report.name(|| self.sentence(channel, at, k, value, allowed));
            }
        }
    }

    /// Between which values the finer texels lie.
    fn finer_bounds(&self, values: &StoredValues, finer: &[Vec4]) -> Vec<Bounds> {
        let is_stored = |flags: u8| flags & STORED != 0;
        let texels = finer.iter().zip(&self.finer);
        if self.id.level > 1 {
            let bounds = |(&value, &flags): (&Vec4, &u8)| match is_stored(flags) {
                true => values.of_texel(value),
                false => values.unknown,
            };
            return texels.map(bounds).collect();
        }
        let fitted: Vec<FittedTexel> = texels
            .map(|(&value, &flags)| FittedTexel {
                stored: is_stored(flags).then(|| values.of_texel(value)),
                may_count: flags & MAY_COUNT != 0,
            })
            .collect();
        let [left, upper] = self.under.low.map(|n| n == 0);
        let [right, lower] = [0, 1].map(|k| self.under.high[k] == self.fine_extent[k]);
        unfitted(&fitted, self.under.size()[0], [left, right, upper, lower], values.unknown)
    }

    /// Where the mean of the finer texels under one around lies, if it surely has one.
    fn mean(&self, values: &StoredValues, bounds: &[Bounds], texel: usize) -> Option<Bounds> {
        if self.coarser[texel] & HAS_FINER == 0 {
            return None;
        }
        let [width, _] = self.around.size();
        let (column, row) = (&self.columns[texel % width], &self.rows[texel / width]);
        let stride = self.under.size()[0];
        let mut parts = [Part { bounds: values.unknown, least: 0.0, most: 0.0 }; MAX_PARTS];
        let mut count = 0;
        for (y, height) in row.parents() {
            for (x, width) in column.parents() {
                let finer = y * stride + x;
                let (flags, area) = (self.finer[finer], width * height);
                if flags & (KNOWN | MAY_COUNT) != 0 {
                    let least = if flags & KNOWN != 0 { area } else { 0.0 };
                    parts[count] = Part { bounds: bounds[finer], least, most: area };
                    count += 1;
                }
            }
        }
        Some(values.mean(&parts[..count]))
    }

    /// Between which values a texel of the part lies; none where anything is possible.
    fn allowed(
        &self,
        values: &StoredValues,
        coarser: &[Vec4],
        means: &[Option<Bounds>],
        at: [u32; 2],
    ) -> Option<Bounds> {
        let texel = self.around.index(at);
        let flags = self.coarser[texel];
        match means[texel] {
            Some(mean) if flags & KNOWN != 0 => Some(mean),
            // Painting fills what lies off the surface, though finer texels may reach it.
            Some(mean) => Some(mean.union(self.filled(values, coarser, means, at)?)),
            None if flags & MAY_COUNT != 0 => None,
            None => self.filled(values, coarser, means, at),
        }
    }

    /// Between which values a texel lies that is filled with the mean of its neighbours on the surface; none where it may have none, or where
    /// pages end, which painting fills one by one.
    fn filled(
        &self,
        values: &StoredValues,
        coarser: &[Vec4],
        means: &[Option<Bounds>],
        at: [u32; 2],
    ) -> Option<Bounds> {
        let page = Rect::of_page(self.coarse_extent, self.id.page);
        let is_inside = |k: usize| {
            let (low, high) = (page.low[k], page.high[k]);
            (low == 0 || at[k] > low) && (high == self.coarse_extent[k] || at[k] + 1 < high)
        };
        if !(0..2).all(is_inside) {
            return None;
        }
        let (mut filled, mut is_certain) = (None::<Bounds>, false);
        let near = Rect { low: at, high: at.map(|n| n + 1) }.grown(1, self.coarse_extent);
        for neighbour in near.texels().filter(|&neighbour| neighbour != at) {
            let texel = self.around.index(neighbour);
            let flags = self.coarser[texel];
            if flags & MAY_COUNT == 0 {
                continue;
            }
            is_certain |= flags & KNOWN != 0;
            // What it was filled from may have been averaged anew since.
            let own = match (flags & STORED != 0, means[texel]) {
                (true, Some(mean)) => values.of_texel(coarser[texel]).union(mean),
                (true, None) => values.of_texel(coarser[texel]),
                (false, _) => values.unknown,
            };
            filled = Some(filled.map_or(own, |filled| filled.union(own)));
        }
        filled.filter(|_| is_certain)
    }

    /// What the encoder of blocks may have changed at a texel of the part and under it.
    fn doubt(&self, [finer, coarser]: &[Vec<f32>; 2], at: [u32; 2]) -> f32 {
        let texel = self.around.index(at);
        let [width, _] = self.around.size();
        let block = |x: usize, y: usize, width: usize| y / 4 * (width / 4) + x / 4;
        let own = coarser[block(texel % width, texel / width, width)];
        let stride = self.under.size()[0];
        let mut under = 0.0_f32;
        for (y, _) in self.rows[texel / width].parents() {
            for (x, _) in self.columns[texel % width].parents() {
                under = under.max(finer[block(x, y, stride)]);
            }
        }
        BLOCK_ERROR + SHARE_OF_FINER * under + SHARE_OF_OWN * own
    }

    fn sentence(&self, channel: &Channel, at: [u32; 2], k: usize, value: Vec4, allowed: Bounds) -> String {
        let PageId { group, level, .. } = self.id;
        let ([x, y], kind) = (at, channel.kind);
        let under = Rect { low: at, high: at.map(|n| n + 1) }.under(self.coarse_extent, self.fine_extent);
        let ([left, top], [right, bottom]) = (under.low, under.high.map(|n| n - 1));
        let component = ["red", "green", "blue", "alpha"][k];
        let (value, low, high, finer) = (value[k], allowed.low[k], allowed.high[k], level - 1);
        format!(
            "{kind} of tile {group}: {component} of texel {x}, {y} at level {level} is {value:.3}; texels {left}, {top} to \
             {right}, {bottom} at level {finer}, and those around, allow {low:.3} to {high:.3}"
        )
    }
}

/// Per block of 4x4 of a rectangle the widest range of a component.
fn contrasts(rect: Rect, texels: &[Vec4], components: usize) -> Vec<f32> {
    let [width, _] = rect.size();
    let of_block = |rows: &[Vec4], x: usize| {
        let block = || (0..16).map(|k| rows[k / 4 * width + x + k % 4]);
        let low = block().fold(Vec4::INFINITY, Vec4::min);
        let high = block().fold(Vec4::NEG_INFINITY, Vec4::max);
        (high - low).to_array()[..components].iter().copied().fold(0.0, f32::max)
    };
    let rows = texels.chunks_exact(4 * width);
    rows.flat_map(|rows| (0..width).step_by(4).map(move |x| of_block(rows, x))).collect()
}

/// Per block of 4x4 of a rectangle the widest range of a component that its means surely have.
fn contrasts_of_means(rect: Rect, means: &[Option<Bounds>], components: usize) -> Vec<f32> {
    let of_block = |block: Rect| {
        let known = || block.texels().filter_map(|at| means[rect.index(at)]);
        let least = known().fold(Vec4::INFINITY, |least, mean| least.min(mean.high));
        let most = known().fold(Vec4::NEG_INFINITY, |most, mean| most.max(mean.low));
        (most - least).to_array()[..components].iter().copied().fold(0.0, f32::max)
    };
    rect.blocks().map(of_block).collect()
}

/// What is known of the texels of a tile's level.
struct Level {
    extent: [u32; 2],
    flags: Vec<u8>,
}

impl Level {
    fn finest(uses: &TexelUses, is_open: bool) -> Self {
        let flags = |texel: usize| {
            let mut flags = flags_of_use(uses, texel, is_open);
            if flags & STORED != 0 && uses.shows_surface(texel) {
                flags |= KNOWN | HAS_FINER;
            }
            flags
        };
        Self { extent: uses.extent(), flags: (0..uses.len()).map(flags).collect() }
    }

    /// The next level.
    fn coarser(&self, uses: &TexelUses, is_open: bool) -> Self {
        let extent = uses.extent();
        let [columns, rows] = [0, 1].map(|k| overlaps(self.extent[k], extent[k], extent[k]));
        let width = self.extent[0] as usize;
        let mut flags = Vec::with_capacity(uses.len());
        for row in &rows {
            for column in &columns {
                let texel = flags.len();
                let mut own = flags_of_use(uses, texel, is_open);
                for (y, _) in row.parents() {
                    for (x, _) in column.parents() {
                        let finer = self.flags[y * width + x];
                        own |= finer & MAY_COUNT;
                        own |= if finer & KNOWN != 0 { HAS_FINER } else { 0 };
                    }
                }
                if own & STORED != 0 && own & HAS_FINER != 0 && uses.shows_surface(texel) {
                    own |= KNOWN;
                }
                flags.push(own);
            }
        }
        Self { extent, flags }
    }

    fn at(&self, [x, y]: [u32; 2]) -> u8 {
        self.flags[y as usize * self.extent[0] as usize + x as usize]
    }

    fn window(&self, rect: Rect) -> Vec<u8> {
        rect.texels().map(|at| self.at(at)).collect()
    }
}

/// What a texel's use alone says. Of open groups any texel may count.
fn flags_of_use(uses: &TexelUses, texel: usize, is_open: bool) -> u8 {
    let mut flags = 0;
    if uses.is_read(texel) {
        flags |= READ;
    }
    if uses.is_in_read_block(texel) {
        flags |= STORED;
    }
    if is_open || uses.may_show_surface(texel) {
        flags |= MAY_COUNT;
    }
    flags
}

/// Columns and rows `low..high` of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Rect {
    low: [u32; 2],
    high: [u32; 2],
}

impl Rect {
    fn of_page(extent: [u32; 2], page: [u32; 2]) -> Self {
        let (low, size) = (page_origin(page), page_extent(extent, page));
        Self { low, high: [0, 1].map(|k| low[k] + size[k]) }
    }

    /// With so many texels more on each side, within `extent`.
    fn grown(self, by: u32, extent: [u32; 2]) -> Self {
        let high = [0, 1].map(|k| (self.high[k] + by).min(extent[k]));
        Self { low: self.low.map(|n| n.saturating_sub(by)), high }
    }

    /// Grown to whole 4x4 blocks.
    fn in_blocks(self) -> Self {
        Self { low: self.low.map(|n| n / 4 * 4), high: self.high.map(|n| n.next_multiple_of(4)) }
    }

    /// The finer texels in its area.
    fn under(self, coarse: [u32; 2], fine: [u32; 2]) -> Self {
        let scaled = |n: u32, k: usize| u64::from(n) * u64::from(fine[k]);
        Self {
            low: [0, 1].map(|k| (scaled(self.low[k], k) / u64::from(coarse[k])) as u32),
            high: [0, 1].map(|k| scaled(self.high[k], k).div_ceil(u64::from(coarse[k])) as u32),
        }
    }

    fn intersection(self, other: Self) -> Self {
        let low = [0, 1].map(|k| self.low[k].max(other.low[k]));
        Self { low, high: [0, 1].map(|k| self.high[k].min(other.high[k])) }
    }

    /// Columns and rows.
    fn size(&self) -> [usize; 2] {
        [0, 1].map(|k| (self.high[k] - self.low[k]) as usize)
    }

    /// The number of a texel, row by row.
    fn index(&self, [x, y]: [u32; 2]) -> usize {
        (y - self.low[1]) as usize * self.size()[0] + (x - self.low[0]) as usize
    }

    /// Row by row.
    fn texels(self) -> impl Iterator<Item = [u32; 2]> {
        (self.low[1]..self.high[1]).flat_map(move |y| (self.low[0]..self.high[0]).map(move |x| [x, y]))
    }

    /// The 4x4 blocks of a rectangle of whole ones, row by row.
    fn blocks(self) -> impl Iterator<Item = Self> {
        let rows = (self.low[1]..self.high[1]).step_by(4);
        rows.flat_map(move |y| {
            let columns = (self.low[0]..self.high[0]).step_by(4);
            columns.map(move |x| Self { low: [x, y], high: [x + 4, y + 4] })
        })
    }
}
