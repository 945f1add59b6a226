//! Wrapped texel indices with weights, along one axis and as tensor products.
//!
//! Texel `i` of an axis with `n` texels has its centre at the coordinate `(i + 1/2) / n`.

use glam::{Vec2, Vec4};

use super::inner::{Quad, QuadRow};
use super::texel::{Kernel, TexelSource, TexelUse, with_border, with_texels};
use crate::Wrap;
use crate::image::Image;

/// The largest integer not above `x` (a library call without SSE4.1); saturates, NaN gives 0.
#[inline(always)]
pub(super) fn floor(x: f32) -> i32 {
    let truncated = x as i32;
    truncated.saturating_sub(i32::from(x < truncated as f32))
}

/// The coordinate folded into `[0,1]` as far as the wrap mode repeats.
#[inline(always)]
pub(super) fn fold(coordinate: f32, wrap: Wrap) -> f32 {
    match wrap {
        Wrap::Clamp | Wrap::Border => coordinate,
        Wrap::Repeat => {
            // Rounded to the nearest integer by adding what leaves no bit for fractions.
            const NO_FRACTIONS: f32 = 12_582_912.0;
            let rest = coordinate - ((coordinate + NO_FRACTIONS) - NO_FRACTIONS);
            if rest < 0.0 { rest + 1.0 } else { rest }
        }
        Wrap::Mirror => {
            let period = coordinate - 2.0 * floor(0.5 * coordinate) as f32;
            1.0 - (1.0 - period).abs()
        }
    }
}

/// The position, in texels, of a coordinate, moved by whole periods to the image's neighbourhood, where floats are precise.
#[inline(always)]
pub(super) fn recenter(coordinate: f32, size: u32, wrap: Wrap) -> f32 {
    let texels = size as f32;
    match wrap {
        Wrap::Repeat => (coordinate - floor(coordinate) as f32) * texels,
        Wrap::Mirror => (coordinate - 2.0 * floor(0.5 * coordinate) as f32) * texels,
        // Further outside, everything in reach of a filter is the same.
        Wrap::Clamp | Wrap::Border => (coordinate * texels).clamp(-MARGIN_TEXELS, texels + MARGIN_TEXELS),
    }
    .clamp(-MARGIN_TEXELS, 2.0 * texels + MARGIN_TEXELS)
}

/// More than the half extent of any filter on one level.
pub(super) const MARGIN_TEXELS: f32 = 4096.0;

/// The texel that stands at position `index` of an endless row; `None` is transparent black.
#[inline(always)]
pub(super) fn wrap_index(index: i32, size: u32, wrap: Wrap) -> Option<usize> {
    let size = size as i32;
    if (0..size).contains(&index) {
        return Some(index as usize);
    }
    match wrap {
        Wrap::Clamp => Some(index.clamp(0, size - 1) as usize),
        Wrap::Border => None,
        Wrap::Repeat => Some(index.rem_euclid(size) as usize),
        Wrap::Mirror => {
            let period = i64::from(index).rem_euclid(2 * i64::from(size));
            Some(period.min(2 * i64::from(size) - 1 - period) as usize)
        }
    }
}

/// `N` texels along one axis and their weights. Texels outside a border have weight 0 and some valid index.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taps<const N: usize> {
    pub(super) index: [usize; N],
    pub(super) weight: [f32; N],
}

impl<const N: usize> Taps<N> {
    /// Indices and weights.
    #[inline(always)]
    pub(crate) fn pairs(self) -> impl Iterator<Item = (usize, f32)> {
        self.index.into_iter().zip(self.weight)
    }
}

/// The taps around a coordinate, for algorithms that are the same for several reconstructions.
pub(crate) trait Reconstruction {
    fn at(coordinate: f32, size: u32, wrap: Wrap) -> Self;
}

impl Reconstruction for Taps<1> {
    #[inline(always)]
    fn at(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        Self::nearest(coordinate, size, wrap)
    }
}

impl Reconstruction for Taps<2> {
    #[inline(always)]
    fn at(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        Self::linear(coordinate, size, wrap)
    }
}

impl Taps<1> {
    #[inline(always)]
    pub(super) fn nearest(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        // Folding may round up to exactly 1, which is one texel too far.
        let position = fold(coordinate, wrap) * size as f32;
        let index = floor(position);
        let is_outside = wrap == Wrap::Border && !(0..size as i32).contains(&index);
        Self {
            index: [index.clamp(0, size as i32 - 1) as usize],
            weight: [if is_outside { 0.0 } else { 1.0 }],
        }
    }
}

impl Taps<2> {
    #[inline(always)]
    pub(super) fn linear(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        let last = size as i32 - 1;
        let position = fold(coordinate, wrap) * size as f32 - 0.5;
        match wrap {
            Wrap::Clamp | Wrap::Mirror => {
                // Beyond the middle of an edge texel, both modes continue with that texel.
                let position = position.clamp(0.0, last as f32);
                let first = position as i32;
                let share = position - first as f32;
                Self { index: [first as usize, (first + 1).min(last) as usize], weight: [1.0 - share, share] }
            }
            Wrap::Repeat => {
                let first = floor(position);
                let share = position - first as f32;
                let second = if first < 0 || first >= last { 0 } else { first + 1 };
                let first = if first < 0 { last } else { first.min(last) };
                Self { index: [first as usize, second as usize], weight: [1.0 - share, share] }
            }
            Wrap::Border => {
                let first = floor(position.clamp(-1.0, size as f32));
                let share = position.clamp(-1.0, size as f32) - first as f32;
                let inside = |index: i32| f32::from(u8::from((0..=last).contains(&index)));
                Self {
                    index: [first.clamp(0, last) as usize, (first + 1).clamp(0, last) as usize],
                    weight: [(1.0 - share) * inside(first), share * inside(first + 1)],
                }
            }
        }
    }
}

/// Weights of four neighbouring texels at the share `t` (0..1) of the way from the second to the third. Catmull and Rom,
/// "A class of local interpolating splines", 1974: interpolates, reproduces quadratics.
#[inline(always)]
pub fn catmull_rom_weights(t: f32) -> [f32; 4] {
    [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (-2.5 + 1.5 * t),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (-0.5 + 0.5 * t),
    ]
}

impl Taps<4> {
    pub(super) fn cubic(coordinate: f32, size: u32, wrap: Wrap) -> Self {
        let position = fold(coordinate, wrap) * size as f32 - 0.5;
        let position = position.clamp(-4.0, size as f32 + 4.0);
        let first = floor(position);
        let mut weight = catmull_rom_weights(position - first as f32);
        let mut index = [0; 4];
        for tap in 0..4 {
            match wrap_index(first - 1 + tap as i32, size, wrap) {
                Some(inside) => index[tap] = inside,
                None => weight[tap] = 0.0,
            }
        }
        Self { index, weight }
    }
}

/// The weighted sum over the tensor product of two axes' taps.
#[derive(Clone, Copy)]
pub(super) struct TensorProduct<const N: usize> {
    pub(super) width: u32,
    pub(super) u: Taps<N>,
    pub(super) v: Taps<N>,
}

impl<const N: usize> Kernel for TensorProduct<N> {
    type Output = Vec4;
    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let mut sum = Vec4::ZERO;
        for (row, row_weight) in self.v.index.into_iter().zip(self.v.weight) {
            let first = row * self.width as usize;
            let mut row_sum = Vec4::ZERO;
            for (column, weight) in self.u.index.into_iter().zip(self.u.weight) {
                row_sum += texels.fetch(first + column) * weight;
            }
            sum += row_sum * row_weight;
        }
        sum
    }
}

/// The texel whose square holds `uv`.
pub(crate) fn nearest(level: &Image, texels: TexelUse, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
    let u = Taps::nearest(uv.x, level.width, wrap[0]);
    let v = Taps::nearest(uv.y, level.height, wrap[1]);
    with_border(level, texels, TensorProduct { width: level.width, u, v })
}

/// Linear interpolation between the four nearest texels.
#[inline]
pub(crate) fn bilinear(level: &Image, texels: TexelUse, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
    match Quad::around(level, uv, wrap) {
        Some(quad) => with_texels(level, texels.alpha, quad),
        None => bilinear_reference(level, texels, uv, wrap),
    }
}

/// As [`bilinear`], by the same steps at the edges and inside.
#[inline(never)]
pub(crate) fn bilinear_reference(level: &Image, texels: TexelUse, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
    let u = Taps::linear(uv.x, level.width, wrap[0]);
    let v = Taps::linear(uv.y, level.height, wrap[1]);
    with_border(level, texels, TensorProduct { width: level.width, u, v })
}

/// The sum of [`bilinear`] over `count` points, at least two, from `first` on.
pub(crate) fn bilinear_row(
    level: &Image,
    texels: TexelUse,
    first: Vec2,
    step: Vec2,
    count: u32,
    wrap: [Wrap; 2],
) -> Vec4 {
    match QuadRow::along(level, first, step, count, wrap) {
        Some(row) => with_texels(level, texels.alpha, row),
        None => (0..count).map(|index| bilinear(level, texels, first + step * index as f32, wrap)).sum(),
    }
}

/// Cubic interpolation between the sixteen nearest texels.
pub(crate) fn bicubic(level: &Image, texels: TexelUse, uv: Vec2, wrap: [Wrap; 2]) -> Vec4 {
    let u = Taps::cubic(uv.x, level.width, wrap[0]);
    let v = Taps::cubic(uv.y, level.height, wrap[1]);
    with_border(level, texels, TensorProduct { width: level.width, u, v })
}
