//! A chequerboard of cubes, averaged exactly.

use glam::Vec3;

use super::{Solid, SolidPoint, opaque};
use crate::{Allowed, InvalidOption};

/// Cubes of two colours in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checker {
    /// Edge of a cube, above 0.
    pub cell: f32,
    /// Colour of the cube between the origin and `(cell, cell, cell)` (linear RGB).
    pub even: Vec3,
    /// Colour of its neighbours.
    pub odd: Vec3,
}

impl Default for Checker {
    /// Light and dark cubes of an eighth.
    fn default() -> Self {
        Self { cell: 0.125, even: Vec3::splat(0.8), odd: Vec3::splat(0.06) }
    }
}

/// The mean of a wave of period 2 that is 1 on [0,1) and -1 on [1,2), over the interval of this width around `x`: the difference of its
/// antiderivative, a triangle wave.
pub(super) fn mean_square_wave(x: f32, width: f32) -> f32 {
    let triangle = |x: f32| {
        let phase = x.rem_euclid(2.0);
        phase.min(2.0 - phase)
    };
    let sign = if x.rem_euclid(2.0) < 1.0 { 1.0 } else { -1.0 };
    if width < 1e-4 {
        sign
    } else {
        ((triangle(x + 0.5 * width) - triangle(x - 0.5 * width)) / width).clamp(-1.0, 1.0)
    }
}

impl Checker {
    /// Checks the options.
    ///
    /// # Errors
    ///
    /// A number is out of its range.
    pub fn validate(&self) -> Result<(), InvalidOption> {
        Allowed::Positive.check("a checker", "cell", &[self.cell])?;
        Allowed::NotNegative.check("a checker", "colour", &self.even.to_array())?;
        Allowed::NotNegative.check("a checker", "colour", &self.odd.to_array())
    }
}

impl Solid for Checker {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        // A plane along an axis keeps its colour however wide the footprint, since that lies in the surface.
        let reach = (Vec3::ONE - at.n * at.n).max(Vec3::ZERO);
        let width = at.footprint / self.cell * Vec3::new(reach.x.sqrt(), reach.y.sqrt(), reach.z.sqrt());
        let p = at.p / self.cell;
        let product = (0..3).map(|axis| mean_square_wave(p[axis], width[axis])).product::<f32>();
        opaque(self.odd.lerp(self.even, 0.5 + 0.5 * product))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn square_waves_are_averaged_exactly() {
        for (x, width) in [(0.3, 0.2), (0.95, 0.5), (-0.4, 1.7), (5.2, 3.3)] {
            let count = 4000;
            let sum: f32 = (0..count)
                .map(|i| mean_square_wave(x + width * ((i as f32 + 0.5) / count as f32 - 0.5), 0.0))
                .sum();
            assert!((sum / count as f32 - mean_square_wave(x, width)).abs() < 2e-3, "{x} {width}");
        }
    }

    #[test]
    fn cubes_alternate_and_blur_to_grey() {
        let checker = Checker { even: Vec3::ONE, odd: Vec3::ZERO, cell: 0.5 };
        let at = |p, footprint| {
            checker.color(&SolidPoint { p, n: Vec3::ONE.normalize(), footprint, time: 0.0 })[0]
        };
        assert_eq!(at(Vec3::splat(0.25), 0.0), 1.0);
        assert_eq!(at(Vec3::new(0.75, 0.25, 0.25), 0.0), 0.0);
        assert_eq!(at(Vec3::new(-0.25, -0.25, 0.25), 0.0), 1.0);
        assert!((at(Vec3::splat(0.25), 40.0) - 0.5).abs() < 0.01);
    }

    #[test]
    fn cells_without_size_are_refused() {
        assert!(Checker { cell: 0.0, ..Checker::default() }.validate().is_err());
        assert!(Checker { cell: f32::NAN, ..Checker::default() }.validate().is_err());
        assert!(Checker::default().validate().is_ok());
    }
}
