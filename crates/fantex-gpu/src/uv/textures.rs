//! Images with their levels as textures.

use std::collections::HashMap;
use std::sync::Arc;

use fantex_texture::color::{srgb8_from_linear, unorm8};
use fantex_texture::{ColorSpace, Image, ImageTexture, Samples};
use half::f16;
use rayon::prelude::*;

use crate::{Gpu, GpuError};

/// The textures of a model, each image once per way of use.
#[derive(Debug, Default)]
pub(super) struct TexturePool {
    views: HashMap<(*const ImageTexture, bool), wgpu::TextureView>,
    /// Keeps the images alive, so that their addresses are theirs alone.
    images: Vec<Arc<ImageTexture>>,
}

impl TexturePool {
    /// The texture of an image; where its alpha is the coverage of a texel, colours are multiplied by it, so that filters
    /// weigh them.
    pub(super) fn view(
        &mut self,
        gpu: &Gpu,
        image: &Arc<ImageTexture>,
        is_premultiplied: bool,
    ) -> Result<wgpu::TextureView, GpuError> {
        let key = (Arc::as_ptr(image), is_premultiplied);
        if let Some(view) = self.views.get(&key) {
            return Ok(view.clone());
        }
        let view = upload(gpu, image, is_premultiplied)?.create_view(&Default::default());
        self.views.insert(key, view.clone());
        self.images.push(Arc::clone(image));
        Ok(view)
    }
}

/// How texels are stored on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Storage {
    Srgb8,
    Linear8,
    /// For images of more than 8 bits.
    Half,
}

impl Storage {
    fn of(image: &Image) -> Self {
        match (&image.samples, image.space) {
            (Samples::U8(_), ColorSpace::Srgb) => Self::Srgb8,
            (Samples::U8(_), ColorSpace::Linear) => Self::Linear8,
            (Samples::U16(_) | Samples::F32(_), _) => Self::Half,
        }
    }

    fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::Srgb8 => wgpu::TextureFormat::Rgba8UnormSrgb,
            Self::Linear8 => wgpu::TextureFormat::Rgba8Unorm,
            Self::Half => wgpu::TextureFormat::Rgba16Float,
        }
    }

    fn texel_bytes(self) -> u32 {
        match self {
            Self::Srgb8 | Self::Linear8 => 4,
            Self::Half => 8,
        }
    }

    /// The bytes of a linear texel.
    fn push(self, [r, g, b, a]: [f32; 4], bytes: &mut Vec<u8>) {
        match self {
            Self::Srgb8 => {
                bytes.extend([srgb8_from_linear(r), srgb8_from_linear(g), srgb8_from_linear(b), unorm8(a)]);
            }
            Self::Linear8 => bytes.extend([r, g, b, a].map(unorm8)),
            Self::Half => {
                let halves = [r, g, b, a].map(|v| f16::from_f32(v.clamp(-65_504.0, 65_504.0)));
                bytes.extend_from_slice(bytemuck::bytes_of(&halves));
            }
        }
    }
}

fn upload(gpu: &Gpu, image: &ImageTexture, is_premultiplied: bool) -> Result<wgpu::Texture, GpuError> {
    let [width, height] = image.size();
    let allowed = gpu.limits().max_texture_dimension_2d;
    if width.max(height) > allowed {
        let side = u64::from(width.max(height));
        return Err(gpu.too_large("a texture", side, u64::from(allowed), "texels along a side"));
    }
    let storage = Storage::of(image.level(0));
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("image"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: image.level_count() as u32,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: storage.format(),
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    for level in 0..image.level_count() {
        let texels = image.level(level);
        let bytes = encode(texels, storage, is_premultiplied && texels.has_alpha());
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level: level as u32, ..texture.as_image_copy() },
            &bytes,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(texels.width * storage.texel_bytes()),
                rows_per_image: None,
            },
            wgpu::Extent3d { width: texels.width, height: texels.height, depth_or_array_layers: 1 },
        );
    }
    Ok(texture)
}

/// The rows of an image, row by row without gaps.
fn encode(image: &Image, storage: Storage, is_premultiplied: bool) -> Vec<u8> {
    if let (Samples::U8(samples), false) = (&image.samples, is_premultiplied) {
        match image.channels {
            4 => return samples.clone(),
            3 => {
                let (rgb, _) = samples.as_chunks::<3>();
                return rgb.par_iter().flat_map_iter(|&[r, g, b]| [r, g, b, 255]).collect();
            }
            _ => {}
        }
    }
    let row = |y: u32| {
        let mut bytes = Vec::with_capacity((image.width * storage.texel_bytes()) as usize);
        for x in 0..image.width {
            let [r, g, b, a] = image.linear_texel(x, y);
            let weight = if is_premultiplied { a } else { 1.0 };
            storage.push([r * weight, g * weight, b * weight, a], &mut bytes);
        }
        bytes
    };
    (0..image.height).into_par_iter().flat_map_iter(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_keep_their_values() {
        let image = |channels, samples| Image {
            width: 1,
            height: 1,
            channels,
            space: ColorSpace::Srgb,
            samples: Samples::U8(samples),
        };
        let plain = |channels, samples| encode(&image(channels, samples), Storage::Srgb8, false);
        assert_eq!(plain(4, vec![1, 2, 3, 4]), [1, 2, 3, 4]);
        assert_eq!(plain(3, vec![1, 2, 3]), [1, 2, 3, 255]);
        assert_eq!(plain(1, vec![77]), [77, 77, 77, 255]);
        assert_eq!(plain(2, vec![77, 9]), [77, 77, 77, 9]);
    }

    #[test]
    fn coverage_weighs_the_light_not_the_bytes() {
        let image = Image {
            width: 1,
            height: 1,
            channels: 4,
            space: ColorSpace::Srgb,
            samples: Samples::U8(vec![255, 188, 0, 128]),
        };
        // 128 of 255 is a little more than a half: of white 188 in sRGB, of 188 (a half) 138.
        assert_eq!(encode(&image, Storage::Srgb8, true), [188, 138, 0, 128]);
    }
}
