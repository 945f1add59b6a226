//! Procedural textures: noise, waves and solids.

use super::{Color, PlaceTable, PositiveLength};

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
