//! Fixed-point screen coordinates and edge functions.
//!
//! Screen positions are rounded to 1/256 of a pixel and all coverage decisions are made in integers, so two triangles
//! that share an edge decide about each sample with the same numbers: exactly one of them owns it.

use glam::DVec2;

/// Sub-pixel steps per pixel (24.8 fixed point).
pub(crate) const SUBPIXELS: i32 = 256;

/// Largest distance from the screen's origin, in pixels, that the clipper lets through. With 8 fractional bits the
/// coordinates stay below 2^24 and the edge functions below 2^51: no overflow in 64 bits.
pub(crate) const GUARD_BAND: f64 = 65536.0;

/// A screen position in 1/256 pixel, x to the right, y downwards.
pub(crate) type FixedPoint = [i32; 2];

/// Rounds a screen position in pixels. Positions are within the guard band (plus rounding of the clipper).
pub(crate) fn snap(screen: DVec2) -> FixedPoint {
    let limit = GUARD_BAND + 1.0;
    // Half up, by truncation of a number that is never negative (rounding is a library call without SSE4.1).
    let origin = 1 << 25;
    [screen.x, screen.y]
        .map(|c| (c.clamp(-limit, limit) * f64::from(SUBPIXELS) + (f64::from(origin) + 0.5)) as i32 - origin)
}

/// Twice the signed area: positive where the corners run clockwise on the screen (y down).
pub(crate) fn doubled_area(v: &[FixedPoint; 3]) -> i64 {
    let [a, b, c] = v.map(|p| p.map(i64::from));
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
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
        let [ax, ay] = a.map(i64::from);
        let [bx, by] = b.map(i64::from);
        let (dx, dy) = (ay - by, bx - ax);
        let is_top = ay == by && bx > ax;
        let is_left = by < ay;
        let bias = if is_top || is_left { 0 } else { -1 };
        Self { dx, dy, constant: bias - dx * ax - dy * ay }
    }

    /// Value at a position.
    pub(crate) fn at(&self, x: i64, y: i64) -> i64 {
        self.dx * x + self.dy * y + self.constant
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
