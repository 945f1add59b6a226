//! Looks as scenes: from a file to dressed models, lamps, surroundings and a camera.

mod bake;
mod dress;

pub use bake::LookBake;
pub use dress::{Dress, Wardrobe};
