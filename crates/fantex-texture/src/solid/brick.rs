//! A wall of bricks in running bond: rows along x, one above the other along y, layers behind each other along z.

use glam::{IVec3, Vec3};

use super::{Solid, SolidPoint, opaque};
use crate::noise::{Fractal, Noise};
use crate::{Allowed, InvalidOption};

/// Bricks with mortar between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brick {
    /// Length, height and depth of a brick with its mortar, above 0.
    pub size: Vec3,
    /// Width of the mortar, at least 0.
    pub mortar_width: f32,
    /// How far each row is shifted against the one below, in bricks: 1/2 is the running bond.
    pub shift: f32,
    /// Colour of the bricks (linear RGB).
    pub brick: Vec3,
    /// Colour of the mortar.
    pub mortar: Vec3,
    /// How much bricks differ in brightness, 0 to 1.
    pub variation: f32,
    noise: Noise,
}

impl Brick {
    /// A red wall with light mortar.
    pub fn new(seed: u32) -> Self {
        Self {
            size: Vec3::new(0.3, 0.1, 0.15),
            mortar_width: 0.012,
            shift: 0.5,
            brick: Vec3::new(0.34, 0.085, 0.045),
            mortar: Vec3::new(0.46, 0.43, 0.38),
            variation: 0.6,
            noise: Noise::new(seed),
        }
    }

    /// Checks the options.
    ///
    /// # Errors
    ///
    /// A number is out of its range.
    pub fn validate(&self) -> Result<(), InvalidOption> {
        Allowed::Positive.check("a brick wall", "size", &self.size.to_array())?;
        Allowed::NotNegative.check("a brick wall", "mortar width", &[self.mortar_width])?;
        Allowed::Finite.check("a brick wall", "shift", &[self.shift])?;
        Allowed::Share.check("a brick wall", "variation", &[self.variation])?;
        let colors = [self.brick.to_array(), self.mortar.to_array()];
        Allowed::NotNegative.check("a brick wall", "colour", colors.as_flattened())
    }

    /// Height of the wall's face at a point, for reliefs: 1 on bricks, 0 in the mortar, averaged over the footprint.
    pub fn height(&self, at: &SolidPoint) -> f32 {
        let local = self.in_bricks(at.p);
        let reach = (Vec3::ONE - at.n * at.n).max(Vec3::ZERO);
        (0..3)
            .map(|axis| {
                let width = at.footprint * reach[axis].sqrt() / self.size[axis];
                let joint = (self.mortar_width / self.size[axis]).min(1.0);
                // Where the face lies along this axis, the joint behind it is not seen.
                let seen = reach[axis];
                1.0 - seen * (1.0 - mean_of_run(local[axis], width, 1.0 - joint))
            })
            .product()
    }

    /// The point in units of bricks, rows shifted; bricks begin at integers.
    fn in_bricks(&self, p: Vec3) -> Vec3 {
        let mut local = p / self.size;
        local.x += self.shift * (local.y.floor() + local.z.floor());
        local
    }
}

/// The mean over `[x - width/2, x + width/2]` of the function of period 1 that is 1 on `[0, length)` and 0 on the rest.
fn mean_of_run(x: f32, width: f32, length: f32) -> f32 {
    let integral = |x: f32| x.floor() * length + (x - x.floor()).min(length);
    if width < 1e-4 {
        return f32::from(u8::from(x - x.floor() < length));
    }
    ((integral(x + 0.5 * width) - integral(x - 0.5 * width)) / width).clamp(0.0, 1.0)
}

impl Solid for Brick {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let share = self.height(at);
        let cell = self.in_bricks(at.p).floor().as_ivec3();
        // Bricks that are smaller than the footprint have their mean colour.
        let left = 1.0 - (at.footprint / self.size.min_element()).min(1.0);
        let tint = 2.0 * self.noise.cell_value(cell) - 1.0;
        let warmth = self.noise.cell_value(cell + IVec3::new(0, 0, 977)) - 0.5;
        let grain = self.noise.fbm(at.p * 60.0, Fractal::octaves(3), 60.0 * at.footprint);
        let brightness = 1.0 + self.variation * left * 0.55 * tint + 0.18 * grain;
        let toned =
            self.brick * (1.0 + self.variation * left * warmth * Vec3::new(0.1, 0.5, 0.6)) * brightness;
        opaque((self.mortar * (1.0 + 0.2 * grain)).lerp(toned, share).max(Vec3::ZERO))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_averaged_exactly() {
        for (x, width, length) in [(0.3, 0.5, 0.9), (-1.2, 2.3, 0.4), (0.98, 0.1, 0.95)] {
            let count = 4000;
            let at = |i: u32| x + width * ((i as f32 + 0.5) / count as f32 - 0.5);
            let sum: f32 = (0..count).map(|i| mean_of_run(at(i), 0.0, length)).sum();
            assert!((sum / count as f32 - mean_of_run(x, width, length)).abs() < 2e-3);
        }
    }

    #[test]
    fn rows_are_shifted_against_each_other() {
        let wall = Brick::new(1);
        let mortar = |x: f32, y: f32| {
            wall.height(&SolidPoint { p: Vec3::new(x, y, 0.05), n: Vec3::Z, footprint: 0.0, time: 0.0 }) < 0.5
        };
        assert!(mortar(0.295, 0.05) && !mortar(0.295, 0.15), "half a brick on, there is a brick");
        assert!(mortar(0.1, 0.095) && !mortar(0.1, 0.05), "between rows lies mortar");
    }
}
