//! Triangles made ready for the rasteriser, and their distribution over the picture's tiles.

use fantex_base::Result;
use fantex_base::input::{self, Held};
use fantex_mesh::Mesh;
use fantex_scene::Projection;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::raster::{NearnessPlane, SamplePattern, SamplesIn};
use crate::surface::{Coverage, Surface};

pub(crate) const TILE: u32 = 32;

/// Triangles per unit of parallel work, at least.
const MIN_CHUNK: usize = 16 * 1024;

/// A triangle on the screen: corners run clockwise (y down), the area is not zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Primitive {
    pub(crate) corners: [FixedPoint; 3],
    /// Nearness `1 / w` at the corners; linear over the screen.
    pub(crate) nearness: [f32; 3],
    pub(crate) triangle: u32,
    /// True where what lies behind may show through.
    pub(crate) layered: bool,
}

impl Primitive {
    /// Least and greatest coordinates of the corners.
    pub(crate) fn bounds(&self) -> [FixedPoint; 2] {
        let [a, b, c] = self.corners;
        let least = |i: usize| a[i].min(b[i]).min(c[i]);
        let greatest = |i: usize| a[i].max(b[i]).max(c[i]);
        [[least(0), least(1)], [greatest(0), greatest(1)]]
    }

    /// First and last pixel column and row (inclusive) that the corners' bounding box touches.
    pub(crate) fn pixel_bounds(&self) -> [[i32; 2]; 2] {
        let [[x0, y0], [x1, y1]] = self.bounds();
        let pixel = |c: i32| c.div_euclid(SUBPIXELS);
        [[pixel(x0), pixel(y0)], [pixel(x1), pixel(y1)]]
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct TileGrid {
    /// Picture width and height in pixels.
    pub(crate) size: [u32; 2],
}

impl TileGrid {
    pub(crate) fn columns(&self) -> u32 {
        self.size[0].div_ceil(TILE)
    }

    pub(crate) fn len(&self) -> usize {
        (self.columns() * self.size[1].div_ceil(TILE)) as usize
    }

    /// Triangles per unit of parallel work: so many that a chunk's tables of tiles are smaller than its primitives. The same on
    /// any number of threads.
    pub(crate) fn chunk_len(&self) -> usize {
        MIN_CHUNK.max(self.len())
    }

    pub(crate) fn rect(&self, tile: usize) -> [[u32; 2]; 2] {
        let origin = [tile as u32 % self.columns() * TILE, tile as u32 / self.columns() * TILE];
        [origin, [TILE.min(self.size[0] - origin[0]), TILE.min(self.size[1] - origin[1])]]
    }

    /// The tile that a pixel lies in and its place there; none outside the picture.
    fn place(&self, pixel: [i32; 2]) -> Option<Place> {
        let (x, y) = (pixel[0] as u32, pixel[1] as u32);
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
            first: [tile(low[0], 0), tile(low[1], 1)],
            end: [tile(high[0], 0) + 1, tile(high[1], 1) + 1],
            stride,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct TouchedTiles {
    /// Column and row of the first tile, and of the one after the last.
    first: [u32; 2],
    end: [u32; 2],
    /// Tiles in a row of the picture.
    stride: u32,
}

impl TouchedTiles {
    fn len(&self) -> usize {
        let length = |i: usize| (self.end[i] - self.first[i]) as usize;
        length(0) * length(1)
    }

    fn single(&self) -> Option<u32> {
        (self.len() == 1).then(|| self.first[1] * self.stride + self.first[0])
    }

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
    pub(crate) has_layers: bool,
}

impl Chunk {
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
    let chunk_len = grid.chunk_len();
    (0..mesh.triangles.len().div_ceil(chunk_len))
        .into_par_iter()
        .map(|chunk| {
            let range = chunk * chunk_len..mesh.triangles.len().min((chunk + 1) * chunk_len);
            let mut pieces = Pieces::default();
            range.for_each(|triangle| setup.add(triangle, &mut pieces));
            // It stays until the picture is there.
            pieces.primitives.shrink_to_fit();
            Chunk::of_pieces(pieces, grid)
        })
        .collect()
}

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

/// Memory that drawing takes for a triangle that is in the picture, bytes: half a vertex on the screen (as closed meshes have), a primitive in
/// a list that grows by doubling, and its number in a tile.
pub const DRAWN_TRIANGLE_BYTES: u64 =
    (size_of::<ScreenVertex>() / 2 + 2 * size_of::<Primitive>() + size_of::<u32>()) as u64;

/// Counts what drawing a mesh takes, as long as it is drawn.
///
/// # Errors
/// There is not enough memory left.
pub(crate) fn reserve_drawing(mesh: &Mesh) -> Result<Held> {
    let count = mesh.triangles.len() as u64;
    // Of the lists, those of a few thousand triangles grow at a time.
    let bytes = DRAWN_TRIANGLE_BYTES - size_of::<Primitive>() as u64;
    input::reserve(format_args!("a picture of {count} triangles"), bytes * count)
}

/// Points up to here need no clipping, in pixels from the picture's corner: well inside the guard band.
const PLAIN: f64 = 0.25 * GUARD_BAND;

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
        let [a, b, c] = self.mesh.triangles[triangle];
        let vertex = |v: u32| self.vertices[v as usize];
        let vertices = [vertex(a), vertex(b), vertex(c)];
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
        let [a, b, c] = vertices;
        let mut corners = [a.at, b.at, c.at];
        let mut nearness = [a.nearness, b.nearness, c.nearness];
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
                let [x, y] = self.pattern.offsets()[0];
                let position = [pixel[0] * SUBPIXELS + x, pixel[1] * SUBPIXELS + y];
                out.dots.extend(self.grid.place(pixel).and_then(|place| place.dot(&primitive, position)));
            }
            _ => out.primitives.push(primitive),
        }
    }
}

// Clipping against the near plane and the guard band.
//
// Triangles are not clipped at the picture's border (the tiles simply end there), only where the projection has no
// meaning (behind the near plane) or its numbers would overflow (outside the guard band). Each plane cuts an edge at a
// point computed from its inside to its outside end, so the two triangles of a shared edge get the same point.

/// A triangle clipped by five planes has at most eight corners.
const MAX_CORNERS: usize = 8;

/// A convex polygon in screen-homogeneous coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Polygon {
    corners: [DVec3; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    pub(crate) fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    fn empty() -> Self {
        Self { corners: [DVec3::ZERO; MAX_CORNERS], count: 0 }
    }

    fn push(&mut self, corner: DVec3) {
        self.corners[self.count] = corner;
        self.count += 1;
    }

    /// The part where `plane . h >= offset` (Sutherland and Hodgman 1974).
    pub(crate) fn clipped(&self, plane: DVec3, offset: f64) -> Self {
        let mut kept = Self::empty();
        let corners = self.corners();
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            let (da, db) = (plane.dot(a) - offset, plane.dot(b) - offset);
            if da >= 0.0 {
                kept.push(a);
            }
            if (da >= 0.0) != (db >= 0.0) {
                let (inside, outside, d_in, d_out) = if da >= 0.0 { (a, b, da, db) } else { (b, a, db, da) };
                kept.push(inside + (outside - inside) * (d_in / (d_in - d_out)));
            }
        }
        kept
    }
}

/// The part of a triangle in front of the near plane and inside the guard band. `near` is a depth, mesh units.
/// Has fewer than three corners where nothing is left.
pub(crate) fn clip(triangle: [DVec3; 3], near: f64) -> Polygon {
    let mut polygon = Polygon::empty();
    triangle.into_iter().for_each(|h| polygon.push(h));
    if triangle.iter().any(|h| !h.is_finite()) {
        return Polygon::empty();
    }
    if triangle.iter().any(|h| h.z < near) {
        polygon = polygon.clipped(DVec3::Z, near);
    }
    if polygon.corners().iter().any(|h| h.x.abs().max(h.y.abs()) > GUARD_BAND * h.z) {
        for side in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y] {
            polygon = polygon.clipped(side + DVec3::Z * GUARD_BAND, 0.0);
        }
    }
    polygon
}

pub(crate) fn screen(h: DVec3) -> DVec2 {
    h.truncate() / h.z
}

// Fixed-point screen coordinates and edge functions.
//
// Screen positions are rounded to 1/256 of a pixel and all coverage decisions are made in integers, so two triangles
// that share an edge decide about each sample with the same numbers: exactly one of them owns it.

/// Sub-pixel steps per pixel (24.8 fixed point).
pub(crate) const SUBPIXELS: i32 = 256;

/// Largest distance from the screen's origin, in pixels, that the clipper lets through. With 8 fractional bits the
/// coordinates stay below 2^24 and the edge functions below 2^51: no overflow in 64 bits.
const GUARD_BAND: f64 = 65536.0;

/// A screen position in 1/256 pixel, x to the right, y downwards.
pub(crate) type FixedPoint = [i32; 2];

/// Rounds a screen position in pixels. Positions are within the guard band (plus rounding of the clipper).
pub(crate) fn snap(screen: DVec2) -> FixedPoint {
    let limit = GUARD_BAND + 1.0;
    // Half up, by truncation of a number that is never negative (rounding is a library call without SSE4.1).
    let origin = 1 << 25;
    let fixed =
        |c: f64| (c.clamp(-limit, limit) * f64::from(SUBPIXELS) + (f64::from(origin) + 0.5)) as i32 - origin;
    [fixed(screen.x), fixed(screen.y)]
}

/// Twice the signed area: positive where the corners run clockwise on the screen (y down).
pub(crate) fn doubled_area(v: &[FixedPoint; 3]) -> i64 {
    let [a, b, c] = v;
    let along = |p: &FixedPoint, i: usize| i64::from(p[i]) - i64::from(a[i]);
    along(b, 0) * along(c, 1) - along(b, 1) * along(c, 0)
}

/// `value = dx * x + dy * y + constant` over fixed-point positions: not negative exactly on the samples that the edge
/// claims for its triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    pub(crate) dx: i64,
    pub(crate) dy: i64,
    constant: i64,
}

impl Edge {
    /// The edge from `a` to `b` of a triangle that runs clockwise on the screen. A sample exactly on the edge belongs
    /// to the triangle if the edge is its top edge or one of its left edges.
    pub(crate) fn new(a: FixedPoint, b: FixedPoint) -> Self {
        let (ax, ay) = (i64::from(a[0]), i64::from(a[1]));
        let (bx, by) = (i64::from(b[0]), i64::from(b[1]));
        let (dx, dy) = (ay - by, bx - ax);
        let is_top = ay == by && bx > ax;
        let is_left = by < ay;
        let bias = if is_top || is_left { 0 } else { -1 };
        Self { dx, dy, constant: bias - dx * ax - dy * ay }
    }

    pub(crate) fn at(&self, x: i64, y: i64) -> i64 {
        self.dx * x + self.dy * y + self.constant
    }
}

// Triangles so small that one sample alone may see them.
//
// With one sample per pixel, triangles of about a pixel hold one sample at most in their bounding box. Whether it lies in the
// triangle is decided when the triangle is set up, and what is left of the triangle then is a dot: a third as large as
// a primitive, and nothing is worked out for it a second time when its tile is drawn.

/// What one sample sees of a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Dot {
    /// Pixel index in the tile, row-major with stride [`TILE`](crate::primitive::TILE).
    pub(crate) pixel: u32,
    /// The mesh's triangle.
    pub(crate) triangle: u32,
    pub(crate) nearness: f32,
}

#[derive(Clone, Copy, Debug)]
struct Place {
    tile: u32,
    /// Its index in the tile.
    pixel: u32,
}

/// A dot and the tile that it lies in.
type PlacedDot = (u32, Dot);

impl Place {
    /// What this pixel's sample, which lies at `position`, sees of a primitive.
    pub(crate) fn dot(self, primitive: &Primitive, position: FixedPoint) -> Option<PlacedDot> {
        let [a, b, c] = primitive.corners;
        let (x, y) = (i64::from(position[0]), i64::from(position[1]));
        let (ab, bc, ca) = (Edge::new(a, b).at(x, y), Edge::new(b, c).at(x, y), Edge::new(c, a).at(x, y));
        // Covered where no sign bit is set.
        (ab | bc | ca >= 0).then(|| {
            let nearness = NearnessPlane::new(primitive).at(position);
            (self.tile, Dot { pixel: self.pixel, triangle: primitive.triangle, nearness })
        })
    }
}

/// Dots by tiles.
#[derive(Debug, Default)]
struct Dots {
    /// Tile `t` owns `dots[starts[t]..starts[t + 1]]`; empty without dots.
    starts: Vec<u32>,
    dots: Vec<Dot>,
}

impl Dots {
    /// Sorts dots into so many tiles.
    pub(crate) fn new(placed: &[PlacedDot], tiles: usize) -> Self {
        if placed.is_empty() {
            return Self::default();
        }
        let mut starts = vec![0; tiles + 1];
        placed.iter().for_each(|(tile, _)| starts[*tile as usize + 1] += 1);
        for tile in 0..tiles {
            starts[tile + 1] += starts[tile];
        }
        let mut next = starts.clone();
        let mut dots = vec![Dot::default(); placed.len()];
        for &(tile, dot) in placed {
            let place = &mut next[tile as usize];
            dots[*place as usize] = dot;
            *place += 1;
        }
        Self { starts, dots }
    }

    pub(crate) fn in_tile(&self, tile: usize) -> &[Dot] {
        match self.starts[..] {
            [] => &[],
            _ => &self.dots[self.starts[tile] as usize..self.starts[tile + 1] as usize],
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
    fn tables_of_tiles_take_less_than_primitives() {
        for side in [1, 100, 1280, 16_384] {
            let grid = TileGrid { size: [side; 2] };
            // Starts of primitives and of dots, and the copies that are there while they are sorted.
            let tables = 4 * size_of::<u32>() * (grid.len() + 1);
            assert!(tables < grid.chunk_len() * size_of::<Primitive>(), "{side}");
        }
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

    #[test]
    fn what_lies_in_front_is_untouched() {
        let triangle = [DVec3::new(1.0, 2.0, 1.0), DVec3::new(9.0, 2.0, 3.0), DVec3::new(1.0, 7.0, 2.0)];
        assert_eq!(clip(triangle, 0.5).corners(), triangle);
    }

    #[test]
    fn shared_edges_are_cut_at_the_same_points() {
        let (a, b) = (DVec3::new(3.0, 4.0, 5.0), DVec3::new(-1e7, 2e6, -3.0));
        let one = clip([a, b, DVec3::new(10.0, 10.0, 4.0)], 0.01);
        let two = clip([b, a, DVec3::new(-10.0, -10.0, 4.0)], 0.01);
        let shared = one.corners().iter().filter(|p| two.corners().contains(p)).count();
        assert!(shared >= 2, "{one:?}\n{two:?}");
    }

    #[test]
    fn everything_left_is_inside() {
        let triangle = [DVec3::new(3.0, 5.0, 1.0), DVec3::new(-1e9, 3.0, 2.0), DVec3::new(5.0, 1e9, -4.0)];
        let polygon = clip(triangle, 0.1);
        assert!(polygon.corners().len() >= 3);
        for h in polygon.corners() {
            let reach = screen(*h).abs().max_element();
            assert!(h.z >= 0.099 && reach <= GUARD_BAND + 1.0, "{h} at {reach}");
        }
    }

    #[test]
    fn what_lies_behind_or_is_not_finite_vanishes() {
        let behind = [DVec3::new(0.0, 0.0, -1.0), DVec3::new(1.0, 0.0, -2.0), DVec3::new(0.0, 1.0, 0.0)];
        assert!(clip(behind, 0.1).corners().len() < 3);
        let broken = [DVec3::new(f64::NAN, 0.0, 1.0), DVec3::new(1.0, 0.0, 2.0), DVec3::new(0.0, 1.0, 1.0)];
        assert!(clip(broken, 0.1).corners().is_empty());
    }

    #[test]
    fn an_edge_and_its_reverse_split_the_plane() {
        let points = [[0, 0], [300, 10], [-40, 256], [256, 0], [0, 256], [777, -513]];
        for a in points {
            for b in points {
                if a == b {
                    continue;
                }
                let (there, back) = (Edge::new(a, b), Edge::new(b, a));
                for x in (-600..900).step_by(31) {
                    for y in (-600..600).step_by(29) {
                        assert!((there.at(x, y) >= 0) != (back.at(x, y) >= 0), "{a:?}-{b:?} at {x},{y}");
                    }
                }
            }
        }
    }

    #[test]
    fn top_left_samples_belong_and_bottom_right_ones_do_not() {
        // A square of one pixel, as two clockwise triangles: exactly its top left corner is inside.
        let (o, x, xy, y) = ([0, 0], [256, 0], [256, 256], [0, 256]);
        let inside = |t: [FixedPoint; 3], p: [i64; 2]| {
            assert!(doubled_area(&t) > 0);
            (0..3).all(|i| Edge::new(t[i], t[(i + 1) % 3]).at(p[0], p[1]) >= 0)
        };
        let hits = |p| [[o, x, xy], [o, xy, y]].iter().filter(|t| inside(**t, p)).count();
        assert_eq!(hits([0, 0]), 1);
        assert_eq!(hits([256, 0]), 0);
        assert_eq!(hits([0, 256]), 0);
        assert_eq!(hits([128, 128]), 1);
        assert_eq!(hits([0, 128]), 1);
        assert_eq!(hits([128, 0]), 1);
        assert_eq!(hits([256, 128]), 0);
    }

    #[test]
    fn every_tile_has_its_own_dots_in_order() {
        let dot = |triangle| Dot { pixel: 7, triangle, nearness: 1.0 };
        let placed = [(2, dot(0)), (0, dot(1)), (2, dot(2)), (3, dot(3)), (0, dot(4))];
        let dots = Dots::new(&placed, 5);
        let triangles = |tile| dots.in_tile(tile).iter().map(|d| d.triangle).collect::<Vec<_>>();
        assert_eq!(
            (0..5).map(triangles).collect::<Vec<_>>(),
            [vec![1, 4], vec![], vec![0, 2], vec![3], vec![]]
        );
        assert!(Dots::new(&[], 5).in_tile(4).is_empty());
    }

    #[test]
    fn a_dot_is_seen_where_the_triangle_covers_the_sample() {
        let primitive = Primitive {
            corners: [[100, 100], [300, 100], [100, 300]],
            nearness: [1.0, 2.0, 3.0],
            triangle: 5,
            layered: false,
        };
        let place = Place { tile: 3, pixel: 9 };
        let (tile, dot) = place.dot(&primitive, [200, 150]).unwrap();
        assert_eq!((tile, dot.pixel, dot.triangle), (3, 9, 5));
        assert!((dot.nearness - 2.0).abs() < 1e-6, "{dot:?}");
        assert_eq!(place.dot(&primitive, [250, 260]), None);
    }
}
