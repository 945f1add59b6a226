//! The camera, as far as demand needs to know it.

use glam::{Mat3, Vec3};

/// A perspective view of a mesh, mesh space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamView {
    /// The pinhole.
    pub eye: Vec3,
    /// Right, up and backward (towards the viewer) unit vectors as columns.
    pub axes: Mat3,
    /// Half the picture's width and height at depth one.
    pub half_extent: [f32; 2],
    /// Pixels per unit of length at depth one, facing the camera.
    pub focal_pixels: f32,
}

impl StreamView {
    /// A view with a vertical opening angle onto a picture of `size` pixels (at least 1x1).
    pub fn new(eye: Vec3, axes: Mat3, fov_radians: f32, size: [u32; 2]) -> Self {
        let tangent = (0.5 * fov_radians).tan();
        let [width, height] = size.map(|n| n.max(1) as f32);
        Self {
            eye,
            axes,
            half_extent: [tangent * width / height, tangent],
            focal_pixels: 0.5 * height / tangent,
        }
    }
}
