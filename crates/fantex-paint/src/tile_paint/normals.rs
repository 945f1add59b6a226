//! Normals on their way from one place to another.
//!
//! A tile stores normals in a frame of its own. What is taken from one place and laid down at another goes through the tangent
//! plane: the part of a normal along the surface, as a vector in mesh space, with alpha as w. So a flat normal stays flat
//! wherever it goes, and values of different tiles can be mixed.

use glam::{Vec3, Vec4};

use crate::{Surface, SurfacePoint};

/// From what a tile stores (x and y in 0..1).
pub(crate) fn tangent_from_stored(surface: &Surface, group: u32, point: SurfacePoint, stored: Vec4) -> Vec4 {
    let [x_axis, y_axis] = axes(surface, group, point);
    (x_axis * (2.0 * stored.x - 1.0) + y_axis * (2.0 * stored.y - 1.0)).extend(stored.w)
}

/// To what a tile stores.
pub(crate) fn stored_from_tangent(surface: &Surface, group: u32, point: SurfacePoint, tangent: Vec4) -> Vec4 {
    let [x_axis, y_axis] = axes(surface, group, point);
    let along = tangent.truncate();
    let (x, y) = (along.dot(x_axis), along.dot(y_axis));
    let half = 0.5 / x.hypot(y).max(1.0);
    Vec4::new(0.5 + half * x, 0.5 + half * y, 0.0, tangent.w)
}

/// From a picture's red and green (x to the right, y upwards) where the picture's axes lie so in mesh space.
pub(crate) fn tangent_from_picture(color: Vec4, [right, up]: [Vec3; 2]) -> Vec4 {
    (right * (2.0 * color.x - 1.0) + up * (2.0 * color.y - 1.0)).extend(color.w)
}

fn axes(surface: &Surface, group: u32, point: SurfacePoint) -> [Vec3; 2] {
    surface.cover().groups[group as usize].shading_axes(surface.normal(point))
}
