//! A filtered image.
//!
//! Level 0 is the image as it was given (bytes stay bytes); the coarser levels are described in `filter/mipmap.rs`. With all
//! levels, an RGB image takes 5 bytes per texel (16 as floats), an RGBA image 6.7.
//!
//! Nanoseconds per look-up on one core at about 2.5 GHz (`examples/texture_speed.rs` of `fantex-bench`, slanted walk over
//! 2048x2048 texels):
//!
//! | look-up | RGB bytes | RGBA bytes | RGB floats |
//! |---|---|---|---|
//! | `AreaSampler::sample`, 0.4 texels wide | 33 | 43 | 30 |
//! | 1 texel | 72 | 75 | 68 |
//! | 2 texels | 98 | 104 | 94 |
//! | 4 texels | 500 | 720 | 470 |
//! | 8 texels | 1600 | 2300 | 1500 |
//! | `sample_area` (prepares the footprint every time) | 26 more | 27 more | 25 more |
//!
//! `sample` on 4096x4096 opaque RGBA bytes (`fantex bench sample`): bilinear 17, bicubic 65, trilinear 47 (by the scalar
//! reference 58; at random places 250, where a random cache line takes 15), anisotropic 8:1 203, EWA 8:1 473. `sample_all`, the
//! same for many points at once: bilinear 5, trilinear 9 (at random places 50), anisotropic 8:1 95.
//!
//! On white noise, the worst case, `sample_area` is off by 0.003 to 0.009 (root mean square, of texels in `[0,1]`).

use std::ops::Range;
use std::sync::Arc;

use fantex_base::bits;
use fantex_base::input::{Held, hold};
use glam::{Vec2, Vec4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::filter::{
    AreaBlock, AreaPlan, BLOCK, Colors, FootprintAxes, LevelPair, Levels, LookUp, Probes, Steps, TexelUse,
    Workspace, resolve,
};
use crate::{Image, Samples, UvPoint, filter};

/// What the alpha channel of an image means when texels are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AlphaUse {
    /// The share of the texel that is covered: colours are weighted by it.
    Coverage,
    /// A fourth number.
    Independent,
}

/// What lies outside `[0,1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Wrap {
    /// The edge texel.
    Clamp,
    /// Transparent black, or the colour that the border is given.
    Border,
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored.
    Mirror,
}

/// Reconstruction and anti-aliasing of an image look-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// The nearest texel of level 0.
    Nearest,
    /// Four texels of level 0.
    Bilinear,
    /// Sixteen texels of level 0 (Catmull-Rom).
    Bicubic,
    /// Sixteen texels of each of two mip levels, isotropic footprint: smooth nearby, anti-aliased afar.
    BicubicMipmaps,
    /// Two mip levels, isotropic footprint.
    #[default]
    Trilinear,
    /// Several trilinear probes along the longer axis of the footprint.
    Anisotropic,
    /// Elliptical weighted average (Heckbert 1989): the reference.
    Ewa,
}

impl Filter {
    /// All filters.
    pub const ALL: [Self; 7] = [
        Self::Nearest,
        Self::Bilinear,
        Self::Bicubic,
        Self::BicubicMipmaps,
        Self::Trilinear,
        Self::Anisotropic,
        Self::Ewa,
    ];
}

/// How textures are filtered: what of [`SampleOptions`] a renderer decides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterOptions {
    /// Reconstruction and anti-aliasing.
    pub filter: Filter,
    /// Longest ratio of the footprint's axes that `Anisotropic` and `Ewa` honour.
    pub max_anisotropy: f32,
}

impl Default for FilterOptions {
    /// Anisotropic, up to 16.
    fn default() -> Self {
        Self { filter: Filter::Anisotropic, max_anisotropy: 16.0 }
    }
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
    coarser: Arc<[Image]>,
    alpha: AlphaUse,
    /// The same beside a border, which may be transparent where no texel is.
    alpha_beside_border: AlphaUse,
    /// What lies outside for [`Wrap::Border`]; straight linear RGBA.
    border: Option<Vec4>,
    /// All levels, in the budget for input.
    _held: Held,
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
        // Colours stay what they are up to a border that is transparent. One number is a mask or a height, of which nobody asks
        // for alpha: it fades to the border's.
        let alpha_beside_border = if base.channels == 1 { AlphaUse::Independent } else { alpha };
        // Where all texels count the same, nothing needs to be weighed.
        let alpha = if is_opaque(&base) { AlphaUse::Independent } else { alpha };
        let coarser: Arc<[Image]> = filter::build_levels(&base, alpha).into();
        let bytes = base.byte_len() + coarser.iter().map(Image::byte_len).sum::<usize>();
        Self { base, coarser, alpha, alpha_beside_border, border: None, _held: hold(bytes as u64) }
    }

    /// The same texture (its texels are shared) with another colour outside for [`Wrap::Border`]: linear RGBA with straight
    /// alpha, which every filter blends in as if it were texels.
    #[must_use]
    pub fn with_border(&self, color: [f32; 4]) -> Self {
        let color = Vec4::from_array(color);
        Self { border: (color != Vec4::ZERO).then_some(color), ..self.clone() }
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
            for (level, &scale) in Arc::make_mut(&mut self.coarser).iter_mut().zip(&scales[1..]) {
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
        let (wrap, texels) = (options.wrap, self.texels(options.wrap));
        let sum = match options.filter {
            Filter::Nearest => filter::reconstructed::<1>(&self.base, texels, uv, wrap),
            Filter::Bilinear => filter::bilinear(&self.base, texels, uv, wrap),
            Filter::Bicubic => filter::reconstructed::<4>(&self.base, texels, uv, wrap),
            Filter::BicubicMipmaps => {
                let levels = self.levels_for(self.squared_major(footprint));
                self.blended(levels, |level| filter::reconstructed::<4>(level, texels, uv, wrap))
            }
            Filter::Trilinear => self.trilinear(uv, texels, wrap, self.squared_major(footprint)),
            Filter::Anisotropic => self.anisotropic(uv, texels, &self.axes(footprint), options),
            Filter::Ewa => self.ewa(uv, texels, &self.axes(footprint), options),
        };
        resolve(sum, texels.alpha)
    }

    /// As [`ImageTexture::sample`] without any fast path: what it is tested against. Both differ by rounding only, at most
    /// by 1e-4 of the texels' range.
    pub fn sample_by_reference(&self, uv: Vec2, footprint: [Vec2; 2], options: &SampleOptions) -> [f32; 4] {
        let (wrap, texels) = (options.wrap, self.texels(options.wrap));
        let axes = self.axes(footprint);
        let sum = match options.filter {
            Filter::Bilinear => filter::bilinear_reference(&self.base, texels, uv, wrap),
            Filter::Trilinear => self.trilinear_reference(uv, texels, wrap, axes.major),
            Filter::Anisotropic => {
                let width = axes.limited_minor(options.max_anisotropy).max(1.0);
                let probes = (axes.major / width).ceil().max(1.0);
                let span = self.in_uv(axes.direction * axes.major);
                let offset = |probe: u32| (probe as f32 + 0.5) / probes - 0.5;
                let points = (0..probes as u32).map(|probe| uv + span * offset(probe));
                let sum: Vec4 =
                    points.map(|point| self.trilinear_reference(point, texels, wrap, width)).sum();
                sum / probes
            }
            Filter::Nearest | Filter::Bicubic | Filter::BicubicMipmaps | Filter::Ewa => {
                return self.sample(uv, footprint, options);
            }
        };
        resolve(sum, texels.alpha)
    }

    /// Linear RGBA interpolated between the four nearest texels of level 0.
    #[inline]
    pub fn sample_level0_bilinear(&self, uv: Vec2, wrap: [Wrap; 2]) -> [f32; 4] {
        let texels = self.texels(wrap);
        resolve(filter::bilinear(&self.base, texels, uv, wrap), texels.alpha)
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
        let texels = self.texels(wrap);
        resolve(plan.nearest_mean(level, texels, uv), texels.alpha)
    }

    /// As [`ImageTexture::sample_area`], of the bicubic reconstruction of level 0, for edges of at most one texel.
    pub fn sample_area_bicubic(&self, uv: Vec2, footprint: [Vec2; 2], wrap: [Wrap; 2]) -> [f32; 4] {
        let texels = self.texels(wrap);
        // Two points of Gauss along each edge: exact for cubics.
        let [a, b] = footprint.map(|edge| edge * (0.5 / 3.0_f32.sqrt()));
        let points = [a + b, a - b, b - a, -a - b].map(|offset| uv + offset);
        let sum: Vec4 =
            points.iter().map(|&point| filter::reconstructed::<4>(&self.base, texels, point, wrap)).sum();
        resolve(sum / 4.0, texels.alpha)
    }

    /// [`ImageTexture::sample_area`] prepared for many look-ups with the same footprint, such as the texels of a triangle.
    #[inline]
    pub fn area_sampler(&self, footprint: [Vec2; 2], wrap: [Wrap; 2]) -> AreaSampler<'_> {
        let level = self.level(self.area_level(footprint));
        AreaSampler { level, texels: self.texels(wrap), plan: AreaPlan::bilinear(level, footprint, wrap) }
    }

    fn area_level(&self, footprint: [Vec2; 2]) -> usize {
        let [first, second] = footprint.map(|edge| self.in_texels(edge).length_squared());
        let (short2, long2) = (first.min(second), first.max(second));
        if short2 < 256.0 && long2 < 262_144.0 {
            return 0;
        }
        let excess = (short2.sqrt() / 8.0).max(long2.sqrt() / 256.0);
        (excess.log2().max(0.0) as usize).min(self.coarser.len())
    }

    #[inline(always)]
    fn texels(&self, wrap: [Wrap; 2]) -> TexelUse {
        if !wrap.contains(&Wrap::Border) {
            return TexelUse { alpha: self.alpha, border: None };
        }
        let alpha = self.alpha_beside_border;
        TexelUse { alpha, border: self.border.map(|color| TexelUse::weighed(color, alpha)) }
    }

    fn size_f32(&self) -> Vec2 {
        Vec2::new(self.base.width as f32, self.base.height as f32)
    }

    /// A vector of uv space in texels of level 0.
    fn in_texels(&self, uv: Vec2) -> Vec2 {
        uv * self.size_f32()
    }

    /// A vector in texels of level 0 in uv space.
    fn in_uv(&self, texels: Vec2) -> Vec2 {
        texels / self.size_f32()
    }

    fn axes(&self, footprint: [Vec2; 2]) -> FootprintAxes {
        FootprintAxes::new(self.in_texels(footprint[0]), self.in_texels(footprint[1]))
    }

    fn levels_for(&self, squared_texels: f32) -> LevelPair {
        LevelPair::for_squared_width(squared_texels, self.coarser.len())
    }

    fn trilinear(&self, uv: Vec2, texels: TexelUse, wrap: [Wrap; 2], squared_width: f32) -> Vec4 {
        self.blended(self.levels_for(squared_width), |level| filter::bilinear(level, texels, uv, wrap))
    }

    /// Between the values of two levels.
    #[inline(always)]
    fn blended(&self, levels: LevelPair, value_at: impl Fn(&Image) -> Vec4) -> Vec4 {
        let LevelPair { fine, coarse, share } = levels;
        let value = value_at(self.level(fine));
        if share == 0.0 { value } else { value.lerp(value_at(self.level(coarse)), share) }
    }

    /// Of the footprint's longer axis, in texels of level 0.
    fn squared_major(&self, footprint: [Vec2; 2]) -> f32 {
        let [dx, dy] = footprint.map(|step| self.in_texels(step));
        FootprintAxes::squared_major(dx, dy)
    }

    fn trilinear_reference(&self, uv: Vec2, texels: TexelUse, wrap: [Wrap; 2], width: f32) -> Vec4 {
        let last = self.coarser.len();
        let lod = if width > 1.0 { width.log2().min(last as f32) } else { 0.0 };
        let (fine, share) = (lod as usize, lod.fract());
        let value = filter::bilinear_reference(self.level(fine), texels, uv, wrap);
        let coarse = self.level((fine + 1).min(last));
        value.lerp(filter::bilinear_reference(coarse, texels, uv, wrap), share)
    }

    /// Probes as wide as the shorter axis, in a row along the longer one.
    fn anisotropic(&self, uv: Vec2, texels: TexelUse, axes: &FootprintAxes, options: &SampleOptions) -> Vec4 {
        let width = axes.limited_minor(options.max_anisotropy).max(1.0);
        let probes = (axes.major / width).ceil();
        if probes.is_nan() || probes <= 1.0 {
            return self.trilinear(uv, texels, options.wrap, width * width);
        }
        let span = self.in_uv(axes.direction * axes.major);
        let step = span / probes;
        let first = uv + 0.5 * (step - span);
        let row = |level: usize| {
            filter::bilinear_row(self.level(level), texels, first, step, probes as u32, options.wrap)
        };
        let LevelPair { fine, coarse, share } = self.levels_for(width * width);
        let sum = row(fine);
        let sum = if share == 0.0 { sum } else { sum.lerp(row(coarse), share) };
        sum / probes
    }

    fn ewa(&self, uv: Vec2, texels: TexelUse, axes: &FootprintAxes, options: &SampleOptions) -> Vec4 {
        let axes = axes.limited(options.max_anisotropy);
        let minor = axes.minor / filter::EWA_MINOR_TEXELS;
        let LevelPair { fine, coarse, share } = self.levels_for(minor * minor);
        let value = self.ewa_at(fine, uv, texels, &axes, options.wrap);
        if share == 0.0 {
            return value;
        }
        value.lerp(self.ewa_at(coarse, uv, texels, &axes, options.wrap), share)
    }

    fn ewa_at(
        &self,
        index: usize,
        uv: Vec2,
        texels: TexelUse,
        axes: &FootprintAxes,
        wrap: [Wrap; 2],
    ) -> Vec4 {
        let level = self.level(index);
        // On the single texel of the last level nothing is left to weigh, and the ellipse may be of any size.
        if index == self.coarser.len() {
            return filter::bilinear(level, texels, uv, wrap);
        }
        let scale = Vec2::new(
            level.width as f32 / self.base.width as f32,
            level.height as f32 / self.base.height as f32,
        );
        let [along, across] = axes.vectors().map(|axis| axis * scale);
        filter::ewa(level, texels, uv, &FootprintAxes::new(along, across), wrap)
    }
}

/// Whether all texels have the same alpha, 1. (Floats are not searched: there, alpha seldom comes without a reason.)
fn is_opaque(image: &Image) -> bool {
    let channels = usize::from(image.channels);
    !image.has_alpha()
        || match &image.samples {
            Samples::U8(values) => values.iter().skip(channels - 1).step_by(channels).all(|&a| a == u8::MAX),
            Samples::U16(values) => {
                values.iter().skip(channels - 1).step_by(channels).all(|&a| a == u16::MAX)
            }
            Samples::F32(_) => false,
        }
}

/// Means over equal parallelograms of one texture; see [`ImageTexture::area_sampler`].
#[derive(Clone, Copy, Debug)]
pub struct AreaSampler<'a> {
    level: &'a Image,
    texels: TexelUse,
    plan: AreaPlan,
}

impl AreaSampler<'_> {
    /// The mean linear RGBA over the parallelogram around `uv`.
    #[inline]
    pub fn sample(&self, uv: Vec2) -> [f32; 4] {
        resolve(self.plan.bilinear_mean(self.level, self.texels, uv), self.texels.alpha)
    }

    /// Whether the parallelograms of another sampler have the same weights: the textures are equally large, wrapped alike and
    /// looked up with the same footprint, as those of one material mostly are.
    pub fn shares_areas_with(&self, other: &AreaSampler<'_>) -> bool {
        let size = |level: &Image| [level.width, level.height];
        size(self.level) == size(other.level) && self.plan == other.plan
    }

    /// The parallelograms around many points, for [`AreaSampler::sample_areas`] of this sampler and of those that share its
    /// areas.
    ///
    /// # Panics
    /// With more than [`AREAS_AT_ONCE`] points.
    pub fn areas(&self, points: &[Vec2]) -> Areas {
        Areas(AreaBlock::new(&self.plan, self.level, points))
    }

    /// [`AreaSampler::sample`] at many points, in vectors where the parallelograms are about a texel wide and the image has one,
    /// three or four channels of bytes. Both differ by at most 1e-5.
    ///
    /// # Panics
    /// If there are not as many colours as points.
    pub fn sample_areas(&self, areas: &Areas, out: &mut [[f32; 4]]) {
        let points = areas.0.points();
        assert_eq!(points.len(), out.len(), "one colour for every point");
        let mut sums = Colors::black();
        let missed = areas.0.sums(self.level, self.texels, &mut sums);
        for (index, ((out, sum), &uv)) in out.iter_mut().zip(sums.0).zip(points).enumerate() {
            let is_missed = missed >> index & 1 == 1;
            *out =
                if is_missed { self.sample(uv) } else { resolve(Vec4::from_array(sum), self.texels.alpha) };
        }
    }
}

/// Most parallelograms that [`AreaSampler::areas`] places in one call.
pub const AREAS_AT_ONCE: usize = BLOCK;

/// Many of an [`AreaSampler`]'s parallelograms, with the weights of the texels in them.
#[derive(Clone, Debug)]
pub struct Areas(AreaBlock);

// ---- Look-ups of many points at once: see `filter/batch.rs`.

/// Fewer points than this are looked up one by one.
const FEW: usize = 4;

impl ImageTexture {
    /// [`ImageTexture::sample`] at many points, several times as fast: whole vectors of look-ups pass each step together, and
    /// none waits for the texels of another. Both differ by at most 1e-4 of the texels' range (but for anisotropic look-ups by 2e-5). The
    /// results are the same on every processor, and however points are distributed over calls of at least four points.
    ///
    /// Vectors are used for bilinear, trilinear and anisotropic look-ups in images of one, three or four 8-bit or 16-bit
    /// channels; others are made one by one.
    ///
    /// # Panics
    /// If `points` and `out` differ in length.
    pub fn sample_all(&self, points: &[UvPoint], options: &SampleOptions, out: &mut [[f32; 4]]) {
        assert_eq!(points.len(), out.len(), "one colour for every point");
        let has_kernel = matches!(options.filter, Filter::Bilinear | Filter::Trilinear | Filter::Anisotropic);
        let levels =
            if has_kernel && points.len() >= FEW { Levels::new(&self.base, &self.coarser) } else { None };
        let Some(levels) = levels else {
            for (point, out) in points.iter().zip(out) {
                *out = self.sample(point.uv, point.steps, options);
            }
            return;
        };
        let alpha = self.texels(options.wrap).alpha;
        let look_up = LookUp { levels: &levels, wrap: options.wrap, alpha };
        match options.filter {
            Filter::Anisotropic => self.anisotropic_all(points, options, &look_up, out),
            _ => self.isotropic_all(points, options, &look_up, out),
        }
    }

    fn isotropic_all(
        &self,
        points: &[UvPoint],
        options: &SampleOptions,
        look_up: &LookUp<'_>,
        out: &mut [[f32; 4]],
    ) {
        let (mut workspace, mut colors) = (Workspace::new(), Colors::black());
        let (mut probes, mut steps) = (Probes::new(), Steps::new());
        for (points, out) in points.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
            probes.place(points.iter().map(|point| point.uv));
            if options.filter == Filter::Trilinear {
                steps.place(points.iter().map(|point| point.steps));
                probes.choose_levels(&steps, self.size_f32(), self.coarser.len());
            }
            let missed = look_up.sums(&probes, &mut workspace, &mut colors);
            if look_up.alpha == AlphaUse::Independent {
                out.copy_from_slice(&colors.0[..out.len()]);
            } else {
                for (out, sum) in out.iter_mut().zip(colors.0) {
                    *out = resolve(Vec4::from_array(sum), look_up.alpha);
                }
            }
            for index in bits(missed) {
                out[index] = self.sample(points[index].uv, points[index].steps, options);
            }
        }
    }

    /// As many probes per point as its footprint asks for; see [`ImageTexture::anisotropic`].
    fn anisotropic_all(
        &self,
        points: &[UvPoint],
        options: &SampleOptions,
        look_up: &LookUp<'_>,
        out: &mut [[f32; 4]],
    ) {
        let mut queue = Queue::new(look_up, self);
        let mut colors = Colors::black();
        for (points, out) in points.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
            let mut sums = [Vec4::ZERO; BLOCK];
            let mut shares = [1.0; BLOCK];
            for (index, point) in points.iter().enumerate() {
                let row = self.probe_row(point, options);
                shares[index] = 1.0 / row.count as f32;
                let mut numbers = 0..row.count;
                while !numbers.is_empty() {
                    if queue.probes.len() == BLOCK {
                        queue.flush(&mut colors, &mut sums);
                    }
                    queue.push(index, &row, &mut numbers);
                }
            }
            queue.flush(&mut colors, &mut sums);
            for ((out, sum), share) in out.iter_mut().zip(sums).zip(shares) {
                *out = resolve(sum * share, look_up.alpha);
            }
        }
    }

    /// The probes of an anisotropic look-up.
    fn probe_row(&self, point: &UvPoint, options: &SampleOptions) -> ProbeRow {
        let axes = self.axes(point.steps);
        let width = axes.limited_minor(options.max_anisotropy).max(1.0);
        let probes = (axes.major / width).ceil();
        let LevelPair { fine, share, .. } = self.levels_for(width * width);
        if probes.is_nan() || probes <= 1.0 {
            return ProbeRow { first: point.uv, step: Vec2::ZERO, count: 1, fine: fine as u32, share };
        }
        let span = self.in_uv(axes.direction * axes.major);
        let step = span / probes;
        let first = point.uv + 0.5 * (step - span);
        ProbeRow { first, step, count: probes as u32, fine: fine as u32, share }
    }
}

struct ProbeRow {
    first: Vec2,
    step: Vec2,
    count: u32,
    fine: u32,
    share: f32,
}

/// Probes of several look-ups, that together fill blocks.
struct Queue<'a> {
    look_up: &'a LookUp<'a>,
    texture: &'a ImageTexture,
    probes: Probes,
    /// The look-up of every probe.
    targets: [u8; BLOCK],
    workspace: Workspace,
}

impl<'a> Queue<'a> {
    fn new(look_up: &'a LookUp<'a>, texture: &'a ImageTexture) -> Self {
        Self { look_up, texture, probes: Probes::new(), targets: [0; BLOCK], workspace: Workspace::new() }
    }

    /// Takes as many probes from a row as there is room for.
    fn push(&mut self, target: usize, row: &ProbeRow, numbers: &mut Range<u32>) {
        let (used, room) = (self.probes.len(), (BLOCK - self.probes.len()) as u32);
        let end = numbers.end.min(numbers.start.saturating_add(room));
        self.probes.push_row([row.first, row.step], numbers.start..end, row.fine, row.share);
        self.targets[used..self.probes.len()].fill(target as u8);
        numbers.start = end;
    }

    /// Looks up all probes and adds each to the sum of its look-up.
    fn flush(&mut self, colors: &mut Colors, sums: &mut [Vec4; BLOCK]) {
        let missed = self.look_up.sums(&self.probes, &mut self.workspace, colors);
        for index in bits(missed) {
            let (at, fine, share) = self.probes.at(index);
            let value = self.texture.between_levels(at, fine as usize, share, self.look_up);
            colors.0[index] = value.to_array();
        }
        for (color, &target) in colors.0[..self.probes.len()].iter().zip(&self.targets) {
            sums[usize::from(target)] += Vec4::from_array(*color);
        }
        self.probes.clear();
    }
}

impl ImageTexture {
    fn between_levels(&self, at: Vec2, fine: usize, share: f32, look_up: &LookUp<'_>) -> Vec4 {
        let texels = self.texels(look_up.wrap);
        let coarse = (fine + 1).min(self.coarser.len());
        self.blended(LevelPair { fine, coarse, share }, |level| {
            filter::bilinear(level, texels, at, look_up.wrap)
        })
    }
}
