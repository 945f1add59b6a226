//! The CPU renderer: the reference that other renderers are compared with.
//!
//! ```text
//!  Mesh + Surface + Camera + Lights --render--> Picture (linear RGBA) --glow, tone map--> Image --> PNG, EXR
//!   |        |                 |
//!   |        |                 '-- Light: directional, point, spot, projector; each with its shadow maps
//!   |        +-- FanSurface    an asset: fan tiles through the texture function
//!   |        +-- LookSurface   a look for each material, or the model's own materials
//!   |        '-- FlatSurface   a colour per triangle and point, for pictures that explain
//!   '-- Scene                  several meshes with their surfaces, as one of each
//! ```
//!
//! Visibility is decided in fixed point with one (nearness, triangle) pair per sample; then each pixel's visible
//! triangles are shaded once each, with barycentric coordinates and their analytic screen-space derivatives. Shadow maps
//! go through the same rasteriser. Lighting happens in mesh space: it differs from the world by a uniform scale and an
//! offset, so directions are the same. Pictures do not depend on the number of threads.

mod fan_surface;
mod hit;
mod illumination;
mod image_surface;
mod look_surface;
mod primitive;
mod raster;
mod reflection;
mod render;
mod scene;
mod shading;
mod shadow;
mod surface;
mod vectors;

pub use fan_surface::FanSurface;
pub use fantex_scene::{
    AmbientLight, Background, Camera, Cookie, EnvironmentLight, Falloff, FilterOptions, Glow, Interpolation,
    Lens, Light, LightKind, Lights, Penumbra, Picture, Projector, Shading, ShadingRate, ShadowOptions,
    SpotLight, ToneMap, world_bounds,
};
pub use hit::Hit;
pub use look_surface::LookSurface;
pub use primitive::DRAWN_TRIANGLE_BYTES;
pub use raster::MAX_SAMPLES;
pub use reflection::{
    CaptureOptions, ObjectReflection, ReflectingSurface, capture_environment, capture_with, cube_cameras,
};
pub use render::{
    MAX_PICTURE_SIDE, RenderOptions, RenderStats, Rendering, StopSignal, render, render_with_glow,
};
pub use scene::{Scene, SceneObject};
pub use shading::{AnisotropySample, Finish};
pub use surface::{Coverage, FlatShading, FlatSurface, MaterialSample, Shaded, SmoothPoint, Surface};
