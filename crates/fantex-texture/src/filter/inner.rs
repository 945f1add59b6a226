//! Bilinear look-ups away from the image's edges, where no texel wraps: the fast path of all filters that interpolate.
//!
//! A position is split into texel and share by adding `2^23`, which leaves the integer in the float's mantissa; one unsigned
//! comparison then tells whether both texels lie inside, whatever the position was (negative, infinite, NaN). The results
//! equal those of `taps.rs`, the reference, up to rounding.

use glam::{Vec2, Vec4};

use super::taps::fold;
use super::texel::{Kernel, TexelSource};
use crate::Wrap;
use crate::image::Image;

/// `2^23`: above, floats are integers.
const INTEGERS: f32 = 8_388_608.0;

/// The whole part of a position in texels and the rest, 0..1 (either, for integers). Positions below 1/4 (those of the
/// first texel's edge) and unusable ones give an index above every side.
#[inline(always)]
fn split(position: f32) -> (u32, f32) {
    let shifted = position - 0.5 + INTEGERS;
    (shifted.to_bits().wrapping_sub(INTEGERS.to_bits()), position - (shifted - INTEGERS))
}

/// Two by two texels with the shares of the right and of the lower ones.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quad {
    /// Row-major offset of the upper left one.
    first: usize,
    /// Texels of a row.
    width: usize,
    right: f32,
    lower: f32,
}

impl Quad {
    /// Around a point; `None` at the edges of the image.
    #[inline(always)]
    pub(super) fn around(level: &Image, uv: Vec2, wrap: [Wrap; 2]) -> Option<Self> {
        let (column, right) = split(fold(uv.x, wrap[0]) * level.width as f32 - 0.5);
        let (row, lower) = split(fold(uv.y, wrap[1]) * level.height as f32 - 0.5);
        let is_inside = column < level.width - 1 && row < level.height - 1;
        let width = level.width as usize;
        is_inside.then(|| Self { first: row as usize * width + column as usize, width, right, lower })
    }
}

impl Kernel for Quad {
    type Output = Vec4;

    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let upper = texels.fetch_run::<2>(self.first);
        let lower = texels.fetch_run::<2>(self.first + self.width);
        let between = |[left, right]: [Vec4; 2]| left + (right - left) * self.right;
        let upper = between(upper);
        upper + (between(lower) - upper) * self.lower
    }
}

/// Equidistant points in a row, all away from the edges of a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct QuadRow {
    /// The first point, in texels from the centre of the first texel.
    first: Vec2,
    /// From point to point, in texels.
    step: Vec2,
    count: u32,
    /// Texels of a row.
    width: usize,
}

/// By how much rounding may move a point, in texels, and more.
const MARGIN: f32 = 0.5;

impl QuadRow {
    /// `count` points from `first` on, in uv; `None` if one lies at the edges of the image.
    #[inline(always)]
    pub(super) fn along(level: &Image, first: Vec2, step: Vec2, count: u32, wrap: [Wrap; 2]) -> Option<Self> {
        let size = Vec2::new(level.width as f32, level.height as f32);
        // Folding the middle moves all points by the same; mirrored ones would change their direction.
        let middle = first + step * (0.5 * (count - 1) as f32);
        let folded = Vec2::new(fold(middle.x, wrap[0]), fold(middle.y, wrap[1]));
        let is_mirrored = |axis: usize| wrap[axis] == Wrap::Mirror && folded[axis] != middle[axis];
        let (middle, step) = (folded * size - 0.5, step * size);
        let reach = step * (0.5 * (count - 1) as f32);
        let (low, high) = (middle - reach.abs(), middle + reach.abs());
        // Comparisons with NaN are false.
        let is_inside = low.cmpge(Vec2::splat(MARGIN)).all() && high.cmple(size - 1.0 - MARGIN).all();
        let is_usable = is_inside && !is_mirrored(0) && !is_mirrored(1);
        is_usable.then(|| Self { first: middle - reach, step, count, width: level.width as usize })
    }
}

impl Kernel for QuadRow {
    type Output = Vec4;

    /// The sum over all points.
    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let mut sum = Vec4::ZERO;
        for index in 0..self.count {
            let position = self.first + self.step * index as f32;
            let ((column, right), (row, lower)) = (split(position.x), split(position.y));
            let first = row as usize * self.width + column as usize;
            sum += Quad { first, width: self.width, right, lower }.run(texels);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_split_exactly() {
        for position in [0.25_f32, 0.3, 0.999, 1.0, 1.5, 2.0, 77.25, 4095.9, 65_534.5] {
            let (index, share) = split(position);
            assert_eq!(index as f32 + share, position);
            assert!((0.0..=1.0).contains(&share), "{position}: {share}");
        }
        for position in [-1e9, -1.0, -0.3, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e9, f32::MAX] {
            assert!(split(position).0 > 1 << 22, "{position}");
        }
    }
}
