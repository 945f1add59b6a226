//! Bump maps of models: normal maps, or heights of which normals are made.

use fantex_base::Result;
use fantex_base::srgb::unorm16;
use fantex_mesh::BumpImage;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::read_image;
use crate::look::{Difference, height_change, height_map};
use crate::{ColorSpace, Image, Samples, Wrap};

/// Height of white over black, as a share of the image's longer side. Model files do not say it; materials scale what follows from it.
const RELIEF: f32 = 1.0 / 64.0;

/// A normal map; of heights, the one that they make.
pub(super) fn read(bump: &BumpImage, space: ColorSpace) -> Result<Image> {
    let image = read_image(&bump.source, space)?;
    Ok(if is_grey(&image) { normals(&image, bump.wrap.map(Wrap::from)) } else { image })
}

fn is_grey(image: &Image) -> bool {
    fn is_equal<T: PartialEq + Sync>(samples: &[T], channels: usize) -> bool {
        samples.par_chunks_exact(channels).all(|texel| texel[0] == texel[1] && texel[1] == texel[2])
    }
    let channels = usize::from(image.channels);
    channels < 3
        || match &image.samples {
            Samples::U8(samples) => is_equal(samples, channels),
            Samples::U16(samples) => is_equal(samples, channels),
            Samples::F32(samples) => is_equal(samples, channels),
        }
}

/// In 16 bits, as eight show steps on smooth heights.
fn normals(heights: &Image, wrap: [Wrap; 2]) -> Image {
    let size = [heights.width, heights.height];
    let height = height_map(heights, wrap);
    let relief_texels = RELIEF * size[0].max(size[1]) as f32;
    let normal = |x: i32, y: i32| {
        let at = |offset: Vec2| height(x + offset.x as i32, y + offset.y as i32);
        let slope = height_change(Difference::Central, [1.0; 2], at) * relief_texels;
        // Rows run downwards, the normal's y upwards.
        let normal = Vec3::new(-slope.x, slope.y, 1.0).normalize_or(Vec3::Z);
        (0.5 + 0.5 * normal).to_array().map(unorm16)
    };
    let rows = (0..size[1] as i32).into_par_iter();
    let samples = rows.flat_map_iter(|y| (0..size[0] as i32).flat_map(move |x| normal(x, y))).collect();
    let [width, height] = size;
    Image { width, height, channels: 3, space: ColorSpace::Linear, samples: Samples::U16(samples) }
}
