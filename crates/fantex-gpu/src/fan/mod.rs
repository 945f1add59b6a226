//! Fan-textured models: geometry, atlas and texture function on the GPU.
//!
//! ```text
//!  Mesh, Cover  --geometry--> plain triangles, border triangles     vertex buffers
//!               --tables----> groups, means, frames                 storage buffers
//!               --page_words> page table                            texture
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
//! triangles loop over the groups that have weight and test at the loop's end. Materials read from a storage buffer instead
//! of a uniform one made a lit frame 2.35 instead of 1.3 times as long as with the ordinary texture.
//!
//! These tables are older than `page_words`: pages are fetched from a texture now, not read from a storage buffer, each word
//! names the coarser level that stands for a missing one, so that nothing is searched for, and the walk over levels starts from
//! the exponent of the pixel's width. On the landscape, unlit and trilinear, on a busy machine: 1.84 to 1.87 before, 1.64 to 1.82 then;
//! anisotropic 1.01 and 0.92, lit 1.22 and 1.20; the bunny 1.49 and 1.41. Of the first ratio (variants of the shader
//! that draw something else, so no more than hints; pages still in a storage buffer, all of it 1.66):
//!
//! | the landscape's frame, trilinear, unlit | ratio |
//! |---|---|
//! | plain triangles of one colour | 1.0 |
//! | border triangles of one colour | 1.25 |
//! | border triangles look up one group, whatever their weights | 1.47 |
//! | one look-up per tile instead of two | 1.41 |
//! | no levels chosen, no pages found | 1.17 |
//! | no pages found | 1.38 |
//! | 64x36 pixels instead of 1280x720: vertices alone | 1.2 |
//!
//! Without effect: rows of the atlas that are no power of two long, pages close together, one fetch instead of two, both words of a
//! look-up in one texel of 64 bits, means left out. Widths of coarser levels estimated from the direction of the longer axis, and
//! three levels without a loop, would save 0.04 to 0.09, but are wrong for long tiles.
//!
//! Since then, each beside the one before, one run after the other on a busy machine:
//!
//! | the landscape's frame, trilinear, unlit | ratio of processor time |
//! |---|---|
//! | as above | 1.70 to 1.78 |
//! | numbers converted as signed ones | 1.65 |
//! | and no loop around a single probe | 1.51 |
//! | and the walk over levels starts between two of them, from a bound of the width without a root (what is drawn now) | 1.40 to 1.46 |
//! | the same without a walk, wrong for long tiles | 1.41 |
//!
//! Before and after in one go: landscape 1.70 and 1.40, anisotropic 0.92 and 0.85, lit 1.20 and 1.11, both 0.93 and 0.94; bunny
//! 1.46 and 1.26, 1.22 and 1.17, 1.29 and 1.25, 1.19 and 1.15.
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
