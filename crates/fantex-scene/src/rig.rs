//! Where somebody stands who moves a camera by hand, and how drags and wheels move it: no window types. World space, +y is up.

use std::f64::consts::PI;

use fantex_base::Aabb;
use fantex_mesh::Mesh;
use glam::{DMat3, DVec2, DVec3};

use crate::Camera;

/// Steepest look up and down: a little less than straight, so that there is always a right and a left.
const MAX_PITCH: f64 = 89.9 * std::f64::consts::PI / 180.0;

/// The size of what is looked at, from which speeds follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneScale {
    /// Its bounding box's centre, world space.
    pub center: DVec3,
    /// Length of its bounding box's diagonal, world units, positive.
    pub diagonal: f64,
}

impl SceneScale {
    /// Of a model with these bounds. A point counts as one unit large.
    pub fn of(bounds: &Aabb<DVec3>) -> Self {
        let diagonal = (bounds.max - bounds.min).length();
        let diagonal = if diagonal > 0.0 && diagonal.is_finite() { diagonal } else { 1.0 };
        Self { center: bounds.center(), diagonal }
    }

    /// How high the eyes of someone are who walks here: 1.7 units where that suits the model (units are metres then), else a
    /// share of the model.
    pub fn eye_height(&self) -> f64 {
        let least = self.diagonal / 4000.0;
        let largest = self.diagonal / 25.0;
        1.7f64.clamp(least, largest)
    }
}

impl Default for SceneScale {
    fn default() -> Self {
        Self { center: DVec3::ZERO, diagonal: 2.0 }
    }
}

/// The camera's place and direction, whatever moves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRig {
    /// The pinhole, world space.
    pub eye: DVec3,
    /// Radians to the left about +y; 0 looks along -z.
    pub yaw: f64,
    /// Radians upwards, within a little less than a right angle.
    pub pitch: f64,
    /// World units to the pivot of orbits, along the line of sight; positive.
    pub distance: f64,
    /// Vertical opening angle in degrees.
    pub fov_degrees: f64,
}

impl Default for CameraRig {
    fn default() -> Self {
        Self { eye: DVec3::Z * 3.0, yaw: 0.0, pitch: 0.0, distance: 3.0, fov_degrees: 35.0 }
    }
}

impl CameraRig {
    /// The rig that shows what a camera shows; a tilted horizon is put upright.
    pub fn of_camera(camera: &Camera) -> Self {
        let sight = camera.target - camera.eye;
        let mut rig = Self {
            eye: camera.eye,
            distance: sight.length().max(f64::MIN_POSITIVE),
            fov_degrees: camera.fov_degrees,
            ..Self::default()
        };
        rig.look_along(sight.normalize_or(DVec3::NEG_Z));
        rig
    }

    /// The camera that shows the same.
    pub fn camera(&self) -> Camera {
        Camera { eye: self.eye, target: self.pivot(), up: self.axes().y_axis, fov_degrees: self.fov_degrees }
    }

    /// Unit vector along the line of sight.
    pub fn forward(&self) -> DVec3 {
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch.sin_cos();
        DVec3::new(-sin_yaw * cos_pitch, sin_pitch, -cos_yaw * cos_pitch)
    }

    /// Right, up and backward unit vectors as columns.
    pub fn axes(&self) -> DMat3 {
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let right = DVec3::new(cos_yaw, 0.0, -sin_yaw);
        let backward = -self.forward();
        DMat3::from_cols(right, backward.cross(right), backward)
    }

    /// The point that orbits go around.
    pub fn pivot(&self) -> DVec3 {
        self.eye + self.forward() * self.distance
    }

    /// Turns the line of sight; the eye stays.
    pub fn look(&mut self, yaw: f64, pitch: f64) {
        self.yaw = (self.yaw + yaw).rem_euclid(std::f64::consts::TAU);
        self.pitch = (self.pitch + pitch).clamp(-MAX_PITCH, MAX_PITCH);
    }

    /// Turns the line of sight along a unit vector.
    fn look_along(&mut self, forward: DVec3) {
        self.pitch = forward.y.clamp(-1.0, 1.0).asin().clamp(-MAX_PITCH, MAX_PITCH);
        // Straight up or down there is no yaw to be seen: the old one stays.
        if forward.x.hypot(forward.z) > 1e-9 {
            self.yaw = (-forward.x).atan2(-forward.z).rem_euclid(std::f64::consts::TAU);
        }
    }

    /// The unit direction from the eye through a position in the picture: `[0, 0]` is its top left corner, `[1, 1]` its bottom
    /// right one. `aspect` is width / height.
    pub fn ray(&self, position: DVec2, aspect: f64) -> DVec3 {
        let half = (self.fov_degrees.to_radians() * 0.5).tan();
        let on_screen = DVec2::new((position.x * 2.0 - 1.0) * half * aspect, (1.0 - position.y * 2.0) * half);
        (self.axes() * on_screen.extend(-1.0)).normalize()
    }

    /// Whether all numbers are usable; a rig that fails this must not be shown.
    pub fn is_sound(&self) -> bool {
        self.eye.is_finite()
            && self.yaw.is_finite()
            && self.pitch.is_finite()
            && self.distance > 0.0
            && self.distance.is_finite()
            && self.camera().defect().is_none()
    }
}

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
        // The share that the limits leave of the movement.
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

    /// Shows the whole mesh from where the camera looks now.
    pub fn frame_all(&mut self, mesh: &Mesh, aspect: f64) {
        *self = Self::of_camera(&Camera::framing_mesh(mesh, -self.forward(), aspect));
    }

    /// Turns to a point and takes it as the pivot.
    pub fn look_at(&mut self, point: DVec3) {
        let camera = Camera { target: point, ..self.camera() };
        if camera.defect().is_none() {
            *self = Self::of_camera(&camera);
        }
    }
}
