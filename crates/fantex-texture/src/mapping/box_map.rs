//! The six faces of a bounding box.

use glam::{Vec2, Vec3};

use super::{Bounds, Mapping};

/// Projection along the coordinate axis that is nearest to the normal.
///
/// On every face the longer of its two edges is `u` and the other `v`, both in units of the box's longest edge, so the
/// image keeps its proportions and one image covers the longest edge once. Opposite faces are mirrored, not rotated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxMap {
    min: Vec3,
    /// Images per unit of length.
    scale: f32,
    /// Axes (0 = x) from the longest to the shortest edge.
    order: [usize; 3],
}

impl BoxMap {
    /// The image once along the longest edge of `bounds`.
    pub fn fit(bounds: Bounds) -> Self {
        Self::repeated(bounds, 1.0)
    }

    /// The image `repeat` times along the longest edge of `bounds`.
    pub fn repeated(bounds: Bounds, repeat: f32) -> Self {
        let extent = bounds.extent();
        let mut order = [0, 1, 2];
        // Stable: equal edges keep the order x, y, z.
        order.sort_by(|&a, &b| extent[b].total_cmp(&extent[a]));
        Self { min: bounds.min, scale: repeat / extent.max_element(), order }
    }

    /// The axes that are u and v on the face across which `n` points.
    fn axes(&self, n: Vec3) -> [usize; 2] {
        let n = n.abs();
        let across = if n.x >= n.y && n.x >= n.z {
            0
        } else if n.y >= n.z {
            1
        } else {
            2
        };
        match self.order.iter().position(|&axis| axis == across) {
            Some(0) => [self.order[1], self.order[2]],
            Some(1) => [self.order[0], self.order[2]],
            _ => [self.order[0], self.order[1]],
        }
    }
}

impl Mapping for BoxMap {
    fn uv(&self, p: Vec3, n: Vec3) -> Vec2 {
        let [u, v] = self.axes(n);
        let local = (p - self.min) * self.scale;
        Vec2::new(local[u], local[v])
    }

    fn uv_footprint(&self, _p: Vec3, n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let [u, v] = self.axes(n);
        [dp_dx, dp_dy].map(|direction| Vec2::new(direction[u], direction[v]) * self.scale)
    }
}
