//! Sources to tiles: evaluates a [`Source`] over every tile of a cover, fits texels to their reconstruction, filters levels,
//! encodes blocks and hands them to the store, in bounded memory.
//!
//! ```text
//!  Source --evaluate--> Raster --fitted--> level 0 --\
//!  (per texel footprint)   `--halved--> level 1.. ---+--> pages --> AssetWriter
//! ```

mod asset_source;
mod bake;
mod charts;
mod fidelity;
mod image_source;
mod light;
mod look_source;
mod raster;
mod samples;
mod source;
mod tile;
mod transfer;

pub use asset_source::AssetSource;
pub use bake::*;
pub use fantex_scene::LightQuantity;
pub use fidelity::*;
pub use light::*;
pub use look_source::{LookSource, baked_materials};
pub use source::*;
pub use transfer::*;
