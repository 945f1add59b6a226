//! The files that are written.

mod document;
mod geometry;
mod ktx2;
mod outputs;
mod picture;
mod png_file;
mod pyramid;

pub(crate) use document::{Document, ImageFile, write_glb, write_gltf};
pub(crate) use geometry::Geometry;
pub(crate) use ktx2::Ktx2Sink;
pub(crate) use outputs::{Outputs, folder_of};
pub(crate) use picture::FloatSink;
pub use png_file::Depth;
pub(crate) use png_file::PngSink;
