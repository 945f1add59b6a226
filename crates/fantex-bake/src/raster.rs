//! What is stored of values over a rectangle of texels: fitting to the reconstruction, coverage, filled blocks.

use std::ops::Range;

use fantex_texture::levels::{AlphaScales, Covered, Raster};
use glam::Vec4;

use crate::{Fit, Prefilter};

/// Which values may overshoot how far when they are fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Overshoot {
    /// Over the largest neighbour.
    pub(crate) above: f32,
    /// Under the smallest neighbour, and at most this share of its distance to zero.
    pub(crate) below: f32,
    share_below: f32,
}

impl Overshoot {
    /// Ringing at edges stays under 8 steps of 255; dark texels lose at most a quarter, so that shadows do not crush.
    pub(crate) const COLOR: Self = Self { above: 1.0 / 32.0, below: 1.0 / 32.0, share_below: 0.25 };
    /// Signed values have no dark end.
    pub(crate) const SIGNED: Self = Self { above: 1.0 / 32.0, below: 1.0 / 32.0, share_below: f32::INFINITY };

    /// A value from which a multiple of the second differences is subtracted, along those of both axes that have them. `around`: left, right,
    /// above and below.
    #[inline]
    fn fitted(
        &self,
        strength: f32,
        center: Vec4,
        [left, right, up, down]: [Vec4; 4],
        [across, along]: [bool; 2],
    ) -> Vec4 {
        let mut curvature = Vec4::ZERO;
        if across {
            curvature += left + right - 2.0 * center;
        }
        if along {
            curvature += up + down - 2.0 * center;
        }
        let low = center.min(left).min(right).min(up).min(down);
        let high = center.max(left).max(right).max(up).max(down);
        (center - strength * curvature).clamp(low - self.below(low), high + self.above)
    }

    #[inline]
    fn below(&self, low: Vec4) -> Vec4 {
        let bound = Vec4::splat(self.below);
        if self.share_below.is_finite() { (low * self.share_below).min(bound).max(Vec4::ZERO) } else { bound }
    }
}

/// What is stored of a raster, made a few rows at a time.
pub(crate) struct Fitting<'a> {
    raster: &'a Raster,
    /// The multiple of the second differences that is subtracted.
    strength: Option<f32>,
    /// Per channel.
    overshoots: Vec<Overshoot>,
    /// What the alpha of cut-outs is multiplied by.
    alpha_scales: AlphaScales,
}

impl<'a> Fitting<'a> {
    /// The texel values that reconstruct the function best. Least squares asks for the inverse of the linear spline's
    /// autocorrelation; its local form (to second order) subtracts a multiple of the second differences along both axes: a
    /// twelfth for values at the texel's centre, an eighth for means over the texel, whose own blur is undone as well.
    pub(crate) fn new(
        raster: &'a Raster,
        fit: Fit,
        prefilter: Prefilter,
        overshoot: impl Fn(usize) -> Overshoot,
    ) -> Self {
        let strength = (fit == Fit::Sharp).then(|| prefilter.sharpening());
        Self {
            raster,
            strength,
            overshoots: (0..raster.channels).map(overshoot).collect(),
            alpha_scales: AlphaScales::default(),
        }
    }

    /// The values as they are.
    pub(crate) fn of_values(raster: &'a Raster) -> Self {
        Self { raster, strength: None, overshoots: Vec::new(), alpha_scales: AlphaScales::default() }
    }

    /// The values of a texel, channel by channel.
    fn texel(&self, texel: usize, mut store: impl FnMut(Vec4)) {
        let raster = self.raster;
        let center = raster.texel(texel);
        let mut store = |channel: usize, value: Vec4| {
            let is_coverage = raster.coverage == Some(channel);
            store(if is_coverage { raster.scaled(texel, value, &self.alpha_scales) } else { value });
        };
        let strength = match self.strength {
            Some(strength) if raster.valid[texel] => strength,
            _ => return center.iter().enumerate().for_each(|(channel, &value)| store(channel, value)),
        };
        let [width, height] = raster.extent.map(|n| n as usize);
        let (x, y) = (texel % width, texel / width);
        let left = if x > 0 && raster.valid[texel - 1] { texel - 1 } else { texel };
        let right = if x + 1 < width && raster.valid[texel + 1] { texel + 1 } else { texel };
        let up = if y > 0 && raster.valid[texel - width] { texel - width } else { texel };
        let down = if y + 1 < height && raster.valid[texel + width] { texel + width } else { texel };
        // A one-sided second difference would be a slope; at an edge of the data that axis is left alone.
        let across = left != texel && right != texel;
        let along = up != texel && down != texel;
        let [left, right, up, down] = [left, right, up, down].map(|texel| raster.texel(texel));
        for (channel, overshoot) in self.overshoots.iter().enumerate() {
            let [left, right, up, down] = [left, right, up, down].map(|texel| texel[channel]);
            let around = [left, right, up, down];
            store(channel, overshoot.fitted(strength, center[channel], around, [across, along]));
        }
    }

    /// The values of the texels of a part of a row.
    fn row(&self, y: usize, columns: Range<usize>, values: &mut Vec<Vec4>) {
        let (raster, channels) = (self.raster, self.raster.channels);
        let [width, height] = raster.extent.map(|n| n as usize);
        let is_inside = y > 0 && y + 1 < height && width > 2;
        let first = y * width + columns.start;
        match self.strength {
            None if raster.coverage.is_none() => {
                values.extend_from_slice(&raster.values[first * channels..][..columns.len() * channels]);
            }
            Some(strength) if raster.coverage.is_none() && is_inside => {
                let [above, own, below] = [y - 1, y, y + 1].map(|y| {
                    (
                        &raster.valid[y * width..][..width],
                        &raster.values[y * width * channels..][..width * channels],
                    )
                });
                for x in columns {
                    let is_whole = x > 0
                        && x + 1 < width
                        && above.0[x]
                        && below.0[x]
                        && own.0[x - 1..=x + 1] == [true; 3];
                    if !is_whole {
                        self.texel(y * width + x, |value| values.push(value));
                        continue;
                    }
                    for (channel, overshoot) in self.overshoots.iter().enumerate() {
                        let at = x * channels + channel;
                        let around = [own.1[at - channels], own.1[at + channels], above.1[at], below.1[at]];
                        values.push(overshoot.fitted(strength, own.1[at], around, [true; 2]));
                    }
                }
            }
            _ => {
                (first..first + columns.len()).for_each(|texel| self.texel(texel, |value| values.push(value)))
            }
        }
    }

    /// The alpha of a texel.
    fn alpha(&self, texel: usize, channel: usize) -> f32 {
        let (mut at, mut alpha) = (0, 0.0);
        self.texel(texel, |value| {
            alpha = if at == channel { value.w } else { alpha };
            at += 1;
        });
        alpha
    }

    /// Scales the alpha of cut-outs so that the share of each that is there stays what it is, whatever its holes are beside texels.
    /// `covered` are those shares, where they are known already.
    pub(crate) fn keep_coverage(&mut self, covered: &mut Covered) {
        let raster = self.raster;
        if let (true, Some(channel)) = (raster.has_cut_outs(), raster.coverage) {
            let alpha: Vec<f32> = (0..raster.valid.len()).map(|texel| self.alpha(texel, channel)).collect();
            self.alpha_scales = raster.alpha_scales(&alpha, covered);
        }
    }

    /// Whole rows of blocks, where every texel that a bilinear look-up may read, and the rest of its 4x4 block, has a value: invalid
    /// ones continue their valid neighbours, or take their block's mean. Blocks that nothing reads are zero: `is_read` tells them by their
    /// columns and rows.
    pub(crate) fn rows(&self, rows: Range<usize>, is_read: impl Fn([usize; 2]) -> bool) -> StoredRows {
        let raster = self.raster;
        let width = raster.extent[0] as usize;
        let mut values = Vec::with_capacity(rows.len() * width * raster.channels);
        let mut read = Vec::with_capacity(width / 4 * (rows.len() / 4));
        for y in rows.clone().step_by(4) {
            let first = read.len();
            read.extend((0..width / 4).map(|x| is_read([x, y / 4])));
            let read = &read[first..];
            for y in y..y + 4 {
                let mut column = 0;
                for blocks in read.chunk_by(PartialEq::eq) {
                    let columns = column..column + 4 * blocks.len();
                    column = columns.end;
                    match blocks[0] {
                        true => self.row(y, columns, &mut values),
                        false => {
                            values.resize(values.len() + columns.len() * raster.channels, Vec4::ZERO);
                        }
                    }
                }
            }
            for (x, _) in (0..).step_by(4).zip(read).filter(|(_, is_read)| **is_read) {
                self.fill_block([x, y], (y - rows.start) * width + x, &mut values);
            }
        }
        StoredRows { width, values, read, channels: raster.channels }
    }

    /// Fills the block at texel `at`, whose values begin at texel `first` of `values`.
    fn fill_block(&self, at: [usize; 2], first: usize, values: &mut [Vec4]) {
        let raster = self.raster;
        let [width, height] = raster.extent.map(|n| n as usize);
        let of_block = || (0..16).map(|k| [at[0] + k % 4, at[1] + k / 4]);
        if (at[1]..at[1] + 4).all(|y| raster.valid[y * width + at[0]..][..4] == [true; 4]) {
            return;
        }
        for channel in 0..raster.channels {
            let value =
                |[x, y]: [usize; 2]| (first + (y - at[1]) * width + x - at[0]) * raster.channels + channel;
            let valid = of_block().filter(|[x, y]| raster.valid[y * width + x]);
            let of_valid = mean(valid.map(|at| values[value(at)]));
            for [x, y] in of_block().filter(|[x, y]| !raster.valid[y * width + x]) {
                let near = texels_around(y * width + x, [width, height]).filter(|&texel| raster.valid[texel]);
                let near = near.map(|texel| raster.texel(texel)[channel].with_w(self.alpha(texel, channel)));
                values[value([x, y])] = mean(near).or(of_valid).unwrap_or(Vec4::ZERO);
            }
        }
    }
}

/// Whole rows of blocks as they are stored.
pub(crate) struct StoredRows {
    /// Texels.
    pub(crate) width: usize,
    /// `values[texel * channels + channel]`, row by row.
    pub(crate) values: Vec<Vec4>,
    pub(crate) channels: usize,
    /// Per block of 4x4.
    pub(crate) read: Vec<bool>,
}

/// True where a look-up falls into a block of 4x4 texels or a texel beside it.
pub(crate) fn is_block_read(raster: &Raster, block: [usize; 2]) -> bool {
    let [width, height] = raster.extent.map(|n| n as usize);
    let [x, y] = block.map(|n| 4 * n);
    (y.saturating_sub(1)..(y + 5).min(height)).any(|row| {
        raster.read[row * width + x.saturating_sub(1)..row * width + (x + 5).min(width)].contains(&true)
    })
}

/// A texel and those around it, row by row, of so many columns and rows.
pub(crate) fn texels_around(texel: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (x, y) = (texel % width, texel / width);
    let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
    rows.flat_map(move |row| {
        (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |column| row * width + column)
    })
}

/// The mean of some values; none of none.
pub(crate) fn mean(values: impl Iterator<Item = Vec4>) -> Option<Vec4> {
    let (sum, count) = values.fold((Vec4::ZERO, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

#[cfg(test)]
mod tests {
    use fantex_mesh::AlphaMode;
    use fantex_texture::levels::CutOuts;
    use proptest::prelude::*;

    use super::*;

    fn raster(extent: [u32; 2], value: impl Fn(u32, u32) -> f32) -> Raster {
        let mut raster = Raster::empty(extent, 1, None);
        raster.valid.fill(true);
        raster.read.fill(true);
        for (i, texel) in raster.values.iter_mut().enumerate() {
            *texel = Vec4::splat(value(i as u32 % extent[0], i as u32 / extent[0]));
        }
        raster
    }

    /// What is stored where everything is read.
    fn fitted(raster: &Raster, fit: Fit, prefilter: Prefilter, overshoot: Overshoot) -> Vec<Vec4> {
        Fitting::new(raster, fit, prefilter, |_| overshoot)
            .rows(0..raster.extent[1] as usize, |_| true)
            .values
    }

    fn texels(values: Vec<f32>, extent: [u32; 2]) -> Raster {
        raster(extent, |x, y| values[((y * extent[0] + x) as usize * 7) % values.len()])
    }

    proptest! {
        #[test]
        fn the_fit_overshoots_as_far_as_allowed_and_no_farther(
            values in prop::collection::vec(0f32..1.0, 60..300),
            signed in any::<bool>(),
            point in any::<bool>(),
        ) {
            let raster = texels(values, [16, 12]);
            let overshoot = if signed { Overshoot::SIGNED } else { Overshoot::COLOR };
            let prefilter = if point { Prefilter::Point } else { Prefilter::Box };
            let fitted = fitted(&raster, Fit::Sharp, prefilter, overshoot);
            for y in 0..12usize {
                for x in 0..16usize {
                    let around = [
                        Some((x, y)),
                        (x > 0).then(|| (x - 1, y)),
                        (x < 15).then_some((x + 1, y)),
                        (y > 0).then(|| (x, y - 1)),
                        (y < 11).then_some((x, y + 1)),
                    ];
                    let around = || around.iter().flatten().map(|&(x, y)| raster.values[16 * y + x].x);
                    let low = around().fold(f32::INFINITY, f32::min);
                    let high = around().fold(f32::NEG_INFINITY, f32::max);
                    let below = if signed { 1.0 / 32.0 } else { (0.25 * low).min(1.0 / 32.0) };
                    let found = fitted[16 * y + x].x;
                    prop_assert!(found <= high + 1.0 / 32.0 + 1e-6 && found >= low - below - 1e-6);
                    prop_assert!(signed || found >= 0.0);
                }
            }
        }

        /// How many rows are made at a time does not matter, also for cut-outs.
        #[test]
        fn rows_are_those_of_the_whole(
            values in prop::collection::vec(0f32..1.0, 60..300),
            holes in prop::collection::vec(any::<bool>(), 37..38),
            is_cut_out in any::<bool>(),
        ) {
            let mut raster = texels(values, [16, 24]);
            for texel in 0..raster.valid.len() {
                raster.valid[texel] = holes[texel % 37];
                raster.read[texel] = holes[texel % 37] && texel % 16 < 9;
            }
            raster.coverage = Some(0);
            let mode = if is_cut_out { AlphaMode::Mask(0.5) } else { AlphaMode::Opaque };
            let mut raster = raster.with_cut_outs(&CutOuts::of([mode], true));
            (0..raster.valid.len()).for_each(|texel| raster.set_alpha_mode(texel, mode));
            let mut fitting = Fitting::new(&raster, Fit::Sharp, Prefilter::Box, |_| Overshoot::COLOR);
            fitting.keep_coverage(&mut Covered(vec![Some(0.3)]));
            let rows = |rows| fitting.rows(rows, |block| is_block_read(&raster, block));
            let whole = rows(0..24);
            let parts = [rows(0..4), rows(4..16), rows(16..24)];
            prop_assert_eq!(&whole.values, &parts.iter().flat_map(|p| p.values.clone()).collect::<Vec<_>>());
            prop_assert_eq!(&whole.read, &parts.iter().flat_map(|p| p.read.clone()).collect::<Vec<_>>());
        }

        /// Nothing curved, nothing to correct: constants and slopes stay, also where texels are missing.
        #[test]
        fn the_fit_keeps_slopes(a in -0.02f32..0.02, b in -0.02f32..0.02, hole in 0usize..256) {
            let mut raster = raster([16, 16], |x, y| 0.5 + a * x as f32 + b * y as f32);
            raster.valid[hole] = false;
            for prefilter in [Prefilter::Point, Prefilter::Box] {
                let fitted = fitted(&raster, Fit::Sharp, prefilter, Overshoot::COLOR);
                for (i, (fitted, value)) in fitted.iter().zip(&raster.values).enumerate() {
                    prop_assert!(i == hole || (*fitted - *value).abs().max_element() < 1e-6);
                }
            }
        }

        /// The fit of a wave comes nearer to what bilinear look-ups between the texels should give.
        #[test]
        fn the_fit_sharpens_waves(phase in 0f32..6.3, wavelength in 9f32..40.0) {
            let wave = |x: f32| 0.5 + 0.3 * (std::f32::consts::TAU * x / wavelength + phase).sin();
            let points = raster([64, 4], |x, _| wave(x as f32));
            let fitted = fitted(&points, Fit::Sharp, Prefilter::Point, Overshoot::SIGNED);
            let error = |values: &[Vec4]| -> f32 {
                (8 * 4..8 * 56)
                    .map(|i| {
                        let x = i as f32 / 8.0;
                        let t = x.fract();
                        let [a, b] = [0, 1].map(|k| values[64 + x as usize + k].x);
                        (a * (1.0 - t) + b * t - wave(x)).powi(2)
                    })
                    .sum()
            };
            prop_assert!(error(&fitted) < 0.5 * error(&points.values), "{} {}", error(&fitted), error(&points.values));
        }
    }

    #[test]
    fn other_fits_take_the_values_as_they_are() {
        let raster = raster([8, 8], |x, y| (x * y % 5) as f32);
        for fit in [Fit::Point, Fit::Box] {
            assert_eq!(fitted(&raster, fit, Prefilter::Box, Overshoot::COLOR), raster.values);
        }
    }

    #[test]
    fn blocks_that_are_read_are_filled_and_others_are_zero() {
        let mut raster = raster([16, 4], |x, y| if (x, y) == (2, 0) { 0.25 } else { 0.5 });
        raster.valid.fill(false);
        raster.read.fill(false);
        // Of three texels the middle one is curved. The last of them is read, beside the second block; the third is out of reach.
        for x in 1..=3 {
            raster.valid[x] = true;
        }
        raster.read[3] = true;
        let stored = Fitting::new(&raster, Fit::Sharp, Prefilter::Box, |_| Overshoot::SIGNED)
            .rows(0..4, |block| is_block_read(&raster, block));
        assert_eq!(stored.read, [true, true, false, false]);
        let curved = 0.25 - 0.5 / 8.0;
        for (i, value) in stored.values.iter().enumerate() {
            let expected = match (i % 16, i / 16) {
                // At its own place it is fitted, as far as it may be; beside it the value goes on as it was before.
                (2, 0) => f32::max(curved, 0.25 - 1.0 / 32.0),
                (1 | 3, 0) | (4, 0..=1) | (0, 0..=1) => 0.5,
                (1 | 3, 1) => (0.25 + 0.5) / 2.0,
                (2, 1) => (0.25 + 0.5 + 0.5) / 3.0,
                (0..4, _) => (0.5 + 0.5 + 0.25 - 1.0 / 32.0) / 3.0,
                _ => 0.0,
            };
            assert!((value.x - expected).abs() < 1e-6, "{} {}: {value} {expected}", i % 16, i / 16);
        }
    }
}
