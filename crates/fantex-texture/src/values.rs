//! Values as files write them: colours, vectors, scales.

use std::borrow::Cow;
use std::fmt;

use fantex_base::srgb::linear_from_srgb;
use glam::{Vec2, Vec3, Vec4};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A colour in linear light with straight alpha. Files write it as `"#rrggbb"` or `"#rrggbbaa"` in sRGB, or as `[r, g, b]` or
/// `[r, g, b, a]` in linear light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color(pub Vec4);

impl Color {
    /// White, opaque.
    pub const WHITE: Self = Self(Vec4::ONE);
    /// Black, opaque.
    pub const BLACK: Self = Self(Vec4::W);
    /// Black, transparent.
    pub const CLEAR: Self = Self(Vec4::ZERO);

    /// Opaque, linear light.
    pub const fn opaque(r: f32, g: f32, b: f32) -> Self {
        Self(Vec4::new(r, g, b, 1.0))
    }

    /// The colour of a text such as `#ff8800`; `None` where it is none.
    pub fn from_hex(text: &str) -> Option<Self> {
        let digits = text.strip_prefix('#')?;
        if !matches!(digits.len(), 6 | 8) || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return None;
        }
        let byte = |channel: usize| u8::from_str_radix(digits.get(2 * channel..2 * channel + 2)?, 16).ok();
        let light = |channel: usize| Some(linear_from_srgb(f32::from(byte(channel)?) / 255.0));
        let alpha = if digits.len() == 8 { byte(3)? } else { 255 };
        Some(Self(Vec4::new(light(0)?, light(1)?, light(2)?, f32::from(alpha) / 255.0)))
    }

    /// Red, green and blue.
    pub fn rgb(self) -> Vec3 {
        self.0.truncate()
    }
}

impl From<Vec3> for Color {
    /// Opaque.
    fn from(rgb: Vec3) -> Self {
        Self(rgb.extend(1.0))
    }
}

impl Serialize for Color {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let count = if self.0.w == 1.0 { 3 } else { 4 };
        self.0.to_array()[..count].serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ColorVisitor)
    }
}

struct ColorVisitor;

impl<'de> Visitor<'de> for ColorVisitor {
    type Value = Color;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a colour")
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Color, E> {
        Color::from_hex(text).ok_or_else(|| E::custom("expected #rrggbb or #rrggbbaa"))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Color, A::Error> {
        let mut numbers = Vec::with_capacity(4);
        while let Some(number) = items.next_element::<f32>()? {
            numbers.push(number);
        }
        match *numbers {
            [r, g, b] => Ok(Color::opaque(r, g, b)),
            [r, g, b, a] => Ok(Color(Vec4::new(r, g, b, a))),
            _ => Err(de::Error::invalid_length(numbers.len(), &"3 or 4 numbers")),
        }
    }
}

impl JsonSchema for Color {
    fn schema_name() -> Cow<'static, str> {
        "Color".into()
    }

    fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "title": "a colour, \"#rrggbb\" in sRGB or [r, g, b] in linear light",
            "anyOf": [
                { "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 4 },
                { "type": "string", "format": "color", "pattern": "^#([0-9a-fA-F]{6}|[0-9a-fA-F]{8})$" },
            ],
        })
    }
}

/// How a vector is written in a file, for `#[serde(with = "...")]`.
macro_rules! vector_format {
    ($($(#[$meta:meta])* $name:ident: $vector:ty = [$item:ty; $count:literal], |$list:ident| $of:expr, |$value:ident| $to:expr;)*) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug)]
        pub struct $name;

        impl $name {
            /// Writes it as a list.
            ///
            /// # Errors
            /// Those of the serializer.
            pub fn serialize<S: Serializer>($value: &$vector, serializer: S) -> Result<S::Ok, S::Error> {
                let list: [$item; $count] = $to;
                list.serialize(serializer)
            }

            /// Reads it from a list.
            ///
            /// # Errors
            /// Those of the deserializer; a list of another length.
            pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<$vector, D::Error> {
                let $list = <[$item; $count]>::deserialize(deserializer)?;
                Ok($of)
            }
        }

        impl JsonSchema for $name {
            fn inline_schema() -> bool {
                true
            }

            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                <[$item; $count]>::json_schema(generator)
            }
        }
    )*};
}

/// A length above 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct PositiveLength(#[schemars(extend("exclusiveMinimum" = 0))] pub f32);

vector_format! {
    /// `[x, y]`.
    List2: Vec2 = [f32; 2], |list| Vec2::from_array(list), |value| value.to_array();
    /// `[x, y, z]`.
    List3: Vec3 = [f32; 3], |list| Vec3::from_array(list), |value| value.to_array();
    /// `[x, y, z]`, all above 0.
    PositiveList3: Vec3 = [PositiveLength; 3], |list| Vec3::from_array(list.map(|l| l.0)),
        |value| value.to_array().map(PositiveLength);
}

/// One number for all axes, or one for each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Scale {
    /// The same along all axes.
    Uniform(f64),
    /// Along u and v.
    Two([f64; 2]),
    /// Along x, y and z.
    Three([f64; 3]),
}

impl Scale {
    /// Along x, y and z; the third axis of two is left as it is.
    pub fn axes(self) -> [f64; 3] {
        match self {
            Self::Uniform(s) => [s; 3],
            Self::Two([x, y]) => [x, y, 1.0],
            Self::Three(axes) => axes,
        }
    }
}

impl Default for Scale {
    fn default() -> Self {
        Self::Uniform(1.0)
    }
}

impl JsonSchema for Scale {
    fn schema_name() -> Cow<'static, str> {
        "Scale".into()
    }

    fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "title": "a number other than 0, or one for each of 2 or 3 axes",
            "anyOf": [
                { "type": "number", "not": { "const": 0 } },
                { "type": "array", "items": { "type": "number", "not": { "const": 0 } }, "minItems": 2, "maxItems": 3 },
            ],
        })
    }
}
