//! The GPU renderer, on wgpu (Vulkan, Metal, DirectX 12): the CPU renderer's pictures, at frame rate.
//!
//! ```text
//!  Gpu          device, queue, what they can do
//!  Model        UvModel: a mesh with its own textures        FanModel: a mesh with the tiles of its cover
//!               StreamedWorld: many of the latter, which come and go with the view
//!  Renderer     per frame:
//!     FrameRecord, LampRecord, ...   camera and lights as shaders want them     (frame/)
//!     shadow maps                    only when lamps or model have changed
//!     surfaces, sky, layers, lines   half floats, linear light, 1 or 4 samples
//!     tone map                       into the target, in its encoding
//! ```
//!
//! Shaders are files that are joined (see [`shader`]): `frame.wgsl` states what every shader is given, `shading.wgsl` turns a
//! material sample into light, and each kind of model adds where its material samples come from.

//!
//! # What differs from the CPU renderer
//!
//! The formulas are the same, and so are pictures within the tolerances of `tests/gpu/pictures.rs`, but:
//!
//! * 1 or 4 samples per pixel; materials are evaluated once per pixel and triangle; interpolation is perspective-correct.
//! * Bicubic filtering is linear and elliptical weighted averages are anisotropic probes: both are the CPU renderer's alone.
//!   How probes are spread over ordinary textures is the device's affair; textures whose texels are to be seen as squares have none.
//! * Vertex colours above 1 count as 1.
//! * Blended triangles are sorted by their centres, not by what each sample sees.
//! * Environments have at most 1024 texels along a cube's face, and mirrors see them through one trilinear look-up.
//! * Cookies are squares of 1024 texels, filtered trilinearly. An orthographic projector's shadows begin at its cookie.
//! * Shadows fall on facets, where the CPU renderer lifts them to the smooth surface: on coarse meshes the border between
//!   light and shade can show them.
//! * Looks on models are the CPU renderer's alone: their textures are functions. Assets that were baked from them show the same, toon
//!   scales, stretched highlights and baked light included (`tests/gpu/fan.rs`), by the metallic-roughness model in both
//!   renderers. Models with their own textures have none of these three.

mod fan;
mod frame;
mod gpu;
mod model;
mod picture;
mod renderer;
pub mod shader;
mod streamed_world;
mod surface_pipeline;
mod timer;
mod uv;
mod wireframe;

pub use fan::{AtlasViewer, FanModel, FanModelSource, StreamedModel, max_anisotropy, stream_view};
pub use frame::{FrameLayout, View};
pub use gpu::{Gpu, GpuInfo, GpuOptions, device_lost};
pub use model::{DrawOptions, FrameContext, Model, ModelSpace, Overlay, WireframeOptions};
pub use picture::{FrameTimes, HiddenScreen, PictureRenderer, Readback, frame_times, render_to_picture};
pub use renderer::{Frame, Renderer};
pub use streamed_world::{StreamedWorld, WorldOptions, WorldStatistics};
pub use surface_pipeline::{Blending, CasterPipeline, SurfaceKey, SurfacePipeline};
pub use timer::DeviceTimer;
pub use uv::UvModel;
