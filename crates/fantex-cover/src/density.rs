//! How many texels the surface is meant to get, before a total is met.

use crate::surface::Surface;
use crate::{CoverOptions, TexelBudget};

/// Texels per mesh unit before the total is met.
pub(crate) enum NominalDensity<'a> {
    Uniform(f32),
    PerTriangle(&'a [f32]),
}

/// A guess of the share of the ideal density that a grouped cover reaches; only decides how large groups grow.
const EXPECTED_SHARE: f64 = 0.7;

impl<'a> NominalDensity<'a> {
    pub(crate) fn new(surface: &Surface<'_>, options: &'a CoverOptions) -> Self {
        match &options.budget {
            TexelBudget::Total(n) => {
                let area = surface.total(|_| 1.0).max(f64::MIN_POSITIVE);
                Self::Uniform((EXPECTED_SHARE * *n as f64 / area).sqrt() as f32)
            }
            TexelBudget::Density(d) => Self::Uniform(*d as f32),
            TexelBudget::PerTriangle(field) => Self::PerTriangle(field),
        }
    }

    pub(crate) fn of_triangle(&self, triangle: usize) -> f32 {
        match self {
            Self::Uniform(d) => *d,
            Self::PerTriangle(field) => field[triangle],
        }
    }

    /// The densest of a fan's triangles decides, so that no detail is lost where densities meet.
    pub(crate) fn of_fan(&self, surface: &Surface<'_>, fan: usize) -> f32 {
        match self {
            Self::Uniform(d) => *d,
            Self::PerTriangle(field) => {
                surface.fans.corners(fan).iter().map(|c| field[c.triangle()]).fold(0.0, f32::max)
            }
        }
    }

    /// Root of the area-weighted mean square.
    pub(crate) fn mean(&self, surface: &Surface<'_>) -> f32 {
        match self {
            Self::Uniform(d) => *d,
            Self::PerTriangle(field) => {
                let area = surface.total(|_| 1.0).max(f64::MIN_POSITIVE);
                let texels = surface.total(|t| f64::from(field[t]) * f64::from(field[t]));
                (texels / area).sqrt() as f32
            }
        }
    }
}
