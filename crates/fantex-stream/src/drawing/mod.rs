//! What renderers draw a streamed asset with, without a graphics type in it: triangles, tables, the atlas' words.
//!
//! ```text
//!  Mesh, Cover  --geometry----> plain triangles, border triangles
//!  Cover, means --tables------> groups, means, frames                per group
//!  TableChange  --page_words--> where each page lies in the atlas    per page
//!  ParcelUpload --uploads-----> rectangles of texels or blocks
//! ```

mod atlas_grid;
mod geometry;
mod page_words;
mod tables;
mod uploads;

pub use atlas_grid::*;
pub use geometry::*;
pub use page_words::*;
pub use tables::*;
pub use uploads::*;
