//! The look: what textures drive on a surface.
//!
//! ```text
//! fantex_look::LookFile --resolve, with a model--> textures, LookMaterial
//!  ^                         lights, camera, objects: left to whoever renders
//!  '--translate-- a model's own materials
//! ```

mod material;

pub use material::*;
