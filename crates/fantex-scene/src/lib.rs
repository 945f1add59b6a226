//! What every renderer is given besides a model: a camera, lights, what is seen behind, how light becomes a picture.
//!
//! ```text
//!  Camera --Projection--> pixels          Lights: AmbientLight (two colours or an EnvironmentLight), Light(s)
//!  Background, FilterOptions, ToneMap     split_sum, smith_visibility: the parts of shading that renderers share
//!  CameraRig: a camera that is moved by hand
//!  LampView, lamp_views: what shadow maps look at          Picture, Glow: what comes out
//! ```
//!
//! Positions are in the world's units, double precision; a [`Projection`] is relative to one mesh.

mod camera;
mod lamp_view;
mod light;
mod picture;
mod rig;
mod shading;

pub use camera::{Camera, Framed, Projection, maxima_of, world_bounds};
pub use fantex_texture::FilterOptions;
pub use lamp_view::{FittedView, LampView, Projected, Spread, lamp_views, projector_view};
pub use light::{
    AmbientLight, ConeFalloff, Cookie, EnvironmentLight, Falloff, Lens, Light, LightKind, Lights, MirrorView,
    Penumbra, Projector, ShadowOptions, SpotLight,
};
pub use picture::{Background, Glow, Picture, ToneMap, luminance};
pub use rig::{CameraRig, SceneScale};
pub use shading::{
    Interpolation, LightQuantity, SPLIT_SUM_NODES, Shading, ShadingRate, smith_visibility, split_sum,
    split_sum_nodes,
};
