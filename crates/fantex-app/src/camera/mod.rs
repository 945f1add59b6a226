//! Where the viewer stands, and how keys and mouse move it: no window types.
//!
//! ```text
//!  orbit (drag, zoom to the cursor, pan) --.
//!  fly   (keys, mouse look, speed) --------+--> CameraRig --> fantex::scene::Camera
//!  walk  (gravity, steps, walls) ----------'        ^
//!                             Ground (rays) --'     '-- presets, recorded paths
//! ```
//!
//! All modes move one and the same [`CameraRig`], so that changing the mode never changes the picture. World space, +y is up.

use std::f64::consts::PI;

use fantex::base::Aabb;
use fantex::glam::{DMat3, DVec2, DVec3};
use fantex::mesh::Mesh;
use fantex::scene::Camera;
pub use path::{PathRecorder, camera_of, load_path, save_path};
use serde::{Deserialize, Serialize};
pub use walk::Walker;
pub use walk::{Ground, GroundHit, MeshGround};

mod path;
mod walk;

/// Steepest look up and down: a little less than straight, so that there is always a right and a left.
const MAX_PITCH: f64 = 89.9 * std::f64::consts::PI / 180.0;

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
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Orbit, "Orbit"), (Self::Fly, "Fly"), (Self::Walk, "Walk")];
}

/// The size of what is looked at, from which speeds follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneScale {
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
}

/// Seconds in which the motion covers most (63 %) of the way to what is wished.
const SOFTNESS_SECONDS: f64 = 0.08;

/// Below this share of the full speed the motion rests.
const MIN_SPEED_SHARE: f64 = 1e-3;

/// Scene diagonals per second at speed factor one.
const DIAGONALS_PER_SECOND: f64 = 0.2;

/// Which way the user wants to go: -1, 0 or 1 per axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MoveInput {
    pub right: f64,
    pub up: f64,
    pub forward: f64,
    pub fast: bool,
}

impl MoveInput {
    pub fn is_none(&self) -> bool {
        self.right == 0.0 && self.up == 0.0 && self.forward == 0.0
    }

    /// The movement as a direction, no longer than one.
    pub fn direction(&self, rig: &CameraRig) -> DVec3 {
        let axes = rig.axes();
        let movement = axes.x_axis * self.right + DVec3::Y * self.up - axes.z_axis * self.forward;
        movement.clamp_length_max(1.0)
    }

    /// As [`MoveInput::direction`], but along the horizon: looking down does not slow a walker.
    pub fn horizontal(&self, rig: &CameraRig) -> DVec3 {
        let right = rig.axes().x_axis;
        let ahead = DVec3::Y.cross(right);
        (right * self.right + ahead * self.forward).clamp_length_max(1.0)
    }

    pub fn speed_factor(&self) -> f64 {
        if self.fast { 4.0 } else { 1.0 }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlyMotion {
    /// Factor of the usual speed, which the wheel changes.
    pub speed: f64,
    /// World units per second.
    velocity: DVec3,
}

impl Default for FlyMotion {
    fn default() -> Self {
        Self::new(1.0)
    }
}

impl FlyMotion {
    pub fn new(speed: f64) -> Self {
        Self { speed, velocity: DVec3::ZERO }
    }

    /// Least and greatest speed factor.
    pub const SPEEDS: [f64; 2] = [1e-3, 100.0];

    /// Faster (positive notches of the wheel) or slower.
    pub fn change_speed(&mut self, notches: f64) {
        let [least, most] = Self::SPEEDS;
        self.speed = (self.speed * 1.2f64.powf(notches)).clamp(least, most);
    }

    /// World units per second at full movement.
    pub fn full_speed(&self, scene: &SceneScale) -> f64 {
        self.speed * DIAGONALS_PER_SECOND * scene.diagonal
    }

    /// Moves the camera for a frame. Returns whether it is still moving.
    pub fn step(
        &mut self,
        rig: &mut CameraRig,
        movement: &MoveInput,
        scene: &SceneScale,
        seconds: f64,
    ) -> bool {
        let full = self.full_speed(scene) * movement.speed_factor();
        let target = movement.direction(rig) * full;
        // Exact for any length of frame: the rest of the difference decays exponentially.
        let kept = (-seconds / SOFTNESS_SECONDS).exp();
        let before = self.velocity;
        self.velocity = target + (before - target) * kept;
        rig.eye += target * seconds + (before - target) * (SOFTNESS_SECONDS * (1.0 - kept));
        if movement.is_none() && self.velocity.length() < MIN_SPEED_SHARE * full {
            self.velocity = DVec3::ZERO;
        }
        !movement.is_none() || self.velocity != DVec3::ZERO
    }

    pub fn stop(&mut self) {
        self.velocity = DVec3::ZERO;
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewPreset {
    /// From the front, the right and above.
    ThreeQuarter,
    /// From +z.
    Front,
    /// From -z.
    Back,
    /// From -x.
    Left,
    /// From +x.
    Right,
    /// From +y, the front below.
    Top,
    /// From -y.
    Bottom,
}

impl ViewPreset {
    pub const ALL: [(Self, &'static str); 7] = [
        (Self::ThreeQuarter, "Three-quarter"),
        (Self::Front, "Front"),
        (Self::Back, "Back"),
        (Self::Left, "Left"),
        (Self::Right, "Right"),
        (Self::Top, "Top"),
        (Self::Bottom, "Bottom"),
    ];

    /// From the model to the camera.
    pub fn direction(self) -> DVec3 {
        match self {
            Self::ThreeQuarter => Camera::THREE_QUARTER,
            Self::Front => DVec3::Z,
            Self::Back => DVec3::NEG_Z,
            Self::Left => DVec3::NEG_X,
            Self::Right => DVec3::X,
            // A little off the axis, so that the front is below in the picture.
            Self::Top => DVec3::new(0.0, 1.0, 2e-3),
            Self::Bottom => DVec3::new(0.0, -1.0, 2e-3),
        }
    }

    /// The view of a mesh. `aspect` is width / height.
    pub fn rig(self, mesh: &Mesh, aspect: f64) -> CameraRig {
        CameraRig::of_camera(&Camera::framing_mesh(mesh, self.direction(), aspect))
    }
}

impl CameraRig {
    /// Shows the whole mesh from where the camera looks now.
    pub fn frame_all(&mut self, mesh: &Mesh, aspect: f64) {
        *self = Self::of_camera(&Camera::framing_mesh(mesh, -self.forward(), aspect));
    }
}
