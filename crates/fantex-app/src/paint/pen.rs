//! The pen in the scene: from places in the picture to points of the surface.

use fantex_paint::{Surface, SurfacePoint};
use glam::{DVec2, DVec3};

use crate::camera::CameraRig;

/// What the pen did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PenPhase {
    /// It touched.
    Down,
    /// It moved, touching.
    Move,
    /// It left.
    Up,
}

/// Something that the pen did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PenEvent {
    /// What.
    pub phase: PenPhase,
    /// Where, 0..1 along the scene's sides.
    pub at: DVec2,
    /// 0..1; 1 where the system does not tell.
    pub pressure: f32,
}

/// From where the scene is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The camera.
    pub rig: CameraRig,
    /// Width and height of the scene in pixels.
    pub pixels: [u32; 2],
}

impl Viewpoint {
    /// Width by height.
    pub fn aspect(&self) -> f64 {
        let [width, height] = self.pixels.map(|n| f64::from(n.max(1)));
        width / height
    }

    /// The first point of the surface under a place in the picture.
    pub fn hit(&self, surface: &Surface, at: DVec2) -> Option<SurfacePoint> {
        let place = surface.mesh().world_from_mesh;
        let ray = self.rig.ray(at, self.aspect());
        surface.hit(place.inverse_point(self.rig.eye), ray.as_vec3())
    }

    /// Where a point of world space is in the picture; none behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let seen = self.rig.axes().transpose() * (point - self.rig.eye);
        if seen.z > -1e-9 * self.rig.distance.max(1e-300) {
            return None;
        }
        let half = (self.rig.fov_degrees.to_radians() * 0.5).tan();
        let [x, y] = [seen.x / -seen.z / (half * self.aspect()), seen.y / -seen.z / half];
        Some(DVec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y))
    }

    /// World units that a pixel covers at a point.
    pub fn world_per_pixel(&self, point: DVec3) -> f64 {
        let depth = (point - self.rig.eye).dot(self.rig.forward()).max(1e-12);
        let half = (self.rig.fov_degrees.to_radians() * 0.5).tan();
        2.0 * half * depth / f64::from(self.pixels[1].max(1))
    }
}

/// World-space position of a point of a surface.
pub(super) fn world_position(surface: &Surface, point: SurfacePoint) -> DVec3 {
    surface.mesh().world_from_mesh.point(surface.position(point).as_vec3())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_ray_meets_is_seen_where_it_started() {
        let view = Viewpoint {
            rig: CameraRig { yaw: 0.4, pitch: -0.2, ..CameraRig::default() },
            pixels: [800, 500],
        };
        for at in [DVec2::new(0.5, 0.5), DVec2::new(0.1, 0.8), DVec2::new(0.95, 0.03)] {
            let point = view.rig.eye + 7.0 * view.rig.ray(at, view.aspect());
            assert!((view.project(point).unwrap() - at).length() < 1e-9);
        }
        assert_eq!(view.project(view.rig.eye - view.rig.forward()), None);
        let middle = view.rig.eye + 4.0 * view.rig.forward();
        let beside = middle + view.rig.axes().y_axis * view.world_per_pixel(middle);
        let moved = (view.project(beside).unwrap() - view.project(middle).unwrap()) * 500.0;
        assert!((moved.length() - 1.0).abs() < 1e-9);
    }
}
