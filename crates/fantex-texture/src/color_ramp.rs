//! One-dimensional textures as colour scales.

use glam::Vec4;

/// How colours change between the stops of a ramp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RampInterpolation {
    /// Proportionally, in linear light.
    #[default]
    Linear,
    /// By a cubic that is level at the stops.
    Smooth,
    /// Not at all: the colour of the last stop holds up to the next.
    Constant,
}

/// A colour scale: a colour for every number.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorRamp {
    stops: Vec<(f32, Vec4)>,
    interpolation: RampInterpolation,
}

/// Why stops make no ramp.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ColorRampError {
    /// There is no stop.
    #[error("a colour ramp needs at least one stop")]
    Empty,
    /// A position is not finite, or smaller than the one before.
    #[error("stop {index} of a colour ramp is at {position}; stops must be finite and in ascending order")]
    Position {
        /// Which stop, from 0.
        index: usize,
        /// Where it is.
        position: f32,
    },
}

impl ColorRamp {
    /// A ramp through `(position, linear RGBA)` in ascending order of position; two stops at one position make a jump.
    ///
    /// # Errors
    ///
    /// There is no stop, or positions are not finite and ascending.
    pub fn new(stops: Vec<(f32, Vec4)>, interpolation: RampInterpolation) -> Result<Self, ColorRampError> {
        let mut before = f32::NEG_INFINITY;
        for (index, &(position, _)) in stops.iter().enumerate() {
            if !position.is_finite() || position < before {
                return Err(ColorRampError::Position { index, position });
            }
            before = position;
        }
        if stops.is_empty() { Err(ColorRampError::Empty) } else { Ok(Self { stops, interpolation }) }
    }

    /// Positions and linear RGBA, ascending; at least one.
    pub fn stops(&self) -> &[(f32, Vec4)] {
        &self.stops
    }

    /// The colour of `x`: linear RGBA. Beyond the ends, the end's colour; for NaN, the first.
    pub fn color(&self, x: f32) -> Vec4 {
        let next = self.stops.partition_point(|stop| stop.0 <= x);
        let Some(&(start, color)) = self.stops.get(next.wrapping_sub(1)) else { return self.stops[0].1 };
        let Some(&(end, next_color)) = self.stops.get(next) else { return color };
        let t = (x - start) / (end - start);
        match self.interpolation {
            RampInterpolation::Linear => color.lerp(next_color, t),
            RampInterpolation::Smooth => color.lerp(next_color, t * t * (3.0 - 2.0 * t)),
            RampInterpolation::Constant => color,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramps_pass_through_their_stops_and_hold_their_ends() {
        let stops = vec![(-1.0, Vec4::ZERO), (1.0, Vec4::ONE), (1.0, Vec4::X), (3.0, Vec4::Y)];
        let ramp = ColorRamp::new(stops, RampInterpolation::Linear).unwrap();
        assert_eq!(ramp.color(-5.0), Vec4::ZERO);
        assert_eq!(ramp.color(0.0), Vec4::splat(0.5));
        assert_eq!(ramp.color(1.0), Vec4::X);
        assert_eq!(ramp.color(9.0), Vec4::Y);
        assert_eq!(ramp.color(f32::NAN), Vec4::ZERO);
    }

    #[test]
    fn stops_out_of_order_are_refused() {
        let refused = |stops| ColorRamp::new(stops, RampInterpolation::Linear).unwrap_err();
        assert_eq!(refused(Vec::new()), ColorRampError::Empty);
        let stops = vec![(1.0, Vec4::ZERO), (0.0, Vec4::ONE)];
        assert_eq!(refused(stops), ColorRampError::Position { index: 1, position: 0.0 });
    }
}
