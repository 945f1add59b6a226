//! Textures made of textures: environment modes, layers, arithmetic, colour scales and contour lines.
//!
//! Every node is plain data with [`Slot`]s as inputs. Colours are linear with straight alpha; where two are
//! mixed, each counts by its alpha.

/// Nodes: textures made of others. The inputs are [`Slot`]s where a node is evaluated, and whatever names a texture where it is read from
/// a file; everything else is the same for both.
macro_rules! nodes {
    ($(
        $(#[$meta:meta])*
        pub struct $name:ident {
            $($(#[$field_meta:meta])* pub $field:ident: $type:ty = $default:expr,)*
            inputs {
                $($(#[$input_meta:meta])* pub $input:ident = $constant:expr,)+
            }
        }
    )*) => {$(
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(default, bound(
            serialize = "I: Serialize",
            deserialize = "I: Deserialize<'de> + From<f32> + From<Color>"
        ))]
        #[schemars(deny_unknown_fields, bound = "I: JsonSchema + Serialize + From<f32> + From<Color>")]
        $(#[$meta])*
        pub struct $name<I = Slot> {
            $($(#[$field_meta])* pub $field: $type,)*
            $($(#[$input_meta])* pub $input: I,)+
        }

        impl<I: From<f32> + From<Color>> Default for $name<I> {
            fn default() -> Self {
                Self { $($field: $default,)* $($input: I::from($constant),)+ }
            }
        }

        impl<I> $name<I> {
            /// The same node with other inputs, each made of the old one and its name.
            ///
            /// # Errors
            /// The first that `input` gives.
            pub fn with_inputs<J, E>(
                &self,
                mut input: impl FnMut(&I, &'static str) -> Result<J, E>,
            ) -> Result<$name<J>, E> {
                Ok($name {
                    $($field: self.$field.clone(),)*
                    $($input: input(&self.$input, stringify!($input))?,)+
                })
            }
        }
    )*};
}

/// A node depends on what one of these inputs depends on.
macro_rules! depends_on {
    ($($input:ident),+) => {
        fn depends_on(&self, what: $crate::Dependence) -> bool {
            $(self.$input.depends_on(what))||+
        }
    };
}

/// A node whose value at a point is a function, `of`, of its one input's.
macro_rules! each_value {
    ($node:ident, $input:ident $(, { $($more:item)* })?) => {
        impl Texture for $node {
            fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
                self.of(self.$input.evaluate(at))
            }

            fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
                self.$input.evaluate_all(at, values);
                values.iter_mut().for_each(|value| *value = self.of(*value));
            }

            fn edges_per_texel(&self, at: &ShadingPoint<'_>) -> Option<[f32; 2]> {
                self.$input.edges_per_texel(at)
            }

            depends_on!($input);

            $($($more)*)?
        }
    };
}

mod scalar;

use std::borrow::Cow;
use std::sync::Arc;

use glam::{Vec3, Vec4};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

use crate::look::Slot;
use crate::{Allowed, Color, Dependence, ShadingPoint, Texture};

pub use scalar::{Contours, Field, RampTexture};

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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
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

nodes! {
    /// Texture `T` and what it meets, `F`.
    #[schemars(extend("required" = ["mode", "texture"]))]
    pub struct Combine {
        /// The mode.
        pub mode: CombineMode = CombineMode::Modulate,
        /// `C`, for `blend`.
        pub constant: Color = Color::WHITE,
        inputs {
            /// `T`.
            pub texture = Color::WHITE,
            /// `F`.
            pub fragment = Color::WHITE,
        }
    }
}

impl Combine {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
        Allowed::Finite.check("an environment mode", "the constant colour", &self.constant.0.to_array())
    }
}

impl Texture for Combine {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.mode.apply(self.texture.evaluate(at), self.fragment.evaluate(at), self.constant.0)
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let mut fragments = vec![Vec4::ZERO; at.len()];
        self.texture.evaluate_all(at, values);
        self.fragment.evaluate_all(at, &mut fragments);
        for (texel, fragment) in values.iter_mut().zip(fragments) {
            *texel = self.mode.apply(*texel, fragment, self.constant.0);
        }
    }

    depends_on!(texture, fragment);
}

// Textures on top of each other.

/// What a layer does to what lies below.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LayerMode {
    /// Covers it by its alpha (the operator "over" of Porter and Duff, "Compositing digital images", 1984).
    #[default]
    Over,
    /// Replaces it: `T`.
    Replace,
    /// `T F`.
    Modulate,
    /// `a_T T + (1 - a_T) F`.
    Decal,
    /// `F (1 - T) + C T`.
    Blend,
}

nodes! {
    /// A layer.
    #[schemars(rename = "Layer", extend("required" = ["texture"]))]
    pub struct Layer {
        /// What it does to what is below.
        pub mode: LayerMode = LayerMode::Over,
        /// `C`, for `blend`.
        pub constant: Color = Color::WHITE,
        inputs {
            /// Its colour.
            pub texture = Color::WHITE,
            /// Where it is: 0 to 1.
            pub mask = 1.0,
            /// How much of it is seen: 0 to 1.
            pub opacity = 1.0,
        }
    }
}

impl Layer {
    /// A texture over everything below.
    pub fn over(texture: Slot) -> Self {
        Self { texture, ..Self::default() }
    }

    fn evaluate(&self, below: Vec4, at: &ShadingPoint<'_>) -> Vec4 {
        let share = (self.mask.evaluate_number(at) * self.opacity.evaluate_number(at)).clamp(0.0, 1.0);
        if share == 0.0 { below } else { self.cover(below, self.texture.evaluate(at), share) }
    }

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
        let mode = match self.mode {
            LayerMode::Over => return over(texel.truncate().extend(texel.w * share), below),
            LayerMode::Replace => CombineMode::Replace,
            LayerMode::Modulate => CombineMode::Modulate,
            LayerMode::Decal => CombineMode::Decal,
            LayerMode::Blend => CombineMode::Blend,
        };
        mix(below, mode.apply(texel, below, self.constant.0), share)
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(bound(serialize = "I: Serialize", deserialize = "I: Deserialize<'de> + From<f32> + From<Color>"))]
#[schemars(deny_unknown_fields, bound = "I: JsonSchema + Serialize + From<f32> + From<Color>")]
pub struct Layers<I = Slot> {
    /// What is below all of them.
    pub base: I,
    /// From the lowest to the highest.
    #[schemars(length(min = 1, max = 256))]
    pub layers: Vec<Layer<I>>,
}

impl Texture for Layers {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.layers.iter().fold(self.base.evaluate(at), |below, layer| layer.evaluate(below, at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        self.base.evaluate_all(at, values);
        self.layers.iter().for_each(|layer| layer.evaluate_all(values, at));
    }

    fn depends_on(&self, what: Dependence) -> bool {
        let mut above = self.layers.iter().flat_map(Layer::slots);
        self.base.depends_on(what) || above.any(|slot| slot.depends_on(what))
    }
}

// Arithmetic on textures.

/// A number of a linear RGBA value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Red.
    #[serde(rename = "r")]
    #[default]
    Red,
    /// Green.
    #[serde(rename = "g")]
    Green,
    /// Blue.
    #[serde(rename = "b")]
    Blue,
    /// Alpha.
    #[serde(rename = "a")]
    Alpha,
    /// The luminance of Rec. 709 primaries: `0.2126 r + 0.7152 g + 0.0722 b`.
    Luminance,
    /// 0.
    Zero,
    /// 1.
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

nodes! {
    /// Channels in another order.
    #[schemars(extend("required" = ["input", "channels"]))]
    pub struct Swizzle {
        /// What becomes red, green, blue and alpha.
        pub channels: [Channel; 4] = [Channel::Red, Channel::Green, Channel::Blue, Channel::Alpha],
        inputs {
            /// The texture.
            pub input = 0.0,
        }
    }
}

impl Swizzle {
    /// One channel as red, green and blue, opaque.
    pub fn select(input: Slot, channel: Channel) -> Self {
        Self { input, channels: [channel, channel, channel, Channel::One] }
    }
}

/// A number or a colour that multiplies a texture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Factor {
    /// The same for red, green and blue; alpha stays.
    Number(f32),
    /// Channel by channel.
    Color(Color),
}

impl Factor {
    /// Leaves the texture as it is.
    pub const ONE: Self = Self::Number(1.0);

    fn one() -> Self {
        Self::ONE
    }

    /// Whether it says nothing.
    pub fn is_one(&self) -> bool {
        matches!(self, Self::Number(1.0))
    }

    /// Factors of red, green, blue and alpha.
    pub fn rgba(self) -> Vec4 {
        match self {
            Self::Number(number) => Vec3::splat(number).extend(1.0),
            Self::Color(color) => color.0,
        }
    }
}

impl JsonSchema for Factor {
    fn schema_name() -> Cow<'static, str> {
        "Factor".into()
    }

    fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "title": "a number or a colour",
            "anyOf": [
                { "type": "number" },
                { "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 4 },
                { "type": "string", "format": "color" },
            ],
        })
    }
}

/// The use of a texture as an input: all of it or one channel, `factor` times that, plus `offset`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "TextureUse", deny_unknown_fields)]
pub struct TextureUse<T = Arc<dyn Texture>> {
    /// The texture.
    pub texture: T,
    /// Only this channel, as grey.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<Channel>,
    /// What the texture is multiplied with; a number leaves alpha as it is.
    #[serde(default = "Factor::one", skip_serializing_if = "Factor::is_one")]
    pub factor: Factor,
    /// What is added to red, green and blue after that.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset: f32,
}

fn is_zero(value: &f32) -> bool {
    *value == 0.0
}

impl<T> TextureUse<T> {
    /// The texture as it is.
    pub fn plain(texture: T) -> Self {
        Self { texture, channel: None, factor: Factor::ONE, offset: 0.0 }
    }

    /// Whether it is the texture as it is.
    pub fn is_plain(&self) -> bool {
        self.channel.is_none() && self.factor.rgba() == Vec4::ONE && self.offset == 0.0
    }

    /// What becomes of the texture's value.
    #[inline]
    pub fn of(&self, value: Vec4) -> Vec4 {
        let value = match self.channel {
            Some(channel) => Vec3::splat(channel.of(value)).extend(1.0),
            None => value,
        };
        self.factor.rgba() * value + Vec3::splat(self.offset).extend(0.0)
    }

    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
        Allowed::Finite.check("the use of a texture", "the factor", &self.factor.rgba().to_array())?;
        Allowed::Finite.check("the use of a texture", "the offset", &[self.offset])
    }
}

each_value!(Swizzle, input);
each_value!(Clamp, input);
each_value!(Remap, input);
each_value!(TextureUse, texture, {
    fn as_use(&self) -> Option<&TextureUse> {
        Some(self)
    }
});

nodes! {
    /// `a` where the mask is 0, `b` where it is 1.
    #[schemars(extend("required" = ["a", "b", "mask"]))]
    pub struct Mix {
        inputs {
            /// Where the mask is 0.
            pub a = 0.0,
            /// Where the mask is 1.
            pub b = 1.0,
            /// 0 to 1.
            pub mask = 0.5,
        }
    }
}

/// What is done with two numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
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
    /// `a / b`, and 0 where `b` is 0.
    Divide,
    /// What is left of `a` after as many whole `b` as fit in it: from 0 up to `b`; `a` where `b` is 0.
    Modulo,
    /// `a` rounded to the nearest whole number.
    Round,
    /// The largest whole number up to `a`.
    Floor,
    /// What `a` has beyond that.
    Fract,
}

nodes! {
    /// `a` and `b`, calculated in red, green and blue. Alpha is that of `a`, except in a product, which multiplies it. Where whole
    /// numbers make steps, these are averaged over the footprint.
    #[schemars(extend("required" = ["operation", "a"]))]
    pub struct Binary {
        /// What is calculated.
        pub operation: Operation = Operation::Multiply,
        inputs {
            /// The first.
            pub a = 0.0,
            /// The second, where there is one.
            pub b = 0.0,
        }
    }
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

nodes! {
    /// A number from one range into another by the line through both; alpha stays.
    #[schemars(extend("required" = ["input"]))]
    pub struct Remap {
        /// The range that it comes from.
        pub from: [f32; 2] = [0.0, 1.0],
        /// The range that it goes to.
        pub to: [f32; 2] = [0.0, 1.0],
        /// Whether it is kept within that range.
        pub clamp: bool = false,
        inputs {
            /// The number, or each channel of a colour.
            pub input = 0.0,
        }
    }
}

impl Clamp {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
        Allowed::Finite.check("clamp", "a limit", &[self.low, self.high])?;
        Allowed::NotNegative.check("clamp", "'high' minus 'low'", &[self.high - self.low])
    }
}

impl Remap {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
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
            Operation::Divide => quotient(a, b),
            Operation::Modulo | Operation::Round | Operation::Floor | Operation::Fract => {
                return self.steps(a, b, Vec3::ZERO);
            }
        };
        value.truncate().extend(a.w)
    }

    fn has_steps(&self) -> bool {
        use Operation::{Floor, Fract, Modulo, Round};
        matches!(self.operation, Modulo | Round | Floor | Fract) && matches!(self.a, Slot::Texture(_))
    }

    /// Means over values of `a` that are spread over `widths`.
    fn steps(&self, a: Vec4, b: Vec4, widths: Vec3) -> Vec4 {
        let floors = |a: Vec4, widths: Vec3| {
            Vec3::new(mean_floor(a.x, widths.x), mean_floor(a.y, widths.y), mean_floor(a.z, widths.z))
        };
        let value = match self.operation {
            Operation::Round => floors(a + 0.5, widths),
            Operation::Floor => floors(a, widths),
            Operation::Fract => a.truncate() - floors(a, widths),
            _ => {
                let widths = quotient(widths.extend(0.0), b).truncate();
                a.truncate() - b.truncate() * floors(quotient(a, b), widths.abs())
            }
        };
        value.extend(a.w)
    }
}

fn quotient(a: Vec4, b: Vec4) -> Vec4 {
    Vec4::select(b.cmpeq(Vec4::ZERO), Vec4::ZERO, a / b)
}

/// The mean of `floor` over an interval.
fn mean_floor(center: f32, width: f32) -> f32 {
    if width < 1e-5 {
        return center.floor();
    }
    let up_to = |x: f64| {
        let n = x.floor();
        n * x - 0.5 * n * (n + 1.0)
    };
    let (center, width) = (f64::from(center), f64::from(width));
    ((up_to(center + 0.5 * width) - up_to(center - 0.5 * width)) / width) as f32
}

impl Texture for Binary {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (a, b) = (self.a.evaluate(at), self.b.evaluate(at));
        if self.has_steps() {
            let beside = |x: f32, y: f32| at.shifted(x, y, |at| self.a.evaluate(at).truncate());
            let [x, y] = [beside(0.5, 0.0) - beside(-0.5, 0.0), beside(0.0, 0.5) - beside(0.0, -0.5)];
            return self.steps(a, b, (x * x + y * y).map(f32::sqrt));
        }
        self.of(a, b)
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        if self.has_steps() {
            at.iter().zip(values).for_each(|(at, value)| *value = self.evaluate(at));
            return;
        }
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

impl Remap {
    fn of(&self, value: Vec4) -> Vec4 {
        let [start, end] = self.from;
        let position = (value.truncate() - start) / (end - start);
        let position = if self.clamp { position.clamp(Vec3::ZERO, Vec3::ONE) } else { position };
        (self.to[0] + position * (self.to[1] - self.to[0])).extend(value.w)
    }
}
