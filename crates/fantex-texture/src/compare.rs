//! How much two pictures of the same size differ, as numbers and as a picture.
//!
//! All measures look at what a display shows: sRGB-encoded colours, clamped to `[0,1]`; alpha is ignored.

use fantex_base::{Error, Result, counted};
use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::image::{ColorSpace, Image, Samples};

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
///
/// # Errors
/// The pictures differ in size.
pub fn compare(reference: &Image, test: &Image) -> Result<Comparison> {
    compare_where(reference, test, &every_texel(reference))
}

/// All measures over the texels that count, row by row; over all of them where none does. A texel's similarity and FLIP error
/// depend on its surroundings, too, which need not count.
///
/// # Errors
///
/// The pictures differ in size, or `counts` has not as many texels.
pub fn compare_where(reference: &Image, test: &Image, counts: &[bool]) -> Result<Comparison> {
    check_sizes(reference, test)?;
    let texels = reference.width as usize * reference.height as usize;
    if counts.len() != texels {
        return Err(Error::invalid(format!(
            "what counts is said of {}, and the picture has {texels}",
            counted(counts.len(), "texel")
        )));
    }
    let all = every_texel(reference);
    let counts = if counts.contains(&true) { counts } else { &all };
    let errors = flip_map(reference, test, FlipOptions::default())?;
    let flip = mean(errors.iter().zip(counts).filter(|(_, counts)| **counts).map(|(&e, _)| f64::from(e)));
    Ok(Comparison {
        psnr_db: psnr_where(reference, test, counts),
        ssim: ssim_where(reference, test, counts),
        flip,
    })
}

fn every_texel(image: &Image) -> Vec<bool> {
    vec![true; image.width as usize * image.height as usize]
}

/// NaN of nothing.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    sum / count as f64
}

/// Peak signal-to-noise ratio, `10 log10(1 / mse)`, the mean squared error taken over the three colour channels of all
/// texels, sRGB-encoded and scaled to `[0,1]` but not rounded to bytes. Infinite where nothing differs.
///
/// # Errors
/// The pictures differ in size.
pub fn psnr_db(reference: &Image, test: &Image) -> Result<f64> {
    check_sizes(reference, test)?;
    Ok(psnr_where(reference, test, &every_texel(reference)))
}

fn psnr_where(reference: &Image, test: &Image, counts: &[bool]) -> f64 {
    let (reference, test) = (display_rgb(reference), display_rgb(test));
    let squares = reference
        .iter()
        .zip(&test)
        .zip(counts)
        .filter(|(_, counts)| **counts)
        .flat_map(|((a, b), _)| a.iter().zip(b).map(|(a, b)| f64::from(a - b) * f64::from(a - b)));
    -10.0 * mean(squares).log10()
}

/// A picture of the absolute differences of the sRGB-encoded colours, times `gain`, as 8-bit sRGB.
///
/// # Errors
/// The pictures differ in size.
pub fn difference_picture(reference: &Image, test: &Image, gain: f32) -> Result<Image> {
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

fn check_sizes(reference: &Image, test: &Image) -> Result<()> {
    let (a, b) = ([reference.width, reference.height], [test.width, test.height]);
    if a == b {
        return Ok(());
    }
    let ([aw, ah], [bw, bh]) = (a, b);
    Err(Error::unsupported(format!(
        "pictures of {aw} x {ah} and {bw} x {bh} texels cannot be compared; render both at one size"
    )))
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

// ---- Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity", 2004.

/// Mean structural similarity of the luma (`0.299 R + 0.587 G + 0.114 B` of the sRGB-encoded colours): 1 for equal
/// pictures, smaller otherwise. Gaussian window of 11x11 texels with standard deviation 1.5, `K1 = 0.01`, `K2 = 0.03`,
/// dynamic range 1. As in the paper, only windows that lie inside the picture count, unless it is smaller than one.
///
/// # Errors
/// The pictures differ in size.
pub fn ssim(reference: &Image, test: &Image) -> Result<f64> {
    check_sizes(reference, test)?;
    Ok(ssim_where(reference, test, &every_texel(reference)))
}

/// The mean over the windows around texels that count: those inside the picture, or all if there are none.
fn ssim_where(reference: &Image, test: &Image, counts: &[bool]) -> f64 {
    let (a, b) = (luma(reference), luma(test));
    let window = gaussian();
    let blurred = |plane: &Plane| plane.separable(&window, &window);
    let (mean_a, mean_b) = (blurred(&a), blurred(&b));
    let mean_aa = blurred(&a.map2(&a, |x, y| x * y));
    let mean_bb = blurred(&b.map2(&b, |x, y| x * y));
    let mean_ab = blurred(&a.map2(&b, |x, y| x * y));

    let similarity_within = |[left, top]: [usize; 2]| {
        let rows = (top..a.height - top).flat_map(|y| (left..a.width - left).map(move |x| y * a.width + x));
        mean(rows.filter(|&i| counts[i]).map(|i| {
            let at = |plane: &Plane| f64::from(plane.values[i]);
            similarity([&mean_a, &mean_b, &mean_aa, &mean_bb, &mean_ab].map(at))
        }))
    };
    let inside = similarity_within([a.width, a.height].map(|size| if size >= WINDOW { RADIUS } else { 0 }));
    if inside.is_nan() { similarity_within([0, 0]) } else { inside }
}

const WINDOW: usize = 11;
const RADIUS: usize = WINDOW / 2;

/// From the means of `a`, `b`, `a^2`, `b^2` and `a b` in a window. At most 1, although variances of flat windows are little but rounding.
fn similarity([a, b, aa, bb, ab]: [f64; 5]) -> f64 {
    const C1: f64 = 0.01 * 0.01;
    const C2: f64 = 0.03 * 0.03;
    let (variance_a, variance_b, covariance) = (aa - a * a, bb - b * b, ab - a * b);
    let similarity = (2.0 * a * b + C1) * (2.0 * covariance + C2)
        / ((a * a + b * b + C1) * (variance_a + variance_b + C2));
    // Other than the smaller of both, what is no number stays none.
    if similarity > 1.0 { 1.0 } else { similarity }
}

fn gaussian() -> [f32; WINDOW] {
    let weight = |i: usize| (-(i as f64 - RADIUS as f64).powi(2) / (2.0 * 1.5 * 1.5)).exp();
    let total: f64 = (0..WINDOW).map(weight).sum();
    std::array::from_fn(|i| (weight(i) / total) as f32)
}

fn luma(image: &Image) -> Plane {
    let values = display_rgb(image).into_iter().map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect();
    Plane { width: image.width as usize, height: image.height as usize, values }
}

// ---- Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: a difference evaluator for alternating images",
// 2020, for pictures of low dynamic range: how much a person notices when two pictures are flipped back and forth.
//
// ```text
// sRGB -> YCxCz -> contrast sensitivity filter -> Lab (Hunt) -> HyAB distance -> colour difference  ---.
//            '---> luminance -> edge and point detectors -> feature difference --------------------> combine
// ```
//
// Deviation: all filters are applied as sums of separable ones, which gives the same values.

/// The viewing conditions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlipOptions {
    /// Pixels that one degree of the visual field covers.
    pub pixels_per_degree: f32,
}

impl Default for FlipOptions {
    /// A monitor 0.7 m wide with 3840 pixels across, seen from 0.7 m: 67 pixels per degree.
    fn default() -> Self {
        Self { pixels_per_degree: 0.7 * (3840.0 / 0.7) * std::f32::consts::PI / 180.0 }
    }
}

/// Mean of [`flip_map`].
///
/// # Errors
/// The pictures differ in size.
pub fn flip(reference: &Image, test: &Image, options: FlipOptions) -> Result<f64> {
    let errors = flip_map(reference, test, options)?;
    Ok(mean(errors.iter().map(|&error| f64::from(error))))
}

/// The error of every texel, row by row: 0 (none) to 1 (largest).
///
/// # Errors
/// The pictures differ in size.
pub fn flip_map(reference: &Image, test: &Image, options: FlipOptions) -> Result<Vec<f32>> {
    check_sizes(reference, test)?;
    let (reference, test) = (Opponent::new(reference), Opponent::new(test));
    let color = color_difference(&reference, &test, options);
    let feature = feature_difference(&reference, &test, options);
    Ok(color.into_iter().zip(feature).map(|(color, feature)| color.powf(1.0 - feature)).collect())
}

/// Linear sRGB to CIE XYZ, relative to the white (1,1,1).
fn relative_xyz_from_rgb() -> Mat3 {
    let xyz = Mat3::from_cols(
        Vec3::new(0.412_456_4, 0.212_672_9, 0.019_333_9),
        Vec3::new(0.357_576_1, 0.715_152_2, 0.119_192),
        Vec3::new(0.180_437_5, 0.072_175, 0.950_304_1),
    );
    Mat3::from_diagonal((xyz * Vec3::ONE).recip()) * xyz
}

/// A picture in YCxCz: luminance, red-green and blue-yellow.
struct Opponent {
    planes: [Plane; 3],
}

impl Opponent {
    fn new(image: &Image) -> Self {
        let matrix = relative_xyz_from_rgb();
        let texels: Vec<Vec3> = display_rgb(image)
            .par_iter()
            .map(|rgb| {
                let Vec3 { x, y, z } = matrix * Vec3::from_array(rgb.map(linear_from_srgb));
                Vec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
            })
            .collect();
        let plane = |channel: usize| Plane {
            width: image.width as usize,
            height: image.height as usize,
            values: texels.iter().map(|texel| texel[channel]).collect(),
        };
        Self { planes: [plane(0), plane(1), plane(2)] }
    }

    /// What the eye resolves at this distance, as Lab colours adjusted for the Hunt effect.
    fn perceived(&self, options: FlipOptions) -> Vec<Vec3> {
        let filtered: [Plane; 3] = std::array::from_fn(|channel| {
            contrast_filter(&self.planes[channel], SENSITIVITY[channel], options)
        });
        let rgb_from_xyz = relative_xyz_from_rgb().inverse();
        (0..filtered[0].values.len())
            .into_par_iter()
            .map(|i| {
                let y = (filtered[0].values[i] + 16.0) / 116.0;
                let x = y + filtered[1].values[i] / 500.0;
                let z = y - filtered[2].values[i] / 200.0;
                hunt_lab((rgb_from_xyz * Vec3::new(x, y, z)).clamp(Vec3::ZERO, Vec3::ONE))
            })
            .collect()
    }
}

/// A term `a sqrt(pi/b) exp(-pi^2 r^2 / b)` of the eye's point response, `r` in degrees.
#[derive(Clone, Copy)]
struct Term {
    a: f32,
    b: f32,
}

/// The terms for luminance, red-green and blue-yellow.
const SENSITIVITY: [&[Term]; 3] = [
    &[Term { a: 1.0, b: 0.0047 }],
    &[Term { a: 1.0, b: 0.0053 }],
    &[Term { a: 34.1, b: 0.04 }, Term { a: 13.5, b: 0.025 }],
];

fn contrast_filter(plane: &Plane, terms: &[Term], options: FlipOptions) -> Plane {
    use std::f32::consts::PI;
    let widest = 0.04_f32;
    let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * options.pixels_per_degree).ceil() as i32;
    let passes: Vec<(f32, Vec<f32>)> = terms
        .iter()
        .map(|term| {
            let taps = taps(radius, |x| {
                let degrees = x / options.pixels_per_degree;
                (-PI * PI * degrees * degrees / term.b).exp()
            });
            let sum: f32 = taps.iter().sum();
            let mass = term.a * (PI / term.b).sqrt() * sum * sum;
            (mass, taps.into_iter().map(|tap| tap / sum).collect())
        })
        .collect();
    let total: f32 = passes.iter().map(|(mass, _)| mass).sum();
    let mut sum = Plane { width: plane.width, height: plane.height, values: vec![0.0; plane.values.len()] };
    for (mass, taps) in &passes {
        sum = sum.map2(&plane.separable(taps, taps), |sum, value| sum + mass / total * value);
    }
    sum
}

fn taps(radius: i32, value: impl Fn(f32) -> f32) -> Vec<f32> {
    (-radius..=radius).map(|x| value(x as f32)).collect()
}

/// CIE Lab of a linear sRGB colour; chroma is scaled by lightness, since dark colours look less colourful.
fn hunt_lab(rgb: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let f = (relative_xyz_from_rgb() * rgb)
        .to_array()
        .map(|t| if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    let lightness = 116.0 * f[1] - 16.0;
    let chroma = 0.01 * lightness;
    Vec3::new(lightness, chroma * 500.0 * (f[0] - f[1]), chroma * 200.0 * (f[1] - f[2]))
}

/// Distance for large colour differences: city-block between lightness and chroma, Euclidean within chroma.
fn hyab(a: Vec3, b: Vec3) -> f32 {
    let difference = a - b;
    difference.x.abs() + difference.y.hypot(difference.z)
}

fn color_difference(reference: &Opponent, test: &Opponent, options: FlipOptions) -> Vec<f32> {
    const EXPONENT: f32 = 0.7;
    const KNEE: f32 = 0.4;
    const KNEE_VALUE: f32 = 0.95;
    let largest = hyab(hunt_lab(Vec3::Y), hunt_lab(Vec3::Z)).powf(EXPONENT);
    let knee = KNEE * largest;
    let difference = |(a, b): (Vec3, Vec3)| {
        let distance = hyab(a, b).powf(EXPONENT);
        if distance < knee {
            KNEE_VALUE / knee * distance
        } else {
            KNEE_VALUE + (distance - knee) / (largest - knee) * (1.0 - KNEE_VALUE)
        }
    };
    reference.perceived(options).into_iter().zip(test.perceived(options)).map(difference).collect()
}

fn feature_difference(reference: &Opponent, test: &Opponent, options: FlipOptions) -> Vec<f32> {
    // Half the width of the eye's edge detectors is 0.041 degrees.
    let deviation = 0.5 * 0.082 * options.pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as i32;
    let gaussian = |x: f32| (-x * x / (2.0 * deviation * deviation)).exp();
    let smooth = normalized(taps(radius, gaussian));
    let edge = normalized(taps(radius, |x| -x * gaussian(x)));
    let point = normalized(taps(radius, |x| (x * x / (deviation * deviation) - 1.0) * gaussian(x)));
    let strength = |picture: &Opponent, detector: &[f32]| {
        let mut luminance = picture.planes[0].map2(&picture.planes[0], |y, _| (y + 16.0) / 116.0);
        let horizontal = luminance.separable(detector, &smooth);
        luminance = luminance.separable(&smooth, detector);
        horizontal.map2(&luminance, f32::hypot).values
    };
    let differences = |detector: &[f32]| {
        let (a, b) = (strength(reference, detector), strength(test, detector));
        a.into_iter().zip(b).map(|(a, b)| (a - b).abs()).collect::<Vec<_>>()
    };
    differences(&edge)
        .into_iter()
        .zip(differences(&point))
        .map(|(edge, point)| (edge.max(point) / std::f32::consts::SQRT_2).sqrt().min(1.0))
        .collect()
}

/// The positive taps scaled to add up to 1, the negative ones to -1.
fn normalized(mut taps: Vec<f32>) -> Vec<f32> {
    let positive: f32 = taps.iter().filter(|tap| **tap > 0.0).sum();
    let negative: f32 = taps.iter().filter(|tap| **tap < 0.0).sum();
    for tap in &mut taps {
        *tap /= if *tap > 0.0 { positive } else { -negative.min(-f32::MIN_POSITIVE) };
    }
    taps
}
