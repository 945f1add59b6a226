//! The ground of a landscape, from altitude and slope: sand, grass, bare strata, snow.

use fantex_base::parameters;
use glam::Vec3;

use super::{BLOCK, Columns, Rock, Solid, SolidPoint, fbm, fractal_sum, in_blocks, opaque};
use crate::noise::{Fractal, Noise, OctaveShape, band_limit, smoothstep};

parameters! {
    /// Sand, grass, rock and snow.
    #[derive(Copy)]
    pub struct Landscape {
        /// Height up to which there is sand: 0 is the lowest point, 1 the highest.
        pub sand_line: f32 = 0.14,
        /// Height from which snow stays on flat ground: 0 is the lowest point, 1 the highest.
        pub snow_line: f32 = 0.74,
        /// The pattern; added to the seed of the command line.
        pub seed: u32 = 0,
        /// Half of the range of altitudes, in units of the place.
        #[serde(skip)]
        pub half_height: f32 = 1.0,
        /// The altitude in the middle of that range.
        #[serde(skip)]
        pub middle: f32 = 0.0,
    }
}

seeded!(Landscape);

const SAND: Vec3 = Vec3::new(0.47, 0.36, 0.22);
const LUSH_GRASS: Vec3 = Vec3::new(0.075, 0.145, 0.028);
const DRY_GRASS: Vec3 = Vec3::new(0.235, 0.205, 0.07);
const SCREE: Vec3 = Vec3::new(0.25, 0.23, 0.205);
const SNOW: Vec3 = Vec3::new(0.83, 0.87, 0.93);

/// Cells per unit where the ground's own grain begins: what meadows, tufts and stones leave out.
const GRAIN_FREQUENCY: f32 = 720.0;
/// Down to cells of about a hundred-thousandth of a unit: 7 mm on a square kilometre. Single precision holds no finer ones. They lose
/// little height from one to the next, as seen from nearby every scale looks alike.
const GRAIN: Fractal = Fractal { octaves: 8, lacunarity: 2.03, gain: 0.8 };

impl Landscape {
    fn noise(&self) -> Noise {
        Noise::new(self.seed ^ 0x5bd1)
    }

    fn rock(&self) -> Rock {
        Rock { frequency: 4.5 / self.half_height, folding: 0.12 * self.half_height, seed: self.seed }
    }

    /// Colours of grass at a block of points.
    fn grass(&self, at: &Columns) -> [Vec3; BLOCK] {
        let meadows = fbm(&self.noise(), at, 4, 6.0, |_, p| p * 6.0);
        let tufts = fbm(&self.noise(), at, 4, 60.0, |_, p| p * 60.0);
        let mut grass = [Vec3::ZERO; BLOCK];
        for i in at.numbers() {
            let color = LUSH_GRASS.lerp(DRY_GRASS, smoothstep(-0.35, 0.5, meadows[i] + 0.25 * tufts[i]));
            grass[i] = color * (1.0 + 0.75 * tufts[i]).max(0.25);
        }
        grass
    }

    /// Brightness of gravel at a block of points.
    fn stones(&self, at: &Columns) -> [f32; BLOCK] {
        let mut stones = fbm(&self.noise(), at, 3, 90.0, |_, p| p * 90.0);
        stones.iter_mut().for_each(|stones| *stones = (1.0 + 0.4 * *stones).max(0.3));
        stones
    }

    /// The grain of the ground from nearby, -1 to 1 and mostly much less: blades, pebbles, cracks. Zero, and free, where footprints are
    /// wider than its coarsest cells.
    fn grain(&self, at: &Columns) -> [f32; BLOCK] {
        let mut grain = [0.0; BLOCK];
        let shows = |i: usize| band_limit(GRAIN_FREQUENCY, at.footprint[i]) > 0.0;
        at.for_some(shows, |some, at| {
            let place = |_, p| p * GRAIN_FREQUENCY + 7.7;
            let sums = fractal_sum(OctaveShape::PLAIN, &self.noise(), at, GRAIN, GRAIN_FREQUENCY, place);
            some.iter().zip(sums).for_each(|(&i, sum)| grain[i] = sum.clamp(-1.0, 1.0));
        });
        grain
    }

    /// What grows and lies where, at points whose normals have these heights, with a noise that makes borders ragged.
    fn cover(&self, at: &Columns, rise: &[f32; BLOCK], ragged: &[f32; BLOCK]) -> GroundCover {
        let mut cover =
            GroundCover { scree: [0.0; BLOCK], sand: [0.0; BLOCK], soil: [0.0; BLOCK], snow: [0.0; BLOCK] };
        let [_, heights, _] = &at.coordinates;
        for i in at.numbers() {
            let altitude = 0.5 + 0.5 * (heights[i] - self.middle) / self.half_height + 0.09 * ragged[i];
            let flatness = rise[i] + 0.16 * ragged[i];
            cover.scree[i] = smoothstep(0.5, 0.68, altitude);
            cover.sand[i] = 1.0 - smoothstep(self.sand_line - 0.05, self.sand_line + 0.05, altitude);
            cover.soil[i] = smoothstep(0.55, 0.75, flatness);
            cover.snow[i] = smoothstep(self.snow_line - 0.04, self.snow_line + 0.06, altitude)
                * smoothstep(0.42, 0.6, flatness);
        }
        cover
    }

    fn block(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        let mut rise = [0.0; BLOCK];
        rise.iter_mut().zip(at).for_each(|(rise, at)| *rise = at.n.y);
        let at = &Columns::of(at);
        let ragged = fbm(&self.noise(), at, 5, 8.0, |_, p| p * 8.0 + 3.0);
        let GroundCover { scree, sand, soil, snow } = self.cover(at, &rise, &ragged);
        let mut bare = [Vec3::ZERO; BLOCK];
        at.for_some(
            |i| soil[i] < 1.0,
            |some, at| {
                some.iter().zip(self.rock().strata(at)).for_each(|(&i, rock)| bare[i] = rock);
            },
        );
        let mut grass = [Vec3::ZERO; BLOCK];
        at.for_some(
            |i| soil[i] > 0.0 && scree[i] < 1.0,
            |some, at| {
                some.iter().zip(self.grass(at)).for_each(|(&i, color)| grass[i] = color);
            },
        );
        let mut stones = [0.0; BLOCK];
        let has_stones = |i: usize| soil[i] > 0.0 && (scree[i] > 0.0 || sand[i] > 0.0);
        at.for_some(has_stones, |some, at| {
            some.iter().zip(self.stones(at)).for_each(|(&i, brightness)| stones[i] = brightness);
        });
        let grain = self.grain(at);
        for (i, color) in at.numbers().zip(colors) {
            let grained = |share: f32| 1.0 + share * grain[i];
            // From the ground up: grass thins out to scree, sand below, bare rock on slopes, snow on top.
            let scattered = stones[i] * grained(0.6);
            let ground = (grass[i] * grained(0.7))
                .lerp(SCREE * scattered, scree[i])
                .lerp(SAND * stones[i] * grained(0.25), sand[i]);
            let mixed = (bare[i] * grained(0.45))
                .lerp(ground, soil[i])
                .lerp(SNOW * (1.0 + 0.05 * ragged[i]) * grained(0.06), snow[i]);
            // Ceilings are damp.
            *color = opaque(mixed * (1.0 - 0.45 * smoothstep(0.1, 0.7, -rise[i])));
        }
    }
}

/// Shares of what covers the ground, 0 to 1, of a block of points.
struct GroundCover {
    scree: [f32; BLOCK],
    sand: [f32; BLOCK],
    soil: [f32; BLOCK],
    snow: [f32; BLOCK],
}

impl Solid for Landscape {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| self.block(at, colors));
    }
}
