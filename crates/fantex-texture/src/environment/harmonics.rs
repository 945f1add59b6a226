//! Diffuse light of an environment as nine numbers per colour.
//!
//! R. Ramamoorthi and P. Hanrahan, "An efficient representation for irradiance environment maps", 2001: the clamped cosine
//! is so smooth that, of the spherical harmonics of its convolution with any light, those beyond order 2 hold little: of the
//! largest irradiance, 1 % on average and 4 % at worst under an overcast forest, 2 % and 6 % with the sun in the sky
//! (`tests/texture/environments.rs`).

use std::f32::consts::PI;

use glam::Vec3;

use super::EnvironmentMap;

/// What white diffuse surfaces reflect under an environment, by their normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IrradianceHarmonics {
    /// Coefficients in the order `1, y, z, x, xy, yz, 3z²-1, xz, x²-y²`, already convolved with the cosine and divided by
    /// pi.
    coefficients: [Vec3; 9],
}

/// Sides above this are not needed: averages enter here only.
const ENOUGH_ROWS: u32 = 128;

impl IrradianceHarmonics {
    /// Projects an environment.
    pub fn of_map(map: &EnvironmentMap) -> Self {
        let last = map.level_count() - 1;
        let level = (0..=last).find(|&level| map.level_size(level)[1] <= ENOUGH_ROWS).unwrap_or(last);
        let mut sums = map.integrate(level, |direction, steradians, color| {
            let light = color * steradians;
            let mut terms = [Vec3::ZERO; 10];
            basis(direction).iter().zip(&mut terms).for_each(|(value, term)| *term = light * *value);
            terms[9] = Vec3::splat(steradians);
            terms
        });
        // The texels' solid angles are those of their middles; together they are the whole sphere.
        let whole = 4.0 * PI / sums[9].x;
        let mut coefficients = [Vec3::ZERO; 9];
        for (order, coefficient) in coefficients.iter_mut().enumerate() {
            // The cosine's own coefficients, divided by pi: 1, 2/3, 1/4.
            let cosine = if order == 0 {
                1.0
            } else if order < 4 {
                2.0 / 3.0
            } else {
                0.25
            };
            sums[order] *= whole * cosine;
            *coefficient = sums[order];
        }
        Self { coefficients }
    }

    /// Irradiance / pi of a surface with a unit normal, linear RGB, at least 0: what it reflects if it is white.
    pub fn diffuse(&self, normal: Vec3) -> Vec3 {
        let terms = self.coefficients.iter().zip(basis(normal));
        terms.fold(Vec3::ZERO, |sum, (coefficient, value)| sum + *coefficient * value).max(Vec3::ZERO)
    }

    /// The nine coefficients; see the field's order above: `diffuse(n)` is their sum weighted by the harmonics of `n`.
    pub fn coefficients(&self) -> [Vec3; 9] {
        self.coefficients
    }
}

/// The real spherical harmonics of orders 0 to 2.
fn basis(Vec3 { x, y, z }: Vec3) -> [f32; 9] {
    [
        0.282_094_8,
        0.488_602_5 * y,
        0.488_602_5 * z,
        0.488_602_5 * x,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * z * z - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (x * x - y * y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::EnvironmentForm;

    fn of(light: impl Fn(Vec3) -> f32 + Sync) -> IrradianceHarmonics {
        let map = EnvironmentMap::from_function(EnvironmentForm::Cube, 64, |d, _| Vec3::splat(light(d)));
        IrradianceHarmonics::of_map(&map)
    }

    #[test]
    fn constant_light_is_reflected_as_it_is() {
        let harmonics = of(|_| 0.75);
        for n in [Vec3::X, Vec3::NEG_Y, Vec3::ONE.normalize()] {
            assert!((harmonics.diffuse(n) - 0.75).abs().max_element() < 1e-4, "{}", harmonics.diffuse(n));
        }
    }

    #[test]
    fn linear_light_is_reflected_at_two_thirds() {
        // Light 1 + d.y: the irradiance is pi (1 + 2/3 n.y).
        let harmonics = of(|d| 1.0 + d.y);
        for n in [Vec3::Y, Vec3::X, Vec3::NEG_Y] {
            let expected = 1.0 + 2.0 / 3.0 * n.y;
            assert!((harmonics.diffuse(n).x - expected).abs() < 1e-3, "{} {expected}", harmonics.diffuse(n));
        }
    }
}
