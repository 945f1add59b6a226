//! Covers and tiles made by hand.

use fantex_cover::{Cover, Frame, Group, GroupKind};
use fantex_mesh::Mesh;
use fantex_render::{TileSource, TileTexels};
use glam::{DVec3, Vec2, Vec3};

use super::{Random, cast};

/// All levels of all tiles of all channels in memory.
#[derive(Default)]
pub(crate) struct MemoryTiles {
    /// `levels[channel][group][level]`
    pub(crate) levels: Vec<Vec<Vec<MemoryTile>>>,
}

#[derive(Clone)]
pub(crate) struct MemoryTile {
    pub(crate) extent: [u32; 2],
    /// Row-major from v = 0.
    pub(crate) rgba: Vec<[f32; 4]>,
}

impl MemoryTile {
    pub(crate) fn mean(&self) -> [f32; 4] {
        [0, 1, 2, 3].map(|c| self.rgba.iter().map(|t| t[c]).sum::<f32>() / self.rgba.len() as f32)
    }
}

impl TileSource for &MemoryTiles {
    type Tile = MemoryTile;

    fn tile(&self, channel: usize, group: u32, level: u32) -> MemoryTile {
        self.levels[channel][group as usize][level as usize].clone()
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.levels[channel][group as usize][0].mean()
    }
}

impl TileTexels for MemoryTile {
    fn extent(&self) -> [u32; 2] {
        self.extent
    }

    fn bilinear(&self, uv: Vec2) -> [f32; 4] {
        let extent = Vec2::new(self.extent[0] as f32, self.extent[1] as f32);
        let p = (uv * extent - 0.5).clamp(Vec2::ZERO, extent - 1.0);
        let (x, y) = (p.x as u32, p.y as u32);
        let (x1, y1) = ((x + 1).min(self.extent[0] - 1), (y + 1).min(self.extent[1] - 1));
        let [a, b, c, d] = [self.texel(x, y), self.texel(x1, y), self.texel(x, y1), self.texel(x1, y1)];
        let t = p - p.floor();
        [0, 1, 2, 3].map(|i| {
            (a[i] * (1.0 - t.x) + b[i] * t.x) * (1.0 - t.y) + (c[i] * (1.0 - t.x) + d[i] * t.x) * t.y
        })
    }

    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        self.rgba[(y * self.extent[0] + x) as usize]
    }
}

/// One fan per tile, each with its own direction near +z and its own turn; for meshes that face +z.
pub(crate) fn fan_cover(mesh: &Mesh, extent: [u32; 2]) -> Cover {
    let mut random = Random::new(77);
    let mut frame_of = |v: usize| {
        let direction = Vec3::new(0.2 * random.signed(), 0.2 * random.signed(), 1.0).normalize();
        let x_axis = Vec3::new(random.signed(), random.signed(), 0.0).cross(direction).normalize();
        Frame { origin: mesh.positions[v], direction, x_axis }
    };
    let group = |v: usize| {
        let frame = frame_of(v);
        let fan = mesh.triangles.iter().filter(|t| t.contains(&(v as u32))).flatten();
        let reach = fan.fold(0f32, |reach, &w| {
            let q = mesh.positions[w as usize] - frame.origin;
            reach.max(q.dot(frame.x_axis).abs()).max(q.dot(frame.y_axis()).abs())
        });
        let (uv_scale, uv_offset) = (Vec2::splat(0.45 / reach), Vec2::splat(0.5));
        Group { kind: GroupKind::Projected, frame, uv_scale, uv_offset, extent }
    };
    let groups = (0..mesh.positions.len()).map(group).collect();
    Cover { delta: 0.2, density: 100.0, corner_groups: mesh.triangles.clone(), groups, unfolded: Vec::new() }
}

/// Tiles of one channel: `value(point, triangle, lambda, frame)` at the surface point under each texel, at every level.
pub(crate) fn bake(
    mesh: &Mesh,
    cover: &Cover,
    value: impl Fn(Vec3, Option<(usize, Vec3)>, &Frame) -> [f32; 4],
) -> Vec<Vec<MemoryTile>> {
    let tile = |group: &Group, level: u32| {
        let extent @ [columns, rows] = group.level_extent(level);
        let texel = |i: u32| {
            let uv = Vec2::new(
                ((i % columns) as f32 + 0.5) / columns as f32,
                ((i / columns) as f32 + 0.5) / rows as f32,
            );
            let offset = (uv - group.uv_offset) / group.uv_scale;
            let frame = &group.frame;
            let on_plane = frame.origin + frame.x_axis * offset.x + frame.y_axis() * offset.y;
            let above: DVec3 = (on_plane + frame.direction * 2.0).as_dvec3();
            match cast(mesh, above, -frame.direction.as_dvec3()) {
                Some((t, lambda)) => {
                    let lambda = lambda.as_vec3();
                    let [a, b, c] = mesh.triangle_positions(t);
                    value(a * lambda.x + b * lambda.y + c * lambda.z, Some((t, lambda)), frame)
                }
                None => value(on_plane, None, frame),
            }
        };
        MemoryTile { extent, rgba: (0..columns * rows).map(texel).collect() }
    };
    let levels = |group: &Group| (0..group.level_count()).map(|level| tile(group, level)).collect();
    cover.groups.iter().map(levels).collect()
}
