//! Corner values that nothing can be computed with.

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::CornerAttributes;

/// Replaces values that are NaN or infinite by what corners without the attribute have; returns how many.
pub(super) fn replace_unusable(corners: &mut CornerAttributes) -> u64 {
    let CornerAttributes { normals, uv_sets, colors, tangents } = corners;
    let coordinates: u64 =
        uv_sets.iter_mut().map(|set| replace(set, |uv: &Vec2| uv.is_finite(), Vec2::ZERO)).sum();
    coordinates
        + replace(colors, |color: &Vec4| color.is_finite(), Vec4::ONE)
        // Zero stands for the triangle's own.
        + replace(normals, |normal: &Vec3| normal.is_finite(), Vec3::ZERO)
        + replace(tangents, |tangent: &Vec4| tangent.is_finite(), Vec4::ZERO)
}

fn replace<T: Copy + Send + Sync>(values: &mut [T], is_usable: impl Fn(&T) -> bool + Sync, by: T) -> u64 {
    let replace_in = |block: &mut [T]| {
        let unusable = block.iter_mut().filter(|value| !is_usable(value));
        unusable.map(|value| *value = by).count() as u64
    };
    values.par_chunks_mut(1 << 14).map(replace_in).sum()
}
