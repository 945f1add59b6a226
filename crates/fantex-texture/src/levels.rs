//! Values over a rectangle of texels, of which only some show a surface: halving for coarser levels, and cut-outs that stay as
//! dense at all of them, each by itself where materials of a tile differ.
//!
//! Bakes and painting make the coarser levels of tiles by these.

use fantex_mesh::AlphaMode;
use glam::Vec4;

use crate::filter::{Overlap, TRANSPARENT_WEIGHT};
use crate::material::coverage_scale;
pub use crate::tile_mean::{LargestCutOut, TexelMean};

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
    cut_outs: CutOuts,
    /// Per texel, what its material makes of alpha, see [`CutOuts::class`]; empty where nothing is cut out.
    classes: Vec<u8>,
    /// True where the texel shows a surface.
    pub valid: Vec<bool>,
    /// True where a look-up of the texture function falls into the texel.
    pub read: Vec<bool>,
}

/// The cut-outs among the materials of a part of a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CutOuts {
    /// Least alphas that are seen, 0..1, ascending: one for each cut-out.
    thresholds: Vec<f32>,
    has_opaque: bool,
    has_blended: bool,
    /// Alpha is the share of a texel that is there.
    has_shares: bool,
}

/// Cut-outs of a tile that are told apart; those of higher thresholds hold the mean of alpha.
const MAX_CUT_OUTS: usize = 16;

/// The class of texels whose alpha is ignored: any scale of it will do.
const OPAQUE: u8 = 254;

/// The class of texels whose alpha stays as it is.
const UNSCALED: u8 = 255;

impl CutOuts {
    /// What the materials of a part of a surface are, by their modes. `has_shares`: alpha is the share of a texel that is there.
    pub fn of(modes: impl IntoIterator<Item = AlphaMode>, has_shares: bool) -> Self {
        let mut cut_outs = Self { has_shares, ..Self::default() };
        for mode in modes {
            match mode {
                AlphaMode::Opaque => cut_outs.has_opaque = true,
                AlphaMode::Blend => cut_outs.has_blended = true,
                AlphaMode::Mask(threshold) => {
                    if cut_outs.place(threshold).is_none() {
                        cut_outs.thresholds.push(threshold);
                    }
                }
            }
        }
        cut_outs.thresholds.sort_unstable_by(f32::total_cmp);
        cut_outs.thresholds.truncate(MAX_CUT_OUTS);
        cut_outs
    }

    /// True where nothing is cut out.
    pub fn is_empty(&self) -> bool {
        self.thresholds.is_empty()
    }

    fn place(&self, threshold: f32) -> Option<usize> {
        self.thresholds.iter().position(|known| known.total_cmp(&threshold).is_eq())
    }

    /// The number of a material's cut-out, or [`OPAQUE`] or [`UNSCALED`].
    fn class(&self, mode: AlphaMode) -> u8 {
        match mode {
            AlphaMode::Opaque => OPAQUE,
            AlphaMode::Blend => UNSCALED,
            AlphaMode::Mask(threshold) => self.place(threshold).map_or(UNSCALED, |place| place as u8),
        }
    }
}

/// The share of each cut-out of a tile that is there, where it is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Covered(pub Vec<Option<f32>>);

impl Covered {
    /// The means of what is known of parts of a tile.
    pub fn mean(parts: &[Self]) -> Self {
        let count = parts.iter().map(|part| part.0.len()).max().unwrap_or(0);
        let mean = |cut_out: usize| {
            let known: Vec<f32> =
                parts.iter().filter_map(|part| part.0.get(cut_out).copied().flatten()).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f32>() / known.len() as f32)
        };
        Self((0..count).map(mean).collect())
    }
}

/// What the alpha of each cut-out is multiplied by at a level, where it does not stay.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlphaScales(Vec<Option<f32>>);

/// A share that passes the threshold and a mean of alpha that differ by less belong to a cut-out that texels resolve.
const RESOLVED: f32 = 0.05;

impl Raster {
    /// The values of a texel, channel by channel.
    #[inline]
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
        let mut part = Self::empty(extent, self.channels, self.coverage).with_cut_outs(&self.cut_outs);
        let are_halves = fine == coarse.map(|n| 2 * n);
        let mut target = 0;
        for row in &rows {
            for column in &columns {
                let first = row.first() * self.extent[0] as usize + column.first();
                let is_done = match are_halves {
                    true => self.gather_four(first, target, &mut part),
                    false => self.gather_whole(column, row, target, &mut part),
                };
                if !is_done {
                    self.gather(column, row, target, &mut part);
                }
                target += 1;
            }
        }
        part
    }

    /// As [`Raster::gather`] of two by two texels from `first` on, the common case; false where only some are valid or alpha is
    /// coverage.
    fn gather_four(&self, first: usize, target: usize, coarse: &mut Self) -> bool {
        let below = first + self.extent[0] as usize;
        let four = [first, first + 1, below, below + 1];
        let valid = four.map(|texel| self.valid[texel]);
        if self.coverage.is_some() || (valid.contains(&false) && valid.contains(&true)) {
            return false;
        }
        coarse.read[target] = four.iter().any(|&texel| self.read[texel]);
        if valid == [false; 4] {
            return true;
        }
        let [a, b, c, d] = four.map(|texel| self.texel(texel));
        let values = &mut coarse.values[target * self.channels..][..self.channels];
        for (channel, value) in values.iter_mut().enumerate() {
            *value = (a[channel] + b[channel] + c[channel] + d[channel]) / 4.0;
        }
        coarse.valid[target] = true;
        true
    }

    /// As [`Raster::gather`] of any number of texels, in the same order; false where only some are valid or alpha is coverage.
    fn gather_whole(&self, columns: &Overlap, rows: &Overlap, target: usize, coarse: &mut Self) -> bool {
        if self.coverage.is_some() {
            return false;
        }
        let (width, channels, across) = (self.extent[0] as usize, self.channels, columns.weights());
        let first = rows.first() * width + columns.first();
        let (mut is_whole, mut is_empty, mut is_read, mut total) = (true, true, false, 0.0);
        for (row, row_weight) in rows.weights().iter().enumerate() {
            let start = first + row * width;
            let [valid, read] = [&self.valid, &self.read].map(|of| &of[start..start + across.len()]);
            for ((valid, read), column_weight) in valid.iter().zip(read).zip(across) {
                is_whole &= valid;
                is_empty &= !valid;
                is_read |= read;
                total += row_weight * column_weight;
            }
        }
        if is_empty {
            coarse.read[target] = is_read;
        }
        if !is_whole {
            return is_empty;
        }
        let values = &mut coarse.values[target * channels..][..channels];
        for (channel, value) in values.iter_mut().enumerate() {
            let mut sum = Vec4::ZERO;
            for (row, row_weight) in rows.weights().iter().enumerate() {
                let start = (first + row * width) * channels + channel;
                for (column, column_weight) in across.iter().enumerate() {
                    sum += row_weight * column_weight * self.values[start + column * channels];
                }
            }
            *value = sum / total;
        }
        (coarse.valid[target], coarse.read[target]) = (true, is_read);
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
            if let Some(class) = coarse.classes.get_mut(target) {
                *class = self.most_of(columns, rows);
            }
        }
    }

    /// The class of most of the valid part of a footprint; of equal parts that of the first.
    fn most_of(&self, columns: &Overlap, rows: &Overlap) -> u8 {
        let width = self.extent[0] as usize;
        let mut parts: [(u8, f32); MAX_CUT_OUTS + 2] = [(UNSCALED, 0.0); MAX_CUT_OUTS + 2];
        let mut count = 0;
        for (row, row_weight) in rows.parents() {
            for (column, column_weight) in columns.parents() {
                let texel = row * width + column;
                if !self.valid[texel] {
                    continue;
                }
                let class = self.classes[texel];
                let known = parts[..count].iter().position(|part| part.0 == class);
                let place = known.unwrap_or(count);
                count = count.max(place + 1);
                parts[place] = (class, parts[place].1 + row_weight * column_weight);
            }
        }
        let most = |best: (u8, f32), part: &(u8, f32)| if part.1 > best.1 { *part } else { best };
        parts[..count].iter().fold((UNSCALED, 0.0), most).0
    }

    /// The same with materials whose cut-outs are told apart; see [`Raster::set_alpha_mode`].
    #[must_use]
    pub fn with_cut_outs(mut self, cut_outs: &CutOuts) -> Self {
        self.classes = if cut_outs.is_empty() { Vec::new() } else { vec![UNSCALED; self.valid.len()] };
        self.cut_outs.clone_from(cut_outs);
        self
    }

    /// Whether anything is cut out.
    pub fn has_cut_outs(&self) -> bool {
        !self.cut_outs.is_empty()
    }

    /// Says what a texel's material makes of alpha.
    pub fn set_alpha_mode(&mut self, texel: usize, mode: AlphaMode) {
        if let Some(class) = self.classes.get_mut(texel) {
            *class = self.cut_outs.class(mode);
        }
    }

    /// What the alpha of each cut-out is to be multiplied by, so that the share of it that is there stays what it is, whatever its holes
    /// are beside texels. `alpha`: that of each texel, as it would be stored. `covered` are the shares that are there, where they are known
    /// already; else they are taken from here.
    pub fn alpha_scales(&self, alpha: &[f32], covered: &mut Covered) -> AlphaScales {
        let thresholds = &self.cut_outs.thresholds;
        covered.0.resize(thresholds.len(), None);
        let cut_outs = thresholds.iter().zip(&mut covered.0).enumerate();
        AlphaScales(
            cut_outs
                .map(|(i, (&threshold, covered))| self.alpha_scale(i, threshold, alpha, covered))
                .collect(),
        )
    }

    /// The value of a texel with its alpha scaled, and capped at 1.
    #[inline]
    pub fn scaled(&self, texel: usize, value: Vec4, scales: &AlphaScales) -> Vec4 {
        let scale = self.cut_out_of(texel).and_then(|cut_out| scales.0.get(cut_out).copied().flatten());
        scale.map_or(value, |scale| value.with_w((value.w * scale).min(1.0)))
    }

    /// The cut-out whose scale a texel takes. Opaque texels take one, so that what is beside them reads no other scale than its own.
    fn cut_out_of(&self, texel: usize) -> Option<usize> {
        match *self.classes.get(texel)? {
            UNSCALED => None,
            OPAQUE => Some(0),
            cut_out => Some(usize::from(cut_out)),
        }
    }

    fn alpha_scale(
        &self,
        cut_out: usize,
        threshold: f32,
        alpha: &[f32],
        covered: &mut Option<f32>,
    ) -> Option<f32> {
        let width = self.extent[0] as usize;
        let is_shown = |&texel: &usize| {
            self.valid[texel] && self.read[texel] && usize::from(self.classes[texel]) == cut_out
        };
        let shown: Vec<usize> = (0..self.valid.len()).filter(is_shown).collect();
        // Between texels, too, where all four are there.
        let is_there =
            |&texel: &usize| self.valid.get(texel) == Some(&true) && self.cut_out_of(texel) == Some(cut_out);
        let is_whole = |texel: usize| {
            texel % width + 1 < width && [texel + 1, texel + width, texel + width + 1].iter().all(is_there)
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
        let is_unresolved = self.cut_outs.has_shares && (passed - mean).abs() > RESOLVED;
        let goal = *covered.get_or_insert(if is_unresolved { mean } else { passed });
        ((passed - goal).abs() >= 1e-3).then(|| coverage_scale(alphas, threshold, goal))
    }

    /// A rectangle of it.
    pub fn window(&self, origin: [u32; 2], extent: [u32; 2]) -> Self {
        let Self { channels, coverage, .. } = *self;
        let cut_outs = self.cut_outs.clone();
        let mut window = Self { extent, channels, coverage, cut_outs, ..Self::default() };
        for row in origin[1]..origin[1] + extent[1] {
            let start = row as usize * self.extent[0] as usize + origin[0] as usize;
            let end = start + extent[0] as usize;
            window.values.extend_from_slice(&self.values[start * self.channels..end * self.channels]);
            window.valid.extend_from_slice(&self.valid[start..end]);
            window.read.extend_from_slice(&self.read[start..end]);
            window.classes.extend_from_slice(self.classes.get(start..end).unwrap_or_default());
        }
        window
    }

    /// Puts another raster of as many channels and the same cut-outs there.
    pub fn paste(&mut self, origin: [u32; 2], from: &Self) {
        let width = from.extent[0] as usize;
        for row in 0..from.extent[1] as usize {
            let to = (origin[1] as usize + row) * self.extent[0] as usize + origin[0] as usize;
            let at = row * width;
            self.values[to * self.channels..(to + width) * self.channels]
                .copy_from_slice(&from.values[at * self.channels..(at + width) * self.channels]);
            self.valid[to..to + width].copy_from_slice(&from.valid[at..at + width]);
            self.read[to..to + width].copy_from_slice(&from.read[at..at + width]);
            if let (Some(to), Some(from)) =
                (self.classes.get_mut(to..to + width), from.classes.get(at..at + width))
            {
                to.copy_from_slice(from);
            }
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
            cut_outs: CutOuts::default(),
            classes: Vec::new(),
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
    fn whole_footprints_have_the_means_of_those_with_gaps() {
        let (fine, coarse) = ([20, 12], [12, 8]);
        let mut raster = Raster::empty(fine, 2, None);
        raster.valid.fill(true);
        for (i, value) in raster.values.iter_mut().enumerate() {
            *value = Vec4::new(i as f32, 0.1 * i as f32, (i * i % 97) as f32, 1.0);
        }
        raster.read[37] = true;
        let axis = |k: usize| crate::filter::overlaps(fine[k], coarse[k], coarse[k]);
        let [mut whole, mut any] = [0; 2].map(|_| Raster::empty(coarse, 2, None));
        let mut target = 0;
        for row in axis(1) {
            for column in axis(0) {
                assert!(raster.gather_whole(&column, &row, target, &mut whole));
                raster.gather(&column, &row, target, &mut any);
                target += 1;
            }
        }
        assert_eq!(whole.values, any.values);
        assert_eq!((whole.valid, whole.read), (any.valid, any.read));
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
        let of = |modes: &[AlphaMode]| CutOuts::of(modes.iter().copied(), false);
        assert_eq!(of(&[Mask(0.5), Mask(0.3), Mask(0.5)]).thresholds, [0.3, 0.5]);
        assert_eq!(of(&[Mask(0.5), Opaque]).thresholds, [0.5]);
        assert_eq!(of(&[Mask(0.5), Mask(0.5)]), of(&[Mask(0.5)]));
        assert_ne!(of(&[Mask(0.5), Opaque]), of(&[Mask(0.5)]), "opaque parts would be cut out");
        assert!([&[Blend][..], &[Opaque], &[]].iter().all(|modes| of(modes).is_empty()));
        let many: Vec<AlphaMode> = (0..100).map(|i| Mask(i as f32 / 100.0)).collect();
        let all = of(&many);
        assert_eq!(all.thresholds.len(), MAX_CUT_OUTS);
        assert_eq!([all.class(many[3]), all.class(many[99])], [3, UNSCALED]);
    }

    /// Each cut-out keeps its own share, at every level: columns of one threshold beside columns of another, beside opaque and blended ones.
    #[test]
    fn each_cut_out_keeps_its_share() {
        use AlphaMode::{Blend, Mask, Opaque};
        let modes = [Mask(0.3), Opaque, Mask(0.8), Blend];
        let mode = |texel: usize, side: usize| modes[texel % side * 4 / side];
        let hash = |x: u32, y: u32| {
            let mixed = x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77);
            (mixed ^ mixed >> 15).wrapping_mul(0x2C1B_3C6D) >> 16
        };
        let mut level = raster([256, 256], |x, y| f32::from(u8::from(hash(x, y) % 100 < 70)));
        level.coverage = Some(0);
        level = level.with_cut_outs(&CutOuts::of(modes, false));
        (0..level.valid.len()).for_each(|texel| level.set_alpha_mode(texel, mode(texel, 256)));
        let mut covered = Covered::default();
        for side in [256, 128, 64, 32] {
            if side < 256 {
                level = level.halved([side as u32; 2]);
            }
            let alpha: Vec<f32> = level.values.iter().map(|value| value.w).collect();
            let scales = level.alpha_scales(&alpha, &mut covered);
            let scaled = |texel: usize| level.scaled(texel, level.values[texel], &scales).w;
            for (cut_out, threshold) in [0.3, 0.8].into_iter().enumerate() {
                let is_own = |&texel: &usize| {
                    [0, 1, side, side + 1].iter().all(|next| mode(texel + next, side) == Mask(threshold))
                };
                let (mut there, mut all) = (0.0, 0.0);
                for texel in (0..side * (side - 1) - 1).filter(is_own) {
                    let [a, b, c, d] = [0, 1, side, side + 1].map(|next| scaled(texel + next));
                    for [x, y] in [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]] {
                        let (upper, lower) = (a + (b - a) * x, c + (d - c) * x);
                        there += f32::from(u8::from(upper + (lower - upper) * y >= threshold));
                        all += 1.0;
                    }
                }
                let (share, expected) = (there / all, covered.0[cut_out].unwrap());
                assert!((share - expected).abs() < 0.06, "{threshold} at {side}: {share}, not {expected}");
            }
            let blended = (0..alpha.len()).filter(|&texel| mode(texel, side) == Blend);
            blended.for_each(|t| assert_eq!(level.scaled(t, level.values[t], &scales), level.values[t]));
        }
    }
}
