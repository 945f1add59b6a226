//! A filtered image.
//!
//! Level 0 is the image as it was given (bytes stay bytes); the coarser levels are described in `filter/mipmap.rs`. With all
//! levels, an RGB image takes 5 bytes per texel (16 as floats), an RGBA image 6.7.
//!
//! Nanoseconds per look-up on one core at about 2.5 GHz (`tests/texture/speed.rs`, slanted walk over 2048x2048 texels;
//! `sample` with a footprint of 8x2 texels):
//!
//! | look-up | RGB bytes | RGBA bytes | RGB floats |
//! |---|---|---|---|
//! | `sample_level0_bilinear` | 22 | 30 | 21 |
//! | `AreaSampler::sample`, 0.4 texels wide | 33 | 43 | 30 |
//! | 1 texel | 72 | 75 | 68 |
//! | 2 texels | 98 | 104 | 94 |
//! | 4 texels | 500 | 720 | 470 |
//! | 8 texels | 1600 | 2300 | 1500 |
//! | `sample_area` (prepares the footprint every time) | 26 more | 27 more | 25 more |
//! | `sample`: nearest | 20 | 25 | 20 |
//! | bilinear | 27 | 31 | 24 |
//! | bicubic | 63 | 76 | 55 |
//! | trilinear | 57 | 61 | 52 |
//! | anisotropic | 155 | 177 | 134 |
//! | EWA | 610 | 690 | 600 |
//!
//! On white noise, the worst case, `sample_area` is off by 0.003 to 0.009 (root mean square, of texels in `[0,1]`).

use std::sync::Arc;

use glam::{Vec2, Vec4};

use crate::Image;
use crate::filter::{self, AreaPlan, FootprintAxes, resolve};

/// What the alpha channel of an image means when texels are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AlphaUse {
    /// The share of the texel that is covered: colours are weighted by it.
    Coverage,
    /// A fourth number (height, roughness, ignored): it is averaged by itself.
    Independent,
}

/// What lies outside `[0,1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The edge texel.
    Clamp,
    /// Transparent black.
    Border,
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored.
    Mirror,
}

/// Reconstruction and anti-aliasing of an image look-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The nearest texel of level 0.
    Nearest,
    /// Four texels of level 0.
    Bilinear,
    /// Sixteen texels of level 0 (Catmull-Rom).
    Bicubic,
    /// Two mip levels, isotropic footprint.
    #[default]
    Trilinear,
    /// Several trilinear probes along the longer axis of the footprint.
    Anisotropic,
    /// Elliptical weighted average (Heckbert 1989): the reference.
    Ewa,
}

/// Options of a look-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleOptions {
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// Reconstruction and anti-aliasing.
    pub filter: Filter,
    /// Longest ratio of the footprint's axes that `Anisotropic` and `Ewa` honour, 1 to
    /// [`MAX_ANISOTROPY`](filter::MAX_ANISOTROPY).
    pub max_anisotropy: f32,
}

impl Default for SampleOptions {
    fn default() -> Self {
        Self { wrap: [Wrap::Repeat; 2], filter: Filter::Trilinear, max_anisotropy: 16.0 }
    }
}

/// An image with its mip levels (any size, down to 1x1, filtered in linear light).
#[derive(Clone, Debug)]
pub struct ImageTexture {
    base: Arc<Image>,
    /// Level 1 and up.
    coarser: Vec<Image>,
    alpha: AlphaUse,
}

impl ImageTexture {
    /// Builds the mip levels; alpha, if there is any, is the coverage of a texel.
    ///
    /// # Panics
    /// If the image has a zero side or its samples do not fit its size (no image that was loaded does).
    pub fn new(base: Arc<Image>) -> Self {
        Self::with_alpha_use(base, AlphaUse::Coverage)
    }

    /// Builds the mip levels. Where alpha is coverage, every filter weights a texel's colour by its alpha, so that the
    /// colour of transparent texels does not bleed; otherwise the four channels are filtered independently.
    ///
    /// # Panics
    /// If the image has a zero side or its samples do not fit its size (no image that was loaded does).
    pub fn with_alpha_use(base: Arc<Image>, alpha: AlphaUse) -> Self {
        let expected = base.width as usize * base.height as usize * usize::from(base.channels);
        assert!(expected > 0 && (1..=4).contains(&base.channels), "an image texture needs texels");
        assert_eq!(base.samples.len(), expected, "samples of {} x {} texels", base.width, base.height);
        let alpha = if base.has_alpha() { alpha } else { AlphaUse::Independent };
        let coarser = filter::build_levels(&base, alpha);
        Self { base, coarser, alpha }
    }

    /// Width and height of level 0.
    pub fn size(&self) -> [u32; 2] {
        [self.base.width, self.base.height]
    }

    /// Levels, at least 1.
    pub fn level_count(&self) -> usize {
        1 + self.coarser.len()
    }

    /// A level: 0 is the image itself, the last has one texel.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level(&self, level: usize) -> &Image {
        if level == 0 { &self.base } else { &self.coarser[level - 1] }
    }

    /// With the alpha of every coarser level multiplied by its factor (`scales[0]` is not used), at most one.
    pub(crate) fn with_scaled_alpha(mut self, scales: &[f32]) -> Self {
        if self.base.has_alpha() {
            for (level, &scale) in self.coarser.iter_mut().zip(&scales[1..]) {
                level.scale_alpha(scale);
            }
        }
        self
    }

    /// Bytes of all levels.
    pub fn byte_len(&self) -> usize {
        self.base.byte_len() + self.coarser.iter().map(Image::byte_len).sum::<usize>()
    }

    /// Filtered linear RGBA (straight alpha; grey images give r = g = b, images without alpha give 1).
    /// `footprint` holds the derivatives of `uv` along the pixel's x and y, in the units of `uv`.
    pub fn sample(&self, uv: Vec2, footprint: [Vec2; 2], options: &SampleOptions) -> [f32; 4] {
        let wrap = options.wrap;
        let sum = match options.filter {
            Filter::Nearest => filter::nearest(&self.base, self.alpha, uv, wrap),
            Filter::Bilinear => filter::bilinear(&self.base, self.alpha, uv, wrap),
            Filter::Bicubic => filter::bicubic(&self.base, self.alpha, uv, wrap),
            Filter::Trilinear => self.trilinear(uv, wrap, self.axes(footprint).major),
            Filter::Anisotropic => self.anisotropic(uv, &self.axes(footprint), options),
            Filter::Ewa => self.ewa(uv, &self.axes(footprint), options),
        };
        resolve(sum, self.alpha)
    }

    /// Linear RGBA interpolated between the four nearest texels of level 0.
    #[inline]
    pub fn sample_level0_bilinear(&self, uv: Vec2, wrap: [Wrap; 2]) -> [f32; 4] {
        resolve(filter::bilinear(&self.base, self.alpha, uv, wrap), self.alpha)
    }

    /// The mean linear RGBA of the bilinear reconstruction over the parallelogram around `uv` whose edges are
    /// `footprint[0]` and `footprint[1]`, in the units of `uv`.
    ///
    /// Level 0 is used as long as the shorter edge has less than 16 texels and the longer one less than 512; beyond, the
    /// coarser level at which this holds again, with 8 to 16 of its texels along the shorter edge.
    pub fn sample_area(&self, uv: Vec2, footprint: [Vec2; 2], wrap: [Wrap; 2]) -> [f32; 4] {
        self.area_sampler(footprint, wrap).sample(uv)
    }

    /// As [`ImageTexture::sample_area`], of the nearest-texel reconstruction (square texels).
    pub fn sample_area_nearest(&self, uv: Vec2, footprint: [Vec2; 2], wrap: [Wrap; 2]) -> [f32; 4] {
        let level = self.level(self.area_level(footprint));
        let plan = AreaPlan::nearest(level, footprint, wrap);
        resolve(plan.nearest_mean(level, self.alpha, uv), self.alpha)
    }

    /// [`ImageTexture::sample_area`] prepared for many look-ups with the same footprint, such as the texels of a triangle.
    #[inline]
    pub fn area_sampler(&self, footprint: [Vec2; 2], wrap: [Wrap; 2]) -> AreaSampler<'_> {
        let level = self.level(self.area_level(footprint));
        AreaSampler { level, alpha: self.alpha, plan: AreaPlan::bilinear(level, footprint, wrap) }
    }

    fn area_level(&self, footprint: [Vec2; 2]) -> usize {
        let [first, second] = footprint.map(|edge| self.texels(edge).length_squared());
        let (short2, long2) = (first.min(second), first.max(second));
        if short2 < 256.0 && long2 < 262_144.0 {
            return 0;
        }
        let excess = (short2.sqrt() / 8.0).max(long2.sqrt() / 256.0);
        (excess.log2().max(0.0) as usize).min(self.coarser.len())
    }

    /// A vector of uv space in texels of level 0.
    fn texels(&self, uv: Vec2) -> Vec2 {
        uv * Vec2::new(self.base.width as f32, self.base.height as f32)
    }

    fn axes(&self, footprint: [Vec2; 2]) -> FootprintAxes {
        FootprintAxes::new(self.texels(footprint[0]), self.texels(footprint[1]))
    }

    /// The two levels between which a texel has the width `texels`, and the share of the coarser one.
    fn levels_for(&self, texels: f32) -> (usize, usize, f32) {
        let last = self.coarser.len();
        let lod = if texels > 1.0 { texels.log2().min(last as f32) } else { 0.0 };
        let fine = lod as usize;
        (fine, (fine + 1).min(last), lod - fine as f32)
    }

    fn trilinear(&self, uv: Vec2, wrap: [Wrap; 2], width_texels: f32) -> Vec4 {
        let (fine, coarse, share) = self.levels_for(width_texels);
        let value = filter::bilinear(self.level(fine), self.alpha, uv, wrap);
        if share == 0.0 {
            return value;
        }
        value.lerp(filter::bilinear(self.level(coarse), self.alpha, uv, wrap), share)
    }

    /// Probes as wide as the shorter axis, in a row along the longer one.
    fn anisotropic(&self, uv: Vec2, axes: &FootprintAxes, options: &SampleOptions) -> Vec4 {
        let width = axes.limited_minor(options.max_anisotropy).max(1.0);
        let probes = (axes.major / width).ceil();
        if probes.is_nan() || probes <= 1.0 {
            return self.trilinear(uv, options.wrap, width);
        }
        let span = axes.direction * axes.major / Vec2::new(self.base.width as f32, self.base.height as f32);
        let mut sum = Vec4::ZERO;
        for probe in 0..probes as u32 {
            let along = (probe as f32 + 0.5) / probes - 0.5;
            sum += self.trilinear(uv + span * along, options.wrap, width);
        }
        sum / probes
    }

    fn ewa(&self, uv: Vec2, axes: &FootprintAxes, options: &SampleOptions) -> Vec4 {
        let axes = axes.limited(options.max_anisotropy);
        let (fine, coarse, share) = self.levels_for(axes.minor / filter::EWA_MINOR_TEXELS);
        let value = self.ewa_at(fine, uv, &axes, options.wrap);
        if share == 0.0 {
            return value;
        }
        value.lerp(self.ewa_at(coarse, uv, &axes, options.wrap), share)
    }

    fn ewa_at(&self, index: usize, uv: Vec2, axes: &FootprintAxes, wrap: [Wrap; 2]) -> Vec4 {
        let level = self.level(index);
        // On the single texel of the last level nothing is left to weigh, and the ellipse may be of any size.
        if index == self.coarser.len() {
            return filter::bilinear(level, self.alpha, uv, wrap);
        }
        let scale = Vec2::new(
            level.width as f32 / self.base.width as f32,
            level.height as f32 / self.base.height as f32,
        );
        let [along, across] = axes.vectors().map(|axis| axis * scale);
        filter::ewa(level, self.alpha, uv, &FootprintAxes::new(along, across), wrap)
    }
}

/// Means over equal parallelograms of one texture; see [`ImageTexture::area_sampler`].
#[derive(Clone, Copy, Debug)]
pub struct AreaSampler<'a> {
    level: &'a Image,
    alpha: AlphaUse,
    plan: AreaPlan,
}

impl AreaSampler<'_> {
    /// The mean linear RGBA over the parallelogram around `uv`.
    #[inline]
    pub fn sample(&self, uv: Vec2) -> [f32; 4] {
        resolve(self.plan.bilinear_mean(self.level, self.alpha, uv), self.alpha)
    }
}
