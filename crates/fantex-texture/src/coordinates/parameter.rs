//! Single numbers of a surface point: the coordinates of one-dimensional textures.

use glam::{Vec2, Vec3, Vec4};

use crate::{Allowed, InvalidOption, ShadingPoint, Texture};

/// A number that every surface point has. As a texture, it gives that number as red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameter {
    /// The distance from the plane through `origin` across `direction`, in units of one over `direction`'s length. The
    /// height, for a direction upwards.
    Along {
        /// Where it is 0.
        origin: Vec3,
        /// In which direction it grows, by its length per unit; not 0.
        direction: Vec3,
    },
    /// The distance from a point, in units of length.
    Distance {
        /// The point.
        center: Vec3,
    },
    /// The angle between the normal and `up` in degrees: 0 on level ground, 90 on a wall, 180 under a ceiling.
    Slope {
        /// The upward direction; of any length but 0.
        up: Vec3,
    },
    /// The cosine between the normal and the direction to the eye, at least 0. Without an eye, 1.
    Facing,
    /// The first texture coordinate; 0 without that set.
    U {
        /// Which set, from 0.
        set: usize,
    },
    /// The second texture coordinate; 0 without that set.
    V {
        /// Which set, from 0.
        set: usize,
    },
    /// Seconds since the start of the animation.
    Time,
}

impl Default for Parameter {
    /// The height: y.
    fn default() -> Self {
        Self::Along { origin: Vec3::ZERO, direction: Vec3::Y }
    }
}

impl Parameter {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        match self {
            Self::Along { origin, direction } => {
                Allowed::Finite.check("a height", "the origin", &origin.to_array())?;
                Allowed::Finite.check("a height", "the direction", &direction.to_array())?;
                Allowed::Positive.check("a height", "the length of the direction", &[direction.length()])
            }
            Self::Distance { center } => {
                Allowed::Finite.check("a distance", "the centre", &center.to_array())
            }
            Self::Slope { up } => {
                Allowed::Finite.check("a slope", "the upward direction", &up.to_array())?;
                Allowed::Positive.check("a slope", "the length of the upward direction", &[up.length()])
            }
            Self::Facing | Self::U { .. } | Self::V { .. } | Self::Time => Ok(()),
        }
    }

    /// The number at a point.
    pub fn value(&self, at: &ShadingPoint<'_>) -> f32 {
        match *self {
            Self::Along { origin, direction } => direction.dot(at.position - origin),
            Self::Distance { center } => at.position.distance(center),
            Self::Slope { up } => at.normal.angle_between(up).to_degrees(),
            Self::Facing => at.to_eye.map_or(1.0, |to_eye| at.normal.dot(to_eye).max(0.0)),
            Self::U { set } => at.uv.get(set).map_or(0.0, |point| point.uv.x),
            Self::V { set } => at.uv.get(set).map_or(0.0, |point| point.uv.y),
            Self::Time => at.time,
        }
    }

    /// The change along the footprint's edges: for all that is not linear in the point, by central differences.
    pub fn steps(&self, at: &ShadingPoint<'_>) -> [f32; 2] {
        let of_set = |set: usize| at.uv.get(set).map_or([Vec2::ZERO; 2], |point| point.steps);
        match *self {
            Self::Along { direction, .. } => at.position_steps.map(|step| direction.dot(step)),
            Self::U { set } => of_set(set).map(|step| step.x),
            Self::V { set } => of_set(set).map(|step| step.y),
            Self::Time => [0.0; 2],
            Self::Distance { .. } | Self::Slope { .. } | Self::Facing => {
                let beside = |a: f32, b: f32| at.shifted(a, b, |point| self.value(point));
                [beside(0.5, 0.0) - beside(-0.5, 0.0), beside(0.0, 0.5) - beside(0.0, -0.5)]
            }
        }
    }
}

impl Texture for Parameter {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        Vec3::splat(self.value(at)).extend(1.0)
    }

    fn is_view_dependent(&self) -> bool {
        *self == Self::Facing
    }

    fn is_animated(&self) -> bool {
        *self == Self::Time
    }
}
