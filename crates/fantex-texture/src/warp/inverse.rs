//! Inverse mapping: for each row `y'` and column `x'` of the image, compute `u` and `v` and look the texture up.

use glam::{DVec2, Vec2};
use rayon::prelude::*;

use super::{PlaneMap, WarpError, check_size};
use crate::{Image, ImageTexture, SampleOptions, Wrap};

/// The texture seen through `map`, in an image of `size` (columns, rows): linear RGBA, transparent where it is not seen.
///
/// The footprint of a pixel is the pre-image of its square to first order: the inverse of the map's derivative.
///
/// # Errors
///
/// A side is 0 or longer than [`MAX_SIDE`](super::MAX_SIDE).
pub fn warp_inverse(
    texture: &ImageTexture,
    map: &dyn PlaneMap,
    size: [u32; 2],
    options: &SampleOptions,
) -> Result<Image, WarpError> {
    check_size(size)?;
    let [width, height] = size;
    let mut texels = vec![[0.0; 4]; width as usize * height as usize];
    texels.par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
        for (x, texel) in row.iter_mut().enumerate() {
            let position = DVec2::new(x as f64, y as f64) + 0.5;
            if let Some((uv, footprint)) = look_up(map, position, options.wrap) {
                *texel = texture.sample(uv, footprint, options);
            }
        }
    });
    Ok(Image::from_linear_rgba(width, height, &texels))
}

/// The texture coordinates at a position with their change from pixel to pixel.
fn look_up(map: &dyn PlaneMap, position: DVec2, wrap: [Wrap; 2]) -> Option<(Vec2, [Vec2; 2])> {
    let uv = map.inverse(position)?;
    let derivative = map.jacobian(uv).inverse();
    let folded = DVec2::new(fold(uv.x, wrap[0]), fold(uv.y, wrap[1]));
    let footprint = [derivative.x_axis.as_vec2(), derivative.y_axis.as_vec2()];
    let is_finite = folded.is_finite() && footprint.iter().all(|step| step.is_finite());
    is_finite.then_some((folded.as_vec2(), footprint))
}

/// Moved by whole periods (two images, for mirrored ones) to where single precision is fine.
fn fold(coordinate: f64, wrap: Wrap) -> f64 {
    match wrap {
        Wrap::Repeat | Wrap::Mirror => coordinate.rem_euclid(2.0),
        Wrap::Clamp | Wrap::Border => coordinate.clamp(-1e6, 1e6),
    }
}
