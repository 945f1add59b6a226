//! Solid textures of cubes, bricks and clouds.

use glam::{IVec3, Vec3};

use super::{Solid, SolidPoint, opaque};
use crate::noise::{Fractal, FractalKind, FractalNoise, Noise, NoiseFamily, smoothstep};
use crate::{Allowed, InvalidOption};

// A chequerboard of cubes, averaged exactly.

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

// A wall of bricks in running bond: rows along x, one above the other along y, layers behind each other along z.

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

// Clouds and smoke: fractal noise that boils, cut off below a density.

/// White clouds before a blue sky, or smoke: the colour goes from `sky` to `cloud` with the density, which is the alpha, too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clouds {
    /// Width of the largest clouds, above 0.
    pub size: f32,
    /// Share of the sky that is covered, 0 to 1.
    pub cover: f32,
    /// How soft the borders are, above 0.
    pub softness: f32,
    /// Cells of change per second: clouds form and dissolve.
    pub speed: f32,
    /// Colour where there is no cloud (linear RGB).
    pub sky: Vec3,
    /// Colour of thick cloud.
    pub cloud: Vec3,
    /// Opacity where there is no cloud, 0 to 1.
    pub sky_alpha: f32,
    noise: FractalNoise,
    swirl: Noise,
}

impl Clouds {
    /// Fair weather.
    pub fn new(seed: u32) -> Self {
        let octaves = Fractal { octaves: 7, lacunarity: 2.03, gain: 0.52 };
        Self {
            size: 0.7,
            cover: 0.5,
            softness: 0.6,
            speed: 0.2,
            sky: Vec3::new(0.10, 0.28, 0.62),
            cloud: Vec3::new(0.92, 0.93, 0.95),
            sky_alpha: 1.0,
            noise: FractalNoise::new(NoiseFamily::Simplex, FractalKind::Fbm, octaves, seed),
            swirl: Noise::new(seed ^ 0x68bc_21eb),
        }
    }

    /// Checks the options.
    ///
    /// # Errors
    ///
    /// A number is out of its range.
    pub fn validate(&self) -> Result<(), InvalidOption> {
        Allowed::Positive.check("clouds", "size", &[self.size])?;
        Allowed::Share.check("clouds", "cover", &[self.cover])?;
        Allowed::Positive.check("clouds", "softness", &[self.softness])?;
        Allowed::Finite.check("clouds", "speed", &[self.speed])?;
        Allowed::Share.check("clouds", "opacity of the sky", &[self.sky_alpha])?;
        let colors = [self.sky.to_array(), self.cloud.to_array()];
        Allowed::NotNegative.check("clouds", "colour", colors.as_flattened())
    }

    /// Thickness of the cloud at a point, 0 to 1.
    pub fn density(&self, at: &SolidPoint) -> f32 {
        let (p, width) = (at.p / self.size, at.footprint / self.size);
        let swirl = self.swirl.fbm(p * 1.3, Fractal::octaves(2), 1.3 * width);
        let at_time = (p + 0.35 * swirl).extend(self.speed * at.time).to_array();
        // About 0.3 is the standard deviation of the sum.
        let threshold = 0.75 * (0.5 - self.cover);
        // What the footprint takes from the noise's contrast comes back as softer borders.
        let half = 0.5 * self.softness + 0.5 * width.min(1.0);
        smoothstep(threshold - half, threshold + half, self.noise.value(at_time, width))
    }
}

impl Solid for Clouds {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let density = self.density(at);
        let rgb = self.sky.lerp(self.cloud, density);
        rgb.extend(self.sky_alpha + (1.0 - self.sky_alpha) * density).to_array()
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
