//! Looks as scenes: from a file to dressed models, lamps, surroundings and a camera.
//!
//! ```text
//! LookFile --Wardrobe--> Dress (a model's materials) --LookBake--> a source for tiles
//!              '-------> LookScene (all objects, lamps, surroundings) --render--> pictures
//! ```

mod bake;
mod displaced;
mod dress;
mod error;
mod lights;
mod objects;
mod scene;
mod shapes;

pub use bake::{LookBake, LookBakeError};
pub use dress::{Dress, Wardrobe};
pub use error::LookSceneError;
pub use objects::GivenModel;
pub use scene::{LookScene, PictureChanges};
