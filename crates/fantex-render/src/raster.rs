//! Coverage and visibility of one tile: which triangle is seen by which sample.
//!
//! Opaque triangles compete in a visibility buffer of one (nearness, triangle) pair per sample. Triangles that let
//! something through become fragments where nothing opaque hides them. However many layers there are, fragments take little
//! memory: where they are many, they are made and composited for one part of the tile after the other.

use fantex_base::bits;
use glam::Vec2;

use crate::primitive::{Dot, Edge, FixedPoint, Primitive, SUBPIXELS, TILE};

/// No triangle: the background.
pub(crate) const NO_TRIANGLE: u32 = u32::MAX;

/// Side of the blocks that are rejected as a whole.
const BLOCK: i32 = 8;

/// Nearness over the screen, relative to the primitive's first corner to keep its digits, held between the corners'
/// values so that slivers cannot extrapolate through others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearnessPlane {
    origin: [i32; 2],
    value: f64,
    slope: [f64; 2],
    low: f64,
    high: f64,
}

impl NearnessPlane {
    pub(crate) fn new(p: &Primitive) -> Self {
        let [a, b, c] = p.corners;
        let [na, nb, nc] = p.nearness;
        let (na, nb, nc) = (f64::from(na), f64::from(nb), f64::from(nc));
        let (bx, by) = (f64::from(b[0] - a[0]), f64::from(b[1] - a[1]));
        let (cx, cy) = (f64::from(c[0] - a[0]), f64::from(c[1] - a[1]));
        let inverse = 1.0 / (bx * cy - by * cx);
        let slope =
            [((nb - na) * cy - (nc - na) * by) * inverse, ((nc - na) * bx - (nb - na) * cx) * inverse];
        Self { origin: a, value: na, slope, low: na.min(nb).min(nc), high: na.max(nb).max(nc) }
    }

    #[inline]
    pub(crate) fn at(&self, [x, y]: [i32; 2]) -> f32 {
        let (dx, dy) = (f64::from(x - self.origin[0]), f64::from(y - self.origin[1]));
        (self.value + self.slope[0] * dx + self.slope[1] * dy).clamp(self.low, self.high) as f32
    }
}

/// A piece of a layered triangle in one pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Pixel index in the tile, row-major with stride [`TILE`].
    pub(crate) pixel: u32,
    pub(crate) triangle: u32,
    /// Samples that it covers and that nothing opaque hides.
    pub(crate) mask: u64,
    /// Its nearness, for the order of the layers.
    pub(crate) nearness: NearnessPlane,
}

#[derive(Debug)]
pub(crate) struct TileSamples<'a> {
    pattern: &'a SamplePattern,
    /// First pixel of the tile and its extent in pixels.
    rect: [[u32; 2]; 2],
    /// Per pixel and sample: nearness and triangle.
    nearness: Vec<f32>,
    triangles: Vec<u32>,
}

/// Most pieces of layered triangles that are composited together; more only where they lie in one pixel.
pub(crate) const MAX_LAYERED: usize = 16 * 1024;

impl<'a> TileSamples<'a> {
    /// An empty tile. `rect` is its first pixel and its extent, at most [`TILE`] each.
    pub(crate) fn new(pattern: &'a SamplePattern, rect: [[u32; 2]; 2]) -> Self {
        let count = (TILE * TILE) as usize * pattern.len();
        Self { pattern, rect, nearness: vec![0.0; count], triangles: vec![NO_TRIANGLE; count] }
    }

    #[inline]
    pub(crate) fn visible(&self, pixel: u32) -> &[u32] {
        let n = self.pattern.len();
        &self.triangles[pixel as usize * n..][..n]
    }

    /// Enters an opaque triangle. Of equally near ones the first of the mesh is seen, whatever the order of entry.
    pub(crate) fn add_opaque(&mut self, primitive: &Primitive) {
        let (pattern, rect) = (self.pattern, self.rect);
        // Most small triangles lie between the samples.
        let mut plane = None;
        for_each_covered(primitive, rect[0], rect, pattern, |pixel, corner, mask| {
            let base = pixel as usize * pattern.len();
            let plane = *plane.get_or_insert_with(|| NearnessPlane::new(primitive));
            for s in bits(mask) {
                let nearness = plane.at(offset(corner, pattern.offsets()[s]));
                self.see(base + s, nearness, primitive.triangle);
            }
        });
    }

    /// Enters what one sample per pixel sees of an opaque triangle; as [`TileSamples::add_opaque`].
    pub(crate) fn add_dot(&mut self, dot: &Dot) {
        self.see(dot.pixel as usize, dot.nearness, dot.triangle);
    }

    #[inline]
    fn see(&mut self, sample: usize, nearness: f32, triangle: u32) {
        let (nearest, seen) = (&mut self.nearness[sample], &mut self.triangles[sample]);
        if nearness > *nearest || (nearness == *nearest && triangle < *seen) {
            (*nearest, *seen) = (nearness, triangle);
        }
    }

    /// Calls `visit` with parts of the tile (first pixel and extent) that together are the tile, and with the fragments of layered
    /// triangles there, ordered by pixel and then as the mesh's triangles are. To be called after all opaque triangles are
    /// entered. `layered` lists the layered ones, and does so again for every part; there are several only where layers are many:
    /// the sum of a part's `weight`s exceeds `most` in single pixels only.
    pub(crate) fn for_each_part<'p, I: Iterator<Item = &'p Primitive>>(
        &self,
        layered: impl Fn() -> I,
        weight: impl Fn(&Fragment) -> usize,
        most: usize,
        mut visit: impl FnMut([[u32; 2]; 2], &[Fragment]),
    ) {
        let (mut parts, mut fragments) = (vec![self.rect], Vec::new());
        while let Some(part) = parts.pop() {
            fragments.clear();
            let halves = halves(part);
            let most = if halves.is_some() { most } else { usize::MAX };
            if !self.add_all(layered(), part, &weight, most, &mut fragments) {
                parts.extend(halves.into_iter().flatten());
                continue;
            }
            fragments.sort_by_key(|f| (f.pixel, f.triangle));
            visit(part, &fragments);
        }
    }

    /// Whether the fragments of all triangles in a part weigh `most` or less; otherwise some are missing.
    fn add_all<'p>(
        &self,
        layered: impl Iterator<Item = &'p Primitive>,
        part: [[u32; 2]; 2],
        weight: impl Fn(&Fragment) -> usize,
        most: usize,
        fragments: &mut Vec<Fragment>,
    ) -> bool {
        let mut total = 0;
        for primitive in layered {
            let first = fragments.len();
            self.add_layered(primitive, part, fragments);
            total += fragments[first..].iter().map(&weight).sum::<usize>();
            if total > most {
                return false;
            }
        }
        true
    }

    /// Appends the fragments of a layered triangle in a part of the tile.
    fn add_layered(&self, primitive: &Primitive, part: [[u32; 2]; 2], fragments: &mut Vec<Fragment>) {
        let pattern = self.pattern;
        let nearness = NearnessPlane::new(primitive);
        for_each_covered(primitive, self.rect[0], part, pattern, |pixel, corner, mask| {
            let base = pixel as usize * pattern.len();
            let in_front =
                |s: &usize| nearness.at(offset(corner, pattern.offsets()[*s])) > self.nearness[base + s];
            let mask = bits(mask).filter(in_front).fold(0, |m, s| m | 1 << s);
            if mask != 0 {
                fragments.push(Fragment { pixel, triangle: primitive.triangle, mask, nearness });
            }
        });
    }

    /// The nearness that each sample sees, zero for the background: per pixel with stride [`TILE`], then per sample.
    pub(crate) fn nearness(&self) -> &[f32] {
        &self.nearness
    }
}

/// The halves of a rectangle of pixels, across its longer side; none of a single pixel.
fn halves([first, extent]: [[u32; 2]; 2]) -> Option<[[[u32; 2]; 2]; 2]> {
    let axis = usize::from(extent[1] >= extent[0]);
    if extent[axis] < 2 {
        return None;
    }
    let (mut low, mut high, mut middle) = (extent, extent, first);
    low[axis] = extent[axis] / 2;
    high[axis] -= low[axis];
    middle[axis] += low[axis];
    Some([[first, low], [middle, high]])
}

fn offset(corner: [i32; 2], by: [i32; 2]) -> [i32; 2] {
    [corner[0] + by[0], corner[1] + by[1]]
}

/// Calls `visit(pixel, corner, mask)` for every pixel with covered samples in a part of the tile that begins at `origin`: its
/// index in the tile, its top left corner in fixed point, and the samples.
fn for_each_covered(
    primitive: &Primitive,
    origin: [u32; 2],
    [start, extent]: [[u32; 2]; 2],
    pattern: &SamplePattern,
    mut visit: impl FnMut(u32, [i32; 2], u64),
) {
    if let [offset] = pattern.offsets() {
        return for_each_covered_once(primitive, origin, [start, extent], *offset, visit);
    }
    let [low, high] = primitive.pixel_bounds();
    let first = [low[0].max(start[0] as i32), low[1].max(start[1] as i32)];
    let last = |i: usize| high[i].min((start[i] + extent[i]) as i32 - 1);
    let last = [last(0), last(1)];
    let [a, b, c] = primitive.corners;
    let coverage = PixelCoverage::new([Edge::new(a, b), Edge::new(b, c), Edge::new(c, a)], pattern);
    for block_y in (first[1]..=last[1]).step_by(BLOCK as usize) {
        for block_x in (first[0]..=last[0]).step_by(BLOCK as usize) {
            let end = [(block_x + BLOCK - 1).min(last[0]), (block_y + BLOCK - 1).min(last[1])];
            if coverage.misses_block([block_x, block_y], end) {
                continue;
            }
            for y in block_y..=end[1] {
                for x in block_x..=end[0] {
                    let corner = [x * SUBPIXELS, y * SUBPIXELS];
                    let mask = coverage.mask(corner);
                    if mask != 0 {
                        visit(
                            (y - origin[1] as i32) as u32 * TILE + (x - origin[0] as i32) as u32,
                            corner,
                            mask,
                        );
                    }
                }
            }
        }
    }
}

/// As [`for_each_covered`] with one sample per pixel: only pixels whose sample lies in the triangle's bounding box are looked at,
/// which of a small triangle's are none or one.
fn for_each_covered_once(
    primitive: &Primitive,
    origin: [u32; 2],
    [start, extent]: [[u32; 2]; 2],
    offset: [i32; 2],
    mut visit: impl FnMut(u32, [i32; 2], u64),
) {
    let [low, high] = primitive.bounds();
    let first = |i: usize| ((low[i] - offset[i] - 1).div_euclid(SUBPIXELS) + 1).max(start[i] as i32);
    let last = |i: usize| (high[i] - offset[i]).div_euclid(SUBPIXELS).min((start[i] + extent[i]) as i32 - 1);
    let (first, last) = ([first(0), first(1)], [last(0), last(1)]);
    if first[0] > last[0] || first[1] > last[1] {
        return;
    }
    let [a, b, c] = primitive.corners;
    let edges = [Edge::new(a, b), Edge::new(b, c), Edge::new(c, a)];
    let step = i64::from(SUBPIXELS);
    let right = [edges[0].dx * step, edges[1].dx * step, edges[2].dx * step];
    let down = [edges[0].dy * step, edges[1].dy * step, edges[2].dy * step];
    let moved = |[a, b, c]: [i64; 3], [x, y, z]: [i64; 3]| [a + x, b + y, c + z];
    let sample = |i: usize| i64::from(first[i] * SUBPIXELS + offset[i]);
    let (x, y) = (sample(0), sample(1));
    let mut row_values = [edges[0].at(x, y), edges[1].at(x, y), edges[2].at(x, y)];
    for y in first[1]..=last[1] {
        let mut values = row_values;
        for x in first[0]..=last[0] {
            // Covered where no sign bit is set.
            if values[0] | values[1] | values[2] >= 0 {
                let pixel = (y - origin[1] as i32) as u32 * TILE + (x - origin[0] as i32) as u32;
                visit(pixel, [x * SUBPIXELS, y * SUBPIXELS], 1);
            }
            values = moved(values, right);
        }
        row_values = moved(row_values, down);
    }
}

/// The edge functions of a triangle, prepared for whole pixels.
struct PixelCoverage<'a> {
    edges: [Edge; 3],
    pattern: &'a SamplePattern,
    /// Largest and smallest change of each edge function from a pixel's top left corner to a point in the pixel.
    reach: [[i64; 2]; 3],
}

impl<'a> PixelCoverage<'a> {
    fn new(edges: [Edge; 3], pattern: &'a SamplePattern) -> Self {
        let side = i64::from(SUBPIXELS);
        let reach = |e: Edge| {
            let [x, y] = [e.dx * side, e.dy * side];
            [x.max(0) + y.max(0), x.min(0) + y.min(0)]
        };
        let reach = [reach(edges[0]), reach(edges[1]), reach(edges[2])];
        Self { edges, pattern, reach }
    }

    /// True where one edge has all pixels `first..=last` on its outer side.
    fn misses_block(&self, first: [i32; 2], last: [i32; 2]) -> bool {
        let side = i64::from(SUBPIXELS);
        let is_outside = |i: usize| {
            let (e, [most, _]) = (&self.edges[i], self.reach[i]);
            let x = if e.dx > 0 { last[0] } else { first[0] };
            let y = if e.dy > 0 { last[1] } else { first[1] };
            e.at(i64::from(x) * side, i64::from(y) * side) + most < 0
        };
        is_outside(0) || is_outside(1) || is_outside(2)
    }

    /// The covered samples of the pixel with the given top left corner.
    fn mask(&self, corner: [i32; 2]) -> u64 {
        let (x, y) = (i64::from(corner[0]), i64::from(corner[1]));
        let [a, b, c] = &self.edges;
        let values = [a.at(x, y), b.at(x, y), c.at(x, y)];
        // Outside where a sign bit is set even of the greatest values in the pixel, inside where none is of the least.
        let extreme = |which: usize| {
            let value = |i: usize| values[i] + self.reach[i][which];
            value(0) | value(1) | value(2)
        };
        if extreme(0) < 0 {
            return 0;
        }
        if extreme(1) >= 0 {
            return self.pattern.full_mask();
        }
        let mut mask = 0;
        for (s, o) in self.pattern.offsets().iter().enumerate() {
            let (ox, oy) = (i64::from(o[0]), i64::from(o[1]));
            let at = |i: usize| values[i] + self.edges[i].dx * ox + self.edges[i].dy * oy;
            // Covered where no sign bit is set.
            let covered = at(0) | at(1) | at(2) >= 0;
            mask |= u64::from(covered) << s;
        }
        mask
    }
}

// Where the samples of a pixel lie.

/// Most samples per pixel: coverage is a 64-bit mask.
pub const MAX_SAMPLES: u32 = 64;

/// Sample positions for 2, 4, 8 and 16 samples in sixteenths of a pixel from its centre: every row and column is hit
/// once, which gives near-horizontal and near-vertical edges as many steps as there are samples. These are the
/// standard multi-sampling patterns of Direct3D (functional specification, section 19.2).
const TWO: [[i32; 2]; 2] = [[4, 4], [-4, -4]];
const FOUR: [[i32; 2]; 4] = [[-2, -6], [6, -2], [-6, 2], [2, 6]];
const EIGHT: [[i32; 2]; 8] = [[1, -3], [-1, 3], [5, 1], [-3, -5], [-5, 5], [-7, -1], [3, 7], [7, -7]];
const SIXTEEN: [[i32; 2]; 16] = [
    [1, 1],
    [-1, -3],
    [-3, 2],
    [4, -1],
    [-5, -2],
    [2, 5],
    [5, 3],
    [3, -5],
    [-2, 6],
    [0, -7],
    [-4, -6],
    [-6, 4],
    [-8, 0],
    [7, -4],
    [6, 7],
    [-7, -8],
];

/// How many samples a box holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SamplesIn {
    None,
    /// The only one of a pixel, of patterns with one sample.
    One([i32; 2]),
    /// Of patterns with several samples also one.
    Several,
}

/// The sample positions of every pixel, in fixed point, as offsets from the pixel's top left corner.
#[derive(Clone, Debug)]
pub(crate) struct SamplePattern {
    offsets: Vec<[i32; 2]>,
}

impl SamplePattern {
    /// `count` positions, 1..=[`MAX_SAMPLES`]: the centre, a standard pattern, or the points of Roberts' R2 sequence.
    pub(crate) fn new(count: u32) -> Self {
        let from_sixteenths = |table: &[[i32; 2]]| {
            table.iter().map(|p| p.map(|c| SUBPIXELS / 2 + c * (SUBPIXELS / 16))).collect::<Vec<_>>()
        };
        let offsets = match count {
            1 => vec![[SUBPIXELS / 2; 2]],
            2 => from_sixteenths(&TWO),
            4 => from_sixteenths(&FOUR),
            8 => from_sixteenths(&EIGHT),
            16 => from_sixteenths(&SIXTEEN),
            n => (0..n).map(r2_point).collect(),
        };
        Self { offsets }
    }

    /// Offsets from the pixel's top left corner in fixed point, each coordinate in `0..SUBPIXELS`.
    pub(crate) fn offsets(&self) -> &[[i32; 2]] {
        &self.offsets
    }

    pub(crate) fn len(&self) -> usize {
        self.offsets.len()
    }

    pub(crate) fn samples_in(&self, low: FixedPoint, high: FixedPoint) -> SamplesIn {
        // One sample of every pixel makes a lattice; the box holds a point of it if it does so along both axes.
        const PIXEL: u32 = SUBPIXELS.ilog2();
        let range = |i: usize, o: i32| (((low[i] - o - 1) >> PIXEL) + 1, (high[i] - o) >> PIXEL);
        if let &[[x, y]] = &self.offsets[..] {
            let (columns, rows) = (range(0, x), range(1, y));
            return if columns.0 > columns.1 || rows.0 > rows.1 {
                SamplesIn::None
            } else if columns.0 == columns.1 && rows.0 == rows.1 {
                SamplesIn::One([columns.0, rows.0])
            } else {
                SamplesIn::Several
            };
        }
        let holds = |i: usize, o: i32| range(i, o).0 <= range(i, o).1;
        let holds_any = self.offsets.iter().any(|o| holds(0, o[0]) && holds(1, o[1]));
        if holds_any { SamplesIn::Several } else { SamplesIn::None }
    }

    pub(crate) fn full_mask(&self) -> u64 {
        u64::MAX >> (64 - self.offsets.len())
    }

    /// Mean position of the samples in `mask` (not empty), in pixels from the pixel's top left corner.
    pub(crate) fn centroid(&self, mask: u64) -> Vec2 {
        let mut sum = [0; 2];
        for s in bits(mask) {
            sum[0] += self.offsets[s][0];
            sum[1] += self.offsets[s][1];
        }
        Vec2::new(sum[0] as f32, sum[1] as f32) / (SUBPIXELS as f32 * mask.count_ones() as f32)
    }
}

/// Point `i` of the additive recurrence on the plastic number (M. Roberts, "The Unreasonable Effectiveness of
/// Quasirandom Sequences", 2018), rounded to the sub-pixel grid.
fn r2_point(i: u32) -> [i32; 2] {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let step = [1.0 / PLASTIC, 1.0 / (PLASTIC * PLASTIC)];
    step.map(|a| ((0.5 + a * f64::from(i)).fract() * f64::from(SUBPIXELS)) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn primitive(corners: [[i32; 2]; 3], nearness: [f32; 3], triangle: u32) -> Primitive {
        Primitive { corners, nearness, triangle, layered: false }
    }

    const WHOLE_TILE: [[u32; 2]; 2] = [[0, 0], [TILE, TILE]];

    #[test]
    fn nearness_is_linear_and_bounded() {
        let p = primitive([[0, 0], [2560, 0], [0, 2560]], [1.0, 2.0, 3.0], 0);
        let plane = NearnessPlane::new(&p);
        assert!((plane.at([1280, 0]) - 1.5).abs() < 1e-6);
        assert!((plane.at([0, 1280]) - 2.0).abs() < 1e-6);
        assert_eq!(plane.at([100_000, 100_000]), 3.0);
    }

    #[test]
    fn the_nearer_triangle_wins_whatever_the_order() {
        let pattern = SamplePattern::new(4);
        let big = [[0, 0], [20_000, 0], [0, 20_000]];
        let (near, far) = (primitive(big, [2.0; 3], 1), primitive(big, [1.0; 3], 0));
        let as_near = primitive(big, [2.0; 3], 2);
        for order in [[near, far, as_near], [far, as_near, near], [as_near, near, far]] {
            let mut tile = TileSamples::new(&pattern, WHOLE_TILE);
            order.iter().for_each(|p| tile.add_opaque(p));
            assert!((0..TILE * TILE).all(|p| tile.visible(p) == [1; 4]));
        }
    }

    #[test]
    fn fragments_are_kept_only_in_front() {
        let pattern = SamplePattern::new(1);
        let big = [[0, 0], [20_000, 0], [0, 20_000]];
        let mut tile = TileSamples::new(&pattern, WHOLE_TILE);
        tile.add_opaque(&primitive(big, [2.0; 3], 0));
        let layers = [primitive(big, [1.0; 3], 1), primitive(big, [3.0; 3], 2)];
        let mut parts = 0;
        tile.for_each_part(
            || layers.iter(),
            |_| 1,
            MAX_LAYERED,
            |part, fragments| {
                assert_eq!((part, fragments.len()), (WHOLE_TILE, (TILE * TILE) as usize));
                assert!(fragments.iter().all(|f| f.triangle == 2));
                assert!(fragments.windows(2).all(|w| w[0].pixel < w[1].pixel));
                parts += 1;
            },
        );
        assert_eq!(parts, 1);
    }

    #[test]
    fn many_layers_are_taken_part_by_part() {
        let big = [[0, 0], [20_000, 0], [0, 20_000]];
        let corner = [[8, 8], [70 * SUBPIXELS, 8], [8, 8 * SUBPIXELS]];
        for samples in [1, 4] {
            let pattern = SamplePattern::new(samples);
            let mut tile = TileSamples::new(&pattern, [[32, 64], [32, 21]]);
            tile.add_opaque(&primitive(big, [1.5; 3], 0));
            // In front of what is opaque and behind it, some large and some small.
            let layers: Vec<Primitive> = (1..200)
                .map(|i| primitive(if i % 3 == 0 { corner } else { big }, [(i % 7) as f32; 3], i))
                .map(|p| Primitive { corners: p.corners.map(|[x, y]| [x, y + 60 * SUBPIXELS]), ..p })
                .collect();
            let collect = |most: usize| {
                let (mut all, mut pixels, mut largest) = (Vec::new(), 0, 0);
                let weight = |f: &Fragment| f.mask.count_ones() as usize;
                tile.for_each_part(
                    || layers.iter(),
                    weight,
                    most,
                    |[_, extent], fragments| {
                        pixels += extent[0] * extent[1];
                        largest = largest.max(fragments.iter().map(weight).sum());
                        all.extend(fragments.iter().map(|f| (f.pixel, f.triangle, f.mask)));
                    },
                );
                assert_eq!(pixels, 32 * 21, "parts make up the tile");
                all.sort_unstable();
                (all, largest)
            };
            let (whole, total) = collect(usize::MAX);
            assert!(total > 50_000, "{total}");
            for most in [MAX_LAYERED, 2000] {
                let (parts, largest) = collect(most);
                assert!(largest <= most, "{largest} of at most {most}");
                assert_eq!(parts, whole);
            }
            let in_one_pixel = collect(1);
            assert_eq!(in_one_pixel.0, whole);
        }
    }

    #[test]
    fn short_cuts_change_nothing() {
        // Large triangles, slivers, small ones on and between samples.
        let triangles = [
            [[-700, 300], [7000, 1111], [2500, 8100]],
            [[-9000, -9000], [20_000, 19_000], [20_000, 20_000]],
            [[128, 128], [384, 128], [128, 384]],
            [[129, 129], [383, 129], [129, 383]],
            [[8000, 8000], [8300, 8001], [8191, 8191]],
        ];
        for samples in [1, 8] {
            triangles.iter().for_each(|&corners| covers_by_its_edges(corners, samples));
        }
    }

    /// Against every sample tested on its own.
    fn covers_by_its_edges(corners: [[i32; 2]; 3], samples: u32) {
        let pattern = SamplePattern::new(samples);
        assert!(crate::primitive::doubled_area(&corners) > 0);
        let mut masks = vec![0; (TILE * TILE) as usize];
        for_each_covered(&primitive(corners, [1.0; 3], 0), [0; 2], WHOLE_TILE, &pattern, |p, _, m| {
            masks[p as usize] = m
        });
        let edges = [0, 1, 2].map(|i| Edge::new(corners[i], corners[(i + 1) % 3]));
        for pixel in 0..TILE * TILE {
            let [x, y] = [pixel % TILE, pixel / TILE].map(|c| c as i32 * SUBPIXELS);
            for (s, o) in pattern.offsets().iter().enumerate() {
                let inside = edges.iter().all(|e| e.at((x + o[0]).into(), (y + o[1]).into()) >= 0);
                assert_eq!(masks[pixel as usize] >> s & 1 == 1, inside, "pixel {pixel} sample {s}");
            }
        }
    }

    #[test]
    fn positions_are_distinct_inside_and_centred() {
        for count in 1..=MAX_SAMPLES {
            let pattern = SamplePattern::new(count);
            let mut seen = pattern.offsets().to_vec();
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), count as usize, "{count} samples coincide");
            assert!(seen.iter().flatten().all(|c| (0..SUBPIXELS).contains(c)));
            let off = pattern.centroid(pattern.full_mask()) - Vec2::splat(0.5);
            assert!(off.length() < 0.5 / (count as f32).sqrt(), "{count}: centroid off by {off}");
        }
    }

    #[test]
    fn boxes_without_samples_are_known() {
        let pattern = SamplePattern::new(1);
        assert_eq!(pattern.samples_in([128, 128], [128, 128]), SamplesIn::One([0, 0]));
        assert_eq!(pattern.samples_in([129, 0], [255, 255]), SamplesIn::None);
        let between_columns = pattern.samples_in([-127, 0], [-1, 9000]);
        assert_eq!(between_columns, SamplesIn::None);
        assert_eq!(pattern.samples_in([-129, 0], [-1, 9000]), SamplesIn::Several);
        assert_eq!(pattern.samples_in([-129, 500], [-1, 700]), SamplesIn::One([-1, 2]));
        let over_a_pixels_corner = [[200, 200], [383, 383]];
        assert_eq!(pattern.samples_in(over_a_pixels_corner[0], over_a_pixels_corner[1]), SamplesIn::None);
        let eight = SamplePattern::new(8).samples_in(over_a_pixels_corner[0], over_a_pixels_corner[1]);
        assert_eq!(eight, SamplesIn::Several);
    }
}
