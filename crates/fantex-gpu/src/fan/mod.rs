//! Fan-textured models: geometry, atlas and texture function on the GPU.
//!
//! ```text
//!  Mesh, Cover  --geometry--> plain triangles, border triangles     vertex buffers
//!               --tables----> groups, page table, means, frames     storage buffers
//!  FrameChanges --upload----> pages in the atlas, entries in the page table
//!  fan_lookup.wgsl    a tile: levels, probes, where they lie in the atlas
//!  fan.wgsl           a fragment: the groups that have weight, blended; from there on as any surface
//! ```

mod atlas;
mod atlas_view;
mod bindings;
mod fan_colors;
mod geometry;
mod grid;
mod load;
mod materials;
mod model;
mod pipelines;
mod tables;
mod upload;

pub use atlas_view::AtlasViewer;
pub use load::{StreamedModel, StreamedModelError, max_anisotropy, stream_view};
pub use model::{FanModel, FanModelSource};
