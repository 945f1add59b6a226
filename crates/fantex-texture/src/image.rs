//! Images in memory.

use glam::Vec4;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::AlphaUse;
use crate::color::{
    linear_from_srgb, linear_from_srgb8_table, linear_from_srgb16_table, srgb_from_linear, srgb8_from_linear,
    srgb16_from_linear, unorm8, unorm16,
};
use crate::filter::{
    Kernel, TexelSource, catmull_rom_weights, filled_rows, resolve, stored_channels, with_texels,
};

/// How the numbers of a colour channel encode light. Alpha is always linear.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// IEC 61966-2-1 transfer curve.
    Srgb,
    /// Proportional to light (or to whatever the texture means: roughness, a normal's coordinate).
    Linear,
}

/// The samples of an image, row-major from the top, channels interleaved.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 8 bits, 0..255 for 0..1.
    U8(Vec<u8>),
    /// 16 bits, 0..65535 for 0..1.
    U16(Vec<u16>),
    /// Any range.
    F32(Vec<f32>),
}

impl Samples {
    /// Number of samples (texels times channels).
    pub fn len(&self) -> usize {
        match self {
            Samples::U8(values) => values.len(),
            Samples::U16(values) => values.len(),
            Samples::F32(values) => values.len(),
        }
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The width of one sample.
    pub fn depth(&self) -> Depth {
        match self {
            Samples::U8(_) => Depth::U8,
            Samples::U16(_) => Depth::U16,
            Samples::F32(_) => Depth::F32,
        }
    }
}

/// The width of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Depth {
    /// 8-bit fixed point.
    U8,
    /// 16-bit fixed point.
    U16,
    /// 32-bit floating point.
    F32,
}

/// A discrete two-dimensional texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows, row 0 on top.
    pub height: u32,
    /// 1 grey, 2 grey + alpha, 3 RGB, 4 RGBA.
    pub channels: u8,
    /// Encoding of the colour channels.
    pub space: ColorSpace,
    /// `width * height * channels` numbers.
    pub samples: Samples,
}

impl Image {
    /// An image of linear-light floats; `samples` holds `width * height * channels` numbers (1, 2, 3 or 4 channels).
    ///
    /// # Panics
    /// If the count of samples does not fit the size: that is a mistake of the caller, never of a file.
    pub fn from_linear(width: u32, height: u32, channels: u8, samples: Vec<f32>) -> Self {
        let expected = width as usize * height as usize * usize::from(channels);
        assert!((1..=4).contains(&channels), "an image has 1 to 4 channels, not {channels}");
        assert_eq!(samples.len(), expected, "{width} x {height} x {channels} samples are needed");
        Self { width, height, channels, space: ColorSpace::Linear, samples: Samples::F32(samples) }
    }

    /// An image of linear-light RGBA texels with straight alpha.
    ///
    /// # Panics
    /// If there are not `width * height` texels.
    pub fn from_linear_rgba(width: u32, height: u32, texels: &[[f32; 4]]) -> Self {
        Self::from_linear(width, height, 4, texels.as_flattened().to_vec())
    }

    /// As [`Image::from_linear_rgba`], without the alpha.
    ///
    /// # Panics
    /// If there are not `width * height` texels.
    pub fn from_linear_rgb(width: u32, height: u32, texels: &[[f32; 4]]) -> Self {
        Self::from_linear(width, height, 3, texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect())
    }

    /// Whether the last channel is alpha.
    pub fn has_alpha(&self) -> bool {
        self.channels == 2 || self.channels == 4
    }

    /// Bytes of the samples.
    pub fn byte_len(&self) -> usize {
        let bytes = match self.samples.depth() {
            Depth::U8 => 1,
            Depth::U16 => 2,
            Depth::F32 => 4,
        };
        self.samples.len() * bytes
    }

    /// The linear RGBA value of the texel in column `x` and row `y`: grey is spread to r, g and b, missing alpha is 1.
    ///
    /// # Panics
    /// Outside the image.
    pub fn linear_texel(&self, x: u32, y: u32) -> [f32; 4] {
        assert!(x < self.width && y < self.height, "texel {x},{y} of {} x {}", self.width, self.height);
        let channels = usize::from(self.channels);
        let first = (y as usize * self.width as usize + x as usize) * channels;
        let value = |channel: usize| {
            let is_alpha = self.has_alpha() && channel + 1 == channels;
            self.linear_sample(first + channel, is_alpha)
        };
        match channels {
            1 => [value(0), value(0), value(0), 1.0],
            2 => [value(0), value(0), value(0), value(1)],
            3 => [value(0), value(1), value(2), 1.0],
            _ => [value(0), value(1), value(2), value(3)],
        }
    }

    fn linear_sample(&self, index: usize, is_alpha: bool) -> f32 {
        let is_srgb = self.space == ColorSpace::Srgb && !is_alpha;
        match &self.samples {
            Samples::U8(values) if is_srgb => linear_from_srgb8_table()[usize::from(values[index])],
            Samples::U8(values) => f32::from(values[index]) / 255.0,
            Samples::U16(values) if is_srgb => linear_from_srgb16_table()[usize::from(values[index])],
            Samples::U16(values) => f32::from(values[index]) / 65535.0,
            Samples::F32(values) if is_srgb => linear_from_srgb(values[index]),
            Samples::F32(values) => values[index],
        }
    }

    /// The same picture with samples of another width and encoding, through linear light; fixed-point samples are clamped
    /// to `[0,1]` and rounded to nearest.
    pub fn converted(&self, depth: Depth, space: ColorSpace) -> Self {
        if self.samples.depth() == depth && self.space == space {
            return self.clone();
        }
        let is_srgb = |is_alpha: bool| space == ColorSpace::Srgb && !is_alpha;
        let samples =
            match depth {
                Depth::U8 => Samples::U8(self.map_linear(|value, is_alpha| {
                    if is_srgb(is_alpha) { srgb8_from_linear(value) } else { unorm8(value) }
                })),
                Depth::U16 => Samples::U16(self.map_linear(|value, is_alpha| {
                    if is_srgb(is_alpha) { srgb16_from_linear(value) } else { unorm16(value) }
                })),
                Depth::F32 => Samples::F32(self.map_linear(|value, is_alpha| {
                    if is_srgb(is_alpha) { srgb_from_linear(value) } else { value }
                })),
            };
        Self { width: self.width, height: self.height, channels: self.channels, space, samples }
    }

    /// Multiplies the last channel, clamped to `[0,1]`.
    pub(crate) fn scale_alpha(&mut self, scale: f32) {
        let channels = usize::from(self.channels);
        match &mut self.samples {
            Samples::U8(values) => values.iter_mut().skip(channels - 1).step_by(channels).for_each(|a| {
                *a = unorm8(f32::from(*a) / 255.0 * scale);
            }),
            Samples::U16(values) => values.iter_mut().skip(channels - 1).step_by(channels).for_each(|a| {
                *a = unorm16(f32::from(*a) / 65535.0 * scale);
            }),
            Samples::F32(values) => values.iter_mut().skip(channels - 1).step_by(channels).for_each(|a| {
                *a = (*a * scale).clamp(0.0, 1.0);
            }),
        }
    }

    fn map_linear<T>(&self, encode: impl Fn(f32, bool) -> T) -> Vec<T> {
        let channels = usize::from(self.channels);
        (0..self.samples.len())
            .map(|index| {
                let is_alpha = self.has_alpha() && index % channels + 1 == channels;
                encode(self.linear_sample(index, is_alpha), is_alpha)
            })
            .collect()
    }
}

// ---- Images of another size.

impl Image {
    /// The same picture with `width` x `height` texels, in linear light; depth and colour space stay. Along each axis, a
    /// smaller size takes the exact mean over the texel's stretch, a larger one interpolates with the cubic of Catmull and
    /// Rom (edge texels go on outside), which may overshoot. `alpha` says whether colours count by their alpha.
    ///
    /// # Panics
    /// If a side of the new or of the old size is 0.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32, alpha: AlphaUse) -> Self {
        self.resized_as([width, height], alpha, self.samples.depth(), self.space)
    }

    /// As [`Image::resized`], with another depth and colour space: rounded once, to those.
    ///
    /// # Panics
    /// If a side of the new or of the old size is 0.
    #[must_use]
    pub fn resized_as(
        &self,
        [width, height]: [u32; 2],
        alpha: AlphaUse,
        depth: Depth,
        space: ColorSpace,
    ) -> Self {
        assert!(width > 0 && height > 0 && self.width > 0 && self.height > 0, "an image needs texels");
        if [width, height] == [self.width, self.height] {
            return self.converted(depth, space);
        }
        let alpha = if self.has_alpha() { alpha } else { AlphaUse::Independent };
        let (columns, rows) = (taps(self.width, width), taps(self.height, height));
        let texels = with_texels(self, alpha, AlongRows { image: self, columns: &columns });
        let samples = down_columns(&texels, width as usize, &rows)
            .flat_map_iter(|sum| {
                let channels = usize::from(self.channels);
                stored_channels(resolve(sum, alpha), channels).into_iter().take(channels)
            })
            .collect();
        Self::from_linear(width, height, self.channels, samples).converted(depth, space)
    }
}

struct OldTexels {
    first: usize,
    /// One per texel from `first` on; they add up to 1.
    weights: Vec<f32>,
}

fn taps(old: u32, new: u32) -> Vec<OldTexels> {
    (0..new)
        .map(|index| if new < old { mean_of(old, new, index) } else { between(old, new, index) })
        .collect()
}

/// The stretch of a new texel on an axis that shrinks; in units of `1 / new` of an old texel, everything is an integer.
fn mean_of(old: u32, new: u32, index: u32) -> OldTexels {
    let [old, new, index] = [old, new, index].map(u64::from);
    let (start, end) = (index * old, (index + 1) * old);
    let (first, last) = (start / new, (end - 1) / new);
    let weights = (first..=last).map(|texel| {
        let covered = end.min((texel + 1) * new) - start.max(texel * new);
        (covered as f64 / old as f64) as f32
    });
    OldTexels { first: first as usize, weights: weights.collect() }
}

/// The four texels around the centre of a new texel on an axis that grows; those beyond the ends are the end texels.
fn between(old: u32, new: u32, index: u32) -> OldTexels {
    let center = (f64::from(index) + 0.5) * f64::from(old) / f64::from(new) - 0.5;
    let base = center.floor();
    let last = i64::from(old) - 1;
    let clamped = [-1, 0, 1, 2].map(|offset| (base as i64 + offset).clamp(0, last));
    let mut weights = vec![0.0; (clamped[3] - clamped[0] + 1) as usize];
    for (texel, weight) in clamped.into_iter().zip(catmull_rom_weights((center - base) as f32)) {
        weights[(texel - clamped[0]) as usize] += weight;
    }
    OldTexels { first: clamped[0] as usize, weights }
}

struct AlongRows<'a> {
    image: &'a Image,
    columns: &'a [OldTexels],
}

impl Kernel for AlongRows<'_> {
    type Output = Vec<Vec4>;

    fn run<T: TexelSource>(self, texels: T) -> Vec<Vec4> {
        let width = self.image.width as usize;
        filled_rows(self.columns.len(), self.image.height as usize, &|row, sums| {
            for (sum, column) in sums.iter_mut().zip(self.columns) {
                let first = row * width + column.first;
                let old = column.weights.iter().enumerate();
                *sum = old.map(|(x, &weight)| texels.fetch(first + x) * weight).sum();
            }
        })
    }
}

/// Resizes every column of rows of `width` sums.
fn down_columns<'a>(
    sums: &'a [Vec4],
    width: usize,
    rows: &'a [OldTexels],
) -> impl ParallelIterator<Item = Vec4> + 'a {
    (0..rows.len() * width).into_par_iter().map(move |index| {
        let (row, column) = (&rows[index / width], index % width);
        let old = row.weights.iter().enumerate();
        old.map(|(y, &weight)| sums[(row.first + y) * width + column] * weight).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_add_up_to_one() {
        for old in 1..40 {
            for new in 1..90 {
                let taps = taps(old, new);
                assert_eq!(taps.len() as u32, new);
                for taps in taps {
                    assert!(taps.first + taps.weights.len() <= old as usize);
                    assert!((taps.weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                }
            }
        }
    }
}
