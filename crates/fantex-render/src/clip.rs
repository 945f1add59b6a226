//! Clipping against the near plane and the guard band.
//!
//! Triangles are not clipped at the picture's border (the tiles simply end there), only where the projection has no
//! meaning (behind the near plane) or its numbers would overflow (outside the guard band). Each plane cuts an edge at a
//! point computed from its inside to its outside end, so the two triangles of a shared edge get the same point.

use glam::{DVec2, DVec3};

use crate::fixed::GUARD_BAND;

/// A triangle clipped by five planes has at most eight corners.
const MAX_CORNERS: usize = 8;

/// A convex polygon in screen-homogeneous coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Polygon {
    corners: [DVec3; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    /// The corners in order.
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
    fn clipped(&self, plane: DVec3, offset: f64) -> Self {
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

/// The position on the screen in pixels.
pub(crate) fn screen(h: DVec3) -> DVec2 {
    h.truncate() / h.z
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
