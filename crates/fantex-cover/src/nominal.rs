//! How many texels the surface is meant to get, before a total is met.

use crate::surface::Surface;
use crate::{CoverOptions, TexelBudget};

/// Texels per mesh unit before the total is met.
pub(crate) enum NominalDensity<'a> {
    /// As good as a total allows.
    Total(f32),
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
                Self::Total((EXPECTED_SHARE * *n as f64 / area).sqrt() as f32)
            }
            TexelBudget::Density(d) => Self::Uniform(*d as f32),
            TexelBudget::PerTriangle(field) => Self::PerTriangle(field),
        }
    }

    /// True where tiles share a total, and not each has a density of its own to meet.
    pub(crate) fn is_total(&self) -> bool {
        matches!(self, Self::Total(_))
    }

    pub(crate) fn of_triangle(&self, triangle: usize) -> f32 {
        match self {
            Self::Total(d) | Self::Uniform(d) => *d,
            Self::PerTriangle(field) => field[triangle],
        }
    }

    /// The densest of a fan's triangles decides, so that no detail is lost where densities meet.
    pub(crate) fn of_fan(&self, surface: &Surface<'_>, fan: usize) -> f32 {
        match self {
            Self::Total(d) | Self::Uniform(d) => *d,
            Self::PerTriangle(field) => {
                surface.fans.corners(fan).iter().map(|c| field[c.triangle()]).fold(0.0, f32::max)
            }
        }
    }

    /// Root of the area-weighted mean square.
    pub(crate) fn mean(&self, surface: &Surface<'_>) -> f32 {
        match self {
            Self::Total(d) | Self::Uniform(d) => *d,
            Self::PerTriangle(field) => {
                let area = surface.total(|_| 1.0).max(f64::MIN_POSITIVE);
                let texels = surface.total(|t| f64::from(field[t]) * f64::from(field[t]));
                (texels / area).sqrt() as f32
            }
        }
    }
}

/// Surfaces that share a tile, and so its density, although each asks for a density of its own.
///
/// A surface of the area `a` that asks for the density `n` has the error `a n^2 (n / d)^4` at the density `d`, in texels that it asks
/// for, and `a d^2` texels. So surfaces at a common density have an error of `sum a n^6 / d^4`, and their [cost](crate::cost)
/// is that of an even surface that asks for `(sum a n^6 / sum a)^(1/6)`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Demand {
    area: f64,
    /// Sum of `a n^2`.
    texels: f64,
    /// Sum of `a n^6`.
    error: f64,
}

impl Demand {
    pub(crate) fn of(area: f32, density: f32) -> Self {
        let (area, density) = (f64::from(area), f64::from(density));
        let squared = density * density;
        Self { area, texels: area * squared, error: area * squared * squared * squared }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.area += other.area;
        self.texels += other.texels;
        self.error += other.error;
    }

    /// Texels at the densities that are asked for.
    pub(crate) fn texels(&self) -> f32 {
        self.texels as f32
    }

    /// The density that an even surface would ask for; `None` without an area.
    pub(crate) fn density(&self) -> Option<f32> {
        let density = libm::cbrt(self.error / self.area).sqrt() as f32;
        density.is_finite().then_some(density)
    }

    /// The density at which the error is that of all surfaces at their own, relative to [`density`](Self::density).
    pub(crate) fn factor_for_own(&self) -> f32 {
        // error / d^4 = texels, for d = factor (error / area)^(1/6)
        let fourth = libm::cbrt(self.error * self.area * self.area) / self.texels;
        let factor = fourth.sqrt().sqrt() as f32;
        if factor.is_finite() { factor.max(1.0) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_with_one_demand_keep_it() {
        let mut demand = Demand::default();
        for area in [0.25, 3.0, 1e-6] {
            demand.add(&Demand::of(area, 700.3));
        }
        assert_eq!(demand.density(), Some(700.3));
        assert!((demand.factor_for_own() - 1.0).abs() < 1e-6);
        assert_eq!(Demand::default().density(), None);
        assert_eq!(Demand::default().factor_for_own(), 1.0);
    }

    #[test]
    fn shared_densities_have_the_error_and_the_cost_that_the_sums_say() {
        let parts = [(0.9, 100.0), (0.1, 600.0), (0.02, 37.0)];
        let mut demand = Demand::default();
        parts.iter().for_each(|&(area, density)| demand.add(&Demand::of(area, density)));
        let error_at = |d: f64| -> f64 {
            parts.iter().map(|&(a, n)| f64::from(a * n * n) * f64::from(n / d as f32).powi(4)).sum()
        };
        let texels: f64 = parts.iter().map(|&(a, n)| f64::from(a * n * n)).sum();
        let density = f64::from(demand.density().unwrap());
        let own = density * f64::from(demand.factor_for_own());
        assert!((error_at(own) / texels - 1.0).abs() < 1e-5);
        // At any density the cost of the parts together is that of an even surface.
        let area: f64 = parts.iter().map(|&(a, _)| f64::from(a)).sum();
        for d in [50.0, density, own] {
            let cost = (error_at(d) * (area * d * d).powi(2)).cbrt();
            assert!((cost / (area * density * density) - 1.0).abs() < 1e-5);
        }
    }
}
