//! Pictures of an asset: its texture function at the points of texels.

use std::rc::Rc;
use std::sync::Arc;

use fantex_bake::{Prefilter, Progress};
use fantex_cover::{Tap, TriangleTiles};
use fantex_mesh::{Mesh, SurfacePoint, interpolate};
use fantex_store::{Asset, ChannelKind, PageCache, Tile, TileId, TileSource, TileTexels};
use glam::{Vec2, Vec3, Vec4};
use rustc_hash::FxHashMap;

use crate::ChannelMap;
use crate::export::{ExportOptions, Map, brightest, scale_of, told};
use crate::layout::{Page, Placed};
use crate::surface::{Frames, NO_AREA, Surface, TriangleFrames, lambda_steps};
use crate::texels::{Region, Values, nearest_of_border};

/// An asset whose pages are read as they are needed.
pub(crate) struct AssetSurface {
    cache: PageCache,
}

impl AssetSurface {
    pub(crate) fn new(asset: &Arc<Asset>, options: &ExportOptions<'_>) -> Self {
        Self { cache: PageCache::new(Arc::clone(asset), (options.memory_bytes / 2) as usize) }
    }

    /// The largest number of a map of light, at least 1.
    pub(crate) fn brightest(&self, map: &Map, progress: &dyn Progress) -> f32 {
        brightest(&self.cache, map, progress)
    }
}

impl Surface for AssetSurface {
    fn mesh(&self) -> &Mesh {
        self.cache.asset().mesh()
    }

    fn texels_per_unit(&self) -> f32 {
        self.cache.asset().cover().density
    }

    fn channels(&self) -> Vec<ChannelKind> {
        self.cache.asset().channels().iter().map(|channel| channel.kind).collect()
    }

    fn map(&self, kind: ChannelMap) -> Option<Map> {
        Map::of(self.cache.asset(), kind)
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn values(&self, page: &Page, region: &Region, maps: &[Map], frames: &Frames<'_>) -> Vec<Values> {
        let mut values: Vec<Values> = maps.iter().map(|_| vec![[0.0; 4]; region.point_count()]).collect();
        let mut tiles = Tiles { cache: &self.cache, held: FxHashMap::default() };
        // Triangle by triangle, so that a tile is fetched once.
        region.for_each_triangle(page, |placed, points| {
            let reader = TriangleReader::new(self, placed, maps, frames, &mut tiles);
            for &(point, lambda) in points {
                for (index, (map, values)) in maps.iter().zip(&mut values).enumerate() {
                    values[point] = reader.value(index, map, lambda).to_array();
                }
            }
        });
        values
    }

    fn largest(&self, map: &Map, progress: &dyn Progress) -> Option<f32> {
        Some(scale_of(&self.cache, map, progress))
    }

    fn damage(&self) -> Option<(u64, String)> {
        told(&self.cache.damage())
    }
}

/// Texels of a tile that a texel may be wide before it is taken as a mean of several look-ups.
const MAX_LOOKUP_WIDTH: f32 = 1.25;

/// Tiles that are kept at hand; each may hold a page.
const MAX_TILES: usize = 64;

/// Tiles in use, so that the cache is asked once for each.
struct Tiles<'a> {
    cache: &'a PageCache,
    held: FxHashMap<(usize, TileId), Rc<Tile>>,
}

impl Tiles<'_> {
    fn get(&mut self, channel: usize, id: TileId) -> Rc<Tile> {
        if self.held.len() >= MAX_TILES {
            self.held.clear();
        }
        let cache = self.cache;
        Rc::clone(self.held.entry((channel, id)).or_insert_with(|| Rc::new(cache.tile(channel, id))))
    }
}

struct SlotReader {
    /// The level that is read, of every map's channel.
    tiles: Vec<Rc<Tile>>,
    /// Places around a point, in texels of the picture, whose mean is taken.
    offsets: &'static [Vec2],
}

struct TriangleReader<'a> {
    surface: &'a AssetSurface,
    tiles: TriangleTiles,
    slots: [SlotReader; 3],
    footprint: Footprint,
    /// Where a map needs them.
    frames: Option<TriangleFrames>,
}

/// What a texel of the picture covers of a triangle.
struct Footprint {
    /// Of the triangle, in the picture.
    corners: [Vec2; 3],
    /// Barycentric coordinates change by these per texel to the right and downwards.
    steps: [Vec3; 2],
    /// As barycentric coordinates: along the longest side, and from there to the other corner, each as far as a texel reaches at most. So a
    /// needle is as wide as it is, whatever its coordinates across do within a texel.
    axes: [Vec3; 2],
    /// It is a line.
    is_flat: bool,
}

impl Footprint {
    fn of(corners: [Vec2; 3]) -> Self {
        let steps = lambda_steps(corners);
        let side = |k: usize| corners[(k + 1) % 3] - corners[k];
        let longest =
            [0, 1, 2].into_iter().max_by(|&i, &j| side(i).length().total_cmp(&side(j).length())).unwrap_or(0);
        let length = side(longest).length();
        if length == 0.0 {
            // It shows the mean of all of it.
            return Self { corners, steps, axes: steps, is_flat: false };
        }
        let (next, other) = ((longest + 1) % 3, (longest + 2) % 3);
        let to_other = corners[other] - corners[longest];
        let share = (to_other.dot(side(longest)) / (length * length)).clamp(0.0, 1.0);
        let height = side(longest).perp_dot(to_other).abs() / length;
        let [mut along, mut across] = [Vec3::ZERO; 2];
        (along[longest], along[next]) = (-1.0, 1.0);
        (across[longest], across[next], across[other]) = (share - 1.0, -share, 1.0);
        let axes = [along / length.max(1.0), across / height.max(1.0)];
        Self { corners, steps, axes, is_flat: height * length < NO_AREA }
    }

    /// How wide it is elsewhere, where the triangle has these corners.
    fn width(&self, corners: [Vec2; 3]) -> f32 {
        let [along, across] = self.axes.map(|axis| interpolate(corners, axis).length());
        along.max(across)
    }

    /// The triangle's point nearest to the place so far off one of its points, in texels.
    fn beside(&self, lambda: Vec3, offset: Vec2) -> Vec3 {
        let moved = lambda + self.steps[0] * offset.x + self.steps[1] * offset.y;
        if moved.min_element() >= 0.0 && !self.is_flat {
            return moved;
        }
        nearest_of_border(&self.corners, interpolate(self.corners, lambda) + offset).0
    }
}

const MIDDLE: &[Vec2] = &[Vec2::ZERO];

/// Four look-ups in the middles of its quarters.
const QUARTERS: &[Vec2] =
    &[Vec2::new(-0.25, -0.25), Vec2::new(0.25, -0.25), Vec2::new(-0.25, 0.25), Vec2::new(0.25, 0.25)];

impl<'a> TriangleReader<'a> {
    fn new(
        surface: &'a AssetSurface,
        placed: &Placed,
        maps: &[Map],
        frames: &Frames<'_>,
        tiles: &mut Tiles<'_>,
    ) -> Self {
        let footprint = Footprint::of(placed.corners);
        let (mesh, cover) = (surface.mesh(), surface.cache.asset().cover());
        let triangle_tiles = cover.triangle_tiles(mesh, placed.triangle);
        let slots = [0, 1, 2].map(|slot| {
            let index = triangle_tiles.groups[slot];
            let extent = cover.groups[index as usize].extent.map(|n| n as f32);
            let width = footprint.width(triangle_tiles.corners[slot].map(|p| p * Vec2::from(extent)));
            let (level, offsets) = match width {
                w if w <= MAX_LOOKUP_WIDTH => (0, MIDDLE),
                w => (w.min(65_536.0).log2().max(0.0) as u32, QUARTERS),
            };
            let tiles = maps.iter().map(|m| tiles.get(m.channel, TileId { group: index, level })).collect();
            SlotReader { tiles, offsets }
        });
        let has_normals = maps.iter().any(Map::has_normals);
        let frames = has_normals.then(|| frames.of_triangle(mesh, placed, footprint.steps));
        Self { surface, tiles: triangle_tiles, slots, footprint, frames }
    }

    /// The value of a map, which is the one of that index, at a point.
    fn value(&self, index: usize, map: &Map, lambda: Vec3) -> Vec4 {
        let stored = |tap: Tap| tap.weight * self.stored(&tap, index, lambda);
        let Some(frames) = self.frames.as_ref().filter(|_| map.has_normals()) else {
            return self.tiles.taps(lambda).map(stored).sum::<Vec4>() / map.scale;
        };
        let normal = frames.normal(lambda);
        let in_mesh = |tap: Tap| {
            let group = &self.surface.cache.asset().cover().groups[tap.group as usize];
            let stored = self.stored(&tap, index, lambda);
            tap.weight * group.normal_from_stored(stored.truncate().truncate(), normal)
        };
        frames.texel(self.tiles.taps(lambda).map(in_mesh).sum(), lambda)
    }

    fn stored(&self, tap: &Tap, map: usize, lambda: Vec3) -> Vec4 {
        let reader = &self.slots[tap.slot];
        let mut sum = Vec4::ZERO;
        for &offset in reader.offsets {
            let lambda = self.footprint.beside(lambda, offset);
            let at = SurfacePoint { lambda, ..SurfacePoint::default() }.clamped();
            sum += Vec4::from_array(reader.tiles[map].bilinear(at.interpolate(tap.corners)));
        }
        sum / reader.offsets.len() as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn footprints_of_needles_are_as_long_as_a_texel() {
        let tile = |shear: f32| [Vec2::ZERO, Vec2::new(30.0, 0.0), Vec2::new(12.0 + shear, 0.05)];
        let needle = Footprint::of([Vec2::ZERO, Vec2::new(30.0, 0.0), Vec2::new(12.0, 0.05)]);
        assert!((needle.width(tile(0.0)) - 1.0).abs() < 1e-5);
        // Rounded coordinates of a tile move the corner by a fraction of a texel, not by as many as a texel has needles side by side.
        assert!(needle.width(tile(0.5)) < 1.01);
        let start = Vec3::new(0.5, 0.5, 0.0);
        for offset in QUARTERS {
            let place = interpolate(needle.corners, needle.beside(start, *offset));
            assert!((place.x - 15.0 - offset.x).abs() < 1e-3 && place.y.abs() < 0.06, "{place}");
        }
        let plain = Footprint::of([Vec2::ZERO, Vec2::new(8.0, 1.0), Vec2::new(2.0, 7.0)]);
        let shrunk = [Vec2::ZERO, Vec2::new(16.0, 2.0), Vec2::new(4.0, 14.0)];
        assert!((plain.width(shrunk) - 2.0).abs() < 1e-5);
        let line = Footprint::of([Vec2::ZERO, Vec2::new(20.0, 0.0), Vec2::new(10.0, 0.0)]);
        let place = interpolate(line.corners, line.beside(start, Vec2::new(0.25, 0.25)));
        assert!((place - Vec2::new(10.25, 0.0)).length() < 1e-3, "{place}");
    }
}
