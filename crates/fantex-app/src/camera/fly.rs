//! Free flight: keys give a wish, the motion follows it softly.

use glam::DVec3;

use super::{CameraRig, SceneScale};

/// Seconds in which the motion covers most (63 %) of the way to what is wished.
const SOFTNESS_SECONDS: f64 = 0.08;

/// Below this share of the full speed the motion rests.
const REST: f64 = 1e-3;

/// Scene diagonals per second at speed factor one.
const DIAGONALS_PER_SECOND: f64 = 0.2;

/// Which way the user wants to go: -1, 0 or 1 per axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// To the right.
    pub right: f64,
    /// Upwards.
    pub up: f64,
    /// Forwards.
    pub forward: f64,
    /// Faster than usual.
    pub fast: bool,
}

impl Wish {
    /// Whether nothing is wished.
    pub fn is_none(&self) -> bool {
        self.right == 0.0 && self.up == 0.0 && self.forward == 0.0
    }

    /// The wish as a direction, no longer than one.
    pub fn direction(&self, rig: &CameraRig) -> DVec3 {
        let axes = rig.axes();
        let wish = axes.x_axis * self.right + DVec3::Y * self.up - axes.z_axis * self.forward;
        wish.clamp_length_max(1.0)
    }

    /// As [`Wish::direction`], but along the horizon: looking down does not slow a walker.
    pub fn horizontal(&self, rig: &CameraRig) -> DVec3 {
        let right = rig.axes().x_axis;
        let ahead = DVec3::Y.cross(right);
        (right * self.right + ahead * self.forward).clamp_length_max(1.0)
    }

    /// Factor of the speed.
    pub fn haste(&self) -> f64 {
        if self.fast { 4.0 } else { 1.0 }
    }
}

/// A flight under way.
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
    /// At rest.
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

    /// World units per second at full wish.
    pub fn full_speed(&self, scene: &SceneScale) -> f64 {
        self.speed * DIAGONALS_PER_SECOND * scene.diagonal
    }

    /// Moves the camera for a frame. Returns whether it is still moving.
    pub fn step(&mut self, rig: &mut CameraRig, wish: &Wish, scene: &SceneScale, seconds: f64) -> bool {
        let full = self.full_speed(scene) * wish.haste();
        let target = wish.direction(rig) * full;
        // Exact for any length of frame: the rest of the difference decays exponentially.
        let kept = (-seconds / SOFTNESS_SECONDS).exp();
        let before = self.velocity;
        self.velocity = target + (before - target) * kept;
        rig.eye += target * seconds + (before - target) * (SOFTNESS_SECONDS * (1.0 - kept));
        if wish.is_none() && self.velocity.length() < REST * full {
            self.velocity = DVec3::ZERO;
        }
        !wish.is_none() || self.velocity != DVec3::ZERO
    }

    /// Stops at once.
    pub fn stop(&mut self) {
        self.velocity = DVec3::ZERO;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: SceneScale = SceneScale { center: DVec3::ZERO, diagonal: 10.0 };

    fn flown(seconds: f64, frames: u32) -> DVec3 {
        let (mut rig, mut motion) = (CameraRig::default(), FlyMotion::default());
        let wish = Wish { forward: 1.0, ..Wish::default() };
        for _ in 0..frames {
            assert!(motion.step(&mut rig, &wish, &SCENE, seconds / f64::from(frames)));
        }
        rig.eye
    }

    #[test]
    fn the_way_does_not_depend_on_the_frame_rate() {
        assert!((flown(1.0, 10) - flown(1.0, 1000)).length() < 1e-9);
        let way = (flown(2.0, 60) - CameraRig::default().eye).length();
        assert!((3.5..4.0).contains(&way), "two units per second, and a soft start: {way}");
    }

    #[test]
    fn flight_comes_to_rest() {
        let (mut rig, mut motion) = (CameraRig::default(), FlyMotion::default());
        motion.step(&mut rig, &Wish { right: 1.0, ..Wish::default() }, &SCENE, 1.0);
        let steps = (0..200).take_while(|_| motion.step(&mut rig, &Wish::default(), &SCENE, 0.02)).count();
        assert!((5..100).contains(&steps), "{steps}");
    }

    #[test]
    fn speed_stays_within_its_range() {
        let mut motion = FlyMotion::default();
        motion.change_speed(1e4);
        assert_eq!(motion.speed, FlyMotion::SPEEDS[1]);
        motion.change_speed(-1e4);
        assert_eq!(motion.speed, FlyMotion::SPEEDS[0]);
    }

    #[test]
    fn walking_wishes_follow_the_horizon() {
        let mut rig = CameraRig::default();
        rig.look(0.7, -1.5);
        let wish = Wish { forward: 1.0, ..Wish::default() }.horizontal(&rig);
        assert!(wish.y == 0.0 && (wish.length() - 1.0).abs() < 1e-9);
        assert!(wish.dot(rig.forward()) > 0.0);
    }
}
