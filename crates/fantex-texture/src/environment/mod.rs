//! Environment maps: light from every direction, as seen from one point.
//!
//! ```text
//!  picture --Layout--> EnvironmentMap --converted--> EnvironmentMap of another form
//!  Sky, six rendered faces --^  |
//!                               +-- sample          mirror reflections, sky boxes (direction with footprint)
//!                               +-- CubeTexture     the same as a texture of a material
//!                               '-- PrefilteredEnvironment   rough reflections and diffuse light
//! ```
//!
//! A map is stored in one of four [forms](EnvironmentForm): each is a way of flattening the sphere of directions into one
//! or more rectangular *charts*. Everything else (filtering, levels, conversion) is written once for all forms.
//!
//! Directions are the world's: `y` up, right-handed. What is drawn in the middle of a panorama, or on the front face of a
//! cube, lies in the direction `-z`, with `+x` to its right; so a camera that looks along `-z` sees every picture as it is
//! in its file, not mirrored.

mod convert;
mod cube_face;
mod cube_texture;
mod form;
mod harmonics;
mod layout;
mod level;
mod load;
mod map;
mod mirror;
mod prefilter;
mod proxy;
mod reduce;
mod sky;

pub use cube_face::CubeFace;
pub use cube_texture::{CubeTexture, DirectionSource};
pub use form::{ChartPoint, EnvironmentForm};
pub use harmonics::IrradianceHarmonics;
pub use layout::EnvironmentLayout;
pub use load::LoadEnvironmentError;
pub use map::{EnvironmentMap, MAX_ENVIRONMENT_ANISOTROPY};
pub use mirror::{mirrored, mirrored_steps};
pub use prefilter::{PREFILTERED_LEVELS, PrefilteredEnvironment};
pub use proxy::EnvironmentProxy;
pub use sky::{MAX_TURBIDITY, Sky, SkyError};
