//! Triangle meshes for fantex: loading model files, cleaning, adjacency and fans.
//!
//! ```text
//!  file --load--> Model --clean--> Mesh --Fans::of--> Fans
//!  (glTF, OBJ, PLY, STL)  as the file says   welded, mesh space   one umbrella per fan
//! ```
//!
//! A [`Model`] is what a file says: corners index positions that loaders may have split, coordinates are in the
//! file's (world) space in double precision. A [`Mesh`] is what everything else works on: welded by position,
//! free of degenerate triangles, consistently oriented where possible, in *mesh space* (centred, scaled by a
//! power of two so that all coordinates lie in [-1, 1]). Attributes stay per corner.

mod adjacency;
mod angle;
mod clean;
mod counts;
mod displace;
mod fans;
#[cfg(not(target_arch = "wasm32"))]
mod fronts;
pub mod generate;
mod hard_edges;
mod load;
mod material;
mod mesh;
mod morton;
mod normals;
mod ray;
#[cfg(not(target_arch = "wasm32"))]
mod simplify;
mod surface_point;
mod tangents;
mod write;

pub use adjacency::*;
pub use angle::*;
pub use clean::*;
pub use displace::*;
pub use fans::*;
pub use hard_edges::*;
pub use load::*;
pub use material::*;
pub use mesh::*;
pub use morton::*;
pub use normals::*;
pub use ray::*;
#[cfg(not(target_arch = "wasm32"))]
pub use simplify::{simplified, simplified_keeping};
pub use surface_point::*;
pub use tangents::*;
pub use write::*;
