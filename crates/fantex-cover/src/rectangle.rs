//! The best-rotated bounding rectangle of a planar point set.
//!
//! The rectangle of least area has a side on an edge of the convex hull (H. Freeman and R. Shapira, "Determining the
//! Minimum-Area Encasing Rectangle for an Arbitrary Closed Curve", 1975). The hull is A. M. Andrew's monotone chain ("Another
//! efficient algorithm for convex hulls in two dimensions", 1979).

use glam::{Vec2, Vec3};

/// A rectangle with its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rectangle {
    /// Unit vector along the first side; the second side is perpendicular, counter-clockwise.
    pub(crate) x_axis: Vec2,
    /// Smallest coordinates along both axes.
    pub(crate) min: Vec2,
    /// Side lengths.
    pub(crate) size: Vec2,
}

/// Buffers that are reused between calls.
#[derive(Default)]
pub(crate) struct RectangleFinder {
    hull: Vec<Vec3>,
}

impl RectangleFinder {
    /// The enclosing rectangle of the points' x and y that minimises `(w + pad) * (h + pad)`. Reorders `points`, of which
    /// there is at least one.
    pub(crate) fn smallest(&mut self, points: &mut [Vec3], pad: f32) -> Rectangle {
        self.convex_hull(points);
        let mut best = bounds(&self.hull, Vec2::X);
        let mut best_area = padded_area(&best, pad);
        for i in 0..self.hull.len() {
            let edge = self.hull[(i + 1) % self.hull.len()] - self.hull[i];
            let Some(axis) = edge.truncate().try_normalize() else { continue };
            let candidate = bounds(&self.hull, axis);
            let area = padded_area(&candidate, pad);
            if area < best_area {
                (best, best_area) = (candidate, area);
            }
        }
        best
    }

    /// The convex hull of the points of the last call; z goes along.
    pub(crate) fn hull(&self) -> &[Vec3] {
        &self.hull
    }

    fn convex_hull(&mut self, points: &mut [Vec3]) {
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
}

fn padded_area(r: &Rectangle, pad: f32) -> f32 {
    (r.size.x + pad) * (r.size.y + pad)
}

fn bounds(points: &[Vec3], x_axis: Vec2) -> Rectangle {
    let (mut min, mut max) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    for p in points {
        let p = p.truncate();
        let q = Vec2::new(p.dot(x_axis), x_axis.perp_dot(p));
        min = min.min(q);
        max = max.max(q);
    }
    Rectangle { x_axis, min, size: max - min }
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

    proptest! {
        #[test]
        fn holds_all_points_and_beats_the_axes(points in prop::collection::vec((-1f32..1.0, -1f32..1.0), 1..40)) {
            let points: Vec<Vec3> = points.into_iter().map(|(x, y)| Vec3::new(x, y, 0.0)).collect();
            let r = RectangleFinder::default().smallest(&mut points.clone(), 0.01);
            for p in points.iter().map(|p| p.truncate()) {
                let q = Vec2::new(p.dot(r.x_axis), r.x_axis.perp_dot(p)) - r.min;
                prop_assert!(q.min_element() > -1e-5 && (r.size - q).min_element() > -1e-5);
            }
            prop_assert!(padded_area(&r, 0.01) <= padded_area(&bounds(&points, Vec2::X), 0.01) + 1e-5);
        }
    }
}
