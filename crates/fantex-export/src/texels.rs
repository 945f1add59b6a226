//! From the layout of a picture to its texels: what the surface shows at every texel's point of it.
//!
//! ```text
//!  Page --regions--> Region (which point under which texel) --Surface--> linear values --fit--> rows --> files
//! ```
//!
//! A picture is made in bands of rows, a band in square regions in parallel; nothing but one band of all maps is in memory.

use fantex_bake::Progress;
use fantex_base::Result;
use fantex_cover::{SPAN_SLACK, span};
use glam::{IVec2, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::charts::NARROW;
use crate::export::{ChannelMap, Map, cancelled};
use crate::layout::{NOBODY, Page, Placed};
use crate::surface::{Frames, Surface};

const REGION: u32 = 256;

const MIN_ROWS: u32 = 16;

/// Linear values of a rectangle of texels, row-major.
pub(crate) type Values = Vec<[f32; 4]>;

/// What was seen while a page was made.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PageStats {
    /// Texels whose centre lies on a triangle.
    pub(crate) covered: u64,
    /// Of these, texels that several triangles claim.
    pub(crate) contested: u64,
}

/// Takes rows of a map from the top.
pub(crate) trait RowSink: Send {
    fn rows(&mut self, values: &[[f32; 4]]) -> Result<()>;

    fn finish(&mut self) -> Result<()>;
}

/// Makes the maps of a page and hands their rows to `sinks`, one per map. `texels_done` counts up over all pages.
///
/// # Errors
/// A sink's, or the user's wish to stop.
pub(crate) fn make_page(
    page: &Page,
    maps: &[Map],
    (surface, frames): (&dyn Surface, &Frames<'_>),
    memory_bytes: u64,
    sinks: &mut [Box<dyn RowSink + '_>],
    progress: (&dyn Progress, &mut u64, u64),
) -> Result<PageStats> {
    let (watch, texels_done, total) = progress;
    let rows = band_rows(page.side, maps.len(), memory_bytes);
    let columns = page.side.div_ceil(REGION);
    let bins = bins(page, rows);
    let mut stats = PageStats::default();
    let bands = page.side.div_ceil(rows);
    let height = |band: u32| rows.min(page.side - band * rows);
    let make = |band: u32| -> Vec<(Vec<Values>, PageStats)> {
        let make = |column: u32| {
            if watch.is_cancelled() {
                return (Vec::new(), PageStats::default());
            }
            let origin = [column * REGION, band * rows];
            let extent = [REGION.min(page.side - origin[0]), height(band)];
            let members = &bins[(band * columns + column) as usize];
            let region = Region::find(page, members, origin, extent);
            let values = surface.values(page, &region, maps, frames);
            let fitted = maps.iter().zip(&values).map(|(map, values)| {
                let values = region.of_texels(values, map);
                fitted(&values, &region, map, surface.prefilter().sharpening())
            });
            (fitted.collect(), region.stats)
        };
        (0..columns).into_par_iter().map(make).collect()
    };
    let mut regions = make(0);
    for band in 0..bands {
        if watch.is_cancelled() {
            return Err(cancelled());
        }
        for (_, region) in &regions {
            stats.covered += region.covered;
            stats.contested += region.contested;
        }
        let height = height(band) as usize;
        let write = || {
            sinks.par_iter_mut().enumerate().try_for_each(|(map, sink)| {
                let mut row_values = Vec::with_capacity(page.side as usize * height);
                for row in 0..height {
                    for (values, _) in &regions {
                        let width = values[map].len() / height;
                        row_values.extend_from_slice(&values[map][row * width..(row + 1) * width]);
                    }
                }
                sink.rows(&row_values)
            })
        };
        // Pictures are packed on one thread each, meanwhile the others make the next band.
        let next = || if band + 1 < bands { make(band + 1) } else { Vec::new() };
        let (written, next) = rayon::join(write, next);
        written?;
        regions = next;
        *texels_done += u64::from(page.side) * height as u64;
        watch.report(*texels_done, total);
    }
    sinks.par_iter_mut().try_for_each(|sink| sink.finish())?;
    Ok(stats)
}

/// The largest of the red, green and blue numbers of a map on a page, at least 1; less once `watch` is cancelled.
pub(crate) fn largest(
    page: &Page,
    map: &Map,
    (surface, frames): (&dyn Surface, &Frames<'_>),
    watch: &dyn Progress,
) -> f32 {
    let columns = page.side.div_ceil(REGION);
    let of_region = |(region, members): (usize, &Vec<u32>)| {
        if watch.is_cancelled() {
            return 1.0;
        }
        let origin = [region as u32 % columns * REGION, region as u32 / columns * REGION];
        let extent = origin.map(|first| REGION.min(page.side - first));
        let region = Region::find(page, members, origin, extent);
        let values = surface.values(page, &region, std::slice::from_ref(map), frames);
        let numbers = values.iter().flatten().flat_map(|value| value.iter().take(3));
        numbers.copied().fold(1.0, f32::max)
    };
    bins(page, REGION).par_iter().enumerate().map(of_region).reduce(|| 1.0, f32::max)
}

/// Rows of a band: its values, twice, and those of the next one take a quarter of the memory at most.
fn band_rows(side: u32, maps: usize, memory_bytes: u64) -> u32 {
    let row_bytes = 3 * 16 * u64::from(side) * maps.max(1) as u64;
    let rows = (memory_bytes / 4 / row_bytes).clamp(1, u64::from(REGION)) as u32;
    (1 << rows.ilog2()).max(MIN_ROWS)
}

/// Which placed triangles may matter to which region, ascending; regions in rows.
fn bins(page: &Page, rows: u32) -> Vec<Vec<u32>> {
    let (columns, bands) = (page.side.div_ceil(REGION), page.side.div_ceil(rows));
    let margin = (margin(page) + BORDER) as f32 + 2.0;
    let mut bins = vec![Vec::new(); columns as usize * bands as usize];
    for (i, placed) in (0u32..).zip(&page.placed) {
        let [low, high] = bounds(placed);
        let bin = |x: f32, size: u32, count: u32| ((x / size as f32).max(0.0) as u32).min(count - 1);
        for y in bin(low.y - margin, rows, bands)..=bin(high.y + margin, rows, bands) {
            for x in bin(low.x - margin, REGION, columns)..=bin(high.x + margin, REGION, columns) {
                bins[(y * columns + x) as usize].push(i);
            }
        }
    }
    bins
}

/// Lower and upper corner of a triangle's rectangle, texels.
fn bounds(placed: &Placed) -> [glam::Vec2; 2] {
    let [a, b, c] = placed.corners;
    [a.min(b).min(c), a.max(b).max(c)]
}

// ---- Which point of the surface lies under which texel.
//
// 1. A texel whose centre lies on a triangle takes the point under it.
// 2. A texel beside its chart takes what a neighbouring triangle continues it with, so that bilinear look-ups along the border
//    read what they would on an uncut surface; without one, the nearest point of the chart.
// 3. Padding takes the point of the nearest texel of its chart.

#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    /// Index into the page's placed triangles, `NOBODY` where there is none.
    placed: u32,
    /// Barycentric coordinates, not negative.
    lambda: Vec3,
}

const NOTHING: Point = Point { placed: NOBODY, lambda: Vec3::ZERO };

/// Texels around a region that are found as well.
const BORDER: u32 = 1;

/// The points under a rectangle of texels and `BORDER` texels around it.
pub(crate) struct Region {
    /// Columns and rows, without the border.
    extent: [u32; 2],
    /// Those of all texels; padding shares the point of the texel that it was taken from.
    points: Vec<Point>,
    /// Per texel, row-major, with the border, the index of its point, or `NOBODY`.
    point_of_texel: Vec<u32>,
    /// The chart of each texel whose centre lies on the surface or on its continuation, else `NOBODY`.
    chart_on_surface: Vec<u32>,
    /// Without the border.
    stats: PageStats,
}

/// Texels this near to a triangle take a point of it.
const NEAR_TEXELS: f32 = 1.5;

/// Triangles of a chart that are so much farther from a texel than the nearest one lie on the same side of it.
const SAME_SIDE_TEXELS: f32 = 0.25;

/// Reach of the padding where texels have no owners.
const UNOWNED_REACH: u32 = 16;

/// How far a region must look beyond its border: the farthest texel of a chart's blocks from the chart.
fn margin(page: &Page) -> u32 {
    if page.owners.is_empty() { UNOWNED_REACH } else { 2 * page.block + page.block / 2 + 2 }
}

impl Region {
    /// Finds the points; `members` are the placed triangles that reach the rectangle or its margin.
    fn find(page: &Page, members: &[u32], origin: [u32; 2], extent: [u32; 2]) -> Self {
        let border = BORDER as i32;
        let margin = margin(page) as i32 + border;
        let (first, size) = (origin.map(|n| n as i32 - margin), extent.map(|n| n as i32 + 2 * margin));
        let mut search = Search::new(page, first, size);
        let placed = |is_beyond: bool| {
            let placed = members.iter().map(|&i| (i, &page.placed[i as usize]));
            placed.filter(move |(_, placed)| placed.is_beyond() == is_beyond)
        };
        placed(false).for_each(|(i, placed)| search.cover(i, placed));
        let open = search.open_texels();
        placed(false).for_each(|(i, placed)| search.surround(i, placed, &open));
        // Only after all of the chart.
        placed(true).for_each(|(i, placed)| search.go_on(i, placed, &open));
        let [width, height] = extent.map(|n| n as i32);
        let mut stats = PageStats::default();
        for row in search.best.chunks(size[0] as usize).skip(margin as usize).take(height as usize) {
            for best in &row[margin as usize..][..width as usize] {
                stats.covered += u64::from(best.kind == Kind::Inside);
                stats.contested += u64::from(best.is_contested);
            }
        }
        let sources = search.spread();
        let count = (width + 2 * border) as usize * (height + 2 * border) as usize;
        let (mut point_of_texel, mut chart_on_surface) =
            (Vec::with_capacity(count), Vec::with_capacity(count));
        let (mut points, mut known) = (Vec::new(), vec![NOBODY; sources.len()]);
        for y in -border..height + border {
            for x in -border..width + border {
                let texel = ((y + margin) * size[0] + x + margin) as usize;
                let source = sources[texel];
                point_of_texel.push(match known.get_mut(source as usize) {
                    None => NOBODY,
                    Some(known) => {
                        if *known == NOBODY {
                            *known = points.len() as u32;
                            points.push(search.best[source as usize].point);
                        }
                        *known
                    }
                });
                let is_sure = matches!(search.best[texel].kind, Kind::Inside | Kind::Beyond);
                chart_on_surface.push(if is_sure { search.owners[texel] } else { NOBODY });
            }
        }
        Self { extent, points, point_of_texel, chart_on_surface, stats }
    }

    /// How many points there are.
    pub(crate) fn point_count(&self) -> usize {
        self.points.len()
    }

    /// Visits the points triangle by triangle: each with its number and its barycentric coordinates.
    pub(crate) fn for_each_triangle(&self, page: &Page, mut visit: impl FnMut(&Placed, &[(usize, Vec3)])) {
        let number = |(i, point): (u64, &Point)| u64::from(point.placed) << 32 | i;
        let mut order: Vec<u64> = (0..).zip(&self.points).map(number).collect();
        order.sort_unstable();
        let mut points = Vec::new();
        for same_triangle in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            points.clear();
            let index = |&number: &u64| number as u32 as usize;
            points.extend(same_triangle.iter().map(index).map(|i| (i, self.points[i].lambda)));
            visit(&page.placed[(same_triangle[0] >> 32) as usize], &points);
        }
    }

    /// From the values of the points to those of the texels.
    fn of_texels(&self, values: &[[f32; 4]], map: &Map) -> Values {
        let value = |&point: &u32| *values.get(point as usize).unwrap_or(&map.background);
        self.point_of_texel.iter().map(value).collect()
    }
}

/// How a texel got its point; better ones first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Inside,
    Beyond,
    Near,
    Nothing,
}

#[derive(Clone, Copy, Debug)]
struct Best {
    kind: Kind,
    /// Texels to the triangle, or to the one that it continues, squared; 0 on its border, below zero well inside.
    distance: f32,
    is_contested: bool,
    point: Point,
}

/// A rectangle that is looked at, part of which may lie outside the picture.
struct Search<'a> {
    page: &'a Page,
    origin: [i32; 2],
    extent: [i32; 2],
    best: Vec<Best>,
    /// The chart that each texel belongs to.
    owners: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(page: &'a Page, origin: [i32; 2], extent: [i32; 2]) -> Self {
        let nothing =
            Best { kind: Kind::Nothing, distance: f32::INFINITY, is_contested: false, point: NOTHING };
        let side = page.side as i32;
        let owner = |x: i32, y: i32| match (0..side).contains(&x) && (0..side).contains(&y) {
            true => page.owner(x as u32, y as u32),
            false => NOBODY,
        };
        let rows = origin[1]..origin[1] + extent[1];
        let owners: Vec<u32> =
            rows.flat_map(|y| (origin[0]..origin[0] + extent[0]).map(move |x| owner(x, y))).collect();
        Self { page, origin, extent, best: vec![nothing; owners.len()], owners }
    }

    /// Visits the texels within `reach` of a triangle that are its chart's, and some more: their indices and centres.
    fn visit(&mut self, placed: &Placed, shape: &Shape, reach: f32, mut offer: impl FnMut(&mut Best, Vec2)) {
        let origin = self.origin_texels();
        let [first, last] = self.box_around(shape, reach);
        let is_narrow = last.x <= first.x + NARROW as i32;
        for y in first.y..last.y {
            let row = origin.y + y as f32 + 0.5;
            let (mut from, mut end) = (first.x, last.x);
            if !is_narrow {
                let reach = reach + SPAN_SLACK;
                let Some([left, right]) =
                    span(placed.corners.map(|p| p.to_array()), row - reach, row + reach)
                else {
                    continue;
                };
                from = from.max((left - origin.x - reach - 1.5) as i32);
                end = end.min((right - origin.x + reach + 1.5) as i32);
            }
            for x in from..end {
                let texel = (y * self.extent[0] + x) as usize;
                if self.owners[texel] == placed.chart {
                    offer(&mut self.best[texel], Vec2::new(origin.x + (x as f32 + 0.5), row));
                }
            }
        }
    }

    fn origin_texels(&self) -> Vec2 {
        Vec2::new(self.origin[0] as f32, self.origin[1] as f32)
    }

    /// The first columns and rows of those within `reach` of a triangle's rectangle, and of those after them.
    fn box_around(&self, shape: &Shape, reach: f32) -> [IVec2; 2] {
        let end = Vec2::new(self.extent[0] as f32, self.extent[1] as f32);
        let [low, high] = [shape.low, shape.high].map(|p| p - self.origin_texels());
        let first = (low - reach - 0.5).ceil().clamp(Vec2::ZERO, end).as_ivec2();
        let last = (high + reach + 0.5).floor().clamp(Vec2::ZERO, end).as_ivec2();
        [first, last]
    }

    /// Offers a triangle to the texels under it.
    fn cover(&mut self, index: u32, placed: &Placed) {
        let shape = Shape::new(placed);
        self.visit(placed, &shape, shape.rounding, |best, centre| {
            let Some(lambda) = shape.point_under(centre) else { return };
            let is_within = lambda.min_element() > shape.border;
            if best.kind == Kind::Inside {
                // On a common edge both are right.
                best.is_contested |= is_within && best.distance < 0.0;
            } else {
                let distance = if is_within { -1.0 } else { 0.0 };
                let point = Point { placed: index, lambda };
                *best = Best { kind: Kind::Inside, distance, is_contested: false, point };
            }
        });
    }

    /// Offers a triangle to the texels beside it that no triangle of its chart covers.
    fn surround(&mut self, index: u32, placed: &Placed, open: &OpenTexels) {
        let shape = Shape::of_bounds(placed);
        if open.are_none_in(self.box_around(&shape, NEAR_TEXELS)) {
            return;
        }
        let most = NEAR_TEXELS * NEAR_TEXELS;
        self.visit(placed, &shape, NEAR_TEXELS, |best, centre| {
            if best.kind == Kind::Inside || shape.is_beyond(centre, best.distance.min(most)) {
                return;
            }
            let (lambda, distance) = shape.nearest(centre);
            if distance < best.distance && distance <= most {
                let point = Point { placed: index, lambda };
                *best = Best { kind: Kind::Near, distance, is_contested: false, point };
            }
        });
    }

    /// Offers a triangle that continues a chart to the texels under it. Only where the chart is near, so that padding farther out is the
    /// chart's own; and where no other triangle of it is nearer than the one that is continued: the far side of a notch is that side's own.
    fn go_on(&mut self, index: u32, placed: &Placed, open: &OpenTexels) {
        let shape = Shape::of_bounds(placed);
        if open.are_none_in(self.box_around(&shape, NEAR_TEXELS)) {
            return;
        }
        let (shape, continued) =
            (Shape::new(placed), Shape::of_bounds(&self.page.placed[placed.continues as usize]));
        self.visit(placed, &shape, shape.rounding, |best, centre| {
            let most = match best.kind {
                Kind::Near => (best.distance.sqrt() + SAME_SIDE_TEXELS).powi(2),
                Kind::Beyond => best.distance,
                Kind::Inside | Kind::Nothing => return,
            };
            let Some(lambda) = shape.point_under(centre) else { return };
            let (_, distance) = continued.nearest(centre);
            if distance < most {
                let point = Point { placed: index, lambda };
                *best = Best { kind: Kind::Beyond, distance, is_contested: false, point };
            }
        });
    }

    /// The texels that no triangle covers.
    fn open_texels(&self) -> OpenTexels {
        let width = self.extent[0] as usize;
        let mut counts = vec![0; width + 1];
        counts.reserve((width + 1) * self.extent[1] as usize);
        for row in self.best.chunks(width) {
            let above = counts.len() - (width + 1);
            let mut count = 0;
            counts.push(0);
            for (x, best) in row.iter().enumerate() {
                count += u32::from(best.kind != Kind::Inside);
                counts.push(counts[above + x + 1] + count);
            }
        }
        OpenTexels { width, counts }
    }

    /// For every texel the texel whose point it takes: the nearest of its chart that has one, found by two passes over the
    /// rows that hand on the nearest so far (P.-E. Danielsson, "Euclidean Distance Mapping", 1980).
    fn spread(&self) -> Vec<u32> {
        let [width, height] = self.extent;
        let has_point = |i: usize| self.best[i].kind != Kind::Nothing;
        let mut sources: Vec<u32> =
            (0..self.best.len()).map(|i| if has_point(i) { i as u32 } else { NOBODY }).collect();
        let mut pass = |x: i32, y: i32, steps: &[[i32; 2]]| {
            let texel = (y * width + x) as usize;
            if has_point(texel) || self.owners[texel] == NOBODY {
                return;
            }
            let squared = |source: u32| {
                let (sx, sy) = (source as i32 % width, source as i32 / width);
                (sx - x).pow(2) + (sy - y).pow(2)
            };
            for [dx, dy] in steps {
                let (nx, ny) = (x + dx, y + dy);
                if !(0..width).contains(&nx) || !(0..height).contains(&ny) {
                    continue;
                }
                let source = sources[(ny * width + nx) as usize];
                let is_mine = source != NOBODY && self.owners[source as usize] == self.owners[texel];
                if is_mine && (sources[texel] == NOBODY || squared(source) < squared(sources[texel])) {
                    sources[texel] = source;
                }
            }
        };
        for y in 0..height {
            (0..width).for_each(|x| pass(x, y, &[[-1, 0], [-1, -1], [0, -1], [1, -1]]));
            (0..width).rev().for_each(|x| pass(x, y, &[[1, 0]]));
        }
        for y in (0..height).rev() {
            (0..width).rev().for_each(|x| pass(x, y, &[[1, 0], [1, 1], [0, 1], [-1, 1]]));
            (0..width).for_each(|x| pass(x, y, &[[-1, 0]]));
        }
        if self.page.owners.is_empty() {
            // What lies farther away would depend on where the region ends.
            let is_far = |texel: usize, source: u32| {
                let (x, y) = (texel as i32 % width, texel as i32 / width);
                let (sx, sy) = (source as i32 % width, source as i32 / width);
                (sx - x).pow(2) + (sy - y).pow(2) > (UNOWNED_REACH as i32).pow(2)
            };
            let far = sources.iter_mut().enumerate().filter(|(t, s)| **s != NOBODY && is_far(*t, **s));
            far.for_each(|(_, source)| *source = NOBODY);
        }
        sources
    }
}

/// How many texels that no triangle covers lie in any rectangle.
struct OpenTexels {
    /// Of the rectangle that is looked at.
    width: usize,
    /// Above and to the left of each corner of a texel, row-major.
    counts: Vec<u32>,
}

impl OpenTexels {
    /// True where there are none from the first column and row on before the last ones.
    fn are_none_in(&self, [first, last]: [IVec2; 2]) -> bool {
        if first.cmpge(last).any() {
            return true;
        }
        let count = |x: i32, y: i32| self.counts[y as usize * (self.width + 1) + x as usize];
        count(last.x, last.y) + count(first.x, first.y) == count(first.x, last.y) + count(last.x, first.y)
    }
}

struct Shape {
    corners: [Vec2; 3],
    /// Of its rectangle.
    low: Vec2,
    high: Vec2,
    /// Barycentric coordinates change by these per texel to the right and downwards; none where it has no area.
    steps: Option<[Vec3; 2]>,
    /// Barycentric coordinates below this are nearer than a hundredth of a texel to a side.
    border: f32,
    /// No centre of a texel farther from its rectangle seems to lie in it.
    rounding: f32,
}

/// Single precision has barycentric coordinates to some 3e-7 of their change along a triangle: up to this product of its squared length and their
/// change per texel they are right farther than [`SPAN_SLACK`] away from it.
const MAX_SURE: f32 = 1e4;

impl Shape {
    fn new(placed: &Placed) -> Self {
        let flat = Self::of_bounds(placed);
        let [a, b, c] = placed.corners.map(|p| p.as_dvec2());
        let area = (b - a).perp_dot(c - a);
        if !(area.abs() > 1e-9 && area.is_finite()) {
            return flat;
        }
        let dx = glam::DVec3::new(b.y - c.y, c.y - a.y, a.y - b.y) / area;
        let dy = glam::DVec3::new(c.x - b.x, a.x - c.x, b.x - a.x) / area;
        let steepest = (dx * dx + dy * dy).max_element().sqrt();
        let is_sure = steepest as f32 * (flat.high - flat.low).max_element().powi(2) < MAX_SURE;
        let rounding = if is_sure { SPAN_SLACK } else { NEAR_TEXELS };
        let steps = Some([dx.as_vec3(), dy.as_vec3()]);
        Self { steps, border: (0.01 * steepest) as f32, rounding, ..flat }
    }

    /// Without what tells what lies in it.
    fn of_bounds(placed: &Placed) -> Self {
        let [low, high] = bounds(placed);
        Self { corners: placed.corners, low, high, steps: None, border: 0.0, rounding: 0.0 }
    }

    /// Barycentric coordinates of what lies in it.
    fn point_under(&self, at: Vec2) -> Option<Vec3> {
        self.lambda(at).filter(|lambda| lambda.min_element() >= 0.0)
    }

    /// True where its rectangle, and so all of it, lies farther from a place than a squared distance, rounding included.
    fn is_beyond(&self, at: Vec2, squared: f32) -> bool {
        let off = (self.low - at).max(at - self.high).max(Vec2::ZERO);
        off.length_squared() > squared + 1e-3 * (1.0 + squared)
    }

    /// Barycentric coordinates; none where it has no area.
    fn lambda(&self, at: Vec2) -> Option<Vec3> {
        let d = at - self.corners[0];
        self.steps.map(|steps| Vec3::X + steps[0] * d.x + steps[1] * d.y)
    }

    /// See [`nearest_of_border`].
    fn nearest(&self, at: Vec2) -> (Vec3, f32) {
        nearest_of_border(&self.corners, at)
    }
}

/// The point of a triangle's border that is nearest to a place, and its squared distance.
pub(crate) fn nearest_of_border(corners: &[Vec2; 3], at: Vec2) -> (Vec3, f32) {
    // A point shows the mean of its triangle.
    let mut best = (Vec3::splat(1.0 / 3.0), corners[0].distance_squared(at));
    if corners[1] == corners[0] && corners[2] == corners[0] {
        return best;
    }
    best.1 = f32::INFINITY;
    for k in 0..3 {
        let (from, to) = (corners[k], corners[(k + 1) % 3]);
        let along = to - from;
        let share = ((at - from).dot(along) / along.length_squared().max(1e-20)).clamp(0.0, 1.0);
        let distance = (from + along * share).distance_squared(at);
        if distance < best.1 {
            let mut lambda = Vec3::ZERO;
            lambda[k] = 1.0 - share;
            lambda[(k + 1) % 3] = share;
            best = (lambda, distance);
        }
    }
    best
}

// ---- Texels that are right when they are read bilinearly.
//
// Values at texel centres, interpolated, are a blurred copy of the function. As in the bake, each texel is moved against its
// second differences, `c - k (a - 2 c + b)` along both axes with `k = Prefilter::sharpening`.

/// How far a fitted texel may lie beyond its neighbours.
const OVERSHOOT: f32 = 1.0 / 32.0;

/// And how far below the least of them, as a share of it, so that shadows do not become black.
const UNDERSHOOT: f32 = 0.25;

/// What overshoot ends at: shares, heights and colours have nothing beyond 1, which OpenEXR would hold. Light has, and normals become unit
/// vectors.
fn ceiling(map: ChannelMap) -> f32 {
    match map {
        ChannelMap::Emission | ChannelMap::Light | ChannelMap::Normal => f32::INFINITY,
        _ => 1.0,
    }
}

/// The values of the inner part of a region, fitted where the texels around lie on the surface, too.
fn fitted(values: &[[f32; 4]], region: &Region, map: &Map, share: f32) -> Values {
    let border = BORDER as usize;
    let stride = region.extent[0] as usize + 2 * border;
    let is_normal = map.has_normals();
    let most = Vec4::splat(ceiling(map.kind));
    let mut inner = Vec::with_capacity(region.extent[0] as usize * region.extent[1] as usize);
    for y in border..border + region.extent[1] as usize {
        for x in border..border + region.extent[0] as usize {
            let value = fitted_texel(values, &region.chart_on_surface, y * stride + x, stride, (share, most));
            inner.push(if is_normal { unit(value) } else { value }.to_array());
        }
    }
    inner
}

fn fitted_texel(
    values: &[[f32; 4]],
    charts: &[u32],
    texel: usize,
    stride: usize,
    (share, most): (f32, Vec4),
) -> Vec4 {
    let at = |i: usize| Vec4::from_array(values[i]);
    let centre = at(texel);
    let chart = charts[texel];
    let (mut bend, mut low, mut high) = (Vec4::ZERO, centre, centre);
    for step in [1, stride] {
        let around = [texel - step, texel + step];
        if chart != crate::layout::NOBODY && around.iter().all(|&i| charts[i] == chart) {
            let [a, b] = around.map(at);
            bend += a + b - 2.0 * centre;
            low = low.min(a).min(b);
            high = high.max(a).max(b);
        }
    }
    let least = (low - OVERSHOOT).max(low * (1.0 - UNDERSHOOT));
    // Values below zero are none of any map, nor such beyond the most; where they are, they stay.
    (centre - share * bend).clamp(least.min(low), (high + OVERSHOOT).min(most.max(high)))
}

/// A texel of a normal map with its normal at unit length.
fn unit(texel: Vec4) -> Vec4 {
    let normal = (texel.truncate() * 2.0 - 1.0).normalize_or(Vec3::Z);
    (normal * 0.5 + 0.5).extend(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The points without the border.
    fn inner(region: &Region) -> Vec<Point> {
        let stride = region.extent[0] as usize + 2;
        let rows = region.point_of_texel.chunks(stride).skip(1).take(region.extent[1] as usize);
        let point = |&i: &u32| region.points.get(i as usize).copied().unwrap_or(NOTHING);
        rows.flat_map(|row| &row[1..stride - 1]).map(point).collect()
    }

    fn page(side: u32, block: u32, corners: [[f32; 2]; 3], owners: Vec<u32>) -> Page {
        let placed = Placed { triangle: 0, chart: 0, corners: corners.map(Vec2::from), continues: NOBODY };
        Page { side, placed: vec![placed], block, owners }
    }

    #[test]
    fn every_texel_of_a_charts_blocks_has_a_point_of_it() {
        let page = page(16, 4, [[6.0, 6.0], [10.0, 6.0], [6.0, 10.0]], vec![0; 16]);
        let region = Region::find(&page, &[0], [0, 0], [16, 16]);
        let points = inner(&region);
        assert!(points.iter().all(|p| p.placed == 0 && (p.lambda.element_sum() - 1.0).abs() < 1e-5));
        assert!(points.iter().all(|p| p.lambda.min_element() >= 0.0));
        assert_eq!(region.stats.covered, 10);
        // Far to the upper left the nearest point is the corner.
        assert!(points[0].lambda.x > 0.7);
    }

    #[test]
    fn blocks_of_nobody_stay_empty() {
        let mut owners = vec![NOBODY; 16];
        owners[5] = 0;
        let page = page(16, 4, [[4.0, 4.0], [8.0, 4.0], [4.0, 8.0]], owners);
        let region = Region::find(&page, &[0], [0, 0], [16, 16]);
        assert_eq!(inner(&region).iter().filter(|p| p.placed == 0).count(), 16);
    }

    /// A needle across the picture gives a point to each texel that is near enough.
    #[test]
    fn texels_beside_a_needle_have_points() {
        let corners = [[2.0, 3.0], [60.5, 41.25], [60.0, 42.0]];
        let page = page(64, 64, corners, Vec::new());
        let region = Region::find(&page, &[0], [0, 0], [64, 64]);
        let shape = Shape::new(&page.placed[0]);
        let [surface, points] = [&region.chart_on_surface, &region.point_of_texel];
        for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let texel = (y + 1) * 66 + x + 1;
            let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let is_inside = shape.lambda(centre).is_some_and(|lambda| lambda.min_element() >= 0.0);
            assert_eq!(surface[texel] == 0, is_inside, "{x} {y}");
            let is_near = shape.nearest(centre).1 <= NEAR_TEXELS * NEAR_TEXELS;
            assert!(!is_near || points[texel] != NOBODY, "{x} {y}");
        }
    }

    /// Two flanks of a chart with four texels between them; what continues the left one reaches beyond the right one.
    #[test]
    fn each_flank_of_a_notch_is_continued_by_its_own_neighbour() {
        let placed = |corners: [[f32; 2]; 3], triangle, continues| Placed {
            triangle,
            chart: 0,
            corners: corners.map(Vec2::from),
            continues,
        };
        let left = placed([[2.0, 0.0], [6.0, 0.0], [6.0, 16.0]], 0, NOBODY);
        let right = placed([[10.0, 0.0], [14.0, 0.0], [10.0, 16.0]], 1, NOBODY);
        let beyond_left = placed([[6.0, 16.0], [6.0, 0.0], [30.0, 8.0]], 2, 0);
        let page = Page { side: 16, placed: vec![left, right, beyond_left], block: 16, owners: vec![0] };
        let region = Region::find(&page, &[0, 1, 2], [0, 0], [16, 16]);
        let points = inner(&region);
        let shown = |x: usize, y: usize| page.placed[points[16 * y + x].placed as usize].triangle;
        for y in 4..12 {
            assert_eq!([5, 6, 9, 10].map(|x| shown(x, y)), [0, 2, 1, 1], "row {y}");
        }
    }

    #[test]
    fn only_light_overshoots_one() {
        // A bright column of three rows.
        let values: Vec<[f32; 4]> = (0..9).map(|i| [if i % 3 == 1 { 1.0 } else { 0.0 }; 4]).collect();
        let fitted = |map| fitted_texel(&values, &[0; 9], 4, 3, (0.125, Vec4::splat(ceiling(map)))).x;
        assert_eq!(fitted(ChannelMap::Opacity), 1.0);
        assert_eq!(fitted(ChannelMap::Emission), 1.0 + OVERSHOOT);
    }

    #[test]
    fn slivers_between_texel_centres_get_texels() {
        let page = page(16, 16, [[2.0, 8.0], [14.0, 8.0], [14.0, 8.05]], Vec::new());
        let region = Region::find(&page, &[0], [0, 0], [16, 16]);
        assert_eq!(region.stats.covered, 0);
        assert_eq!(inner(&region)[8 * 16 + 8].placed, 0);
    }
}
