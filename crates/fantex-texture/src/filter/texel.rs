//! Decoding of stored texels into weighted sums.
//!
//! Where alpha is coverage, a texel counts in proportion to its alpha, so that the colour of transparent texels does not
//! bleed into their neighbours: a sum collects `w (a + e) rgb` and `w a`, and [`resolve`] divides. The tiny `e` makes the
//! plain mean of the colours appear where everything is transparent.

use glam::Vec4;

use crate::AlphaUse;
use crate::color::{linear_from_srgb, linear_from_srgb8_table, linear_from_srgb16_table, unit_from_u8_table};
use crate::image::{ColorSpace, Image, Samples};

pub(super) const TRANSPARENT_WEIGHT: f32 = 1.0 / (1 << 20) as f32;

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

    /// The RGBA value of a texel with 1 to 4 channels.
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
