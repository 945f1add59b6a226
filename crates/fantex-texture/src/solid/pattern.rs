//! Solid textures of cubes, bricks and clouds.

use fantex_base::parameters;
use glam::{IVec3, Vec3, Vec4};

use super::{Columns, Notes, Recipe, Solid, SolidPoint, fbm, in_blocks, opaque, remainder};
use crate::coordinates::NormalAxes;
use crate::noise::{Fractal, FractalKind, FractalNoise, Noise, NoiseFamily, smoothstep};
use crate::{Allowed, Color, PositiveList3};

// A chequerboard of cubes, averaged exactly.

parameters! {
    /// Cubes of two colours in turn.
    #[derive(Copy)]
    pub struct Checker {
        /// Edge of a cube, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub cell: f32 = 0.125,
        /// Colour of the cube that begins at the origin.
        pub even: Color = Color::opaque(0.8, 0.8, 0.8),
        /// Colour of its neighbours.
        pub odd: Color = Color::opaque(0.06, 0.06, 0.06),
    }
}

/// The mean of a wave of period 2 that is 1 on [0,1) and -1 on [1,2), over the interval of this width around `x`: the difference of its
/// antiderivative, a triangle wave.
pub(super) fn mean_square_wave(x: f32, width: f32) -> f32 {
    let triangle = |x: f32| {
        let phase = remainder::<2>(x);
        phase.min(2.0 - phase)
    };
    if width < 1e-4 {
        if remainder::<2>(x) < 1.0 { 1.0 } else { -1.0 }
    } else {
        ((triangle(x + 0.5 * width) - triangle(x - 0.5 * width)) / width).clamp(-1.0, 1.0)
    }
}

impl Recipe for Checker {
    type Solid = Self;

    fn prepared(&self, _seed: u32) -> Self {
        *self
    }

    fn check(&self) -> fantex_base::Result<()> {
        Allowed::Positive.check("a checker", "cell", &[self.cell])?;
        Allowed::NotNegative.check("a checker", "colour", &self.even.rgb().to_array())?;
        Allowed::NotNegative.check("a checker", "colour", &self.odd.rgb().to_array())
    }
}

impl Solid for Checker {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        assert_eq!(at.len(), colors.len(), "one colour for every point");
        for (at, color) in at.iter().zip(colors) {
            // A plane along an axis keeps its colour however wide the footprint, since that lies in the surface.
            let reach = (Vec3::ONE - at.n * at.n).max(Vec3::ZERO);
            let width = at.footprint / self.cell * Vec3::new(reach.x.sqrt(), reach.y.sqrt(), reach.z.sqrt());
            let p = at.p / self.cell;
            let product = (0..3).map(|axis| mean_square_wave(p[axis], width[axis])).product::<f32>();
            *color = opaque(self.odd.rgb().lerp(self.even.rgb(), 0.5 + 0.5 * product));
        }
    }

    fn normal_axes(&self) -> NormalAxes {
        NormalAxes::Texture
    }
}

// A wall of bricks in running bond: rows along x, one above the other along y, layers behind each other along z.

parameters! {
    /// Bricks.
    #[derive(Copy)]
    pub struct Brick {
        /// Length, height and depth of a brick with its mortar, in units of the place.
        #[serde(with = "PositiveList3")]
        pub size: Vec3 = Vec3::new(0.3, 0.1, 0.15),
        /// Width of the mortar, in units of the place.
        #[schemars(range(min = 0))]
        pub mortar_width: f32 = 0.012,
        /// How far each row is shifted against the one below, in bricks.
        pub shift: f32 = 0.5,
        /// Colour of the bricks.
        pub brick: Color = Color::opaque(0.34, 0.085, 0.045),
        /// Colour of the mortar.
        pub mortar: Color = Color::opaque(0.46, 0.43, 0.38),
        /// How much bricks differ in brightness.
        #[schemars(range(min = 0, max = 1))]
        pub variation: f32 = 0.6,
        /// Whether the texture is the height of the wall's face, 1 on bricks and 0 in the mortar, instead of its colour.
        pub relief: bool = false,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
    }
}

seeded!(Brick, |brick| {
    Allowed::Positive.check("a brick wall", "size", &brick.size.to_array())?;
    Allowed::NotNegative.check("a brick wall", "mortar width", &[brick.mortar_width])?;
    Allowed::Finite.check("a brick wall", "shift", &[brick.shift])?;
    Allowed::Share.check("a brick wall", "variation", &[brick.variation])?;
    let colors = [brick.brick.rgb().to_array(), brick.mortar.rgb().to_array()];
    Allowed::NotNegative.check("a brick wall", "colour", colors.as_flattened())
});

impl Brick {
    fn noise(&self) -> Noise {
        Noise::new(self.seed)
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

impl Brick {
    fn block(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        if self.relief {
            at.iter().zip(colors).for_each(|(at, color)| *color = opaque(Vec3::splat(self.height(at))));
            return;
        }
        let grain = fbm(&self.noise(), &Columns::of(at), 3, 60.0, |_, p| p * 60.0);
        for ((at, grain), color) in at.iter().zip(grain).zip(colors) {
            let cell = self.in_bricks(at.p).floor().as_ivec3();
            // Bricks that are smaller than the footprint have their mean colour.
            let left = 1.0 - (at.footprint / self.size.min_element()).min(1.0);
            let tint = 2.0 * self.noise().cell_value(cell) - 1.0;
            let warmth = self.noise().cell_value(cell + IVec3::new(0, 0, 977)) - 0.5;
            let brightness = 1.0 + self.variation * left * 0.55 * tint + 0.18 * grain;
            let warm = 1.0 + self.variation * left * warmth * Vec3::new(0.1, 0.5, 0.6);
            let toned = self.brick.rgb() * warm * brightness;
            let mortar = self.mortar.rgb() * (1.0 + 0.2 * grain);
            *color = opaque(mortar.lerp(toned, self.height(at)).max(Vec3::ZERO));
        }
    }
}

impl Solid for Brick {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| self.block(at, colors));
    }

    fn normal_axes(&self) -> NormalAxes {
        NormalAxes::Texture
    }
}

// Clouds and smoke: fractal noise that boils, cut off below a density.

parameters! {
    /// Clouds or smoke: colour and density, which is the alpha.
    #[derive(Copy)]
    pub struct Clouds {
        /// Width of the largest clouds, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub size: f32 = 0.7,
        /// Share of the sky that clouds cover.
        #[schemars(range(min = 0, max = 1))]
        pub cover: f32 = 0.5,
        /// How soft the borders are.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub softness: f32 = 0.6,
        /// Cells of change per second: clouds form and dissolve.
        pub speed: f32 = 0.2,
        /// Colour between the clouds.
        pub sky: Color = Color::opaque(0.10, 0.28, 0.62),
        /// Colour of the clouds.
        pub cloud: Color = Color::opaque(0.92, 0.93, 0.95),
        /// Alpha between the clouds.
        #[schemars(range(min = 0, max = 1))]
        pub sky_alpha: f32 = 1.0,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
    }
}

/// Clouds with their noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudField {
    clouds: Clouds,
    noise: FractalNoise,
    swirl: Noise,
}

impl Recipe for Clouds {
    type Solid = CloudField;

    fn prepared(&self, seed: u32) -> CloudField {
        let seed = self.seed.wrapping_add(seed);
        let octaves = Fractal { octaves: 7, lacunarity: 2.03, gain: 0.52 };
        let noise = FractalNoise::new(NoiseFamily::Simplex, FractalKind::Fbm, octaves, seed);
        CloudField { clouds: *self, noise, swirl: Noise::new(seed ^ 0x68bc_21eb) }
    }

    fn check(&self) -> fantex_base::Result<()> {
        Allowed::Positive.check("clouds", "size", &[self.size])?;
        Allowed::Share.check("clouds", "cover", &[self.cover])?;
        Allowed::Positive.check("clouds", "softness", &[self.softness])?;
        Allowed::Finite.check("clouds", "speed", &[self.speed])?;
        Allowed::Share.check("clouds", "opacity of the sky", &[self.sky_alpha])?;
        let colors = [self.sky.rgb().to_array(), self.cloud.rgb().to_array()];
        Allowed::NotNegative.check("clouds", "colour", colors.as_flattened())
    }
}

impl CloudField {
    /// Thickness of the cloud at a point, 0 to 1.
    pub fn density(&self, at: &SolidPoint) -> f32 {
        self.densities(std::slice::from_ref(at))[0]
    }

    fn densities(&self, at: &[SolidPoint]) -> Notes<f32> {
        let Clouds { size, cover, softness, speed, .. } = self.clouds;
        let swirl = fbm(&self.swirl, &Columns::of(at), 2, 1.3 / size, |_, p| p / size * 1.3);
        let places: Notes<Vec4> = at
            .iter()
            .zip(swirl)
            .map(|(at, swirl)| (at.p / size + 0.35 * swirl).extend(speed * at.time))
            .collect();
        let widths: Notes<f32> = at.iter().map(|at| at.footprint / size).collect();
        let mut sums: Notes<f32> = at.iter().map(|_| 0.0).collect();
        self.noise.values_4d(&places, &widths, &mut sums);
        // About 0.3 is the standard deviation of the sum.
        let threshold = 0.75 * (0.5 - cover);
        let density = |(sum, width): (f32, f32)| {
            // What the footprint takes from the noise's contrast comes back as softer borders.
            let half = 0.5 * softness + 0.5 * width.min(1.0);
            smoothstep(threshold - half, threshold + half, sum)
        };
        sums.into_iter().zip(widths).map(density).collect()
    }
}

impl Solid for CloudField {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        let Clouds { sky, cloud, sky_alpha, .. } = self.clouds;
        in_blocks(at, colors, |at, colors| {
            for (density, color) in self.densities(at).into_iter().zip(colors) {
                let rgb = sky.rgb().lerp(cloud.rgb(), density);
                *color = rgb.extend(sky_alpha + (1.0 - sky_alpha) * density).to_array();
            }
        });
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
    fn runs_are_averaged_exactly() {
        for (x, width, length) in [(0.3, 0.5, 0.9), (-1.2, 2.3, 0.4), (0.98, 0.1, 0.95)] {
            let count = 4000;
            let at = |i: u32| x + width * ((i as f32 + 0.5) / count as f32 - 0.5);
            let sum: f32 = (0..count).map(|i| mean_of_run(at(i), 0.0, length)).sum();
            assert!((sum / count as f32 - mean_of_run(x, width, length)).abs() < 2e-3);
        }
    }
}
