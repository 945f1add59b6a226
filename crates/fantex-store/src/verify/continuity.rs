//! The continuity certificate: on every edge the texture function, evaluated from either of the triangles that continue each
//! other there ([`continued`](fantex_mesh::continued)) on the texels as they are stored, gives the same value.
//!
//! ```text
//!          c             on the edge ab the weight of the fans around c and d is zero,
//!         / \            so both triangles read the same tiles at the same places
//!        / 0 \
//!       a-x-x-b          x: sample points, also within the blend band around the middle
//!        \ 1 /
//!         \ /
//!          d
//! ```
//!
//! Compared are the blended **linear** values of all channels, as the sampler returns them (for normals: the stored numbers,
//! before they are turned into a common frame). Values beyond 1, in float channels, are compared relative to their size.

use fantex_cover::unflattenable_vertices;
use fantex_mesh::Edges;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::layout::level_count;
use crate::{Asset, PageCache, Tile};

/// Continuity of the texture function across edges.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Continuity {
    /// Largest difference of any channel between the two triangles of an edge.
    pub largest_jump: f32,
    /// Where it is; none where there is no jump at all.
    pub worst: Option<WorstJump>,
    /// Edges compared.
    pub edges: u64,
    /// Choices of levels compared: every level, and some pseudo-random mixtures.
    pub levels: u32,
    /// Pairs of values compared (RGBA, all channels, count as one).
    pub samples: u64,
    /// Edges left out: the sum of `exempt`.
    pub exempt_edges: u64,
    /// Why.
    pub exempt: ExemptEdges,
    /// Edges whose two triangles name different groups at an end, although the fan there could be laid flat: a fault of the
    /// cover. They are neither compared nor exempt.
    pub needless_splits: u64,
    /// Edges of one triangle: nothing to compare.
    pub boundary_edges: u64,
}

/// Edges of two or more triangles that are not compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExemptEdges {
    /// Three or more triangles meet, and none continues another.
    pub non_manifold: u64,
    /// The two sides of a leaf meet, which have the same three vertices.
    pub rim: u64,
    /// The two triangles belong to different groups at an end, where the fan had to be split.
    pub split_fan: u64,
}

/// Which level of each tile was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LevelChoice {
    /// This one, or the tile's last.
    Same(u32),
    /// A pseudo-random one of each tile.
    Mixed(u32),
}

/// Where the texture function jumps most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorstJump {
    /// The edge's vertices.
    pub vertices: [u32; 2],
    /// Its triangles.
    pub triangles: [u32; 2],
    /// Position along the edge, 0 at the first vertex, 1 at the second.
    pub position: f32,
    /// Levels that were read.
    pub level: LevelChoice,
    /// Channel index.
    pub channel: usize,
}

/// Pseudo-random mixtures of levels that are compared.
const MIXTURES: u32 = 2;

/// Fewest and most equally spaced points per edge, besides those of the blend band.
const POINTS: [f32; 2] = [5.0, 17.0];

/// An edge of two triangles that belong to the same groups at both ends.
#[derive(Clone, Copy)]
struct Edge {
    triangles: [u32; 2],
    /// Slots (0..3) of the edge's two vertices, per triangle.
    slots: [[u8; 2]; 2],
    /// Groups at the two vertices.
    groups: [u32; 2],
}

pub(super) fn certify(cache: &PageCache) -> Continuity {
    let asset = cache.asset();
    let mut total = Continuity::default();
    let mut edges = compared_edges(asset, &mut total);
    // Neighbouring groups are neighbours in the file.
    edges.par_sort_by_key(|edge| edge.groups);
    let parts: Vec<Continuity> = edges
        .par_chunks(1024)
        .map(|chunk| {
            let mut comparison = Comparison::new(cache);
            chunk.iter().for_each(|edge| comparison.compare(edge));
            comparison.result
        })
        .collect();
    for part in parts {
        total.samples += part.samples;
        if part.largest_jump > total.largest_jump {
            (total.largest_jump, total.worst) = (part.largest_jump, part.worst);
        }
    }
    total.edges = edges.len() as u64;
    total.exempt_edges = total.exempt.non_manifold + total.exempt.rim + total.exempt.split_fan;
    total.levels = asset.level_count() + MIXTURES;
    total
}

/// All edges of the mesh that can be compared; counts the others.
fn compared_edges(asset: &Asset, counts: &mut Continuity) -> Vec<Edge> {
    let (mesh, cover) = (asset.mesh(), asset.cover());
    let mut edges = Vec::new();
    let mut split_at: Vec<Vec<u32>> = Vec::new();
    for edge in Edges::of(&mesh.triangles).iter() {
        if edge.triangle_count() == 1 {
            counts.boundary_edges += 1;
            continue;
        }
        let vertices = edge.vertices();
        let pairs = edge.continued();
        if pairs.is_empty() {
            let exempt = &mut counts.exempt;
            *if edge.triangle_count() == 2 { &mut exempt.rim } else { &mut exempt.non_manifold } += 1;
        }
        for pair in pairs {
            let triangles = pair.map(|half_edge| half_edge / 3);
            let slots = triangles.map(|t| vertices.map(|v| slot_of(mesh.triangles[t as usize], v)));
            let groups = [0, 1].map(|side| {
                slots[side].map(|slot| cover.corner_groups[triangles[side] as usize][usize::from(slot)])
            });
            if groups[0] == groups[1] {
                edges.push(Edge { triangles, slots, groups: groups[0] });
            } else {
                split_at
                    .push((0..2).filter(|&k| groups[0][k] != groups[1][k]).map(|k| vertices[k]).collect());
            }
        }
    }
    if !split_at.is_empty() {
        let allowed = unflattenable_vertices(mesh);
        for ends in split_at {
            let must = ends.iter().all(|v| allowed.binary_search(v).is_ok());
            *if must { &mut counts.exempt.split_fan } else { &mut counts.needless_splits } += 1;
        }
    }
    edges
}

fn slot_of(triangle: [u32; 3], vertex: u32) -> u8 {
    triangle.iter().position(|&v| v == vertex).unwrap_or(0) as u8
}

/// Compares edges one by one.
struct Comparison<'a> {
    cache: &'a PageCache,
    asset: &'a Asset,
    result: Continuity,
}

/// What the texture function reads at one point, seen from one triangle: place in the edge's pair of tiles, weight and tile
/// coordinates of each look-up.
type LookUps = [Option<(usize, f32, Vec2)>; 3];

impl<'a> Comparison<'a> {
    fn new(cache: &'a PageCache) -> Self {
        Self { cache, asset: cache.asset(), result: Continuity::default() }
    }

    fn compare(&mut self, edge: &Edge) {
        let corners = [0, 1].map(|side| {
            let triangle = edge.triangles[side] as usize;
            [0, 1, 2].map(|slot| self.asset.cover().tile_corners(self.asset.mesh(), triangle, slot))
        });
        let levels = edge.groups.map(|g| level_count(self.extent(g))).into_iter().max().unwrap_or(1);
        for level in 0..levels {
            self.compare_at(edge, &corners, LevelChoice::Same(level));
        }
        for choice in (0..MIXTURES).map(LevelChoice::Mixed) {
            let mixed = edge.groups.map(|g| self.level(g, choice));
            let same = LevelChoice::Same(mixed[0].max(mixed[1]));
            // Otherwise it has been compared above.
            if mixed != edge.groups.map(|g| self.level(g, same)) {
                self.compare_at(edge, &corners, choice);
            }
        }
    }

    fn compare_at(&mut self, edge: &Edge, corners: &[[[Vec2; 3]; 3]; 2], choice: LevelChoice) {
        let tiles: Vec<[Tile; 2]> = (0..self.asset.channels().len())
            .map(|channel| {
                let tile = |group| self.cache.tile(channel, group, self.level(group, choice));
                let first = tile(edge.groups[0]);
                let is_one_group = edge.groups[0] == edge.groups[1];
                let second = if is_one_group { first.clone() } else { tile(edge.groups[1]) };
                [first, second]
            })
            .collect();
        for s in self.positions(edge, &corners[0], choice) {
            self.result.samples += 1;
            let look_ups = [0, 1].map(|side| self.look_ups(edge, side, &corners[side], s));
            for (channel, pair) in tiles.iter().enumerate() {
                let [a, b] = look_ups.each_ref().map(|look_ups| blend(pair, look_ups));
                let jump = (0..4).map(|k| jump(a[k], b[k])).fold(0.0, f32::max);
                if jump > self.result.largest_jump {
                    self.result.largest_jump = jump;
                    self.result.worst = Some(self.place(edge, s, choice, channel));
                }
            }
        }
    }

    fn place(&self, edge: &Edge, position: f32, level: LevelChoice, channel: usize) -> WorstJump {
        let triangle = self.asset.mesh().triangles[edge.triangles[0] as usize];
        let vertices = edge.slots[0].map(|slot| triangle[usize::from(slot)]);
        WorstJump { vertices, triangles: edge.triangles, position, level, channel }
    }

    fn extent(&self, group: u32) -> [u32; 2] {
        self.asset.cover().groups[group as usize].extent
    }

    /// Points along the edge: its ends, one per texel, and the blend band.
    fn positions(
        &self,
        edge: &Edge,
        corners: &[[Vec2; 3]; 3],
        choice: LevelChoice,
    ) -> impl Iterator<Item = f32> + use<> {
        let [from, to] = edge.slots[0].map(usize::from);
        let texels = [from, to].into_iter().zip(edge.groups).map(|(slot, group)| {
            let extent = crate::layout::level_extent(self.extent(group), self.level(group, choice));
            let along = corners[slot][to] - corners[slot][from];
            (along * Vec2::new(extent[0] as f32, extent[1] as f32)).length()
        });
        let count = texels.fold(POINTS[0], f32::max).min(POINTS[1]) as u32;
        let equal = (0..=count).map(move |k| k as f32 / count as f32);
        // The band: |1 - 2 s| < delta.
        let delta = self.asset.cover().delta;
        let band = [-0.999, -0.5, 0.0, 0.5, 0.999].map(|x| 0.5 + 0.5 * delta * x);
        let blends = edge.groups[0] != edge.groups[1];
        equal.chain(band.into_iter().filter(move |_| blends))
    }

    fn level(&self, group: u32, choice: LevelChoice) -> u32 {
        let levels = level_count(self.extent(group));
        match choice {
            LevelChoice::Same(level) => level.min(levels - 1),
            LevelChoice::Mixed(seed) => {
                // Multiplicative hashing: the high bits depend on all bits of the group.
                let hash = (group ^ (seed << 27)).wrapping_add(seed + 1).wrapping_mul(0x9e37_79b1);
                ((u64::from(hash) * u64::from(levels)) >> 32) as u32
            }
        }
    }

    /// The look-ups of the texture function on the edge, from one of its triangles.
    fn look_ups(&self, edge: &Edge, side: usize, corners: &[[Vec2; 3]; 3], s: f32) -> LookUps {
        let triangle = edge.triangles[side] as usize;
        let [from, to] = edge.slots[side].map(usize::from);
        let mut lambda = Vec3::ZERO;
        lambda[from] = 1.0 - s;
        lambda[to] = s;
        let cover = self.asset.cover();
        let mut look_ups = [None; 3];
        for (look_up, (slot, weight)) in look_ups.iter_mut().zip(cover.weights(triangle, lambda).iter()) {
            let [a, b, c] = corners[slot];
            let uv = a * lambda.x + b * lambda.y + c * lambda.z;
            // The third corner's weight is zero on the edge, whatever delta <= 1/3 is.
            let group = cover.corner_groups[triangle][slot];
            *look_up = Some((usize::from(group != edge.groups[0]), weight, uv));
        }
        look_ups
    }
}

/// The texture function of one channel.
fn blend(tiles: &[Tile; 2], look_ups: &LookUps) -> [f32; 4] {
    let mut value = [0.0; 4];
    for &(tile, weight, uv) in look_ups.iter().flatten() {
        let texel = tiles[tile].bilinear(uv);
        for k in 0..4 {
            value[k] += weight * texel[k];
        }
    }
    value
}

/// Difference, relative to the size of values beyond 1. A value that is no number on one side only is a jump of 1.
fn jump(a: f32, b: f32) -> f32 {
    let difference = (a - b).abs() / a.abs().max(b.abs()).max(1.0);
    if difference.is_nan() { if a.is_nan() && b.is_nan() { 0.0 } else { 1.0 } } else { difference }
}
