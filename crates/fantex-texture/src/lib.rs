//! Textures as functions: images and their filters, procedural solids, mappings of space to texture coordinates.
//!
//! [`coordinates`] says where on a surface a texture is looked up, [`combine`] makes textures of textures, and [`warp`] maps
//! between texture and image planes.
//!
//! Values are linear-light RGBA `[f32; 4]` with straight alpha. Image coordinates have their origin at the top left of
//! row 0, column 0, `u` to the right and `v` downwards, both in `[0,1]` over the image.

mod color_ramp;
pub mod combine;
pub mod compare;
mod container;
pub mod coordinates;
pub mod environment;
mod eye;
pub mod filter;
mod frames;
mod image;
mod image_file;
mod image_texture;
mod invalid_option;
pub mod levels;
pub mod look;
mod mapping;
pub mod material;
pub mod noise;
mod procedural;
mod solid;
mod surface_detail;
mod tabulate;
mod texture;
mod tile_mean;
mod values;
mod volume;
pub mod warp;

pub use color_ramp::*;
pub use eye::*;
pub use fantex_base::srgb as color;
pub use frames::*;
pub use image::*;
pub use image_file::*;
pub use image_texture::*;
pub use invalid_option::Allowed;
pub use mapping::*;
pub use procedural::*;
pub use solid::*;
pub use surface_detail::*;
pub use tabulate::*;
pub use texture::*;
pub use values::*;
pub use volume::*;
