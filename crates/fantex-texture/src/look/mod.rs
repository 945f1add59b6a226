//! The look: what textures drive on a surface.

mod material;

pub use material::*;
