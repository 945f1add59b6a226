//! Values of a look's keys: inputs that may be textures, names, coordinates.

use std::borrow::Cow;
use std::fmt;

use fantex_base::parameters;
use fantex_texture::combine::{Channel, TextureUse};
use fantex_texture::{Color, HemisphereLayout, Scale};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::StrDeserializer;
use serde::de::{self, IntoDeserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A texture's name and the channel that may follow it behind a dot.
pub(crate) fn split_channel(text: &str) -> (&str, Option<Channel>) {
    let channel = |name: &str| match name {
        "r" => Some(Channel::Red),
        "g" => Some(Channel::Green),
        "b" => Some(Channel::Blue),
        "a" => Some(Channel::Alpha),
        _ => None,
    };
    match text.rsplit_once('.').map(|(name, last)| (name, channel(last))) {
        Some((name, Some(channel))) => (name, Some(channel)),
        _ => (text, None),
    }
}

/// What a key that drives something holds: a number, a colour, or a texture as `"NAME"`, `"NAME.g"` or a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// The same number everywhere.
    Number(f32),
    /// The same colour everywhere.
    Color(Color),
    /// A texture.
    Texture(TextureUse<TextureName>),
}

impl Input {
    /// A texture as it is.
    pub fn texture(name: impl Into<String>) -> Self {
        Self::Texture(TextureUse::plain(TextureName(name.into())))
    }
}

impl From<f32> for Input {
    fn from(number: f32) -> Self {
        Self::Number(number)
    }
}

impl From<Color> for Input {
    fn from(color: Color) -> Self {
        Self::Color(color)
    }
}

impl Serialize for Input {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let texture_use = match self {
            Self::Number(number) => return number.serialize(serializer),
            Self::Color(color) => return color.serialize(serializer),
            Self::Texture(texture_use) => texture_use,
        };
        let TextureUse { texture, channel, factor, offset } = texture_use;
        let letter = match channel {
            _ if !factor.is_one() || *offset != 0.0 => return texture_use.serialize(serializer),
            None => return texture.serialize(serializer),
            Some(Channel::Red) => "r",
            Some(Channel::Green) => "g",
            Some(Channel::Blue) => "b",
            Some(Channel::Alpha) => "a",
            Some(_) => return texture_use.serialize(serializer),
        };
        format!("{texture}.{letter}").serialize(serializer)
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
        Ok(Input::Number(number as f32))
    }

    fn visit_u64<E: de::Error>(self, number: u64) -> Result<Input, E> {
        Ok(Input::Number(number as f32))
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<Input, E> {
        Ok(Input::Number(number as f32))
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Input, E> {
        if text.starts_with('#') {
            let color = Color::from_hex(text);
            return color.map(Input::Color).ok_or_else(|| E::custom("expected #rrggbb or #rrggbbaa"));
        }
        let (name, channel) = split_channel(text);
        Ok(Input::Texture(TextureUse { channel, ..TextureUse::plain(TextureName(name.into())) }))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Input, A::Error> {
        Color::deserialize(de::value::SeqAccessDeserializer::new(items)).map(Input::Color)
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
                { "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 4 },
                { "type": "string", "format": "color-or-texture" },
                generator.subschema_for::<TextureUse<TextureName>>(),
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
    /// Numbers of textures: an image of one row is a table of one dimension.
    Texture(IndexTable),
}

parameters! {
    /// Texture coordinates of the model.
    pub struct UvTable {
        /// Which set, from 0.
        #[schemars(range(max = 7))]
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
        pub layout: HemisphereLayout = HemisphereLayout::Shared,
    }

    /// Coordinates that textures give.
    #[schemars(extend("required" = ["u"]))]
    pub struct IndexTable {
        /// u: red of a texture, or a number.
        pub u: Input = Input::Number(0.5),
        /// v, from the top; the middle where it is left out, for images of one row.
        pub v: Input = Input::Number(0.5),
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

/// How a point of the object is joined to the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
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
