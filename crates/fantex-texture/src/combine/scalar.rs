//! Numbers as colours: colour scales, contour lines, and what the surface itself says.

use glam::{Vec3, Vec4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Channel, interval, mix};
use crate::look::Slot;
use crate::{Allowed, Color, ColorRamp, Dependence, ShadingPoint, Texture};

// A scalar in false colours.

/// A number of a texture as index of a colour scale, averaged over the numbers within the footprint, so that jumps of the
/// scale have smooth edges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields, description = "A colour scale.")]
pub struct RampTexture<I = Slot> {
    /// The number.
    pub input: I,
    /// Which number of the input.
    #[serde(skip)]
    pub channel: Channel,
    /// The colours.
    #[serde(flatten)]
    pub ramp: ColorRamp,
}

impl Texture for RampTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (center, width) = interval(&self.input, self.channel, at);
        self.ramp.mean(center - 0.5 * width, center + 0.5 * width)
    }

    depends_on!(input);
}

// Contour lines.

nodes! {
    /// Lines where a number of a texture is a multiple of the spacing, drawn over another texture.
    ///
    /// A line's share of the footprint is found in closed form from the input's change over it, so lines are smooth, and where
    /// they are too close to be told apart, they become an even tint.
    #[schemars(extend("required" = ["input", "spacing"]), description = "Contour lines.")]
    pub struct Contours {
        /// Which number of the input.
        #[serde(skip)]
        pub channel: Channel = Channel::Red,
        /// Step between two lines.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub spacing: f32 = 1.0,
        /// The number of one of the lines.
        pub offset: f32 = 0.0,
        /// Width of the lines in pixels.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub pixels: f32 = 1.5,
        /// Width of the lines in units of the number instead.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub width: Option<f32> = None,
        inputs {
            /// The number.
            pub input = 0.0,
            /// Colour of the lines.
            pub color = Color::BLACK,
            /// What is between them.
            pub over = Color::WHITE,
        }
    }
}

impl Contours {
    /// Lines at multiples of `spacing` of a texture's red, one and a half pixels wide, black on white.
    pub fn new(input: Slot, spacing: f32) -> Self {
        Self { input, spacing, ..Self::default() }
    }

    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
        const OWNER: &str = "contour lines";
        Allowed::Positive.check(OWNER, "the spacing", &[self.spacing])?;
        Allowed::Finite.check(OWNER, "the offset", &[self.offset])?;
        Allowed::NotNegative.check(OWNER, "the width", &[self.width.unwrap_or(self.pixels)])
    }

    fn coverage(&self, at: &ShadingPoint<'_>) -> f32 {
        let (center, reach) = interval(&self.input, self.channel, at);
        let line = self.width.unwrap_or(self.pixels * reach);
        line_share((center - self.offset) / self.spacing, reach / self.spacing, line / self.spacing)
    }
}

/// The share of the interval of length `reach` around `center` that lies in lines of the given width around the integers.
fn line_share(center: f32, reach: f32, width: f32) -> f32 {
    if width >= 1.0 {
        return 1.0;
    }
    let center = center - center.round();
    let half = 0.5 * width;
    // Below this, a jump is a jump: the quotient would be rounding errors.
    if reach.is_nan() || reach <= 1e-6 {
        return f32::from(u8::from(center.abs() < half));
    }
    // The length of lines between 0 and x.
    let lines = |x: f32| {
        let nearest = x.round();
        nearest * width + (x - nearest).clamp(-half, half)
    };
    ((lines(center + 0.5 * reach) - lines(center - 0.5 * reach)) / reach).clamp(0.0, 1.0)
}

impl Texture for Contours {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let coverage = self.coverage(at);
        let ground = self.over.evaluate(at);
        if coverage == 0.0 {
            return ground;
        }
        let line = self.color.evaluate(at);
        let tint = mix(ground, line.truncate().extend(1.0), line.w.clamp(0.0, 1.0));
        mix(ground, tint, coverage)
    }

    depends_on!(input, color, over);
}

// What the surface itself says, as colours.

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
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
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

    fn depends_on(&self, what: Dependence) -> bool {
        matches!(*self, Self::Uv { set } if what == Dependence::Uv(set))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_equal_counted_ones() {
        for (center, reach, width) in [
            (0.1, 0.5, 0.2),
            (3.45, 0.02, 0.1),
            (-2.0, 7.3, 0.3),
            (0.5, 1.0, 0.25),
            (10.05, 0.3, 0.1),
            (0.3, 0.1, 0.0),
        ] {
            let count = 100_000;
            let inside = (0..count)
                .filter(|i| {
                    let x: f64 = center + reach * ((f64::from(*i) + 0.5) / f64::from(count) - 0.5);
                    (x - x.round()).abs() < 0.5 * width
                })
                .count();
            let expected = inside as f32 / count as f32;
            let got = line_share(center as f32, reach as f32, width as f32);
            assert!((got - expected).abs() < 1e-4, "{center} {reach} {width}: {got}, counted {expected}");
        }
        assert_eq!(line_share(4.0, 0.0, 0.1), 1.0);
        assert_eq!(line_share(4.5, 0.0, 0.1), 0.0);
        assert_eq!(line_share(4.5, 0.3, 1.5), 1.0);
    }
}
