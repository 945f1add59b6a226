//! The cover of a mesh by partial fans, and the texture function over it.
//!
//! ```text
//!  Mesh --> fans --> fan_shape --> partition --> connect --> flatten --> merge --> Cover
//!           umbrellas  project?    patches of    connected   direction,  small     tile maps,
//!                 |    unfold?     a tile's      pieces,     rectangle,  groups    extents
//!                 |    split?      extent        fragments   injective?  join        ^
//!                 '--> lone (one fan per tile: all of that, fan by fan) -------------'
//! ```
//!
//! [`Cover`] is the run-time data with the texture function's weights and tile coordinates; [`build_cover`] makes one.

mod border;
mod build;
mod cone;
mod connect;
mod cover;
mod density;
mod extent;
mod fan_shape;
mod flatten;
mod footprints;
mod grouping;
mod injective;
mod lone;
mod merge;
mod pack;
mod partition;
mod rectangle;
mod region;
mod ring;
mod stats;
mod surface;
mod unfold;

pub use build::*;
pub use cover::*;
pub use extent::MAX_EXTENT;
pub use footprints::*;
pub use pack::*;
pub use stats::*;
