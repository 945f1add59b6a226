//! Values over a rectangle of texels, of which only some show a surface: halving for coarser levels, and cut-outs that stay as
//! dense at all of them.
//!
//! Bakes and painting make the coarser levels of tiles by these.

use fantex_mesh::AlphaMode;
use glam::Vec4;

use crate::filter::{Overlap, TRANSPARENT_WEIGHT};
use crate::material::coverage_scale;

/// Texels with values and validity, row-major.
#[derive(Clone, Debug, Default)]
pub struct Raster {
    /// Columns and rows.
    pub extent: [u32; 2],
    /// One **linear** value per channel and texel: `values[texel * channels + channel]`.
    pub values: Vec<Vec4>,
    /// Values per texel.
    pub channels: usize,
    /// The channel whose alpha is coverage, if any.
    pub coverage: Option<usize>,
    /// Where everything is a cut-out of the same threshold.
    pub cut_out: Option<CutOut>,
    /// True where the texel shows a surface.
    pub valid: Vec<bool>,
    /// True where a look-up of the texture function falls into the texel.
    pub read: Vec<bool>,
}

/// A cut-out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutOut {
    /// Least alpha that is seen, 0..1.
    pub threshold: f32,
    /// Alpha is the share of a texel that is there.
    pub has_shares: bool,
}

impl CutOut {
    /// What all materials of a part of a surface are, by their modes; none where they are not all cut-outs of the same threshold, or
    /// where there are none.
    pub fn of_all(modes: impl IntoIterator<Item = AlphaMode>, has_shares: bool) -> Option<Self> {
        let mut modes = modes.into_iter();
        let first = modes.next()?;
        let AlphaMode::Mask(threshold) = first else { return None };
        modes.all(|mode| mode == first).then_some(Self { threshold, has_shares })
    }
}

/// A share that passes the threshold and a mean of alpha that differ by less belong to a cut-out that texels resolve.
const RESOLVED: f32 = 0.05;

impl Raster {
    /// The values of a texel, channel by channel.
    pub fn texel(&self, texel: usize) -> &[Vec4] {
        &self.values[texel * self.channels..][..self.channels]
    }

    /// The next coarser level: each texel is the mean of the valid part of its footprint, exact for any ratio of extents.
    pub fn halved(&self, extent: [u32; 2]) -> Self {
        self.halved_part([0; 2], [self.extent, extent], [0; 2], extent)
    }

    /// A part of the next coarser level, from texel `first` on. This one holds the texels of the finer level from `origin` on, at least
    /// those below that part. `levels`: the extents of the finer and the coarser level.
    pub fn halved_part(
        &self,
        origin: [u32; 2],
        levels: [[u32; 2]; 2],
        first: [u32; 2],
        extent: [u32; 2],
    ) -> Self {
        let [fine, coarse] = levels;
        let [columns, rows] = [0, 1].map(|k| -> Vec<Overlap> {
            (first[k]..first[k] + extent[k])
                .map(|texel| Overlap::of(texel, fine[k], coarse[k], coarse[k]).counted_from(origin[k]))
                .collect()
        });
        let mut part = Self { cut_out: self.cut_out, ..Self::empty(extent, self.channels, self.coverage) };
        let are_halves = fine == coarse.map(|n| 2 * n);
        let mut target = 0;
        for row in &rows {
            for column in &columns {
                let first = row.first() * self.extent[0] as usize + column.first();
                if !(are_halves && self.gather_four(first, target, &mut part)) {
                    self.gather(column, row, target, &mut part);
                }
                target += 1;
            }
        }
        part
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

    /// What the alpha of a cut-out is to be multiplied by (and capped at 1), so that the share of it that is there stays what it is,
    /// whatever its holes are beside texels; none where it may stay, and where there is no cut-out. `alpha`: that of each texel, as it
    /// would be stored. `covered` is the share that is there, if it is known already; else it is taken from here.
    pub fn alpha_scale(&self, alpha: &[f32], covered: &mut Option<f32>) -> Option<f32> {
        let cut_out = self.cut_out?;
        let threshold = cut_out.threshold;
        let width = self.extent[0] as usize;
        let shown: Vec<usize> =
            (0..self.valid.len()).filter(|&texel| self.valid[texel] && self.read[texel]).collect();
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
                alphas.push(alpha[texel]);
                continue;
            }
            for [s, t] in [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]] {
                let row = |first: usize| alpha[first] + (alpha[first + 1] - alpha[first]) * s;
                let (upper, lower) = (row(texel), row(texel + width));
                alphas.push(upper + (lower - upper) * t);
            }
        }
        if alphas.is_empty() {
            return None;
        }
        let mean = shown.iter().map(|&texel| alpha[texel]).sum::<f32>() / shown.len() as f32;
        let passed = alphas.iter().filter(|&&a| a >= threshold).count() as f32 / alphas.len() as f32;
        // Where texels resolve the cut-out, its edges are where they are.
        let is_unresolved = cut_out.has_shares && (passed - mean).abs() > RESOLVED;
        let goal = *covered.get_or_insert(if is_unresolved { mean } else { passed });
        ((passed - goal).abs() >= 1e-3).then(|| coverage_scale(alphas, threshold, goal))
    }

    /// A rectangle of it.
    pub fn window(&self, origin: [u32; 2], extent: [u32; 2]) -> Self {
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

    /// Puts another raster of as many channels there.
    pub fn paste(&mut self, origin: [u32; 2], from: &Self) {
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

    /// Nothing is valid or read; all values are zero.
    pub fn empty(extent: [u32; 2], channels: usize, coverage: Option<usize>) -> Self {
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
    }

    /// Whatever is halved at a time, the level is the same.
    #[test]
    fn parts_are_those_of_the_whole_level() {
        for (fine, coarse) in [([24, 16], [12, 8]), ([20, 12], [12, 8])] {
            let mut whole = raster(fine, |x, y| ((7 * x + 13 * y) % 11) as f32 / 11.0);
            whole.valid[3] = false;
            whole.coverage = Some(0);
            let halved = whole.halved(coarse);
            for (first, extent) in [([0, 0], [4, 4]), ([4, 0], [8, 8]), ([5, 3], [2, 5]), ([0, 0], coarse)] {
                let low = [0, 1].map(|k| first[k] * fine[k] / coarse[k]);
                let high = [0, 1].map(|k| ((first[k] + extent[k]) * fine[k]).div_ceil(coarse[k]));
                let window = whole.window(low, [high[0] - low[0], high[1] - low[1]]);
                let part = window.halved_part(low, [fine, coarse], first, extent);
                let expected = halved.window(first, extent);
                assert_eq!(part.values, expected.values, "{fine:?} {first:?}");
                assert_eq!((part.valid, part.read), (expected.valid, expected.read), "{fine:?} {first:?}");
            }
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

    #[test]
    fn cut_outs_are_those_of_all_materials() {
        use AlphaMode::{Blend, Mask, Opaque};
        let of = |modes: &[AlphaMode]| CutOut::of_all(modes.iter().copied(), false).map(|cut| cut.threshold);
        assert_eq!(of(&[Mask(0.5), Mask(0.5)]), Some(0.5));
        assert_eq!(of(&[Mask(0.3)]), Some(0.3));
        for modes in [&[Mask(0.5), Mask(0.3)][..], &[Mask(0.5), Opaque], &[Blend], &[]] {
            assert_eq!(of(modes), None, "{modes:?}");
        }
    }
}
