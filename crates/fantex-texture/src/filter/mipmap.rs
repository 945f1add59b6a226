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

/// The parents of one texel along one axis.
pub(crate) struct Stretch {
    first: usize,
    count: usize,
    weight: [f32; 3],
}

impl Stretch {
    /// Indices and weights.
    #[inline(always)]
    pub(crate) fn parents(&self) -> impl Iterator<Item = (usize, f32)> {
        (self.first..self.first + self.count).zip(self.weight)
    }
}

/// The parents of every texel of an axis that is halved from `parents` texels.
pub(crate) fn stretches(parents: u32) -> Vec<Stretch> {
    let texels = (parents / 2).max(1);
    // In units of 1/texels of a parent, everything is an integer: a texel spans `parents` units, a parent `texels`.
    let (span, parent_span) = (u64::from(parents), u64::from(texels));
    (0..u64::from(texels))
        .map(|texel| {
            let (start, end) = (texel * span, (texel + 1) * span);
            let first = start / parent_span;
            let last = (end - 1) / parent_span;
            let mut weight = [0.0; 3];
            for parent in first..=last {
                let covered = end.min((parent + 1) * parent_span) - start.max(parent * parent_span);
                weight[(parent - first) as usize] = (covered as f64 / span as f64) as f32;
            }
            Stretch { first: first as usize, count: (last - first + 1) as usize, weight }
        })
        .collect()
}

struct Halve<'a> {
    parent: &'a Image,
    alpha: AlphaUse,
    is_fixed_point: bool,
}

impl Kernel for Halve<'_> {
    type Output = Image;

    fn run<T: TexelSource>(self, texels: T) -> Image {
        let (columns, rows) = (stretches(self.parent.width), stretches(self.parent.height));
        let (width, height) = (columns.len(), rows.len());
        let parent_width = self.parent.width as usize;
        let channels = usize::from(self.parent.channels);
        let texel = |row: &Stretch, column: &Stretch| {
            let mut sum = Vec4::ZERO;
            for y in 0..row.count {
                let mut row_sum = Vec4::ZERO;
                let first = (row.first + y) * parent_width + column.first;
                for x in 0..column.count {
                    row_sum += texels.fetch(first + x) * column.weight[x];
                }
                sum += row_sum * row.weight[y];
            }
            stored_channels(resolve(sum, self.alpha), channels)
        };
        let samples = if self.is_fixed_point {
            Samples::U16(fill_rows(width * channels, &rows, |row, out| {
                for (out, column) in out.chunks_exact_mut(channels).zip(&columns) {
                    let value = texel(row, column);
                    out.iter_mut().zip(value).for_each(|(out, value)| *out = unorm16(value));
                }
            }))
        } else {
            Samples::F32(fill_rows(width * channels, &rows, |row, out| {
                for (out, column) in out.chunks_exact_mut(channels).zip(&columns) {
                    let value = texel(row, column);
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

fn fill_rows<S: Copy + Default + Send>(
    row_len: usize,
    rows: &[Stretch],
    fill: impl Fn(&Stretch, &mut [S]) + Sync,
) -> Vec<S>
where
    Stretch: Sync,
{
    let mut samples = vec![S::default(); row_len * rows.len()];
    samples.par_chunks_mut(row_len).zip(rows).for_each(|(out, row)| fill(row, out));
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_cover_every_parent_equally() {
        for parents in 1..200_u32 {
            let stretches = stretches(parents);
            assert_eq!(stretches.len() as u32, (parents / 2).max(1));
            let mut total = vec![0.0_f64; parents as usize];
            for stretch in &stretches {
                let sum: f32 = stretch.weight.iter().sum();
                assert!((sum - 1.0).abs() < 1e-6);
                for i in 0..stretch.count {
                    total[stretch.first + i] += f64::from(stretch.weight[i]);
                }
            }
            let expected = stretches.len() as f64 / f64::from(parents);
            assert!(total.iter().all(|t| (t - expected).abs() < 1e-6), "{parents} parents: {total:?}");
        }
    }
}
