//! The six faces of a bounding box.

use glam::{Vec2, Vec3};

use super::{Bounds, Mapping};

/// Projection along the coordinate axis that is nearest to the normal.
///
/// On every face the longer of its two edges is `u` and the other `v`, both in units of the box's longest edge, so the
/// image keeps its proportions and one image covers the longest edge once. From outside, every face shows the image as it
/// is, not mirrored: upright where y is `v`, and lying on its left side (its right pointing to +y) where y is `u`; the image's
/// down is +z on the top and -z on the bottom (where z is `u`, its right is -z and +z).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxMap {
    bounds: Bounds,
    /// Images per unit of length.
    scale: f32,
    /// Axes (0 = x) from the longest to the shortest edge.
    order: [usize; 3],
}

/// How a face carries the image: per texture coordinate the axis of space (0 = x), and whether it runs backwards.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    axes: [usize; 2],
    backwards: [bool; 2],
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
        Self { bounds, scale: repeat / extent.max_element(), order }
    }

    /// The face across which `n` points.
    fn face(&self, n: Vec3) -> Face {
        let size = n.abs();
        let across = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let [u, v] = match self.order.iter().position(|&axis| axis == across) {
            Some(0) => [self.order[1], self.order[2]],
            Some(1) => [self.order[0], self.order[2]],
            _ => [self.order[0], self.order[1]],
        };
        // Seen from outside, right cross down points into the solid.
        let is_cyclic = (u + 1) % 3 == v;
        let is_mirrored = is_cyclic == (n[across] >= 0.0);
        match [u, v] {
            [_, 1] => Face { axes: [u, v], backwards: [!is_mirrored, true] },
            [2, 0] => Face { axes: [u, v], backwards: [is_mirrored, false] },
            _ => Face { axes: [u, v], backwards: [false, is_mirrored] },
        }
    }
}

impl Face {
    /// The change of the coordinates along a direction of space.
    fn linear(&self, direction: Vec3) -> Vec2 {
        let along = |k: usize| {
            let d = direction[self.axes[k]];
            if self.backwards[k] { -d } else { d }
        };
        Vec2::new(along(0), along(1))
    }
}

impl Mapping for BoxMap {
    fn uv(&self, p: Vec3, n: Vec3) -> Vec2 {
        let face = self.face(n);
        let mut corner = self.bounds.min;
        for (axis, backwards) in face.axes.into_iter().zip(face.backwards) {
            corner[axis] = if backwards { self.bounds.max[axis] } else { self.bounds.min[axis] };
        }
        face.linear(p - corner) * self.scale
    }

    fn uv_footprint(&self, _p: Vec3, n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let face = self.face(n);
        [dp_dx, dp_dy].map(|direction| face.linear(direction) * self.scale)
    }
}
