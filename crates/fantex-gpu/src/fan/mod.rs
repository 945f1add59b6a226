//! Fan-textured models: geometry, atlas and texture function on the GPU.
//!
//! ```text
//!  Mesh, Cover  --geometry--> plain triangles, border triangles     vertex buffers
//!               --tables----> groups, page table, means, frames     storage buffers
//!  FrameChanges --upload----> pages in the atlas, entries in the page table
//!  fan_lookup.wgsl    a tile: levels, probes, where they lie in the atlas
//!  fan.wgsl           a fragment: the groups that have weight, blended; from there on as any surface
//! ```
//!
//! # The atlas: one texture, levels chosen by the shader
//!
//! A tile's levels lie anywhere in one texture without mip levels, and the shader blends two of them. The other design, arrays
//! by size class with real mip chains, was not built: it fragments a small pool into classes and keeps whole chains. What
//! the choice costs, beside the same model with an ordinary mipmapped texture (`examples/fan_speed.rs`, software Vulkan, 2
//! shared cores, 1280x720, 4 M texels; processor time, ratio in one run; a bunny of 69 k triangles, then a landscape of 100 k):
//!
//! | | trilinear | anisotropic, 8 |
//! |---|---|---|
//! | base colour alone, unlit | 1.49, 1.91 | 1.27, 0.95 |
//! | lit (metallic-roughness) | 1.36, 1.32 | 1.26, not measured |
//!
//! A software adapter executes both sides of every branch, the body of a loop once more than needed if the test comes first,
//! and reads storage buffers lane by lane. So, in milliseconds of processor time per frame of the unlit bunny, untextured 40,
//! ordinary trilinear texture 54 to 57:
//!
//! | plain triangles drawn as fans | ms |
//! |---|---|
//! | choice of levels alone | 58 |
//! | and both entries of the page table | 65 |
//! | and one look-up; and the other | 78; 86 |
//! | the same with both look-ups in a loop | 87 to 92 |
//! | what is drawn now (also climbs to coarser levels, and to the mean) | 95 to 104 |
//! | one loop over levels, probes and pages for all tiles | 139 to 194 |
//!
//! Therefore tiles of one page per level have a straight path, and larger tiles (`FAN_PAGED`) a pipeline of their own. Border
//! triangles loop over the groups that have weight and test at the loop's end. Entries passed on from the vertex stage
//! would save at most the 7 ms of the table. Materials read from a storage buffer instead of a uniform one made a lit frame
//! 2.35 instead of 1.3 times as long as with the ordinary texture.
//!
//! # Uploads
//!
//! 3589 pages (22.6 MB) through mapped staging buffers take 145 ms the first time, while these are made, then 38 ms;
//! `Queue::write_texture` 84, then 33 ms. The difference is within the noise of these runs; `write_texture` makes a staging
//! buffer in every call, the ring none, and so the ring it is.

mod atlas;
mod atlas_view;
mod bindings;
mod fan_colors;
mod geometry;
mod grid;
mod load;
mod materials;
mod model;
mod page_words;
mod pipelines;
mod tables;
mod upload;

pub use atlas_view::AtlasViewer;
pub use load::{StreamedModel, StreamedModelError, max_anisotropy, stream_view};
pub use model::{FanModel, FanModelSource};
