//! Where a texture is looked up.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::StrDeserializer;
use serde::de::{self, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::Scale;

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
