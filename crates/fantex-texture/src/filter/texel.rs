//! Decoding of stored texels into weighted sums.
//!
//! Where alpha is coverage, a texel counts in proportion to its alpha, so that the colour of transparent texels does not
//! bleed into their neighbours: a sum collects `w (a + e) rgb` and `w a`, and [`resolve`] divides. The tiny `e` makes the
//! plain mean of the colours appear where everything is transparent.

use glam::Vec4;

use crate::AlphaUse;
use crate::color::{linear_from_srgb, linear_from_srgb8_table, linear_from_srgb16_table, unit_from_u8_table};
use crate::image::{ColorSpace, Image, Samples};

const TRANSPARENT_WEIGHT: f32 = 1.0 / (1 << 20) as f32;

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
            by_channels(values, channels, alpha, Table8(table), kernel)
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
        let color = |channel: usize| self.decoder.color(texel[channel]);
        let (rgb, alpha) = match C {
            1 => (Vec4::splat(color(0)), None),
            2 => (Vec4::splat(color(0)), Some(self.decoder.alpha(texel[1]))),
            3 => (Vec4::new(color(0), color(1), color(2), 0.0), None),
            _ => (Vec4::new(color(0), color(1), color(2), 0.0), Some(self.decoder.alpha(texel[3]))),
        };
        match alpha {
            // Opaque: the weight 1 + e is undone by `resolve`, or both are left out.
            None if self.alpha_is_coverage => (rgb * (1.0 + TRANSPARENT_WEIGHT)).with_w(1.0),
            None => rgb.with_w(1.0),
            Some(alpha) if self.alpha_is_coverage => (rgb * (alpha + TRANSPARENT_WEIGHT)).with_w(alpha),
            Some(alpha) => rgb.with_w(alpha),
        }
    }
}

/// From a stored sample to a linear number.
trait Decoder: Copy + Sync {
    type Sample: Copy + Sync;
    fn color(self, sample: Self::Sample) -> f32;
    fn alpha(self, sample: Self::Sample) -> f32;
}

#[derive(Clone, Copy)]
struct Table8<'a>(&'a [f32; 256]);

impl Decoder for Table8<'_> {
    type Sample = u8;
    #[inline(always)]
    fn color(self, sample: u8) -> f32 {
        self.0[usize::from(sample)]
    }
    #[inline(always)]
    fn alpha(self, sample: u8) -> f32 {
        f32::from(sample) * (1.0 / 255.0)
    }
}

#[derive(Clone, Copy)]
struct Table16<'a>(&'a [f32]);

impl Decoder for Table16<'_> {
    type Sample = u16;
    #[inline(always)]
    fn color(self, sample: u16) -> f32 {
        self.0[usize::from(sample)]
    }
    #[inline(always)]
    fn alpha(self, sample: u16) -> f32 {
        f32::from(sample) * (1.0 / 65535.0)
    }
}

#[derive(Clone, Copy)]
struct Unit16;

impl Decoder for Unit16 {
    type Sample = u16;
    #[inline(always)]
    fn color(self, sample: u16) -> f32 {
        f32::from(sample) * (1.0 / 65535.0)
    }
    #[inline(always)]
    fn alpha(self, sample: u16) -> f32 {
        f32::from(sample) * (1.0 / 65535.0)
    }
}

#[derive(Clone, Copy)]
struct Float;

impl Decoder for Float {
    type Sample = f32;
    #[inline(always)]
    fn color(self, sample: f32) -> f32 {
        sample
    }
    #[inline(always)]
    fn alpha(self, sample: f32) -> f32 {
        sample
    }
}

#[derive(Clone, Copy)]
struct SrgbFloat;

impl Decoder for SrgbFloat {
    type Sample = f32;
    fn color(self, sample: f32) -> f32 {
        linear_from_srgb(sample)
    }
    fn alpha(self, sample: f32) -> f32 {
        sample
    }
}
