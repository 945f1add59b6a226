//! Whose texel is which: the triangles of a mesh over an image, by their texture coordinates, which may repeat the image.
//!
//! A texel belongs to the first triangle that covers its centre in any copy of the image. Texels that have a triangle are stepped over, so
//! a triangle that covers the image again and again costs no more than one that covers it once.

use std::ops::RangeInclusive;

use fantex_cover::{SPAN_SLACK, span};
use glam::{DVec2, DVec3, Vec2};

/// Twice the area of a triangle, over the square of its length, from which it is looked for row by row.
const MIN_SPAN_SHAPE: f64 = 1e-9;

/// How far beside such a triangle rounding may place a texel, over its length.
const SPAN_ROUNDING: f64 = 1e-5;

/// Copies of the image, side by side and one below the other, in which a triangle is looked for. What is larger covers the image in them,
/// or is a needle.
const MAX_COPIES: i64 = 64;

/// Areas that exceed the texels that triangles have by less than this factor, or by more, tell without counting.
const SURELY_OWN: f64 = 0.99;
const SURELY_SHARED: f64 = 4.0;

/// The least barycentric coordinate of texels that lie within a triangle, and not on its border.
const MIN_INNER: f64 = 1e-6;

/// Nobody's texel.
const EMPTY: u32 = u32::MAX;

pub(crate) struct Charts<'a> {
    uv: &'a [Vec2],
    size: [u32; 2],
    /// Row by row.
    owners: Vec<u32>,
}

/// The triangle that a texel belongs to, in the copy of the image in which it covers the texel.
pub(crate) struct Owner {
    pub(crate) triangle: u32,
    /// Texels.
    pub(crate) corners: [DVec2; 3],
    /// Of the texel.
    pub(crate) center: DVec2,
}

impl<'a> Charts<'a> {
    /// Of the texture coordinates of all corners. Nothing if somebody wants to stop, which is asked for each triangle and each of its rows.
    pub(crate) fn new(uv: &'a [Vec2], size: [u32; 2], is_cancelled: &dyn Fn() -> bool) -> Option<Self> {
        let [width, height] = size.map(|n| n as usize);
        let mut owners = vec![EMPTY; width * height];
        let mut rows = vec![FreeTexels::new(size[0]); height];
        let mut left = owners.len();
        for triangle in 0..uv.len() / 3 {
            if is_cancelled() {
                return None;
            }
            if left == 0 {
                break;
            }
            let Some(footprint) = Footprint::new(corners_in_texels(uv, size, triangle), size) else {
                continue;
            };
            for y in footprint.rows.clone() {
                if is_cancelled() {
                    return None;
                }
                let row = y.rem_euclid(height as i64) as usize;
                let free = &mut rows[row];
                let Some(columns) = footprint.columns(y) else { continue };
                let (mut x, last) = columns.into_inner();
                while x <= last && !free.is_empty() {
                    let column = x.rem_euclid(width as i64);
                    let next = free.at_or_after(column as usize);
                    // Where there is none, this is the beginning of the next copy.
                    x += next as i64 - column;
                    if next == width || x > last {
                        continue;
                    }
                    if footprint.covers(x, y) {
                        owners[row * width + next] = triangle as u32;
                        free.take(next);
                        left -= 1;
                    }
                    x += 1;
                }
            }
        }
        Some(Self { uv, size, owners })
    }

    /// Texels of the image.
    pub(crate) fn texels(&self) -> usize {
        self.owners.len()
    }

    /// Share of what the triangles cover, in all copies of the image, that shows texels which belong to another triangle or copy.
    pub(crate) fn shared_share(&self) -> f64 {
        let owned = self.owners.iter().filter(|&&owner| owner != EMPTY).count() as f64;
        let triangles = 0..self.uv.len() / 3;
        let corners = triangles.map(|triangle| corners_in_texels(self.uv, self.size, triangle));
        let areas = corners.clone().map(|[a, b, c]| 0.5 * (b - a).perp_dot(c - a).abs());
        let area: f64 = areas.filter(|area| area.is_finite()).sum();
        let share = |covered: f64| (1.0 - owned / covered.max(1.0)).max(0.0);
        // Texels are counted where areas leave a doubt, as borders beside centres of texels seem to share some.
        if owned < 1.0 || area * SURELY_OWN < owned {
            return 0.0;
        }
        if area > SURELY_SHARED * owned {
            return share(area);
        }
        let footprints = corners.filter_map(|corners| Footprint::new(corners, self.size));
        share(footprints.map(|footprint| footprint.inner_texels()).sum::<usize>() as f64)
    }

    /// Nothing for texels that no triangle covers.
    pub(crate) fn owner(&self, texel: usize) -> Option<Owner> {
        let triangle = Some(self.owners[texel]).filter(|&owner| owner != EMPTY)?;
        let corners = corners_in_texels(self.uv, self.size, triangle as usize);
        let [width, height] = self.size.map(i64::from);
        let (column, row) = (texel as i64 % width, texel as i64 / width);
        let footprint = Footprint::new(corners, self.size)?;
        let (first, last) = footprint.rows.clone().into_inner();
        let mut rows = (at_or_after(first, row, height)..=last).step_by(height as usize);
        let (x, y) = rows.find_map(|y| {
            let (first, last) = footprint.columns(y)?.into_inner();
            let mut columns = (at_or_after(first, column, width)..=last).step_by(width as usize);
            columns.find(|&x| footprint.covers(x, y)).map(|x| (x, y))
        })?;
        Some(Owner { triangle, corners, center: center(x, y) })
    }
}

/// The first number from `first` on that has a remainder.
fn at_or_after(first: i64, remainder: i64, divisor: i64) -> i64 {
    first + (remainder - first).rem_euclid(divisor)
}

/// The texels of a row that nobody has, as disjoint sets: each leads to the first free one from it on.
#[derive(Clone)]
struct FreeTexels(Vec<u32>);

impl FreeTexels {
    fn new(width: u32) -> Self {
        Self((0..=width).collect())
    }

    fn is_empty(&mut self) -> bool {
        self.at_or_after(0) + 1 == self.0.len()
    }

    /// The first free column from one on, or the width.
    fn at_or_after(&mut self, column: usize) -> usize {
        let mut at = column;
        while self.0[at] as usize != at {
            self.0[at] = self.0[self.0[at] as usize];
            at = self.0[at] as usize;
        }
        at
    }

    fn take(&mut self, column: usize) {
        self.0[column] += 1;
    }
}

/// Where a triangle may cover the centres of texels, in all copies of the image.
struct Footprint {
    corners: [DVec2; 3],
    rows: RangeInclusive<i64>,
    /// Of its box.
    columns: RangeInclusive<i64>,
    /// Barycentric coordinates are rounding errors, anywhere in the box.
    is_flat: bool,
    slack: f64,
}

impl Footprint {
    fn new(corners: [DVec2; 3], size: [u32; 2]) -> Option<Self> {
        let [a, b, c] = corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        if !(low.is_finite() && high.is_finite() && low.abs().max(high.abs()).max_element() < 1e9) {
            return None;
        }
        let longest = (high - low).max_element();
        let area = (b - a).perp_dot(c - a).abs();
        if area == 0.0 {
            // It has no barycentric coordinates, so it covers nothing, however long it is.
            return None;
        }
        let is_flat = area < MIN_SPAN_SHAPE * longest * longest;
        let [columns, rows] = [0, 1].map(|k| {
            let (first, last) = ((low[k] - 0.5).ceil() as i64, (high[k] - 0.5).floor() as i64);
            // What is flat covers next to nothing in any copy.
            let copies = if is_flat { 1 } else { MAX_COPIES };
            let longest = copies * i64::from(size[k]) - 1;
            if last - first <= longest {
                return first..=last;
            }
            // The row and the column through the middle corners cross within the triangle, where it is wide.
            let middle = a[k] + b[k] + c[k] - low[k] - high[k];
            let first = (middle as i64 - longest / 2).clamp(first, last - longest);
            first..=first + longest
        });
        let slack = f64::from(SPAN_SLACK) + SPAN_ROUNDING * longest;
        Some(Self { corners, rows, columns, is_flat, slack })
    }

    /// The columns of a row beyond which it covers no texel; none where it covers none.
    fn columns(&self, y: i64) -> Option<RangeInclusive<i64>> {
        if self.is_flat {
            return Some(self.columns.clone());
        }
        let (row, slack) = (y as f64 + 0.5, self.slack);
        let corners = self.corners.map(|corner| corner.to_array());
        let [left, right] = span(corners, row - slack, row + slack)?;
        let first = ((left - slack - 0.5).ceil() as i64).max(*self.columns.start());
        let last = ((right + slack - 0.5).floor() as i64).min(*self.columns.end());
        Some(first..=last)
    }

    /// The number of texels whose centres lie within it, not on its border. Of what is flat there are next to none.
    fn inner_texels(&self) -> usize {
        let is_inside = |x: i64, y: i64| {
            lambda_at(self.corners, center(x, y)).is_some_and(|lambda| lambda.min_element() > MIN_INNER)
        };
        if self.is_flat {
            return 0;
        }
        let of_row =
            |y: i64| self.columns(y).map_or(0, |columns| columns.filter(|&x| is_inside(x, y)).count());
        self.rows.clone().map(of_row).sum()
    }

    fn covers(&self, x: i64, y: i64) -> bool {
        lambda_at(self.corners, center(x, y)).is_some_and(|lambda| lambda.min_element() >= 0.0)
    }
}

fn center(x: i64, y: i64) -> DVec2 {
    DVec2::new(x as f64 + 0.5, y as f64 + 0.5)
}

fn corners_in_texels(uv: &[Vec2], size: [u32; 2], triangle: usize) -> [DVec2; 3] {
    let size = DVec2::new(size[0].into(), size[1].into());
    [0, 1, 2].map(|k| uv[3 * triangle + k].as_dvec2() * size)
}

/// Barycentric coordinates of a point in the plane; `None` for a triangle without area.
pub(crate) fn lambda_at([a, b, c]: [DVec2; 3], p: DVec2) -> Option<DVec3> {
    let area = (b - a).perp_dot(c - a);
    let lambda = DVec3::new((b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)) / area;
    lambda.is_finite().then_some(lambda)
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;

    use super::*;

    fn charts(uv: &[Vec2], size: [u32; 2]) -> Charts<'_> {
        Charts::new(uv, size, &|| false).unwrap()
    }

    /// The triangles of texels, each of which is asked for everywhere in its box.
    fn owners_in_boxes(uv: &[Vec2], size: [u32; 2]) -> Vec<u32> {
        let mut owners = vec![EMPTY; size[0] as usize * size[1] as usize];
        for triangle in 0..uv.len() / 3 {
            let corners = corners_in_texels(uv, size, triangle);
            let [a, b, c] = corners;
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let range = |k: usize| (low[k] - 0.5).ceil() as i64..=(high[k] - 0.5).floor() as i64;
            for (y, x) in range(1).flat_map(|y| range(0).map(move |x| (y, x))) {
                if lambda_at(corners, center(x, y)).is_some_and(|l| l.min_element() >= 0.0) {
                    let [column, row] = [(x, size[0]), (y, size[1])].map(|(n, of)| n.rem_euclid(of.into()));
                    let owner = &mut owners[row as usize * size[0] as usize + column as usize];
                    *owner = (*owner).min(triangle as u32);
                }
            }
        }
        owners
    }

    #[test]
    fn charts_are_those_found_in_whole_boxes() {
        let mut random = Random::new(3);
        let size = [61, 47];
        for round in 0..400usize {
            let scale: f32 = [0.02, 0.3, 1.0, if round % 100 == 3 { 40.0 } else { 5.0 }][round % 4];
            let mut uv = Vec::new();
            for triangle in 0..6 {
                let mut point = || Vec2::new(random.unit() as f32 - 0.3, random.unit() as f32 - 0.3) * scale;
                let [a, b, mut c] = [point(), point(), point()];
                match triangle {
                    // Needles, at last without area but for rounding.
                    0 => c = a.lerp(b, 0.4) + Vec2::new(1e-3, -1e-3) * scale,
                    1 => c = a.lerp(b, 1.7) + Vec2::new(1e-6, 1e-6) * scale,
                    2 => c = a.lerp(b, 0.3),
                    3 => c = Vec2::new(c.x, a.y),
                    _ => {}
                }
                uv.extend([a, b, c]);
            }
            // Each alone, too: together they fill the image soon.
            for uv in uv.chunks(3).chain([&uv[..]]) {
                assert_eq!(charts(uv, size).owners, owners_in_boxes(uv, size), "{round}: {uv:?}");
            }
        }
    }

    #[test]
    fn owners_cover_their_texels_in_the_copy_that_they_name() {
        let size = [16, 16];
        for (repeats, full) in [(1.0, 136), (1.5, 228), (2.0, 256), (60.0, 256)] {
            let uv = [Vec2::ZERO, Vec2::new(repeats, 0.0), Vec2::splat(repeats)];
            let charts = charts(&uv, size);
            let owners: Vec<(usize, Owner)> =
                (0..charts.texels()).filter_map(|texel| Some((texel, charts.owner(texel)?))).collect();
            assert_eq!(owners.len(), full, "{repeats}");
            for (texel, owner) in owners {
                assert!(lambda_at(owner.corners, owner.center).unwrap().min_element() >= 0.0);
                let [column, row] = [owner.center.x, owner.center.y].map(|x| x.rem_euclid(16.0));
                assert_eq!([column, row], [(texel % 16) as f64 + 0.5, (texel / 16) as f64 + 0.5]);
            }
        }
    }

    #[test]
    fn shares_of_texels_that_others_have_are_counted() {
        let square = |low: f32, high: f32| {
            let [a, b, c, d] = [[low, low], [high, low], [high, high], [low, high]].map(Vec2::from);
            [a, b, c, a, c, d]
        };
        let share = |uv: &[Vec2]| charts(uv, [64, 64]).shared_share();
        // A square whose borders lie beside centres of texels, so that its area exceeds its texels by 4 %.
        let alone = square(7.55 / 64.0, 56.45 / 64.0);
        assert_eq!(share(&alone), 0.0);
        // Twice the same, half of another, and four copies of the image.
        assert!((share(&[alone, alone].concat()) - 0.5).abs() < 0.02);
        let halves = [square(0.0, 1.0), square(0.25, 0.75)].concat();
        assert!((share(&halves) - 0.2).abs() < 0.02, "{}", share(&halves));
        assert!((share(&square(0.0, 2.0)) - 0.75).abs() < 0.02);
        assert!((share(&square(0.0, 20.0)) - 0.9975).abs() < 1e-6);
    }

    #[test]
    fn triangles_without_area_are_not_looked_for() {
        let uv = [Vec2::ZERO, Vec2::ONE, Vec2::splat(0.25)];
        let asked = std::cell::Cell::new(0);
        let is_cancelled = || {
            asked.set(asked.get() + 1);
            false
        };
        let charts = Charts::new(&uv, [64, 64], &is_cancelled).unwrap();
        assert!(charts.owners.iter().all(|&owner| owner == EMPTY));
        // For the triangle, and for none of its rows.
        assert_eq!(asked.get(), 1);
    }

    /// What lies over millions of copies ends, and covers the image, if it is no needle.
    #[test]
    fn triangles_over_many_copies_cover_the_image() {
        let all = |uv: &[Vec2]| charts(uv, [64, 64]).owners.iter().all(|&owner| owner == 0);
        for far in [1e3, 1e5, 1e7] {
            assert!(all(&[Vec2::ZERO, Vec2::new(far, 0.0), Vec2::splat(far)]), "{far}");
            // Its wide part is far from both ends.
            assert!(all(&[Vec2::ZERO, Vec2::new(30.0, 0.3 * far), Vec2::new(-30.0, far)]), "{far}");
            assert!(all(&[Vec2::ZERO, Vec2::new(0.3 * far, 30.0), Vec2::new(far, -30.0)]), "{far}");
        }
        // Needles may leave something, but end.
        for thin in [1e-6, 1e-3, 0.1] {
            charts(&[Vec2::ZERO, Vec2::splat(1e7), Vec2::new(1e7, 1e7 * (1.0 + thin))], [64, 64]);
        }
    }
}
