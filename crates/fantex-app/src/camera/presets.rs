//! Views that show the whole model.

use fantex_mesh::Mesh;
use fantex_scene::Camera;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::CameraRig;

/// A side of the model.
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
    /// All views in the order of their keys.
    pub const ALL: [Self; 7] =
        [Self::ThreeQuarter, Self::Front, Self::Back, Self::Left, Self::Right, Self::Top, Self::Bottom];

    /// Its name in menus.
    pub fn label(self) -> &'static str {
        match self {
            Self::ThreeQuarter => "Three-quarter",
            Self::Front => "Front",
            Self::Back => "Back",
            Self::Left => "Left",
            Self::Right => "Right",
            Self::Top => "Top",
            Self::Bottom => "Bottom",
        }
    }

    /// From the model to the camera.
    fn direction(self) -> DVec3 {
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

#[cfg(test)]
mod tests {
    use fantex_mesh::generate::torus;
    use fantex_mesh::{CleanOptions, clean};

    use super::*;

    #[test]
    fn every_side_is_seen_upright() {
        let (mesh, _) = clean(torus(32, 16), &CleanOptions::default()).unwrap();
        for preset in ViewPreset::ALL {
            let rig = preset.rig(&mesh, 1.5);
            assert!(rig.is_sound());
            assert!(rig.forward().dot(-preset.direction().normalize()) > 0.999, "{preset:?}");
        }
        let top = ViewPreset::Top.rig(&mesh, 1.5);
        assert!(top.axes().y_axis.dot(DVec3::NEG_Z) > 0.99, "the front is below: {}", top.axes().y_axis);
    }

    #[test]
    fn framing_keeps_the_direction() {
        let (mesh, _) = clean(torus(32, 16), &CleanOptions::default()).unwrap();
        let mut rig = CameraRig { eye: DVec3::splat(90.0), ..CameraRig::default() };
        rig.look(0.6, -0.4);
        let before = rig.forward();
        rig.frame_all(&mesh, 1.5);
        assert!(rig.forward().dot(before) > 0.999_999);
        assert!(rig.eye.length() < 20.0);
    }
}
