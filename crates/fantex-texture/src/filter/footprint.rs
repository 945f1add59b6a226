//! The footprint of a look-up as an ellipse.

use std::f32::consts::{LN_2, SQRT_2};
use std::sync::LazyLock;

use glam::{Vec2, Vec4};

use super::taps::{Kernel, TexelSource, TexelUse, recenter, with_border, wrap_index};
use crate::Wrap;
use crate::image::Image;

/// The longest ratio of a footprint's axes that any filter honours; also the most probes of an anisotropic look-up.
pub const MAX_ANISOTROPY: f32 = 64.0;

/// The axes of the ellipse onto which the derivatives map the unit circle of the pixel's plane, in texels.
#[derive(Clone, Copy, Debug)]
pub struct FootprintAxes {
    /// Unit vector along the longer axis.
    pub direction: Vec2,
    /// Half length of the longer axis: the width of the pixel along it.
    pub major: f32,
    /// Half length of the shorter axis.
    pub minor: f32,
}

impl FootprintAxes {
    /// From the derivatives of the texel position along the pixel's x and y: the singular values and the first left
    /// singular vector of the matrix with these columns.
    pub fn new(texels_dx: Vec2, texels_dy: Vec2) -> Self {
        let xx = texels_dx.x * texels_dx.x + texels_dy.x * texels_dy.x;
        let xy = texels_dx.x * texels_dx.y + texels_dy.x * texels_dy.y;
        let yy = texels_dx.y * texels_dx.y + texels_dy.y * texels_dy.y;
        let half_difference = 0.5 * (xx - yy);
        let root = (half_difference * half_difference + xy * xy).sqrt();
        let axis = if half_difference >= 0.0 {
            Vec2::new(half_difference + root, xy)
        } else {
            Vec2::new(xy, root - half_difference)
        };
        let major = (0.5 * (xx + yy) + root).sqrt();
        // The determinant is the product of the singular values; a difference of squares would cancel.
        let minor = if major > 0.0 { texels_dx.perp_dot(texels_dy).abs() / major } else { 0.0 };
        Self { direction: axis.normalize_or(Vec2::X), major, minor }
    }

    /// The square of the longer axis of [`FootprintAxes::new`] alone.
    #[inline(always)]
    pub fn squared_major(texels_dx: Vec2, texels_dy: Vec2) -> f32 {
        let (xx, yy) = (texels_dx.length_squared(), texels_dy.length_squared());
        let (half_difference, xy) = (0.5 * (xx - yy), texels_dx.dot(texels_dy));
        0.5 * (xx + yy) + (half_difference * half_difference + xy * xy).sqrt()
    }

    /// The shorter axis widened until the ratio of both is at most `max_anisotropy`, which counts as 1 to
    /// [`MAX_ANISOTROPY`].
    pub fn limited_minor(&self, max_anisotropy: f32) -> f32 {
        self.minor.max(self.major / max_anisotropy.clamp(1.0, MAX_ANISOTROPY))
    }

    /// The square of [`FootprintAxes::limited_minor`] of [`FootprintAxes::new`] alone.
    #[inline(always)]
    pub fn squared_limited_minor(texels_dx: Vec2, texels_dy: Vec2, max_anisotropy: f32) -> f32 {
        let major = Self::squared_major(texels_dx, texels_dy);
        let minor = if major > 0.0 { texels_dx.perp_dot(texels_dy).powi(2) / major } else { 0.0 };
        minor.max(major / max_anisotropy.clamp(1.0, MAX_ANISOTROPY).powi(2))
    }

    /// With the shorter axis as [`FootprintAxes::limited_minor`] says.
    pub fn limited(&self, max_anisotropy: f32) -> Self {
        Self { minor: self.limited_minor(max_anisotropy), ..*self }
    }

    /// Both axes as vectors, the longer one first.
    pub fn vectors(&self) -> [Vec2; 2] {
        [self.direction * self.major, self.direction.perp() * self.minor]
    }
}

// ---- Which levels a footprint is looked up in.

/// The logarithm to base 2 of a finite number above 0 (normal, no denormal), to 3e-7 or one part in ten million: exponent,
/// and `artanh` of the mantissa. A library call takes three times as long.
#[inline(always)]
pub fn log2(x: f32) -> f32 {
    const MANTISSA: u32 = 0x007f_ffff;
    // Mantissas in [1/sqrt 2, sqrt 2).
    let bits = x.to_bits().wrapping_sub((SQRT_2 * 0.5).to_bits());
    let exponent = (bits as i32) >> 23;
    let mantissa = f32::from_bits((bits & MANTISSA).wrapping_add((SQRT_2 * 0.5).to_bits()));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let series = 1.0 + s2 * (1.0 / 3.0 + s2 * (1.0 / 5.0 + s2 * (1.0 / 7.0)));
    exponent as f32 + (2.0 / LN_2) * s * series
}

/// Two neighbouring levels and the share of the coarser one; the same level twice at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LevelPair {
    pub(crate) fine: usize,
    pub(crate) coarse: usize,
    pub(crate) share: f32,
}

impl LevelPair {
    /// The levels between which a texel is as wide as the square root of `squared_texels` texels of level 0.
    #[inline(always)]
    pub(crate) fn for_squared_width(squared_texels: f32, last: usize) -> Self {
        // A NaN is no width; beyond the last level, everything is the same.
        let lod = if squared_texels > 1.0 {
            (0.5 * log2(squared_texels.min(f32::MAX))).min(last as f32)
        } else {
            0.0
        };
        let fine = lod as usize;
        Self { fine, coarse: (fine + 1).min(last), share: lod - fine as f32 }
    }
}

// ---- Heckbert, "Fundamentals of texture mapping and image warping", 1989: the elliptical weighted average.
//
// A Gaussian over the pixel, mapped into the texture, is a Gaussian over an ellipse. Its texels are averaged directly, so
// this filter is the reference for the others. Deviations: a level is used from a minor axis of three texels on (rather
// than one), where the filter that made the level widens the Gaussian by less than two percent; two levels are blended,
// so that the value changes continuously with the footprint; and axes shorter than a texel are set to one texel (rather
// than adding one to their square), so that magnified images are smoothed no more than needed.

/// Exponent of the Gaussian: the pixel's filter is `exp(-2 r^2)`, standard deviation half a pixel, cut off at `r = 1`.
const FALLOFF: f32 = 2.0;
/// The minor axis, in texels of a level, from which on that level alone is fine enough.
pub const EWA_MINOR_TEXELS: f32 = 3.0;
/// No axis is shorter, so that there is always a texel inside the ellipse.
const MIN_AXIS_TEXELS: f32 = 1.0;
const TABLE_SIZE: usize = 1024;

/// `exp(-2 r^2) - exp(-2)` by `r^2`.
fn weight_table() -> &'static [f32; TABLE_SIZE + 1] {
    static TABLE: LazyLock<[f32; TABLE_SIZE + 1]> = LazyLock::new(|| {
        std::array::from_fn(|i| (-FALLOFF * i as f32 / TABLE_SIZE as f32).exp() - (-FALLOFF).exp())
    });
    &TABLE
}

/// The average at one level of the texels around `uv` under the footprint with `axes` (in texels of this level).
pub(crate) fn ewa(level: &Image, texels: TexelUse, uv: Vec2, axes: &FootprintAxes, wrap: [Wrap; 2]) -> Vec4 {
    let center =
        Vec2::new(recenter(uv.x, level.width, wrap[0]) - 0.5, recenter(uv.y, level.height, wrap[1]) - 0.5);
    with_border(level, texels, EllipseSum { level, wrap, ellipse: WeightedEllipse::new(center, axes) })
}

/// The texels under a footprint with their weights, row by row. Texel `i` has its centre at `i`.
#[derive(Clone, Copy, Debug)]
pub struct WeightedEllipse {
    center: Vec2,
    /// The matrix Q of the ellipse `p^T Q^-1 p = 1`: `yy`, `xy / yy` and `determinant / yy`.
    squared_half_height: f32,
    slant: f32,
    squared_half_width: f32,
}

impl WeightedEllipse {
    /// The ellipse around `center` with these axes, each at least one texel long, so that there is always a texel inside.
    pub fn new(center: Vec2, axes: &FootprintAxes) -> Self {
        let major2 = axes.major.max(MIN_AXIS_TEXELS).powi(2);
        let minor2 = axes.minor.max(MIN_AXIS_TEXELS).powi(2);
        let Vec2 { x: cos, y: sin } = axes.direction;
        let xx = major2 * cos * cos + minor2 * sin * sin;
        let xy = (major2 - minor2) * cos * sin;
        let yy = major2 * sin * sin + minor2 * cos * cos;
        let determinant = xx * yy - xy * xy;
        Self { center, squared_half_height: yy, slant: xy / yy, squared_half_width: determinant / yy }
    }

    /// The rows that the ellipse touches, from the top.
    pub fn rows(self) -> impl Iterator<Item = EllipseRow> {
        let half_height = self.squared_half_height.sqrt();
        let first_row = (self.center.y - half_height).ceil() as i32;
        let last_row = (self.center.y + half_height).floor() as i32;
        (first_row..=last_row).map(move |row| self.row(row))
    }

    /// On a row, `r^2 = (x - m)^2 / s^2 + y^2 / yy` with the row's middle `m` and the half width `s` at the centre.
    #[inline(always)]
    fn row(&self, row: i32) -> EllipseRow {
        let y = row as f32 - self.center.y;
        let base = y * y / self.squared_half_height;
        let half_width = (self.squared_half_width * (1.0 - base).max(0.0)).sqrt();
        let middle = self.slant * y;
        EllipseRow {
            row,
            first: (self.center.x + middle - half_width).ceil() as i32,
            last: (self.center.x + middle + half_width).floor() as i32,
            center: self.center.x,
            middle,
            base,
            squared_half_width: self.squared_half_width,
        }
    }
}

/// One row of a [`WeightedEllipse`].
#[derive(Clone, Copy, Debug)]
pub struct EllipseRow {
    /// The row's index; may lie outside the image.
    pub row: i32,
    first: i32,
    last: i32,
    center: f32,
    middle: f32,
    base: f32,
    squared_half_width: f32,
}

impl EllipseRow {
    /// The row's texels from the left, as columns (which may lie outside the image) with weights that are not negative.
    /// The weights of all rows add up to more than zero.
    #[inline(always)]
    pub fn weights(self) -> impl Iterator<Item = (i32, f32)> {
        let table = weight_table();
        (self.first..=self.last).map(move |column| {
            let x = column as f32 - self.center - self.middle;
            let squared_radius = x * x / self.squared_half_width + self.base;
            (column, table[((squared_radius * TABLE_SIZE as f32) as usize).min(TABLE_SIZE)])
        })
    }
}

#[derive(Clone, Copy)]
struct EllipseSum<'a> {
    level: &'a Image,
    wrap: [Wrap; 2],
    ellipse: WeightedEllipse,
}

impl Kernel for EllipseSum<'_> {
    type Output = Vec4;

    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let (mut sum, mut total) = (Vec4::ZERO, 0.0);
        for row in self.ellipse.rows() {
            let row_offset = wrap_index(row.row, self.level.height, self.wrap[1])
                .map(|wrapped| wrapped * self.level.width as usize);
            for (column, weight) in row.weights() {
                total += weight;
                let wrapped = wrap_index(column, self.level.width, self.wrap[0]);
                if let (Some(row_offset), Some(column)) = (row_offset, wrapped) {
                    sum += texels.fetch(row_offset + column) * weight;
                }
            }
        }
        // The ellipse contains the unit circle, and that always a texel centre.
        if total > 0.0 { sum / total } else { Vec4::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_are_those_of_the_library() {
        let mut x = 1.2e-38_f32;
        while x < 3e38 {
            let truth = f64::from(x).log2();
            let error = (f64::from(log2(x)) - truth).abs();
            assert!(error < 3e-7 + 1e-7 * truth.abs(), "log2 {x}: off by {error}");
            x *= 1.003_7;
        }
        assert_eq!((log2(1.0), log2(2.0), log2(0.25), log2(65_536.0)), (0.0, 1.0, -2.0, 16.0));
    }

    #[test]
    fn levels_are_continuous_and_bounded() {
        let pair = |texels: f32| LevelPair::for_squared_width(texels * texels, 5);
        assert_eq!(pair(0.3), LevelPair { fine: 0, coarse: 1, share: 0.0 });
        assert_eq!(pair(4.0), LevelPair { fine: 2, coarse: 3, share: 0.0 });
        for texels in [32.0, 1e9, f32::MAX, f32::INFINITY] {
            assert_eq!(pair(texels), LevelPair { fine: 5, coarse: 5, share: 0.0 });
        }
        assert_eq!(pair(f32::NAN).share, 0.0);
        let mut last = 0.0;
        for step in 0..10_000 {
            let LevelPair { fine, share, .. } = pair(1.0 + step as f32 * 0.004);
            let level = fine as f32 + share;
            assert!(level >= last && level - last < 0.01);
            last = level;
        }
    }
}
