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
use super::texel::{Kernel, TexelSource, with_texels};
use crate::image::Image;
use crate::{AlphaUse, Wrap};

/// Exponent of the Gaussian: the pixel's filter is `exp(-2 r^2)`, standard deviation half a pixel, cut off at `r = 1`.
const FALLOFF: f32 = 2.0;
/// The minor axis, in texels of a level, from which on that level alone is fine enough.
pub(crate) const EWA_MINOR_TEXELS: f32 = 3.0;
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
pub(crate) fn ewa(level: &Image, alpha: AlphaUse, uv: Vec2, axes: &FootprintAxes, wrap: [Wrap; 2]) -> Vec4 {
    let major2 = axes.major.max(SMALLEST_AXIS_TEXELS).powi(2);
    let minor2 = axes.minor.max(SMALLEST_AXIS_TEXELS).powi(2);
    let Vec2 { x: cos, y: sin } = axes.direction;
    let quadric = Ellipse {
        xx: major2 * cos * cos + minor2 * sin * sin,
        xy: (major2 - minor2) * cos * sin,
        yy: major2 * sin * sin + minor2 * cos * cos,
    };
    let center =
        Vec2::new(recenter(uv.x, level.width, wrap[0]) - 0.5, recenter(uv.y, level.height, wrap[1]) - 0.5);
    with_texels(level, alpha, EllipseSum { level, wrap, center, quadric })
}

/// The matrix Q of the ellipse `p^T Q^-1 p = 1`.
struct Ellipse {
    xx: f32,
    xy: f32,
    yy: f32,
}

struct EllipseSum<'a> {
    level: &'a Image,
    wrap: [Wrap; 2],
    center: Vec2,
    quadric: Ellipse,
}

impl Kernel for EllipseSum<'_> {
    type Output = Vec4;

    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let Ellipse { xx, xy, yy } = self.quadric;
        let determinant = xx * yy - xy * xy;
        let table = weight_table();
        let half_height = yy.sqrt();
        let first_row = (self.center.y - half_height).ceil() as i32;
        let last_row = (self.center.y + half_height).floor() as i32;
        let (mut sum, mut total) = (Vec4::ZERO, 0.0);
        for row in first_row..=last_row {
            let y = row as f32 - self.center.y;
            // r^2 = ((x - m)^2 / s^2 + y^2 / yy) with the row's middle m and half width at the centre s.
            let middle = xy / yy * y;
            let squared_half_width = determinant / yy;
            let base = y * y / yy;
            let half_width = (squared_half_width * (1.0 - base).max(0.0)).sqrt();
            let first = (self.center.x + middle - half_width).ceil() as i32;
            let last = (self.center.x + middle + half_width).floor() as i32;
            let row_offset = wrap_index(row, self.level.height, self.wrap[1])
                .map(|wrapped| wrapped * self.level.width as usize);
            for column in first..=last {
                let x = column as f32 - self.center.x - middle;
                let squared_radius = x * x / squared_half_width + base;
                let weight = table[((squared_radius * TABLE_SIZE as f32) as usize).min(TABLE_SIZE)];
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
