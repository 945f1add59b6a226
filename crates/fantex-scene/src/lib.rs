//! What every renderer is given besides a model: a camera, lights, what is seen behind, how light becomes a picture.
//!
//! ```text
//!  Camera --Projection--> pixels          Lights: AmbientLight (two colours or an EnvironmentLight), Light(s)
//!  Background, FilterOptions, ToneMap     split_sum, smith_visibility: the parts of shading that renderers share
//!  LampView, lamp_views: what shadow maps look at          Picture, Glow: what comes out
//! ```
//!
//! Positions are in the world's units, double precision; a [`Projection`] is relative to one mesh.

mod background;
mod camera;
mod environment_light;
mod filter_options;
mod glow;
mod lamp_fit;
mod lamp_view;
mod light;
mod picture;
mod shading;
mod shadow;
mod split_sum;
mod tone_map;

pub use background::Background;
pub use camera::{Bounds, Camera, Projection, view_axes};
pub use environment_light::{EnvironmentLight, MirrorView};
pub use filter_options::FilterOptions;
pub use glow::Glow;
pub use lamp_fit::{FittedView, lamp_views, projector_view};
pub use lamp_view::{LampView, Projected, Spread};
pub use light::{AmbientLight, Falloff, Lens, Light, LightKind, Lights, Projector, Slide, SpotLight};
pub use picture::Picture;
pub use shading::Shading;
pub use shadow::{Penumbra, ShadowOptions};
pub use split_sum::{SPLIT_SUM_NODES, smith_visibility, split_sum, split_sum_nodes};
pub use tone_map::{ToneMap, luminance};
