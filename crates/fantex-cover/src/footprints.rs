//! Which triangle lies under which texel.
//!
//! A block is a rectangle of a tile's level 0 (or, with corners scaled to it, of a coarser one). Every triangle of the tile's
//! group is scan-converted into it; texels just off the surface (at boundaries of the mesh) take the nearest triangle within two
//! texels, whose plane is continued there.

use arrayvec::ArrayVec;
use glam::{Vec2, Vec3};

use crate::stored::{self, Cells};

/// A rectangle of texels of level 0 of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelBlock {
    /// First column and row.
    pub origin: [u32; 2],
    /// Columns and rows.
    pub extent: [u32; 2],
}

impl TexelBlock {
    /// Texels of the block.
    pub fn texel_count(&self) -> usize {
        self.extent[0] as usize * self.extent[1] as usize
    }
}

/// A triangle in the tile: barycentric coordinates as an affine function of texel coordinates.
#[derive(Clone, Copy, Debug)]
pub struct TexelTriangle {
    /// Index in the mesh.
    pub triangle: u32,
    /// True for the corners whose fans are in the group.
    pub inside: [bool; 3],
    /// Corners in texels, texel centres at half integers.
    corners: [Vec2; 3],
    /// Change of the barycentric coordinates per texel, along columns and along rows.
    pub steps: [Vec3; 2],
}

impl TexelTriangle {
    /// `None` for a triangle that is degenerate in the tile.
    pub fn new(triangle: u32, inside: [bool; 3], corners: [Vec2; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(Vec2::as_dvec2);
        let area = (b - a).perp_dot(c - a);
        if !(area.abs() > 1e-12 && area.is_finite()) {
            return None;
        }
        let dx = glam::DVec3::new(b.y - c.y, c.y - a.y, a.y - b.y) / area;
        let dy = glam::DVec3::new(c.x - b.x, a.x - c.x, b.x - a.x) / area;
        Some(Self { triangle, inside, corners, steps: [dx.as_vec3(), dy.as_vec3()] })
    }

    /// Barycentric coordinates at a position in texels.
    #[inline]
    pub fn lambda(&self, at: Vec2) -> Vec3 {
        let d = at - self.corners[0];
        Vec3::X + self.steps[0] * d.x + self.steps[1] * d.y
    }

    /// True where the triangle's bounding box meets a block or the texels that continue the surface beside it.
    pub fn touches(&self, block: TexelBlock) -> bool {
        let margin = Vec2::splat(EXTENSION_TEXELS + 1.0);
        let [own_low, own_high] = self.bounds();
        let low = Vec2::new(block.origin[0] as f32, block.origin[1] as f32);
        let high = low + Vec2::new(block.extent[0] as f32, block.extent[1] as f32);
        (own_low - margin).cmple(high).all() && (own_high + margin).cmpge(low).all()
    }

    /// Its corners, texels.
    pub fn corners(&self) -> [Vec2; 3] {
        self.corners
    }

    /// Lower and upper corner of the bounding box, texels.
    pub fn bounds(&self) -> [Vec2; 2] {
        let [a, b, c] = self.corners;
        [a.min(b).min(c), a.max(b).max(c)]
    }

    /// What so many texels off each of its sides are in barycentric coordinates.
    pub(crate) fn reaches(&self, texels: f32) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|k| texels * self.slope(k)))
    }

    /// Change of a barycentric coordinate per texel along its gradient.
    fn slope(&self, k: usize) -> f32 {
        Vec2::new(self.steps[0][k], self.steps[1][k]).length()
    }

    /// Roughly how many texels a point with these barycentric coordinates lies outside; not positive inside.
    pub(crate) fn distance_texels(&self, lambda: Vec3) -> f32 {
        distance_texels(lambda, self.slopes())
    }

    /// Change of the barycentric coordinates per texel along their gradients.
    fn slopes(&self) -> Vec3 {
        self.reaches(1.0)
    }
}

/// As [`TexelTriangle::distance_texels`], with a triangle's [`slopes`](TexelTriangle::slopes).
fn distance_texels(lambda: Vec3, slopes: Vec3) -> f32 {
    (0..3).map(|k| -lambda[k] / slopes[k].max(1e-12)).fold(f32::NEG_INFINITY, f32::max)
}

/// No triangle.
pub const NO_OWNER: u32 = u32::MAX;

/// For every texel of a block the triangle under it.
#[derive(Clone, Debug, Default)]
pub struct Footprints {
    /// What may lie under the texels; put in before [`cover`](Self::cover).
    pub triangles: Vec<TexelTriangle>,
    /// Index into `triangles`, or `NO_OWNER`. Row-major.
    pub owner: Vec<u32>,
    /// True where the region that the texture function reads covers the texel's centre, or its outline passes the texel.
    pub in_region: Vec<bool>,
    /// Texels between the centre and the owner; not positive on the surface.
    pub distance: Vec<f32>,
}

/// Side of the squares in which texels follow one another.
const SQUARE: u32 = 4;

/// Texels this far off the surface still get a value: what a bilinear look-up at the surface's edge and the fit read.
pub(crate) const EXTENSION_TEXELS: f32 = 2.0;

/// How far off the surface texels of a level show it, in texels of that level: a texel of a coarser level does if a texel of level 0
/// within it does.
pub fn texel_reach(level: u32) -> f32 {
    if level == 0 { EXTENSION_TEXELS } else { 0.5 + EXTENSION_TEXELS / (1u64 << level) as f32 }
}

impl Footprints {
    /// Finds the owners of a block's texels, with the cover's `delta`; `self.triangles` holds the group's triangles.
    pub fn cover(&mut self, block: TexelBlock, delta: f32) {
        self.owner.clear();
        self.owner.resize(block.texel_count(), NO_OWNER);
        self.in_region.clear();
        self.in_region.resize(block.texel_count(), false);
        self.distance.clear();
        self.distance.resize(block.texel_count(), f32::INFINITY);
        for i in 0..self.triangles.len() {
            self.scan(i as u32, block, delta);
        }
        for i in 0..self.triangles.len() {
            self.extend(i as u32, block);
            self.mark_outline(i as u32, block, delta);
        }
    }

    /// Per 4x4 block of a block of a tile, row by row: whether look-ups of the texture function read it. The triangles are those of level 0,
    /// where the tile has `extent` texels; origin and extent of the block are multiples of 4.
    pub fn read_blocks(&self, block: TexelBlock, extent: [u32; 2], delta: f32) -> Vec<bool> {
        let [first, count] = [block.origin, block.extent].map(|texels| texels.map(|n| n / stored::BLOCK));
        let mut read = vec![false; (count[0] * count[1]) as usize];
        let cells = Cells::blocks(extent);
        let end = [0, 1].map(|k| first[k] + count[k]);
        let part = |row: u32, [from, to]: [u32; 2]| {
            let (from, to) = (from.max(first[0]), (to + 1).min(end[0]));
            let is_met = (first[1]..end[1]).contains(&row) && from < to;
            let at = |column: u32| ((row - first[1]) * count[0] + column - first[0]) as usize;
            if is_met { at(from)..at(from) + (to - from) as usize } else { 0..0 }
        };
        for triangle in &self.triangles {
            // Small triangles lie in blocks that their neighbours read, mostly.
            let [low, high] = cells.around(&triangle.corners);
            if (low[1]..=high[1]).all(|row| !read[part(row, [low[0], high[0]])].contains(&false)) {
                continue;
            }
            for piece in region_pieces(triangle.corners, triangle.inside, delta) {
                cells.for_each_run(&piece, |row, from, to| read[part(row, [from, to])].fill(true));
            }
        }
        read
    }

    /// Visits every triangle that owns texels of the block that was [covered](Self::cover) with them, square of 4x4 after square, each row by row:
    /// texels that follow one another lie near each other.
    pub fn for_each_owner(&self, block: TexelBlock, mut visit: impl FnMut(&TexelTriangle, &[u32])) {
        // Sorted by counting, so texels stay in that order.
        let mut ends = vec![0_u32; self.triangles.len() + 1];
        let is_owned = |owner: &&u32| **owner != NO_OWNER;
        self.owner.iter().filter(is_owned).for_each(|&owner| ends[owner as usize + 1] += 1);
        let mut count = 0;
        for end in &mut ends {
            count += *end;
            *end = count;
        }
        // These are starts; filling moves each to its end.
        let mut owned = vec![0_u32; count as usize];
        let [width, height] = block.extent;
        for (top, left) in (0..height)
            .step_by(SQUARE as usize)
            .flat_map(|y| (0..width).step_by(SQUARE as usize).map(move |x| (y, x)))
        {
            for y in top..(top + SQUARE).min(height) {
                let texels = y * width + left..y * width + (left + SQUARE).min(width);
                let owners = &self.owner[texels.start as usize..texels.end as usize];
                for (texel, &owner) in texels.zip(owners).filter(|(_, owner)| is_owned(owner)) {
                    let place = &mut ends[owner as usize];
                    owned[*place as usize] = texel;
                    *place += 1;
                }
            }
        }
        let mut begin = 0;
        for (triangle, &end) in self.triangles.iter().zip(&ends) {
            if end > begin {
                visit(triangle, &owned[begin as usize..end as usize]);
            }
            begin = end;
        }
    }

    fn scan(&mut self, index: u32, block: TexelBlock, delta: f32) {
        let triangle = self.triangles[index as usize];
        let [x0, y0] = block.origin.map(|o| o as f32);
        let [width, height] = block.extent;
        let [low, high] = triangle.bounds();
        let first_row = (low.y - y0 - 0.5).ceil().max(0.0) as u32;
        let end_row = ((high.y - y0 - 0.5).floor() + 1.0).clamp(0.0, height as f32) as u32;
        for row in first_row..end_row {
            // Barycentric coordinates grow linearly along the row; each bounds the columns from one side.
            let start = triangle.lambda(Vec2::new(x0 + 0.5, y0 + row as f32 + 0.5));
            let bounds =
                [(low.x - x0 - 0.5).ceil().max(0.0), (high.x - x0 - 0.5).floor().min(width as f32 - 1.0)];
            let [from, to] = columns(bounds, start, triangle.steps[0]);
            if to < from {
                continue;
            }
            let offset = row as usize * width as usize;
            let run = offset + from as usize..offset + to as usize + 1;
            self.owner[run.clone()].fill(index);
            self.distance[run.clone()].fill(0.0);
            if triangle.inside == [true; 3] {
                // The greatest coordinate belongs to one of them.
                self.in_region[run].fill(true);
                continue;
            }
            for column in from as usize..=to as usize {
                let lambda = start + triangle.steps[0] * column as f32;
                self.in_region[offset + column] |= is_in_region(lambda, triangle.inside, delta);
            }
        }
    }

    /// Claims the texels just off the surface that are nearest to this triangle.
    fn extend(&mut self, index: u32, block: TexelBlock) {
        let triangle = self.triangles[index as usize];
        let [low, high] = triangle.bounds();
        let origin = Vec2::new(block.origin[0] as f32, block.origin[1] as f32);
        let end = Vec2::new(block.extent[0] as f32, block.extent[1] as f32);
        let margin = EXTENSION_TEXELS + 0.5;
        let from = (low - origin - margin).ceil().clamp(Vec2::ZERO, end).as_uvec2();
        let to = ((high - origin + margin).floor()).clamp(Vec2::ZERO, end).as_uvec2();
        // What is so far outside of one side that it is out of reach.
        let slopes = triangle.slopes();
        let reach = EXTENSION_TEXELS * slopes;
        let width = block.extent[0] as usize;
        let bounds = [from.x as f32, to.x as f32 - 1.0];
        for row in from.y..to.y {
            let open = &self.distance[row as usize * width..][..width];
            // Whole rows, as vectors compare them.
            let is_open = |open: &[f32]| open.iter().fold(false, |is, &distance| is | (distance > 0.0));
            if to.x <= from.x || !is_open(&open[from.x as usize..to.x as usize]) {
                continue;
            }
            let start = triangle.lambda(origin + Vec2::new(0.5, row as f32 + 0.5));
            let [first, last] = columns(bounds, start + reach, triangle.steps[0]);
            // A column more on either side makes good for rounding.
            let (first, last) = ((first - 1.0).max(bounds[0]), (last + 1.0).min(bounds[1]));
            if last < first {
                continue;
            }
            for column in first as u32..=last as u32 {
                let texel = row as usize * width + column as usize;
                if self.distance[texel] <= 0.0 {
                    continue;
                }
                let lambda = triangle.lambda(origin + Vec2::new(column as f32 + 0.5, row as f32 + 0.5));
                let distance = distance_texels(lambda, slopes);
                if distance < self.distance[texel] && distance <= EXTENSION_TEXELS {
                    self.distance[texel] = distance;
                    self.owner[texel] = index;
                }
            }
        }
    }

    /// Marks the texels along the outline of the region in a triangle: tips and slivers pass between texel centres, also
    /// where the triangle is wholly inside.
    fn mark_outline(&mut self, index: u32, block: TexelBlock, delta: f32) {
        let triangle = self.triangles[index as usize];
        let inside = triangle.inside;
        let origin = Vec2::new(block.origin[0] as f32, block.origin[1] as f32);
        let [width, height] = block.extent;
        let end = Vec2::new(width as f32, height as f32);
        // Most texels of most triangles are known already.
        let [low, high] = triangle.bounds();
        let first = (low - origin - OUTLINE_SLACK).clamp(Vec2::ZERO, end).as_uvec2();
        let last = (high - origin + OUTLINE_SLACK + 1.0).clamp(Vec2::ZERO, end).as_uvec2();
        let is_known = |row: u32| {
            let row = &self.in_region[row as usize * width as usize..][..width as usize];
            last.x <= first.x || row[first.x as usize..last.x as usize].iter().fold(true, |all, &is| all & is)
        };
        if (first.y..last.y).all(is_known) {
            return;
        }
        for piece in region_pieces(triangle.corners, inside, delta) {
            for (i, &from) in piece.iter().enumerate() {
                let along = piece[(i + 1) % piece.len()] - from;
                let steps = (along.length() * STEPS_PER_TEXEL).ceil().min(MAX_STEPS);
                for step in 0..=steps as u32 {
                    let at = from + along * (step as f32 / steps.max(1.0)) - origin;
                    if at.x >= 0.0 && at.y >= 0.0 && (at.x as u32) < width && (at.y as u32) < height {
                        self.in_region[at.y as usize * width as usize + at.x as usize] = true;
                    }
                }
            }
        }
    }
}

/// The first and the last column of those between `bounds` where nothing of `lambda`, which grows by `step` per column from column 0 on, is
/// negative; the last is below the first where there is none.
pub(crate) fn columns(bounds: [f32; 2], lambda: Vec3, step: Vec3) -> [f32; 2] {
    let [mut first, mut last] = bounds;
    for (l, step) in lambda.to_array().into_iter().zip(step.to_array()) {
        if step > 0.0 {
            first = first.max((-l / step - ROUNDING).ceil());
        } else if step < 0.0 {
            last = last.min((-l / step + ROUNDING).floor());
        } else if l < 0.0 {
            return [0.0, -1.0];
        }
    }
    [first, last]
}

/// The group's region in a triangle, as convex polygons: the triangle, or a kite at every corner in the group (`c e_j m e_k`, drawn above
/// `outline_points`).
pub(crate) fn region_pieces(
    corners: [Vec2; 3],
    inside: [bool; 3],
    delta: f32,
) -> impl Iterator<Item = ArrayVec<Vec2, 4>> {
    let (near, far) = (0.5 - 0.5 * delta, 0.5 + 0.5 * delta);
    let is_whole = inside == [true; 3];
    let kite = move |k: usize| -> ArrayVec<Vec2, 4> {
        let [own, next, previous] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
        let middle = own * ((1.0 - 2.0 * delta) / 3.0) + (next + previous) * ((1.0 + delta) / 3.0);
        [own, own * near + next * far, middle, own * near + previous * far].into()
    };
    let whole = is_whole.then(|| corners.into_iter().collect());
    whole.into_iter().chain((0..3).filter(move |&k| inside[k] && !is_whole).map(kite))
}

/// Steps along an outline are shorter than a texel, so that they miss the corners of texels at most.
const STEPS_PER_TEXEL: f32 = 1.5;

/// Points of an outline lie within a triangle's rectangle up to rounding, texels.
const OUTLINE_SLACK: f32 = 0.05;

/// Longer outlines than any tile come from numerical accidents only.
const MAX_STEPS: f32 = 1e6;

/// Columns whose centre lies on an edge belong to both triangles: a few ulp of a column index.
const ROUNDING: f32 = 1e-3;

/// True where one of the group's corners has a positive weight.
fn is_in_region(lambda: Vec3, inside: [bool; 3], delta: f32) -> bool {
    (0..3).any(|k| inside[k] && lambda[k] - lambda[(k + 1) % 3].max(lambda[(k + 2) % 3]) + delta > 0.0)
}
