//! Mip levels: Williams, "Pyramidal parametrics", 1983, for images of any size.
//!
//! A level has half the texels of the one below it along each axis, rounded down, at least one. Texel `i` of `n` is the
//! mean over the stretch `[i, i+1) * m/n` of the `m` texels below, so each of them counts equally in the level: the mean
//! of the image is that of every level. For even sizes this is the mean of four parents; for odd ones of up to nine.
//!
//! Levels are averaged in linear light and stored so: 16-bit numbers above 8-bit images (a step of 1.5e-5, a twentieth of
//! the darkest step of sRGB bytes), floats above 16-bit and float images.

use glam::Vec4;
use rayon::prelude::*;

use super::taps::{Kernel, TexelSource, resolve, with_texels};
use crate::AlphaUse;
use crate::color::unorm16;
use crate::image::{ColorSpace, Depth, Image, Samples};

/// All levels above `base`, down to a single texel.
pub(crate) fn build_levels(base: &Image, alpha: AlphaUse) -> Vec<Image> {
    let mut levels: Vec<Image> = Vec::new();
    loop {
        let parent = levels.last().unwrap_or(base);
        if parent.width == 1 && parent.height == 1 {
            return levels;
        }
        let is_fixed_point = base.samples.depth() == Depth::U8;
        levels.push(with_texels(parent, alpha, Halve { parent, alpha, is_fixed_point }));
    }
}

/// The texels of a row that one texel of a coarser row covers.
#[derive(Clone, Copy, Debug)]
pub struct Overlap {
    first: usize,
    count: usize,
    weights: [f32; MAX_OVERLAP],
}

const MAX_OVERLAP: usize = 4;

impl Overlap {
    /// What a texel of an axis with `coarse` texels covers of one with `fine` texels, at most three times as many. Weights are parts of
    /// `whole`: `fine` gives means, weights that add up to 1; `coarse` gives the share of each fine texel that is covered.
    pub fn of(texel: u32, fine: u32, coarse: u32, whole: u32) -> Self {
        assert!(fine.div_ceil(3) <= coarse, "{fine} texels under {coarse}");
        // In units of 1 / coarse of a fine texel, everything is an integer: a texel spans `fine` units, a parent `coarse`.
        let (texel, span, parent_span) = (u64::from(texel), u64::from(fine), u64::from(coarse));
        let (start, end) = (texel * span, (texel + 1) * span);
        let first = start / parent_span;
        let last = (end - 1) / parent_span;
        let mut weights = [0.0; MAX_OVERLAP];
        for parent in first..=last {
            let covered = end.min((parent + 1) * parent_span) - start.max(parent * parent_span);
            weights[(parent - first) as usize] = (covered as f64 / f64::from(whole)) as f32;
        }
        Self { first: first as usize, count: (last - first + 1) as usize, weights }
    }

    /// The same with indices that count from a texel on, which does not lie beyond the first one.
    pub fn counted_from(self, texel: u32) -> Self {
        Self { first: self.first - texel as usize, ..self }
    }

    /// The first index.
    pub fn first(&self) -> usize {
        self.first
    }

    /// Their weights.
    pub fn weights(&self) -> &[f32] {
        &self.weights[..self.count]
    }

    /// Indices and weights.
    #[inline(always)]
    pub fn parents(&self) -> impl Iterator<Item = (usize, f32)> {
        (self.first..self.first + self.count).zip(self.weights)
    }
}

/// [`Overlap::of`] every texel of an axis.
pub fn overlaps(fine: u32, coarse: u32, whole: u32) -> Vec<Overlap> {
    (0..coarse).map(|texel| Overlap::of(texel, fine, coarse, whole)).collect()
}

/// The parents of every texel of an axis that is halved from `parents` texels.
pub(crate) fn halved_axis(parents: u32) -> Vec<Overlap> {
    overlaps(parents, (parents / 2).max(1), parents)
}

/// A row of half the length, rounded up: `mean` of two by two texels of two rows, in the order upper left, upper right, lower
/// left, lower right. `beyond` stands for what lies beyond the end of an odd row, and for a lower row that is empty.
pub fn halved_row<T: Copy>(
    upper: &[T],
    lower: &[T],
    beyond: T,
    mean: impl Fn([T; 4]) -> T,
) -> impl Iterator<Item = T> {
    let at = move |row: &[T], x: usize| row.get(x).copied().unwrap_or(beyond);
    (0..upper.len().div_ceil(2))
        .map(move |x| mean([at(upper, 2 * x), at(upper, 2 * x + 1), at(lower, 2 * x), at(lower, 2 * x + 1)]))
}

/// Half the columns and rows of row-major texels, rounded up, each [`halved_row`] in parallel.
pub fn halved_level<T: Copy + Send + Sync>(
    width: usize,
    texels: &[T],
    beyond: T,
    mean: impl Fn([T; 4]) -> T + Sync,
) -> Vec<T> {
    let row = |rows: &[T]| {
        let (upper, lower) = rows.split_at(width);
        halved_row(upper, lower, beyond, &mean).collect::<Vec<T>>()
    };
    texels.par_chunks(2 * width).flat_map_iter(row).collect()
}

struct Halve<'a> {
    parent: &'a Image,
    alpha: AlphaUse,
    is_fixed_point: bool,
}

impl Kernel for Halve<'_> {
    type Output = Image;

    fn run<T: TexelSource>(self, texels: T) -> Image {
        let (columns, rows) = (halved_axis(self.parent.width), halved_axis(self.parent.height));
        let (width, height) = (columns.len(), rows.len());
        let parent_width = self.parent.width as usize;
        let channels = usize::from(self.parent.channels);
        let texel = |row: &Overlap, column: &Overlap| {
            let mut sum = Vec4::ZERO;
            for y in 0..row.count {
                let mut row_sum = Vec4::ZERO;
                let first = (row.first + y) * parent_width + column.first;
                for x in 0..column.count {
                    row_sum += texels.fetch(first + x) * column.weights[x];
                }
                sum += row_sum * row.weights[y];
            }
            stored_channels(resolve(sum, self.alpha), channels)
        };
        let samples = if self.is_fixed_point {
            Samples::U16(filled_rows(width * channels, height, &|row, out| {
                for (out, column) in out.chunks_exact_mut(channels).zip(&columns) {
                    let value = texel(&rows[row], column);
                    out.iter_mut().zip(value).for_each(|(out, value)| *out = unorm16(value));
                }
            }))
        } else {
            Samples::F32(filled_rows(width * channels, height, &|row, out| {
                for (out, column) in out.chunks_exact_mut(channels).zip(&columns) {
                    let value = texel(&rows[row], column);
                    out.copy_from_slice(&value[..channels]);
                }
            }))
        };
        Image {
            width: width as u32,
            height: height as u32,
            channels: self.parent.channels,
            space: ColorSpace::Linear,
            samples,
        }
    }
}

/// RGBA in the order in which an image of so many channels stores it.
pub(crate) fn stored_channels([r, g, b, a]: [f32; 4], channels: usize) -> [f32; 4] {
    if channels == 2 { [r, a, 0.0, 0.0] } else { [r, g, b, a] }
}

/// `count` rows of `len` values each, filled in parallel: `fill` gets a row's number and its values. A kernel is compiled for every
/// kind of texels; what runs it in parallel is not.
pub(crate) fn filled_rows<S: Copy + Default + Send>(
    len: usize,
    count: usize,
    fill: &(dyn Fn(usize, &mut [S]) + Sync),
) -> Vec<S> {
    let mut values = vec![S::default(); len * count];
    values.par_chunks_mut(len).enumerate().for_each(|(row, out)| fill(row, out));
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parent_is_covered_equally() {
        let rounded_up = (1..200).map(|fine: u32| (fine, fine.div_ceil(2)));
        let halved = (1..200).map(|fine| (fine, (fine / 2).max(1)));
        for (fine, coarse) in halved.chain(rounded_up).chain([(20, 12), (12, 8), (4, 4), (65536, 32768)]) {
            let (means, shares) = (overlaps(fine, coarse, fine), overlaps(fine, coarse, coarse));
            assert_eq!(means.len() as u32, coarse);
            let mut total = vec![0.0_f64; fine as usize];
            for (mean, share) in means.iter().zip(&shares) {
                assert!((mean.weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                assert!((share.weights.iter().sum::<f32>() - fine as f32 / coarse as f32).abs() < 1e-6);
                share.parents().for_each(|(parent, weight)| total[parent] += f64::from(weight));
            }
            assert!(total.iter().all(|t| (t - 1.0).abs() < 1e-6), "{fine} to {coarse}: {total:?}");
        }
    }
}
