//! Symmetry as the user sets it, and its plane in the scene.

use fantex_paint::Symmetry;
use fantex_scene::Bounds;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What kind of symmetry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SymmetryKind {
    /// None.
    #[default]
    Off,
    /// On the other side of a plane.
    Mirror,
    /// Around an axis.
    Radial,
}

impl SymmetryKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Off, Self::Mirror, Self::Radial];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Off => "Off",
            Self::Mirror => "Mirror",
            Self::Radial => "Radial",
        }
    }
}

/// Where strokes are repeated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SymmetrySettings {
    /// How.
    pub kind: SymmetryKind,
    /// The axis: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// World units from the model's centre to the plane, or of the axis, along the axes.
    pub offset: f64,
    /// Copies around an axis, the stroke itself included.
    pub count: u32,
    /// Whether the plane is shown.
    pub shows_plane: bool,
}

impl Default for SymmetrySettings {
    fn default() -> Self {
        Self { kind: SymmetryKind::Off, axis: 0, offset: 0.0, count: 6, shows_plane: true }
    }
}

impl SymmetrySettings {
    /// As the engine knows it. `center` is the model's, world space.
    pub fn symmetry(&self, center: DVec3) -> Symmetry {
        let axis = self.axis.min(2);
        match self.kind {
            SymmetryKind::Off => Symmetry::None,
            SymmetryKind::Mirror => Symmetry::Mirror { axis, offset: center[axis] + self.offset },
            SymmetryKind::Radial => {
                Symmetry::Radial { axis, center: center.to_array(), count: self.count.clamp(2, 64) }
            }
        }
    }
}

/// The corners of a plane orthogonal to an axis, around the model's box, in order; world space.
pub fn plane_outline(bounds: &Bounds, axis: usize, offset: f64) -> [DVec3; 4] {
    let axis = axis.min(2);
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let center = bounds.center();
    let margin = 0.06 * (bounds.max - bounds.min).length();
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(s, t)| {
        let mut corner = center;
        corner[axis] = offset;
        corner[i] += s * (0.5 * (bounds.max - bounds.min)[i] + margin);
        corner[j] += t * (0.5 * (bounds.max - bounds.min)[j] + margin);
        corner
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_pass_the_centre_unless_moved() {
        let center = DVec3::new(5.0, 1.0, 2.0);
        let settings = SymmetrySettings { kind: SymmetryKind::Mirror, offset: 0.5, ..Default::default() };
        assert_eq!(settings.symmetry(center), Symmetry::Mirror { axis: 0, offset: 5.5 });
        let bounds = Bounds { min: center - 1.0, max: center + 1.0 };
        assert!(plane_outline(&bounds, 0, 5.5).iter().all(|corner| corner.x == 5.5));
    }
}
