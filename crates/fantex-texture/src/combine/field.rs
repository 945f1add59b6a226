//! What the surface itself says, as colours.

use glam::{Vec3, Vec4};

use crate::{Allowed, InvalidOption, ShadingPoint, Texture};

/// A colour that every surface point has. (Single numbers are [`Parameter`](crate::coordinates::Parameter)s.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Field {
    /// The model's vertex colours.
    VertexColor,
    /// The normal, `[-1,1]` as `[0,1]`.
    Normal,
    /// The position, `min` black and `max` white.
    Position {
        /// Smallest coordinates.
        min: Vec3,
        /// Largest coordinates; different from the smallest along each axis.
        max: Vec3,
    },
    /// Texture coordinates as red and green; black without that set.
    Uv {
        /// Which set, from 0.
        set: usize,
    },
}

impl Field {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        let Self::Position { min, max } = self else { return Ok(()) };
        Allowed::Finite.check("a position field", "'min'", &min.to_array())?;
        Allowed::Finite.check("a position field", "'max'", &max.to_array())?;
        Allowed::NotZero.check("a position field", "'max' minus 'min'", &(*max - *min).to_array())
    }
}

impl Texture for Field {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        match *self {
            Self::VertexColor => at.vertex_color,
            Self::Normal => (0.5 + 0.5 * at.normal).extend(1.0),
            Self::Position { min, max } => ((at.position - min) / (max - min)).extend(1.0),
            Self::Uv { set } => {
                let uv = at.uv.get(set).map_or(glam::Vec2::ZERO, |point| point.uv);
                Vec4::new(uv.x, uv.y, 0.0, 1.0)
            }
        }
    }
}
