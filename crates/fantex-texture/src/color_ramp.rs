//! One-dimensional textures as colour scales.

use fantex_base::{Error, Result, parameters};
use fantex_mesh::{ToonInterpolation, ToonScale};
use glam::Vec4;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Color;

/// How colours change between the stops of a ramp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RampInterpolation {
    /// Proportionally, in linear light.
    #[default]
    Linear,
    /// By a cubic that is level at the stops.
    Smooth,
    /// Not at all: the colour of the last stop holds up to the next.
    Constant,
}

impl From<ToonInterpolation> for RampInterpolation {
    fn from(interpolation: ToonInterpolation) -> Self {
        match interpolation {
            ToonInterpolation::Linear => Self::Linear,
            ToonInterpolation::Smooth => Self::Smooth,
            ToonInterpolation::Constant => Self::Constant,
        }
    }
}

parameters! {
    /// A stop of a colour scale.
    #[derive(Copy)]
    #[schemars(extend("required" = ["at", "color"]))]
    pub struct Stop {
        /// Where it is.
        pub at: f32 = 0.0,
        /// Its colour.
        pub color: Color = Color::WHITE,
    }

    /// A colour scale: a colour for every number.
    #[schemars(extend("required" = ["stops"]))]
    pub struct ColorRamp {
        /// Colours in ascending order of the number; two at one place make a jump.
        #[schemars(length(min = 1, max = 1024))]
        pub stops: Vec<Stop> = Vec::new(),
        /// How colours change between the stops.
        pub interpolation: RampInterpolation = RampInterpolation::Linear,
    }
}

impl ColorRamp {
    /// A ramp through `(position, linear RGBA)` in ascending order of position; two stops at one position make a jump.
    ///
    /// # Errors
    /// There is no stop, or positions are not finite and ascending.
    pub fn new(stops: Vec<(f32, Vec4)>, interpolation: RampInterpolation) -> Result<Self> {
        let stops = stops.into_iter().map(|(at, color)| Stop { at, color: Color(color) }).collect();
        let ramp = Self { stops, interpolation };
        ramp.check().map(|()| ramp)
    }

    /// Whether it can be evaluated.
    ///
    /// # Errors
    /// There is no stop, or positions are not finite and ascending.
    pub fn check(&self) -> Result<()> {
        let mut before = f32::NEG_INFINITY;
        for (index, &Stop { at: position, .. }) in self.stops.iter().enumerate() {
            if !position.is_finite() || position < before {
                return Err(Error::invalid(format!(
                    "stop {} of a colour ramp is at {position}; stops must be finite and in ascending order",
                    index + 1
                )));
            }
            before = position;
        }
        match self.stops.is_empty() {
            true => Err(Error::invalid("a colour ramp needs at least one stop")),
            false => Ok(()),
        }
    }

    /// The ramp that a material's toon scale stands for; `None` where its stops make none.
    pub fn of_toon_scale(scale: &ToonScale) -> Option<Self> {
        let stops = scale.stops.iter().map(|&(at, color)| (at, color.extend(1.0)));
        Self::new(stops.collect(), scale.interpolation.into()).ok()
    }

    /// This ramp between -1 and 1 as a material keeps it. One of more stops than that has room for is sampled evenly.
    pub fn toon_scale(&self) -> ToonScale {
        let most = ToonScale::MAX_STOPS;
        if self.stops.len() > most {
            let places = (0..most).map(|i| 2.0 * i as f32 / (most - 1) as f32 - 1.0);
            let stops = places.map(|at| (at, self.color(at).truncate())).collect();
            return ToonScale { stops, interpolation: ToonInterpolation::Linear };
        }
        let interpolation = match self.interpolation {
            RampInterpolation::Linear => ToonInterpolation::Linear,
            RampInterpolation::Smooth => ToonInterpolation::Smooth,
            RampInterpolation::Constant => ToonInterpolation::Constant,
        };
        let stops = self.stops.iter().map(|stop| (stop.at, stop.color.rgb())).collect();
        ToonScale { stops, interpolation }
    }

    /// The colour of `x`: linear RGBA. Beyond the ends, the end's colour; for NaN, the first.
    pub fn color(&self, x: f32) -> Vec4 {
        let next = self.stops.partition_point(|stop| stop.at <= x);
        let Some(&Stop { at: start, color: Color(color) }) = self.stops.get(next.wrapping_sub(1)) else {
            return self.stops[0].color.0;
        };
        let Some(&Stop { at: end, color: Color(next_color) }) = self.stops.get(next) else { return color };
        let t = (x - start) / (end - start);
        match self.interpolation {
            RampInterpolation::Linear => color.lerp(next_color, t),
            RampInterpolation::Smooth => color.lerp(next_color, t * t * (3.0 - 2.0 * t)),
            RampInterpolation::Constant => color,
        }
    }

    /// The exact mean colour of the numbers between `from` and `to`, in either order; without an interval between them, the
    /// colour of the number. The four channels are averaged independently.
    pub fn mean(&self, from: f32, to: f32) -> Vec4 {
        // Twice the largest is still a number.
        let [from, to] = [from, to].map(|x| x.clamp(-0.25 * f32::MAX, 0.25 * f32::MAX));
        let (low, high) = (from.min(to), from.max(to));
        let width = high - low;
        if width.is_nan() || width <= 0.0 {
            return self.color(from);
        }
        let share = |start: f32, end: f32| (end.min(high) - start.max(low)).max(0.0) / width;
        let (first, last) = (self.stops[0], self.stops[self.stops.len() - 1]);
        let mut sum =
            first.color.0 * share(f32::NEG_INFINITY, first.at) + last.color.0 * share(last.at, f32::INFINITY);
        for pair in self.stops.windows(2) {
            let [Stop { at: start, color: Color(color) }, Stop { at: end, color: Color(next_color) }] =
                [pair[0], pair[1]];
            let share = share(start, end);
            if share > 0.0 {
                let position = |x: f32| ((x - start) / (end - start)).clamp(0.0, 1.0);
                sum += color.lerp(next_color, self.mean_blend(position(low), position(high))) * share;
            }
        }
        sum
    }

    /// The mean share of the next stop's colour between the positions `a` and `b` of a piece, both 0..1. Powers are averaged
    /// as `(a + b) / 2` and so on, which loses no digits where the positions are close together.
    fn mean_blend(&self, a: f32, b: f32) -> f32 {
        let linear = 0.5 * (a + b);
        match self.interpolation {
            RampInterpolation::Linear => linear,
            RampInterpolation::Smooth => a * a + a * b + b * b - linear * (a * a + b * b),
            RampInterpolation::Constant => 0.0,
        }
    }
}
