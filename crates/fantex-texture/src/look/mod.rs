//! The look: what textures drive on a surface.
//!
//! ```text
//! fantex_look::LookFile --resolve, with a model--> textures, LookMaterial
//!  ^                         lights, camera, objects: left to whoever renders
//!  '--translate-- a model's own materials
//! ```

mod material;
mod resolve;
mod translate;

pub use material::*;
pub use resolve::{LookImages, ResolveOptions, Resolver, linear_color, linear_rgb};
pub use translate::{TranslatedLook, look_of_model, materials_of_model};
