//! Values of a look's keys: colours, inputs that may be textures, file names.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::StrDeserializer;
use serde::de::{IntoDeserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// A colour, as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Color {
    /// `"#rrggbb"` or `"#rrggbbaa"`: sRGB with straight alpha, in 255ths.
    Srgb([u8; 4]),
    /// `[r, g, b]` or `[r, g, b, a]`: linear light.
    Linear([f64; 4]),
}

impl Color {
    /// White, opaque.
    pub const WHITE: Self = Self::Linear([1.0; 4]);
    /// Black, opaque.
    pub const BLACK: Self = Self::rgb([0.0; 3]);

    /// Opaque, linear.
    pub const fn rgb([r, g, b]: [f64; 3]) -> Self {
        Self::Linear([r, g, b, 1.0])
    }

    /// The colour of a text such as `#ff8800`; `None` where it is none.
    pub fn from_hex(text: &str) -> Option<Self> {
        let digits = text.strip_prefix('#')?;
        if !matches!(digits.len(), 6 | 8) || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return None;
        }
        let byte = |channel: usize| u8::from_str_radix(digits.get(2 * channel..2 * channel + 2)?, 16).ok();
        let alpha = if digits.len() == 8 { byte(3)? } else { 255 };
        Some(Self::Srgb([byte(0)?, byte(1)?, byte(2)?, alpha]))
    }

    fn from_numbers<E: de::Error>(numbers: &[f64]) -> Result<Self, E> {
        match *numbers {
            [r, g, b] => Ok(Self::rgb([r, g, b])),
            [r, g, b, a] => Ok(Self::Linear([r, g, b, a])),
            _ => Err(E::invalid_length(numbers.len(), &"3 or 4 numbers")),
        }
    }
}

impl Serialize for Color {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Self::Srgb([r, g, b, 255]) => format!("#{r:02x}{g:02x}{b:02x}").serialize(serializer),
            Self::Srgb([r, g, b, a]) => format!("#{r:02x}{g:02x}{b:02x}{a:02x}").serialize(serializer),
            Self::Linear(numbers) => {
                let count = if numbers[3] == 1.0 { 3 } else { 4 };
                numbers[..count].serialize(serializer)
            }
        }
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Input::deserialize(deserializer)? {
            Input::Color(color) => Ok(color),
            Input::Number(_) | Input::Texture(_) => Err(de::Error::custom("expected a colour")),
        }
    }
}

/// The items of a colour's list.
fn color_numbers() -> Schema {
    json_schema!({ "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 4 })
}

impl JsonSchema for Color {
    fn schema_name() -> Cow<'static, str> {
        "Color".into()
    }

    fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "title": "a colour, \"#rrggbb\" in sRGB or [r, g, b] in linear light",
            "anyOf": [color_numbers(), { "type": "string", "format": "color", "pattern": "^#([0-9a-fA-F]{6}|[0-9a-fA-F]{8})$" }],
        })
    }
}

/// A channel of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// Alpha.
    A,
}

impl Channel {
    /// The channel of a name of one letter.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "r" => Some(Self::R),
            "g" => Some(Self::G),
            "b" => Some(Self::B),
            "a" => Some(Self::A),
            _ => None,
        }
    }

    /// Its place in RGBA.
    pub fn index(self) -> usize {
        self as usize
    }
}

/// The use of a texture as an input: `"NAME"`, `"NAME.g"`, or a table that scales and shifts it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TextureUse {
    /// The texture.
    pub texture: TextureName,
    /// Only this channel, as grey.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<Channel>,
    /// What the texture is multiplied with.
    #[serde(default = "Factor::one", skip_serializing_if = "Factor::is_one")]
    pub factor: Factor,
    /// What is added to red, green and blue after that.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl TextureUse {
    /// The texture as it is.
    pub fn plain(name: impl Into<String>) -> Self {
        Self { texture: TextureName(name.into()), channel: None, factor: Factor::one(), offset: 0.0 }
    }

    /// The meaning of a text: a texture's name, or one with a channel behind a dot.
    fn from_text(text: &str) -> Self {
        let (name, channel) = split_channel(text);
        Self { channel, ..Self::plain(name) }
    }
}

/// A texture's name and the channel that may follow it behind a dot.
pub fn split_channel(text: &str) -> (&str, Option<Channel>) {
    match text.rsplit_once('.').map(|(name, channel)| (name, Channel::from_name(channel))) {
        Some((name, Some(channel))) => (name, Some(channel)),
        _ => (text, None),
    }
}

/// A number or a colour that multiplies a texture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Factor {
    /// The same for red, green and blue; alpha stays.
    Number(f64),
    /// Channel by channel.
    Color(Color),
}

impl Factor {
    fn one() -> Self {
        Self::Number(1.0)
    }

    fn is_one(&self) -> bool {
        matches!(self, Self::Number(1.0))
    }
}

impl JsonSchema for Factor {
    fn schema_name() -> Cow<'static, str> {
        "Factor".into()
    }

    fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "title": "a number or a colour",
            "anyOf": [{ "type": "number" }, color_numbers(), { "type": "string", "format": "color" }],
        })
    }
}

/// What a key that drives something holds: a number, a colour, or a texture.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// The same number everywhere.
    Number(f64),
    /// The same colour everywhere.
    Color(Color),
    /// A texture.
    Texture(TextureUse),
}

impl Input {
    /// A texture as it is.
    pub fn texture(name: impl Into<String>) -> Self {
        Self::Texture(TextureUse::plain(name))
    }
}

impl Serialize for Input {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Number(number) => number.serialize(serializer),
            Self::Color(color) => color.serialize(serializer),
            Self::Texture(TextureUse { texture, channel, factor, offset })
                if factor.is_one() && *offset == 0.0 =>
            {
                match channel {
                    None => texture.0.serialize(serializer),
                    Some(channel) => format!("{}.{}", texture.0, ["r", "g", "b", "a"][channel.index()])
                        .serialize(serializer),
                }
            }
            Self::Texture(texture_use) => texture_use.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Input {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(InputVisitor)
    }
}

struct InputVisitor;

impl<'de> Visitor<'de> for InputVisitor {
    type Value = Input;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, a colour or a texture")
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<Input, E> {
        Ok(Input::Number(number as f64))
    }

    fn visit_u64<E: de::Error>(self, number: u64) -> Result<Input, E> {
        Ok(Input::Number(number as f64))
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<Input, E> {
        Ok(Input::Number(number))
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Input, E> {
        if text.starts_with('#') {
            let color = Color::from_hex(text);
            return color.map(Input::Color).ok_or_else(|| E::custom("expected #rrggbb or #rrggbbaa"));
        }
        Ok(Input::Texture(TextureUse::from_text(text)))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Input, A::Error> {
        let mut numbers = Vec::new();
        while let Some(number) = items.next_element::<f64>()? {
            numbers.push(number);
        }
        Color::from_numbers(&numbers).map(Input::Color)
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Input, A::Error> {
        TextureUse::deserialize(de::value::MapAccessDeserializer::new(map)).map(Input::Texture)
    }
}

impl JsonSchema for Input {
    fn schema_name() -> Cow<'static, str> {
        "Input".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "title": "a number, a colour or a texture",
            "anyOf": [
                { "type": "number" },
                color_numbers(),
                { "type": "string", "format": "color-or-texture" },
                generator.subschema_for::<TextureUse>(),
            ],
        })
    }
}

/// A text that stands for something else: a schema with a format, which the checks of a file follow.
macro_rules! text_type {
    ($(#[$doc:meta])* $name:ident, $format:literal, $title:literal) => {
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub String);

        impl JsonSchema for $name {
            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
                json_schema!({ "title": $title, "type": "string", "format": $format })
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(&self.0)
            }
        }
    };
}

text_type!(
    /// The name of a table `[textures.NAME]`.
    TextureName,
    "texture",
    "the name of a texture"
);
text_type!(
    /// The name of a table `[materials.NAME]`.
    MaterialName,
    "material",
    "the name of a material"
);
text_type!(
    /// The name of an `[[object]]`.
    ObjectName,
    "object",
    "the name of an object"
);
text_type!(
    /// A file, relative to the look's own folder.
    FileName,
    "file",
    "the name of a file"
);

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

// Where a texture is looked up.

/// Coordinates of two-dimensional textures: a table, or the text of its key `from` alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct CoordinatesTable(pub CoordinatesKind);

impl Default for CoordinatesTable {
    /// The model's first texture coordinates.
    fn default() -> Self {
        Self(CoordinatesKind::Uv(UvTable::default()))
    }
}

/// Where two-dimensional coordinates come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "from", rename_all = "snake_case")]
pub enum CoordinatesKind {
    /// Texture coordinates of the model.
    Uv(UvTable),
    /// A plane in front of the model's bounding box.
    Plane(SurfaceTable),
    /// The model's bounding box: the longest edge is u, the second v.
    Box(SurfaceTable),
    /// An upright cylinder around the model.
    Cylinder(SurfaceTable),
    /// Longitude and latitude around the model.
    Sphere(SurfaceTable),
    /// Two hemispheres by stereographic projection.
    Hemispheres(SurfaceTable),
    /// Three planar projections, blended by the normal.
    Triplanar(TriplanarTable),
}

table! {
    /// Texture coordinates of the model.
    pub struct UvTable {
        /// Which set, from 0.
        #[schemars(range(max = 31))]
        pub set: u32 = 0,
    }

    /// An intermediate surface, fitted to the bounding box of the model and then placed. Object space: world units, the
    /// origin in the middle of the model.
    pub struct SurfaceTable {
        /// How a point of the object is joined to the surface.
        pub o_map: OMapName = OMapName::SurfaceNormal,
        /// The point that scale and rotation leave in place, and the centroid for `o_map = "centroid"`. World units, object space.
        pub pivot: [f64; 3] = [0.0; 3],
        /// Factors of the fitted surface's size.
        pub scale: Scale = Scale::Uniform(1.0),
        /// Rotation about x, then y, then z, in degrees.
        pub rotate: [f64; 3] = [0.0; 3],
        /// Shift after that, in world units.
        pub translate: [f64; 3] = [0.0; 3],
        /// Only for hemispheres: whether both discs lie side by side in the image or share it.
        pub layout: HemisphereLayoutName = HemisphereLayoutName::Shared,
    }

    /// Three planar projections.
    pub struct TriplanarTable {
        /// World units that the image covers; without it, the longest edge of the model's bounding box.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub size: Option<f64> = None,
        /// How narrow the blend is.
        #[schemars(range(min = 0.1, max = 64))]
        pub sharpness: f64 = 4.0,
    }
}

choice! {
    /// An O-map.
    pub enum OMapName {
        /// Along the view ray, reflected at the surface.
        Reflection,
        /// Along the object's normal.
        ObjectNormal,
        /// From the centroid through the point.
        Centroid,
        /// Along the normal of the intermediate surface.
        SurfaceNormal,
    }

    /// How the discs of two hemispheres lie in the image.
    pub enum HemisphereLayoutName {
        /// Both show the same disc.
        Shared,
        /// The upper one in the left half, the lower one in the right half.
        SideBySide,
    }
}

impl<'de> Deserialize<'de> for CoordinatesTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(CoordinatesVisitor)
    }
}

struct CoordinatesVisitor;

impl<'de> Visitor<'de> for CoordinatesVisitor {
    type Value = CoordinatesTable;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("coordinates")
    }

    fn visit_str<E: de::Error>(self, from: &str) -> Result<CoordinatesTable, E> {
        let from: StrDeserializer<'_, E> = from.into_deserializer();
        let table = de::value::MapDeserializer::new([("from", from)].into_iter());
        CoordinatesKind::deserialize(table).map(CoordinatesTable)
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<CoordinatesTable, A::Error> {
        CoordinatesKind::deserialize(de::value::MapAccessDeserializer::new(map)).map(CoordinatesTable)
    }
}

/// The kinds by name, for the text that stands for a table.
const COORDINATES: [&str; 7] = ["uv", "plane", "box", "cylinder", "sphere", "hemispheres", "triplanar"];

impl JsonSchema for CoordinatesTable {
    fn schema_name() -> Cow<'static, str> {
        "Coordinates".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let tables = generator.subschema_for::<CoordinatesKind>();
        json_schema!({
            "title": "a table with a key 'from', or its text alone",
            "anyOf": [{ "type": "string", "enum": COORDINATES }, tables],
        })
    }
}

/// A map of coordinates before the look-up: `matrix`, then scale and rotation about the pivot, then the shift. It acts on the
/// coordinates: a scale of 2 shows the texture twice as often, half as large.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MatrixTable {
    /// A projective map of (u, v, 1) by rows.
    pub projective: Option<[[f64; 3]; 3]>,
    /// The coordinates that scale and rotation leave in place.
    pub pivot: [f64; 2],
    /// Factors of u and v.
    pub scale: Scale,
    /// Rotation in degrees, from u towards v.
    pub rotate: f64,
    /// Added to u and v.
    pub translate: [f64; 2],
    /// Added to the shift each second.
    #[serde(rename = "move")]
    pub shift_per_second: [f64; 2],
    /// Added to the rotation each second, in degrees.
    pub spin: f64,
    /// By which the scale is multiplied each second.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub grow: f64,
}

impl Default for MatrixTable {
    /// Coordinates stay as they are.
    fn default() -> Self {
        Self {
            projective: None,
            pivot: [0.0; 2],
            scale: Scale::Uniform(1.0),
            rotate: 0.0,
            translate: [0.0; 2],
            shift_per_second: [0.0; 2],
            spin: 0.0,
            grow: 1.0,
        }
    }
}

/// Where a texture of space lies in the object: recipes are placed like an object of their own. A scale of 2 makes the
/// pattern twice as large.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PlaceTable {
    /// The point of the object that is the pattern's origin, in world units, object space.
    pub center: [f64; 3],
    /// Size of the pattern's unit: factors of the unit that `unit` names.
    pub scale: Scale,
    /// What is one unit of the pattern.
    pub unit: PlaceUnit,
    /// Rotation of the pattern about x, then y, then z, in degrees.
    pub rotate: [f64; 3],
    /// Shift of the pattern each second, in its units.
    #[serde(rename = "move")]
    pub shift_per_second: [f64; 3],
    /// Rotation of the pattern each second: the direction is the axis, the length the angle in degrees.
    pub spin: [f64; 3],
}

impl Default for PlaceTable {
    /// Around the model, with its bounding sphere's radius as unit.
    fn default() -> Self {
        Self {
            center: [0.0; 3],
            scale: Scale::Uniform(1.0),
            unit: PlaceUnit::Model,
            rotate: [0.0; 3],
            shift_per_second: [0.0; 3],
            spin: [0.0; 3],
        }
    }
}

choice! {
    /// A unit of length.
    pub enum PlaceUnit {
        /// The radius of the model's bounding sphere.
        Model,
        /// The world's unit.
        World,
    }
}
