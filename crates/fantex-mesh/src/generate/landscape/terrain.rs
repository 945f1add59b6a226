//! The ground of a landscape as a height map: ridged mountains, terraced cliffs, a canyon.

use glam::Vec2;
use rayon::prelude::*;

use crate::generate::noise::{Noise, lerp, smoothstep, spun, turned};

/// Nominal height of the highest peaks above sea level, metres.
const PEAK_HEIGHT: f32 = 230.0;
/// Depth of the canyon's bed below its rim, metres.
const CANYON_DEPTH: f32 = 85.0;

/// Ground heights on a square lattice, looked up bilinearly.
pub(super) struct HeightMap {
    /// Position of the first sample, metres (x and z).
    origin: Vec2,
    step: f32,
    side: usize,
    /// Heights in metres, rows along x.
    heights: Vec<f32>,
}

impl HeightMap {
    /// Samples the ground of a seed on a square of `size` metres around the origin with about `step` metres distance.
    pub(super) fn new(seed: u64, size: f32, step: f32) -> Self {
        let side = (size / step).ceil() as usize + 3;
        let origin = Vec2::splat(-0.5 * step * (side - 1) as f32);
        let ground = Ground::new(seed, size, step);
        let heights = (0..side * side)
            .into_par_iter()
            .with_min_len(1 << 10)
            .map(|i| ground.height(origin + step * Vec2::new((i % side) as f32, (i / side) as f32)))
            .collect();
        Self { origin, step, side, heights }
    }

    /// Height at a point (x, z); points outside the map take the height of its border.
    pub(super) fn at(&self, p: Vec2) -> f32 {
        let q = ((p - self.origin) / self.step).clamp(Vec2::ZERO, Vec2::splat((self.side - 1) as f32 - 1e-3));
        let (x, y) = (q.x as usize, q.y as usize);
        let (fx, fy) = (q.x - x as f32, q.y - y as f32);
        let row = |y: usize| {
            let i = y * self.side + x;
            lerp(self.heights[i], self.heights[i + 1], fx)
        };
        lerp(row(y), row(y + 1), fy)
    }

    /// The lowest and highest sample, metres.
    pub(super) fn range(&self) -> (f32, f32) {
        self.heights.iter().fold((f32::MAX, f32::MIN), |(low, high), &h| (low.min(h), high.max(h)))
    }
}

/// The function behind the map.
struct Ground {
    size: f32,
    /// Octaves of the mountains, as many as the lattice can hold.
    octaves: u32,
    warp: [Noise; 2],
    ridges: Noise,
    massif: Noise,
    hills: Noise,
    cliffs: Noise,
    canyon: Noise,
}

impl Ground {
    fn new(seed: u64, size: f32, step: f32) -> Self {
        let noise = |stream| Noise::new(seed, stream);
        // Ridges of the first octave are about a fifth of the world apart; those of the last span about two samples.
        let octaves = ((size / 6.4 / step).log2().ceil().max(3.0) as u32).min(10);
        Self {
            size,
            octaves,
            warp: [noise(1), noise(2)],
            ridges: noise(3),
            massif: noise(4),
            hills: noise(5),
            cliffs: noise(6),
            canyon: noise(7),
        }
    }

    /// Height in metres at (x, z).
    fn height(&self, p: Vec2) -> f32 {
        let q = p / self.size;
        let bend = Vec2::new(self.warp[0].fbm2(q * 3.0, 3), self.warp[1].fbm2(q * 3.0, 3));
        let warped = q + 0.07 * bend;
        let massif = self.massif(q, warped);
        let mountains = self.ridged(warped * 3.2) * massif;
        let hills = 0.24 + 0.10 * self.hills.fbm2(warped * 5.0, self.octaves.min(5));
        let raw = PEAK_HEIGHT * (hills + mountains);
        let carved = self.carve_canyon(q, raw);
        self.terrace(q, carved)
    }

    /// How much of a mountain stands here, 0..1: higher towards the back (-z), lower towards the front.
    fn massif(&self, q: Vec2, warped: Vec2) -> f32 {
        let along = 0.55 - 0.75 * q.y - 0.35 * q.x.abs();
        smoothstep(0.05, 0.95, along + 0.8 * self.massif.fbm2(warped * 2.2, 3))
    }

    /// Ridged multifractal, about 0..1: sharp crests, detail grows with height (F. K. Musgrave, in D. Ebert et al.,
    /// "Texturing and Modeling", 1994). Every octave is displaced along the slopes of the coarser ones, which draws the
    /// crests out into spurs with gullies between them (G. de Carpentier, "Scape: procedural extensions", 2011).
    fn ridged(&self, mut p: Vec2) -> f32 {
        const PROBE: f32 = 0.05;
        let (mut sum, mut weight, mut amplitude, mut drift) = (0.0, 1.0, 0.5, Vec2::ZERO);
        for _ in 0..self.octaves {
            let crest = |p: Vec2| {
                let crest = 1.0 - (1.6 * self.ridges.at2(p)).abs();
                crest * crest
            };
            let at = p + drift;
            let signal = crest(at);
            let slope = Vec2::new(crest(at + PROBE * Vec2::X), crest(at + PROBE * Vec2::Y)) - signal;
            sum += amplitude * signal * weight;
            weight = (1.5 * signal * weight).clamp(0.14, 1.0);
            // In units of the next octave, whose lattice is turned and twice as fine.
            drift = spun(drift - 0.11 * slope / PROBE * weight) * 2.0;
            amplitude *= 0.5;
            p = turned(p) * 2.0;
        }
        sum * 1.12
    }

    /// A winding canyon with steep walls from left to right.
    fn carve_canyon(&self, q: Vec2, height: f32) -> f32 {
        let course = 0.16 + 0.16 * self.canyon.fbm2(Vec2::new(2.3 * q.x, 0.5), 2);
        let rough = 0.010 * self.canyon.fbm2(q * 16.0, self.octaves.min(4));
        let distance = (q.y - course).abs() + rough;
        let bed = 0.04 * PEAK_HEIGHT + 0.15 * (height - 0.24 * PEAK_HEIGHT).max(0.0);
        let depth = (1.0 - smoothstep(0.016, 0.044, distance)) * CANYON_DEPTH;
        lerp(height, (height - depth).max(bed.min(height)), smoothstep(0.0, 0.08, depth / CANYON_DEPTH))
    }

    /// Steps of varying height, in patches: flat ledges above steep cliffs.
    fn terrace(&self, q: Vec2, height: f32) -> f32 {
        let strength = smoothstep(-0.1, 0.25, self.cliffs.fbm2(q * 3.1, 3));
        let step = 30.0 + 14.0 * self.cliffs.at2(q * 1.7 + 40.0);
        let coarse = terraced(height + 4.0 * self.cliffs.fbm2(q * 9.0, 2), step, 0.36);
        let fine = terraced(coarse, step / 4.3, 0.25);
        lerp(height, fine, 0.9 * strength)
    }
}

/// Moves a height towards the middle of steps; `softness` (0..0.5) is half the share of a step that stays flat.
fn terraced(height: f32, step: f32, softness: f32) -> f32 {
    let (level, within) = ((height / step).floor(), (height / step).fract());
    let within = if within < 0.0 { within + 1.0 } else { within };
    step * (level + lerp(within, smoothstep(softness, 1.0 - softness, within), 0.92))
}
