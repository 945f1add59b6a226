//! Which point of the surface lies under which texel.
//!
//! 1. A texel whose centre lies on a triangle takes the point under it.
//! 2. A texel beside its chart takes what a neighbouring triangle continues it with, so that bilinear look-ups along the border
//!    read what they would on an uncut surface; without one, the nearest point of the chart.
//! 3. Padding takes the point of the nearest texel of its chart.

use glam::{Vec2, Vec3};

use super::{PageStats, bounds};
use crate::layout::{NOBODY, Page, Placed};

/// A texel's point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    /// Index into the page's placed triangles, `NOBODY` where there is none.
    pub(super) placed: u32,
    /// Barycentric coordinates, not negative.
    pub(super) lambda: Vec3,
}

const NOTHING: Point = Point { placed: NOBODY, lambda: Vec3::ZERO };

/// Texels around a region that are found as well.
pub(super) const BORDER: u32 = 1;

/// The points under a rectangle of texels and `BORDER` texels around it.
pub(super) struct Region {
    /// Columns and rows, without the border.
    pub(super) extent: [u32; 2],
    /// One per texel, row-major, with the border; equal points of padding are those of the texel that they were taken from.
    pub(super) points: Vec<Point>,
    /// The chart of each texel whose centre lies on the surface or on its continuation, else `NOBODY`.
    pub(super) chart_on_surface: Vec<u32>,
    /// Without the border.
    pub(super) stats: PageStats,
}

/// Texels this near to a triangle take a point of it.
const NEAR_TEXELS: f32 = 1.5;

/// Reach of the padding where texels have no owners.
const UNOWNED_REACH: u32 = 16;

/// How far a region must look beyond its border: the farthest texel of a chart's blocks from the chart.
pub(super) fn margin(page: &Page) -> u32 {
    if page.owners.is_empty() { UNOWNED_REACH } else { page.block + page.block / 2 + 2 }
}

impl Region {
    /// Finds the points; `members` are the placed triangles that reach the rectangle or its margin.
    pub(super) fn find(page: &Page, members: &[u32], origin: [u32; 2], extent: [u32; 2]) -> Self {
        let border = BORDER as i32;
        let margin = margin(page) as i32 + border;
        let frame = Frame {
            page,
            origin: origin.map(|n| n as i32 - margin),
            extent: extent.map(|n| n as i32 + 2 * margin),
        };
        let mut search = Search::new(frame);
        for is_beyond in [false, true] {
            for &i in members.iter().filter(|&&i| page.placed[i as usize].is_beyond == is_beyond) {
                search.scan(i, &page.placed[i as usize]);
            }
        }
        let [width, height] = extent.map(|n| n as i32);
        let inner = |texel: usize| {
            let x = texel as i32 % frame.extent[0] - margin;
            let y = texel as i32 / frame.extent[0] - margin;
            (0..width).contains(&x) && (0..height).contains(&y)
        };
        let mut stats = PageStats::default();
        for (_, best) in search.best.iter().enumerate().filter(|(texel, _)| inner(*texel)) {
            stats.covered += u64::from(best.kind == Kind::Inside);
            stats.contested += u64::from(best.is_contested);
        }
        let sources = search.spread();
        let count = (width + 2 * border) as usize * (height + 2 * border) as usize;
        let (mut points, mut chart_on_surface) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for y in -border..height + border {
            for x in -border..width + border {
                let texel = ((y + margin) * frame.extent[0] + x + margin) as usize;
                let source = sources[texel];
                points.push(if source == NOBODY { NOTHING } else { search.best[source as usize].point });
                let is_sure = matches!(search.best[texel].kind, Kind::Inside | Kind::Beyond);
                chart_on_surface.push(if is_sure { search.owners[texel] } else { NOBODY });
            }
        }
        Self { extent, points, chart_on_surface, stats }
    }
}

/// The rectangle that is looked at, part of which may lie outside the picture.
#[derive(Clone, Copy)]
struct Frame<'a> {
    page: &'a Page,
    origin: [i32; 2],
    extent: [i32; 2],
}

impl Frame<'_> {
    /// The chart that a texel of the frame belongs to.
    fn owner(&self, x: i32, y: i32) -> u32 {
        let (x, y) = (x + self.origin[0], y + self.origin[1]);
        let side = self.page.side as i32;
        if !(0..side).contains(&x) || !(0..side).contains(&y) {
            return NOBODY;
        }
        self.page.owner(x as u32, y as u32)
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
    /// Texels, squared.
    distance: f32,
    is_contested: bool,
    point: Point,
}

struct Search<'a> {
    frame: Frame<'a>,
    best: Vec<Best>,
    owners: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(frame: Frame<'a>) -> Self {
        let [width, height] = frame.extent;
        let nothing =
            Best { kind: Kind::Nothing, distance: f32::INFINITY, is_contested: false, point: NOTHING };
        let owners = (0..height).flat_map(|y| (0..width).map(move |x| frame.owner(x, y))).collect();
        Self { frame, best: vec![nothing; width as usize * height as usize], owners }
    }

    /// Offers a triangle to the texels under it and beside it. Those beyond a chart come after all of the chart.
    fn scan(&mut self, index: u32, placed: &Placed) {
        let Some(shape) = Shape::new(placed) else { return };
        let origin = Vec2::new(self.frame.origin[0] as f32, self.frame.origin[1] as f32);
        let [low, high] = bounds(placed).map(|p| p - origin);
        let end = Vec2::new(self.frame.extent[0] as f32, self.frame.extent[1] as f32);
        let first = (low - NEAR_TEXELS - 0.5).ceil().clamp(Vec2::ZERO, end).as_ivec2();
        let last = (high + NEAR_TEXELS + 0.5).floor().clamp(Vec2::ZERO, end).as_ivec2();
        for y in first.y..last.y {
            for x in first.x..last.x {
                let texel = (y * self.frame.extent[0] + x) as usize;
                if self.owners[texel] == placed.chart {
                    let centre = origin + Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    self.offer(texel, index, placed.is_beyond, &shape, centre);
                }
            }
        }
    }

    fn offer(&mut self, texel: usize, index: u32, is_beyond: bool, shape: &Shape, centre: Vec2) {
        let best = &mut self.best[texel];
        let lambda = shape.lambda(centre);
        if lambda.min_element() >= 0.0 {
            match (is_beyond, best.kind) {
                (false, Kind::Inside) => {
                    // On a common edge both are right.
                    best.is_contested |= lambda.min_element() > shape.border && best.distance < 0.0;
                }
                (false, _) => {
                    let distance = if lambda.min_element() > shape.border { -1.0 } else { 0.0 };
                    let point = Point { placed: index, lambda };
                    *best = Best { kind: Kind::Inside, distance, is_contested: false, point };
                }
                // Only where the chart is near, so that padding farther out is the chart's own.
                (true, Kind::Near) => {
                    best.kind = Kind::Beyond;
                    best.point = Point { placed: index, lambda };
                }
                (true, _) => {}
            }
            return;
        }
        if is_beyond || !matches!(best.kind, Kind::Near | Kind::Nothing) {
            return;
        }
        let (lambda, distance) = shape.nearest(centre);
        if distance < best.distance && distance <= NEAR_TEXELS * NEAR_TEXELS {
            *best = Best {
                kind: Kind::Near,
                distance,
                is_contested: false,
                point: Point { placed: index, lambda },
            };
        }
    }

    /// For every texel the texel whose point it takes: the nearest of its chart that has one, found by two passes over the
    /// rows that hand on the nearest so far (P.-E. Danielsson, "Euclidean Distance Mapping", 1980).
    fn spread(&self) -> Vec<u32> {
        let [width, height] = self.frame.extent;
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
        if self.frame.page.owners.is_empty() {
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

/// A triangle in the picture, ready for questions.
struct Shape {
    corners: [Vec2; 3],
    /// Barycentric coordinates change by these per texel to the right and downwards.
    steps: [Vec3; 2],
    /// Barycentric coordinates below this are nearer than a hundredth of a texel to a side.
    border: f32,
}

impl Shape {
    /// None for one without area.
    fn new(placed: &Placed) -> Option<Self> {
        let [a, b, c] = placed.corners.map(|p| p.as_dvec2());
        let area = (b - a).perp_dot(c - a);
        if !(area.abs() > 1e-9 && area.is_finite()) {
            return None;
        }
        let dx = glam::DVec3::new(b.y - c.y, c.y - a.y, a.y - b.y) / area;
        let dy = glam::DVec3::new(c.x - b.x, a.x - c.x, b.x - a.x) / area;
        let steepest = (dx * dx + dy * dy).max_element().sqrt();
        Some(Self {
            corners: placed.corners,
            steps: [dx.as_vec3(), dy.as_vec3()],
            border: (0.01 * steepest) as f32,
        })
    }

    fn lambda(&self, at: Vec2) -> Vec3 {
        let d = at - self.corners[0];
        Vec3::X + self.steps[0] * d.x + self.steps[1] * d.y
    }

    /// The nearest point of the border, and its squared distance in texels.
    fn nearest(&self, at: Vec2) -> (Vec3, f32) {
        let mut best = (Vec3::X, f32::INFINITY);
        for k in 0..3 {
            let (from, to) = (self.corners[k], self.corners[(k + 1) % 3]);
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
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The points without the border.
    fn inner(region: &Region) -> Vec<Point> {
        let stride = region.extent[0] as usize + 2;
        let rows = region.points.chunks(stride).skip(1).take(region.extent[1] as usize);
        rows.flat_map(|row| &row[1..stride - 1]).copied().collect()
    }

    fn page(side: u32, block: u32, corners: [[f32; 2]; 3], owners: Vec<u32>) -> Page {
        let placed = Placed { triangle: 0, chart: 0, corners: corners.map(Vec2::from), is_beyond: false };
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

    #[test]
    fn slivers_between_texel_centres_get_texels() {
        let page = page(16, 16, [[2.0, 8.0], [14.0, 8.0], [14.0, 8.05]], Vec::new());
        let region = Region::find(&page, &[0], [0, 0], [16, 16]);
        assert_eq!(region.stats.covered, 0);
        assert_eq!(inner(&region)[8 * 16 + 8].placed, 0);
    }
}
