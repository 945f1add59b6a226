//! What becomes of the texels of a tile's level: which ones look-ups read, and which ones show a surface.
//!
//! ```text
//!   . . . . . .
//!   . r r r r .     #  the group's region in a triangle, convex, meets the texel
//!   . r # # r .     r  a bilinear look-up within the region reads the texel, too
//!   . r r # r .
//!   . . . . . .
//! ```
//!
//! All are found along outlines, row by row: tips and slivers pass between texel centres.

use fantex_mesh::Mesh;
use glam::Vec2;

use crate::footprints::{EXTENSION_TEXELS, columns, region_pieces, texel_reach};
use crate::stored::{self, Cells};
use crate::{Cover, TexelTriangle};

/// A bilinear look-up reads the texels whose squares, grown so far, hold its place. A little less than half a texel: who reads a texel gives
/// it a 64th along each axis at least.
const READ_GROWTH: f32 = 0.5 - 1.0 / 64.0;

/// Texels by which rounding may move the outline of a surface.
const DOUBT: f32 = 1.0 / 16.0;

/// Texels along a side of a block.
const BLOCK: usize = stored::BLOCK as usize;

const IS_READ: u8 = 1;
const IS_IN_READ_BLOCK: u8 = 2;
const SHOWS_SURFACE: u8 = 4;
const MAY_SHOW_SURFACE: u8 = 8;

/// How the texels of a group's tile are used at one level. Texels are numbered row by row.
#[derive(Clone, Debug)]
pub struct TexelUses {
    extent: [u32; 2],
    flags: Vec<u8>,
}

impl TexelUses {
    /// Of a group, by the [triangles](crate::GroupTriangles) with a corner in it. Takes a byte per texel.
    pub fn of(cover: &Cover, mesh: &Mesh, group: u32, triangles: &[u32], level: u32) -> Self {
        let extent = cover.groups[group as usize].level_extent(level);
        let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
        let mut uses = Self { extent, flags: vec![0; extent[0] as usize * extent[1] as usize] };
        for &triangle in triangles {
            let inside = cover.corner_groups[triangle as usize].map(|other| other == group);
            let Some(slot) = inside.iter().position(|&is_inside| is_inside) else { continue };
            let corners = cover.tile_corners(mesh, triangle as usize, slot).map(|uv| uv * texels);
            // Bakes leave triangles out that are degenerate in the tile.
            let Some(in_tile) = TexelTriangle::new(triangle, inside, corners) else { continue };
            uses.mark_surface(&in_tile, texel_reach(level));
            for piece in region_pieces(corners, inside, cover.delta) {
                uses.mark_read(&piece);
            }
        }
        uses.mark_read_blocks();
        uses
    }

    /// Columns and rows.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }

    /// Number of texels.
    pub fn len(&self) -> usize {
        self.flags.len()
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        self.flags.is_empty()
    }

    /// Whether a bilinear look-up of the texture function reads a texel.
    pub fn is_read(&self, texel: usize) -> bool {
        self.flags[texel] & IS_READ != 0
    }

    /// Whether a texel of its block of 4x4 is read: whoever writes tiles stores the block.
    pub fn is_in_read_block(&self, texel: usize) -> bool {
        self.flags[texel] & IS_IN_READ_BLOCK != 0
    }

    /// Whether a texel shows the surface, or continues it within [`texel_reach`].
    pub fn shows_surface(&self, texel: usize) -> bool {
        self.flags[texel] & SHOWS_SURFACE != 0
    }

    /// The same where rounding might say otherwise.
    pub fn may_show_surface(&self, texel: usize) -> bool {
        self.flags[texel] & MAY_SHOW_SURFACE != 0
    }

    /// Marks the texels within reach of a triangle, as [`Footprints`](crate::Footprints) claim them.
    fn mark_surface(&mut self, triangle: &TexelTriangle, reach: f32) {
        let [low, high] = triangle.bounds();
        let most = reach + DOUBT;
        // Nothing farther than this from the bounding box is claimed, however far the tip of its offset reaches.
        let margin = EXTENSION_TEXELS + DOUBT;
        let last_texel = Vec2::new(self.extent[0] as f32, self.extent[1] as f32) - 1.0;
        let from = (low - margin - 0.5).ceil().max(Vec2::ZERO);
        let to = (high + margin - 0.5).floor().min(last_texel);
        // Also where a number is none.
        if !from.cmple(to).all() {
            return;
        }
        let reaches = triangle.reaches(most);
        let bounds = [from.x, to.x];
        for row in from.y as u32..=to.y as u32 {
            let start = triangle.lambda(Vec2::new(0.5, row as f32 + 0.5));
            let [first, last] = columns(bounds, start + reaches, triangle.steps[0]);
            // A column more on either side makes good for rounding.
            let (first, last) = ((first - 1.0).max(bounds[0]), (last + 1.0).min(bounds[1]));
            if last < first {
                continue;
            }
            let first_of_row = row as usize * self.extent[0] as usize;
            for column in first as u32..=last as u32 {
                let at = Vec2::new(column as f32, row as f32) + 0.5;
                let distance = triangle.distance_texels(triangle.lambda(at));
                if distance > most {
                    continue;
                }
                let flags = &mut self.flags[first_of_row + column as usize];
                *flags |= MAY_SHOW_SURFACE;
                let sure = EXTENSION_TEXELS - DOUBT;
                let is_near = at.cmpge(low - sure).all() && at.cmple(high + sure).all();
                if is_near && distance <= reach - DOUBT {
                    *flags |= SHOWS_SURFACE;
                }
            }
        }
    }

    /// Marks the texels that look-ups in a piece of the region read.
    fn mark_read(&mut self, piece: &[Vec2]) {
        let cells = Cells { side: 1.0, growth: READ_GROWTH, count: self.extent };
        let width = self.extent[0] as usize;
        cells.for_each_run(piece, |row, from, to| {
            let row = &mut self.flags[row as usize * width..][..width];
            row[from as usize..=to as usize].iter_mut().for_each(|flags| *flags |= IS_READ);
        });
    }

    fn mark_read_blocks(&mut self) {
        let width = self.extent[0] as usize;
        for rows in self.flags.chunks_exact_mut(BLOCK * width) {
            for x in (0..width).step_by(BLOCK) {
                let texels = || (0..BLOCK * BLOCK).map(|k| k / BLOCK * width + x + k % BLOCK);
                if texels().any(|texel| rows[texel] & IS_READ != 0) {
                    texels().for_each(|texel| rows[texel] |= IS_IN_READ_BLOCK);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_mesh::generate;
    use fantex_test::cleaned;
    use glam::Vec3;

    use super::*;
    use crate::{CoverOptions, Footprints, GroupTriangles, NO_OWNER, TexelBlock, TexelBudget, build_cover};

    fn balls() -> impl Iterator<Item = (Mesh, Cover)> {
        [(0, 20_000), (64, 20_000), (256, 120_000)].into_iter().map(|(tile, texels)| {
            let mesh = cleaned(generate::icosphere(3));
            let budget = TexelBudget::Total(texels);
            let options = CoverOptions { budget, tile, ..CoverOptions::default() };
            let cover = build_cover(&mesh, &options).unwrap().0;
            (mesh, cover)
        })
    }

    /// The texels of a look-up at tile coordinates, without those of next to no weight along an axis.
    fn read_at(extent: [u32; 2], uv: Vec2) -> [[u32; 2]; 4] {
        let axis = |u: f32, n: u32| {
            let at = (u * n as f32 - 0.5).clamp(0.0, n as f32 - 1.0);
            let share = at.fract();
            let first = at as u32;
            let second = (first + 1).min(n - 1);
            if share < 0.02 {
                [first, first]
            } else if share > 0.98 {
                [second, second]
            } else {
                [first, second]
            }
        };
        let ([x0, x1], [y0, y1]) = (axis(uv.x, extent[0]), axis(uv.y, extent[1]));
        [[x0, y0], [x1, y0], [x0, y1], [x1, y1]]
    }

    /// What look-ups read is marked, and nothing else is, but for corners that points on a grid miss.
    #[test]
    fn what_look_ups_read_is_marked() {
        for (mesh, cover) in balls() {
            let triangles = GroupTriangles::of(&cover);
            for group in (0..cover.groups.len() as u32).step_by(7) {
                for level in 0..cover.groups[group as usize].level_count() {
                    let uses = TexelUses::of(&cover, &mesh, group, triangles.of_group(group), level);
                    let extent = uses.extent();
                    let mut is_read = vec![false; uses.len()];
                    for &triangle in triangles.of_group(group) {
                        let tiles = cover.triangle_tiles(&mesh, triangle);
                        for [i, j] in (0..=40).flat_map(|i| (0..=40 - i).map(move |j| [i, j])) {
                            let lambda = Vec3::new(i as f32, j as f32, (40 - i - j) as f32) / 40.0;
                            for tap in tiles.taps(lambda).filter(|tap| tap.group == group) {
                                for [x, y] in read_at(extent, tap.uv) {
                                    is_read[(y * extent[0] + x) as usize] = true;
                                }
                            }
                        }
                    }
                    let marked = (0..uses.len()).filter(|&texel| uses.is_read(texel)).count();
                    let found = is_read.iter().filter(|&&is_read| is_read).count();
                    for (texel, is_read) in is_read.into_iter().enumerate() {
                        assert!(
                            uses.is_read(texel) || !is_read,
                            "group {group}, level {level}, texel {texel}"
                        );
                        assert!(uses.is_in_read_block(texel) || !uses.is_read(texel));
                    }
                    assert!(
                        marked <= found + found / 5 + 8,
                        "group {group}, level {level}: {marked} {found}"
                    );
                }
            }
        }
    }

    /// What surely shows the surface has an owner in a bake, and what has one may show it; what is read is stored.
    #[test]
    fn bakes_agree() {
        for (mesh, cover) in balls() {
            let triangles = GroupTriangles::of(&cover);
            for group in (0..cover.groups.len() as u32).step_by(7) {
                for level in 0..cover.groups[group as usize].level_count() {
                    let uses = TexelUses::of(&cover, &mesh, group, triangles.of_group(group), level);
                    let extent = uses.extent();
                    let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
                    let in_tile = |&triangle: &u32| {
                        let inside = cover.corner_groups[triangle as usize].map(|other| other == group);
                        let slot = inside.iter().position(|&is_inside| is_inside)?;
                        let corners = cover.tile_corners(&mesh, triangle as usize, slot);
                        TexelTriangle::new(triangle, inside, corners.map(|uv| uv * texels))
                    };
                    let own = triangles.of_group(group).iter().filter_map(in_tile).collect();
                    let mut footprints = Footprints { triangles: own, ..Footprints::default() };
                    footprints.cover(TexelBlock { origin: [0, 0], extent }, cover.delta);
                    for texel in 0..uses.len() {
                        let is_claimed = footprints.owner[texel] != NO_OWNER
                            && footprints.distance[texel] <= texel_reach(level);
                        assert!(is_claimed || !uses.shows_surface(texel), "{group} {level} {texel}");
                        assert!(uses.may_show_surface(texel) || !is_claimed, "{group} {level} {texel}");
                        assert!(
                            uses.is_read(texel) || !footprints.in_region[texel],
                            "{group} {level} {texel}"
                        );
                        if uses.is_read(texel) {
                            let [x, y] = [texel as u32 % extent[0], texel as u32 / extent[0]];
                            let near = |n: u32, end: u32| n.saturating_sub(2)..(n + 3).min(end);
                            let mut around = near(y, extent[1])
                                .flat_map(|y| near(x, extent[0]).map(move |x| (y * extent[0] + x) as usize));
                            assert!(around.any(|t| footprints.in_region[t]), "{group} {level} {texel}");
                        }
                    }
                }
            }
        }
    }
}
