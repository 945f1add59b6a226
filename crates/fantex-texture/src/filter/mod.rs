//! How texels become a value: decoding, wrapping, reconstruction, footprints.
//!
//! ```text
//! uv, footprint --> axes of the footprint --> level and probes --> taps (wrapped texels and weights)
//!                                                                       |
//!                            linear RGBA <-- resolve <-- weighted sum of decoded texels
//! ```
//!
//! Public is what other kinds of texture (the tiles of a cover) need to filter by the same rules as images.

mod area;
mod batch;
mod ewa;
mod footprint;
mod inner;
mod lod;
mod mipmap;
mod taps;
mod texel;

pub use batch::{GRID_LOOK_UPS, GridLookUps, TexelGrid};
pub use ewa::{EWA_MINOR_TEXELS, EllipseRow, WeightedEllipse};
pub use footprint::{FootprintAxes, MAX_ANISOTROPY};
pub use taps::catmull_rom_weights;

pub(crate) use area::{AreaBlock, AreaPlan};
pub(crate) use batch::{BLOCK, Colors, Levels, LookUp, Probes, Steps, Workspace};
pub(crate) use ewa::ewa;
pub(crate) use lod::LevelPair;
pub(crate) use mipmap::{Stretch, build_levels, stored_channels, stretches};
pub(crate) use taps::{Reconstruction, Taps, bicubic, bilinear, bilinear_reference, bilinear_row, nearest};
pub(crate) use texel::{Kernel, TexelSource, TexelUse, resolve, with_samples, with_texels};
