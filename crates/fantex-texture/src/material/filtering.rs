//! What becomes of cut-outs and highlights under minification.

use std::collections::HashMap;
use std::sync::Arc;

use fantex_mesh::{AlphaMode, Material};
use glam::Vec3;

use super::MaterialTextures;
use crate::{ColorSpace, Depth, Image, ImageTexture, Samples};

// Cut-outs whose coverage survives minification.
//
// Averaging draws the alpha of fine parts towards the mean of their surroundings; compared with a fixed threshold, leaves
// thin out, or close up, with every level. So the alpha of each level is scaled until the same share of it passes the test as
// of level 0 (I. Castaño, "Computing Alpha Mipmaps", 2010).

/// How the levels of an image have to be scaled so that a cut-out covers the same share at each.
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaCoverage {
    covered: f32,
    scales: Vec<f32>,
}

/// Largest factor of a level's alpha.
const MAX_SCALE: f32 = 64.0;

/// Points per texel along each axis at which the interpolated alpha of a level is looked up.
const POINTS: u32 = 4;

/// Levels with more texels are judged by their texels alone.
const MAX_INTERPOLATED: u32 = 1 << 14;

impl AlphaCoverage {
    /// Measures the coverage of a cut-out with this threshold, 0..1, at every level of an image that repeats.
    pub fn of(texture: &ImageTexture, threshold: f32) -> Self {
        let base = alphas(texture.level(0));
        let covered = base.iter().filter(|&&a| a >= threshold).count() as f32 / base.len() as f32;
        let scale = |level: usize| match level {
            0 => 1.0,
            _ => coverage_scale(alphas(texture.level(level)), threshold, covered),
        };
        Self { covered, scales: (0..texture.level_count()).map(scale).collect() }
    }

    /// Share of level 0 whose alpha reaches the threshold, 0..1.
    pub fn covered(&self) -> f32 {
        self.covered
    }

    /// Factor of the alpha of every level, that of level 0 is one.
    pub fn scales(&self) -> &[f32] {
        &self.scales
    }
}

impl ImageTexture {
    /// The same image with the alpha of its coarser levels scaled so that a cut-out with this threshold covers the same share
    /// at every level; see [`AlphaCoverage`]. Level 0 and the colours stay as they are.
    pub fn with_preserved_coverage(self, threshold: f32) -> Self {
        let scales = AlphaCoverage::of(&self, threshold).scales;
        self.with_scaled_alpha(&scales)
    }
}

/// Lets the cut-outs of materials cover the same share at every level of their textures; `textures` has an entry per material. Those that
/// share an image still do, where their thresholds are the same.
pub fn preserve_coverage(materials: &[Material], textures: &mut [MaterialTextures]) {
    // With each image what it becomes: while it is kept, its address is its alone.
    let mut preserved: HashMap<_, [Arc<ImageTexture>; 2]> = HashMap::new();
    for (material, textures) in materials.iter().zip(textures) {
        if let (AlphaMode::Mask(threshold), Some(layer)) = (material.alpha, &mut textures.base_color) {
            // The alpha that is compared is the texel's times the factor's.
            let threshold = threshold / material.base_color.w.max(1e-3);
            let [_, texture] = preserved
                .entry((Arc::as_ptr(&layer.texture), threshold.to_bits()))
                .or_insert_with(|| [layer.texture.clone(), with_coverage(&layer.texture, threshold)]);
            layer.texture = Arc::clone(texture);
        }
    }
}

/// As [`ImageTexture::with_preserved_coverage`], of which only what changes is another image.
fn with_coverage(texture: &Arc<ImageTexture>, threshold: f32) -> Arc<ImageTexture> {
    if !texture.level(0).has_alpha() {
        return Arc::clone(texture);
    }
    Arc::new(ImageTexture::clone(texture).with_preserved_coverage(threshold))
}

/// The alpha over a level: of its texels, or of a level with few texels at points between them, too.
fn alphas(level: &Image) -> Vec<f32> {
    let (width, height) = (level.width, level.height);
    let texel = |x: u32, y: u32| level.linear_texel(x % width, y % height)[3];
    if width.saturating_mul(height) > MAX_INTERPOLATED {
        return (0..height).flat_map(|y| (0..width).map(move |x| texel(x, y))).collect();
    }
    let mut values = Vec::with_capacity((width * height * POINTS * POINTS) as usize);
    for y in 0..height {
        for x in 0..width {
            let corners = [texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)];
            for i in 0..POINTS * POINTS {
                let [s, t] = [i % POINTS, i / POINTS].map(|c| (c as f32 + 0.5) / POINTS as f32);
                let row = |a: f32, b: f32| a + (b - a) * s;
                let (top, bottom) = (row(corners[0], corners[1]), row(corners[2], corners[3]));
                values.push(top + (bottom - top) * t);
            }
        }
    }
    values
}

/// The factor that lets a share of `covered` of some alphas (at least one) reach the threshold of a cut-out; at most 64.
pub(crate) fn coverage_scale(mut alphas: Vec<f32>, threshold: f32, covered: f32) -> f32 {
    if covered <= 0.0 || covered >= 1.0 {
        return 1.0;
    }
    let last = alphas.len() - 1;
    let uncovered = (((1.0 - covered) * alphas.len() as f32).round() as usize).min(last);
    let (_, &mut least_covered, _) = alphas.select_nth_unstable_by(uncovered, f32::total_cmp);
    // What is fully transparent stays so.
    if least_covered > 0.0 {
        (threshold / least_covered).clamp(1.0 / MAX_SCALE, MAX_SCALE)
    } else {
        MAX_SCALE
    }
}

// Roughness that grows by what averaging takes from the normals.
//
// Where a footprint covers bumps, the mean of their normals is shorter than one. The lost length is the spread of the
// microfacets that the mean no longer shows; added to that of the material, the highlight keeps its width and energy under
// minification. M. Toksvig, "Mipmapping Normal Maps", 2005, gives the variance as `(1 - |n|) / |n|`; M. Olano and D. Baker,
// "LEAN Mapping", 2010, measure it from second moments of slopes. Both add to `alpha^2 / 2`, the slope variance of a
// microfacet distribution with `alpha = roughness^2`.

/// The perceptual roughness (0..1) of a surface with microfacets of `perceptual_roughness` on bumps whose slopes have the
/// variance `slope_variance` along each axis of the tangent plane. Negative variances (rounding) and NaN count as none.
pub fn roughness_with_variance(perceptual_roughness: f32, slope_variance: f32) -> f32 {
    let alpha2 = perceptual_roughness.clamp(0.0, 1.0).powi(4);
    (alpha2 + 2.0 * slope_variance.max(0.0)).min(1.0).sqrt().sqrt()
}

/// Shortest mean of unit normals that rounding to bytes explains.
pub const ROUNDED_LENGTH: f32 = 1.0 - 1.0 / 255.0;

/// Longest normal that is left as it is: rounding to bytes explains it, too.
const LONGEST: f32 = 1.01;

impl Image {
    /// The picture of encoded normals (`[-1,1]` as `[0,1]`) with all of them of unit length: those that a lossy file or a painter has made
    /// shorter would else count as spread of bumps. None is shorter than [`ROUNDED_LENGTH`] in the end. Texels that are no direction, and
    /// images with fewer than three linear channels, stay as they are.
    #[must_use]
    pub fn with_unit_normals(mut self) -> Self {
        let channels = usize::from(self.channels);
        let is_linear = self.space == ColorSpace::Linear || self.samples.depth() == Depth::F32;
        if channels < 3 || !is_linear {
            return self;
        }
        match &mut self.samples {
            Samples::U8(samples) => {
                let unit = |byte: u8| f32::from(byte) / 255.0;
                bring_to_unit_length(samples, channels, unit, |number| number as u8, 255.0);
            }
            Samples::U16(samples) => {
                let unit = |number: u16| f32::from(number) / 65535.0;
                bring_to_unit_length(samples, channels, unit, |number| number as u16, 65535.0);
            }
            Samples::F32(samples) => {
                for texel in samples.chunks_exact_mut(channels) {
                    let normal = decoded(texel, |number| number);
                    if let Some(normal) = normal.try_normalize().filter(|_| is_off(normal)) {
                        texel[..3].copy_from_slice(&(normal * 0.5 + 0.5).to_array());
                    }
                }
            }
        }
        self
    }
}

fn decoded<T: Copy>(texel: &[T], unit: impl Fn(T) -> f32) -> Vec3 {
    Vec3::new(unit(texel[0]), unit(texel[1]), unit(texel[2])) * 2.0 - 1.0
}

fn is_off(normal: Vec3) -> bool {
    !(ROUNDED_LENGTH..=LONGEST).contains(&normal.length())
}

/// Normals in the first three of some channels of whole numbers up to `most`.
fn bring_to_unit_length<T: Copy>(
    samples: &mut [T],
    channels: usize,
    unit: impl Fn(T) -> f32,
    sample: impl Fn(f32) -> T,
    most: f32,
) {
    for texel in samples.chunks_exact_mut(channels) {
        let normal = decoded(texel, &unit);
        let Some(normal) = normal.try_normalize().filter(|_| is_off(normal)) else { continue };
        let mut put = |round: fn(f32) -> f32| {
            for (own, coordinate) in texel.iter_mut().zip(normal.to_array()) {
                // Upwards is away from the middle.
                let step = round(coordinate.abs() * 0.5 * most - 0.5);
                *own = sample(0.5 * most + (step + 0.5).min(0.5 * most).copysign(coordinate));
            }
            decoded(texel, &unit).length()
        };
        if put(f32::round) < ROUNDED_LENGTH {
            put(f32::ceil);
        }
    }
}
