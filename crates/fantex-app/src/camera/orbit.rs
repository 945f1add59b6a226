//! Around the model: drag turns, wheel comes closer to what is under the cursor, another button shifts.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::{CameraRig, SceneScale};

/// Radians by which a drag over the whole picture's height turns.
const TURN_PER_HEIGHT: f64 = PI;

/// The eye comes no closer to the pivot than this share of the scene, and goes no farther away than so many scenes.
const DISTANCE_RANGE: [f64; 2] = [1e-6, 50.0];

impl CameraRig {
    /// Turns about the pivot. `drag` is in units of the picture's height, downwards positive: the model follows the hand.
    pub fn orbit(&mut self, drag: DVec2) {
        let pivot = self.pivot();
        self.look(-drag.x * TURN_PER_HEIGHT, -drag.y * TURN_PER_HEIGHT);
        self.eye = pivot - self.forward() * self.distance;
    }

    /// Comes closer to a point (`factor` below one) or goes away from it. What is at the point stays where it is in the
    /// picture.
    pub fn zoom_to(&mut self, point: DVec3, factor: f64, scene: &SceneScale) {
        let [nearest, farthest] = DISTANCE_RANGE.map(|share| share * scene.diagonal);
        // The share that the limits leave of the wish.
        let factor = (self.distance * factor).clamp(nearest, farthest) / self.distance;
        self.eye = point + (self.eye - point) * factor;
        self.distance *= factor;
    }

    /// The point under the cursor: `hit` world units along the ray if something is there, else at the pivot's depth.
    pub fn point_under(&self, position: DVec2, aspect: f64, hit: Option<f64>) -> DVec3 {
        let ray = self.ray(position, aspect);
        let depth = self.distance / ray.dot(self.forward()).max(1e-3);
        self.eye + ray * hit.unwrap_or(depth)
    }

    /// Shifts the camera so that the plane through the pivot follows the hand. `drag` is in units of the picture's height.
    pub fn pan(&mut self, drag: DVec2) {
        let height = 2.0 * self.distance * (self.fov_degrees.to_radians() * 0.5).tan();
        let axes = self.axes();
        self.eye += (axes.y_axis * drag.y - axes.x_axis * drag.x) * height;
    }

    /// Takes a point, such as one of the surface, as the pivot's depth: orbits then keep its distance.
    pub fn set_pivot_depth(&mut self, point: DVec3) {
        let depth = (point - self.eye).dot(self.forward());
        if depth > 0.0 && depth.is_finite() {
            self.distance = depth;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: SceneScale = SceneScale { center: DVec3::ZERO, diagonal: 2.0 };

    fn rig() -> CameraRig {
        let mut rig = CameraRig { eye: DVec3::new(1.0, 2.0, 5.0), distance: 4.0, ..CameraRig::default() };
        rig.look(0.4, -0.3);
        rig
    }

    /// Where in the picture a point is, 0..1 along its sides.
    fn seen(rig: &CameraRig, point: DVec3, aspect: f64) -> DVec2 {
        let p = rig.axes().transpose() * (point - rig.eye);
        let half = (rig.fov_degrees.to_radians() * 0.5).tan();
        DVec2::new(p.x / -p.z / half / aspect, -p.y / -p.z / half) * 0.5 + 0.5
    }

    #[test]
    fn orbits_keep_pivot_and_distance() {
        let mut rig = rig();
        let pivot = rig.pivot();
        for drag in [DVec2::new(0.3, 0.1), DVec2::new(-2.0, 1.0), DVec2::new(0.0, -9.0)] {
            rig.orbit(drag);
            assert!((rig.pivot() - pivot).length() < 1e-9);
            assert!(((rig.eye - pivot).length() - 4.0).abs() < 1e-9);
            assert!(rig.axes().y_axis.y > 0.0, "up is kept");
        }
    }

    #[test]
    fn zoom_keeps_what_is_under_the_cursor() {
        let mut rig = rig();
        let cursor = DVec2::new(0.2, 0.7);
        let point = rig.point_under(cursor, 1.6, Some(3.0));
        assert!((seen(&rig, point, 1.6) - cursor).length() < 1e-9);
        rig.zoom_to(point, 0.5, &SCENE);
        assert!((seen(&rig, point, 1.6) - cursor).length() < 1e-9, "{}", seen(&rig, point, 1.6));
        assert!((rig.eye.distance(point) - 1.5).abs() < 1e-9);
    }

    #[test]
    fn zoom_has_limits_and_comes_back_from_them() {
        let mut rig = rig();
        for _ in 0..1000 {
            rig.zoom_to(DVec3::ZERO, 0.5, &SCENE);
        }
        assert!(rig.is_sound() && rig.distance >= 1e-6);
        for _ in 0..1000 {
            rig.zoom_to(DVec3::ZERO, 2.0, &SCENE);
        }
        assert!(rig.is_sound() && rig.distance <= 101.0);
    }

    #[test]
    fn panning_moves_the_pivot_with_the_hand() {
        let mut rig = rig();
        let point = rig.pivot();
        rig.pan(DVec2::new(0.25, -0.125));
        let moved = seen(&rig, point, 1.0) - 0.5;
        assert!((moved - DVec2::new(0.25, -0.125)).length() < 1e-9, "{moved}");
    }
}
