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

mod blur;
mod form;
mod level;
mod lighting;
mod map;
mod sky;

pub use form::{ChartPoint, CubeFace, EnvironmentForm, EnvironmentLayout, mirrored, mirrored_steps};
pub use lighting::{IrradianceHarmonics, PREFILTERED_LEVELS, PrefilteredEnvironment};
pub use map::{CubeTexture, DirectionSource, EnvironmentMap, EnvironmentProxy, MAX_ENVIRONMENT_ANISOTROPY};
pub use sky::{MAX_TURBIDITY, Sky};
