//! What surrounds the scene.

use super::{Color, FileName, ObjectName};

table! {
    /// The surroundings: one of `image`, `faces`, `sky`, `capture` or `color` says what they are.
    pub struct EnvironmentTable {
        /// A picture of the surroundings, usually HDR: latitude-longitude, an unfolded cube, a strip of faces or a mirror ball.
        pub image: Option<FileName> = None,
        /// Six pictures: right, left, up, down, front, back.
        pub faces: Option<[FileName; 6]> = None,
        /// A clear sky, computed.
        pub sky: Option<SkyTable> = None,
        /// What is seen from an object, rendered in six passes.
        pub capture: Option<CaptureTable> = None,
        /// The same colour on all sides.
        pub color: Option<Color> = None,
        /// How `image` is laid out; recognised by its proportions where it is left out.
        pub layout: Option<EnvironmentLayoutName> = None,
        /// Factor of its light.
        #[schemars(range(min = 0))]
        pub strength: f64 = 1.0,
        /// Turned about the vertical axis, in degrees.
        pub rotation: f64 = 0.0,
        /// Whether it is the background of the picture.
        pub visible: bool = true,
        /// The form into which it is converted; it keeps its own where this is left out.
        pub form: Option<EnvironmentFormName> = None,
        /// Texels along a face of the cube, a disc or the height of the sphere after conversion, and of a sky.
        #[schemars(range(min = 4, max = 8192))]
        pub size: u32 = 512,
    }

    /// A clear sky over a plain.
    pub struct SkyTable {
        /// To the sun, of any length but zero, world axes.
        pub to_sun: [f64; 3] = [-0.5, 0.72, 0.7],
        /// Haze, from 2 (after rain) to 10.
        #[schemars(range(min = 2, max = 10))]
        pub turbidity: f64 = 3.0,
        /// Colour of the ground.
        pub ground: Color = Color::rgb([0.18, 0.17, 0.12]),
        /// Whether the sun's disc is drawn.
        pub sun: bool = false,
    }

    /// The scene as an object sees it.
    pub struct CaptureTable {
        /// The object that is left out, and from whose middle the scene is rendered; the first one where it is left out.
        pub object: Option<ObjectName> = None,
        /// From where instead, world units.
        pub position: Option<[f64; 3]> = None,
        /// What is behind the scene.
        pub sky: Option<SkyTable> = None,
        /// Texels along a face.
        #[schemars(range(min = 4, max = 4096))]
        pub size: u32 = 256,
        /// Samples per texel.
        #[schemars(range(min = 1, max = 64))]
        pub samples: u32 = 4,
    }
}

choice! {
    /// How an environment is kept.
    pub enum EnvironmentFormName {
        /// Latitude and longitude.
        Sphere,
        /// Six faces.
        Cube,
        /// Two paraboloids.
        Paraboloid,
    }

    /// How a picture shows an environment.
    pub enum EnvironmentLayoutName {
        /// Latitude and longitude, twice as wide as high.
        Panorama,
        /// An unfolded cube, lying: 4 by 3 faces.
        HorizontalCross,
        /// An unfolded cube, standing: 3 by 4 faces.
        VerticalCross,
        /// Six faces side by side.
        HorizontalStrip,
        /// Six faces one below the other.
        VerticalStrip,
        /// Two paraboloids side by side.
        Paraboloids,
        /// A mirror ball, photographed from afar.
        MirrorBall,
    }
}
