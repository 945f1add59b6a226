//! The ground of a landscape, from altitude and slope: sand, grass, bare strata, snow.

use fantex_base::parameters;
use glam::Vec3;

use super::{BLOCK, Notes, Rock, Solid, SolidPoint, fbm, fractal_sum, in_blocks, opaque};
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
    fn grass(&self, at: &[SolidPoint]) -> Notes<Vec3> {
        let meadows = fbm(&self.noise(), at, 4, 6.0, |_, p| p * 6.0);
        let tufts = fbm(&self.noise(), at, 4, 60.0, |_, p| p * 60.0);
        let color = |(meadows, tufts): (f32, f32)| {
            let color = LUSH_GRASS.lerp(DRY_GRASS, smoothstep(-0.35, 0.5, meadows + 0.25 * tufts));
            color * (1.0 + 0.75 * tufts).max(0.25)
        };
        meadows.into_iter().zip(tufts).map(color).collect()
    }

    /// Brightness of gravel at a block of points.
    fn stones(&self, at: &[SolidPoint]) -> Notes<f32> {
        let stones = fbm(&self.noise(), at, 3, 90.0, |_, p| p * 90.0);
        stones.into_iter().map(|stones| (1.0 + 0.4 * stones).max(0.3)).collect()
    }

    /// The grain of the ground from nearby, -1 to 1 and mostly much less: blades, pebbles, cracks. Zero, and free, where footprints are
    /// wider than its coarsest cells.
    fn grain(&self, at: &[SolidPoint]) -> [f32; BLOCK] {
        let mut grain = [0.0; BLOCK];
        let shows = |i: usize| band_limit(GRAIN_FREQUENCY, at[i].footprint) > 0.0;
        for_some(at, shows, |some, at| {
            let place = |_, p| p * GRAIN_FREQUENCY + 7.7;
            let sums = fractal_sum(OctaveShape::PLAIN, &self.noise(), at, GRAIN, GRAIN_FREQUENCY, place);
            some.iter().zip(sums).for_each(|(&i, sum)| grain[i] = sum.clamp(-1.0, 1.0));
        });
        grain
    }

    /// What grows and lies where, at a point with a noise that makes borders ragged.
    fn cover(&self, at: &SolidPoint, ragged: f32) -> GroundCover {
        let altitude = 0.5 + 0.5 * (at.p.y - self.middle) / self.half_height + 0.09 * ragged;
        let flatness = at.n.y + 0.16 * ragged;
        GroundCover {
            scree: smoothstep(0.5, 0.68, altitude),
            sand: 1.0 - smoothstep(self.sand_line - 0.05, self.sand_line + 0.05, altitude),
            soil: smoothstep(0.55, 0.75, flatness),
            snow: smoothstep(self.snow_line - 0.04, self.snow_line + 0.06, altitude)
                * smoothstep(0.42, 0.6, flatness),
        }
    }

    fn block(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        let ragged = fbm(&self.noise(), at, 5, 8.0, |_, p| p * 8.0 + 3.0);
        let covers: Notes<GroundCover> =
            at.iter().zip(&ragged).map(|(at, &ragged)| self.cover(at, ragged)).collect();
        let mut bare = [[0.0; 4]; BLOCK];
        for_some(
            at,
            |i| covers[i].soil < 1.0,
            |some, at| {
                let mut rock = [[0.0; 4]; BLOCK];
                self.rock().colors(at, &mut rock[..at.len()]);
                some.iter().zip(rock).for_each(|(&i, rock)| bare[i] = rock);
            },
        );
        let mut grass = [Vec3::ZERO; BLOCK];
        for_some(
            at,
            |i| covers[i].soil > 0.0 && covers[i].scree < 1.0,
            |some, at| {
                some.iter().zip(self.grass(at)).for_each(|(&i, color)| grass[i] = color);
            },
        );
        let mut stones = [0.0; BLOCK];
        let has_stones = |i: usize| covers[i].soil > 0.0 && (covers[i].scree > 0.0 || covers[i].sand > 0.0);
        for_some(at, has_stones, |some, at| {
            some.iter().zip(self.stones(at)).for_each(|(&i, brightness)| stones[i] = brightness);
        });
        let grain = self.grain(at);
        for (i, (at, color)) in at.iter().zip(colors).enumerate() {
            let grained = |share: f32| 1.0 + share * grain[i];
            // From the ground up: grass thins out to scree, sand below, bare rock on slopes, snow on top.
            let GroundCover { scree, sand, soil, snow } = covers[i];
            let scattered = stones[i] * grained(0.6);
            let ground = (grass[i] * grained(0.7))
                .lerp(SCREE * scattered, scree)
                .lerp(SAND * stones[i] * grained(0.25), sand);
            let mixed = (Vec3::from_slice(&bare[i][..3]) * grained(0.45))
                .lerp(ground, soil)
                .lerp(SNOW * (1.0 + 0.05 * ragged[i]) * grained(0.06), snow);
            // Ceilings are damp.
            *color = opaque(mixed * (1.0 - 0.45 * smoothstep(0.1, 0.7, -at.n.y)));
        }
    }
}

/// Shares of what covers the ground, 0 to 1.
struct GroundCover {
    scree: f32,
    sand: f32,
    soil: f32,
    snow: f32,
}

/// Calls `then` with the numbers of the points that are `wanted` and with these points, if there are any.
fn for_some(at: &[SolidPoint], wanted: impl Fn(usize) -> bool, then: impl FnOnce(&[usize], &[SolidPoint])) {
    let some: Notes<usize> = (0..at.len()).filter(|&i| wanted(i)).collect();
    if !some.is_empty() {
        let points: Notes<SolidPoint> = some.iter().map(|&i| at[i]).collect();
        then(&some, &points);
    }
}

impl Solid for Landscape {
    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        in_blocks(at, colors, |at, colors| self.block(at, colors));
    }
}
