//! What a cover *is*: the data that the texture function needs at run time. Building one is in `build`.

use fantex_mesh::{Mesh, SurfacePoint, WorldFromMesh, interpolate};
use glam::{Vec2, Vec3};

use crate::{UnfoldedCorner, UnfoldedCorners};

/// How a group's surface is laid into its tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupKind {
    /// Orthogonal projection: the tile map is one affine map of mesh space.
    Projected,
    /// A fan unfolded about its centre, or several unrolled across creases: coordinates are stored per corner in [`Cover::unfolded`], the same
    /// at all corners of a triangle that are in the group.
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
    /// Projection frame. Of an unfolded group `direction` is the mean normal, used only to bring normals into one frame.
    pub frame: Frame,
    /// Tile coordinates per mesh unit along the frame's x and y axis:
    /// `uv = uv_offset + uv_scale * ((p - origin) . x_axis, (p - origin) . y_axis)`.
    pub uv_scale: Vec2,
    /// Tile coordinates of the frame's origin.
    pub uv_offset: Vec2,
    /// Tile width and height at level 0 in texels, multiples of 4.
    pub extent: [u32; 2],
}

/// A cover of a mesh by groups of partial fans.
#[derive(Clone, Debug, PartialEq)]
pub struct Cover {
    /// Width of the blend band in barycentric coordinates, 0 < delta <= 1/3.
    pub delta: f32,
    /// Nominal texels per mesh unit of length at level 0.
    pub density: f32,
    /// Fans end at [creases](fantex_mesh::is_crease), where the texture function jumps: for light, which does.
    pub is_creased: bool,
    /// Fans end at [hard edges](fantex_mesh::HardEdges) from so many degrees on, where the texture function may jump, as was asked for.
    pub hard_edges: Option<f32>,
    /// Where more than two triangles meet at an edge, the texture function is continuous between those that continue each other
    /// [by angle](fantex_mesh::continued_by_angle); else only where their vertices tell.
    pub is_paired_by_angle: bool,
    /// For every triangle the groups of the fans around its corners 0, 1, 2.
    pub corner_groups: Vec<[u32; 3]>,
    /// All groups, ordered along a space-filling curve over the surface.
    pub groups: Vec<Group>,
    /// Coordinates of unfolded groups.
    pub unfolded: UnfoldedCorners,
}

impl Cover {
    /// That of the same mesh in another mesh space ([`Mesh::move_to`]).
    pub fn move_between(&mut self, from: &WorldFromMesh, to: &WorldFromMesh) {
        if from == to {
            return;
        }
        let shrink = (to.scale / from.scale) as f32;
        self.density *= shrink;
        for group in &mut self.groups {
            group.frame.origin = to.inverse_point(from.point(group.frame.origin));
            group.uv_scale *= shrink;
        }
    }

    /// Tile coordinates (in 0..1 where the texture function looks them up) of the three corners of `triangle` in
    /// the tile of the group at its corner `slot` (0..3). They interpolate linearly over the triangle.
    #[inline]
    pub fn tile_corners(&self, mesh: &Mesh, triangle: usize, slot: usize) -> [Vec2; 3] {
        let group = &self.groups[self.corner_groups[triangle][slot] as usize];
        match group.kind {
            GroupKind::Projected => {
                let [a, b, c] = mesh.triangle_positions(triangle);
                [group.tile_from_mesh(a), group.tile_from_mesh(b), group.tile_from_mesh(c)]
            }
            GroupKind::Unfolded => {
                let corner = (3 * triangle + slot) as u32;
                self.unfolded.find(corner).map_or([Vec2::splat(0.5); 3], |entry| entry.uv)
            }
        }
    }

    /// The cover of a [subset](Mesh::subset) of the mesh's triangles: the texture function on these is the same. Also returns which group of
    /// this cover each of its groups is, ascending.
    #[must_use]
    pub fn subset(&self, triangles: &[u32]) -> (Self, Vec<u32>) {
        let mut groups: Vec<u32> = triangles.iter().flat_map(|&t| self.groups_of(t)).collect();
        groups.sort_unstable();
        groups.dedup();
        let number = |group: u32| groups.partition_point(|&other| other < group) as u32;
        let corners =
            (0u32..).zip(triangles).flat_map(|(t, &whole)| [0, 1, 2].map(|k| (3 * t + k, 3 * whole + k)));
        let subset = Self {
            corner_groups: triangles.iter().map(|&t| self.corner_groups[t as usize].map(number)).collect(),
            groups: groups.iter().map(|&group| self.groups[group as usize]).collect(),
            unfolded: corners
                .filter_map(|(corner, whole)| Some(UnfoldedCorner { corner, ..*self.unfolded.find(whole)? }))
                .collect(),
            ..*self
        };
        (subset, groups)
    }

    /// Texels of all tiles at level 0.
    pub fn texels(&self) -> u64 {
        self.groups.iter().map(Group::texels).sum()
    }

    /// The look-ups of the texture function at a point of the surface.
    #[inline]
    pub fn taps<'a>(&'a self, mesh: &'a Mesh, point: SurfacePoint) -> impl ExactSizeIterator<Item = Tap> {
        let triangle = point.triangle as usize;
        let corners_of = move |slot| self.tile_corners(mesh, triangle, slot);
        taps(self.corner_groups[triangle], point.lambda, self.delta, corners_of)
    }

    /// A triangle as the texture function sees it, for its points one after the other.
    pub fn triangle_tiles(&self, mesh: &Mesh, triangle: u32) -> TriangleTiles {
        let groups = self.corner_groups[triangle as usize];
        let corners = |slot| self.tile_corners(mesh, triangle as usize, slot);
        let corners = if is_one(groups) { [corners(0); 3] } else { [corners(0), corners(1), corners(2)] };
        TriangleTiles { groups, corners, delta: self.delta }
    }

    /// The groups of a triangle's corners, each once.
    #[inline]
    pub fn groups_of(&self, triangle: u32) -> impl Iterator<Item = u32> + use<> {
        distinct(self.corner_groups[triangle as usize])
    }

    /// The groups that the texture function reads at a point of a triangle, with their weights.
    #[inline]
    pub fn weights(&self, triangle: usize, lambda: Vec3) -> GroupWeights {
        GroupWeights::new(self.corner_groups[triangle], lambda, self.delta)
    }
}

impl Group {
    /// Texels of its tile at level 0, read or not.
    pub fn texels(&self) -> u64 {
        u64::from(self.extent[0]) * u64::from(self.extent[1])
    }

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

    /// The part of a stored normal (see [`Group::normal_from_stored`]) along the surface, mesh space.
    #[inline]
    pub fn tangent_from_stored(&self, stored: Vec2, vertex_normal: Vec3) -> Vec3 {
        let [x, y] = stored.to_array().map(|c| c * 2.0 - 1.0);
        let [x_axis, y_axis] = self.shading_axes(vertex_normal);
        x_axis * x + y_axis * y
    }

    /// Turns a stored normal into a unit vector in mesh space. Tiles store the x and y coordinate in their
    /// [shading frame](Group::shading_axes), mapped from -1..1 to 0..1.
    #[inline]
    pub fn normal_from_stored(&self, stored: Vec2, vertex_normal: Vec3) -> Vec3 {
        let [x, y] = stored.to_array().map(|c| c * 2.0 - 1.0);
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        let [x_axis, y_axis] = self.shading_axes(vertex_normal);
        (x_axis * x + y_axis * y + vertex_normal * z).normalize_or(vertex_normal)
    }

    /// A unit normal in mesh space as the tile stores it: the inverse of [`Group::normal_from_stored`] on the front side. One that
    /// looks backwards becomes the nearest on the front side.
    #[inline]
    pub fn stored_from_normal(&self, normal: Vec3, vertex_normal: Vec3) -> Vec2 {
        let [x_axis, y_axis] = self.shading_axes(vertex_normal);
        let mut along = Vec2::new(normal.dot(x_axis), normal.dot(y_axis));
        if normal.dot(vertex_normal) < 0.0 {
            along = along.normalize_or_zero();
        }
        along * 0.5 + 0.5
    }

    /// The normal whose part along the surface is `tangent`, as the tile stores it; shortened to a unit vector if it is longer.
    #[inline]
    pub fn stored_from_tangent(&self, tangent: Vec3, vertex_normal: Vec3) -> Vec2 {
        let [x_axis, y_axis] = self.shading_axes(vertex_normal);
        let (x, y) = (tangent.dot(x_axis), tangent.dot(y_axis));
        let half = 0.5 / x.hypot(y).max(1.0);
        Vec2::new(0.5 + half * x, 0.5 + half * y)
    }

    /// Turns a stored stretch, the doubled angle of a direction times a strength, from the tile's shading frame to
    /// [`stretch_axes`].
    #[inline]
    pub fn stretch_from_stored(&self, stored: Vec2, vertex_normal: Vec3) -> Vec2 {
        let [x_axis, _] = self.shading_axes(vertex_normal);
        let axis = Vec2::from(stretch_axes(vertex_normal).map(|axis| axis.dot(x_axis)));
        // Angles are doubled, so that between the frames is, too.
        (stored * 2.0 - 1.0).rotate(axis.rotate(axis))
    }

    /// A direction in mesh space and a strength as the tile stores them: the angle doubled, times the strength.
    #[inline]
    pub fn stored_from_stretch(&self, direction: Vec3, strength: f32, vertex_normal: Vec3) -> Vec2 {
        let [x_axis, y_axis] = self.shading_axes(vertex_normal);
        let unit = Vec2::new(direction.dot(x_axis), direction.dot(y_axis)).normalize_or_zero();
        unit.rotate(unit) * strength * 0.5 + 0.5
    }

    /// See [`level_count`].
    #[inline]
    pub fn level_count(&self) -> u32 {
        level_count(self.extent)
    }

    /// See [`level_extent`].
    #[inline]
    pub fn level_extent(&self, level: u32) -> [u32; 2] {
        level_extent(self.extent, level)
    }
}

/// Axes in the surface to which the stretches of all tiles are turned before they are blended. Which ones makes no difference.
#[inline]
pub fn stretch_axes(vertex_normal: Vec3) -> [Vec3; 2] {
    let x = vertex_normal.any_orthonormal_vector();
    [x, vertex_normal.cross(x)]
}

/// Number of levels of a tile of `extent` texels at level 0: the last is 4x4.
#[inline]
pub fn level_count(extent: [u32; 2]) -> u32 {
    // The first level `l` at which the longer side is less than `6 * 2^l` texels long is rounded to 4.
    let sixths = extent[0].max(extent[1]) / 6;
    if sixths == 0 { 1 } else { sixths.ilog2() + 2 }
}

/// Extent of a level in texels, of the extent of level 0: half as long per level, rounded to the nearest multiple of 4, at
/// least 4.
#[inline]
pub fn level_extent(extent: [u32; 2], level: u32) -> [u32; 2] {
    [level_length(extent[0], level), level_length(extent[1], level)]
}

/// `n / 2^level` rounded to the nearest multiple of 4 (halves up), at least 4; `level` is below 32.
#[inline]
pub fn level_length(n: u32, level: u32) -> u32 {
    let quarters = (u64::from(n) + (2 << level)) >> (level + 2);
    4 * (quarters as u32).max(1)
}

/// Whether all corners of a triangle are in one group.
#[inline]
fn is_one([a, b, c]: [u32; 3]) -> bool {
    a == b && b == c
}

/// The different numbers among three.
fn distinct([a, b, c]: [u32; 3]) -> impl Iterator<Item = u32> {
    [Some(a), (b != a).then_some(b), (c != a && c != b).then_some(c)].into_iter().flatten()
}

/// For every group the triangles with a corner in it, ascending, in compressed rows.
#[derive(Clone, Debug)]
pub struct GroupTriangles {
    /// Row `g` is `triangles[starts[g]..starts[g + 1]]`.
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl GroupTriangles {
    /// Of all groups of a cover.
    pub fn of(cover: &Cover) -> Self {
        let mut starts = vec![0u32; cover.groups.len() + 1];
        for group in cover.corner_groups.iter().copied().flat_map(distinct) {
            starts[group as usize + 1] += 1;
        }
        for group in 1..starts.len() {
            starts[group] += starts[group - 1];
        }
        let mut next = starts.clone();
        let mut triangles = vec![0; starts[starts.len() - 1] as usize];
        for (t, &groups) in (0u32..).zip(&cover.corner_groups) {
            for group in distinct(groups) {
                triangles[next[group as usize] as usize] = t;
                next[group as usize] += 1;
            }
        }
        Self { starts, triangles }
    }

    /// The triangles with a corner in a group.
    #[inline]
    pub fn of_group(&self, group: u32) -> &[u32] {
        &self.triangles[self.starts[group as usize] as usize..self.starts[group as usize + 1] as usize]
    }
}

/// A look-up of the texture function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tap {
    /// The triangle's corner whose group is read.
    pub slot: usize,
    /// Index of the group, which is also the tile's.
    pub group: u32,
    /// Share of the value; those of a point sum to one.
    pub weight: f32,
    /// Tile coordinates of the point, 0..1.
    pub uv: Vec2,
    /// Tile coordinates of the triangle's corners.
    pub corners: [Vec2; 3],
}

impl Tap {
    /// Change of the tile coordinates for two changes of the barycentric coordinates, as those of a footprint.
    #[inline]
    pub fn steps(&self, lambda_steps: [Vec3; 2]) -> [Vec2; 2] {
        let [x, y] = lambda_steps;
        [interpolate(self.corners, x), interpolate(self.corners, y)]
    }
}

/// The look-ups of the texture function at a point: one to three, of different groups.
#[inline]
fn taps(
    groups: [u32; 3],
    lambda: Vec3,
    delta: f32,
    corners_of: impl Fn(usize) -> [Vec2; 3],
) -> impl ExactSizeIterator<Item = Tap> {
    GroupWeights::new(groups, lambda, delta).iter().map(move |(slot, weight)| {
        let corners = corners_of(slot);
        Tap { slot, group: groups[slot], weight, uv: interpolate(corners, lambda), corners }
    })
}

/// A triangle as the texture function sees it.
#[derive(Clone, Copy, Debug)]
pub struct TriangleTiles {
    /// The groups of its corners.
    pub groups: [u32; 3],
    /// For each of them the tile coordinates of the three corners.
    pub corners: [[Vec2; 3]; 3],
    /// See [`Cover::delta`].
    pub delta: f32,
}

impl TriangleTiles {
    /// The look-ups at a point.
    #[inline]
    pub fn taps(&self, lambda: Vec3) -> impl ExactSizeIterator<Item = Tap> {
        taps(self.groups, lambda, self.delta, |slot| self.corners[slot])
    }
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
        if is_one(groups) {
            // Most triangles: whatever the weights, their sum is.
            return Self { count: 1, slots: [0; 3], weights: [1.0, 0.0, 0.0] };
        }
        let [l0, l1, l2] = lambda.to_array();
        let a = [l0 - l1.max(l2) + delta, l1 - l2.max(l0) + delta, l2 - l0.max(l1) + delta];
        let mut merged = Self { count: 0, slots: [0; 3], weights: [0.0; 3] };
        for (slot, weight) in a.into_iter().enumerate() {
            if weight > 0.0 {
                merged.add(slot, groups, weight);
            }
        }
        if merged.count == 1 {
            // That of most points needs no division.
            merged.weights[0] = 1.0;
        } else {
            let sum: f32 = merged.weights.iter().sum();
            merged.weights.iter_mut().for_each(|weight| *weight /= sum);
        }
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
    pub fn iter(self) -> impl ExactSizeIterator<Item = (usize, f32)> {
        (0..self.count as usize).map(move |i| (self.slots[i] as usize, self.weights[i]))
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
