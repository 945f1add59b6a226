//! The cover of a mesh by partial fans, and the texture function over it.
//!
//! ```text
//!  Mesh --> fans --> fan_shape --> partition --------------> flatten --> merge --> sizing --> Cover
//!           umbrellas  project?    cuts that make tiles      direction,  groups    extents,
//!                 |    unfold?     cheaper; connected        rectangle,  join      tile maps
//!                 |                pieces                    injective?              ^
//!                 '--> fan_tiles (one fan per tile: all of that, fan by fan) ---------'
//! ```
//!
//! What "cheaper" means is in `cost`: texels per unit of error in the worst direction.
//! [`Cover`] is the run-time data with the texture function's weights and tile coordinates; [`build_cover`] makes one.

mod blocks;
mod build;
mod cone;
mod connect;
mod cost;
mod cover;
mod crossings;
mod fan_shape;
mod fan_tiles;
mod flatten;
mod footprints;
mod groups;
mod injective;
mod islands;
mod merge;
mod nominal;
mod pack;
mod partition;
mod rectangle;
mod sheet;
mod sizing;
mod spans;
mod stats;
mod stored;
mod surface;
mod texel_uses;
mod unfolded;
mod unroll;
mod watch;

pub use blocks::*;
pub use build::*;
pub use cover::*;
pub use footprints::*;
pub use pack::*;
pub use rectangle::{Rectangle, RectangleFinder};
pub use sheet::Sheet;
pub use sizing::{MAX_EXTENT, MIN_EXTENT};
pub use spans::{SPAN_SLACK, span};
pub use stats::*;
pub use stored::StoredBlocks;
pub use texel_uses::TexelUses;
pub use unfolded::*;
