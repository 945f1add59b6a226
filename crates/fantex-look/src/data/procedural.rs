//! Procedural textures: noise, waves and solids.

use super::{Color, PlaceTable};

table! {
    /// Noise: a number, as grey.
    pub struct NoiseTable {
        /// The kind of noise.
        pub family: NoiseName = NoiseName::Perlin,
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
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Clouds or smoke.
    pub struct CloudsTable {
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where they lie.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Granite.
    pub struct GraniteTable {
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Rock.
    pub struct RockTable {
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// A chequerboard of cubes.
    pub struct CheckerTable {
        /// One colour.
        pub a: Color = Color::WHITE,
        /// The other.
        pub b: Color = Color::rgb([0.05, 0.05, 0.05]),
        /// Edge of a cube.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub cell: f64 = 0.25,
        /// Where it lies.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Bricks.
    pub struct BrickTable {
        /// The pattern of their colours; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Where they lie.
        pub place: PlaceTable = PlaceTable::default(),
    }

    /// Grass, rock and snow.
    pub struct LandscapeTable {
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
        /// A random number per cell.
        White,
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
