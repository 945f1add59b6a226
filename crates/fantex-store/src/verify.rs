//! Verifying assets: structure, checksums, the continuity certificate, and on request (`verify_texels.rs`) that detail levels agree.
//!
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

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use fantex_base::{Error, Result};
use fantex_cover::{TriangleTiles, level_count};
use fantex_mesh::{Edges, HardEdges, Mesh, is_crease, shading_normals};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::directory::Attachments;
use crate::verify_texels::check_texels;
use crate::{
    Asset, Channel, ChannelKind, ClusterId, PageCache, TexelReport, Tile, TileId, TileSource, TileTexels,
};

/// A jump of the texture function across an edge up to this passes. It lies far below half a step of 8 bits (2e-3), so
/// nothing of it can be seen, and far above what rounding makes (below 1e-6: both sides take the same tile coordinates up
/// to the order of additions).
pub const JUMP_BOUND: f32 = 1e-4;

/// How to verify. The number of threads is that of the current rayon pool.
#[derive(Clone, Debug)]
pub struct VerifyOptions {
    /// Bytes of decoded pages to keep.
    pub memory_bytes: usize,
    /// Compare all texels that look-ups read with the finer ones that they are made of. Takes time in proportion to the texels.
    pub texels: bool,
}

impl Default for VerifyOptions {
    /// 256 MiB, without the texels.
    fn default() -> Self {
        Self { memory_bytes: 256 << 20, texels: false }
    }
}

/// What verification found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VerifyReport {
    /// Nothing damaged (texels, headers, attachments), no fault of the mesh, no jump above [`JUMP_BOUND`], no texel that contradicts
    /// finer ones, where that was asked for.
    pub ok: bool,
    /// Tile levels with damage (all channels of a tile's level count as one).
    pub damaged_tiles: u64,
    /// The first few clusters that could not be read, then attachments, in words.
    pub first_damage: Vec<String>,
    /// Header slots that are damaged (0 or 1: without any the asset does not open).
    pub damaged_headers: u32,
    /// Attachments (layers, history) that cannot be read; their damaged list counts as one.
    pub damaged_attachments: u64,
    /// Guarantees of a clean mesh that do not hold; at most one of each kind.
    pub mesh_faults: Vec<MeshFault>,
    /// The certificate.
    pub continuity: Continuity,
    /// Texels beside finer ones, where that was asked for and all could be read.
    pub texels: Option<TexelReport>,
    /// Detail levels of the tile with the most.
    pub levels: u32,
    /// Length of the file.
    pub bytes: u64,
}

/// Opens and verifies an asset on the current rayon pool.
///
/// # Errors
/// It cannot be opened. (What is damaged in it is reported.)
pub fn verify(path: &Path, options: &VerifyOptions) -> Result<VerifyReport> {
    Ok(verify_asset(&Arc::new(Asset::open(path)?), options))
}

/// Verifies an open asset on the current rayon pool.
pub fn verify_asset(asset: &Arc<Asset>, options: &VerifyOptions) -> VerifyReport {
    let damage = check_clusters(asset);
    // A large tile may have pages in several clusters.
    let damaged_tiles = damage.iter().flat_map(|d| &d.tiles).collect::<BTreeSet<_>>().len() as u64;
    let cache = PageCache::new(Arc::clone(asset), options.memory_bytes);
    let continuity = certify(&cache);
    // In the place of what is damaged coarser levels would be read.
    let texels = (options.texels && damage.is_empty()).then(|| check_texels(&cache));
    let unread = check_attachments(asset);
    let sentences = damage.into_iter().map(|d| d.what).chain(unread.iter().map(ToString::to_string));
    let mut report = VerifyReport {
        ok: false,
        damaged_tiles,
        first_damage: sentences.take(16).collect(),
        damaged_headers: asset.damaged_headers(),
        damaged_attachments: unread.len() as u64,
        mesh_faults: find_faults(asset.mesh()),
        continuity,
        texels,
        levels: asset.level_count(),
        bytes: asset.file_bytes(),
    };
    report.ok = report.damaged_tiles == 0
        && report.damaged_headers == 0
        && report.damaged_attachments == 0
        && report.mesh_faults.is_empty()
        && report.continuity.needless_splits == 0
        && report.continuity.largest_jump <= JUMP_BOUND
        && report.texels.as_ref().is_none_or(TexelReport::is_sound);
    report
}

/// Reads every attachment: why it cannot be read, or why their list cannot.
fn check_attachments(asset: &Asset) -> Vec<Error> {
    let unread = |list: &Attachments| {
        list.par_iter().filter_map(|(name, record)| asset.read_attachment(name, record).err()).collect()
    };
    asset.attachments().map_or_else(|error| vec![error], unread)
}

struct ClusterDamage {
    what: String,
    /// Those that have pages in the cluster.
    tiles: Vec<TileId>,
}

/// Reads every cluster. A cluster that unpacks to its recorded length, which opening compared with the cover, holds pages
/// of the right lengths, and every bit pattern of a page decodes.
fn check_clusters(asset: &Asset) -> Vec<ClusterDamage> {
    let all: Vec<ClusterId> = asset.clusters().collect();
    let damage = all.par_iter().filter_map(|&cluster| {
        let error = asset.read_cluster(cluster).err()?;
        let level = cluster.level;
        let has_level = |&g: &u32| level < asset.cover().groups[g as usize].level_count();
        let tiles =
            asset.groups_in_cluster(cluster).filter(has_level).map(|group| TileId { group, level }).collect();
        Some(ClusterDamage { what: error.to_string(), tiles })
    });
    damage.collect()
}

/// A guarantee of [`Mesh`] that does not hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshFault {
    /// Coordinates beyond [-1, 1].
    #[error("vertex {0} lies outside of the cube [-1, 1]^3")]
    OutsideCube(u32),
    /// No triangle uses a vertex.
    #[error("vertex {0} belongs to no triangle")]
    UnusedVertex(u32),
    /// Two vertices at one position.
    #[error("vertices {0} and {1} lie at the same position")]
    CoincidentVertices(u32, u32),
    /// Two triangles with the same vertices in the same cyclic order.
    #[error("triangles {0} and {1} are the same")]
    SameTriangle(u32, u32),
    /// A triangle without area.
    #[error("triangle {0} has no area")]
    NoArea(u32),
}

/// At most one fault of each kind.
fn find_faults(mesh: &Mesh) -> Vec<MeshFault> {
    [outside_cube(mesh), unused_vertex(mesh), coincident_vertices(mesh), same_triangle(mesh), no_area(mesh)]
        .into_iter()
        .flatten()
        .collect()
}

fn outside_cube(mesh: &Mesh) -> Option<MeshFault> {
    let vertex = mesh.positions.iter().position(|p| p.abs().max_element() > 1.0)?;
    Some(MeshFault::OutsideCube(vertex as u32))
}

fn unused_vertex(mesh: &Mesh) -> Option<MeshFault> {
    let mut used = vec![false; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    used.iter().position(|used| !used).map(|v| MeshFault::UnusedVertex(v as u32))
}

fn coincident_vertices(mesh: &Mesh) -> Option<MeshFault> {
    // Adding zero makes -0 and 0 the same.
    let keys = mesh.positions.iter().map(|p| p.to_array().map(|x| (x + 0.0).to_bits()));
    first_pair(keys).map(|[a, b]| MeshFault::CoincidentVertices(a, b))
}

fn same_triangle(mesh: &Mesh) -> Option<MeshFault> {
    let keys = mesh.triangles.iter().map(|&[a, b, c]| {
        if a < b && a < c {
            [a, b, c]
        } else if b < c {
            [b, c, a]
        } else {
            [c, a, b]
        }
    });
    first_pair(keys).map(|[a, b]| MeshFault::SameTriangle(a, b))
}

/// Indices of the first two equal keys (in the order of the keys).
fn first_pair(keys: impl Iterator<Item = [u32; 3]>) -> Option<[u32; 2]> {
    let mut sorted: Vec<([u32; 3], u32)> = keys.zip(0..).collect();
    sorted.par_sort_unstable();
    sorted.windows(2).find(|pair| pair[0].0 == pair[1].0).map(|pair| [pair[0].1, pair[1].1])
}

fn no_area(mesh: &Mesh) -> Option<MeshFault> {
    let flat = |t: &usize| {
        let [a, b, c] = mesh.triangle_positions(*t).map(|p| p.as_dvec3());
        (b - a).cross(c - a) == glam::DVec3::ZERO
    };
    (0..mesh.triangles.len()).find(flat).map(|t| MeshFault::NoArea(t as u32))
}

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
    /// Largest difference across the [hard edges](ExemptEdges::hard) at the finest level, which no bound is for. Of normals and directions,
    /// which tiles store in frames of their own, nothing is said.
    pub largest_hard_jump: f32,
    /// Why.
    pub exempt: ExemptEdges,
    /// Edges whose two triangles name different groups at an end: a fault of the cover, as every fan can be laid flat. They are
    /// neither compared nor exempt.
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
    /// The edge is a crease of a cover whose fans end there.
    pub crease: u64,
    /// The edge is [hard](fantex_mesh::HardEdges), and fans were asked to end there.
    pub hard: u64,
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

/// Bounds of the number of equally spaced points per edge, besides those of the blend band.
const MIN_POINTS: f32 = 5.0;
const MAX_POINTS: f32 = 17.0;

/// An edge of two triangles.
#[derive(Clone, Copy)]
struct Edge {
    triangles: [u32; 2],
    /// Slots (0..3) of the edge's two vertices, per triangle.
    slots: [[u8; 2]; 2],
    /// Groups at the two vertices, per triangle.
    groups: [[u32; 2]; 2],
}

impl Edge {
    /// Whether both triangles belong to the same groups.
    fn is_whole(&self) -> bool {
        self.groups[0] == self.groups[1]
    }
}

fn certify(cache: &PageCache) -> Continuity {
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
        total.largest_hard_jump = total.largest_hard_jump.max(part.largest_hard_jump);
        if part.largest_jump > total.largest_jump {
            (total.largest_jump, total.worst) = (part.largest_jump, part.worst);
        }
    }
    let ExemptEdges { non_manifold, rim, crease, hard } = total.exempt;
    total.edges = edges.len() as u64 - hard;
    total.exempt_edges = non_manifold + rim + crease + hard;
    total.levels = asset.level_count() + MIXTURES;
    total
}

/// All edges of the mesh that can be compared, hard ones among them; counts the others and the hard ones.
fn compared_edges(asset: &Asset, counts: &mut Continuity) -> Vec<Edge> {
    let (mesh, cover) = (asset.mesh(), asset.cover());
    let mut edges = Vec::new();
    let normals = if cover.is_creased { shading_normals(mesh) } else { Vec::new() };
    let hard_edges = cover.hard_edges.map(|degrees| HardEdges::of(mesh, degrees));
    for edge in Edges::of(&mesh.triangles).iter() {
        if edge.triangle_count() == 1 {
            counts.boundary_edges += 1;
            continue;
        }
        let vertices = edge.vertices();
        let pairs = match cover.is_paired_by_angle {
            true => edge.continued_by_angle(&mesh.positions),
            false => edge.continued(),
        };
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
            let edge = Edge { triangles, slots, groups };
            let is_hard = || hard_edges.as_ref().is_some_and(|hard| hard.is_hard(triangles, vertices));
            if edge.is_whole() {
                edges.push(edge);
            } else if is_hard() {
                counts.exempt.hard += 1;
                edges.push(edge);
            } else {
                let corner =
                    |side: usize, k: usize| 3 * triangles[side] as usize + usize::from(slots[side][k]);
                let is_crease =
                    |k: usize| cover.is_creased && is_crease(&normals, corner(0, k), corner(1, k));
                let is_cut = (0..2).all(|k| groups[0][k] == groups[1][k] || is_crease(k));
                *if is_cut { &mut counts.exempt.crease } else { &mut counts.needless_splits } += 1;
            }
        }
    }
    edges
}

fn slot_of(triangle: [u32; 3], vertex: u32) -> u8 {
    triangle.iter().position(|&v| v == vertex).unwrap_or(0) as u8
}

struct Comparison<'a> {
    cache: &'a PageCache,
    asset: &'a Asset,
    result: Continuity,
}

/// See [`look_ups`].
type LookUps = [Option<(usize, f32, Vec2)>; 3];

impl<'a> Comparison<'a> {
    fn new(cache: &'a PageCache) -> Self {
        Self { cache, asset: cache.asset(), result: Continuity::default() }
    }

    fn compare(&mut self, edge: &Edge) {
        let (mesh, cover) = (self.asset.mesh(), self.asset.cover());
        let corners = edge.triangles.map(|triangle| cover.triangle_tiles(mesh, triangle));
        if !edge.is_whole() {
            return self.measure_hard(edge, &corners);
        }
        let groups = edge.groups[0];
        let levels = groups.map(|g| level_count(self.extent(g))).into_iter().max().unwrap_or(1);
        for level in 0..levels {
            self.compare_at(edge, &corners, LevelChoice::Same(level));
        }
        for choice in (0..MIXTURES).map(LevelChoice::Mixed) {
            let mixed = groups.map(|g| self.level(g, choice));
            let same = LevelChoice::Same(mixed[0].max(mixed[1]));
            // Otherwise it has been compared above.
            if mixed != groups.map(|g| self.level(g, same)) {
                self.compare_at(edge, &corners, choice);
            }
        }
    }

    fn compare_at(&mut self, edge: &Edge, corners: &[TriangleTiles; 2], choice: LevelChoice) {
        let channels = 0..self.asset.channels().len();
        let tiles: Vec<[Tile; 2]> =
            channels.map(|channel| self.tiles(channel, edge.groups[0], choice)).collect();
        for s in self.positions(edge, &corners[0].corners, choice) {
            self.result.samples += 1;
            let look_ups = [0, 1].map(|side| look_ups(edge, side, &corners[side], s));
            for (channel, pair) in tiles.iter().enumerate() {
                let [a, b] = look_ups.each_ref().map(|look_ups| blend(pair, look_ups));
                let jump = jump(a, b);
                if jump > self.result.largest_jump {
                    self.result.largest_jump = jump;
                    self.result.worst = Some(self.place(edge, s, choice, channel));
                }
            }
        }
    }

    /// Of an edge whose triangles read tiles of their own.
    fn measure_hard(&mut self, edge: &Edge, corners: &[TriangleTiles; 2]) {
        let finest = LevelChoice::Same(0);
        for (channel, Channel { kind, .. }) in self.asset.channels().iter().enumerate() {
            if matches!(kind, ChannelKind::Normal | ChannelKind::Anisotropy) {
                continue;
            }
            let tiles = edge.groups.map(|groups| self.tiles(channel, groups, finest));
            for s in self.positions(edge, &corners[0].corners, finest) {
                let [a, b] = [0, 1].map(|side| blend(&tiles[side], &look_ups(edge, side, &corners[side], s)));
                self.result.largest_hard_jump = self.result.largest_hard_jump.max(jump(a, b));
            }
        }
    }

    fn tiles(&self, channel: usize, [first, second]: [u32; 2], choice: LevelChoice) -> [Tile; 2] {
        let tile = |group| self.cache.tile(channel, TileId { group, level: self.level(group, choice) });
        let one = tile(first);
        if first == second { [one.clone(), one] } else { [one, tile(second)] }
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
        let texels = [from, to].into_iter().zip(edge.groups[0]).map(|(slot, group)| {
            let extent = crate::layout::level_extent(self.extent(group), self.level(group, choice));
            let along = corners[slot][to] - corners[slot][from];
            (along * Vec2::new(extent[0] as f32, extent[1] as f32)).length()
        });
        let count = texels.fold(MIN_POINTS, f32::max).min(MAX_POINTS) as u32;
        let equal = (0..=count).map(move |k| k as f32 / count as f32);
        // The band: |1 - 2 s| < delta.
        let delta = self.asset.cover().delta;
        let band = [-0.999, -0.5, 0.0, 0.5, 0.999].map(|x| 0.5 + 0.5 * delta * x);
        let [first, second] = edge.groups[0];
        let blends = first != second;
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
}

/// What the texture function reads at a point of the edge, seen from one of its triangles: place in the edge's pair of tiles,
/// weight and tile coordinates of each look-up. (The third corner's weight is zero on the edge, whatever delta <= 1/3 is.)
fn look_ups(edge: &Edge, side: usize, tiles: &TriangleTiles, s: f32) -> LookUps {
    let [from, to] = edge.slots[side].map(usize::from);
    let mut lambda = Vec3::ZERO;
    lambda[from] = 1.0 - s;
    lambda[to] = s;
    let mut look_ups = [None; 3];
    for (look_up, tap) in look_ups.iter_mut().zip(tiles.taps(lambda)) {
        *look_up = Some((usize::from(tap.group != edge.groups[side][0]), tap.weight, tap.uv));
    }
    look_ups
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

/// The largest difference between the components of two values of a texture function, relative to the size of those beyond 1. What is no
/// number on one side only is a jump of 1.
pub fn jump(a: [f32; 4], b: [f32; 4]) -> f32 {
    let of_component = |(a, b): (f32, f32)| {
        let difference = (a - b).abs() / a.abs().max(b.abs()).max(1.0);
        if difference.is_nan() { if a.is_nan() && b.is_nan() { 0.0 } else { 1.0 } } else { difference }
    };
    a.into_iter().zip(b).map(of_component).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn square() -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn each_fault_is_found() {
        assert_eq!(find_faults(&square()), []);
        let faults = |change: fn(&mut Mesh)| {
            let mut mesh = square();
            change(&mut mesh);
            find_faults(&mesh)
        };
        assert_eq!(faults(|m| m.positions[1].x = 1.5), [MeshFault::OutsideCube(1)]);
        assert_eq!(faults(|m| m.positions.push(Vec3::Z)), [MeshFault::UnusedVertex(4)]);
        assert_eq!(
            faults(|m| {
                m.positions.push(-0.0 * Vec3::ONE);
                m.triangles.push([4, 3, 1]);
            }),
            [MeshFault::CoincidentVertices(0, 4)]
        );
        assert_eq!(faults(|m| m.triangles.push([2, 0, 1])), [MeshFault::SameTriangle(0, 2)]);
        assert_eq!(faults(|m| m.triangles.push([2, 1, 0])), []);
        assert_eq!(faults(|m| m.positions[1] = Vec3::splat(0.5)), [MeshFault::NoArea(0)]);
    }
}
