//! Procedural models: small known shapes and landscapes of any size.

mod landscape;
mod noise;
mod primitives;

pub use landscape::{Landscape, LandscapeOptions, landscape};
pub use primitives::{book, cube, grid, icosphere, torus, uv_sphere};
