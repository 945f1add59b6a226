//! Which point of the surface lies under each texel of a page.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_cover::{Footprints, NO_OWNER, TexelBlock, TexelTriangle, texel_reach};
use fantex_mesh::SurfacePoint;
use fantex_store::{PageId, page_extent, page_origin};
use glam::Vec2;
use rayon::prelude::*;

use crate::Surface;

/// The triangles under the texels of a page at some level.
#[derive(Debug)]
pub(crate) struct TexelPage {
    /// Of the tile.
    pub(crate) group: u32,
    pub(crate) block: TexelBlock,
    /// Those that touch the page, ascending by their index in the mesh.
    pub(crate) triangles: Vec<TexelTriangle>,
    /// Per texel, row-major: index into `triangles`, or `NO_OWNER` off the surface.
    pub(crate) owner: Vec<u32>,
    /// Per texel: whether the region that the texture function reads covers or passes it.
    in_region: Vec<bool>,
    /// Per block of 4 x 4 texels, row-major: whether a filter reads it. The bake leaves the others empty.
    is_read: Vec<bool>,
}

impl TexelPage {
    pub(crate) fn build(surface: &Surface, id: PageId) -> Self {
        let cover = surface.cover();
        let extent = cover.groups[id.group as usize].level_extent(id.level);
        let block = TexelBlock { origin: page_origin(id.page), extent: page_extent(extent, id.page) };
        let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
        // A texel more on each side: look-ups beside the page read its outermost blocks.
        let low = block.origin.map(|n| n.saturating_sub(1));
        let end = [0, 1].map(|k| (block.origin[k] + block.extent[k] + 1).min(extent[k]));
        let around = TexelBlock { origin: low, extent: [end[0] - low[0], end[1] - low[1]] };
        let in_page = |&t: &u32| {
            let triangle = texel_triangle(surface, id.group, t, texels)?;
            triangle.touches(around).then_some(triangle)
        };
        let triangles = surface.triangles_of_group(id.group).iter().filter_map(in_page).collect();
        let mut footprints = Footprints { triangles, ..Footprints::default() };
        footprints.cover(around, cover.delta);
        let own = Rect::of(block.extent).moved([0, 1].map(|k| block.origin[k] - low[k]));
        let texel = |[x, y]: [u32; 2]| (y * around.extent[0] + x) as usize;
        let reach = texel_reach(id.level);
        let in_region = own.texels().map(|place| footprints.in_region[texel(place)]).collect();
        let owner = own.texels().map(texel);
        let owner =
            owner.map(|t| if footprints.distance[t] > reach { NO_OWNER } else { footprints.owner[t] });
        // As bakes keep blocks.
        let is_read = match id.level {
            0 => footprints.read_blocks(block, extent, cover.delta),
            _ => {
                let is_read = |block: Rect| {
                    let mut near = block.grown(around.extent).texels();
                    near.any(|place| footprints.in_region[texel(place)])
                };
                blocks_of(own).map(is_read).collect()
            }
        };
        let owner = owner.collect();
        Self { group: id.group, block, triangles: footprints.triangles, owner, in_region, is_read }
    }

    /// True where the texel shows the surface, and is stored: the bake leaves blocks empty that no filter reads.
    pub(crate) fn is_known(&self, texel: usize) -> bool {
        let [x, y] = self.place(texel);
        self.is_valid(texel) && self.is_read[(y / 4 * (self.block.extent[0] / 4) + x / 4) as usize]
    }

    /// True where a look-up of the texture function falls into the texel.
    pub(crate) fn is_in_region(&self, texel: usize) -> bool {
        self.in_region[texel]
    }

    pub(crate) fn is_valid(&self, texel: usize) -> bool {
        self.owner[texel] != NO_OWNER
    }

    /// The number of a texel, given by column and row within the page.
    #[inline]
    pub(crate) fn texel(&self, [x, y]: [u32; 2]) -> usize {
        (y * self.block.extent[0] + x) as usize
    }

    pub(crate) fn place(&self, texel: usize) -> [u32; 2] {
        let width = self.block.extent[0];
        [texel as u32 % width, texel as u32 / width]
    }

    /// The triangle that a texel shows, which must show one.
    #[inline]
    pub(crate) fn triangle(&self, place: [u32; 2]) -> &TexelTriangle {
        &self.triangles[self.owner[self.texel(place)] as usize]
    }

    /// The point at the centre of a texel that shows the surface; beside its triangle, that is continued.
    #[inline]
    pub(crate) fn point(&self, place: [u32; 2]) -> SurfacePoint {
        let triangle = self.triangle(place);
        let [x, y] = [0, 1].map(|k| (self.block.origin[k] + place[k]) as f32 + 0.5);
        SurfacePoint { triangle: triangle.triangle, lambda: triangle.lambda(Vec2::new(x, y)) }
    }

    fn memory_bytes(&self) -> usize {
        size_of::<Self>()
            + 4 * self.owner.len()
            + self.in_region.len()
            + self.is_read.len()
            + size_of::<TexelTriangle>() * self.triangles.len()
    }
}

/// A triangle of a group in the texels of a level of `extent`.
pub(crate) fn texel_triangle(
    surface: &Surface,
    group: u32,
    triangle: u32,
    extent: Vec2,
) -> Option<TexelTriangle> {
    let cover = surface.cover();
    let inside = cover.corner_groups[triangle as usize].map(|g| g == group);
    let slot = inside.iter().position(|&i| i)?;
    let corners = cover.tile_corners(surface.mesh(), triangle as usize, slot).map(|uv| uv * extent);
    TexelTriangle::new(triangle, inside, corners)
}

/// Pages that were built, within a budget: those used longest ago go first.
#[derive(Debug, Default)]
pub(crate) struct TexelPages {
    pages: BTreeMap<PageId, (u64, Arc<TexelPage>)>,
    bytes: usize,
    clock: u64,
}

impl TexelPages {
    /// Builds what is missing, in parallel, and returns all that are asked for, in their order.
    pub(crate) fn get(
        &mut self,
        surface: &Surface,
        ids: &[PageId],
        budget_bytes: usize,
    ) -> Vec<Arc<TexelPage>> {
        let missing: Vec<PageId> = ids.iter().filter(|id| !self.pages.contains_key(id)).copied().collect();
        let built: Vec<_> =
            missing.par_iter().map(|&id| (id, Arc::new(TexelPage::build(surface, id)))).collect();
        for (id, page) in built {
            self.bytes += page.memory_bytes();
            self.pages.insert(id, (0, page));
        }
        self.clock += 1;
        let mut found = Vec::with_capacity(ids.len());
        for id in ids {
            if let Some((used, page)) = self.pages.get_mut(id) {
                *used = self.clock;
                found.push(Arc::clone(page));
            }
        }
        self.shrink(budget_bytes);
        found
    }

    fn shrink(&mut self, budget_bytes: usize) {
        if self.bytes <= budget_bytes {
            return;
        }
        let mut by_age: Vec<(u64, PageId)> = self.pages.iter().map(|(&id, (used, _))| (*used, id)).collect();
        by_age.sort_unstable();
        for (_, id) in by_age {
            if self.bytes <= budget_bytes / 2 {
                break;
            }
            if let Some((_, page)) = self.pages.remove(&id) {
                self.bytes -= page.memory_bytes();
            }
        }
    }
}

// Rectangles of texels.

/// Columns and rows `low..high`; empty where `high <= low`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rect {
    pub(crate) low: [u32; 2],
    pub(crate) high: [u32; 2],
}

impl Rect {
    pub(crate) const EMPTY: Self = Self { low: [u32::MAX; 2], high: [0; 2] };

    /// From the first texel on.
    pub(crate) fn of(extent: [u32; 2]) -> Self {
        Self { low: [0; 2], high: extent }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.low[0] >= self.high[0] || self.low[1] >= self.high[1]
    }

    pub(crate) fn add(&mut self, [x, y]: [u32; 2]) {
        *self = self.union(Self { low: [x, y], high: [x + 1, y + 1] });
    }

    pub(crate) fn union(self, other: Self) -> Self {
        if other.is_empty() {
            return self;
        }
        let low = [0, 1].map(|k| self.low[k].min(other.low[k]));
        Self { low, high: [0, 1].map(|k| self.high[k].max(other.high[k])) }
    }

    pub(crate) fn intersection(self, other: Self) -> Self {
        let low = [0, 1].map(|k| self.low[k].max(other.low[k]));
        Self { low, high: [0, 1].map(|k| self.high[k].min(other.high[k])) }
    }

    /// Grown to whole 4x4 blocks.
    pub(crate) fn blocks(self) -> Self {
        Self { low: self.low.map(|n| n / 4 * 4), high: self.high.map(|n| n.next_multiple_of(4)) }
    }

    pub(crate) fn moved(self, by: [u32; 2]) -> Self {
        let add = |corner: [u32; 2]| [corner[0] + by[0], corner[1] + by[1]];
        Self { low: add(self.low), high: add(self.high) }
    }

    /// Relative to a corner that does not lie beyond its own.
    pub(crate) fn relative_to(self, origin: [u32; 2]) -> Self {
        let subtract = |corner: [u32; 2]| [corner[0] - origin[0], corner[1] - origin[1]];
        Self { low: subtract(self.low), high: subtract(self.high) }
    }

    pub(crate) fn extent(&self) -> [u32; 2] {
        [0, 1].map(|k| self.high[k].saturating_sub(self.low[k]))
    }

    /// With a texel more on each side, within `extent`.
    pub(crate) fn grown(self, extent: [u32; 2]) -> Self {
        let high = [0, 1].map(|k| (self.high[k] + 1).min(extent[k]));
        Self { low: self.low.map(|n| n.saturating_sub(1)), high }
    }

    /// Columns and rows, row by row.
    pub(crate) fn texels(self) -> impl Iterator<Item = [u32; 2]> {
        (self.low[1]..self.high[1]).flat_map(move |y| (self.low[0]..self.high[0]).map(move |x| [x, y]))
    }
}

/// The blocks of 4 x 4 texels of a rectangle from its first texel on, row by row.
pub(crate) fn blocks_of(rect: Rect) -> impl Iterator<Item = Rect> {
    let rows = (rect.low[1]..rect.high[1]).step_by(4);
    rows.flat_map(move |y| {
        let columns = (rect.low[0]..rect.high[0]).step_by(4);
        columns.map(move |x| Rect { low: [x, y], high: [x + 4, y + 4] })
    })
}
