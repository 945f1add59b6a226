//! Which blocks of a cover's tiles anything reads at level 0.
//!
//! A bilinear look-up reads texels within half a texel of its place, in each direction. Bakes keep the blocks of 4x4 texels that meet the group's
//! region grown by that and a little more. A region is convex within each triangle, so these blocks are found exactly, row by row.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use fantex_mesh::Mesh;
use glam::{Vec2, Vec4};
use rayon::prelude::*;

use crate::footprints::region_pieces;
use crate::{Cover, Group, GroupTriangles};

/// Texels by which a region grows on all sides: what bilinear look-ups read, and a 16th for places that other programs and graphics
/// cards compute with less care.
pub(crate) const GROWTH: f32 = 0.5 + 1.0 / 16.0;

/// Texels along a side of a block.
pub(crate) const BLOCK: u32 = 4;

/// Blocks that are counted at a time, or those of a single tile: 8 MiB of bits, for the longest tile 32.
const BLOCKS_AT_ONCE: u64 = 1 << 26;

/// So many groups tell to a few thousandths by how much what is stored differs from what was expected.
const SAMPLED_GROUPS: usize = 2048;

/// A bit per block of 4x4 texels of all tiles at level 0: whether look-ups read it.
#[derive(Debug)]
pub struct StoredBlocks {
    /// Group by group and row by row.
    bits: Vec<AtomicU64>,
    /// The first of these groups.
    first_group: usize,
    /// Of each group, the number of blocks before it.
    starts: Vec<u64>,
    /// Of each group, blocks in a row.
    columns: Vec<u32>,
}

impl StoredBlocks {
    /// Of every `step`th of some groups; none is read.
    fn unread(groups: &[Group], first_group: usize, step: usize) -> Self {
        let mut count = 0;
        let start = |(i, group): (usize, &Group)| {
            let start = count;
            count += if i.is_multiple_of(step) { blocks_of(group) } else { 0 };
            start
        };
        let starts: Vec<u64> = groups.iter().enumerate().map(start).collect();
        let bits = (0..count.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let columns = groups.iter().map(|group| group.extent[0] / BLOCK).collect();
        Self { bits, first_group, starts, columns }
    }

    /// Whether a block of a group's tile is read.
    pub fn contains(&self, group: u32, [column, row]: [u32; 2]) -> bool {
        let group = group as usize - self.first_group;
        let bit = self.starts[group] + u64::from(row) * u64::from(self.columns[group]) + u64::from(column);
        self.bits[(bit / 64) as usize].load(Ordering::Relaxed) >> (bit % 64) & 1 == 1
    }

    /// Texels of all blocks that are read.
    pub fn texels(&self) -> u64 {
        let ones: u64 =
            self.bits.par_iter().map(|word| u64::from(word.load(Ordering::Relaxed).count_ones())).sum();
        ones * u64::from(BLOCK * BLOCK)
    }
}

impl Cover {
    /// Texels at level 0 in blocks of 4x4 that look-ups read. Other blocks are zeros in files, and take no room in an atlas. Counting takes
    /// some megabytes of memory, whatever their number.
    pub fn stored_texels(&self, mesh: &Mesh) -> u64 {
        self.stored_texels_counted(mesh, BLOCKS_AT_ONCE)
    }

    /// Texels that are stored of every `step`th group, beginning with the first, of some thousands; and `step`. `None` where they are not many more.
    pub(crate) fn stored_texels_of_some(&self, mesh: &Mesh) -> Option<(u64, usize)> {
        let blocks = self.groups.iter().map(blocks_of).sum::<u64>();
        let step = (self.groups.len() / SAMPLED_GROUPS).max(blocks.div_ceil(BLOCKS_AT_ONCE) as usize);
        (step > 2).then(|| (self.stored_blocks_of_every(step, mesh).texels(), step))
    }

    /// Counts so many blocks at a time, or those of a single tile.
    fn stored_texels_counted(&self, mesh: &Mesh, at_once: u64) -> u64 {
        if self.groups.iter().map(blocks_of).sum::<u64>() <= at_once {
            return self.stored_blocks(mesh).texels();
        }
        let triangles = GroupTriangles::of(self);
        let counted = |groups: Range<usize>| {
            let blocks = StoredBlocks::unread(&self.groups[groups.clone()], groups.start, 1);
            groups.into_par_iter().for_each(|group| {
                let id = group as u32;
                triangles.of_group(id).par_iter().for_each(|&triangle| {
                    let slot = self.corner_groups[triangle as usize].iter().position(|&other| other == id);
                    if let Some(slot) = slot {
                        self.mark(mesh, triangle as usize, slot, &blocks);
                    }
                });
            });
            blocks.texels()
        };
        self.runs_of_blocks(at_once).into_iter().map(counted).sum()
    }

    /// All groups in runs that have so many blocks at most, or are single groups.
    fn runs_of_blocks(&self, most: u64) -> Vec<Range<usize>> {
        let mut runs = Vec::new();
        let (mut first, mut sum) = (0, 0);
        for (group, blocks) in self.groups.iter().map(blocks_of).enumerate() {
            if first < group && sum + blocks > most {
                runs.push(first..group);
                (first, sum) = (group, 0);
            }
            sum += blocks;
        }
        runs.push(first..self.groups.len());
        runs
    }

    /// The blocks that look-ups read: a bit per block of the tiles.
    pub fn stored_blocks(&self, mesh: &Mesh) -> StoredBlocks {
        self.stored_blocks_of_every(1, mesh)
    }

    /// The same of every `step`th group, beginning with the first.
    fn stored_blocks_of_every(&self, step: usize, mesh: &Mesh) -> StoredBlocks {
        let blocks = StoredBlocks::unread(&self.groups, 0, step);
        // A division for each corner would take as long as the rest.
        let asked: Vec<bool> = (0..self.groups.len()).map(|group| group.is_multiple_of(step)).collect();
        let mark = |triangle: usize| {
            let groups = self.corner_groups[triangle];
            let is_asked = |slot: usize| asked[groups[slot] as usize];
            let distinct = (0..3).filter(|&slot| is_asked(slot) && !groups[..slot].contains(&groups[slot]));
            distinct.for_each(|slot| self.mark(mesh, triangle, slot, &blocks));
        };
        (0..mesh.triangles.len()).into_par_iter().with_min_len(1 << 10).for_each(mark);
        blocks
    }

    /// Marks the blocks that a triangle reads of the group of its corner `slot`.
    fn mark(&self, mesh: &Mesh, triangle: usize, slot: usize, blocks: &StoredBlocks) {
        let groups = self.corner_groups[triangle];
        let id = groups[slot];
        let group = &self.groups[id as usize];
        let inside = [groups[0] == id, groups[1] == id, groups[2] == id];
        let texels = Vec2::new(group.extent[0] as f32, group.extent[1] as f32);
        let [a, b, c] = self.tile_corners(mesh, triangle, slot);
        let corners = [a * texels, b * texels, c * texels];
        let cells = Cells::blocks(group.extent);
        let start = blocks.starts[id as usize - blocks.first_group];
        let in_row = |row: u32, [from, to]: [u32; 2]| {
            let first = start + u64::from(row) * u64::from(cells.count[0]);
            [first + u64::from(from), first + u64::from(to)]
        };
        // Small triangles lie in blocks that their neighbours have marked, mostly.
        let [first, last] = cells.around(&corners);
        if (first[1]..=last[1]).all(|row| blocks.are_set(in_row(row, [first[0], last[0]]))) {
            return;
        }
        for piece in region_pieces(corners, inside, self.delta) {
            cells.for_each_run(&piece, |row, from, to| blocks.set(in_row(row, [from, to])));
        }
    }
}

/// Blocks of a group's tile.
fn blocks_of(group: &Group) -> u64 {
    let [columns, rows] = group.extent.map(|n| u64::from(n / BLOCK));
    columns * rows
}

impl StoredBlocks {
    /// Marks the blocks from the first to the last, both included.
    fn set(&self, range: [u64; 2]) {
        for (bits, mask) in self.words(range) {
            if bits.load(Ordering::Relaxed) & mask != mask {
                bits.fetch_or(mask, Ordering::Relaxed);
            }
        }
    }

    /// Whether the blocks from the first to the last, both included, are marked.
    #[inline]
    fn are_set(&self, range: [u64; 2]) -> bool {
        let [from, to] = range;
        if from / 64 == to / 64 {
            let mask = (u64::MAX >> (63 - (to - from))) << (from % 64);
            return self.bits[(from / 64) as usize].load(Ordering::Relaxed) & mask == mask;
        }
        self.words(range).all(|(bits, mask)| bits.load(Ordering::Relaxed) & mask == mask)
    }

    /// The words that hold the blocks from the first to the last, both included, and the bits of these.
    fn words(&self, [from, to]: [u64; 2]) -> impl Iterator<Item = (&AtomicU64, u64)> {
        (from / 64..=to / 64).map(move |word| {
            let low = from.saturating_sub(word * 64);
            let high = (to - word * 64).min(63);
            (&self.bits[word as usize], (u64::MAX >> (63 - high)) & (u64::MAX << low))
        })
    }
}

/// A grid of square cells in which polygons are marked.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cells {
    /// Texels along a side of a cell.
    pub(crate) side: f32,
    /// Texels by which polygons grow on all sides.
    pub(crate) growth: f32,
    /// Columns and rows.
    pub(crate) count: [u32; 2],
}

impl Cells {
    /// The blocks of a tile of `extent` texels at level 0 that look-ups may read.
    pub(crate) fn blocks(extent: [u32; 2]) -> Self {
        Self { side: BLOCK as f32, growth: GROWTH, count: extent.map(|n| n / BLOCK) }
    }

    /// The first and the last cell, column and row, around a polygon (in texels) that has grown.
    pub(crate) fn around(&self, polygon: &[Vec2]) -> [[u32; 2]; 2] {
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for &p in polygon {
            low = low.min(p);
            high = high.max(p);
        }
        let (low, high) = (low - self.growth, high + self.growth);
        [[self.at(low.x, 0), self.at(low.y, 1)], [self.at(high.x, 0), self.at(high.y, 1)]]
    }

    /// The column (axis 0) or row (axis 1) that a place in texels lies in.
    fn at(&self, x: f32, axis: usize) -> u32 {
        ((x / self.side).max(0.0) as u32).min(self.count[axis] - 1)
    }

    /// The cells that meet a convex polygon of at most four corners (in texels) that has grown, as `(row, first column, last column)`.
    pub(crate) fn for_each_run(&self, polygon: &[Vec2], mut visit: impl FnMut(u32, u32, u32)) {
        let [first, last] = self.around(polygon);
        if first == last {
            return visit(first[1], first[0], first[0]);
        }
        // The edges, all at once; of a triangle the last one twice.
        let corner = |i: usize, step: usize| polygon[(i.min(polygon.len() - 1) + step) % polygon.len()];
        let [a, b] = [0, 1].map(|step| [0, 1, 2, 3].map(|i| corner(i, step)));
        let [(ax, ay), (bx, by)] =
            [a, b].map(|ends| (Vec4::from(ends.map(|p| p.x)), Vec4::from(ends.map(|p| p.y))));
        let (along, up) = (bx - ax, by - ay);
        for row in first[1]..=last[1] {
            let band = [row as f32 * self.side - self.growth, (row + 1) as f32 * self.side + self.growth]
                .map(Vec4::splat);
            let begins_within = ay.cmpge(band[0]) & ay.cmple(band[1]);
            let mut from = Vec4::select(begins_within, ax, Vec4::INFINITY);
            let mut to = Vec4::select(begins_within, ax, Vec4::NEG_INFINITY);
            for y in band {
                let crosses = ay.cmplt(y) ^ by.cmplt(y);
                let x = ax + along * ((y - ay) / up);
                from = from.min(Vec4::select(crosses, x, Vec4::INFINITY));
                to = to.max(Vec4::select(crosses, x, Vec4::NEG_INFINITY));
            }
            let (from, to) = (from.min_element(), to.max_element());
            if from <= to {
                visit(row, self.at(from - self.growth, 0), self.at(to + self.growth, 0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_mesh::generate;
    use fantex_test::cleaned;

    use super::*;
    use crate::{CoverOptions, Footprints, TexelBlock, TexelBudget, TexelTriangle, build_cover};

    fn ball(tile: u32, texels: u64) -> (Mesh, Cover) {
        let mesh = cleaned(generate::icosphere(3));
        let budget = TexelBudget::Total(texels);
        let cover = build_cover(&mesh, &CoverOptions { budget, tile, ..CoverOptions::default() }).unwrap().0;
        (mesh, cover)
    }

    /// Bakes and painters, which see a part of a tile, keep what the whole cover says.
    #[test]
    fn blocks_of_a_part_are_those_of_the_cover() {
        for tile in [0, 256] {
            let (mesh, cover) = ball(tile, 60_000);
            let stored = cover.stored_blocks(&mesh);
            let all = GroupTriangles::of(&cover);
            let (mut seen, mut kept) = (0, 0);
            for (id, group) in (0..).zip(&cover.groups) {
                let extent = group.extent;
                let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
                let triangle = |&t: &u32| {
                    let inside = cover.corner_groups[t as usize].map(|other| other == id);
                    let slot = inside.iter().position(|&is_inside| is_inside)?;
                    let corners = cover.tile_corners(&mesh, t as usize, slot).map(|uv| uv * texels);
                    TexelTriangle::new(t, inside, corners)
                };
                let triangles = all.of_group(id).iter().filter_map(triangle).collect();
                let footprints = Footprints { triangles, ..Footprints::default() };
                let half = extent.map(|n| n / 8 * 4);
                for block in [
                    TexelBlock { origin: [0, 0], extent },
                    TexelBlock { origin: half, extent: [extent[0] - half[0], extent[1] - half[1]] },
                ] {
                    let read = footprints.read_blocks(block, extent, cover.delta);
                    let columns = block.extent[0] / BLOCK;
                    assert_eq!(read.len() as u32, columns * (block.extent[1] / BLOCK));
                    for (at, &is_read) in (0..).zip(&read) {
                        let place = [at % columns, at / columns];
                        let place = [0, 1].map(|k| block.origin[k] / BLOCK + place[k]);
                        assert_eq!(is_read, stored.contains(id, place), "group {id}, block {place:?}");
                        seen += 1;
                        kept += u32::from(is_read);
                    }
                }
            }
            assert!(kept > 1000 && (tile == 0 || kept < seen), "{kept} of {seen}");
        }
    }

    /// However few bits there are at a time, and never more than that.
    #[test]
    fn texels_are_counted_in_little_memory() {
        for tile in [0, 64] {
            let (mesh, cover) = ball(tile, 200_000);
            let largest = cover.groups.iter().map(blocks_of).max().unwrap();
            let expected = cover.stored_blocks(&mesh).texels();
            for at_once in [1, largest, 3 * largest, u64::MAX] {
                assert_eq!(cover.stored_texels_counted(&mesh, at_once), expected);
                let runs = cover.runs_of_blocks(at_once);
                assert!(runs.iter().cloned().flatten().eq(0..cover.groups.len()));
                for run in runs {
                    let blocks: u64 = cover.groups[run.clone()].iter().map(blocks_of).sum();
                    assert!(run.len() == 1 || blocks <= at_once, "{blocks} of {at_once}");
                }
            }
        }
        assert_eq!(u64::from(crate::MAX_EXTENT / BLOCK).pow(2) / 8, 32 << 20, "bits of the longest tile");
    }
}
