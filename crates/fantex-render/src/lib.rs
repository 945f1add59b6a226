//! The CPU renderer: the reference that other renderers are compared with.
//!
//! ```text
//!  Mesh + Surface + Camera + Lights --render--> Picture (linear RGBA) --> Image --> PNG, EXR
//!            |
//!            +-- MeshSurface   the model's own UV textures
//!            +-- FanSurface    an asset: fan tiles through the texture function
//!            '-- FlatSurface   a colour per triangle and point, for pictures that explain
//! ```
//!
//! Visibility is decided in fixed point with one (nearness, triangle) pair per sample; then each pixel's visible
//! triangles are shaded once each, with barycentric coordinates and their analytic screen-space derivatives. Lighting
//! happens in mesh space: it differs from the world by a uniform scale and an offset, so directions are the same.
//! Pictures do not depend on the number of threads.

mod camera;
mod capture;
mod clip;
mod environment_light;
mod fan_surface;
mod fixed;
mod flat_surface;
mod hit;
mod light;
mod mesh_surface;
mod normals;
mod options;
mod pattern;
mod picture;
mod primitive;
mod raster;
mod reflecting_surface;
mod render;
mod resolve;
mod shading;
mod sky_box;
mod split_sum;
mod surface;
mod tile_filter;
mod tiles;

pub use camera::{Bounds, Camera};
pub use capture::{CaptureOptions, capture_environment, capture_with, cube_cameras};
pub use environment_light::EnvironmentLight;
pub use fan_surface::FanSurface;
pub use flat_surface::{FlatShading, FlatSurface};
pub use hit::{Hit, Interpolation};
pub use light::{AmbientLight, DirectionalLight, Lights};
pub use mesh_surface::{FilterOptions, MeshSurface};
pub use options::{Background, MAX_PICTURE_SIDE, RenderError, RenderOptions, ShadingRate};
pub use pattern::MAX_SAMPLES;
pub use picture::Picture;
pub use reflecting_surface::{ObjectReflection, ReflectingSurface};
pub use render::{RenderStats, Rendering, render};
pub use shading::Shading;
pub use surface::{Coverage, MaterialSample, Surface};
pub use tiles::{TileSource, TileTexels};
