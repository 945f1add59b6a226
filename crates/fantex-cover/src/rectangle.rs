//! The best-rotated bounding rectangle of a planar point set.
//!
//! The rectangle of least area has a side on an edge of the convex hull (H. Freeman and R. Shapira, "Determining the
//! Minimum-Area Encasing Rectangle for an Arbitrary Closed Curve", 1975). The hull is A. M. Andrew's monotone chain ("Another
//! efficient algorithm for convex hulls in two dimensions", 1979).

use glam::{Vec2, Vec3, Vec4};

/// A rectangle with its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Unit vector along the first side; the second side is perpendicular, counter-clockwise.
    pub x_axis: Vec2,
    /// Smallest coordinates along both axes.
    pub min: Vec2,
    /// Side lengths.
    pub size: Vec2,
}

impl Rectangle {
    /// Nothing but the origin.
    pub(crate) const POINT: Self = Self { x_axis: Vec2::X, min: Vec2::ZERO, size: Vec2::ZERO };

    /// A point's coordinates along the rectangle's axes.
    #[inline]
    pub(crate) fn turned(&self, p: Vec2) -> Vec2 {
        Vec2::new(p.dot(self.x_axis), self.x_axis.perp_dot(p))
    }
}

/// Finds the smallest rectangles around points; keeps its buffers.
#[derive(Default)]
pub struct RectangleFinder {
    hull: Vec<Vec3>,
    planar: Vec<Vec2>,
    /// Unit vectors along the hull's edges.
    axes: Vec<Vec2>,
}

impl RectangleFinder {
    /// The enclosing rectangle of the points' x and y that minimises `(w + pad) * (h + pad)`. Reorders `points`, of which
    /// there is at least one.
    pub fn smallest(&mut self, points: &mut [Vec3], pad: f32) -> Rectangle {
        self.convex_hull(points);
        self.planar.clear();
        self.planar.extend(self.hull.iter().map(|p| p.truncate()));
        self.collect_axes();
        smallest_along(&self.axes, &self.planar, pad)
    }

    /// As [`smallest`](Self::smallest), for a polygon that goes counter-clockwise around the origin once. Its hull needs no
    /// sorting (R. L. Graham, "An Efficient Algorithm for Determining the Convex Hull of a Finite Planar Set", 1972).
    pub(crate) fn smallest_around_star(&mut self, polygon: &[Vec2], pad: f32) -> Rectangle {
        let leftmost = (1..polygon.len()).fold(0, |l, i| if polygon[i].x < polygon[l].x { i } else { l });
        self.planar.clear();
        for &p in polygon[leftmost..].iter().chain(&polygon[..=leftmost]) {
            while let [.., a, b] = self.planar[..]
                && (b - a).perp_dot(p - a) <= 0.0
            {
                self.planar.pop();
            }
            self.planar.push(p);
        }
        self.collect_axes();
        // All points are enclosed, not the hull alone: where rounding spoils the order, axes are missed, but no point is.
        smallest_along(&self.axes, polygon, pad)
    }

    /// The convex hull of the points of the last call of [`smallest`](Self::smallest); z goes along.
    pub fn hull(&self) -> &[Vec3] {
        &self.hull
    }

    fn convex_hull(&mut self, points: &mut [Vec3]) {
        let outer = if points.len() > MIN_THINNED { move_inner_back(points) } else { points.len() };
        let points = &mut points[..outer];
        points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        self.hull.clear();
        self.half_hull(points.iter());
        self.half_hull(points.iter().rev());
        if self.hull.is_empty() {
            self.hull.push(points[0]);
        }
    }

    /// Appends one chain without its last point.
    fn half_hull<'a>(&mut self, points: impl Iterator<Item = &'a Vec3>) {
        let start = self.hull.len();
        for &p in points {
            while let [.., a, b] = self.hull[start..] {
                if (b - a).truncate().perp_dot((p - a).truncate()) > 0.0 {
                    break;
                }
                self.hull.pop();
            }
            self.hull.push(p);
        }
        self.hull.pop();
    }

    /// The directions of the edges of the polygon in `planar`, after that of the first axis.
    fn collect_axes(&mut self) {
        self.axes.clear();
        self.axes.push(Vec2::X);
        let Some(&last) = self.planar.last() else { return };
        let mut from = last;
        for &to in &self.planar {
            let edge = to - from;
            let length = edge.length();
            // Too short or not finite: no direction.
            if length > f32::MIN_POSITIVE && length < f32::INFINITY {
                self.axes.push(edge / length);
            }
            from = to;
        }
    }
}

/// Fewer points are sorted as they are.
const MIN_THINNED: usize = 24;

/// Moves the points behind the others that lie well inside the octagon of those that lie farthest in eight directions, so that they are not on
/// the convex hull (S. G. Akl and G. T. Toussaint, "A Fast Convex Hull Algorithm", 1978). Returns how many others there are.
fn move_inner_back(points: &mut [Vec3]) -> usize {
    let (mut low, mut high) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
    // Counter-clockwise: farthest to the right, the upper right, upwards and so on.
    let mut corners = [Vec2::ZERO; 8];
    for p in points.iter() {
        let along = Vec4::new(p.x, p.x + p.y, p.y, p.y - p.x);
        let (lower, higher) = (along.cmplt(low), along.cmpgt(high));
        if (lower | higher).any() {
            for k in 0..4 {
                if higher.test(k) {
                    corners[k] = p.truncate();
                }
                if lower.test(k) {
                    corners[k + 4] = p.truncate();
                }
            }
            (low, high) = (low.min(along), high.max(along));
        }
    }
    let middle = 0.5 * Vec2::new(low.x + high.x, low.z + high.z);
    let margin = ROUNDING * Vec2::new(high.x - low.x, high.z - low.z).length_squared();
    if margin <= 0.0 {
        return points.len();
    }
    // What lies to the left of all sides by more than rounding is inside.
    let sides = [0, 4].map(|first| {
        let mut lines = [[0.0, 0.0, f32::NEG_INFINITY]; 4];
        for (k, line) in (first..).zip(&mut lines) {
            let (from, to) = (corners[k] - middle, corners[(k + 1) % 8] - middle);
            if from != to {
                let normal = (to - from).perp();
                *line = [normal.x, normal.y, normal.dot(from) + margin];
            }
        }
        [0, 1, 2].map(|i| Vec4::from(lines.map(|line| line[i])))
    });
    let mut outer = 0;
    for i in 0..points.len() {
        let p = points[i].truncate() - middle;
        let is_inside = |[x, y, least]: &[Vec4; 3]| (*x * p.x + *y * p.y).cmpgt(*least).all();
        if !sides.iter().all(is_inside) {
            points.swap(i, outer);
            outer += 1;
        }
    }
    outer
}

/// What rounding moves a product of lengths by at most, as a share of the square of the longest.
const ROUNDING: f32 = 1e-6;

/// The best of the rectangles around the points with a side along one of the unit vectors; among equals the first.
fn smallest_along(axes: &[Vec2], points: &[Vec2], pad: f32) -> Rectangle {
    let mut best = Rectangle::POINT;
    let mut best_area = f32::INFINITY;
    for four in axes.chunks(4) {
        let axis = |i: usize| four[i.min(four.len() - 1)];
        let mut bounds = FourBounds::along([axis(0), axis(1), axis(2), axis(3)]);
        points.iter().for_each(|&p| bounds.add(p));
        let [width, height] = bounds.sizes();
        let areas = (width + pad) * (height + pad);
        for (i, area) in areas.to_array().into_iter().enumerate() {
            if area < best_area {
                let (min, max) = bounds.at(i);
                (best, best_area) = (Rectangle { x_axis: axis(i), min, size: max - min }, area);
            }
        }
    }
    best
}

/// The bounds of a point set along four rotations at once, one in each lane.
#[derive(Clone, Copy)]
pub(crate) struct FourBounds {
    /// Coordinates of the rotations' first axes.
    x: Vec4,
    y: Vec4,
    min_x: Vec4,
    min_y: Vec4,
    max_x: Vec4,
    max_y: Vec4,
}

impl FourBounds {
    /// Bounds of nothing yet. The axes are unit vectors.
    pub(crate) fn along(axes: [Vec2; 4]) -> Self {
        let (x, y) = (Vec4::from(axes.map(|a| a.x)), Vec4::from(axes.map(|a| a.y)));
        let (low, high) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        Self { x, y, min_x: low, min_y: low, max_x: high, max_y: high }
    }

    #[inline]
    pub(crate) fn add(&mut self, p: Vec2) {
        let along = self.x * p.x + self.y * p.y;
        let across = self.x * p.y - self.y * p.x;
        self.min_x = self.min_x.min(along);
        self.max_x = self.max_x.max(along);
        self.min_y = self.min_y.min(across);
        self.max_y = self.max_y.max(across);
    }

    /// Widths and heights.
    pub(crate) fn sizes(&self) -> [Vec4; 2] {
        [self.max_x - self.min_x, self.max_y - self.min_y]
    }

    fn at(&self, lane: usize) -> (Vec2, Vec2) {
        let at = |x: Vec4, y: Vec4| Vec2::new(x[lane], y[lane]);
        (at(self.min_x, self.min_y), at(self.max_x, self.max_y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn finds_a_rotated_square() {
        let mut points = [Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y, Vec3::ZERO];
        let r = RectangleFinder::default().smallest(&mut points, 0.0);
        assert!((r.size - Vec2::splat(2f32.sqrt())).length() < 1e-6, "{r:?}");
    }

    #[test]
    fn a_point_and_a_segment_have_rectangles() {
        let r = RectangleFinder::default().smallest(&mut [Vec3::ONE], 0.1);
        assert_eq!(r.size, Vec2::ZERO);
        let r = RectangleFinder::default().smallest(&mut [Vec3::ZERO, Vec3::ONE, Vec3::splat(0.5)], 0.1);
        assert!(r.size.min_element() < 1e-6 && (r.size.max_element() - 2f32.sqrt()).abs() < 1e-6);
    }

    fn padded_area(r: &Rectangle) -> f32 {
        (r.size.x + 0.01) * (r.size.y + 0.01)
    }

    #[test]
    fn points_within_are_left_out_of_sorting_only() {
        let mut random = fantex_base::Random::new(3);
        for round in 0..200 {
            let count = 3 + round % 100;
            // A disc, a grid with many points on its border, a line, a point.
            let mut point = |_| {
                let [x, y] = [random.unit() as f32 - 0.5, random.unit() as f32 - 0.5];
                match round % 4 {
                    0 => Vec2::from_angle(9.0 * x) * y,
                    1 => (8.0 * Vec2::new(x, y)).round(),
                    2 => Vec2::new(x, 3.0 * x),
                    _ => Vec2::ONE,
                }
            };
            let mut points: Vec<Vec3> = (0..count).map(|i| point(i).extend(0.0)).collect();
            let outer = move_inner_back(&mut points);
            assert!(outer > 0 && (round % 4 != 0 || outer < count || count < 20), "{outer} of {count}");
            let hull = |points: &mut [Vec3]| {
                let mut finder = RectangleFinder::default();
                // In small numbers points are not moved.
                points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
                finder.half_hull(points.iter());
                finder.half_hull(points.iter().rev());
                finder.hull
            };
            assert_eq!(hull(&mut points[..outer].to_vec()), hull(&mut points));
        }
    }

    proptest! {
        #[test]
        fn a_star_needs_no_sorting(
            radii in prop::collection::vec(0.1f32..1.0, 3..30),
            first in 0f32..6.3,
            turn in prop::sample::select(vec![1.0, 2.0, 4.0, 6.1, std::f32::consts::TAU]),
        ) {
            let step = turn / radii.len() as f32;
            let at = |(i, r): (usize, &f32)| *r * Vec2::from_angle(first + step * i as f32);
            // An open fan begins with its centre.
            let open = (turn < 6.2).then_some(Vec2::ZERO);
            let polygon: Vec<Vec2> = open.into_iter().chain(radii.iter().enumerate().map(at)).collect();
            let mut points: Vec<Vec3> = polygon.iter().map(|p| p.extend(0.0)).collect();
            let sorted = RectangleFinder::default().smallest(&mut points, 0.01);
            let mut finder = RectangleFinder::default();
            let r = finder.smallest_around_star(&polygon, 0.01);
            prop_assert!((padded_area(&r) - padded_area(&sorted)).abs() < 1e-5, "{r:?}, not {sorted:?}");
        }

        #[test]
        fn holds_all_points_and_beats_the_axes(points in prop::collection::vec((-1f32..1.0, -1f32..1.0), 1..40)) {
            let points: Vec<Vec3> = points.into_iter().map(|(x, y)| Vec3::new(x, y, 0.0)).collect();
            let r = RectangleFinder::default().smallest(&mut points.clone(), 0.01);
            for p in points.iter().map(|p| p.truncate()) {
                let q = Vec2::new(p.dot(r.x_axis), r.x_axis.perp_dot(p)) - r.min;
                prop_assert!(q.min_element() > -1e-5 && (r.size - q).min_element() > -1e-5);
            }
            let planar: Vec<Vec2> = points.iter().map(|p| p.truncate()).collect();
            let upright = smallest_along(&[Vec2::X], &planar, 0.01);
            prop_assert!(padded_area(&r) <= padded_area(&upright) + 1e-5);
        }
    }
}
