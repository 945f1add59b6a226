//! The texture function at the points of texels.

use std::collections::HashMap;

use fantex_cover::{Cover, Group};
use fantex_mesh::Mesh;
use fantex_store::{ChannelKind, PageCache, Tile};
use fantex_texture::material::TangentFrame;
use glam::{Vec2, Vec3, Vec4};

use super::Values;
use super::region::{Point, Region};
use crate::layout::{NOBODY, Page, Placed};
use crate::maps::Map;

/// Evaluates the channels of an asset.
pub(crate) struct Sampler<'a> {
    pub(crate) cache: &'a PageCache,
    pub(crate) mesh: &'a Mesh,
    pub(crate) cover: &'a Cover,
    /// Unit normals, one per corner.
    pub(crate) normals: &'a [Vec3],
    /// Tangents of the layout's coordinates, one per corner; empty where no normals are wanted.
    pub(crate) tangents: &'a [Vec4],
}

/// Texels of a tile that a texel may be wide before it is taken as a mean of several look-ups.
const WIDEST_LOOKUP: f32 = 1.25;

/// Tiles that are kept at hand; each may hold a page.
const MOST_TILES: usize = 64;

impl Sampler<'_> {
    /// Linear values of every map at every texel of a region.
    pub(super) fn values(&self, page: &Page, region: &Region, maps: &[Map]) -> Vec<Values> {
        let mut values: Vec<Values> = maps.iter().map(|m| vec![m.background; region.points.len()]).collect();
        // Triangle by triangle, so that a tile is fetched once; equal points (in padding) follow each other.
        let mut order: Vec<u32> =
            (0..region.points.len() as u32).filter(|&t| region.points[t as usize].placed != NOBODY).collect();
        let key = |t: u32| {
            let Point { placed, lambda } = region.points[t as usize];
            (placed, lambda.x.to_bits(), lambda.y.to_bits())
        };
        order.sort_by_key(|&t| key(t));
        let mut tiles = Tiles { cache: self.cache, held: HashMap::new() };
        for same_triangle in order.chunk_by(|&a, &b| key(a).0 == key(b).0) {
            let placed = &page.placed[key(same_triangle[0]).0 as usize];
            let reader = TriangleReader::new(self, placed, maps, &mut tiles);
            for same_point in same_triangle.chunk_by(|&a, &b| key(a) == key(b)) {
                let lambda = region.points[same_point[0] as usize].lambda;
                for (map, values) in maps.iter().zip(&mut values) {
                    let value = reader.value(map, maps, lambda).to_array();
                    same_point.iter().for_each(|&t| values[t as usize] = value);
                }
            }
        }
        values
    }
}

/// Tiles in use, so that the cache is asked once for each.
struct Tiles<'a> {
    cache: &'a PageCache,
    held: HashMap<(usize, u32, u32), Tile>,
}

impl Tiles<'_> {
    fn get(&mut self, channel: usize, group: u32, level: u32) -> Tile {
        if self.held.len() >= MOST_TILES {
            self.held.clear();
        }
        let cache = self.cache;
        self.held.entry((channel, group, level)).or_insert_with(|| cache.tile(channel, group, level)).clone()
    }
}

/// One of a triangle's groups.
struct SlotReader<'a> {
    group: &'a Group,
    /// Tile coordinates of the triangle's corners.
    corners: [Vec2; 3],
    /// The level that is read, of every map's channel.
    tiles: Vec<Tile>,
    /// Positions, as changes of barycentric coordinates, whose mean is taken.
    offsets: &'static [Vec2],
}

/// Reads the points of one triangle.
struct TriangleReader<'a> {
    sampler: &'a Sampler<'a>,
    triangle: usize,
    slots: [SlotReader<'a>; 3],
    /// Barycentric coordinates change by these per texel to the right and downwards.
    steps: [Vec3; 2],
    normals: [Vec3; 3],
    tangents: [Vec4; 3],
}

/// One look-up in the middle of the texel.
const MIDDLE: &[Vec2] = &[Vec2::ZERO];

/// Four look-ups in the middles of its quarters.
const QUARTERS: &[Vec2] =
    &[Vec2::new(-0.25, -0.25), Vec2::new(0.25, -0.25), Vec2::new(-0.25, 0.25), Vec2::new(0.25, 0.25)];

impl<'a> TriangleReader<'a> {
    fn new(sampler: &'a Sampler<'a>, placed: &Placed, maps: &[Map], tiles: &mut Tiles<'_>) -> Self {
        let triangle = placed.triangle as usize;
        let steps = lambda_steps(placed.corners);
        let slots = [0, 1, 2].map(|slot| {
            let index = sampler.cover.corner_groups[triangle][slot];
            let group = &sampler.cover.groups[index as usize];
            let corners = sampler.cover.tile_corners(sampler.mesh, triangle, slot);
            let extent = Vec2::new(group.extent[0] as f32, group.extent[1] as f32);
            let width =
                |l: Vec3| ((corners[0] * l.x + corners[1] * l.y + corners[2] * l.z) * extent).length();
            let width = width(steps[0]).max(width(steps[1]));
            let (level, offsets) = match width {
                w if w <= WIDEST_LOOKUP => (0, MIDDLE),
                w => (w.min(65_536.0).log2().max(0.0) as u32, QUARTERS),
            };
            let tiles = maps.iter().map(|m| tiles.get(m.channel, index, level)).collect();
            SlotReader { group, corners, tiles, offsets }
        });
        let normals = [0, 1, 2].map(|k| sampler.normals[3 * triangle + k]);
        let tangents = match sampler.tangents.get(3 * triangle..3 * triangle + 3) {
            Some(own) if !placed.is_beyond => [own[0], own[1], own[2]],
            _ => tangents_of_picture(sampler.mesh, triangle, &normals, steps),
        };
        Self { sampler, triangle, slots, steps, normals, tangents }
    }

    /// The value of a map at a point.
    fn value(&self, map: &Map, maps: &[Map], lambda: Vec3) -> Vec4 {
        let index = maps.iter().position(|m| m.kind == map.kind).unwrap_or(0);
        let is_normal = map.kind.channel() == ChannelKind::Normal;
        let normal = self.normals[0] * lambda.x + self.normals[1] * lambda.y + self.normals[2] * lambda.z;
        let normal = normal.normalize_or(Vec3::Z);
        let mut sum = Vec4::ZERO;
        for (slot, weight) in self.sampler.cover.weights(self.triangle, lambda).iter() {
            let reader = &self.slots[slot];
            let stored = self.slot_value(reader, index, lambda);
            sum += weight
                * if is_normal { mesh_normal(stored, reader.group, normal).extend(0.0) } else { stored };
        }
        if is_normal { self.tangent_space(sum.truncate(), normal, lambda) } else { sum / map.scale }
    }

    fn slot_value(&self, reader: &SlotReader<'_>, map: usize, lambda: Vec3) -> Vec4 {
        let mut sum = Vec4::ZERO;
        for offset in reader.offsets {
            let l = clamped(lambda + self.steps[0] * offset.x + self.steps[1] * offset.y);
            let uv = reader.corners[0] * l.x + reader.corners[1] * l.y + reader.corners[2] * l.z;
            sum += Vec4::from_array(reader.tiles[map].bilinear(uv));
        }
        sum / reader.offsets.len() as f32
    }

    /// A normal in mesh space as the texel of a normal map.
    fn tangent_space(&self, n_mesh: Vec3, vertex_normal: Vec3, lambda: Vec3) -> Vec4 {
        let frame = TangentFrame::at(&self.normals, &self.tangents, 0, lambda);
        let relative = frame.relative(n_mesh.normalize_or(vertex_normal)).unwrap_or(Vec3::Z);
        (relative * 0.5 + 0.5).extend(1.0)
    }
}

/// Turns a stored normal (see [`ChannelKind::Normal`]) from its tile's shading frame into mesh space.
fn mesh_normal(stored: Vec4, group: &Group, vertex_normal: Vec3) -> Vec3 {
    let [x, y] = [stored.x, stored.y].map(|c| c * 2.0 - 1.0);
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let [x_axis, y_axis] = group.shading_axes(vertex_normal);
    (x_axis * x + y_axis * y + vertex_normal * z).normalize_or(vertex_normal)
}

/// The nearest barycentric coordinates on the triangle, roughly.
fn clamped(lambda: Vec3) -> Vec3 {
    let inside = lambda.max(Vec3::ZERO);
    inside / inside.element_sum().max(f32::MIN_POSITIVE)
}

/// Change of the barycentric coordinates per texel to the right and downwards.
fn lambda_steps([a, b, c]: [Vec2; 3]) -> [Vec3; 2] {
    let area = (b - a).perp_dot(c - a);
    if area.abs() < 1e-9 {
        return [Vec3::ZERO; 2];
    }
    [Vec3::new(b.y - c.y, c.y - a.y, a.y - b.y) / area, Vec3::new(c.x - b.x, a.x - c.x, b.x - a.x) / area]
}

/// Tangents along the picture's rows, for triangles that continue a chart.
fn tangents_of_picture(mesh: &Mesh, triangle: usize, normals: &[Vec3; 3], steps: [Vec3; 2]) -> [Vec4; 3] {
    let [a, b, c] = mesh.triangle_positions(triangle);
    let along = a * steps[0].x + b * steps[0].y + c * steps[0].z;
    normals.map(|n| (along - n * n.dot(along)).normalize_or(n.any_orthonormal_vector()).extend(1.0))
}
