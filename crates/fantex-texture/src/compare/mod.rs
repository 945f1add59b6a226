//! How much two pictures of the same size differ, as numbers and as a picture.
//!
//! All measures look at what a display shows: sRGB-encoded colours, clamped to `[0,1]`; alpha is ignored.

mod flip;
mod ssim;

use crate::color::srgb_from_linear;
use crate::image::{ColorSpace, Image, Samples};

pub use flip::{FlipOptions, flip, flip_map};
pub use ssim::ssim;

/// Why two pictures cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// They have different sizes.
    #[error("pictures of {} x {} and {} x {} texels cannot be compared; render both at one size",
        .reference[0], .reference[1], .test[0], .test[1])]
    Size {
        /// Width and height of the first.
        reference: [u32; 2],
        /// Width and height of the second.
        test: [u32; 2],
    },
}

/// All measures of a pair of pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Peak signal-to-noise ratio in decibels; infinite for equal pictures. See [`psnr_db`].
    pub psnr_db: f64,
    /// Mean structural similarity, at most 1. See [`ssim()`].
    pub ssim: f64,
    /// Mean FLIP error, 0 to 1. See [`flip()`].
    pub flip: f64,
}

/// All measures at once.
pub fn compare(reference: &Image, test: &Image) -> Result<Comparison, CompareError> {
    Ok(Comparison {
        psnr_db: psnr_db(reference, test)?,
        ssim: ssim(reference, test)?,
        flip: flip(reference, test, FlipOptions::default())?,
    })
}

/// Peak signal-to-noise ratio, `10 log10(1 / mse)`, the mean squared error taken over the three colour channels of all
/// texels, sRGB-encoded and scaled to `[0,1]` but not rounded to bytes. Infinite where nothing differs.
pub fn psnr_db(reference: &Image, test: &Image) -> Result<f64, CompareError> {
    check_sizes(reference, test)?;
    let (reference, test) = (display_rgb(reference), display_rgb(test));
    let squares: f64 = reference
        .as_flattened()
        .iter()
        .zip(test.as_flattened())
        .map(|(a, b)| f64::from(a - b) * f64::from(a - b))
        .sum();
    Ok(-10.0 * (squares / (3 * reference.len()) as f64).log10())
}

/// A picture of the absolute differences of the sRGB-encoded colours, times `gain`, as 8-bit sRGB.
pub fn difference_picture(reference: &Image, test: &Image, gain: f32) -> Result<Image, CompareError> {
    check_sizes(reference, test)?;
    let (a, b) = (display_rgb(reference), display_rgb(test));
    let bytes = a
        .as_flattened()
        .iter()
        .zip(b.as_flattened())
        .map(|(a, b)| crate::color::unorm8((a - b).abs() * gain))
        .collect();
    Ok(Image {
        width: reference.width,
        height: reference.height,
        channels: 3,
        space: ColorSpace::Srgb,
        samples: Samples::U8(bytes),
    })
}

fn check_sizes(reference: &Image, test: &Image) -> Result<(), CompareError> {
    let (a, b) = ([reference.width, reference.height], [test.width, test.height]);
    if a == b { Ok(()) } else { Err(CompareError::Size { reference: a, test: b }) }
}

/// The sRGB-encoded colours in `[0,1]`, row by row.
fn display_rgb(image: &Image) -> Vec<[f32; 3]> {
    let mut texels = Vec::with_capacity(image.width as usize * image.height as usize);
    for y in 0..image.height {
        for x in 0..image.width {
            let [r, g, b, _] = image.linear_texel(x, y);
            // NaN counts as black.
            texels.push([r, g, b].map(|value| srgb_from_linear(value.clamp(0.0, 1.0).max(0.0))));
        }
    }
    texels
}

/// One number per texel.
struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    /// The plane filtered along rows with `horizontal` and then along columns with `vertical`; both have an odd number of
    /// taps, and the edge texels are repeated outside.
    fn separable(&self, horizontal: &[f32], vertical: &[f32]) -> Self {
        use rayon::prelude::*;
        let (width, height) = (self.width, self.height);
        let mut rows = vec![0.0; self.values.len()];
        rows.par_chunks_mut(width).zip(self.values.par_chunks(width)).for_each(|(out, row)| {
            for (x, out) in out.iter_mut().enumerate() {
                *out = weigh(horizontal, x, width, |x| row[x]);
            }
        });
        let mut values = vec![0.0; rows.len()];
        values.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            for (x, out) in out.iter_mut().enumerate() {
                *out = weigh(vertical, y, height, |y| rows[y * width + x]);
            }
        });
        Self { width, height, values }
    }

    fn map2(&self, other: &Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| f(*a, *b)).collect();
        Self { width: self.width, height: self.height, values }
    }
}

/// The sum of the taps over the texels around `center`, clamped to the `size` texels that there are.
fn weigh(taps: &[f32], center: usize, size: usize, value: impl Fn(usize) -> f32) -> f32 {
    let radius = taps.len() / 2;
    let at = |tap: usize| (center + tap).saturating_sub(radius).min(size - 1);
    taps.iter().enumerate().map(|(tap, weight)| weight * value(at(tap))).sum()
}
