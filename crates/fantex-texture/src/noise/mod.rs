//! Noise: reproducible randomness that is smooth, has a width of its details, and repeats nowhere.
//!
//! | module | family |
//! |---|---|
//! | `perlin3` | gradient noise in space with its fractal sums: what the solids are made of |
//! | `batch` | the same at many points, or for many octaves, in vectors |
//! | `gradient` | gradient noise of 2, 3 and 4 dimensions with derivatives |
//! | `simplex` | the same on simplices |
//! | `cellular` | distances to scattered points |
//! | `family` | all of them by name, and their fractal sums |
//! | `waves` | sums of sine waves |
//!
//! Patterns come from an integer hash of the cell and a seed, so that they have no period. Sums take a footprint: the width,
//! in the units of the point, over which the caller averages. What is narrower fades to its mean.

mod batch;
mod cellular;
mod family;
mod gradient;
mod hash;
mod perlin3;
mod simplex;
#[cfg(test)]
mod tests_common;
mod waves;

pub use cellular::{Cellular, CellularMetric, cellular};
pub use family::{FractalKind, FractalNoise, NoiseFamily};
pub use gradient::gradient_noise;
pub use hash::white_noise;
pub use perlin3::*;
pub use simplex::simplex_noise;
pub use waves::{Wave, Waves};

/// What is left of a detail whose period is one cell, when cells of `frequency` per unit are averaged over `footprint`:
/// 1 below a quarter of a cell, 0 from three quarters on.
pub fn band_limit(frequency: f32, footprint: f32) -> f32 {
    1.0 - smoothstep(0.25, 0.75, frequency * footprint)
}

/// 0 below `low`, 1 above `high`, a cubic with level ends between.
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
