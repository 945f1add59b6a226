//! Arithmetic on textures.

use glam::Vec4;

use super::mix;
use crate::look::Slot;
use crate::{Allowed, InvalidOption, ShadingPoint, Texture};

/// A number of a linear RGBA value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Channel {
    /// The first.
    #[default]
    Red,
    /// The second.
    Green,
    /// The third.
    Blue,
    /// The fourth.
    Alpha,
    /// The luminance of Rec. 709 primaries: `0.2126 r + 0.7152 g + 0.0722 b`.
    Luminance,
    /// 0, whatever the value.
    Zero,
    /// 1, whatever the value.
    One,
}

impl Channel {
    /// The number.
    pub fn of(self, value: Vec4) -> f32 {
        match self {
            Self::Red => value.x,
            Self::Green => value.y,
            Self::Blue => value.z,
            Self::Alpha => value.w,
            Self::Luminance => value.dot(Vec4::new(0.2126, 0.7152, 0.0722, 0.0)),
            Self::Zero => 0.0,
            Self::One => 1.0,
        }
    }
}

/// Channels picked anew.
#[derive(Clone, Debug)]
pub struct Swizzle {
    /// Where from.
    pub input: Slot,
    /// What becomes red, green, blue and alpha.
    pub channels: [Channel; 4],
}

impl Swizzle {
    /// One channel as red, green and blue, opaque.
    pub fn select(input: Slot, channel: Channel) -> Self {
        Self { input, channels: [channel, channel, channel, Channel::One] }
    }
}

/// `scale input + offset`, channel by channel.
#[derive(Clone, Debug)]
pub struct ScaleOffset {
    /// What is scaled.
    pub input: Slot,
    /// Factors of red, green, blue and alpha.
    pub scale: Vec4,
    /// Added to red, green, blue and alpha.
    pub offset: Vec4,
}

impl ScaleOffset {
    /// `1 - input`; alpha stays.
    pub fn invert(input: Slot) -> Self {
        Self { input, scale: Vec4::new(-1.0, -1.0, -1.0, 1.0), offset: Vec4::new(1.0, 1.0, 1.0, 0.0) }
    }
}

/// Two textures, mixed by a mask.
#[derive(Clone, Debug)]
pub struct Mix {
    /// Where the mask is 0.
    pub a: Slot,
    /// Where the mask is 1.
    pub b: Slot,
    /// Red, clamped to 0..1.
    pub mask: Slot,
}

/// What is done with two numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Operation {
    /// `a + b`.
    Add,
    /// `a - b`.
    Subtract,
    /// `a b`.
    #[default]
    Multiply,
    /// The smaller one.
    Minimum,
    /// The larger one.
    Maximum,
}

/// Two textures joined by arithmetic in red, green and blue. Alpha is that of `a`, except in a product, which multiplies it.
#[derive(Clone, Debug)]
pub struct Binary {
    /// What is done.
    pub operation: Operation,
    /// The first operand.
    pub a: Slot,
    /// The second operand.
    pub b: Slot,
}

/// Red, green and blue held within limits; alpha stays.
#[derive(Clone, Debug)]
pub struct Clamp {
    /// What is held.
    pub input: Slot,
    /// The smallest number.
    pub low: f32,
    /// The largest number; not below `low`.
    pub high: f32,
}

/// Red, green and blue brought from one range to another by the line through both; alpha stays.
#[derive(Clone, Debug)]
pub struct Remap {
    /// What is brought there.
    pub input: Slot,
    /// Two different numbers.
    pub from: [f32; 2],
    /// What these become.
    pub to: [f32; 2],
    /// Whether numbers beyond `from` stay at the ends of `to`.
    pub clamp: bool,
}

impl ScaleOffset {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        Allowed::Finite.check("scale-offset", "the scale", &self.scale.to_array())?;
        Allowed::Finite.check("scale-offset", "the offset", &self.offset.to_array())
    }
}

impl Clamp {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        Allowed::Finite.check("clamp", "a limit", &[self.low, self.high])?;
        Allowed::NotNegative.check("clamp", "'high' minus 'low'", &[self.high - self.low])
    }
}

impl Remap {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        Allowed::Finite.check("remap", "'from'", &self.from)?;
        Allowed::Finite.check("remap", "'to'", &self.to)?;
        Allowed::NotZero.check("remap", "the length of 'from'", &[self.from[1] - self.from[0]])
    }
}

impl Swizzle {
    fn of(&self, value: Vec4) -> Vec4 {
        Vec4::from_array(self.channels.map(|channel| channel.of(value)))
    }
}

impl Texture for Swizzle {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.of(self.input.evaluate(at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        self.input.evaluate_all(at, values);
        values.iter_mut().for_each(|value| *value = self.of(*value));
    }

    depends_on!(input);
}

impl ScaleOffset {
    fn of(&self, value: Vec4) -> Vec4 {
        self.scale * value + self.offset
    }
}

impl Texture for ScaleOffset {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.of(self.input.evaluate(at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        self.input.evaluate_all(at, values);
        values.iter_mut().for_each(|value| *value = self.of(*value));
    }

    depends_on!(input);
}

impl Texture for Mix {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        match self.mask.evaluate_number(at).clamp(0.0, 1.0) {
            0.0 => self.a.evaluate(at),
            1.0 => self.b.evaluate(at),
            share => mix(self.a.evaluate(at), self.b.evaluate(at), share),
        }
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let mut others = vec![Vec4::ZERO; at.len()];
        self.mask.evaluate_all(at, &mut others);
        let shares: Vec<f32> = others.iter().map(|mask| mask.x.clamp(0.0, 1.0)).collect();
        // What is seen nowhere is not asked.
        if shares.iter().all(|&share| share == 1.0) {
            return self.b.evaluate_all(at, values);
        }
        self.a.evaluate_all(at, values);
        if shares.iter().all(|&share| share == 0.0) {
            return;
        }
        self.b.evaluate_all(at, &mut others);
        for ((a, b), share) in values.iter_mut().zip(others).zip(shares) {
            *a = match share {
                0.0 => *a,
                1.0 => b,
                share => mix(*a, b, share),
            };
        }
    }

    depends_on!(a, b, mask);
}

impl Binary {
    fn of(&self, a: Vec4, b: Vec4) -> Vec4 {
        let value = match self.operation {
            Operation::Add => a + b,
            Operation::Subtract => a - b,
            Operation::Multiply => return a * b,
            Operation::Minimum => a.min(b),
            Operation::Maximum => a.max(b),
        };
        value.truncate().extend(a.w)
    }
}

impl Texture for Binary {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.of(self.a.evaluate(at), self.b.evaluate(at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let mut others = vec![Vec4::ZERO; at.len()];
        self.a.evaluate_all(at, values);
        self.b.evaluate_all(at, &mut others);
        values.iter_mut().zip(others).for_each(|(a, b)| *a = self.of(*a, b));
    }

    depends_on!(a, b);
}

impl Clamp {
    fn of(&self, value: Vec4) -> Vec4 {
        value.max(Vec4::splat(self.low)).min(Vec4::splat(self.high)).truncate().extend(value.w)
    }
}

impl Texture for Clamp {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.of(self.input.evaluate(at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        self.input.evaluate_all(at, values);
        values.iter_mut().for_each(|value| *value = self.of(*value));
    }

    depends_on!(input);
}

impl Remap {
    fn of(&self, value: Vec4) -> Vec4 {
        let [start, end] = self.from;
        let position = (value.truncate() - start) / (end - start);
        let position = if self.clamp { position.clamp(glam::Vec3::ZERO, glam::Vec3::ONE) } else { position };
        (self.to[0] + position * (self.to[1] - self.to[0])).extend(value.w)
    }
}

impl Texture for Remap {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.of(self.input.evaluate(at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        self.input.evaluate_all(at, values);
        values.iter_mut().for_each(|value| *value = self.of(*value));
    }

    depends_on!(input);
}
