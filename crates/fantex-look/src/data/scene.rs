//! Camera, picture, lamps, surroundings, objects, and what is baked.

use std::collections::BTreeMap;

use fantex_base::parameters;
use fantex_scene::{Glow, Interpolation, LightQuantity, ShadingRate, ShadowOptions, ToneMap};
use fantex_texture::environment::{EnvironmentForm, EnvironmentLayout, Sky};
use fantex_texture::{Color, Filter, Scale};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FileName, MaterialName, ObjectName, TextureName};

parameters! {
    /// A pinhole camera, world space.
    pub struct CameraTable {
        /// Where it is, world units; without it, it shows the whole scene from the front, the right and above.
        pub eye: Option<[f64; 3]> = None,
        /// What it looks at, world units; the middle of the scene where it is left out.
        pub target: Option<[f64; 3]> = None,
        /// Upwards in the picture.
        pub up: [f64; 3] = [0.0, 1.0, 0.0],
        /// Vertical opening angle in degrees.
        #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
        pub fov: f64 = 35.0,
    }

    /// The picture.
    pub struct PictureTable {
        /// Width and height in pixels.
        pub size: [PictureSide; 2] = [PictureSide(1280), PictureSide(720)],
        /// Samples per pixel.
        #[schemars(range(min = 1, max = 64))]
        pub samples: u32 = 8,
        /// How images are filtered that do not say so themselves.
        pub filter: Filter = Filter::Anisotropic,
        /// How attributes are interpolated over a triangle.
        pub interpolation: Interpolation = Interpolation::Perspective,
        /// How often surfaces are asked for their colour.
        pub shading: ShadingRate = ShadingRate::PerPixel,
        /// Brightness in stops: each doubles the light.
        #[schemars(range(min = -20, max = 20))]
        pub exposure: f64 = 0.0,
        /// How bright light is brought into the picture's range.
        pub tone_mapping: ToneMap = ToneMap::Clip,
        /// Colour behind the scene, with alpha 0 for a transparent picture; a light grey that darkens downwards where it is left out.
        pub background: Option<Color> = None,
        /// Seconds since the start of the animation.
        pub time: f64 = 0.0,
        /// An animation: numbered pictures.
        pub frames: Option<FramesTable> = None,
        /// A halo around bright light.
        pub glow: Option<Glow> = None,
    }

    /// The pictures of an animation.
    #[schemars(extend("required" = ["count"]))]
    pub struct FramesTable {
        /// How many.
        #[schemars(range(min = 1, max = 100_000))]
        pub count: u32 = 1,
        /// Time of the first, in seconds.
        pub from: f64 = 0.0,
        /// Time after the last, in seconds: the animation takes `to - from`.
        pub to: f64 = 1.0,
    }

    /// A thing in the scene: a model, an asset, or a simple shape.
    pub struct ObjectTable {
        /// Name, for the environment that it captures.
        pub name: Option<String> = None,
        /// A model (.glb .gltf .obj .ply .stl) or an asset (.fan); the model of the command line where neither this nor a shape is given.
        pub model: Option<FileName> = None,
        /// A simple shape instead of a model.
        pub shape: Option<ShapeTable> = None,
        /// The material of the whole object; its own where it is left out.
        pub material: Option<MaterialName> = None,
        /// Materials for those of the model, by their name in the model.
        pub materials: BTreeMap<String, MaterialName> = BTreeMap::new(),
        /// Factors of its size.
        pub scale: Scale = Scale::Uniform(1.0),
        /// Rotation about x, then y, then z, in degrees.
        pub rotate: [f64; 3] = [0.0; 3],
        /// Shift after that, in world units.
        pub translate: [f64; 3] = [0.0; 3],
    }

    /// A simple shape around the origin.
    #[schemars(extend("required" = ["kind"]))]
    pub struct ShapeTable {
        /// Which.
        pub kind: ShapeName = ShapeName::Sphere,
        /// Width, height and depth of a box; width and depth of a plane; in world units.
        pub size: [ShapeLength; 3] = [ShapeLength(1.0); 3],
        /// Radius of spheres, cylinders and tori, in world units.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub radius: f64 = 0.5,
        /// Radius of a torus's tube, in world units.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub tube: f64 = 0.2,
        /// Height of cylinders, in world units.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub height: f64 = 1.0,
        /// How finely round shapes are divided: edges round the equator; edges along a side of a plane or box.
        #[schemars(range(min = 1, max = 4096))]
        pub segments: Option<u32> = None,
    }

    /// What a bake puts into the tiles: the channels of the material, unless one of the keys is there.
    pub struct BakeTable {
        /// The material that is baked where no object names one; the only one where it is left out.
        pub material: Option<MaterialName> = None,
        /// A texture, as base colour.
        pub texture: Option<TextureName> = None,
        /// Seconds since the start of the animation.
        pub time: f64 = 0.0,
        /// Whether displacements become a channel of heights, the red of their textures, instead of geometry.
        pub heights: bool = false,
        /// The finished light.
        pub light: Option<LightBakeTable> = None,
    }

    /// Light by path tracing.
    pub struct LightBakeTable {
        /// Which light.
        pub quantity: LightQuantity = LightQuantity::Full,
        /// Whether the light is multiplied with the base colour, so that the bake is the finished picture; else it is a light map, the
        /// channel `light`.
        pub colored: bool = true,
        /// Paths per texel.
        #[schemars(range(min = 4, max = 1_048_576))]
        pub samples: u32 = 256,
        /// Diffuse reflections that are followed.
        #[schemars(range(max = 64))]
        pub bounces: u32 = 4,
        /// Standard error above which a texel takes more paths, in units of the light.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub target_error: Option<f64> = None,
        /// Paths per texel at most.
        #[schemars(range(min = 4, max = 1_048_576))]
        pub max_samples: u32 = 4096,
        /// Distance beyond which surfaces do not occlude, in world units; only for ambient occlusion.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub occlusion_distance: Option<f64> = None,
        /// Whether noise is taken out: texels become the mean of their neighbours that differ by no more than noise.
        pub denoise: bool = true,
    }
}

/// A length of a shape, above 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct ShapeLength(#[schemars(extend("exclusiveMinimum" = 0))] pub f64);

/// A side of the picture in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct PictureSide(#[schemars(range(min = 1, max = 16_384))] pub u32);

/// A simple shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShapeName {
    /// A square in the x-z plane, seen from above.
    Plane,
    /// A box.
    Box,
    /// A sphere of longitudes and latitudes.
    Sphere,
    /// An upright cylinder.
    Cylinder,
    /// A torus around the vertical axis.
    Torus,
}

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

parameters! {
    /// Light from one direction.
    #[schemars(extend("required" = ["to_light"]))]
    pub struct SunTable {
        /// From the surface to the light, of any length but zero, world axes.
        pub to_light: [f64; 3] = [0.0, 1.0, 0.0],
        /// Colour: what a white surface that faces the light reflects.
        pub color: Color = Color::WHITE,
        /// Factor of the colour.
        #[schemars(range(min = 0))]
        pub strength: f32 = 1.0,
        /// Half the angle under which the light is seen, in degrees: soft shadows in baked light.
        #[schemars(range(min = 0, max = 90))]
        pub radius: f64 = 0.27,
        /// Shadows; none where it is left out.
        pub shadow: Option<ShadowOptions> = None,
    }

    /// How light from a place shines.
    pub struct Beam {
        /// Colour: what a white surface that faces the light reflects (at the distance `full_at`, where that is given).
        pub color: Color = Color::WHITE,
        /// Factor of the colour.
        #[schemars(range(min = 0))]
        pub strength: f32 = 1.0,
        /// Distance in world units at which it is as strong as it says. It weakens with the square of the distance, so that nearer it is
        /// stronger: four times at half of it. Without it, it does not weaken.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub full_at: Option<f64> = None,
        /// Distance in world units beyond which there is no light; needs `full_at`.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub range: Option<f64> = None,
        /// Shadows; none where it is left out.
        pub shadow: Option<ShadowOptions> = None,
    }

    /// Light from a point.
    #[schemars(extend("required" = ["position"]))]
    pub struct PointTable {
        /// Where it is, world units.
        pub position: [f64; 3] = [0.0; 3],
        /// How it shines.
        #[serde(flatten)]
        pub beam: Beam = Beam::default(),
        /// Radius of the lamp in world units: soft shadows in baked light.
        #[schemars(range(min = 0))]
        pub radius: f64 = 0.0,
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
        /// How it shines.
        #[serde(flatten)]
        pub beam: Beam = Beam::default(),
        /// Radius of the lamp in world units: soft shadows in baked light.
        #[schemars(range(min = 0))]
        pub radius: f64 = 0.0,
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
        /// How it shines.
        #[serde(flatten)]
        pub beam: Beam = Beam::default(),
    }

    /// Light from everywhere.
    pub struct AmbientTable {
        /// From straight above.
        pub sky: Color = Color::WHITE,
        /// From straight below; as from above where it is left out.
        pub ground: Option<Color> = None,
        /// Factor of both.
        #[schemars(range(min = 0))]
        pub strength: f32 = 1.0,
    }

}

parameters! {
    /// The surroundings: one of `image`, `faces`, `sky`, `capture` or `color` says what they are.
    pub struct EnvironmentTable {
        /// A picture of the surroundings, usually HDR: latitude-longitude, an unfolded cube, a strip of faces, or a KTX2 or DDS file of a
        /// cube; with `layout`, two paraboloids or a mirror ball.
        pub image: Option<FileName> = None,
        /// Six pictures: right, left, up, down, front, back.
        pub faces: Option<[FileName; 6]> = None,
        /// A clear sky, computed.
        pub sky: Option<Sky> = None,
        /// What is seen from an object, rendered in six passes.
        pub capture: Option<CaptureTable> = None,
        /// The same colour on all sides.
        pub color: Option<Color> = None,
        /// How `image` is laid out; recognised by its proportions where it is left out, but for paraboloids and mirror balls.
        pub layout: Option<EnvironmentLayout> = None,
        /// Factor of its light.
        #[schemars(range(min = 0))]
        pub strength: f32 = 1.0,
        /// Turned about the vertical axis, in degrees.
        pub rotation: f64 = 0.0,
        /// Whether it is the background of the picture.
        pub visible: bool = true,
        /// The form into which it is converted; it keeps its own where this is left out.
        pub form: Option<EnvironmentForm> = None,
        /// Texels along a face of the cube, a disc or the height of the sphere after conversion, and of a sky.
        #[schemars(range(min = 4, max = 8192))]
        pub size: u32 = 512,
    }

    /// The scene as an object sees it.
    pub struct CaptureTable {
        /// The object that is left out, and from whose middle the scene is rendered; the first one where it is left out.
        pub object: Option<ObjectName> = None,
        /// From where instead, world units.
        pub position: Option<[f64; 3]> = None,
        /// What is behind the scene.
        pub sky: Option<Sky> = None,
        /// Texels along a face.
        #[schemars(range(min = 4, max = 4096))]
        pub size: u32 = 256,
        /// Samples per texel.
        #[schemars(range(min = 1, max = 64))]
        pub samples: u32 = 4,
    }
}
