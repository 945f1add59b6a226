//! Directions by which cube and environment maps are looked up.

use glam::Vec3;

use crate::mapping::reflected;
use crate::{Allowed, InvalidOption, ShadingPoint};

/// A direction that every surface point has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Direction {
    /// The view ray, reflected. Without an eye, the normal.
    #[default]
    Reflection,
    /// The normal.
    Normal,
    /// From the eye to the point. Without an eye, against the normal.
    View,
    /// From a point to the surface.
    From {
        /// The point, object space.
        center: Vec3,
    },
}

/// A direction with its change along the footprint's edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionPoint {
    /// Unit vector, object space.
    pub direction: Vec3,
    /// Change along the footprint's edges. The eye counts as far away: what a plane mirror shows changes more.
    pub steps: [Vec3; 2],
}

impl Direction {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        match self {
            Self::From { center } => Allowed::Finite.check("a direction", "the centre", &center.to_array()),
            Self::Reflection | Self::Normal | Self::View => Ok(()),
        }
    }

    /// Whether it depends on the eye.
    pub fn is_view_dependent(&self) -> bool {
        matches!(self, Self::Reflection | Self::View)
    }

    /// The direction at a point.
    pub fn at(&self, at: &ShadingPoint<'_>) -> DirectionPoint {
        let (n, normal_steps) = (at.normal, at.normal_steps);
        match (*self, at.to_eye) {
            (Self::Normal, _) | (Self::Reflection, None) => {
                DirectionPoint { direction: n, steps: normal_steps }
            }
            (Self::Reflection, Some(to_eye)) => DirectionPoint {
                direction: reflected(to_eye, n),
                steps: normal_steps.map(|dn| 2.0 * (dn.dot(to_eye) * n + n.dot(to_eye) * dn)),
            },
            (Self::View, to_eye) => {
                DirectionPoint { direction: -to_eye.unwrap_or(n), steps: [Vec3::ZERO; 2] }
            }
            (Self::From { center }, _) => {
                let arm = at.position - center;
                let direction = arm.normalize_or(n);
                // A step longer than the arm turns the direction by a radian at most.
                let reach = |dp: Vec3| arm.length().max(dp.length()).max(f32::MIN_POSITIVE);
                let across = |dp: Vec3| (dp - direction * direction.dot(dp)) / reach(dp);
                DirectionPoint { direction, steps: at.position_steps.map(across) }
            }
        }
    }
}
