//! Detail levels agree: every texel that a filter reads is about what the finer texels under it are.
//!
//! A texel of a coarser level is a mean of finer ones; beside the surface it continues such means. So its value lies between the
//! smallest and the largest finer texel within two texels of it, but for what compression adds. Compared are all texels that look-ups
//! of the texture function reach, those beside the surface too, where a wrong one shows as a line along the tile's border.

use fantex_cover::{Footprints, GroupTriangles, NO_OWNER, TexelBlock, TexelTriangle};
use glam::{Vec2, Vec4};
use rayon::prelude::*;

use crate::{Channel, ChannelKind, PAGE, PageCache, PageId, TileId, TileSource, TileTexels, page_grid};

/// Distance from the range of the finer texels that is usual where these are all alike, 0..1 as stored. Their contrast comes to it: that
/// much compression may add, and texels of which nothing is stored, because no filter reads them.
pub const STRAY_BOUND: f32 = 0.1;

/// Coarser levels beside the finer ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelAgreement {
    /// Texels of coarser levels that filters read, all channels together.
    pub texels: u64,
    /// Largest distance of a texel from the range of the finer ones, in the measure of [`STRAY_BOUND`]: much more than 1 on a smooth
    /// texture is a fault.
    pub largest_stray: f32,
    /// Where it is; none where no texel lies beside its range.
    pub worst: Option<StrayTexel>,
}

/// A texel that is not what the finer ones are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StrayTexel {
    /// Of the tile.
    pub group: u32,
    /// Detail level.
    pub level: u32,
    /// Column and row within the level.
    pub texel: [u32; 2],
    /// Channel index.
    pub channel: usize,
}

/// Columns and rows `low..high`.
#[derive(Clone, Copy)]
struct Rect {
    low: [u32; 2],
    high: [u32; 2],
}

impl Rect {
    fn grown(self, extent: [u32; 2]) -> Self {
        let high = [0, 1].map(|k| (self.high[k] + 1).min(extent[k]));
        Self { low: self.low.map(|n| n.saturating_sub(1)), high }
    }

    fn extent(&self) -> [u32; 2] {
        [0, 1].map(|k| self.high[k] - self.low[k])
    }

    fn texels(self) -> impl Iterator<Item = [u32; 2]> {
        (self.low[1]..self.high[1]).flat_map(move |y| (self.low[0]..self.high[0]).map(move |x| [x, y]))
    }

    fn index(&self, [x, y]: [u32; 2]) -> usize {
        ((y - self.low[1]) * self.extent()[0] + x - self.low[0]) as usize
    }
}

pub(crate) fn compare_levels(cache: &PageCache) -> LevelAgreement {
    let cover = cache.asset().cover();
    let triangles = GroupTriangles::of(cover);
    let compared = (0..cover.groups.len() as u32).into_par_iter().map(|group| {
        let mut result = LevelAgreement::default();
        for level in 1..cover.groups[group as usize].level_count() {
            let [columns, rows] = page_grid(cover.groups[group as usize].level_extent(level));
            for page in (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])) {
                let own = triangles.of_group(group);
                compare_page(cache, PageId { group, level, page }, own, &mut result);
            }
        }
        result
    });
    compared.reduce(LevelAgreement::default, |a, b| {
        let texels = a.texels + b.texels;
        // Of equals the first, whatever the order of work.
        let worse = if b.largest_stray > a.largest_stray { b } else { a };
        LevelAgreement { texels, ..worse }
    })
}

fn compare_page(cache: &PageCache, id: PageId, triangles: &[u32], result: &mut LevelAgreement) {
    let asset = cache.asset();
    let shape = asset.cover().groups[id.group as usize];
    let [fine, coarse] = [shape.level_extent(id.level - 1), shape.level_extent(id.level)];
    let low = id.page.map(|n| n * PAGE);
    let page = Rect { low, high: [0, 1].map(|k| (low[k] + PAGE).min(coarse[k])) };
    let around = page.grown(coarse).grown(coarse);
    let under = |at: [u32; 2]| Rect {
        low: [0, 1].map(|k| scaled(at[k], fine[k], coarse[k], false)),
        high: [0, 1].map(|k| scaled(at[k] + 1, fine[k], coarse[k], true)),
    };
    let last = around.high.map(|n| n - 1);
    let finer = Rect { low: under(around.low).low, high: under(last).high };
    let read = TexelUse::of(cache, id.group, id.level, page, triangles).read;
    let known = TexelUse::of(cache, id.group, id.level - 1, finer, triangles).known;
    for (index, channel) in asset.channels().iter().enumerate() {
        let tile = |level| cache.tile(index, TileId { group: id.group, level });
        let (fine_tile, coarse_tile) = (tile(id.level - 1), tile(id.level));
        let range = |at: [u32; 2]| {
            let texels = under(at).texels().filter(|texel| known[finer.index(*texel)]);
            texels.fold([Vec4::INFINITY, Vec4::NEG_INFINITY], |[low, high], [x, y]| {
                let value = compared(channel, fine_tile.texel(x, y));
                [low.min(value), high.max(value)]
            })
        };
        let ranges: Vec<[Vec4; 2]> = around.texels().map(range).collect();
        for texel in page.texels().filter(|texel| read[page.index(*texel)]) {
            let near = Rect { low: texel, high: texel.map(|n| n + 1) }.grown(coarse).grown(coarse);
            let [low, high] = near
                .texels()
                .map(|at| ranges[around.index(at)])
                .fold([Vec4::INFINITY, Vec4::NEG_INFINITY], |[low, high], range| {
                    [low.min(range[0]), high.max(range[1])]
                });
            if low.x > high.x {
                continue;
            }
            let value = compared(channel, coarse_tile.texel(texel[0], texel[1]));
            let beside = (low - value).max(value - high).max(Vec4::ZERO);
            let stray = (beside / (STRAY_BOUND + (high - low))).max_element();
            result.texels += 1;
            if stray > result.largest_stray {
                result.largest_stray = stray;
                result.worst = Some(StrayTexel { group: id.group, level: id.level, texel, channel: index });
            }
        }
    }
}

fn scaled(n: u32, fine: u32, coarse: u32, up: bool) -> u32 {
    let (n, coarse) = (u64::from(n) * u64::from(fine), u64::from(coarse));
    (if up { n.div_ceil(coarse) } else { n / coarse }) as u32
}

/// A value as it is stored, about: roots of colours, which are multiplied by their opacity; at most 1.
fn compared(channel: &Channel, value: [f32; 4]) -> Vec4 {
    let value = Vec4::from_array(value).clamp(Vec4::splat(-1.0), Vec4::ONE);
    let value =
        if channel.kind == ChannelKind::BaseColor { (value * value.w).with_w(value.w) } else { value };
    if channel.srgb { value.max(Vec4::ZERO).map(f32::sqrt).with_w(value.w) } else { value }
}

/// What becomes of the texels of a rectangle.
struct TexelUse {
    /// A bilinear look-up of the texture function reads it.
    read: Vec<bool>,
    /// It shows the surface, and lies in a block of 4 x 4 that look-ups read: the bake leaves other blocks empty.
    known: Vec<bool>,
}

impl TexelUse {
    fn of(cache: &PageCache, group: u32, level: u32, rect: Rect, triangles: &[u32]) -> Self {
        let (mesh, cover) = (cache.asset().mesh(), cache.asset().cover());
        let extent = cover.groups[group as usize].level_extent(level);
        let blocks = Rect {
            low: rect.low.map(|n| n / 4 * 4),
            high: [0, 1].map(|k| rect.high[k].next_multiple_of(4).min(extent[k])),
        };
        let around = blocks.grown(extent);
        let block = TexelBlock { origin: around.low, extent: around.extent() };
        let in_block = |&triangle: &u32| {
            let inside = cover.corner_groups[triangle as usize].map(|g| g == group);
            let slot = inside.iter().position(|&i| i)?;
            let scale = Vec2::new(extent[0] as f32, extent[1] as f32);
            let corners = cover.tile_corners(mesh, triangle as usize, slot).map(|uv| uv * scale);
            TexelTriangle::new(triangle, inside, corners).filter(|triangle| triangle.touches(block))
        };
        let triangles = triangles.iter().filter_map(in_block).collect();
        let mut footprints = Footprints { triangles, ..Footprints::default() };
        footprints.cover(block, cover.delta);
        let is_near =
            |part: Rect| part.grown(extent).texels().any(|at| footprints.in_region[around.index(at)]);
        let reach = if level == 0 { f32::INFINITY } else { 0.5 };
        let is_known = |texel: [u32; 2]| {
            let index = around.index(texel);
            let low = texel.map(|n| n / 4 * 4);
            let own = Rect { low, high: [0, 1].map(|k| (low[k] + 4).min(extent[k])) };
            footprints.owner[index] != NO_OWNER && footprints.distance[index] <= reach && is_near(own)
        };
        Self {
            read: rect.texels().map(|at| is_near(Rect { low: at, high: at.map(|n| n + 1) })).collect(),
            known: rect.texels().map(is_known).collect(),
        }
    }
}
