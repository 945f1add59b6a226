//! The look: what textures drive on a surface.
//!
//! ```text
//! TOML --file--> data (plain tables) --resolve, with a model--> textures, LookMaterial
//!  ^                                        lights, camera, objects: left to whoever renders
//!  '--translate-- a model's own materials
//! ```

pub mod data;
mod file;
mod material;

pub use file::{Key, LookError, LookFile, LookProblem, look_schema};
pub use material::*;
