//! What every renderer is given besides a model: a camera, lights, what is seen behind, how light becomes a picture.
//!
//! ```text
//!  Camera --Projection--> pixels          Lights: AmbientLight (two colours or an EnvironmentLight), Light(s)
//!  Background, FilterOptions, ToneMap     split_sum, smith_visibility: the parts of shading that renderers share
//! ```
//!
//! Positions are in the world's units, double precision; a [`Projection`] is relative to one mesh.

mod background;
mod camera;
mod environment_light;
mod filter_options;
mod light;
mod shadow;
mod split_sum;
mod tone_map;

pub use background::Background;
pub use camera::{Bounds, Camera, Projection, view_axes};
pub use environment_light::{EnvironmentLight, MirrorView};
pub use filter_options::FilterOptions;
pub use light::{AmbientLight, Falloff, Lens, Light, LightKind, Lights, Projector, Slide, SpotLight};
pub use shadow::{Penumbra, ShadowOptions};
pub use split_sum::{smith_visibility, split_sum};
pub use tone_map::{ToneMap, luminance};
