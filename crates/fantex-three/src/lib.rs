//! The core of the npm package `@fantex/three`: reads an asset by `fetch`, decides which of its texels are needed, and hands them to a
//! page that draws with three.js. No graphics interface is in it.
//!
//! ```text
//!  three/src: FanLoader, FanMesh, materials          FanCore
//!     FanCore.open(url) -------------------------->  fetch: header, sections
//!     geometry(), groups(), means(), ... <---------  vertex arrays and tables, once
//!     begin(formats, memory) --------------------->  an empty atlas
//!     update(view, seconds, sink) ---------------->  demand, residency, a slice of unpacking
//!     sink.texels(...), sink.words(...) <----------  what goes into the atlas and the page table
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
