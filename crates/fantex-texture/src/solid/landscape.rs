//! The ground of a landscape, from altitude and slope: sand, grass, bare strata, snow.

use glam::Vec3;

use super::{Rock, Solid, SolidPoint, opaque};
use crate::noise::{Fractal, Noise, smoothstep};

/// y is up; altitude runs from `-half_height` to `half_height`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landscape {
    /// Half of the range of altitudes.
    pub half_height: f32,
    /// Altitude (0 = lowest, 1 = highest) below which the ground is sand.
    pub sand_line: f32,
    /// Altitude (0 = lowest, 1 = highest) above which snow stays on flat ground.
    pub snow_line: f32,
    rock: Rock,
    noise: Noise,
}

const SAND: Vec3 = Vec3::new(0.47, 0.36, 0.22);
const LUSH_GRASS: Vec3 = Vec3::new(0.075, 0.145, 0.028);
const DRY_GRASS: Vec3 = Vec3::new(0.235, 0.205, 0.07);
const SCREE: Vec3 = Vec3::new(0.25, 0.23, 0.205);
const SNOW: Vec3 = Vec3::new(0.83, 0.87, 0.93);

impl Landscape {
    /// Temperate mountains. `half_height` is in units of the bounding sphere's radius.
    pub fn new(seed: u32, half_height: f32) -> Self {
        let mut rock = Rock::new(seed);
        rock.frequency = 4.5 / half_height;
        rock.folding = 0.12 * half_height;
        Self { half_height, sand_line: 0.14, snow_line: 0.74, rock, noise: Noise::new(seed ^ 0x5bd1) }
    }

    fn grass(&self, p: Vec3, footprint: f32) -> Vec3 {
        let meadows = self.noise.fbm(p * 6.0, Fractal::octaves(4), 6.0 * footprint);
        let tufts = self.noise.fbm(p * 60.0, Fractal::octaves(4), 60.0 * footprint);
        let color = LUSH_GRASS.lerp(DRY_GRASS, smoothstep(-0.35, 0.5, meadows + 0.25 * tufts));
        color * (1.0 + 0.75 * tufts).max(0.25)
    }

    /// Brightness of gravel.
    fn stones(&self, p: Vec3, footprint: f32) -> f32 {
        let stones = self.noise.fbm(p * 90.0, Fractal::octaves(3), 90.0 * footprint);
        (1.0 + 0.4 * stones).max(0.3)
    }
}

impl Solid for Landscape {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let (p, footprint) = (at.p, at.footprint);
        // Borders between the kinds of ground are ragged.
        let ragged = self.noise.fbm(p * 8.0 + 3.0, Fractal::octaves(5), 8.0 * footprint);
        let altitude = 0.5 + 0.5 * p.y / self.half_height + 0.09 * ragged;
        let flatness = at.n.y + 0.16 * ragged;

        // From the ground up: grass thins out to scree, sand below, bare rock on slopes, snow on top. Only what shows is
        // worked out.
        let scree = smoothstep(0.5, 0.68, altitude);
        let sand = 1.0 - smoothstep(self.sand_line - 0.05, self.sand_line + 0.05, altitude);
        let soil = smoothstep(0.55, 0.75, flatness);
        let snow = smoothstep(self.snow_line - 0.04, self.snow_line + 0.06, altitude)
            * smoothstep(0.42, 0.6, flatness);
        let mut color = Vec3::ZERO;
        if soil < 1.0 {
            color = Vec3::from_slice(&self.rock.color(at)[..3]);
        }
        if soil > 0.0 {
            let mut ground = if scree < 1.0 { self.grass(p, footprint) } else { Vec3::ZERO };
            if scree > 0.0 || sand > 0.0 {
                let stones = self.stones(p, footprint);
                ground = ground.lerp(SCREE * stones, scree).lerp(SAND * stones, sand);
            }
            color = color.lerp(ground, soil);
        }
        color = color.lerp(SNOW * (1.0 + 0.05 * ragged), snow);
        // Ceilings are damp.
        color *= 1.0 - 0.45 * smoothstep(0.1, 0.7, -at.n.y);
        opaque(color)
    }
}
