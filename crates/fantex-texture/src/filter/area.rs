//! The mean of a reconstructed image over a parallelogram, by regular subsamples.

use glam::{Vec2, Vec4};

use super::taps::{Reconstruction, Taps, TensorProduct};
use super::texel::{Kernel, TexelSource, with_texels};
use crate::image::Image;
use crate::{AlphaUse, Wrap};

/// Subsamples along both edges of the parallelogram.
#[derive(Clone, Copy, Debug)]
struct Subsamples {
    columns: u32,
    rows: u32,
}

/// Most subsamples along one edge; callers choose the level so that this is not reached by sensible footprints.
const MAX_SUBSAMPLES: f32 = 512.0;

/// Mean of the bilinear reconstruction of `level` over the parallelogram around `uv` with the given edges (in uv).
///
/// Along an edge of `l` texels there are `ceil(l + 1/2)` subsamples: two for one texel, where the mean of two linear
/// pieces is exact about a texel's centre, and about one per texel of a long edge, where the errors at the kinks average out.
pub(crate) fn area_bilinear(
    level: &Image,
    alpha: AlphaUse,
    uv: Vec2,
    edges: [Vec2; 2],
    wrap: [Wrap; 2],
) -> Vec4 {
    let subsamples = count(level, edges, |length| (length + 0.5).ceil());
    with_texels(level, alpha, Mean::<2> { level, uv, edges, wrap, subsamples })
}

/// Mean of the nearest-texel reconstruction of `level` over the parallelogram, with four subsamples per texel and axis.
pub(crate) fn area_nearest(
    level: &Image,
    alpha: AlphaUse,
    uv: Vec2,
    edges: [Vec2; 2],
    wrap: [Wrap; 2],
) -> Vec4 {
    let subsamples = count(level, edges, |length| (4.0 * length).ceil());
    with_texels(level, alpha, Mean::<1> { level, uv, edges, wrap, subsamples })
}

fn count(level: &Image, edges: [Vec2; 2], along: impl Fn(f32) -> f32) -> Subsamples {
    let texels = Vec2::new(level.width as f32, level.height as f32);
    // A NaN becomes one subsample.
    let [columns, rows] =
        edges.map(|edge| along((edge * texels).length()).max(1.0).min(MAX_SUBSAMPLES) as u32);
    Subsamples { columns, rows }
}

struct Mean<'a, const N: usize> {
    level: &'a Image,
    uv: Vec2,
    edges: [Vec2; 2],
    wrap: [Wrap; 2],
    subsamples: Subsamples,
}

impl<const N: usize> Kernel for Mean<'_, N>
where
    Taps<N>: Reconstruction,
{
    type Output = Vec4;

    #[inline(always)]
    fn run<T: TexelSource>(self, texels: T) -> Vec4 {
        let Subsamples { columns, rows } = self.subsamples;
        let step = [self.edges[0] / columns as f32, self.edges[1] / rows as f32];
        let first = self.uv - 0.5 * (self.edges[0] + self.edges[1]) + 0.5 * (step[0] + step[1]);
        let mut sum = Vec4::ZERO;
        for row in 0..rows {
            for column in 0..columns {
                let uv = first + step[0] * column as f32 + step[1] * row as f32;
                let u = Taps::at(uv.x, self.level.width, self.wrap[0]);
                let v = Taps::at(uv.y, self.level.height, self.wrap[1]);
                sum += TensorProduct { width: self.level.width, u, v }.run(texels);
            }
        }
        sum / (columns * rows) as f32
    }
}
