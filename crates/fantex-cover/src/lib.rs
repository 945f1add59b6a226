//! The cover of a mesh by partial fans, and the texture function over it.
//!
//! ```text
//!  Mesh --> fans --> fan_shape --> partition --> flatten --> merge --> Cover
//!           umbrellas  project?    patches of    direction,  small     tile maps,
//!                      unfold?     a tile's      rectangle,  groups    extents
//!                      split?      extent        injective?  join
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
pub use pack::*;
pub use stats::*;
