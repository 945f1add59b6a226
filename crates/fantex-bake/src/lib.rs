//! Sources to tiles: evaluates a [`Source`] over every tile of a cover, fits texels to their reconstruction, filters levels,
//! encodes blocks and hands them to the store, in bounded memory.
//!
//! ```text
//!  Source --evaluate--> Raster --fitted--> level 0 --\
//!  (per texel footprint)   `--halved--> level 1.. ---+--> pages --> AssetWriter
//! ```

mod bake;
mod fidelity;
mod light;
mod options;
mod progress;
mod raster;
mod source;
mod sources;
mod stored;
mod tile;
mod transfer;

pub use bake::*;
pub use fidelity::*;
pub use light::*;
pub use options::*;
pub use progress::*;
pub use source::*;
pub use sources::*;
pub use transfer::*;
