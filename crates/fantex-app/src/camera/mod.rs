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

use fantex::glam::DVec3;
use fantex::mesh::Mesh;
use fantex::scene::Camera;
pub use fantex::scene::{CameraRig, SceneScale};
pub use path::{PathRecorder, camera_of, load_path, save_path};
use serde::{Deserialize, Serialize};
pub use walk::Walker;
pub use walk::{Ground, GroundHit, MeshGround};

mod path;
mod walk;

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
