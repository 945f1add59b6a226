//! The mean of a reconstructed image over a parallelogram, by regular subsamples.

use fantex_base::vector_level;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch};
use glam::{Vec2, Vec4};

use super::batch::{BLOCK, Block, Colors};
use super::batch_texels::{Meaning, UNIT, eight, load_four, store_rgba, widen};
use super::taps::{
    Kernel, MARGIN_TEXELS, Reconstruction, TRANSPARENT_WEIGHT, Taps, TensorProduct, TexelSource, TexelUse,
    bilinear, floor, recenter, with_border, wrap_index,
};
use crate::image::{ColorSpace, Image, Samples};
use crate::{AlphaUse, Wrap};

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

// ---- Means over many equal footprints at once: those about a texel wide, in images of bytes.
//
// A lane of a vector is a footprint. Its nine weights are the same for all images of equal size; per image three rows of three
// texels are copied, decoded and weighted. See `batch.rs`, whose steps these are.

/// Texels along a side of a footprint's window.
const SIDE: usize = 3;

/// No offset: the window reaches over the image's border.
const NONE: u32 = u32::MAX;

/// Weights of the texels under a block of equal footprints.
#[derive(Clone, Debug)]
pub(crate) struct AreaBlock {
    points: Block<Vec2>,
    count: usize,
    /// Row-major offset of the window's first texel, or [`NONE`]; without, the footprint is no narrow one.
    first: Option<Block<u32>>,
    /// By row, then column.
    weights: [[Block<f32>; SIDE]; SIDE],
}

impl AreaBlock {
    /// Around up to a block of points.
    pub(crate) fn new(plan: &AreaPlan, image: &Image, points: &[Vec2]) -> Self {
        let mut block = Self {
            points: Block([Vec2::ZERO; BLOCK]),
            count: points.len(),
            first: None,
            weights: [[Block([0.0; BLOCK]); SIDE]; SIDE],
        };
        block.points.0[..points.len()].copy_from_slice(points);
        let is_small = u64::from(image.width) * u64::from(image.height) < u64::from(u32::MAX);
        if let Some(window) = plan.window.filter(|window| window.is_narrow && is_small) {
            dispatch!(vector_level(), simd => place(simd, plan, &window, [image.width, image.height], &mut block));
        }
        block
    }

    pub(crate) fn points(&self) -> &[Vec2] {
        &self.points.0[..self.count]
    }

    /// The means of `image`, which has the size that was given; alpha still a weight. Returns the set of those (a bit each) that
    /// must be looked up otherwise.
    pub(crate) fn sums(&self, image: &Image, texels: TexelUse, out: &mut Colors) -> u64 {
        let all = u64::MAX >> (BLOCK - self.count.max(1));
        let (Samples::U8(bytes), Some(first)) = (&image.samples, &self.first) else { return all };
        let source = Source {
            bytes,
            width: image.width as usize,
            first,
            is_srgb: image.space == ColorSpace::Srgb,
            is_coverage: texels.alpha == AlphaUse::Coverage,
        };
        dispatch!(vector_level(), simd => match image.channels {
            1 => sums::<_, 1>(simd, self, &source, out),
            3 => sums::<_, 3>(simd, self, &source, out),
            4 => sums::<_, 4>(simd, self, &source, out),
            _ => all,
        })
    }
}

struct Source<'a> {
    bytes: &'a [u8],
    width: usize,
    first: &'a Block<u32>,
    is_srgb: bool,
    is_coverage: bool,
}

/// As [`Window::new`] and [`Window::gather`].
#[inline(always)]
fn place<S: Simd>(simd: S, plan: &AreaPlan, window: &WindowPlan, size: [u32; 2], block: &mut AreaBlock) {
    let mut offsets = Block([NONE; BLOCK]);
    let mut at = [Block([0.0; BLOCK]); 2];
    for (index, point) in block.points.0.iter().enumerate() {
        (at[0].0[index], at[1].0[index]) = (point.x, point.y);
    }
    let last = size.map(|n| S::f32s::splat(simd, n as f32 - SIDE as f32));
    let zero = S::f32s::splat(simd, 0.0);
    for first in (0..block.count).step_by(S::f32s::LEN) {
        let range = first..first + S::f32s::LEN;
        let u = S::f32s::from_slice(simd, &at[0].0[range.clone()]);
        let v = S::f32s::from_slice(simd, &at[1].0[range.clone()]);
        let x = recentred(simd, u, size[0] as f32, plan.wrap[0]) - 0.5;
        let y = recentred(simd, v, size[1] as f32, plan.wrap[1]) - 0.5;
        let (column, row) = ((x - window.reach.x).floor(), (y - window.reach.y).floor());
        let is_inside =
            column.simd_ge(zero) & row.simd_ge(zero) & column.simd_le(last[0]) & row.simd_le(last[1]);
        let offset = row.to_int::<S::u32s>() * size[0] + column.to_int::<S::u32s>();
        is_inside.select(offset, S::u32s::splat(simd, NONE)).store_slice(&mut offsets.0[range]);
        let from = [x - column + window.first.x, y - row + window.first.y];
        gather(simd, from, window, plan.subsamples, &mut block.weights, first);
    }
    block.first = Some(offsets);
}

/// As the scalar `recenter`.
#[inline(always)]
fn recentred<S: Simd>(simd: S, coordinate: S::f32s, texels: f32, wrap: Wrap) -> S::f32s {
    let position = match wrap {
        Wrap::Repeat => (coordinate - coordinate.floor()) * texels,
        Wrap::Mirror => (coordinate - (coordinate * 0.5).floor() * 2.0) * texels,
        Wrap::Clamp | Wrap::Border => coordinate * texels,
    };
    position.max(S::f32s::splat(simd, -MARGIN_TEXELS)).min(S::f32s::splat(simd, 2.0 * texels + MARGIN_TEXELS))
}

#[inline(always)]
fn gather<S: Simd>(
    simd: S,
    from: [S::f32s; 2],
    window: &WindowPlan,
    subsamples: Subsamples,
    weights: &mut [[Block<f32>; SIDE]; SIDE],
    first: usize,
) {
    let mut sums = [[S::f32s::splat(simd, 0.0); SIDE]; SIDE];
    for row in 0..subsamples.rows {
        for column in 0..subsamples.columns {
            let offset = window.step[0] * column as f32 + window.step[1] * row as f32;
            let (across, down) = (hats(simd, from[0] + offset.x), hats(simd, from[1] + offset.y));
            for y in 0..SIDE {
                for x in 0..SIDE {
                    sums[y][x] += across[x] * down[y];
                }
            }
        }
    }
    for y in 0..SIDE {
        for x in 0..SIDE {
            (sums[y][x] * window.share).store_slice(&mut weights[y][x].0[first..first + S::f32s::LEN]);
        }
    }
}

#[inline(always)]
fn hats<S: Simd>(simd: S, position: S::f32s) -> [S::f32s; SIDE] {
    let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    let mut hats = [zero; SIDE];
    for (texel, hat) in hats.iter_mut().enumerate() {
        *hat = (one - (position - texel as f32).abs()).max(zero);
    }
    hats
}

#[inline(always)]
fn sums<S: Simd, const C: usize>(simd: S, block: &AreaBlock, source: &Source<'_>, out: &mut Colors) -> u64 {
    let count = block.count;
    let meaning = Meaning { is_srgb: source.is_srgb, has_alpha: C == 4 };
    let no_bytes = Block([0_u64; BLOCK]);
    let mut bytes = [[no_bytes; 2]; SIDE];
    let mut missed = 0;
    for index in 0..count {
        let first = source.first.0[index] as usize;
        let mut is_read = true;
        for (row, bytes) in bytes.iter_mut().enumerate() {
            let at = (first + row * source.width) * C;
            match (eight(source.bytes, at), eight(source.bytes, at + 8)) {
                (Some(near), Some(far)) => {
                    bytes[0].0[index] = u64::from_le_bytes(*near);
                    bytes[1].0[index] = u64::from_le_bytes(*far);
                }
                _ => is_read = false,
            }
        }
        missed |= u64::from(!is_read) << index;
    }
    let no_words = Block([[0_u64; 2]; BLOCK]);
    let mut words = [[no_words; 2]; SIDE];
    for (bytes, words) in bytes.iter().zip(&mut words) {
        widen(simd, &bytes[0], meaning, &mut words[0], count);
        // One channel has no texel there.
        if C > 1 {
            widen(simd, &bytes[1], meaning, &mut words[1], count);
        }
    }
    for first in (0..count).step_by(S::f32s::LEN) {
        let mut sum = [S::f32s::splat(simd, 0.0); 4];
        for (words, weights) in words.iter().zip(&block.weights) {
            let [a, b, c, d] = load_four(simd, &words[0].0[first..]);
            let [e, f, g, h] = load_four(simd, &words[1].0[first..]);
            let words = [a, b, c, d, e, f, g, h];
            for (texel, weight) in weights.iter().enumerate() {
                let weight = S::f32s::from_slice(simd, &weight.0[first..first + S::f32s::LEN]);
                sum = weighted::<S, C>(sum, words, texel * C, weight, source.is_coverage);
            }
        }
        store_rgba::<S, C>(simd, sum, out, first);
    }
    missed
}

/// Adds the texel whose samples begin at number `first` of sixteen.
#[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, which keeps arrays in registers")]
#[inline(always)]
fn weighted<S: Simd, const C: usize>(
    mut sum: [S::f32s; 4],
    words: [S::u32s; 8],
    first: usize,
    weight: S::f32s,
    is_coverage: bool,
) -> [S::f32s; 4] {
    let mut color_weight = weight;
    if C == 4 && is_coverage {
        color_weight = weight * (number::<S>(words, first + 3) * UNIT + TRANSPARENT_WEIGHT);
    }
    for channel in 0..C {
        let weight = if channel < 3 { color_weight } else { weight };
        sum[channel] += number::<S>(words, first + channel) * weight;
    }
    sum
}

#[inline(always)]
fn number<S: Simd>(words: [S::u32s; 8], sample: usize) -> S::f32s {
    let word = words[sample / 2];
    let number = if sample % 2 == 1 { word >> 16 } else { word & 0xffff };
    number.bitcast::<S::i32s>().to_float::<S::f32s>()
}

#[cfg(test)]
mod tests {
    use super::*;

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
