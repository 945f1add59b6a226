//! What depends on the eye: the angle to it, and what a mirror shows to it.

use glam::{Mat3, Vec3};

use crate::environment::{mirrored, mirrored_steps};

/// Relative difference of lengths that single precision does not tell from rounding.
const ROUNDING: f32 = 1e-5;

/// How a scene stretches an object: neither angles nor the law of reflection outlast that.
#[derive(Clone, Copy, Debug)]
pub struct Stretch {
    scene_from_object: Mat3,
    object_from_scene: Mat3,
}

impl Stretch {
    /// The linear part of an object's place in its scene. Nothing where it keeps angles, or leaves no volume.
    pub fn of(scene_from_object: Mat3) -> Option<Self> {
        let products = scene_from_object.transpose() * scene_from_object;
        let mean = (products.x_axis.x + products.y_axis.y + products.z_axis.z) / 3.0;
        let keeps_angles = (products * mean.recip()).abs_diff_eq(Mat3::IDENTITY, ROUNDING);
        let object_from_scene = scene_from_object.inverse();
        let is_needed = !keeps_angles && object_from_scene.is_finite();
        is_needed.then_some(Self { scene_from_object, object_from_scene })
    }

    fn direction(&self, own: Vec3) -> Vec3 {
        (self.scene_from_object * own).normalize_or(own)
    }

    fn normal(&self, own: Vec3) -> Vec3 {
        (self.object_from_scene.transpose() * own).normalize_or(own)
    }
}

/// The eye as seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct Eye<'a> {
    /// Unit vector to it, object space.
    pub direction: Vec3,
    /// What the scene does to the object, where angles change by it: those of the scene count.
    pub stretch: Option<&'a Stretch>,
}

impl From<Vec3> for Eye<'_> {
    fn from(direction: Vec3) -> Self {
        Self { direction, stretch: None }
    }
}

impl Eye<'_> {
    /// The cosine between a unit normal, object space, and the direction to the eye, -1..1.
    pub fn cosine(&self, normal: Vec3) -> f32 {
        match self.stretch {
            None => normal.dot(self.direction),
            Some(stretch) => stretch.normal(normal).dot(stretch.direction(self.direction)),
        }
    }

    /// The direction that a mirror with a unit normal shows to the eye; all in object space.
    pub fn mirrored(&self, normal: Vec3) -> Vec3 {
        let Some(stretch) = self.stretch else { return mirrored(normal, self.direction) };
        let shown = mirrored(stretch.normal(normal), stretch.direction(self.direction));
        (stretch.object_from_scene * shown).normalize_or(normal)
    }

    /// The same with its change along a footprint's edges, from that of the normal.
    pub(crate) fn mirrored_with_steps(&self, normal: Vec3, normal_steps: [Vec3; 2]) -> (Vec3, [Vec3; 2]) {
        let Some(stretch) = self.stretch else {
            let steps = mirrored_steps(normal, normal_steps, self.direction, [Vec3::ZERO; 2]);
            return (mirrored(normal, self.direction), steps);
        };
        let mirror = || {
            let (normal, steps) =
                unit_with_steps(stretch.object_from_scene.transpose(), normal, normal_steps)?;
            let to_eye = stretch.direction(self.direction);
            let steps = mirrored_steps(normal, steps, to_eye, [Vec3::ZERO; 2]);
            unit_with_steps(stretch.object_from_scene, mirrored(normal, to_eye), steps)
        };
        mirror().unwrap_or((normal, normal_steps))
    }
}

/// A vector as a matrix maps it, normalised, with its change: of `v / |v|` that is `(dv - u (u . dv)) / |v|`. Nothing where it has no
/// direction.
pub(crate) fn unit_with_steps(matrix: Mat3, vector: Vec3, steps: [Vec3; 2]) -> Option<(Vec3, [Vec3; 2])> {
    let mapped = matrix * vector;
    let unit = mapped.try_normalize()?;
    let steps = steps.map(|step| {
        let change = matrix * step;
        (change - unit * unit.dot(change)) / mapped.length()
    });
    Some((unit, steps))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane tilted by 45 degrees that is three times as long along x: its normal stands at 18.4 degrees from the vertical.
    #[test]
    fn angles_are_those_of_the_scene() {
        let stretch = Stretch::of(Mat3::from_diagonal(Vec3::new(3.0, 1.0, 1.0))).unwrap();
        let eye = Eye { direction: Vec3::Y, stretch: Some(&stretch) };
        let normal = Vec3::new(-1.0, 1.0, 0.0).normalize();
        assert!((eye.cosine(normal) - 0.9486833).abs() < 1e-6);
        // In the scene (-0.6, 0.8, 0).
        let expected = Vec3::new(-0.2, 0.8, 0.0).normalize();
        assert!(eye.mirrored(normal).abs_diff_eq(expected, 1e-6));
    }

    #[test]
    fn changes_are_those_of_the_direction() {
        let stretch = Stretch::of(Mat3::from_cols(
            Vec3::new(2.0, 0.3, 0.0),
            Vec3::new(-0.1, 0.5, 0.4),
            Vec3::new(0.0, 0.2, 1.0),
        ));
        let eye = Eye { direction: Vec3::new(0.6, 0.0, 0.8), stretch: stretch.as_ref() };
        let normal = Vec3::new(0.2, -0.3, 0.9).normalize();
        let along = normal.any_orthonormal_vector();
        let (_, [step, _]) = eye.mirrored_with_steps(normal, [along, Vec3::ZERO]);
        let beside = |side: f32| eye.mirrored((normal + along * (side * 1e-2)).normalize());
        let measured = (beside(1.0) - beside(-1.0)) / 2e-2;
        assert!((step - measured).length() < 1e-3 * measured.length(), "{step} {measured}");
    }

    #[test]
    fn turns_mirrors_and_sizes_keep_angles() {
        let turn = Mat3::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 2.0);
        assert!(Stretch::of(turn * 250.0).is_none());
        assert!(Stretch::of(turn * Mat3::from_diagonal(Vec3::new(-0.01, 0.01, 0.01))).is_none());
        assert!(Stretch::of(Mat3::from_diagonal(Vec3::new(1.0, 1.0, 0.0))).is_none());
        assert!(Stretch::of(turn * Mat3::from_diagonal(Vec3::new(1.0, 1.001, 1.0))).is_some());
    }
}
