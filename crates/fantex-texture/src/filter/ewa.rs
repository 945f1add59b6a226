//! Heckbert, "Fundamentals of texture mapping and image warping", 1989: the elliptical weighted average.
//!
//! A Gaussian over the pixel, mapped into the texture, is a Gaussian over an ellipse. Its texels are averaged directly, so
//! this filter is the reference for the others. Deviations: a level is used from a minor axis of three texels on (rather
//! than one), where the filter that made the level widens the Gaussian by less than two percent; two levels are blended,
//! so that the value changes continuously with the footprint; and axes shorter than a texel are set to one texel (rather
//! than adding one to their square), so that magnified images are smoothed no more than needed.

use std::sync::LazyLock;

use glam::{Vec2, Vec4};

use super::footprint::FootprintAxes;
use super::taps::{recenter, wrap_index};
use super::texel::{Kernel, TexelSource, TexelUse, with_border};
use crate::Wrap;
use crate::image::Image;

/// Exponent of the Gaussian: the pixel's filter is `exp(-2 r^2)`, standard deviation half a pixel, cut off at `r = 1`.
const FALLOFF: f32 = 2.0;
/// The minor axis, in texels of a level, from which on that level alone is fine enough.
pub const EWA_MINOR_TEXELS: f32 = 3.0;
/// No axis is shorter, so that there is always a texel inside the ellipse.
const SMALLEST_AXIS_TEXELS: f32 = 1.0;
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
        let major2 = axes.major.max(SMALLEST_AXIS_TEXELS).powi(2);
        let minor2 = axes.minor.max(SMALLEST_AXIS_TEXELS).powi(2);
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
