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
use crate::surface::{Frames, Surface, TriangleFrames, lambda_steps};
use crate::texels::{Region, Values};

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
    /// Positions, as changes of barycentric coordinates, whose mean is taken.
    offsets: &'static [Vec2],
}

struct TriangleReader<'a> {
    surface: &'a AssetSurface,
    tiles: TriangleTiles,
    slots: [SlotReader; 3],
    /// Barycentric coordinates change by these per texel to the right and downwards.
    steps: [Vec3; 2],
    /// Where a map needs them.
    frames: Option<TriangleFrames>,
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
        let steps = lambda_steps(placed.corners);
        let (mesh, cover) = (surface.mesh(), surface.cache.asset().cover());
        let triangle_tiles = cover.triangle_tiles(mesh, placed.triangle);
        let slots = [0, 1, 2].map(|slot| {
            let index = triangle_tiles.groups[slot];
            let extent = cover.groups[index as usize].extent.map(|n| n as f32);
            let width =
                |step: Vec3| (interpolate(triangle_tiles.corners[slot], step) * Vec2::from(extent)).length();
            let width = width(steps[0]).max(width(steps[1]));
            let (level, offsets) = match width {
                w if w <= MAX_LOOKUP_WIDTH => (0, MIDDLE),
                w => (w.min(65_536.0).log2().max(0.0) as u32, QUARTERS),
            };
            let tiles = maps.iter().map(|m| tiles.get(m.channel, TileId { group: index, level })).collect();
            SlotReader { tiles, offsets }
        });
        let has_normals = maps.iter().any(Map::has_normals);
        let frames = has_normals.then(|| frames.of_triangle(mesh, placed, steps));
        Self { surface, tiles: triangle_tiles, slots, steps, frames }
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
        for offset in reader.offsets {
            let lambda = lambda + self.steps[0] * offset.x + self.steps[1] * offset.y;
            let at = SurfacePoint { lambda, ..SurfacePoint::default() }.clamped();
            sum += Vec4::from_array(reader.tiles[map].bilinear(at.interpolate(tap.corners)));
        }
        sum / reader.offsets.len() as f32
    }
}
