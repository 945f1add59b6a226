//! The core of the npm package `@fantex/three`: reads an asset by `fetch`, decides which of its texels are needed, and hands them to a
//! page that draws with three.js. No graphics interface is in it.
//!
//! ```text
//!  the page, three/src: FanMesh, materials    a worker, or the page: engine.js    FanCore
//!    FanStream: open { url } -----------------> FanCore.open(url) ----------------> fetch: header, sections
//!    vertex arrays, tables <------ opened ----- geometry(), groups(), ... <-------- once
//!    textures: begin { atlas } ---------------> begin(formats, memory) -----------> an empty atlas
//!    camera: update { view } -----------------> update(view, seconds, sink) ------> demand, residency, a slice of unpacking
//!    textures <------------------- updated ---- sink.texels(...), sink.words(...) <- what goes into atlas and page table
//! ```
//!
//! On other targets than WebAssembly the crate is empty.

#[cfg(target_arch = "wasm32")]
mod core;
#[cfg(target_arch = "wasm32")]
mod geometry;
#[cfg(target_arch = "wasm32")]
mod materials;

#[cfg(target_arch = "wasm32")]
pub use self::core::*;
#[cfg(target_arch = "wasm32")]
pub use geometry::FanGeometry;
#[cfg(target_arch = "wasm32")]
pub use materials::FanMaterial;
