//! Solid textures that look like stone or wood: marble, granite, strata, annual rings.

use std::f32::consts::TAU;

use fantex_base::parameters;
use glam::{IVec3, Quat, Vec2, Vec3};

use super::{BLOCK, Columns, Solid, SolidPoint, fbm, fractal_sum, in_blocks, opaque, remainder, values};
use crate::noise::{
    Cellular, CellularMetric, Fractal, Noise, OctaveShape, band_limit, cellular_all, smoothstep,
};
use crate::{Allowed, Color};

// Wood: annual rings about a trunk, with irregular waves, fibres and pores; the textbook's is [`Rings`](super::Rings).

parameters! {
    /// Wood. The trunk stands along y.
    #[derive(Copy)]
    pub struct Wood {
        /// Width of a ring.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub ring: f32 = 0.085,
        /// How far outer rings lie off centre, per radius.
        #[schemars(range(min = 0, max = 1))]
        pub eccentricity: f32 = 0.25,
        /// Amplitude of lobes that wind round the trunk.
        #[schemars(range(min = 0))]
        pub twist: f32 = 0.012,
        /// Angle between the trunk and the y axis, in degrees.
        pub tilt: f64 = 7.0,
        /// Amplitude of the rings' irregular waves.
        #[schemars(range(min = 0))]
        pub wobble: f32 = 0.09,
        /// Strength of fibres and pores.
        #[schemars(range(min = 0))]
        pub grain: f32 = 1.0,
        /// Colour of the wood grown in spring.
        pub early: Color = Color::opaque(0.56, 0.31, 0.13),
        /// Colour of the wood grown in late summer.
        pub late: Color = Color::opaque(0.20, 0.075, 0.022),
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
    }
}

seeded!(Wood);

/// Mean of [`ring_profile`] over a period.
const RING_MEAN: f32 = 0.275;

/// Share of late wood over one ring: grows slowly, ends sharply.
fn ring_profile(phase: f32) -> f32 {
    smoothstep(0.4, 0.95, phase) * (1.0 - smoothstep(0.9, 1.0, phase)).max(0.0)
}

/// Pores per unit of the place.
const PORES: f32 = 110.0;

/// How dark a pore is, by noise.
fn pore(noise: f32) -> f32 {
    smoothstep(0.25, 0.6, noise)
}

/// Mean of [`pore`] over space.
const PORE_MEAN: f32 = 0.0675;

impl Wood {
    fn noise(&self) -> Noise {
        Noise::new(self.seed)
    }

    /// Turns the trunk upright.
    fn trunk(&self) -> Quat {
        let tilt = self.tilt.to_radians() as f32;
        Quat::from_rotation_z(tilt) * Quat::from_rotation_x(0.6 * tilt)
    }

    /// The distance from the trunk's (bent) axis in which the rings are equally wide, at a point of the upright trunk.
    fn radius(&self, local: Vec3, waves: f32) -> f32 {
        let plain = Vec2::new(local.x, local.z).length();
        let off_center = self.eccentricity * plain;
        let at = Vec2::new(local.x - 0.5 * off_center, local.z * (1.0 + 0.3 * self.eccentricity));
        let radius = at.length();
        // The fifth power of a unit vector has five times its angle.
        let unit = if radius > 0.0 { at / radius } else { Vec2::X };
        let squared = unit.rotate(unit);
        let five_angles = squared.rotate(squared).rotate(unit);
        let turned = five_angles.rotate(Vec2::from_angle(0.8 * TAU * local.y));
        radius + self.twist * turned.y * smoothstep(0.0, 0.3, plain) + self.wobble * waves
    }
}

/// The trunk's axis passes beside the model, so that boards show arcs and cathedrals, not targets only.
const FROM_AXIS: Vec3 = Vec3::new(0.35, 0.0, 0.25);

impl Wood {
    fn block(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        let noise = self.noise();
        let trunk = self.trunk();
        let at = &Columns::of(at);
        let mut locals = [Vec3::ZERO; BLOCK];
        at.numbers().for_each(|i| locals[i] = trunk * (at.p(i) + FROM_AXIS));
        // Waves bend rings of any footprint, so they are not averaged.
        let waves = fbm(&noise, at, 3, 0.0, |i, _| locals[i] * Vec3::new(1.6, 0.5, 1.6));
        let fibers = fbm(&noise, at, 3, 60.0, |i, p| Vec3::new(p.x * 60.0, locals[i].y * 3.0, p.z * 60.0));
        let pores = match at.numbers().any(|i| band_limit(PORES, at.footprint[i]) > 0.0) {
            true => values(&noise, at, |i, p| Vec3::new(p.x * PORES, locals[i].y * 4.0, p.z * PORES)),
            false => [0.0; BLOCK],
        };
        let tones = fbm(&noise, at, 2, 1.3, |_, p| p * 1.3);
        for (i, color) in at.numbers().zip(colors) {
            let footprint = at.footprint[i];
            let rings = self.radius(locals[i], waves[i]) / self.ring;
            let ring = rings.floor();
            // The sharp end of a ring is a tenth of it.
            let left = band_limit(2.0 / self.ring, footprint);
            // Years differ.
            let vigor = 0.55 + 0.45 * noise.cell_value(IVec3::new(ring as i32, 0, 0));
            // The mean over the footprint, by its thirds.
            let width = footprint / self.ring;
            let mut profile = 0.0;
            for side in [-1.0, 0.0, 1.0] {
                profile += ring_profile(remainder::<1>(rings - ring + side * width / 3.0));
            }
            let profile = profile / 3.0;
            let late = RING_MEAN * 0.775 + left * (vigor * profile - RING_MEAN * 0.775);
            let share = (1.15 * late + self.grain * 0.16 * fibers[i]).clamp(0.0, 1.0);
            let pores = PORE_MEAN + band_limit(PORES, footprint) * (pore(pores[i]) - PORE_MEAN);
            let tone = 1.0 + 0.25 * tones[i];
            let rgb =
                self.early.rgb().lerp(self.late.rgb(), share) * tone * (1.0 - self.grain * 0.35 * pores);
            *color = opaque(rgb.max(Vec3::ZERO));
        }
    }
}

impl Solid for Wood {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| self.block(at, colors));
    }
}

// Marble: layers that turbulence has folded, after Perlin, "An image synthesizer", 1985.

parameters! {
    /// Marble.
    #[derive(Copy)]
    pub struct Marble {
        /// Veins per unit of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub frequency: f32 = 1.1,
        /// How far turbulence displaces the layers, in veins.
        pub warp: f32 = 1.6,
        /// Colour of the stone.
        pub stone: Color = Color::opaque(0.82, 0.80, 0.76),
        /// Colour of the clouds in it.
        pub cloud: Color = Color::opaque(0.52, 0.54, 0.56),
        /// Colour of the veins.
        pub vein: Color = Color::opaque(0.07, 0.075, 0.085),
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
    }
}

seeded!(Marble);

/// Mean of [`vein`] over a period.
const VEIN_MEAN: f32 = 0.0947;

/// A thin dark line in every period, with soft flanks: `(1 - |sin(pi phase)|)^6`, within 2e-6. No call of the library, so that vectors are
/// made of it.
fn vein(phase: f32) -> f32 {
    // Beyond half of the largest float with halves there are integers only.
    const ROUNDING: f32 = 12_582_912.0;
    let nearest = (phase + ROUNDING) - ROUNDING;
    let x = (phase - nearest).clamp(-0.5, 0.5);
    let square = x * x;
    // Least error of the sine of half a turn by odd powers.
    let sine = x
        * (3.141_592_5
            + square
                * (-5.167_707 + square * (2.550_031_2 + square * (-0.598_044_2 + square * 0.077_218_38))));
    let left = 1.0 - sine.abs();
    let squared = left * left;
    squared * squared * squared
}

impl Marble {
    fn noise(&self) -> Noise {
        Noise::new(self.seed)
    }

    /// The veins of one direction, from places shifted by `shift`; a second set is finer and fainter.
    fn veins(&self, at: &Columns, shift: f32, direction: Vec3, frequency: f32) -> [f32; BLOCK] {
        let (noise, octaves) = (self.noise(), Fractal::octaves(6));
        let place = |_, p| (p + shift) * frequency;
        let folds = fractal_sum(OctaveShape::ABSOLUTE, &noise, at, octaves, frequency, place);
        let slow = fbm(&noise, at, 2, 0.7 * frequency, |_, p| (p + shift) * 0.7 * frequency);
        let mut veins = [0.0; BLOCK];
        for i in at.numbers() {
            // A vein is a sixth of its period, and folding makes periods up to about three times narrower.
            let left = band_limit(6.0 * frequency, at.footprint[i]);
            let phase = direction.dot(at.p(i) + shift) * frequency + self.warp * (folds[i] + 0.7 * slow[i]);
            veins[i] = VEIN_MEAN + left * (vein(phase) - VEIN_MEAN);
        }
        veins
    }

    fn block(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        let (noise, at) = (self.noise(), &Columns::of(at));
        let clouds = fbm(&noise, at, 5, 1.7, |_, p| p * 1.7 + 11.0);
        let coarse = self.veins(at, 0.0, Vec3::new(0.62, 0.55, 0.56), self.frequency);
        let fine = self.veins(at, 31.0, Vec3::new(-0.48, 0.77, 0.42), 2.7 * self.frequency);
        // Veins run in some places and fade out in others.
        let presence = values(&noise, at, |_, p| p * 1.1 - 7.0);
        let crystals = fbm(&noise, at, 2, 70.0, |_, p| p * 70.0);
        for (i, color) in colors.iter_mut().enumerate() {
            let presence = smoothstep(-0.35, 0.4, presence[i]);
            let stone = self.stone.rgb().lerp(self.cloud.rgb(), smoothstep(-0.25, 0.65, clouds[i]));
            let share =
                (0.9 * coarse[i] * (0.35 + 0.65 * presence) + 0.4 * fine[i] * presence).clamp(0.0, 1.0);
            *color = opaque((stone * (1.0 + 0.06 * crystals[i])).lerp(self.vein.rgb(), share));
        }
    }
}

impl Solid for Marble {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| self.block(at, colors));
    }
}

// Granite: grains of feldspar, quartz and mica grown into each other, as the Voronoi cells of scattered points.

parameters! {
    /// Granite.
    #[derive(Copy)]
    pub struct Granite {
        /// Width of a grain, in units of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub grain: f32 = 0.055,
        /// Colour of the feldspar.
        pub feldspar: Color = Color::opaque(0.55, 0.40, 0.33),
        /// Colour of the quartz.
        pub quartz: Color = Color::opaque(0.50, 0.50, 0.49),
        /// Colour of the mica.
        pub mica: Color = Color::opaque(0.035, 0.033, 0.032),
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
    }
}

seeded!(Granite, |granite| {
    Allowed::Positive.check("granite", "grain", &[granite.grain])?;
    let colors = [granite.feldspar.rgb(), granite.quartz.rgb(), granite.mica.rgb()].map(|c| c.to_array());
    Allowed::NotNegative.check("granite", "colour", colors.as_flattened())
});

/// Shares of feldspar and of feldspar with quartz.
const SHARES: [f32; 2] = [0.52, 0.83];

/// Width of the lines that part grains, in grains.
const BORDER: f32 = 0.08;

/// How dark the line between grains is, where it is drawn this wide: nearly as dark in the mean, whatever the width.
fn border(grain: &Cellular, width: f32) -> f32 {
    (1.0 - smoothstep(0.0, width, grain.second - grain.nearest)) * BORDER / width
}

/// Mean of [`border`] over space.
const BORDER_MEAN: f32 = 0.148;

impl Granite {
    /// Of all grains and what parts them.
    fn mean(&self) -> Vec3 {
        let minerals = self.feldspar.rgb() * SHARES[0]
            + self.quartz.rgb() * (SHARES[1] - SHARES[0])
            + self.mica.rgb() * (1.0 - SHARES[1]);
        minerals * (1.0 - 0.28 * BORDER_MEAN)
    }

    /// The grains of one width, from places shifted by `shift`.
    fn grains(&self, at: &Columns, shift: f32, width: f32, seed: u32) -> [Vec3; BLOCK] {
        let mean = self.mean();
        let mut colors = [mean; BLOCK];
        if at.numbers().all(|i| band_limit(1.0 / width, at.footprint[i]) == 0.0) {
            return colors;
        }
        // Grains have crooked borders.
        let noise = Noise::new(seed);
        let crooked =
            [0.0, 19.0, -23.0].map(|axis| values(&noise, at, |_, p| (p + shift) * 2.1 / width + axis));
        let mut places = [Vec3::ZERO; BLOCK];
        for i in at.numbers() {
            let crooked = Vec3::new(crooked[0][i], crooked[1][i], crooked[2][i]);
            places[i] = (at.p(i) + shift) / width + 0.35 * crooked;
        }
        let mut grains = [Cellular::default(); BLOCK];
        cellular_all(seed, &places[at.numbers()], CellularMetric::Euclidean, &mut grains[at.numbers()]);
        for i in at.numbers() {
            let grain = &grains[i];
            let mineral = match grain.id {
                id if id < SHARES[0] => self.feldspar.rgb(),
                id if id < SHARES[1] => self.quartz.rgb(),
                _ => self.mica.rgb(),
            };
            // Brightness differs from grain to grain; thin dark borders part them.
            let shade = 0.78 + 0.44 * remainder::<1>(grain.id * 37.0);
            // Beyond a fiftieth of a grain a footprint widens borders.
            let border = border(grain, BORDER.max(BORDER - 0.02 + at.footprint[i] / width));
            let left = band_limit(1.0 / width, at.footprint[i]);
            colors[i] = mean.lerp(mineral * shade * (1.0 - 0.28 * border), left);
        }
        colors
    }

    fn block(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        let at = &Columns::of(at);
        // Where the fine grains fill in between the coarse ones.
        let frequency = 0.6 / self.grain;
        let noise = Noise::new(self.seed.wrapping_add(3));
        let mut fill = fbm(&noise, at, 2, frequency, |_, p| p * frequency);
        fill.iter_mut().for_each(|fill| *fill = smoothstep(-0.15, 0.25, *fill));
        let coarse = self.grains(at, 0.0, self.grain, self.seed);
        let mut fine = [Vec3::ZERO; BLOCK];
        at.for_some(
            |i| fill[i] > 0.0,
            |some, at| {
                let grains = self.grains(at, 7.7, 0.4 * self.grain, self.seed ^ 0x5bd1_e995);
                some.iter().zip(grains).for_each(|(&i, grain)| fine[i] = grain);
            },
        );
        let cloud = fbm(&noise, at, 3, 2.0, |_, p| p * 2.0 + 5.0);
        for (i, color) in colors.iter_mut().enumerate() {
            *color = opaque(coarse[i].lerp(fine[i], 0.75 * fill[i]) * (1.0 + 0.12 * cloud[i]));
        }
    }
}

impl Solid for Granite {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| self.block(at, colors));
    }
}

// Sedimentary rock: strata of varying thickness and colour, folded and weathered.

parameters! {
    /// Rock.
    #[derive(Copy)]
    pub struct Rock {
        /// Strata per unit of the place.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub frequency: f32 = 7.0,
        /// How far folds lift the strata, in units of the place.
        #[schemars(range(min = 0))]
        pub folding: f32 = 0.12,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
    }
}

seeded!(Rock);

/// Colours of the layers (linear RGB), from which neighbours are blended.
const LAYERS: [Vec3; 6] = [
    Vec3::new(0.36, 0.24, 0.15),
    Vec3::new(0.48, 0.35, 0.23),
    Vec3::new(0.28, 0.155, 0.095),
    Vec3::new(0.53, 0.43, 0.31),
    Vec3::new(0.22, 0.18, 0.15),
    Vec3::new(0.41, 0.26, 0.16),
];

/// Share of a layer in which it changes into the next.
const CHANGE: f32 = 0.2;

impl Rock {
    fn noise(&self) -> Noise {
        Noise::new(self.seed)
    }

    /// The colour of the layer with a number.
    fn layer_color(&self, index: f32) -> Vec3 {
        let pick = self.noise().cell_value(IVec3::new(index as i32, 91, 0));
        LAYERS[(pick * LAYERS.len() as f32) as usize % LAYERS.len()]
    }

    /// The colours of the strata at a block of points.
    pub(super) fn strata(&self, at: &Columns) -> [Vec3; BLOCK] {
        let noise = self.noise();
        let folds = fbm(&noise, at, 4, 1.5, |_, p| p * Vec3::new(1.5, 0.8, 1.5));
        let mut levels = [0.0; BLOCK];
        for i in at.numbers() {
            levels[i] = (at.p(i).y + self.folding * folds[i]) * self.frequency;
        }
        // Thin beds within the layers: noise along the level alone, a little irregular sideways.
        let beds =
            fbm(&noise, at, 3, 4.0 * self.frequency, |i, p| Vec3::new(p.x * 2.0, levels[i] * 4.0, p.z * 2.0));
        let weathering = fbm(&noise, at, 5, 9.0, |_, p| p * 9.0);
        let cracks = fractal_sum(OctaveShape::CREST, &noise, at, Fractal::octaves(3), 6.0, |_, p| {
            p * Vec3::new(6.0, 2.5, 6.0)
        });

        let mean = LAYERS.iter().sum::<Vec3>() / LAYERS.len() as f32;
        let mut colors = [Vec3::ZERO; BLOCK];
        // Points that follow one another mostly lie in one layer.
        let mut known = (f32::NAN, [Vec3::ZERO; 2]);
        for i in at.numbers() {
            // Layers are even inside and change within a fifth of their thickness, and a footprint widens that to both sides.
            let change = (CHANGE + self.frequency * at.footprint[i]).min(1.0);
            let level = levels[i] + 0.35 * beds[i] - 0.5 * (change - CHANGE);
            let index = level.floor();
            if known.0 != index {
                known = (index, [self.layer_color(index), self.layer_color(index + 1.0)]);
            }
            let layer = known.1[0].lerp(known.1[1], smoothstep(1.0 - change, 1.0, level - index));
            // Neighbouring layers are unlike, but some difference remains over several of them.
            let left = band_limit(0.35 * self.frequency, at.footprint[i]);
            let crack = smoothstep(1.25, 1.65, cracks[i]);
            let shade = (1.0 + 0.45 * beds[i] + 0.4 * weathering[i]).max(0.2) * (1.0 - 0.45 * crack);
            colors[i] = mean.lerp(layer, left) * shade;
        }
        colors
    }
}

impl Solid for Rock {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| {
            let strata = self.strata(&Columns::of(at));
            colors.iter_mut().zip(strata).for_each(|(color, rgb)| *color = opaque(rgb));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ring_mean_is_that_of_the_profile() {
        let mean = (0..10_000).map(|i| ring_profile((i as f32 + 0.5) / 10_000.0)).sum::<f32>() / 10_000.0;
        assert!((mean - RING_MEAN).abs() < 0.005, "{mean}");
    }

    /// A mean over points that are spread over much of space.
    fn mean(value: impl Fn(Vec3) -> f32) -> f32 {
        let mut random = fantex_base::Random::new(3);
        let mut along = || 2000.0 * random.unit() as f32 - 1000.0;
        (0..200_000).map(|_| value(Vec3::new(along(), along(), along()))).sum::<f32>() / 200_000.0
    }

    #[test]
    fn pore_mean_is_that_of_the_noise() {
        let noise = Noise::new(7);
        let mean = mean(|p| pore(noise.value(p)));
        assert!((mean - PORE_MEAN).abs() < 0.002, "{mean}");
    }

    #[test]
    fn border_mean_is_that_of_the_grains_and_hardly_changes_with_the_width() {
        let grain = |p: Vec3| crate::noise::cellular(7, p.to_array(), CellularMetric::Euclidean);
        for (width, off) in [(BORDER, 0.002), (0.1, 0.005), (0.2, 0.016)] {
            let mean = mean(|p| border(&grain(p), width));
            assert!((mean - BORDER_MEAN).abs() < off, "{width}: {mean}");
        }
    }

    /// Colours for a footprint are those of its points in the mean: over a plane, and square by square.
    #[test]
    fn a_footprint_shows_the_mean_of_its_points() {
        let solids: [Box<dyn Solid>; 4] = [
            Box::new(Marble::new(1)),
            Box::new(Granite::new(1)),
            Box::new(Rock::new(1)),
            Box::new(Wood::new(1)),
        ];
        let bounds = [
            ("marble", 0.002, [0.009, 0.034]),
            ("granite", 0.01, [0.06, 0.095]),
            ("rock", 0.001, [0.0025, 0.016]),
            ("wood", 0.002, [0.009, 0.029]),
        ];
        const SQUARES: usize = 64;
        const POINTS: usize = 12;
        for ((name, bias, differences), solid) in bounds.into_iter().zip(solids) {
            for (width, difference) in [0.004_f32, 0.012].into_iter().zip(differences) {
                let at = |x: f32, y: f32, footprint: f32| SolidPoint {
                    p: Vec3::new(x * width, y * width, 0.3),
                    n: Vec3::Z,
                    footprint,
                    time: 0.0,
                };
                let mut shown = Vec::new();
                let mut points = Vec::new();
                for square in 0..SQUARES * SQUARES {
                    let [x, y] = [square % SQUARES, square / SQUARES].map(|n| n as f32 - 20.0);
                    shown.push(at(x + 0.5, y + 0.5, width));
                    for point in 0..POINTS * POINTS {
                        let [u, v] =
                            [point % POINTS, point / POINTS].map(|n| (n as f32 + 0.5) / POINTS as f32);
                        points.push(at(x + u, y + v, 0.0));
                    }
                }
                let [shown, points] = [shown, points].map(|at| {
                    let mut colors = vec![[0.0; 4]; at.len()];
                    solid.colors(&at, &mut colors);
                    colors
                });
                let mean = |colors: &[[f32; 4]]| {
                    let sum: glam::DVec4 = colors.iter().map(|&c| glam::Vec4::from(c).as_dvec4()).sum();
                    (sum / colors.len() as f64).as_vec4()
                };
                let squares = shown.iter().zip(points.chunks_exact(POINTS * POINTS));
                let squared: f32 =
                    squares.map(|(&c, all)| (glam::Vec4::from(c) - mean(all)).length_squared()).sum();
                let found = [(mean(&shown) - mean(&points)).length(), (squared / shown.len() as f32).sqrt()];
                eprintln!("{name} {width}: bias {:.4}, difference {:.4}", found[0], found[1]);
                assert!(found[0] < bias && found[1] < difference, "{name} {width}: {found:?}");
            }
        }
    }

    #[test]
    fn veins_are_powers_of_sines() {
        for i in -40_000..40_000 {
            let phase = i as f32 / 1024.0;
            let expected = (1.0 - (std::f64::consts::PI * f64::from(phase)).sin().abs()).powi(6);
            assert!((f64::from(vein(phase)) - expected).abs() < 2e-6, "{phase}");
        }
        for phase in [1e7, -3e8, 1e30, f32::INFINITY] {
            assert!((0.0..=1.0).contains(&vein(phase)) || !phase.is_finite());
        }
    }

    #[test]
    fn vein_mean_is_that_of_the_profile() {
        let mean = (0..10_000).map(|i| vein((i as f32 + 0.5) / 10_000.0)).sum::<f32>() / 10_000.0;
        assert!((mean - VEIN_MEAN).abs() < 0.003, "{mean}");
    }
}
