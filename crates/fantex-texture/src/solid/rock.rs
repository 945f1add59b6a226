//! Sedimentary rock: strata of varying thickness and colour, folded and weathered.

use glam::{IVec3, Vec3};

use super::{Solid, SolidPoint, opaque};
use crate::noise::{Fractal, Noise, band_limit, smoothstep};

/// Layers along y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rock {
    /// Main layers per unit of height.
    pub frequency: f32,
    /// How far the layers are displaced from their level, in units of length.
    pub folding: f32,
    noise: Noise,
}

/// Colours of the layers (linear RGB), from which neighbours are blended.
const LAYERS: [Vec3; 6] = [
    Vec3::new(0.36, 0.24, 0.15),
    Vec3::new(0.48, 0.35, 0.23),
    Vec3::new(0.28, 0.155, 0.095),
    Vec3::new(0.53, 0.43, 0.31),
    Vec3::new(0.22, 0.18, 0.15),
    Vec3::new(0.41, 0.26, 0.16),
];

impl Rock {
    /// Brown sandstone.
    pub fn new(seed: u32) -> Self {
        Self { frequency: 7.0, folding: 0.12, noise: Noise::new(seed) }
    }

    /// The colour of the sequence of layers at `level`, averaged over `width`, both in layers.
    fn layer(&self, level: f32, width: f32) -> Vec3 {
        let index = level.floor();
        let color = |index: f32| {
            let pick = self.noise.cell_value(IVec3::new(index as i32, 91, 0));
            LAYERS[(pick * LAYERS.len() as f32) as usize % LAYERS.len()]
        };
        // Layers are even inside and change within a fifth of their thickness, or within the footprint.
        let change = (0.2 + width).min(1.0);
        color(index).lerp(color(index + 1.0), smoothstep(1.0 - change, 1.0, level - index))
    }
}

impl Solid for Rock {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let (p, footprint) = (at.p, at.footprint);
        let folds =
            self.noise.fbm(Vec3::new(p.x * 1.5, p.y * 0.8, p.z * 1.5), Fractal::octaves(4), 1.5 * footprint);
        let level = (p.y + self.folding * folds) * self.frequency;
        // Thin beds within the layers: noise along the level alone, a little irregular sideways.
        let beds_at = Vec3::new(p.x * 2.0, level * 4.0, p.z * 2.0);
        let beds = self.noise.fbm(beds_at, Fractal::octaves(3), 4.0 * self.frequency * footprint);

        let mean = LAYERS.iter().sum::<Vec3>() / LAYERS.len() as f32;
        // Neighbouring layers are unlike, but some difference remains over several of them.
        let left = band_limit(0.35 * self.frequency, footprint);
        let layer = mean.lerp(self.layer(level + 0.35 * beds, self.frequency * footprint), left);
        let weathering = self.noise.fbm(p * 9.0, Fractal::octaves(5), 9.0 * footprint);
        let cracks = self.noise.ridged(p * Vec3::new(6.0, 2.5, 6.0), Fractal::octaves(3), 6.0 * footprint);
        let crack = smoothstep(1.25, 1.65, cracks);
        let shade = (1.0 + 0.45 * beds + 0.4 * weathering).max(0.2) * (1.0 - 0.45 * crack);
        opaque(layer * shade)
    }
}
