//! Which triangle lies under which texel.
//!
//! A block is a rectangle of a tile's level 0. Every triangle of the tile's group is scan-converted into it; texels just off
//! the surface (at boundaries of the mesh) take the nearest triangle within two texels, whose plane is continued there.

use glam::{Vec2, Vec3};

/// A rectangle of texels of level 0 of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Block {
    /// First column and row.
    pub(crate) origin: [u32; 2],
    /// Columns and rows.
    pub(crate) extent: [u32; 2],
}

impl Block {
    pub(crate) fn texel_count(&self) -> usize {
        self.extent[0] as usize * self.extent[1] as usize
    }
}

/// A triangle in the tile: barycentric coordinates as an affine function of texel coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TexelTriangle {
    /// Index in the mesh.
    pub(crate) triangle: u32,
    /// True for the corners whose fans are in the group.
    pub(crate) inside: [bool; 3],
    /// Corners in texels, texel centres at half integers.
    corners: [Vec2; 3],
    /// Barycentric coordinates at texel coordinates `corners[0]` (that is, 1 0 0), and their change per texel.
    pub(crate) steps: [Vec3; 2],
}

impl TexelTriangle {
    /// `None` for a triangle that is degenerate in the tile.
    pub(crate) fn new(triangle: u32, inside: [bool; 3], corners: [Vec2; 3]) -> Option<Self> {
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
    pub(crate) fn lambda(&self, at: Vec2) -> Vec3 {
        let d = at - self.corners[0];
        Vec3::X + self.steps[0] * d.x + self.steps[1] * d.y
    }

    /// True where the triangle's bounding box meets a block or the texels that continue the surface beside it.
    pub(crate) fn touches(&self, block: Block) -> bool {
        let margin = Vec2::splat(EXTENSION_TEXELS as f32 + 1.0);
        let [a, b, c] = self.corners;
        let low = Vec2::new(block.origin[0] as f32, block.origin[1] as f32);
        let high = low + Vec2::new(block.extent[0] as f32, block.extent[1] as f32);
        (a.min(b).min(c) - margin).cmple(high).all() && (a.max(b).max(c) + margin).cmpge(low).all()
    }

    /// Roughly how many texels a point with these barycentric coordinates lies outside; not positive inside.
    fn distance_texels(&self, lambda: Vec3) -> f32 {
        let slope = |k: usize| Vec2::new(self.steps[0][k], self.steps[1][k]).length().max(1e-12);
        (0..3).map(|k| -lambda[k] / slope(k)).fold(f32::NEG_INFINITY, f32::max)
    }
}

/// No triangle.
pub(crate) const NOBODY: u32 = u32::MAX;

/// For every texel of a block the triangle under it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Footprints {
    pub(crate) triangles: Vec<TexelTriangle>,
    /// Index into `triangles`, or `NOBODY`. Row-major.
    pub(crate) owner: Vec<u32>,
    /// True where the texture function reads the tile at the texel's centre with a positive weight.
    pub(crate) in_region: Vec<bool>,
    pub(crate) border: Vec<(u32, u32)>,
}

/// Texels this far off the surface still get a value: what a bilinear look-up at the surface's edge and the fit read.
const EXTENSION_TEXELS: usize = 2;

impl Footprints {
    /// Finds the owners of a block's texels; `self.triangles` holds the group's triangles.
    pub(crate) fn cover(&mut self, block: Block, delta: f32) {
        self.owner.clear();
        self.owner.resize(block.texel_count(), NOBODY);
        self.in_region.clear();
        self.in_region.resize(block.texel_count(), false);
        for i in 0..self.triangles.len() {
            self.scan(i as u32, block, delta);
        }
        for _ in 0..EXTENSION_TEXELS {
            if !self.extend(block) {
                break;
            }
        }
    }

    fn scan(&mut self, index: u32, block: Block, delta: f32) {
        let triangle = self.triangles[index as usize];
        let [x0, y0] = block.origin.map(|o| o as f32);
        let [width, height] = block.extent;
        let low = triangle.corners[0].min(triangle.corners[1]).min(triangle.corners[2]);
        let high = triangle.corners[0].max(triangle.corners[1]).max(triangle.corners[2]);
        let first_row = (low.y - y0 - 0.5).ceil().max(0.0) as u32;
        let end_row = ((high.y - y0 - 0.5).floor() + 1.0).clamp(0.0, height as f32) as u32;
        for row in first_row..end_row {
            // Barycentric coordinates grow linearly along the row; each bounds the columns from one side.
            let start = triangle.lambda(Vec2::new(x0 + 0.5, y0 + row as f32 + 0.5));
            let (mut from, mut to) =
                ((low.x - x0 - 0.5).ceil().max(0.0), (high.x - x0 - 0.5).floor().min(width as f32 - 1.0));
            for k in 0..3 {
                let (l, step) = (start[k], triangle.steps[0][k]);
                if step > 0.0 {
                    from = from.max((-l / step - ROUNDING).ceil());
                } else if step < 0.0 {
                    to = to.min((-l / step + ROUNDING).floor());
                } else if l < 0.0 {
                    to = -1.0;
                }
            }
            if to < from {
                continue;
            }
            let offset = row as usize * width as usize;
            for column in from as usize..=to as usize {
                self.owner[offset + column] = index;
                let lambda = start + triangle.steps[0] * column as f32;
                self.in_region[offset + column] |= is_in_region(lambda, triangle.inside, delta);
            }
        }
    }

    /// Gives texels beside an owned one the nearest of their neighbours' triangles; false if there was none to give.
    fn extend(&mut self, block: Block) -> bool {
        let [width, height] = block.extent.map(|n| n as usize);
        let mut border = std::mem::take(&mut self.border);
        border.clear();
        for y in 0..height {
            for x in 0..width {
                if self.owner[y * width + x] == NOBODY
                    && let Some(owner) = self.nearest_neighbour(x, y, block)
                {
                    border.push(((y * width + x) as u32, owner));
                }
            }
        }
        for &(texel, owner) in &border {
            self.owner[texel as usize] = owner;
        }
        self.border = border;
        !self.border.is_empty()
    }

    fn nearest_neighbour(&self, x: usize, y: usize, block: Block) -> Option<u32> {
        let [width, height] = block.extent.map(|n| n as usize);
        let at = Vec2::new(
            (block.origin[0] as usize + x) as f32 + 0.5,
            (block.origin[1] as usize + y) as f32 + 0.5,
        );
        let mut best: Option<(f32, u32)> = None;
        for ny in y.saturating_sub(1)..=(y + 1).min(height - 1) {
            for nx in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                let owner = self.owner[ny * width + nx];
                if owner == NOBODY {
                    continue;
                }
                let triangle = &self.triangles[owner as usize];
                let distance = triangle.distance_texels(triangle.lambda(at));
                if best.is_none_or(|b| (distance, owner) < b) {
                    best = Some((distance, owner));
                }
            }
        }
        best.map(|b| b.1)
    }
}

/// Columns whose centre lies on an edge belong to both triangles: a few ulp of a column index.
const ROUNDING: f32 = 1e-3;

/// True where one of the group's corners has a positive weight.
fn is_in_region(lambda: Vec3, inside: [bool; 3], delta: f32) -> bool {
    (0..3).any(|k| inside[k] && lambda[k] - lambda[(k + 1) % 3].max(lambda[(k + 2) % 3]) + delta > 0.0)
}
