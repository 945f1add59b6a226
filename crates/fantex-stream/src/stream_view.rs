//! The camera, as far as demand needs to know it.

use fantex_mesh::WorldFromMesh;
use glam::{DMat3, DVec3, Mat3, Vec3};

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

    /// The same of a camera in world space. `axes`: right, up and backward.
    pub fn in_world(
        world_from_mesh: &WorldFromMesh,
        eye: DVec3,
        axes: DMat3,
        fov_degrees: f64,
        size: [u32; 2],
    ) -> Self {
        let fov_radians = fov_degrees.to_radians() as f32;
        Self::new(world_from_mesh.inverse_point(eye), axes.as_mat3(), fov_radians, size)
    }

    /// A view that a page states in fifteen numbers, world space: the eye; unit vectors to the right, upwards and backwards; half the
    /// picture's width and height at depth one; pixels per unit of length at depth one. `None` where there are fewer.
    pub fn of_numbers(world_from_mesh: &WorldFromMesh, numbers: &[f64]) -> Option<Self> {
        let vector = |first: usize| Some(DVec3::from_slice(numbers.get(first..first + 3)?));
        let axis = |first| Some(vector(first)?.as_vec3().normalize_or_zero());
        Some(Self {
            eye: world_from_mesh.inverse_point(vector(0)?),
            axes: Mat3::from_cols(axis(3)?, axis(6)?, axis(9)?),
            half_extent: [*numbers.get(12)? as f32, *numbers.get(13)? as f32],
            focal_pixels: *numbers.get(14)? as f32,
        })
    }
}
