//! Textures: images, noise, waves and solids, numbers of the surface, and what is made of other textures.

use fantex_base::parameters;
use fantex_texture::combine::{Binary, Combine, Contours, Layers, Mix, RampTexture, Remap, Swizzle};
use fantex_texture::coordinates::{InPlace, Place, PlaceUnit, TextureMatrixOptions};
use fantex_texture::{
    AlphaUse, Brick, Checker, Clouds, Color, ColorSpace, Depth, Filter, FrameWrap, Granite, Landscape, List3,
    Marble, NoiseOptions, PositiveLength, Rings, Rock, Sines, Wood, Wrap,
};
use glam::Vec3;
use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use super::{CoordinatesTable, FileName, Input};

/// A texture: its key `kind` says which.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum TextureTable {
    /// An image.
    Image(ImageTable),
    /// A volume in space.
    Volume(VolumeTable),
    /// Images that follow each other in time.
    Frames(FrameImagesTable),
    /// A cube map or any other environment, looked up by a direction.
    Cube(CubeTable),
    /// A channel of a baked asset, such as a light map.
    Asset(AssetTable),
    /// The same colour everywhere.
    Color(ColorTable),
    /// Gradient, cellular or white noise and its fractal sums.
    Noise(InPlace<NoiseOptions>),
    /// A sum of sine waves.
    Sines(InPlace<Sines>),
    /// Wood: annual rings about a trunk.
    Wood(InPlace<Wood>),
    /// Rings about an axis: `round(radius) mod period`.
    Rings(InPlace<Rings>),
    /// Marble: veins that wander.
    Marble(InPlace<Marble>),
    /// Clouds or smoke.
    Clouds(InPlace<Clouds>),
    /// Granite: grains of several minerals.
    Granite(InPlace<Granite>),
    /// Rock: strata and cracks.
    Rock(InPlace<Rock>),
    /// Cubes of two colours in turn.
    Checker(InPlace<Checker>),
    /// A wall of bricks.
    Brick(InPlace<Brick>),
    /// Grass, rock and snow by height and slope.
    Landscape(InPlace<Landscape>),
    /// Any texture, tabulated: computed once on a grid in space, then interpolated.
    Table(TabulationTable),
    /// A colour scale of a number.
    Ramp(RampTexture<Input>),
    /// Lines where a number passes multiples of a step.
    Contours(Contours<Input>),
    /// Polygons in the plane of the coordinates, sharp at any distance: windows on a wall, letters on a sign.
    Polygons(PolygonsTable),
    /// Two textures by a mode of the fixed-function pipeline.
    Combine(Combine<Input>),
    /// Textures one over the other, with masks.
    Layers(Layers<Input>),
    /// Two textures, mixed by a mask.
    Mix(Mix<Input>),
    /// A calculation with two textures, channel by channel.
    Math(Binary<Input>),
    /// Numbers brought from one range into another.
    Remap(Remap<Input>),
    /// Channels in another order.
    Swizzle(Swizzle<Input>),
    /// A texture asked elsewhere in space.
    Placed(PlacedTable),
    /// Height: the distance from a plane.
    Height(HeightTable),
    /// Distance from a point.
    Distance(DistanceTable),
    /// Angle between the surface and the ground, in degrees.
    Slope(SlopeTable),
    /// Cosine between normal and view, 0 to 1.
    Facing(NoKeys),
    /// Seconds since the start of the animation.
    Time(NoKeys),
    /// Texture coordinates, as red and green.
    Uv(UvFieldTable),
    /// Position within the bounding box of the model, 0 to 1 along each axis.
    Position(NoKeys),
    /// Normal in object space, -1 to 1 as 0 to 1.
    Normal(NoKeys),
    /// Vertex colours of the model.
    VertexColor(NoKeys),
}

parameters! {
    /// An image. Either `image` or `model_image` is needed.
    pub struct ImageTable {
        /// The file: PNG, JPEG, TIFF, WebP, HDR, OpenEXR, KTX2, DDS, TGA or BMP.
        pub image: Option<FileName> = None,
        /// An image of the model instead: its number, from 0.
        pub model_image: Option<u32> = None,
        /// What the numbers mean; floating-point images are always linear.
        pub color_space: ColorSpace = ColorSpace::Srgb,
        /// What alpha means when texels are averaged.
        pub alpha: AlphaUse = AlphaUse::Coverage,
        /// Where it is looked up.
        pub coordinates: CoordinatesTable = CoordinatesTable::default(),
        /// Map of the coordinates before the look-up.
        pub matrix: TextureMatrixOptions = TextureMatrixOptions::default(),
        /// What lies outside the image, along u and v.
        pub wrap: WrapTable = WrapTable::Both(Wrap::Repeat),
        /// Colour outside the image for `wrap = "border"`.
        pub border: Color = Color::CLEAR,
        /// How it is filtered; as `picture.filter` says where it is left out.
        pub filter: Option<Filter> = None,
        /// Longest ratio of the footprint's axes that anisotropic filters honour.
        #[schemars(range(min = 1, max = 64))]
        pub max_anisotropy: f32 = 16.0,
        /// Whether texels are squares when they are larger than pixels.
        pub square_texels: bool = false,
        /// Width over which it is blurred besides, as a share of the image.
        #[schemars(range(min = 0, max = 1))]
        pub blur: f32 = 0.0,
    }

    /// A volume: a MetaImage, a stack of images of one size, the first at the lowest z, or a block of raw numbers.
    pub struct VolumeTable {
        /// A MetaImage file (.mhd, .mha).
        pub meta_image: Option<FileName> = None,
        /// One image per slice.
        pub slices: Vec<FileName> = Vec::new(),
        /// A file of raw numbers, x fastest, then y, then z; needs `size`.
        pub raw: Option<FileName> = None,
        /// Numbers along x, y and z of a raw file.
        pub size: Option<[VolumeSide; 3]> = None,
        /// Channels of a raw file.
        #[schemars(range(min = 1, max = 4))]
        pub channels: u32 = 1,
        /// Numbers of a raw file.
        pub format: Depth = Depth::U8,
        /// What the numbers of images mean.
        pub color_space: ColorSpace = ColorSpace::Srgb,
        /// Where the volume lies: its middle is the centre, its height 2 units, so that it surrounds the model.
        pub place: Place = Place::default(),
        /// Extents in units of the place; from the numbers of its voxels, the longest side being 2, where it is left out.
        pub extent: Option<[PositiveLength; 3]> = None,
        /// What lies outside.
        pub wrap: Wrap = Wrap::Clamp,
    }

    /// Images that follow each other.
    #[schemars(extend("required" = ["images"]))]
    pub struct FrameImagesTable {
        /// The images, of any sizes.
        #[schemars(length(min = 1, max = 100_000))]
        pub images: Vec<FileName> = Vec::new(),
        /// Images per second.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub rate: f32 = 25.0,
        /// What follows the last image.
        pub after: FrameWrap = FrameWrap::Repeat,
        /// Whether images fade into each other.
        pub blend: bool = true,
        /// What the numbers mean.
        pub color_space: ColorSpace = ColorSpace::Srgb,
        /// Where they are looked up.
        pub coordinates: CoordinatesTable = CoordinatesTable::default(),
        /// Map of the coordinates before the look-up.
        pub matrix: TextureMatrixOptions = TextureMatrixOptions::default(),
        /// What lies outside the images, along u and v.
        pub wrap: WrapTable = WrapTable::Both(Wrap::Repeat),
        /// How they are filtered; as `picture.filter` says where it is left out.
        pub filter: Option<Filter> = None,
    }

    /// An environment as a texture. Either `image` or `faces` is needed.
    pub struct CubeTable {
        /// Latitude-longitude, an unfolded cube, a strip of faces: recognised by its proportions; or a KTX2 or DDS file of a cube.
        pub image: Option<FileName> = None,
        /// Six images: right, left, up, down, front, back.
        pub faces: Option<[FileName; 6]> = None,
        /// Which direction it is looked up by.
        pub direction: DirectionName = DirectionName::Reflection,
        /// Point from which directions count for `direction = "position"`, in world units, object space.
        #[serde(with = "List3")]
        pub center: Vec3 = Vec3::ZERO,
        /// Turned about the vertical axis, in degrees.
        pub rotation: f32 = 0.0,
        /// Shape of near surroundings, taken at `center`: reflections take the place of the surface into account.
        pub room: Option<RoomTable> = None,
    }

    /// The shape of near surroundings: an axis-aligned box, or a ball where `radius` is there. World units, object space.
    pub struct RoomTable {
        /// Smallest coordinates of the box.
        pub min: Option<[f32; 3]> = None,
        /// Largest coordinates of the box.
        pub max: Option<[f32; 3]> = None,
        /// Centre of the ball.
        #[serde(with = "List3")]
        pub center: Vec3 = Vec3::ZERO,
        /// Radius of the ball.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub radius: Option<f32> = None,
    }

    /// An asset that was baked on the model (`fantex bake`), of any density.
    #[schemars(extend("required" = ["asset"]))]
    pub struct AssetTable {
        /// The file (.fan).
        pub asset: Option<FileName> = None,
        /// Which channel; light, or else the base colour, where it is left out.
        pub channel: Option<AssetChannel> = None,
        /// How it is filtered; as `picture.filter` says where it is left out.
        pub filter: Option<Filter> = None,
    }

    /// A colour.
    #[schemars(extend("required" = ["color"]))]
    pub struct ColorTable {
        /// The colour.
        pub color: Color = Color::WHITE,
    }

    /// A tabulation.
    #[schemars(extend("required" = ["texture"]))]
    pub struct TabulationTable {
        /// The texture; it is asked for its value in space, so it must not need texture coordinates, a normal or an eye (`facing` is 1 there).
        pub texture: Input = Input::Number(0.0),
        /// Values along the longest side of the box.
        #[schemars(range(min = 2, max = 2048))]
        pub size: u32 = 128,
        /// Smallest coordinates of the box that is tabulated, object space; those of the model's bounding box where they are left out.
        pub min: Option<[f32; 3]> = None,
        /// Largest coordinates of the box; those of the model's bounding box where they are left out.
        pub max: Option<[f32; 3]> = None,
        /// Whether values are interpolated.
        pub smooth: bool = true,
        /// What lies outside the box.
        pub wrap: Wrap = Wrap::Clamp,
    }

    /// Polygons.
    #[schemars(extend("required" = ["polygons"]))]
    pub struct PolygonsTable {
        /// The polygons; later ones cover earlier ones of the same priority.
        #[schemars(length(min = 1, max = 100_000))]
        pub polygons: Vec<PolygonTable> = Vec::new(),
        /// What is seen between them.
        pub base: Input = Input::Color(Color::CLEAR),
        /// Whether they come again in every unit square of the coordinates.
        pub repeat: bool = false,
        /// Where they lie.
        pub coordinates: CoordinatesTable = CoordinatesTable::default(),
        /// Map of the coordinates before that.
        pub matrix: TextureMatrixOptions = TextureMatrixOptions::default(),
    }

    /// A polygon.
    #[schemars(extend("required" = ["outlines"]))]
    pub struct PolygonTable {
        /// Closed outlines, each a list of corners `[u, v]`: the polygon is what lies inside an odd number of them, so that
        /// holes are outlines, too. They must not cross.
        #[schemars(length(min = 1, max = 10_000))]
        pub outlines: Vec<Vec<[f32; 2]>> = Vec::new(),
        /// Its colour.
        pub color: Input = Input::Color(Color::WHITE),
        /// Polygons of higher priority cover those of lower.
        pub priority: i32 = 0,
    }

    /// A texture elsewhere.
    #[schemars(extend("required" = ["texture"]))]
    pub struct PlacedTable {
        /// The texture; its own place is within this one.
        pub texture: Input = Input::Number(0.0),
        /// Where it lies, in world units where `unit` is left out.
        #[serde(deserialize_with = "in_world_units")]
        pub place: Place = Place { unit: PlaceUnit::World, ..Place::default() },
    }

    /// A height.
    pub struct HeightTable {
        /// In which direction it grows, object space.
        #[serde(with = "List3")]
        pub direction: Vec3 = Vec3::Y,
        /// Where it is 0; without it, heights run from 0 to 1 over the model's bounding box.
        pub origin: Option<[f32; 3]> = None,
        /// World units of 1; only with `origin`.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub unit: f32 = 1.0,
    }

    /// A distance in world units.
    pub struct DistanceTable {
        /// The point, object space.
        #[serde(with = "List3")]
        pub center: Vec3 = Vec3::ZERO,
        /// Direction of an axis through it, object space, from which distance is measured instead.
        pub axis: Option<[f32; 3]> = None,
    }

    /// A slope.
    pub struct SlopeTable {
        /// Upwards, object space.
        #[serde(with = "List3")]
        pub up: Vec3 = Vec3::Y,
    }

    /// Texture coordinates.
    pub struct UvFieldTable {
        /// Which set, from 0.
        #[schemars(range(max = 7))]
        pub set: u32 = 0,
    }

    /// No keys but `kind`.
    pub struct NoKeys {}
}

/// Voxels along a side of a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct VolumeSide(#[schemars(range(min = 1, max = 65_536))] pub u32);

/// What lies outside an image: the same along u and v, or a text for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(title = "one of \"repeat\", \"clamp\", \"mirror\", \"border\", or a list of two of them")]
pub enum WrapTable {
    /// Along both.
    Both(Wrap),
    /// Along u and along v.
    Each([Wrap; 2]),
}

/// A place whose unit is the world's, unless it has one: what keys leave out is otherwise that of patterns.
fn in_world_units<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Place, D::Error> {
    let mut place = Map::deserialize(deserializer)?;
    place.entry("unit").or_insert_with(|| "world".into());
    serde_json::from_value(Value::Object(place)).map_err(D::Error::custom)
}

impl WrapTable {
    /// Along u and v.
    pub fn each(self) -> [Wrap; 2] {
        match self {
            Self::Both(wrap) => [wrap; 2],
            Self::Each(wraps) => wraps,
        }
    }
}

/// A channel of an asset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AssetChannel {
    /// Light that arrives.
    Light,
    /// Colour and opacity.
    BaseColor,
    /// Emitted light.
    Emission,
    /// Heights.
    Displacement,
    /// Occlusion, roughness, metallic as red, green, blue.
    Orm,
    /// As `orm`.
    Surface,
}

/// A direction that every surface point has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DirectionName {
    /// The view ray, reflected.
    Reflection,
    /// The normal.
    Normal,
    /// From a centre to the point.
    Position,
    /// The view ray as it goes on behind the surface.
    View,
}
