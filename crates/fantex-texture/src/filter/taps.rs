//! Wrapped texel indices with weights, along one axis and as tensor products.
//!
//! Texel `i` of an axis with `n` texels has its centre at the coordinate `(i + 1/2) / n`.

use glam::{Vec2, Vec4};

use crate::color::{linear_from_srgb, linear_from_srgb8_table, linear_from_srgb16_table, unit_from_u8_table};
use crate::image::{ColorSpace, Image, Samples};
use crate::{AlphaUse, Wrap};

/// The largest integer not above `x` (a library call without SSE4.1); saturates, NaN gives 0.
#[inline(always)]
pub(super) fn floor(x: f32) -> i32 {
    let truncated = x as i32;
    truncated.saturating_sub(i32::from(x < truncated as f32))
}

/// The coordinate folded into `[0,1]` as far as the wrap mode repeats.
#[inline(always)]
pub(super) fn fold(coordinate: f32, wrap: Wrap) -> f32 {
    match wrap {
        Wrap::Clamp | Wrap::Border => coordinate,
        Wrap::Repeat => {
            // Rounded to the nearest integer by adding what leaves no bit for fractions.
            const NO_FRACTIONS: f32 = 12_582_912.0;
            let rest = coordinate - ((coordinate + NO_FRACTIONS) - NO_FRACTIONS);
            if rest < 0.0 { rest + 1.0 } else { rest }
        }
        Wrap::Mirror => {
            let period = coordinate - 2.0 * floor(0.5 * coordinate) as f32;
            1.0 - (1.0 - period).abs()
        }
    }
}

/// The position, in texels, of a coordinate, moved by whole periods to the image's neighbourhood, where floats are precise.
#[inline(always)]
pub(super) fn recenter(coordinate: f32, size: u32, wrap: Wrap) -> f32 {
    let texels = size as f32;
    match wrap {
        Wrap::Repeat => (coordinate - floor(coordinate) as f32) * texels,
        Wrap::Mirror => (coordinate - 2.0 * floor(0.5 * coordinate) as f32) * texels,
        // Further outside, everything in reach of a filter is the same.
        Wrap::Clamp | Wrap::Border => (coordinate * texels).clamp(-MARGIN_TEXELS, texels + MARGIN_TEXELS),
    }
    .clamp(-MARGIN_TEXELS, 2.0 * texels + MARGIN_TEXELS)
}

/// More than the half extent of any filter on one level.
pub(super) const MARGIN_TEXELS: f32 = 4096.0;

/// The texel that stands at position `index` of an endless row; `None` is transparent black.
#[inline(always)]
pub(crate) fn wrap_index(index: i32, size: u32, wrap: Wrap) -> Option<usize> {
    let size = size as i32;
    if (0..size).contains(&index) {
        return Some(index as usize);
    }
    match wrap {
        Wrap::Clamp => Some(index.clamp(0, size - 1) as usize),
        Wrap::Border => None,
        Wrap::Repeat => Some(index.rem_euclid(size) as usize),
        Wrap::Mirror => {
            let period = i64::from(index).rem_euclid(2 * i64::from(size));
            Some(period.min(2 * i64::from(size) - 1 - period) as usize)
        }
    }
}

/// `N` texels along one axis and their weights. Texels outside a border have weight 0 and some valid index.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taps<const N: usize> {
    pub(super) index: [usize; N],
    pub(super) weight: [f32; N],
}

impl<const N: usize> Taps<N> {
    #[inline(always)]
    pub(crate) fn pairs(self) -> impl Iterator<Item = (usize, f32)> {
        self.index.into_iter().zip(self.weight)
    }
}

/// The taps around a coordinate, for algorithms that are the same for several reconstructions.
pub(crate) trait Reconstruction {
    fn at(coordinate: f32, size: u32, wrap: Wrap) -> Self;
}

impl Reconstruction for Taps<1> {
    #[inline(always)]
    fn at(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        // Folding may round up to exactly 1, which is one texel too far.
        let position = fold(coordinate, wrap) * size as f32;
        let index = floor(position);
        let is_outside = wrap == Wrap::Border && !(0..size as i32).contains(&index);
        Self {
            index: [index.clamp(0, size as i32 - 1) as usize],
            weight: [if is_outside { 0.0 } else { 1.0 }],
        }
    }
}

impl Reconstruction for Taps<2> {
    #[inline(always)]
    fn at(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        let last = size as i32 - 1;
        let position = fold(coordinate, wrap) * size as f32 - 0.5;
        match wrap {
            Wrap::Clamp | Wrap::Mirror => {
                // Beyond the middle of an edge texel, both modes continue with that texel.
                let position = position.clamp(0.0, last as f32);
                let first = position as i32;
                let share = position - first as f32;
                Self { index: [first as usize, (first + 1).min(last) as usize], weight: [1.0 - share, share] }
            }
            Wrap::Repeat => {
                let first = floor(position);
                let share = position - first as f32;
                let second = if first < 0 || first >= last { 0 } else { first + 1 };
                let first = if first < 0 { last } else { first.min(last) };
                Self { index: [first as usize, second as usize], weight: [1.0 - share, share] }
            }
            Wrap::Border => {
                let first = floor(position.clamp(-1.0, size as f32));
                let share = position.clamp(-1.0, size as f32) - first as f32;
                let inside = |index: i32| f32::from(u8::from((0..=last).contains(&index)));
                Self {
                    index: [first.clamp(0, last) as usize, (first + 1).clamp(0, last) as usize],
                    weight: [(1.0 - share) * inside(first), share * inside(first + 1)],
                }
            }
        }
    }
}

/// Weights of four neighbouring texels at the share `t` (0..1) of the way from the second to the third. Catmull and Rom,
/// "A class of local interpolating splines", 1974: interpolates, reproduces quadratics.
#[inline(always)]
pub fn catmull_rom_weights(t: f32) -> [f32; 4] {
    [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (-2.5 + 1.5 * t),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (-0.5 + 0.5 * t),
    ]
}

impl Reconstruction for Taps<4> {
    fn at(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        let position = fold(coordinate, wrap) * size as f32 - 0.5;
        let position = position.clamp(-4.0, size as f32 + 4.0);
        let first = floor(position);
        let mut weight = catmull_rom_weights(position - first as f32);
        let mut index = [0; 4];
        for tap in 0..4 {
            match wrap_index(first - 1 + tap as i32, size, wrap) {
                Some(inside) => index[tap] = inside,
                None => weight[tap] = 0.0,
            }
        }
        Self { index, weight }
    }
}

/// The weighted sum over the tensor product of two axes' taps.
#[derive(Clone, Copy)]
pub(super) struct TensorProduct<const N: usize> {
    pub(super) width: u32,
    pub(super) u: Taps<N>,
    pub(super) v: Taps<N>,
}

impl<const N: usize> Kernel for TensorProduct<N> {
    type Output = Vec4;
    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let mut sum = Vec4::ZERO;
        for (row, row_weight) in self.v.index.into_iter().zip(self.v.weight) {
            let first = row * self.width as usize;
            let mut row_sum = Vec4::ZERO;
            for (column, weight) in self.u.index.into_iter().zip(self.u.weight) {
                row_sum += texels.fetch(first + column) * weight;
            }
            sum += row_sum * row_weight;
        }
        sum
    }
}

/// The value reconstructed of `N` by `N` texels: the nearest one, linear interpolation, or cubic.
#[inline(always)]
pub(crate) fn reconstructed<const N: usize>(
    level: &Image,
    texels: TexelUse,
    uv: Vec2,
    wrap: [Wrap; 2],
) -> Vec4
where
    Taps<N>: Reconstruction,
{
    let u = Taps::<N>::at(uv.x, level.width, wrap[0]);
    let v = Taps::<N>::at(uv.y, level.height, wrap[1]);
    with_border(level, texels, TensorProduct { width: level.width, u, v })
}

#[inline]
pub(crate) fn bilinear(level: &Image, texels: TexelUse, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
    match Quad::around(level, uv, wrap) {
        Some(quad) => with_texels(level, texels.alpha, quad),
        None => bilinear_reference(level, texels, uv, wrap),
    }
}

/// As [`bilinear`], by the same steps at the edges and inside.
#[inline(never)]
pub(crate) fn bilinear_reference(level: &Image, texels: TexelUse, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
    reconstructed::<2>(level, texels, uv, wrap)
}

/// The sum of [`bilinear`] over `count` points, at least two, from `first` on.
pub(crate) fn bilinear_row(
    level: &Image,
    texels: TexelUse,
    first: Vec2,
    step: Vec2,
    count: u32,
    wrap: [Wrap; 2],
) -> Vec4 {
    match QuadRow::along(level, first, step, count, wrap) {
        Some(row) => with_texels(level, texels.alpha, row),
        None => (0..count).map(|index| bilinear(level, texels, first + step * index as f32, wrap)).sum(),
    }
}

// ---- Decoding of stored texels into weighted sums.
//
// Where alpha is coverage, a texel counts in proportion to its alpha, so that the colour of transparent texels does not
// bleed into their neighbours: a sum collects `w (a + e) rgb` and `w a`, and [`resolve`] divides. The tiny `e` makes the
// plain mean of the colours appear where everything is transparent.

pub(crate) const TRANSPARENT_WEIGHT: f32 = 1.0 / (1 << 20) as f32;

/// The straight RGBA value of a sum of fetched texels whose weights add up to one.
pub(crate) fn resolve(sum: Vec4, alpha: AlphaUse) -> [f32; 4] {
    match alpha {
        AlphaUse::Independent => sum.to_array(),
        AlphaUse::Coverage => {
            // Negative lobes can cancel the coverage; there is no colour then.
            let weight = sum.w + TRANSPARENT_WEIGHT;
            let color = if weight > 0.5 * TRANSPARENT_WEIGHT { sum / weight } else { Vec4::ZERO };
            color.with_w(sum.w.clamp(0.0, 1.0)).to_array()
        }
    }
}

/// How texels are weighed, and what lies beyond them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TexelUse {
    pub(crate) alpha: AlphaUse,
    /// A decoded, weighed texel that stands for all texels that a border leaves out; `None` is transparent black.
    pub(crate) border: Option<Vec4>,
}

impl TexelUse {
    /// A straight linear RGBA colour as texels are summed.
    pub(crate) fn weighed(color: Vec4, alpha: AlphaUse) -> Vec4 {
        match alpha {
            AlphaUse::Independent => color,
            AlphaUse::Coverage => (color * (color.w + TRANSPARENT_WEIGHT)).with_w(color.w),
        }
    }
}

/// Runs a weighted sum on the texels of `image`; weights that a border took away go to its colour.
#[inline(always)]
pub(crate) fn with_border<K: Kernel<Output = Vec4> + Copy>(
    image: &Image,
    texels: TexelUse,
    kernel: K,
) -> Vec4 {
    let sum = with_texels(image, texels.alpha, kernel);
    match texels.border {
        Some(border) => sum + border * (1.0 - kernel.run(Ones).x),
        None => sum,
    }
}

/// Texels of which any weighted sum is the sum of its weights.
#[derive(Clone, Copy)]
struct Ones;

impl TexelSource for Ones {
    #[inline(always)]
    fn fetch(self, _offset: usize) -> Vec4 {
        Vec4::ONE
    }

    #[inline(always)]
    fn fetch_run<const N: usize>(self, _offset: usize) -> [Vec4; N] {
        [Vec4::ONE; N]
    }
}

/// The texels of one level, decoded on access.
pub(crate) trait TexelSource: Copy + Sync {
    /// The texel at `offset` (row-major), linear, weighted by its alpha if that is coverage.
    fn fetch(self, offset: usize) -> Vec4;

    /// `N` texels that follow one another in a row.
    fn fetch_run<const N: usize>(self, offset: usize) -> [Vec4; N];
}

/// A computation over texels of any storage, compiled once for each.
pub(crate) trait Kernel {
    type Output;
    fn run<T: TexelSource>(self, texels: T) -> Self::Output;
}

/// Runs `kernel` on the texels of `image`.
#[inline(always)]
pub(crate) fn with_texels<K: Kernel>(image: &Image, alpha: AlphaUse, kernel: K) -> K::Output {
    with_samples(&image.samples, image.channels, image.space, alpha, kernel)
}

/// Runs `kernel` on samples that form texels of so many channels.
#[inline]
pub(crate) fn with_samples<K: Kernel>(
    samples: &Samples,
    channels: u8,
    space: ColorSpace,
    alpha: AlphaUse,
    kernel: K,
) -> K::Output {
    let is_srgb = space == ColorSpace::Srgb;
    match samples {
        Samples::U8(values) => {
            let table = if is_srgb { linear_from_srgb8_table() } else { unit_from_u8_table() };
            let decoder = Table8 { color: table, alpha: unit_from_u8_table() };
            by_channels(values, channels, alpha, decoder, kernel)
        }
        Samples::U16(values) if is_srgb => {
            by_channels(values, channels, alpha, Table16(linear_from_srgb16_table()), kernel)
        }
        Samples::U16(values) => by_channels(values, channels, alpha, Unit16, kernel),
        Samples::F32(values) if is_srgb => by_channels(values, channels, alpha, SrgbFloat, kernel),
        Samples::F32(values) => by_channels(values, channels, alpha, Float, kernel),
    }
}

fn by_channels<D: Decoder, K: Kernel>(
    values: &[D::Sample],
    channels: u8,
    alpha: AlphaUse,
    decoder: D,
    kernel: K,
) -> K::Output {
    fn texels<D: Decoder, const C: usize>(
        values: &[D::Sample],
        alpha: AlphaUse,
        decoder: D,
    ) -> Texels<'_, D, C> {
        Texels { texels: values.as_chunks().0, alpha_is_coverage: alpha == AlphaUse::Coverage, decoder }
    }
    match channels {
        1 => kernel.run(texels::<D, 1>(values, alpha, decoder)),
        2 => kernel.run(texels::<D, 2>(values, alpha, decoder)),
        3 => kernel.run(texels::<D, 3>(values, alpha, decoder)),
        _ => kernel.run(texels::<D, 4>(values, alpha, decoder)),
    }
}

#[derive(Clone, Copy)]
struct Texels<'a, D: Decoder, const C: usize> {
    texels: &'a [[D::Sample; C]],
    alpha_is_coverage: bool,
    decoder: D,
}

impl<D: Decoder, const C: usize> TexelSource for Texels<'_, D, C> {
    #[inline(always)]
    fn fetch(self, offset: usize) -> Vec4 {
        self.decode(&self.texels[offset])
    }

    #[inline(always)]
    fn fetch_run<const N: usize>(self, offset: usize) -> [Vec4; N] {
        let run = &self.texels[offset..offset + N];
        std::array::from_fn(|i| self.decode(&run[i]))
    }
}

impl<D: Decoder, const C: usize> Texels<'_, D, C> {
    #[inline(always)]
    fn decode(&self, texel: &[D::Sample; C]) -> Vec4 {
        let value = self.decoder.rgba(texel);
        if self.alpha_is_coverage {
            // The weight `a + e` is undone by `resolve`.
            (value * (value.w + TRANSPARENT_WEIGHT)).with_w(value.w)
        } else {
            value
        }
    }
}

/// From stored samples to linear numbers.
trait Decoder: Copy + Sync {
    type Sample: Copy + Sync;

    fn rgba<const C: usize>(self, texel: &[Self::Sample; C]) -> Vec4;
}

/// Grey is spread to r, g and b, missing alpha is 1. All four numbers are made at once, so that the compiler uses vectors.
#[inline(always)]
fn spread<S: Copy, const C: usize>(
    texel: &[S; C],
    color: impl Fn(S) -> f32,
    alpha: impl Fn(S) -> f32,
) -> Vec4 {
    match C {
        1 => Vec4::splat(color(texel[0])).with_w(1.0),
        2 => Vec4::splat(color(texel[0])).with_w(alpha(texel[1])),
        3 => Vec4::new(color(texel[0]), color(texel[1]), color(texel[2]), 1.0),
        _ => Vec4::new(color(texel[0]), color(texel[1]), color(texel[2]), alpha(texel[3])),
    }
}

#[derive(Clone, Copy)]
struct Table8<'a> {
    color: &'a [f32; 256],
    alpha: &'a [f32; 256],
}

impl Decoder for Table8<'_> {
    type Sample = u8;
    #[inline(always)]
    fn rgba<const C: usize>(self, texel: &[u8; C]) -> Vec4 {
        // A load takes less than a conversion.
        spread(texel, |sample| self.color[usize::from(sample)], |sample| self.alpha[usize::from(sample)])
    }
}

#[derive(Clone, Copy)]
struct Table16<'a>(&'a [f32]);

impl Decoder for Table16<'_> {
    type Sample = u16;
    #[inline(always)]
    fn rgba<const C: usize>(self, texel: &[u16; C]) -> Vec4 {
        spread(texel, |sample| self.0[usize::from(sample)], |sample| f32::from(sample) * (1.0 / 65535.0))
    }
}

#[derive(Clone, Copy)]
struct Unit16;

impl Decoder for Unit16 {
    type Sample = u16;
    #[inline(always)]
    fn rgba<const C: usize>(self, texel: &[u16; C]) -> Vec4 {
        if C == 4 {
            // The mantissas of floats from 2^23 on are integers: no conversion is needed, and none is scalar.
            const INTEGERS: f32 = 8_388_608.0;
            let floats = [0, 1, 2, 3].map(|i| f32::from_bits(INTEGERS.to_bits() | u32::from(texel[i])));
            return (Vec4::from_array(floats) - INTEGERS) * (1.0 / 65535.0);
        }
        let unit = |sample| f32::from(sample) * (1.0 / 65535.0);
        spread(texel, unit, unit)
    }
}

#[derive(Clone, Copy)]
struct Float;

impl Decoder for Float {
    type Sample = f32;
    #[inline(always)]
    fn rgba<const C: usize>(self, texel: &[f32; C]) -> Vec4 {
        spread(texel, |sample| sample, |sample| sample)
    }
}

#[derive(Clone, Copy)]
struct SrgbFloat;

impl Decoder for SrgbFloat {
    type Sample = f32;
    fn rgba<const C: usize>(self, texel: &[f32; C]) -> Vec4 {
        spread(texel, linear_from_srgb, |sample| sample)
    }
}

// ---- Bilinear look-ups away from the image's edges, where no texel wraps: the fast path of all filters that interpolate.
//
// A position is split into texel and share by adding `2^23`, which leaves the integer in the float's mantissa; one unsigned
// comparison then tells whether both texels lie inside, whatever the position was (negative, infinite, NaN). The results
// equal those of [`bilinear_reference`] up to rounding.

/// `2^23`: above, floats are integers.
const INTEGERS: f32 = 8_388_608.0;

/// The whole part of a position in texels and the rest, 0..1 (either, for integers). Positions below 1/4 (those of the
/// first texel's edge) and unusable ones give an index above every side.
#[inline(always)]
fn split(position: f32) -> (u32, f32) {
    let shifted = position - 0.5 + INTEGERS;
    (shifted.to_bits().wrapping_sub(INTEGERS.to_bits()), position - (shifted - INTEGERS))
}

/// Two by two texels with the shares of the right and of the lower ones.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quad {
    /// Row-major offset of the upper left one.
    first: usize,
    /// Texels of a row.
    width: usize,
    right: f32,
    lower: f32,
}

impl Quad {
    /// Around a point; `None` at the edges of the image.
    #[inline(always)]
    pub(super) fn around(level: &Image, uv: Vec2, wrap: [Wrap; 2]) -> Option<Self> {
        let (column, right) = split(fold(uv.x, wrap[0]) * level.width as f32 - 0.5);
        let (row, lower) = split(fold(uv.y, wrap[1]) * level.height as f32 - 0.5);
        let is_inside = column < level.width - 1 && row < level.height - 1;
        let width = level.width as usize;
        is_inside.then(|| Self { first: row as usize * width + column as usize, width, right, lower })
    }
}

impl Kernel for Quad {
    type Output = Vec4;

    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let upper = texels.fetch_run::<2>(self.first);
        let lower = texels.fetch_run::<2>(self.first + self.width);
        let between = |[left, right]: [Vec4; 2]| left + (right - left) * self.right;
        let upper = between(upper);
        upper + (between(lower) - upper) * self.lower
    }
}

/// Equidistant points in a row, all away from the edges of a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct QuadRow {
    /// The first point, in texels from the centre of the first texel.
    first: Vec2,
    /// From point to point, in texels.
    step: Vec2,
    count: u32,
    /// Texels of a row.
    width: usize,
}

/// By how much rounding may move a point, in texels, and more.
const MARGIN: f32 = 0.5;

impl QuadRow {
    /// `count` points from `first` on, in uv; `None` if one lies at the edges of the image.
    #[inline(always)]
    pub(super) fn along(level: &Image, first: Vec2, step: Vec2, count: u32, wrap: [Wrap; 2]) -> Option<Self> {
        let size = Vec2::new(level.width as f32, level.height as f32);
        // Folding the middle moves all points by the same; mirrored ones would change their direction.
        let middle = first + step * (0.5 * (count - 1) as f32);
        let folded = Vec2::new(fold(middle.x, wrap[0]), fold(middle.y, wrap[1]));
        let is_mirrored = |axis: usize| wrap[axis] == Wrap::Mirror && folded[axis] != middle[axis];
        let (middle, step) = (folded * size - 0.5, step * size);
        let reach = step * (0.5 * (count - 1) as f32);
        let (low, high) = (middle - reach.abs(), middle + reach.abs());
        // Comparisons with NaN are false.
        let is_inside = low.cmpge(Vec2::splat(MARGIN)).all() && high.cmple(size - 1.0 - MARGIN).all();
        let is_usable = is_inside && !is_mirrored(0) && !is_mirrored(1);
        is_usable.then(|| Self { first: middle - reach, step, count, width: level.width as usize })
    }
}

impl Kernel for QuadRow {
    type Output = Vec4;

    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let mut sum = Vec4::ZERO;
        for index in 0..self.count {
            let position = self.first + self.step * index as f32;
            let ((column, right), (row, lower)) = (split(position.x), split(position.y));
            let first = row as usize * self.width + column as usize;
            sum += Quad { first, width: self.width, right, lower }.run(texels);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_split_exactly() {
        for position in [0.25_f32, 0.3, 0.999, 1.0, 1.5, 2.0, 77.25, 4095.9, 65_534.5] {
            let (index, share) = split(position);
            assert_eq!(index as f32 + share, position);
            assert!((0.0..=1.0).contains(&share), "{position}: {share}");
        }
        for position in [-1e9, -1.0, -0.3, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e9, f32::MAX] {
            assert!(split(position).0 > 1 << 22, "{position}");
        }
    }
}
