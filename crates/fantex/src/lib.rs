//! UV-free, seamless, streamed texturing.
//!
//! fantex covers a triangle mesh by parts of its own triangle fans, lays each part (or a few neighbours together) flat into
//! a tile of texels, and blends the tiles where they meet. No texture coordinates are needed, and the resulting *texture
//! function* is continuous on the whole surface, at every detail level and through lossy compression.
//!
//! From a file to a filtered colour on its surface:
//!
//! ```
//! use fantex::{Asset, Baker, ChannelKind, Footprint, Mesh, Source};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let assets = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/WaterBottle");
//! # let folder = tempfile::tempdir()?;
//! # for file in assets.read_dir()? {
//! #     let file = file?;
//! #     let name = file.file_name().to_string_lossy().replace("WaterBottle.gltf", "bottle.gltf");
//! #     std::fs::copy(file.path(), folder.path().join(name))?;
//! # }
//! # std::env::set_current_dir(folder.path())?;
//! let mesh = Mesh::load("bottle.gltf")?; // loads and cleans; mesh.report() says what was done
//! # const TEXELS: u64 = 40_000;
//! # fn smaller(baker: Baker<'_>) -> Baker<'_> { baker.texels(TEXELS) }
//! # smaller(
//! Baker::new(&mesh).texels(4_000_000).source(Source::own_materials())
//! # )
//! .write("bottle.fan")?;
//!
//! let asset = Asset::open("bottle.fan")?; // a path or a URL
//! let sampler = asset.sampler(64 << 20); // decoded tiles within 64 MiB
//! let point = asset.nearest_point([0.1, 0.2, 0.3]).ok_or("far away")?;
//! let rgba = sampler.sample(ChannelKind::BaseColor, point, Footprint::NONE)?;
//! println!("{rgba}");
//! # Ok(())
//! # }
//! ```
//!
//! # Types by task
//!
//! | task | types |
//! |---|---|
//! | load a model, or take one from memory | [`Mesh`] |
//! | bake it | [`Baker`], [`Source`], [`Baked`] |
//! | open an asset, look texels up | [`Asset`], [`Sampler`], [`SurfacePoint`], [`Footprint`] |
//! | show something before all texels are there | [`Preview`] |
//! | split a large asset, show many together | [`split()`], [`World`], [`WorldScene`], [`frame_world`], [`verify_world`] |
//! | draw pictures of a look, compare pictures | [`look_scene`], [`Surroundings`], [`ModelPicture`], [`ViewComparison`] |
//! | be told of progress, end what takes long | [`Progress`], [`NoProgress`] |
//! | tell errors apart | [`Error`], [`ErrorKind`] |
//!
//! Of these, functions named `open` take paths and addresses, those named `load` files alone.
//!
//! # Features
//!
//! None is on by default; without features there is no window, GPU or network code.
//!
//! | feature | adds |
//! |---|---|
//! | `gpu` | [`gpu`]: drawing on wgpu, into a host's own frames too |
//! | `http` | assets at `http://`, `https://`, `s3://`, `gs://` and `az://` addresses, and writing to stores ([`addresses`]); [`Merge`] and [`change_world`], which take files and addresses |
//! | `paint` | [`paint`]: strokes, layers, undo |
//! | `photos` | [`photos`]: photographs with cameras as a source |
//! | `export` | [`export`]: models with ordinary texture coordinates, unwrapping |
//! | `signals` | [`signals`]: requests to end a program, limits |
//!
//! # Modules
//!
//! The types above suffice for common tasks; the modules hold the rest of the library.
//!
//! | module | what |
//! |---|---|
//! | [`mesh`] | loading, cleaning, fans, generators |
//! | [`look`] | the look: its file and its schema |
//! | [`look_scene`] | looks as scenes of models with materials |
//! | [`texture`] | images, filters, mappings, solid recipes, comparison of pictures |
//! | [`cover`] | partial fans, groups, tile maps, the texture function |
//! | [`store`] | the `.fan` asset: writing, reading, caching, sampling, verifying |
//! | [`bake`] | sources to tiles |
//! | [`stream`] | asynchronous reading, demand and residency of tiles |
//! | [`scene`] | cameras, lights, surroundings, tone mapping: what renderers are given |
//! | [`render`] | the CPU renderer |
//! | [`base`] | errors, random numbers, boxes |
//!
//! Implement [`bake::Source`] to bake anything that is a function of a surface point, [`render::Surface`] to render
//! anything that gives a material at one. All work runs on the current rayon pool, and its results do not depend on the
//! number of threads.
//!
//! Files that others made are read within [`ReadLimits`]: how much memory they may take, and which other files they may name. They hold
//! for the process, or for what is called within [`ReadLimits::run`], so that each of several assets can have its own.
//!
//! `examples/` holds short programs: sampling, baking a closure, drawing into a host's frame, streaming without a GPU, painting,
//! unwrapping.

#[cfg(feature = "http")]
pub mod addresses;
mod asset;
mod baker;
pub mod look_scene;
mod look_table;
mod model;
mod notes;
mod pictures;
mod preview;
#[cfg(feature = "signals")]
pub mod signals;
mod world;

#[cfg(feature = "http")]
pub use addresses::upload::{Upload, Uploaded};
pub use asset::{Asset, FileKind};
#[cfg(feature = "photos")]
pub use baker::PhotoSet;
pub use baker::{Baked, Baker, Covered, LongestEdge, OwnLook, Source};
#[cfg(feature = "http")]
pub use baker::{Merge, Merged};
#[cfg(feature = "export")]
pub use fantex_export as export;
#[cfg(feature = "gpu")]
pub use fantex_gpu as gpu;
#[cfg(feature = "gpu")]
pub use fantex_gpu::{StreamedWorld, WorldOptions, WorldStatistics};
#[cfg(feature = "paint")]
pub use fantex_paint as paint;
#[cfg(feature = "photos")]
pub use fantex_photos as photos;
pub use fantex_stream::{WORLD_EXTENSION, World, WorldCoarse, WorldObject, WorldPreview};
pub use look_table::{LookTable, look_texture};
pub use model::Mesh;
#[cfg(feature = "export")]
pub use notes::{ModelKind, model_notes};
pub use notes::{damage_note, not_verified, smallest_tiles_note, stand_in_note};
pub use pictures::{ModelPicture, Surroundings, ViewComparison};
pub use preview::{Preview, PreviewOptions};
pub use world::{
    ObjectReport, SectorPreviews, Split, SplitOptions, WorldReport, WorldScene, WorldSurface, frame_world,
    split, verify_world,
};
#[cfg(feature = "http")]
pub use world::{StoreFolder, WorldChange, WorldChanged, change_world};
#[cfg(feature = "export")]
pub use world::{export_world, export_world_fans};
pub use {
    fantex_bake as bake, fantex_base as base, fantex_cover as cover, fantex_look as look,
    fantex_mesh as mesh, fantex_render as render, fantex_scene as scene, fantex_store as store,
    fantex_stream as stream, fantex_texture as texture, glam,
};
pub use {
    fantex_bake::{BakeFormat, Fit, NoProgress, Progress},
    fantex_base::{Error, ErrorKind, ReadLimits, ReadOptions, Result},
    fantex_mesh::SurfacePoint,
    fantex_store::{ChannelKind, Footprint, Quality, Sampler},
    fantex_texture::MappingKind,
};
