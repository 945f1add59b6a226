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
mod batch_texels;
mod footprint;
mod grids;
mod mipmap;
mod taps;

pub use batch::log2_lanes;
pub use footprint::{EWA_MINOR_TEXELS, EllipseRow, FootprintAxes, MAX_ANISOTROPY, WeightedEllipse, log2};
pub use grids::{ColorSums, GRID_LOOK_UPS, GridLookUps, GridPlaces, TexelGrid};
pub use mipmap::{Overlap, halved_level, halved_row, overlaps};
pub use taps::catmull_rom_weights;

pub(crate) use area::{AreaBlock, AreaPlan};
pub(crate) use batch::{BLOCK, Colors, LookUp, Probes, Steps, Workspace};
pub(crate) use batch_texels::Levels;
pub(crate) use footprint::{LevelPair, ewa};
pub(crate) use mipmap::{build_levels, filled_rows, halved_axis, stored_channels};
pub(crate) use taps::wrap_index;
pub(crate) use taps::{
    Kernel, Reconstruction, TRANSPARENT_WEIGHT, Taps, TexelSource, TexelUse, bilinear, bilinear_reference,
    bilinear_row, reconstructed, resolve, with_samples, with_texels,
};
