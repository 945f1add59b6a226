//! Camera, picture, objects, and what is baked.

use std::collections::BTreeMap;

use super::{Color, FileName, MaterialName, Scale, TextureName};

table! {
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
        pub filter: FilterName = FilterName::Anisotropic,
        /// How attributes are interpolated over a triangle.
        pub interpolation: InterpolationName = InterpolationName::Perspective,
        /// How often surfaces are asked for their colour.
        pub shading: ShadingName = ShadingName::PerPixel,
        /// Brightness in stops: each doubles the light.
        #[schemars(range(min = -20, max = 20))]
        pub exposure: f64 = 0.0,
        /// How bright light is brought into the picture's range.
        pub tone_mapping: ToneMappingName = ToneMappingName::None,
        /// Colour behind the scene, with alpha 0 for a transparent picture; from white above to grey below where it is left out.
        pub background: Option<Color> = None,
        /// Seconds since the start of the animation.
        pub time: f64 = 0.0,
        /// An animation: numbered pictures.
        pub frames: Option<FramesTable> = None,
        /// A halo around bright light.
        pub glow: Option<GlowTable> = None,
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

    /// A halo.
    pub struct GlowTable {
        /// Radius in shares of the picture's height.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1))]
        pub radius: f64 = 0.05,
        /// Share of the light that is spread.
        #[schemars(range(min = 0, max = 100))]
        pub strength: f64 = 0.5,
        /// Light above which a surface glows by itself; emission always does.
        #[schemars(range(min = 0))]
        pub threshold: Option<f64> = None,
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
        pub size: [PositiveLength; 3] = [PositiveLength(1.0); 3],
        /// Radius of spheres, cylinders, cones and tori, in world units.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub radius: f64 = 0.5,
        /// Radius of a torus's tube, in world units.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub tube: f64 = 0.2,
        /// Height of cylinders and cones, in world units.
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
        /// The finished light.
        pub light: Option<LightBakeTable> = None,
    }

    /// Light by path tracing.
    pub struct LightBakeTable {
        /// Which light.
        pub quantity: LightQuantityName = LightQuantityName::Full,
        /// Whether the light is multiplied with the base colour, so that the bake is the finished picture.
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
    }
}

/// A side of the picture in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(transparent)]
pub struct PictureSide(#[schemars(range(min = 1, max = 16_384))] pub u32);

/// A length above 0.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(transparent)]
pub struct PositiveLength(#[schemars(extend("exclusiveMinimum" = 0))] pub f64);

choice! {
    /// A filter.
    pub enum FilterName {
        /// The nearest texel.
        Nearest,
        /// Four texels, no anti-aliasing.
        Bilinear,
        /// Sixteen texels, no anti-aliasing.
        Bicubic,
        /// Two detail levels.
        Trilinear,
        /// Several trilinear probes along the footprint.
        Anisotropic,
        /// Elliptical weighted average, the reference.
        Ewa,
    }

    /// How attributes are interpolated.
    pub enum InterpolationName {
        /// Perspectively correct.
        Perspective,
        /// Linearly on the screen: wrong, shown for comparison.
        Affine,
    }

    /// How often surfaces are asked.
    pub enum ShadingName {
        /// Once per pixel and triangle.
        PerPixel,
        /// At every sample: supersampling.
        PerSample,
    }

    /// How bright light is brought into the picture's range.
    pub enum ToneMappingName {
        /// Cut off.
        None,
        /// Reinhard's curve.
        Reinhard,
        /// A film-like curve.
        Filmic,
    }

    /// A simple shape.
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

    /// Which light is baked.
    pub enum LightQuantityName {
        /// What lamps, sky and glowing surfaces give directly.
        Direct,
        /// The share of the sky that is seen.
        AmbientOcclusion,
        /// All light.
        Full,
    }
}
