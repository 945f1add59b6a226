//! Mip levels of volumes, made as those of images: half as many voxels along each axis, rounded down, at least one, each the
//! mean over its stretch of the voxels below, in linear light.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::{Volume, sample_bytes};
use crate::color::unorm16;
use crate::filter::{Kernel, Stretch, TexelSource, resolve, stored_channels, stretches, with_samples};
use crate::{AlphaUse, ColorSpace, Depth, Samples};

/// How the voxels of coarser levels are stored.
fn level_depth(base: Depth) -> Depth {
    if base == Depth::U8 { Depth::U16 } else { Depth::F32 }
}

/// Voxels along each axis of the next coarser level; `None` after a single voxel.
fn next_size(size: [u32; 3]) -> Option<[u32; 3]> {
    (size != [1; 3]).then(|| size.map(|side| (side / 2).max(1)))
}

/// Bytes of a volume with all its levels; saturates.
pub(super) fn bytes_with_levels(size: [u32; 3], channels: u8, depth: Depth) -> u64 {
    let bytes = |size: [u32; 3], depth| {
        let voxels = size.iter().fold(1_u64, |product, &side| product.saturating_mul(u64::from(side)));
        voxels.saturating_mul(u64::from(channels) * sample_bytes(depth))
    };
    let coarser = std::iter::successors(next_size(size), |&size| next_size(size));
    coarser.map(|size| bytes(size, level_depth(depth))).fold(bytes(size, depth), u64::saturating_add)
}

/// All levels above `base`, down to a single voxel.
pub(super) fn build(base: &Volume, alpha: AlphaUse) -> Vec<Volume> {
    let depth = level_depth(base.samples.depth());
    let mut levels: Vec<Volume> = Vec::new();
    loop {
        let parent = levels.last().unwrap_or(base);
        let Some(size) = next_size(parent.size) else { return levels };
        let kernel = Halve { parent, size, alpha, depth };
        let samples = with_samples(&parent.samples, parent.channels, parent.space, alpha, kernel);
        let spacing = parent.extent() / Vec3::from(size.map(|side| side as f32));
        let level = Volume { size, channels: parent.channels, space: ColorSpace::Linear, samples, spacing };
        levels.push(level);
    }
}

struct Halve<'a> {
    parent: &'a Volume,
    size: [u32; 3],
    alpha: AlphaUse,
    depth: Depth,
}

impl Kernel for Halve<'_> {
    type Output = Samples;

    fn run<T: TexelSource>(self, voxels: T) -> Samples {
        let [columns, rows, slices] = self.parent.size.map(stretches);
        let [parent_width, parent_height, _] = self.parent.size.map(|side| side as usize);
        let channels = usize::from(self.parent.channels);
        let voxel = |slice: &Stretch, row: &Stretch, column: &Stretch| {
            let mut sum = Vec4::ZERO;
            for (z, slice_weight) in slice.parents() {
                for (y, row_weight) in row.parents() {
                    let first = (z * parent_height + y) * parent_width;
                    for (x, weight) in column.parents() {
                        sum += voxels.fetch(first + x) * (slice_weight * row_weight * weight);
                    }
                }
            }
            stored_channels(resolve(sum, self.alpha), channels)
        };
        // In parallel over all rows of all slices.
        let value_rows = (0..slices.len() * rows.len()).into_par_iter().flat_map_iter(|index| {
            let (slice, row) = (&slices[index / rows.len()], &rows[index % rows.len()]);
            let columns = &columns;
            let voxel = &voxel;
            columns.iter().flat_map(move |column| voxel(slice, row, column).into_iter().take(channels))
        });
        debug_assert_eq!(self.size.map(|side| side as usize), [columns.len(), rows.len(), slices.len()]);
        if self.depth == Depth::U16 {
            Samples::U16(value_rows.map(unorm16).collect())
        } else {
            Samples::F32(value_rows.collect())
        }
    }
}
