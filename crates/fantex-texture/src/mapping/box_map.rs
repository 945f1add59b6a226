//! The six faces of a bounding box.

use glam::{Vec2, Vec3};

use super::{Bounds, Mapping, SurfacePoint};
use crate::{Allowed, InvalidOption};

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

    pub(super) fn longest_edge(&self) -> f32 {
        self.bounds.extent().max_element()
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

    /// Where `u` and `v` are 0 on a face (its third coordinate is that of the smallest corner).
    fn corner(&self, face: Face) -> Vec3 {
        let mut corner = self.bounds.min;
        for (axis, backwards) in face.axes.into_iter().zip(face.backwards) {
            corner[axis] = if backwards { self.bounds.max[axis] } else { self.bounds.min[axis] };
        }
        corner
    }

    /// The point with these coordinates on the face across which `n` points.
    pub fn point(&self, uv: Vec2, n: Vec3) -> Vec3 {
        let face = self.face(n);
        let mut point = self.corner(face);
        for (k, axis) in face.axes.into_iter().enumerate() {
            let sign = if face.backwards[k] { -1.0 } else { 1.0 };
            point[axis] += sign * uv[k] / self.scale;
        }
        let across = 3 - face.axes[0] - face.axes[1];
        point[across] = if n[across] >= 0.0 { self.bounds.max[across] } else { self.bounds.min[across] };
        point
    }

    /// Where the line leaves the box (for lines that pass by: near where they pass), with the face's normal.
    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<SurfacePoint> {
        let far = Vec3::select(direction.cmpgt(Vec3::ZERO), self.bounds.max, self.bounds.min);
        let along = Vec3::select(direction.cmpeq(Vec3::ZERO), Vec3::INFINITY, (far - origin) / direction);
        let axis = along.min_position();
        if !along[axis].is_finite() {
            return None;
        }
        let position = (origin + direction * along[axis]).max(self.bounds.min).min(self.bounds.max);
        Some(self.on_face(position, axis, direction[axis] > 0.0))
    }

    /// The foot of the perpendicular onto the nearest face.
    pub(super) fn foot(&self, p: Vec3) -> SurfacePoint {
        let (above, below) = (self.bounds.max - p, p - self.bounds.min);
        let axis = above.min(below).min_position();
        let inside = p.max(self.bounds.min).min(self.bounds.max);
        self.on_face(inside, axis, above[axis] <= below[axis])
    }

    fn on_face(&self, mut position: Vec3, axis: usize, is_upper: bool) -> SurfacePoint {
        position[axis] = if is_upper { self.bounds.max[axis] } else { self.bounds.min[axis] };
        let normal = if is_upper { Vec3::AXES[axis] } else { -Vec3::AXES[axis] };
        SurfacePoint { position, normal }
    }

    pub(super) fn check(&self) -> Result<(), InvalidOption> {
        const OWNER: &str = "a box mapping";
        Allowed::Finite.check(OWNER, "the smallest corner", &self.bounds.min.to_array())?;
        Allowed::Finite.check(OWNER, "the largest corner", &self.bounds.max.to_array())?;
        let edges = self.bounds.max - self.bounds.min;
        Allowed::NotNegative.check(OWNER, "an edge", &edges.to_array())?;
        Allowed::NotZero.check(OWNER, "the repeat", &[self.scale])
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
        face.linear(p - self.corner(face)) * self.scale
    }

    fn uv_footprint(&self, _p: Vec3, n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let face = self.face(n);
        [dp_dx, dp_dy].map(|direction| face.linear(direction) * self.scale)
    }
}
