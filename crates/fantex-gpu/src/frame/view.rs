//! The camera in mesh space.

use fantex_scene::{Camera, view_axes};
use glam::{DVec3, Mat3, Mat4, Vec3};

use crate::ModelSpace;

/// A perspective view of a model, mesh space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Columns and rows of the picture, at least 1.
    pub size: [u32; 2],
    /// The pinhole.
    pub eye: DVec3,
    /// Right, up and backward (towards the viewer) unit vectors as columns.
    pub axes: Mat3,
    /// Vertical opening angle in radians.
    pub fov_radians: f32,
    /// Depth of the near plane.
    pub near: f32,
}

/// Nearer than this share of the farthest point's depth nothing is drawn, so that depth keeps its digits.
const NEAREST_SHARE: f64 = 1e-5;

impl View {
    /// The view of a camera without defect onto `size` pixels.
    pub fn new(camera: &Camera, size: [u32; 2], space: &ModelSpace) -> Self {
        let frame = space.world_from_mesh;
        let eye = (camera.eye - frame.offset) / frame.scale;
        let backward = (camera.eye - camera.target).normalize_or(DVec3::Z);
        let axes = view_axes(backward, camera.up.normalize_or(DVec3::Y));
        Self {
            size,
            eye,
            axes: axes.as_mat3(),
            fov_radians: camera.fov_degrees.to_radians() as f32,
            near: near_depth(space, eye, -backward) as f32,
        }
    }

    /// Pixels per unit of length at depth one, facing the camera.
    pub fn focal_pixels(&self) -> f32 {
        0.5 * self.size[1] as f32 / (0.5 * self.fov_radians).tan()
    }

    /// From offsets from the eye to clip space. Depth is reversed and has no far end: `near / depth`.
    pub fn clip_from_offset(&self) -> Mat4 {
        let [width, height] = self.size.map(|n| n as f32);
        let focal = 1.0 / (0.5 * self.fov_radians).tan();
        let [right, up, backward] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        Mat4::from_cols(
            (right * (focal * height / width)).extend(0.0),
            (up * focal).extend(0.0),
            Vec3::ZERO.extend(self.near),
            (-backward).extend(0.0),
        )
        .transpose()
    }

    /// The (not normalised) direction through the picture's top left corner, and its change per pixel to the right and
    /// downwards.
    pub fn rays(&self) -> [Vec3; 3] {
        let [width, height] = self.size.map(|n| n as f32);
        let [right, up, backward] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        let pixel = 1.0 / self.focal_pixels();
        let [right, down] = [right * pixel, up * -pixel];
        [-backward - right * (0.5 * width) - down * (0.5 * height), right, down]
    }
}

/// Half of the way to the nearest point that the model's box allows.
fn near_depth(space: &ModelSpace, eye: DVec3, forward: DVec3) -> f64 {
    let [low, high] = space.bounds.map(|p| p.as_dvec3());
    let depths = (0..8).map(|corner| {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        (DVec3::new(pick(0), pick(1), pick(2)) - eye).dot(forward)
    });
    let (nearest, farthest) = depths.fold((f64::INFINITY, 0f64), |(near, far), d| (near.min(d), far.max(d)));
    (nearest * 0.5).max(farthest * NEAREST_SHARE).max(1e-12)
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{Mesh, WorldFromMesh};
    use fantex_scene::Projection;
    use glam::Vec2;

    use super::*;

    /// A view and the CPU renderer's projection of the same camera.
    fn both() -> (View, Projection, Mesh) {
        let mesh = Mesh {
            positions: vec![Vec3::new(-0.5, 0.3, 0.2), Vec3::new(0.7, -0.4, 0.9), Vec3::new(0.1, 0.9, -0.8)],
            triangles: vec![[0, 1, 2]],
            world_from_mesh: WorldFromMesh { offset: DVec3::new(1e4, -20.0, 3.0), scale: 32.0 },
            ..Mesh::default()
        };
        let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
        let size = [300, 200];
        (View::new(&camera, size, &ModelSpace::of_mesh(&mesh)), Projection::new(&camera, size, &mesh), mesh)
    }

    #[test]
    fn points_are_where_the_cpu_renderer_sees_them() {
        let (view, projection, mesh) = both();
        for &p in &mesh.positions {
            let clip = view.clip_from_offset() * (p.as_dvec3() - view.eye).as_vec3().extend(1.0);
            let seen = Vec2::new(clip.x, -clip.y) / clip.w * 0.5 + 0.5;
            let h = projection.project(p);
            let pixel = h.truncate() / h.z;
            assert!((seen.as_dvec2() * glam::DVec2::new(300.0, 200.0) - pixel).length() < 1e-3);
            assert!((f64::from(clip.w) - h.z).abs() < 1e-5);
            assert!(clip.z > 0.0 && clip.z < clip.w, "nearer than the near plane: {clip}");
        }
    }

    #[test]
    fn rays_go_through_their_pixels() {
        let (view, projection, _) = both();
        let [corner, right, down] = view.rays();
        for pixel in [Vec2::ZERO, Vec2::new(150.0, 100.0), Vec2::new(299.5, 10.5)] {
            let direction = (corner + right * pixel.x + down * pixel.y).normalize();
            assert!((direction - projection.direction(pixel).as_vec3()).length() < 1e-5, "{pixel}");
        }
    }
}
