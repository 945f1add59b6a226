//! Granite: grains of feldspar, quartz and mica grown into each other, as the Voronoi cells of scattered points.

use glam::Vec3;

use super::{Solid, SolidPoint, opaque};
use crate::noise::{CellularMetric, Fractal, Noise, band_limit, cellular, smoothstep};
use crate::{Allowed, InvalidOption};

/// A rock of coarse grains of several minerals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Granite {
    /// Width of the largest grains, above 0.
    pub grain: f32,
    /// Colour of the feldspar, more than half of the rock (linear RGB).
    pub feldspar: Vec3,
    /// Colour of the quartz, about a third.
    pub quartz: Vec3,
    /// Colour of the mica, the dark rest.
    pub mica: Vec3,
    seed: u32,
}

/// Shares of feldspar and of feldspar with quartz.
const SHARES: [f32; 2] = [0.52, 0.83];

impl Granite {
    /// Grey-pink granite.
    pub fn new(seed: u32) -> Self {
        Self {
            grain: 0.055,
            feldspar: Vec3::new(0.55, 0.40, 0.33),
            quartz: Vec3::new(0.50, 0.50, 0.49),
            mica: Vec3::new(0.035, 0.033, 0.032),
            seed,
        }
    }

    /// Checks the options.
    ///
    /// # Errors
    ///
    /// A number is out of its range.
    pub fn validate(&self) -> Result<(), InvalidOption> {
        Allowed::Positive.check("granite", "grain", &[self.grain])?;
        let colors = [self.feldspar, self.quartz, self.mica].map(|c| c.to_array());
        Allowed::NotNegative.check("granite", "colour", colors.as_flattened())
    }

    fn mean(&self) -> Vec3 {
        self.feldspar * SHARES[0] + self.quartz * (SHARES[1] - SHARES[0]) + self.mica * (1.0 - SHARES[1])
    }

    /// The minerals of one size of grains.
    fn grains(&self, p: Vec3, width: f32, footprint: f32, seed: u32) -> Vec3 {
        let left = band_limit(0.7 / width, footprint);
        if left == 0.0 {
            return self.mean();
        }
        // Grains have crooked borders.
        let noise = Noise::new(seed);
        let crooked = Vec3::new(
            noise.value(p * 2.1 / width),
            noise.value(p * 2.1 / width + 19.0),
            noise.value(p * 2.1 / width - 23.0),
        );
        let grain = cellular(seed, (p / width + 0.35 * crooked).to_array(), CellularMetric::Euclidean);
        let mineral = match grain.id {
            id if id < SHARES[0] => self.feldspar,
            id if id < SHARES[1] => self.quartz,
            _ => self.mica,
        };
        // Brightness differs from grain to grain; thin dark borders part them.
        let shade = 0.78 + 0.44 * (grain.id * 37.0).fract();
        let blur = (footprint / width).max(0.02);
        let border = smoothstep(0.0, 0.06 + blur, grain.second - grain.nearest);
        self.mean().lerp(mineral * shade * (0.72 + 0.28 * border), left)
    }
}

impl Solid for Granite {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let (p, footprint) = (at.p, at.footprint);
        let coarse = self.grains(p, self.grain, footprint, self.seed);
        let fine = self.grains(p + 7.7, 0.4 * self.grain, footprint, self.seed ^ 0x5bd1_e995);
        // Where the fine grains fill in between the coarse ones.
        let frequency = 0.6 / self.grain;
        let noise = Noise::new(self.seed.wrapping_add(3));
        let fill =
            smoothstep(-0.15, 0.25, noise.fbm(p * frequency, Fractal::octaves(2), frequency * footprint));
        let cloud = 1.0 + 0.12 * noise.fbm(p * 2.0 + 5.0, Fractal::octaves(3), 2.0 * footprint);
        opaque(coarse.lerp(fine, 0.75 * fill) * cloud)
    }
}
