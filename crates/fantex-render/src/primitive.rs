//! Triangles made ready for the rasteriser, and their distribution over the picture's tiles.

use fantex_mesh::Mesh;
use glam::DVec3;
use rayon::prelude::*;

use crate::clip::{clip, screen};
use crate::dots::{Dot, Dots, Place, PlacedDot};
use crate::fixed::{FixedPoint, GUARD_BAND, SUBPIXELS, doubled_area, snap};
use crate::pattern::{SamplePattern, SamplesIn};
use crate::surface::{Coverage, Surface};
use fantex_scene::Projection;

/// Side of a tile in pixels.
pub(crate) const TILE: u32 = 32;

/// Triangles per unit of parallel work. Fixed, so that the work is cut the same way on any number of threads.
pub(crate) const CHUNK: usize = 16 * 1024;

/// A triangle on the screen: corners run clockwise (y down), the area is not zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Primitive {
    /// Corner positions.
    pub(crate) corners: [FixedPoint; 3],
    /// Nearness `1 / w` at the corners; linear over the screen.
    pub(crate) nearness: [f32; 3],
    /// The mesh's triangle.
    pub(crate) triangle: u32,
    /// True where what lies behind may show through.
    pub(crate) layered: bool,
}

impl Primitive {
    /// Least and greatest coordinates of the corners.
    pub(crate) fn bounds(&self) -> [FixedPoint; 2] {
        let [a, b, c] = self.corners;
        [[0, 1].map(|i| a[i].min(b[i]).min(c[i])), [0, 1].map(|i| a[i].max(b[i]).max(c[i]))]
    }

    /// First and last pixel column and row (inclusive) that the corners' bounding box touches.
    pub(crate) fn pixel_bounds(&self) -> [[i32; 2]; 2] {
        self.bounds().map(|corner| corner.map(|c| c.div_euclid(SUBPIXELS)))
    }
}

/// The picture's division into tiles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileGrid {
    /// Picture width and height in pixels.
    pub(crate) size: [u32; 2],
}

impl TileGrid {
    /// Tiles in a row.
    pub(crate) fn columns(&self) -> u32 {
        self.size[0].div_ceil(TILE)
    }

    /// Number of tiles.
    pub(crate) fn len(&self) -> usize {
        (self.columns() * self.size[1].div_ceil(TILE)) as usize
    }

    /// First pixel and extent of a tile.
    pub(crate) fn rect(&self, tile: usize) -> [[u32; 2]; 2] {
        let origin = [tile as u32 % self.columns() * TILE, tile as u32 / self.columns() * TILE];
        [origin, [0, 1].map(|i| TILE.min(self.size[i] - origin[i]))]
    }

    /// The tile that a pixel lies in and its place there; none outside the picture.
    fn place(&self, pixel: [i32; 2]) -> Option<Place> {
        let [x, y] = pixel.map(|c| c as u32);
        // Negative numbers are too large ones.
        let is_inside = x < self.size[0] && y < self.size[1];
        is_inside
            .then(|| Place { tile: y / TILE * self.columns() + x / TILE, pixel: y % TILE * TILE + x % TILE })
    }

    /// The tiles that a box of pixels touches.
    fn touched(&self, [low, high]: [[i32; 2]; 2]) -> TouchedTiles {
        let stride = self.columns();
        if (0..2).any(|i| high[i] < 0 || low[i] >= self.size[i] as i32) {
            return TouchedTiles { first: [0; 2], end: [0; 2], stride };
        }
        let tile = |c: i32, axis: usize| c.clamp(0, self.size[axis] as i32 - 1) as u32 / TILE;
        TouchedTiles {
            first: [0, 1].map(|i| tile(low[i], i)),
            end: [0, 1].map(|i| tile(high[i], i) + 1),
            stride,
        }
    }
}

/// A rectangle of tiles.
#[derive(Clone, Copy, Debug)]
struct TouchedTiles {
    /// Column and row of the first tile, and of the one after the last.
    first: [u32; 2],
    end: [u32; 2],
    /// Tiles in a row of the picture.
    stride: u32,
}

impl TouchedTiles {
    /// Number of tiles.
    fn len(&self) -> usize {
        [0, 1].map(|i| (self.end[i] - self.first[i]) as usize).iter().product()
    }

    /// The tile's number, if it is only one.
    fn single(&self) -> Option<u32> {
        (self.len() == 1).then(|| self.first[1] * self.stride + self.first[0])
    }

    /// Visits the tiles' numbers, ascending.
    fn for_each(&self, mut visit: impl FnMut(usize)) {
        for row in self.first[1]..self.end[1] {
            for column in self.first[0]..self.end[0] {
                visit((row * self.stride + column) as usize);
            }
        }
    }
}

/// Primitives that touch more tiles than this are not entered into each of them.
const MANY_TILES: usize = 64;

/// No tile's number: of primitives that touch several tiles, or none.
const SEVERAL: u32 = u32::MAX;

/// Primitives of one run of the mesh's triangles and, per tile, which of them touch it.
#[derive(Debug)]
pub(crate) struct Chunk {
    primitives: Vec<Primitive>,
    /// Tile `t` owns `entries[starts[t]..starts[t + 1]]`.
    starts: Vec<u32>,
    entries: Vec<u32>,
    /// Primitives that touch many tiles.
    large: Vec<u32>,
    dots: Dots,
    /// Whether any primitive is layered.
    pub(crate) has_layers: bool,
}

impl Chunk {
    /// The primitives that may touch a tile.
    pub(crate) fn in_tile(&self, grid: &TileGrid, tile: usize) -> impl Iterator<Item = &Primitive> {
        let range = self.starts[tile] as usize..self.starts[tile + 1] as usize;
        let [origin, extent] = grid.rect(tile);
        let overlaps = move |p: &&Primitive| {
            let [low, high] = p.pixel_bounds();
            (0..2).all(|i| high[i] >= origin[i] as i32 && low[i] < (origin[i] + extent[i]) as i32)
        };
        let large = self.large.iter().map(|&i| &self.primitives[i as usize]).filter(overlaps);
        large.chain(self.entries[range].iter().map(|&i| &self.primitives[i as usize]))
    }

    /// The triangles that were seen by one sample of a tile.
    pub(crate) fn dots_in_tile(&self, tile: usize) -> &[Dot] {
        self.dots.in_tile(tile)
    }

    /// Bins primitives.
    pub(crate) fn new(primitives: Vec<Primitive>, grid: &TileGrid) -> Self {
        Self::of_pieces(Pieces { primitives, dots: Vec::new() }, grid)
    }

    fn of_pieces(Pieces { primitives, dots }: Pieces, grid: &TileGrid) -> Self {
        let dots = Dots::new(&dots, grid.len());
        // Counting sort by tile; most primitives touch a single one.
        let mut starts = vec![0; grid.len() + 1];
        let mut single = Vec::with_capacity(primitives.len());
        let mut large = Vec::new();
        for (index, primitive) in primitives.iter().enumerate() {
            let tiles = grid.touched(primitive.pixel_bounds());
            single.push(tiles.single().unwrap_or(SEVERAL));
            if tiles.len() > MANY_TILES {
                large.push(index as u32);
            } else {
                tiles.for_each(|tile| starts[tile + 1] += 1);
            }
        }
        for tile in 0..grid.len() {
            starts[tile + 1] += starts[tile];
        }
        let mut next = starts.clone();
        let mut entries = vec![0; starts[grid.len()] as usize];
        let mut enter = |index: usize, tile: usize| {
            entries[next[tile] as usize] = index as u32;
            next[tile] += 1;
        };
        for (index, primitive) in primitives.iter().enumerate() {
            if single[index] != SEVERAL {
                enter(index, single[index] as usize);
                continue;
            }
            let tiles = grid.touched(primitive.pixel_bounds());
            if tiles.len() <= MANY_TILES {
                tiles.for_each(|tile| enter(index, tile));
            }
        }
        let has_layers = primitives.iter().any(|primitive| primitive.layered);
        Self { primitives, starts, entries, large, dots, has_layers }
    }
}

/// Projects, clips, culls and bins the mesh's triangles.
pub(crate) fn prepare(
    mesh: &Mesh,
    surface: &dyn Surface,
    projection: &Projection,
    grid: &TileGrid,
    pattern: &SamplePattern,
) -> Vec<Chunk> {
    let vertices: Vec<ScreenVertex> = mesh
        .positions
        .par_iter()
        .map(|&p| ScreenVertex::new(projection.project(p), projection.near))
        .collect();
    let setup = Setup { mesh, vertices: &vertices, surface, projection, grid, pattern };
    (0..mesh.triangles.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let range = chunk * CHUNK..mesh.triangles.len().min((chunk + 1) * CHUNK);
            let mut pieces = Pieces::default();
            range.for_each(|triangle| setup.add(triangle, &mut pieces));
            Chunk::of_pieces(pieces, grid)
        })
        .collect()
}

/// A projected point.
#[derive(Clone, Copy, Debug)]
struct ScreenVertex {
    /// Its place on the screen; without meaning where `nearness` is 0.
    at: FixedPoint,
    /// `1 / w`; 0 for points behind the near plane or far outside, whose triangles must be clipped.
    nearness: f32,
}

impl ScreenVertex {
    fn new(h: DVec3, near: f64) -> Self {
        if h.z >= near && h.x.abs().max(h.y.abs()) <= PLAIN * h.z {
            Self { at: snap(screen(h)), nearness: (1.0 / h.z) as f32 }
        } else {
            Self { at: [0; 2], nearness: 0.0 }
        }
    }
}

/// Points up to here need no clipping, in pixels from the picture's corner: well inside the guard band.
const PLAIN: f64 = 0.25 * GUARD_BAND;

/// What is visible of the triangles of a chunk.
#[derive(Default)]
struct Pieces {
    primitives: Vec<Primitive>,
    /// Those that one sample may see, seen by it.
    dots: Vec<PlacedDot>,
}

struct Setup<'a> {
    mesh: &'a Mesh,
    vertices: &'a [ScreenVertex],
    surface: &'a dyn Surface,
    projection: &'a Projection,
    grid: &'a TileGrid,
    pattern: &'a SamplePattern,
}

impl Setup<'_> {
    /// Appends what is visible of a triangle, as a fan of its clipped polygon.
    fn add(&self, triangle: usize, out: &mut Pieces) {
        let vertices = self.mesh.triangles[triangle].map(|v| self.vertices[v as usize]);
        if vertices.iter().all(|v| v.nearness > 0.0) {
            self.add_piece(triangle, vertices, out);
            return;
        }
        let corners = self.mesh.triangle_positions(triangle).map(|p| self.projection.project(p));
        let polygon = clip(corners, self.projection.near);
        let vertex = |h: DVec3| ScreenVertex { at: snap(screen(h)), nearness: (1.0 / h.z) as f32 };
        for pair in polygon.corners().get(1..).unwrap_or(&[]).windows(2) {
            self.add_piece(triangle, [polygon.corners()[0], pair[0], pair[1]].map(vertex), out);
        }
    }

    fn add_piece(&self, triangle: usize, vertices: [ScreenVertex; 3], out: &mut Pieces) {
        let mut corners = vertices.map(|v| v.at);
        let mut nearness = vertices.map(|v| v.nearness);
        let area = doubled_area(&corners);
        // Counter-clockwise in space is counter-clockwise to the eye, too: negative with y down.
        let front = area < 0;
        if area == 0 || !(front || self.surface.is_double_sided(triangle)) {
            return;
        }
        if front {
            corners.swap(1, 2);
            nearness.swap(1, 2);
        }
        let mut primitive = Primitive { corners, nearness, triangle: triangle as u32, layered: false };
        let [low, high] = primitive.bounds();
        let outside = (0..2).any(|i| high[i] < 0 || low[i] >= self.grid.size[i] as i32 * SUBPIXELS);
        if outside {
            return;
        }
        let inside = self.pattern.samples_in(low, high);
        if inside == SamplesIn::None {
            return;
        }
        primitive.layered = self.surface.coverage(triangle) == Coverage::Layered;
        match inside {
            SamplesIn::One(pixel) if !primitive.layered => {
                let position = [0, 1].map(|i| pixel[i] * SUBPIXELS + self.pattern.offsets()[0][i]);
                out.dots.extend(self.grid.place(pixel).and_then(|place| place.dot(&primitive, position)));
            }
            _ => out.primitives.push(primitive),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_picture_once() {
        let grid = TileGrid { size: [100, 37] };
        let pixels: u32 = (0..grid.len()).map(|t| grid.rect(t)[1]).map(|[w, h]| w * h).sum();
        assert_eq!(pixels, 100 * 37);
        assert_eq!(grid.rect(grid.len() - 1), [[96, 32], [4, 5]]);
    }

    #[test]
    fn boxes_touch_the_tiles_they_overlap() {
        let grid = TileGrid { size: [100, 37] };
        let touched = |b| {
            let mut tiles = Vec::new();
            grid.touched(b).for_each(|tile| tiles.push(tile));
            assert_eq!(tiles.len(), grid.touched(b).len());
            tiles
        };
        assert!(touched([[-5, -5], [-1, 10]]).is_empty());
        assert_eq!(touched([[31, 0], [32, 31]]), [0, 1]);
        assert_eq!(touched([[-9, -9], [900, 900]]), (0..8).collect::<Vec<_>>());
        assert!(touched([[100, 0], [101, 5]]).is_empty());
    }
}
