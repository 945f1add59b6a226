//! Textures: images, noise, waves and solids, numbers of the surface, and what is made of other textures.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Color, CoordinatesTable, FileName, FilterName, Input, MatrixTable, PlaceTable, PositiveLength, RampName,
    StopTable,
};

// Textures: images, numbers of the surface, and what is made of other textures.

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
    /// The same colour everywhere.
    Color(ColorTable),
    /// Gradient, cellular or white noise and its fractal sums.
    Noise(NoiseTable),
    /// A sum of sine waves.
    Sines(SinesTable),
    /// Wood: annual rings about a trunk.
    Wood(WoodTable),
    /// Marble: veins that wander.
    Marble(MarbleTable),
    /// Clouds or smoke.
    Clouds(CloudsTable),
    /// Granite: grains of several minerals.
    Granite(GraniteTable),
    /// Rock: strata and cracks.
    Rock(RockTable),
    /// Cubes of two colours in turn.
    Checker(CheckerTable),
    /// A wall of bricks.
    Brick(BrickTable),
    /// Grass, rock and snow by height and slope.
    Landscape(LandscapeTable),
    /// Any texture, tabulated: computed once on a grid in space, then interpolated.
    Table(TabulationTable),
    /// A colour scale of a number.
    Ramp(RampTable),
    /// Lines where a number passes multiples of a step.
    Contours(ContoursTable),
    /// Polygons in the plane of the coordinates, sharp at any distance: windows on a wall, letters on a sign.
    Polygons(PolygonsTable),
    /// Two textures by a mode of the fixed-function pipeline.
    Combine(CombineTable),
    /// Textures one over the other, with masks.
    Layers(LayersTable),
    /// Two textures, mixed by a mask.
    Mix(MixTable),
    /// A calculation with two textures, channel by channel.
    Math(MathTable),
    /// Numbers brought from one range into another.
    Remap(RemapTable),
    /// Channels in another order.
    Swizzle(SwizzleTable),
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

table! {
    /// An image. Either `image` or `model_image` is needed.
    pub struct ImageTable {
        /// The file: PNG, JPEG, TIFF, WebP, HDR, OpenEXR, KTX2 or DDS.
        pub image: Option<FileName> = None,
        /// An image of the model instead: its number, from 0.
        pub model_image: Option<u32> = None,
        /// What the numbers mean; floating-point images are always linear.
        pub color_space: ColorSpaceName = ColorSpaceName::Srgb,
        /// What alpha means when texels are averaged.
        pub alpha: AlphaName = AlphaName::Coverage,
        /// Where it is looked up.
        pub coordinates: CoordinatesTable = CoordinatesTable::default(),
        /// Map of the coordinates before the look-up.
        pub matrix: MatrixTable = MatrixTable::default(),
        /// What lies outside the image, along u and v.
        pub wrap: WrapTable = WrapTable::Both(WrapName::Repeat),
        /// Colour outside the image for `wrap = "border"`.
        pub border: Color = Color::Linear([0.0; 4]),
        /// How it is filtered; as `picture.filter` says where it is left out.
        pub filter: Option<FilterName> = None,
        /// Longest ratio of the footprint's axes that anisotropic filters honour.
        #[schemars(range(min = 1, max = 64))]
        pub max_anisotropy: f64 = 16.0,
        /// Whether texels are squares when they are larger than pixels.
        pub square_texels: bool = false,
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
        pub format: RawFormatName = RawFormatName::U8,
        /// What the numbers of images mean.
        pub color_space: ColorSpaceName = ColorSpaceName::Srgb,
        /// Where the volume lies: its middle is the centre, its height 2 units, so that it surrounds the model.
        pub place: PlaceTable = PlaceTable::default(),
        /// Extents in units of the place; from the numbers of its voxels, the longest side being 2, where it is left out.
        pub extent: Option<[PositiveLength; 3]> = None,
        /// What lies outside.
        pub wrap: WrapName = WrapName::Clamp,
    }

    /// Images that follow each other.
    #[schemars(extend("required" = ["images"]))]
    pub struct FrameImagesTable {
        /// The images, of any sizes.
        #[schemars(length(min = 1, max = 100_000))]
        pub images: Vec<FileName> = Vec::new(),
        /// Images per second.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub rate: f64 = 25.0,
        /// What follows the last image.
        pub after: AfterName = AfterName::Repeat,
        /// Whether images fade into each other.
        pub blend: bool = true,
        /// What the numbers mean.
        pub color_space: ColorSpaceName = ColorSpaceName::Srgb,
        /// Where they are looked up.
        pub coordinates: CoordinatesTable = CoordinatesTable::default(),
        /// Map of the coordinates before the look-up.
        pub matrix: MatrixTable = MatrixTable::default(),
        /// What lies outside the images, along u and v.
        pub wrap: WrapTable = WrapTable::Both(WrapName::Repeat),
        /// How they are filtered; as `picture.filter` says where it is left out.
        pub filter: Option<FilterName> = None,
    }

    /// An environment as a texture. Either `image` or `faces` is needed.
    pub struct CubeTable {
        /// Latitude-longitude, an unfolded cube, a strip of faces: recognised by its proportions.
        pub image: Option<FileName> = None,
        /// Six images: right, left, up, down, front, back.
        pub faces: Option<[FileName; 6]> = None,
        /// Which direction it is looked up by.
        pub direction: DirectionName = DirectionName::Reflection,
        /// Point from which directions count for `direction = "position"`, in world units, object space.
        pub center: [f64; 3] = [0.0; 3],
        /// Turned about the vertical axis, in degrees.
        pub rotation: f64 = 0.0,
        /// Shape of near surroundings, taken at `center`: reflections take the place of the surface into account.
        pub room: Option<RoomTable> = None,
    }

    /// The shape of near surroundings: an axis-aligned box, or a ball where `radius` is there. World units, object space.
    pub struct RoomTable {
        /// Smallest coordinates of the box.
        pub min: Option<[f64; 3]> = None,
        /// Largest coordinates of the box.
        pub max: Option<[f64; 3]> = None,
        /// Centre of the ball.
        pub center: [f64; 3] = [0.0; 3],
        /// Radius of the ball.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub radius: Option<f64> = None,
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
        /// The texture; it is asked for its value in space, so it must not need texture coordinates, a normal or an eye.
        pub texture: Input = Input::Number(0.0),
        /// Values along the longest side of the model's bounding box.
        #[schemars(range(min = 2, max = 2048))]
        pub size: u32 = 128,
        /// Whether values are interpolated.
        pub smooth: bool = true,
    }

    /// A colour scale.
    #[schemars(extend("required" = ["input", "stops"]))]
    pub struct RampTable {
        /// The number.
        pub input: Input = Input::Number(0.0),
        /// Colours in ascending order of the number; two at one place make a jump.
        #[schemars(length(min = 1, max = 1024))]
        pub stops: Vec<StopTable> = Vec::new(),
        /// How colours change between the stops.
        pub interpolation: RampName = RampName::Linear,
    }

    /// Contour lines.
    #[schemars(extend("required" = ["input", "spacing"]))]
    pub struct ContoursTable {
        /// The number.
        pub input: Input = Input::Number(0.0),
        /// Step between two lines.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub spacing: f64 = 1.0,
        /// The number of one of the lines.
        pub offset: f64 = 0.0,
        /// Width of the lines in pixels.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub pixels: f64 = 1.5,
        /// Width of the lines in units of the number instead.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub width: Option<f64> = None,
        /// Colour of the lines.
        pub color: Input = Input::Color(Color::BLACK),
        /// What is between them.
        pub over: Input = Input::Color(Color::WHITE),
    }

    /// Polygons.
    #[schemars(extend("required" = ["polygons"]))]
    pub struct PolygonsTable {
        /// The polygons; later ones cover earlier ones of the same priority.
        #[schemars(length(min = 1, max = 100_000))]
        pub polygons: Vec<PolygonTable> = Vec::new(),
        /// What is seen between them.
        pub base: Input = Input::Color(Color::Linear([0.0; 4])),
        /// Whether they come again in every unit square of the coordinates.
        pub repeat: bool = false,
        /// Where they lie.
        pub coordinates: CoordinatesTable = CoordinatesTable::default(),
        /// Map of the coordinates before that.
        pub matrix: MatrixTable = MatrixTable::default(),
    }

    /// A polygon.
    #[schemars(extend("required" = ["outlines"]))]
    pub struct PolygonTable {
        /// Closed outlines, each a list of corners `[u, v]`: the polygon is what lies inside an odd number of them, so that
        /// holes are outlines, too. They must not cross.
        #[schemars(length(min = 1, max = 10_000))]
        pub outlines: Vec<Vec<[f64; 2]>> = Vec::new(),
        /// Its colour.
        pub color: Input = Input::Color(Color::WHITE),
        /// Polygons of higher priority cover those of lower.
        pub priority: i32 = 0,
    }

    /// Texture `T` and what it meets, `F`.
    #[schemars(extend("required" = ["mode", "texture"]))]
    pub struct CombineTable {
        /// The mode.
        pub mode: CombineName = CombineName::Modulate,
        /// `T`.
        pub texture: Input = Input::Color(Color::WHITE),
        /// `F`.
        pub fragment: Input = Input::Color(Color::WHITE),
        /// `C`, for `blend`.
        pub constant: Color = Color::WHITE,
    }

    /// Layers.
    #[schemars(extend("required" = ["base", "layers"]))]
    pub struct LayersTable {
        /// What is below all of them.
        pub base: Input = Input::Color(Color::WHITE),
        /// From the lowest to the highest.
        #[schemars(length(min = 1, max = 256))]
        pub layers: Vec<LayerTable> = Vec::new(),
    }

    /// A layer.
    #[schemars(extend("required" = ["texture"]))]
    pub struct LayerTable {
        /// Its colour.
        pub texture: Input = Input::Color(Color::WHITE),
        /// What it does to what is below.
        pub mode: LayerName = LayerName::Over,
        /// `C`, for `blend`.
        pub constant: Color = Color::WHITE,
        /// Where it is: 0 to 1.
        pub mask: Input = Input::Number(1.0),
        /// How much of it is seen: 0 to 1.
        pub opacity: Input = Input::Number(1.0),
    }

    /// `a` where the mask is 0, `b` where it is 1.
    #[schemars(extend("required" = ["a", "b", "mask"]))]
    pub struct MixTable {
        /// Where the mask is 0.
        pub a: Input = Input::Number(0.0),
        /// Where the mask is 1.
        pub b: Input = Input::Number(1.0),
        /// 0 to 1.
        pub mask: Input = Input::Number(0.5),
    }

    /// `a` and `b`, calculated.
    #[schemars(extend("required" = ["operation", "a", "b"]))]
    pub struct MathTable {
        /// What is calculated.
        pub operation: OperationName = OperationName::Add,
        /// The first.
        pub a: Input = Input::Number(0.0),
        /// The second.
        pub b: Input = Input::Number(0.0),
    }

    /// A number from one range into another.
    #[schemars(extend("required" = ["input"]))]
    pub struct RemapTable {
        /// The number, or each channel of a colour.
        pub input: Input = Input::Number(0.0),
        /// The range that it comes from.
        pub from: [f64; 2] = [0.0, 1.0],
        /// The range that it goes to.
        pub to: [f64; 2] = [0.0, 1.0],
        /// Whether it is kept within that range.
        pub clamp: bool = false,
    }

    /// Channels in another order.
    #[schemars(extend("required" = ["input", "channels"]))]
    pub struct SwizzleTable {
        /// The texture.
        pub input: Input = Input::Number(0.0),
        /// What becomes red, green, blue and alpha.
        pub channels: [ChannelName; 4] = [ChannelName::R, ChannelName::G, ChannelName::B, ChannelName::A],
    }

    /// A texture elsewhere.
    #[schemars(extend("required" = ["texture"]))]
    pub struct PlacedTable {
        /// The texture; its own place is within this one.
        pub texture: Input = Input::Number(0.0),
        /// Where it lies, in world units.
        pub place: PlaceTable = PlaceTable { unit: super::PlaceUnit::World, ..PlaceTable::default() },
    }

    /// A height.
    pub struct HeightTable {
        /// In which direction it grows, object space.
        pub direction: [f64; 3] = [0.0, 1.0, 0.0],
        /// Where it is 0; without it, heights run from 0 to 1 over the model.
        pub origin: Option<[f64; 3]> = None,
        /// World units of 1; only with `origin`.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub unit: f64 = 1.0,
    }

    /// A distance in world units.
    pub struct DistanceTable {
        /// The point, object space.
        pub center: [f64; 3] = [0.0; 3],
    }

    /// A slope.
    pub struct SlopeTable {
        /// Upwards, object space.
        pub up: [f64; 3] = [0.0, 1.0, 0.0],
    }

    /// Texture coordinates.
    pub struct UvFieldTable {
        /// Which set, from 0.
        #[schemars(range(max = 31))]
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
    Both(WrapName),
    /// Along u and along v.
    Each([WrapName; 2]),
}

impl WrapTable {
    /// Along u and v.
    pub fn each(self) -> [WrapName; 2] {
        match self {
            Self::Both(wrap) => [wrap; 2],
            Self::Each(wraps) => wraps,
        }
    }
}

choice! {
    /// What the numbers of an image mean.
    pub enum ColorSpaceName {
        /// Colours in sRGB.
        Srgb,
        /// Light, or anything that is no colour.
        Linear,
    }

    /// What alpha means when texels are averaged.
    pub enum AlphaName {
        /// The share of the texel that is covered: colours are weighted by it.
        Coverage,
        /// A fourth number.
        Independent,
    }

    /// What lies outside an image.
    pub enum WrapName {
        /// The image again.
        Repeat,
        /// The edge texel.
        Clamp,
        /// The image mirrored.
        Mirror,
        /// The border's colour.
        Border,
    }

    /// Numbers of a raw file.
    pub enum RawFormatName {
        /// Bytes, 0 to 255 for 0 to 1.
        U8,
        /// 16 bits, little-endian, 0 to 65535 for 0 to 1.
        U16,
        /// 32-bit floats, little-endian.
        F32,
    }

    /// What follows the last of some images.
    pub enum AfterName {
        /// The first again.
        Repeat,
        /// The last for ever.
        Hold,
        /// The same backwards.
        Mirror,
    }

    /// A direction that every surface point has.
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

    /// A mode of the fixed-function pipeline.
    pub enum CombineName {
        /// `T`.
        Replace,
        /// `T F`.
        Modulate,
        /// `a_T T + (1 - a_T) F`.
        Decal,
        /// `F (1 - T) + C T`.
        Blend,
    }

    /// What a layer does to what is below.
    pub enum LayerName {
        /// Lies over it, by its alpha.
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

    /// A calculation.
    pub enum OperationName {
        /// a + b.
        Add,
        /// a - b.
        Subtract,
        /// a b.
        Multiply,
        /// The smaller one.
        Minimum,
        /// The larger one.
        Maximum,
    }

    /// A channel, or a number.
    pub enum ChannelName {
        /// Red.
        R,
        /// Green.
        G,
        /// Blue.
        B,
        /// Alpha.
        A,
        /// Brightness.
        Luminance,
        /// 0.
        Zero,
        /// 1.
        One,
    }
}

// Procedural textures: noise, waves and solids.

table! {
    /// Noise: a number, as grey.
    pub struct NoiseTable {
        /// The kind of noise.
        pub family: NoiseName = NoiseName::Perlin,
        /// How distances of cellular noise are measured.
        pub metric: MetricName = MetricName::Euclidean,
        /// How octaves are summed.
        pub fractal: FractalName = FractalName::Fbm,
        /// Number of octaves.
        #[schemars(range(min = 1, max = 24))]
        pub octaves: u32 = 5,
        /// Ratio of the frequencies of two octaves.
        #[schemars(range(min = 1.01, max = 16))]
        pub lacunarity: f64 = 2.03,
        /// Ratio of the amplitudes of two octaves.
        #[schemars(range(min = 0, max = 1))]
        pub gain: f64 = 0.5,
        /// Width of a cell of the first octave, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub cell: f64 = 0.25,
        /// How far the point is moved by another noise first, in cells.
        #[schemars(range(min = 0, max = 100))]
        pub warp: f64 = 0.0,
        /// Factor of the noise.
        pub amplitude: f64 = 0.5,
        /// Added after that.
        pub offset: f64 = 0.5,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// How far a fourth coordinate of the noise grows each second, in cells: noise that boils.
        pub evolve: f64 = 0.0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Sine waves: a number, as grey.
    #[schemars(extend("required" = ["waves"]))]
    pub struct SinesTable {
        /// The waves.
        #[schemars(length(min = 1, max = 1024))]
        pub waves: Vec<WaveTable> = Vec::new(),
        /// Added to their sum.
        pub offset: f64 = 0.5,
        /// Where they lie.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// A sine wave.
    pub struct WaveTable {
        /// Along which it changes, of any length but zero.
        pub direction: [f64; 3] = [1.0, 0.0, 0.0],
        /// Its length, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub length: f64 = 0.5,
        /// Its amplitude.
        pub amplitude: f64 = 0.5,
        /// Its phase at the origin, in degrees.
        pub phase: f64 = 0.0,
        /// Waves that pass each second.
        pub speed: f64 = 0.0,
    }

    /// Wood. The trunk stands along y.
    pub struct WoodTable {
        /// Width of a ring.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub ring: f64 = 0.085,
        /// How far outer rings lie off centre, per radius.
        #[schemars(range(min = 0, max = 1))]
        pub eccentricity: f64 = 0.25,
        /// Amplitude of lobes that wind round the trunk.
        #[schemars(range(min = 0))]
        pub twist: f64 = 0.012,
        /// Angle between the trunk and the y axis, in degrees.
        pub tilt: f64 = 7.0,
        /// Amplitude of the rings' irregular waves.
        #[schemars(range(min = 0))]
        pub wobble: f64 = 0.09,
        /// Strength of fibres and pores.
        #[schemars(range(min = 0))]
        pub grain: f64 = 1.0,
        /// Colour of the wood grown in spring.
        pub early: Color = Color::rgb([0.56, 0.31, 0.13]),
        /// Colour of the wood grown in late summer.
        pub late: Color = Color::rgb([0.20, 0.075, 0.022]),
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Marble.
    pub struct MarbleTable {
        /// Veins per unit of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub frequency: f64 = 1.1,
        /// How far turbulence displaces the layers, in veins.
        pub warp: f64 = 1.6,
        /// Colour of the stone.
        pub stone: Color = Color::rgb([0.82, 0.80, 0.76]),
        /// Colour of the clouds in it.
        pub cloud: Color = Color::rgb([0.52, 0.54, 0.56]),
        /// Colour of the veins.
        pub vein: Color = Color::rgb([0.07, 0.075, 0.085]),
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Clouds or smoke: colour and density, which is the alpha.
    pub struct CloudsTable {
        /// Width of the largest clouds, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub size: f64 = 0.7,
        /// Share of the sky that clouds cover.
        #[schemars(range(min = 0, max = 1))]
        pub cover: f64 = 0.5,
        /// How soft the borders are.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub softness: f64 = 0.6,
        /// Cells of change per second: clouds form and dissolve.
        pub speed: f64 = 0.2,
        /// Colour between the clouds.
        pub sky: Color = Color::rgb([0.10, 0.28, 0.62]),
        /// Colour of the clouds.
        pub cloud: Color = Color::rgb([0.92, 0.93, 0.95]),
        /// Alpha between the clouds.
        #[schemars(range(min = 0, max = 1))]
        pub sky_alpha: f64 = 1.0,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where they lie.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Granite.
    pub struct GraniteTable {
        /// Width of a grain, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub grain: f64 = 0.055,
        /// Colour of the feldspar.
        pub feldspar: Color = Color::rgb([0.55, 0.40, 0.33]),
        /// Colour of the quartz.
        pub quartz: Color = Color::rgb([0.50, 0.50, 0.49]),
        /// Colour of the mica.
        pub mica: Color = Color::rgb([0.035, 0.033, 0.032]),
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Rock.
    pub struct RockTable {
        /// Strata per unit of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub frequency: f64 = 7.0,
        /// How far folds lift the strata, in units of the place.
        #[schemars(range(min = 0))]
        pub folding: f64 = 0.12,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Cubes of two colours in turn.
    pub struct CheckerTable {
        /// Edge of a cube, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub cell: f64 = 0.125,
        /// Colour of the cube that begins at the origin.
        pub even: Color = Color::rgb([0.8; 3]),
        /// Colour of its neighbours.
        pub odd: Color = Color::rgb([0.06; 3]),
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Bricks.
    pub struct BrickTable {
        /// Length, height and depth of a brick with its mortar, in units of the place.
        pub size: [PositiveLength; 3] = [PositiveLength(0.3), PositiveLength(0.1), PositiveLength(0.15)],
        /// Width of the mortar, in units of the place.
        #[schemars(range(min = 0))]
        pub mortar_width: f64 = 0.012,
        /// How far each row is shifted against the one below, in bricks.
        pub shift: f64 = 0.5,
        /// Colour of the bricks.
        pub brick: Color = Color::rgb([0.34, 0.085, 0.045]),
        /// Colour of the mortar.
        pub mortar: Color = Color::rgb([0.46, 0.43, 0.38]),
        /// How much bricks differ in brightness.
        #[schemars(range(min = 0, max = 1))]
        pub variation: f64 = 0.6,
        /// Whether the texture is the height of the wall's face, 1 on bricks and 0 in the mortar, instead of its colour.
        pub relief: bool = false,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where they lie.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Sand, grass, rock and snow.
    pub struct LandscapeTable {
        /// Height up to which there is sand: 0 is the lowest point, 1 the highest.
        pub sand_line: f64 = 0.14,
        /// Height from which snow stays on flat ground: 0 is the lowest point, 1 the highest.
        pub snow_line: f64 = 0.74,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }
}

choice! {
    /// A kind of noise.
    pub enum NoiseName {
        /// Perlin's gradient noise.
        Perlin,
        /// Simplex noise.
        Simplex,
        /// Distance to the nearest of scattered points.
        Cellular,
        /// How much farther the second nearest point is: 0 along the borders of cells.
        CellularBorders,
        /// A random number for every cell around a scattered point.
        CellularIds,
        /// A random number for every cubic cell.
        White,
    }

    /// How distances of cellular noise are measured.
    pub enum MetricName {
        /// The shortest way.
        Euclidean,
        /// Along the axes.
        Manhattan,
        /// The longest of the ways along the axes.
        Chebyshev,
    }

    /// How octaves are summed.
    pub enum FractalName {
        /// One octave only.
        None,
        /// The sum.
        Fbm,
        /// The sum of absolute values.
        Turbulence,
        /// The sum of crests.
        Ridged,
    }
}
