//! How texels become a value: decoding, wrapping, reconstruction, footprints.
//!
//! ```text
//! uv, footprint --> axes of the footprint --> level and probes --> taps (wrapped texels and weights)
//!                                                                       |
//!                            linear RGBA <-- resolve <-- weighted sum of decoded texels
//! ```

mod area;
mod ewa;
mod footprint;
mod mipmap;
mod taps;
mod texel;

pub(crate) use area::AreaPlan;
pub(crate) use ewa::{EWA_MINOR_TEXELS, ewa};
pub(crate) use footprint::FootprintAxes;
pub(crate) use mipmap::build_levels;
pub(crate) use taps::{bicubic, bilinear, nearest};
pub(crate) use texel::resolve;
