//! The mean of a reconstructed image over a parallelogram, by regular subsamples.

mod batch;

use glam::{Vec2, Vec4};

pub(crate) use self::batch::AreaBlock;
use super::taps::{
    MARGIN_TEXELS, Reconstruction, Taps, TensorProduct, bilinear, floor, recenter, wrap_index,
};
use super::texel::{Kernel, TexelSource, TexelUse, with_border};
use crate::Wrap;
use crate::image::Image;

/// Subsamples along both edges of the parallelogram.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Subsamples {
    columns: u32,
    rows: u32,
}

impl Subsamples {
    fn count(self) -> u32 {
        self.columns * self.rows
    }
}

/// Most subsamples along one edge; callers choose the level so that this is not reached by sensible footprints.
const MAX_SUBSAMPLES: f32 = 512.0;

/// A footprint prepared for many look-ups on one level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AreaPlan {
    wrap: [Wrap; 2],
    subsamples: Subsamples,
    /// From subsample to subsample along both edges, in uv.
    step: [Vec2; 2],
    /// From the centre to the first subsample, in uv.
    first: Vec2,
    /// The same in texels, if the subsamples fit into a [`Window`].
    window: Option<WindowPlan>,
}

impl AreaPlan {
    /// For the mean of the bilinear reconstruction of `level` over parallelograms with the given edges (in uv).
    ///
    /// Along an edge of `l` texels there are `l + 1/2` subsamples, rounded up: two for one texel, where the mean of two
    /// linear pieces is exact about a texel's centre, and about one per texel of a long edge, where the errors at the kinks
    /// average out.
    pub(crate) fn bilinear(level: &Image, edges: [Vec2; 2], wrap: [Wrap; 2]) -> Self {
        let mut plan = Self::new(level, edges, wrap, |length| length + 0.5);
        if plan.subsamples.count() > 1 {
            plan.window = WindowPlan::new(level, plan.step, plan.subsamples);
        }
        plan
    }

    /// For the mean of the nearest-texel reconstruction, with four subsamples per texel and axis.
    pub(crate) fn nearest(level: &Image, edges: [Vec2; 2], wrap: [Wrap; 2]) -> Self {
        Self::new(level, edges, wrap, |length| 4.0 * length)
    }

    fn new(level: &Image, edges: [Vec2; 2], wrap: [Wrap; 2], count: impl Fn(f32) -> f32) -> Self {
        // Along a side of one texel all places are alike, unless there is something else beside it.
        let varies =
            |texels: u32, wrap: Wrap| if texels > 1 || wrap == Wrap::Border { texels as f32 } else { 0.0 };
        let size = Vec2::new(varies(level.width, wrap[0]), varies(level.height, wrap[1]));
        // A NaN becomes one subsample.
        let [columns, rows] =
            edges.map(|edge| (count((edge * size).length()).min(MAX_SUBSAMPLES) + 0.9999).max(1.0) as u32);
        let step = [edges[0] / columns as f32, edges[1] / rows as f32];
        let first = 0.5 * (step[0] + step[1] - edges[0] - edges[1]);
        Self { wrap, subsamples: Subsamples { columns, rows }, step, first, window: None }
    }

    /// The mean of the bilinear reconstruction around `uv`.
    #[inline]
    pub(crate) fn bilinear_mean(&self, level: &Image, texels: TexelUse, uv: Vec2) -> Vec4 {
        let (size, wrap, subsamples) = ([level.width, level.height], self.wrap, self.subsamples);
        match &self.window {
            // Three by three texels, or four by four.
            Some(plan) if plan.is_narrow => {
                with_border(level, texels, Window::<3>::new(size, uv, wrap, subsamples, plan))
            }
            Some(plan) => with_border(level, texels, Window::<WINDOW>::new(size, uv, wrap, subsamples, plan)),
            None if subsamples.count() == 1 => bilinear(level, texels, uv, wrap),
            None => with_border(level, texels, Mean::<2> { level, uv, plan: self }),
        }
    }

    /// The mean of the nearest-texel reconstruction around `uv`.
    pub(crate) fn nearest_mean(&self, level: &Image, texels: TexelUse, uv: Vec2) -> Vec4 {
        with_border(level, texels, Mean::<1> { level, uv, plan: self })
    }
}

fn level_size(level: &Image) -> Vec2 {
    Vec2::new(level.width as f32, level.height as f32)
}

#[derive(Clone, Copy)]
struct Mean<'a, const N: usize> {
    level: &'a Image,
    uv: Vec2,
    plan: &'a AreaPlan,
}

impl<const N: usize> Kernel for Mean<'_, N>
where
    Taps<N>: Reconstruction,
{
    type Output = Vec4;

    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let AreaPlan { subsamples: Subsamples { columns, rows }, step, wrap, .. } = *self.plan;
        let first = self.uv + self.plan.first;
        let mut sum = Vec4::ZERO;
        for row in 0..rows {
            for column in 0..columns {
                let uv = first + step[0] * column as f32 + step[1] * row as f32;
                let u = Taps::at(uv.x, self.level.width, wrap[0]);
                let v = Taps::at(uv.y, self.level.height, wrap[1]);
                sum += TensorProduct { width: self.level.width, u, v }.run(texels);
            }
        }
        sum / (columns * rows) as f32
    }
}

/// Most texels along a side of the window of a small footprint.
const WINDOW: usize = 4;

/// The subsamples of a small footprint share their texels: their weights are gathered over a window of `N` x `N` texels, so
/// that every texel is decoded once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window<const N: usize> {
    /// Texels of the level.
    size: [u32; 2],
    wrap: [Wrap; 2],
    /// Column and row of the window's first texel, before wrapping.
    origin: [i32; 2],
    /// By row, then column; 0 from `N` on.
    weights: [Vec4; N],
}

/// The part of a window that does not depend on the look-up's centre, in texels.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WindowPlan {
    step: [Vec2; 2],
    /// From the centre to the first subsample.
    first: Vec2,
    /// From the centre to the farthest subsample along x and y.
    reach: Vec2,
    /// One over the number of subsamples.
    share: f32,
    /// Whether three texels along a side are enough.
    is_narrow: bool,
}

impl WindowPlan {
    fn new(level: &Image, step_uv: [Vec2; 2], subsamples: Subsamples) -> Option<Self> {
        let step = step_uv.map(|step| step * level_size(level));
        let to_last = [step[0] * (subsamples.columns - 1) as f32, step[1] * (subsamples.rows - 1) as f32];
        let reach = 0.5 * (to_last[0].abs() + to_last[1].abs());
        let share = 1.0 / subsamples.count() as f32;
        let first = -0.5 * (to_last[0] + to_last[1]);
        // A span of one texel touches the hats of three at most, a span of two those of four. Rounding can make a span
        // a little longer; the weight that is lost then is as small.
        let is_narrow = reach.max_element() <= 0.5;
        (reach.max_element() <= 1.0).then_some(Self { step, first, reach, share, is_narrow })
    }
}

impl<const N: usize> Window<N> {
    #[inline(always)]
    fn new(size: [u32; 2], uv: Vec2, wrap: [Wrap; 2], subsamples: Subsamples, plan: &WindowPlan) -> Self {
        let center =
            Vec2::new(recenter(uv.x, size[0], wrap[0]) - 0.5, recenter(uv.y, size[1], wrap[1]) - 0.5);
        let low = center - plan.reach;
        let origin = [floor(low.x), floor(low.y)];
        let first = center - Vec2::new(origin[0] as f32, origin[1] as f32) + plan.first;
        Self { size, wrap, origin, weights: Self::gather(first, plan, subsamples) }
    }

    /// Sums the hat functions of all subsamples; `first` is relative to the window's first texel.
    #[inline(always)]
    fn gather(first: Vec2, plan: &WindowPlan, subsamples: Subsamples) -> [Vec4; N] {
        let step = plan.step;
        let texels = Vec4::new(0.0, 1.0, 2.0, 3.0);
        let hat = |position: f32| (1.0 - (texels - position).abs()).max(Vec4::ZERO);
        let mut weights = [Vec4::ZERO; N];
        for row in 0..subsamples.rows {
            for column in 0..subsamples.columns {
                let position = first + step[0] * column as f32 + step[1] * row as f32;
                let (across, down) = (hat(position.x), hat(position.y).to_array());
                for (weight, down) in weights.iter_mut().zip(down) {
                    *weight += across * down;
                }
            }
        }
        weights.map(|weight| weight * plan.share)
    }

    /// The row-major offset of the first texel where no texel of the window wraps.
    #[inline(always)]
    fn inner_offset(&self) -> Option<usize> {
        let [column, row] = self.origin;
        let last = self.size.map(|n| n as i32 - N as i32);
        let is_inside = column >= 0 && row >= 0 && column <= last[0] && row <= last[1];
        is_inside.then(|| row as usize * self.size[0] as usize + column as usize)
    }

    /// The sum over a window that reaches over the image's border.
    #[cold]
    fn wrapped<T: TexelSource>(&self, texels: T) -> Vec4 {
        let width = self.size[0] as usize;
        let mut sum = Vec4::ZERO;
        for (row, weights) in self.weights.iter().enumerate() {
            let wrapped = wrap_index(self.origin[1] + row as i32, self.size[1], self.wrap[1]);
            let Some(first) = wrapped.map(|row| row * width) else { continue };
            for (column, weight) in weights.to_array().into_iter().take(N).enumerate() {
                let wrapped = wrap_index(self.origin[0] + column as i32, self.size[0], self.wrap[0]);
                if let Some(column) = wrapped {
                    sum += texels.fetch(first + column) * weight;
                }
            }
        }
        sum
    }
}

impl<const N: usize> Kernel for Window<N> {
    type Output = Vec4;

    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let Some(first) = self.inner_offset() else { return self.wrapped(texels) };
        let width = self.size[0] as usize;
        let mut sum = Vec4::ZERO;
        for (row, weights) in self.weights.into_iter().enumerate() {
            let weights = weights.to_array();
            for (column, texel) in texels.fetch_run::<N>(first + row * width).into_iter().enumerate() {
                sum += texel * weights[column];
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ColorSpace, Samples};

    /// However large a footprint, an image of one texel is asked once, and along a row of texels only lengths count.
    #[test]
    fn sides_of_one_texel_take_no_subsamples() {
        let image = |width: u32, height: u32| Image {
            width,
            height,
            channels: 1,
            space: ColorSpace::Linear,
            samples: Samples::U8(vec![7; (width * height) as usize]),
        };
        let count = |image: &Image, edges: [Vec2; 2], wrap: Wrap| {
            let plans = [AreaPlan::bilinear, AreaPlan::nearest].map(|plan| plan(image, edges, [wrap; 2]));
            plans.map(|plan| plan.subsamples.count())
        };
        for edges in [[Vec2::splat(1e30), Vec2::splat(-1e30)], [Vec2::X * 40.0, Vec2::Y * 40.0]] {
            assert_eq!(count(&image(1, 1), edges, Wrap::Repeat), [1, 1]);
        }
        let long = [Vec2::new(0.5, 300.0), Vec2::Y * 300.0];
        assert_eq!(count(&image(8, 1), long, Wrap::Clamp), [5, 16]);
        assert!(count(&image(1, 1), long, Wrap::Border)[0] > 1000);
    }
}
