//! Selectors that may be repeated.
//!
//! A *pattern* says where each of 16 texels lies between two end points, 0..1. With `t` these places less their mean, normalised to
//! length 1, the least squares fit of a channel `x` has the slope `t . x` and leaves `|x - mean|^2 - (t . x)^2`: one dot product per
//! channel ranks a pattern, eight patterns at a time.

use std::f32::consts::TAU;

use super::layout::{Layout, Planes};

/// Patterns at a time.
const LANES: usize = 8;

const RAMPS: usize = 32;

pub(super) struct Patterns {
    /// `t`: `[pattern / LANES][texel][pattern % LANES]`, zeros where all places are equal.
    directions: Vec<[[f32; LANES]; 16]>,
    selectors: Vec<u64>,
    mean_places: Vec<f32>,
    /// One over the length that was normalised, or 0.
    slopes: Vec<f32>,
    /// The last block that has it.
    sources: Vec<Option<u32>>,
    /// Where the next one is remembered.
    next: usize,
}

impl Patterns {
    /// A flat pattern, ramps, and room for at least so many more.
    pub(super) fn new<L: Layout>(remembered: usize) -> Self {
        let count = (1 + RAMPS + remembered).next_multiple_of(LANES);
        let mut patterns = Self {
            directions: vec![[[0.0; LANES]; 16]; count / LANES],
            selectors: vec![u64::MAX; count],
            mean_places: vec![0.0; count],
            slopes: vec![0.0; count],
            sources: vec![None; count],
            next: 1 + RAMPS,
        };
        for (at, places) in std::iter::once([0.0; 16]).chain((0..RAMPS).map(ramp)).enumerate() {
            patterns.put::<L>(at, L::nearest(&places), None);
        }
        patterns
    }

    fn put<L: Layout>(&mut self, at: usize, selectors: u64, source: Option<u32>) {
        let places = L::places(selectors);
        let mean = places.iter().sum::<f32>() / 16.0;
        let length = places.iter().map(|place| (place - mean).powi(2)).sum::<f32>().sqrt();
        let slope = if length > 0.0 { 1.0 / length } else { 0.0 };
        for (direction, place) in self.directions[at / LANES].iter_mut().zip(places) {
            direction[at % LANES] = (place - mean) * slope;
        }
        (self.selectors[at], self.mean_places[at], self.slopes[at]) = (selectors, mean, slope);
        self.sources[at] = source;
    }

    /// Notes the selectors of a block, in the place of the oldest ones.
    pub(super) fn remember<L: Layout>(&mut self, selectors: u64, block: u32) {
        if let Some(at) = self.find(selectors) {
            self.sources[at] = Some(block);
            return;
        }
        self.put::<L>(self.next, selectors, Some(block));
        self.next = if self.next + 1 == self.selectors.len() { 1 + RAMPS } else { self.next + 1 };
    }

    pub(super) fn find(&self, selectors: u64) -> Option<usize> {
        self.selectors.iter().position(|&own| own == selectors)
    }

    pub(super) fn selectors(&self, pattern: usize) -> u64 {
        self.selectors[pattern]
    }

    /// The last block that has it.
    pub(super) fn source(&self, pattern: usize) -> Option<u32> {
        self.sources[pattern]
    }

    /// `t . x` per channel.
    #[inline(always)]
    pub(super) fn dots(&self, pattern: usize, texels: &Planes) -> [f32; 4] {
        let directions = &self.directions[pattern / LANES];
        texels.map(|channel| {
            channel
                .iter()
                .zip(directions)
                .fold(0.0, |dot, (x, direction)| dot + direction[pattern % LANES] * x)
        })
    }

    /// End points by least squares.
    #[inline(always)]
    pub(super) fn ends(&self, pattern: usize, means: [f32; 4], dots: [f32; 4]) -> [[f32; 4]; 2] {
        let (place, slope) = (self.mean_places[pattern], self.slopes[pattern]);
        [0.0, 1.0].map(|end: f32| std::array::from_fn(|c| means[c] + dots[c] * slope * (end - place)))
    }

    /// The two patterns that explain most of the texels, with `t . x`.
    #[inline(always)]
    pub(super) fn best<L: Layout>(&self, texels: &Planes, weights: &[f32; 4]) -> [(usize, [f32; 4]); 2] {
        let mut best = [(f32::NEG_INFINITY, 0, [0.0; 4]); 2];
        for (group, directions) in self.directions.iter().enumerate() {
            let mut dots = [[0.0; LANES]; 4];
            for (i, direction) in directions.iter().enumerate() {
                for c in 0..L::CHANNELS {
                    for lane in 0..LANES {
                        dots[c][lane] += direction[lane] * texels[c][i];
                    }
                }
            }
            let mut explained = [0.0; LANES];
            for c in 0..L::CHANNELS {
                for lane in 0..LANES {
                    explained[lane] += weights[c] * dots[c][lane] * dots[c][lane];
                }
            }
            for (lane, &explained) in explained.iter().enumerate() {
                let is_allowed = !L::MUST_FALL || dots[0][lane] <= 0.0;
                if is_allowed && explained > best[1].0 {
                    best[1] = (explained, LANES * group + lane, dots.map(|dots| dots[lane]));
                    if best[1].0 > best[0].0 {
                        best.swap(0, 1);
                    }
                }
            }
        }
        best.map(|(_, pattern, dots)| (pattern, dots))
    }
}

/// Places that rise evenly from one corner of a block, or side, to the other one.
fn ramp(direction: usize) -> [f32; 16] {
    let (y, x) = (direction as f32 * TAU / RAMPS as f32).sin_cos();
    let reach = 3.0 * (x.abs() + y.abs());
    std::array::from_fn(|i| {
        let [column, row] = [i % 4, i / 4].map(|n| n as f32 - 1.5);
        (0.5 + (column * x + row * y) / reach).clamp(0.0, 1.0)
    })
}
