//! UV-free, seamless, streamed texturing.
//!
//! fantex covers a triangle mesh by parts of its own triangle fans, lays each part (or a few neighbours together) flat into
//! a tile of texels, and blends the tiles where they meet. No texture coordinates are needed, and the resulting *texture
//! function* is continuous on the whole surface, at every detail level and through lossy compression.
//!
//! This crate is the front door: it re-exports the crates that do the work. From a file to a colour on its surface:
//!
//! ```no_run
//! use std::path::Path;
//! use std::sync::Arc;
//!
//! use fantex::bake::{BakeOptions, NoProgress, UvSource, bake, sample_finest};
//! use fantex::cover::{CoverOptions, TexelBudget, build_cover};
//! use fantex::mesh::{CleanOptions, LoadOptions, clean, load};
//! use fantex::store::{Asset, PageCache};
//! use glam::Vec3;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Load: what the file says. Clean: welded, without duplicates, in mesh space; the report says what was done.
//! let model = load(Path::new("bottle.gltf"), &LoadOptions::default())?;
//! let (mesh, report) = clean(model, &CleanOptions::default())?;
//! report.lines().iter().for_each(|line| println!("{line}"));
//!
//! // Cover: fans, their projections, and the tiles' extents for a number of texels.
//! let options = CoverOptions { budget: TexelBudget::Total(4_000_000), ..CoverOptions::default() };
//! let (cover, stats) = build_cover(&mesh, &options)?;
//! println!("{} tiles, {:.2} look-ups per sample", stats.groups, stats.lookups_per_sample);
//!
//! // Bake: the model's own textures into one asset, written whole or not at all.
//! let source = UvSource::new(&mesh)?;
//! let asset_path = Path::new("bottle.fan");
//! bake(&mesh, &cover, &source, asset_path, &BakeOptions::default(), &NoProgress)?;
//!
//! // Open and sample: decoded tiles stay within a memory budget.
//! let asset = Arc::new(Asset::open(asset_path)?);
//! let cache = PageCache::new(asset, 64 << 20);
//! let (triangle, barycentric) = (0, Vec3::splat(1.0 / 3.0));
//! let (linear_rgba, lookups) = sample_finest(&cache, 0, triangle, barycentric);
//! println!("{linear_rgba} from {lookups} tiles");
//! # Ok(())
//! # }
//! ```
//!
//! | module | what |
//! |---|---|
//! | [`mesh`] | loading, cleaning, fans, generators |
//! | [`look`] | the look: its file, its tables, its schema |
//! | [`look_scene`] | looks as scenes of dressed models |
//! | [`texture`] | images, filters, mappings, solid recipes, comparison of pictures |
//! | [`cover`] | partial fans, groups, tile maps, the texture function |
//! | [`store`] | the `.fan` asset: writing, reading, caching, verifying |
//! | [`bake`] | sources to tiles |
//! | [`photos`] | photographs with cameras as a source |
//! | [`stream`] | asynchronous reading, demand and residency of tiles, files and URLs alike |
//! | [`scene`] | cameras, lights, surroundings, tone mapping: what renderers are given |
//! | [`paint`] | painting on assets |
//! | [`export`] | out again: models with ordinary texture coordinates, single pictures |
//! | [`render`] | the CPU renderer |
//! | [`gpu`] | the GPU renderer: models with UV textures, and assets through a small atlas |
//!
//! Implement [`bake::Source`] to bake anything that is a function of a surface point, [`render::Surface`] to render
//! anything that gives a material at one. All work runs on the current rayon pool, and its results do not depend on the
//! number of threads.

pub mod look_scene;

pub use {
    fantex_bake as bake, fantex_base as base, fantex_cover as cover, fantex_export as export,
    fantex_gpu as gpu, fantex_look as look, fantex_mesh as mesh, fantex_paint as paint,
    fantex_photos as photos, fantex_render as render, fantex_scene as scene, fantex_store as store,
    fantex_stream as stream, fantex_texture as texture,
};
