//! Images of another size.

use glam::Vec4;
use rayon::prelude::*;

use crate::filter::{Kernel, TexelSource, catmull_rom_weights, resolve, stored_channels, with_texels};
use crate::{AlphaUse, Image};

impl Image {
    /// The same picture with `width` x `height` texels, in linear light; depth and colour space stay. Along each axis, a
    /// smaller size takes the exact mean over the texel's stretch, a larger one interpolates with the cubic of Catmull and
    /// Rom (edge texels go on outside), which may overshoot. `alpha` says whether colours count by their alpha.
    ///
    /// # Panics
    /// If a side of the new or of the old size is 0.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32, alpha: AlphaUse) -> Self {
        assert!(width > 0 && height > 0 && self.width > 0 && self.height > 0, "an image needs texels");
        if [width, height] == [self.width, self.height] {
            return self.clone();
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
        Self::from_linear(width, height, self.channels, samples).converted(self.samples.depth(), self.space)
    }

    /// As [`Image::resized`], to the powers of two that are nearest to the sides in ratio: 1000 becomes 1024, 720 becomes
    /// 512, 725 becomes 1024.
    ///
    /// # Panics
    /// If a side is 0.
    #[must_use]
    pub fn to_power_of_two(&self, alpha: AlphaUse) -> Self {
        let [width, height] = [self.width, self.height].map(nearest_power_of_two);
        self.resized(width, height, alpha)
    }
}

/// `2^round(log2 n)`: the next lower power `p` as long as `n^2 < 2 p^2`.
fn nearest_power_of_two(n: u32) -> u32 {
    let lower = 1_u64 << n.max(1).ilog2();
    let power = if u64::from(n) * u64::from(n) < 2 * lower * lower { lower } else { 2 * lower };
    u32::try_from(power).unwrap_or(1 << 31)
}

/// What a new texel is made of along one axis.
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

/// Resizes every row.
struct AlongRows<'a> {
    image: &'a Image,
    columns: &'a [OldTexels],
}

impl Kernel for AlongRows<'_> {
    type Output = Vec<Vec4>;

    fn run<T: TexelSource>(self, texels: T) -> Vec<Vec4> {
        let width = self.image.width as usize;
        (0..self.image.height as usize)
            .into_par_iter()
            .flat_map_iter(|row| {
                self.columns.iter().map(move |column| {
                    let first = row * width + column.first;
                    let old = column.weights.iter().enumerate();
                    old.map(|(x, &weight)| texels.fetch(first + x) * weight).sum::<Vec4>()
                })
            })
            .collect()
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

    #[test]
    fn powers_of_two_are_the_nearest_in_ratio() {
        let pairs =
            [(1, 1), (2, 2), (3, 4), (5, 4), (6, 8), (720, 512), (725, 1024), (1000, 1024), (4096, 4096)];
        for (n, power) in pairs {
            assert_eq!(nearest_power_of_two(n), power, "{n}");
        }
        assert_eq!(nearest_power_of_two(u32::MAX), 1 << 31);
    }
}
