//! The viewer for browsers: the streamer, the loader and the renderer of the other programs, with `fetch` for reads and a canvas for a
//! window.
//!
//! ```text
//!  page/viewer.js: events, animation frames, what is said        Viewer: camera, streamed model or world, renderer
//!       open(canvas, url) -------------------------------------->  fetch: header, sections, or the index of a world
//!       frame(time) -------------------------------------------->  slices of unpacking, uploads, a picture if something changed
//!       orbit, pan, zoom, resize ------------------------------->  the camera
//! ```
//!
//! On other targets the crate is the files of such a page, for programs that hand them out ([`files`], [`Page`]).

#[cfg(not(target_arch = "wasm32"))]
mod files;
#[cfg(target_arch = "wasm32")]
mod viewer;

#[cfg(not(target_arch = "wasm32"))]
pub use files::*;
#[cfg(target_arch = "wasm32")]
pub use viewer::*;
