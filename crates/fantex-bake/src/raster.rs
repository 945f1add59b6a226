//! Values of one channel over a rectangle of texels: fitting to the reconstruction, and halving for the levels.

use fantex_texture::filter::{Overlap, overlaps};
use fantex_texture::material::coverage_scale;
use glam::Vec4;

use crate::{Fit, Prefilter};

/// Texels with values and validity, row-major.
#[derive(Clone, Debug, Default)]
pub(crate) struct Raster {
    pub(crate) extent: [u32; 2],
    /// One value per channel and texel: `values[texel * channels + channel]`.
    pub(crate) values: Vec<Vec4>,
    pub(crate) channels: usize,
    /// The channel whose alpha is coverage, if any.
    pub(crate) coverage: Option<usize>,
    /// Where everything is a cut-out of the same threshold.
    pub(crate) cut_out: Option<CutOut>,
    pub(crate) valid: Vec<bool>,
    /// True where a look-up of the texture function falls into the texel.
    pub(crate) read: Vec<bool>,
}

/// A cut-out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CutOut {
    /// Least alpha that is seen, 0..1.
    pub(crate) threshold: f32,
    /// Alpha is the share of a texel that is there.
    pub(crate) has_shares: bool,
}

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

    fn below(&self, low: Vec4) -> Vec4 {
        let bound = Vec4::splat(self.below);
        if self.share_below.is_finite() { (low * self.share_below).min(bound).max(Vec4::ZERO) } else { bound }
    }
}

impl Raster {
    /// The texel values that reconstruct the function best. Least squares asks for the inverse of the linear spline's
    /// autocorrelation; its local form (to second order) subtracts a multiple of the second differences along both axes: a
    /// twelfth for values at the texel's centre, an eighth for means over the texel, whose own blur is undone as well.
    pub(crate) fn fitted(
        &self,
        fit: Fit,
        prefilter: Prefilter,
        overshoot: impl Fn(usize) -> Overshoot,
    ) -> Vec<Vec4> {
        let strength = match (fit, prefilter) {
            (Fit::Point | Fit::Box, _) => return self.values.clone(),
            (Fit::Sharp, Prefilter::Point) => 1.0 / 12.0,
            (Fit::Sharp, Prefilter::Box) => 1.0 / 8.0,
        };
        let [width, height] = self.extent.map(|n| n as usize);
        let mut fitted = Vec::with_capacity(self.values.len());
        let overshoots: Vec<Overshoot> = (0..self.channels).map(overshoot).collect();
        for y in 0..height {
            for x in 0..width {
                let texel = y * width + x;
                let center = self.texel(texel);
                if !self.valid[texel] {
                    fitted.extend_from_slice(center);
                    continue;
                }
                let left = if x > 0 && self.valid[texel - 1] { texel - 1 } else { texel };
                let right = if x + 1 < width && self.valid[texel + 1] { texel + 1 } else { texel };
                let up = if y > 0 && self.valid[texel - width] { texel - width } else { texel };
                let down = if y + 1 < height && self.valid[texel + width] { texel + width } else { texel };
                // A one-sided second difference would be a slope; at an edge of the data that axis is left alone.
                let across = left != texel && right != texel;
                let along = up != texel && down != texel;
                let [left, right, up, down] = [left, right, up, down].map(|texel| self.texel(texel));
                fitted.extend(overshoots.iter().enumerate().map(|(channel, overshoot)| {
                    let center = center[channel];
                    let [left, right, up, down] = [left, right, up, down].map(|texel| texel[channel]);
                    let mut curvature = Vec4::ZERO;
                    if across {
                        curvature += left + right - 2.0 * center;
                    }
                    if along {
                        curvature += up + down - 2.0 * center;
                    }
                    let low = center.min(left).min(right).min(up).min(down);
                    let high = center.max(left).max(right).max(up).max(down);
                    let below = overshoot.below(low);
                    (center - strength * curvature).clamp(low - below, high + overshoot.above)
                }));
            }
        }
        fitted
    }

    fn texel(&self, texel: usize) -> &[Vec4] {
        &self.values[texel * self.channels..][..self.channels]
    }

    /// The next coarser level: each texel is the mean of the valid part of its footprint, exact for any ratio of extents.
    pub(crate) fn halved(&self, extent: [u32; 2]) -> Self {
        let [columns, rows] = [0, 1].map(|axis| overlaps(self.extent[axis], extent[axis], extent[axis]));
        let mut coarse = Self { cut_out: self.cut_out, ..Self::empty(extent, self.channels, self.coverage) };
        let are_halves = self.extent == extent.map(|n| 2 * n);
        for (y, row) in rows.iter().enumerate().take(extent[1] as usize) {
            for (x, column) in columns.iter().enumerate().take(extent[0] as usize) {
                let target = y * extent[0] as usize + x;
                if !(are_halves
                    && self.gather_four(2 * (y * self.extent[0] as usize + x), target, &mut coarse))
                {
                    self.gather(column, row, target, &mut coarse);
                }
            }
        }
        coarse
    }

    /// As [`Raster::gather`] of two by two texels from `first` on, the common case; false where not all are valid or alpha is
    /// coverage.
    fn gather_four(&self, first: usize, target: usize, coarse: &mut Self) -> bool {
        let below = first + self.extent[0] as usize;
        let four = [first, first + 1, below, below + 1];
        if self.coverage.is_some() || !four.iter().all(|&texel| self.valid[texel]) {
            return false;
        }
        let [a, b, c, d] = four.map(|texel| self.texel(texel));
        let values = &mut coarse.values[target * self.channels..][..self.channels];
        for (channel, value) in values.iter_mut().enumerate() {
            *value = (a[channel] + b[channel] + c[channel] + d[channel]) / 4.0;
        }
        coarse.valid[target] = true;
        coarse.read[target] = four.iter().any(|&texel| self.read[texel]);
        true
    }

    fn gather(&self, columns: &Overlap, rows: &Overlap, target: usize, coarse: &mut Self) {
        let values = &mut coarse.values[target * self.channels..(target + 1) * self.channels];
        let mut total = 0.0;
        for (row, row_weight) in rows.parents() {
            for (column, column_weight) in columns.parents() {
                let texel = row * self.extent[0] as usize + column;
                coarse.read[target] |= self.read[texel];
                if self.valid[texel] {
                    let weight = row_weight * column_weight;
                    total += weight;
                    let fine = &self.values[texel * self.channels..(texel + 1) * self.channels];
                    for (channel, (value, &fine)) in values.iter_mut().zip(fine).enumerate() {
                        *value += weight * if self.coverage == Some(channel) { weighted(fine) } else { fine };
                    }
                }
            }
        }
        coarse.valid[target] = total > 0.0;
        if total > 0.0 {
            values.iter_mut().for_each(|v| *v /= total);
            if let Some(channel) = self.coverage {
                values[channel] = unweighted(values[channel]);
            }
        }
    }

    /// Gives every texel that a bilinear look-up may read, and the rest of its 4x4 block, a value: invalid ones continue
    /// their valid neighbours, or take their block's mean. Blocks that nothing reads become zero. `values` as in `fitted`.
    /// Tells, row by row, which blocks are read.
    pub(crate) fn fill_blocks(&self, values: &mut [Vec4]) -> Vec<bool> {
        let [width, height] = self.extent.map(|n| n as usize);
        let mut read = Vec::with_capacity(width / 4 * (height / 4));
        for y in (0..height).step_by(4) {
            for x in (0..width).step_by(4) {
                let texels = (0..16).map(|k| (x + k % 4, y + k / 4));
                read.push(self.is_block_read(x, y));
                if read.last() == Some(&true) {
                    self.fill_block(texels, values);
                } else {
                    for (x, y) in texels {
                        let texel = y * width + x;
                        values[texel * self.channels..(texel + 1) * self.channels].fill(Vec4::ZERO);
                    }
                }
            }
        }
        read
    }

    /// True where a look-up falls into the block or a texel beside it.
    fn is_block_read(&self, x: usize, y: usize) -> bool {
        let [width, height] = self.extent.map(|n| n as usize);
        (y.saturating_sub(1)..(y + 5).min(height)).any(|row| {
            self.read[row * width + x.saturating_sub(1)..row * width + (x + 5).min(width)].contains(&true)
        })
    }

    fn fill_block(&self, texels: impl Iterator<Item = (usize, usize)> + Clone, values: &mut [Vec4]) {
        let [width, height] = self.extent.map(|n| n as usize);
        for channel in 0..self.channels {
            let mut block = Mean::default();
            for (x, y) in texels.clone() {
                if self.valid[y * width + x] {
                    block.add(values[(y * width + x) * self.channels + channel]);
                }
            }
            for (x, y) in texels.clone() {
                if self.valid[y * width + x] {
                    continue;
                }
                let mut near = Mean::default();
                for ny in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                    for nx in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                        if self.valid[ny * width + nx] {
                            let value = (ny * width + nx) * self.channels + channel;
                            near.add(self.values[value].with_w(values[value].w));
                        }
                    }
                }
                values[(y * width + x) * self.channels + channel] =
                    near.value().or(block.value()).unwrap_or(Vec4::ZERO);
            }
        }
    }

    /// Scales the alpha of a cut-out so that the share of it that is there stays what it is, whatever its holes are beside texels.
    /// `values` as in `fitted`; `covered` is that share, if it is known already.
    pub(crate) fn keep_coverage(&self, values: &mut [Vec4], covered: &mut Option<f32>) {
        let (Some(cut_out), Some(channel)) = (self.cut_out, self.coverage) else { return };
        let threshold = cut_out.threshold;
        let width = self.extent[0] as usize;
        let alpha = |texel: usize| values[texel * self.channels + channel].w;
        let shown: Vec<usize> = (0..self.valid.len()).filter(|&t| self.valid[t] && self.read[t]).collect();
        // Between texels, too, where all four are there.
        let is_whole = |texel: usize| {
            texel % width + 1 < width
                && [texel + 1, texel + width, texel + width + 1]
                    .iter()
                    .all(|&t| self.valid.get(t).copied().unwrap_or(false))
        };
        let mut alphas = Vec::new();
        for &texel in &shown {
            if !is_whole(texel) {
                alphas.push(alpha(texel));
                continue;
            }
            for [s, t] in [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]] {
                let row = |first: usize| alpha(first) + (alpha(first + 1) - alpha(first)) * s;
                let (upper, lower) = (row(texel), row(texel + width));
                alphas.push(upper + (lower - upper) * t);
            }
        }
        if alphas.is_empty() {
            return;
        }
        let mean = shown.iter().map(|&texel| alpha(texel)).sum::<f32>() / shown.len() as f32;
        let passed = alphas.iter().filter(|&&a| a >= threshold).count() as f32 / alphas.len() as f32;
        // Where texels resolve the cut-out, its edges are where they are.
        let is_unresolved = cut_out.has_shares && (passed - mean).abs() > RESOLVED;
        let goal = *covered.get_or_insert(if is_unresolved { mean } else { passed });
        if (passed - goal).abs() < 1e-3 {
            return;
        }
        let scale = coverage_scale(alphas, threshold, goal);
        values.iter_mut().skip(channel).step_by(self.channels).for_each(|v| v.w = (v.w * scale).min(1.0));
    }

    pub(crate) fn window(&self, origin: [u32; 2], extent: [u32; 2]) -> Self {
        let Self { channels, coverage, cut_out, .. } = *self;
        let mut window = Self { extent, channels, coverage, cut_out, ..Self::default() };
        for row in origin[1]..origin[1] + extent[1] {
            let start = row as usize * self.extent[0] as usize + origin[0] as usize;
            let end = start + extent[0] as usize;
            window.values.extend_from_slice(&self.values[start * self.channels..end * self.channels]);
            window.valid.extend_from_slice(&self.valid[start..end]);
            window.read.extend_from_slice(&self.read[start..end]);
        }
        window
    }

    pub(crate) fn paste(&mut self, origin: [u32; 2], from: &Self) {
        let width = from.extent[0] as usize;
        for row in 0..from.extent[1] as usize {
            let to = (origin[1] as usize + row) * self.extent[0] as usize + origin[0] as usize;
            let at = row * width;
            self.values[to * self.channels..(to + width) * self.channels]
                .copy_from_slice(&from.values[at * self.channels..(at + width) * self.channels]);
            self.valid[to..to + width].copy_from_slice(&from.valid[at..at + width]);
            self.read[to..to + width].copy_from_slice(&from.read[at..at + width]);
        }
    }

    pub(crate) fn empty(extent: [u32; 2], channels: usize, coverage: Option<usize>) -> Self {
        let texels = extent[0] as usize * extent[1] as usize;
        Self {
            extent,
            values: vec![Vec4::ZERO; texels * channels],
            channels,
            coverage,
            cut_out: None,
            valid: vec![false; texels],
            read: vec![false; texels],
        }
    }
}

/// Colour times alpha, so that transparent texels do not bleed; the trace of weight that is left to them decides where
/// everything is transparent.
fn weighted(v: Vec4) -> Vec4 {
    (v * (v.w + TRANSPARENT_WEIGHT)).with_w(v.w)
}

fn unweighted(v: Vec4) -> Vec4 {
    (v / (v.w + TRANSPARENT_WEIGHT)).with_w(v.w)
}

const TRANSPARENT_WEIGHT: f32 = 1.0 / (1 << 20) as f32;

/// A share that passes the threshold and a mean of alpha that differ by less belong to a cut-out that texels resolve.
const RESOLVED: f32 = 0.05;

#[derive(Default)]
pub(crate) struct Mean {
    sum: Vec4,
    count: f32,
}

impl Mean {
    pub(crate) fn add(&mut self, value: Vec4) {
        self.sum += value;
        self.count += 1.0;
    }

    pub(crate) fn value(&self) -> Option<Vec4> {
        (self.count > 0.0).then(|| self.sum / self.count)
    }
}

#[cfg(test)]
mod tests {
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

    #[test]
    fn transparent_texels_do_not_bleed_into_coarser_levels() {
        let mut cut_out = raster([8, 8], |_, _| 0.0);
        cut_out.coverage = Some(0);
        let (leaf, nothing) = (Vec4::new(0.2, 0.8, 0.1, 1.0), Vec4::new(1.0, 0.0, 1.0, 0.0));
        for (i, texel) in cut_out.values.iter_mut().enumerate() {
            *texel = if i % 2 == 0 { leaf } else { nothing };
        }
        for value in cut_out.halved([4, 4]).values {
            assert!((value - leaf.with_w(0.5)).abs().max_element() < 1e-5, "{value}");
        }
        cut_out.values.fill(nothing);
        for value in cut_out.halved([4, 4]).values {
            assert!((value - nothing).abs().max_element() < 1e-5, "{value}");
        }
    }

    fn mean(raster: &Raster) -> f64 {
        raster.values.iter().map(|v| f64::from(v.x)).sum::<f64>() / raster.values.len() as f64
    }

    /// Multiples of 4, and half of them rounded to a multiple of 4, up or down.
    fn extents() -> impl Strategy<Value = ([u32; 2], [u32; 2])> {
        let side = (1u32..20, any::<bool>()).prop_map(|(n, up)| {
            let half = 2 * n;
            (
                4 * n,
                if half % 4 == 0 {
                    half
                } else if up {
                    half + 2
                } else {
                    (half - 2).max(4)
                },
            )
        });
        [side.clone(), side].prop_map(|[(w, w2), (h, h2)]| ([w, h], [w2, h2]))
    }

    fn texels(values: Vec<f32>, extent: [u32; 2]) -> Raster {
        raster(extent, |x, y| values[((y * extent[0] + x) as usize * 7) % values.len()])
    }

    proptest! {
        #[test]
        fn halving_keeps_the_mean_and_the_range(
            (fine, coarse) in extents(),
            values in prop::collection::vec(0f32..1.0, 100..400),
        ) {
            let raster = texels(values, fine);
            let halved = raster.halved(coarse);
            prop_assert_eq!(halved.extent, coarse);
            prop_assert!((mean(&halved) - mean(&raster)).abs() < 1e-5);
            prop_assert!(halved.valid.iter().chain(&halved.read).all(|&b| b));
            prop_assert!(halved.values.iter().all(|v| (0.0..=1.0 + 1e-6).contains(&v.x)));
        }

        /// Invalid texels count for nothing, however they are spread.
        #[test]
        fn halving_takes_the_mean_of_what_is_valid(
            (fine, coarse) in extents(),
            valid in prop::collection::vec(any::<bool>(), 64..65),
        ) {
            let mut raster = raster(fine, |_, _| 0.375);
            for i in 0..raster.valid.len() {
                if !valid[i * 13 % valid.len()] {
                    raster.valid[i] = false;
                    raster.values[i] = Vec4::splat(f32::NAN);
                }
            }
            let halved = raster.halved(coarse);
            for (value, valid) in halved.values.iter().zip(&halved.valid) {
                let expected = if *valid { 0.375 } else { 0.0 };
                prop_assert!((value.x - expected).abs() < 1e-6);
            }
            prop_assert_eq!(raster.valid.contains(&true), halved.valid.contains(&true));
        }

        #[test]
        fn the_fit_overshoots_as_far_as_allowed_and_no_farther(
            values in prop::collection::vec(0f32..1.0, 60..300),
            signed in any::<bool>(),
            point in any::<bool>(),
        ) {
            let raster = texels(values, [16, 12]);
            let overshoot = if signed { Overshoot::SIGNED } else { Overshoot::COLOR };
            let prefilter = if point { Prefilter::Point } else { Prefilter::Box };
            let fitted = raster.fitted(Fit::Sharp, prefilter, |_| overshoot);
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

        /// Nothing curved, nothing to correct: constants and slopes stay, also where texels are missing.
        #[test]
        fn the_fit_keeps_slopes(a in -0.02f32..0.02, b in -0.02f32..0.02, hole in 0usize..256) {
            let mut raster = raster([16, 16], |x, y| 0.5 + a * x as f32 + b * y as f32);
            raster.valid[hole] = false;
            for prefilter in [Prefilter::Point, Prefilter::Box] {
                let fitted = raster.fitted(Fit::Sharp, prefilter, |_| Overshoot::COLOR);
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
            let fitted = points.fitted(Fit::Sharp, Prefilter::Point, |_| Overshoot::SIGNED);
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
            assert_eq!(raster.fitted(fit, Prefilter::Box, |_| Overshoot::COLOR), raster.values);
        }
    }

    #[test]
    fn blocks_that_are_read_are_filled_and_others_are_zero() {
        let mut raster = raster([12, 4], |_, _| 0.5);
        raster.valid.fill(false);
        raster.read.fill(false);
        // One texel of the first block is read, beside the second block; the third is out of reach.
        (raster.valid[3], raster.read[3]) = (true, true);
        let mut fitted = raster.values.clone();
        fitted[3] = Vec4::splat(0.25);
        raster.fill_blocks(&mut fitted);
        for (i, value) in fitted.iter().enumerate() {
            let expected = match (i % 12, i / 12) {
                (3, 0) => 0.25,
                // Beside the valid texel its value goes on, as it was before it was fitted.
                (2, 0) | (2..=4, 1) | (4, 0) => 0.5,
                (0..4, _) => 0.25,
                _ => 0.0,
            };
            assert_eq!(value.x, expected, "{} {}", i % 12, i / 12);
        }
    }

    #[test]
    fn windows_and_pastes_are_inverse() {
        let whole = raster([16, 8], |x, y| (16 * y + x) as f32);
        let mut copy = Raster::empty([16, 8], 1, None);
        for origin in [[0, 0], [8, 0], [0, 4], [8, 4]] {
            copy.paste(origin, &whole.window(origin, [8, 4]));
        }
        assert_eq!(copy.values, whole.values);
        assert_eq!(copy.valid, whole.valid);
    }
}
