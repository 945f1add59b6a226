//! Sources to tiles: evaluates a [`Source`] over every tile of a cover, fits texels, filters levels, encodes blocks and hands
//! them to the store, in bounded memory.

mod options;
mod source;

pub use options::*;
pub use source::*;
