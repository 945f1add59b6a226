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
    extent: Extent,
}

/// How a triangle lies in the picture.
#[derive(Clone, Copy)]
enum Extent {
    Area,
    /// Its longest side begins at that corner. A texel covers all of what lies across.
    Line(usize),
    /// A texel covers all of it.
    Point,
}

/// A triangle without area in the picture is looked up in so many places in both directions.
const SPREAD: usize = 4;

/// The middles of the triangles that a triangle falls into when each of its sides is divided into [`SPREAD`].
const MIDDLES: [Vec3; SPREAD * SPREAD] = {
    let mut middles = [Vec3::ZERO; SPREAD * SPREAD];
    let (mut count, mut row) = (0, 0);
    while row < SPREAD {
        let mut column = 0;
        // In turns upright and upside down.
        while column < 2 * (SPREAD - row) - 1 {
            let third = 1 + column % 2;
            let y = (3 * row + third) as f32 / (3 * SPREAD) as f32;
            let x = (3 * (column / 2) + third) as f32 / (3 * SPREAD) as f32;
            middles[count] = Vec3::new(1.0 - x - y, x, y);
            count += 1;
            column += 1;
        }
        row += 1;
    }
    middles
};

impl Footprint {
    fn of(corners: [Vec2; 3]) -> Self {
        let steps = lambda_steps(corners);
        let side = |k: usize| corners[(k + 1) % 3] - corners[k];
        let longest =
            [0, 1, 2].into_iter().max_by(|&i, &j| side(i).length().total_cmp(&side(j).length())).unwrap_or(0);
        let length = side(longest).length();
        let to_other = corners[(longest + 2) % 3] - corners[longest];
        let height = side(longest).perp_dot(to_other).abs() / length.max(f32::MIN_POSITIVE);
        let extent = match height * length < NO_AREA {
            false => Extent::Area,
            true if length < 1.0 => Extent::Point,
            true => Extent::Line(longest),
        };
        let share = share_along(&corners, longest, corners[(longest + 2) % 3]);
        let [mut along, mut across] = [Vec3::ZERO; 2];
        (along[longest], along[(longest + 1) % 3]) = (-1.0, 1.0);
        across[longest] = share - 1.0;
        across[(longest + 1) % 3] = -share;
        across[(longest + 2) % 3] = 1.0;
        Self { corners, steps, axes: [along / length.max(1.0), across / height.max(1.0)], extent }
    }

    /// How long it is elsewhere along its axes, where the triangle has these corners.
    fn lengths(&self, corners: [Vec2; 3]) -> [f32; 2] {
        self.axes.map(|axis| interpolate(corners, axis).length())
    }

    /// The level that is read in a tile, where the triangle has these corners in texels, and the places around a point whose mean is taken.
    fn lookups(&self, corners: [Vec2; 3]) -> (u32, &'static [Vec2]) {
        let [along, across] = self.lengths(corners);
        let width = along.max(across);
        let level = |width: f32| width.clamp(1.0, 65_536.0).log2() as u32;
        match self.extent {
            Extent::Area if width > MAX_LOOKUP_WIDTH => (level(width), QUARTERS),
            Extent::Area => (0, MIDDLE),
            // The outermost places are so far inside the triangle that its neighbours have no share in them.
            Extent::Line(_) | Extent::Point => (level(along.min(inradius(corners) / SPREAD as f32)), MIDDLE),
        }
    }

    /// The places whose mean a texel shows around a point of a triangle without area.
    fn spread(&self, lambda: Vec3) -> Option<[Vec3; SPREAD * SPREAD]> {
        let first = match self.extent {
            Extent::Area => return None,
            Extent::Point => return Some(MIDDLES),
            Extent::Line(first) => first,
        };
        let (second, third) = ((first + 1) % 3, (first + 2) % 3);
        let at = share_along(&self.corners, first, interpolate(self.corners, lambda));
        let bend = share_along(&self.corners, first, self.corners[third]);
        let length = self.corners[first].distance(self.corners[second]);
        let (from, to) = ((at - 0.5 / length).max(0.0), (at + 0.5 / length).min(1.0));
        let middle = |i: usize| (i as f32 + 0.5) / SPREAD as f32;
        Some(std::array::from_fn(|i| {
            let at = from + (to - from) * middle(i / SPREAD);
            // From the longest side to the other two.
            let farthest =
                if at < bend { at / bend } else { (1.0 - at) / (1.0 - bend).max(f32::MIN_POSITIVE) };
            let mut lambda = Vec3::ZERO;
            lambda[third] = farthest.min(1.0) * middle(i % SPREAD);
            lambda[second] = (at - bend * lambda[third]).max(0.0);
            lambda[first] = (1.0 - lambda[second] - lambda[third]).max(0.0);
            lambda
        }))
    }

    /// The triangle's point nearest to the place so far off one of its points, in texels.
    fn beside(&self, lambda: Vec3, offset: Vec2) -> Vec3 {
        let moved = lambda + self.steps[0] * offset.x + self.steps[1] * offset.y;
        if moved.min_element() >= 0.0 {
            return moved;
        }
        nearest_of_border(&self.corners, interpolate(self.corners, lambda) + offset).0
    }
}

/// Where a place lies along the side of a triangle that begins at that corner: 0..1.
fn share_along(corners: &[Vec2; 3], first: usize, place: Vec2) -> f32 {
    let side = corners[(first + 1) % 3] - corners[first];
    let squared = side.length_squared().max(f32::MIN_POSITIVE);
    ((place - corners[first]).dot(side) / squared).clamp(0.0, 1.0)
}

/// The radius of the largest circle inside a triangle.
fn inradius([a, b, c]: [Vec2; 3]) -> f32 {
    let perimeter = a.distance(b) + b.distance(c) + c.distance(a);
    (b - a).perp_dot(c - a).abs() / perimeter.max(f32::MIN_POSITIVE)
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
            let (level, offsets) =
                footprint.lookups(triangle_tiles.corners[slot].map(|p| p * Vec2::from(extent)));
            let tiles = maps.iter().map(|m| tiles.get(m.channel, TileId { group: index, level })).collect();
            SlotReader { tiles, offsets }
        });
        let has_normals = maps.iter().any(Map::has_normals);
        let frames = has_normals.then(|| frames.of_triangle(mesh, placed, footprint.steps));
        Self { surface, tiles: triangle_tiles, slots, footprint, frames }
    }

    /// The value of a map, which is the one of that index, at a point.
    fn value(&self, index: usize, map: &Map, lambda: Vec3) -> Vec4 {
        let frames = self.frames.as_ref().filter(|_| map.has_normals());
        let read = |lambda| match frames {
            Some(frames) => self.normal_in_mesh(index, lambda, frames.normal(lambda)).extend(0.0),
            None => self.tiles.taps(lambda).map(|tap| tap.weight * self.stored(&tap, index, lambda)).sum(),
        };
        let value: Vec4 = match self.footprint.spread(lambda) {
            Some(places) => places.into_iter().map(read).sum::<Vec4>() / places.len() as f32,
            None => read(lambda),
        };
        match frames {
            Some(frames) => frames.texel(value.truncate(), lambda),
            None => value / map.scale,
        }
    }

    /// A normal of the map of that index, of any length; `normal` is the vertices' one there.
    fn normal_in_mesh(&self, index: usize, lambda: Vec3, normal: Vec3) -> Vec3 {
        let in_mesh = |tap: Tap| {
            let group = &self.surface.cache.asset().cover().groups[tap.group as usize];
            let stored = self.stored(&tap, index, lambda);
            tap.weight * group.normal_from_stored(stored.truncate().truncate(), normal)
        };
        self.tiles.taps(lambda).map(in_mesh).sum()
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
        let width =
            |footprint: &Footprint, corners| footprint.lengths(corners).into_iter().fold(0.0, f32::max);
        assert!((width(&needle, tile(0.0)) - 1.0).abs() < 1e-5);
        // Rounded coordinates of a tile move the corner by a fraction of a texel, not by as many as a texel has needles side by side.
        assert!(width(&needle, tile(0.5)) < 1.01);
        let start = Vec3::new(0.5, 0.5, 0.0);
        for offset in QUARTERS {
            let place = interpolate(needle.corners, needle.beside(start, *offset));
            assert!((place.x - 15.0 - offset.x).abs() < 1e-3 && place.y.abs() < 0.06, "{place}");
        }
        let plain = Footprint::of([Vec2::ZERO, Vec2::new(8.0, 1.0), Vec2::new(2.0, 7.0)]);
        let shrunk = [Vec2::ZERO, Vec2::new(16.0, 2.0), Vec2::new(4.0, 14.0)];
        assert!((width(&plain, shrunk) - 2.0).abs() < 1e-5);
    }

    #[test]
    fn triangles_without_area_are_looked_up_all_over() {
        let is_inside =
            |lambda: Vec3| lambda.min_element() > 0.0 && (lambda.element_sum() - 1.0).abs() < 1e-6;
        let point = Footprint::of([Vec2::splat(7.5); 3]);
        let places = point.spread(Vec3::X).unwrap();
        assert!(places.iter().all(|&place| is_inside(place)), "{places:?}");
        let mean = places.iter().sum::<Vec3>() / places.len() as f32;
        assert!((mean - 1.0 / 3.0).abs().max_element() < 1e-6, "{mean}");
        // In the tile it has a circle with a radius of 200 texels inside.
        let tile = [Vec2::ZERO, Vec2::new(800.0, 0.0), Vec2::new(0.0, 600.0)];
        assert_eq!(point.lookups(tile), (5, MIDDLE));
        for (bend, level) in [(0.0, 5), (10.0, 5), (20.0, 4)] {
            let line = Footprint::of([Vec2::ZERO, Vec2::new(20.0, 0.0), Vec2::new(bend, 0.0)]);
            let places = line.spread(Vec3::new(0.25, 0.75, 0.0)).unwrap();
            let along = places.map(|place| interpolate(line.corners, place).x);
            assert!(along.iter().all(|x| (x - 15.0).abs() < 0.38), "{along:?}");
            assert!(places.iter().all(|&place| is_inside(place)), "{places:?}");
            assert!(places.iter().any(|place| place.z > 0.2), "{places:?}");
            assert_eq!(line.lookups(tile), (level, MIDDLE), "{bend}");
        }
    }
}
