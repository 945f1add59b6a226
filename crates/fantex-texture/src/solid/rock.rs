//! Sedimentary rock: strata of varying thickness and colour, folded and weathered.

use glam::{IVec3, Vec3};

use super::{BLOCK, Notes, Solid, SolidPoint, fbm, opaque};
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

impl Rock {
    /// Colours of at most a block of points.
    fn block(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        let folds = fbm(&self.noise, at, 4, 1.5, |_, p| p * Vec3::new(1.5, 0.8, 1.5));
        let levels: Notes<f32> = at
            .iter()
            .zip(&folds)
            .map(|(at, folds)| (at.p.y + self.folding * folds) * self.frequency)
            .collect();
        // Thin beds within the layers: noise along the level alone, a little irregular sideways.
        let beds = fbm(&self.noise, at, 3, 4.0 * self.frequency, |i, p| {
            Vec3::new(p.x * 2.0, levels[i] * 4.0, p.z * 2.0)
        });
        let weathering = fbm(&self.noise, at, 5, 9.0, |_, p| p * 9.0);
        let cracks_at: Notes<Vec3> = at.iter().map(|at| at.p * Vec3::new(6.0, 2.5, 6.0)).collect();
        let footprints: Notes<f32> = at.iter().map(|at| 6.0 * at.footprint).collect();
        let mut cracks: Notes<f32> = at.iter().map(|_| 0.0).collect();
        self.noise.ridged_all(&cracks_at, Fractal::octaves(3), &footprints, &mut cracks);

        let mean = LAYERS.iter().sum::<Vec3>() / LAYERS.len() as f32;
        for (i, (at, color)) in at.iter().zip(colors).enumerate() {
            // Neighbouring layers are unlike, but some difference remains over several of them.
            let left = band_limit(0.35 * self.frequency, at.footprint);
            let layer = self.layer(levels[i] + 0.35 * beds[i], self.frequency * at.footprint);
            let crack = smoothstep(1.25, 1.65, cracks[i]);
            let shade = (1.0 + 0.45 * beds[i] + 0.4 * weathering[i]).max(0.2) * (1.0 - 0.45 * crack);
            *color = opaque(mean.lerp(layer, left) * shade);
        }
    }
}

impl Solid for Rock {
    fn color(&self, at: &SolidPoint) -> [f32; 4] {
        let mut color = [[0.0; 4]];
        self.block(std::slice::from_ref(at), &mut color);
        color[0]
    }

    fn colors(&self, at: &[SolidPoint], colors: &mut [[f32; 4]]) {
        assert_eq!(at.len(), colors.len(), "one colour for every point");
        at.chunks(BLOCK).zip(colors.chunks_mut(BLOCK)).for_each(|(at, colors)| self.block(at, colors));
    }
}
