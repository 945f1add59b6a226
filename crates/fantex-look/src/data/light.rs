//! Lamps.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Color, FileName, TextureName};

/// A lamp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum LightTable {
    /// Light from one direction.
    Sun(SunTable),
    /// Light from a point to all sides.
    Point(PointTable),
    /// Light from a point into a cone.
    Spot(SpotTable),
    /// Light through a slide.
    Projector(ProjectorTable),
    /// Light from everywhere.
    Ambient(AmbientTable),
}

table! {
    /// Light from one direction.
    #[schemars(extend("required" = ["to_light"]))]
    pub struct SunTable {
        /// From the surface to the light, of any length but zero, world axes.
        pub to_light: [f64; 3] = [0.0, 1.0, 0.0],
        /// Colour: what a white surface that faces the light reflects.
        pub color: Color = Color::WHITE,
        /// Factor of the colour.
        #[schemars(range(min = 0))]
        pub strength: f64 = 1.0,
        /// Half the angle under which the light is seen, in degrees: soft shadows in baked light.
        #[schemars(range(min = 0, max = 90))]
        pub radius: f64 = 0.27,
        /// Shadows; none where it is left out.
        pub shadow: Option<ShadowTable> = None,
    }

    /// Light from a point.
    #[schemars(extend("required" = ["position"]))]
    pub struct PointTable {
        /// Where it is, world units.
        pub position: [f64; 3] = [0.0; 3],
        /// Colour: what a white surface that faces the light at the distance `full_at` reflects.
        pub color: Color = Color::WHITE,
        /// Factor of the colour.
        #[schemars(range(min = 0))]
        pub strength: f64 = 1.0,
        /// Distance in world units at which it has its full strength and beyond which it weakens with the square of the
        /// distance; without it, it does not weaken.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub full_at: Option<f64> = None,
        /// Distance in world units beyond which there is no light; needs `full_at`.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub range: Option<f64> = None,
        /// Radius of the lamp in world units: soft shadows in baked light.
        #[schemars(range(min = 0))]
        pub radius: f64 = 0.0,
        /// Shadows; none where it is left out.
        pub shadow: Option<ShadowTable> = None,
    }

    /// Light from a point into a cone.
    #[schemars(extend("required" = ["position", "target"]))]
    pub struct SpotTable {
        /// Where it is, world units.
        pub position: [f64; 3] = [0.0; 3],
        /// A point on the cone's axis, world units.
        pub target: [f64; 3] = [0.0; 3],
        /// Angle between the axis and the border of the full light, in degrees.
        #[schemars(range(min = 0, max = 90))]
        pub inner: f64 = 20.0,
        /// Angle between the axis and the border of all light, in degrees; not below `inner`.
        #[schemars(range(min = 0, max = 90))]
        pub outer: f64 = 25.0,
        /// Colour: what a white surface that faces the light reflects.
        pub color: Color = Color::WHITE,
        /// Factor of the colour.
        #[schemars(range(min = 0))]
        pub strength: f64 = 1.0,
        /// Distance in world units at which it has its full strength and beyond which it weakens with the square of the
        /// distance; without it, it does not weaken.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub full_at: Option<f64> = None,
        /// Distance in world units beyond which there is no light; needs `full_at`.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub range: Option<f64> = None,
        /// Radius of the lamp in world units: soft shadows in baked light.
        #[schemars(range(min = 0))]
        pub radius: f64 = 0.0,
        /// Shadows; none where it is left out.
        pub shadow: Option<ShadowTable> = None,
    }

    /// Light through a slide: an image or any texture.
    #[schemars(extend("required" = ["position", "target"]))]
    pub struct ProjectorTable {
        /// The pinhole, world units.
        pub position: [f64; 3] = [0.0; 3],
        /// Where the middle of the slide falls, world units.
        pub target: [f64; 3] = [0.0; 3],
        /// To the top of the slide.
        pub up: [f64; 3] = [0.0, 1.0, 0.0],
        /// Vertical opening angle in degrees.
        #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
        pub fov: f64 = 30.0,
        /// Height of the picture in world units, for parallel light instead of light from a point.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub height: Option<f64> = None,
        /// Width of the slide over its height; the image's where it is left out, else 1.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub aspect: Option<f64> = None,
        /// The slide, an image.
        pub image: Option<FileName> = None,
        /// The slide, a texture: its coordinates run over the slide from 0 to 1.
        pub texture: Option<TextureName> = None,
        /// Colour of the lamp behind the slide.
        pub color: Color = Color::WHITE,
        /// Factor of the colour.
        #[schemars(range(min = 0))]
        pub strength: f64 = 1.0,
        /// Distance in world units at which it has its full strength and beyond which it weakens with the square of the
        /// distance; without it, it does not weaken.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub full_at: Option<f64> = None,
        /// Distance in world units beyond which there is no light; needs `full_at`.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub range: Option<f64> = None,
        /// Shadows; none where it is left out.
        pub shadow: Option<ShadowTable> = None,
    }

    /// Light from everywhere.
    pub struct AmbientTable {
        /// From straight above.
        pub sky: Color = Color::WHITE,
        /// From straight below; as from above where it is left out.
        pub ground: Option<Color> = None,
        /// Factor of both.
        #[schemars(range(min = 0))]
        pub strength: f64 = 1.0,
    }

    /// A shadow map.
    pub struct ShadowTable {
        /// Texels along each side of the map.
        #[schemars(range(min = 16, max = 16384))]
        pub size: u32 = 2048,
        /// How far a receiver is lifted towards the lamp, in texels of the map.
        #[schemars(range(min = 0, max = 1000))]
        pub bias: f64 = 1.0,
        /// How far a receiver is lifted along its normal where light grazes it, in texels of the map.
        #[schemars(range(min = 0, max = 1000))]
        pub normal_bias: f64 = 1.5,
        /// Half the width of the border, in world units.
        #[schemars(range(min = 0))]
        pub softness: f64 = 0.0,
        /// Radius of the lamp in world units (of the sun: the tangent of its angle): borders grow wider with the distance.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub lamp_radius: Option<f64> = None,
    }
}
