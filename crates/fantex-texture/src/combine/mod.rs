//! Textures made of textures: environment modes, layers, arithmetic, colour scales and contour lines.
//!
//! Every node is plain data with [`Slot`]s as inputs. Colours are linear with straight alpha; where two are
//! mixed, each counts by its alpha.

/// A node depends on the eye and on the time if one of these inputs does.
macro_rules! depends_on {
    ($($input:ident),+) => {
        fn is_view_dependent(&self) -> bool {
            $(self.$input.is_view_dependent())||+
        }

        fn is_animated(&self) -> bool {
            $(self.$input.is_animated())||+
        }
    };
}

mod scalar;

use glam::Vec4;

use crate::look::Slot;
use crate::{Allowed, InvalidOption, ShadingPoint, Texture};

pub use scalar::{Contours, Field, LineWidth, RampTexture};

/// From `a` to `b` by `share` (0..1); colours count by their alpha.
pub(crate) fn mix(a: Vec4, b: Vec4, share: f32) -> Vec4 {
    let alpha = a.w + (b.w - a.w) * share;
    if alpha <= 0.0 {
        return a.lerp(b, share);
    }
    let color = (a * (a.w * (1.0 - share)) + b * (b.w * share)) / alpha;
    color.truncate().extend(alpha)
}

/// The number of an input at a point, and the width of the interval over which it varies within the footprint: that of the
/// box with the same variance as the parallelogram. Exact where the input varies along one edge only.
fn interval(input: &Slot, channel: Channel, at: &ShadingPoint<'_>) -> (f32, f32) {
    let number = |at: &ShadingPoint<'_>| channel.of(input.evaluate(at));
    let center = number(at);
    if matches!(input, Slot::Constant(_)) {
        return (center, 0.0);
    }
    let beside = |a: f32, b: f32| at.shifted(a, b, number);
    let dx = beside(0.5, 0.0) - beside(-0.5, 0.0);
    let dy = beside(0.0, 0.5) - beside(0.0, -0.5);
    (center, dx.hypot(dy))
}

// The texture environment modes of OpenGL 1.1.

/// What becomes of the fragment's colour `F` under a texel `T`, with a constant colour `C`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum CombineMode {
    /// `T`, alpha too.
    Replace,
    /// `T F`, alpha too.
    #[default]
    Modulate,
    /// `a_T T + (1 - a_T) F`; alpha stays the fragment's.
    Decal,
    /// `F (1 - T) + C T`; alphas are multiplied.
    Blend,
}

impl CombineMode {
    /// The combined linear RGBA.
    pub fn apply(self, texel: Vec4, fragment: Vec4, constant: Vec4) -> Vec4 {
        let (t, f, c) = (texel.truncate(), fragment.truncate(), constant.truncate());
        match self {
            Self::Replace => texel,
            Self::Modulate => texel * fragment,
            Self::Decal => (t * texel.w + f * (1.0 - texel.w)).extend(fragment.w),
            Self::Blend => (f * (1.0 - t) + c * t).extend(texel.w * fragment.w),
        }
    }
}

/// A texture over a fragment's colour.
#[derive(Clone, Debug)]
pub struct Combine {
    /// How.
    pub mode: CombineMode,
    /// `T`.
    pub texture: Slot,
    /// `F`.
    pub fragment: Slot,
    /// `C`, linear RGBA; of importance for [`CombineMode::Blend`].
    pub constant: Vec4,
}

impl Combine {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        Allowed::Finite.check("an environment mode", "the constant colour", &self.constant.to_array())
    }
}

impl Texture for Combine {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.mode.apply(self.texture.evaluate(at), self.fragment.evaluate(at), self.constant)
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let mut fragments = vec![Vec4::ZERO; at.len()];
        self.texture.evaluate_all(at, values);
        self.fragment.evaluate_all(at, &mut fragments);
        for (texel, fragment) in values.iter_mut().zip(fragments) {
            *texel = self.mode.apply(*texel, fragment, self.constant);
        }
    }

    depends_on!(texture, fragment);
}

// Textures on top of each other.

/// What a layer does to what lies below.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LayerMode {
    /// It covers by its alpha (the operator "over" of Porter and Duff, "Compositing digital images", 1984).
    #[default]
    Over,
    /// An environment mode, what lies below being the fragment.
    Combine {
        /// Which one.
        mode: CombineMode,
        /// `C`, linear RGBA.
        constant: Vec4,
    },
}

/// One of several textures.
#[derive(Clone, Debug)]
pub struct Layer {
    /// The colours.
    pub texture: Slot,
    /// What it does to what lies below.
    pub mode: LayerMode,
    /// Where it does so: red, 0..1.
    pub mask: Slot,
    /// How much it does so: red, 0..1; a factor of the mask.
    pub opacity: Slot,
}

impl Layer {
    /// A texture over everything below.
    pub fn over(texture: Slot) -> Self {
        Self { texture, mode: LayerMode::Over, mask: Slot::number(1.0), opacity: Slot::number(1.0) }
    }

    /// What becomes of the colour below.
    fn evaluate(&self, below: Vec4, at: &ShadingPoint<'_>) -> Vec4 {
        let share = (self.mask.evaluate_number(at) * self.opacity.evaluate_number(at)).clamp(0.0, 1.0);
        if share == 0.0 { below } else { self.cover(below, self.texture.evaluate(at), share) }
    }

    /// What becomes of the colours below.
    fn evaluate_all(&self, below: &mut [Vec4], at: &[ShadingPoint<'_>]) {
        let mut values = vec![Vec4::ZERO; at.len()];
        self.mask.evaluate_all(at, &mut values);
        let masks: Vec<f32> = values.iter().map(|value| value.x).collect();
        self.opacity.evaluate_all(at, &mut values);
        let share = |(mask, opacity): (f32, &Vec4)| (mask * opacity.x).clamp(0.0, 1.0);
        let shares: Vec<f32> = masks.into_iter().zip(&values).map(share).collect();
        if shares.iter().all(|&share| share == 0.0) {
            return;
        }
        self.texture.evaluate_all(at, &mut values);
        for ((below, texel), share) in below.iter_mut().zip(values).zip(shares) {
            if share != 0.0 {
                *below = self.cover(*below, texel, share);
            }
        }
    }

    fn cover(&self, below: Vec4, texel: Vec4, share: f32) -> Vec4 {
        match self.mode {
            LayerMode::Over => over(texel.truncate().extend(texel.w * share), below),
            LayerMode::Combine { mode, constant } => mix(below, mode.apply(texel, below, constant), share),
        }
    }

    fn slots(&self) -> [&Slot; 3] {
        [&self.texture, &self.mask, &self.opacity]
    }
}

/// Porter and Duff's "over", for straight alpha.
fn over(above: Vec4, below: Vec4) -> Vec4 {
    let seen = below.w * (1.0 - above.w);
    let alpha = above.w + seen;
    if alpha <= 0.0 {
        return below;
    }
    ((above * above.w + below * seen) / alpha).truncate().extend(alpha)
}

/// Several textures, the first one at the bottom.
#[derive(Clone, Debug)]
pub struct Layers {
    /// What lies below all layers.
    pub base: Slot,
    /// From the lowest to the highest.
    pub layers: Vec<Layer>,
}

impl Texture for Layers {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.layers.iter().fold(self.base.evaluate(at), |below, layer| layer.evaluate(below, at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        self.base.evaluate_all(at, values);
        self.layers.iter().for_each(|layer| layer.evaluate_all(values, at));
    }

    fn is_view_dependent(&self) -> bool {
        let above = self.layers.iter().flat_map(Layer::slots).any(Texture::is_view_dependent);
        self.base.is_view_dependent() || above
    }

    fn is_animated(&self) -> bool {
        let above = self.layers.iter().flat_map(Layer::slots).any(Texture::is_animated);
        self.base.is_animated() || above
    }
}

// Arithmetic on textures.

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
