//! Rendered pictures.

use fantex_base::parameters;
use fantex_texture::color::{srgb8_from_linear, unorm8};
use fantex_texture::filter::halved_level;
use fantex_texture::{ColorSpace, Image, Samples};
use glam::Vec3;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A picture in linear light.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major from the top: linear RGB and straight alpha. RGB may exceed one.
    pub rgba: Vec<[f32; 4]>,
}

impl Picture {
    /// The pixel in column `x` and row `y`. Panics outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 4] {
        assert!(x < self.width && y < self.height, "pixel {x},{y} of {}x{}", self.width, self.height);
        self.rgba[(y * self.width + x) as usize]
    }

    /// True where every pixel is opaque.
    pub fn is_opaque(&self) -> bool {
        self.rgba.iter().all(|p| p[3] == 1.0)
    }

    /// As floats in linear light, for OpenEXR and HDR files.
    pub fn to_linear_image(&self) -> Image {
        self.image(ColorSpace::Linear, |channels| {
            Samples::F32(self.rgba.iter().flat_map(|p| p[..channels].iter().copied()).collect())
        })
    }

    /// As 8-bit sRGB, values above one cut off, for PNG and JPEG files.
    pub fn to_srgb_image(&self) -> Image {
        self.image(ColorSpace::Srgb, |channels| {
            let byte = |(c, &v): (usize, &f32)| if c == 3 { unorm8(v) } else { srgb8_from_linear(v) };
            Samples::U8(self.rgba.iter().flat_map(|p| p[..channels].iter().enumerate().map(byte)).collect())
        })
    }

    /// The picture with all its light in 0..1.
    pub fn tone_mapped(&self, tone_map: ToneMap) -> Picture {
        let map = |&[r, g, b, alpha]: &[f32; 4]| tone_map.map(Vec3::new(r, g, b)).extend(alpha).to_array();
        Picture { rgba: self.rgba.iter().map(map).collect(), ..*self }
    }

    /// Without an alpha channel where the picture is opaque.
    fn image(&self, space: ColorSpace, samples: impl FnOnce(usize) -> Samples) -> Image {
        let channels: u8 = if self.is_opaque() { 3 } else { 4 };
        let samples = samples(usize::from(channels));
        Image { width: self.width, height: self.height, channels, space, samples }
    }
}

// Glow: the halo of light around what is bright.
//
// ```text
//  bright part --halve--> level 1 --halve--> level 2 ...      (multi-pass: each pass is small)
//       |                    |                  |
//     blur                 blur               blur            Gaussians of doubling width
//       '---- added up while doubling back to full size ----> halo
// ```
//
// Eyes and lenses scatter a little light far and more of it near, which a sum of Gaussians follows (G. Spencer et al.,
// "Physically-Based Glare Effects for Digital Images", 1995). Every pass keeps the sum of the light; what is scattered out of
// the picture is gone.

parameters! {
    /// A halo around bright light.
    #[derive(Copy)]
    pub struct Glow {
        /// Radius in shares of the picture's height: the standard deviation of the widest of four Gaussians, each half as wide as the one before.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1))]
        pub radius: f32 = 0.05,
        /// Light of the halo, which is added, as a share of the light that makes it.
        #[schemars(range(min = 0, max = 100))]
        pub strength: f32 = 0.5,
        /// Light above which the picture glows, the excess only. Without it only emission glows, all of it.
        #[schemars(range(min = 0))]
        pub threshold: Option<f32> = None,
    }
}

/// Gaussians of a halo, each half as wide as the one before.
const GAUSSIANS: usize = 4;

/// Levels are halved until a Gaussian's standard deviation there is below twice this many pixels.
const MIN_SIGMA: f32 = 2.0;

impl Picture {
    /// This picture with the halo of a source of the same size: the emitted light, or the picture itself. Where the picture
    /// is transparent, the halo makes it as opaque as it is bright.
    ///
    /// # Panics
    /// If the source has another size.
    pub fn with_glow(&self, source: &Picture, glow: &Glow) -> Picture {
        assert_eq!((self.width, self.height), (source.width, source.height), "a halo of the same size");
        let halo = halo(source, glow);
        let mut glowing = self.clone();
        glowing.rgba.par_iter_mut().zip(&halo).for_each(|(pixel, &halo)| {
            let [r, g, b, alpha] = *pixel;
            let covered = alpha.max(halo.max_element().clamp(0.0, 1.0));
            if covered > 0.0 {
                let color = (Vec3::new(r, g, b) * alpha + halo) / covered;
                *pixel = color.extend(covered).to_array();
            }
        });
        glowing
    }
}

fn halo(source: &Picture, glow: &Glow) -> Vec<Vec3> {
    let bright = Layer {
        width: source.width as usize,
        height: source.height as usize,
        pixels: source
            .rgba
            .par_iter()
            .map(|&pixel| bright_part(pixel, glow.threshold.unwrap_or(0.0)))
            .collect(),
    };
    let widest = (glow.radius * source.height as f32).clamp(0.0, 1e4);
    let mut sum = vec![Vec3::ZERO; bright.pixels.len()];
    for i in 0..GAUSSIANS {
        let blurred = blur(&bright, widest / (1 << i) as f32);
        let share = glow.strength / GAUSSIANS as f32;
        sum.par_iter_mut().zip(&blurred.pixels).for_each(|(sum, &light)| *sum += light * share);
    }
    sum
}

/// What exceeds the threshold, in the pixel's own hue.
fn bright_part([r, g, b, alpha]: [f32; 4], threshold: f32) -> Vec3 {
    let color = Vec3::new(r, g, b).max(Vec3::ZERO) * alpha;
    let bright = luminance(color);
    if bright > threshold && bright.is_finite() {
        color * (1.0 - threshold.max(0.0) / bright)
    } else {
        Vec3::ZERO
    }
}

struct Layer {
    width: usize,
    height: usize,
    pixels: Vec<Vec3>,
}

impl Layer {
    fn at(&self, x: isize, y: isize) -> Vec3 {
        let inside = x >= 0 && y >= 0 && x < self.width as isize && y < self.height as isize;
        if inside { self.pixels[y as usize * self.width + x as usize] } else { Vec3::ZERO }
    }

    fn from_fn(width: usize, height: usize, pixel: impl Fn(isize, isize) -> Vec3 + Sync) -> Self {
        let mut pixels = vec![Vec3::ZERO; width * height];
        pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = pixel(x as isize, y as isize));
        });
        Self { width, height, pixels }
    }

    fn halved(&self) -> Self {
        let mean = |[a, b, c, d]: [Vec3; 4]| ((a + b) + (c + d)) * 0.25;
        Self {
            width: self.width.div_ceil(2),
            height: self.height.div_ceil(2),
            pixels: halved_level(self.width, &self.pixels, Vec3::ZERO, mean),
        }
    }

    /// Twice as large, bilinear: each pixel keeps its light.
    fn doubled(&self, width: usize, height: usize) -> Self {
        // A pixel lies a quarter of a coarse pixel beside the middle of its parent.
        let beside = |c: isize| c / 2 + if c % 2 == 0 { -1 } else { 1 };
        Self::from_fn(width, height, |x, y| {
            let row = |y: isize| self.at(x / 2, y) * 0.75 + self.at(beside(x), y) * 0.25;
            row(y / 2) * 0.75 + row(beside(y)) * 0.25
        })
    }

    fn gaussian(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let weight = |i: isize| (-0.5 * (i as f32 / sigma).powi(2)).exp();
        let total: f32 = (-reach..=reach).map(weight).sum();
        let kernel: Vec<(isize, f32)> = (-reach..=reach).map(|i| (i, weight(i) / total)).collect();
        let (width, height) = (self.width, self.height);
        let sum = |at: &dyn Fn(isize) -> Vec3| kernel.iter().map(|&(i, w)| at(i) * w).sum();
        let across = Self::from_fn(width, height, |x, y| sum(&|i| self.at(x + i, y)));
        Self::from_fn(width, height, |x, y| sum(&|i| across.at(x, y + i)))
    }
}

/// Filtered by a Gaussian with a standard deviation of `sigma` pixels. Halving `n` times and doubling back adds a variance of
/// `(4^n - 1) / 3`; the Gaussian in between adds the rest.
fn blur(layer: &Layer, sigma: f32) -> Layer {
    if sigma < 0.1 {
        return Layer { pixels: layer.pixels.clone(), ..*layer };
    }
    let levels = (sigma / MIN_SIGMA).log2().floor().max(0.0) as i32;
    let mut finer_sizes = Vec::new();
    let mut small = Layer { pixels: layer.pixels.clone(), ..*layer };
    for _ in 0..levels {
        finer_sizes.push((small.width, small.height));
        small = small.halved();
    }
    let scale = 4f32.powi(levels);
    small = small.gaussian(((sigma * sigma - (scale - 1.0) / 3.0) / scale).sqrt());
    finer_sizes.iter().rev().fold(small, |coarse, &(width, height)| coarse.doubled(width, height))
}

// From the light of a scene to what a screen can show.

/// How bright light is brought into the picture's range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ToneMap {
    /// Cut off.
    #[default]
    #[serde(rename = "none", alias = "clip")]
    Clip,
    /// Reinhard's curve of the luminance, hues kept: `L (1 + L / 16) / (1 + L)`, which is 1 at 4.
    // E. Reinhard et al., "Photographic Tone Reproduction for Digital Images", 2002, equation 4, with `white` 4.
    Reinhard,
    /// A film-like curve of each channel: `x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14)`.
    // Close to that of the Academy Color Encoding System (K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2015).
    Filmic,
}

impl ToneMap {
    /// The smallest luminance that Reinhard's curve makes one.
    pub const WHITE: f32 = 4.0;

    /// Maps linear RGB of the scene to linear RGB of the screen, 0..1.
    pub fn map(self, color: Vec3) -> Vec3 {
        let color = color.max(Vec3::ZERO);
        let mapped = match self {
            Self::Clip => color,
            Self::Reinhard => {
                let l = luminance(color);
                color * ((1.0 + l / (Self::WHITE * Self::WHITE)) / (1.0 + l))
            }
            Self::Filmic => {
                // Beyond this the curve is one, and its squares would overflow.
                let x = color.min(Vec3::splat(1e6));
                x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
            }
        };
        mapped.clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Luminance of linear RGB with the primaries of sRGB (ITU-R BT.709).
pub fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

// What is seen behind everything.

/// What is seen where no surface is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Nothing: the picture gets an alpha channel.
    Transparent,
    /// Linear RGB.
    Color(Vec3),
    /// Linear RGB from the first row to the last.
    Gradient {
        /// First row.
        top: Vec3,
        /// Last row.
        bottom: Vec3,
    },
    /// The surroundings that light the scene, as a sky box.
    Environment {
        /// Perceptual roughness, 0..1, by which they are blurred, as if seen in a rough mirror; 0 shows them sharp.
        blur: f32,
    },
}

impl Default for Background {
    /// A light grey gradient, darker below.
    fn default() -> Self {
        Self::Gradient { top: Vec3::splat(0.62), bottom: Vec3::splat(0.34) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dark picture with one bright pixel.
    fn spark(width: u32, height: u32, [x, y]: [u32; 2], light: f32) -> Picture {
        let mut rgba = vec![[0.0, 0.0, 0.0, 1.0]; (width * height) as usize];
        rgba[(y * width + x) as usize] = [light, 0.5 * light, 0.0, 1.0];
        Picture { width, height, rgba }
    }

    #[test]
    fn halos_keep_the_light() {
        for (width, height, at) in [(256, 256, [128, 128]), (301, 253, [150, 121])] {
            let picture = spark(width, height, at, 100.0);
            let glow = Glow { threshold: None, strength: 0.3, radius: 0.06 };
            let sum: Vec3 = halo(&picture, &glow).iter().sum();
            assert!((sum / Vec3::new(30.0, 15.0, 1.0) - Vec3::new(1.0, 1.0, 0.0)).length() < 0.01, "{sum}");
        }
    }

    #[test]
    fn gaussians_have_their_width() {
        let bright = spark(400, 400, [201, 198], 1.0);
        let pixels = bright.rgba.iter().map(|p| Vec3::splat(p[0])).collect();
        let layer = Layer { width: 400, height: 400, pixels };
        for sigma in [1.0, 3.0, 5.0, 12.0, 30.0] {
            let blurred = blur(&layer, sigma);
            let (mut total, mut second) = (0.0, 0.0);
            for (i, p) in blurred.pixels.iter().enumerate() {
                let x = (i % 400) as f32 - 201.0;
                total += p.x;
                second += p.x * x * x;
            }
            let seen = (second / total).sqrt();
            assert!((seen / sigma - 1.0).abs() < 0.03, "{sigma}: {seen}");
        }
    }

    #[test]
    fn halos_do_not_depend_on_the_resolution() {
        let glow = Glow { radius: 0.08, ..Glow::default() };
        let large = halo(&spark(256, 256, [128, 128], 4.0), &glow);
        let small = halo(&spark(128, 128, [64, 64], 1.0), &glow);
        // The same light, seen at the same places of the picture.
        for (x, y) in [(64, 50), (80, 64), (70, 70)] {
            let (s, l) = (small[y * 128 + x].x, large[2 * y * 256 + 2 * x].x);
            assert!((s * 0.25 / (l * 0.25) - 1.0).abs() < 0.15, "{x},{y}: {s} against {l}");
        }
    }

    #[test]
    fn only_the_excess_glows_and_transparency_gives_way() {
        let glow = Glow { threshold: Some(1.0), strength: 0.5, radius: 0.05 };
        assert!(halo(&spark(64, 64, [32, 32], 1.0), &glow).iter().all(|h| *h == Vec3::ZERO));
        let clear = Picture { width: 64, height: 64, rgba: vec![[0.0; 4]; 64 * 64] };
        let lit = clear.with_glow(&spark(64, 64, [32, 32], 100.0), &glow);
        let [r, _, _, alpha] = lit.pixel(34, 32);
        assert!(alpha > 0.0 && alpha < 1.0 && r > 0.9, "{r} {alpha}");
    }
}
