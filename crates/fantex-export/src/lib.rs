//! Out again: assets, or sources on a mesh, as models with ordinary texture coordinates, for programs that know no fans, and as single
//! pictures.
//!
//! ```text
//!  Mesh --charts--> Layout <--model's UVs  Asset or Source --Surface--> rows --> PNG, KTX2, OpenEXR
//!                     |                                         ^
//!                     `-- Region: which point under which texel -'
//!                     `-- Geometry: split vertices, tangents -----> .glb, .gltf
//! ```
//!
//! Texels hold the texture function at their point of the surface, in linear light; where the picture is coarser than the
//! tiles, its mean over the texel. Padding is described in `layout.rs`.

mod asset_surface;
mod atlas;
mod charts;
mod export;
mod extents;
mod fan_files;
mod fan_shaders;
mod fans;
mod fullest;
mod layout;
mod layout_progress;
mod mask;
mod materialx;
mod model_file;
mod model_uv;
mod objects;
mod overlaps;
mod packing;
mod pictures;
mod planes;
mod plans;
mod slots;
mod source_surface;
mod surface;
mod texels;
mod unions;
mod unwrap;
mod usd;
mod vertex_copies;

pub use atlas::*;
pub use export::*;
pub use fan_files::*;
pub use fan_shaders::*;
pub use fans::*;
pub use objects::*;
pub use pictures::Depth;
pub use unwrap::*;
