//! What a cover *is*: the data that the texture function needs at run time. Building one is in `build`.

use fantex_mesh::Mesh;
use glam::{Vec2, Vec3};

/// How a group's surface is laid into its tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupKind {
    /// Orthogonal projection: the tile map is one affine map of mesh space.
    Projected,
    /// A single fan, unfolded about its centre: coordinates are stored per corner in [`Cover::unfolded`].
    Unfolded,
}

/// A frame of an orthogonal projection, mesh space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// A point near the group; coordinates are taken relative to it to keep precision.
    pub origin: Vec3,
    /// Unit projection direction; the front faces it.
    pub direction: Vec3,
    /// Unit vector orthogonal to `direction`: the tile's u axis. The v axis is `direction x x_axis`.
    pub x_axis: Vec3,
}

impl Frame {
    /// The tile's v axis, mesh space.
    #[inline]
    pub fn y_axis(&self) -> Vec3 {
        self.direction.cross(self.x_axis)
    }
}

/// One or more neighbouring partial fans that share a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Group {
    /// Projected or unfolded.
    pub kind: GroupKind,
    /// Projection frame. For an unfolded fan `direction` is its mean normal, used only to bring normals into one frame.
    pub frame: Frame,
    /// Tile coordinates per mesh unit along the frame's x and y axis:
    /// `uv = uv_offset + uv_scale * ((p - origin) . x_axis, (p - origin) . y_axis)`.
    pub uv_scale: Vec2,
    /// Tile coordinates of the frame's origin.
    pub uv_offset: Vec2,
    /// Tile width and height at level 0 in texels, multiples of 4.
    pub extent: [u32; 2],
}

/// Coordinates of one triangle in the tile of an unfolded fan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnfoldedCorner {
    /// Corner index `3 * triangle + k` of the fan's centre vertex.
    pub corner: u32,
    /// Tile coordinates, 0..1, of the triangle's corners 0, 1, 2.
    pub uv: [Vec2; 3],
}

/// A cover of a mesh by groups of partial fans.
#[derive(Clone, Debug, PartialEq)]
pub struct Cover {
    /// Width of the blend band in barycentric coordinates, 0 < delta <= 1/3.
    pub delta: f32,
    /// Nominal texels per mesh unit of length at level 0.
    pub density: f32,
    /// For every triangle the groups of the fans around its corners 0, 1, 2.
    pub corner_groups: Vec<[u32; 3]>,
    /// All groups, ordered along a space-filling curve over the surface.
    pub groups: Vec<Group>,
    /// Coordinates of unfolded fans, ascending by `corner`.
    pub unfolded: Vec<UnfoldedCorner>,
}

impl Cover {
    /// Tile coordinates (in 0..1 where the texture function looks them up) of the three corners of `triangle` in
    /// the tile of the group at its corner `slot` (0..3). They interpolate linearly over the triangle.
    #[inline]
    pub fn tile_corners(&self, mesh: &Mesh, triangle: usize, slot: usize) -> [Vec2; 3] {
        let group = &self.groups[self.corner_groups[triangle][slot] as usize];
        match group.kind {
            GroupKind::Projected => mesh.triangle_positions(triangle).map(|p| group.tile_from_mesh(p)),
            GroupKind::Unfolded => {
                let corner = (3 * triangle + slot) as u32;
                match self.unfolded.binary_search_by_key(&corner, |u| u.corner) {
                    Ok(i) => self.unfolded[i].uv,
                    Err(_) => [Vec2::splat(0.5); 3],
                }
            }
        }
    }

    /// Texels of all tiles at level 0.
    pub fn texels(&self) -> u64 {
        self.groups.iter().map(|g| u64::from(g.extent[0]) * u64::from(g.extent[1])).sum()
    }

    /// The groups that the texture function reads at a point of a triangle, with their weights.
    #[inline]
    pub fn weights(&self, triangle: usize, lambda: Vec3) -> GroupWeights {
        GroupWeights::new(self.corner_groups[triangle], lambda, self.delta)
    }
}

impl Group {
    /// The tile map of a projected group: mesh space to tile coordinates.
    #[inline]
    pub fn tile_from_mesh(&self, p_mesh: Vec3) -> Vec2 {
        let q = p_mesh - self.frame.origin;
        self.uv_offset + self.uv_scale * Vec2::new(q.dot(self.frame.x_axis), q.dot(self.frame.y_axis()))
    }

    /// The x and y axis of the shading frame in which a tile stores normals, at a point with the unit vertex normal
    /// `normal` (mesh space): the frame's `x_axis`, turned by the smallest rotation that takes the projection direction to
    /// `normal`, and `normal` cross it.
    #[inline]
    pub fn shading_axes(&self, normal: Vec3) -> [Vec3; 2] {
        let (d, x) = (self.frame.direction, self.frame.x_axis);
        // Rodrigues' rotation of a vector orthogonal to d; the bound keeps the antipode finite.
        let turned = x - (d + normal) * (x.dot(normal) / (1.0 + d.dot(normal)).max(1e-4));
        let x_axis = (turned - normal * turned.dot(normal)).normalize_or(normal.any_orthonormal_vector());
        [x_axis, normal.cross(x_axis)]
    }

    /// Number of detail levels of the tile: level 0 is `extent`, the last is 4x4.
    pub fn level_count(&self) -> u32 {
        // The first level `l` at which the longer side is less than `6 * 2^l` texels long is rounded to 4.
        let sixths = self.extent[0].max(self.extent[1]) / 6;
        if sixths == 0 { 1 } else { sixths.ilog2() + 2 }
    }

    /// Tile extent in texels at a level: half as long per level, rounded to the nearest multiple of 4, at least 4.
    pub fn level_extent(&self, level: u32) -> [u32; 2] {
        self.extent.map(|n| level_length(n, level))
    }
}

/// `n / 2^level` rounded to the nearest multiple of 4 (halves up), at least 4.
fn level_length(n: u32, level: u32) -> u32 {
    let quarters = (u64::from(n) + (2 << level)) >> (level + 2);
    4 * (quarters as u32).max(1)
}

/// The normalised weights of the texture function at one point: up to three groups.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroupWeights {
    count: u8,
    slots: [u8; 3],
    weights: [f32; 3],
}

impl GroupWeights {
    /// `a_i = max(0, lambda_i - max(lambda_j, lambda_k) + delta)`, summed per group and normalised.
    #[inline]
    pub fn new(groups: [u32; 3], lambda: Vec3, delta: f32) -> Self {
        let [l0, l1, l2] = lambda.to_array();
        let a =
            [l0 - l1.max(l2) + delta, l1 - l2.max(l0) + delta, l2 - l0.max(l1) + delta].map(|a| a.max(0.0));
        let mut merged = Self { count: 0, slots: [0; 3], weights: [0.0; 3] };
        for (slot, weight) in a.into_iter().enumerate() {
            if weight > 0.0 {
                merged.add(slot, groups, weight);
            }
        }
        let sum: f32 = merged.weights.iter().sum();
        merged.weights = merged.weights.map(|w| w / sum);
        merged
    }

    fn add(&mut self, slot: usize, groups: [u32; 3], weight: f32) {
        for i in 0..self.count as usize {
            if groups[self.slots[i] as usize] == groups[slot] {
                self.weights[i] += weight;
                return;
            }
        }
        self.slots[self.count as usize] = slot as u8;
        self.weights[self.count as usize] = weight;
        self.count += 1;
    }

    /// `(slot, weight)` pairs, at least one; `slot` is the triangle corner whose group is meant. Weights sum to one.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        (0..self.count as usize).map(|i| (self.slots[i] as usize, self.weights[i]))
    }

    /// Number of look-ups, 1..=3.
    #[inline]
    pub fn len(&self) -> usize {
        self.count as usize
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_end_with_the_first_that_is_four_texels_long() {
        for longest in (1..5000).chain([16_384, 65_532, 65_536]) {
            let first = (0..).find(|&level| level_length(longest, level) == 4).unwrap();
            let group = Group {
                kind: GroupKind::Projected,
                frame: Frame { origin: Vec3::ZERO, direction: Vec3::Z, x_axis: Vec3::X },
                uv_scale: Vec2::ONE,
                uv_offset: Vec2::ZERO,
                extent: [4, longest],
            };
            assert_eq!(group.level_count(), first + 1, "{longest}");
        }
    }
}
