//! Cut-outs whose coverage survives minification.
//!
//! Averaging draws the alpha of fine parts towards the mean of their surroundings; compared with a fixed threshold, leaves
//! thin out, or close up, with every level. So the alpha of each level is scaled until the same share of it passes the test as
//! of level 0 (I. Castaño, "Computing Alpha Mipmaps", 2010).

use std::sync::Arc;

use fantex_mesh::{AlphaMode, Material};

use super::MaterialTextures;
use crate::{Image, ImageTexture};

/// How the levels of an image have to be scaled so that a cut-out covers the same share at each.
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaCoverage {
    covered: f32,
    scales: Vec<f32>,
}

/// Largest factor of a level's alpha.
const MOST_SCALE: f32 = 64.0;

/// Points per texel along each axis at which the interpolated alpha of a level is looked up.
const POINTS: u32 = 4;

/// Levels with more texels are judged by their texels alone.
const MOST_INTERPOLATED: u32 = 1 << 14;

impl AlphaCoverage {
    /// Measures the coverage of a cut-out with this threshold, 0..1, at every level of an image that repeats.
    pub fn of(texture: &ImageTexture, threshold: f32) -> Self {
        let base = alphas(texture.level(0));
        let covered = base.iter().filter(|&&a| a >= threshold).count() as f32 / base.len() as f32;
        let scale = |level: usize| match level {
            0 => 1.0,
            _ => scale_to(alphas(texture.level(level)), threshold, covered),
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

    /// Factor of the alpha that is filtered between levels.
    pub fn scale(&self, level: f32) -> f32 {
        let last = self.scales.len() - 1;
        let level = level.clamp(0.0, last as f32);
        let fine = level as usize;
        let (a, b) = (self.scales[fine], self.scales[(fine + 1).min(last)]);
        a + (b - a) * (level - fine as f32)
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

/// Lets the cut-outs of materials cover the same share at every level of their textures; `textures` has an entry per material.
pub fn preserve_coverage(materials: &[Material], textures: &mut [MaterialTextures]) {
    for (material, textures) in materials.iter().zip(textures) {
        if let (AlphaMode::Mask(threshold), Some(layer)) = (material.alpha, &mut textures.base_color) {
            // The alpha that is compared is the texel's times the factor's.
            let threshold = threshold / material.base_color.w.max(1e-3);
            let texture = ImageTexture::clone(&layer.texture).with_preserved_coverage(threshold);
            layer.texture = Arc::new(texture);
        }
    }
}

/// The alpha over a level: of its texels, or of a level with few texels at points between them, too.
fn alphas(level: &Image) -> Vec<f32> {
    let (width, height) = (level.width, level.height);
    let texel = |x: u32, y: u32| level.linear_texel(x % width, y % height)[3];
    if width.saturating_mul(height) > MOST_INTERPOLATED {
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

/// The factor that lets a share of `covered` reach the threshold.
fn scale_to(mut alphas: Vec<f32>, threshold: f32, covered: f32) -> f32 {
    if covered <= 0.0 || covered >= 1.0 {
        return 1.0;
    }
    let last = alphas.len() - 1;
    let uncovered = (((1.0 - covered) * alphas.len() as f32).round() as usize).min(last);
    let (_, &mut least_covered, _) = alphas.select_nth_unstable_by(uncovered, f32::total_cmp);
    // What is fully transparent stays so.
    if least_covered > 0.0 {
        (threshold / least_covered).clamp(1.0 / MOST_SCALE, MOST_SCALE)
    } else {
        MOST_SCALE
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::{Filter, SampleOptions};

    /// Leaves: soft blobs of random size and place.
    fn leaves(side: u32) -> ImageTexture {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let blobs: Vec<_> = (0..60).map(|_| [random(), random(), 0.015 + 0.04 * random()]).collect();
        let texel = |i: u32| {
            let [x, y] = [i % side, i / side].map(|c| (c as f32 + 0.5) / side as f32);
            let inside = |&[bx, by, r]: &[f32; 3]| {
                let wrapped = |d: f32| d - d.round();
                (1.5 - wrapped(x - bx).hypot(wrapped(y - by)) / r).clamp(0.0, 1.0)
            };
            let alpha = blobs.iter().map(inside).fold(0.0, f32::max);
            [0.1, 0.4, 0.1, alpha]
        };
        let texels: Vec<_> = (0..side * side).map(texel).collect();
        ImageTexture::new(Arc::new(Image::from_linear_rgba(side, side, &texels)))
    }

    fn covered_at(texture: &ImageTexture, level: usize, threshold: f32) -> f32 {
        let options = SampleOptions { filter: Filter::Trilinear, ..SampleOptions::default() };
        let width = (1 << level) as f32 / texture.size()[0] as f32;
        let points = 300;
        let seen = (0..points * points).filter(|i| {
            let uv = Vec2::new((i % points) as f32, (i / points) as f32) / points as f32;
            texture.sample(uv, [Vec2::X * width, Vec2::Y * width], &options)[3] >= threshold
        });
        seen.count() as f32 / (points * points) as f32
    }

    #[test]
    fn cut_outs_cover_the_same_share_at_every_level() {
        let threshold = 0.6;
        let plain = leaves(256);
        let kept = plain.clone().with_preserved_coverage(threshold);
        let near = covered_at(&plain, 0, threshold);
        assert!((AlphaCoverage::of(&plain, threshold).covered() - near).abs() < 0.01);
        for level in 1..5 {
            let (without, with) = (covered_at(&plain, level, threshold), covered_at(&kept, level, threshold));
            assert!((with / near - 1.0).abs() < 0.04, "level {level}: {with} instead of {near}");
            assert!((with - near).abs() <= (without - near).abs() + 0.01, "level {level}: {without}");
        }
        let lost = covered_at(&plain, 4, threshold) / near;
        assert!(lost < 0.9, "without, a good part is lost: {lost}");
    }

    #[test]
    fn empty_and_full_images_stay_so() {
        for alpha in [0.0, 1.0] {
            let texels = vec![[1.0, 1.0, 1.0, alpha]; 64];
            let texture = ImageTexture::new(Arc::new(Image::from_linear_rgba(8, 8, &texels)));
            let coverage = AlphaCoverage::of(&texture, 0.5);
            assert_eq!(coverage.covered(), alpha);
            assert!(coverage.scales().iter().all(|s| *s == 1.0), "{coverage:?}");
            assert_eq!(coverage.scale(1.5), 1.0);
        }
    }
}
