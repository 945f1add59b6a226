//! Where the viewer stands, and how keys and mouse move it: no window types.
//!
//! ```text
//!  orbit (drag, zoom to the cursor, pan) --.
//!  fly   (keys, mouse look, speed) --------+--> CameraRig --> fantex_scene::Camera
//!  walk  (gravity, steps, walls) ----------'        ^
//!                             Ground (rays) --'     '-- presets, recorded paths
//! ```
//!
//! All modes move one and the same [`CameraRig`], so that changing the mode never changes the picture. World space, +y is up.

mod fly;
mod ground;
mod orbit;
mod path;
mod presets;
mod walk;

use fantex_scene::{Bounds, Camera};
use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

pub use fly::{FlyMotion, Wish};
pub use ground::{Ground, GroundHit, MeshGround};
pub use path::{CameraKey, CameraPath, PathError, PathRecorder};
pub use presets::ViewPreset;
pub use walk::Walker;

/// Steepest look up and down: a little less than straight, so that there is always a right and a left.
const MAX_PITCH: f64 = 89.9 * std::f64::consts::PI / 180.0;

/// How the camera is moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraMode {
    /// Around a point of the model.
    #[default]
    Orbit,
    /// Freely, as a bird.
    Fly,
    /// On the ground, as a person.
    Walk,
}

impl CameraMode {
    /// All modes in the order of their keys.
    pub const ALL: [Self; 3] = [Self::Orbit, Self::Fly, Self::Walk];

    /// Its name on buttons.
    pub fn label(self) -> &'static str {
        match self {
            Self::Orbit => "Orbit",
            Self::Fly => "Fly",
            Self::Walk => "Walk",
        }
    }
}

/// The size of what is looked at, from which speeds follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneScale {
    /// Middle of the model.
    pub center: DVec3,
    /// Length of its bounding box's diagonal, world units, positive.
    pub diagonal: f64,
}

impl SceneScale {
    /// Of a model with these bounds. A point counts as one unit large.
    pub fn of(bounds: &Bounds) -> Self {
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

    /// What renderers are given.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_shows_what_its_camera_shows() {
        let camera = Camera {
            eye: DVec3::new(3.0, 2.0, -5.0),
            target: DVec3::new(0.5, -1.0, 4.0),
            up: DVec3::Y,
            fov_degrees: 50.0,
        };
        let again = CameraRig::of_camera(&camera).camera();
        assert!((again.target - camera.target).length() < 1e-12, "{again:?}");
        assert!((again.eye - camera.eye).length() < 1e-12);
        assert!(again.up.y > 0.9 && again.up.dot(again.target - again.eye).abs() < 1e-9);
    }

    #[test]
    fn axes_are_orthonormal_and_right_handed() {
        for (yaw, pitch) in [(0.0, 0.0), (1.0, 0.5), (4.0, -1.5), (6.0, 1.56)] {
            let rig = CameraRig { yaw, pitch, ..CameraRig::default() };
            let axes = rig.axes();
            assert!((axes.determinant() - 1.0).abs() < 1e-12);
            assert!((axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-12));
        }
    }

    #[test]
    fn rays_go_through_the_picture_the_right_way_round() {
        let rig = CameraRig::default();
        assert!((rig.ray(DVec2::splat(0.5), 1.6) - DVec3::NEG_Z).length() < 1e-12);
        assert!(rig.ray(DVec2::new(1.0, 0.5), 1.6).x > 0.0, "the right border is on the right");
        assert!(rig.ray(DVec2::new(0.5, 0.0), 1.6).y > 0.0, "the first row is above");
    }

    #[test]
    fn looking_straight_down_stays_upright() {
        let mut rig = CameraRig::default();
        rig.look(0.3, -10.0);
        assert!(rig.is_sound() && rig.axes().y_axis.y > 0.0);
    }

    #[test]
    fn eyes_are_at_a_height_that_suits_the_scene() {
        let height = |diagonal| SceneScale { center: DVec3::ZERO, diagonal }.eye_height();
        assert_eq!(height(2000.0), 1.7);
        assert!(height(0.2) < 0.01 && height(1e6) > 100.0);
    }
}
